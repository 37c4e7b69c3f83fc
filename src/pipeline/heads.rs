//! All printheads of a recording while it flows: each burst is judged about what its head and its channels
//! were known to be when it was acquired.
//!
//! In: bursts in the recording's order, each with the judge that the windows gave it, from the identify
//! stage ([`Heads::take`]). Out: for each burst the judge in use and, with `--baseline`, its channels' own
//! levels. A burst waits until its *sweep* is over ([`super::sweep`]), so that the result does not depend on
//! how a logger divides one moment's channels into messages.
//!
//! This file decides which sweep a burst belongs to and when a sweep is closed; what a closed sweep says of
//! its head, [`super::head`] finds.

use super::batches::{AssignedJudge, AssignedJudges, Slot};
use super::groups::ByGroup;
use super::head::{Head, Judging};
use super::head_movement::HeadMovement;
use super::rings::Deviations;
use super::run::Replay;
use super::sweep::{Sweep, SweepClock, channels};
use inkling_core::burst::Burst;
use inkling_core::design::{Judge, Workspace};
use inkling_core::state::Memory;
use inkling_core::state::memory::MOST_CHANNELS;
use std::sync::Arc;

/// Maximum number of printheads that are followed; further ones are judged by the windows' judges.
const MOST_HEADS: usize = 1 << 10;

/// All printheads of a recording. A *head* here is a group: a printhead at one sampling.
#[derive(Debug)]
pub struct Heads<'a> {
    /// Index in `heads` by group; `None`: the group came when [`MOST_HEADS`] were there already.
    numbers: ByGroup,
    /// By index. `None`: no judge so far knew enough for the printhead's channels to be followed.
    heads: Vec<Option<Followed>>,
    judging: Judging<'a>,
}

#[derive(Debug)]
struct Followed {
    /// The sweep that has not ended yet; `None`: the next burst begins one.
    open: Option<Sweep>,
    /// What judged the previous sweep; before the first, the judge of the windows.
    last: AssignedJudge,
    /// The window's judge and the last moment, ns, of the previous sweep.
    closed: Option<(Arc<Judge>, i64)>,
    head: Box<Head>,
}

impl<'a> Heads<'a> {
    pub fn new(replay: &'a Replay) -> Heads<'a> {
        let remembered = replay.baselines.as_ref().map_or(0, Memory::channels);
        let judging = Judging {
            replay,
            room: MOST_CHANNELS - remembered,
            moves: 0,
            clock: SweepClock::default(),
            deviations: Deviations::new(replay.settings.input.rails),
            work: Workspace::default(),
        };
        Heads { numbers: ByGroup::default(), heads: Vec::new(), judging }
    }

    /// Lets time go on to a usable burst of any printhead, also of one that nothing judges. Appends to
    /// `given` the bursts whose sweeps are now over, in any order, with what judges them.
    pub fn hear(&mut self, burst: &Burst, given: &mut AssignedJudges) {
        self.judging.clock.hear(burst);
        if self.judging.clock.is_due(burst.t_acq_ns) {
            self.close_overlong(burst.t_acq_ns, given);
        }
    }

    /// `slot`: the burst's place among those that wait; `judge`: the windows' one.
    pub fn take(
        &mut self,
        slot: Slot,
        judge: &Arc<Judge>,
        burst: &Burst,
        given: &mut AssignedJudges,
    ) {
        let Heads { numbers, heads, judging } = self;

        let number = numbers.of(burst, |_| {
            let number = (heads.len() < MOST_HEADS).then_some(heads.len());
            heads.extend(number.map(|_| None));
            number
        });
        let head = number.and_then(|number| {
            let head = &mut heads[number];
            // the judges before may not have known enough; try again with this one
            if head.is_none() {
                *head = Followed::meet(judge, burst, judging);
            }
            head.as_mut()
        });
        // a head that cannot be followed is judged at once, by the judge as it is
        match head {
            Some(head) => head.take((slot, judge, burst), judging, given),
            None => given.push((slot, AssignedJudge { judge: Ok(judge.clone()), own: None })),
        }
    }

    pub fn end(&mut self, given: &mut AssignedJudges) {
        for head in self.heads.iter_mut().flatten() {
            head.close(&mut self.judging, given);
        }
    }

    fn close_overlong(&mut self, t_ns: i64, given: &mut AssignedJudges) {
        self.judging.clock.forget();
        for head in self.heads.iter_mut().flatten() {
            if head.open.as_ref().is_some_and(|open| self.judging.clock.is_over(open.from, t_ns)) {
                head.close(&mut self.judging, given);
            }
            self.judging.clock.opened(&head.open);
        }
    }

    /// Printheads whose level was known in at least one sweep.
    pub fn followed(&self) -> impl Iterator<Item = &str> {
        let heads = self.heads.iter().flatten().filter(|of| !of.head.history.is_empty());
        heads.map(|of| &*of.head.movement.printhead)
    }

    /// How printheads moved, for those of which there is something to tell, sorted by name.
    pub fn movements(&self) -> Vec<HeadMovement> {
        let heads = self.heads.iter().flatten().map(|of| &of.head.movement);
        let mut moved: Vec<HeadMovement> = heads.filter(|of| of.is_told()).cloned().collect();
        moved.sort_by(|p, q| p.printhead.cmp(&q.printhead));
        moved
    }

    /// The remembered states, where there are any, with those of this recording's heads in place of theirs.
    pub fn memory(&self) -> Option<Memory> {
        let mut memory = self.judging.replay.baselines.clone()?;
        for of in self.heads.iter().flatten() {
            memory.printheads.insert(of.head.movement.printhead.to_string(), of.head.memory());
        }
        Some(memory)
    }
}

impl Followed {
    /// Begins to follow a printhead at its first burst. `None`: its channels cannot be followed.
    fn meet(judge: &Arc<Judge>, burst: &Burst, judging: &Judging) -> Option<Followed> {
        let head = Box::new(Head::meet(judge, burst, judging)?);
        let last = AssignedJudge { judge: Ok(judge.clone()), own: None };
        Some(Followed { open: None, last, closed: None, head })
    }

