//! What chapter 4 gives, and why it may not.

use serde::Serialize;
use std::collections::BTreeMap;
use thiserror::Error;

#[derive(Debug, Error)]
pub enum ThesisError {
    #[error("scenario: {0}")]
    Scenario(String),
    #[error(transparent)]
    Design(#[from] crate::design::DesignError),
    #[error(transparent)]
    Detect(#[from] crate::detect::DetectError),
    #[error(transparent)]
    Plot(#[from] crate::plot::PlotError),
    #[error("{path}: {source}")]
    Write { path: String, source: std::io::Error },
}

/// Signals of class (row) that were named so (column); a mean over seeds.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Confusion {
    pub classes: Vec<String>,
    pub counts: Vec<Vec<f64>>,
}

/// What one seed gives, by name.
#[derive(Clone, Debug, Default)]
pub struct Figures {
    pub values: BTreeMap<String, f64>,
    pub confusions: BTreeMap<String, Confusion>,
}

/// A figure over seeds.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Spread {
    pub mean: f64,
    /// From seed to seed.
    pub sd: f64,
    pub least: f64,
    pub most: f64,
}

/// Chapter 4 over seeds.
#[derive(Clone, Debug, Serialize)]
pub struct Chapter {
    pub seeds: Vec<u64>,
    pub values: BTreeMap<String, Spread>,
    pub confusions: BTreeMap<String, Confusion>,
}
