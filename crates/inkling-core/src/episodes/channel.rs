//! Follows one channel look by look: whether an episode is on, when it began, and when it ends.
//!
//! In: the channel's looks in the order of time, and what isolation says of flagged ones, from
//! `printhead`. Out: the drafts of episodes that have ended; the draft of the episode that is on
//! stays with the channel, and `channel_episode` makes an episode of it.
//!
//! Two tests run side by side. `evidence` (CUSUM) raises a fault that shifts the channel's looks,
//! and ends every fault. `intermittent` raises a fault that is flagged now and then, with healthy
//! looks between. Each has its own onset and its own draft until it raises: the draft of the first
//! is discarded whenever its evidence falls to nothing, that of the second begins anew with a
//! flagged look before which its evidence has fallen to nothing.

use super::episode_draft::EpisodeDraft;
use super::evidence::{Evidence, FIRST_IN_MEDIANS, Step};
use super::intermittent::Flags;
use super::rules::Rules;
use super::{Counts, IsolatedSignal, Looks, Untimely};
use std::cmp::Ordering;

/// The state of one channel after its last look.
#[derive(Debug, Default)]
pub struct Channel {
    pub number: u32,
    /// Time, ns, and statistic over threshold of the last look.
    pub last_ns: i64,
    pub last_ratio: f32,
    /// Number of looks since the onset, the onset's own included.
    pub looks: u64,
    /// Time of the onset, ns, of the episode that is on or of what may become one.
    pub onset_ns: i64,
    /// The model that judged the channel last; `None`: none has judged it.
    pub model: Option<u16>,
    /// The threshold of that model over the median of healthy statistics.
    in_medians: f32,
    /// Whether the channel was last judged by its own baseline.
    pub own: bool,
    pub evidence: Evidence,
    /// The draft of the episode that is on, or of what may become one.
    pub draft: Option<Box<EpisodeDraft>>,
    /// Looks at the channel while no episode was on, and flagged ones among them.
    pub quiet: Flags,
    /// The flagged looks that stand out from the channel's level, since the test for a fault that comes
    /// and goes last began; `None`: there are none.
    flagged_looks: Option<Box<FlaggedLooks>>,
}

/// Flagged looks at a channel that stand out from its level, consecutive or not: the evidence for a
/// fault that comes and goes.
#[derive(Clone, Debug)]
struct FlaggedLooks {
    /// Number of these looks.
    flagged: u64,
    /// Time of the first of these looks, ns, and how many looks came before it while no episode was on.
    since_ns: i64,
    before: u64,
    /// What isolation said of these looks, for the episode that they may become.
    draft: EpisodeDraft,
}

impl FlaggedLooks {
    /// The looks since the first of these, and how many of them were flagged and stand out. `looks`:
    /// number of looks while no episode was on, of which `before` came earlier.
    fn flags(&self, looks: u64) -> Flags {
        Flags { looks: looks - self.before, flagged: self.flagged }
    }
}

impl Channel {
    /// A channel of which no look was taken yet.
    pub fn new(number: u32) -> Channel {
        Channel {
            number,
            last_ns: i64::MIN,
            last_ratio: f32::NAN,
            in_medians: FIRST_IN_MEDIANS,
            ..Channel::default()
        }
    }

    /// Whether a look is later than all looks before; then its time and ratio are kept. A look that
    /// is not is counted instead: as too late, repeated, or one of several at one time.
    pub fn is_next(
        &mut self,
        t_ns: i64,
        ratio: f32,
        counts: &mut Counts,
        untimely: &mut Untimely,
    ) -> bool {
        let order = t_ns.cmp(&self.last_ns);
        match order {
            Ordering::Less => {
                counts.signals_too_late += 1;
                untimely.too_late += 1;
            }
            // the same look again
            Ordering::Equal if ratio.to_bits() == self.last_ratio.to_bits() => {
                counts.signals_repeated += 1;
            }
            Ordering::Equal => {
                counts.signals_at_one_time += 1;
                (untimely.at_one_time, untimely.t_ns) = (untimely.at_one_time + 1, t_ns);
            }
            Ordering::Greater => (self.last_ns, self.last_ratio) = (t_ns, ratio),
        }
        order.is_gt()
    }

    /// Adapts the channel's level where another model begins to judge the channel, or its own
    /// baseline begins or ceases to. To be called before [`Channel::look`].
    pub fn judge_by(&mut self, looks: &Looks, own: bool) {
        if self.model != Some(looks.model) {
            self.change_model(looks, own);
        }
        if self.own != own {
            self.own = own;
            self.evidence.judge_by_own(own);
            if !own {
                // what is first expected of a channel is in medians of another threshold
                self.evidence.change_model(FIRST_IN_MEDIANS / self.in_medians);
            }
        }
    }

