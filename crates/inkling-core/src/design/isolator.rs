//! The methods of `isolate.method` (how the fault of a flagged signal is named), each made ready
//! for a model.
//!
//! In: a healthy model, the fault classes of a design as training left them. Out: an [`Isolator`],
//! which a [`super::Judge`] holds: it turns a signal's deviation from the expected signal into one
//! weight per class. Four methods:
//! * posterior (the default): needs a ring fitted to the signal; [`super::named_ring`] does the
//!   weighing;
//! * residual matching, thesis §3-3-2: min over phi of |R phi - r|, phi >= 0, sum phi = 1;
//! * model matching, thesis §3-3-1: the class whose own filter leaves the least residual energy;
//! * neighbours, thesis §4-3-1: a vote of the nearest training signals.
//!
//! The last three compare deviations per unit drive with the classes' ones, so they survive another
//! identification of the healthy model.

use super::rings::Rings;
use super::workspace::Workspace;
use super::{
    Design, DesignError, FaultClass, FaultModel, HealthyModel, IsolateSettings, LearnSettings,
};
use crate::identify::averaging::SignalSet;
use crate::isolate::neighbours::Neighbours;
use crate::isolate::posterior::Posterior;
use crate::isolate::typical::Typical;
use crate::isolate::{
    IsolateMethod, IsolateSignal, MAX_CLASSES, SignatureMatrix, Simplex, model_matching,
};
use crate::model::ring_fit::Fit;
use nalgebra::Vector4;
use std::sync::Arc;

/// What isolation by the features of a fitted ring needs (`isolate.method` = `posterior`); used in
/// [`super::named_ring`].
#[derive(Debug)]
pub(super) struct RingClassifier {
    /// The densities of the features in each class.
    pub(super) posterior: Arc<Posterior>,
    /// Fits rings about the healthy ring of the model.
    pub(super) rings: Rings,
    /// Prior weight of each class, in the design's order; they sum to 1.
    pub(super) priors: Vec<f64>,
    /// How the features of a ring, healthy or faulty, change with temperature, per K.
    pub(super) per_k: Vector4<f64>,
    /// Bounds on what signals of each class leave beside their rings; `None`: there are none.
    pub(super) typical: Option<Arc<Typical>>,
}

/// A method of isolation, ready for one model.
#[derive(Debug)]
pub(super) enum Isolator {
    /// A posterior over the classes from the features of a fitted ring.
    Posterior(Box<RingClassifier>),
    /// thesis §3-3-2. The solver of the simplex needs R^T r of a signal's residual r only. It is
    /// computed with the adjoint signatures F^T R in place of R: since r = F d, (F^T R)^T d = R^T
    /// r, so no signal needs to be filtered.
    ResidualMatching(SignatureMatrix, Simplex),
    /// thesis §3-3-1: the identified model of each class that has one.
    ModelMatching(Vec<Option<FaultModel>>),
    /// thesis §4-3-1: the training signals that are nearest to a signal vote.
    Neighbours(Neighbours),
}

