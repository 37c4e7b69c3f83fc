//! How bad a named fault is.
//!
//! In: the features of a signal's fitted ring, the class that was named. Out: the mean and the
//! standard deviation of the severity's posterior, from the physics of that kind of fault
//! ([`super::fault_curve`]): every severity from none to the largest is as likely beforehand, whatever
//! the class's name says of size. thesis §2-2, chapter 5 (fault estimation).

use super::fault_curve::FaultCurve;
use nalgebra::Vector4;

/// A severity in the contract's unit, with its standard deviation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Severity {
    pub value: f64,
    pub sd: f64,
}

/// Curves of the design's classes.
#[derive(Clone, Debug)]
pub struct Severities {
    /// Per class its kind's curve; `None`: a user's own class, or a kind that does not ring.
    pub(super) curve_of: Vec<Option<usize>>,
    pub(super) curves: Vec<FaultCurve>,
    pub(super) coordinates: usize,
}

impl Severities {
    /// Of a fault of `class` with these features, at a drive. `None`: the physics knows no such
    /// class.
    pub fn estimate(&self, class: usize, features: &[f64], drive: f64) -> Option<Severity> {
        let curve = &self.curves[(*self.curve_of.get(class)?)?];
        let mut x = Vector4::zeros();
        x.iter_mut().zip(&features[..self.coordinates]).for_each(|(x, f)| *x = *f);
        let (mut most, mut sum, mut first, mut second) = (f64::NEG_INFINITY, 0.0, 0.0, 0.0);
        for node in &curve.nodes {
            let ln = node.ln_density(&x, drive) + node.length.ln();
            if ln > most {
                // scale what was summed to the new largest
                let factor = (most - ln).exp();
                (sum, first, second) = (sum * factor, first * factor, second * factor);
                most = ln;
            }
            if ln > most - 40.0 {
                let w = (ln - most).exp();
                sum += w;
                first += w * node.severity;
                second += w * node.severity * node.severity;
            }
        }
        let value = first / sum;
        let variance = (second / sum - value * value).max(0.0);
        value.is_finite().then_some(Severity { value, sd: variance.sqrt() })
    }
}
