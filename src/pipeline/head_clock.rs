//! What the times of a printhead's bursts are worth; what was odd about them `clock_words` says.
//!
//! In: the times of its bursts, and those at which they were recorded, in the order of the file, from the identify stage
//! ([`HeadClock::hear`]). Out: whether a burst stands in the order of time ([`Standing`]).
//!
//! A burst is *late* if it is earlier than the latest one before it by more than the reorder time, and a *stray* if it
//! lies apart from it by more than `JUMP_NS`, earlier or later, or if it is dated so far ahead of its record that no
//! pause explains it. Both are judged by what is known, and teach nothing; faults are followed over late ones, for which
//! they are put in order. After `STEADY` such moments in a row that follow each other in order the clock was set: there a
//! new stretch of the same printhead begins. But where they go on from before a leap (a pause, as it seemed), after fewer
//! moments than that, what came after the leap was astray. A file whose chunks are in no order tells nothing of clocks.

use super::groups::GroupKey;
use super::log_clock::LogClock;
use super::not_judged::NotJudged;
use super::numbers::{DELAY_NS, DIFFER_NS, JUMP_NS, STEADY};
use crate::report::WrongStretch;
use inkling_core::burst::Burst;
use inkling_io::recording::Recording;

/// Usual reorder time, ns: by how much a burst may be earlier than bursts that stand before it in the file; and the
/// longest. A file that is further out of order is in none.
const USUAL_REORDER_NS: u64 = 100_000_000;
const MOST_REORDER_NS: u64 = 2_000_000_000;

/// At most so many steps of a clock, and so many times strays, are put right.
const MOST_STEPS: usize = 64;

/// What the file says of the order of its bursts.
#[derive(Clone, Copy, Debug)]
pub struct FileOrder {
    /// By how much a burst may be earlier than others that stand before it, ns.
    pub reorder_ns: i64,
    /// Whether no burst is earlier by more than that. Of what is being written this is taken for granted; another file
    /// that does not say may be in any order.
    pub is_of_times: bool,
    /// Whether its chunks are in no order of time.
    pub is_shuffled: bool,
}

impl FileOrder {
    pub fn of(recording: &Recording) -> FileOrder {
        let disorder = recording.disorder_ns.unwrap_or(MOST_REORDER_NS);
        let is_known = recording.is_growing() || recording.disorder_ns.is_some();
        FileOrder {
            reorder_ns: disorder.clamp(USUAL_REORDER_NS, MOST_REORDER_NS) as i64,
            is_of_times: is_known && disorder <= MOST_REORDER_NS,
            is_shuffled: recording.is_shuffled,
        }
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Standing {
    #[default]
    InOrder,
    /// It stands in the file after later ones: it is judged by what is known, and teaches nothing.
    Late,
    /// It is dated apart from the others; besides, no fault is followed over it.
    Stray,
    /// It is in order, and the first burst of a new stretch of time: the clock was set.
    Set,
}

/// Bursts that follow each other in order.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stretch {
    pub(super) first_ns: i64,
    pub(super) latest_ns: i64,
    moments: u32,
    bursts: u64,
    /// The longest time between two of its moments.
    widest_ns: i64,
}

impl Stretch {
    fn of(t_ns: i64) -> Stretch {
        Stretch { first_ns: t_ns, latest_ns: t_ns, moments: 1, bursts: 1, widest_ns: 0 }
    }

    fn continues_with(&self, t_ns: i64, reorder_ns: i64, jump_ns: i64) -> bool {
        let after = t_ns.saturating_sub(self.latest_ns);
        (-reorder_ns..=jump_ns).contains(&after)
    }

    /// This one, and then another.
    fn joined(self, with: Stretch) -> Stretch {
        Stretch {
            first_ns: self.first_ns,
            latest_ns: self.latest_ns.max(with.latest_ns),
            moments: self.moments.saturating_add(with.moments),
            bursts: self.bursts + with.bursts,
            widest_ns: self.widest_ns.max(with.widest_ns),
        }
    }

