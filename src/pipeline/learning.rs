//! Learns models from healthy windows while the signals flow, in the identify stage.
//!
//! In: bursts, about in the order of their times. Out: the model of every burst, once every window that had
//! ended by then was learned. A window is over when some burst is later than its end by the reorder time. A
//! burst that comes later still, and that would have changed a finished window, is noticed: the whole
//! recording is then learned in two passes ([`super::windows`]), with the same models, numbers and refusals.
//!
//! Two things are held in memory at a time. The first is the samples of the windows that are open, at most
//! [`HELD_BYTES`]; a recording that needs more is learned in two passes, too. The second is, for each
//! printhead, the bursts that may begin windows while earlier ones may still come, at most [`WAITING_BYTES`];
//! beyond that they begin their windows without waiting longer.

use super::PipelineError;
use super::learner::{Learner, Window, offer};
use super::placing::Placing;
use super::progress::{Entry, Progress};
use super::schedule::{Schedule, Timeline};
use super::survey::{ByGroup, GroupKey};
use inkling_core::burst::Burst;
use inkling_core::design::Judge;
use inkling_core::identify::reservoir::Reservoir;
use inkling_core::side_by_side::side_by_side;
use inkling_core::verdict::Reason;
use std::sync::Arc;

/// Usual reorder time, ns: by how much a burst may be earlier than bursts that stand before it in the file.
/// Loggers of several printheads write bursts about as they come.
pub const USUAL_REORDER_NS: u64 = 100_000_000;
/// Longest reorder time, ns, taken where the chunk index says that the file's order is that far off. It is
/// known so much later who judges a burst.
pub const MOST_REORDER_NS: u64 = 2_000_000_000;
/// Maximum bytes of signals held, over all open windows.
const HELD_BYTES: usize = 64 << 20;
/// Maximum bytes of samples in the waiting bursts of one printhead.
const WAITING_BYTES: usize = 16 << 20;

/// Who judges a burst.
#[derive(Debug)]
pub enum Judgement {
    By(Arc<Judge>),
    Reject(Reason),
    /// Not known yet: a window that may decide it is not over.
    NotYet,
}

#[derive(Debug)]
pub struct Learning<'a> {
    learner: &'a Learner<'a>,
    /// The reorder time, ns: a burst may be earlier by that much than bursts that came before it.
    reorder_ns: i64,
    /// Number of threads that learn printheads, or read on ahead, side by side.
    pub workers: usize,
    schedule: Schedule<'a>,
    /// Index in `heads` by group; `None`: the group is judged without windows.
    numbers: ByGroup<Option<usize>>,
    heads: Vec<Head>,
    /// Time of the latest burst so far.
    latest_ns: i64,
    /// Nothing is to be settled before a burst of that time.
    due_ns: i64,
    /// End and group of the window whose model got the last number. Numbers must ascend in this order, which
    /// is the order of two passes.
    numbered: Option<(i64, GroupKey)>,
    /// Bytes of signals held for all open windows.
    held: usize,
    /// Whether the last burst was taken.
    over: bool,
}

/// One group (a printhead at one sampling), as far as it is learned.
#[derive(Debug)]
struct Head {
    key: GroupKey,
    sample_period_s: f64,
    progress: Progress,
    /// Places the group's windows; `None`: `identify.spans` gives them.
    placing: Option<Placing>,
    /// Bursts that may begin windows, while earlier ones may still come.
    waiting: Vec<Burst>,
    /// Bytes of the samples of `waiting`.
    waiting_bytes: usize,
    /// Time of the earliest waiting burst; `i64::MAX`: none waits.
    waiting_from_ns: i64,
    open: Vec<OpenWindow>,
    /// A burst that comes now and is earlier than this would have changed a window that
    /// was already placed or learned.
    settled_ns: i64,
    timeline: Timeline,
}

