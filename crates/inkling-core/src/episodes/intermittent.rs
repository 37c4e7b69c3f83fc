//! A fault that comes and goes: its flagged looks are too few in a row for the sequential test, and
//! too many in all for false alarms.
//!
//! In: how many looks at a channel were flagged, of how many ([`Flags`]), and the same of the other
//! channels of its printhead ([`QuietLooks`]). Out: the ln likelihood ratio of "flagged for reasons of its own"
//! against "flagged by false alarms" ([`Flags::evidence`]).
//!
//! Flags are taken for independent: with rate q on a healthy channel, and with a share p on a
//! faulty one, which is not known. The ratio is averaged over p = 2 q, 4 q, 8 q, .. below 1:
//!
//! ```text
//! ln mean over p of (p / q)^flagged ((1 - p) / (1 - q))^not_flagged
//! ```
//!
//! With a fixed q the ratio is a test martingale: on a healthy channel, flagged at the rate q at
//! most, its ln passes a bound b with a probability of at most e^-b (Ville 1939). The test begins
//! anew with each flagged look before which the ln is negative; then b is passed in at most e^-b of
//! the looks (the e-detector of Shin, Ramdas and Rinaldo, 2022). Both hold about, as q is taken anew
//! from the other channels at each look.

use super::tuned;
use crate::numbers::LEAST_RATE;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Flags {
    pub looks: u64,
    pub flagged: u64,
}

impl Flags {
    pub fn add(&mut self, flagged: bool) {
        self.looks += 1;
        self.flagged += u64::from(flagged);
    }

    fn without(self, those: Flags) -> Flags {
        let looks = self.looks.saturating_sub(those.looks);
        Flags { looks, flagged: self.flagged.saturating_sub(those.flagged) }
    }

    pub fn share(self) -> f64 {
        self.flagged as f64 / self.looks.max(1) as f64
    }

    pub fn begin_anew(self, others: Flags) -> bool {
        self.flagged == 0 || self.evidence(others) < 0.0
    }

    /// `others`: looks at the printhead's other channels ([`QuietLooks::of_others`]).
    pub fn evidence(self, others: Flags) -> f64 {
        // The rate q: what all channels do is no fault of one. The upper bound is somewhat arbitrary.
        let rate = (tuned::OF_OTHERS * others.share()).clamp(LEAST_RATE, 0.2);
        let (flagged, not) = (self.flagged as f64, (self.looks - self.flagged) as f64);

        let of_share = |p: f64| flagged * (p / rate).ln() + not * ((-p).ln_1p() - (-rate).ln_1p());
        let shares = std::iter::successors(Some(2.0 * rate), |p| Some(2.0 * p));
        let lns: Vec<f64> = shares.take_while(|p| *p < 1.0).map(of_share).collect();
        let most = lns.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        most + (lns.iter().map(|ln| (ln - most).exp()).sum::<f64>() / lns.len() as f64).ln()
    }
}

/// The looks at each channel of a printhead while no episode was on in it.
#[derive(Clone, Debug, Default)]
pub struct QuietLooks {
    of: Vec<Flags>,
    /// Those three quarters of the channels that are flagged most seldom, as others may have faults that come and go,
    /// and the largest share among them.
    seldom: Flags,
    largest: f64,
    /// Number of looks until these are taken anew: once for as many looks as there are channels, as it takes a while.
    until: usize,
}

impl QuietLooks {
    pub fn add_channel(&mut self) {
        self.of.push(Flags::default());
    }

    pub fn begin_anew(&mut self) {
        self.of.fill(Flags::default());
        self.until = 0;
    }

    /// `place`: the index of the channel.
    pub fn add(&mut self, place: usize, flagged: bool) {
        self.of[place].add(flagged);
        self.until = self.until.saturating_sub(1);
    }

    /// Number of looks at a channel.
    pub fn looks(&self, place: usize) -> u64 {
        self.of[place].looks
    }