    fn add(&mut self, t_ns: i64) {
        self.moments = self.moments.saturating_add(u32::from(t_ns > self.latest_ns));
        self.widest_ns = self.widest_ns.max(t_ns.saturating_sub(self.latest_ns));
        self.latest_ns = self.latest_ns.max(t_ns);
        self.bursts += 1;
    }
}

/// A clock that was set: the latest time before, the time that the next moment would have had, and the one that
/// it has, ns.
#[derive(Clone, Copy, Debug)]
pub(super) struct Step {
    pub(super) before_ns: i64,
    pub(super) expected_ns: i64,
    pub(super) after_ns: i64,
    /// Whether the records' times went back with it: then the file may be in another order.
    pub(super) is_of_records: bool,
}

impl Step {
    fn by_ns(&self) -> u64 {
        self.after_ns.abs_diff(self.expected_ns)
    }
}

/// A longer time between two bursts than clocks differ by: a pause, or the clock of what follows is wrong.
#[derive(Clone, Copy, Debug)]
struct Leap {
    before: Stretch,
    to_ns: i64,
}

/// What the time of its record says of a burst's time.
#[derive(Clone, Copy, Debug, Default)]
struct ByRecord {
    /// It is dated ahead, if it comes after a leap.
    is_ahead: bool,
    /// It went back by as much as the burst did.
    is_back: bool,
}

#[derive(Clone, Debug)]
pub struct HeadClock {
    pub key: GroupKey,
    order: FileOrder,
    /// Beyond this, ns, a burst is dated apart: [`JUMP_NS`], or more where bursts are known to be further apart.
    jump_ns: i64,
    pub(super) bursts: u64,
    /// The bursts of the present stretch, and those that came last and are late or strays.
    pub(super) stretch: Option<Stretch>,
    aside: Option<Stretch>,
    /// The last leap within the present stretch.
    leap: Option<Leap>,
    /// Both times of the last burst in order, ns.
    last: (i64, i64),
    /// Number of strays, and the times of the first and last of them in the file, ns.
    pub(super) strays: u64,
    pub(super) strays_at: Option<(i64, i64)>,
    /// From when to when strays are dated that follow each other, at most [`MOST_STEPS`] times.
    strays_ns: Vec<[i64; 2]>,
    /// Number of late bursts, and by how much the latest of them are late, ns.
    pub(super) late: u64,
    pub(super) latest_ns: u64,
    /// How often the clock was set, and the largest step.
    pub(super) steps: u64,
    pub(super) largest: Option<Step>,
    /// Where it was set back, at most [`MOST_STEPS`].
    wrong: Vec<WrongStretch>,
    pub(super) against_log: LogClock,
}

impl HeadClock {
    pub fn new(key: GroupKey, order: FileOrder) -> HeadClock {
        HeadClock {
            key,
            order,
            jump_ns: JUMP_NS,
            bursts: 0,
            stretch: None,
            aside: None,
            leap: None,
            last: (0, 0),
            strays: 0,
            strays_at: None,
            strays_ns: Vec::new(),
            late: 0,
            latest_ns: 0,
            steps: 0,
            largest: None,
            wrong: Vec::new(),
            against_log: LogClock::default(),
        }
    }

    /// Takes in the next burst in the file.
    pub fn hear(&mut self, burst: &Burst) -> Standing {
        let (t_ns, logged_ns) = (burst.t_acq_ns, burst.logged_ns);
        let (before_ns, before_logged_ns) = self.last;
        let by_ns = t_ns.saturating_sub(before_ns);
        let of_record_ns = logged_ns.saturating_sub(before_logged_ns);
        let record = ByRecord {
            is_ahead: self.against_log.is_ahead(t_ns, logged_ns),
            is_back: by_ns < 0 && by_ns.abs_diff(of_record_ns) <= DELAY_NS,
        };
        self.against_log.hear(t_ns, logged_ns);
        let standing = self.stand(t_ns, record);
        if matches!(standing, Standing::InOrder | Standing::Set) {
            self.last = (t_ns, logged_ns);
        }
        if standing == Standing::Set {
            self.against_log.set();
        }
        standing
    }

