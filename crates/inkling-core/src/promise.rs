//! What a design says of itself before any data are judged: how small a fault it finds, and which classes
//! it tells apart. Made by the design, shown by the evaluation.

use serde::Serialize;

/// Found in so many of its signals.
pub const FOUND: f64 = 0.9;

/// Of one healthy model.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Promise {
    /// Share of healthy signals that its threshold is meant for; `None`: not by a quantile.
    pub false_alarm_rate: Option<f64>,
    pub classes: Vec<Detectable>,
    /// Those that are mistaken for each other most come first.
    pub pairs: Vec<Pair>,
    /// Signals drawn of each class and size.
    pub draws: usize,
}

/// How small a fault of a class is found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Detectable {
    pub class: String,
    /// Severities that the class's name stands for.
    pub range: [f64; 2],
    /// The smallest that is found in [`FOUND`] of its signals, and so are larger ones; `None`: none is.
    pub smallest: Option<f64>,
    /// Share of signals flagged, all sizes of the class as likely as each other.
    pub found: f64,
}

/// Two classes, and how often a flagged signal of one is taken for the other.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Pair {
    pub classes: [String; 2],
    /// Mean of both ways.
    pub mistaken: f64,
    /// Between what faults of the two do to a signal, in the metric of noise and healthy spread, at their nearest: 0
    /// where some fault of the one looks like one of the other, up to its size; 90 where they have nothing in common.
    pub angle_degrees: f64,
}
