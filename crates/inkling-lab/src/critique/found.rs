//! Holds what is found apart from the causes that move the expected signal: in the converter's codes, in the
//! noise, in the trigger. These findings are accepted by their own significance and do not go through the
//! selection. `engine.rs` fills an [`Aside`] from `codes.rs`, `ensemble.rs` and `jitter.rs`.

use super::candidate::Candidate;
use super::catalogue::CauseId;

/// The size of a cause (the catalogue's parameter, in its unit) if it is among `found` and accepted.
pub fn accepted(found: &[Candidate], id: CauseId) -> Option<f64> {
    found.iter().find(|f| f.id == id && f.accepted()).map(|f| f.value)
}

/// What was tested in codes, and in noise and trigger, accepted or not.
#[derive(Clone, Debug, Default)]
pub struct Aside {
    pub codes: Vec<Candidate>,
    pub noise: Vec<Candidate>,
    /// -ln of the probability that noise gives such misfits to those few signals that ring like the others
    /// but have a far larger misfit (`Outliers::shaped`); 0: nothing odd.
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
