//! How far estimated severities lie off the true ones, and their correction.
//!
//! In: severities as the physics estimates them, and as they were labelled. Out: estimates from which the
//! mean error is taken off, and standard deviations that hold the rest. What a fault does may differ from its
//! law by any factor along its curve. No decay tells such a factor, but labels do.

use super::tuned;
use crate::numbers::tuned::few;
use serde::{Deserialize, Serialize};

/// A severity in the contract's unit, with its standard deviation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Severity {
    pub value: f64,
    pub sd: f64,
}

/// How severities by the physics lie off labelled ones: a label is `offset` + `slope` times the estimate, up
/// to an error of standard deviation `sd` beyond the estimate's own.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SizeError {
    pub offset: f64,
    pub slope: f64,
    pub sd: f64,
}

/// The severity of a signal as estimated and as labelled, and the weight of that signal.
#[derive(Clone, Copy, Debug)]
pub struct LabelledSize {
    pub estimated: Severity,
    pub labelled: f64,
    pub weight: f64,
}

/// How the severities of a class are corrected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Calibration {
    /// By what was learned from labelled severities.
    Learned(SizeError),
    /// Where no label tells: the estimate is kept, and what a fault changes is believed to within the
    /// relative error of guessed rates.
    Guessed {
        /// The severity of no fault.
        none: f64,
    },
}

impl Calibration {
    /// The corrected severity, with the standard deviation that the correction leaves.
    pub fn correct(self, estimated: Severity) -> Severity {
        match self {
            Calibration::Learned(error) => error.correct(estimated),
            Calibration::Guessed { none } => {
                let guessed = tuned::guessed_rate() * (estimated.value - none);
                Severity { sd: estimated.sd.hypot(guessed), ..estimated }
            }
        }
    }
}

impl SizeError {
    /// The weighted least-squares line from estimates to labels, and the standard deviation of those
    /// residuals that the estimates' own standard deviations do not explain. `None`: there are too few
    /// signals.
    pub fn learn(signals: &[LabelledSize]) -> Option<SizeError> {
        if signals.len() < few() {
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
        let residual = |s: &LabelledSize| s.labelled - offset - slope * s.estimated.value;
        // two parameters were fitted, so that many degrees of freedom are gone
        let n = signals.len() as f64;
        let rest = mean(&|s| residual(s).powi(2)) * n / (n - 2.0)
            - mean(&|s| (slope * s.estimated.sd).powi(2));
        let sd = rest.max(0.0).sqrt();
        [offset, slope, sd].iter().all(|v| v.is_finite()).then_some(SizeError { offset, slope, sd })
    }

    /// The severity that labels would give; the error beside the line is added to its variance.
    fn correct(self, Severity { value, sd }: Severity) -> Severity {
        let value = self.offset + self.slope * value;
        Severity { value, sd: (self.slope * sd).hypot(self.sd) }
    }

    /// Whether it could have been learned.
    pub fn check(&self) -> bool {
        [self.offset, self.slope, self.sd].iter().all(|v| v.abs() < 1e6) && self.sd >= 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_distr::{Distribution, StandardNormal};

    /// Drawn severities from 1 to 3: the estimate has a standard deviation of .02, and the label is `label`
    /// of the true one with a standard deviation of `rest`.
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
        assert!(off.check() && SizeError::learn(&sizes(7, |s| s, 0.0)).is_none());
    }
}
