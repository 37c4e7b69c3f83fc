//! Fault estimation: how severe a named fault is. thesis §2-2, chapter 5.
//!
//! In: a signal compared with the fault curves, the class that was named, and the posterior of all
//! classes. Out: mean and standard deviation of the severity's posterior:
//!
//! 1. Within one class a sum over the nodes of the kind's curve ([`super::fault_curve`]): the
//!    density of the features there is the likelihood, the node's share in the class the prior.
//! 2. Calibrated by labels, or widened where there are none ([`super::calibration`]).
//! 3. Classes of one kind that differ in degree only (slightly, medium, deeply dried) are mixed by
//!    their posterior weights, since none of them may be certain.

use super::calibration::Severity;
use super::node_columns::{self, NODES, NodeDensities};
use super::physics_density::{Comparison, FaultCurves, SeverityPrior};
use crate::processor::for_processor;

impl FaultCurves {
    /// In the unit of the kind of `class` (an index). `weights`: the posterior of all classes, of
    /// which the ratios within the kind matter. `None`: the class is of no law or of several kinds,
    /// no class of its kind has a weight above .001, or all nodes are negligible.
    pub fn severity(&self, class: usize, weights: &[f64], of: &Comparison) -> Option<Severity> {
        let [SeverityPrior { curve, .. }] = *self.class(class) else { return None };
        let densities = &of.of_curves.get(curve)?.densities;
        // classes of one kind share a curve, and differ in their prior and their calibration
        let (mut value, mut square, mut total) = (0.0, 0.0, 0.0);
        for (k, weight) in weights.iter().enumerate().filter(|(_, weight)| **weight > 1e-3) {
            let [sizes] = self.class(k) else { continue };
            if sizes.curve != curve {
                continue;
            }

            let [sum, of_value, of_square] = moments(self, sizes, densities);
            let mean = of_value / sum;
            let of_class =
                Severity { value: mean, sd: (of_square / sum - mean * mean).max(0.0).sqrt() };
            let of_class = self.calibrations[k].map_or(of_class, |by| by.correct(of_class));
            value += weight * of_class.value;
            square += weight * (of_class.value.powi(2) + of_class.sd.powi(2));
            total += weight;
        }

        // 0 / 0 where no class or no node counts; the variance is that within and between classes
        let value = value / total;
        let variance = (square / total - value * value).max(0.0);
        value.is_finite().then_some(Severity { value, sd: variance.sqrt() })
    }
}

for_processor! {
    /// Moments of order 0, 1 and 2 of the severity, nodes weighted by share times density.
    fn moments(of: &FaultCurves, sizes: &SeverityPrior, densities: &[NodeDensities]) -> [f64; 3] { portable }
}

#[inline(always)] // body of `moments`, compiled once per instruction set
fn portable(of: &FaultCurves, sizes: &SeverityPrior, densities: &[NodeDensities]) -> [f64; 3] {
    let [mut sum, mut of_value, mut of_square] = [[0.0; NODES]; 3];
    for NodeDensities { block, of: density } in densities {
        let (share, severity) = (&sizes.share[*block], of.curves[sizes.curve].severities(*block));
        for i in 0..NODES {
            let w = f64::from(share[i]) * f64::from(density[i]);
            let weighed = w * severity[i];
            sum[i] += w;
            of_value[i] += weighed;
            of_square[i] += weighed * severity[i];
        }
    }
    [node_columns::sum(&sum), node_columns::sum(&of_value), node_columns::sum(&of_square)]
}
