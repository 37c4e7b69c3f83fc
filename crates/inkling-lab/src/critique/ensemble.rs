//! Tests causes that show in the noise of single signals, not in their mean: random tone, correlated and
//! heteroscedastic noise (which grows with the signal).
//!
//! In: signals, and a fitted model. Out: one [`Candidate`] for each. First each signal's residual r is freed
//! of what its own ring explains and of what all signals have in common: u = (1 - Q Q^T) r (`residuals`).
//! Then:
//!
//! - random tone: the frequency at which the mean of all periodograms of u is largest (`pooled_line`);
//! - correlation: the mean of u_k u_{k-1} (`lag_one`);
//! - growth: the slope of u_k² against the squared expected sample (`heteroscedastic`).
//!
//! The projection takes more of some frequencies, lags and samples than of others, so each test allows for
//! what Q takes. Standard errors come from the scatter over signals, so heavy tails widen them.

use super::autoregression::Autoregression;
use super::candidate::Candidate;
use super::candidates::LEAST_PERIODS;
use super::catalogue::CauseId;
use super::chance::{THRESHOLD, maximum, normal_deviate};
use super::model::{Model, PATTERNS, powers};
use super::observations::Observations;
use super::tuned::{FEWEST_OF_NOISE, LINE_BOUND, STANDS_OUT};
use inkling_core::model::free_decay::FREE;
use inkling_core::model::inner_product::dot;
use inkling_core::model::median::median_of;
use inkling_core::model::normal::ln_upper_tail;
use inkling_core::model::waves::waves;
use nalgebra::DMatrix;
use std::f64::consts::{PI, TAU};

/// Number of directions that are projected out: a signal's own parameters, and what all have in common.
const TAKEN: usize = FREE + 1;

/// One signal's residual u, counts, and the orthonormal basis Q of what was projected out, N x TAKEN. Samples
/// that may be clipped have r = 0.
pub struct Residual {
    pub u: Vec<f64>,
    pub q: DMatrix<f64>,
    pub expected: Vec<f64>,
}

/// Each is freed of its tangent and of the mean misfit of all: a cubic in the drive if there is a drive scan.
fn residuals(model: &Model, data: &Observations) -> Vec<Residual> {
    let n = data.samples;
    let scale = model.scale();
    let mut all = model.of_each(data, |i, linear| Residual {
        u: linear.residual.clone(),
        q: linear.by_free(&scale).qr().q(),
        expected: linear.expected(data.signal(i)),
    });

    let used = if data.beside.drive_scan { PATTERNS } else { 1 };
    let drives = DMatrix::from_fn(data.len(), used, |i, a| powers(data.beside.drive[i])[a]);
    let left = DMatrix::from_fn(data.len(), n, |i, k| all[i].u[k]);
    let gram = drives.tr_mul(&drives) + DMatrix::identity(used, used) * 1e-9;
    let mean = gram.cholesky().map(|c| c.solve(&drives.tr_mul(&left)));
    let common = mean.map_or(DMatrix::zeros(data.len(), n), |mean| drives * mean);

    // The common part is one more column of Q, and is not subtracted as it is, because each signal has an
    // amount of its own of it.
    for (left, common) in all.iter_mut().zip(common.row_iter()) {
        let mut j = left.q.clone().resize_horizontally(TAKEN, 0.0);
        j.set_column(FREE, &common.transpose());
        left.q = j.qr().q();
        project(&left.q, &mut left.u);
    }
    all
}

/// Projects an orthonormal basis `q` (N x any number of columns) out of u, in place.
pub fn project(q: &DMatrix<f64>, u: &mut [f64]) {
    for column in q.column_iter() {
        let share: f64 = column.iter().zip(u.iter()).map(|(q, u)| q * u).sum();
        u.iter_mut().zip(column.iter()).for_each(|(u, q)| *u -= share * q);
    }
}

/// The mean of each column shifted down and up by so many samples, with zeros from outside. Then y^T
/// shifted(y) is the sum of products y_k y_{k-lag}.
pub fn shifted(q: &DMatrix<f64>, lag: usize) -> DMatrix<f64> {
    DMatrix::from_fn(q.nrows(), q.ncols(), |k, a| {
        let back = if k >= lag { q[(k - lag, a)] } else { 0.0 };
        let on = if k + lag < q.nrows() { q[(k + lag, a)] } else { 0.0 };
        0.5 * (back + on)
    })
}

