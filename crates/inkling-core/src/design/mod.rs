//! The design: what training makes offline. `replay` can also judge without one.
//!
//! In: healthy and labelled faulty signals of each printhead ([`TrainingSet`]). Out: a [`Design`]:
//! healthy models with filter and threshold, fault classes as mean deviations from these, class
//! densities and the physics of faults. `inkling train` writes it to a file (`schemas/design.md`),
//! and `replay` judges by it. In this crate `identify`, `detect` and `isolate` meet only here.
//!
//! `train` makes a design, `learn` with `learn_distances` a healthy model, `cold_start` what the
//! physics knows of faults; `checks` refuses a trained design that cannot be used. A [`Judge`] is a
//! model of a design made ready for signals: `detector` flags them, `isolator` with `named_ring`
//! names the fault. `own_channel` and `moved_model` make a judge follow channels and printheads that
//! change. `held_out` and `promise` say how good a design is.

mod channel_levels;
mod checks;
mod cold_start;
mod detector;
mod error;
mod extension;
mod fault_class;
mod fd_filter;
mod feature_estimator;
mod gain_steps;
mod healthy_model;
mod held_out;
mod isolator;
mod judge;
mod learn;
mod learn_distances;
mod learned_filter;
mod leftover;
mod moved_model;
mod named_ring;
mod odd_channels;
mod own_channel;
mod promise;
mod reported_ring;
mod residual;
mod rings;
mod temperature;
mod thermometer;
mod train;
mod training_set;
pub mod tuned;
mod typical;
mod workspace;

pub use crate::detect::DetectSettings;
pub use crate::isolate::severity::Severity;
pub use crate::isolate::{Decision as Isolation, IsolateSettings};
pub use detector::{Detection, FirstLook, SensitivityDetector};
pub use error::{DesignError, Result, same_period};
pub use extension::{Covariate, CovariateEffect, Extension};
pub use fault_class::{FaultClass, FaultModel};
pub use fd_filter::{LearnSettings, LearnedFilter};
pub use healthy_model::HealthyModel;
pub use held_out::{ClassReview, Judged};
pub use judge::{Judge, JudgeKey, Tested, Thresholds};
pub use moved_model::ring_from;
pub use own_channel::{Behind, OwnBaseline, OwnBasis, OwnChannels, OwnReference};
pub use training_set::TrainingSet;
pub use workspace::Workspace;

use crate::burst::Burst;
use crate::fault;
use crate::isolate::fault_physics::FaultPhysics;
use crate::isolate::physics_density::FaultCurves;
use crate::isolate::posterior::Posterior;
use crate::isolate::tuned::NO_CLASS;
use crate::isolate::typical::Typical;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock};

/// Version of the design file; a breaking change needs a new number.
pub const VERSION: u32 = 5;

#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Design {
    /// [`VERSION`]; a design of another version is refused.
    pub version: u32,
    /// Program and version, such as `inkling 1.2.3`.
    pub made_by: String,
    pub sample_period_s: f64,
    pub samples: usize,
    /// Reference drive voltage, V, at which the models expect their signals; absent: not recorded.
    pub drive_voltage_v: Option<f64>,
    /// The section `[detect]` of the training; `replay` takes it over.
    pub detect: DetectSettings,
    /// Further settings of the training that are not the default; `replay` takes them over.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub chosen: BTreeMap<String, serde_json::Value>,
    /// What was learned from faults for the FD filter; models of a replay's windows use it, too.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub filter: Option<LearnedFilter>,
    /// Number of signals by label; training left out `unlabelled`, `rejected` and `other_sampling`.
    pub signals: BTreeMap<String, u64>,
    pub models: Vec<HealthyModel>,
    /// The model of all printheads together, for printheads that the design does not know.
    pub pooled: HealthyModel,
    /// The thesis's classes in the order of its tables, then a user's own by name.
    pub classes: Vec<FaultClass>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub extension: Option<Extension>,
    /// Class densities of a fitted ring's features, for `isolate.method` = `posterior`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub posterior: Option<Arc<Posterior>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub typical: Option<Arc<Typical>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub physics: Option<FaultPhysics>,
    /// The fault curves, made of `physics` at the first call of `curves`; to be reset if classes change.
    #[serde(skip)]
    curves: OnceLock<Arc<FaultCurves>>,
}

impl Design {
    pub fn model_of(&self, printhead: &str) -> Option<&HealthyModel> {
        self.models.iter().find(|m| m.printhead.as_deref() == Some(printhead))
    }

    pub fn reference_of(&self, printhead: &str) -> &HealthyModel {
        self.model_of(printhead).unwrap_or(&self.pooled)
    }

    pub fn fits(&self, sample_period_s: f64, samples: usize) -> bool {
        same_period(self.sample_period_s, sample_period_s) && self.samples == samples
    }

    /// Takes the extension off `signal`: the samples, counts, of row `row` of a burst.
    pub fn take_off_extension(&self, burst: &Burst, row: usize, signal: &mut [f64]) {
        if let Some(extension) = &self.extension {
            extension.take_off(burst, row, self.drive_voltage_v, signal);
        }
    }

    /// Made once and shared by all models. `None`: there is no physics, or no posterior to use them.
    pub fn curves(&self) -> Option<Arc<FaultCurves>> {
        let physics = self.physics.as_ref().filter(|_| self.posterior.is_some())?;
        let (dt_s, classes) = (self.sample_period_s, self.fault_classes());
        let make = || Arc::new(physics.curves(&classes, dt_s, self.samples));
        Some(self.curves.get_or_init(make).clone())
    }

    /// Prior probability that a flagged signal is of no class.
    pub fn of_no_class(&self) -> f64 {
        self.curves().map_or(NO_CLASS, |curves| curves.of_no_class())
    }

    pub fn class_names(&self) -> Vec<String> {
        self.classes.iter().map(|c| c.name.clone()).collect()
    }

    /// The classes, with the unit of their severities where a user declared one.
    pub fn fault_classes(&self) -> Vec<fault::Class> {
        let laws = self.physics.as_ref().map(|physics| &physics.laws);
        let class = |of: &FaultClass| {
            let class = of.class();
            let law = laws.and_then(|laws| laws.law(laws.one_kind(&class.of)?));
            fault::Class { unit: law.and_then(|law| law.unit.clone()), ..class }
        };
        self.classes.iter().map(class).collect()
    }
}
