//! Tests `trigger_jitter`: a shift in time that is common to all channels of a burst, which share the
//! trigger. In: signals about a fitted model that holds the causes found so far. Out: one [`Candidate`].
//!
//! How the acquisition states of healthy signals scatter is not known, so a shift of one signal alone is
//! healthy scatter, and bursts may have something in common without a jitter (for example a drive that
//! varies), in any direction of the state. So two questions are asked:
//!
//! 1. Do bursts vary along the shift at all, beyond the scatter of single signals? (likelihood ratio
//!    `Excess::statistic`, which must pass the threshold of all causes)
//! 2. Is their variance along the shift clearly larger than that across the shift, in amplitude? (likelihood
//!    ratio `Excess::ratio`, which must be a hint). Variances are compared in radians of the ring, or in
//!    multiples of the single signals' own scatter, whichever asks for more (`healthy_ratio`).
//!
//! Both are asked of contrasts between bursts, free of channels' means and of covariates (`between.rs`).

use super::between::{Contrasts, Scatter, least};
use super::candidate::Candidate;
use super::catalogue::CauseId;
use super::chance::{HINT, surprise};
use super::covariates::DRIVE;
use super::matrices::means_of_groups;
use super::model::{Linear, Model};
use super::objection::Objection;
use super::observations::{Observations, numbered};
use inkling_core::numbers::LITTLE;
use nalgebra::{DMatrix, DVector, Matrix2, Matrix4, Vector2, Vector4};
use std::collections::BTreeMap;

/// Largest number of signals (about), and of bursts; of more, every second burst or third, .. is looked at.
const MOST: usize = 4096;
const MOST_BURSTS: usize = 400;

/// The candidate's value is the standard deviation of the shift in s. It is `untested` where bursts hold one
/// channel, signals do not ring, or too few contrasts are left.
pub fn jitter(model: &Model, data: &Observations) -> Candidate {
    let lack = |why| Candidate::untested(CauseId::TriggerJitter, why);
    if !data.beside.shared_bursts {
        return lack("bursts of several channels");
    }
    let Some(mut each) = scattered(model, data) else { return lack("signals that ring") };
    freed_of_frequency(&mut each);
    let Some([along, across]) = contrasts(&each) else { return lack("more bursts") };
    let excess = Excess::of(&along, &across, healthy_ratio(&each));
    // from radians of the ring to s; the error of a root is that of the variance over twice the root
    let to_s = data.length_s() / model.mean[1].exp();
    let sd = excess.along.max(1e-16).sqrt();
    let error_s = excess.along_sd / (2.0 * sd) * to_s;
    let plain = Candidate::plain(CauseId::TriggerJitter, excess.statistic, ());
    let mut found = Candidate { value: sd * to_s, sd: error_s, ..plain };
    if found.accepted() && !excess.beyond_any_direction() {
        found.objection = Some(Objection::AnyDirection);
    }
    found
}

/// Derivatives of the amplitudes (a, b) of a damped pair by a shift of the time of acquisition, per radian of
/// the ring, and by a relative growth. Later by t, the pair is e^{-sigma t} times (a, b) turned by omega t.
fn polar(a: f64, b: f64, sigma: f64, omega: f64) -> Matrix2<f64> {
    let r = sigma / omega;
    Matrix2::new(b - r * a, a, -(a + r * b), b)
}

/// Each signal's own shift (rad), gain, ln damping and ln frequency by least squares, relative to its
/// channel's parameters in the model. `None`: a signal does not ring.
fn scattered(model: &Model, data: &Observations) -> Option<Vec<Scatter>> {
    let of_signals = data.len().div_ceil(MOST);
    let stride = of_signals.max(data.bursts.div_ceil(MOST_BURSTS));
    let mut linear = Linear::default();
    let mut each = Vec::new();
    let mut numbers = BTreeMap::new();
    for (i, row) in data.rows.iter().enumerate() {
        if !row.burst.is_multiple_of(stride) {
            continue;
        }
        model.linearise(i, data, &mut linear);
        let theta = model.theta(i, data);
        let turn = polar(theta[2], theta[3], theta[0].exp(), theta[1].exp());
        let c = &linear.tangent.columns;
        let columns = DMatrix::from_fn(data.samples, 4, |k, j| match j {
            0 | 1 => turn[(0, j)] * c[2][k] + turn[(1, j)] * c[3][k],
            _ => c[j - 2][k],
        });
        let inverse = columns.tr_mul(&columns).try_inverse()?;
        let x = &inverse * columns.tr_mul(&DVector::from_column_slice(&linear.residual));
        // the fit finds only what the model's own deviation of the signal has missed: add that, turned to
        // (shift, gain)
        let own = model.each[i];
        let taken = turn.try_inverse()? * Vector2::new(own[2], own[3]);
        // the constant would be of no use there, so its place takes the square of the drive
        let mut of_beside = data.beside.z[i];
        of_beside[0] = data.beside.z[i][DRIVE].powi(2);
        each.push(Scatter {
            x: Vector4::new(x[0] + taken[0], x[1] + taken[1], x[2] + own[0], x[3] + own[1]),
            noise: Matrix4::from_fn(|a, b| inverse[(a, b)] * model.noise_var),
            unit: numbered(&mut numbers, row.unit),
            burst: row.burst,
            beside: of_beside,
        });
    }
    Some(each)
}

