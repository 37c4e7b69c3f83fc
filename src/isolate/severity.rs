//! How bad a named fault is.
//!
//! In: the features of a signal's fitted ring, the posterior of the classes. Out: mean and standard
//! deviation of the severity's posterior, from the physics of that kind of fault
//! ([`super::fault_curve`]). Beforehand severities are as likely as in the class's labelled signals; a
//! part of the belief stays on every size of that kind. thesis §2-2, chapter 5 (fault estimation).

use super::fault_curve::Node;
use super::fault_curve::Seen;
use super::physics_density::{FaultCurves, NEGLIGIBLE};

/// A severity in the contract's unit, with its standard deviation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Severity {
    pub value: f64,
    pub sd: f64,
}

impl FaultCurves {
    /// Of a fault of the kind of `class` with these features. `weights`: the posterior of
    /// the classes; those of the same kind add up. `None`: the physics knows no such class.
    pub fn severity(
        &self,
        class: usize,
        features: &[f64],
        seen: Seen,
        weights: &[f64],
    ) -> Option<Severity> {
        let of = self.class(class)?.curve;
        let alike: Vec<(usize, f64)> = (0..weights.len())
            .filter(|&k| weights[k] > 1e-3 && self.class(k).is_some_and(|c| c.curve == of))
            .map(|k| (k, weights[k]))
            .collect();
        let x = self.vector(features);
        let near: Vec<(usize, &Node, f64)> =
            self.near(of, &x, seen).map(|(i, node)| (i, node, node.ln_density(&x, seen))).collect();
        let (mut value, mut square, mut total) = (0.0, 0.0, 0.0);
        for (k, weight) in alike {
            let ln_share = &self.class(k)?.ln_share;
            let ln = |(i, _, ln): &(usize, &Node, f64)| ln + ln_share[*i];
            let most = near.iter().map(ln).fold(f64::NEG_INFINITY, f64::max);
            let mut sum = [0.0; 3];
            for of in near.iter().filter(|of| ln(of) > most - NEGLIGIBLE) {
                let (w, severity) = ((ln(of) - most).exp(), of.1.severity);
                sum[0] += w;
                sum[1] += w * severity;
                sum[2] += w * severity * severity;
            }
            value += weight * sum[1] / sum[0];
            square += weight * sum[2] / sum[0];
            total += weight;
        }
        let value = value / total;
        let variance = (square / total - value * value).max(0.0);
        value.is_finite().then_some(Severity { value, sd: variance.sqrt() })
    }
}
