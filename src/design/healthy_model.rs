//! A healthy model ready to judge by: identification, filter and threshold of one window.

use super::{Design, DesignError, DetectSettings};
use crate::detect::{ResidualGenerator, ThresholdMethod, null_space, poles, threshold};
use crate::identify::averaging::{self, SignalSet, median};
use crate::identify::grey_box::{self, Identification};
use crate::identify::{GreyBoxSettings, tangent};
use crate::model::Plant;
use serde::{Deserialize, Serialize};
use threshold::Threshold;

/// A filter that answers one count with more within a signal is unstable: its marginal pair of
/// poles (thesis §3-2-1) rings on and does not grow.
const MOST_GAIN: f64 = 1e6;

/// What a healthy model is learned with.
#[derive(Clone, Copy, Debug)]
pub struct LearnSettings<'a> {
    pub grey_box: &'a GreyBoxSettings,
    pub detect: &'a DetectSettings,
    /// Least share of signals that must agree; `None`: labels say that all are healthy.
    pub least_agreeing: Option<f64>,
    pub sample_period_s: f64,
}

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
    /// y_hat = C e^{At} x_a_hat at the reference drive, counts.
    pub expected: Vec<f64>,
    /// d y_hat / d temperature, counts/K; absent: not recorded or no significant effect.
    pub temperature_response: Option<Vec<f64>>,
    /// Relative change of damping and of resonance per K.
    pub damping_per_k: f64,
    pub frequency_per_k: f64,
    pub generator: ResidualGenerator,
    pub threshold: Threshold,
    /// Median residual energy of the window's signals, counts²·s.
    pub median_energy: f64,
}

