//! What a judge computes with: buffers that are reused from signal to signal, and results beside the
//! decision.

use super::own_channel::Own;
use crate::isolate::calibration::Severity;
use crate::isolate::physics_density::Comparison;
use crate::model::ring_fit::{Fit, Products};
use crate::verdict::Appearance;

/// Buffers of a judge, one set per thread, and results beside the decision on the signal last isolated.
#[derive(Debug, Default)]
pub struct Workspace {
    pub(super) residual: Vec<f64>,
    pub(super) projection: Vec<f64>,
    pub(super) products: Products,
    /// Weight of each class for that signal: a posterior, or what the method has instead.
    pub weights: Vec<f64>,
    /// The probability that the signal is of any class, given all that it may be.
    pub of_any: f64,
    /// What the signal may well be instead of a fault of a class.
    pub alternative: Option<Appearance>,
    /// ln damping and ln frequency of the ring last fitted for isolation, relative to the healthy model's and
    /// corrected to its temperature; `None`: no ring was fitted.
    pub ring: Option<[f64; 2]>,
    /// Severity of the fault of the signal last isolated, if its category was named.
    pub severity: Option<Severity>,
    /// The signal's mean square misfit over the noise's; NaN: no ring was fitted.
    pub misfit: f64,
    /// The ring fitted to the signal.
    pub(super) fit: Option<Fit>,
    /// The signal's misfit beside that ring, N, in standard deviations of the noise; empty: it was not
    /// computed.
    pub(super) beside: Vec<f64>,
    /// Buffer: ln density of the signal's features in each class.
    pub(super) ln_densities: Vec<f64>,
    /// The signal's features compared with all fault curves.
    pub(super) physics: Comparison,
    /// To be set before a signal is isolated: its temperature above the model's ([`super::Judge::warmer`]),
    /// K.
    pub warmer: f64,
    /// To be set before a signal is isolated: its channel's own baseline, if the channel has one.
    pub own: Option<Own>,
}

impl Workspace {
    /// Forgets the results of the signal last isolated.
    pub fn forget(&mut self) {
        (self.severity, self.ring, self.fit, self.misfit) = (None, None, None, f64::NAN);
        self.weights.clear();
        (self.of_any, self.alternative) = (1.0, None);
        self.beside.clear();
    }
}
