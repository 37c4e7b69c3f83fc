//! The numbers behind the report's pictures: misfit in time, in frequency, and against what was recorded.

use super::covariates::{COVARIATES, Covariates, NAMES, POSITION, UNITS};
use super::finding::{CovariateFigure, Energies, Figures, MeanMisfit, Spectrum};
use super::model::{Linear, Matrix5, Model, Vector5, dot};
use super::observations::Observations;
use super::ring::FREE;
use std::f64::consts::TAU;

/// Bins of a covariate.
const BINS: usize = 8;
/// Signals whose spectra are averaged, at most.
const MOST_SPECTRA: usize = 512;

/// Mean misfit about each channel's own parameters, with its standard error; and each signal's own
/// (amplitude, damping, frequency), relative, about its channel or about the population.
struct Seen {
    mean: Vec<f64>,
    se: Vec<f64>,
    within: Vec<[f64; 3]>,
    about_mean: Vec<[f64; 3]>,
    power: Vec<f64>,
}

fn see(model: &Model, data: &Observations, beside: &Covariates) -> Seen {
    let n = data.samples;
    let (mut sum, mut square) = (vec![0.0; n], vec![0.0; n]);
    let mut linear = Linear::default();
    let (mut within, mut about_mean) = (Vec::new(), Vec::new());
    let mut power = vec![0.0; n / 2];
    let every = data.len().div_ceil(MOST_SPECTRA).max(1);
    let mut spectra = 0.0;
    for i in 0..data.len() {
        model.linearise(i, data, beside, &mut linear);
        let columns = &linear.tangent.columns;
        let scale = model.scale();
        let mut gram = Matrix5::identity() * 1e-12;
        let mut product = Vector5::zeros();
        for a in 0..FREE {
            product[a] = dot(&columns[a], &linear.residual) * scale[a];
            for b in 0..FREE {
                gram[(a, b)] += dot(&columns[a], &columns[b]) * scale[a] * scale[b];
            }
        }
        let x = gram.try_inverse().map_or_else(Vector5::zeros, |m| m * product);
        let unit = model.units[data.rows[i].unit];
        let (a, b) = (unit[2] / scale[2], unit[3] / scale[2]);
        let size = a.hypot(b).max(1e-9);
        let own = model.each[i];
        let moved = [own[2] / scale[2] + x[2], own[3] / scale[2] + x[3]];
        let along = (a * moved[0] + b * moved[1]) / (size * size);
        let relative = [along, own[0] + x[0], own[1] + x[1]];
        let off = [
            size - (model.mean[2] / scale[2]).hypot(model.mean[3] / scale[2]),
            unit[0] - model.mean[0],
            unit[1] - model.mean[1],
        ];
        within.push(relative);
        about_mean.push(std::array::from_fn(|j| relative[j] + off[j]));
        for k in 0..n {
            let r = linear.residual[k];
            sum[k] += r;
            square[k] += r * r;
        }
        if i % every == 0 {
            spectra += 1.0;
            for (j, power) in power.iter_mut().enumerate() {
                let omega = TAU * (j + 1) as f64 / n as f64;
                let (sin, cos) = omega.sin_cos();
                let (mut c, mut s, mut re, mut im) = (1.0, 0.0, 0.0, 0.0);
                for r in &linear.residual {
                    re += r * c;
                    im += r * s;
                    (c, s) = (c * cos - s * sin, s * cos + c * sin);
                }
                *power += (re * re + im * im) / n as f64;
            }
        }
    }
    let m = data.len() as f64;
    let mean: Vec<f64> = sum.iter().map(|s| s / m).collect();
    let se = square
        .iter()
        .zip(&mean)
        .map(|(q, mean)| ((q / m - mean * mean).max(0.0) / m).sqrt())
        .collect();
    power.iter_mut().for_each(|p| *p /= f64::max(spectra, 1.0));
    Seen { mean, se, within, about_mean, power }
}

pub fn draw(
    before: &Model,
    after: &Model,
    data: &Observations,
    beside: &Covariates,
    energies: &Energies,
) -> Figures {
    let (b, a) = (see(before, data, beside), see(after, data, beside));
    let n = data.samples;
    let band = |seen: &Seen, sign: f64| -> Vec<f64> {
        seen.mean.iter().zip(&seen.se).map(|(m, se)| m + sign * 1.96 * se).collect()
    };
    let mean_misfit = MeanMisfit {
        time_s: (0..n).map(|k| k as f64 * data.dt_s).collect(),
        before_low: band(&b, -1.0),
        before_high: band(&b, 1.0),
        after_low: band(&a, -1.0),
        after_high: band(&a, 1.0),
        before: b.mean.clone(),
        after: a.mean.clone(),
    };
    let spectra = data.len().div_ceil(data.len().div_ceil(MOST_SPECTRA).max(1)) as f64;
    let half = 1.96 / spectra.sqrt();
    let spectrum = Spectrum {
        frequency_hz: (0..n / 2).map(|j| (j + 1) as f64 / (n as f64 * data.dt_s)).collect(),
        band_low: vec![after.noise_var * (1.0 - half).max(0.0); n / 2],
        band_high: vec![after.noise_var * (1.0 + half); n / 2],
        before: b.power.clone(),
        after: a.power.clone(),
    };
    let mut covariates = Vec::new();
    for which in 1..COVARIATES {
        if beside.present[which] {
            for (j, parameter) in ["amplitude", "damping", "frequency"].iter().enumerate() {
                covariates.push(against(which, (j, parameter), (&b, &a), beside));
            }
        }
    }
    Figures { mean_misfit, spectrum, covariates, energies: energies.clone() }
}

fn against(
    which: usize,
    (j, parameter): (usize, &str),
    (before, after): (&Seen, &Seen),
    beside: &Covariates,
) -> CovariateFigure {
    let mut order: Vec<usize> = (0..beside.z.len()).collect();
    order.sort_by(|p, q| beside.z[*p][which].total_cmp(&beside.z[*q][which]));
    let mut figure = CovariateFigure {
        covariate: NAMES[which].into(),
        unit: UNITS[which].into(),
        parameter: parameter.into(),
        ..CovariateFigure::default()
    };
    let size = order.len().div_ceil(BINS).max(1);
    for bin in order.chunks(size) {
        let count = bin.len() as f64;
        let centre = bin.iter().map(|&i| beside.z[i][which]).sum::<f64>() / count;
        let value = beside.mean[which] + centre * beside.sd[which];
        figure.centre.push(if NAMES[which] == "idle" { value.exp() } else { value });
        for (seen, mean, bar) in [
            (before, &mut figure.before, &mut figure.before_bar),
            (after, &mut figure.after, &mut figure.after_bar),
        ] {
            let of = if which == POSITION { &seen.about_mean } else { &seen.within };
            let m = bin.iter().map(|&i| of[i][j]).sum::<f64>() / count;
            let v = bin.iter().map(|&i| (of[i][j] - m).powi(2)).sum::<f64>() / count;
            mean.push(m);
            bar.push(1.96 * (v / count).sqrt());
        }
    }
    figure
}
