//! Figures for the page: the size of faults over time, and the drift of healthy rings with
//! temperature.
//!
//! In: a [`Report`] (`trends`), or its healthy models (`drift`). Out: SVG in HTML. The titles say
//! what the figures show, from the same words as the list.

use super::Report;
use super::drift::{ModelPoint, per_kelvin};
use super::fault::{Fault, certain_trend, trend_in_words, what};
use super::survey::Survey;
use super::trend::Severities;
use super::watch::Watch;
use super::words::{clock, counted_as, signed};
use inkling_core::model::faults::{Law, law};
use inkling_lab::plot::{Axis, Figure, Mark, Series, page, unit_of_time};
use std::collections::BTreeMap;

/// Width and height of a figure, pixels.
const SIZE: (u32, u32) = (860, 380);
/// Most faults whose size over time is drawn.
const MOST_TRENDS: usize = 16;
/// Most printheads in one figure: more could not be told apart.
const MOST_HEADS: usize = 8;
/// Least number of bins of severities of a fault for its figure.
const LEAST_BINS: usize = 5;
/// Least number of models of a printhead for a figure of its drift.
const LEAST_DOTS: usize = 8;

/// Figures of severity over time of the most urgent faults, by the fault's index in the report.
pub fn trends(report: &Report) -> BTreeMap<usize, String> {
    let drawn = |(place, fault): (usize, &Fault)| Some((place, trend(fault, &report.survey)?));
    report.faults.iter().enumerate().filter_map(drawn).take(MOST_TRENDS).collect()
}

/// The figure of one fault: the mean of each bin of its severities, with a 95 % bar where a bin has several.
fn trend(fault: &Fault, survey: &Survey) -> Option<String> {
    let story = &fault.story;
    let of_channel = |w: &&Watch| w.spells.iter().any(|s| s.episode.channel == story.channel);
    let watch = survey.get(&story.printhead)?.watches.iter().find(of_channel)?;
    let from = story.began_at_ns as f64;
    let to = story.ended_at_ns.map_or(f64::INFINITY, |end| end as f64);
    let quantity = story.quantity.as_deref()?;

    // A bin that holds only signals without a size has the time 0, which lies before any onset.
    let bins = watch.course(quantity)?.values().filter(|b| (from..=to).contains(&b.t_ns()));
    let bins: Vec<&Severities> = bins.collect();
    let last = bins.last().filter(|_| bins.len() >= LEAST_BINS)?.t_ns();

    // Means and bars, over the time since the onset.
    let (scale, unit) = unit_of_time((last - from) / 1e9);
    let at = |b: &Severities| (b.t_ns() - from) / 1e9 * scale;
    let means = bins.iter().map(|b| (at(b), b.mean())).collect();
    let half = |b: &Severities| b.standard_error().map(|error| 1.96 * error);
    let bars = bins
        .iter()
        .filter_map(|b| Some((at(b), b.mean(), half(b)?)))
        .flat_map(|(t, y, half)| [(t, y - half), (t, y + half)])
        .collect();

    // The title tells the trend, or why there is none.
    let finding = match (certain_trend(story), story.cures) {
        (Some(_), _) => trend_in_words(story),
        (None, 0) => "no trend yet".into(),
        (None, cures) => format!("cured {}", counted_as(cures.into(), "once", "times")),
    };

    // The axis begins at the severity of no fault.
    let class = story.fault.as_deref().or(story.category.as_deref()).unwrap_or_default();
    let none = if class == "dried_nozzle" { Some(1.0) } else { law(class).map(Law::none) };
    let none = none.unwrap_or(0.0);
    let tops = bins.iter().map(|b| b.mean() + half(b).unwrap_or(0.0));
    let highest = tops.fold(f64::NEG_INFINITY, f64::max);
    let lowest = bins.iter().map(|b| b.mean()).fold(none, f64::min);
    let room = 0.08 * (highest - lowest);
    let figure = Figure::new(
        format!("{} channel {}: {finding}", story.printhead, story.channel),
        Axis::new(&format!("{unit} since {} UTC (means, 95 %)", clock(story.began_at_ns))),
        Axis {
            range: (room > 0.0).then_some((lowest - 0.2 * room, highest + room)),
            ..Axis::new(quantity)
        },
        vec![Series::new("", Mark::Points, means), Series::new("", Mark::Bars, bars)],
    );
    let alt = format!("{}; {quantity} of {}", figure.title, what(story));
    Some(page::figure(&figure, SIZE, &alt))
}

/// Figures of healthy resonance and damping against temperature, where that was recorded.
pub fn drift(points: &[ModelPoint]) -> Vec<String> {
    let resonance = quantity(points, "Healthy resonance", "kHz", |p| p.frequency_hz / 1e3);
    let damping = quantity(points, "Healthy damping", "1/ms", |p| p.damping_per_s / 1e3);
    [resonance, damping].into_iter().flatten().collect()
}

/// The figure of one quantity of the healthy models, one series for each printhead. `None` if no printhead has
/// [`LEAST_DOTS`] models of a temperature.
fn quantity(
    points: &[ModelPoint],
    what: &str,
    unit: &str,
    of: fn(&ModelPoint) -> f64,
) -> Option<String> {
    // The models of each printhead, in the order in which the printheads are met.
    let mut of_heads: Vec<(&str, Vec<(f64, f64)>)> = Vec::new();
    for point in points {
        let name = point.printhead.as_deref().unwrap_or("all printheads");
        let dot = (point.temperature_c, of(point));
        match of_heads.iter_mut().find(|of| of.0 == name) {
            Some((_, own)) => own.push(dot),
            None => of_heads.push((name, vec![dot])),
        }
    }
    let mut changes: Vec<f64> = of_heads.iter().filter_map(|(_, own)| per_kelvin(own)).collect();
    changes.sort_by(f64::total_cmp);
    let drawn = of_heads.into_iter().take(MOST_HEADS);
    let series: Vec<Series> = drawn.map(|(name, of)| Series::new(name, Mark::Dots, of)).collect();
    if series.iter().map(|s| s.points.len()).max().unwrap_or_default() < LEAST_DOTS {
        return None;
    }
    let finding = match (changes.first(), changes.last()) {
        (Some(low), Some(high)) => {
            let [low, high] = [low, high].map(|change| signed(100.0 * change, 2));
            format!("{what} changes by {low} to {high} % per K from printhead to printhead")
        }
        _ => {
            let all = || points.iter().map(of);
            let (low, high) = (all().fold(f64::INFINITY, f64::min), all().fold(0.0, f64::max));
            format!("{what} lies between {low:.2} and {high:.2} {unit}")
        }
    };
    let y = Axis::new(&format!("{}, {unit}", what.to_lowercase()));
    // for those who do not see it, it says its title
    let figure = Figure::new(finding, Axis::new("ink temperature, °C"), y, series);
    Some(page::figure(&figure, SIZE, &figure.title))
}
