//! One printhead while a recording flows: its level is followed sweep by sweep, and each sweep gets its
//! judge.
//!
//! In: sweeps over the head's channels, from `heads`. Out:
//! the head's judge, moved to where most of the channels are; with `--baseline` also the channels' own levels; or
//! the reason why the sweep is not judged ([`Head::close`]).
//!
//! The *level* is where the rings of all healthy channels lie in common: ln amplitude, ln damping,
//! ln frequency and phase, counted from the *base* ring: that of the design's model of this
//! printhead, or without a design that of its window's model. The method (docs/design/state.md)
//! stands in `inkling_core::state`; here the state is fed and asked. For each sweep:
//! 1. The judge is moved to the recorded temperature, and a subset of the channels is looked at by it: a look is the
//!    four features of one signal's ring.
//! 2. The state of the head takes the looks in, and says where the level is, that it does not know, or that
//!    this is another head.
//! 3. The judge is moved to the level, in steps (`moved_judge`), and judges all signals of the sweep.
//!
//! Three places are counted from the base: the level; where the judge's model lies (`model_at`);
//! and where the judge in use lies (`now_at`), which is the model's place plus the judge's move.

use super::batches::AssignedJudge;
use super::channel_subset::ChannelSubset;
use super::frozen::{Frozen, LEAST_NOISE};
use super::head_movement::{HeadMovement, ReplacedChannel};
use super::moved_judge::{MovedJudge, is_beyond};
use super::rings::Deviations;
use super::run::Replay;
use super::sweep::{Sweep, SweepClock, channels};
use inkling_core::burst::Burst;
use inkling_core::design::{
    Design, HealthyModel, Judge, OwnBasis, OwnChannels, Workspace, ring_from, tuned,
};
use inkling_core::model::median::median_of;
use inkling_core::state::{Features, Head as State, HeadMemory, Look, OwnLevel, SweepOutcome};
use inkling_core::verdict::Reason;
use std::sync::Arc;

/// After this many sweeps in a row without a known level, signals far from the model are no longer fitted,
/// which takes time; they count as no rings.
const MOST_UNKNOWN: u32 = 64;

/// Without `--baseline` a head is taken for another one after this many strange sweeps in a row.
const IN_A_ROW: u32 = 8;

/// What the judging of all heads of a recording shares.
#[derive(Debug)]
pub(super) struct Judging<'a> {
    /// Its design gives the models from which levels are counted, and with `--baseline` it holds the states in
    /// which earlier recordings left the heads.
    pub replay: &'a Replay,
    /// How many more new channels may be taken in, over all heads; bounds memory.
    pub room: usize,
    /// Counts the moves of all judges of the run: heads may share a judge, whose moves need different keys.
    pub moves: u32,
    /// Says when open sweeps have lasted as long as they may.
    pub clock: SweepClock,
    pub deviations: Deviations,
    pub work: Workspace,
}

impl Judging<'_> {
    /// Bounds of the relative changes of damping and frequency, in this order.
    fn bounds(&self) -> [f64; 2] {
        let identify = &self.replay.settings.identify;
        [identify.max_damping_drift, identify.max_frequency_drift]
    }
}

#[derive(Debug)]
pub(super) struct Head {
    state: State,
    /// The channels that were met before the open sweep, of which some are looked at; and the frozen ones.
    pub channels: ChannelSubset,
    frozen: Frozen,
    /// Number of consecutive sweeps, up to the last one, in which the head seemed to be another one.
    strange: u32,
    /// Without a design, the base ring (amplitude in counts, damping in 1/s, frequency in Hz, phase in rad),
    /// which is remembered with the state, since the next recording has another.
    ring: Option<[f64; 4]>,
    /// Number of sweeps so far, modulo 2^32: the turn of the channel subset.
    sweeps: u32,
    judge: MovedJudge,
    /// Where the ring of the window's model lies: its features from the base's ring.
    model_at: Features,
    /// Whether the level was known in some sweep, and in the last one.
    pub is_followed: bool,
    pub is_level: bool,
    /// Number of sweeps without a known level since one was last known.
    unknown: u32,
    /// The basis of own levels, with the three numbers it was made at: the looks behind the within-channel
    /// scatter, how much wider the channels lie than the design's, and how many K from where they were learned.
    own: Option<([f64; 3], Arc<OwnBasis>)>,
    /// K above its model's reference temperature, as it was recorded last.
    warmer: f64,
    pub movement: HeadMovement,
}

struct Looks {
    /// The looks at channels that gave a ring, counted from the base.
    rings: Vec<Look>,
    no_rings: usize,
    /// How large signals without a ring are beside the expected one, of those that have its form.
    sizes: Vec<f64>,
    /// Whether more of the subset's channels are frozen than are not: then recorder or converter stand still.
    all_frozen: bool,
}

