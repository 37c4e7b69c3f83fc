//! What the extension buys, on signals that nothing was fitted to.
//!
//! In: baseline and causes. Out: [`Measured`]. Both models are fitted to every other channel in the
//! first half of the time, and judged on the other channels in the second half (with too few channels
//! by time alone). A held-out channel's own parameters are unknown: what is judged is the deviation from
//! the population, in its covariance.

use super::candidates::Applied;
use super::covariates::Covariates;
use super::ensemble::project;
use super::finding::{Energies, Gain, GainFigures, HeldOut, Misfit};
use super::model::{Linear, Matrix5, Model, Vector5, dot};
use super::observations::Observations;
use super::ring::FREE;
use super::selection::{Setting, refit};
use nalgebra::DMatrix;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Fewer channels than this are split by time alone.
const FEWEST_UNITS: usize = 6;
/// Signals of a part that a model can be fitted to.
const FEWEST: usize = 8;
const RESAMPLINGS: usize = 100;
/// Share of healthy training signals beyond the threshold.
const FALSE_ALARMS: f64 = 0.01;
/// The small nozzle fault that is put in: a change of ln damping, in standard deviations of the extended
/// model's healthy signals.
const FAULT: f64 = 2.5;
const LAGS: usize = 10;

#[derive(Clone, Debug, Default)]
pub struct Measured {
    pub gain: Gain,
    pub misfit: Misfit,
    pub energies: Energies,
    pub auc_gain: f64,
}

/// What one signal says against a model.
struct Judged {
    unit: usize,
    chi2: f64,
    square: f64,
    size: f64,
    /// Free parameters about the population mean, and the inverse of their covariance.
    off: Vector5,
    metric: Matrix5,
    /// Products at each lag, whitened.
    lags: [f64; LAGS],
}

fn judge(model: &Model, data: &Observations, beside: &Covariates) -> Vec<Judged> {
    // about the mean, not about the channels' own parameters
    let mut mean = model.clone();
    mean.units = vec![model.mean; data.units];
    mean.each = vec![Default::default(); data.len()];
    let mut linear = Linear::default();
    let n = data.samples;
    (0..data.len())
        .map(|i| {
            mean.linearise(i, data, beside, &mut linear);
            let columns = &linear.tangent.columns;
            let r = &linear.residual;
            let mut gram = Matrix5::zeros();
            let mut product = Vector5::zeros();
            for a in 0..FREE {
                product[a] = dot(&columns[a], r);
                for b in 0..=a {
                    gram[(a, b)] = dot(&columns[a], &columns[b]);
                    gram[(b, a)] = gram[(a, b)];
                }
            }
            let v = model.noise_var;
            let spread = model.between + model.within;
            // r^T (v + J S J^T)^-1 r
            let inner = Matrix5::identity() * v + gram * spread;
            let m = spread * inner.try_inverse().unwrap_or_else(Matrix5::zeros);
            let square = dot(r, r);
            let chi2 = (square - product.dot(&(m * product))) / v;
            let scale = model.scale();
            let scaled = Matrix5::from_fn(|a, b| gram[(a, b)] * scale[a] * scale[b]);
            let ridge = Matrix5::identity() * (1e-9 * scaled.trace());
            let inverse = (scaled + ridge).try_inverse().unwrap_or_else(Matrix5::zeros);
            let off = inverse * product.component_mul(&scale);
            let covariance =
                inverse * v + Matrix5::from_fn(|a, b| spread[(a, b)] / (scale[a] * scale[b]));
            let metric = covariance.try_inverse().unwrap_or_else(Matrix5::zeros);
            let mut u = r.clone();
            let j = DMatrix::from_fn(n, FREE, |k, a| columns[a][k] * scale[a]);
            project(&j.qr().q(), &mut u);
            let power = dot(&u, &u).max(f64::MIN_POSITIVE);
            let lags = std::array::from_fn(|lag| {
                let products: f64 = (lag + 1..n).map(|k| u[k] * u[k - lag - 1]).sum();
                products / power
            });
            let y = data.signal(i);
            let centre = y.iter().map(|y| f64::from(*y)).sum::<f64>() / n as f64;
            let size = y.iter().map(|y| (f64::from(*y) - centre).powi(2)).sum();
            Judged { unit: data.rows[i].unit, chi2, square, size, off, metric, lags }
        })
        .collect()
}

fn statistics(judged: &[Judged], fault: f64) -> Vec<f64> {
    let d = |j: &Judged| {
        let mut off = j.off;
        off[0] += fault;
        off.dot(&(j.metric * off))
    };
    judged.iter().map(d).collect()
}

