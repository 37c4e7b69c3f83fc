//! What is known of one channel: where it lies from its head's level while it is healthy, where
//! while it is faulty, and how probable it is that it is faulty now, in canonical coordinates.
//!
//! In: sweep by sweep a look, less the head's level, and what `level` puts it down to; pauses; how
//! far the channel has moved beside others. Out: healthy and faulty mean, probability of a fault.
//!
//! When a day is over, the mean of its healthy looks is added to three means over about 4, 16 and 64
//! days (`RUNG_DAYS`), as at most 1 / `between`² looks, because a channel differs by `between` from
//! day to day. So a slow fault is seen as a distance of today's mean from that of long ago.

use super::kind::Features;
use super::process::{self, DAY_NS, DRIFTED, ODD_ONE, RUNG_DAYS};
use nalgebra::Vector4;
use serde::{Deserialize, Serialize};

/// The mean of some looks and how many they are, kept as sums, to which a look is simply added.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sum {
    /// Sum of the looks' precisions: how many looks at the reference drive they are worth.
    pub looks: f64,
    pub sum: [f64; 4],
    /// Sum over looks of how many K warmer than the model's reference they were, each times its precision.
    pub kelvins: f64,
}

impl Sum {
    /// `share`: of the look that is put down to what the mean is of.
    fn add(&mut self, look: &FromLevel, share: f64) {
        let looks = share * look.looks;
        let (sum, kelvins) = ((looks * look.at).into(), looks * look.warmer);
        self.absorb(&Sum { looks, sum, kelvins });
    }

    fn absorb(&mut self, other: &Sum) {
        self.looks += other.looks;
        self.kelvins += other.kelvins;
        self.sum.iter_mut().zip(other.sum).for_each(|(sum, of)| *sum += of);
    }

    /// The mean of the looks; zero if there are none.
    pub fn mean(&self) -> Features {
        Vector4::from(self.sum) / self.looks.max(f64::MIN_POSITIVE)
    }

    /// How many K warmer than the model's reference the looks were in the mean.
    pub fn warmer(&self) -> f64 {
        self.kelvins / self.looks.max(f64::MIN_POSITIVE)
    }

    /// Of a channel expected about zero with the variance `spread`; `noise`: of one look. With n
    /// looks the variance is 1 / (1/spread + n/noise), the mean that times sum / noise.
    pub fn posterior(&self, spread: &Features, noise: &Features) -> (Features, Features) {
        let shrunk = spread.zip_map(noise, |s2, v| s2 / (v + self.looks * s2));
        (shrunk.component_mul(&Vector4::from(self.sum)), shrunk.component_mul(noise))
    }

    /// Lets the mean count as at most `looks` looks, so that later looks weigh more.
    fn at_most(&mut self, looks: f64) {
        if self.looks > looks {
            let by = looks / self.looks;
            self.looks = looks;
            self.kelvins *= by;
            self.sum.iter_mut().for_each(|v| *v *= by);
        }
    }
}

/// What is known of one channel, all positions from the level that its head had at each look.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Channel {
    /// Means of the healthy looks before today, over about so many days each as [`RUNG_DAYS`] says.
    pub past: [Sum; RUNGS],
    /// The channel's healthy looks of the day that is not over yet.
    pub today: Sum,
    /// When today's first look was, ns; `i64::MAX`: there was none yet.
    pub day_from_ns: i64,
    /// The looks at the fault that the channel has, or had last: about the last `of_beginning`.
    pub faulty: Sum,
    /// How many looks that fault has had since it began.
    pub faulty_looks: f64,
    pub faulty_days: f64,
    /// Probability that the channel is faulty before the next look.
    pub is_faulty: f64,
    /// At least 1 while its level has drifted or lies apart: squared distance over bound. Else 0.
    pub off: f64,
}

pub const RUNGS: usize = RUNG_DAYS.len();
/// The rung from which a look is expected: one look does not decide whether a channel moves slowly.
const USUAL: usize = 0;
/// The rung whose mean becomes the healthy level of a channel that turns out to drift.
const OLDEST: usize = RUNGS - 1;

/// The probabilities, after a look, of what it may be put down to; their sum is 1.
#[derive(Clone, Copy, Debug, Default)]
pub struct Responsibility {
    pub healthy: f64,
    pub faulty: f64,
    /// The channel is another one than before the last pause.
    pub replaced: f64,
}

/// A look at a channel, with the level of its head taken off.
#[derive(Clone, Copy, Debug)]
pub struct FromLevel {
    pub at: Features,
    /// Precision: 1 at the reference drive, less at a smaller one or where the level is uncertain.
    pub looks: f64,
    /// K above the model's reference temperature.
    pub warmer: f64,
}

