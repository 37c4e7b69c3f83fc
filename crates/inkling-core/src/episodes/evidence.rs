//! The sequential test for a fault of one channel.
//!
//! In: a channel's detection statistics over their thresholds (*ratios*), in time order. Out, for
//! each look: whether the evidence for a fault suffices, since when it has grown, and when the fault
//! is gone ([`Step`]).
//!
//! 1. x is the fourth root of the ratio, which is close to normal (Hawkins and Wixley 1986, for
//!    chi-squared), and z = (x - level) / sd by the channel's own running mean (its *level*) and
//!    spread. So a healthy channel that always reads high is no fault.
//! 2. The gain of a look is the smaller of two log likelihood ratios of faulty against healthy:
//!    that of a normal shifted by `shift`, shift (z - shift / 2), and that of being flagged or not.
//! 3. Page's CUSUM (1954): evidence = max(0, evidence + gain). A fault is raised where the evidence
//!    reaches the bound, and its onset is where it began to grow (`begins`).
//! 4. While a fault is on, its end is looked for: of a fault that stays, by a second CUSUM of
//!    healthy against the fault's own shift (`look_at_shift`); of one that comes and goes, which
//!    `channel` raises, by enough looks in a row without a flag (`look_for_flags`).
//!
//! Why the smaller of the two: healthy looks then seldom raise anything if either statistics are
//! distributed as assumed, or flags come at their stated rate (the mean of e^gain is at most 1).

use super::tuned;
use crate::numbers::FEW;

/// ln likelihood ratio of a flagged and of an unflagged look: a fifth of the looks is flagged, against
/// at most 9e-4 of healthy ones. Three flagged looks in a row suffice at the default bound.
const FLAGGED: f32 = 5.4;
const NOT_FLAGGED: f32 = -0.22;

/// The threshold over the median of healthy statistics that `FIRST` is for: that of chi-squared
/// with three degrees of freedom at a false-alarm rate of 5e-4.
pub const FIRST_IN_MEDIANS: f32 = 7.5;
/// Prior level and spread of a channel that was never observed, each with its weight in looks: about
/// those of the fourth root of chi-squared with three degrees of freedom over its upper 5e-4 point.
const FIRST: Learned = Learned {
    level: 0.62,
    level_looks: 2.0,
    variance: 0.11 * 0.11,
    variance_looks: 20.0,
    faulty: 0.0,
};
/// The same of a channel that is judged by its own baseline, over the upper 7e-4 point.
const OWN: Learned = Learned {
    level: 0.607,
    level_looks: 25.0,
    variance: 0.135 * 0.135,
    variance_looks: 60.0,
    ..FIRST
};
/// Largest factor by which the thresholds, in medians, of two models are believed to differ.
const MOST_LOWER: f32 = 16.0;
/// The largest level that is accepted as healthy: the threshold itself.
const LARGEST_LEVEL: f32 = 1.0;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// No fault in sight.
    Quiet,
    /// The evidence is above 0, but does not suffice yet. `begins`: this look may be the onset.
    Suspect { begins: bool },
    /// The evidence suffices from this look on.
    Raised,
    /// The channel is still faulty. `fading`: there is evidence of the return to healthy.
    Faulty { fading: bool },
    /// The channel is healthy again, since the first of the last looks that were `fading`.
    Ended,
}

#[derive(Clone, Copy, Debug)]
pub struct Evidence {
    learned: Learned,
    /// ln of the likelihood ratio of healthy again against faulty, at least 0; while one is raised.
    recovered: f32,
    /// How far the raised fault shifts looks, in standard deviations of a look: a running mean.
    shift: f32,
    /// Whether a fault is on: from the look that raised it to the one that ended it.
    pub raised: bool,
    /// Share of looks in which a fault that comes and goes was flagged; 0: the fault stays.
    share: f32,
}

/// What was learned of a channel while no fault was raised, by fourth roots of the ratio.
#[derive(Clone, Copy, Debug)]
struct Learned {
    /// Running mean, and the number of looks that it rests on.
    level: f32,
    level_looks: f32,
    variance: f32,
    variance_looks: f32,
    /// ln of the likelihood ratio of faulty since the best onset against healthy, at least 0.
    faulty: f32,
}

impl Default for Evidence {
    fn default() -> Evidence {
        Evidence { learned: FIRST, recovered: 0.0, shift: tuned::SHIFT, raised: false, share: 0.0 }
    }
}

impl Evidence {
    pub fn is_quiet(&self) -> bool {
        !self.raised && self.learned.faulty <= 0.0
    }

    /// Whether a look's evidence alone makes a suspect channel.
    pub fn stands_out(&self, ratio: f32) -> bool {
        evidence_of(ratio, self.learned.deviation(ratio).0) > tuned::SUSPICION
    }

    /// Raises a fault that comes and goes, and is flagged in this share of the looks.
    pub fn raise_intermittent(&mut self, share: f32) {
        (self.raised, self.recovered, self.share) = (true, 0.0, share);
    }