/// Area under the ROC curve: the chance that a faulty signal's statistic is the larger.
fn auc(healthy: &[f64], faulty: &[f64]) -> f64 {
    let mut all: Vec<(f64, bool)> = healthy.iter().map(|v| (*v, false)).collect();
    all.extend(faulty.iter().map(|v| (*v, true)));
    all.sort_by(|p, q| p.0.total_cmp(&q.0));
    let (mut below, mut sum) = (0.0, 0.0);
    for (_, is_faulty) in all {
        if is_faulty {
            sum += below;
        } else {
            below += 1.0;
        }
    }
    sum / (healthy.len() as f64 * faulty.len() as f64).max(1.0)
}

/// Ljung and Box over the pooled lags, against their own spread over signals.
fn whiteness(judged: &[Judged]) -> f64 {
    let n = judged.len() as f64;
    let mut z2 = 0.0;
    for lag in 0..LAGS {
        let mean = judged.iter().map(|j| j.lags[lag]).sum::<f64>() / n;
        let var = judged.iter().map(|j| (j.lags[lag] - mean).powi(2)).sum::<f64>() / n;
        z2 += mean * mean / (var / n).max(1e-300);
    }
    (-super::candidates::surprise(z2, LAGS, 1.0, f64::INFINITY)).exp()
}

struct Sums {
    chi2: f64,
    nrmse: f64,
}

fn sums<'a>(judged: impl Iterator<Item = &'a Judged>, samples: usize) -> Sums {
    let (mut chi2, mut square, mut size, mut n) = (0.0, 0.0, 0.0, 0.0);
    for j in judged {
        chi2 += j.chi2;
        square += j.square;
        size += j.size;
        n += samples as f64;
    }
    Sums { chi2: chi2 / f64::max(n, 1.0), nrmse: 100.0 * (square / f64::max(size, 1e-300)).sqrt() }
}

fn figures(
    model: &Model,
    train: (&Observations, &Covariates),
    test: (&Observations, &Covariates),
    fault: f64,
) -> (GainFigures, Vec<f64>) {
    let mut of_training = statistics(&judge(model, train.0, train.1), 0.0);
    of_training.sort_by(f64::total_cmp);
    let at = ((of_training.len() as f64 * (1.0 - FALSE_ALARMS)).ceil() as usize)
        .clamp(1, of_training.len());
    let threshold = of_training[at - 1];
    let judged = judge(model, test.0, test.1);
    let healthy = statistics(&judged, 0.0);
    let faulty = statistics(&judged, fault);
    let all = sums(judged.iter(), test.0.samples);
    let alarms = |chosen: &[usize]| {
        chosen.iter().filter(|&&i| healthy[i] > threshold).count() as f64
            / chosen.len().max(1) as f64
    };
    // resampling channels
    let mut by_unit = vec![Vec::new(); test.0.units];
    judged.iter().enumerate().for_each(|(i, j)| by_unit[j.unit].push(i));
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut resampled: [Vec<f64>; 4] = Default::default();
    for _ in 0..RESAMPLINGS {
        let mut chosen = Vec::with_capacity(judged.len());
        if by_unit.len() >= FEWEST_UNITS {
            for _ in 0..by_unit.len() {
                chosen.extend_from_slice(&by_unit[rng.random_range(0..by_unit.len())]);
            }
        } else {
            chosen.extend((0..judged.len()).map(|_| rng.random_range(0..judged.len())));
        }
        let s = sums(chosen.iter().map(|&i| &judged[i]), test.0.samples);
        let pick = |v: &[f64]| -> Vec<f64> { chosen.iter().map(|&i| v[i]).collect() };
        resampled[0].push(s.chi2);
        resampled[1].push(s.nrmse);
        resampled[2].push(alarms(&chosen));
        resampled[3].push(auc(&pick(&healthy), &pick(&faulty)));
    }
    let interval = |values: &mut Vec<f64>| {
        values.sort_by(f64::total_cmp);
        let at = |share: f64| values[((values.len() - 1) as f64 * share).round() as usize];
        Some([at(0.025), at(0.975)])
    };
    let everyone: Vec<usize> = (0..judged.len()).collect();
    let found = GainFigures {
        chi2_per_dof: all.chi2,
        chi2_per_dof_interval: interval(&mut resampled[0]),
        nrmse_percent: all.nrmse,
        nrmse_percent_interval: interval(&mut resampled[1]),
        whiteness_p: whiteness(&judged),
        threshold,
        false_alarms: alarms(&everyone),
        false_alarms_interval: interval(&mut resampled[2]),
        detection_auc: auc(&healthy, &faulty),
        detection_auc_interval: interval(&mut resampled[3]),
    };
    (found, healthy)
}

