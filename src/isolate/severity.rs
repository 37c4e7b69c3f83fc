//! How bad a named fault is.
//!
//! In: where on its fault curves a signal may lie, the posterior of the classes. Out: mean and standard
//! deviation of the severity's posterior, from the physics of that kind of fault
//! ([`super::fault_curve`]). Beforehand severities are as likely as in the class's labelled signals; a
//! part of the belief stays on every size of that kind. thesis §2-2, chapter 5 (fault estimation).

use super::node_columns::{self, NODES, Terms};
use super::physics_density::{Comparison, FaultCurves, Sizes};
use crate::processor::for_processor;

/// A severity in the contract's unit, with its standard deviation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Severity {
    pub value: f64,
    pub sd: f64,
}

impl FaultCurves {
    /// Of a signal that is a fault of the kind of `class`. `weights`: the posterior of the classes;
    /// those of the same kind add up. `None`: the physics knows no such class, or it is of several
    /// kinds, whose severities have no common unit.
    pub fn severity(&self, class: usize, weights: &[f64], of: &Comparison) -> Option<Severity> {
        let [Sizes { curve, .. }] = *self.class(class) else { return None };
        let terms = &of.of_curves.get(curve)?.terms;
        let (mut value, mut square, mut total) = (0.0, 0.0, 0.0);
        for (k, weight) in weights.iter().enumerate().filter(|(_, weight)| **weight > 1e-3) {
            let [sizes] = self.class(k) else { continue };
            if sizes.curve != curve {
                continue;
            }
            let [sum, of_value, of_square] = moments(self, sizes, terms);
            value += weight * of_value / sum;
            square += weight * of_square / sum;
            total += weight;
        }
        let value = value / total;
        let variance = (square / total - value * value).max(0.0);
        value.is_finite().then_some(Severity { value, sd: variance.sqrt() })
    }
}

for_processor! {
    /// Sum of a class's terms, of these times the severity, and times its square.
    fn moments(of: &FaultCurves, sizes: &Sizes, terms: &[Terms]) -> [f64; 3] { portable }
}

#[inline(always)] // compiled once per instruction set
fn portable(of: &FaultCurves, sizes: &Sizes, terms: &[Terms]) -> [f64; 3] {
    let [mut sum, mut of_value, mut of_square] = [[0.0; NODES]; 3];
    for Terms { stretch, of: terms } in terms {
        let (share, severity) = (&sizes.share[*stretch], of.severities(sizes.curve, *stretch));
        for i in 0..NODES {
            let w = share[i] * terms[i];
            let weighed = w * severity[i];
            sum[i] += w;
            of_value[i] += weighed;
            of_square[i] += weighed * severity[i];
        }
    }
    [node_columns::sum(&sum), node_columns::sum(&of_value), node_columns::sum(&of_square)]
}
