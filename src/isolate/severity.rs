//! How bad a named fault is.
//!
//! In: where on its fault curves a signal may lie, the posterior of the classes. Out: mean and standard
//! deviation of the severity's posterior, from the physics of that kind of fault
//! ([`super::fault_curve`]). Beforehand severities are as likely as in the class's labelled signals; a
//! part of the belief stays on every size of that kind. thesis §2-2, chapter 5 (fault estimation).

use super::node_columns::NODES;
use super::physics_density::{Comparison, FaultCurves};

/// A severity in the contract's unit, with its standard deviation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Severity {
    pub value: f64,
    pub sd: f64,
}

impl FaultCurves {
    /// Of a signal that is a fault of the kind of `class`. `weights`: the posterior of the classes;
    /// those of the same kind add up. `None`: the physics knows no such class.
    pub fn severity(&self, class: usize, weights: &[f64], of: &Comparison) -> Option<Severity> {
        let curve = self.class(class)?.curve;
        let terms = &of.of_curves.get(curve)?.terms;
        let (mut value, mut square, mut total) = (0.0, 0.0, 0.0);
        for (k, weight) in weights.iter().enumerate().filter(|(_, weight)| **weight > 1e-3) {
            let Some(sizes) = self.class(k).filter(|sizes| sizes.curve == curve) else { continue };
            let mut sums = [[0.0; NODES]; 3];
            for of in terms {
                let (share, severity) =
                    (&sizes.share[of.stretch], self.severities(curve, of.stretch));
                for i in 0..NODES {
                    let w = share[i] * of.of[i];
                    sums[0][i] += w;
                    sums[1][i] += w * severity[i];
                    sums[2][i] += w * severity[i] * severity[i];
                }
            }
            let sum = sums.map(|lanes| lanes.iter().sum::<f64>());
            value += weight * sum[1] / sum[0];
            square += weight * sum[2] / sum[0];
            total += weight;
        }
        let value = value / total;
        let variance = (square / total - value * value).max(0.0);
        value.is_finite().then_some(Severity { value, sd: variance.sqrt() })
    }
}
