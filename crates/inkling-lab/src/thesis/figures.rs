//! The figures of the thesis, drawn from the signals of one part: 2-2, 3-2, 3-3, 3-5, 4-1 to 4-4.
//!
//! In: a seed (`simulated`) or a part of a user's recordings (`recorded`), from `thesis::write`.
//! Out: for each figure an SVG and a CSV in a directory. The filter, the model and the weights
//! are those of the thesis's own design, learned from the part. Every title is a sentence made of the
//! numbers that its figure shows. Figs. 4-1 and 4-2 are in `key_figures`.

use super::datasets::{self, Part, each, states};
use super::key_figures::{self, key_numbers};
use super::measure::{TestSignal, each_signal, train};
use super::methods::{own_isolation, thesis_detect};
use super::outcome::{DataSet, ThesisError};
use crate::plot::{Axis, Figure, Mark, Series};
use crate::simulate::drying;
use crate::simulate::scenario::Physics;
use inkling_core::design::{Design, TrainingSet};
use inkling_core::fault::HEALTHY;
use std::path::Path;

/// Writes the figures of one seed of simulated data.
pub fn simulated(seed: u64, dir: &Path) -> Result<(), ThesisError> {
    let physics = datasets::physics()?;
    let of_form = datasets::part(DataSet::ThesisForm, seed)?;
    let drying = datasets::part(DataSet::Drying, seed)?;
    let (design, of_drying) = (learned(&of_form)?, learned(&drying)?);
    of_any(&of_form, &design, dir)?;
    identified(&of_drying, &drying.test, Some(&physics), dir)?;
    actuation(&physics, &drying.test).write(dir, "fig_2-2_actuation_and_signal")?;
    key_numbers(&drying.test, "fig_4-2", dir)?;
    energies(&of_drying, &drying.test, "fig_4-4_energies_drying", dir)
}

/// Writes the figures of one part of recordings; the actuation is not known.
pub fn recorded(part: &Part, dir: &Path) -> Result<(), ThesisError> {
    let design = learned(part)?;
    of_any(part, &design, dir)?;
    identified(&design, &part.test, None, dir)
}

/// The figures that can be drawn of any signals: 3-2, 3-5, 4-1 and 4-3.
fn of_any(part: &Part, design: &Design, dir: &Path) -> Result<(), ThesisError> {
    average(&part.learn).write(dir, "fig_3-2_average")?;
    isolated(design, &part.test, dir)?;
    key_numbers(&part.test, "fig_4-1", dir)?;
    energies(design, &part.test, "fig_4-3_energies", dir)
}

/// Most letters of a class's name in a title.
const LONGEST_NAME: usize = 24;

/// Names of all figures but those of key numbers, without extension, for `forget`.
const NAMES: [&str; 8] = [
    "fig_2-2_actuation_and_signal",
    "fig_3-2_average",
    "fig_3-3_signal_and_model",
    "fig_3-5_mean_residuals",
    "fig_3-5_one_signal",
    "fig_3-5_weights",
    "fig_4-3_energies",
    "fig_4-4_energies_drying",
];

/// Removes the figures of an earlier run from `dir`, since other data may have fewer figures.
pub fn forget(dir: &Path) {
    let key_numbers = ["fig_4-1", "fig_4-2"].into_iter().flat_map(key_figures::names);
    for name in NAMES.map(str::to_owned).into_iter().chain(key_numbers) {
        // each figure has its data beside it
        for extension in ["svg", "csv"] {
            // a file that is not there needs no removal
            let _ = std::fs::remove_file(dir.join(format!("{name}.{extension}")));
        }
    }
}

/// The thesis's own design, learned from a part.
fn learned(part: &Part) -> Result<Design, ThesisError> {
    train(&part.learn, &thesis_detect(part.mu), &own_isolation())
}

/// The first healthy signal of a set, counts; empty if there is none.
fn healthy_one(set: &TrainingSet) -> Vec<f64> {
    each(set).find(|(state, _)| *state == HEALTHY).map_or(Vec::new(), |(_, y)| y)
}

/// The drive voltage as a series in µs since t_a and tenths of a volt, until `until_us`.
fn pulse(physics: &Physics, until_us: f64) -> Series {
    let (end_us, tenths) = (-physics.acquisition.delay_us, 10.0 * drying::DRIVE_V);
    let begin_us = end_us - physics.acquisition.pulse_us;
    let corners = [
        (begin_us - 5.0, 0.0),
        (begin_us, 0.0),
        (begin_us, tenths),
        (end_us, tenths),
        (end_us, 0.0),
        (until_us, 0.0),
    ];
    Series::new("input u, 0.1 V", Mark::Line, corners.to_vec())
}

