//! Fault estimation: how severe a named fault is.
//!
//! In: a signal compared with the fault curves, and the posterior of the classes. Out: mean and standard
//! deviation of the severity's posterior, by the physics of that kind of fault ([`super::fault_curve`]). The
//! prior is the distribution of severities in the class's labelled signals, mixed with a uniform one over all
//! severities of the kind. Where the severities of many signals were labelled, the error of the physics that
//! they show is taken off. thesis §2-2, chapter 5 (fault estimation).

use super::calibration::Severity;
use super::node_columns::{self, NODES, NodeDensities};
use super::physics_density::{Comparison, FaultCurves, Sizes};
use crate::processor::for_processor;

impl FaultCurves {
    /// The severity of a signal, given that its fault is of the kind of `class`. `weights`: the posterior of
    /// the classes, by which the classes of that kind are weighted. `None`: the physics knows no such class,
    /// or the class is of several kinds, whose severities have no common unit.
    pub fn severity(&self, class: usize, weights: &[f64], of: &Comparison) -> Option<Severity> {
        let [Sizes { curve, .. }] = *self.class(class) else { return None };
        let densities = &of.of_curves.get(curve)?.densities;
        // Moments of the mixture over all classes of the same kind, which differ in their prior of the
        // severity. Classes with negligible weight are left out.
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
            let of_class = self.calibration(k).map_or(of_class, |by| by.correct(of_class));
            value += weight * of_class.value;
            square += weight * (of_class.value.powi(2) + of_class.sd.powi(2));
            total += weight;
        }
        let value = value / total;
        // the variance of the mixture: within the classes and between them
        let variance = (square / total - value * value).max(0.0);
        value.is_finite().then_some(Severity { value, sd: variance.sqrt() })
    }
}

for_processor! {
    /// Moments of order 0, 1 and 2 of the severity under a class's densities.
    fn moments(of: &FaultCurves, sizes: &Sizes, densities: &[NodeDensities]) -> [f64; 3] { portable }
}

#[inline(always)] // compiled once per instruction set
fn portable(of: &FaultCurves, sizes: &Sizes, densities: &[NodeDensities]) -> [f64; 3] {
    let [mut sum, mut of_value, mut of_square] = [[0.0; NODES]; 3];
    for NodeDensities { block, of: densities } in densities {
        let (share, severity) = (&sizes.share[*block], of.severities(sizes.curve, *block));
        for i in 0..NODES {
            let w = f64::from(share[i]) * f64::from(densities[i]);
            let weighed = w * severity[i];
            sum[i] += w;
            of_value[i] += weighed;
            of_square[i] += weighed * severity[i];
        }
    }
    [node_columns::sum(&sum), node_columns::sum(&of_value), node_columns::sum(&of_square)]
}
