//! What a critique ends with, or why there is none.

use super::extended::{Extended, NotExtended};
use super::finding::Critique;
use thiserror::Error;

/// Signals that a critique needs at least, and samples of each.
pub const FEWEST_SIGNALS: usize = 8;
pub const FEWEST_SAMPLES: usize = 16;

#[derive(Debug, Error)]
pub enum CritiqueError {
    #[error(
        "{found} usable signals of an ink channel: a critique needs {FEWEST_SIGNALS} at least (few, long decays \
         of something else: --plant oscillator)"
    )]
    TooFew { found: usize },
    #[error("signals of {samples} samples: a critique needs {FEWEST_SAMPLES} at least")]
    TooShort { samples: usize },
    #[error("nothing rings in these signals: one damped oscillation explains less than a tenth")]
    NoRing,
}

/// A critique, and the model that it ended with.
pub struct Outcome {
    pub critique: Critique,
    /// Rows that were left out as unlike the others.
    pub outlier: Vec<bool>,
    /// Of an ink channel: the causes' part of it makes a design's extension.
    pub extended: Result<Extended, NotExtended>,
}
