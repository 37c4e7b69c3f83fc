//! What the extension buys on signals that nothing was fitted to: misfit, whiteness, false alarms, and the
//! detection of a small fault, before and after.
//!
//! In: the baseline, and the causes that extend it. Out: [`Misfit`] and [`Gain`]. The steps:
//!
//! 1. split the signals: both models are fitted to every other channel in three of five blocks of time, and
//!    judged on the other channels in the two blocks between (with too few channels, the split is by time
//!    alone; where every channel was heard once, by channel alone);
//! 2. judge each held-out signal by its deviation from the population (`held_out.rs`): chi-squared of its
//!    samples, and the squared Mahalanobis distance of its fitted parameters, the detection statistic;
//! 3. learn the threshold of that statistic from the training signals;
//! 4. plant a small fault, a change of ln damping, in each held-out signal, and compute the area under the
//!    ROC curve (AUC) between faulty and healthy ones;
//! 5. resample channels for all intervals.
//!
//! Nothing is estimated from held-out signals. But which causes there are, clipping, the coarse step, and how
//! noise was made white had been chosen with all signals before.

use super::candidates::{Applied, Setting};
use super::chance::{interval, interval_of, resampled};
use super::finding::{FAULT, Gain, GainFigures, HeldOut, Misfit, Worth};
use super::held_out::{
    FEWEST_UNITS, Population, SHRINKAGE, Signal, TrainTestSplit, baseline, by_channel, population,
    signals, with,
};
use super::matrices::{Matrix5, Vector5, inverse_or_zero};
use super::model::Model;
use super::observations::Observations;
use super::whiteness::{Lags, whiteness_p};
use inkling_core::model::free_decay::FREE;
use std::iter::Sum;

/// Seed of the drawings: the same for all figures, so that these can be compared.
const DRAWINGS: u64 = 1;

/// Sums over the samples of signals, or of parts of an oscillator's decays (`decay/gain.rs`).
#[derive(Clone, Copy, Default)]
pub struct Squares {
    /// Chi-squared: the square of the misfit in the covariance that the model expects, which holds the noise
    /// and, for a signal, the scatter of its parameters. No parameter is free, so there are as many degrees
    /// of freedom as samples.
    pub chi2: f64,
    /// Sum of squares of the misfit, counts²; for a signal, about the model's mean.
    pub misfit: f64,
    /// Sum of squares of the signal about its mean, counts².
    pub signal: f64,
    pub samples: f64,
}

impl Squares {
    fn chi2_and_nrmse(self) -> [f64; 2] {
        let share = self.misfit / self.signal.max(1e-300);
        [self.chi2 / self.samples.max(1.0), 100.0 * share.sqrt()]
    }

    pub fn misfit(self, whiteness_p: f64) -> Misfit {
        let [chi2_per_dof, nrmse_percent] = self.chi2_and_nrmse();
        Misfit { chi2_per_dof, nrmse_percent, whiteness_p }
    }

    /// What is held out. `groups`: which of `each` are drawn together in resampling. What concerns detection is
    /// not measured.
    pub fn figures(each: &[Squares], groups: &[Vec<usize>], whiteness_p: f64) -> GainFigures {
        let of_some =
            |chosen: &[usize]| chosen.iter().map(|i| each[*i]).sum::<Squares>().chi2_and_nrmse();
        let ([chi2_per_dof, nrmse_percent], drawn) = resampled(groups, DRAWINGS, of_some);
        GainFigures {
            chi2_per_dof,
            chi2_per_dof_interval: interval_of(&drawn, 0),
            nrmse_percent,
            nrmse_percent_interval: interval_of(&drawn, 1),
            whiteness_p,
            threshold: f64::NAN,
            false_alarms: f64::NAN,
            detection_auc: f64::NAN,
            ..GainFigures::default()
        }
    }
}

