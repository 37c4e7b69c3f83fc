//! The methods of `isolate.method`, which name the fault of a signal, made ready for one model.
//!
//! In: a healthy model, the fault classes of a design. Out: an [`Isolator`], by which a
//! [`super::Judge`] turns a signal's deviation into one weight per class. Four methods:
//! * posterior (the default): needs a ring fitted to the signal; `named_ring` does the weighing;
//! * residual matching, thesis §3-3-2: min over phi of |R phi - r|, phi >= 0, sum phi = 1;
//! * model matching, thesis §3-3-1: the class whose own filter leaves the least residual energy;
//! * neighbours, thesis §4-3-1: a vote of the nearest training signals.

use super::rings::Rings;
use super::workspace::Workspace;
use super::{Design, DesignError, FaultModel, HealthyModel, IsolateSettings, Result};
use crate::isolate::neighbours::Neighbours;
use crate::isolate::posterior::Posterior;
use crate::isolate::typical::Typical;
use crate::isolate::{
    IsolateMethod, IsolateSignal, MAX_CLASSES, SignatureMatrix, Simplex, model_matching,
};
use crate::model::ring_fit::Fit;
use nalgebra::Vector4;
use std::sync::Arc;

/// What isolation by the features of a fitted ring needs (`isolate.method` = `posterior`).
#[derive(Debug)]
pub(super) struct RingClassifier {
    pub(super) posterior: Arc<Posterior>,
    pub(super) rings: Rings,
    /// Prior weight of each class, in the design's order; they sum to 1.
    pub(super) priors: Vec<f64>,
    /// How the features of a ring change with temperature, per K.
    pub(super) per_k: Vector4<f64>,
    pub(super) typical: Option<Arc<Typical>>,
}

#[derive(Debug)]
pub(super) enum Isolator {
    Posterior(Box<RingClassifier>),
    /// thesis §3-3-2: the adjoint signatures F^T R, for signals without a filter, and the solver.
    ResidualMatching(SignatureMatrix, Simplex),
    /// thesis §3-3-1: the identified model of each class that has one.
    ModelMatching(Vec<Option<FaultModel>>),
    /// thesis §4-3-1: the training signals that are nearest to a signal vote.
    Neighbours(Neighbours),
}

impl Isolator {
    /// An error if the design was not trained with the method.
    pub(super) fn new(
        model: &HealthyModel,
        design: &Design,
        settings: &IsolateSettings,
    ) -> Result<Isolator> {
        design.check_method(settings.method)?;
        Ok(match settings.method {
            IsolateMethod::Posterior => {
                let untrained = || DesignError::untrained(settings.method);
                let rings = model.rings()?;
                Isolator::Posterior(Box::new(RingClassifier {
                    posterior: design.posterior.clone().ok_or_else(untrained)?,
                    priors: settings.prior_weights(&design.class_names())?,
                    per_k: model.features_per_k(&rings.fitter),
                    rings,
                    typical: design.typical.clone(),
                }))
            }
            IsolateMethod::ResidualMatching => {
                Isolator::residual_matching(model, design, settings.signal)?
            }
            IsolateMethod::ModelMatching => {
                Isolator::ModelMatching(design.classes.iter().map(|c| c.model.clone()).collect())
            }
            IsolateMethod::Neighbours => {
                // the training signals of all classes, filtered by this model
                let classes = (0..).zip(&design.classes);
                let labelled =
                    classes.flat_map(|(k, class)| class.examples.iter().map(move |e| (k, e)));
                let examples: Vec<(u16, Vec<f64>)> =
                    labelled.map(|(k, e)| (k, compared(model, settings.signal, e))).collect();
                Isolator::Neighbours(Neighbours::new(&examples, settings.neighbours)?)
            }
        })
    }