/// Fig. 2-2: the drive voltage, and from t_a on what the actuator then senses, with a line at t_a.
fn actuation(physics: &Physics, test: &TrainingSet) -> Figure {
    let output =
        Series::over_time("output y, counts", Mark::Line, &healthy_one(test), test.sample_period_s);
    let until_us = output.points.last().map_or(0.0, |(t, _)| *t);
    let largest = output.points.iter().map(|(_, y)| y.abs()).fold(0.0, f64::max);
    let title = format!(
        "The channel is sensed from {} µs after the pulse of {} µs on, and rings to {largest:.0} counts",
        physics.acquisition.delay_us, physics.acquisition.pulse_us
    );
    let series = vec![pulse(physics, until_us), output];
    let figure = Figure::over_time(title, "input, 0.1 V; output, counts", series);
    Figure { thresholds: vec![(0.0, "t_a".into())], ..figure }
}

/// Fig. 3-2: 40 healthy training signals, and the average of all.
fn average(learn: &TrainingSet) -> Figure {
    const SHOWN: usize = 40;
    let healthy: Vec<Vec<f64>> =
        each(learn).filter(|(state, _)| *state == HEALTHY).map(|(_, y)| y).collect();
    let n = healthy.len().max(1) as f64;
    let mean: Vec<f64> =
        (0..learn.samples).map(|k| healthy.iter().map(|y| y[k]).sum::<f64>() / n).collect();
    let dt_s = learn.sample_period_s;
    // Standard deviation about the mean, over all samples; over the root of n it is that of the mean.
    let off = |y: &Vec<f64>| y.iter().zip(&mean).map(|(y, m)| (y - m).powi(2)).sum::<f64>();
    let scatter =
        healthy.iter().map(off).sum::<f64>() / (learn.samples as f64 * (n - 1.0).max(1.0));
    let scatter = scatter.sqrt();
    let shown = &healthy[..healthy.len().min(SHOWN)];
    let raw = shown.iter().flat_map(|y| Series::over_time("", Mark::Points, y, dt_s).points);
    let some = format!("{} of the signals", shown.len());
    let (all, of_mean) = (healthy.len(), scatter / n.sqrt());
    Figure::over_time(
        format!(
            "Healthy signals scatter by {scatter:.1} counts; the average of {all} of them by {of_mean:.2}"
        ),
        "sensor signal, counts",
        vec![
            Series::new(&some, Mark::Points, raw.collect()),
            Series::over_time("the average of all", Mark::Line, &mean, dt_s),
        ],
    )
}

/// Fig. 3-3: one healthy signal and the identified model, with the input where that is known.
fn identified(
    design: &Design,
    test: &TrainingSet,
    physics: Option<&Physics>,
    dir: &Path,
) -> Result<(), ThesisError> {
    let fit = design.pooled.identification.fit_percent;
    let line = |name: &str, mark, y: &[f64]| Series::over_time(name, mark, y, test.sample_period_s);
    let mut series = vec![
        line("one healthy signal", Mark::Points, &healthy_one(test)),
        line("identified model, thesis (3-1)", Mark::Line, &design.pooled.expected),
    ];
    let until_us = series[1].points.last().map_or(0.0, |(t, _)| *t);
    series.extend(physics.map(|physics| pulse(physics, until_us)));
    let title = format!(
        "The identified model explains {fit:.1} % of the healthy average; one signal scatters about it"
    );
    let figure = Figure::over_time(title, "sensor signal, counts", series);
    Ok(figure.write(dir, "fig_3-3_signal_and_model")?)
}

/// Fig. 3-5: the mean residuals R; one signal's residual r with R phi; and that signal's weights phi.
fn isolated(design: &Design, test: &TrainingSet, dir: &Path) -> Result<(), ThesisError> {
    let (model, dt_s) = (&design.pooled, test.sample_period_s);
    let residual = |deviation: &[f64]| {
        let mut r = vec![0.0; deviation.len()];
        model.generator.filter(deviation, &mut r);
        r
    };

    // The filter is linear, so these are the mean residuals rho of thesis §3-3-2.
    let columns: Vec<Vec<f64>> = design.classes.iter().map(|c| residual(&c.deviation)).collect();
    let names = design.class_names();
    let energy = |rho: &Vec<f64>| rho.iter().map(|r| r * r).sum::<f64>();
    let all = || names.iter().zip(&columns);
    // of equally strong or weak ones the last is taken
    let strongest = all().max_by(|a, b| energy(a.1).total_cmp(&energy(b.1)));
    let weakest = all().rev().min_by(|a, b| energy(a.1).total_cmp(&energy(b.1)));
    let [strongest, weakest] = [strongest, weakest].map(|of| of.map_or("", |(name, _)| name));

    Figure::over_time(
        format!(
            "R holds the mean residual of each of {} faults: {strongest} has the largest, {weakest} the smallest",
            names.len()
        ),
        "mean residual rho, counts",
        all().map(|(name, rho)| Series::over_time(name, Mark::Line, rho, dt_s)).collect(),
    )
    .write(dir, "fig_3-5_mean_residuals")?;

    // r and R phi of one signal, both at the reference drive
    let Some(example) = Example::of(design, test)? else { return Ok(()) };
    let r = residual(&example.deviation);
    let mixed: Vec<f64> = (0..test.samples)
        .map(|k| example.phi.iter().zip(&columns).map(|(phi, rho)| phi * rho[k]).sum())
        .collect();
    let left: f64 = r.iter().zip(&mixed).map(|(r, m)| (r - m).powi(2)).sum();
    let (state, named) = (&example.state, &names[example.class]);
    let explained = 100.0 * (1.0 - left / energy(&r).max(f64::MIN_POSITIVE));
    Figure::over_time(
        format!(
            "The mixture R phi explains {explained:.0} % of the residual's energy of a signal of {state}"
        ),
        "residual, counts",
        vec![
            Series::over_time("r", Mark::Points, &r, dt_s),
            Series::over_time("R phi", Mark::Line, &mixed, dt_s),
        ],
    )
    .write(dir, "fig_3-5_one_signal")?;

    let points = example.phi.iter().enumerate().map(|(k, &phi)| (phi, k as f64)).collect();
    let weight = example.phi[example.class];
    Figure::new(
        format!(
            "Its largest weight is {named}'s, {weight:.2}: a signal of {state} is named {named}"
        ),
        Axis { range: Some((-0.05, 1.05)), ..Axis::new("mixture weight phi") },
        Axis { categories: names.clone(), ..Axis::new("class") },
        vec![Series::new("phi", Mark::Dots, points)],
    )
    .write(dir, "fig_3-5_weights")?;
    Ok(())
}

