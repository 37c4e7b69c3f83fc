//! One printhead while a recording flows.
//!
//! In: its sweeps, with the judge that the windows gave them. Out: the same judge, moved to where most of the channels
//! are; where channels' own levels are remembered (`--baseline`), these; or the reason why the head is not judged.

use super::batches::AssignedJudge;
use super::channel_subset::ChannelSubset;
use super::frozen::{Frozen, LEAST_NOISE};
use super::head_movement::HeadMovement;
use super::level_history::LevelHistory;
use super::moved_judge::{MovedJudge, is_beyond};
use super::sweep::{Sweep, channels};
use inkling_core::burst::Burst;
use inkling_core::design::{HealthyModel, Judge, OwnBasis, OwnChannels, Workspace};
use inkling_core::isolate::physics_density::FaultCurves;
use inkling_core::state::{
    Features, Head as State, HeadMemory, Look, Memory, OwnLevel, SweepOutcome,
};
use inkling_core::verdict::{Reason, unusable_signal};
use std::sync::Arc;

/// Relative change of all channels' amplitude that is worth a word: a supply sags by less.
const GAIN_BOUND: f64 = 0.25;
/// After so many sweeps without a level signals far from the model are no longer fitted: they are faults.
const MOST_UNKNOWN: u32 = 64;

/// In so many sweeps in a row a head of which nothing is remembered must be another one.
const IN_A_ROW: u32 = 8;

/// What all heads of a recording are judged with.
#[derive(Debug)]
pub(super) struct Judging<'a> {
    pub rails: [f64; 2],
    /// Of damping and frequency, relative.
    pub bounds: [f64; 2],
    /// The states that heads were left in; `None`: no states are kept.
    pub memory: Option<&'a Memory>,
    /// What signals are isolated by; `None`: the design has no physics.
    pub curves: Option<Arc<FaultCurves>>,
    pub false_alarm_rate: f64,
    /// Channels that may still be met.
    pub room: usize,
    /// Of all judges: heads may have one in common.
    pub moves: u32,
    pub work: LookBuffers,
}

/// The channels of a printhead that were met before a sweep, and those that stand still.
#[derive(Debug, Default)]
pub(super) struct Watched {
    pub channels: ChannelSubset,
    pub frozen: Frozen,
}

impl Watched {
    pub fn meet(&mut self, burst: &Burst) {
        self.channels.meet(channels(burst));
    }

    /// `judge`: its noise tells whether signals can be the same by chance.
    pub fn hear(&mut self, burst: &Burst, judge: &Judge, rails: [f64; 2]) {
        if judge.model.noise > LEAST_NOISE {
            self.frozen.hear(burst, rails);
        }
    }
}

/// Buffers for looks at a burst's channels.
#[derive(Debug, Default)]
pub(super) struct LookBuffers {
    pub signal: Vec<f64>,
    pub expected: Vec<f64>,
    pub work: Workspace,
}

#[derive(Debug)]
pub(super) struct Head {
    state: State,
    /// With `--baseline`: its channels are judged about their own levels.
    is_remembered: bool,
    /// Sweeps in a row in which it was another head.
    strange: u32,
    /// The ring that its features are from, where no design names it.
    ring: Option<[f64; 4]>,
    base: Arc<HealthyModel>,
    sweeps: u32,
    /// The judge in use, and the features of its window's ring from the base's.
    judge: MovedJudge,
    window_at: Features,
    /// Levels of late.
    history: LevelHistory,
    /// Sweeps since a level was known.
    unknown: u32,
    healthy_sd: Features,
    /// What channels are judged by, and the looks and the spread of them that it was made of.
    own: Option<([f64; 2], Arc<OwnBasis>)>,
    pub movement: HeadMovement,
}

/// What was seen of some of a sweep's channels.
struct Looks {
    rings: Vec<Look>,
    /// Signals that are no rings.
    no_rings: usize,
    /// Most are the same bits as before.
    all_frozen: bool,
}

/// To a fifth.
fn alike(a: f64, b: f64) -> bool {
    (a / b).ln().abs() < 0.2
}

