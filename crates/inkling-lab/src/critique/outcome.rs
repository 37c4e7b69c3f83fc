//! What a critique returns: an [`Outcome`], or a [`CritiqueError`] that says why there is none.

use super::extended::{Extended, NotExtended};
use super::finding::Critique;
use thiserror::Error;

/// Fewest signals, of all ink channels together, and fewest samples of each signal of any plant, that a
/// critique needs.
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
    #[error(
        "nothing rings in these signals: one damped oscillation explains less than a tenth of them, or no more than chance would"
    )]
    NoRing,
    #[error(
        "no burst holds all {outputs} outputs of the oscillator: each of its decays must be one burst of all of them"
    )]
    NoCompleteBurst { outputs: usize },
    #[error(
        "these are signals of {printheads} printheads, and all outputs of an oscillator are one system: criticise \
         one printhead at a time, by recordings of it alone or by --labels that name no other"
    )]
    SeveralPrintheads { printheads: usize },
    #[error(
        "{outputs} channels are more than the {most} outputs that an oscillator may have: record or convert fewer"
    )]
    ManyOutputs { outputs: usize, most: usize },
    #[error("output {channel} of the oscillator never moves: record the others alone")]
    StillOutput { channel: u32 },
}

pub struct Outcome {
    pub critique: Critique,
    /// For each row of the given observations whether the signal was left out as unlike the others.
    pub outlier: Vec<bool>,
    /// The model for a design's extension (ink channels only), or why there is none.
    pub extended: Result<Extended, NotExtended>,
}
