//! `isolate.method`, made ready for a model: what tells a deviation's class.

use super::detector::ring_of;
use super::{Design, DesignError, FaultModel, HealthyModel, IsolateSettings};
use crate::isolate::neighbours::Neighbours;
use crate::isolate::posterior::Posterior;
use crate::isolate::typical::{Beside, Typical};
use crate::isolate::{IsolateMethod, IsolateSignal, SignatureMatrix, Simplex};
use crate::model::beside_ring::BesideRing;
use crate::model::ring_fit::{Fit, RingFitter};
use std::sync::Arc;

/// What names a fitted ring.
#[derive(Debug)]
pub(super) struct OfRings {
    pub(super) posterior: Arc<Posterior>,
    pub(super) fitter: RingFitter,
    /// Of each class.
    pub(super) priors: Vec<f64>,
    /// How healthy features change with temperature, per K.
    pub(super) per_k: [f64; 4],
    pub(super) beside: BesideRing,
    pub(super) typical: Option<Arc<Typical>>,
}

/// `isolate.method`, ready for this model.
#[derive(Debug)]
pub(super) enum Isolator {
    /// A fitted ring among class densities.
    Posterior(Box<OfRings>),
    /// thesis §3-3-2: F^T R of the filter r = F d, which projects a deviation as R^T its residual.
    ResidualMatching(SignatureMatrix, Simplex),
    /// thesis §3-3-1: per class its model, if it has one.
    ModelMatching(Vec<Option<FaultModel>>),
    /// thesis §4-3-1
    Neighbours(Neighbours),
}

impl Isolator {
    pub(super) fn new(
        model: &HealthyModel,
        design: &Design,
        settings: &IsolateSettings,
    ) -> Result<Isolator, DesignError> {
        design.check_method(settings.method)?;
        Ok(match settings.method {
            IsolateMethod::Posterior => {
                Isolator::Posterior(Box::new(OfRings::new(model, design, settings)?))
            }
            IsolateMethod::ResidualMatching => {
                Isolator::residual_matching(model, design, settings.signal)?
            }
            IsolateMethod::ModelMatching => {
                Isolator::ModelMatching(design.classes.iter().map(|c| c.model.clone()).collect())
            }
            IsolateMethod::Neighbours => {
                let (mut rows, mut class_of) = (Vec::new(), Vec::new());
                for (k, class) in design.classes.iter().enumerate() {
                    rows.extend(class.examples.iter().map(|e| seen(model, settings.signal, e)));
                    class_of.resize(rows.len(), k as u16); // check(): at most 32 classes
                }
                let (classes, k) = (design.classes.len(), settings.neighbours);
                Isolator::Neighbours(Neighbours::new(&slices(&rows), &class_of, classes, k)?)
            }
        })
    }

    /// rho of every class is the residual of its mean deviation, by this model's filter.
    fn residual_matching(
        model: &HealthyModel,
        design: &Design,
        signal: IsolateSignal,
    ) -> Result<Isolator, DesignError> {
        let rho = design.classes.iter().map(|class| seen(model, signal, &class.deviation));
        let rho: Vec<Vec<f64>> = rho.collect();
        let simplex = Simplex::new(&SignatureMatrix::new(&slices(&rho))?);
        let adjoint: Vec<Vec<f64>> = match signal {
            IsolateSignal::Deviation => rho,
            IsolateSignal::Residual => rho.iter().map(|rho| model.adjoint(rho)).collect(),
        };
        Ok(Isolator::ResidualMatching(SignatureMatrix::new(&slices(&adjoint))?, simplex))
    }
}

/// How a model sees a deviation.
fn seen(model: &HealthyModel, signal: IsolateSignal, deviation: &[f64]) -> Vec<f64> {
    match signal {
        IsolateSignal::Deviation => deviation.to_vec(),
        IsolateSignal::Residual => {
            let mut r = vec![0.0; deviation.len()];
            model.residual(deviation, &mut r);
            r
        }
    }
}

fn slices(of: &[Vec<f64>]) -> Vec<&[f64]> {
    of.iter().map(Vec::as_slice).collect()
}

/// Of a ring with its phase free: mean square that it leaves over the noise's, the same less what
/// signals of a class leave.
pub(super) struct LeftOfRing {
    pub all: f64,
    pub of_class: f64,
}

impl OfRings {
    fn new(
        model: &HealthyModel,
        design: &Design,
        settings: &IsolateSettings,
    ) -> Result<OfRings, DesignError> {
        let untrained = || DesignError::untrained(settings.method);
        let posterior = Arc::new(design.posterior.clone().ok_or_else(untrained)?);
        let (dt_s, samples) = (model.generator.dt_s, model.expected.len());
        let ring = ring_of(&model.identification)?;
        let beside = BesideRing::new(&ring, dt_s, samples);
        let fitter = RingFitter::new(ring, dt_s, samples);
        let priors = settings.prior_weights(&design.class_names())?;
        let per_k = model.features_per_k(&fitter);
        let typical = design.typical.clone().map(Arc::new);
        Ok(OfRings { posterior, fitter, priors, per_k, beside, typical })
    }

    /// A ring's features as they would be that much less warm, K.
    pub(super) fn features(&self, fit: &Fit, warmer: f64) -> [f64; 4] {
        let mut features = fit.features.coordinates();
        features.iter_mut().zip(self.per_k).for_each(|(x, slope)| *x -= warmer * slope);
        features
    }

    /// `y`: per unit drive, counts; `noise`: of a sample of it.
    pub(super) fn left(
        &self,
        y: &[f64],
        fit: &Fit,
        model: &HealthyModel,
        noise: f64,
        class: usize,
    ) -> LeftOfRing {
        let fit = self.fitter.fit_from(y, &fit.features, true).unwrap_or(*fit);
        let shape = &model.leftover;
        let mut left = self.beside.left_without(&self.fitter, y, &fit.features, shape);
        let size = fit.features.ln_amplitude.exp();
        left.iter_mut().for_each(|v| *v /= noise);
        let all = left.iter().map(|v| v * v).sum::<f64>() / left.len() as f64;
        // noise is one at the signal's own drive, and so is its ring
        let of_class = self.typical.as_ref().map_or(all, |typical| {
            let size = size * (model.noise_beside() / noise);
            typical.misfit_of(Beside { left: &left, size }, class)
        });
        LeftOfRing { all, of_class }
    }
}
