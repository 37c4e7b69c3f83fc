//! The error of the room `design`: why a design cannot be made or used. And the small rules, shared
//! by its files, of what numbers of a design or signal must be.

use crate::isolate::IsolateMethod;
use thiserror::Error;

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

impl DesignError {
    /// The error in words, with what helps against it. `labelled`: whether labels say which signals
    /// are healthy, since other things help then.
    pub fn advice(&self, labelled: bool) -> String {
        match self {
            DesignError::Identify(e) => e.advice(labelled),
            e => e.to_string(),
        }
    }

    /// The error of a method of isolation that the design was not trained with.
    pub(super) fn untrained(method: IsolateMethod) -> DesignError {
        let method = method.as_str();
        DesignError::Invalid(format!(
            "isolate.method = \"{method}\": the design was not trained with it; train with --set \
             isolate.method={method}"
        ))
    }
}

/// Whether a number may be counts: finite, and so small that sums of its squares are finite, too.
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
