//! Healthy windows to models while the signals flow, in the identify stage.
//!
//! In: bursts, about in the order of their times. Out: the model of every burst, once every window that had
//! ended by then was learned. A window is over when some burst is later than its end by the reorder time; what
//! comes later still and would have changed it is met, and the whole recording is then learned in two passes
//! ([`super::windows`]), with the same models, numbers and refusals.
//!
//! Held at a time: the samples of the windows that are open ([`HELD_BYTES`]; what would be more is learned in two
//! passes, too), and of each printhead bursts that may begin windows while earlier ones may still come
//! ([`WAITING_BYTES`]; what would be more begins them).

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

/// How much later than others a burst may come that is earlier than they: loggers of several printheads write
/// them about as they come. ns.
pub const USUAL_REORDER_NS: u64 = 100_000_000;
/// The same where the chunk index says that it is more. Whoever judges a burst is known so much later.
pub const MOST_REORDER_NS: u64 = 2_000_000_000;
/// Bytes of signals that are held of all open windows.
const HELD_BYTES: usize = 64 << 20;
/// Bytes of samples of a printhead's bursts that wait.
const WAITING_BYTES: usize = 16 << 20;

/// Who judges a burst.
#[derive(Debug)]
pub enum Judgement {
    By(Arc<Judge>),
    Reject(Reason),
    /// A window that may say so is not over.
    NotYet,
}

#[derive(Debug)]
pub struct Learning<'a> {
    learner: &'a Learner<'a>,
    /// Bursts may come so much later than others that are later than they.
    reorder_ns: i64,
    /// Threads that learn printheads, or read on ahead, side by side.
    pub workers: usize,
    schedule: Schedule<'a>,
    /// `None`: judged without windows.
    numbers: ByGroup<Option<usize>>,
    heads: Vec<Head>,
    latest_ns: i64,
    /// Nothing is to be done before a burst of that time.
    due_ns: i64,
    /// End and group of the window whose model got the last number.
    numbered: Option<(i64, GroupKey)>,
    /// Bytes.
    held: usize,
    over: bool,
}

/// One printhead, as far as it is learned.
#[derive(Debug)]
struct Head {
    key: GroupKey,
    sample_period_s: f64,
    progress: Progress,
    /// `None`: the windows are given.
    placing: Option<Placing>,
    /// May begin windows, but earlier ones may still come.
    waiting: Vec<Burst>,
    /// Bytes of their samples.
    waiting_bytes: usize,
    waiting_from_ns: i64,
    open: Vec<OpenWindow>,
    /// What comes now from before would have changed a window.
    settled_ns: i64,
    timeline: Timeline,
}

/// A window that signals are still collected for.
#[derive(Debug)]
struct OpenWindow {
    window: Window,
    bursts: u64,
    reservoir: Reservoir,
}

fn out_of_order(of: &GroupKey) -> PipelineError {
    PipelineError::NeedsTwoPasses(format!(
        "bursts of {} come long after later ones",
        inkling_io::printable::line(&of.printhead, 64)
    ))
}

impl<'a> Learning<'a> {
    /// `schedule`: the design's models.
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

    /// The next burst.
    pub fn take(&mut self, burst: &Burst) -> Result<(), PipelineError> {
        let t_ns = burst.t_acq_ns;
        self.latest_ns = self.latest_ns.max(t_ns);
        if let Some(number) = self.number_of(burst) {
            self.take_of(number, burst)?;
        }
        if self.latest_ns >= self.due_ns { self.settle() } else { Ok(()) }
    }

