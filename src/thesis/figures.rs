//! The figures of the thesis from one seed's signals: 2-2, 3-2, 3-3, 3-5, 4-1, 4-2, 4-3, 4-4.

use super::chapter::{self, settings, thesis_detect};
use super::data::Signals;
use super::{ThesisError, experiment};
use crate::design::{Design, IsolateSettings, Judge, Workspace};
use crate::detect::key_numbers::KeyNumbers;
use crate::fault::{CLASSES, HEALTHY};
use crate::isolate::{IsolateMethod, IsolateSignal};
use crate::plot::{Axis, Figure, Mark, Series};
use crate::simulate::Scenario;
use crate::simulate::drying;
use crate::simulate::scenario::{Kind, Physics};
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
    average(&learn).write(dir, "fig_3-2_average")?;
    isolation(&design, &isolate, &test, dir)?;
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
    actuation(physics, &test).write(dir, "fig_2-2_actuation_and_signal")?;
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

/// Over time since the first sample, µs.
fn over_time(name: &str, mark: Mark, y: &[f64], dt_s: f64) -> Series {
    let points = y.iter().enumerate().map(|(k, &v)| (k as f64 * dt_s * 1e6, v)).collect();
    Series { name: name.into(), mark, points }
}

/// Fig. 2-2: the voltage, and from t_a on what the actuator then senses.
fn actuation(physics: &Physics, test: &Signals) -> Figure {
    let acquisition = &physics.acquisition;
    let end_us = acquisition.pulse_us;
    let t_a_us = end_us + acquisition.delay_us;
    let tenths = 10.0 * drying::DRIVE_V;
    let healthy = test.each().find(|(_, state)| *state == HEALTHY).map_or(&[][..], |(y, _)| y);
    let mut output = over_time("output y, counts", Mark::Line, healthy, test.dt_s);
    output.points.iter_mut().for_each(|(t, _)| *t += t_a_us);
    let last_us = output.points.last().map_or(t_a_us, |(t, _)| *t);
    let corners =
        [(-5.0, 0.0), (0.0, 0.0), (0.0, tenths), (end_us, tenths), (end_us, 0.0), (last_us, 0.0)];
    Figure {
        title: "The channel is sensed only after its actuation, so no input acts while it rings"
            .into(),
        x: Axis::new("time since the actuation began, µs"),
        y: Axis::new("input, 0.1 V; output, counts"),
        series: vec![
            Series { name: "input u, 0.1 V".into(), mark: Mark::Line, points: corners.to_vec() },
            output,
        ],
        thresholds: vec![(t_a_us, "t_a".into())],
    }
}

/// Fig. 3-2: signals of the data set and their average.
fn average(learn: &Signals) -> Figure {
    const SHOWN: usize = 40;
    let healthy: Vec<&[f64]> =
        learn.each().filter(|(_, state)| *state == HEALTHY).map(|(y, _)| y).collect();
    let n = healthy.len().max(1) as f64;
    let mean: Vec<f64> =
        (0..learn.samples).map(|k| healthy.iter().map(|y| y[k]).sum::<f64>() / n).collect();
    let raw = healthy.iter().take(SHOWN).map(|y| over_time("", Mark::Points, y, learn.dt_s).points);
    Figure {
        title: format!(
            "The average of {} healthy signals is smooth where each one is noisy",
            healthy.len()
        ),
        x: Axis::new("time since acquisition began, µs"),
        y: Axis::new("sensor signal, counts"),
        series: vec![
            Series {
                name: format!("{} of the signals", healthy.len().min(SHOWN)),
                mark: Mark::Points,
                points: raw.flatten().collect(),
            },
            over_time("their average", Mark::Line, &mean, learn.dt_s),
        ],
        thresholds: Vec::new(),
    }
}

/// Fig. 3-5: R, one signal's residual beside R phi, and its phi.
fn isolation(
    design: &Design,
    settings: &IsolateSettings,
    test: &Signals,
    dir: &Path,
) -> Result<(), ThesisError> {
    let model = &design.pooled;
    let residual = |deviation: &[f64]| {
        let mut r = vec![0.0; deviation.len()];
        model.generator.filter(deviation, &mut r);
        r
    };
    let columns: Vec<Vec<f64>> = design.classes.iter().map(|c| residual(&c.deviation)).collect();
    let names = design.class_names();
    let means = names.iter().zip(&columns);
    Figure {
        title: "Each fault has a mean residual of its own; R holds them as columns".into(),
        x: Axis::new("time since acquisition began, µs"),
        y: Axis::new("mean residual rho, counts"),
        series: means.map(|(name, rho)| over_time(name, Mark::Line, rho, test.dt_s)).collect(),
        thresholds: Vec::new(),
    }
    .write(dir, "fig_3-5_mean_residuals")?;

    // the example: the first partly blocked nozzle, or whatever is faulty
    let example = test.each().find(|(_, state)| *state == "PBN");
    let Some((y, state)) = example.or_else(|| test.each().find(|(_, s)| *s != HEALTHY)) else {
        return Ok(());
    };
    let deviation: Vec<f64> = y.iter().zip(&model.expected).map(|(y, e)| y - e).collect();
    let judge = Judge::new(0, model.clone().into(), None, Some(design), settings)?;
    let mut work = Workspace::default();
    if judge.isolate(&deviation, 1.0, &mut work).is_some() {
        let [mixture, weights] =
            example_isolated(state, &residual(&deviation), &columns, &names, &work.weights, test);
        mixture.write(dir, "fig_3-5_one_signal")?;
        weights.write(dir, "fig_3-5_weights")?;
    }
    Ok(())
}

/// Fig. 3-5, online: r beside R phi, and phi.
fn example_isolated(
    state: &str,
    r: &[f64],
    columns: &[Vec<f64>],
    names: &[String],
    phi: &[f64],
    test: &Signals,
) -> [Figure; 2] {
    let mixed: Vec<f64> = (0..test.samples)
        .map(|k| phi.iter().zip(columns).map(|(phi, rho)| phi * rho[k]).sum())
        .collect();
    let (best, most) = names.iter().zip(phi).fold(("", 0.0), |best, (name, &phi)| {
        if phi > best.1 { (name.as_str(), phi) } else { best }
    });
    let mixture = Figure {
        title: format!(
            "The residual of a signal of {state} and the mixture of R's columns nearest to it"
        ),
        x: Axis::new("time since acquisition began, µs"),
        y: Axis::new("residual, counts"),
        series: vec![
            over_time("r", Mark::Points, r, test.dt_s),
            over_time("R phi", Mark::Line, &mixed, test.dt_s),
        ],
        thresholds: Vec::new(),
    };
    let points = phi.iter().enumerate().map(|(k, &phi)| (phi, k as f64)).collect();
    let weights = Figure {
        title: format!(
            "Its largest weight is {best}'s, {most:.2}: a signal of {state} is named {best}"
        ),
        x: Axis { range: Some((-0.05, 1.05)), ..Axis::new("mixture weight phi") },
        y: Axis { categories: names.to_vec(), ..Axis::new("class") },
        series: vec![Series { name: "phi".into(), mark: Mark::Dots, points }],
        thresholds: Vec::new(),
    };
    [mixture, weights]
}

fn signal_and_model(design: &Design, test: &Signals) -> Figure {
    let line = |name: &str, mark, y: &[f64]| over_time(name, mark, y, test.dt_s);
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
    let numbers = super::practice::key_numbers(signals);
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
