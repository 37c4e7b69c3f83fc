//! All printheads of a recording while it flows: each burst is judged about what its head and its channels
//! were known to be when it was acquired.
//!
//! In: bursts in the recording's order, each with the judge of its printhead, from the identify stage
//! ([`Heads::take`]). Out: for each burst the judge in use and, with `--baseline`, its channels' own
//! levels. A burst waits until its *sweep* is over ([`super::sweep`]), so that the result does not depend on
//! how a logger divides one moment's channels into messages.
//!
//! This file decides which sweep a burst belongs to and when a sweep is closed; what a closed sweep says of
//! its head, [`super::head`] finds.

use super::batches::{AssignedJudge, AssignedJudges, Slot};
use super::head::{Head, Judging};
use super::head_clock::Standing;
use super::head_movement::HeadMovement;
use super::numbers::{LOOK_EVERY_NS, LOOKS};
use super::rings::Deviations;
use super::run::Replay;
use super::sweep::{Sweep, SweepClock, channels};
use inkling_core::burst::Burst;
use inkling_core::design::{Judge, Workspace};
use inkling_core::state::Memory;
use inkling_core::state::memory::MOST_CHANNELS;
use std::sync::Arc;

/// Maximum number of printheads that are followed; further ones are judged by the judges as they are.
const MOST_HEADS: usize = 1 << 10;
/// All printheads of a recording. A *head* here is a group: a printhead at one sampling.
#[derive(Debug)]
pub struct Heads<'a> {
    /// By the number of the group. `None`: its judge does not know enough for its channels to be followed, or there
    /// are [`MOST_HEADS`] already.
    heads: Vec<Option<Followed>>,
    judging: Judging<'a>,
}

/// A burst, and where it waits for its judge.
#[derive(Clone, Copy, Debug)]
pub struct Heard<'b> {
    pub slot: Slot,
    pub burst: &'b Burst,
}

