//! A healthy model ready to judge by: identification, filter and threshold of one window.

use super::DetectSettings;
use super::Statistic;
use super::detector::{Scratch, SensitivityDetector, ring_of};
use super::error::{DesignError, is_count, is_positive, same_period};
use super::filter_of_model::{LearnSettings, residual_generator};
use super::leftover::Left;
use crate::detect::contamination::{Degrees, contaminated};
use crate::detect::decoupling::KnownShapes;
use crate::detect::key_numbers::{KeyNumbers, KeyRange, Spectrum};
use crate::detect::misfit::{self, Misfit};
use crate::detect::sensitivity::Sensitivity;
use crate::detect::{DetectMethod, ResidualGenerator, ThresholdMethod, threshold};
use crate::identify::averaging::{self, SignalSet};
use crate::identify::grey_box::{self, Identification};
use crate::identify::{IdentifyError, tangent};
use crate::model::beside_ring::BesideRing;
use crate::model::median::median;
use crate::model::ring::Ring;
use crate::model::ring_fit::{Features, RingFitter};
use serde::{Deserialize, Serialize};
use threshold::Threshold;

/// A filter that answers one count with more within a signal is unstable: its marginal pair of
/// poles (thesis §3-2-1) rings on and does not grow.
const MOST_GAIN: f64 = 1e6;

/// Signals from which a window's own spread and thresholds count, where there is a design.
const FEWEST_OWN: usize = 200;

/// A threshold so many times what most of the signals allow was learned on more than healthy ones.
const SUSPECT: f64 = 3.0;

/// Samples over which noise may remember.
const LAGS: usize = 32;

/// One identified model with its x_a_hat, poles and threshold, thesis §3-1 and §3-2.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct HealthyModel {
    /// `None`: pooled over printheads.
    pub printhead: Option<String>,
    /// Judges bursts from here on, ns since the epoch; `None`: from the beginning.
    pub valid_from_ns: Option<i64>,
    pub n_signals: usize,
    pub n_channels: usize,
    /// Of one healthy signal about the mean / of one sample alone, counts.
    pub scatter: f64,
    pub noise: f64,
    /// Mean recorded temperature of the window, °C.
    pub temperature_c: Option<f64>,
    pub identification: Identification,
    /// y_hat = C e^{At} x_a_hat at the reference drive, counts; with `detect.method` = `sensitivity` plus
    /// what all healthy signals hold beside their ring, `leftover`.
    pub expected: Vec<f64>,
    /// Part of `expected`, counts; empty: there is none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub leftover: Vec<f64>,
    /// d y_hat / d temperature, counts/K; absent: not recorded or no significant effect.
    pub temperature_response: Option<Vec<f64>>,
    /// Relative change of damping and of resonance per K.
    pub damping_per_k: f64,
    pub frequency_per_k: f64,
    pub generator: ResidualGenerator,
    pub threshold: Threshold,
    /// Healthy channels along the model's sensitivities, for `detect.method` = `sensitivity`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensitivity: Option<Sensitivity>,
    /// What is compared instead, with `detect.method` = `residual-maximum` or `practice`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub statistic: Option<Statistic>,
    /// What is taken off a deviation before the filter, with `detect.decouple`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub decoupled: Option<KnownShapes>,
    /// What healthy signals leave beside their rings, for the second test.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub misfit: Option<Misfit>,
    /// Of labelled signals: the share that lies apart from the others, where that moves the threshold.
    #[serde(skip)]
    pub apart: Option<f64>,
    /// Median detection statistic of the window's signals.
    pub median_statistic: f64,
}

impl HealthyModel {
    /// Where its threshold lies, in medians of healthy statistics.
    pub fn in_medians(&self) -> f32 {
        (self.threshold.value / self.median_statistic) as f32
    }

    /// Its two statistics. `misfit`: with the second test.
    pub(super) fn detector(
        &self,
        sensitivity: Sensitivity,
        misfit: Option<&Misfit>,
    ) -> Result<SensitivityDetector, DesignError> {
        let (ring, dt_s) = (ring_of(&self.identification)?, self.generator.dt_s);
        SensitivityDetector::new(ring, dt_s, &self.expected, &self.leftover, sensitivity, misfit)
    }

