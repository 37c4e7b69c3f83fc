//! What the extension buys, on signals that nothing was fitted to.
//!
//! In: baseline and causes. Out: [`Measured`]. Both models are fitted to every other channel in three of
//! five blocks of time, and judged on the other channels in the two blocks between (with too few channels
//! by time alone). A held-out channel's own parameters are unknown: what is judged is the deviation from
//! the population, in its covariance.

use super::candidates::Applied;
use super::chance::interval;
use super::covariates::Covariates;
use super::finding::{Energies, FAULT, Gain, GainFigures, HeldOut, Misfit};
use super::matrices::{Matrix5, Vector5, floored, inverse, scaled};
use super::model::{Linear, Model, dot, free_products};
use super::observations::Observations;
use super::refit::{Setting, apply, refit};
use super::whiteness::{Lags, whiteness_p};
use inkling_core::model::free_decay::FREE;
use nalgebra::DMatrix;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Fewer channels than this are split by time alone.
pub const FEWEST_UNITS: usize = 6;
/// Signals of a part that a model can be fitted to.
pub const FEWEST: usize = 8;
/// So many channels' weight has the guess that the scatter's parts are independent: the fewest that an inverse Wishart
/// prior with a mean needs.
const SHRINKAGE: f64 = FREE as f64 + 1.0;
pub const RESAMPLINGS: usize = 200;
/// Blocks of time with equally many signals.
const BLOCKS: usize = 5;
/// Gauss-Newton from the population to a signal's own parameters: steps at most, and the squared step, in its
/// own errors, that is none.
const MOST_STEPS: usize = 6;
const AT_REST: f64 = 1e-3;
/// Signals whose misfit is tested for whiteness, at most.
const MOST_WHITENED: usize = 2048;

#[derive(Default)]
pub struct Measured {
    pub gain: Gain,
    pub misfit: Misfit,
    pub energies: Energies,
}

/// Where a signal's parameters are expected, in units of [`Model::scale`].
#[derive(Clone, Copy)]
pub struct Population {
    /// From the model's mean.
    shift: Vector5,
    spread: Matrix5,
}

/// The scatter between channels is known from as many channels as were heard. Its matrix is drawn towards
/// scatter of amplitude, phase and the rest alone (Ledoit and Wolf 2004, weight of [`SHRINKAGE`] channels),
/// and the mean's own error is added. `without`: as if that channel had not been heard.
fn population(model: &Model, without: Option<usize>) -> Population {
    let scale = model.scale();
    let (mut between, mut shift) = (scaled(&model.between, &scale), Vector5::zeros());
    let mut units = model.units.len() as f64;
    if let Some(unit) = without.filter(|_| units >= FEWEST_UNITS as f64) {
        let off = (model.units[unit] - model.mean).fixed_rows::<FREE>(0).component_div(&scale);
        let own = off * off.transpose() * (units / (units - 1.0));
        between = (between * (units - 1.0) - own) / (units - 2.0);
        shift = -off / (units - 1.0);
        units -= 1.0;
    }
    if units >= (FEWEST_UNITS - 1) as f64 {
        let mut turn = Matrix5::identity();
        let (a, b) = (model.mean[2], model.mean[3]);
        let size = a.hypot(b).max(f64::MIN_POSITIVE);
        (turn[(2, 2)], turn[(2, 3)]) = (a / size, b / size);
        (turn[(3, 2)], turn[(3, 3)]) = (-b / size, a / size);
        let own = turn * between * turn.transpose();
        let weight = SHRINKAGE / (units - 1.0 + SHRINKAGE);
        let alone = Matrix5::from_diagonal(&own.diagonal().map(|v| v.max(0.0)));
        let drawn = own * (1.0 - weight) + alone * weight;
        between = turn.transpose() * drawn * turn * (1.0 + 1.0 / units);
    }
    Population { shift, spread: floored(&(between + scaled(&model.within, &scale))) }
}

/// A signal's own parameters at their most probable values, beside where its channel may lie.
pub struct AtRest {
    pub linear: Linear,
    pub gram: Matrix5,
    pub product: Vector5,
    /// From the population's mean, in units of [`Model::scale`].
    pub about: Vector5,
    /// Square of the misfit about the population's mean.
    square: f64,
}

/// A model, and where it expects each channel's parameters before these signals were heard.
pub struct Predictor<'a> {
    data: &'a Observations,
    beside: &'a Covariates,
    mean: Model,
    of_unit: Vec<Population>,
    scale: Vector5,
}

