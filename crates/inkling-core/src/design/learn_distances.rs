//! Learning the detection by `detect.method` = `sensitivity`: the leftover and the noise, the spread
//! of healthy channels, the statistics by it, and the thresholds of both tests.
//!
//! In, from `learn`: a model with its average and filter; its signals, labelled healthy or of a window, of which
//! some may be faulty. Out: the model's `sensitivity`; `threshold`, a squared distance (no unit); `misfit`
//! (counts^2; its threshold a squared distance). How labelled signals and windows differ, `learn` says.

use super::detector::{DEPENDENT_SENSITIVITIES, Detection, SensitivityDetector, three};
use super::learn::{Sources, learn_threshold};
use super::leftover::Misfits;
use super::{DetectSettings, HealthyModel, Result, tuned};
use crate::detect::ThresholdMethod;
use crate::detect::contamination::{Degrees, Spread, contaminated};
use crate::detect::misfit::{Misfit, SECOND_LOOK_SDS};
use crate::detect::sensitivity::Sensitivity;
use crate::detect::threshold::Method;
use crate::identify::SignalSet;
use crate::identify::averaging;
use crate::model::median::median;
use crate::model::ring_fit::{Features, FitBuffers};
use crate::numbers::LITTLE;
use nalgebra::Vector3;
use std::borrow::Cow;

/// The largest factor by which a window's faulty signals may raise the median squared distance. If 46 % are
/// faulty and far out, the median of all is the quantile .5 / .54 of the healthy ones, which of chi-squared with
/// three degrees of freedom is three times their median.
const MOST_FAULTY: f64 = 3.0;

/// The values tried for `Sensitivity::share`, each the next times the square root of two.
const SHARES: [f64; 5] = [1.0, 0.71, 0.5, 0.35, 0.25];

/// Number of lags of the noise's autocovariance, from 0 on.
const LAGS: usize = 32;

struct Usable<'a> {
    signals: Cow<'a, SignalSet>,
    /// The three features, to first order, and the relative drive of each signal.
    features: Vec<(Vector3<f64>, f64)>,
}

#[derive(Default)]
struct Statistics {
    /// Squared distances along the ring's sensitivities.
    along: Vec<f64>,
    /// Misfits beside the ring, counts²; NaN for a signal that lies far along it.
    squares: Vec<f64>,
}

impl HealthyModel {
    /// Learns both tests. Labelled signals give their own spread of healthy channels for the
    /// metric, of which a share counts (`smallest`). A window uses its anchor's spread if it has
    /// few signals or if that spread gives the better test (`by_known_spread`).
    pub(super) fn learn_distances(&mut self, from: Sources) -> Result<()> {
        let Sources { set, healthy, anchor, detect, labelled } = from;
        let new = self.learn_ring(healthy)?;

        // of a window all signals: those that agree lack the tail of the healthy ones
        let seen = if labelled { healthy } else { set };
        // of few signals only the ring and the noise are the window's own
        if let (false, true, Some(anchor)) = (labelled, seen.len() < tuned::FEWEST_OWN, anchor)
            && let Some(known) = &anchor.sensitivity
        {
            self.sensitivity = Some(new.with_spread_of(known));
            self.median_statistic = anchor.median_statistic;
            (self.threshold, self.misfit) = (anchor.threshold.clone(), anchor.misfit.clone());
            return Ok(());
        }

        let Usable { signals: seen, features } = self.usable(seen, &new)?;
        let own = match labelled {
            true => self.smallest(&seen, new.with_spread(&features), detect)?,
            false => {
                let own = new.with_core_spread(&features);
                (self.statistics(&seen, &own)?, own)
            }
        };

        let known = anchor.filter(|of| !labelled && of.threshold.method != Method::Window);
        let better = known.map(|known| self.by_known_spread(&seen, &own, known, detect));
        let better = better.transpose()?.flatten();
        let spread = if better.is_some() { Spread::Known } else { Spread::Own };
        let (found, sensitivity) = better.unwrap_or(own);

        self.sensitivity = Some(sensitivity);
        self.median_statistic = median(&mut found.along.clone());
        self.learn_thresholds(&found, spread, (&seen.channel, labelled), detect)
    }