    /// The looks at the other channels that tell how often healthy ones are flagged. `place`: the index of the channel,
    /// whose own looks do not count.
    pub fn of_others(&mut self, place: usize) -> Flags {
        if self.until == 0 {
            let mut all = self.of.clone();
            let kept = (all.len() - all.len() / 4).max(1);
            all.select_nth_unstable_by(kept - 1, |a, b| a.share().total_cmp(&b.share()));
            self.largest = all[kept - 1].share();
            self.seldom = all[..kept].iter().fold(Flags::default(), |sum, of| Flags {
                looks: sum.looks + of.looks,
                flagged: sum.flagged + of.flagged,
            });
            self.until = all.len();
        }
        let own = self.of[place];
        if own.share() > self.largest { self.seldom } else { self.seldom.without(own) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    /// Draws looks at channels that are flagged at the first rate for the first number of looks, and at the
    /// second rate for the second number. Returns how often the evidence reached the bound, after which the test
    /// begins anew, and in how many channels it did while the second rate held.
    fn raised(parts: [(f64, u64); 2], channels: usize, bound: f64) -> (usize, usize) {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
        let others = Flags { looks: 1_000_000, flagged: 0 };
        let (mut times, mut found) = (0, 0);
        for _ in 0..channels {
            let (mut flags, mut in_part) = (Flags::default(), [false; 2]);
            for ((rate, looks), in_part) in parts.into_iter().zip(&mut in_part) {
                for _ in 0..looks {
                    let flagged = rng.random_bool(rate);
                    if flagged && flags.begin_anew(others) {
                        flags = Flags::default();
                    }
                    flags.add(flagged);
                    if flagged && flags.evidence(others) >= bound {
                        (times, flags, *in_part) = (times + 1, Flags::default(), true);
                    }
                }
            }
            found += usize::from(in_part[1]);
        }
        (times, found)
    }

    #[test]
    fn false_alarms_raise_as_seldom_as_the_bound_says_and_seldom_faults_are_raised() {
        let healthy =
            |rate, looks, channels, bound| raised([(rate, looks), (rate, 0)], channels, bound).0;
        // in e^-8 of the looks, 1677 of five million, at most
        let at_its_rate = healthy(LEAST_RATE, 5000, 1000, 8.0);
        assert!(at_its_rate <= 1677, "{at_its_rate}");
        assert_eq!(healthy(7e-4, 50_000, 1000, 16.1), 0);
        // whatever healthy past the channel has
        for past in [0, 1000, 100_000] {
            for (rate, looks) in [(0.1, 400), (0.04, 1000), (0.02, 2500)] {
                let (_, found) = raised([(7e-4, past), (rate, looks)], 100, 16.1);
                assert!(found >= 90, "{rate} after {past}: {found}");
            }
        }
    }

    #[test]
    fn channels_that_come_and_go_together_hide_none_of_each_other() {
        let flags = |flagged: u64| Flags { looks: 200, flagged };
        let evidence = |of: Vec<Flags>, place: usize| {
            let own = of[place];
            own.evidence(QuietLooks { of, ..QuietLooks::default() }.of_others(place))
        };
        let (healthy, faulty) = (vec![flags(0); 52], vec![flags(20); 12]);
        assert!(evidence([healthy, faulty].concat(), 60) > 16.1);
        // what most channels do, and every channel of a small printhead
        assert!(evidence([vec![flags(0); 20], vec![flags(20); 44]].concat(), 60) < 0.0);
        assert!(evidence(vec![flags(20), flags(19)], 0) < 0.0);
        assert!(evidence(vec![flags(20)], 0) > 16.1, "it has no neighbours");
    }

    #[test]
    fn what_all_channels_do_is_no_fault_of_one() {
        let of_channel = Flags { looks: 1000, flagged: 40 };
        let others = Flags { looks: 60_000, flagged: 2400 };
        assert!(of_channel.evidence(others) < 0.0);
        assert!(of_channel.evidence(Flags { looks: 60_000, flagged: 60 }) > 16.1);
    }
}
