//! Validation of a design that was read from a file: whether training could have made it.
//!
//! In: a [`Design`]. Out: nothing, or an error in words that names the key and its value. Later
//! code relies on what is checked here: row lengths, finite numbers whose squares are finite,
//! positive thresholds, names of their own, at most [`MAX_CLASSES`] classes, stable filters.

use super::error::{is_signal, must, same_period};
use super::{Design, FaultClass, HealthyModel, Result, Statistic, VERSION, other_version};
use crate::detect::sensitivity::Sensitivity;
use crate::fault;
use crate::identify::grey_box::Identification;
use crate::isolate::MAX_CLASSES;
use std::collections::BTreeSet;

/// Largest value that a stable filter's impulse response may have within a signal: a marginal pair
/// of poles (thesis §3-2-1) rings on but does not grow.
const MOST_GAIN: f64 = 1e6;

/// Refuses rows that are no signals: not one number per sample, or numbers that cannot be counts.
fn signals<'a>(
    what: &str,
    rows: impl IntoIterator<Item = &'a Vec<f64>>,
    samples: usize,
) -> Result<(), String> {
    let words = format!("{what} must be finite, one number per sample");
    must(rows.into_iter().all(|row| is_signal(row, samples)), words)
}

fn positive(what: &str, v: f64) -> Result<(), String> {
    must(v.is_finite() && v > 0.0, format!("{what} must be positive"))
}

/// Refuses numbers whose absolute value is above `most`, and NaN. `key`: where they stand in the
/// file; `bounds`: what they must be, in words.
fn within(key: &str, all: &[f64], most: f64, bounds: &str) -> Result<(), String> {
    let wrong = all.iter().find(|v| v.is_nan() || v.abs() > most);
    wrong.map_or(Ok(()), |v| Err(format!("`{key}` = {v:e}: must be {bounds}")))
}

impl Design {
    /// Refuses what training could not have made (hand-edited, damaged or newer files).
    pub fn check(&self) -> Result<()> {
        Ok(self.check_all()?)
    }

    fn check_all(&self) -> Result<(), String> {
        must(self.version == VERSION, other_version(self.version, &self.made_by))?;
        let period = self.sample_period_s;
        positive(&format!("sample_period_s = {period:?}:"), period)?;
        let (classes, samples) = (self.classes.len(), self.samples);
        let words = format!("{classes} fault classes: at most {MAX_CLASSES}");
        must(classes <= MAX_CLASSES, words)?;
        if let Some(v) = self.drive_voltage_v {
            positive(&format!("drive_voltage_v = {v:?}:"), v)?;
        }
        self.detect.check().map_err(|what| format!("detect.{what}"))?;
        self.check_names()?;
        for class in &self.classes {
            class.check(self).map_err(|what| format!("class {}: {what}", class.name))?;
        }
        let extension = self.extension.iter().try_for_each(|of| of.check(samples));
        extension.map_err(|what| format!("extension: {what}"))?;
        self.posterior.iter().try_for_each(|of| of.check(classes))?;
        self.typical.iter().try_for_each(|of| of.check(classes, samples))?;
        self.physics.iter().try_for_each(|of| of.check())?;
        self.filter.iter().try_for_each(|of| of.check())?;
        self.models.iter().chain([&self.pooled]).try_for_each(|model| {
            let name = model.printhead.as_deref().unwrap_or("(pooled)");
            model.check(period, samples).map_err(|what| format!("model {name}: {what}"))
        })
    }

    /// Refuses models or classes without names of their own.
    fn check_names(&self) -> Result<(), String> {
        let mut names = BTreeSet::new();
        for model in &self.models {
            let name = model.printhead.as_ref().ok_or("a model without printhead")?;
            must(names.insert(name), format!("two models of printhead {name}"))?;
        }
        let mut names = BTreeSet::from(["", fault::HEALTHY]);
        self.classes.iter().try_for_each(|FaultClass { name, .. }| {
            let words = "a fault class needs a name of its own, other than `healthy`";
            must(names.insert(name), format!("class \"{name}\": {words}"))
        })
    }
}