/// Features of one ring (amplitude, damping, frequency, phase) from another.
fn ring_from(of: [f64; 4], from: [f64; 4]) -> Features {
    let turned = of[3] - from[3];
    Features::new(
        (of[0] / from[0]).ln(),
        (of[1] / from[1]).ln(),
        (of[2] / from[2]).ln(),
        turned - std::f64::consts::TAU * (turned / std::f64::consts::TAU).round(),
    )
}

impl Head {
    /// A printhead whose channels can be followed. `named`: the design's model of it; `remembered`: the state that it was
    /// left in.
    pub fn meet(
        named: Option<&HealthyModel>,
        remembered: Option<&HeadMemory>,
        history: LevelHistory,
        judge: &Arc<Judge>,
        burst: &Burst,
        by: &Judging,
    ) -> Option<Head> {
        let (kind, healthy_sd) = judge.kind(by.bounds).zip(judge.healthy_sd())?;
        let base = named.map_or_else(|| judge.model.clone(), |of| Arc::new(of.clone()));
        let ring = if named.is_none() { base.ring_numbers() } else { None };
        let mut state = match remembered {
            Some(of) => {
                let from = of.ring.zip(ring).map(|(then, now)| ring_from(then, now));
                State::remembered(kind, of, &from.unwrap_or_default())
            }
            None => State::new(kind),
        };
        state.begin(burst.t_acq_ns);
        let window_at = judge.model.features_from(&base).unwrap_or_default();
        if remembered.is_none() && judge.model.valid_from_ns.is_some() {
            state.begin_at(&window_at, burst.t_acq_ns);
        }
        Some(Head {
            state,
            is_remembered: by.memory.is_some(),
            strange: 0,
            ring,
            window_at,
            base,
            sweeps: 0,
            judge: MovedJudge::new(judge.clone()),
            history,
            unknown: 0,
            healthy_sd,
            own: None,
            movement: HeadMovement::new(burst.printhead.clone()),
        })
    }

    /// What is to be remembered.
    pub fn memory(&self) -> HeadMemory {
        self.state.memory(self.ring)
    }

    /// Whether its level was ever known.
    pub fn has_level(&self) -> bool {
        !self.history.is_empty()
    }

    /// Whether a burst comes after what was judged: then it changes nothing.
    pub fn is_late(&self, t_ns: i64) -> bool {
        self.state.heard_ns().is_some_and(|before| t_ns <= before)
    }

    /// A sweep is over: judged about the level that it shows, and channels as they were before it.
    pub fn close(&mut self, sweep: &Sweep, watched: &Watched, by: &mut Judging) -> AssignedJudge {
        if self.judge.window.index != sweep.judge.index {
            self.window_is(&sweep.judge);
        }
        self.sweeps = self.sweeps.wrapping_add(1);
        let t_ns = sweep.to_ns();
        let Looks { rings: looks, no_rings, all_frozen } = self.look(sweep, watched, by);
        let own = self.is_remembered.then(|| self.own(by));
        let frozen = watched.frozen.channels();
        let outcome = self.state.sweep(t_ns, &looks, no_rings);
        self.movement.scatters(t_ns, &self.state);
        self.movement.swapped_ns = self.state.swapped_ns();
        let is_strange = matches!(outcome, SweepOutcome::Strange { .. });
        self.strange = if is_strange { self.strange.saturating_add(1) } else { 0 };
        let judge = match outcome {
            _ if all_frozen => Err(Reason::Frozen),
            // a library may hold bursts of one fault
            SweepOutcome::Strange { .. } if !self.is_remembered && self.strange < IN_A_ROW => {
                Ok(self.judge.now().clone())
            }
            SweepOutcome::Strange { level } => {
                self.movement.is_strange(t_ns, level);
                Err(Reason::HeadChanged)
            }
            SweepOutcome::Level { level, sd } => Ok(self.judged_by(t_ns, (level, sd), by)),
            SweepOutcome::Unknown => {
                self.unknown = self.unknown.saturating_add(1);
                Ok(self.judge.now().clone())
            }
        };
        let own = self.placed(&judge, own, frozen);
        AssignedJudge { judge, own }
    }

    fn window_is(&mut self, judge: &Arc<Judge>) {
        self.judge = MovedJudge::new(judge.clone());
        // a window's model is where its ring is: what channels were found at in it would add an error with each window.
        // Where its ring is unknown, it is where its channels were, or where the one before was
        let in_window =
            || judge.model.valid_from_ns.and_then(|to_ns| self.history.mean_before(to_ns));
        let at = judge.model.features_from(&self.base).or_else(in_window);
        self.window_at = at.unwrap_or(self.window_at);
    }