/// A window for which signals are still collected.
#[derive(Debug)]
struct OpenWindow {
    window: Window,
    /// Number of bursts in it so far.
    bursts: u64,
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
    /// `schedule`: holds the design's models, and gets those that are learned.
    pub fn new(
        learner: &'a Learner<'a>,
        schedule: Schedule<'a>,
        reorder_ns: i64,
        workers: usize,
    ) -> Learning<'a> {
        Learning {
            learner,
            reorder_ns,
            workers,
            schedule,
            numbers: ByGroup::default(),
            heads: Vec::new(),
            latest_ns: i64::MIN,
            due_ns: i64::MAX,
            numbered: None,
            held: 0,
            over: false,
        }
    }

    /// Takes the next burst of the recording.
    pub fn take(&mut self, burst: &Burst) -> Result<(), PipelineError> {
        let t_ns = burst.t_acq_ns;
        self.latest_ns = self.latest_ns.max(t_ns);
        if let Some(number) = self.number_of(burst) {
            self.take_of(number, burst)?;
        }
        if self.latest_ns >= self.due_ns { self.settle() } else { Ok(()) }
    }

    /// Takes the next burst of a group that needs windows: it is learned from, or waits if it may begin a
    /// window and an earlier burst may still come.
    fn take_of(&mut self, number: usize, burst: &Burst) -> Result<(), PipelineError> {
        let t_ns = burst.t_acq_ns;
        let head = &mut self.heads[number];
        if t_ns < head.settled_ns {
            return Err(out_of_order(&head.key));
        }
        if head.progress.is_over(self.learner) {
            return Ok(()); // no later window changes who judges it
        }
        // once a burst of this time came, no burst may come any more that is earlier than this one
        let sure_ns = t_ns.saturating_add(self.reorder_ns);
        if !head.may_begin(t_ns) || sure_ns <= self.latest_ns {
            return self.learn(number, burst);
        }
        head.wait(burst);
        self.due_ns = self.due_ns.min(sure_ns);
        match head.waiting_bytes > WAITING_BYTES {
            true => self.place_waiting(number, self.latest_ns), // at such a rate that is long enough
            false => Ok(()),
        }
    }

    /// Ends the recording: learns from all windows that are still open, and closes the schedule.
    pub fn end(&mut self) -> Result<(), PipelineError> {
        if self.over {
            return Ok(());
        }
        (self.latest_ns, self.over) = (i64::MAX, true);
        // at the end of all times everything is due
        self.settle()?;
        let refusals =
            self.heads.iter_mut().map(|head| std::mem::take(&mut head.progress.refusals));
        let refusals = refusals.flatten().collect();
        let groups = self.heads.iter().map(|head| &head.key);
        self.schedule.close(groups, refusals, self.learner.nobody());
        Ok(())
    }

    pub fn schedule_mut(&mut self) -> &mut Schedule<'a> {
        &mut self.schedule
    }

    /// All models; to be called after [`Learning::end`].
    pub fn into_schedule(self) -> Schedule<'a> {
        self.schedule
    }

    /// Who judges a burst that was taken, if that is known already.
    pub fn judgement(&mut self, burst: &Burst) -> Result<Judgement, PipelineError> {
        if !self.schedule.fits(burst) {
            return Ok(Judgement::Reject(Reason::DesignMismatch));
        }
        // a group without windows is judged by the design's model of its name, another by its timeline
        let (model, nobody) = match self.number_of(burst) {
            None => (self.schedule.model_of(&burst.printhead), Reason::NoModel),
            Some(number) => {
                let head = &self.heads[number];
                if !(self.over || self.is_known(head, burst.t_acq_ns)) {
                    return Ok(Judgement::NotYet);
                }
                (head.timeline.at(burst.t_acq_ns), self.learner.nobody())
            }
        };
        match model {
            Some(model) => Ok(Judgement::By(self.schedule.judge(model)?)),
            None => Ok(Judgement::Reject(nobody)),
        }
    }

    /// Whether it is known who judges a burst of time `t_ns`: no window that is
    /// not learned yet can change it.
    fn is_known(&self, head: &Head, t_ns: i64) -> bool {
        let ends_before = |open: &OpenWindow| open.window.to_ns <= t_ns;
        let first_ns = self.learner.first_ns();
        // a waiting burst may begin a window, which would end by then
        let waits = head.waiting_from_ns.saturating_add(first_ns) <= t_ns;
        !head.timeline.is_empty()
            && (self.learner.knows_by_design() || !(waits || head.open.iter().any(ends_before)))
    }

    /// Index of a burst's group in `heads`; `None`: the group needs no windows.
    fn number_of(&mut self, burst: &Burst) -> Option<usize> {
        let Learning { numbers, heads, learner, due_ns, reorder_ns, .. } = self;
        numbers.of(burst, |key| {
            let needs = learner.needs_windows(key, burst.sample_period_s);
            let number = heads.len();
            needs.then(|| {
                let head = Head::meet(key, burst.sample_period_s, number, learner);
                // windows that the settings give are open from the start
                if let Some(first) = head.open.iter().map(|open| open.window.to_ns).min() {
                    *due_ns = (*due_ns).min(first.saturating_add(*reorder_ns));
                }
                heads.push(head);
                number
            })
        })
    }

    /// Learns from a burst in its turn: places the windows that begin up to it, and samples its signals for
    /// the windows that it lies in.
    fn learn(&mut self, number: usize, burst: &Burst) -> Result<(), PipelineError> {
        let (learner, t_ns) = (self.learner, burst.t_acq_ns);
        let head = &mut self.heads[number];
        if let Some(mut placing) = head.placing.take() {
            // windows begin anew here: an earlier burst that comes now would have begun them elsewhere
            if placing.begins_at(t_ns) {
                head.settled_ns = head.settled_ns.max(t_ns);
            }
            let reached = placing.reach(t_ns, |from_ns, to_ns| {
                head.open(learner, Window { group: number, from_ns, to_ns });
                self.due_ns = self.due_ns.min(to_ns.saturating_add(self.reorder_ns));
            });
            head.placing = Some(placing);
            reached?;
        }

        for open in head.open.iter_mut() {
            if (open.window.from_ns..open.window.to_ns).contains(&t_ns) {
                let before = open.reservoir.bytes();
                open.bursts += 1;
                let (labels, design) = (learner.labels, learner.design);
                offer(learner.settings, labels, design, burst, &mut open.reservoir);
                self.held += open.reservoir.bytes() - before;
            }
        }
        match self.held > HELD_BYTES {
            true => Err(PipelineError::NeedsTwoPasses(
                "its windows hold more signals at a time than are kept".into(),
            )),
            false => Ok(()),
        }
    }

    /// Places the bursts that waited long enough, learns from the windows that are over, and finds when there
    /// is something to settle next.
    fn settle(&mut self) -> Result<(), PipelineError> {
        let is_due = |t_ns: i64, latest_ns: i64| t_ns <= latest_ns;
        // 1. place the bursts that waited for the reorder time, before which no earlier one can come any more
        for number in 0..self.heads.len() {
            let head = &mut self.heads[number];
            let from_ns = head.waiting_from_ns.saturating_add(self.reorder_ns);
            if !head.waiting.is_empty() && is_due(from_ns, self.latest_ns) {
                self.place_waiting(number, self.latest_ns.saturating_sub(self.reorder_ns))?;
            }
        }

        let due = |open: &OpenWindow| {
            is_due(open.window.to_ns.saturating_add(self.reorder_ns), self.latest_ns)
        };
        // 2. take out the windows that ended more than the reorder time ago
        let mut over: Vec<OpenWindow> = Vec::new();
        for head in &mut self.heads {
            over.extend(head.open.extract_if(.., |open| due(open)));
        }
        // 3. Learn from them, in the order in which their models become valid:
        // models are numbered in that order.
        let heads = &self.heads;
        over.sort_by(|a, b| {
            let of = |open: &OpenWindow| (open.window.to_ns, &heads[open.window.group].key);
            of(a).cmp(&of(b)).then(a.window.from_ns.cmp(&b.window.from_ns))
        });
        for (window, entry) in self.models_of(over) {
            self.enter(window, entry)?;
        }

        let next = self.heads.iter().map(Head::next_ns).min().unwrap_or(i64::MAX);
        self.due_ns = next.saturating_add(self.reorder_ns);
        Ok(())
    }

    /// Learns from a group's waiting bursts, in the order of their times. Those later than `sure_ns` that may
    /// begin windows go on waiting.
    fn place_waiting(&mut self, number: usize, sure_ns: i64) -> Result<(), PipelineError> {
        let head = &mut self.heads[number];
        let mut waiting = std::mem::take(&mut head.waiting);
        (head.waiting_bytes, head.waiting_from_ns) = (0, i64::MAX);
        waiting.sort_by_key(|burst| burst.t_acq_ns);
        for burst in waiting {
            let t_ns = burst.t_acq_ns;
            let head = &mut self.heads[number];
            match t_ns > sure_ns && head.may_begin(t_ns) {
                true => head.wait(&burst),
                false => self.learn(number, &burst)?,
            }
        }
        Ok(())
    }

    /// For each window that is over, what it adds to its printhead's timeline, in the order of `over`.
    /// Printheads are learned side by side: they know nothing of each other.
    fn models_of(&mut self, over: Vec<OpenWindow>) -> Vec<(Window, Option<Entry>)> {
        let windows: Vec<Window> = over.iter().map(|open| open.window).collect();
        let mut of_heads: Vec<Vec<(usize, OpenWindow)>> =
            self.heads.iter().map(|_| Vec::new()).collect();
        for (place, open) in over.into_iter().enumerate() {
            self.held -= open.reservoir.bytes();
            of_heads[open.window.group].push((place, open));
        }

        let learner = self.learner;
        let of_heads = self.heads.iter_mut().zip(of_heads).filter(|(_, over)| !over.is_empty());
        let of_heads: Vec<(&mut Head, Vec<(usize, OpenWindow)>)> = of_heads.collect();
        let learned = side_by_side(self.workers, of_heads, |(head, over)| {
            let close = |(place, open)| (place, head.close(learner, open));
            over.into_iter().map(close).collect::<Vec<_>>()
        });
        // back into the order of the windows, whichever thread learned them
        let mut entries: Vec<Option<Entry>> = windows.iter().map(|_| None).collect();
        for (place, entry) in learned.into_iter().flatten() {
            entries[place] = entry;
        }
        windows.into_iter().zip(entries).collect()
    }

    /// Enters what a window adds into the schedule and the group's timeline. An error where a model would get
    /// a number out of the order in which models become valid.
    fn enter(&mut self, window: Window, entry: Option<Entry>) -> Result<(), PipelineError> {
        let Some(entry) = entry else { return Ok(()) };
        let head = &mut self.heads[window.group];
        // two passes would number all models by the ends of their windows: here they must come in that order
        if matches!(entry, Entry::Learned { .. }) {
            let now = (window.to_ns, head.key.clone());
            if self.numbered.as_ref().is_some_and(|before| *before > now) {
                return Err(out_of_order(&head.key));
            }
            self.numbered = Some(now);
        }
        if let Some(since) = entry.enter(&head.key, &mut self.schedule)? {
            head.timeline.enter(since);
        }
        Ok(())
    }
}