/// Takes out of all signals' shifts and gains what follows their frequency within channels, by linear
/// regression: a signal that rings faster arrives at t_a with another phase.
fn freed_of_frequency(each: &mut [Scatter]) {
    let centred = centred(each);
    // Sums of products with the frequency; in `real` the covariance of the errors is subtracted, which would
    // otherwise look like a regression.
    let (mut seen, mut real) = (0.0, Vector4::zeros());
    for (x, one) in centred.iter().zip(each.iter()) {
        seen += x[3] * x[3];
        real += x * x[3] - one.noise.column(3);
    }
    // at least a tenth of the square, so that a frequency that hardly scatters gives no wild slope
    let var = real[3].max(LITTLE * seen).max(1e-300);
    let mut turn = Matrix4::identity();
    turn[(0, 3)] = -real[0] / var;
    turn[(1, 3)] = -real[1] / var;
    for one in each {
        one.x = turn * one.x;
        one.noise = turn * one.noise * turn.transpose();
    }
}

fn centred(each: &[Scatter]) -> Vec<Vector4<f64>> {
    about_their_means(each.iter().map(|one| one.x).collect(), |i| each[i].unit)
}

fn about_their_means(
    mut of: Vec<Vector4<f64>>,
    group: impl Fn(usize) -> usize,
) -> Vec<Vector4<f64>> {
    let groups: Vec<usize> = (0..of.len()).map(group).collect();
    let count = groups.iter().max().map_or(0, |last| last + 1);
    let means = means_of_groups(count, groups.iter().copied().zip(of.iter().copied()));
    of.iter_mut().zip(groups).for_each(|(x, group)| *x -= means[group]);
    of
}

/// Variance that single signals have beyond the noise in a direction (0: along the shift, 1: in amplitude),
/// but at least its standard error. `of`: parameters relative to some mean.
fn beyond_noise(each: &[Scatter], of: &[Vector4<f64>], direction: usize) -> f64 {
    let n = each.len() as f64;
    let beyond: Vec<f64> = of
        .iter()
        .zip(each)
        .map(|(x, one)| x[direction].powi(2) - one.noise[(direction, direction)])
        .collect();
    let mean = beyond.iter().sum::<f64>() / n;
    let square = beyond.iter().map(|b| (b - mean).powi(2)).sum::<f64>() / n;
    mean.max((square / n).sqrt()) // a smaller variance cannot be told from none
}

/// Ratio of single signals' variances along the shift and across it, about the means of channel and burst; at
/// least 1. Healthy bursts are granted the same ratio.
fn healthy_ratio(each: &[Scatter]) -> f64 {
    let of = about_their_means(centred(each), |i| each[i].burst);
    (beyond_noise(each, &of, 0) / beyond_noise(each, &of, 1)).max(1.0)
}

fn contrasts(each: &[Scatter]) -> Option<[Contrasts; 2]> {
    let centred = centred(each);
    let of = |direction| Contrasts::of(each, direction, beyond_noise(each, &centred, direction));
    Some([of(0)?, of(1)?])
}

/// The variance of bursts along the shift, compared with none and with that across it.
struct Excess {
    statistic: f64,
    /// Likelihood-ratio statistic of two free variances against two whose ratio is at most that of healthy
    /// bursts.
    ratio: f64,
    /// Most likely variance along the shift, rad².
    along: f64,
    along_sd: f64,
}

impl Excess {
    fn of(along: &Contrasts, across: &Contrasts, most: f64) -> Excess {
        let best = least(|v| along.deviance(v));
        let best_across = least(|v| across.deviance(v));
        let free = along.deviance(best) + across.deviance(best_across);
        // the ratio at its healthy bound, with one free variance
        let ratio = match best <= most * best_across {
            true => 0.0,
            false => {
                let tied = least(|v| along.deviance(v) + across.deviance(v / most));
                along.deviance(tied) + across.deviance(tied / most) - free
            }
        };
        Excess {
            statistic: along.deviance(0.0) - along.deviance(best),
            ratio: ratio.max(0.0),
            along: best,
            along_sd: 1.0 / along.information(best).max(1e-300).sqrt(),
        }
    }

