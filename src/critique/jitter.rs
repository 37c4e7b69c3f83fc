//! `trigger_jitter`: a shift in time that is common to all channels of a burst, which share the trigger.
//!
//! In: signals about a fitted model. Out: [`Found`]. How healthy acquisition states scatter is not known, and no
//! share, direction or correlation of it is assumed: a shift of one signal alone is healthy scatter. What tells a
//! trigger is what the channels of one burst have in common. A burst may have something in common without a
//! jitter (a drive that varies), so the variance that bursts have along the shift must exceed what they have
//! across it, in amplitude. "Exceed" is said in radians of the ring and in multiples of the single signals' own
//! scatter, whichever asks for more.

use super::catalogue::CauseId;
use super::chance::{maximum, surprise};
use super::covariates::{COVARIATES, Covariates, DRIVE};
use super::found::Found;
use super::model::{Linear, Model};
use super::observations::Observations;
use super::tuned::FEW;
use nalgebra::{DMatrix, DVector, Matrix2, Matrix4, Vector2, Vector4};
use std::collections::BTreeMap;

/// Signals that are looked at, at most, and bursts.
const MOST: usize = 4096;
const MOST_BURSTS: usize = 400;
/// Bursts whose common part is not taken for something else that tell a variance.
const FEWEST: usize = 8;

/// One signal: phase, gain, ln sigma, ln omega about its model, and the noise of these.
struct Scatter {
    x: Vector4<f64>,
    noise: Matrix4<f64>,
    unit: usize,
    burst: usize,
    beside: [f64; COVARIATES],
}

/// What bursts have in common along one direction: independent contrasts between bursts, each of variance
/// `own + weight * common`.
struct Contrasts {
    /// (contrast, weight)
    each: Vec<Contrast>,
    /// Variance of one signal, noise included.
    own: f64,
}

struct Contrast {
    value: f64,
    weight: f64,
}

pub fn jitter(model: &Model, data: &Observations, beside: &Covariates) -> Found {
    let lack = |why| Found::untested(CauseId::TriggerJitter, why);
    if !beside.shared_bursts {
        return lack("bursts of several channels");
    }
    let Some(mut each) = scattered(model, data, beside) else { return lack("signals that ring") };
    freed_of_frequency(&mut each);
    let Some([along, across]) = contrasts(&each) else { return lack("more bursts") };
    let excess = Excess::of(&along, &across, healthy_ratio(&each));
    let to_s = data.dt_s * data.samples as f64 / model.mean[1].exp();
    let sd = excess.along.max(1e-16).sqrt();
    let s = surprise(excess.ratio, 1, 1.0, f64::INFINITY);
    let error_s = excess.along_sd / (2.0 * sd) * to_s;
    Found::of(CauseId::TriggerJitter, s, excess.ratio, sd * to_s, error_s)
}

/// Columns: (a, b) turned by a radian of shift, and (a, b) itself.
fn polar(a: f64, b: f64, sigma: f64, omega: f64) -> Matrix2<f64> {
    let r = sigma / omega;
    Matrix2::new(b - r * a, a, -(a + r * b), b)
}

/// Each signal's own parameters, by least squares about the model. `None`: they do not ring.
fn scattered(model: &Model, data: &Observations, beside: &Covariates) -> Option<Vec<Scatter>> {
    let of_signals = data.len().div_ceil(MOST);
    let stride = of_signals.max(data.bursts.div_ceil(MOST_BURSTS));
    let mut linear = Linear::default();
    let mut each = Vec::new();
    let mut numbers = BTreeMap::new();
    for (i, row) in data.rows.iter().enumerate() {
        if !row.burst.is_multiple_of(stride) {
            continue;
        }
        model.linearise(i, data, beside, &mut linear);
        let theta = model.theta(i, data, beside);
        let turn = polar(theta[2], theta[3], theta[0].exp(), theta[1].exp());
        let c = &linear.tangent.columns;
        let columns = DMatrix::from_fn(data.samples, 4, |k, j| match j {
            0 | 1 => turn[(0, j)] * c[2][k] + turn[(1, j)] * c[3][k],
            _ => c[j - 2][k],
        });
        let inverse = columns.tr_mul(&columns).try_inverse()?;
        let x = &inverse * columns.tr_mul(&DVector::from_column_slice(&linear.residual));
        // what the linearisation has taken already
        let own = model.each[i];
        let taken = turn.try_inverse()? * Vector2::new(own[2], own[3]);
        let mut of_beside = beside.z[i];
        of_beside[0] = beside.z[i][DRIVE].powi(2);
        each.push(Scatter {
            x: Vector4::new(x[0] + taken[0], x[1] + taken[1], x[2] + own[0], x[3] + own[1]),
            noise: Matrix4::from_fn(|a, b| inverse[(a, b)] * model.noise_var),
            unit: {
                let next = numbers.len();
                *numbers.entry(row.unit).or_insert(next)
            },
            burst: row.burst,
            beside: of_beside,
        });
    }
    Some(each)
}