#[derive(Debug)]
struct Followed {
    /// The sweep that has not ended yet; `None`: the next burst begins one.
    open: Option<Sweep>,
    /// What judged the previous sweep; before the first, the judge as it is.
    last: AssignedJudge,
    /// When the head was looked at first and last, ns; `None`: not yet.
    looked_ns: Option<[i64; 2]>,
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
        Heads { heads: Vec::new(), judging }
    }

    /// Lets time go on to a usable burst of any printhead, also of one that nothing judges. Appends to
    /// `given` the bursts whose sweeps are now over, in any order, with what judges them.
    pub fn hear(&mut self, group: usize, burst: &Burst, given: &mut AssignedJudges) {
        self.judging.clock.hear(group, burst);
        self.close_overlong(given);
    }

    /// Counts samples of a burst that nobody hears, but that waits behind others.
    pub fn count(&mut self, samples: u64, given: &mut AssignedJudges) {
        self.judging.clock.count(samples);
        self.close_overlong(given);
    }

    /// `group`: number of the burst's group; `judge`: the group's.
    pub fn take(
        &mut self,
        group: usize,
        heard: Heard,
        judge: &Arc<Judge>,
        given: &mut AssignedJudges,
    ) {
        let Heads { heads, judging } = self;
        if group >= heads.len() {
            let has_room = heads.len() < MOST_HEADS;
            heads.resize_with(group, || None);
            let new = has_room.then(|| Followed::meet(judge, heard.burst, judging));
            heads.push(new.flatten());
        }
        // a head that cannot be followed is judged at once, by the judge as it is
        match &mut heads[group] {
            Some(head) => head.take(heard, judging, given),
            None => given.push((heard.slot, AssignedJudge::new(Ok(judge.clone())))),
        }
    }

    pub fn end(&mut self, given: &mut AssignedJudges) {
        for head in self.heads.iter_mut().flatten() {
            head.close(&mut self.judging, given);
        }
    }

    fn close_overlong(&mut self, given: &mut AssignedJudges) {
        if !self.judging.clock.is_due() {
            return;
        }
        self.judging.clock.forget();
        for head in self.heads.iter_mut().flatten() {
            if head.open.as_ref().is_some_and(|open| self.judging.clock.is_over(open)) {
                head.close(&mut self.judging, given);
            }
            self.judging.clock.opened(&head.open);
        }
    }

    /// Printheads whose level was known in at least one sweep.
    pub fn followed(&self) -> impl Iterator<Item = &str> {
        let heads = self.heads.iter().flatten().filter(|of| of.head.is_followed);
        heads.map(|of| &*of.head.movement.printhead)
    }

    /// How printheads moved, for those of which there is something to tell, sorted by name.
    pub fn movements(&self) -> Vec<HeadMovement> {
        let heads = self.heads.iter().flatten().map(|of| of.head.movement());
        let mut moved: Vec<HeadMovement> = heads.filter(HeadMovement::is_told).collect();
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
        let last = AssignedJudge::new(Ok(judge.clone()));
        Some(Followed { open: None, last, looked_ns: None, head })
    }

    /// Takes the next burst of this head: adds it to the open sweep, or judges it at once where no look is due;
    /// closes the sweeps that end with it.
    fn take(&mut self, heard: Heard, judging: &mut Judging, given: &mut AssignedJudges) {
        let Heard { slot, burst } = heard;
        let t_ns = burst.t_acq_ns;
        // 1. what is out of the order of time is judged as the last sweep was, and teaches nothing
        match slot.standing {
            Standing::InOrder => {}
            Standing::Late | Standing::Stray => {
                given.push((slot, self.last.clone()));
                return;
            }
            Standing::Set => {
                self.close(judging, given);
                self.head.begin_anew(t_ns);
                self.looked_ns = None;
            }
        }

        if self.open.as_ref().is_some_and(|open| open.is_past(t_ns)) {
            self.close(judging, given);
        }

        // 2. so is what comes later than the last sweep in the file, and before a look is due again
        if self.open.is_none() {
            let is_late = self.head.is_late(t_ns);
            if is_late || !self.is_due(t_ns) {
                if !is_late || self.looked_ns.is_some_and(|[_, last]| last == t_ns) {
                    // channels may be new, and recorders and converters that stand still are told from all bursts
                    self.head.hear(burst, judging.replay.settings.input.rails);
                    self.head.channels.meet(channels(burst));
                }
                given.push((slot, self.last.clone()));
                return;
            }
        }

        // 3. the others show where the head is
        match &mut self.open {
            Some(open) => {
                if let Some(over) = open.hear(slot, burst, &judging.clock) {
                    // the burst began the next sweep: close the one that is over, then go on with the next
                    let next = self.open.replace(over);
                    self.close(judging, given);
                    self.open = next;
                }
            }
            None => self.open = Some(Sweep::begin(slot, burst, &judging.clock)),
        }
        if self.is_over() {
            self.close(judging, given);
        }
        judging.clock.opened(&self.open);
    }

    /// Whether the head is to be looked at again: as often as it is heard at first and wherever its level is not
    /// known, then less often, up to every [`LOOK_EVERY_NS`].
    fn is_due(&self, t_ns: i64) -> bool {
        let Some([first, last]) = self.looked_ns else { return true };
        let apart = (last.saturating_sub(first) / LOOKS).min(LOOK_EVERY_NS);
        !self.head.is_level || t_ns.saturating_sub(last) >= apart
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

        let is_first = self.looked_ns.is_none();
        for burst in sweep.bursts() {
            self.head.hear(burst, judging.replay.settings.input.rails);
            // no channel was known before the first sweep, which would otherwise show nothing
            if is_first {
                self.head.channels.meet(channels(burst));
            }
        }

        self.last = self.head.close(&sweep, judging);
        sweep.bursts().iter().for_each(|burst| self.head.channels.meet(channels(burst)));
        let last = &self.last;
        given.extend(sweep.slots().map(|slot| (slot, last.clone())));
        let to_ns = sweep.to_ns();
        self.looked_ns = Some([self.looked_ns.map_or(to_ns, |[first, _]| first), to_ns]);
    }
}