impl Predictor<'_> {
    pub fn of<'a>(
        model: &Model,
        data: &'a Observations,
        beside: &'a Covariates,
        of_unit: Vec<Population>,
    ) -> Predictor<'a> {
        // about the mean, not about the channels' own parameters
        let mut mean = model.clone();
        mean.units = vec![model.mean; data.units];
        mean.each = vec![Default::default(); data.len()];
        Predictor { data, beside, of_unit, scale: model.scale(), mean }
    }

    pub fn spread(&self, i: usize) -> Matrix5 {
        self.of_unit[self.data.rows[i].unit].spread
    }

    /// Channels differ by per cents: linear about the population is not enough.
    pub fn at_rest(&mut self, i: usize) -> AtRest {
        let Population { shift, spread } = self.of_unit[self.data.rows[i].unit];
        let precision = spread.try_inverse().unwrap_or_else(Matrix5::zeros);
        let v = self.mean.noise_var;
        let (mut linear, mut square) = (Linear::default(), f64::NAN);
        let mut step = 0;
        loop {
            self.mean.linearise(i, self.data, self.beside, &mut linear);
            let (gram, product) = free_products(&linear, &self.scale);
            let own = self.mean.each[i].fixed_rows::<FREE>(0).component_div(&self.scale);
            let about = own - shift;
            if step == 0 {
                square = dot(&linear.residual, &linear.residual);
            }
            let hessian = gram / v + precision;
            let by = hessian.try_inverse().map(|m| m * (product / v - precision * about));
            let on = by.filter(|by| step < MOST_STEPS && by.dot(&(hessian * by)) >= AT_REST);
            let Some(by) = on else {
                self.mean.each[i] = Default::default();
                return AtRest { linear, gram, product, about, square };
            };
            for j in 0..FREE {
                let most = [0.3, 0.05].get(j).copied().unwrap_or(f64::INFINITY);
                self.mean.each[i][j] += (by[j] * self.scale[j]).clamp(-most, most);
            }
            step += 1;
        }
    }
}

impl Population {
    /// Of channels that a model was not fitted to.
    pub fn unheard(model: &Model) -> Population {
        population(model, None)
    }

    /// Of a channel that it was fitted to, by so many signals.
    pub fn heard(model: &Model, unit: usize, signals: f64) -> Population {
        let scale = model.scale();
        let shift = (model.units[unit] - model.mean).fixed_rows::<FREE>(0).component_div(&scale);
        let within = floored(&scaled(&model.within, &scale));
        let of_within = within.try_inverse().unwrap_or_else(Matrix5::zeros) * signals;
        let of_between = inverse(&scaled(&model.between, &scale));
        let unknown = (of_within + of_between).try_inverse().unwrap_or_else(Matrix5::zeros);
        Population { shift, spread: floored(&(within + unknown)) }
    }
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
    /// Misfit beside all that the signal's own parameters explain, where it is looked at.
    white: Option<Lags>,
}

/// `known`: the signals are those that the model was fitted to, each judged as if its channel was not.
fn judge(model: &Model, data: &Observations, beside: &Covariates, known: bool) -> Vec<Judged> {
    let of_unit: Vec<Population> = match known {
        true => (0..model.units.len()).map(|unit| population(model, Some(unit))).collect(),
        false => vec![population(model, None); data.units],
    };
    let mut predictor = Predictor::of(model, data, beside, of_unit);
    let (scale, v) = (model.scale(), model.noise_var);
    let every = data.len().div_ceil(MOST_WHITENED).max(1);
    let n = data.samples;
    (0..data.len())
        .map(|i| {
            let AtRest { linear, gram, product, about, square } = predictor.at_rest(i);
            let spread = predictor.spread(i);
            let precision = spread.try_inverse().unwrap_or_else(Matrix5::zeros);
            let (columns, r) = (&linear.tangent.columns, &linear.residual);
            // r0^T (v + J S J^T)^-1 r0, r0 about the mean, is the least of |r|^2/v + about^T S^-1 about
            let chi2 = dot(r, r) / v + about.dot(&(precision * about));
            let ridge = Matrix5::identity() * (1e-9 * gram.trace());
            let inverse = (gram + ridge).try_inverse().unwrap_or_else(Matrix5::zeros);
            let off = about + inverse * product;
            let metric = (inverse * v + spread).try_inverse().unwrap_or_else(Matrix5::zeros);
            let white = i.is_multiple_of(every).then(|| {
                let j = DMatrix::from_fn(n, FREE, |k, a| columns[a][k] * scale[a]);
                Lags::of(r.clone(), &j.qr().q())
            });
            let y = data.signal(i);
            let centre = y.iter().map(|y| f64::from(*y)).sum::<f64>() / n as f64;
            let size = y.iter().map(|y| (f64::from(*y) - centre).powi(2)).sum();
            Judged { unit: data.rows[i].unit, chi2, square, size, off, metric, white }
        })
        .collect()
}

