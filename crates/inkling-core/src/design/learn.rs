//! Learning a healthy model, from a window's signals or from signals that labels say are healthy.
//!
//! In, from training (`train`) and from the windows of a replay (`pipeline/progress.rs`): signals
//! in counts with their drive and temperature, the model that came before (the *anchor*; a window's
//! is the design's model of the printhead, or else its first window's), settings. Out: a
//! [`HealthyModel`]. The steps: average, grey box (3-1), filter, effect of temperature; then
//! detection: the leftover and the noise, the spread of healthy channels, the statistics by it, and
//! their thresholds.
//!
//! The two sources differ in what may be trusted. Labelled signals are all healthy, so their mean,
//! spread and tail are taken as they are. Of a window nobody knows which signals are faulty (up to
//! two in five), so only the signals that agree are averaged, the spread is estimated robustly, and
//! the thresholds come from a mixture model or from the anchor. Which of the two a call is about,
//! `LearnSettings::least_agreeing` says: `None` for labelled signals, `Some` for a window.

use super::detector::{Detection, SensitivityDetector};
use super::error::DesignError;
use super::fd_filter::{LearnSettings, residual_generator};
use super::leftover::Leftovers;
use super::tuned;
use super::{DetectSettings, HealthyModel, Statistic};
use crate::detect::contamination::{Degrees, Spread, contaminated};
use crate::detect::key_numbers::{KeyNumbers, KeyRange, Spectrum};
use crate::detect::misfit::{Misfit, SECOND_LOOK_SDS};
use crate::detect::sensitivity::Sensitivity;
use crate::detect::threshold::{self, Method, Threshold};
use crate::detect::{DetectMethod, ThresholdMethod};
use crate::identify::averaging::{self, SignalSet};
use crate::identify::{grey_box, tangent};
use crate::model::median::median;
use crate::model::ring_fit::Features;
use crate::numbers::tuned::little;
use nalgebra::Vector3;
use std::borrow::Cow;

/// The largest factor by which faulty signals in a window may raise the median of the squared
/// distances. If 46 % of the signals are faulty and lie far off, the median of all signals is the
/// quantile .5 / .54 of the healthy ones, which for chi-squared with three degrees of freedom is
/// three times the median. A larger factor means that the window's signals have another spread.
const MOST_FAULTY: f64 = 3.0;

/// The values tried for `Sensitivity::share`, the share of the channels' covariance that a metric
/// counts: all of it down to a quarter, each the next times the square root of two.
const SHARES: [f64; 5] = [1.0, 0.71, 0.5, 0.35, 0.25];

/// Number of lags, one sample apart and beginning with 0, of the noise's autocovariance.
const LAGS: usize = 32;

/// The signals of a set whose features are plausible.
struct Usable<'a> {
    signals: Cow<'a, SignalSet>,
    /// ln amplitude, ln damping and ln frequency of each signal relative to the model's ring, to
    /// first order, and the signal's relative drive.
    features: Vec<(Vector3<f64>, f64)>,
}

/// Both statistics of some signals, one entry per signal each.
#[derive(Default)]
struct Statistics {
    /// Squared distances along the ring's sensitivities.
    along: Vec<f64>,
    /// Misfits beside the ring, counts²; NaN for a signal that lies far along it.
    squares: Vec<f64>,
}