    /// Question 2 of the module's doc.
    fn beyond_any_direction(&self) -> bool {
        surprise(self.ratio, 1, 1.0, f64::INFINITY) > HINT
    }
}

#[cfg(test)]
mod tests {
    use super::super::chance::THRESHOLD;
    use super::super::covariates::COVARIATES;
    use super::super::covariates::{TEMPERATURE, TIME, square_of};
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    /// Standard deviations, along the shift (rad) and across it, of single signals and of what bursts have in
    /// common; and the shift of a burst per relative change of the drive.
    #[derive(Clone, Copy, Default)]
    struct Spread {
        own: [f64; 2],
        common: [f64; 2],
        follows: f64,
    }

    /// 24 bursts of 8 of the 16 channels each, with a time, a temperature and a drive each.
    fn drawn(spread: Spread, seed: u64) -> Vec<Scatter> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let of_channel: Vec<f64> = (0..16).map(|_| 0.05 * normal()).collect();
        let mut all = Vec::new();
        for burst in 0..24_i32 {
            let mut common = spread.common.map(|sd| sd * normal());
            let drive = 0.67 + 0.165 * f64::from(burst % 5);
            common[0] += spread.follows * (drive - 1.0);
            let mut beside = [0.0; COVARIATES];
            beside[DRIVE] = drive - 1.0;
            beside[TIME] = f64::from(burst) / 23.0 - 0.5;
            beside[TEMPERATURE] = (0.6 * f64::from(burst)).sin();
            for which in [TIME, TEMPERATURE] {
                beside[square_of(which).unwrap()] = beside[which] * beside[which];
            }
            for slot in 0..8 {
                let unit = ((burst % 2) * 8 + slot) as usize;
                let sd = [0.006, 0.005, 0.02, 0.0006].map(|s| s / drive);
                let mut x = Vector4::new(0.0, 0.0, 0.01 * normal(), 0.002 * normal());
                for j in 0..2 {
                    x[j] = of_channel[unit] + common[j] + spread.own[j] * normal();
                }
                (0..4).for_each(|j| x[j] += sd[j] * normal());
                let noise = Matrix4::from_diagonal(&Vector4::from(sd).map(|s| s * s));
                all.push(Scatter { x, noise, unit, burst: burst as usize, beside });
            }
        }
        all
    }

    /// The excess along the shift that the test finds in drawn signals.
    fn excess(spread: Spread, seed: u64) -> Excess {
        let mut each = drawn(spread, seed);
        freed_of_frequency(&mut each);
        let [along, across] = contrasts(&each).unwrap();
        Excess::of(&along, &across, healthy_ratio(&each))
    }

    /// In how many runs a jitter is found.
    fn found_in(spread: Spread, runs: u64) -> usize {
        let passes = |seed| {
            let excess = excess(spread, seed);
            let s = surprise(excess.statistic, 1, 1.0, f64::INFINITY);
            s > THRESHOLD && excess.beyond_any_direction()
        };
        (0..runs).filter(|seed| passes(*seed)).count()
    }

    #[test]
    fn a_shift_of_whole_bursts_is_found_and_measured() {
        let spread = Spread { own: [0.01, 0.01], common: [0.02, 0.0], ..Default::default() };
        assert!(found_in(spread, 40) >= 38);
        let sizes: f64 = (0..40).map(|seed| excess(spread, seed).along.sqrt()).sum();
        assert!((sizes / 40.0 - 0.02).abs() < 0.002, "{}", sizes / 40.0);
        // bursts shifted by two detection limits
        let found = found_in(Spread { common: [0.01, 0.0], ..spread }, 40);
        assert!(found >= 32, "{found} of 40");
    }

    /// However single signals scatter, and whatever the channels of a burst have in common in all directions,
    /// no jitter may be found.
    #[test]
    fn healthy_scatter_is_no_jitter() {
        for own in [[0.01, 0.01], [0.03, 0.001], [0.001, 0.03]] {
            for common in [[0.0, 0.0], [0.0, 0.03], [0.02, 0.02]] {
                let found = found_in(Spread { own, common, ..Default::default() }, 60);
                assert!(found <= 2, "{own:?} {common:?}: {found} of 60");
            }
        }
    }

    #[test]
    fn what_bursts_follow_is_no_jitter() {
        for follows in [0.02, 0.04, 0.1] {
            let found = found_in(Spread { own: [0.01; 2], common: [0.0; 2], follows }, 60);
            assert!(found <= 1, "{follows}: {found} of 60");
        }
    }
}