    /// The test by that of the [`SHARES`] of the spread of labelled signals, from the largest on, behind which the
    /// ellipsoid of healthy features no longer becomes smaller: the less far the channels' differences reach in the tail,
    /// the smaller is the share. `own`: by the spread of `seen`.
    fn smallest(
        &self,
        seen: &SignalSet,
        own: Sensitivity,
        settings: &DetectSettings,
    ) -> Result<(Statistics, Sensitivity)> {
        // the second test has the part LITTLE of the allowed false alarms, the first one the rest
        let of_rate = 1.0 - LITTLE;
        let test = |share| -> Result<(f64, (Statistics, Sensitivity))> {
            let test = Sensitivity { share, ..own.clone() };
            let found = self.statistics(seen, &test)?;
            let threshold = learn_threshold(&found.along, &seen.channel, settings, of_rate)?;
            Ok((test.volume(threshold.value), (found, test)))
        };
        let [first, others @ ..] = SHARES;
        // Behind the first share that is no gain none is tried: of few channels one of them may seem to be a gain by chance.
        let mut smallest = test(first)?;
        for share in others {
            let next = test(share)?;
            // a volume that is NaN is no gain
            if next.0.is_nan() || next.0 >= smallest.0 {
                break;
            }
            smallest = next;
        }
        Ok(smallest.1)
    }

    /// A window's test by the anchor's spread, of labelled signals, if it calls a smaller volume of
    /// features healthy than the window's own: faults in a window widen its spread and hide in it,
    /// but the known spread may be another printhead's. `found`: statistics by `own`.
    fn by_known_spread(
        &self,
        seen: &SignalSet,
        (found, own): &(Statistics, Sensitivity),
        known: &HealthyModel,
        settings: &DetectSettings,
    ) -> Result<Option<(Statistics, Sensitivity)>> {
        let Some(spread) = &known.sensitivity else { return Ok(None) };
        let like_known = own.clone().scattering_like(spread);
        let of_known = self.statistics(seen, &like_known)?;

        // Signals farther apart than faults explain do not have the known spread. Each median is
        // divided by the mean of its own metric, which may count another share of the spread.
        let apart = median(&mut of_known.along.clone()) / like_known.mean_square();
        if apart > MOST_FAULTY * known.typical_distance() {
            return Ok(None);
        }

        let rate = (1.0 - LITTLE) * settings.false_alarm_rate;
        let threshold = |of: &Statistics, spread: Spread| {
            let kind = (Degrees::Three, spread);
            contaminated(&of.along, &seen.channel, kind, rate, settings.confidence).ok()
        };
        let Some(by_known) = threshold(&of_known, Spread::Known) else { return Ok(None) };
        let is_better = threshold(found, Spread::Own).is_none_or(|by_own| {
            // the window's own must be better by two standard deviations of the ln volume of n
            // channels' spread, sqrt(3 / 2n) (determinant of a Wishart matrix, three features)
            let surely = 2.0 * (1.5 / by_own.n_channels as f64).sqrt();
            like_known.volume(by_known.value).ln() < own.volume(by_own.value).ln() + surely
        });
        Ok(is_better.then_some((of_known, like_known)))
    }

    /// Adds the leftover of healthy signals to the expected signal, and returns the ring's
    /// sensitivities, corrected for coloured noise; mean and spread of the channels are still 0.
    fn learn_ring(&mut self, healthy: &SignalSet) -> Result<Sensitivity> {
        let rings = self.rings()?;
        let left = Misfits::of(self, &rings, healthy, Some(Features::HEALTHY));
        if let Some(shape) = left.shape() {
            self.expected.iter_mut().zip(&shape).for_each(|(e, s)| *e += s);
            self.leftover = shape;
        }

        let left = left.without(&self.leftover);
        let tangent = rings.fitter.tangent(&Features::HEALTHY).columns(0, 3).into_owned();
        let new = Sensitivity::new(&tangent, self.noise).ok_or(DEPENDENT_SENSITIVITIES)?;

        // the projection beside the ring colours even white noise
        let (seen, white) = (left.autocovariance(LAGS), left.of_white_noise(&rings, LAGS));
        let white: Vec<f64> = white.iter().map(|r| r * self.noise * self.noise).collect();
        Ok(new.coloured(&seen, &white))
    }