impl HealthyModel {
    /// Learns a healthy model. `set`: a window's signals, or labelled ones; `printhead`: the name
    /// of their printhead, `None` if the signals are of several; `anchor`: the model that came
    /// before, which passes on what one window cannot know (temperature response, tail of the
    /// statistics). An error if the signals are too few, do not agree, or give no model that rings.
    pub fn learn(
        set: &SignalSet,
        printhead: Option<&str>,
        anchor: Option<&HealthyModel>,
        settings: LearnSettings,
    ) -> Result<HealthyModel, DesignError> {
        // The average is to be that of healthy signals: of a window it is taken over the signals
        // that agree with each other.
        // Departs: thesis §3-1 averages all signals and trusts that few are faulty. With
        // `plain_mean` this code does the same.
        let least = settings.least_agreeing.filter(|_| !settings.grey_box.plain_mean);
        let healthy = &*averaging::healthy(set, least)?;

        // Identification of the average, then the filter that turns the identified model's signal
        // into nothing.
        let mean = averaging::average(healthy)?;
        let dt_s = settings.sample_period_s;
        let near = anchor.map(|anchor| &anchor.identification.channel);
        let identification =
            grey_box::identify_scattered(healthy, &mean, dt_s, settings.grey_box, near)?;
        let expected = identification.expected(dt_s, set.samples);
        let generator = residual_generator(&identification, set.samples, settings, dt_s)?;

        // The effect of temperature, counts/K sample by sample: the anchor's if it knows one, or
        // else a regression on labelled signals. From the response along the ring's tangent follow
        // the changes of damping and frequency per K.
        let temperature_c = healthy.mean_temperature_c();
        let directions = tangent::tangent(&identification, dt_s, set.samples);
        let known = anchor.and_then(|anchor| anchor.temperature_response.clone());
        let temperature_response = known.or_else(|| {
            // In a window without labels temperature and time rise together, so that any other slow
            // change would be taken for the effect of temperature.
            let reference = temperature_c.filter(|_| settings.least_agreeing.is_none())?;
            tangent::temperature_response(healthy, &expected, &directions, reference)
        });
        let (damping_per_k, frequency_per_k) = temperature_response
            .as_ref()
            .and_then(|response| tangent::pole_changes(&identification, &directions, response))
            .unwrap_or((0.0, 0.0));

        // The model without its detection, which is learned next from the deviations from this
        // model.
        let mut model = HealthyModel {
            printhead: printhead.map(str::to_owned),
            valid_from_ns: None,
            n_signals: mean.n_signals,
            n_channels: mean.n_channels,
            scatter: mean.scatter,
            noise: mean.noise,
            temperature_c,
            identification,
            expected,
            leftover: Vec::new(),
            temperature_response,
            damping_per_k,
            frequency_per_k,
            generator,
            sensitivity: None,
            statistic: None,
            decoupled: None,
            threshold: Threshold::none(),
            misfit: None,
            apart: None,
            median_statistic: f64::NAN,
        };
        model.learn_detection(set, healthy, anchor, settings)?;
        Ok(model)
    }

    /// Learns the statistics of `detect.method` and their thresholds. `set`: the whole window;
    /// `healthy`: those of its signals that agree with each other (all of them if labels say so).
    /// The model must have its average, filter and expected signal already.
    fn learn_detection(
        &mut self,
        set: &SignalSet,
        healthy: &SignalSet,
        anchor: Option<&HealthyModel>,
        settings: LearnSettings,
    ) -> Result<(), DesignError> {
        if !settings.detect.decouple.is_empty() {
            self.decoupled = Some(self.decoupling(&settings.detect.decouple)?);
        }
        match settings.detect.method {
            DetectMethod::ResidualEnergy | DetectMethod::ResidualMaximum => {
                let is_maximum = settings.detect.method == DetectMethod::ResidualMaximum;
                self.statistic = is_maximum.then_some(Statistic::ResidualMaximum);
                let (mut all, mut scratch) = (Vec::with_capacity(healthy.len()), Vec::new());
                self.each_deviation(healthy, |_, deviation, _| {
                    all.push(self.of_residual(deviation, &mut scratch));
                });
                self.learn_statistics(&all, healthy, anchor, settings)
            }
            DetectMethod::Practice => self.learn_ranges(healthy, anchor, settings),
            DetectMethod::Sensitivity => self.learn_distances(set, healthy, anchor, settings),
        }
    }

