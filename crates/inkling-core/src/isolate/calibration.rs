//! How far estimated severities lie off the true ones, and their correction.
//!
//! In, for training: severities of labelled signals as estimated and as labelled. Out: a
//! [`SeverityLine`] per class, which corrects the estimated [`Severity`] of a signal.
//!
//! What a fault does may differ from its law by any factor along its curve, which no decay tells.
//! Where at least `few` labels tell it, a line label = offset + slope estimate is fitted by least
//! squares, and the scatter about it widens the standard deviation. Without labels that is widened
//! by a share of what the fault changes (`guessed_rate`).

use crate::numbers::{FEW, GUESSED_RATE};
use serde::{Deserialize, Serialize};

/// A severity in the unit of its class (`schemas/verdicts.md`), with its standard deviation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Severity {
    pub value: f64,
    pub sd: f64,
}

/// `sd`: standard deviation of a label about the line, beyond the estimate's own.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SeverityLine {
    pub offset: f64,
    pub slope: f64,
    pub sd: f64,
}

#[derive(Clone, Copy, Debug)]
pub struct LabelledSeverity {
    pub estimated: Severity,
    pub labelled: f64,
    /// The weights of a channel's signals add up to 1.
    pub weight: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Calibration {
    Learned(SeverityLine),
    Guessed {
        /// The severity of no fault, in the class's unit.
        none: f64,
    },
}

impl Calibration {
    pub fn correct(self, estimated: Severity) -> Severity {
        match self {
            Calibration::Learned(line) => line.correct(estimated),
            Calibration::Guessed { none } => {
                let guessed = GUESSED_RATE * (estimated.value - none);
                Severity { sd: estimated.sd.hypot(guessed), ..estimated }
            }
        }
    }
}

impl SeverityLine {
    /// `sd` is what is to be expected of a further label about the line (the final prediction error
    /// of Akaike, 1969), beyond the estimates' own. Signals of one channel weigh like one, as they
    /// have in common what is particular to it. `None`: fewer than `few` signals, or of two channels
    /// at most, which a line fits whatever they are.
    pub fn learn(signals: &[LabelledSeverity]) -> Option<SeverityLine> {
        let all: f64 = signals.iter().map(|s| s.weight).sum();
        if signals.len() < FEW || all <= 2.0 {
            return None;
        }
        let mean = |of: &dyn Fn(&LabelledSeverity) -> f64| {
            signals.iter().map(|s| s.weight * of(s)).sum::<f64>() / all
        };

        // where all estimates are equal, only the offset is learned
        let (x, y) = (mean(&|s| s.estimated.value), mean(&|s| s.labelled));
        let square = mean(&|s| (s.estimated.value - x).powi(2));
        let product = mean(&|s| (s.estimated.value - x) * (s.labelled - y));
        let slope = if square > 0.0 { product / square } else { 1.0 };
        let offset = y - slope * x;
        let residual = |s: &LabelledSeverity| s.labelled - offset - slope * s.estimated.value;

        // (n + 2) / (n - 2): the two fitted parameters are uncertain
        let rest = mean(&|s| residual(s).powi(2)) * (all + 2.0) / (all - 2.0)
            - mean(&|s| (slope * s.estimated.sd).powi(2));
        let line = SeverityLine { offset, slope, sd: rest.max(0.0).sqrt() };
        [offset, slope, line.sd].iter().all(|v| v.is_finite()).then_some(line)
    }

    fn correct(self, Severity { value, sd }: Severity) -> Severity {
        let value = self.offset + self.slope * value;
        Severity { value, sd: (self.slope * sd).hypot(self.sd) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_distr::{Distribution, StandardNormal};

    /// Drawn severities from 1 to 3: the estimate has a standard deviation of .02, and the label is `label`
    /// of the true one with a standard deviation of `rest`.
    fn sizes(n: usize, label: impl Fn(f64) -> f64, rest: f64) -> Vec<LabelledSeverity> {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(12);
        let mut signal = || {
            let size: f64 = rng.random_range(1.0..3.0);
            let [p, q]: [f64; 2] = std::array::from_fn(|_| StandardNormal.sample(&mut rng));
            let estimated = Severity { value: size + 0.02 * p, sd: 0.02 };
            LabelledSeverity { estimated, labelled: label(size) + rest * q, weight: 0.5 }
        };
        (0..n).map(|_| signal()).collect()
    }

    #[test]
    fn what_the_physics_is_off_by_is_learned_and_what_it_leaves_is_told() {
        let exact = SeverityLine::learn(&sizes(2000, |s| s, 0.0)).unwrap();
        assert!((exact.slope - 1.0).abs() < 0.01 && exact.offset.abs() < 0.01, "{exact:?}");
        assert!(exact.sd < 0.01, "{exact:?}");
        let off = SeverityLine::learn(&sizes(2000, |s| 1.0 + 0.8 * (s - 1.0), 0.05)).unwrap();
        let found = off.correct(Severity { value: 2.0, sd: 0.02 });
        assert!((found.value - 1.8).abs() < 0.01, "{off:?} {found:?}");
        assert!((found.sd - 0.016_f64.hypot(0.05)).abs() < 0.005, "{off:?} {found:?}");
        assert!(SeverityLine::learn(&sizes(7, |s| s, 0.0)).is_none());
    }

    /// Four channels give ten signals each, and each channel's labels are off by its own amount, of standard deviation
    /// .1. By the prediction error, labels of a fifth channel are as far off as is said, in the mean of many draws.
    #[test]
    fn signals_of_few_channels_promise_no_more_than_channels_keep() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(77);
        let (mut said, mut off) = (0.0, 0.0);
        for _ in 0..2000 {
            let mut signals: Vec<LabelledSeverity> = Vec::new();
            for _ in 0..5 {
                let (size, own): (f64, f64) =
                    (rng.random_range(1.0..3.0), StandardNormal.sample(&mut rng));
                let one = |_| LabelledSeverity {
                    estimated: Severity { value: size, sd: 0.0 },
                    labelled: size + 0.1 * own,
                    weight: 0.1,
                };
                signals.extend((0..10).map(one));
            }
            let fifth = signals.split_off(40)[0];
            let learned = SeverityLine::learn(&signals).unwrap();
            let found = learned.correct(fifth.estimated);
            said += found.sd.powi(2) / 2000.0;
            off += (found.value - fifth.labelled).clamp(-1.0, 1.0).powi(2) / 2000.0;
        }
        assert!((0.5..2.0).contains(&(said / off)), "{said} {off}");
    }
}
