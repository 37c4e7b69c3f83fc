//! Printheads while a recording flows: each burst is judged about what its head and its channels are known to be when it
//! was acquired.
//!
//! In: bursts in the recording's order, with the judges that the windows gave them. Out: what each of them is judged by
//! and about. A burst waits until its *sweep* is over ([`super::sweep`]): how a moment is divided into messages then
//! changes nothing.

use super::batches::{AssignedJudge, AssignedJudges, Slot};
use super::head::{Head, Judging, LookBuffers, Watched};
use super::head_movement::HeadMovement;
use super::level_history::LevelHistory;
use super::survey::ByGroup;
use super::sweep::{Clock, Sweep};
use crate::settings::{IdentifySettings, Settings};
use inkling_core::burst::Burst;
use inkling_core::design::{Design, Judge};
use inkling_core::state::Memory;
use inkling_core::state::memory::MOST_CHANNELS;
use std::sync::Arc;

/// Printheads that are told apart.
const MOST_HEADS: usize = 1 << 10;

/// All of a recording.
#[derive(Debug)]
pub struct Heads<'a> {
    /// What levels are measured from; `None`: a printhead's first model.
    design: Option<&'a Design>,
    /// Length of windows, s.
    window_s: f64,
    /// `None`: there are more than are told apart.
    numbers: ByGroup<Option<usize>>,
    /// `None`: no judge so far knows enough of it for its channels to be followed; it is judged as it is.
    heads: Vec<Option<Followed>>,
    clock: Clock,
    judging: Judging<'a>,
}

/// A printhead, and the sweep over its channels that has not ended yet.
#[derive(Debug)]
struct Followed {
    printhead: Arc<str>,
    watched: Watched,
    open: Option<Sweep>,
    /// What the sweep before was given; and its judge and its last moment.
    last: AssignedJudge,
    closed: Option<(Arc<Judge>, i64)>,
    head: Box<Head>,
}

impl<'a> Heads<'a> {
    /// `memory`: the states that heads were left in; `None`: no states are kept.
    pub fn new(
        settings: &Settings,
        design: Option<&'a Design>,
        memory: Option<&'a Memory>,
    ) -> Heads<'a> {
        let identify: &IdentifySettings = &settings.identify;
        let judging = Judging {
            rails: settings.input.rails,
            bounds: [identify.max_damping_drift, identify.max_frequency_drift],
            room: MOST_CHANNELS - memory.map_or(0, Memory::channels),
            memory,
            curves: design.and_then(Design::curves),
            false_alarm_rate: settings.detect.false_alarm_rate,
            moves: 0,
            work: LookBuffers::default(),
        };
        Heads {
            design,
            window_s: identify.first,
            numbers: ByGroup::default(),
            heads: Vec::new(),
            clock: Clock::default(),
            judging,
        }
    }

    /// The next burst. `given`: bursts of sweeps that are over, in any order.
    pub fn take(
        &mut self,
        slot: Slot,
        judge: &Arc<Judge>,
        burst: &Burst,
        given: &mut AssignedJudges,
    ) {
        self.clock.hear(burst);
        if self.clock.is_due(burst.t_acq_ns) {
            self.close_what_waits(burst.t_acq_ns, given);
        }
        let Heads { design, window_s, numbers, heads, judging, clock } = self;
        let number = numbers.of(burst, |_| {
            let number = (heads.len() < MOST_HEADS).then_some(heads.len());
            heads.extend(number.map(|_| None));
            number
        });
        let head = number.map(|number| &mut heads[number]);
        let head = head.and_then(|head| {
            if head.is_none() {
                let history = LevelHistory::new(*window_s);
                *head = Followed::meet(*design, history, judge, burst, judging);
            }
            head.as_mut()
        });
        match head {
            Some(head) => head.take((slot, judge, burst), clock, judging, given),
            None => given.push((slot, AssignedJudge::by(Ok(judge.clone())))),
        }
    }

    /// There are no more.
    pub fn end(&mut self, given: &mut AssignedJudges) {
        for head in self.heads.iter_mut().flatten() {
            head.close(&mut self.judging, given);
        }
    }

    /// Sweeps that have lasted as long as one may.
    fn close_what_waits(&mut self, t_ns: i64, given: &mut AssignedJudges) {
        self.clock.forget();
        for head in self.heads.iter_mut().flatten() {
            if head.open.as_ref().is_some_and(|open| self.clock.is_over(open, t_ns)) {
                head.close(&mut self.judging, given);
            }
            self.clock.opened(&head.open);
        }
    }

    /// Printheads whose levels were known.
    pub fn followed(&self) -> impl Iterator<Item = &str> {
        let heads = self.heads.iter().flatten().filter(|of| of.head.has_level());
        heads.map(|of| &*of.printhead)
    }

    pub fn movements(&self) -> Vec<HeadMovement> {
        let heads = self.heads.iter().flatten();
        let moved = heads.map(|of| &of.head.movement).filter(|of| of.is_told());
        let mut moved: Vec<HeadMovement> = moved.cloned().collect();
        moved.sort_by(|p, q| p.printhead.cmp(&q.printhead));
        moved
    }

    /// What is to be remembered after the recording, where states are kept.
    pub fn memory(&self) -> Option<Memory> {
        let mut memory = self.judging.memory?.clone();
        for of in self.heads.iter().flatten() {
            memory.printheads.insert(of.printhead.to_string(), of.head.memory());
        }
        Some(memory)
    }
}