impl Head {
    /// Begins to learn a group. `number`: its index in `heads`.
    fn meet(key: &GroupKey, sample_period_s: f64, number: usize, learner: &Learner) -> Head {
        let mut head = Head {
            key: key.clone(),
            sample_period_s,
            progress: Progress::start(learner, key),
            placing: None,
            waiting: Vec::new(),
            waiting_bytes: 0,
            waiting_from_ns: i64::MAX,
            open: Vec::new(),
            settled_ns: i64::MIN,
            timeline: Timeline::default(),
        };
        match learner.spans.is_empty() {
            true => head.placing = Some(Placing::new(learner.first_ns(), learner.every_ns())),
            false => {
                for &(from_ns, to_ns) in &learner.spans {
                    head.open(learner, Window { group: number, from_ns, to_ns });
                }
            }
        }
        head
    }

    /// Whether windows may begin with a burst of that time; then a burst that comes after it may be earlier
    /// and begin them instead.
    fn may_begin(&self, t_ns: i64) -> bool {
        t_ns >= self.waiting_from_ns || self.placing.as_ref().is_some_and(|p| p.begins_at(t_ns))
    }

    /// Lets a burst wait.
    fn wait(&mut self, burst: &Burst) {
        self.waiting.push(burst.clone());
        self.waiting_bytes += burst.samples.len();
        self.waiting_from_ns = self.waiting_from_ns.min(burst.t_acq_ns);
    }

    /// Begins to collect signals for a window.
    fn open(&mut self, learner: &Learner, window: Window) {
        let samples = self.key.samples as usize;
        let reservoir = Reservoir::new(samples, learner.most_signals(samples));
        self.open.push(OpenWindow { window, bursts: 0, reservoir });
    }

    /// Learns from a window that is over. `None`: it adds nothing to the timeline.
    fn close(&mut self, learner: &Learner, open: OpenWindow) -> Option<Entry> {
        let OpenWindow { window, bursts, reservoir } = open;
        self.settled_ns = self.settled_ns.max(window.to_ns);
        if bursts == 0 && learner.spans.is_empty() {
            return None; // nothing was printed then: nothing to learn, nothing to judge by it
        }
        self.progress.take(learner, (&self.key, self.sample_period_s), window, &reservoir)
    }

    /// The time that is to be settled next, before the reorder time is added: the first end of an open
    /// window, or the earliest waiting burst.
    fn next_ns(&self) -> i64 {
        let ends = self.open.iter().map(|open| open.window.to_ns);
        ends.min().unwrap_or(i64::MAX).min(self.waiting_from_ns)
    }
}