impl Head {
    /// `None`: the judge does not know enough (another method than `sensitivity`, or an extension).
    pub fn meet(judge: &Arc<Judge>, burst: &Burst, by: &Judging) -> Option<Head> {
        let named = by.replay.design.as_ref().map(|design| design.reference_of(&burst.printhead));
        let memory = by.replay.baselines.as_ref();
        let remembered = memory.and_then(|memory| memory.printheads.get(&*burst.printhead));

        let (mut kind, healthy_sd) = judge.kind(by.bounds()).zip(judge.healthy_sd())?;
        let base: &HealthyModel = named.unwrap_or(&judge.model);
        let model_at = judge.model.features_from(base).unwrap_or_default();
        kind.ring = model_at[0];
        let ring = if named.is_none() { base.ring_numbers() } else { None };

        // a remembered state is counted from the base ring of its time, and carried over to the present one
        let mut state = match remembered {
            Some(of) => {
                let from = of.ring.zip(ring).map(|(then, now)| ring_from(then, now));
                State::remembered(kind, of, &from.unwrap_or_default())
            }
            None => State::new(kind),
        };
        state.begin(burst.t_acq_ns);
        // the model comes from a window of this recording, and so tells where the head's level is
        if remembered.is_none() && judge.model.valid_from_ns.is_some() {
            state.begin_at(&model_at, burst.t_acq_ns);
        }
        Some(Head {
            state,
            channels: ChannelSubset::default(),
            frozen: Frozen::default(),
            strange: 0,
            ring,
            model_at,
            sweeps: 0,
            judge: MovedJudge::new(judge.clone(), healthy_sd),
            is_followed: false,
            is_level: false,
            unknown: 0,
            own: None,
            warmer: 0.0,
            movement: HeadMovement::new(burst.printhead.clone()),
        })
    }

    /// How the head moved, as far as the recording has gone.
    pub fn movement(&self) -> HeadMovement {
        let replaced = self.state.replaced().map(ReplacedChannel::from).collect();
        HeadMovement { replaced, ..self.movement.clone() }
    }

    pub fn memory(&self) -> HeadMemory {
        self.state.memory(self.ring)
    }

    /// Whether the state knows a burst of this time or a later one: then the burst must not change it.
    pub fn is_late(&self, t_ns: i64) -> bool {
        self.state.heard_ns.is_some_and(|before| t_ns <= before)
    }

    /// The clock was set to `t_ns`: what follows comes after a pause.
    pub fn begin_anew(&mut self, t_ns: i64) {
        self.state.clock_set(t_ns);
    }

    /// Checks a burst for frozen channels, unless noise is so low that signals may be equal by chance.
    pub fn hear(&mut self, burst: &Burst, rails: [f64; 2]) {
        if self.judge.unmoved.model.noise > LEAST_NOISE {
            self.frozen.hear(burst, rails);
        }
    }

    /// Ends a sweep: updates the head's state by it, and returns what its bursts are judged by: the judge at
    /// the level which the sweep itself shows, and the channels' own levels as they were before it.
    pub fn close(&mut self, sweep: &Sweep, by: &mut Judging) -> AssignedJudge {
        self.sweeps = self.sweeps.wrapping_add(1);
        let t_ns = sweep.to_ns();
        self.heat(sweep, by);
        let Looks { rings: looks, no_rings, sizes, all_frozen } = self.look(sweep, by);
        // own levels are taken before the state is updated, so that no sweep is judged about its own
        let is_remembered = by.replay.baselines.is_some();
        let own = is_remembered.then(|| self.own(by));
        let frozen = self.frozen.channels();

        let followed = self.state.channels.len();
        let outcome = self.state.sweep(t_ns, &looks, no_rings);
        by.room = (by.room + followed).saturating_sub(self.state.channels.len());
        // a window tells too little of how channels differ to say that they have moved apart since
        if self.judge.unmoved.model.valid_from_ns.is_none() {
            self.movement.note_scatter(t_ns, &self.state);
        }
        self.movement.swapped_ns = self.state.swapped_ns;
        let is_strange = matches!(outcome, SweepOutcome::Strange { .. });
        self.is_level = matches!(outcome, SweepOutcome::Level { .. }) && !all_frozen;
        self.strange = if is_strange { self.strange.saturating_add(1) } else { 0 };

        let judge = match outcome {
            _ if all_frozen => Err(Reason::Frozen),
            SweepOutcome::Strange { level } if is_remembered || self.strange >= IN_A_ROW => {
                self.movement.note_strange(t_ns, level, median_of(looks.iter().map(|of| of.drive)));
                Err(Reason::HeadChanged)
            }
            // the recording may be a library of bursts of one fault: a few strange sweeps are judged
            SweepOutcome::Strange { .. } => Ok(self.judge.now.clone()),
            SweepOutcome::Level { level, sd } => Ok(self.judged_by(t_ns, (level, sd), by)),
            SweepOutcome::Unknown => {
                self.unknown = self.unknown.saturating_add(1);
                if self.unknown >= IN_A_ROW && no_rings > looks.len() {
                    self.movement.note_no_rings(t_ns, no_rings, sizes);
                }
                Ok(self.judge.now.clone())
            }
        };

        let own = self.placed(&judge, own, frozen);
        AssignedJudge { own, ..AssignedJudge::new(judge) }
    }

