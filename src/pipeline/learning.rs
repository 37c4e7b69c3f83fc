//! Learns models from healthy windows while the signals flow, in the identify stage, and says who judges a
//! burst.
//!
//! In: bursts, about in the order of their times, from `models` ([`Learning::take`]). Out: the judge of every
//! burst ([`Learning::judge_of`]), once every window that had ended by the burst's time was learned; the models
//! by number ([`Schedule`]).
//!
//! A burst goes this way. It belongs to a group (a printhead at one sampling), which is learned by itself. If
//! the burst may begin a window, it waits until no earlier burst can come any more, since windows are placed by
//! the first burst. In its turn it places the windows that begin up to it, and its signals are sampled for the
//! windows that it lies in. A window is over when some burst, of any group, is later than its end by the
//! reorder time: then its model is learned (`progress`), and entered under the next number.
//!
//! A burst that comes later still, and that would have changed a window that was placed or learned, is noticed
//! (`settled_ns`): the whole recording is then learned in two passes ([`super::two_passes`]), with the same result.
//!
//! Held in memory are the samples of open windows, at most [`HELD_BYTES`] (a recording that needs more is
//! learned in two passes, too), and for each printhead the bursts that wait, at most [`WAITING_BYTES`]; beyond
//! that they begin their windows without waiting longer.

use super::groups::{ByGroup, GroupKey};
use super::placing::Placing;
use super::progress::{Entry, Progress};
use super::run::Replay;
use super::schedule::{Refusal, Schedule, Timeline};
use super::window_rules::Window;
use super::{PipelineError, Result};
use inkling_core::burst::Burst;
use inkling_core::design::Judge;
use inkling_core::identify::reservoir::Reservoir;
use inkling_core::side_by_side::side_by_side;
use inkling_core::verdict::Reason;
use std::sync::Arc;

/// Usual reorder time, ns: by how much a burst may be earlier than bursts that stand before it in the file.
pub const USUAL_REORDER_NS: u64 = 100_000_000;
/// Longest reorder time, ns, taken where the chunk index says that the file is that far out of order.
pub const MOST_REORDER_NS: u64 = 2_000_000_000;
/// Maximum bytes of signals held, over all open windows.
const HELD_BYTES: usize = 64 << 20;
/// Maximum bytes of samples in the waiting bursts of one printhead.
const WAITING_BYTES: usize = 16 << 20;

#[derive(Debug)]
pub struct Learning<'a> {
    pub(super) replay: &'a Replay,
    /// The reorder time, ns: a burst may be earlier by that much than bursts that came before it.
    reorder_ns: i64,
    pub workers: usize,
    pub schedule: Schedule<'a>,
    /// Index in `groups` by group; `None`: the group is judged without windows.
    numbers: ByGroup,
    pub(super) groups: Vec<LearnedGroup>,
    /// Time of the latest burst so far, of any group, ns.
    latest_ns: i64,
    /// Before a burst of that time, ns, there is nothing to settle (`Learning::settle`).
    due_ns: i64,
    /// End and group of the window whose model got the last number: numbers ascend in this order.
    numbered: Option<(i64, GroupKey)>,
    /// Bytes of signals held for all open windows.
    held: usize,
    /// Whether all windows were learned: every burst that comes is only judged.
    pub over: bool,
}

#[derive(Debug)]
pub(super) struct LearnedGroup {
    pub key: GroupKey,
    progress: Progress,
    /// Places the group's windows; `None`: `identify.spans` gives them.
    pub placing: Option<Placing>,
    /// Bursts that may begin windows, while earlier ones may still come.
    waiting: Vec<Burst>,
    waiting_bytes: usize,
    /// Time of the earliest waiting burst; `i64::MAX`: none waits.
    waiting_from_ns: i64,
    /// The windows that were placed and not learned from yet.
    pub open: Vec<OpenWindow>,
    /// A burst that comes now and is earlier than this, ns, would have changed a window.
    settled_ns: i64,
    timeline: Timeline,
}

#[derive(Debug)]
pub(super) struct OpenWindow {
    pub window: Window,
    bursts: u64,
    /// A bounded sample of its usable signals.
    reservoir: Reservoir,
}

