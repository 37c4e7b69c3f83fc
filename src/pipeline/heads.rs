//! Printheads' states ([`crate::state`]) while a recording flows: each burst is judged about what its head and its
//! channels are known to be when it was acquired.
//!
//! In: bursts in the recording's order, with the judges that the windows gave them. Out: what each of them is judged by
//! and about. A burst waits until its *sweep* is over ([`super::sweep`]).

use super::batches::{AssignedJudge, AssignedJudges, Slot};
use super::head::{Head, Judging, LookBuffers};
use super::head_movement::HeadMovement;
use super::level_history::LevelHistory;
use super::survey::GroupKey;
use super::sweep::Clock;
use crate::burst::Burst;
use crate::design::{Design, Judge};
use crate::settings::{IdentifySettings, Settings};
use crate::state::Memory;
use crate::state::memory::MOST_CHANNELS;
use std::collections::HashMap;
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
    of: HashMap<GroupKey, Head>,
    clock: Clock,
    judging: Judging<'a>,
}

impl<'a> Heads<'a> {
    pub fn new(settings: &Settings, design: Option<&'a Design>, memory: &'a Memory) -> Heads<'a> {
        let identify: &IdentifySettings = &settings.identify;
        let judging = Judging {
            rails: settings.input.rails,
            bounds: [identify.max_damping_drift, identify.max_frequency_drift],
            room: MOST_CHANNELS - memory.channels(),
            memory,
            curves: design.and_then(Design::curves),
            false_alarm_rate: settings.detect.false_alarm_rate,
            moves: 0,
            work: LookBuffers::default(),
        };
        let (of, clock) = (HashMap::new(), Clock::default());
        Heads { design, window_s: identify.first, of, clock, judging }
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
        let key = GroupKey::of(burst);
        if !self.of.contains_key(&key) && !self.meet(&key, judge, burst) {
            given.push((slot, AssignedJudge::by(Ok(judge.clone()))));
            return;
        }
        let Some(head) = self.of.get_mut(&key) else { return };
        if head.open.as_ref().is_some_and(|open| open.judge.index != judge.index) {
            head.close(&mut self.judging, given);
        }
        if head.is_late(burst.t_acq_ns) {
            // what comes after later ones changes nothing
            head.movement.late += 1;
            given.push((slot, head.last.clone()));
            return;
        }
        if let Some(over) = head.hear(slot, judge, burst, &self.clock) {
            let next = head.open.replace(over);
            head.close(&mut self.judging, given);
            head.open = next;
        }
        self.clock.opened(&head.open);
    }

    /// There are no more.
    pub fn end(&mut self, given: &mut AssignedJudges) {
        for head in self.of.values_mut() {
            head.close(&mut self.judging, given);
        }
    }

    /// Sweeps that have lasted as long as one may.
    fn close_what_waits(&mut self, t_ns: i64, given: &mut AssignedJudges) {
        self.clock.forget();
        for head in self.of.values_mut() {
            if head.open.as_ref().is_some_and(|open| self.clock.is_over(open, t_ns)) {
                head.close(&mut self.judging, given);
            }
            self.clock.opened(&head.open);
        }
    }

    /// A printhead whose channels can be followed.
    fn meet(&mut self, key: &GroupKey, judge: &Arc<Judge>, burst: &Burst) -> bool {
        let named = self.design.map(|design| design.reference_of(&key.printhead));
        let history = LevelHistory::new(self.window_s);
        let has_room = self.of.len() < MOST_HEADS;
        let head = has_room.then(|| Head::meet(named, history, judge, burst, &self.judging));
        let Some(head) = head.flatten() else { return false };
        self.of.insert(key.clone(), head);
        true
    }

    pub fn movements(&self) -> Vec<HeadMovement> {
        let mut moved: Vec<HeadMovement> = self
            .of
            .values()
            .map(|head| head.movement.clone())
            .filter(HeadMovement::is_told)
            .collect();
        moved.sort_by(|p, q| p.printhead.cmp(&q.printhead));
        moved
    }

    /// What is to be remembered after the recording.
    pub fn memory(&self) -> Memory {
        let mut memory = self.judging.memory.clone();
        for (key, head) in &self.of {
            memory.printheads.insert(key.printhead.to_string(), head.memory());
        }
        memory
    }
}