/// A signal that rings faster arrives at t_a with another phase: takes out what follows the frequency within
/// channels.
fn freed_of_frequency(each: &mut [Scatter]) {
    let centred = centred(each);
    let (mut seen, mut real) = (0.0, Vector4::zeros());
    for (x, one) in centred.iter().zip(each.iter()) {
        seen += x[3] * x[3];
        real += x * x[3] - one.noise.column(3);
    }
    let var = real[3].max(FEW * seen).max(1e-300);
    let mut turn = Matrix4::identity();
    turn[(0, 3)] = -real[0] / var;
    turn[(1, 3)] = -real[1] / var;
    for one in each {
        one.x = turn * one.x;
        one.noise = turn * one.noise * turn.transpose();
    }
}

/// Each signal about its channel's mean.
fn centred(each: &[Scatter]) -> Vec<Vector4<f64>> {
    let units = each.iter().map(|one| one.unit + 1).max().unwrap_or(0);
    let mut sums = vec![(Vector4::zeros(), 0.0); units];
    for one in each {
        sums[one.unit].0 += one.x;
        sums[one.unit].1 += 1.0;
    }
    each.iter().map(|one| one.x - sums[one.unit].0 / sums[one.unit].1).collect()
}

/// Variance that single signals have beyond the noise, along the shift and in amplitude.
fn healthy(each: &[Scatter], direction: usize) -> f64 {
    beyond_noise(each, &centred(each), direction)
}

fn beyond_noise(each: &[Scatter], of: &[Vector4<f64>], direction: usize) -> f64 {
    let n = each.len() as f64;
    let beyond: Vec<f64> = of
        .iter()
        .zip(each)
        .map(|(x, one)| x[direction].powi(2) - one.noise[(direction, direction)])
        .collect();
    let mean = beyond.iter().sum::<f64>() / n;
    let square = beyond.iter().map(|b| (b - mean).powi(2)).sum::<f64>() / n;
    mean.max((square / n).sqrt()) // no smaller than it can be told
}

/// How much more single signals scatter along the shift than across it, what their bursts have in common left out;
/// 1 where it is less.
fn healthy_ratio(each: &[Scatter]) -> f64 {
    let of = about_bursts(each, centred(each));
    (beyond_noise(each, &of, 0) / beyond_noise(each, &of, 1)).max(1.0)
}

/// Each signal about its burst's mean.
fn about_bursts(each: &[Scatter], mut of: Vec<Vector4<f64>>) -> Vec<Vector4<f64>> {
    let mut sums = BTreeMap::<usize, (Vector4<f64>, f64)>::new();
    for (x, one) in of.iter().zip(each) {
        let sum = sums.entry(one.burst).or_default();
        sum.0 += x;
        sum.1 += 1.0;
    }
    for (x, one) in of.iter_mut().zip(each) {
        let (sum, n) = sums[&one.burst];
        *x -= sum / n;
    }
    of
}

/// Contrasts between bursts along the shift and across it, free of channels' own means and of what follows a
/// covariate. `None`: too few are left.
fn contrasts(each: &[Scatter]) -> Option<[Contrasts; 2]> {
    let along = contrasts_of(each, 0)?;
    let across = contrasts_of(each, 1)?;
    Some([along, across])
}