    /// Learns the ranges of frequency and damping of `detect.method` = `practice`. The ranges are
    /// set once, on signals that are known to be healthy, and never adapted: a window takes over
    /// those of its anchor.
    fn learn_ranges(
        &mut self,
        healthy: &SignalSet,
        anchor: Option<&HealthyModel>,
        settings: LearnSettings,
    ) -> Result<(), DesignError> {
        if let Some(anchor) = anchor.filter(|_| settings.least_agreeing.is_some()) {
            (self.statistic, self.threshold) = (anchor.statistic, anchor.threshold.clone());
            self.median_statistic = anchor.median_statistic;
            return Ok(());
        }
        let spectrum = Spectrum::new(healthy.samples, settings.sample_period_s);
        let mut y = vec![0.0; healthy.samples];
        let numbers: Vec<KeyNumbers> = (0..healthy.len())
            .map(|i| {
                self.at_reference(healthy, i, &mut y);
                spectrum.key_numbers(&y)
            })
            .collect();
        let range = KeyRange::of(numbers.iter(), 0.0)
            .ok_or_else(|| DesignError::Invalid("no healthy signal has a range".into()))?;
        self.statistic = Some(Statistic::Practice(range));
        let distances: Vec<f64> = numbers.iter().map(|k| range.distance(k)).collect();
        self.learn_statistics(&distances, healthy, None, settings)
    }

    /// Learns the threshold of a method with one test, thesis (3-4) on its statistic. `energies`:
    /// the statistic of each signal of `healthy`, in the unit of the method.
    fn learn_statistics(
        &mut self,
        energies: &[f64],
        healthy: &SignalSet,
        anchor: Option<&HealthyModel>,
        settings: LearnSettings,
    ) -> Result<(), DesignError> {
        self.median_statistic = median(&mut energies.to_vec());
        // Nobody says that a window is free of slight faults, so its own tail cannot be trusted,
        // but its median can. So the anchor's threshold is taken, times the ratio of the two
        // medians.
        // Departs: the thesis has one model, and (3-4) of signals that are known to be healthy.
        let trusted = anchor.filter(|_| settings.least_agreeing.is_some());
        self.threshold = match trusted {
            Some(anchor) => {
                anchor.threshold.scaled(self.median_statistic / anchor.median_statistic)
            }
            None => learn_threshold(energies, &healthy.channel, settings.detect, 1.0)?,
        };
        Ok(())
    }

    /// Learns `detect.method` = `sensitivity`: the test along the ring and the one beside it.
    /// `set`: the whole window; `healthy`: those of its signals that agree with each other.
    ///
    /// The spread of healthy channels decides the metric. Labelled signals give their own spread,
    /// of which a share counts (`smallest`). A window uses the anchor's spread if the window has
    /// few signals or if that spread gives the better test (`like_known`); otherwise it uses its
    /// own.
    fn learn_distances(
        &mut self,
        set: &SignalSet,
        healthy: &SignalSet,
        anchor: Option<&HealthyModel>,
        settings: LearnSettings,
    ) -> Result<(), DesignError> {
        // The sensitivities and the noise, for which healthy signals are needed.
        let new = self.learn_ring(healthy)?;

        // Spread and thresholds are learned from `seen`. Labels say that all signals are healthy.
        // Without labels `seen` is the whole window, up to two in five of whose signals may be
        // faulty: if only the signals that agree were used, the tail of the healthy ones would be
        // cut off.
        let (seen, labelled) = match settings.least_agreeing {
            None => (healthy, true),
            Some(_) => (set, false),
        };
        // A window of few signals says less of spread and tail than the design does: only the ring
        // and the noise are the window's own.
        if let (false, true, Some(anchor)) = (labelled, seen.len() < tuned::fewest_own(), anchor)
            && let Some(known) = &anchor.sensitivity
        {
            self.sensitivity = Some(new.with_spread_of(known));
            self.median_statistic = anchor.median_statistic;
            (self.threshold, self.misfit) = (anchor.threshold.clone(), anchor.misfit.clone());
            return Ok(());
        }

        // The spread of these signals, and the statistics of the signals by that spread.
        let Usable { signals: seen, features } = self.usable(seen, &new)?;
        let own = match labelled {
            true => self.smallest(&seen, new.with_spread(&features), settings.detect)?,
            false => {
                let own = new.with_core_spread(&features);
                (self.statistics(&seen, &own)?, own)
            }
        };

        // The spread of the anchor competes with it if the anchor was learned from labels, not from
        // a window.
        let known = anchor.filter(|of| !labelled && of.threshold.method != Method::Window);
        let better = known.map(|known| self.like_known(&seen, &own, known, settings.detect));
        let better = better.transpose()?.flatten();
        let spread = if better.is_some() { Spread::Known } else { Spread::Own };
        let (found, sensitivity) = better.unwrap_or(own);

        // With the metric chosen, the thresholds.
        self.sensitivity = Some(sensitivity);
        self.median_statistic = median(&mut found.along.clone());
        self.learn_thresholds(&found, spread, (&seen.channel, labelled), settings.detect)
    }

