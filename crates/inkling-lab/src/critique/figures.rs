//! Computes the numbers behind the report's pictures: the misfit in time, in frequency, and against each
//! recorded covariate, before and after the extension.
//!
//! In: the baseline and the extended model, and the signals that both were fitted to. Out: [`Figures`]: the mean
//! residual at each sample with its standard error; the mean periodogram of single signals, with what white noise
//! would have after the same fit; and each signal's amplitude, damping and frequency, averaged in bins of each
//! covariate (`against`).

use super::covariates::{COVARIATES, IDLE, NAMES, POSITION, UNITS};
use super::ensemble::{mean_of, project};
use super::finding::{Compared, CovariateFigure, Curve, Figures};
use super::matrices::{Matrix5, Vector5, inverse_or_zero};
use super::model::{Linear, Model, free_products};
use super::observations::Observations;
use inkling_core::model::free_decay::Theta;
use inkling_core::model::waves::power_at;
use std::f64::consts::TAU;

const PARAMETERS: [&str; 3] = ["amplitude", "damping", "frequency"];
/// Number of bins of a covariate; up to so many distinct values get a bin each instead.
pub const BINS: usize = 8;
const MOST_DISTINCT: usize = 16;

/// Relative amplitude, ln damping and ln frequency of a signal, less its channel's (`unit`): its own
/// deviation in the model (`own`) plus the least-squares step that its residual still asks for (from
/// `missed`). What a covariate's cause adds is in neither, so an explained effect vanishes.
fn about_channel(unit: &Theta, own: &Theta, missed: &Linear, scale: &Vector5) -> [f64; 3] {
    let (gram, product) = free_products(missed, scale);
    let x = inverse_or_zero(gram + Matrix5::identity() * 1e-12) * product;
    let (a, b) = (unit[2] / scale[2], unit[3] / scale[2]);
    let size = a.hypot(b).max(1e-9);
    let moved = [own[2] / scale[2] + x[2], own[3] / scale[2] + x[3]];
    let along = (a * moved[0] + b * moved[1]) / (size * size);
    [along, own[0] + x[0], own[1] + x[1]]
}

/// The same three numbers of a channel, less those of the population's mean.
fn about_population(unit: &Theta, mean: &Theta, scale: &Vector5) -> [f64; 3] {
    let size = |of: &Theta| (of[2] / scale[2]).hypot(of[3] / scale[2]);
    [size(unit).max(1e-9) - size(mean), unit[0] - mean[0], unit[1] - mean[1]]
}

struct Residuals {
    /// Mean residual at each sample, counts, and its standard error.
    mean: Vec<f64>,
    se: Vec<f64>,
    /// Amplitude, damping and frequency of each signal, relative to its channel's and to the population's.
    within: Vec<[f64; 3]>,
    about_mean: Vec<[f64; 3]>,
    /// Mean periodogram of the misfits beside the signals' own rings, counts², at N/2 frequencies; and that
    /// of white noise of variance one after the same projection.
    power: Vec<f64>,
    of_white: Vec<f64>,
}

fn residuals(model: &Model, data: &Observations) -> Residuals {
    let n = data.samples;
    let (mut power, mut of_white) = (vec![0.0; n / 2], vec![0.0; n / 2]);
    let scale = model.scale();
    let each = model.of_each(data, |i, linear| {
        let unit = &model.units[data.rows[i].unit];
        let relative = about_channel(unit, &model.each[i], linear, &scale);
        let off = about_population(unit, &model.mean, &scale);
        // the ring's tangent is projected out; what this takes from white noise at a frequency is the sum of the
        // periodograms of the orthonormal columns
        let q = linear.by_free(&scale).qr().q();
        let mut left = linear.residual.clone();
        project(&q, &mut left);
        for (j, (power, of_white)) in power.iter_mut().zip(&mut of_white).enumerate() {
            *power += of_bin(j, &left);
            let taken = q.column_iter().map(|c| of_bin(j, c.as_slice())).sum::<f64>();
            *of_white += (1.0 - taken).max(0.0);
        }
        let about_mean: [f64; 3] = std::array::from_fn(|j| relative[j] + off[j]);
        (relative, about_mean)
    });
    let (within, about_mean) = each.into_iter().unzip();
    let misfits = model.of_each(data, |_, linear| linear.residual.clone());
    let at = |k: usize| mean_of(&misfits.iter().map(|r| r[k]).collect::<Vec<f64>>());
    let (mean, se) = (0..n).map(at).unzip();
    power.iter_mut().chain(&mut of_white).for_each(|p| *p /= data.len() as f64);
    Residuals { mean, se, within, about_mean, power, of_white }
}

