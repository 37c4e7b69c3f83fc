//! Fault estimation: how severe a named fault is. thesis §2-2, chapter 5 (fault estimation).
//!
//! In, from `design/named_ring.rs`: a signal compared with the fault curves
//! ([`super::physics_density::Comparison`]), the class that was named, and the posterior of all
//! classes. Out: mean and standard deviation of the severity's posterior. The steps:
//!
//! 1. Within one class: the posterior of the severity is a sum over the nodes of the kind's curve
//!    ([`super::fault_curve`]). The likelihood of a node is the density of the signal's features
//!    there. Its prior is the node's share in the class, a mixture of three: uniform over the
//!    severities that the class's name means, as the severities of its labelled signals are
//!    distributed, and uniform over the whole curve ([`FaultCurves::set`]).
//! 2. The result is calibrated ([`super::calibration`]): where enough severities were labelled, the
//!    mean error of the physics that the labels show is taken off; elsewhere the standard deviation
//!    is raised by what is uncertain of the physics.
//! 3. Classes of the same kind that differ only in degree (slightly, medium, deeply dried) are
//!    mixed by their posterior weights, since none of them may be certain.

use super::calibration::Severity;
use super::node_columns::{self, NODES, NodeDensities};
use super::physics_density::{Comparison, FaultCurves, Sizes};
use crate::processor::for_processor;

impl FaultCurves {
    /// The severity of a signal, given that its fault is of the kind of `class` (an index), in the
    /// unit of that kind. `weights`: the posterior of all classes; here only the ratios within the
    /// kind matter. `of`: the signal as compared with these curves. `None`: the physics knows no
    /// such class; the class is of several kinds, whose severities have no common unit; no class of
    /// the kind has a weight above .001; or the signal is so far from the curve that all its nodes
    /// are negligible.
    pub fn severity(&self, class: usize, weights: &[f64], of: &Comparison) -> Option<Severity> {
        let [Sizes { curve, .. }] = *self.class(class) else { return None };
        let densities = &of.of_curves.get(curve)?.densities;
        // Weighted moments of the mixture over all classes of the same kind (of dried nozzles:
        // slightly, medium, deeply): sums of weight, weight times mean, weight times mean square.
        // The classes share a curve, and differ in their prior of the severity and in their
        // calibration. Classes with negligible weight are left out.
        let (mut value, mut square, mut total) = (0.0, 0.0, 0.0);
        for (k, weight) in weights.iter().enumerate().filter(|(_, weight)| **weight > 1e-3) {
            let [sizes] = self.class(k) else { continue };
            if sizes.curve != curve {
                continue;
            }

            // mean and standard deviation within this class, calibrated
            let [sum, of_value, of_square] = moments(self, sizes, densities);
            let mean = of_value / sum;
            let of_class =
                Severity { value: mean, sd: (of_square / sum - mean * mean).max(0.0).sqrt() };
            let of_class = self.calibration(k).map_or(of_class, |by| by.correct(of_class));
            value += weight * of_class.value;
            square += weight * (of_class.value.powi(2) + of_class.sd.powi(2));
            total += weight;
        }

        // Where no class counts or no node does, this is 0 / 0 and not finite, hence `None`. The
        // variance of the mixture is that within the classes plus that between them.
        let value = value / total;
        let variance = (square / total - value * value).max(0.0);
        value.is_finite().then_some(Severity { value, sd: variance.sqrt() })
    }
}

for_processor! {
    /// Moments of order 0, 1 and 2 of the severity, with share times density as the weight of each
    /// node. The moments are not normalised: a factor that all densities of the curve have in
    /// common cancels when the moment of order 0 is divided out. `sizes`: the class's share of each
    /// node.
    fn moments(of: &FaultCurves, sizes: &Sizes, densities: &[NodeDensities]) -> [f64; 3] { portable }
}

#[inline(always)] // body of `moments`, compiled once per instruction set
fn portable(of: &FaultCurves, sizes: &Sizes, densities: &[NodeDensities]) -> [f64; 3] {
    let [mut sum, mut of_value, mut of_square] = [[0.0; NODES]; 3];
    for NodeDensities { block, of: density } in densities {
        let (share, severity) = (&sizes.share[*block], of.severities(sizes.curve, *block));
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