/// The error that sends the recording through two passes: a burst came too late for what was learned.
fn out_of_order(of: &GroupKey) -> PipelineError {
    PipelineError::NeedsTwoPasses(format!(
        "bursts of {} come long after later ones",
        inkling_io::printable::line(&of.printhead, 64)
    ))
}

impl<'a> Learning<'a> {
    pub fn new(
        replay: &'a Replay,
        schedule: Schedule<'a>,
        reorder_ns: i64,
        workers: usize,
    ) -> Learning<'a> {
        Learning {
            replay,
            reorder_ns,
            workers,
            schedule,
            numbers: ByGroup::default(),
            groups: Vec::new(),
            latest_ns: i64::MIN,
            due_ns: i64::MAX,
            numbered: None,
            held: 0,
            over: false,
        }
    }

    pub fn take(&mut self, burst: &Burst) -> Result<()> {
        let t_ns = burst.t_acq_ns;
        self.latest_ns = self.latest_ns.max(t_ns);
        if let Some(number) = self.number_of(burst) {
            self.take_of(number, burst)?;
        }
        if self.latest_ns >= self.due_ns { self.settle() } else { Ok(()) }
    }

    fn take_of(&mut self, number: usize, burst: &Burst) -> Result<()> {
        let t_ns = burst.t_acq_ns;
        let group = &mut self.groups[number];
        if t_ns < group.settled_ns {
            return Err(out_of_order(&group.key));
        }
        if group.progress.is_over(self.replay) {
            return Ok(()); // no later window changes who judges it
        }
        // once a burst of the time `sure_ns` came, none may come any more that is earlier than this one
        let sure_ns = t_ns.saturating_add(self.reorder_ns);
        if !group.may_begin(t_ns) || sure_ns <= self.latest_ns {
            return self.learn(number, burst);
        }
        group.wait(burst);
        self.due_ns = self.due_ns.min(sure_ns);
        match group.waiting_bytes > WAITING_BYTES {
            // at such a rate of data they have waited long enough
            true => self.place_waiting(number, self.latest_ns),
            false => Ok(()),
        }
    }

    pub fn end(&mut self) -> Result<()> {
        if self.over {
            return Ok(());
        }
        self.latest_ns = i64::MAX; // at the end of all times everything is due
        self.settle()?;
        self.close();
        Ok(())
    }

    /// Notes that all windows were learned, and which of them were refused.
    pub(super) fn close(&mut self) {
        self.over = true;
        let refusals = self.groups.iter_mut().flat_map(|group| group.progress.refusals.drain(..));
        self.schedule.refusals = refusals.collect();
        let order = |r: &Refusal| (r.printhead.clone(), r.from_ns, r.to_ns, r.why.clone());
        self.schedule.refusals.sort_by_cached_key(order);
    }

    /// `None`: that is not known yet. An error: too many models, or a model of which no judge can be made.
    pub fn judge_of(&mut self, burst: &Burst) -> Result<Option<Result<Arc<Judge>, Reason>>> {
        if !self.schedule.fits(burst) {
            self.schedule.note_sampling(burst);
            return Ok(Some(Err(Reason::DesignMismatch)));
        }
        // a group without windows is judged by the design's model of its name, another by its timeline
        let (model, nobody) = match self.number_of(burst) {
            None => (self.schedule.model_of(&burst.printhead), Reason::NoModel),
            Some(number) => {
                let group = &self.groups[number];
                if !(self.over || self.is_known(group, burst.t_acq_ns)) {
                    return Ok(None);
                }
                (group.timeline.at(burst.t_acq_ns), self.replay.nobody())
            }
        };
        match model {
            Some(model) => Ok(Some(Ok(self.schedule.judge(model, self.groups.len())?))),
            None => Ok(Some(Err(nobody))),
        }
    }

    /// Whether it is known who judges a burst of time `t_ns`: the windows that end by `t_ns` were learned, and
    /// some model was, since the first one also judges everything before.
    fn is_known(&self, group: &LearnedGroup, t_ns: i64) -> bool {
        let ends_before = |open: &OpenWindow| open.window.to_ns <= t_ns;
        let first_ns = self.replay.first_ns();
        // a waiting burst may begin a window, and that window may end by `t_ns`
        let waits = group.waiting_from_ns.saturating_add(first_ns) <= t_ns;
        !group.timeline.0.is_empty()
            && (self.replay.knows_by_design() || !(waits || group.open.iter().any(ends_before)))
    }

    /// Index of a burst's group, which is added if it is new; `None`: the group needs no windows.
    pub(super) fn number_of(&mut self, burst: &Burst) -> Option<usize> {
        let Learning { numbers, groups, replay, schedule, due_ns, reorder_ns, .. } = self;
        numbers.of(burst, |key| {
            let needs = replay.needs_windows(key, burst.sample_period_s);
            let number = groups.len();
            needs.then(|| {
                let mut group = LearnedGroup::new(key, burst.sample_period_s, replay, schedule);
                // windows that the settings give are open from the start
                for &(from_ns, to_ns) in &replay.spans {
                    group.open(replay, Window { group: number, from_ns, to_ns });
                    *due_ns = (*due_ns).min(to_ns.saturating_add(*reorder_ns));
                }
                groups.push(group);
                number
            })
        })
    }

    fn learn(&mut self, number: usize, burst: &Burst) -> Result<()> {
        let (replay, t_ns) = (self.replay, burst.t_acq_ns);
        let group = &mut self.groups[number];
        if let Some(mut placing) = group.placing.take() {
            // windows begin anew here: an earlier burst that comes now would have begun them elsewhere
            if placing.begins_at(t_ns) {
                group.settled_ns = group.settled_ns.max(t_ns);
            }
            let reached = placing.reach(t_ns, |from_ns, to_ns| {
                group.open(replay, Window { group: number, from_ns, to_ns });
                self.due_ns = self.due_ns.min(to_ns.saturating_add(self.reorder_ns));
            });
            group.placing = Some(placing);
            reached?;
        }

        self.sample(number, burst);
        match self.held > HELD_BYTES {
            true => Err(PipelineError::NeedsTwoPasses(
                "its windows hold more signals at a time than are kept".into(),
            )),
            false => Ok(()),
        }
    }

    pub(super) fn sample(&mut self, number: usize, burst: &Burst) {
        for open in &mut self.groups[number].open {
            if (open.window.from_ns..open.window.to_ns).contains(&burst.t_acq_ns) {
                let before = open.reservoir.bytes();
                open.bursts += 1;
                self.replay.offer(burst, &mut open.reservoir);
                self.held += open.reservoir.bytes() - before;
            }
        }
    }

    /// Settles what is due: bursts that waited long enough, windows that are over; finds when to settle next.
    fn settle(&mut self) -> Result<()> {
        // 1. the bursts before which no earlier one can come any more
        let (latest_ns, reorder_ns) = (self.latest_ns, self.reorder_ns);
        let is_due = |t_ns: i64| t_ns.saturating_add(reorder_ns) <= latest_ns;
        for number in 0..self.groups.len() {
            let group = &mut self.groups[number];
            if !group.waiting.is_empty() && is_due(group.waiting_from_ns) {
                self.place_waiting(number, latest_ns.saturating_sub(reorder_ns))?;
            }
        }

        // 2. the windows that ended more than the reorder time ago
        let entries = self.learn_from(|window| is_due(window.to_ns));
        self.enter(entries)?;

        // 3. the next time at which a window ends or a burst has waited long enough
        let next = self.groups.iter().map(LearnedGroup::next_ns).min().unwrap_or(i64::MAX);
        self.due_ns = next.saturating_add(self.reorder_ns);
        Ok(())
    }

    /// Learns from a group's waiting bursts, in the order of their times; some of those after `sure_ns` wait on.
    fn place_waiting(&mut self, number: usize, sure_ns: i64) -> Result<()> {
        let group = &mut self.groups[number];
        let mut waiting = std::mem::take(&mut group.waiting);
        (group.waiting_bytes, group.waiting_from_ns) = (0, i64::MAX);
        waiting.sort_by_key(|burst| burst.t_acq_ns);
        for burst in waiting {
            let t_ns = burst.t_acq_ns;
            let group = &mut self.groups[number];
            // an earlier one may have begun its windows meanwhile, and then it begins none
            match t_ns > sure_ns && group.may_begin(t_ns) {
                true => group.wait(&burst),
                false => self.learn(number, &burst)?,
            }
        }
        Ok(())
    }

    /// Learns from the open windows that are `over`, and returns what they add to their groups' timelines. Those of
    /// a group are learned in the order of their begins, since each is compared with the models before.
    pub(super) fn learn_from(&mut self, over: impl Fn(&Window) -> bool) -> Vec<(Window, Entry)> {
        let mut of_groups = Vec::new();
        for group in &mut self.groups {
            let windows = group.open.extract_if(.., |open| over(&open.window));
            let mut windows: Vec<OpenWindow> = windows.collect();
            windows.sort_by_key(|open| open.window.from_ns);
            self.held -= windows.iter().map(|open| open.reservoir.bytes()).sum::<usize>();
            if !windows.is_empty() {
                of_groups.push((group, windows));
            }
        }
        let replay = self.replay;
        let learned = side_by_side(self.workers, of_groups, |(group, windows)| {
            let close = |open| group.close(replay, open);
            windows.into_iter().filter_map(close).collect::<Vec<_>>()
        });
        learned.into_iter().flatten().collect()
    }

    /// Enters what windows add into the schedule and their groups' timelines. Models are numbered in the order
    /// in which they become valid (by the window's end, then by group), which is also that of two passes.
    pub(super) fn enter(&mut self, mut entries: Vec<(Window, Entry)>) -> Result<()> {
        let valid_from = |of: &Window| (of.to_ns, &self.groups[of.group].key);
        entries.sort_by(|(a, _), (b, _)| valid_from(a).cmp(&valid_from(b)));
        for (window, entry) in entries {
            let group = &mut self.groups[window.group];
            let (from_ns, number) = match entry {
                Entry::Known => (i64::MIN, self.schedule.model_of(&group.key.printhead)),
                Entry::Learned { from_ns, model, reference_v } => {
                    let now = (window.to_ns, group.key.clone());
                    if self.numbered.as_ref().is_some_and(|before| *before > now) {
                        return Err(out_of_order(&group.key));
                    }
                    self.numbered = Some(now);
                    (from_ns, Some(self.schedule.add(model, reference_v)?))
                }
            };
            if let Some(number) = number {
                group.timeline.enter(from_ns, number);
            }
        }
        Ok(())
    }
}

