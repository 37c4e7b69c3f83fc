//! What temperature does, learned from the recording itself where the design does not know it: a fault
//! library is often recorded at one temperature, and production is not.
//!
//! In: a design, a recording. Out: the design, its models knowing what a kelvin changes. Nothing else
//! of them changes. Only for recordings whose temperatures leave what the models know
//! ([`super::temperature_check`]): it costs a pass over the recording.
//!
//! A pass of its own, since a kelvin's effect is the slope over all temperatures that the recording holds, and
//! judges its first signals, too: in the stream they would be judged before the ink had changed its temperature.

use super::job::Replay;
use super::learner::{HELD_BYTES, offer};
use super::{Control, PipelineError, visit};
use inkling_core::design::Design;
use inkling_core::identify::reservoir::Reservoir;
use inkling_io::recording::Recording;
use std::collections::BTreeMap;

/// Signals that are kept to learn from, of every model.
const FEWEST_HELD: usize = 64;

/// A design that knows what temperature does, and what that is in words, by printhead.
pub(super) type Learned = (Design, Vec<(String, String)>);

impl Replay {
    /// What could be learned; `None`: nothing.
    pub(super) fn learn_temperature(
        &self,
        recording: &Recording,
        control: &Control,
    ) -> Result<Option<Learned>, PipelineError> {
        let Some(design) = &self.design else { return Ok(None) };
        // by the model's place; after the last: the pooled one
        let mut reservoirs: BTreeMap<usize, Reservoir> = BTreeMap::new();
        let pooled = design.models.len();
        let fit = HELD_BYTES / (4 * design.samples.max(1) * (pooled + 1));
        let capacity = self.settings.identify.window_signals.min(fit.max(FEWEST_HELD));
        visit::all(recording, control, |burst| {
            let known = burst.temperature_c.is_some_and(f64::is_finite);
            let samples = burst.samples_per_channel as usize;
            if known && design.fits(burst.sample_period_s, samples) {
                let is_its = |name: &Option<String>| name.as_deref() == Some(&*burst.printhead);
                let place = design.models.iter().position(|m| is_its(&m.printhead));
                let reservoir = reservoirs
                    .entry(place.unwrap_or(pooled))
                    .or_insert_with(|| Reservoir::new(samples, capacity));
                offer(&self.settings, self.labels.as_ref(), Some(design), burst, reservoir);
            }
        })?;
        let mut knowing = design.clone();
        let mut learned = Vec::new();
        for (place, reservoir) in reservoirs {
            let set = reservoir.into_set(design.drive_voltage_v);
            let least_agreeing =
                self.labels.is_none().then_some(self.settings.identify.least_agreeing);
            let model = knowing.models.get_mut(place).unwrap_or(&mut knowing.pooled);
            if model.temperature_response.is_none() && model.learn_temperature(&set, least_agreeing)
            {
                let whose = model
                    .printhead
                    .as_deref()
                    .unwrap_or("printheads that the design does not name");
                let what = format!(
                    "damping {:+.2} %, resonance {:+.3} % per K",
                    100.0 * model.damping_per_k,
                    100.0 * model.frequency_per_k
                );
                learned.push((whose.to_owned(), what));
            }
        }
        Ok((!learned.is_empty()).then_some((knowing, learned)))
    }
}