    fn stand(&mut self, t_ns: i64, record: ByRecord) -> Standing {
        self.bursts += 1;
        let Some(stretch) = &mut self.stretch else {
            self.stretch = Some(Stretch::of(t_ns));
            return Standing::InOrder;
        };
        let since = t_ns.saturating_sub(stretch.latest_ns);
        let leaps = since > DIFFER_NS as i64;
        let is_ahead = record.is_ahead && leaps;
        if !is_ahead && stretch.continues_with(t_ns, self.order.reorder_ns, self.jump_ns) {
            if leaps {
                self.leap = Some(Leap { before: *stretch, to_ns: t_ns });
            }
            stretch.add(t_ns);
            if let Some(aside) = self.aside.take() {
                self.set_aside(aside);
            }
            return Standing::InOrder;
        }
        let is_stray = is_ahead || since.unsigned_abs() > self.jump_ns as u64;
        let apart = if is_stray { Standing::Stray } else { Standing::Late };
        if self.order.is_shuffled {
            self.set_aside(Stretch::of(t_ns));
            return apart;
        }

        let aside = match self.aside.take() {
            Some(mut aside) if aside.continues_with(t_ns, self.order.reorder_ns, i64::MAX) => {
                aside.add(t_ns);
                aside
            }
            other => {
                other.into_iter().for_each(|of| self.set_aside(of));
                Stretch::of(t_ns)
            }
        };
        if aside.moments < STEADY {
            self.aside = Some(aside);
            return apart;
        }
        self.set_to(aside, record.is_back);
        Standing::Set
    }

    /// Counts bursts that came after those of `self.stretch`: as strays, or as late.
    fn set_aside(&mut self, of: Stretch) {
        match self.stretch.filter(|here| !self.is_apart(here, &of)) {
            Some(here) => {
                self.late += of.bursts;
                self.latest_ns = self.latest_ns.max(here.latest_ns.abs_diff(of.first_ns));
            }
            None => self.stray(of),
        }
    }

    fn is_apart(&self, here: &Stretch, of: &Stretch) -> bool {
        let apart = of.latest_ns.abs_diff(here.first_ns).min(of.first_ns.abs_diff(here.latest_ns));
        // what came late is earlier; a burst in order that was put aside was dated ahead of its record
        apart > self.jump_ns as u64 || of.first_ns > here.latest_ns
    }

    /// Counts what is dated apart from `self.stretch`.
    fn stray(&mut self, of: Stretch) {
        self.strays += of.bursts;
        if self.strays_ns.len() < MOST_STEPS {
            self.strays_ns.push([of.first_ns, of.latest_ns]);
        }
        let (_, to_ns) = self.strays_at.get_or_insert((of.first_ns, of.latest_ns));
        *to_ns = of.latest_ns;
    }

    /// Goes on with bursts that lay aside. What came before was itself astray if it was as short. `is_of_records`: whether
    /// the records' times went back with them.
    fn set_to(&mut self, aside: Stretch, is_of_records: bool) {
        // whoever prints once a week is not astray the next time
        self.jump_ns = self.jump_ns.max(aside.widest_ns.saturating_mul(2));
        let Some(mut before) = self.stretch.replace(aside) else { return };
        if let Some(Leap { before: here, to_ns }) = self.leap.take()
            && before.moments - here.moments < STEADY
            && here.continues_with(aside.first_ns, self.order.reorder_ns, DIFFER_NS as i64)
        {
            self.stretch = Some(here.joined(aside));
            let moments = before.moments - here.moments;
            before =
                Stretch { first_ns: to_ns, moments, bursts: before.bursts - here.bursts, ..before };
        }
        if before.moments < STEADY {
            let here = self.stretch.filter(|here| self.is_apart(here, &before));
            if here.is_some() || before.latest_ns >= aside.first_ns {
                self.stray(before);
            }
            return;
        }
        self.steps += 1;
        let apart =
            before.latest_ns.saturating_sub(before.first_ns) / i64::from(before.moments - 1);
        let step = Step {
            before_ns: before.latest_ns,
            expected_ns: before.latest_ns.saturating_add(apart),
            after_ns: aside.first_ns,
            is_of_records,
        };
        if step.after_ns < step.expected_ns && self.wrong.len() < MOST_STEPS {
            self.wrong.push(WrongStretch {
                printhead: self.key.printhead.to_string(),
                before_ns: Some([before.first_ns, before.latest_ns]),
                from_ns: aside.first_ns,
                by_ns: step.expected_ns.saturating_sub(step.after_ns),
                strays_ns: Vec::new(),
            });
        }
        if self.largest.is_none_or(|largest| step.by_ns() > largest.by_ns()) {
            self.largest = Some(step);
        }
    }

    /// No more bursts come.
    fn end(&mut self) {
        self.aside.take().into_iter().for_each(|of| self.set_aside(of));
    }