impl Worth {
    /// `groups`: which of the gains are drawn together in resampling.
    pub fn of(gains: &[f64], groups: &[Vec<usize>]) -> Worth {
        let mean = |chosen: &[usize]| {
            chosen.iter().map(|i| gains[*i]).sum::<f64>() / chosen.len().max(1) as f64
        };
        let (gain, mut drawn) = resampled(groups, DRAWINGS + 1, mean);
        Worth { gain, ci95: interval(&mut drawn).unwrap_or([f64::NAN; 2]) }
    }
}

impl Sum for Squares {
    fn sum<I: Iterator<Item = Squares>>(all: I) -> Squares {
        all.fold(Squares::default(), |sum, one| Squares {
            chi2: sum.chi2 + one.chi2,
            misfit: sum.misfit + one.misfit,
            signal: sum.signal + one.signal,
            samples: sum.samples + one.samples,
        })
    }
}

struct Judged {
    unit: usize,
    squares: Squares,
    /// The signal's own free parameters by least squares, relative to the population's mean, in units of
    /// [`Model::scale`].
    off: Vector5,
    /// Inverse of the covariance of `off`: the population's scatter and the error of the estimate.
    metric: Matrix5,
    /// Autocorrelations of what the signal's own parameters leave, where asked for.
    white: Option<Lags>,
}

impl Judged {
    /// Detection statistic off^T metric off, as if ln damping were larger by `fault`.
    fn statistic(&self, fault: f64) -> f64 {
        let mut off = self.off;
        off[0] += fault;
        off.dot(&(self.metric * off))
    }
}

/// `known`: the model was fitted to these very signals; each signal's channel is then left out of its
/// population. `lags`: whether misfits are to be tested for whiteness.
fn judge(model: &Model, data: &Observations, known: bool, lags: bool) -> Vec<Judged> {
    let of_unit: Vec<Population> = match known {
        true => (0..model.units.len()).map(|unit| population(model, Some(unit))).collect(),
        false => vec![population(model, None); data.units],
    };
    let each = |(i, signal): (usize, Signal)| {
        let Signal { residual, tangent, about, spread, noise_var, .. } = &signal;
        // Chi-squared is r0^T (v + J S J^T)^-1 r0, with the residual r0 about the population's mean and
        // the population's covariance S. To first order this is the minimum of |r|²/v + about^T S^-1 about
        // over the parameters, reached at the most probable ones.
        let of_parameters = about.dot(&(inverse_or_zero(*spread) * about));
        let chi2 = residual.norm_squared() / noise_var + of_parameters;
        let gram: Matrix5 = (tangent.tr_mul(tangent)).fixed_view::<FREE, FREE>(0, 0).into_owned();
        let product = tangent.tr_mul(residual).fixed_rows::<FREE>(0).into_owned();
        let ridge = Matrix5::identity() * (1e-9 * gram.trace());
        let inverse = inverse_or_zero(gram + ridge);
        let white = lags.then(|| Lags::of(residual.as_slice().to_vec(), &tangent.clone().qr().q()));
        let (signal_square, samples) = (data.movement(i), data.samples as f64);
        Judged {
            unit: signal.unit,
            squares: Squares { chi2, misfit: signal.square, signal: signal_square, samples },
            // least squares: one Gauss-Newton step, without the prior, from the most probable parameters
            off: about + inverse * product,
            metric: inverse_or_zero(inverse * *noise_var + spread),
            white,
        }
    };
    signals(model, data, of_unit).into_iter().enumerate().map(each).collect()
}

/// Area under the ROC curve: the share of pairs in which the faulty signal has the larger statistic.
fn auc(healthy: &[f64], faulty: &[f64]) -> f64 {
    let mut sorted = healthy.to_vec();
    sorted.sort_by(f64::total_cmp);
    let below = |faulty: &f64| sorted.partition_point(|healthy| healthy <= faulty);
    let pairs = (healthy.len() * faulty.len()).max(1);
    faulty.iter().map(below).sum::<usize>() as f64 / pairs as f64
}

