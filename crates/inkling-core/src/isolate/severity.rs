//! Fault estimation: how severe a named fault is. thesis §2-2, chapter 5.
//!
//! In: a signal compared with the fault curves, the class that was named, and the posterior of all
//! classes. Out: mean and standard deviation of the severity's posterior:
//!
//! 1. Within one class a sum over the nodes of the kind's curve ([`super::fault_curve`]): the
//!    density of the features there is the likelihood, the node's share in the class the prior.
//! 2. Widened where no label of the kind has a size: what the fault changes is as uncertain as
//!    guessed rates are, as no decay tells a factor along the curve.
//! 3. Classes of one kind that differ in degree only (slightly, medium, deeply dried) are mixed by
//!    their posterior weights, since none of them may be certain.

use super::node_columns::NodeDensities;
use super::physics_density::{Comparison, FaultCurves, Guess, SeverityPrior};

/// A severity in the unit of its class (`schemas/verdicts.md`), with its standard deviation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Severity {
    pub value: f64,
    pub sd: f64,
}

impl FaultCurves {
    /// In the unit of the kind of `class` (an index). `weights`: the posterior of all classes, of
    /// which the ratios within the kind matter. `None`: the class is of no law or of several kinds,
    /// no class of its kind has a weight above .001, or all nodes are negligible.
    pub fn severity(&self, class: usize, weights: &[f64], of: &Comparison) -> Option<Severity> {
        let [SeverityPrior { curve, .. }] = *self.class(class) else { return None };
        let densities = &of.of_curves.get(curve)?.densities;
        // classes of one kind share a curve, and differ in their prior
        let (mut value, mut square, mut total) = (0.0, 0.0, 0.0);
        for (k, weight) in weights.iter().enumerate().filter(|(_, weight)| **weight > 1e-3) {
            let [sizes] = self.class(k) else { continue };
            if sizes.curve != curve {
                continue;
            }

            let [sum, of_value, of_square] = moments(self, sizes, densities);
            let mean = of_value / sum;
            let Guess { none, share } = self.guesses[curve];
            let guessed = share * (mean - none);
            value += weight * mean;
            square += weight * (of_square / sum + guessed * guessed);
            total += weight;
        }

        // 0 / 0 where no class or no node counts; the variance is that within and between classes
        let value = value / total;
        let variance = (square / total - value * value).max(0.0);
        value.is_finite().then_some(Severity { value, sd: variance.sqrt() })
    }
}

/// Moments of order 0, 1 and 2 of the severity, nodes weighted by share times density.
fn moments(of: &FaultCurves, sizes: &SeverityPrior, densities: &[NodeDensities]) -> [f64; 3] {
    let mut moments = [0.0; 3];
    for NodeDensities { block, of: density } in densities {
        let severities = of.curves[sizes.curve].severities(*block);
        for ((share, density), size) in sizes.share[*block].iter().zip(density).zip(severities) {
            let weight = f64::from(*share) * f64::from(*density);
            moments[0] += weight;
            moments[1] += weight * size;
            moments[2] += weight * size * size;
        }
    }
    moments
}