    /// Learns from a healthy window. `anchor`: the model that came before, which passes on what one
    /// window cannot know (temperature response, tail of the energies).
    pub fn learn(
        set: &SignalSet,
        printhead: Option<&str>,
        anchor: Option<&HealthyModel>,
        settings: LearnSettings,
    ) -> Result<HealthyModel, DesignError> {
        let chosen;
        // Departs: thesis §3-1 averages all signals and trusts that few are faulty; with
        // `plain_mean` so does this
        let healthy = match settings.least_agreeing {
            Some(share) if !settings.grey_box.plain_mean => {
                chosen = set.select(&averaging::agreeing(set, share)?);
                &chosen
            }
            _ => set,
        };
        let mean = averaging::average(healthy)?;
        let dt_s = settings.sample_period_s;
        let identification = grey_box::identify_scattered(healthy, &mean, dt_s, settings.grey_box)?;
        let expected = identification.expected(dt_s, set.samples);
        let generator = residual_generator(&identification, set.samples, settings, dt_s)?;

        let temperature_c = healthy.mean_temperature_c();
        let directions = tangent::tangent(&identification, dt_s, set.samples);
        let known = anchor.and_then(|anchor| anchor.temperature_response.clone());
        let temperature_response = known.or_else(|| {
            let reference = temperature_c?;
            tangent::temperature_response(healthy, &expected, &directions, reference)
        });
        let (damping_per_k, frequency_per_k) = temperature_response
            .as_ref()
            .and_then(|response| tangent::pole_changes(&identification, &directions, response))
            .unwrap_or((0.0, 0.0));
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

    /// `detect.method`, and where its thresholds lie. `set`: the window; `healthy`: what agrees in it.
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
            DetectMethod::ResidualEnergy => {
                let energies =
                    self.of_deviations(healthy, |model, d, work| model.residual_energy(d, work));
                self.learn_statistics(&energies, healthy, anchor, settings)?;
            }
            DetectMethod::ResidualMaximum => {
                self.statistic = Some(Statistic::ResidualMaximum);
                let maxima =
                    self.of_deviations(healthy, |model, d, work| model.residual_maximum(d, work));
                self.learn_statistics(&maxima, healthy, anchor, settings)?;
            }
            DetectMethod::Practice => self.learn_ranges(healthy, anchor, settings)?,
            DetectMethod::Sensitivity => self.learn_distances(set, healthy, anchor, settings)?,
        }
        Ok(())
    }

    fn of_deviations(
        &self,
        set: &SignalSet,
        statistic: impl Fn(&HealthyModel, &[f64], &mut Vec<f64>) -> f64,
    ) -> Vec<f64> {
        let (mut all, mut scratch) = (Vec::with_capacity(set.len()), Vec::new());
        self.each_deviation(set, |deviation, _| {
            all.push(statistic(self, deviation, &mut scratch));
        });
        all
    }

    /// `practice`: the ranges are set once, on what is known to be healthy, and follow nothing.
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

    /// One test, thesis (3-4) on its statistic.
    fn learn_statistics(
        &mut self,
        energies: &[f64],
        healthy: &SignalSet,
        anchor: Option<&HealthyModel>,
        settings: LearnSettings,
    ) -> Result<(), DesignError> {
        self.median_statistic = median(&mut energies.to_vec());
        // Nobody says that the window is free of slight faults, so its own tail cannot be trusted; its
        // median can. The anchor's tail is carried over, in units of the median.
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

    /// `sensitivity`: along the ring and beside it. `set`: the window; `healthy`: what agrees in it.
    fn learn_distances(
        &mut self,
        set: &SignalSet,
        healthy: &SignalSet,
        anchor: Option<&HealthyModel>,
        settings: LearnSettings,
    ) -> Result<(), DesignError> {
        let (dt_s, samples) = (settings.sample_period_s, set.samples);
        let ring = ring_of(&self.identification)?;
        let fitter = RingFitter::new(ring, dt_s, samples);
        let beside = BesideRing::new(&ring, dt_s, samples);
        let near = Some(Features::HEALTHY);
        let left = Left::of(healthy, (&fitter, &beside), near, |i, y| {
            self.at_reference(healthy, i, y);
        });
        if let Some(shape) = left.shape() {
            self.expected.iter_mut().zip(&shape).for_each(|(e, s)| *e += s);
            self.leftover = shape;
        }
        let left = left.without(&self.leftover);
        let tangent = fitter.tangent(&Features::HEALTHY).columns(0, 3).into_owned();
        let new = Sensitivity::new(&tangent, self.noise).ok_or_else(|| {
            DesignError::Invalid("amplitude, damping and frequency cannot be told apart".into())
        })?;
        let (seen, white) =
            (left.autocovariance(LAGS), left.of_white_noise(&fitter, &beside, LAGS));
        let white: Vec<f64> = white.iter().map(|r| r * self.noise * self.noise).collect();
        let new = new.coloured(&seen, &white);
        // labels say that all are healthy; without, up to two in five may be faulty
        let (seen, labelled) = match settings.least_agreeing {
            None => (healthy, true),
            Some(_) => (set, false),
        };
        // a window of few signals says less than the design does
        if let (false, true, Some(anchor)) = (labelled, seen.len() < FEWEST_OWN, anchor)
            && let Some(known) = &anchor.sensitivity
        {
            self.sensitivity = Some(new.with_spread_of(known));
            self.median_statistic = anchor.median_statistic;
            (self.threshold, self.misfit) = (anchor.threshold.clone(), anchor.misfit.clone());
            return Ok(());
        }
        let mut features = Vec::with_capacity(seen.len());
        let mut usable = Vec::with_capacity(seen.len());
        self.each_deviation(seen, |deviation, drive| {
            let x = new.features(deviation, drive);
            // absurd drives make absurd features
            usable.push(x.iter().all(|v| v.abs() < 1e6));
            features.push((x, drive));
        });
        let kept: Vec<usize> = (0..seen.len()).filter(|&i| usable[i]).collect();
        let chosen;
        let seen = if kept.len() == seen.len() {
            seen
        } else {
            chosen = seen.select(&kept);
            &chosen
        };
        let features: Vec<_> = kept.iter().map(|&i| features[i]).collect();
        if features.len() < averaging::FEWEST_SIGNALS {
            let (found, needed) = (features.len(), averaging::FEWEST_SIGNALS);
            return Err(IdentifyError::TooFewSignals { found, needed }.into());
        }
        let sensitivity =
            if labelled { new.with_spread(&features) } else { new.with_core_spread(&features) };
        let mut detector = self.detector(sensitivity.clone(), None)?;
        let (mut scratch, mut distances, mut squares) =
            (Scratch::default(), Vec::new(), Vec::new());
        self.each_deviation(seen, |deviation, drive| {
            squares.push(detector.first_look(deviation, drive).detection().unexplained);
        });
        squares.retain(|q| q.is_finite());
        if let Some([root, sd]) = Misfit::scale(&squares) {
            detector.look_beyond((root + misfit::SECOND_LOOK_SDS * sd).powi(2));
        }
        squares.clear();
        self.each_deviation(seen, |deviation, drive| {
            let found = detector.detect(deviation, drive, &mut scratch);
            distances.push(found.ring);
            squares.push(found.unexplained);
        });
        self.sensitivity = Some(sensitivity);
        self.median_statistic = median(&mut distances.clone());
        let learn = |statistics: &[f64], channels: &[u32], kind: Degrees, share: f64| {
            let DetectSettings { false_alarm_rate, confidence, .. } = *settings.detect;
            match labelled || settings.detect.threshold == ThresholdMethod::Max {
                true => learn_threshold(statistics, channels, settings.detect, share),
                false => {
                    let rate = share * false_alarm_rate;
                    Ok(contaminated(statistics, channels, kind, rate, confidence)?)
                }
            }
        };
        let share = 1.0 - misfit::SHARE_OF_RATE;
        self.threshold = learn(&distances, &seen.channel, Degrees::Three, share)?;
        if labelled {
            let rate = share * settings.detect.false_alarm_rate;
            let law = contaminated(&distances, &seen.channel, Degrees::Three, rate, 0.5);
            let apart = law.ok().filter(|law| self.threshold.value > SUSPECT * law.value);
            self.apart = apart.map(|law| 1.0 - law.n_effective / distances.len() as f64);
        }
        // what is far along the ring says nothing of what lies beside it
        let near = |i: &usize| squares[*i].is_finite() && distances[*i] <= self.threshold.value;
        let near: Vec<usize> = (0..squares.len()).filter(near).collect();
        let channels: Vec<u32> = near.iter().map(|&i| seen.channel[i]).collect();
        let squares: Vec<f64> = near.iter().map(|&i| squares[i]).collect();
        if let Some(scale) = Misfit::scale(&squares) {
            let distances: Vec<f64> = squares.iter().map(|q| Misfit::distance(*q, scale)).collect();
            let threshold = learn(&distances, &channels, Degrees::OneSided, misfit::SHARE_OF_RATE)?;
            let [root, root_sd] = scale;
            let within: Vec<f64> = squares
                .iter()
                .zip(&distances)
                .filter(|(_, d)| **d <= threshold.value)
                .map(|(q, _)| *q)
                .collect();
            let square = within.iter().sum::<f64>() / within.len().max(1) as f64;
            self.misfit = Some(Misfit { square, root, root_sd, threshold });
        }
        Ok(())
    }

    /// Leaves a set's signal as it would be at the reference drive and temperature, counts.
    pub(super) fn at_reference(&self, set: &SignalSet, i: usize, y: &mut [f64]) {
        let (drive, warmer) = (set.drive[i], self.warmer(set.temperature_c[i]));
        y.iter_mut().zip(set.signal(i)).for_each(|(y, v)| *y = f64::from(*v) / drive);
        if let Some(response) = self.temperature_response.as_ref().filter(|_| warmer != 0.0) {
            y.iter_mut().zip(response).for_each(|(y, slope)| *y -= warmer * slope);
        }
    }

    /// Learns what temperature does, and nothing else, from signals at other temperatures than its own.
    /// `least_agreeing`: share of them that must agree; `None`: labels say that all are healthy. False:
    /// they do not tell.
    pub fn learn_temperature(&mut self, set: &SignalSet, least_agreeing: Option<f64>) -> bool {
        let agreeing = |share| averaging::agreeing(set, share).map(|keep| set.select(&keep));
        let (Some(reference), Ok(chosen)) =
            (self.temperature_c, least_agreeing.map(agreeing).transpose())
        else {
            return false;
        };
        let (healthy, dt_s) = (chosen.as_ref().unwrap_or(set), self.generator.dt_s);
        let directions = tangent::tangent(&self.identification, dt_s, set.samples);
        let expected = &self.expected;
        let response = tangent::temperature_response(healthy, expected, &directions, reference);
        let changes = response
            .as_ref()
            .and_then(|r| tangent::pole_changes(&self.identification, &directions, r));
        let Some((damping_per_k, frequency_per_k)) = changes else { return false };
        self.temperature_response = response;
        (self.damping_per_k, self.frequency_per_k) = (damping_per_k, frequency_per_k);
        true
    }

    /// What a kelvin adds to a ring's features, whatever rings: a fault's ratios to the healthy ring
    /// hardly depend on temperature, its difference from the healthy signal does.
    pub(super) fn features_per_k(&self, fitter: &RingFitter) -> [f64; 4] {
        let response = self.temperature_response.as_deref();
        response.and_then(|response| fitter.features_of(response)).unwrap_or_default()
    }

    /// ln damping and ln frequency of this model's ring from another's, so much warmer than its window.
    pub(super) fn ring_from(&self, ring: &Ring, warmer: f64) -> [f64; 2] {
        let poles = self.identification.poles;
        [
            (poles.damping_per_s / ring.damping_per_s).ln() + warmer * self.damping_per_k,
            (poles.frequency_hz / ring.frequency_hz).ln() + warmer * self.frequency_per_k,
        ]
    }

    /// A signal per unit drive, at its own temperature, from its deviation. Counts.
    pub(super) fn per_drive(&self, deviation: &[f64], drive: f64, warmer: f64, out: &mut Vec<f64>) {
        out.clear();
        out.extend(self.expected.iter().zip(deviation).map(|(e, d)| e + d / drive));
        if let Some(response) = self.temperature_response.as_ref().filter(|_| warmer != 0.0) {
            out.iter_mut().zip(response).for_each(|(y, slope)| *y += warmer * slope);
        }
    }

    /// K above the model's temperature; 0 where it is unknown or has no effect.
    pub fn warmer(&self, temperature_c: f64) -> f64 {
        match (&self.temperature_response, self.temperature_c) {
            (Some(_), Some(reference)) if temperature_c.is_finite() => temperature_c - reference,
            _ => 0.0,
        }
    }

    /// y_hat at a drive and temperature (NaN: not recorded), counts.
    pub fn expect(&self, drive: f64, temperature_c: f64, out: &mut [f64]) {
        let response = self.temperature_response.as_deref();
        Expectation { y: &self.expected, reference_c: self.temperature_c, response }.at(
            drive,
            temperature_c,
            out,
        );
    }

    /// Calls `see` with the deviation and drive of every signal of a set.
    pub(super) fn each_deviation(&self, set: &SignalSet, see: impl FnMut(&[f64], f64)) {
        let response = self.temperature_response.as_deref();
        Expectation { y: &self.expected, reference_c: self.temperature_c, response }.each(set, see);
    }

    /// Relative drift (frequency, damping) of `later` from this model, beyond what the recorded
    /// temperatures explain where one of the two knows their effect.
    pub fn drift_to(&self, later: &HealthyModel) -> (f64, f64) {
        let knows = if self.temperature_response.is_some() { self } else { later };
        let warmer = match (self.temperature_c, later.temperature_c) {
            (Some(here), Some(there)) => there - here,
            _ => 0.0,
        };
        let (p, q) = (self.identification.poles, later.identification.poles);
        (
            q.frequency_hz / (p.frequency_hz * (1.0 + warmer * knows.frequency_per_k)) - 1.0,
            q.damping_per_s / (p.damping_per_s * (1.0 + warmer * knows.damping_per_k)) - 1.0,
        )
    }

    /// As a model of a design for signals of that sampling.
    pub(super) fn check(&self, sample_period_s: f64, samples: usize) -> Result<(), DesignError> {
        let name = self.printhead.as_deref().unwrap_or("(pooled)");
        let refuse = |what: &str| Err(DesignError::Invalid(format!("model {name}: {what}")));
        let finite = |v: &[f64]| v.len() == samples && v.iter().all(|&x| is_count(x));
        if !finite(&self.expected) {
            return refuse("`expected` must be finite, one number per sample");
        }
        if self.temperature_response.as_ref().is_some_and(|r| !finite(r)) {
            return refuse("`temperature_response` must be finite, one number per sample");
        }
        self.check_numbers().map_err(|(key, value, bounds)| {
            DesignError::Invalid(format!("model {name}: `{key}` = {value:e}: must be {bounds}"))
        })?;
        if !same_period(self.generator.dt_s, sample_period_s) {
            return refuse("its filter has another sample period than the design");
        }
        if !(self.threshold.value.is_finite() && self.threshold.value > 0.0) {
            return refuse("its threshold must be positive");
        }
        if !(self.median_statistic.is_finite() && self.median_statistic > 0.0) {
            return refuse("`median_statistic` must be positive");
        }
        if !self.leftover.is_empty() && !finite(&self.leftover) {
            return refuse("`leftover` must be finite, one number per sample");
        }
        if let Some(decoupled) = &self.decoupled {
            decoupled
                .check(samples)
                .map_err(|what| DesignError::Invalid(format!("model {name}: {what}")))?;
        }
        if let Some(Statistic::Practice(range)) = &self.statistic {
            range.check().map_err(|what| DesignError::Invalid(format!("model {name}: {what}")))?;
        }
        if let Some(misfit) = &self.misfit {
            misfit.check().map_err(|what| DesignError::Invalid(format!("model {name}: {what}")))?;
        }
        if let Some(sensitivity) = &self.sensitivity {
            sensitivity
                .check(samples)
                .map_err(|what| DesignError::Invalid(format!("model {name}: {what}")))?;
        }
        // re-identification carries the threshold over in units of the median
        if !(1e-9..=1e9).contains(&(self.threshold.value / self.median_statistic)) {
            return refuse("its threshold is out of all proportion to `median_statistic`");
        }
        let answer = self.generator.impulse_response(samples);
        let largest = answer.iter().map(|v| v.abs()).fold(0.0, f64::max);
        if !answer.iter().all(|v| v.is_finite()) || largest > MOST_GAIN {
            return refuse("its filter is unstable");
        }
        if largest == 0.0 {
            return refuse("its filter lets nothing through");
        }
        Ok(())
    }
}