/// The detection threshold, which 1 % of healthy signals of channels never heard before is
/// expected to exceed. Because the scatter is known from few channels, the statistic is a multiple of F, and
/// not a chi-squared. Its size comes from `of_left_out`, the statistics of training signals whose channel was
/// left out. `units`: number of channels that the scatter is known from.
fn threshold(of_left_out: &[f64], units: usize) -> f64 {
    let q = FREE as f64;
    // degrees of freedom of the predictive t, under the inverse Wishart prior of weight SHRINKAGE
    let known = units as f64 + SHRINKAGE + 1.0;
    let mean = of_left_out.iter().sum::<f64>() / of_left_out.len().max(1) as f64;
    mean * (known - 2.0) / known * quantile_of_f(q, known)
}

/// The value that F with (p, q) degrees of freedom exceeds in 1 % of all cases (Paulson 1942): ((1 - b) x - (1 - a)) / sqrt(b x² + a) is nearly standard normal, with x the cube root of
/// F, a = 2/(9 p) and b = 2/(9 q).
fn quantile_of_f(p: f64, q: f64) -> f64 {
    const NORMAL: f64 = 2.3263; // exceeded in 1 %
    let (a, b) = (2.0 / (9.0 * p), 2.0 / (9.0 * q));
    let z2 = NORMAL * NORMAL;
    let (s, half, t) =
        ((1.0 - b).powi(2) - z2 * b, (1.0 - a) * (1.0 - b), (1.0 - a).powi(2) - z2 * a);
    ((half + (half * half - s * t).max(0.0).sqrt()) / s).powi(3)
}

fn whiteness(judged: &[Judged]) -> f64 {
    whiteness_p(judged.iter().filter_map(|j| j.white.as_ref()))
}

/// Also the areas of all drawings of channels. `known`: the signals that the model was fitted to, judged with their
/// channels left out.
fn figures(
    model: &Model,
    known: &[Judged],
    test: &Observations,
    fault: f64,
) -> (GainFigures, Vec<f64>) {
    let of = |judged: &[Judged]| judged.iter().map(|j| j.statistic(0.0)).collect::<Vec<f64>>();
    let threshold = threshold(&of(known), model.units.len());
    let judged = judge(model, test, false, true);
    let healthy = of(&judged);
    // The planted fault goes in either direction: a model whose error shifts all signals one way must not
    // gain by it.
    let faulty: Vec<[f64; 2]> =
        judged.iter().map(|j| [fault, -fault].map(|fault| j.statistic(fault))).collect();
    let of_some = |chosen: &[usize]| -> [f64; 2] {
        let alarms = chosen.iter().filter(|&&i| healthy[i] > threshold).count() as f64;
        let auc = auc(
            &chosen.iter().map(|&i| healthy[i]).collect::<Vec<f64>>(),
            &chosen.iter().flat_map(|&i| faulty[i]).collect::<Vec<f64>>(),
        );
        [alarms / chosen.len().max(1) as f64, auc]
    };
    let groups = by_channel(judged.iter().map(|j| j.unit));
    let ([false_alarms, detection_auc], drawn) = resampled(&groups, DRAWINGS, of_some);
    // Resampling gives no alarm at all an interval of length zero. So the upper end is at least the 95 %
    // upper bound of the rate where none was seen in so many independent signals.
    let none = 1.0 - 0.05_f64.powf(1.0 / healthy.len() as f64);
    let squares: Vec<Squares> = judged.iter().map(|j| j.squares).collect();
    let figures = GainFigures {
        threshold,
        false_alarms,
        false_alarms_interval: interval_of(&drawn, 0).map(|[low, high]| [low, high.max(none)]),
        detection_auc,
        detection_auc_interval: interval_of(&drawn, 1),
        ..Squares::figures(&squares, &groups, whiteness(&judged))
    };
    let aucs = drawn.iter().map(|of| of[1]).collect();
    (figures, aucs)
}