fn of_a_day() -> f64 {
    process::BETWEEN.powi(-2)
}

impl Default for Channel {
    fn default() -> Channel {
        Channel {
            past: [Sum::default(); RUNGS],
            today: Sum::default(),
            day_from_ns: i64::MAX,
            faulty: Sum::default(),
            faulty_looks: 0.0,
            faulty_days: 0.0,
            is_faulty: process::CHANGE,
            off: 0.0,
        }
    }
}

/// Variances of where faulty channels lie about the level: `wide`² times those of healthy channels,
/// and of one look's noise (1) at least.
pub fn wide(spread: &Features) -> Features {
    let square = process::WIDE.powi(2);
    spread.map(|s2| (square * s2).max(square))
}

/// What a channel does as the others of its head do.
#[derive(Clone, Copy, Debug)]
pub struct AsOthers {
    /// It moved no further than they did, over any time, while they age.
    pub moves: bool,
    /// It lies among them.
    pub lies: bool,
}

impl Channel {
    /// The mean over the last days and today, which counts as at most one day beside a past.
    pub fn healthy(&self) -> Sum {
        let (mut all, past) = (self.today, &self.past[USUAL]);
        if past.looks > 0.0 {
            all.at_most(of_a_day());
            all.absorb(past);
        }
        all
    }

    /// The first sweep after a pause, at `t_ns`: a fault may have come or gone, or the day be over.
    pub fn resume(&mut self, t_ns: i64) {
        self.is_faulty = self.is_faulty.max(process::CHANGE);
        if t_ns.saturating_sub(self.day_from_ns) < DAY_NS {
            return;
        }
        self.day_from_ns = i64::MAX;
        if self.stays_faulty() {
            self.faulty_days += 1.0;
        }
        if self.today.looks <= 0.0 {
            return;
        }

        // the precision that the day's looks and the difference of days leave
        self.today.at_most(1.0 / (1.0 / of_a_day() + 1.0 / self.today.looks));
        for (past, days) in self.past.iter_mut().zip(RUNG_DAYS) {
            past.at_most((days - 1.0) * of_a_day());
            past.absorb(&self.today);
        }
        self.today = Sum::default();
    }

    /// How far the mean of today (or of the fault that stays) lies from where the channel was over
    /// the days of each of [`RUNG_DAYS`], and, last, from all channels of its head; in standard
    /// deviations of what a healthy channel moves by. `None`: one of the positions is not known. `per_k`: variances of
    /// what a kelvin does to channels beside what it does to all.
    pub fn moved(
        &self,
        spread: &Features,
        (noise, per_k): (&Features, &Features),
    ) -> [Option<Features>; RUNGS + 1] {
        let now = if self.stays_faulty() { self.faulty } else { self.today };
        let of_now = noise / now.looks;

        let mut moved = [None; RUNGS + 1];
        for (moved, past) in moved.iter_mut().zip(&self.past) {
            if past.looks > 0.0 && now.looks > 0.0 {
                let of_past = noise * (1.0 / of_a_day() + 1.0 / past.looks);
                let of_warmth = per_k * (now.warmer() - past.warmer()).powi(2);
                let variance = of_now + of_past + of_warmth;
                *moved = Some((now.mean() - past.mean()).component_div(&variance.map(f64::sqrt)));
            }
        }

        let all = if self.stays_faulty() { self.faulty } else { self.healthy() };
        if all.looks > 0.0 {
            let variance = spread + noise / all.looks;
            moved[RUNGS] = Some(all.mean().component_div(&variance.map(f64::sqrt)));
        }
        moved
    }

    /// How far the channel lies from its head's level while it is healthy, or, where that is not known, while it is
    /// faulty; as [`Channel::moved`] counts.
    pub fn healthy_place(&self, spread: &Features, noise: &Features) -> Option<Features> {
        let of =
            if self.stays_faulty() && !self.knows_level() { self.faulty } else { self.healthy() };
        let variance = spread + noise / of.looks;
        (of.looks > 0.0).then(|| of.mean().component_div(&variance.map(f64::sqrt)))
    }

    /// How many times as long ago the channel's past at a rung is as the other channels': while a
    /// channel is faulty nothing is added to its past. 1 for the last place of [`Channel::moved`].
    pub fn times_as_long(&self, rung: usize) -> f64 {
        1.0 + RUNG_DAYS.get(rung).map_or(0.0, |days| self.faulty_days / days)
    }

    fn stays_faulty(&self) -> bool {
        self.is_faulty > 0.5 && self.knows_fault()
    }