impl Followed {
    /// `None`: its channels cannot be followed.
    fn meet(
        design: Option<&Design>,
        history: LevelHistory,
        judge: &Arc<Judge>,
        burst: &Burst,
        judging: &Judging,
    ) -> Option<Followed> {
        let named = design.map(|design| design.reference_of(&burst.printhead));
        let of = judging.memory.and_then(|memory| memory.printheads.get(&*burst.printhead));
        let head = Box::new(Head::meet(named, of, history, judge, burst, judging)?);
        let last = AssignedJudge::by(Ok(judge.clone()));
        let (printhead, watched) = (burst.printhead.clone(), Watched::default());
        Some(Followed { printhead, watched, open: None, last, closed: None, head })
    }

    fn take(
        &mut self,
        (slot, judge, burst): (Slot, &Arc<Judge>, &Burst),
        clock: &mut Clock,
        judging: &mut Judging,
        given: &mut AssignedJudges,
    ) {
        let t_ns = burst.t_acq_ns;
        let is_other = |open: &Sweep| {
            let is_late = judging.memory.is_none() && open.is_later(t_ns);
            open.judge.index != judge.index || is_late
        };
        if self.open.as_ref().is_some_and(is_other) {
            self.close(judging, given);
        }
        let is_closed = |(by, at_ns): &(Arc<Judge>, i64)| by.index == judge.index && *at_ns == t_ns;
        if self.open.is_none() && self.closed.as_ref().is_some_and(is_closed) {
            // the rest of a moment: channels that were not known before it, or bursts that repeat it
            self.watched.hear(burst, judge, judging.rails);
            self.watched.meet(burst);
            given.push((slot, self.last.clone()));
            return;
        }
        if judging.memory.is_some() && self.head.is_late(t_ns) {
            // what comes after later ones is no part of what is remembered
            self.head.movement.late += 1;
            given.push((slot, self.last.clone()));
            return;
        }
        match &mut self.open {
            Some(open) => {
                if let Some(over) = open.hear(slot, burst, clock) {
                    let next = self.open.replace(over);
                    self.close(judging, given);
                    self.open = next;
                }
            }
            None => self.open = Some(Sweep::begin(slot, judge.clone(), burst, clock)),
        }
        if self.is_over() {
            self.close(judging, given);
        }
        clock.opened(&self.open);
    }

    /// Whether a moment holds all channels that were known before it: nobody need wait for the next one.
    fn is_over(&self) -> bool {
        let known = &self.watched.channels.met;
        !known.is_empty() && self.open.as_ref().is_some_and(|open| open.holds_at_once(known))
    }

    /// The open sweep is over: judged about what it shows, and about channels as they were before it.
    ///
    /// Channels that were not known before it are looked at from the next one on: whether they came before those that
    /// ended the sweep is a matter of how a moment is divided.
    fn close(&mut self, judging: &mut Judging, given: &mut AssignedJudges) {
        let Some(sweep) = self.open.take() else { return };
        let is_first = self.closed.is_none();
        for burst in sweep.bursts() {
            self.watched.hear(burst, &sweep.judge, judging.rails);
            if is_first {
                self.watched.meet(burst);
            }
        }
        self.last = self.head.close(&sweep, &self.watched, judging);
        sweep.bursts().into_iter().for_each(|burst| self.watched.meet(burst));
        let last = &self.last;
        given.extend(sweep.slots().map(|slot| (slot, last.clone())));
        self.closed = Some((sweep.judge.clone(), sweep.to_ns()));
    }
}
