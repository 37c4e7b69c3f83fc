//! The promise of a design: what it says of itself before any data are judged. How small a fault of
//! each class is found, and how well two classes are told apart. These are the result types alone.

use serde::Serialize;

/// A fault of some size counts as found if at least this share of its signals is flagged.
pub const FOUND: f64 = 0.9;

#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Promise {
    /// Share of healthy signals that the threshold is meant to flag; `None`: it is no quantile.
    pub false_alarm_rate: Option<f64>,
    /// Only classes that the physics can predict.
    pub classes: Vec<Detectable>,
    /// Those that are mistaken for each other most come first.
    pub pairs: Vec<Pair>,
    /// Number of signals of each class and size.
    pub draws: usize,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Detectable {
    pub class: String,
    /// Least and largest severity that the class's name stands for, in its unit.
    pub range: [f64; 2],
    /// The smallest severity from which on all severities are found, see [`FOUND`].
    pub smallest: Option<f64>,
    /// Share of signals flagged, of severities evenly over `range` on the scale of the class's law.
    pub found: f64,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Pair {
    pub classes: [String; 2],
    /// Share of flagged signals for which the other class has the largest weight, both directions.
    pub mistaken: f64,
    /// Smallest angle, degrees, between what their faults do to a signal. 0: alike up to their size.
    pub angle_degrees: f64,
}