fn contrasts_of(each: &[Scatter], direction: usize) -> Option<Contrasts> {
    let scatter = healthy(each, direction);
    let weights: Vec<f64> =
        each.iter().map(|one| 1.0 / (scatter + one.noise[(direction, direction)])).collect();
    let bursts = each.iter().map(|one| one.burst + 1).max()?;
    let mut place = vec![usize::MAX; bursts];
    let mut count = 0;
    for one in each {
        if place[one.burst] == usize::MAX {
            place[one.burst] = count;
            count += 1;
        }
    }
    // columns: bursts, covariates, the signal itself; each less its channel's weighted mean
    let (n, columns) = (each.len(), count + COVARIATES + 1);
    let mut m = DMatrix::<f64>::zeros(n, columns);
    for (i, one) in each.iter().enumerate() {
        m[(i, place[one.burst])] = 1.0;
        (0..COVARIATES).for_each(|c| m[(i, count + c)] = one.beside[c]);
        m[(i, columns - 1)] = one.x[direction];
    }
    less_channels(&mut m, each, &weights);
    let gram = m.tr_mul(&m);
    let beside = gram.view((count, count), (COVARIATES, COVARIATES)).into_owned();
    let scale = beside.diagonal().map(|d| if d > 1e-9 * n as f64 { 1.0 / d.sqrt() } else { 0.0 });
    let unit =
        DMatrix::from_fn(COVARIATES, COVARIATES, |a, b| beside[(a, b)] * scale[a] * scale[b]);
    let eigen = unit.symmetric_eigen();
    let kept = eigen.eigenvalues.map(|v| if v > 1e-6 { 1.0 / v.sqrt() } else { 0.0 });
    let root = DMatrix::from_diagonal(&scale) * eigen.eigenvectors * DMatrix::from_diagonal(&kept);
    let explained = gram.columns(count, COVARIATES) * root;
    let left = &gram - &explained * explained.transpose();
    let of_bursts = left.view((0, 0), (count, count)).into_owned().symmetric_eigen();
    let score = left.view((0, columns - 1), (count, 1)).into_owned();
    let largest = of_bursts.eigenvalues.max();
    let each_contrast: Vec<Contrast> = (0..count)
        .filter(|k| of_bursts.eigenvalues[*k] > FEW * largest)
        .map(|k| {
            let weight = of_bursts.eigenvalues[k];
            let value = of_bursts.eigenvectors.column(k).dot(&score.column(0)) / weight.sqrt();
            Contrast { value, weight }
        })
        .collect();
    let between: f64 = each_contrast.iter().map(|c| c.value * c.value).sum();
    let channels = each.iter().map(|one| one.unit + 1).max()?;
    let free = n as f64
        - (channels + kept.iter().filter(|k| **k > 0.0).count() + each_contrast.len()) as f64;
    (each_contrast.len() >= FEWEST && free >= FEWEST as f64).then(|| Contrasts {
        own: (left[(columns - 1, columns - 1)] - between).max(1e-300) / free,
        each: each_contrast,
    })
}

/// Rows times the roots of their weights, less their channel's weighted mean.
fn less_channels(m: &mut DMatrix<f64>, each: &[Scatter], weights: &[f64]) {
    let units = each.iter().map(|one| one.unit + 1).max().unwrap_or(0);
    let mut sums = DMatrix::<f64>::zeros(units, m.ncols());
    let mut total = vec![0.0; units];
    for (i, one) in each.iter().enumerate() {
        total[one.unit] += weights[i];
        let mut sum = sums.row_mut(one.unit);
        sum += m.row(i) * weights[i];
    }
    for (i, one) in each.iter().enumerate() {
        let centred = (m.row(i) - sums.row(one.unit) / total[one.unit]) * weights[i].sqrt();
        m.set_row(i, &centred);
    }
}

impl Contrasts {
    /// -2 ln likelihood of a common variance.
    fn deviance(&self, common: f64) -> f64 {
        let of = |c: &Contrast| {
            let var = self.own + c.weight * common;
            var.ln() + c.value * c.value / var
        };
        self.each.iter().map(of).sum()
    }

    /// Fisher information of the common variance.
    fn information(&self, common: f64) -> f64 {
        let of = |c: &Contrast| 0.5 * (c.weight / (self.own + c.weight * common)).powi(2);
        self.each.iter().map(of).sum()
    }
}

/// Bursts' variance along the shift beyond what they have across it.
struct Excess {
    /// Likelihood ratio: free, against no more along the shift than across it.
    ratio: f64,
    /// Variance along the shift, and its standard error, rad².
    along: f64,
    along_sd: f64,
}