impl LearnedGroup {
    fn new(key: &GroupKey, sample_period_s: f64, replay: &Replay, schedule: &Schedule) -> Self {
        let placing = || Placing::new(replay.first_ns(), replay.every_ns());
        LearnedGroup {
            key: key.clone(),
            progress: Progress::start(schedule, &key.printhead, sample_period_s),
            placing: replay.spans.is_empty().then(placing),
            waiting: Vec::new(),
            waiting_bytes: 0,
            waiting_from_ns: i64::MAX,
            open: Vec::new(),
            settled_ns: i64::MIN,
            timeline: Timeline::default(),
        }
    }

    /// Whether windows may begin with a burst of that time; then a later one in the file may be earlier and
    /// begin them instead. While a burst waits, so does every later one.
    fn may_begin(&self, t_ns: i64) -> bool {
        t_ns >= self.waiting_from_ns || self.placing.as_ref().is_some_and(|p| p.begins_at(t_ns))
    }

    fn wait(&mut self, burst: &Burst) {
        self.waiting.push(burst.clone());
        self.waiting_bytes += burst.samples.len();
        self.waiting_from_ns = self.waiting_from_ns.min(burst.t_acq_ns);
    }

    pub fn open(&mut self, replay: &Replay, window: Window) {
        let samples = self.key.samples as usize;
        let reservoir = Reservoir::new(samples, replay.most_signals(samples));
        self.open.push(OpenWindow { window, bursts: 0, reservoir });
    }

    /// Learns from a window that is over. `None`: it adds nothing to the timeline.
    fn close(&mut self, replay: &Replay, open: OpenWindow) -> Option<(Window, Entry)> {
        let OpenWindow { window, bursts, reservoir } = open;
        self.settled_ns = self.settled_ns.max(window.to_ns);
        if bursts == 0 && replay.spans.is_empty() {
            return None; // nothing was printed then: nothing to learn, nothing to judge by it
        }
        Some((window, self.progress.take(replay, window, &reservoir)?))
    }

    /// When to settle next, before the reorder time is added: the first end of a window, or a waiting burst.
    fn next_ns(&self) -> i64 {
        let ends = self.open.iter().map(|open| open.window.to_ns);
        ends.min().unwrap_or(i64::MAX).min(self.waiting_from_ns)
    }
}
