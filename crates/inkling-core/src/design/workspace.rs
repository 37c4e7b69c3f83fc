//! What a judge computes with: buffers that are reused from signal to signal, and results beside
//! the decision.
//!
//! Every thread that judges owns one [`Workspace`] (in the filter and isolate stages, and in
//! training); detection uses its buffers alone. For each signal to isolate, the thread sets
//! `warmer` and `own`, calls [`super::Judge::isolate`] or [`super::Judge::isolate_ring`], and then
//! reads the results: `weights`, `of_any`, `alternative`, `ring`, `severity`, `misfit`. The results
//! hold until [`Workspace::forget`] or the next isolation. For a signal that is not isolated,
//! `forget` must be called before `Judge::ring_of`, `Judge::is_no_ring` or `Judge::appearance`:
//! otherwise the fit or the misfit of an earlier signal would serve.

use super::own_channel::Own;
use crate::isolate::calibration::Severity;
use crate::isolate::physics_density::Comparison;
use crate::model::ring_fit::{Fit, FitBuffers};
use crate::verdict::Appearance;

/// Buffers of a judge, one set per thread, and results beside the decision on the signal last
/// isolated.
#[derive(Debug, Default)]
pub struct Workspace {
    /// Buffer for a signal or its residual, N, counts.
    pub(super) residual: Vec<f64>,
    /// Buffer: one number per class, by which the methods without rings weigh the classes.
    pub(super) projection: Vec<f64>,
    /// Buffers of ring fits.
    pub(super) products: FitBuffers,
    /// Weight of each class for the signal last isolated, in the design's order: the posterior
    /// given that the signal is of some class, or phi, or votes. Empty: no ring explains the
    /// signal, or nothing was isolated. All 0: a method without rings found no class.
    pub weights: Vec<f64>,
    /// The probability that the signal is of any class, given all else that it may be; 1 with
    /// methods that know no alternatives.
    pub of_any: f64,
    /// What the signal may well be instead of a fault of a class; `None`: nothing of the kind.
    pub alternative: Option<Appearance>,
    /// ln damping and ln frequency of the ring fitted for isolation, relative to the healthy
    /// model's ring and corrected to the model's temperature; `None`: no ring was fitted, or it is
    /// no more than noise.
    pub ring: Option<[f64; 2]>,
    /// Severity of the fault of the signal last isolated, if its category was named.
    pub severity: Option<Severity>,
    /// The mean square of the signal's misfit over the noise's variance: of the misfit of the fit;
    /// or, where that exceeds the bound of the best class, of the misfit beside the ring. NaN: no
    /// ring was fitted, or the ring is no more than noise.
    pub misfit: f64,
    /// The ring fitted to the signal per unit drive; `None`: no ring was fitted.
    pub(super) fit: Option<Fit>,
    /// The signal's misfit beside that ring, N, in standard deviations of the noise; empty: it was
    /// not computed.
    pub(super) beside: Vec<f64>,
    /// Buffer: ln density of the signal's features in each class.
    pub(super) ln_densities: Vec<f64>,
    /// Buffer: the signal's features compared with all fault curves.
    pub(super) physics: Comparison,
    /// To be set before a signal is isolated: its temperature above the model's
    /// ([`super::Judge::warmer`]), K.
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

    /// Forgets what belongs to the name of the signal last isolated, because the name is dropped:
    /// how the classes were weighed, the severity, and what the signal may be instead. The fitted
    /// ring stays.
    pub fn drop_name(&mut self) {
        self.weights.clear();
        (self.severity, self.alternative) = (None, None);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dropped_name_takes_what_the_signal_may_be_instead_with_it() {
        let mut work = Workspace {
            weights: vec![1.0],
            alternative: Some(Appearance::Slow),
            ring: Some([0.1, 0.2]),
            ..Workspace::default()
        };
        work.drop_name();
        assert!(work.weights.is_empty() && work.severity.is_none() && work.alternative.is_none());
        assert_eq!(work.ring, Some([0.1, 0.2]), "the ring is the signal's, not the name's");
    }
}