    /// The next burst of a group that needs windows.
    fn take_of(&mut self, number: usize, burst: &Burst) -> Result<(), PipelineError> {
        let t_ns = burst.t_acq_ns;
        let head = &mut self.heads[number];
        if t_ns < head.settled_ns {
            return Err(out_of_order(&head.key));
        }
        if head.progress.is_over(self.learner) {
            return Ok(()); // no later window changes who judges it
        }
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

    /// There are no more.
    pub fn end(&mut self) -> Result<(), PipelineError> {
        if self.over {
            return Ok(());
        }
        (self.latest_ns, self.over) = (i64::MAX, true);
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

    /// All models, after the end.
    pub fn into_schedule(self) -> Schedule<'a> {
        self.schedule
    }

    pub fn judgement(&mut self, burst: &Burst) -> Result<Judgement, PipelineError> {
        if !self.schedule.fits(burst) {
            return Ok(Judgement::Reject(Reason::DesignMismatch));
        }
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

    /// Whether no window that is not learned yet can change who judges a burst.
    fn is_known(&self, head: &Head, t_ns: i64) -> bool {
        let ends_before = |open: &OpenWindow| open.window.to_ns <= t_ns;
        let first_ns = self.learner.first_ns();
        let waits = head.waiting_from_ns.saturating_add(first_ns) <= t_ns;
        !head.timeline.is_empty()
            && (self.learner.knows_by_design() || !(waits || head.open.iter().any(ends_before)))
    }

    /// The group of a burst, if it needs windows.
    fn number_of(&mut self, burst: &Burst) -> Option<usize> {
        let Learning { numbers, heads, learner, due_ns, reorder_ns, .. } = self;
        numbers.of(burst, |key| {
            let needs = learner.needs_windows(key, burst.sample_period_s);
            let number = heads.len();
            needs.then(|| {
                let head = Head::meet(key, burst.sample_period_s, number, learner);
                if let Some(first) = head.open.iter().map(|open| open.window.to_ns).min() {
                    *due_ns = (*due_ns).min(first.saturating_add(*reorder_ns));
                }
                heads.push(head);
                number
            })
        })
    }

    /// Places the windows that begin up to a burst, and samples its signals for those that it lies in.
    fn learn(&mut self, number: usize, burst: &Burst) -> Result<(), PipelineError> {
        let (learner, t_ns) = (self.learner, burst.t_acq_ns);
        let head = &mut self.heads[number];
        if let Some(mut placing) = head.placing.take() {
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

    /// Places what waited long enough, learns from windows that are over.
    fn settle(&mut self) -> Result<(), PipelineError> {
        let is_due = |t_ns: i64, latest_ns: i64| t_ns <= latest_ns;
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
        let mut over: Vec<OpenWindow> = Vec::new();
        for head in &mut self.heads {
            over.extend(head.open.extract_if(.., |open| due(open)));
        }
        // models are numbered as they become valid
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

    /// Bursts of a group that waited, in the order of their times; what may begin windows after `sure_ns` waits on.
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

    /// What windows that are over add to their printheads' timelines, in their order. Printheads are learned side
    /// by side: they know nothing of each other.
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
        let mut entries: Vec<Option<Entry>> = windows.iter().map(|_| None).collect();
        for (place, entry) in learned.into_iter().flatten() {
            entries[place] = entry;
        }
        windows.into_iter().zip(entries).collect()
    }

    fn enter(&mut self, window: Window, entry: Option<Entry>) -> Result<(), PipelineError> {
        let Some(entry) = entry else { return Ok(()) };
        let head = &mut self.heads[window.group];
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
    /// `number`: its own.
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

    /// Whether windows may begin with a burst of that time: those that come now may be earlier.
    fn may_begin(&self, t_ns: i64) -> bool {
        t_ns >= self.waiting_from_ns || self.placing.as_ref().is_some_and(|p| p.begins_at(t_ns))
    }

    fn wait(&mut self, burst: &Burst) {
        self.waiting.push(burst.clone());
        self.waiting_bytes += burst.samples.len();
        self.waiting_from_ns = self.waiting_from_ns.min(burst.t_acq_ns);
    }

    fn open(&mut self, learner: &Learner, window: Window) {
        let samples = self.key.samples as usize;
        let reservoir = Reservoir::new(samples, learner.most_signals(samples));
        self.open.push(OpenWindow { window, bursts: 0, reservoir });
    }

    /// Learns from a window that is over.
    fn close(&mut self, learner: &Learner, open: OpenWindow) -> Option<Entry> {
        let OpenWindow { window, bursts, reservoir } = open;
        self.settled_ns = self.settled_ns.max(window.to_ns);
        if bursts == 0 && learner.spans.is_empty() {
            return None; // nothing was printed then: nothing to learn, nothing to judge by it
        }
        self.progress.take(learner, (&self.key, self.sample_period_s), window, &reservoir)
    }

    /// What is to be settled first.
    fn next_ns(&self) -> i64 {
        let ends = self.open.iter().map(|open| open.window.to_ns);
        ends.min().unwrap_or(i64::MAX).min(self.waiting_from_ns)
    }
}