    /// Decides, after each sweep, whether the channel lies where a healthy one would. `squares`:
    /// squared distances of what [`Channel::moved`] returns (`Apart::square`).
    ///
    /// * A healthy channel beyond a bound becomes faulty, at its present level. Its healthy level is
    ///   then what it was long ago if it has drifted from there, or unknown. Nobody knows of one without a
    ///   past that it is healthy, so it must not lie further out than one in a thousand does (`WITHIN_POPULATION`).
    /// * A faulty channel becomes healthy, at its present level, where it has moved no further than
    ///   the others of its ageing head, or is within the bounds and knows no level. The covariance of few
    ///   channels says of nothing that it is rare, so it has to lie among the others by that itself, too.
    pub fn watch(&mut self, squares: [f64; RUNGS + 1], as_others: AsOthers) {
        let drifted = squares[..RUNGS].iter().copied().fold(0.0, f64::max) / DRIFTED;
        let rare = if self.has_past() { ODD_ONE } else { WITHIN_POPULATION };
        let off = drifted.max(squares[RUNGS] / rare);
        if self.stays_faulty() {
            let has_aged = as_others.moves && self.faulty_days >= 1.0;
            if has_aged || !self.knows_level() && off < 1.0 && as_others.lies {
                // it begins anew: its present level is healthy, and it has no past
                *self = Channel {
                    today: self.faulty,
                    day_from_ns: self.day_from_ns,
                    faulty_looks: self.faulty_looks,
                    ..Channel::default()
                };
            } else if off >= 1.0 && self.faulty_days >= 1.0 {
                self.off = off;
            }
            return;
        }

        self.off = 0.0;
        if off >= 1.0 && self.knows_level() {
            self.off = off;
            let left = if drifted >= 1.0 { self.past[OLDEST] } else { Sum::default() };
            (self.past, self.faulty) = ([left; RUNGS], self.today);
            self.faulty_looks = self.today.looks;
            (self.today, self.is_faulty) = (Sum::default(), 0.9);
        }
    }

    /// Whether the channel was met healthy on a day before today.
    pub fn has_past(&self) -> bool {
        self.past[USUAL].looks > 0.0
    }

    fn knows_level(&self) -> bool {
        self.healthy().looks >= process::FEW
    }

    pub fn knows_fault(&self) -> bool {
        self.faulty.looks >= 1.0
    }

    /// Takes in a look, shared between the healthy and the faulty mean by what it is put down to.
    /// `spread`: variances of healthy channels; `noise`: of one look.
    pub fn learn(
        &mut self,
        t_ns: i64,
        look: FromLevel,
        by: Responsibility,
        (spread, noise): (&Features, &Features),
    ) {
        let FromLevel { at, looks, .. } = look;
        self.day_from_ns = self.day_from_ns.min(t_ns);

        if by.replaced > 0.5 {
            *self = Channel { day_from_ns: t_ns, ..Channel::default() };
            self.today.add(&look, 1.0);
            return;
        }

        self.today.add(&look, by.healthy);

        // a fault that lies far from the known one is another one
        let (f, variance) = self.faulty.posterior(&wide(spread), noise);
        let variance = variance + noise / looks;
        let far = (at - f).zip_map(&variance, |d, v| d * d / v).sum();
        if by.faulty > 0.5 && self.knows_fault() && far > ANOTHER_FAULT {
            (self.faulty, self.faulty_looks) = (Sum::default(), 0.0);
        }
        self.faulty.at_most(process::OF_BEGINNING);
        self.faulty.add(&look, by.faulty);
        self.faulty_looks += by.faulty * looks;

        // before the next look the channel may become faulty or healthy
        let moved = by.faulty * (1.0 - process::CHANGE) + (1.0 - by.faulty) * process::SUDDEN;
        self.is_faulty = moved.clamp(process::SUDDEN, 0.9);
        self.swap_if_cured(spread, noise);
        if !self.stays_faulty() {
            self.faulty_days = 0.0;
        }
    }

    /// Exchanges the healthy and the faulty level where the channel more likely began faulty and was
    /// cured: by which level lies nearer to all channels, and by how long the fault would have
    /// lasted, (1 - `change`)^n for n looks. Only on the channel's first day.
    fn swap_if_cured(&mut self, spread: &Features, noise: &Features) {
        // not if it drifts; and only once the second level has enough looks
        let has_past = self.has_past();
        let Channel { today, faulty, faulty_looks, off, .. } = self;
        let lasts = *faulty_looks >= today.looks.min(process::OF_BEGINNING);
        if has_past || *off > 0.0 || !lasts {
            return;
        }

        // squared distance of a level from all channels, and the log odds of "began faulty"
        let far = |of: &Sum| {
            let variance = spread + noise / of.looks.max(f64::MIN_POSITIVE);
            of.mean().zip_map(&variance, |d, v| d * d / v).sum()
        };
        let longer = *faulty_looks - today.looks;
        let ln_odds = 0.5 * (far(today) - far(faulty)) - longer * (-process::CHANGE).ln_1p();
        if far(faulty) < WITHIN_POPULATION && ln_odds > 0.0 {
            std::mem::swap(today, faulty);
            *faulty_looks = 0.0;
            self.is_faulty = process::CHANGE;
        }
    }
}