/// A signal that was isolated, for Fig. 3-5.
struct Example {
    state: String,
    /// Deviation at the reference drive, N counts.
    deviation: Vec<f64>,
    /// Weight of each class.
    phi: Vec<f64>,
    /// Index of the class that was named.
    class: usize,
}

impl Example {
    /// The first signal that is named rightly with a weight of at least .8, the bound of Table 4-4,
    /// and below .99, so that the mixture can be seen; if there is none, the first faulty signal
    /// that is named at all.
    fn of(design: &Design, test: &TrainingSet) -> Result<Option<Example>, ThesisError> {
        let (settings, names) = (own_isolation(), design.class_names());
        let [mut right, mut any] = [None, None];
        each_signal(design, &settings, test, |met, work| {
            let TestSignal { judge, deviation, drive, state } = met;
            if state == HEALTHY || right.is_some() {
                return;
            }
            let Some(class) = judge.isolate(deviation, drive, work).and_then(|d| d.candidate)
            else {
                return;
            };
            let class = usize::from(class);
            let made = || Example {
                state: state.into(),
                deviation: deviation.iter().map(|d| d / drive).collect(),
                phi: work.weights.clone(),
                class,
            };
            if names[class] == state && (0.8..0.99).contains(&work.weights[class]) {
                right = Some(made());
            }
            any.get_or_insert_with(made);
        })?;
        Ok(right.or(any))
    }
}

/// Figs. 4-3 and 4-4: the residual energy of every test signal, one band for each class, relative
/// to the threshold (3-4). The title tells which class lies below the threshold most often.
fn energies(
    design: &Design,
    test: &TrainingSet,
    name: &str,
    dir: &Path,
) -> Result<(), ThesisError> {
    let names = states(test);
    let mut by_state: Vec<Vec<f64>> = vec![Vec::new(); names.len()];
    // relative to the threshold, since each printhead has its own
    each_signal(design, &own_isolation(), test, |met, work| {
        let found = met.judge.test(met.judge.detect(met.deviation, met.drive, work));
        if let Some(k) = names.iter().position(|name| name == met.state) {
            by_state[k].push(found.statistic / found.threshold);
        }
    })?;

    // The faults with their shares below the threshold, the worst first, without the healthy state.
    let below = |energies: &[f64]| {
        energies.iter().filter(|e| **e <= 1.0).count() as f64 / energies.len().max(1) as f64
    };
    let faults = names.iter().zip(&by_state).skip(1);
    let mut missed: Vec<_> = faults.map(|(name, all)| (below(all), name, all)).collect();
    missed.sort_by(|a, b| b.0.total_cmp(&a.0));
    let title = match missed[..] {
        [(_, hardest, all), (second, ..), ..] => {
            let under = all.iter().filter(|e| **e <= 1.0).count();
            let hardest: String = hardest.chars().take(LONGEST_NAME).collect();
            let (all, second) = (all.len(), 100.0 * second);
            format!(
                "{under} of {all} {hardest} lie below the threshold; of every other fault at most {second:.1} %"
            )
        }
        _ => "Energies of the residual beside the threshold".into(),
    };

    // Within a band signals are moved by multiples of the golden ratio, so that none covers another.
    let band = |row: usize, energies: &[f64]| {
        let spread = |i: usize| 0.6 * ((i as f64 * 0.618_034).fract() - 0.5);
        energies.iter().enumerate().map(|(i, &e)| (e, row as f64 + spread(i))).collect()
    };
    let rows = names.iter().zip(&by_state).enumerate();
    let series =
        rows.map(|(row, (name, energies))| Series::new(name, Mark::Points, band(row, energies)));
    let figure = Figure {
        title,
        x: Axis::log("residual energy e(r) over the threshold (3-4)"),
        y: Axis { categories: names.clone(), ..Axis::new("class") },
        series: series.collect(),
        thresholds: vec![(1.0, "threshold (3-4)".into())],
    };
    Ok(figure.write(dir, name)?)
}
