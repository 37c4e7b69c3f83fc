//! What a design says of itself before any data are judged: how small a fault it finds, and which classes it
//! tells apart. Made by the design, shown by the evaluation.

use serde::Serialize;

/// A fault counts as found if this share of its signals is flagged.
pub const FOUND: f64 = 0.9;

/// The power analysis of one healthy model.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Promise {
    /// Share of healthy signals that the model's threshold is meant to flag; `None`: the threshold is no
    /// quantile.
    pub false_alarm_rate: Option<f64>,
    /// How small a fault of each class is found.
    pub classes: Vec<Detectable>,
    /// Pairs of classes; those that are mistaken for each other most come first.
    pub pairs: Vec<Pair>,
    /// Number of signals that were drawn of each class and size.
    pub draws: usize,
}

/// How small a fault of a class is found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Detectable {
    pub class: String,
    /// Severities that the class's name stands for.
    pub range: [f64; 2],
    /// The smallest severity that is found in [`FOUND`] of its signals, as all larger ones are; `None`: no
    /// severity is.
    pub smallest: Option<f64>,
    /// Share of signals flagged, all sizes of the class being equally likely.
    pub found: f64,
}

/// Two classes, and how often a flagged signal of one is taken for the other.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Pair {
    pub classes: [String; 2],
    /// Share of the flagged signals that is taken for the other class, the mean of both ways.
    pub mistaken: f64,
    /// Angle between what faults of the two classes do to a signal, in the metric of noise and healthy
    /// spread, at their nearest: 0 if some fault of the one looks like one of the other, up to its size; 90
    /// if they have nothing in common.
    pub angle_degrees: f64,
}
