//! A healthy model and the fault classes as they meet a signal: what rides with every batch.

use super::{Design, DesignError, HealthyModel, IsolateSettings, categories};
use crate::burst::Burst;
use crate::identify::reservoir::relative_drive;
use crate::isolate::{Decision, SignatureMatrix, decide};

/// Judges signals by one model. Built once per model, shared by all workers.
#[derive(Debug)]
pub struct Judge {
    /// Its place in the metadata's `models`.
    pub index: u16,
    pub model: HealthyModel,
    pub reference_v: Option<f64>,
    signatures: Option<SignatureMatrix>,
    category_of_class: Vec<usize>,
    certainty: f64,
}

/// What isolation says of one signal.
pub type Isolation = Decision;

/// Scratch of one worker.
#[derive(Debug, Default)]
pub struct Workspace {
    residual: Vec<f64>,
    pub weights: Vec<f64>,
}

impl Judge {
    /// `design`: its fault classes, if there is one; without, whatever passes stays undecided.
    /// `reference_v`: the drive voltage at which the model expects its signals.
    pub fn new(
        index: u16,
        model: HealthyModel,
        reference_v: Option<f64>,
        design: Option<&Design>,
        settings: &IsolateSettings,
    ) -> Result<Judge, DesignError> {
        let classes = design.map_or(&[][..], |d| &d.classes);
        let residuals: Vec<Vec<f64>> = classes
            .iter()
            .map(|class| {
                let mut rho = vec![0.0; class.deviation.len()];
                model.generator.filter(&class.deviation, &mut rho);
                rho
            })
            .collect();
        let counts: Vec<u64> = classes.iter().map(|c| c.n_signals).collect();
        let names: Vec<String> = classes.iter().map(|c| c.name.clone()).collect();
        let signatures = match residuals.is_empty() {
            true => None,
            false => Some(SignatureMatrix::new(&residuals, &counts)?),
        };
        Ok(Judge {
            index,
            reference_v,
            model,
            signatures,
            category_of_class: categories(&names).1,
            certainty: settings.certainty,
        })
    }

    /// Scale of what is expected of a burst: its drive voltage over the reference.
    pub fn drive(&self, burst: &Burst) -> f64 {
        relative_drive(burst.drive_voltage_v.unwrap_or(f64::NAN), self.reference_v)
    }

    /// y_hat of a burst, counts.
    pub fn expect(&self, burst: &Burst, out: &mut [f64]) {
        self.model.expect(self.drive(burst), burst.temperature_c.unwrap_or(f64::NAN), out);
    }

    pub fn can_isolate(&self) -> bool {
        self.signatures.is_some()
    }

    /// Thesis §3-3-2 on the deviation of a signal from what is expected, counts; `drive` scales the
    /// signatures as it scales the signal.
    pub fn isolate(&self, deviation: &[f64], drive: f64, work: &mut Workspace) -> Option<Isolation> {
        let signatures = self.signatures.as_ref()?;
        work.residual.resize(deviation.len(), 0.0);
        self.model.generator.filter(deviation, &mut work.residual);
        work.residual.iter_mut().for_each(|r| *r /= drive);
        work.weights.resize(self.category_of_class.len(), 0.0);
        signatures.mixture_weights(&work.residual, &mut work.weights);
        Some(decide(&work.weights, &self.category_of_class, self.certainty))
    }
}
