//! Fault estimation: the severity of a named fault.
//!
//! In: a signal compared with the fault curves, the posterior of the classes. Out: mean and standard
//! deviation of the severity's posterior, by the physics of that kind of fault ([`super::fault_curve`]).
//! The prior is the distribution of severities in the class's labelled signals, mixed with a uniform one
//! over all severities of the kind. Where many of these have labelled severities, what the physics is off by is taken off.
//! thesis §2-2, chapter 5 (fault estimation).

use super::node_columns::{self, NODES, NodeDensities};
use super::physics_density::{Comparison, FaultCurves, Sizes};
use crate::processor::for_processor;
use serde::{Deserialize, Serialize};

/// A severity in the contract's unit, with its standard deviation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Severity {
    pub value: f64,
    pub sd: f64,
}

/// How severities by the physics lie off labelled ones: a label is `offset` + `slope` times the estimate, but for a standard
/// deviation of `sd` beyond the estimate's own. What a fault does may differ from its law by any factor along the curve, which
/// no decay tells and labels do.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SizeError {
    pub offset: f64,
    pub slope: f64,
    pub sd: f64,
}

/// A severity as estimated and as labelled, and the weight of that signal.
#[derive(Clone, Copy, Debug)]
pub struct LabelledSize {
    pub estimated: Severity,
    pub labelled: f64,
    pub weight: f64,
}

/// Where no labels tell, the rates are guesses, known to a fifth as in [`super::fault_curve`]: so is what a fault changes.
const GUESSED: f64 = 0.2;

/// How estimated severities lie off the true ones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Calibration {
    Learned(SizeError),
    /// Nobody knows; `none` is the severity of no fault.
    Guessed {
        none: f64,
    },
}

impl Calibration {
    fn correct(self, estimated: Severity) -> Severity {
        match self {
            Calibration::Learned(error) => error.correct(estimated),
            Calibration::Guessed { none } => {
                let guessed = GUESSED * (estimated.value - none);
                Severity { sd: estimated.sd.hypot(guessed), ..estimated }
            }
        }
    }
}

impl SizeError {
    /// Fewer signals tell no line and what lies beside it.
    const FEWEST: usize = 20;

    /// The least-squares line, and what of the residuals the estimates' own standard deviations do not explain.
    pub fn learn(signals: &[LabelledSize]) -> Option<SizeError> {
        if signals.len() < SizeError::FEWEST {
            return None;
        }
        let all: f64 = signals.iter().map(|s| s.weight).sum();
        let mean = |of: &dyn Fn(&LabelledSize) -> f64| {
            signals.iter().map(|s| s.weight * of(s)).sum::<f64>() / all
        };
        let (x, y) = (mean(&|s| s.estimated.value), mean(&|s| s.labelled));
        let square = mean(&|s| (s.estimated.value - x).powi(2));
        let product = mean(&|s| (s.estimated.value - x) * (s.labelled - y));
        let slope = if square > 0.0 { product / square } else { 1.0 };
        let offset = y - slope * x;
        let rest = mean(&|s| {
            let off = s.labelled - offset - slope * s.estimated.value;
            off * off - (slope * s.estimated.sd).powi(2)
        });
        let sd = rest.max(0.0).sqrt();
        [offset, slope, sd].iter().all(|v| v.is_finite()).then_some(SizeError { offset, slope, sd })
    }

    fn correct(self, Severity { value, sd }: Severity) -> Severity {
        let value = self.offset + self.slope * value;
        Severity { value, sd: (self.slope * sd).hypot(self.sd) }
    }

    /// Refused if it could not have been learned.
    pub fn check(&self) -> bool {
        [self.offset, self.slope, self.sd].iter().all(|v| v.abs() < 1e6) && self.sd >= 0.0
    }
}

impl FaultCurves {
    /// The severity of a signal, given that its fault is of the kind of `class`. `weights`: the posterior of
    /// the classes, which weights the classes of that kind. `None`: the physics knows no such class, or it
    /// is of several kinds, whose severities have no common unit.
    pub fn severity(&self, class: usize, weights: &[f64], of: &Comparison) -> Option<Severity> {
        let [Sizes { curve, .. }] = *self.class(class) else { return None };
        let densities = &of.of_curves.get(curve)?.densities;
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

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_distr::{Distribution, StandardNormal};

    fn sizes(n: usize, label: impl Fn(f64) -> f64, rest: f64) -> Vec<LabelledSize> {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(12);
        let mut signal = || {
            let size: f64 = rng.random_range(1.0..3.0);
            let [p, q]: [f64; 2] = std::array::from_fn(|_| StandardNormal.sample(&mut rng));
            let estimated = Severity { value: size + 0.02 * p, sd: 0.02 };
            LabelledSize { estimated, labelled: label(size) + rest * q, weight: 0.5 }
        };
        (0..n).map(|_| signal()).collect()
    }

    #[test]
    fn what_the_physics_is_off_by_is_learned_and_what_it_leaves_is_told() {
        let exact = SizeError::learn(&sizes(2000, |s| s, 0.0)).unwrap();
        assert!((exact.slope - 1.0).abs() < 0.01 && exact.offset.abs() < 0.01, "{exact:?}");
        assert!(exact.sd < 0.01, "{exact:?}");
        let off = SizeError::learn(&sizes(2000, |s| 1.0 + 0.8 * (s - 1.0), 0.05)).unwrap();
        let found = off.correct(Severity { value: 2.0, sd: 0.02 });
        assert!((found.value - 1.8).abs() < 0.01, "{off:?} {found:?}");
        assert!((found.sd - 0.016_f64.hypot(0.05)).abs() < 0.005, "{off:?} {found:?}");
        assert!(off.check() && SizeError::learn(&sizes(19, |s| s, 0.0)).is_none());
    }
}