    /// Moves the judge to the temperature of a sweep, as the first of its bursts whose temperature is believed says.
    fn heat(&mut self, sweep: &Sweep, by: &mut Judging) {
        let model = &self.judge.unmoved.model;
        let all = sweep.bursts().into_iter().filter_map(|burst| burst.temperature_c);
        let warmer = all.filter(|t| model.believes(*t)).map(|t| model.warmer(t)).next();
        if let Some(warmer) = warmer {
            self.warmer = warmer;
            self.judge.heat(warmer, &mut by.moves);
        }
    }

    fn now_at(&self) -> Features {
        self.model_at + self.judge.by
    }

    /// Frozen channels are only counted, and signals that cannot be judged are passed over.
    fn look(&mut self, sweep: &Sweep, by: &mut Judging) -> Looks {
        // `far`: whether a ring is fitted where the closed form does not tell
        let (at, judge, far) = (self.now_at(), self.judge.now.clone(), self.unknown < MOST_UNKNOWN);
        let Judging { deviations, work, room, .. } = by;
        let mut room = *room;
        let (mut looks, mut no_rings, mut repeated) = (Vec::new(), 0, 0);
        let mut sizes = Vec::new();
        for burst in sweep.bursts() {
            let (drive, warmer) = (judge.drive(burst), judge.warmer(burst));
            for channel in channels(burst) {
                if !self.channels.holds(channel, self.sweeps) {
                    continue;
                }
                let row = (channel - burst.first_channel) as usize;
                let Ok(deviation) = deviations.usable(&judge, burst, row) else { continue };
                if self.frozen.is_frozen(channel) {
                    repeated += 1;
                    continue;
                }
                let local = judge.features(deviation, (drive, warmer), far, work);
                let Some(local) = local.filter(|of| of.iter().all(|v| v.is_finite())) else {
                    no_rings += 1;
                    sizes.extend(deviations.size());
                    continue;
                };
                // a new channel is only shown to the state while there is room for it
                if !self.state.channels.contains_key(&channel) {
                    let Some(left) = room.checked_sub(1) else { continue };
                    room = left;
                }
                // counted from the healthy mean about the judge's ring, which lies at `at` from the base's
                looks.push(Look { channel, features: local + at, drive, warmer: self.warmer });
            }
        }
        Looks { all_frozen: repeated > looks.len() + no_rings, rings: looks, no_rings, sizes }
    }

    /// The own levels relative to the head's. The basis costs time to make: it is kept until there are twice
    /// as many looks behind the scatter within channels, their spread has changed by about a fifth, or the
    /// temperature by a kelvin.
    fn own(&mut self, by: &Judging) -> (Arc<OwnBasis>, Vec<OwnLevel>) {
        let apart = Some(self.warmer - self.state.warmer()).filter(|apart| apart.is_finite());
        let now = [self.state.looks_within(), self.state.wider(), apart.unwrap_or(0.0)];
        let is_current = |then: &[f64; 3]| {
            let is_wider = (now[1] / then[1]).ln().abs() >= 0.2;
            now[0] < 2.0 * then[0] && !is_wider && (now[2] - then[2]).abs() < 1.0
        };
        let kept = self.own.take().filter(|(then, _)| is_current(then));
        let new = || {
            let curves = by.replay.design.as_ref().and_then(Design::curves);
            let rate = by.replay.settings.detect.false_alarm_rate;
            (now, Arc::new(OwnBasis::new(&self.state, now[2], curves.as_deref(), rate)))
        };
        let (_, basis) = self.own.insert(kept.unwrap_or_else(new));
        (basis.clone(), self.state.own().collect())
    }

    /// The channels' own levels, counted from the ring of the judge that the sweep was given, and the frozen
    /// channels. `None`: the sweep is rejected, or there is nothing to say of any channel.
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
        // A level is the head's plus the channel's own, from the base; from the judge's ring it is that less
        // `now_at`. Looks are counted from the healthy mean, baselines from the ring itself.
        let from = self.state.level() - self.now_at() + judge.healthy_mean()?;
        Some(Arc::new(OwnChannels::new(basis, channels, from, frozen)))
    }

    /// Moves the judge to a known level, if it is far enough from there, and notes how far the head has moved.
    /// `sd`: standard deviations of the level. Returns the judge in use.
    fn judged_by(
        &mut self,
        t_ns: i64,
        (level, sd): (Features, Features),
        by: &mut Judging,
    ) -> Arc<Judge> {
        self.unknown = 0;
        self.is_followed = true;
        let [damping, frequency] = by.bounds();
        let bounds = [tuned::GAIN_BOUND, damping, frequency];
        if (0..3).any(|k| is_beyond(level[k], sd[k], bounds[k])) {
            self.movement.beyond_since_ns.get_or_insert(t_ns);
        }
        self.movement.note_level(&level);
        self.judge.follow(level - self.model_at, sd, &mut by.moves);
        self.movement.bursts += u64::from(self.judge.is_moved());
        self.judge.now.clone()
    }
}
