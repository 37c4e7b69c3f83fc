//! What is found beside the causes that move what is expected: in codes, in noise, in the trigger.

use super::candidate::Candidate;
use super::catalogue::CauseId;

/// The value of a cause among those found.
pub fn accepted(found: &[Candidate], id: CauseId) -> Option<f64> {
    found.iter().find(|f| f.id == id && f.accepted()).map(|f| f.value)
}

/// What was found in codes, and in noise and trigger.
#[derive(Clone, Debug, Default)]
pub struct Aside {
    pub codes: Vec<Candidate>,
    pub noise: Vec<Candidate>,
    /// -ln of the chance of the misfits that few signals have, and that are left out for them.
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
