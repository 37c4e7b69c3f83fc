//! Measures what the extension, and each of its causes, buys on stretches of the decays that nothing was fitted
//! to, tests what is left for whiteness, and computes the report's figures.
//!
//! In, from `decay/mod.rs`: [`Selected`], the baseline (plain oscillation) and the extended model.
//! Out: [`Misfit`], [`Gain`] and [`Figures`], as of an ink channel.
//!
//! 1. Every third of some twenty stretches is held out, so that both parts hold large and small amplitudes: its
//!    samples count for nothing in the noise, so that a fit does not see them ([`Stretches`]).
//! 2. The plain oscillation, the model with all that was found, and the same model without one cause at a time are
//!    fitted to the others, and judged on the held-out ones.
//! 3. What a cause is worth is the gain in ln p of the held-out samples, each given those before it, where the noise
//!    of a model is the autoregression of what it leaves in the stretches that it was fitted to.
//! 4. Intervals draw held-out stretches anew (bootstrap). Detection of faults is not measured: a single oscillator
//!    has no fault classes.

use super::decays::Decays;
use super::noise::{Noise, sizes};
use super::plant::{AtRest, Fit};
use super::selection::Selected;
use crate::critique::catalogue::CauseId;
use crate::critique::figures::band_of_means;
use crate::critique::finding::{
    Compared, Curve, Figures, Gain, GainFigures, HeldOut, LogLikelihood, Misfit, Worth,
};
use crate::critique::gain::Squares;
use crate::critique::whiteness::{Lags, whiteness_p};
use inkling_core::model::spectrum;
use nalgebra::DMatrix;
use std::collections::BTreeMap;
use std::ops::Range;

/// Unit of the figures: the recording does not name its own.
const UNIT: &str = "units of the recording";
/// A series is cut into so many stretches, and one of so many is held out.
const STRETCHES: usize = 20;
const EVERY: usize = 3;

struct Stretches {
    length: usize,
    /// The ranges of samples that models are fitted to, and those between them.
    fitted: Vec<Range<usize>>,
    held_out: Vec<Range<usize>>,
}

impl Stretches {
    fn of(samples: usize) -> Stretches {
        let length = samples.div_ceil(STRETCHES).max(2);
        // from and to are counted in stretches
        let ranges = |from: usize, to: usize| -> Vec<Range<usize>> {
            let all = (0..samples).step_by(EVERY * length);
            let part = |at| samples.min(at + from * length)..samples.min(at + to * length);
            all.map(part).filter(|range| !range.is_empty()).collect()
        };
        Stretches { length, fitted: ranges(0, EVERY - 1), held_out: ranges(EVERY - 1, EVERY) }
    }

    /// ln p of each held-out stretch of each series.
    fn ln_held_out(&self, model: &Fit) -> Vec<f64> {
        let decays = model.decays;
        let colours = model.noise_within(&self.fitted).colours;
        let of_series = |(i, series): (usize, &[f64])| -> Vec<f64> {
            let ln = colours[i % decays.outputs].ln_densities(series);
            self.held_out.iter().map(|range| ln[range.clone()].iter().sum()).collect()
        };
        model.misfit().chunks(decays.samples).enumerate().flat_map(of_series).collect()
    }

    /// ln p of one model less another's, per series, nats.
    fn worth(&self, own: &[f64], others: &[f64]) -> Worth {
        let of_series = self.held_out.len() as f64;
        let gains: Vec<f64> = own.iter().zip(others).map(|(p, q)| of_series * (p - q)).collect();
        Worth::of(&gains, &alone(gains.len()))
    }
}

/// Each for itself: what groups are drawn as, where nothing belongs together.
fn alone(count: usize) -> Vec<Vec<usize>> {
    (0..count).map(|i| vec![i]).collect()
}

/// p-value of the misfit being white within these ranges of each series; one that is shorter than the first is not
/// looked at. What a fit itself correlates is not allowed for; decays are long.
pub fn whiteness(misfit: &[f64], decays: &Decays, ranges: &[Range<usize>]) -> f64 {
    let lags = |y: &[f64]| Lags::of(y.to_vec(), &DMatrix::zeros(y.len(), 0));
    let whole = ranges.iter().filter(|range| range.len() >= ranges[0].len());
    let of = |series: &[f64]| whole.clone().map(|range| lags(&series[range.clone()])).collect();
    let all: Vec<Vec<Lags>> = misfit.chunks(decays.samples).map(of).collect();
    whiteness_p(all.iter().flatten())
}

/// Sums of squares over the samples of each range, of one series after the other. `sds`: standard deviation of each
/// output's noise, in the scale of the decays.
fn squares(decays: &Decays, misfit: &[f64], sds: &[f64], ranges: &[Range<usize>]) -> Vec<Squares> {
    let of_range = |range: &Range<usize>| -> Vec<Squares> {
        let all = misfit.chunks(decays.samples).zip(decays.y.chunks(decays.samples));
        let of_series = |(series, (misfit, signal)): (usize, (&[f64], &[f64]))| {
            let mean = signal.iter().sum::<f64>() / signal.len() as f64;
            let misfit: f64 = misfit[range.clone()].iter().map(|r| r * r).sum();
            let signal = signal[range.clone()].iter().map(|y| (y - mean).powi(2)).sum();
            let chi2 = misfit / sds[series % decays.outputs].powi(2);
            Squares { chi2, misfit, signal, samples: range.len() as f64 }
        };
        all.enumerate().map(of_series).collect()
    };
    ranges.iter().flat_map(of_range).collect()
}