    /// Chooses how much of the spread of labelled signals the metric counts. One test is made for
    /// each of [`SHARES`], all at the same rate of false alarms; the best test is the one whose
    /// ellipsoid of healthy features has the smallest volume. The less far the channels'
    /// differences reach in the tail, beside a Gaussian of their covariance, the smaller is the
    /// share that wins. `own`: the sensitivities with the spread of `seen`. Returns the statistics
    /// of `seen` by the chosen share, and the sensitivities with that share.
    fn smallest(
        &self,
        seen: &SignalSet,
        own: Sensitivity,
        settings: &DetectSettings,
    ) -> Result<(Statistics, Sensitivity), DesignError> {
        // the part of the allowed false alarms that is left to the first test
        let of_rate = 1.0 - little();
        let test = |share| -> Result<(f64, (Statistics, Sensitivity)), DesignError> {
            let test = Sensitivity { share, ..own.clone() };
            let found = self.statistics(seen, &test)?;
            let threshold = learn_threshold(&found.along, &seen.channel, settings, of_rate)?;
            Ok((test.volume(threshold.value), (found, test)))
        };
        let [first, others @ ..] = SHARES;
        // a volume that is NaN is never the smaller one
        let mut smallest = test(first)?;
        for share in others {
            let next = test(share)?;
            if next.0 < smallest.0 {
                smallest = next;
            }
        }
        Ok(smallest.1)
    }

    /// A window's test by the spread that labelled signals have, if that test is better than the
    /// one by the window's own spread. `found`, `own`: the statistics by the window's own spread,
    /// and that spread; `known`: the anchor, learned from labelled signals. `None`: the window's
    /// own is better.
    ///
    /// Faults in a window widen the window's spread in the direction of the faults, and hide there.
    /// The known spread is free of faults, but may be that of another printhead. Of two tests of
    /// the same rate of false alarms the better one calls a smaller volume of the space of features
    /// healthy.
    fn like_known(
        &self,
        seen: &SignalSet,
        (found, own): &(Statistics, Sensitivity),
        known: &HealthyModel,
        settings: &DetectSettings,
    ) -> Result<Option<(Statistics, Sensitivity)>, DesignError> {
        let Some(spread) = &known.sensitivity else { return Ok(None) };
        let like_known = own.clone().scattering_like(spread);
        let of_known = self.statistics(seen, &like_known)?;

        // If the signals lie farther apart than faults among them explain, the known spread is not
        // theirs. The medians here and in training are by metrics that may count different shares
        // of the spread, so each is divided by the mean that its own metric gives.
        let apart = median(&mut of_known.along.clone()) / like_known.mean_square();
        if apart > MOST_FAULTY * known.typical_distance() {
            return Ok(None);
        }

        // Compare the volumes of features that the two tests call healthy. A test whose threshold
        // cannot be learned loses.
        let rate = (1.0 - little()) * settings.false_alarm_rate;
        let threshold = |of: &Statistics, spread: Spread| {
            let kind = (Degrees::Three, spread);
            contaminated(&of.along, &seen.channel, kind, rate, settings.confidence).ok()
        };
        let Some(by_known) = threshold(&of_known, Spread::Known) else { return Ok(None) };
        let is_better = threshold(found, Spread::Own).is_none_or(|by_own| {
            // The spread of n channels is known badly: ln of its volume has the standard deviation
            // sqrt(3 / 2n), from the determinant of a Wishart matrix of three features. The
            // window's own test must be better by two of these standard deviations.
            let surely = 2.0 * (1.5 / by_own.n_channels as f64).sqrt();
            like_known.volume(by_known.value).ln() < own.volume(by_own.value).ln() + surely
        });
        Ok(is_better.then_some((of_known, like_known)))
    }