impl FaultClass {
    fn check(&self, design: &Design) -> Result<(), String> {
        let samples = design.samples;
        signals("`deviation`", [&self.deviation], samples)?;
        signals("each of its `examples`", &self.examples, samples)?;
        let laws = design.physics.as_ref().map(|physics| &physics.laws);
        let are_laws = laws.is_none_or(|laws| self.of.iter().all(|of| laws.law(of).is_some()));
        must(are_laws, "`of` names what is no law of a fault")?;
        let Some(model) = &self.model else { return Ok(()) };
        signals("its model's `expected`", [&model.expected], samples)?;
        let same = same_period(model.generator.dt_s, design.sample_period_s);
        must(same, "its filter has another sample period than the design")?;
        positive("its model's `bound`", model.bound)
    }
}

impl HealthyModel {
    fn check(&self, sample_period_s: f64, samples: usize) -> Result<(), String> {
        signals("`expected`", [&self.expected], samples)?;
        signals("`temperature_response`", &self.temperature_response, samples)?;
        self.check_numbers()?;
        let same = same_period(self.generator.dt_s, sample_period_s);
        must(same, "its filter has another sample period than the design")?;
        positive("its threshold", self.threshold.value)?;
        positive("`median_statistic`", self.median_statistic)?;
        let leftover = Some(&self.leftover).filter(|leftover| !leftover.is_empty());
        signals("`leftover`", leftover, samples)?;
        self.decoupled.iter().try_for_each(|of| of.check(samples))?;
        if let Some(Statistic::Practice(range)) = &self.statistic {
            range.check()?;
        }
        self.misfit.iter().try_for_each(|of| of.check())?;
        self.sensitivity.iter().try_for_each(|of| of.check(samples))?;
        // windows carry the threshold over in units of the median
        let in_medians = self.threshold.value / self.median_statistic;
        let words = "its threshold is out of all proportion to `median_statistic`";
        must((1e-9..=1e9).contains(&in_medians), words)?;

        // the impulse response over the length of a signal must not grow, nor be 0 throughout
        let answer = self.generator.impulse_response(samples);
        let largest = answer.iter().map(|v| v.abs()).fold(0.0, f64::max);
        let is_stable = answer.iter().all(|v| v.is_finite()) && largest <= MOST_GAIN;
        must(is_stable, "its filter is unstable")?;
        must(largest != 0.0, "its filter lets nothing through")
    }

    fn check_numbers(&self) -> Result<(), String> {
        let Identification { channel, poles, output_state, acquisition_state, cubic, .. } =
            &self.identification;
        let rates = [
            ("noise", self.noise),
            ("identification.channel.a_per_s2", channel.a_per_s2),
            ("identification.channel.b_per_s2", channel.b_per_s2),
            ("identification.channel.g_per_s", channel.g_per_s),
            ("identification.channel.d_per_s", channel.d_per_s),
            ("identification.poles.damping_per_s", poles.damping_per_s),
            ("identification.poles.frequency_hz", poles.frequency_hz),
            ("identification.poles.lambda_per_s", poles.lambda_per_s),
        ];
        // so the square and the inverse square of each of these numbers are finite, too
        for (key, v) in rates {
            let words = format!("`{key}` = {v:e}: must be 1e-30 to 1e30");
            must((1e-30..=1e30).contains(&v), words)?;
        }
        within("damping_per_k", &[self.damping_per_k], 1.0, "-1 to 1 per K")?;
        within("frequency_per_k", &[self.frequency_per_k], 1.0, "-1 to 1 per K")?;
        within("temperature_c", self.temperature_c.as_slice(), 1e4, "a temperature in °C")?;
        let state = "-1e60 to 1e60";
        within("identification.output_state", output_state, 1e60, state)?;
        within("identification.acquisition_state", acquisition_state, 1e60, state)?;
        within("identification.cubic", cubic, 1e60, state)?;

        let Some(Sensitivity { mean, spread, noise, projection, .. }) = &self.sensitivity else {
            return Ok(());
        };
        let (relative, counts) = ("-1e6 to 1e6", "-1e30 to 1e30");
        within("sensitivity.mean", mean, 1e6, relative)?;
        within("sensitivity.spread", spread.as_flattened(), 1e6, relative)?;
        within("sensitivity.noise", noise.as_flattened(), 1e30, counts)?;
        projection.iter().try_for_each(|row| within("sensitivity.projection", row, 1e30, counts))
    }
}