/// `Misfit`: of the baseline on all samples, in the noise that the final model leaves there.
pub fn measure(selected: &Selected) -> (Misfit, Gain) {
    let decays = selected.fit.decays;
    let n = decays.samples;
    let before = selected.baseline.misfit();
    let sds = selected.fit.sizes();
    let whole = 0..n;
    let whole = std::slice::from_ref(&whole);
    let all: Squares = squares(decays, &before, &sds, whole).into_iter().sum();
    let misfit = all.misfit(whiteness(&before, decays, whole));

    let stretches = Stretches::of(n);
    let held_out = (0..n).map(|k| stretches.held_out.iter().any(|range| range.contains(&k)));
    let noise = Noise { held_out: held_out.collect(), ..Noise::white(&sds) };
    let refitted = [&selected.baseline, &selected.fit].map(|fit| fit.descend(&noise));
    let [plain, extended] = refitted.each_ref().map(Fit::misfit);

    // each output's noise is what the extended model leaves where it was fitted
    let fitted = squares(decays, &extended, &vec![1.0; decays.outputs], &stretches.fitted);
    let kept = |output| {
        let all: Squares = fitted.iter().skip(output).step_by(decays.outputs).copied().sum();
        (all.misfit / all.samples.max(1.0)).sqrt().max(1e-12)
    };
    let kept: Vec<f64> = (0..decays.outputs).map(kept).collect();
    let held: usize = stretches.held_out.iter().map(Range::len).sum();
    let figures = |misfit: &[f64]| -> GainFigures {
        let each = squares(decays, misfit, &kept, &stretches.held_out);
        let p = whiteness(misfit, decays, &stretches.held_out);
        Squares::figures(&each, &alone(each.len()), p)
    };
    let gain = Gain {
        before: figures(&plain),
        after: figures(&extended),
        held_out: HeldOut {
            by: format!(
                "time: {held} of {n} samples of each, in stretches of {}",
                stretches.length
            ),
            signals: decays.bursts * decays.outputs,
            channels: decays.outputs,
            fitted_signals: decays.bursts * decays.outputs,
            fitted_channels: decays.outputs,
        },
        log_likelihood_per_signal: worth(selected, &refitted, &noise, &stretches),
        ..Gain::default()
    };
    (misfit, gain)
}

/// The gain of all that was found, and of each named cause (all lines of one name together). `refitted`: the
/// plain oscillation and the final model, fitted in `noise`, which counts what is not held out.
fn worth(
    selected: &Selected,
    refitted: &[Fit; 2],
    noise: &Noise,
    stretches: &Stretches,
) -> Option<LogLikelihood> {
    let (fit, named) = (&selected.fit, selected.named());
    if named.is_empty() {
        return None;
    }
    let [plain, extended] = refitted.each_ref().map(|model| stretches.ln_held_out(model));
    let mut by_cause = BTreeMap::new();
    for id in named {
        by_cause.entry(id.name()).or_insert_with(|| {
            let left = match id {
                CauseId::Offset => fit.resting(AtRest::Zero),
                _ => fit.without(|i| fit.terms[i].id() == id),
            };
            stretches.worth(&extended, &stretches.ln_held_out(&left.descend(noise)))
        });
    }
    Some(LogLikelihood { all: stretches.worth(&extended, &plain), by_cause })
}

/// The mean misfit and its spectrum are of the output whose misfit the extension reduces most.
pub fn draw(selected: &Selected) -> Figures {
    let decays = selected.fit.decays;
    let n = decays.samples;
    let before = selected.baseline.misfit();
    let after = selected.fit.misfit();
    let (large, small) = (sizes(&before, decays), sizes(&after, decays));
    let output = (0..decays.outputs)
        .max_by(|p, q| (large[*p] / small[*p]).total_cmp(&(large[*q] / small[*q])))
        .unwrap_or(0);

    // mean misfit over the bursts, with the band that the final model's noise gives it
    let sd = small[output] * decays.scale[output];
    let half = 1.96 * sd / (decays.bursts as f64).sqrt();
    let weight = decays.scale[output] / decays.bursts as f64;
    let mean = |misfit: &[f64]| {
        let each: Vec<&[f64]> = decays.of_output(misfit, output).collect();
        let mean = (0..n).map(|k| weight * each.iter().map(|r| r[k]).sum::<f64>()).collect();
        Curve::about(mean, std::iter::repeat_n(half, n))
    };
    let times = (0..n).map(|k| decays.time_s(k)).collect();
    let mean_misfit = Compared::of(times, [&before, &after].map(|misfit| mean(misfit)));

    // mean spectrum over the bursts; the band is about that of white noise of the same size
    let [low, high] = band_of_means(decays.bursts as f64);
    let mean_power = |misfit: &[f64]| {
        let weight = decays.scale[output].powi(2) / decays.bursts as f64;
        let power = spectrum::total(decays.of_output(misfit, output), weight);
        // the spectrum is interpolated by zero padding: every fourth point is enough
        let y: Vec<f64> = power.into_iter().skip(4).step_by(4).collect();
        let edge = |by: f64| vec![sd * sd * by; y.len()];
        Curve { low: edge(low), high: edge(high), y }
    };
    let powers = [&before, &after].map(|misfit| mean_power(misfit));
    let step_hz = 4.0 / ((4 * n).next_power_of_two() as f64 * decays.dt_s);
    let hertz = (0..powers[0].y.len()).map(|j| (j + 1) as f64 * step_hz).collect();
    let spectrum = Compared::of(hertz, powers);
    Figures { mean_misfit, spectrum, unit: UNIT.into() }
}