    /// To be called where another model begins to judge. `lower`: the threshold so far over the new
    /// one, each over the median of its model's healthy statistics, by which ratios become larger.
    pub fn change_model(&mut self, lower: f32) {
        let Learned { level, variance, .. } = &mut self.learned;
        let by = lower.clamp(1.0 / MOST_LOWER, MOST_LOWER).sqrt().sqrt();
        *level = (*level * by).min(LARGEST_LEVEL);
        *variance *= by * by;
    }

    /// To be called where the channel's own baseline begins to judge, or ceases to.
    pub fn judge_by_own(&mut self, own: bool) {
        let begin = if own { OWN } else { FIRST };
        self.learned = Learned { faulty: self.learned.faulty, ..begin };
    }

    /// Updates the channel by one look. `ratio`: not negative and no NaN. `bound`: ln likelihood ratio
    /// at which a fault is raised, and at which it ends.
    pub fn look(&mut self, ratio: f32, bound: f32) -> Step {
        let (z, sd) = self.learned.deviation(ratio);
        if self.raised {
            match self.share > 0.0 {
                true => self.look_for_flags(ratio),
                false => self.look_at_shift(z),
            }
            if self.recovered >= bound {
                (self.learned.faulty, self.recovered) = (0.0, 0.0);
                (self.raised, self.share) = (false, 0.0);
                return Step::Ended;
            }
            return Step::Faulty { fading: self.recovered > 0.0 };
        }

        // level and spread stay as they were before this look, with which the fault's shift begins
        let before = self.learned.faulty;
        let next = self.learned.after(ratio, z, sd);
        if next.faulty >= bound {
            (self.learned.faulty, self.raised, self.recovered) = (next.faulty, true, 0.0);
            self.shift = z.clamp(tuned::SHIFT, tuned::LARGEST_SHIFT);
            return Step::Raised;
        }
        self.learned = next;
        match next.faulty > 0.0 {
            true => Step::Suspect { begins: begins(before, evidence_of(ratio, z)) },
            false => Step::Quiet,
        }
    }

    /// The test for the end of a fault that comes and goes: so many looks in a row without a flag as
    /// its share of flagged looks makes improbable.
    fn look_for_flags(&mut self, ratio: f32) {
        match ratio > 1.0 {
            true => self.recovered = 0.0,
            // -ln of the probability that a faulty channel is not flagged; a healthy one hardly is
            false => self.recovered -= (-self.share).ln_1p(),
        }
    }

    /// The test for the end of a fault that stays: a CUSUM of healthy (no shift) against the shift of
    /// the episode so far. `z`: the look's deviation from the healthy level.
    fn look_at_shift(&mut self, z: f32) {
        // no look says more than a flagged one does of the beginning: three looks end a fault, too
        let gain = self.shift * (self.shift / 2.0 - z.min(tuned::LARGEST_SHIFT));
        self.recovered = (self.recovered + gain.clamp(-FLAGGED, FLAGGED)).max(0.0);

        // where the look belongs to the fault rather than to its end, the shift follows it
        if z >= self.shift / 2.0 {
            self.shift = (self.shift + (z - self.shift) / FEW as f32)
                .clamp(tuned::SHIFT, tuned::LARGEST_SHIFT);
        }
    }
}

/// The evidence of one look that deviates by `z`: the smaller of two ln likelihood ratios.
fn evidence_of(ratio: f32, z: f32) -> f32 {
    let by_flag = if ratio > 1.0 { FLAGGED } else { NOT_FLAGGED };
    (tuned::SHIFT * (z - tuned::SHIFT / 2.0)).min(by_flag)
}

/// Whether a look that leaves evidence may be the onset: there was too little `before` to make the
/// channel suspect, while this look alone does.
fn begins(before: f32, of_look: f32) -> bool {
    (before <= 0.0) | ((before < tuned::SUSPICION) & (of_look > tuned::SUSPICION))
}

impl Learned {
    /// A look's deviation z from the level, and its standard deviation, with the level's error.
    fn deviation(self, ratio: f32) -> (f32, f32) {
        let x = ratio.max(0.0).sqrt().sqrt().min(1e3);
        let sd = (self.variance * (1.0 + 1.0 / self.level_looks)).sqrt();
        ((x - self.level) / sd, sd)
    }

    /// What is known after a look. `z`, `sd`: as `deviation` gives them.
    fn after(self, ratio: f32, z: f32, sd: f32) -> Learned {
        let faulty = (self.faulty + evidence_of(ratio, z)).max(0.0);

        let share = if faulty < tuned::SUSPICION { 1.0 } else { 0.0 };
        let innovation = z.clamp(-3.0, 3.0) * sd;
        // the square without what the error of the level adds to it
        let of_one_look = innovation * innovation / (1.0 + 1.0 / self.level_looks);
        let level = self.level + share * innovation / (self.level_looks + 1.0);
        let variance =
            self.variance + share * (of_one_look - self.variance) / (self.variance_looks + 1.0);
        Learned {
            level: level.min(LARGEST_LEVEL),
            level_looks: (self.level_looks + share).min(tuned::MEMORY_LOOKS),
            variance,
            variance_looks: (self.variance_looks + share).min(tuned::MEMORY_LOOKS),
            faulty,
        }
    }
}

#[cfg(test)]
mod tests;
