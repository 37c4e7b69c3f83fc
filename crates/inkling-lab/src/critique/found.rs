//! What is found apart from the causes that move the expected signal: in codes, in noise, in the trigger.

use super::candidate::Candidate;
use super::catalogue::CauseId;

/// The value of a cause, if it was found and accepted.
pub fn accepted(found: &[Candidate], id: CauseId) -> Option<f64> {
    found.iter().find(|f| f.id == id && f.accepted()).map(|f| f.value)
}

/// What was found in codes, and in noise and trigger.
#[derive(Clone, Debug, Default)]
pub struct Aside {
    pub codes: Vec<Candidate>,
    pub noise: Vec<Candidate>,
    /// -ln of the probability by chance of the misfits of those few signals that ring like the others and
    /// were left out for their misfit.
    pub odd_signals: f64,
}

impl Aside {
    pub fn all(&self) -> impl Iterator<Item = &Candidate> {
        self.codes.iter().chain(&self.noise)
    }

    pub fn accepted(&self) -> impl Iterator<Item = &Candidate> {
        self.all().filter(|f| f.accepted())
    }
}
