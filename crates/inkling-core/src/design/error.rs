//! Why a design cannot be made or used; and what numbers of a design or signal must be.

use crate::isolate::IsolateMethod;
use thiserror::Error;

/// A result whose error, unless another is named, is a [`DesignError`].
pub type Result<T, E = DesignError> = std::result::Result<T, E>;

/// Why a design cannot be made or used.
#[derive(Debug, Error)]
pub enum DesignError {
    /// The signals give no average or no model.
    #[error(transparent)]
    Identify(#[from] crate::identify::IdentifyError),
    /// The filter or the threshold cannot be made.
    #[error(transparent)]
    Detect(#[from] crate::detect::DetectError),
    /// The isolator cannot be made.
    #[error(transparent)]
    Isolate(#[from] crate::isolate::IsolateError),
    /// Anything else, in words for the user.
    #[error("{0}")]
    Invalid(String),
}

impl From<String> for DesignError {
    fn from(words: String) -> DesignError {
        DesignError::Invalid(words)
    }
}

impl From<&str> for DesignError {
    fn from(words: &str) -> DesignError {
        DesignError::Invalid(words.into())
    }
}

impl DesignError {
    /// The error with what helps against it. `labelled`: whether labels say what is healthy.
    pub fn advice(&self, labelled: bool) -> String {
        match self {
            DesignError::Identify(e) => e.advice(labelled),
            e => e.to_string(),
        }
    }

    /// The error of a method of isolation that the design was not trained with.
    pub(super) fn untrained(method: IsolateMethod) -> DesignError {
        let method = method.as_str();
        format!(
            "isolate.method = \"{method}\": the design was not trained with it; train with --set \
             isolate.method={method}"
        )
        .into()
    }
}

/// An error in these words unless `holds`.
pub(super) fn must(holds: bool, words: impl Into<String>) -> Result<(), String> {
    if holds { Ok(()) } else { Err(words.into()) }
}

/// Whether a number may be counts: sums of squares are finite, too.
pub(super) fn is_count(v: &f64) -> bool {
    v.abs() <= 1e30
}

/// Whether a row has one number per sample, which may be counts.
pub(super) fn is_signal(row: &[f64], samples: usize) -> bool {
    row.len() == samples && row.iter().all(is_count)
}

/// Whether two sample periods, s, are equal by the contract: up to 1e-6 relative.
pub fn same_period(p: f64, q: f64) -> bool {
    (p / q - 1.0).abs() <= 1e-6
}
