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
use crate::numbers::tuned::few;

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
        Evidence {
            learned: FIRST,
            recovered: 0.0,
            shift: tuned::shift(),
            raised: false,
            share: 0.0,
        }
    }
}

/// Number of channels that are updated together, in SIMD lanes.
pub const TOGETHER: usize = 8;

impl Evidence {
    pub fn is_quiet(&self) -> bool {
        !self.raised && self.learned.faulty <= 0.0
    }

    /// Whether a look's evidence alone makes a suspect channel.
    pub fn stands_out(&self, ratio: f32) -> bool {
        evidence_of(ratio, self.learned.deviation(ratio).0) > tuned::suspicion()
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
            self.shift = z.clamp(tuned::shift(), tuned::largest_shift());
            return Step::Raised;
        }
        self.learned = next;
        match next.faulty > 0.0 {
            true => Step::Suspect { begins: begins(before, evidence_of(ratio, z)) },
            false => Step::Quiet,
        }
    }

    /// Updates several channels at once as [`Evidence::look`] does: those `among`, none of them raised.
    /// Returns which were updated (not those that this look would raise), and where an onset may lie.
    pub fn look_at_quiet(
        of: [&mut Evidence; TOGETHER],
        among: [bool; TOGETHER],
        ratios: &[f32; TOGETHER],
        bound: f32,
    ) -> ([bool; TOGETHER], [bool; TOGETHER]) {
        let learned = of.each_ref().map(|of| of.learned);
        let (mut next, mut begin, mut updated) = (learned, [false; TOGETHER], [false; TOGETHER]);
        for i in 0..TOGETHER {
            let (z, sd) = learned[i].deviation(ratios[i]);
            next[i] = learned[i].after(ratios[i], z, sd);
            let of_look = evidence_of(ratios[i], z);
            begin[i] = (next[i].faulty > 0.0) & begins(learned[i].faulty, of_look);
            updated[i] = among[i] & (next[i].faulty < bound);
        }
        for ((of, next), updated) in of.into_iter().zip(next).zip(updated) {
            if updated {
                of.learned = next;
            }
        }
        (updated, begin)
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
        let gain = self.shift * (self.shift / 2.0 - z.min(tuned::largest_shift()));
        self.recovered = (self.recovered + gain.clamp(-FLAGGED, FLAGGED)).max(0.0);

        // where the look belongs to the fault rather than to its end, the shift follows it
        if z >= self.shift / 2.0 {
            self.shift = (self.shift + (z - self.shift) / few() as f32)
                .clamp(tuned::shift(), tuned::largest_shift());
        }
    }
}

/// The evidence of one look that deviates by `z`: the smaller of two ln likelihood ratios.
#[inline(always)] // several channels side by side
fn evidence_of(ratio: f32, z: f32) -> f32 {
    let by_flag = if ratio > 1.0 { FLAGGED } else { NOT_FLAGGED };
    (tuned::shift() * (z - tuned::shift() / 2.0)).min(by_flag)
}

/// Whether a look that leaves evidence may be the onset: there was too little `before` to make the
/// channel suspect, while this look alone does.
fn begins(before: f32, of_look: f32) -> bool {
    (before <= 0.0) | ((before < tuned::suspicion()) & (of_look > tuned::suspicion()))
}

impl Learned {
    /// A look's deviation z from the level, and its standard deviation, with the level's error.
    #[inline(always)] // several channels side by side
    fn deviation(self, ratio: f32) -> (f32, f32) {
        let x = ratio.max(0.0).sqrt().sqrt().min(1e3);
        let sd = (self.variance * (1.0 + 1.0 / self.level_looks)).sqrt();
        ((x - self.level) / sd, sd)
    }