/// `before`: the baseline on all signals. `causes`: as they were found.
pub fn measure(before: &Model, causes: &[Applied], setting: Setting) -> Measured {
    let (data, beside) = (setting.data, setting.beside);
    let all = judge(before, data, beside);
    let s = sums(all.iter(), data.samples);
    let misfit =
        Misfit { chi2_per_dof: s.chi2, nrmse_percent: s.nrmse, whiteness_p: whiteness(&all) };
    let mut measured = Measured { misfit, ..Measured::default() };

    let mut times: Vec<i64> = data.rows.iter().map(|r| r.beside.t_acq_ns).collect();
    times.sort_unstable();
    let middle = times[times.len() / 2];
    let by_channel = data.units >= FEWEST_UNITS;
    let late = |i: usize| data.rows[i].beside.t_acq_ns >= middle;
    let odd = |i: usize| data.rows[i].unit % 2 == 1;
    // where every channel was heard once, time says nothing beyond the channel
    let by_time = data.len() > data.units;
    let train = |i: usize| (!by_channel || !odd(i)) && (!by_time || !late(i));
    let test = |i: usize| (!by_channel || odd(i)) && (!by_time || late(i));
    let (of_train, of_test) = (data.select(train), data.select(test));
    if of_train.len() < FEWEST || of_test.len() < FEWEST {
        return measured;
    }
    let (z_train, z_test) = (beside.select(train), beside.select(test));
    let part = Setting { data: &of_train, beside: &z_train, avoid: setting.avoid };
    let Ok(mut start) = Model::start(&of_train, &z_train, before.real) else { return measured };
    start.ceiling = before.ceiling;
    start.lattice = before.lattice;
    start.fit(&of_train, &z_train, 2);
    let plain = refit(start, Vec::new(), part, 2, true).model;
    let extended = if causes.is_empty() {
        plain.clone()
    } else {
        let mut model = plain.clone();
        causes.iter().for_each(|c| super::selection::apply(&mut model, c, &c.coefficients));
        refit(model, causes.to_vec(), part, 3, true).model
    };
    let fault = FAULT * damping_sd(&extended, &of_train, &z_train);
    let (first, before_statistics) =
        figures(&plain, (&of_train, &z_train), (&of_test, &z_test), fault);
    let (second, after_statistics) =
        figures(&extended, (&of_train, &z_train), (&of_test, &z_test), fault);
    measured.auc_gain = second.detection_auc - first.detection_auc;
    measured.energies = energies(&before_statistics, &after_statistics, &first, &second);
    let by = match (by_channel, by_time) {
        (true, true) => "channel+time",
        (true, false) => "channel",
        _ => "time",
    };
    measured.gain = Gain {
        before: first,
        after: second,
        held_out: HeldOut { by: by.into(), signals: of_test.len() },
    };
    measured
}

/// Standard deviation of ln damping of one healthy signal about the population, noise included.
fn damping_sd(model: &Model, data: &Observations, beside: &Covariates) -> f64 {
    let judged = judge(model, data, beside);
    let typical = &judged[judged.len() / 2];
    typical.metric.try_inverse().map_or(0.1, |c| c[(0, 0)].max(0.0).sqrt())
}

fn energies(before: &[f64], after: &[f64], first: &GainFigures, second: &GainFigures) -> Energies {
    const BINS: usize = 40;
    let top = before.iter().chain(after).fold(0.0_f64, |m, v| m.max(*v));
    let top = top.min(4.0 * first.threshold.max(second.threshold)).max(1e-9);
    let edges: Vec<f64> = (0..=BINS).map(|k| top * k as f64 / BINS as f64).collect();
    let count = |values: &[f64]| {
        let mut bins = vec![0; BINS];
        for v in values {
            bins[((v / top * BINS as f64) as usize).min(BINS - 1)] += 1;
        }
        bins
    };
    Energies {
        before: count(before),
        after: count(after),
        edges,
        threshold_before: first.threshold,
        threshold_after: second.threshold,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn auc_counts_the_pairs_in_order() {
        assert_eq!(auc(&[1.0, 2.0], &[3.0, 4.0]), 1.0);
        assert_eq!(auc(&[3.0, 4.0], &[1.0, 2.0]), 0.0);
        assert_eq!(auc(&[1.0, 3.0], &[2.0, 4.0]), 0.75);
    }
}
