//! A fault that comes and goes: flagged looks too few in a row for the sequential test, and too
//! many in all for false alarms.
//!
//! In: how many looks at a channel were flagged, of how many ([`Flags`]), and the same of all
//! channels of its printhead. Out: the ln likelihood ratio of "flagged for reasons of its own"
//! against "flagged by false alarms" ([`Flags::evidence`]), which `channel` compares with the bound
//! of the sequential test.
//!
//! Flags are taken for independent: with rate q on a healthy channel, and with a share p on a
//! faulty one, which is not known. The ratio is averaged over p = 2 q, 4 q, 8 q, .. below 1:
//!
//! ```text
//! ln mean over p of (p / q)^flagged ((1 - p) / (1 - q))^not_flagged
//! ```
//!
//! With a fixed q the ratio is a test martingale: on a healthy channel whose flags come no more
//! often than at the rate q its ln passes a bound b at any time at all with a probability of at
//! most e^-b (Ville 1939). Here q is taken anew from the other channels at each look, so that holds
//! about, not exactly.

use super::tuned;
use crate::numbers::tuned::least_rate;

/// A number of looks, and how many of them were flagged.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Flags {
    pub looks: u64,
    pub flagged: u64,
}

impl Flags {
    /// Share of the looks that were flagged.
    pub fn share(self) -> f64 {
        self.flagged as f64 / self.looks.max(1) as f64
    }

    /// The ln likelihood ratio that the channel is flagged for reasons of its own. `of_all`: looks
    /// and flags of all channels of its printhead, this one included.
    pub fn evidence(self, of_all: Flags) -> f64 {
        // The rate q of false alarms: `of_others` times that of the other channels, so that what
        // all of them do is no fault of one, and at least `least_rate`.
        let others = Flags {
            looks: of_all.looks.saturating_sub(self.looks),
            flagged: of_all.flagged.saturating_sub(self.flagged),
        };
        let rate = (tuned::of_others() * others.share()).clamp(least_rate(), 0.2);
        let (flagged, not) = (self.flagged as f64, (self.looks - self.flagged) as f64);

        // The likelihood ratio of a share p of flagged looks against that rate, averaged over
        // shares of 2, 4, 8, .. times the rate (in logarithms, with the largest term taken out).
        // The rate is at most .2, so there is at least one share.
        let of_share = |p: f64| flagged * (p / rate).ln() + not * ((-p).ln_1p() - (-rate).ln_1p());
        let shares = std::iter::successors(Some(2.0 * rate), |p| Some(2.0 * p));
        let lns: Vec<f64> = shares.take_while(|p| *p < 1.0).map(of_share).collect();
        let most = lns.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        most + (lns.iter().map(|ln| (ln - most).exp()).sum::<f64>() / lns.len() as f64).ln()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    /// Draws looks at channels that are flagged at a rate, and counts the channels in which the
    /// evidence reaches the bound at any time.
    fn raised(rate: f64, looks: u64, channels: usize, bound: f64) -> usize {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
        let mut of = |_: &usize| {
            let mut flags = Flags::default();
            (0..looks).any(|_| {
                flags.looks += 1;
                let flagged = rng.random_bool(rate);
                flags.flagged += u64::from(flagged);
                flagged && flags.evidence(flags) >= bound
            })
        };
        (0..channels).filter(&mut of).count()
    }

    #[test]
    fn false_alarms_raise_as_seldom_as_the_bound_says_and_seldom_faults_are_raised() {
        // e^-3: 100 of 2,000 at most
        let at_its_rate = raised(least_rate(), 5000, 2000, 3.0);
        assert!(at_its_rate <= 100, "{at_its_rate}");
        assert_eq!(raised(7e-4, 50_000, 1000, 16.1), 0);
        for (rate, looks) in [(0.1, 400), (0.04, 1000), (0.02, 2500)] {
            assert!(raised(rate, looks, 100, 16.1) >= 90, "{rate}");
        }
    }

    #[test]
    fn what_all_channels_do_is_no_fault_of_one() {
        let of_channel = Flags { looks: 1000, flagged: 40 };
        let of_all = Flags { looks: 60_000, flagged: 2400 };
        assert!(of_channel.evidence(of_all) < 0.0);
        assert!(of_channel.evidence(Flags { looks: 60_000, flagged: 60 }) > 16.1);
    }
}