    /// Adds the leftover of healthy signals to the expected signal, and returns the ring's
    /// sensitivities. The noise covariance in the result is corrected for coloured noise, which the
    /// misfits beside the ring show; mean and spread of the channels are still 0 in it.
    fn learn_ring(&mut self, healthy: &SignalSet) -> Result<Sensitivity, DesignError> {
        let rings = self.rings()?;
        let left = Leftovers::of(self, &rings, healthy, Some(Features::HEALTHY));
        // What healthy signals have in common beside their rings is expected of every signal.
        if let Some(shape) = left.shape() {
            self.expected.iter_mut().zip(&shape).for_each(|(e, s)| *e += s);
            self.leftover = shape;
        }

        // The sensitivities by ln amplitude, ln damping and ln frequency, with the phase held.
        let left = left.without(&self.leftover);
        let tangent = rings.fitter.tangent(&Features::HEALTHY).columns(0, 3).into_owned();
        let new = Sensitivity::new(&tangent, self.noise).ok_or_else(|| {
            DesignError::Invalid("amplitude, damping and frequency cannot be told apart".into())
        })?;

        // The misfits were projected beside the ring, which colours even white noise. So their
        // autocovariance is compared with that of white noise after the same projection.
        let (seen, white) = (left.autocovariance(LAGS), left.of_white_noise(&rings, LAGS));
        let white: Vec<f64> = white.iter().map(|r| r * self.noise * self.noise).collect();
        Ok(new.coloured(&seen, &white))
    }

