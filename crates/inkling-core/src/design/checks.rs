//! Validation of a healthy model that was read from a file: whether training could have made it.

use super::error::{DesignError, is_count, is_positive, same_period};
use super::{HealthyModel, Statistic};
use crate::identify::grey_box::Identification;

/// Largest value that a filter's impulse response may have within a signal. Beyond, the filter is unstable: a
/// marginal pair of poles (thesis §3-2-1) rings on but does not grow.
const MOST_GAIN: f64 = 1e6;

/// A number that no training makes: its key in the file, its value, what it must be.
type WrongNumber = (&'static str, f64, &'static str);

impl HealthyModel {
    /// Refuses a model that training could not have made, for a design of signals of that sampling.
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

        // The filter is judged by its impulse response over the length of a signal.
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

    /// Finds a number that is out of its range, if there is one.
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
