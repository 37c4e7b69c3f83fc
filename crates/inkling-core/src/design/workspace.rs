//! What a judge computes with: buffers that are used again, and results beside the decision.
//!
//! Every thread that judges owns one [`Workspace`]. For each signal to isolate it sets `warmer` and
//! `own`, calls [`super::Judge::isolate`] or [`super::Judge::isolate_ring`], and reads the results.
//! For a signal that is not isolated it must call [`Workspace::forget`] before `Judge::ring_of`,
//! `Judge::is_no_ring` or `Judge::appearance`, which use a fit or misfit that they find there.

use super::own_channel::OwnReference;
use crate::isolate::physics_density::Comparison;
use crate::isolate::severity::Severity;
use crate::model::ring_fit::{Fit, FitBuffers};
use crate::verdict::Appearance;

#[derive(Debug, Default)]
pub struct Workspace {
    /// Buffer for a signal or its residual, N, counts.
    pub(super) residual: Vec<f64>,
    /// Buffer: one number per class.
    pub(super) projection: Vec<f64>,
    pub(super) products: FitBuffers,
    /// Weight of each class: the posterior given that the signal is of some class, or phi, or
    /// votes. Empty: no ring explains it. All 0: a method without rings found no class.
    pub weights: Vec<f64>,
    /// The probability that the signal is of any class; 1 with methods that know no alternatives.
    pub of_any: f64,
    /// What the signal may well be instead of a fault of a class.
    pub alternative: Option<Appearance>,
    /// `None`: the signal is of no class, or no law says what its size is.
    pub severity: Option<Severity>,
    /// The mean square, over the noise's variance, of the misfit of the fit; or, where that exceeds
    /// the bound of the best class, of the misfit beside the ring. NaN: no ring was fitted, or it is no more than
    /// noise.
    pub misfit: f64,
    /// The ring fitted to the signal per unit drive; `None`: no ring was fitted.
    pub(super) fit: Option<Fit>,
    /// The misfit beside that ring, N, in standard deviations of the noise; empty: not computed.
    pub(super) beside: Vec<f64>,
    pub(super) ln_densities: Vec<f64>,
    pub(super) physics: Comparison,
    /// To be set before, as `own`: the temperature above the model's ([`super::Judge::warmer`]), K.
    pub warmer: f64,
    pub own: Option<OwnReference>,
}

impl Workspace {
    pub fn forget(&mut self) {
        (self.severity, self.fit, self.misfit) = (None, None, f64::NAN);
        self.weights.clear();
        (self.of_any, self.alternative) = (1.0, None);
        self.beside.clear();
    }

    pub fn drop_name(&mut self) {
        self.weights.clear();
        (self.severity, self.alternative) = (None, None);
    }
}