    /// The signals with plausible first-order features, and these features. `by`: sensitivities
    /// whose projection gives the features. An error if fewer signals remain than an average needs.
    fn usable<'a>(&self, seen: &'a SignalSet, by: &Sensitivity) -> Result<Usable<'a>, DesignError> {
        let (mut features, mut kept) = (Vec::with_capacity(seen.len()), Vec::new());
        self.each_deviation(seen, |i, deviation, drive| {
            let x = by.features(deviation, drive);
            // a recorded drive near 0 makes features that no channel has, and would ruin the
            // covariance
            if x.iter().all(|v| v.abs() < 1e6) {
                features.push((x, drive));
                kept.push(i);
            }
        });
        averaging::enough(features.len())?;
        let all = kept.len() == seen.len();
        let signals = if all { Cow::Borrowed(seen) } else { Cow::Owned(seen.select(&kept)) };
        Ok(Usable { signals, features })
    }

    /// Both statistics of a set's signals, computed as by a judge: to first order, and by fits
    /// where first order does not decide.
    fn statistics(
        &self,
        seen: &SignalSet,
        sensitivity: &Sensitivity,
    ) -> Result<Statistics, DesignError> {
        // There is no second test yet whose threshold would tell which first-order misfits need a
        // fit. So that limit is set from the distribution of the first-order misfits themselves. A
        // misfit that is NaN belongs to a signal far along the ring.
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

    /// Learns the thresholds of both tests, each for its share of the rate of false alarms.
    /// `found`: the statistics of the signals; `spread`: whether the distances are by the signals'
    /// own spread or by a known one; `channels`: the channel of each signal; `labelled`: whether
    /// labels say that all signals are healthy. Labelled signals give a tail quantile or a maximum,
    /// others the quantile of a mixture model of healthy and faulty signals.
    fn learn_thresholds(
        &mut self,
        found: &Statistics,
        spread: Spread,
        (channels, labelled): (&[u32], bool),
        settings: &DetectSettings,
    ) -> Result<(), DesignError> {
        let Statistics { along, squares } = found;
        // a threshold on any statistic; `kind` is that statistic's distribution in the mixture
        // model
        let learn = |statistics: &[f64], channels: &[u32], kind, share: f64| match labelled
            || settings.threshold == ThresholdMethod::Max
        {
            true => learn_threshold(statistics, channels, settings, share),
            false => {
                let rate = share * settings.false_alarm_rate;
                Ok(contaminated(statistics, channels, kind, rate, settings.confidence)?)
            }
        };

        // The first test gets all of the allowed false alarms but the share of the second one.
        let share = 1.0 - little();
        self.threshold = learn(along, channels, (Degrees::Three, spread), share)?;

        // Labels may be wrong. If the threshold by the mixture model lies far below the learned
        // one, a part of the signals lies apart from the others, of which training warns.
        if labelled {
            let rate = share * settings.false_alarm_rate;
            let law = contaminated(along, channels, (Degrees::Three, spread), rate, 0.5);
            let apart = law.ok().filter(|law| self.threshold.value > tuned::suspect() * law.value);
            self.apart = apart.map(|law| 1.0 - law.n_effective / along.len() as f64);
        }

        // The second test is learned from the signals that the first test calls healthy, since
        // signals far along the ring have no misfit (NaN). Its statistic is the squared
        // standardised excess of the misfit's root over the median root.
        let near = |i: &usize| squares[*i].is_finite() && along[*i] <= self.threshold.value;
        let near: Vec<usize> = (0..squares.len()).filter(near).collect();
        let channels: Vec<u32> = near.iter().map(|&i| channels[i]).collect();
        let squares: Vec<f64> = near.iter().map(|&i| squares[i]).collect();
        if let Some(scale) = Misfit::scale(&squares) {
            let distances: Vec<f64> = squares.iter().map(|q| Misfit::distance(*q, scale)).collect();
            let kind = (Degrees::OneSided, Spread::Own);
            let threshold = learn(&distances, &channels, kind, little())?;
            let [root, root_sd] = scale;
            // the mean misfit of the signals that the second test calls healthy: verdicts state
            // misfits relative to this mean
            let within = squares.iter().zip(&distances).filter(|(_, d)| **d <= threshold.value);
            let within: Vec<f64> = within.map(|(q, _)| *q).collect();
            let square = within.iter().sum::<f64>() / within.len().max(1) as f64;
            self.misfit = Some(Misfit { square, root, root_sd, threshold });
        }
        Ok(())
    }
}

/// A threshold by `detect.threshold`, with all signals taken for healthy: thesis (3-4), or the tail
/// quantile. `energies`: the statistic of each signal; `channels`: the channel of each signal,
/// since signals of one channel are not independent; `share`: the part of `false_alarm_rate` that
/// the threshold's test may use.
fn learn_threshold(
    energies: &[f64],
    channels: &[u32],
    settings: &DetectSettings,
    share: f64,
) -> Result<Threshold, DesignError> {
    Ok(match settings.threshold {
        ThresholdMethod::Max => threshold::max(energies, channels, settings.mu)?,
        ThresholdMethod::Quantile => threshold::quantile(
            energies,
            channels,
            share * settings.false_alarm_rate,
            settings.confidence,
        )?,
    })
}