    /// The signals with plausible features, by rings fitted from what the projection of `by` says; an error if they are too
    /// few. The projection alone would take a channel that is off in frequency for damped, too, by the square of that.
    fn usable<'a>(&self, seen: &'a SignalSet, by: &Sensitivity) -> Result<Usable<'a>> {
        let mut first = Vec::with_capacity(seen.len());
        self.each_deviation(seen, |_, deviation, drive| first.push(by.features(deviation, drive)));
        let start = |x: &Vector3<f64>| Some(Features::from(x.push(0.0)));
        let starts: Vec<Option<Features>> = first.iter().map(start).collect();
        let response = self.temperature_response.as_deref().unwrap_or_default();
        let copy = |i: usize, y: &mut [f64]| self.less_warmth((seen, i), response, y);
        let fits = self.fitter()?.fit_all(false, &mut FitBuffers::default(), &starts, copy);

        let (mut features, mut kept) = (Vec::with_capacity(seen.len()), Vec::new());
        for (i, (first, fit)) in first.iter().zip(fits).enumerate() {
            let x = fit.as_ref().and_then(three).unwrap_or(*first);
            // a recorded drive near 0 makes features that would ruin the covariance
            if x.iter().all(|v| v.abs() < 1e6) {
                features.push((x, seen.drive[i]));
                kept.push(i);
            }
        }
        averaging::enough(features.len())?;
        let all = kept.len() == seen.len();
        let signals = if all { Cow::Borrowed(seen) } else { Cow::Owned(seen.select(&kept)) };
        Ok(Usable { signals, features })
    }

    /// Both statistics of a set's signals, as a judge computes them.
    fn statistics(&self, seen: &SignalSet, sensitivity: &Sensitivity) -> Result<Statistics> {
        // which first-order misfits need a fit, their distribution tells (NaN: far along the ring)
        let mut detector = SensitivityDetector::new(self, sensitivity.clone(), None)?;
        let mut squares = Vec::with_capacity(seen.len());
        self.each_deviation(seen, |_, deviation, drive| {
            squares.push(detector.first_look(deviation, drive).detection().unexplained);
        });
        squares.retain(|q| q.is_finite());
        if let Some([root, sd]) = Misfit::scale(&squares) {
            detector.settled = (root + SECOND_LOOK_SDS * sd).powi(2);
        }

        let (mut scratch, mut found) = (Vec::new(), Statistics::default());
        self.each_deviation(seen, |_, deviation, drive| {
            let Detection { ring, unexplained } = detector.detect(deviation, drive, &mut scratch);
            found.along.push(ring);
            found.squares.push(unexplained);
        });
        Ok(found)
    }

    /// `spread`: whether the distances are by the signals' own; `channels`: of each signal. Labelled
    /// signals give a tail quantile or a maximum, others the quantile of a mixture model.
    fn learn_thresholds(
        &mut self,
        found: &Statistics,
        spread: Spread,
        (channels, labelled): (&[u32], bool),
        settings: &DetectSettings,
    ) -> Result<()> {
        let Statistics { along, squares } = found;
        let mixture = |statistics: &[f64], channels: &[u32], kind, share: f64, confidence| {
            contaminated(statistics, channels, kind, share * settings.false_alarm_rate, confidence)
        };
        let learn = |statistics: &[f64], channels: &[u32], kind, share: f64| match labelled
            || settings.threshold == ThresholdMethod::Max
        {
            true => learn_threshold(statistics, channels, settings, share),
            false => Ok(mixture(statistics, channels, kind, share, settings.confidence)?),
        };

        let (kind, share) = ((Degrees::Three, spread), 1.0 - LITTLE);
        self.threshold = learn(along, channels, kind, share)?;

        // labels may be wrong: training warns of a part of the signals that lies apart; by a mixture,
        // `n_effective` is the number of signals taken for healthy
        if labelled {
            let law = mixture(along, channels, kind, share, 0.5);
            let apart = law.ok().filter(|law| self.threshold.value > tuned::SUSPECT * law.value);
            self.apart = apart.map(|law| 1.0 - law.n_effective / along.len() as f64);
        }

        // The second test is learned from the signals that the first one calls healthy.
        let near = |i: &usize| squares[*i].is_finite() && along[*i] <= self.threshold.value;
        let near: Vec<usize> = (0..squares.len()).filter(near).collect();
        let channels: Vec<u32> = near.iter().map(|&i| channels[i]).collect();
        let squares: Vec<f64> = near.iter().map(|&i| squares[i]).collect();
        if let Some(scale) = Misfit::scale(&squares) {
            let distances: Vec<f64> = squares.iter().map(|q| Misfit::distance(*q, scale)).collect();
            let kind = (Degrees::OneSided, Spread::Own);
            let threshold = learn(&distances, &channels, kind, LITTLE)?;
            let [root, root_sd] = scale;
            // the mean misfit of what the second test calls healthy: verdicts state misfits over it
            let within = squares.iter().zip(&distances).filter(|(_, d)| **d <= threshold.value);
            let within: Vec<f64> = within.map(|(q, _)| *q).collect();
            let square = within.iter().sum::<f64>() / within.len().max(1) as f64;
            self.misfit = Some(Misfit { square, root, root_sd, threshold });
        }
        Ok(())
    }
}
