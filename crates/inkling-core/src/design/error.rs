//! Why a design cannot be made or used, and what its numbers must be.

use crate::isolate::IsolateMethod;
use thiserror::Error;

/// Why a design cannot be made or used.
#[derive(Debug, Error)]
pub enum DesignError {
    #[error(transparent)]
    Identify(#[from] crate::identify::IdentifyError),
    #[error(transparent)]
    Detect(#[from] crate::detect::DetectError),
    #[error(transparent)]
    Isolate(#[from] crate::isolate::IsolateError),
    #[error("{0}")]
    Invalid(String),
}

impl DesignError {
    /// The error in words, with what helps. `labelled`: labels say which signals are healthy.
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

/// Whether a number may be counts: finite, and so small that its square is finite, too.
pub(super) fn is_count(v: &f64) -> bool {
    v.abs() <= 1e30
}

/// Whether a row has one number per sample, which may be counts.
pub(super) fn is_signal(row: &[f64], samples: usize) -> bool {
    row.len() == samples && row.iter().all(is_count)
}

/// Whether two sample periods are equal by the contract: up to 1e-6 relative.
pub fn same_period(p: f64, q: f64) -> bool {
    (p / q - 1.0).abs() <= 1e-6
}
