//! Why a design cannot be made or used, and what its numbers must be.

use crate::isolate::IsolateMethod;
use thiserror::Error;

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
    /// In words, with what helps. `labelled`: labels say which signals are healthy.
    pub fn advice(&self, labelled: bool) -> String {
        match self {
            DesignError::Identify(e) => e.advice(labelled),
            e => e.to_string(),
        }
    }

    pub(super) fn untrained(method: IsolateMethod) -> DesignError {
        let method = method.as_str();
        DesignError::Invalid(format!(
            "isolate.method = \"{method}\": the design was not trained with it; train with --set \
             isolate.method={method}"
        ))
    }
}

/// Whether a number may be counts: finite, and far from where its square is not.
pub(super) fn is_count(v: f64) -> bool {
    v.abs() <= 1e30
}

/// Whether a number may be a positive rate, frequency or size of counts: its square and its inverse
/// square are numbers too.
pub(super) fn is_positive(v: f64) -> bool {
    (1e-30..=1e30).contains(&v)
}

/// Equal sample periods, contract: up to 1e-6 relative.
pub fn same_period(p: f64, q: f64) -> bool {
    (p / q - 1.0).abs() <= 1e-6
}
