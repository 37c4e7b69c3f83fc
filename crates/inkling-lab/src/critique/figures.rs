//! Computes the numbers behind the report's pictures: the misfit in time and in frequency, before and after the
//! extension.
//!
//! In: the baseline and the extended model, and the signals that both were fitted to. Out: [`Figures`]: the mean
//! residual at each sample with its standard error; and the mean periodogram of single signals, with what white noise
//! would have after the same fit.

use super::ensemble::{mean_of, project};
use super::finding::{Compared, Curve, Figures};
use super::model::Model;
use super::observations::Observations;
use inkling_core::model::waves::power_at;
use std::f64::consts::TAU;

struct Residuals {
    /// Mean residual at each sample, counts, with its 95 % band.
    mean: Curve,
    /// Mean periodogram of the misfits beside the signals' own rings, counts², at N/2 frequencies; and that
    /// of white noise of variance one after the same projection.
    power: Vec<f64>,
    of_white: Vec<f64>,
}

fn residuals(model: &Model, data: &Observations) -> Residuals {
    let n = data.samples;
    let (mut power, mut of_white) = (vec![0.0; n / 2], vec![0.0; n / 2]);
    let scale = model.scale();
    let misfits = model.of_each(data, |_, linear| {
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
        linear.residual.clone()
    });
    let at = |k: usize| mean_of(&misfits.iter().map(|r| r[k]).collect::<Vec<f64>>());
    let (mean, se): (Vec<f64>, Vec<f64>) = (0..n).map(at).unzip();
    power.iter_mut().chain(&mut of_white).for_each(|p| *p /= data.len() as f64);
    let mean = Curve::about(mean, se.into_iter().map(|se| 1.96 * se));
    Residuals { mean, power, of_white }
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
    let times = (0..n).map(|k| k as f64 * data.dt_s).collect();
    let mean_misfit = Compared::of(times, [&b, &a].map(|r| r.mean.clone()));
    let [low, high] = band_of_means(data.len() as f64);
    let edge = |by: f64| a.of_white.iter().map(|w| after.noise_var * w * by).collect();
    let power = |r: &Residuals| Curve { y: r.power.clone(), low: edge(low), high: edge(high) };
    let hertz = (0..n / 2).map(|j| (j + 1) as f64 / (n as f64 * data.dt_s)).collect();
    let spectrum = Compared::of(hertz, [&b, &a].map(power));
    Figures { unit: "counts".into(), mean_misfit, spectrum }
}