/// Squared distance from a known fault beyond which a look is at another one, and from all channels
/// within which a level may be healthy: upper 1e-10 and 1e-3 of chi-squared, four degrees of freedom.
const ANOTHER_FAULT: f64 = 52.4;
const WITHIN_POPULATION: f64 = 18.47;

#[cfg(test)]
mod tests {
    use super::*;

    const ONE: Features = Vector4::new(1.0, 1.0, 1.0, 1.0);

    fn spread() -> Features {
        Vector4::new(4.0, 1.0, 9.0, 0.0)
    }

    /// Looks at these times and at this place, each healthy with this probability and else faulty.
    fn learn(of: &mut Channel, times: std::ops::Range<i64>, at: Features, healthy: f64) {
        let by = Responsibility { healthy, faulty: 1.0 - healthy, replaced: 0.0 };
        times.for_each(|t| {
            of.learn(t, FromLevel { at, looks: 1.0, warmer: 0.0 }, by, (&spread(), &ONE))
        });
    }

    #[test]
    fn posterior_is_the_conjugate_one() {
        let mut sum = Sum::default();
        let at = Vector4::new(1.0, 2.0, -1.0, 0.5);
        (0..10).for_each(|_| sum.add(&FromLevel { at, looks: 1.0, warmer: 0.0 }, 0.5));
        let (mean, variance) = sum.posterior(&spread(), &Vector4::repeat(1.0));
        // precision 1/s² + n, mean n y / (1/s² + n)
        assert!((variance[0] - 1.0 / (0.25 + 5.0)).abs() < 1e-12);
        assert!((mean[1] - 2.0 * 5.0 / 6.0).abs() < 1e-12);
        assert_eq!((mean[3], variance[3]), (0.0, 0.0), "where channels do not differ");
        assert!((sum.mean()[2] + 1.0).abs() < 1e-12);
    }

    #[test]
    fn faulty_looks_do_not_teach_and_first_ones_that_were_faulty_are_swapped() {
        let (fault, look) = (Vector4::new(30.0, 0.0, 0.0, 0.0), Vector4::new(1.0, 0.0, 1.0, 0.0));
        let mut of = Channel::default();
        learn(&mut of, 0..20, look, 1.0);
        let before = of.healthy();
        learn(&mut of, 20..520, fault, 0.0);
        assert_eq!(of.healthy(), before);
        assert!(of.knows_fault() && of.is_faulty > 0.5);
        let mut young = Channel::default();
        learn(&mut young, 0..3, fault, 1.0);
        learn(&mut young, 3..11, look, 0.0);
        assert!((young.healthy().mean() - look).amax() < 1e-9, "{young:?}");
    }

    /// Both levels are such as healthy channels have; the one further out was a slight fault of the
    /// first minutes, unless it has lasted much longer than faults do.
    #[test]
    fn a_slight_fault_of_the_first_minutes_is_cured_and_a_long_past_is_believed() {
        let (outer, inner) = (Vector4::new(3.0, 0.0, 2.0, 0.0), Vector4::new(1.0, 0.0, 1.0, 0.0));
        let healthy_after = |first: i64, then: i64| {
            let mut of = Channel::default();
            learn(&mut of, 0..first, outer, 1.0);
            learn(&mut of, first..first + then, inner, 0.0);
            of.healthy().mean()
        };
        assert!((healthy_after(20, 20) - inner).amax() < 1e-9);
        assert!((healthy_after(500, 20) - outer).amax() < 1e-9);
        assert!((healthy_after(20, 3) - outer).amax() < 1e-9, "three looks are no level");
    }

    #[test]
    fn a_channel_is_the_mean_of_its_days_however_many_looks_each_has() {
        let mut of = Channel::default();
        for (day, looks) in [(0, 1000), (1, 30), (2, 5000)] {
            let t_ns = day * 86_400_000_000_000;
            of.resume(t_ns);
            let at = Vector4::repeat(day as f64);
            learn(&mut of, t_ns..t_ns + looks, at, 1.0);
            // a pause within a day begins none
            of.resume(t_ns + 3_600_000_000_000);
        }
        let mean = of.healthy().mean()[0];
        assert!((mean - 1.0).abs() < 0.1, "{mean}");
        assert!(of.healthy().looks < 3.0 * of_a_day() + 1e-9);
    }
}