pub fn mean_of(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let square = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    (mean, (square / n).sqrt())
}

/// Tests random tone (value: its frequency, Hz), correlated noise (rho at lag one) and heteroscedastic noise
/// (the growth h), in this order; with less than `FEWEST_OF_NOISE` signals all three are untested.
pub fn test(data: &Observations, model: &Model) -> Vec<Candidate> {
    if data.len() < FEWEST_OF_NOISE {
        return [CauseId::RandomTone, CauseId::CorrelatedNoise, CauseId::HeteroscedasticNoise]
            .map(|id| Candidate::untested(id, "needs 16 signals"))
            .into();
    }
    let mut left = residuals(model, data);
    let n = data.samples;
    let v = left.iter().map(|l| dot(&l.u, &l.u)).sum::<f64>()
        / (left.len() * (n - TAKEN).max(1)) as f64;
    let (line, contrast) = pooled_line(&left, n, v);
    let mut rho = lag_one(&left, n, v);

    // A line correlates the noise, and correlated noise is a broad hump in the spectrum. So the line counts
    // only if it stands out of its neighbourhood; the correlation is then measured without it.
    let mut line_surprise = line.surprise;
    if line_surprise > 0.0 {
        left.iter_mut().for_each(|left| notch(left, line.value, n));
        if line.surprise > THRESHOLD && contrast > STANDS_OUT {
            rho = lag_one(&left, n, v);
        } else {
            line_surprise = 0.0;
        }
    }

    let hz = |omega: f64| omega / TAU / data.length_s();
    let (surprise, value, sd) = (line_surprise, hz(line.value), hz(line.sd));
    let tone = Candidate { surprise, value, sd, ..line };
    let growth = heteroscedastic(&left, n, v);
    // noise that shrinks with the signal is no cause of the catalogue
    let surprise = if growth.value > 0.0 { growth.surprise } else { 0.0 };
    vec![tone, rho, Candidate { surprise, ..growth }]
}

/// How surprising whitened signals are if their noise was this autoregression. `tones`: frequencies of random tones, rad per signal length.
pub fn surprise_of(
    noise: &Autoregression,
    data: &Observations,
    model: &Model,
    tones: &[f64],
) -> f64 {
    let mut left = residuals(model, data);
    let n = data.samples;
    tones.iter().for_each(|omega| left.iter_mut().for_each(|left| notch(left, *omega, n)));
    noise.surprise_of(&left)
}

fn found(id: CauseId, z: f64, value: f64, sd: f64) -> Candidate {
    Candidate { value, sd, ..Candidate::plain(id, z * z, ()) }
}

/// Projects cosine and sine at a frequency (rad per signal length) out of a residual, too.
fn notch(left: &mut Residual, omega: f64, n: usize) {
    let mut q = left.q.clone().resize_horizontally(TAKEN + 2, 0.0);
    for (column, wave) in waves(0.0, omega / n as f64, n).iter().enumerate() {
        q.column_mut(TAKEN + column).copy_from_slice(wave);
    }
    left.q = q.qr().q();
    let q = left.q.clone();
    project(&q, &mut left.u);
}

/// Mean over signals, with its standard error, of the periodogram at one frequency (rad per signal length),
/// relative to what white noise of variance `v` has there after the projection.
fn mean_power(left: &[Residual], v: f64, omega: f64) -> (f64, f64) {
    let n = left[0].u.len();
    let [c, s] = waves(0.0, omega / n as f64, n);
    let power = |y: &[f64]| dot(y, &c).powi(2) + dot(y, &s).powi(2);
    let values: Vec<f64> = left
        .iter()
        .map(|l| {
            let lost: f64 = l.q.column_iter().map(|q| power(q.as_slice())).sum();
            power(&l.u) / (v * (n as f64 - lost).max(1.0))
        })
        .collect();
    mean_of(&values)
}

