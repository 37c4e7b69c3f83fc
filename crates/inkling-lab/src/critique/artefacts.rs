//! What is found apart from the causes that move the expected signal: in the converter's codes, in the noise,
//! in the trigger. These findings are accepted by their own significance.

use super::candidate::Candidate;
use super::catalogue::CauseId;

/// The value of a cause if it is among `found` and accepted.
pub fn accepted(found: &[Candidate], id: CauseId) -> Option<f64> {
    found.iter().find(|f| f.id == id && f.accepted()).map(|f| f.value)
}

/// What was tested in codes, and in noise and trigger, accepted or not.
#[derive(Clone, Debug, Default)]
pub struct Artefacts {
    pub codes: Vec<Candidate>,
    pub noise: Vec<Candidate>,
    /// `Outliers::shape_surprise`; 0: nothing odd.
    pub odd_signals: f64,
}

impl Artefacts {
    pub fn all(&self) -> impl Iterator<Item = &Candidate> {
        self.codes.iter().chain(&self.noise)
    }

    pub fn accepted(&self) -> impl Iterator<Item = &Candidate> {
        self.all().filter(|f| f.accepted())
    }
}