impl Excess {
    /// `most`: how many times the variance across may be had along the shift by healthy bursts.
    fn of(along: &Contrasts, across: &Contrasts, most: f64) -> Excess {
        let best = least(|v| along.deviance(v));
        let best_across = least(|v| across.deviance(v));
        let free = along.deviance(best) + across.deviance(best_across);
        let ratio = match best <= most * best_across {
            true => 0.0,
            false => {
                let tied = least(|v| along.deviance(v) + across.deviance(v / most));
                along.deviance(tied) + across.deviance(tied / most) - free
            }
        };
        Excess {
            ratio: ratio.max(0.0),
            along: best,
            along_sd: 1.0 / along.information(best).max(1e-300).sqrt(),
        }
    }
}

/// The variance (rad², relative²) at which a deviance is least: a scan over decades, then the golden section.
fn least(deviance: impl Fn(f64) -> f64) -> f64 {
    let at = |ln: f64| deviance(ln.exp());
    let middle = (-30..=2).map(f64::from).min_by(|p, q| at(*p).total_cmp(&at(*q))).unwrap_or(0.0);
    let found = maximum(|ln| -at(ln), middle, 1.0).exp();
    if deviance(0.0) <= deviance(found) { 0.0 } else { found }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    /// Standard deviations: of single signals and of bursts, along the shift (rad) and across it.
    #[derive(Clone, Copy)]
    struct Spread {
        own: [f64; 2],
        common: [f64; 2],
    }

    /// 24 bursts of 8 of 16 channels each.
    fn drawn(spread: Spread, seed: u64) -> Vec<Scatter> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let of_channel: Vec<f64> = (0..16).map(|_| 0.05 * normal()).collect();
        let mut all = Vec::new();
        for burst in 0..24 {
            let common = spread.common.map(|sd| sd * normal());
            let drive = 0.67 + 0.165 * f64::from(burst % 5);
            for slot in 0..8 {
                let unit = ((burst % 2) * 8 + slot) as usize;
                let sd = [0.006, 0.005, 0.02, 0.0006].map(|s| s / drive);
                let mut x = Vector4::new(0.0, 0.0, 0.01 * normal(), 0.002 * normal());
                for j in 0..2 {
                    x[j] = of_channel[unit] + common[j] + spread.own[j] * normal();
                }
                (0..4).for_each(|j| x[j] += sd[j] * normal());
                let noise = Matrix4::from_diagonal(&Vector4::from(sd).map(|s| s * s));
                let mut beside = [0.0; COVARIATES];
                beside[DRIVE] = drive - 1.0;
                all.push(Scatter { x, noise, unit, burst: burst as usize, beside });
            }
        }
        all
    }

    fn excess(spread: Spread, seed: u64) -> Excess {
        let mut each = drawn(spread, seed);
        freed_of_frequency(&mut each);
        let [along, across] = contrasts(&each).unwrap();
        Excess::of(&along, &across, healthy_ratio(&each))
    }

    fn found_in(spread: Spread, runs: u64) -> usize {
        let passes = |seed| surprise(excess(spread, seed).ratio, 1, 1.0, f64::INFINITY) > 8.3;
        (0..runs).filter(|seed| passes(*seed)).count()
    }

    #[test]
    fn a_shift_of_whole_bursts_is_found_and_measured() {
        let spread = Spread { own: [0.01, 0.01], common: [0.02, 0.0] };
        assert!(found_in(spread, 40) >= 38);
        let sizes: f64 = (0..40).map(|seed| excess(spread, seed).along.sqrt()).sum();
        assert!((sizes / 40.0 - 0.02).abs() < 0.002, "{}", sizes / 40.0);
    }

    /// However single signals scatter, and whatever a burst's channels have in common in all directions.
    #[test]
    fn healthy_scatter_is_no_jitter() {
        for own in [[0.01, 0.01], [0.03, 0.001], [0.001, 0.03]] {
            for common in [[0.0, 0.0], [0.0, 0.03], [0.02, 0.02]] {
                let found = found_in(Spread { own, common }, 60);
                assert!(found <= 1, "{own:?} {common:?}: {found} of 60");
            }
        }
    }
}