/// The line of random phase that all signals share, its frequency in rad per signal length; and its excess over
/// white noise, over that of the neighbouring frequencies. `v`: variance of the noise. In white noise a
/// periodogram is exponentially distributed, so the mean over m signals is chi-squared of 2 m degrees. The
/// largest of n independent frequencies is looked at, which adds ln n to the logarithm of its probability.
fn pooled_line(left: &[Residual], n: usize, v: f64) -> (Candidate, f64) {
    let ratio = |omega: f64| mean_power(left, v, omega);
    let m = left.len() as f64;

    // scan in steps of a quarter of a period per signal length; `all[j]` is at (j + 1) steps
    let count = 2 * n;
    let step = PI * n as f64 / count as f64;
    let all: Vec<f64> = (1..count - 1).map(|j| ratio(j as f64 * step).0).collect();
    let first = (LEAST_PERIODS * TAU / step).ceil() as usize;
    let mut best = first.min(all.len() - 1);
    for j in first..all.len().saturating_sub(2) {
        if all[j] > all[best] {
            best = j;
        }
    }

    // with heavy tails the exponential distribution is too optimistic, so the spread over signals bounds it
    let omega = maximum(|omega| ratio(omega).0, (best + 1) as f64 * step, step);
    let (r, se) = ratio(omega);
    let z = normal_deviate(r, 2.0 * m).min((r - 1.0) / se.max(1e-9) * LINE_BOUND);

    // r - 1 is amplitude² N / (4 v), the signal-to-noise ratio s of one signal. By the Cramér-Rao bound the
    // variance of the frequency is 6 / (s m) in (rad per signal length)²; 1 + 1/s widens it for weak lines.
    let snr = (r - 1.0).max(1e-6);
    let var = 6.0 / (n as f64 * n as f64) / (snr * m) * (1.0 + 1.0 / snr) * (n * n) as f64;
    // below the slowest line, the power is that of slow noise
    let surprise = match omega < LEAST_PERIODS * TAU {
        true => 0.0,
        false => (-(ln_upper_tail(z)) - (n as f64).ln()).max(0.0),
    };
    let line = Candidate { surprise, ..found(CauseId::RandomTone, z, omega, var.sqrt()) };
    (line, (r - 1.0) / (around(&all, best) - 1.0).abs().max(1.0 / m.sqrt()))
}

/// Median power of the neighbours of a peak, those 5 to 24 steps away.
fn around(all: &[f64], peak: usize) -> f64 {
    let near = all.iter().enumerate().filter(|(j, _)| (5..=24).contains(&j.abs_diff(peak)));
    median_of(near.map(|(_, power)| *power))
}

/// Mean over signals of the correlation rho at lag one, corrected for what the projection makes.
///
/// With S = (shift + its transpose)/2 and P = Q Q^T: E[u^T S u] = v (-tr(S P) + 2 rho (tr(S²) - 2 tr(S² P) +
/// tr(S P S P))) to first order in rho. In the code `products` is u^T S u, `lost` is tr(S P), and `slope` is
/// 2 (...), where 2 tr(S²) = n - 1.
fn lag_one(left: &[Residual], n: usize, v: f64) -> Candidate {
    let values: Vec<f64> = left
        .iter()
        .map(|l| {
            let products: f64 = l.u.windows(2).map(|w| w[0] * w[1]).sum();
            let q = &l.q;
            let s_q = shifted(q, 1);
            let inner = q.tr_mul(&s_q);
            let lost = inner.trace();
            let slope = (n as f64 - 1.0) - 4.0 * s_q.norm_squared() + 2.0 * inner.norm_squared();
            (products + v * lost) / (v * slope.max(1.0))
        })
        .collect();
    let (mean, se) = mean_of(&values);
    found(CauseId::CorrelatedNoise, mean / se.max(1e-12), mean, se)
}

/// rho of AR(1) noise to which digitising adds white noise of variance `white`, counts². `t`: the number for
/// which the sum n of both noises makes n_k - t n_{k-1} free of correlation at lag one; `left`: the variance
/// of this difference. With the variance S (`own`) of the AR(1) noise alone,
///
/// S (rho - t)(1 - rho t) = t white and left = (1 + t²)(S + white) - 2 t rho S,
///
/// which are solved by fixed-point iteration, with half steps.
pub fn beneath_rounding(t: f64, left: f64, white: f64) -> f64 {
    let mut rho = t;
    for _ in 0..50 {
        let denominator = 1.0 + t * t - 2.0 * t * rho;
        let own = (left - (1.0 + t * t) * white) / denominator.max(1e-6);
        if own <= white {
            return t; // hardly more than the rounding itself: nothing is known of it
        }
        let next = t + t * white / (own * (1.0 - rho * t).max(1e-3));
        rho = (0.5 * (rho + next)).clamp(-0.99, 0.99);
    }
    rho
}

