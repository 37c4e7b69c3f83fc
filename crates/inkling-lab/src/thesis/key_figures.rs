//! Figs. 4-1 and 4-2 of the thesis: dominant amplitude, damping and frequency of every signal.
//!
//! In: a set of labelled signals, from `figures`. Out: files in a directory, six figures for each
//! stem (`fig_4-1`, `fig_4-2`): the thesis's three-dimensional plot as three projections, each as a
//! whole and as a close-up of the classes whose frequency is near the healthy one. The titles say
//! which classes lie apart from the healthy one, by ranges that hold the middle 90 % of each class.

use super::datasets::states;
use super::key_numbers::{KeyNumbers, range};
use super::outcome::ThesisError;
use super::practice;
use crate::plot::{Axis, Figure, Mark, Series};
use inkling_core::design::TrainingSet;
use inkling_core::fault::HEALTHY;
use std::path::Path;

/// Share of a class's signals that its range leaves out at each end.
const BEYOND: f64 = 0.05;
/// A close-up leaves out classes whose middle frequency is farther from the healthy one than this share.
const NEAR: f64 = 0.15;

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

    /// The middle of that range.
    fn middle(&self, quantity: &Quantity) -> f64 {
        let [low, high] = self.range(quantity);
        0.5 * (low + high)
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
    PROJECTIONS
        .iter()
        .flat_map(move |(name, ..)| ["", "_zoom"].map(|end| format!("{stem}_{name}{end}")))
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

    // The classes near the healthy frequency, for the close-ups.
    let healthy = classes.iter().find(|class| class.name == HEALTHY);
    let f0 = healthy.map_or(f64::NAN, |class| class.middle(&FREQUENCY));
    let is_near = |class: &&Class| (class.middle(&FREQUENCY) / f0 - 1.0).abs() <= NEAR;
    let near: Vec<&Class> = classes.iter().filter(is_near).collect();
    for (name, x, y) in PROJECTIONS {
        let all: Vec<&Class> = classes.iter().collect();
        draw(&all, x, y, whole_title(&all, y)).write(dir, &format!("{stem}_{name}"))?;
        let title = close_up_title(&near, y);
        let mut figure = draw(&near, x, y, title);
        // All series, so that each class has the same colour in both figures.
        figure.series = draw(&all, x, y, String::new()).series;
        figure.write(dir, &format!("{stem}_{name}_zoom"))?;
    }
    Ok(())
}

/// A figure of these classes, one series for each, with axes that hold the ranges of all of them.
fn draw(classes: &[&Class], x: &Quantity, y: &Quantity, title: String) -> Figure {
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
    Figure::new(title, axis(x), axis(y), series.collect())
}

/// Title of a whole figure: the number of faults that lie apart from the healthy class in the quantity
/// drawn upwards, or of few faults the range of each. `classes`: the healthy one first.
fn whole_title(classes: &[&Class], y: &Quantity) -> String {
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

/// Title of a close-up: which near faults overlap the healthy class. `near`: that class first.
fn close_up_title(near: &[&Class], y: &Quantity) -> String {
    let Some((healthy, faults)) = near.split_first() else { return "Close up".into() };
    let among: Vec<&str> = faults
        .iter()
        .filter(|class| !class.is_apart(healthy, y))
        .map(|class| class.name.as_str())
        .collect();
    let among = match among[..] {
        [] => "none overlaps".to_owned(),
        _ => format!("{} overlap", among.join(", ")),
    };
    format!("Close up: by {} {among} healthy signals", y.name)
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
        let [healthy, dried, deeply] =
            [class(HEALTHY, 3e4), class("IDN", 3.1e4), class("DDN", 5e4)];
        let all = [&healthy, &dried, &deeply];
        let title = whole_title(&all, &DAMPING);
        assert!(title.contains("healthy 30–32, IDN 31–33, DDN 50–52"), "{title}");
        let title = close_up_title(&all, &DAMPING);
        assert!(title.ends_with("by damping IDN overlap healthy signals"), "{title}");
        let apart = [&healthy, &deeply];
        assert!(close_up_title(&apart, &DAMPING).contains("none overlaps"));
        let many = [&healthy, &dried, &deeply, &deeply, &deeply];
        let title = whole_title(&many, &DAMPING);
        assert!(title.starts_with("By damping 3 of 4 faults"), "{title}");
    }
}
