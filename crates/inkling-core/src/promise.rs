//! The promise of a design: what it says of itself before any data are judged. How small a fault of
//! each class is found, and how well two classes are told apart.
//!
//! These are the result types alone. `design/promise.rs` makes them by Monte Carlo; `inkling
//! score`, `inkling identify` and the page of an evaluation (`report/promised.rs`) show them.

use serde::Serialize;

/// A fault of some size counts as found if at least this share of its signals is flagged.
pub const FOUND: f64 = 0.9;

/// The power analysis of one healthy model.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Promise {
    /// Share of healthy signals that the model's threshold is meant to flag; `None`: the threshold
    /// is no quantile.
    pub false_alarm_rate: Option<f64>,
    /// How small a fault of each class is found; only classes that the physics can predict.
    pub classes: Vec<Detectable>,
    /// Pairs of classes; those that are mistaken for each other most come first.
    pub pairs: Vec<Pair>,
    /// Number of signals that were drawn of each class and size.
    pub draws: usize,
}

/// How small a fault of a class is found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Detectable {
    /// Name of the class.
    pub class: String,
    /// Least and largest severity that the class's name stands for, in its unit
    /// (`schemas/verdicts.md`).
    pub range: [f64; 2],
    /// The smallest severity from which on all severities are found, see [`FOUND`]. `None`: not
    /// even the largest severity is found.
    pub smallest: Option<f64>,
    /// Share of signals flagged, of severities evenly over `range` on the scale of the class's law
    /// (the logarithm of a factor, or a share itself).
    pub found: f64,
}

/// Two classes, and how often a flagged signal of one is taken for the other.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Pair {
    /// Names of the two classes.
    pub classes: [String; 2],
    /// Share of a class's flagged signals for which the other class has the largest weight, as the
    /// mean of both directions.
    pub mistaken: f64,
    /// Smallest angle, in degrees, between the spans of what faults of the two classes do to a
    /// signal, in the metric of noise and healthy spread. 0: some fault of the one class looks, up
    /// to its size, like one of the other; 90: the two have nothing in common; NaN: not known.
    pub angle_degrees: f64,
}