/// Estimates the growth h of the noise's variance v0 (1 + h x), where x is the squared expected sample over
/// the largest one, from the mean and scatter over signals of the slope of squared residuals on x.
fn heteroscedastic(left: &[Residual], n: usize, v: f64) -> Candidate {
    let expected = || left.iter().flat_map(|l| &l.expected);
    let largest = expected().fold(1e-300_f64, |m, y| m.max(y.abs()));
    let x = |y: &f64| (y / largest).powi(2);
    let count = expected().count() as f64;
    let centre = expected().map(x).sum::<f64>() / count;
    let spread = expected().map(|y| x(y) * x(y)).sum::<f64>() / count - centre * centre;

    // The leverage is the share of a sample's variance that the projection takes.
    let (slopes, levels): (Vec<f64>, Vec<f64>) = left
        .iter()
        .map(|l| {
            let (mut slope, mut level) = (0.0, 0.0);
            for k in 0..n {
                let leverage: f64 = l.q.row(k).iter().map(|q| q * q).sum();
                let w = l.u[k] * l.u[k] / (1.0 - leverage).max(0.2) / v;
                slope += (w - 1.0) * (x(&l.expected[k]) - centre);
                level += w;
            }
            (slope / (spread * n as f64).max(1e-300), level / n as f64)
        })
        .unzip();

    let ((slope, se), (level, _)) = (mean_of(&slopes), mean_of(&levels));
    let at_zero = (level - slope * centre).max(0.05);
    let h = slope / at_zero;
    let sd = se / at_zero * (1.0 + h * centre);
    found(CauseId::HeteroscedasticNoise, slope / se.max(1e-12), h, sd)
}

#[cfg(test)]
mod tests {
    use super::super::generator::{Run, draw};
    use super::*;

    /// A fit takes low frequencies out of the noise and so correlates what is left; the estimate must allow
    /// for that.
    #[test]
    fn correlation_is_estimated_without_bias_from_what_a_fit_leaves() {
        for (rho, seed) in [(0.0, 21), (0.12, 22)] {
            let run = Run {
                channels: 16,
                bursts: 6,
                effect: Some(CauseId::CorrelatedNoise),
                size: rho,
                ..Run::default()
            };
            let data = draw(&run, seed);
            let model = Model::fitted(&data, 2).unwrap();
            let found = test(&data, &model);
            let own = &found.iter().find(|f| f.id == CauseId::CorrelatedNoise).unwrap();
            assert!((own.value - rho).abs() < 3.5 * own.sd, "{rho}: {} +- {}", own.value, own.sd);
            assert_eq!(own.accepted(), rho > 0.0);
        }
    }

    /// From the autocovariances of AR(1) noise with white noise added, the t that whitens is found by
    /// bisection; the rho that was put in must follow from it.
    #[test]
    fn rounding_does_not_hide_how_strongly_noise_is_correlated() {
        for rho in [-0.6, 0.1, 0.5, 0.87, 0.93] {
            let (own, white) = (4.0, 1.0 / 12.0);
            let lag_one = |t: f64| {
                let at = [own + white, rho * own, rho * rho * own];
                (1.0 + t * t) * at[1] - t * (at[0] + at[2])
            };
            let (mut low, mut high) = (-0.999, 0.999);
            for _ in 0..60 {
                let middle = 0.5 * (low + high);
                if lag_one(middle) > 0.0 { low = middle } else { high = middle }
            }
            let t = low;
            let left = (1.0 + t * t) * (own + white) - 2.0 * t * rho * own;
            let found = beneath_rounding(t, left, white);
            assert!((found - rho).abs() < 1e-4, "{rho}: {t} -> {found}");
            assert!(rho.abs() < 0.8 || (t - rho).abs() > 0.03, "rounding matters: {t}");
        }
    }
}
