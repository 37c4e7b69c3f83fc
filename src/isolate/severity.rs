//! How bad a named fault is.
//!
//! In: where on its fault curves a signal may lie, the posterior of the classes. Out: mean and standard
//! deviation of the severity's posterior, from the physics of that kind of fault
//! ([`super::fault_curve`]). Beforehand severities are as likely as in the class's labelled signals; a
//! part of the belief stays on every size of that kind. thesis §2-2, chapter 5 (fault estimation).

use super::node_columns::{self, NODES, Terms};
use super::physics_density::{Comparison, FaultCurves, Sizes};

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
            let [sum, of_value, of_square] = self.moments(sizes, terms);
            value += weight * of_value / sum;
            square += weight * of_square / sum;
            total += weight;
        }
        let value = value / total;
        let variance = (square / total - value * value).max(0.0);
        value.is_finite().then_some(Severity { value, sd: variance.sqrt() })
    }

    /// Sum of a class's terms, of these times the severity, and times its square.
    fn moments(&self, sizes: &Sizes, terms: &[Terms]) -> [f64; 3] {
        #[cfg(target_arch = "x86_64")]
        {
            // SAFETY: the processor was found to have what is asked of it
            if std::is_x86_feature_detected!("avx512f") {
                return unsafe { x86::with_avx512(self, sizes, terms) };
            }
            // SAFETY: as above
            if std::is_x86_feature_detected!("avx2") {
                return unsafe { x86::with_avx2(self, sizes, terms) };
            }
        }
        moments(self, sizes, terms)
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{FaultCurves, Sizes, Terms, moments};

    #[target_feature(enable = "avx512f")]
    pub fn with_avx512(of: &FaultCurves, sizes: &Sizes, terms: &[Terms]) -> [f64; 3] {
        moments(of, sizes, terms)
    }

    #[target_feature(enable = "avx2")]
    pub fn with_avx2(of: &FaultCurves, sizes: &Sizes, terms: &[Terms]) -> [f64; 3] {
        moments(of, sizes, terms)
    }
}

#[inline(always)] // compiled once per instruction set
fn moments(of: &FaultCurves, sizes: &Sizes, terms: &[Terms]) -> [f64; 3] {
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