impl Isolator {
    /// Makes the isolator of a design's classes for one model, by `settings.method`. An error if
    /// the design was not trained with the method.
    pub(super) fn new(
        model: &HealthyModel,
        design: &Design,
        settings: &IsolateSettings,
    ) -> Result<Isolator, DesignError> {
        design.check_method(settings.method)?;
        Ok(match settings.method {
            IsolateMethod::Posterior => {
                Isolator::Posterior(Box::new(RingClassifier::new(model, design, settings)?))
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
    /// each class. For every method but [`Isolator::Posterior`], which needs a fitted ring.
    /// `deviation`: from the expected signal, N, counts; `drive`: relative; `model`: whose filter
    /// makes the residual; `signal`: whether neighbours compare residuals or deviations (the
    /// signatures of residual matching were made of one of the two in [`Isolator::new`]). `None`:
    /// no class fits, or a number is not finite.
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
                // c = R^T r = (F^T R)^T d, per unit drive: the residual itself is not needed
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
                // Per class the energy that its filter leaves; infinite where that exceeds the
                // class's bound, or where the class has no model.
                for (energy, model) in projection.iter_mut().zip(models) {
                    *energy = model
                        .as_ref()
                        .map(|m| (m.energy(deviation, drive, residual), m.bound))
                        .filter(|(energy, bound)| energy <= bound)
                        .map_or(f64::INFINITY, |(energy, _)| energy);
                }
                // The class with the least energy gets all the weight. The bounds were applied
                // above, so none are given here.
                let best = model_matching::best_class(projection, &[f64::MAX; MAX_CLASSES])?;
                weights[usize::from(best)] = 1.0;
            }
        }
        Some(())
    }

    /// Residual matching, thesis §3-3-2: the signature rho of every class is the residual of the
    /// class's mean deviation by this model's filter, or that deviation itself.
    fn residual_matching(
        model: &HealthyModel,
        design: &Design,
        signal: IsolateSignal,
    ) -> Result<Isolator, DesignError> {
        let rho = design.classes.iter().map(|class| compared(model, signal, &class.deviation));
        let rho: Vec<Vec<f64>> = rho.collect();
        let simplex = Simplex::new(&SignatureMatrix::new(&slices(&rho))?);
        // The columns that a signal's deviation is projected on: F^T rho, or rho itself where
        // deviations are compared.
        let adjoint: Vec<Vec<f64>> = match signal {
            IsolateSignal::Deviation => rho,
            IsolateSignal::Residual => rho.iter().map(|rho| model.adjoint(rho)).collect(),
        };
        Ok(Isolator::ResidualMatching(SignatureMatrix::new(&slices(&adjoint))?, simplex))
    }
}

impl Design {
    /// Refuses a method of isolation that needs what this design was not trained with.
    pub fn check_method(&self, method: IsolateMethod) -> Result<(), DesignError> {
        let is_trained = match method {
            IsolateMethod::Posterior => self.posterior.is_some(),
            IsolateMethod::ResidualMatching => true,
            IsolateMethod::ModelMatching => self.classes.iter().any(|c| c.model.is_some()),
            IsolateMethod::Neighbours => self.classes.iter().any(|c| !c.examples.is_empty()),
        };
        if is_trained { Ok(()) } else { Err(DesignError::untrained(method)) }
    }
}

impl FaultClass {
    /// Learns what the method of isolation needs of a class's labelled signals beside their mean
    /// deviation. `sets`: the class's signals, each set with the healthy model of its printhead.
    pub(super) fn learn_for(
        &mut self,
        isolate: &IsolateSettings,
        pooled: &HealthyModel,
        sets: &[(&HealthyModel, &SignalSet)],
        settings: LearnSettings,
    ) -> Result<(), DesignError> {
        match isolate.method {
            IsolateMethod::Posterior | IsolateMethod::ResidualMatching => {}
            IsolateMethod::ModelMatching => {
                self.learn_model(pooled, sets, isolate.matching_share, settings)?;
            }
            IsolateMethod::Neighbours => self.keep_examples(sets),
        }
        Ok(())
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

/// `write_compared` into a new vector, for the deviation of a class or of a training signal.
fn compared(model: &HealthyModel, signal: IsolateSignal, deviation: &[f64]) -> Vec<f64> {
    let mut out = Vec::new();
    write_compared(model, signal, deviation, &mut out);
    out
}

/// The same rows as slices.
fn slices(of: &[Vec<f64>]) -> Vec<&[f64]> {
    of.iter().map(Vec::as_slice).collect()
}

impl RingClassifier {
    /// The classifier of a design's classes for one model. An error if the design has no posterior.
    fn new(
        model: &HealthyModel,
        design: &Design,
        settings: &IsolateSettings,
    ) -> Result<RingClassifier, DesignError> {
        let untrained = || DesignError::untrained(settings.method);
        let posterior = design.posterior.clone().ok_or_else(untrained)?;
        let rings = model.rings()?;
        let priors = settings.prior_weights(&design.class_names())?;
        let per_k = model.features_per_k(&rings.fitter);
        let typical = design.typical.clone();
        Ok(RingClassifier { posterior, rings, priors, per_k, typical })
    }

    /// A fitted ring's features (ln amplitude, ln damping, ln frequency, phase, relative to the
    /// model's ring), corrected for a temperature `warmer` K above the model's.
    pub(super) fn features(&self, fit: &Fit, warmer: f64) -> Vector4<f64> {
        fit.features.coordinates() - warmer * self.per_k
    }

    /// Mean square of a misfit beside a ring over the noise's, in which what is usual in class
    /// number `class` counts less ([`Typical::misfit_of`]). `beside`: the misfit, N, in standard
    /// deviations of the noise; `fit`: the ring; `noise`: standard deviation of one sample of the
    /// signal per unit drive, counts.
    pub(super) fn misfit_beyond(
        &self,
        beside: &[f64],
        fit: &Fit,
        model: &HealthyModel,
        noise: f64,
        class: usize,
    ) -> f64 {
        let mean_square = || beside.iter().map(|v| v * v).sum::<f64>() / beside.len() as f64;
        self.typical.as_ref().map_or_else(mean_square, |typical| {
            // `typical` states the variances for a ring of the healthy amplitude and the noise at
            // the reference drive. `size` is the amplitude of this signal's ring over the healthy
            // one, each in units of its own noise.
            let size = fit.features.ln_amplitude.exp() * (model.noise_beside() / noise);
            typical.misfit_of(beside, size, class)
        })
    }
}