    /// Takes the next burst of this head: adds it to the open sweep, or judges it at once where its sweep was
    /// closed already; closes the sweeps that end with it.
    fn take(
        &mut self,
        (slot, judge, burst): (Slot, &Arc<Judge>, &Burst),
        judging: &mut Judging,
        given: &mut AssignedJudges,
    ) {
        let t_ns = burst.t_acq_ns;
        // 1. a sweep has one judge; without `--baseline` a late burst ends the sweep, too
        let is_other = |open: &Sweep| {
            let is_late = judging.replay.baselines.is_none() && t_ns < open.latest_ns;
            open.judge.index != judge.index || is_late
        };
        if self.open.as_ref().is_some_and(is_other) {
            self.close(judging, given);
        }

        // 2. bursts that come after their sweep was closed are judged as the last sweep was
        let is_closed = |(by, at_ns): &(Arc<Judge>, i64)| by.index == judge.index && *at_ns == t_ns;
        if self.open.is_none() && self.closed.as_ref().is_some_and(is_closed) {
            // that sweep ended with this very moment: here are channels that were new to it, or repeated
            self.head.hear(burst, judge, judging.replay.settings.input.rails);
            self.head.channels.meet(channels(burst));
            given.push((slot, self.last.clone()));
            return;
        }
        if judging.replay.baselines.is_some() && self.head.is_late(t_ns) {
            // the state knows later bursts already: this one is judged, and teaches it nothing
            self.head.movement.late += 1;
            given.push((slot, self.last.clone()));
            return;
        }

        match &mut self.open {
            Some(open) => {
                if let Some(over) = open.hear(slot, burst, &judging.clock) {
                    // the burst began the next sweep: close the one that is over, then go on with the next
                    let next = self.open.replace(over);
                    self.close(judging, given);
                    self.open = next;
                }
            }
            None => self.open = Some(Sweep::begin(slot, judge.clone(), burst, &judging.clock)),
        }

        if self.is_over() {
            self.close(judging, given);
        }
        judging.clock.opened(&self.open);
    }

    /// Whether the latest moment of the open sweep holds all channels that were known before it: then nothing
    /// that belongs to this sweep can follow.
    fn is_over(&self) -> bool {
        let met = &self.head.channels.met;
        !met.0.is_empty()
            && self.open.as_ref().is_some_and(|open| met.0.iter().all(|of| open.moment.hold(of)))
    }

    /// Channels that were new in the sweep are looked at from the next sweep on: whether they came before the
    /// burst that ended it depends on how a moment is divided into messages.
    fn close(&mut self, judging: &mut Judging, given: &mut AssignedJudges) {
        let Some(sweep) = self.open.take() else { return };

        let is_first = self.closed.is_none();
        for burst in sweep.bursts() {
            self.head.hear(burst, &sweep.judge, judging.replay.settings.input.rails);
            // no channel was known before the first sweep, which would otherwise show nothing
            if is_first {
                self.head.channels.meet(channels(burst));
            }
        }

        self.last = self.head.close(&sweep, judging);
        sweep.bursts().iter().for_each(|burst| self.head.channels.meet(channels(burst)));
        let last = &self.last;
        given.extend(sweep.slots().map(|slot| (slot, last.clone())));
        self.closed = Some((sweep.judge.clone(), sweep.to_ns()));
    }
}