/// Periodogram of y at j + 1 periods per signal; that of white noise of variance one is 1 on average.
fn of_bin(j: usize, y: &[f64]) -> f64 {
    power_at(TAU * (j + 1) as f64 / y.len() as f64, y) / y.len() as f64
}

/// Factors on the expected power between which the mean of `count` periodograms of white noise stays in 95 of
/// 100 cases: a chi-squared of 2 `count` degrees of freedom over these (Wilson and Hilferty 1931).
pub fn band_of_means(count: f64) -> [f64; 2] {
    let third = 1.0 / (9.0 * count);
    [-1.96, 1.96].map(|z| (1.0 - third + z * third.sqrt()).powi(3).max(1e-3))
}

pub fn draw(before: &Model, after: &Model, data: &Observations) -> Figures {
    let (b, a) = (residuals(before, data), residuals(after, data));
    let n = data.samples;
    let mean = |r: &Residuals| Curve::about(r.mean.clone(), r.se.iter().map(|se| 1.96 * se));
    let times = (0..n).map(|k| k as f64 * data.dt_s).collect();
    let mean_misfit = Compared::of(times, [&b, &a].map(mean));
    let [low, high] = band_of_means(data.len() as f64);
    let edge = |by: f64| a.of_white.iter().map(|w| after.noise_var * w * by).collect();
    let power = |r: &Residuals| Curve { y: r.power.clone(), low: edge(low), high: edge(high) };
    let hertz = (0..n / 2).map(|j| (j + 1) as f64 / (n as f64 * data.dt_s)).collect();
    let spectrum = Compared::of(hertz, [&b, &a].map(power));
    let present = (1..COVARIATES).filter(|which| data.beside.present[*which]);
    let pairs = present.flat_map(|which| (0..PARAMETERS.len()).map(move |j| (which, j)));
    let covariates = pairs.map(|(which, j)| against(which, j, [&b, &a], data)).collect();
    Figures { unit: "counts".into(), mean_misfit, spectrum, covariates }
}

/// Means in bins of x and of what the models before and after leave, with 95 % bars by its scatter in the bin.
pub fn in_bins(bins: impl Iterator<Item = impl Iterator<Item = [f64; 3]>>) -> Compared {
    let bins: Vec<Vec<[f64; 3]>> = bins.map(Iterator::collect).collect();
    let means = |j: usize| -> (Vec<f64>, Vec<f64>) {
        let column = |bin: &Vec<[f64; 3]>| bin.iter().map(|of| of[j]).collect::<Vec<f64>>();
        bins.iter().map(|bin| mean_of(&column(bin))).unzip()
    };
    let curve = |j: usize| {
        let (mean, se) = means(j);
        Curve::about(mean, se.into_iter().map(|se| 1.96 * se))
    };
    Compared::of(means(0).0, [1, 2].map(curve))
}

/// Mean of the misfit of `PARAMETERS[j]` in bins of covariate `which`, with 95 % bars; empty where there
/// would be fewer than two bins.
fn against(
    which: usize,
    j: usize,
    [before, after]: [&Residuals; 2],
    data: &Observations,
) -> CovariateFigure {
    // without a known idle time, a signal has no place on the axis of idle times
    let known = |i: &usize| which != IDLE || data.rows[*i].beside.idle_s.is_finite();
    let mut order: Vec<usize> = (0..data.len()).filter(known).collect();
    order.sort_by(|p, q| data.beside.z[*p][which].total_cmp(&data.beside.z[*q][which]));
    let mut figure = CovariateFigure {
        covariate: NAMES[which].into(),
        decades: which == IDLE,
        unit: UNITS[which].into(),
        parameter: PARAMETERS[j].into(),
        ..CovariateFigure::default()
    };
    let alike = |p: &usize, q: &usize| data.beside.z[*p][which] == data.beside.z[*q][which];
    let size = order.len().div_ceil(BINS).max(1);
    let bins: Vec<&[usize]> = match order.chunk_by(alike).count() <= MOST_DISTINCT {
        true => order.chunk_by(alike).collect(),
        false => order.chunks(size).collect(),
    };
    if bins.len() < 2 {
        return figure;
    }
    // position differs between channels only, so there their own deviations count
    let of = |r: &Residuals, i: usize| match which == POSITION {
        true => r.about_mean[i][j],
        false => r.within[i][j],
    };
    let left = |i: &usize| [data.beside.z[*i][which], of(before, *i), of(after, *i)];
    figure.means = in_bins(bins.iter().map(|bin| bin.iter().map(left)));
    // place of a bin: its mean in the covariate's unit (of the logarithm for idle times)
    for x in &mut figure.means.x {
        let value = data.beside.mean[which] + *x * data.beside.sd[which];
        *x = if which == IDLE { value.exp() } else { value };
    }
    figure
}
