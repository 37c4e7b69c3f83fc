//! What a judge computes with.

use super::detector::Scratch;
use super::own_channel::Own;
use crate::isolate::calibration::Severity;
use crate::isolate::physics_density::Comparison;
use crate::model::ring_fit::{Fit, Products, RingFitter};
use crate::verdict::Appearance;

/// Buffers of a judge, one set per thread, and results beside the decision.
#[derive(Debug, Default)]
pub struct Workspace {
    pub(super) residual: Vec<f64>,
    pub(super) projection: Vec<f64>,
    pub(super) products: Products,
    pub(super) detector: Scratch,
    /// Weight of each class, for the signal last isolated.
    pub weights: Vec<f64>,
    /// The probability that it is of any of them, given all that it may be.
    pub of_any: f64,
    /// What else than a class it may well be.
    pub alternative: Option<Appearance>,
    /// ln damping and ln frequency of the ring last fitted for isolation, relative to the healthy model's and
    /// corrected to its temperature; `None`: none was fitted.
    pub ring: Option<[f64; 2]>,
    /// Severity of the signal last isolated, if its category was named.
    pub severity: Option<Severity>,
    /// Its mean square misfit over the noise's; NaN: no ring was fitted.
    pub misfit: f64,
    /// Its fitted ring.
    pub(super) fit: Option<Fit>,
    /// Its misfit beside that ring, N, in standard deviations of the noise; empty: nobody asked.
    pub(super) beside: Vec<f64>,
    /// A fitter about the ring of a judge that has none, for telling of rings; by that judge's number and moves.
    pub(super) told: Option<((u16, u32), RingFitter)>,
    pub(super) ln_densities: Vec<f64>,
    pub(super) physics: Comparison,
    /// To be set for the signal isolated next: [`super::Judge::warmer`], K.
    pub warmer: f64,
    /// To be set for the signal judged next, with `--baseline`: its channel's baseline, if there is one.
    pub own: Option<Own>,
}

impl Workspace {
    /// Forgets the signal last isolated.
    pub fn forget(&mut self) {
        (self.severity, self.ring, self.fit, self.misfit) = (None, None, None, f64::NAN);
        self.weights.clear();
        (self.of_any, self.alternative) = (1.0, None);
        self.beside.clear();
    }
}
