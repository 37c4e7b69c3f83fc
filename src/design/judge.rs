//! A healthy model and the fault classes as they meet a signal: what rides with every batch.

use super::{Design, DesignError, HealthyModel, IsolateSettings};
use crate::burst::Burst;
use crate::detect::kernel::LaneFilter;
use crate::identify::reservoir::relative_drive;
use crate::isolate::{Decision, DecisionRule, SignatureMatrix, Simplex};

/// Judges signals by one model. Built once per model, shared by all workers.
#[derive(Debug)]
pub struct Judge {
    /// Its place in the metadata's `models`.
    pub index: u16,
    pub model: HealthyModel,
    pub reference_v: Option<f64>,
    /// The filter for many signals at once; where there is none, the model's own does the work.
    pub lanes: Option<LaneFilter>,
    isolator: Option<Isolator>,
}

/// Residual matching with this model's filter.
#[derive(Debug)]
struct Isolator {
    /// F^T R of the filter r = F d: projects a deviation as R^T projects its residual.
    adjoint: SignatureMatrix,
    simplex: Simplex,
    rule: DecisionRule,
}

/// What isolation says of one signal.
pub type Isolation = Decision;

/// Scratch of one worker.
#[derive(Debug, Default)]
pub struct Workspace {
    projection: Vec<f64>,
    /// Per class, of the signal last isolated.
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
        let isolator = match design {
            Some(design) if !design.classes.is_empty() => {
                Some(Isolator::new(&model, design, settings.certainty)?)
            }
            _ => None,
        };
        let response = model.temperature_response.as_deref();
        let lanes = LaneFilter::new(&model.generator, &model.expected, response);
        Ok(Judge { index, reference_v, model, lanes, isolator })
    }

    /// Scale of what is expected of a burst: its drive voltage over the reference.
    pub fn drive(&self, burst: &Burst) -> f64 {
        relative_drive(burst.drive_voltage_v.unwrap_or(f64::NAN), self.reference_v)
    }

    /// How much warmer than the model a burst was, as far as that matters. K.
    pub fn warmer(&self, burst: &Burst) -> f64 {
        self.model.warmer(burst.temperature_c.unwrap_or(f64::NAN))
    }

    /// y_hat of a burst, counts.
    pub fn expect(&self, burst: &Burst, out: &mut [f64]) {
        self.model.expect(self.drive(burst), burst.temperature_c.unwrap_or(f64::NAN), out);
    }

    pub fn can_isolate(&self) -> bool {
        self.isolator.is_some()
    }

    /// Thesis §3-3-2 on the deviation of a signal from what is expected, counts; `drive` scales the
    /// signatures as it scales the signal.
    pub fn isolate(
        &self,
        deviation: &[f64],
        drive: f64,
        work: &mut Workspace,
    ) -> Option<Isolation> {
        let Isolator { adjoint, simplex, rule } = self.isolator.as_ref()?;
        work.projection.resize(adjoint.classes(), 0.0);
        work.weights.resize(adjoint.classes(), 0.0);
        // c = R^T r = (F^T R)^T d: without the residual itself
        adjoint.project(deviation, &mut work.projection);
        work.projection.iter_mut().for_each(|c| *c /= drive);
        // lengths agree by construction; a residual that is no number says nothing
        simplex.solve(&work.projection, &mut work.weights).ok()?;
        Some(rule.decide(&work.weights))
    }
}

impl Isolator {
    /// rho of every class is the residual of its mean deviation, by this model's filter.
    fn new(model: &HealthyModel, design: &Design, certainty: f64) -> Result<Isolator, DesignError> {
        let residuals: Vec<Vec<f64>> = design
            .classes
            .iter()
            .map(|class| {
                let mut rho = vec![0.0; class.deviation.len()];
                model.generator.filter(&class.deviation, &mut rho);
                rho
            })
            .collect();
        let columns: Vec<&[f64]> = residuals.iter().map(Vec::as_slice).collect();
        let signatures = SignatureMatrix::new(&columns)?;
        let rule = DecisionRule::new(&design.class_names(), certainty)?;
        let adjoint: Vec<Vec<f64>> =
            residuals.iter().map(|rho| model.generator.adjoint(rho)).collect();
        let columns: Vec<&[f64]> = adjoint.iter().map(Vec::as_slice).collect();
        let adjoint = SignatureMatrix::new(&columns)?;
        Ok(Isolator { simplex: Simplex::new(&signatures), adjoint, rule })
    }
}