    /// Writes the weights of the classes to [`Workspace::weights`], which must come in as one 0 for
    /// each class; not for [`Isolator::Posterior`]. `signal`: what neighbours compare. `None`: no
    /// class fits, or a number is not finite.
    pub(super) fn weigh(
        &self,
        (deviation, drive): (&[f64], f64),
        (model, signal): (&HealthyModel, IsolateSignal),
        work: &mut Workspace,
    ) -> Option<()> {
        let Workspace { residual, projection, weights, .. } = work;
        projection.resize(weights.len(), 0.0); // one number per class
        match self {
            Isolator::Posterior(_) => return None,
            Isolator::ResidualMatching(adjoint, simplex) => {
                adjoint.project(deviation, projection);
                projection.iter_mut().for_each(|c| *c /= drive);
                simplex.solve(projection, weights);
            }
            Isolator::Neighbours(neighbours) => {
                write_compared(model, signal, deviation, residual);
                residual.iter_mut().for_each(|r| *r /= drive);
                neighbours.weigh(residual, weights);
            }
            Isolator::ModelMatching(models) => {
                // infinite beyond the class's bound, or without a model
                for (energy, model) in projection.iter_mut().zip(models) {
                    *energy = model
                        .as_ref()
                        .map(|m| (m.energy(deviation, drive, residual), m.bound))
                        .filter(|(energy, bound)| energy <= bound)
                        .map_or(f64::INFINITY, |(energy, _)| energy);
                }
                // the bounds were applied above, so none are given here
                let best = model_matching::best_class(projection, &[f64::MAX; MAX_CLASSES])?;
                weights[usize::from(best)] = 1.0;
            }
        }
        Some(())
    }

    /// The signature rho of every class is the residual of the class's mean deviation by this
    /// model's filter, or that deviation itself.
    fn residual_matching(
        model: &HealthyModel,
        design: &Design,
        signal: IsolateSignal,
    ) -> Result<Isolator> {
        let rho = design.classes.iter().map(|class| compared(model, signal, &class.deviation));
        let rho: Vec<Vec<f64>> = rho.collect();
        let simplex = Simplex::new(&SignatureMatrix::new(&slices(&rho))?);
        let adjoint: Vec<Vec<f64>> = match signal {
            IsolateSignal::Deviation => rho,
            IsolateSignal::Residual => rho.iter().map(|rho| model.adjoint(rho)).collect(),
        };
        Ok(Isolator::ResidualMatching(SignatureMatrix::new(&slices(&adjoint))?, simplex))
    }
}

impl Design {
    /// Refuses a method of isolation that needs what this design was not trained with.
    pub fn check_method(&self, method: IsolateMethod) -> Result<()> {
        let is_trained = match method {
            IsolateMethod::Posterior => self.posterior.is_some(),
            IsolateMethod::ResidualMatching => true,
            IsolateMethod::ModelMatching => self.classes.iter().any(|c| c.model.is_some()),
            IsolateMethod::Neighbours => self.classes.iter().any(|c| !c.examples.is_empty()),
        };
        if is_trained { Ok(()) } else { Err(DesignError::untrained(method)) }
    }
}

/// Writes to `out` what is compared of a signal, N, counts: the residual of its `deviation` by a
/// model's filter, or the deviation itself.
fn write_compared(
    model: &HealthyModel,
    signal: IsolateSignal,
    deviation: &[f64],
    out: &mut Vec<f64>,
) {
    out.resize(deviation.len(), 0.0);
    match signal {
        IsolateSignal::Residual => model.residual(deviation, out),
        IsolateSignal::Deviation => out.copy_from_slice(deviation),
    }
}

fn compared(model: &HealthyModel, signal: IsolateSignal, deviation: &[f64]) -> Vec<f64> {
    let mut out = Vec::new();
    write_compared(model, signal, deviation, &mut out);
    out
}

fn slices(of: &[Vec<f64>]) -> Vec<&[f64]> {
    of.iter().map(Vec::as_slice).collect()
}

impl RingClassifier {
    /// A fitted ring's features (ln amplitude, ln damping, ln frequency, phase, relative to the
    /// model's ring), corrected for a temperature `warmer` K above the model's.
    pub(super) fn features(&self, fit: &Fit, warmer: f64) -> Vector4<f64> {
        fit.features.coordinates() - warmer * self.per_k
    }
}
