//! Labelled signals to a design.

use super::{
    Design, DesignError, DetectSettings, FaultClass, HealthyModel, LearnSettings, VERSION,
};
use crate::identify::GreyBoxSettings;
use crate::identify::averaging::SignalSet;
use std::collections::BTreeMap;

/// Labelled signals of one sampling, by printhead; drives relative to `drive_voltage_v`.
#[derive(Debug, Default)]
pub struct TrainingSet {
    pub sample_period_s: f64,
    pub samples: usize,
    pub drive_voltage_v: Option<f64>,
    pub healthy: BTreeMap<String, SignalSet>,
    /// By class, then printhead.
    pub faulty: BTreeMap<String, BTreeMap<String, SignalSet>>,
    /// Signals seen, by label.
    pub signals: BTreeMap<String, u64>,
}

impl Design {
    /// Learns a model of every printhead and of all together, and a class of every fault label.
    /// Also returns what could not be learned, in words.
    pub fn train(
        set: &TrainingSet,
        grey_box: &GreyBoxSettings,
        detect: &DetectSettings,
    ) -> Result<(Design, Vec<String>), DesignError> {
        // labels say who is healthy
        let settings = LearnSettings {
            grey_box,
            detect,
            least_agreeing: None,
            sample_period_s: set.sample_period_s,
        };
        let pooled = HealthyModel::learn(&pool(&set.healthy, set.samples), None, None, settings)?;
        let (mut models, mut warnings) = (Vec::new(), Vec::new());
        for (name, healthy) in &set.healthy {
            match HealthyModel::learn(healthy, Some(name), None, settings) {
                Ok(model) => models.push(model),
                Err(e) => warnings.push(format!(
                    "printhead {name}: no model of its own ({e}); the pooled one judges it"
                )),
            }
        }
        let mut design = Design {
            version: VERSION,
            made_by: format!("inkling {}", env!("CARGO_PKG_VERSION")),
            sample_period_s: set.sample_period_s,
            samples: set.samples,
            drive_voltage_v: set.drive_voltage_v,
            detect: detect.clone(),
            signals: set.signals.clone(),
            models,
            pooled,
            classes: Vec::new(),
        };
        design.classes = set
            .faulty
            .iter()
            .map(|(class, printheads)| {
                let sets: Vec<(&HealthyModel, &SignalSet)> = printheads
                    .iter()
                    .map(|(name, set)| (design.model_of(name).unwrap_or(&design.pooled), set))
                    .collect();
                FaultClass::learn(class, &sets)
            })
            .collect();
        in_table_order(&mut design.classes);
        design.check()?;
        Ok((design, warnings))
    }
}

/// The thesis's classes in the order of its tables, then a user's own by name.
fn in_table_order(classes: &mut [FaultClass]) {
    let place =
        |name: &str| crate::fault::CLASSES.iter().position(|c| *c == name).unwrap_or(usize::MAX);
    classes.sort_by(|a, b| place(&a.name).cmp(&place(&b.name)).then(a.name.cmp(&b.name)));
}

/// All printheads' signals in one set, their channels told apart.
fn pool(healthy: &BTreeMap<String, SignalSet>, samples: usize) -> SignalSet {
    let mut all = SignalSet::new(samples);
    for (p, set) in healthy.values().enumerate() {
        for i in 0..set.len() {
            let channel = (p as u32).wrapping_mul(1 << 20).wrapping_add(set.channel[i]);
            all.push(set.signal(i), channel, set.drive[i], set.temperature_c[i]);
        }
    }
    all
}