    /// What is known after a look. `z`, `sd`: as `deviation` gives them.
    #[inline(always)] // as above
    fn after(self, ratio: f32, z: f32, sd: f32) -> Learned {
        let faulty = (self.faulty + evidence_of(ratio, z)).max(0.0);

        let share = if faulty < tuned::suspicion() { 1.0 } else { 0.0 };
        let innovation = z.clamp(-3.0, 3.0) * sd;
        // the square without what the error of the level adds to it
        let of_one_look = innovation * innovation / (1.0 + 1.0 / self.level_looks);
        let level = self.level + share * innovation / (self.level_looks + 1.0);
        let variance =
            self.variance + share * (of_one_look - self.variance) / (self.variance_looks + 1.0);
        Learned {
            level: level.min(LARGEST_LEVEL),
            level_looks: (self.level_looks + share).min(tuned::memory_looks()),
            variance,
            variance_looks: (self.variance_looks + share).min(tuned::memory_looks()),
            faulty,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::normal::draws;

    /// Draws looks at a channel: |offset + noise|² over the threshold. The vector has three
    /// components, of which the first has the offset, and all have noise of standard deviation .75.
    /// At the threshold of 15.85 looks with offsets of 0, 1 and 2 are flagged at rates of 3e-6,
    /// 1.5e-4 and 9e-3; channels with offsets spread evenly from 0 to 2 at about 1e-3.
    fn source(seed: u64) -> impl FnMut(f32) -> f32 {
        let mut normal = draws(seed);
        move |offset| {
            let off = [offset, 0.0, 0.0].map(|at| at + 0.75 * normal() as f32);
            off.map(|x| x * x).iter().sum::<f32>() / 15.85
        }
    }

    /// How often so many looks raise an episode.
    fn raised(evidence: &mut Evidence, looks: usize, mut look: impl FnMut() -> f32) -> usize {
        (0..looks).filter(|_| evidence.look(look(), 16.0) == Step::Raised).count()
    }

    #[test]
    fn healthy_channels_high_or_low_raise_less_often_than_the_bound_says() {
        // bound of 20 in a million looks, 1.6 million looks
        let bound = (1e6f32 / 20.0).ln();
        let mut look = source(1);
        let mut raised = 0;
        for channel in 0..4000 {
            let offset = 2.0 * channel as f32 / 4000.0;
            let mut evidence = Evidence::default();
            for _ in 0..400 {
                raised += u32::from(evidence.look(look(offset), bound) == Step::Raised);
            }
        }
        assert!(raised <= 32, "{raised} raised");
    }

    #[test]
    fn the_shift_follows_what_is_seen_of_a_fault_and_not_what_is_seen_of_its_end() {
        let after = |z: f32| {
            let mut evidence = Evidence { shift: 6.0, raised: true, ..Evidence::default() };
            for _ in 0..200 {
                evidence.look_at_shift(z);
            }
            evidence.shift
        };
        for z in [3.5, 4.5, 5.5] {
            assert!((after(z) - z).abs() < 1e-3, "{}, not {z}", after(z));
        }
        assert_eq!(after(2.0), 6.0);
        assert_eq!(after(1e3), tuned::largest_shift());
    }

    #[test]
    fn fault_is_raised_within_a_few_looks_and_ended_soon_after_it_is_gone() {
        let bound = 16.0;
        let mut look = source(2);
        for _ in 0..200 {
            let mut evidence = Evidence::default();
            for _ in 0..60 {
                evidence.look(look(1.0), bound);
            }
            let raised = (1..30).find(|_| evidence.look(look(8.0), bound) == Step::Raised);
            assert!(raised.is_some_and(|n| (2..=6).contains(&n)), "{raised:?}");
            for _ in 0..50 {
                let step = evidence.look(look(8.0), bound);
                assert!(matches!(step, Step::Faulty { .. }), "{step:?}");
            }
            let ended = (1..30).find(|_| evidence.look(look(1.0), bound) == Step::Ended);
            assert!(ended.is_some_and(|n| n <= 8), "{ended:?}");
        }
        // as is a channel that is faulty from the start
        let mut evidence = Evidence::default();
        let raised = (1..30).find(|_| evidence.look(look(8.0), bound) == Step::Raised);
        assert!(raised.is_some_and(|n| n <= 8), "{raised:?}");
    }

    /// A look by a channel's own baseline: chi-squared with three degrees of freedom over the value
    /// that it exceeds at a rate of 7e-4.
    fn own_look(look: &mut impl FnMut(f32) -> f32) -> f32 {
        look(0.0) * 15.85 / 0.75f32.powi(2) / 17.06
    }

    #[test]
    fn own_statistic_has_the_level_and_spread_that_are_expected_of_it() {
        let mut look = source(6);
        let x: Vec<f64> = (0..100_000).map(|_| f64::from(own_look(&mut look)).powf(0.25)).collect();
        let mean = x.iter().sum::<f64>() / x.len() as f64;
        let sd = (x.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / x.len() as f64).sqrt();
        assert!((mean - f64::from(OWN.level)).abs() < 0.003, "{mean}");
        assert!((sd - f64::from(OWN.variance).sqrt()).abs() < 0.003, "{sd}");
    }

    #[test]
    fn own_baseline_that_begins_is_no_fault() {
        let mut look = source(5);
        let raises = |_: &u32| {
            let mut evidence = Evidence::default();
            // twenty looks against all channels' spread, which is wider than the channel's own;
            // from then on against the latter
            let by_all = raised(&mut evidence, 20, || 0.3 * own_look(&mut look));
            evidence.judge_by_own(true);
            by_all + raised(&mut evidence, 200, || own_look(&mut look)) > 0
        };
        // 400,000 looks, of which .1 per million are expected to raise an episode
        assert_eq!((0..2000).filter(raises).count(), 0);
    }

    /// Healthy looks whose distribution is another than assumed, flagged at the stated rate or
    /// never.
    #[test]
    fn healthy_looks_of_any_shape_raise_nothing() {
        // A log-normal whose threshold is 3.19 standard deviations out (7e-4); and a tenth of the
        // threshold or, one time in twenty, nine tenths of it.
        let shapes: [fn(f32) -> f32; 2] =
            [|z| (1.6 * (z - 3.19)).exp(), |z| if z > 1.645 { 0.9 } else { 0.1 }];
        let mut normal = draws(9);
        for shape in shapes {
            for _ in 0..1000 {
                assert_eq!(raised(&mut Evidence::default(), 400, || shape(normal() as f32)), 0);
            }
        }
    }

    #[test]
    fn a_lower_threshold_is_no_fault_if_it_is_told_and_would_be_one_if_not() {
        // A channel that lies far out, and always did. The tail of the first window is known badly,
        // so its threshold is high; that of the next one is lower.
        let channels = |told: bool| {
            let mut look = source(7);
            let raises = |_: &u32| {
                let mut evidence = Evidence::default();
                let wide = raised(&mut evidence, 60, || 0.55 * look(3.0));
                evidence.change_model(if told { 1.0 / 0.55 } else { 1.0 });
                wide + raised(&mut evidence, 60, || look(3.0)) > 0
            };
            (0..2000).filter(raises).count()
        };
        let (told, not) = (channels(true), channels(false));
        assert!(told <= 2 && not >= 20, "{told} and {not}");
    }

    #[test]
    fn one_odd_look_however_large_raises_nothing() {
        let mut evidence = Evidence::default();
        let mut look = source(4);
        for i in 0..2000 {
            let ratio = if i % 50 == 49 { f32::MAX } else { look(1.0) };
            assert!(!matches!(evidence.look(ratio, 16.0), Step::Raised | Step::Ended));
        }
    }

    /// The statistic over threshold of a look that lies `z` standard deviations above what is
    /// learned.
    fn look_at(learned: &Learned, z: f32) -> f32 {
        (learned.level + z * learned.deviation(0.0).1).powi(4)
    }

    #[test]
    fn level_and_spread_are_running_means_and_a_look_is_measured_by_what_it_may_be() {
        let of = Evidence::default().learned;
        let (z, sd) = of.deviation(look_at(&of, 2.0));
        assert!((z - 2.0).abs() < 1e-4, "{z}");
        // the variance of a look to come: its own, and that of the level, which is a mean of so
        // many looks
        let predicted = of.variance + of.variance / of.level_looks;
        assert!((sd * sd / predicted - 1.0).abs() < 1e-4);
        let after = |z: f32| {
            let ratio = look_at(&of, z);
            of.after(ratio, of.deviation(ratio).0, sd)
        };
        let (one, two) = (after(1.0), after(2.0));
        // A look as far off as expected leaves the variance as it is; one farther off raises it.
        assert!((one.variance / of.variance - 1.0).abs() < 1e-4);
        let mean =
            (of.variance_looks * of.variance + 4.0 * of.variance) / (of.variance_looks + 1.0);
        assert!((two.variance / mean - 1.0).abs() < 1e-4);
        let mean = (of.level_looks * of.level + of.level + 2.0 * sd) / (of.level_looks + 1.0);
        assert!((two.level - mean).abs() < 1e-4);
        assert_eq!(two.level_looks, of.level_looks + 1.0);
        assert_eq!(two.variance_looks, of.variance_looks + 1.0);
    }

    #[test]
    fn a_look_lies_as_far_off_by_another_threshold_as_by_this_one() {
        for lower in [0.25, 1.8] {
            let mut evidence = Evidence::default();
            let before = [0.1, 0.5, 0.9].map(|ratio| evidence.learned.deviation(ratio).0);
            evidence.change_model(lower);
            let after = [0.1, 0.5, 0.9].map(|ratio| evidence.learned.deviation(ratio * lower).0);
            assert!(before.iter().zip(after).all(|(b, a)| (b - a).abs() < 1e-3), "{before:?}");
        }
    }

    #[test]
    fn a_look_at_its_threshold_is_not_flagged() {
        let of = Evidence::default().learned;
        let evidence = |ratio: f32| {
            let (z, sd) = of.deviation(ratio);
            of.after(ratio, z, sd).faulty
        };
        assert_eq!(evidence(1.0), 0.0);
        assert!(evidence(1.001) > 2.0);
    }

    #[test]
    fn own_baseline_brings_its_own_level_and_takes_it_with_it_and_evidence_stays() {
        let mut evidence = Evidence::default();
        assert!(evidence.is_quiet());
        assert_eq!(evidence.look(1.1, 16.0), Step::Suspect { begins: true });
        assert!(!evidence.is_quiet());
        let suspicion = evidence.learned.faulty;
        evidence.judge_by_own(true);
        assert!(evidence.learned.deviation(OWN.level.powi(4)).0.abs() < 1e-4);
        assert_eq!(evidence.learned.faulty, suspicion);
        evidence.judge_by_own(false);
        assert!(evidence.learned.deviation(FIRST.level.powi(4)).0.abs() < 1e-4);
        assert_eq!(evidence.learned.faulty, suspicion);
    }

    #[test]
    fn what_a_fault_has_grown_to_is_what_its_end_is_told_by() {
        let looks_to_the_end = |grown: f32| {
            let mut evidence = Evidence::default();
            let look = |z: f32| look_at(&evidence.learned, z);
            let (beyond, grown, healthy) = (look(2.9), look(grown), look(0.0));
            let raised = (0..40).find(|_| evidence.look(beyond, 16.0) == Step::Raised);
            assert!(raised.is_some());
            (0..60).for_each(|_| {
                evidence.look(grown, 16.0);
            });
            (1..60).find(|_| evidence.look(healthy, 16.0) == Step::Ended).expect("it ends")
        };
        let (small, large) = (looks_to_the_end(2.9), looks_to_the_end(40.0));
        assert!(large == 3 && small > large, "{small}, {large}");
    }

    #[test]
    fn an_onset_is_the_first_evidence_or_what_chance_does_not_explain() {
        let alone = 1.01 * tuned::suspicion();
        assert!(begins(0.0, 0.1) && begins(tuned::suspicion() / 2.0, alone));
        assert!(!begins(tuned::suspicion() / 2.0, 0.99 * tuned::suspicion()));
        assert!(!begins(tuned::suspicion(), alone));
        // a look that is not flagged is no onset, however far it lies above the channel's level
        assert!(!begins(tuned::suspicion() / 2.0, evidence_of(0.9, 20.0)));
    }

    #[test]
    fn channels_together_are_channels_one_by_one() {
        let mut look = source(5);
        let mut one_by_one = [Evidence::default(); TOGETHER];
        let (mut together, mut raised) = (one_by_one, [false; TOGETHER]);
        for nth in 0..400 {
            let offset = if nth > 350 { 8.0 } else { 1.5 };
            let ratios: [f32; TOGETHER] = std::array::from_fn(|_| look(offset));
            // raised channels are left out, and now and then another one
            let among = std::array::from_fn(|i| !raised[i] && (nth + i) % 9 != 0);
            let before = together;
            let (updated, begin) =
                Evidence::look_at_quiet(together.each_mut(), among, &ratios, 16.0);
            for i in 0..TOGETHER {
                let told = |of: &Evidence| format!("{of:?}");
                if !among[i] {
                    assert!(!updated[i] && told(&together[i]) == told(&before[i]));
                    continue;
                }
                let step = one_by_one[i].look(ratios[i], 16.0);
                assert_eq!(updated[i], step != Step::Raised);
                if updated[i] {
                    assert_eq!(told(&together[i]), told(&one_by_one[i]));
                    assert_eq!(begin[i], step == Step::Suspect { begins: true });
                } else {
                    assert_eq!(told(&together[i]), told(&before[i]));
                    raised[i] = true;
                }
            }
        }
        assert!(raised.contains(&true));
    }
}