/// `before`: the baseline, fitted to all signals. `causes`: as found in all signals; they are fitted again to
/// the training part. With too few signals only the misfit of `before` is measured, and the gain is empty.
pub fn measure(before: &Model, causes: &[Applied], setting: Setting) -> (Misfit, Gain) {
    let data = setting.data;
    let all = judge(before, data, true, true);
    let squares: Squares = all.iter().map(|judged| judged.squares).sum();
    let misfit = squares.misfit(whiteness(&all));
    let unknown = (misfit, Gain::default());

    let by_channel = data.units >= FEWEST_UNITS;
    // where every channel was heard once, a split by time would add nothing
    let by_time = data.len() > data.units;
    let split = TrainTestSplit::of(data, by_channel, by_time);
    let Some(TrainTestSplit { train, test, .. }) = split else { return unknown };
    let part = Setting { data: &train, avoid: setting.avoid };
    let Some(plain) = baseline(Some(before), part) else { return unknown };
    let extended = with(&plain, causes, part);

    // judge both by the same fault, so that their AUCs can be compared
    let [known, known_extended] =
        [&plain, &extended].map(|model| judge(model, &train, true, false));
    let fault = FAULT * damping_sd(&known_extended);
    let (before, first) = figures(&plain, &known, &test, fault);
    let (after, second) = figures(&extended, &known_extended, &test, fault);
    // both models drew the same channels, since the seed is the same
    let mut gains: Vec<f64> = second.iter().zip(&first).map(|(a, b)| a - b).collect();
    let by = match (by_channel, by_time) {
        (true, true) => "channel+time",
        (true, false) => "channel",
        _ => "time",
    };
    let gain = Gain {
        detection_gain: after.detection_auc - before.detection_auc,
        before,
        after,
        log_likelihood_per_signal: None, // `worth.rs` measures it
        detection_gain_interval: if causes.is_empty() { None } else { interval(&mut gains) },
        held_out: HeldOut {
            by: by.into(),
            signals: test.len(),
            channels: test.units,
            fitted_signals: train.len(),
            fitted_channels: train.units,
        },
    };
    (misfit, gain)
}

/// The signal in the middle of the rows stands for all.
fn damping_sd(judged: &[Judged]) -> f64 {
    let typical = &judged[judged.len() / 2];
    typical.metric.try_inverse().map_or(0.1, |c| c[(0, 0)].max(0.0).sqrt())
}

#[cfg(test)]
mod tests {
    use super::super::generator::{Run, assert_uniform, draw};
    use super::*;

    #[test]
    fn the_quantile_of_f_is_that_of_the_tables() {
        // quantiles of F with (5, 10), (5, 20), (5, 100) degrees of freedom at 1 %, and of chi-squared with 5
        // over 5
        for (q, table) in [(10.0, 5.636), (20.0, 4.103), (100.0, 3.206), (1e9, 3.017)] {
            let found = quantile_of_f(5.0, q);
            assert!((found / table - 1.0).abs() < 0.01, "{q}: {found}, {table}");
        }
    }

    /// On signals of a right model, p-values are uniform, and few channels do not raise the false-alarm rate.
    #[test]
    fn on_healthy_signals_the_misfit_is_white_and_alarms_are_few() {
        const SEEDS: u64 = 72;
        let (mut least, mut alarms, mut signals) = (0, 0.0, 0.0);
        let p: Vec<f64> = (0..SEEDS)
            .map(|seed| {
                let spread = [[0.004, 0.06, 0.025], [0.02, 0.06, 0.025]][seed as usize % 2];
                let data =
                    draw(&Run { channels: 12, bursts: 8, spread, ..Run::default() }, 700 + seed);
                let model = Model::fitted(&data, 2).unwrap();
                let setting = Setting { data: &data, avoid: &[] };
                let (misfit, gain) = measure(&model, &[], setting);
                assert_eq!((gain.held_out.channels, gain.held_out.fitted_channels), (6, 6));
                assert_eq!(gain.before.chi2_per_dof, gain.after.chi2_per_dof);
                alarms += gain.before.false_alarms * gain.held_out.signals as f64;
                signals += gain.held_out.signals as f64;
                least += usize::from(gain.before.whiteness_p < 1e-3);
                misfit.whiteness_p
            })
            .collect();
        assert_uniform(p);
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
