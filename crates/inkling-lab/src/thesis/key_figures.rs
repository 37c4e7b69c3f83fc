//! Figs. 4-1 and 4-2 of the thesis: dominant amplitude, damping and frequency of every signal.
//!
//! In: a set of labelled signals, from `figures`. Out: files in a directory, three figures for each
//! stem (`fig_4-1`, `fig_4-2`): the thesis's three-dimensional plot as three projections. The titles say
//! which classes lie apart from the healthy one, by ranges that hold the middle 90 % of each class.

use super::datasets::states;
use super::key_numbers::{KeyNumbers, range};
use super::outcome::ThesisError;
use super::practice;
use crate::plot::{Axis, Figure, Mark, Series};
use inkling_core::design::TrainingSet;
use std::path::Path;

/// Share of a class's signals that its range leaves out at each end.
const BEYOND: f64 = 0.05;

/// One of the three numbers; `of`: its value in the label's unit.
struct Quantity {
    name: &'static str,
    label: &'static str,
    of: fn(&KeyNumbers) -> f64,
}

const FREQUENCY: Quantity =
    Quantity { name: "frequency", label: "dominant frequency, kHz", of: |k| k.frequency_hz / 1e3 };
const DAMPING: Quantity =
    Quantity { name: "damping", label: "dominant damping, 1000/s", of: |k| k.damping_per_s / 1e3 };
const AMPLITUDE: Quantity =
    Quantity { name: "amplitude", label: "dominant amplitude, counts", of: |k| k.amplitude_counts };

/// A class, with the key numbers of its signals.
struct Class {
    name: String,
    numbers: Vec<KeyNumbers>,
}

impl Class {
    /// The range of the middle 90 % of the signals, in the quantity's unit; NaN without signals.
    fn range(&self, quantity: &Quantity) -> [f64; 2] {
        let values = self.numbers.iter().map(quantity.of).collect();
        range(values, BEYOND).unwrap_or([f64::NAN; 2])
    }

    /// Whether the ranges of the two classes do not overlap.
    fn is_apart(&self, other: &Class, quantity: &Quantity) -> bool {
        let ([low, high], [a, b]) = (self.range(quantity), other.range(quantity));
        low > b || high < a
    }
}

/// The projections: name, quantity to the right, quantity upwards.
const PROJECTIONS: [(&str, &Quantity, &Quantity); 3] = [
    ("damping", &FREQUENCY, &DAMPING),
    ("amplitude", &FREQUENCY, &AMPLITUDE),
    ("amplitude_damping", &DAMPING, &AMPLITUDE),
];

/// Names of all figures of a stem, without their extensions.
pub fn names(stem: &str) -> impl Iterator<Item = String> {
    PROJECTIONS.iter().map(move |(name, ..)| format!("{stem}_{name}"))
}

/// Writes the figures that `names` lists into `dir`.
pub fn key_numbers(set: &TrainingSet, stem: &str, dir: &Path) -> Result<(), ThesisError> {
    let numbers = practice::key_numbers(set);

    // The classes with their signals' numbers, the healthy one first.
    let of_state = |name: String| {
        let own = numbers.iter().filter(|(state, _)| *state == name).map(|(_, k)| *k);
        Class { numbers: own.collect(), name }
    };
    let classes: Vec<Class> = states(set).into_iter().map(of_state).collect();

    for (name, x, y) in PROJECTIONS {
        draw(&classes, x, y).write(dir, &format!("{stem}_{name}"))?;
    }
    Ok(())
}

/// A figure of these classes, one series for each, with axes that hold the ranges of all of them.
fn draw(classes: &[Class], x: &Quantity, y: &Quantity) -> Figure {
    // the axes hold the ranges, with some room; if they held outliers, everything else would be a point
    let axis = |quantity: &Quantity| {
        let ranges = classes.iter().map(|class| class.range(quantity));
        let [low, high] =
            ranges.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], [c, d]| [a.min(c), b.max(d)]);
        let room = 0.15 * (high - low);
        let range = (low - room, high + room);
        Axis { range: (high > low).then_some(range), ..Axis::new(quantity.label) }
    };
    let points = |class: &Class| class.numbers.iter().map(|k| ((x.of)(k), (y.of)(k))).collect();
    let series = classes.iter().map(|of| Series::new(&of.name, Mark::Points, points(of)));
    Figure::new(title(classes, y), axis(x), axis(y), series.collect())
}

/// Title of a figure: the number of faults that lie apart from the healthy class in the quantity
/// drawn upwards, or of few faults the range of each. `classes`: the healthy one first.
fn title(classes: &[Class], y: &Quantity) -> String {
    let Some((healthy, faults)) = classes.split_first() else { return String::new() };
    if faults.len() > 3 {
        let apart = faults.iter().filter(|class| class.is_apart(healthy, y)).count();
        let (by, all) = (y.name, faults.len());
        return format!(
            "By {by} {apart} of {all} faults lie apart from healthy signals (middle 90 % of each)"
        );
    }
    let ranges = classes.iter().map(|class| {
        let [low, high] = class.range(y);
        format!("{} {low:.0}–{high:.0}", class.name)
    });
    let ranges = ranges.collect::<Vec<_>>().join(", ");
    format!("Middle 90 % of {}: {ranges}", y.label.trim_start_matches("dominant "))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn class(name: &str, damping: f64) -> Class {
        let number = |k: usize| KeyNumbers {
            amplitude_counts: 300.0,
            damping_per_s: damping + 100.0 * k as f64,
            frequency_hz: 6e4,
        };
        Class { name: name.into(), numbers: (0..20).map(number).collect() }
    }

    #[test]
    fn titles_say_what_the_numbers_are() {
        let all =
            [("healthy", 3e4), ("IDN", 3.1e4), ("DDN", 5e4)].map(|(name, of)| class(name, of));
        let few = title(&all, &DAMPING);
        assert!(few.contains("healthy 30–32, IDN 31–33, DDN 50–52"), "{few}");
        let more = [class("SDN", 5e4), class("BN", 5e4)];
        let many: Vec<Class> = all.into_iter().chain(more).collect();
        let many = title(&many, &DAMPING);
        assert!(many.starts_with("By damping 3 of 4 faults"), "{many}");
    }
}