/// A number that no training makes: its key, itself, what it must be.
type WrongNumber = (&'static str, f64, &'static str);

impl HealthyModel {
    fn check_numbers(&self) -> Result<(), WrongNumber> {
        let Identification { channel, poles, output_state, acquisition_state, cubic, .. } =
            &self.identification;
        let positive = [
            ("noise", self.noise),
            ("identification.channel.a_per_s2", channel.a_per_s2),
            ("identification.channel.b_per_s2", channel.b_per_s2),
            ("identification.channel.g_per_s", channel.g_per_s),
            ("identification.channel.d_per_s", channel.d_per_s),
            ("identification.poles.damping_per_s", poles.damping_per_s),
            ("identification.poles.frequency_hz", poles.frequency_hz),
            ("identification.poles.lambda_per_s", poles.lambda_per_s),
        ];
        if let Some((key, v)) = positive.into_iter().find(|(_, v)| !is_positive(*v)) {
            return Err((key, v, "1e-30 to 1e30"));
        }
        let within = |key: &'static str, all: &[f64], most: f64, bounds: &'static str| {
            let wrong = all.iter().find(|v| v.is_nan() || v.abs() > most);
            wrong.map_or(Ok(()), |v| Err((key, *v, bounds)))
        };
        let kelvin = "-1 to 1 per K";
        within("damping_per_k", &[self.damping_per_k], 1.0, kelvin)?;
        within("frequency_per_k", &[self.frequency_per_k], 1.0, kelvin)?;
        within("temperature_c", self.temperature_c.as_slice(), 1e4, "a temperature in °C")?;
        let state = "-1e60 to 1e60";
        within("identification.output_state", output_state, 1e60, state)?;
        within("identification.acquisition_state", acquisition_state, 1e60, state)?;
        within("identification.cubic", cubic, 1e60, state)?;
        let Some(sensitivity) = &self.sensitivity else { return Ok(()) };
        let (relative, counts) = ("-1e6 to 1e6", "-1e30 to 1e30");
        within("sensitivity.mean", &sensitivity.mean, 1e6, relative)?;
        within("sensitivity.spread", sensitivity.spread.as_flattened(), 1e6, relative)?;
        within("sensitivity.noise", sensitivity.noise.as_flattened(), 1e30, counts)?;
        sensitivity
            .projection
            .iter()
            .try_for_each(|row| within("sensitivity.projection", row, 1e30, counts))
    }
}