    /// Where its ring lies from the base's.
    fn now_at(&self) -> Features {
        self.window_at + self.judge.by()
    }

    /// Looks at some of a sweep's channels, at all of them in turn.
    fn look(&mut self, sweep: &Sweep, watched: &Watched, by: &mut Judging) -> Looks {
        let (at, judge, far) =
            (self.now_at(), self.judge.now().clone(), self.unknown < MOST_UNKNOWN);
        let Judging { rails, work: LookBuffers { signal, expected, work }, room, .. } = by;
        let (mut looks, mut no_rings, mut repeated) = (Vec::new(), 0, 0);
        for burst in sweep.bursts() {
            let n = burst.samples_per_channel as usize;
            signal.resize(n, 0.0);
            expected.resize(n, 0.0);
            judge.expect(burst, expected);
            let drive = judge.drive(burst);
            for channel in channels(burst) {
                let is_frozen = watched.frozen.is_frozen(channel);
                if !(is_frozen || watched.channels.holds(channel, self.sweeps)) {
                    continue;
                }
                let row = (channel - burst.first_channel) as usize;
                burst.copy_signal(row, signal);
                if unusable_signal(signal, *rails).is_some() {
                    continue;
                }
                if is_frozen {
                    repeated += 1;
                    continue;
                }
                judge.deviate(burst, row, expected, signal);
                let local = judge.features(signal, drive, far, work);
                let Some(local) = local.filter(|of| of.iter().all(|v| v.is_finite())) else {
                    no_rings += 1;
                    continue;
                };
                if !self.state.knows(channel) {
                    let Some(left) = room.checked_sub(1) else { continue };
                    *room = left;
                }
                looks.push(Look { channel, features: local + at, drive });
            }
        }
        Looks { all_frozen: repeated > looks.len(), rings: looks, no_rings }
    }

    /// Where channels are by themselves, from the level; and what all have in common.
    fn own(&mut self, by: &Judging) -> (Arc<OwnBasis>, Vec<OwnLevel>) {
        let now = [self.state.looks_within(), self.state.wider()];
        let basis = match &self.own {
            // drops and channels differ about as much as they did
            Some((then, basis)) if now[0] < 2.0 * then[0] && alike(now[1], then[1]) => {
                basis.clone()
            }
            _ => {
                let curves = by.curves.as_deref();
                let basis = Arc::new(OwnBasis::new(&self.state, curves, by.false_alarm_rate));
                self.own = Some((now, basis.clone()));
                basis
            }
        };
        (basis, self.state.own().collect())
    }

    /// The same about the judge that the sweep was given. `None`: there is nothing to say of any channel.
    fn placed(
        &self,
        judge: &Result<Arc<Judge>, Reason>,
        own: Option<(Arc<OwnBasis>, Vec<OwnLevel>)>,
        frozen: Vec<u32>,
    ) -> Option<Arc<OwnChannels>> {
        let judge = judge.as_ref().ok()?;
        let Some((basis, channels)) = own else {
            return (!frozen.is_empty()).then(|| Arc::new(OwnChannels::of_frozen(frozen)));
        };
        let from = self.state.level() - self.now_at() + judge.healthy_mean()?;
        Some(Arc::new(OwnChannels::new(basis, channels, from, frozen)))
    }

    /// The judge where a level is known.
    fn judged_by(
        &mut self,
        t_ns: i64,
        (level, sd): (Features, Features),
        by: &mut Judging,
    ) -> Arc<Judge> {
        self.unknown = 0;
        self.history.push(t_ns, level);
        let bounds = [GAIN_BOUND, by.bounds[0], by.bounds[1]];
        if (0..3).any(|k| is_beyond(level[k], sd[k], bounds[k])) {
            self.movement.is_beyond(t_ns);
        }
        self.movement.reaches(&level);
        self.judge.follow(level - self.window_at, sd, &self.healthy_sd, &mut by.moves);
        self.movement.bursts += u64::from(self.judge.is_moved());
        self.judge.now().clone()
    }
}
