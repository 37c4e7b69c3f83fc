//! The figures of the thesis from one seed's signals: 3-3, 4-1, 4-2, 4-3, 4-4.

use super::chapter::{self, settings, thesis_detect};
use super::data::Signals;
use super::practice::{KeyNumbers, Spectrum};
use super::{ThesisError, experiment};
use crate::design::Design;
use crate::fault::{CLASSES, HEALTHY};
use crate::isolate::{IsolateMethod, IsolateSignal};
use crate::plot::{Axis, Figure, Mark, Series};
use crate::simulate::Scenario;
use crate::simulate::scenario::Kind;
use std::path::Path;

pub fn write(
    classes: &Scenario,
    physics: &Scenario,
    seed: u64,
    dir: &Path,
) -> Result<(), ThesisError> {
    let (learn, test) = chapter::signals(classes, seed)?;
    let isolate = settings(IsolateMethod::ResidualMatching, IsolateSignal::Residual);
    let design = chapter::train(&learn.training(learn.faulty()), &thesis_detect(1.0), &isolate)?;
    signal_and_model(&design, &test).write(dir, "fig_3-3_signal_and_model")?;
    let titles = [
        "Frequency parts most faults; dried nozzles differ from healthy ones by damping",
        "Close up: slightly dried nozzles touch the healthy ones",
        "Amplitude sets deeply dried nozzles apart; most classes overlap in it",
    ];
    key_numbers(&test, "4-1", titles, dir)?;
    energies(
        &design,
        &test,
        "Slightly dried nozzles reach below the threshold, most other faults not",
    )
    .write(dir, "fig_4-3_energies")?;

    let Kind::Physics(physics) = &physics.kind else { return Ok(()) };
    let (learn, test) = experiment::signals(physics, seed);
    let design = chapter::train(&learn.training(learn.faulty()), &thesis_detect(2.0), &isolate)?;
    let titles = [
        "Damping rises from healthy to deeply dried nozzles in three clusters",
        "Close up: intermediately dried nozzles lie between healthy and deeply dried ones",
        "Amplitude falls as nozzles dry",
    ];
    key_numbers(&test, "4-2", titles, dir)?;
    energies(
        &design,
        &test,
        "Deeply dried nozzles lie far above the threshold, some intermediately dried ones below",
    )
    .write(dir, "fig_4-4_energies_drying")?;
    Ok(())
}

fn signal_and_model(design: &Design, test: &Signals) -> Figure {
    let line = |name: &str, mark, y: &[f64]| Series {
        name: name.into(),
        mark,
        points: y.iter().enumerate().map(|(k, &v)| (k as f64 * test.dt_s * 1e6, v)).collect(),
    };
    let fit = design.pooled.identification.fit_percent;
    let healthy = test.each().find(|(_, state)| *state == HEALTHY).map_or(&[][..], |(y, _)| y);
    Figure {
        title: format!(
            "The identified model explains {fit:.1} % of the healthy average; one signal scatters about it"
        ),
        x: Axis::new("time since acquisition began, µs"),
        y: Axis::new("sensor signal, counts"),
        series: vec![
            line("one healthy signal", Mark::Points, healthy),
            line("identified model, thesis (3-1)", Mark::Line, &design.pooled.expected),
        ],
        thresholds: Vec::new(),
    }
}

/// Classes that are there, healthy first.
fn states(signals: &Signals) -> Vec<&'static str> {
    let all = std::iter::once(HEALTHY).chain(CLASSES);
    all.filter(|class| signals.state.iter().any(|s| s == class)).collect()
}

/// Dominant damping over frequency, amplitude over frequency, and the first without EC, close up.
fn key_numbers(
    signals: &Signals,
    number: &str,
    titles: [&str; 3],
    dir: &Path,
) -> Result<(), ThesisError> {
    let numbers = Spectrum::new(signals.samples, signals.dt_s).of_all(signals);
    let figure = |title: &str, y: Axis, of: fn(&KeyNumbers) -> f64| Figure {
        title: title.into(),
        x: Axis::new("dominant frequency, kHz"),
        y,
        series: states(signals)
            .into_iter()
            .map(|class| Series {
                name: class.into(),
                mark: Mark::Points,
                points: numbers
                    .iter()
                    .zip(&signals.state)
                    .filter(|(_, s)| *s == class)
                    .map(|(k, _)| (k.frequency_hz / 1e3, of(k)))
                    .collect(),
            })
            .collect(),
        thresholds: Vec::new(),
    };
    let damping = |k: &KeyNumbers| k.damping_per_s / 1e3;
    let range = |low, high| Some((low, high));
    let mut by_damping = figure(
        titles[0],
        Axis { range: range(-15.0, 110.0), ..Axis::new("dominant damping, 1000/s") },
        damping,
    );
    by_damping.write(dir, &format!("fig_{number}_damping"))?;
    by_damping.title = titles[1].into();
    by_damping.x.range = range(52.0, 78.0);
    by_damping.y.range = range(10.0, 90.0);
    by_damping.write(dir, &format!("fig_{number}_damping_zoom"))?;
    figure(
        titles[2],
        Axis { range: range(50.0, 1050.0), ..Axis::new("dominant amplitude, counts") },
        |k| k.amplitude_counts,
    )
    .write(dir, &format!("fig_{number}_amplitude"))?;
    Ok(())
}

fn energies(design: &Design, signals: &Signals, title: &str) -> Figure {
    let model = &design.pooled;
    let names = states(signals);
    let mut each: Vec<Vec<f64>> = vec![Vec::new(); names.len()];
    for (y, state) in signals.each() {
        let deviation: Vec<f64> = y.iter().zip(&model.expected).map(|(y, e)| y - e).collect();
        if let Some(k) = names.iter().position(|n| *n == state) {
            each[k].push(model.generator.energy(&deviation));
        }
    }
    // a band per class, its signals one above the other
    let band = |row: usize, energies: &[f64]| {
        let spread = |i: usize| 0.6 * ((i as f64 * 0.618_034).fract() - 0.5);
        energies.iter().enumerate().map(|(i, &e)| (e, row as f64 + spread(i))).collect()
    };
    let series = names.iter().zip(&each).enumerate().map(|(row, (name, energies))| Series {
        name: (*name).into(),
        mark: Mark::Points,
        points: band(row, energies),
    });
    Figure {
        title: title.into(),
        x: Axis { log: true, ..Axis::new("residual energy e(r), counts²·s") },
        y: Axis { categories: names.iter().map(|n| n.to_string()).collect(), ..Axis::new("class") },
        series: series.collect(),
        thresholds: vec![(model.threshold.value, "threshold (3-4)".into())],
    }
}