/// Of every signal with so much more damping.
fn statistics(judged: &[Judged], fault: f64) -> Vec<f64> {
    let d = |j: &Judged| {
        let mut off = j.off;
        off[0] += fault;
        off.dot(&(j.metric * off))
    };
    judged.iter().map(d).collect()
}

/// Of every signal with the fault in either direction, one after the other: what shifts all signals one
/// way must not count as a fault found.
fn faulty_statistics(judged: &[Judged], fault: f64) -> Vec<f64> {
    let (more, less) = (statistics(judged, fault), statistics(judged, -fault));
    more.into_iter().zip(less).flat_map(|(more, less)| [more, less]).collect()
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

/// Above this level one of 100 healthy signals of channels never heard before is expected: the statistic of signals whose channels were left out is a multiple of F, because the scatter
/// is known from few channels.
fn threshold(of_left_out: &[f64], units: usize) -> f64 {
    let q = FREE as f64;
    // of the predictive t under the inverse Wishart prior whose mean weighs SHRINKAGE channels
    let known = units as f64 + SHRINKAGE + 1.0;
    let mean = of_left_out.iter().sum::<f64>() / of_left_out.len().max(1) as f64;
    mean * (known - 2.0) / known * quantile_of_f(q, known)
}

/// The value that F with (p, q) degrees exceeds in a share [`ALARMS`] of all, by Paulson 1942.
fn quantile_of_f(p: f64, q: f64) -> f64 {
    const NORMAL: f64 = 2.3263; // of 1 - ALARMS
    let (a, b) = (2.0 / (9.0 * p), 2.0 / (9.0 * q));
    // ((1 - b) x - (1 - a))^2 = NORMAL^2 (b x^2 + a), x = cube root
    let z2 = NORMAL * NORMAL;
    let (s, half, t) =
        ((1.0 - b).powi(2) - z2 * b, (1.0 - a) * (1.0 - b), (1.0 - a).powi(2) - z2 * a);
    ((half + (half * half - s * t).max(0.0).sqrt()) / s).powi(3)
}

fn whiteness(judged: &[Judged]) -> f64 {
    whiteness_p(judged.iter().filter_map(|j| j.white.as_ref()))
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

/// Signals, and what was recorded beside them.
pub struct Share {
    pub data: Observations,
    pub beside: Covariates,
}

/// What a model does on signals that it was not fitted to.
struct HeldOutFigures {
    figures: GainFigures,
    /// Detection statistic of every healthy signal.
    healthy: Vec<f64>,
    /// Detection AUC of every drawing of channels.
    aucs: Vec<f64>,
}

fn figures(model: &Model, train: &Share, test: &Share, fault: f64) -> HeldOutFigures {
    let of_training = statistics(&judge(model, &train.data, &train.beside, true), 0.0);
    let threshold = threshold(&of_training, train.data.units);
    let judged = judge(model, &test.data, &test.beside, false);
    let healthy = statistics(&judged, 0.0);
    let faulty = faulty_statistics(&judged, fault);
    let all = sums(judged.iter(), test.data.samples);
    let alarms = |chosen: &[usize]| {
        chosen.iter().filter(|&&i| healthy[i] > threshold).count() as f64
            / chosen.len().max(1) as f64
    };
    // resampling channels
    let mut by_unit = vec![Vec::new(); test.data.units];
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
        let s = sums(chosen.iter().map(|&i| &judged[i]), test.data.samples);
        let both = |i: &usize| [faulty[2 * i], faulty[2 * i + 1]];
        resampled[0].push(s.chi2);
        resampled[1].push(s.nrmse);
        resampled[2].push(alarms(&chosen));
        resampled[3].push(auc(
            &chosen.iter().map(|&i| healthy[i]).collect::<Vec<f64>>(),
            &chosen.iter().flat_map(both).collect::<Vec<f64>>(),
        ));
    }
    let aucs = resampled[3].clone();
    let everyone: Vec<usize> = (0..judged.len()).collect();
    let figures = GainFigures {
        chi2_per_dof: all.chi2,
        chi2_per_dof_interval: interval(&mut resampled[0]),
        nrmse_percent: all.nrmse,
        nrmse_percent_interval: interval(&mut resampled[1]),
        whiteness_p: whiteness(&judged),
        threshold,
        false_alarms: alarms(&everyone),
        // none among so few is not none among all: the 95 % bound of that
        false_alarms_interval: interval(&mut resampled[2])
            .map(|[low, high]| [low, high.max(1.0 - 0.05_f64.powf(1.0 / healthy.len() as f64))]),
        detection_auc: auc(&healthy, &faulty),
        detection_auc_interval: interval(&mut resampled[3]),
    };
    HeldOutFigures { figures, healthy, aucs }
}

/// Which signals lie in the second and the fourth block of time: what drifts is judged between the times that it was
/// learned at.
pub fn between(data: &Observations) -> Vec<bool> {
    let mut times: Vec<i64> = data.rows.iter().map(|r| r.beside.t_acq_ns).collect();
    times.sort_unstable();
    let bounds: Vec<i64> = (1..BLOCKS).map(|block| times[times.len() * block / BLOCKS]).collect();
    let block = |t: i64| bounds.partition_point(|bound| *bound <= t);
    data.rows.iter().map(|row| block(row.beside.t_acq_ns) % 2 == 1).collect()
}

/// `before`: the baseline on all signals. `causes`: as they were found.
pub fn measure(before: &Model, causes: &[Applied], setting: Setting) -> Measured {
    let (data, beside) = (setting.data, setting.beside);
    let all = judge(before, data, beside, true);
    let s = sums(all.iter(), data.samples);
    let misfit =
        Misfit { chi2_per_dof: s.chi2, nrmse_percent: s.nrmse, whiteness_p: whiteness(&all) };
    let mut measured = Measured { misfit, ..Measured::default() };

    let by_channel = data.units >= FEWEST_UNITS;
    let between = between(data);
    let odd = |i: usize| data.rows[i].unit % 2 == 1;
    // where every channel was heard once, time says nothing beyond the channel
    let by_time = data.len() > data.units;
    let train = |i: usize| (!by_channel || !odd(i)) && (!by_time || !between[i]);
    let test = |i: usize| (!by_channel || odd(i)) && (!by_time || between[i]);
    let train = Share { data: data.select(train), beside: beside.select(train) };
    let test = Share { data: data.select(test), beside: beside.select(test) };
    if train.data.len() < FEWEST || test.data.len() < FEWEST {
        return measured;
    }
    let part = Setting { data: &train.data, beside: &train.beside, avoid: setting.avoid };
    let Some((plain, extended)) = fitted(before, causes, part) else { return measured };
    let fault = FAULT * damping_sd(&extended, &train);
    let first = figures(&plain, &train, &test, fault);
    let second = figures(&extended, &train, &test, fault);
    // the same channels were drawn for both
    let mut gains: Vec<f64> = second.aucs.iter().zip(&first.aucs).map(|(a, b)| a - b).collect();
    measured.energies = energies(&first, &second);
    let by = match (by_channel, by_time) {
        (true, true) => "channel+time",
        (true, false) => "channel",
        _ => "time",
    };
    measured.gain = Gain {
        detection_gain: second.figures.detection_auc - first.figures.detection_auc,
        before: first.figures,
        after: second.figures,
        log_likelihood_per_signal: None,
        detection_gain_interval: if causes.is_empty() { None } else { interval(&mut gains) },
        held_out: HeldOut {
            by: by.into(),
            signals: test.data.len(),
            channels: test.data.units,
            fitted_signals: train.data.len(),
            fitted_channels: train.data.units,
        },
    };
    measured
}

/// Baseline and model with the causes, fitted to a part of the signals. `None`: nothing rings there.
fn fitted(before: &Model, causes: &[Applied], part: Setting) -> Option<(Model, Model)> {
    let plain = baseline(before.real, Some(before), part)?;
    let extended = with(&plain, causes, part);
    Some((plain, extended))
}

/// The baseline alone. `codes`: whose clipping and coarse step it knows.
pub fn baseline(real: bool, codes: Option<&Model>, part: Setting) -> Option<Model> {
    let mut start = Model::start(part.data, part.beside, real).ok()?;
    if let Some(codes) = codes {
        (start.ceiling, start.lattice) = (codes.ceiling, codes.lattice);
    }
    start.fit(part.data, part.beside, 2);
    Some(refit(start, Vec::new(), part, 2, true).model)
}

/// The baseline with causes, fitted again.
pub fn with(plain: &Model, causes: &[Applied], part: Setting) -> Model {
    let mut model = plain.clone();
    if causes.is_empty() {
        return model;
    }
    causes.iter().for_each(|c| apply(&mut model, c, &c.coefficients, part));
    refit(model, causes.to_vec(), part, 3, true).model
}

/// Standard deviation of ln damping of one healthy signal about the population, noise included.
fn damping_sd(model: &Model, train: &Share) -> f64 {
    let judged = judge(model, &train.data, &train.beside, true);
    let typical = &judged[judged.len() / 2];
    typical.metric.try_inverse().map_or(0.1, |c| c[(0, 0)].max(0.0).sqrt())
}

fn energies(before: &HeldOutFigures, after: &HeldOutFigures) -> Energies {
    const BINS: usize = 40;
    let thresholds = [before, after].map(|of| of.figures.threshold);
    let all = before.healthy.iter().chain(&after.healthy);
    let top = all.fold(0.0_f64, |m, v| m.max(*v));
    let top = top.min(4.0 * thresholds[0].max(thresholds[1])).max(1e-9);
    let edges: Vec<f64> = (0..=BINS).map(|k| top * k as f64 / BINS as f64).collect();
    let count = |values: &[f64]| {
        let mut bins = vec![0; BINS];
        for v in values {
            bins[((v / top * BINS as f64) as usize).min(BINS - 1)] += 1;
        }
        bins
    };
    Energies {
        before: count(&before.healthy),
        after: count(&after.healthy),
        edges,
        threshold_before: thresholds[0],
        threshold_after: thresholds[1],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_quantile_of_f_is_that_of_the_tables() {
        // F of (5, 10), (5, 20), (5, 100) at 1 %, and chi-squared of 5 over 5
        for (q, table) in [(10.0, 5.636), (20.0, 4.103), (100.0, 3.206), (1e9, 3.017)] {
            let found = quantile_of_f(5.0, q);
            assert!((found / table - 1.0).abs() < 0.01, "{q}: {found}, {table}");
        }
    }

    /// Signals of a right model: chances are even, and few channels do not raise the alarm.
    #[test]
    fn on_healthy_signals_the_misfit_is_white_and_alarms_are_few() {
        use super::super::generator::{Run, draw};
        const SEEDS: u64 = 72;
        let (mut least, mut alarms, mut signals) = (0, 0.0, 0.0);
        let mut p: Vec<f64> = (0..SEEDS)
            .map(|seed| {
                let spread = [[0.004, 0.06, 0.025], [0.02, 0.06, 0.025]][seed as usize % 2];
                let data =
                    draw(&Run { channels: 12, bursts: 8, spread, ..Run::default() }, 700 + seed);
                let beside = Covariates::of(&data);
                let mut model = Model::start(&data, &beside, true).unwrap();
                model.fit(&data, &beside, 2);
                let setting = Setting { data: &data, beside: &beside, avoid: &[] };
                let measured = measure(&model, &[], setting);
                let gain = measured.gain;
                assert_eq!((gain.held_out.channels, gain.held_out.fitted_channels), (6, 6));
                assert_eq!(gain.before.chi2_per_dof, gain.after.chi2_per_dof);
                alarms += gain.before.false_alarms * gain.held_out.signals as f64;
                signals += gain.held_out.signals as f64;
                least += usize::from(gain.before.whiteness_p < 1e-3);
                measured.misfit.whiteness_p
            })
            .collect();
        p.sort_by(f64::total_cmp);
        // Kolmogorov and Smirnov, 99 %
        for (k, p) in p.iter().enumerate() {
            let share = (k as f64 + 0.5) / SEEDS as f64;
            assert!((p - share).abs() < 1.63 / (SEEDS as f64).sqrt(), "{share}: {p}");
        }
        println!("{least} of {SEEDS}, {alarms} of {signals}");
        assert!(least <= 3, "{least} of {SEEDS} held-out sets");
        assert!(alarms / signals < 0.03, "{alarms} of {signals}");
    }

    #[test]
    fn auc_counts_the_pairs_in_order() {
        assert_eq!(auc(&[1.0, 2.0], &[3.0, 4.0]), 1.0);
        assert_eq!(auc(&[3.0, 4.0], &[1.0, 2.0]), 0.0);
        assert_eq!(auc(&[1.0, 3.0], &[2.0, 4.0]), 0.75);
    }
}