/// What a healthy channel is expected to say.
#[derive(Clone, Copy)]
struct Expectation<'a> {
    y: &'a [f64],
    reference_c: Option<f64>,
    response: Option<&'a [f64]>,
}

impl Expectation<'_> {
    fn at(self, drive: f64, temperature_c: f64, out: &mut [f64]) {
        let warmer = match self.reference_c {
            Some(reference) if temperature_c.is_finite() => temperature_c - reference,
            _ => 0.0,
        };
        match self.response {
            Some(response) if warmer != 0.0 => {
                for ((y, e), slope) in out.iter_mut().zip(self.y).zip(response) {
                    *y = drive * (e + warmer * slope);
                }
            }
            _ => out.iter_mut().zip(self.y).for_each(|(y, e)| *y = drive * e),
        }
    }

    /// Calls `see` with every signal's deviation and drive.
    fn each(self, set: &SignalSet, mut see: impl FnMut(&[f64], f64)) {
        let mut deviation = vec![0.0; set.samples];
        for i in 0..set.len() {
            self.at(set.drive[i], set.temperature_c[i], &mut deviation);
            for (d, &y) in deviation.iter_mut().zip(set.signal(i)) {
                *d = f64::from(y) - *d;
            }
            see(&deviation, set.drive[i]);
        }
    }
}

/// `share`: of the rate of false alarms.
fn learn_threshold(
    energies: &[f64],
    channels: &[u32],
    settings: &DetectSettings,
    share: f64,
) -> Result<Threshold, DesignError> {
    const SEED: u64 = 1;
    Ok(match settings.threshold {
        ThresholdMethod::Max => threshold::max(energies, channels, settings.mu)?,
        ThresholdMethod::Quantile => threshold::quantile(
            energies,
            channels,
            share * settings.false_alarm_rate,
            settings.confidence,
            SEED,
        )?,
    })
}

/// Deviations per unit drive of every signal, counts.
pub(super) fn deviations(sets: &[(&HealthyModel, &SignalSet)]) -> Vec<Vec<f64>> {
    let mut all = Vec::new();
    for (model, set) in sets {
        for i in 0..set.len() {
            let drive = set.drive[i];
            let mut d = vec![0.0; set.samples];
            model.expect(drive, set.temperature_c[i], &mut d);
            for (d, &y) in d.iter_mut().zip(set.signal(i)) {
                *d = (f64::from(y) - *d) / drive;
            }
            all.push(d);
        }
    }
    all
}
