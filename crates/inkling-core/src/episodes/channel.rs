//! Follows one channel look by look: whether an episode is on, when it began, and when it ends.
//!
//! In: the channel's looks in the order of time, and what isolation says of flagged ones. Out: the
//! drafts of episodes that have ended; the draft of the one that is on stays with the channel.
//!
//! Two tests run side by side, each with its own onset and draft: `evidence` (CUSUM) raises a fault
//! that shifts the channel's looks, and ends every fault; `intermittent` raises a fault that is
//! flagged now and then, with healthy looks between.

use super::episode_draft::EpisodeDraft;
use super::evidence::{Evidence, FIRST_IN_MEDIANS, Step};
use super::intermittent::{Flags, QuietLooks};
use super::rules::Rules;
use super::{Counts, IsolatedSignal, Looks, Untimely};
use std::cmp::Ordering;

#[derive(Debug, Default)]
pub struct Channel {
    pub number: u32,
    pub last_ns: i64,
    pub last_ratio: f32,
    pub looks: u64,
    /// Time of the onset, ns, of the episode that is on or of what may become one.
    pub onset_ns: i64,
    /// The model that judged the channel last; `None`: none has judged it.
    pub model: Option<u16>,
    /// The threshold of that model over the median of healthy statistics.
    in_medians: f32,
    pub own: bool,
    pub evidence: Evidence,
    pub draft: Option<Box<EpisodeDraft>>,
    flagged_looks: Option<Box<FlaggedLooks>>,
}

/// Flagged looks that stand out from the channel's level: evidence for what comes and goes.
#[derive(Clone, Debug)]
struct FlaggedLooks {
    flagged: u64,
    /// Time of the first, ns, and how many looks came before it while no episode was on.
    since_ns: i64,
    before: u64,
    draft: EpisodeDraft,
}

impl FlaggedLooks {
    /// The looks since the first of these, out of `looks` while no episode was on.
    fn flags(&self, looks: u64) -> Flags {
        Flags { looks: looks - self.before, flagged: self.flagged }
    }
}

impl Channel {
    pub fn new(number: u32) -> Channel {
        Channel {
            number,
            last_ns: i64::MIN,
            last_ratio: f32::NAN,
            in_medians: FIRST_IN_MEDIANS,
            ..Channel::default()
        }
    }

    /// Whether a look is later than all before; then its time and ratio are kept. Any other is
    /// counted as too late, repeated, or one of several at one time.
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

    pub fn judge_by(&mut self, looks: &Looks, own: bool) {
        if self.model != Some(looks.model) {
            // a threshold in medians that is not known is taken to be that of the model before
            let next = if looks.in_medians > 0.0 { looks.in_medians } else { self.in_medians };
            // the threshold of its own baseline does not change with the model
            let lower = if own { 1.0 } else { self.in_medians / next };
            self.evidence.change_model(lower);
            (self.model, self.in_medians) = (Some(looks.model), next);
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

    /// Takes in the next look, and returns the draft of the episode that has ended with it. `named`:
    /// of a flagged look; `quiet`: the looks at all channels, this one among them, and the place of the channel.
    pub fn look(
        &mut self,
        t_ns: i64,
        ratio: f32,
        named: Option<&IsolatedSignal>,
        (quiet, place): (&mut QuietLooks, usize),
        rules: &Rules,
    ) -> Option<Box<EpisodeDraft>> {
        let was_raised = self.evidence.raised;

        // a healthy channel that always reads high is flagged now and then, never far from its level
        let stands_out = self.evidence.stands_out(ratio);
        let was_quiet = self.evidence.is_quiet();
        let step = self.evidence.look(ratio, rules.bound);
        self.looks += 1;

        if was_raised || step == Step::Raised {
            self.flagged_looks = None;
        } else if stands_out {
            let (others, looks) = (quiet.of_others(place), quiet.looks(place));
            self.count_flagged(t_ns, named, (looks - 1, others), rules);
            // as long as the sequential test has evidence, the fault did not go
            if was_quiet && self.is_intermittent(t_ns, (looks, others), rules) {
                return None;
            }
        }

        match step {
            // what was suspected was chance
            Step::Quiet => {
                self.draft = None;
                return None;
            }
            Step::Suspect { begins: true } => {
                (self.onset_ns, self.looks, self.draft) = (t_ns, 1, None);
            }
            Step::Suspect { begins: false } => {}
            Step::Raised => self.open_draft(rules).raised_at_ns = t_ns,
            // the episode may end with the first look that fits the return to healthy
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

    /// Counts one more flagged look that stands out. Where nothing speaks for a fault the test begins anew. `before`:
    /// number of looks before it while no episode was on.
    fn count_flagged(
        &mut self,
        t_ns: i64,
        named: Option<&IsolatedSignal>,
        (before, others): (u64, Flags),
        rules: &Rules,
    ) {
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

    /// Raises a fault that comes and goes, from its first flagged look on, if the evidence reaches the
    /// bound, and tells whether it does. `looks`: number of looks while no episode was on.
    fn is_intermittent(&mut self, t_ns: i64, (looks, others): (u64, Flags), rules: &Rules) -> bool {
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

    fn open_draft(&mut self, rules: &Rules) -> &mut EpisodeDraft {
        self.draft.get_or_insert_with(|| Box::new(EpisodeDraft::new(rules)))
    }
}
