//! Whether a design that was just trained can be used: absurd signals (float samples of 1e30, say)
//! give numbers whose squares are not finite, or a filter that is unstable.
//!
//! In: the design. Out: an error with the key of the first such number. A design from a file needs
//! no check, since a checksum says that it is what training wrote (`inkling-io`'s `design_file`);
//! one that a fleet's executor is sent has none, and is checked.

use super::{Design, HealthyModel, Result};
use crate::identify::grey_box::Identification;
use crate::isolate::MAX_CLASSES;
use nalgebra::Matrix4;

/// Largest value that a stable filter's impulse response may have within a signal: a marginal pair
/// of poles (thesis §3-2-1) rings on but does not grow.
const MOST_GAIN: f64 = 1e6;

impl Design {
    pub fn check(&self) -> Result<()> {
        let classes = self.classes.len();
        if classes > MAX_CLASSES {
            return Err(format!("{classes} fault classes: at most {MAX_CLASSES}").into());
        }
        for class in &self.classes {
            let filter = class.model.as_ref().map_or(Ok(()), |model| model.generator.check());
            filter.map_err(|e| format!("class {}: its filter: {e}", class.name))?;
        }
        for model in self.models.iter().chain([&self.pooled]) {
            let name = model.printhead.as_deref().unwrap_or("(pooled)");
            model.check(self.samples).map_err(|what| format!("model {name}: {what}"))?;
        }
        Ok(())
    }
}

impl HealthyModel {
    fn check(&self, samples: usize) -> Result<(), String> {
        let Identification { channel, poles, .. } = &self.identification;
        if self.noise == 0.0 {
            return Err("`noise` = 0: its healthy signals do not differ; were they frozen, the same samples again and \
                 again?".into());
        }
        // so the square and the inverse square of each of these numbers are finite, too
        for (key, v) in [
            ("noise", self.noise),
            ("identification.channel.a_per_s2", channel.a_per_s2),
            ("identification.channel.b_per_s2", channel.b_per_s2),
            ("identification.channel.g_per_s", channel.g_per_s),
            ("identification.channel.d_per_s", channel.d_per_s),
            ("identification.poles.damping_per_s", poles.damping_per_s),
            ("identification.poles.frequency_hz", poles.frequency_hz),
            ("identification.poles.lambda_per_s", poles.lambda_per_s),
            ("threshold", self.threshold.value),
            ("median_statistic", self.median_statistic),
        ] {
            if !(1e-30..=1e30).contains(&v) {
                return Err(format!("`{key}` = {v:e}: must be 1e-30 to 1e30"));
            }
        }
        let mut counts = self.expected.iter().chain(self.temperature_response.iter().flatten());
        if !counts.all(|v| v.abs() <= 1e30) {
            return Err("`expected` or `temperature_response`: must be -1e30 to 1e30".into());
        }
        let of = Matrix4::from(self.channels_per_k.unwrap_or_default());
        let is_covariance = of.amax() <= 1.0
            && of == of.transpose()
            && of.symmetric_eigenvalues().min() >= -1e-9 * of.amax();
        if !is_covariance {
            return Err("`channels_per_k`: must be a covariance of -1 to 1".into());
        }

        self.generator.check().map_err(|e| format!("its filter: {e}"))?;
        let answer = self.generator.impulse_response(samples);
        let largest = answer.iter().map(|v| v.abs()).fold(0.0, f64::max);
        match answer.iter().all(|v| v.is_finite()) && largest <= MOST_GAIN {
            false => Err("its filter is unstable".into()),
            true if largest == 0.0 => Err("its filter lets nothing through".into()),
            true => Ok(()),
        }
    }
}
