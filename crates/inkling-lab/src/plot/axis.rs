//! An axis of a figure: its range, where its ticks are, and their text.
//!
//! In: an `Axis` as a figure asks for it, and the values of the data on it. Out to `plot`: a
//! `Scale`, which `plotters` draws by. Figures have values, a `Scale` has coordinates: on a
//! logarithmic axis the coordinate is the decimal logarithm of the value, on others the value itself.

use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint};
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::Ranged;
use std::ops::Range;

/// Largest number of ticks of a linear axis.
const MOST_TICKS: f64 = 8.0;

/// An axis as a figure asks for it.
#[derive(Clone, Debug, Default)]
pub struct Axis {
    /// The label, with the unit.
    pub label: String,
    pub log: bool,
    /// Smallest and largest value; `None`: the range of the data.
    pub range: Option<(f64, f64)>,
}

impl Axis {
    /// A linear axis, with the range of the data.
    pub fn new(label: &str) -> Axis {
        Axis { label: label.into(), ..Axis::default() }
    }

    /// The same, logarithmic.
    pub fn log(label: &str) -> Axis {
        Axis { log: true, ..Axis::new(label) }
    }

    /// Coordinate of a value. Values that have no logarithm lie far below any axis.
    pub(super) fn at(&self, v: f64) -> f64 {
        if self.log { v.max(f64::MIN_POSITIVE).log10() } else { v }
    }

    /// The axis as it is drawn, given the values of the data on it.
    pub(super) fn scale(&self, values: impl Iterator<Item = f64>) -> Scale {
        let (low, high) = self.span(values);
        Scale { low, high, ticks: self.ticks(low, high) }
    }

    /// Smallest and largest coordinate: the fixed range, or the data with 4 % of room at each end; 0 to 1
    /// without data.
    fn span(&self, values: impl Iterator<Item = f64>) -> (f64, f64) {
        if let Some((low, high)) = self.range {
            return (self.at(low), self.at(high));
        }
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for v in values.filter(|v| v.is_finite()).map(|v| self.at(v)) {
            (low, high) = (low.min(v), high.max(v));
        }
        if low > high {
            return (0.0, 1.0);
        }
        let room = 0.04 * (high - low).max(1e-9 * (1.0 + high.abs()));
        (low - room, high + room)
    }

    /// The text of a tick at a coordinate.
    pub(super) fn tick(&self, v: f64) -> String {
        if self.log {
            let power = v.round();
            if (v - power).abs() < 1e-6 && !(-3.0..=5.0).contains(&power) {
                return format!("1e{}", power as i32);
            }
            return plain(10f64.powf(v));
        }
        plain(v)
    }

    /// Coordinates of the ticks between two coordinates.
    fn ticks(&self, low: f64, high: f64) -> Vec<f64> {
        let span = high - low;
        if !(span > 0.0 && span.is_finite()) {
            return vec![low];
        }
        // Logarithmic: the fewer decades are shown, the more ticks there are in each; if there are
        // very many, only every second, third ... decade has one.
        if self.log {
            let mantissas: &[f64] = match span {
                s if s < 0.9 => &[1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0],
                s if s < 1.8 => &[1.0, 1.5, 2.0, 3.0, 5.0, 7.0],
                s if s < 3.2 => &[1.0, 2.0, 5.0],
                _ => &[1.0],
            };
            let every = (span / MOST_TICKS).ceil().max(1.0) as i32;
            let decades = (low.floor() as i32)..=(high.ceil() as i32);
            let all = decades
                .filter(|d| d % every == 0)
                .flat_map(|d| mantissas.iter().map(move |m| f64::from(d) + m.log10()));
            return all.filter(|at| (low..=high).contains(at)).collect();
        }

        // Linear: the smallest step of 1, 2, 2.5 or 5 times a power of ten that is wide enough.
        let rough = span / MOST_TICKS;
        let power = 10f64.powf(rough.log10().floor());
        let step = power
            * [1.0, 2.0, 2.5, 5.0, 10.0].into_iter().find(|m| m * power >= rough).unwrap_or(10.0);
        let first = (low / step).ceil() as i64;
        (0..=MOST_TICKS as i64 + 1)
            .map(|k| (first + k) as f64 * step)
            .take_while(|at| *at <= high + 1e-9 * span)
            .collect()
    }
}

/// A unit that suits times up to `longest_s`: the factor from seconds to it, and its name.
pub fn unit_of_time(longest_s: f64) -> (f64, &'static str) {
    match longest_s {
        t if t < 2e-3 => (1e6, "µs"),
        t if t < 2.0 => (1e3, "ms"),
        t if t < 300.0 => (1.0, "s"),
        t if t < 3.0 * 3600.0 => (1.0 / 60.0, "minutes"),
        t if t < 3.0 * 86_400.0 => (1.0 / 3600.0, "hours"),
        _ => (1.0 / 86_400.0, "days"),
    }
}

/// A range with ticks, both in coordinates, as `plotters` wants it.
pub(super) struct Scale {
    low: f64,
    high: f64,
    ticks: Vec<f64>,
}

impl Ranged for Scale {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        RangedCoordf64::from(self.low..self.high).map(value, limit)
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        // the grid of light lines between the ticks is left out
        if hint.weight().allow_light_points() { Vec::new() } else { self.ticks.clone() }
    }

    fn range(&self) -> Range<f64> {
        self.low..self.high
    }
}

/// The text of a number for a tick, without the digits that rounding errors add.
fn plain(v: f64) -> String {
    if v != 0.0 && !(1e-4..1e7).contains(&v.abs()) {
        return format!("{v:.2e}");
    }
    let text = format!("{v:.6}");
    let short = text.trim_end_matches('0').trim_end_matches('.');
    if short == "-0" { "0".into() } else { short.into() }
}
