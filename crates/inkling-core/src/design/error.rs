//! Why a design cannot be made or used.

use crate::isolate::IsolateMethod;
use thiserror::Error;

/// A result whose error, unless another is named, is a [`DesignError`].
pub type Result<T, E = DesignError> = std::result::Result<T, E>;

#[derive(Debug, Error)]
pub enum DesignError {
    #[error(transparent)]
    Identify(#[from] crate::identify::IdentifyError),
    #[error(transparent)]
    Detect(#[from] crate::detect::DetectError),
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

/// Whether two sample periods, s, are equal by the contract: up to 1e-6 relative.
pub fn same_period(p: f64, q: f64) -> bool {
    (p / q - 1.0).abs() <= 1e-6
}