    /// Tells the evidence that another model judges from here on, with another threshold. A model
    /// whose threshold in medians is not known is taken to have that of the model before.
    fn change_model(&mut self, looks: &Looks, own: bool) {
        let next = if looks.in_medians > 0.0 { looks.in_medians } else { self.in_medians };
        // a baseline of its own has a threshold of its own, which does not change with the model
        let lower = if own { 1.0 } else { self.in_medians / next };
        self.evidence.change_model(lower);
        (self.model, self.in_medians) = (Some(looks.model), next);
    }

    /// Takes in the next look, and returns the draft of the episode that has ended with it.
    /// `ratio`: statistic over threshold; `named`: what isolation says, if the look was flagged;
    /// `of_all`: looks and flagged looks at all of the printhead's channels while no episode was on
    /// in them.
    pub fn look(
        &mut self,
        t_ns: i64,
        ratio: f32,
        named: Option<&IsolatedSignal>,
        of_all: Flags,
        rules: &Rules,
    ) -> Option<Box<EpisodeDraft>> {
        let was_raised = self.evidence.is_raised();

        // A healthy channel that always reads high is flagged now and then, but never far from its
        // level. So only looks that stand out from the level count as flagged for a fault that
        // comes and goes. That is asked before the look moves the level.
        let stands_out = self.evidence.stands_out(ratio);
        let was_quiet = self.evidence.is_quiet();
        let step = self.evidence.look(ratio, rules.bound);
        self.looks += 1;
        if !was_raised {
            self.quiet.add(ratio > 1.0);
        }

        // While an episode is on, flagged looks belong to it and begin to be counted anew after it.
        if was_raised || step == Step::Raised {
            self.flagged_looks = None;
        } else if stands_out {
            let others = of_all.without(self.quiet);
            self.count_flagged(t_ns, named, others, rules);
            // As long as the sequential test has evidence, the fault did not go: that test decides.
            if was_quiet && self.is_intermittent(t_ns, others, rules) {
                return None;
            }
        }

        // What the sequential test says of this look decides what becomes of the draft.
        match step {
            Step::Quiet => {
                // what was suspected was chance
                self.draft = None;
                return None;
            }
            Step::Suspect { begins: true } => {
                // the first look that may belong to a fault: what was drafted before is discarded
                (self.onset_ns, self.looks, self.draft) = (t_ns, 1, None);
            }
            Step::Suspect { begins: false } => {}
            Step::Raised => self.open_draft(rules).raised_at_ns = t_ns,
            // the first look that fits the return to healthy is remembered: the episode may end
            // there
            Step::Faulty { fading: true } => {
                let before = self.looks - 1;
                self.open_draft(rules).fading.get_or_insert((t_ns, before));
            }
            Step::Faulty { fading: false } => self.open_draft(rules).fading = None,
            Step::Ended => {
                let before = self.looks - 1;
                let mut over = self.draft.take()?;
                over.fading.get_or_insert((t_ns, before));
                return Some(over);
            }
        }

        if let Some(named) = named {
            self.open_draft(rules).add(named, rules);
        }
        None
    }

    /// Counts one more flagged look that stands out. Where nothing speaks for a fault up to this look, the
    /// test begins anew with it, so that a long healthy past does not hide a fault that begins now.
    fn count_flagged(
        &mut self,
        t_ns: i64,
        named: Option<&IsolatedSignal>,
        others: Flags,
        rules: &Rules,
    ) {
        let before = self.quiet.looks - 1;
        let begin_anew = |all: &FlaggedLooks| all.flags(before).begin_anew(others);
        if self.flagged_looks.as_deref().is_none_or(begin_anew) {
            let draft = EpisodeDraft::new(rules);
            let new = FlaggedLooks { flagged: 0, since_ns: t_ns, before, draft };
            self.flagged_looks = Some(Box::new(new));
        }
        if let Some(all) = &mut self.flagged_looks {
            all.flagged += 1;
            named.iter().for_each(|named| all.draft.add(named, rules));
        }
    }

    /// Raises a fault that comes and goes if the flagged looks are by now too many for false alarms:
    /// their evidence has to reach the same bound as that of the sequential test. Returns whether the fault
    /// was raised. The episode begins with the first of these looks, and its draft is theirs.
    fn is_intermittent(&mut self, t_ns: i64, others: Flags, rules: &Rules) -> bool {
        let looks = self.quiet.looks;
        let suffices = |all: &mut Box<FlaggedLooks>| {
            all.flags(looks).evidence(others) >= f64::from(rules.bound)
        };
        let Some(all) = self.flagged_looks.take_if(suffices) else { return false };
        let flags = all.flags(looks);
        self.evidence.raise_intermittent(flags.share() as f32);
        (self.onset_ns, self.looks) = (all.since_ns, flags.looks);
        let share = Some(flags.share());
        self.draft = Some(Box::new(EpisodeDraft { raised_at_ns: t_ns, share, ..all.draft }));
        true
    }

    /// The channel's draft; a new one if there is none.
    fn open_draft(&mut self, rules: &Rules) -> &mut EpisodeDraft {
        self.draft.get_or_insert_with(|| Box::new(EpisodeDraft::new(rules)))
    }
}