impl HealthyModel {
    /// Learns from a healthy window. `anchor`: the model that came before, which passes on what one
    /// window cannot know (temperature response, tail of the energies).
    pub fn learn(
        set: &SignalSet,
        printhead: Option<&str>,
        anchor: Option<&HealthyModel>,
        settings: LearnSettings,
    ) -> Result<HealthyModel, DesignError> {
        let chosen;
        let healthy = match settings.least_agreeing {
            None => set,
            Some(share) => {
                chosen = set.select(&averaging::agreeing(set, share)?);
                &chosen
            }
        };
        let mean = averaging::average(healthy)?;
        let dt_s = settings.sample_period_s;
        let identification =
            grey_box::identify(&mean.y, dt_s, mean.standard_error(), settings.grey_box)?;
        let expected = identification.expected(dt_s, set.samples);
        let generator = residual_generator(&identification, set.samples, dt_s, settings.detect)?;

        let temperature_c = healthy.mean_temperature_c();
        let directions = tangent::tangent(&identification, dt_s, set.samples);
        let temperature_response = match anchor {
            Some(anchor) => anchor.temperature_response.clone(),
            None => temperature_c.and_then(|reference| {
                tangent::temperature_response(healthy, &expected, &directions, reference)
            }),
        };
        let (damping_per_k, frequency_per_k) = temperature_response
            .as_ref()
            .and_then(|response| tangent::pole_changes(&identification, &directions, response))
            .unwrap_or((0.0, 0.0));

        let expectation = Expectation {
            y: &expected,
            reference_c: temperature_c,
            response: temperature_response.as_deref(),
        };
        let energies = energies(expectation, &generator, healthy);
        let median_energy = median(&mut energies.clone());
        let threshold = match anchor.filter(|_| settings.least_agreeing.is_some()) {
            // Nobody says that the window is free of slight faults, so its own tail cannot be
            // trusted; its median can. The anchor's tail is carried over, in units of the median.
            Some(anchor) => anchor.threshold.scaled(median_energy / anchor.median_energy),
            None => learn_threshold(&energies, &healthy.channel, settings.detect)?,
        };
        Ok(HealthyModel {
            printhead: printhead.map(str::to_owned),
            valid_from_ns: None,
            n_signals: mean.n_signals,
            n_channels: mean.n_channels,
            scatter: mean.scatter,
            noise: mean.noise,
            temperature_c,
            identification,
            expected,
            temperature_response,
            damping_per_k,
            frequency_per_k,
            generator,
            threshold,
            median_energy,
        })
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

    /// Relative drift (frequency, damping) of `later` from this model, beyond what the recorded
    /// temperatures explain where their effect is known.
    pub fn drift_to(&self, later: &HealthyModel) -> (f64, f64) {
        let warmer = match (self.temperature_c, later.temperature_c) {
            (Some(here), Some(there)) => there - here,
            _ => 0.0,
        };
        let (p, q) = (self.identification.poles, later.identification.poles);
        (
            q.frequency_hz / (p.frequency_hz * (1.0 + warmer * self.frequency_per_k)) - 1.0,
            q.damping_per_s / (p.damping_per_s * (1.0 + warmer * self.damping_per_k)) - 1.0,
        )
    }

    pub(super) fn check(&self, design: &Design) -> Result<(), DesignError> {
        let name = self.printhead.as_deref().unwrap_or("(pooled)");
        let refuse = |what: &str| Err(DesignError::Invalid(format!("model {name}: {what}")));
        let finite = |v: &[f64]| v.len() == design.samples && v.iter().all(|&x| super::is_count(x));
        if !finite(&self.expected) {
            return refuse("`expected` must be finite, one number per sample");
        }
        if self.temperature_response.as_ref().is_some_and(|r| !finite(r)) {
            return refuse("`temperature_response` must be finite, one number per sample");
        }
        if !super::same_period(self.generator.dt_s, design.sample_period_s) {
            return refuse("its filter has another sample period than the design");
        }
        if !(self.threshold.value.is_finite() && self.threshold.value > 0.0) {
            return refuse("its threshold must be positive");
        }
        if !(self.median_energy.is_finite() && self.median_energy > 0.0) {
            return refuse("`median_energy` must be positive");
        }
        // re-identification carries the threshold over in units of the median
        if !(1e-9..=1e9).contains(&(self.threshold.value / self.median_energy)) {
            return refuse("its threshold is out of all proportion to `median_energy`");
        }
        let answer = self.generator.impulse_response(design.samples);
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
}

/// Residual energy of every signal of a set, counts²·s.
fn energies(expectation: Expectation, generator: &ResidualGenerator, set: &SignalSet) -> Vec<f64> {
    let mut deviation = vec![0.0; set.samples];
    (0..set.len())
        .map(|i| {
            expectation.at(set.drive[i], set.temperature_c[i], &mut deviation);
            for (d, &y) in deviation.iter_mut().zip(set.signal(i)) {
                *d = f64::from(y) - *d;
            }
            generator.energy(&deviation)
        })
        .collect()
}

/// The FD filter of an identified model: numerator (3-2), denominator §3-2-1.
fn residual_generator(
    identification: &Identification,
    samples: usize,
    dt_s: f64,
    settings: &DetectSettings,
) -> Result<ResidualGenerator, DesignError> {
    let plant = identification.channel;
    let degree = 2 + settings.other_poles_per_s.len();
    let numerator = null_space::numerator(&plant.a(), &plant.c(), dt_s, degree)?;
    let oscillations = settings.oscillations.unwrap_or_else(|| {
        poles::healthy_oscillations(identification.poles.frequency_hz, samples, dt_s)
    });
    let omega_r = poles::resonance_of_oscillations(oscillations, samples, dt_s);
    let denominator = poles::resonance(omega_r, &settings.other_poles_per_s, dt_s)?;
    Ok(ResidualGenerator::new(numerator, denominator, dt_s)?)
}

fn learn_threshold(
    energies: &[f64],
    channels: &[u32],
    settings: &DetectSettings,
) -> Result<Threshold, DesignError> {
    const SEED: u64 = 1;
    Ok(match settings.threshold {
        ThresholdMethod::Max => threshold::max(energies, channels, settings.mu)?,
        ThresholdMethod::Quantile => threshold::quantile(
            energies,
            channels,
            settings.false_alarm_rate,
            settings.confidence,
            SEED,
        )?,
    })
}
