//! The outcome of a critique, or why there is none.

use super::extended::{Extended, NotExtended};
use super::finding::Critique;
use thiserror::Error;

/// Fewest signals that a critique of ink channels needs, and fewest samples of each.
pub const FEWEST_SIGNALS: usize = 8;
pub const FEWEST_SAMPLES: usize = 16;

/// Why there is no critique.
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

/// A critique, with the model that it ended with.
pub struct Outcome {
    pub critique: Critique,
    /// For each row whether it was left out as unlike the others.
    pub outlier: Vec<bool>,
    /// The model that a design's extension is made from (ink channels only), or why there is none.
    pub extended: Result<Extended, NotExtended>,
}