    /// The bursts whose times stand in no order with others.
    pub(super) fn wrong_times(&mut self) -> Vec<WrongStretch> {
        self.end();
        let first_ns = self.stretch.map_or(0, |of| of.first_ns);
        let by_ns = self.against_log.misdated_by_ns();
        let of_all = (by_ns.is_some() || !self.strays_ns.is_empty()).then(|| WrongStretch {
            printhead: self.key.printhead.to_string(),
            before_ns: None,
            from_ns: first_ns,
            by_ns: by_ns.unwrap_or(0),
            strays_ns: self.strays_ns.clone(),
        });
        of_all.into_iter().chain(self.wrong.iter().cloned()).collect()
    }

    /// What was odd about the times, for the report.
    pub(super) fn told(mut self) -> Option<NotJudged> {
        self.end();
        self.in_words().map(|what| NotJudged::of_printhead(&self.key.printhead, what))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: i64 = 1_000_000_000;

    fn heard(times: impl IntoIterator<Item = i64>) -> (Vec<Standing>, Option<String>) {
        let key = GroupKey::of(&Default::default());
        let mut clock = HeadClock::new(
            key,
            FileOrder { reorder_ns: S / 10, is_of_times: true, is_shuffled: false },
        );
        let standing = times.into_iter().map(|t| clock.stand(t, ByRecord::default())).collect();
        (standing, clock.told().map(|of| of.what))
    }

    #[test]
    fn a_clock_that_was_set_begins_a_new_stretch() {
        for by in [-30 * S - S / 2, -3600 * S, 9 * JUMP_NS] {
            let at = |i: i64| 1_700_000_000 * S + i * S + if i >= 20 { by } else { 0 };
            let (standing, said) = heard((0..40).map(at));
            let set = standing.iter().position(|of| *of == Standing::Set);
            assert_eq!(set, Some(20 + STEADY as usize - 1));
            let way = if by < 0 { "back" } else { "forward" };
            assert!(said.as_ref().unwrap().contains(way), "{said:?}");
        }
    }

    #[test]
    fn a_few_bursts_that_are_dated_ahead_are_strays_and_no_clock_was_set() {
        // by their own times alone: what follows goes on from before the leap
        for (astray, ahead) in [(30..31, 3600 * S), (30..33, 600 * S), (0..1, 3600 * S)] {
            let at =
                |i: i64| 1_700_000_000 * S + i * S + if astray.contains(&i) { ahead } else { 0 };
            let (_, said) = heard((0..100).map(at));
            let said = said.unwrap_or_default();
            let of = astray.end - astray.start;
            assert!(said.starts_with(&format!("{of} of 100 bursts")), "{said}");
            assert!(!said.contains("the clock"), "{said}");
        }
        // by the times of their records, at once
        let key = GroupKey::of(&Default::default());
        let order = FileOrder { reorder_ns: S / 10, is_of_times: true, is_shuffled: false };
        let mut clock = HeadClock::new(key, order);
        let mut hear = |i: i64| {
            let logged_ns = 1_700_000_000 * S + i * S;
            let t_acq_ns = logged_ns + if i == 30 { 3600 * S } else { 0 };
            clock.hear(&Burst { t_acq_ns, logged_ns, ..Burst::default() })
        };
        let standing: Vec<Standing> = (0..100).map(&mut hear).collect();
        assert_eq!(standing.iter().filter(|of| **of != Standing::InOrder).count(), 1);
        assert_eq!(standing[30], Standing::Stray);
    }

    #[test]
    fn whoever_prints_seldom_is_believed_once_that_is_seen() {
        // about every third day, for half a year
        let at = |i: i64| 1_700_000_000 * S + i * 3 * JUMP_NS + (i * 7919 % 1000) * 60 * S;
        let (standing, said) = heard((0..60).map(at));
        assert!(standing[STEADY as usize + 1..].iter().all(|of| *of == Standing::InOrder));
        assert_eq!(said, None);
    }

    #[test]
    fn pauses_repeats_and_a_little_disorder_are_not_odd() {
        let times = (0..100).map(|i| {
            (1_700_000_000 + i / 3 + if i > 50 { 3600 } else { 0 }) * S - (i % 3) * S / 20
        });
        let (standing, said) = heard(times);
        assert!(standing.iter().all(|of| *of == Standing::InOrder) && said.is_none(), "{said:?}");
    }
}
