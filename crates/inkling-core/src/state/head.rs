//! One printhead: its level, and its channels from there, filtered in the order of time.
//!
//! In: a sweep, that is, looks at many channels of the head within one stretch of time ([`Look`]).
//! Out: what the sweep tells of the level ([`SweepOutcome`]), the channels' own levels and how far
//! healthy looks scatter; all features, while inside positions are canonical (`kind.rs`). The steps:
//!
//! 1. `walk`: the level has become less certain since the last sweep.
//! 2. `find`: the level that explains the sweep (`level.rs`), and whether it is believed.
//! 3. `learn`: Kalman's update of the level, of the scatter within channels, and of each channel.
//! 4. `watch`: which channels have drifted slowly from their past, or lie apart (`ageing.rs`).

use super::ageing::{Apart, OFTEN, RARELY, rarely_apart};
use super::channel::{AsOthers, Channel, FromLevel, RUNGS, Sum};
use super::kind::{Features, Kind};
use super::level::{Expected, Explained, Member, Move, Variances, alike, explain};
use super::process::{self, DRIFTED, FEWEST, NOT_THIS_HEAD, ODD_ONE, PAUSE_NS};
use super::within::Within;
use crate::model::median::median_of;
use nalgebra::{Matrix4, Vector4};
use std::collections::{BTreeMap, BTreeSet};

#[derive(Clone, Copy, Debug)]
pub struct Look {
    pub channel: u32,
    /// The signal's ring relative to the head's base ring, per unit drive.
    pub features: Features,
    pub drive: f64,
    /// K above the model's reference temperature.
    pub warmer: f64,
}

/// The looks with drives reduced by how much smaller most rings are than the ring of ln amplitude
/// `ring`, whose noise is 1: looks at small rings say less. Drives are never raised.
fn as_large_as_most(looks: &[Look], ring: f64) -> Vec<Look> {
    let size = (median_of(looks.iter().map(|look| look.features[0])) - ring).exp().min(1.0);
    looks.iter().map(|look| Look { drive: look.drive * size, ..*look }).collect()
}

/// Where a channel is expected by itself while it is healthy.
#[derive(Clone, Copy, Debug)]
pub struct OwnLevel {
    pub channel: u32,
    pub looks: f64,
    pub at: Features,
    /// At least 1: its level drifted or lies apart, by this multiple of the bound. 0: it did not.
    pub off: f64,
    /// Where it is while it is faulty, if that is known.
    pub fault: Option<Features>,
}

/// A channel that is another one since a pause.
#[derive(Clone, Copy, Debug)]
pub struct OtherChannel {
    pub channel: u32,
    /// The first look at it, ns.
    pub since_ns: i64,
    /// How its ring differs from before: ln amplitude, ln damping, ln frequency, phase in rad.
    pub by: Features,
}

#[derive(Clone, Debug)]
pub struct Head {
    pub(super) kind: Kind,
    /// The level, what all channels have in common, and its covariance; both canonical.
    pub(super) level: Features,
    pub(super) covariance: Matrix4<f64>,
    pub channels: BTreeMap<u32, Channel>,
    pub(super) within: Within,
    /// When the head was heard last, ns; `None`: not before the recording.
    pub heard_ns: Option<i64>,
    /// Whether only another head was heard since the last pause.
    still_paused: bool,
    /// Whether the recording lies before what was heard already.
    is_earlier: bool,
    pub swapped_ns: Option<i64>,
    /// Channels that one look after a pause puts down to another channel: when, and the healthy looks before.
    replaced: BTreeMap<u32, (i64, Sum)>,
    /// Channels heard since the last pause.
    heard: BTreeSet<u32>,
    /// The variances of the channels about the level, over those that the design says, 1 or more.
    pub(super) wider: Features,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SweepOutcome {
    /// The level lies there: features from the base ring, and their standard deviations.
    Level { level: Features, sd: Features },
    /// There are few channels, or they agree on nothing: the level is where it was expected.
    Unknown,
    /// The head is not the one that it was: most channels lie there, features from the base ring.
    Strange { level: Features },
}

impl Head {
    /// A head of which nothing is known but its kind: its level is expected at the base ring.
    pub fn new(kind: Kind) -> Head {
        let of_look = kind.spread.add_scalar(1.0);
        Head {
            level: Vector4::zeros(),
            covariance: Matrix4::from_diagonal(&(of_look * process::OF_HEADS)),
            within: Within {
                covariance: Matrix4::from_diagonal(&of_look),
                looks: process::OF_BEGINNING,
            },
            kind,
            channels: BTreeMap::new(),
            heard_ns: None,
            still_paused: false,
            is_earlier: false,
            swapped_ns: None,
            replaced: BTreeMap::new(),
            heard: BTreeSet::new(),
            wider: Vector4::repeat(1.0),
        }
    }

    pub fn level(&self) -> Features {
        self.kind.from * self.level
    }

    /// Called before a recording that begins at `t_ns`. If the head was heard then or later (it is
    /// judged again), its first sweep counts as one after a pause.
    pub fn begin(&mut self, t_ns: i64) {
        self.is_earlier = self.heard_ns.is_some_and(|heard_ns| heard_ns >= t_ns);
        self.clock_set(t_ns);
        // a recorder that begins another file is no pause
        if self.heard_ns.is_some_and(|heard_ns| t_ns.abs_diff(heard_ns) <= PAUSE_NS) {
            self.heard = self.channels.keys().copied().collect();
        }
    }

    /// What follows begins at `t_ns`, and after a pause.
    pub fn clock_set(&mut self, t_ns: i64) {
        self.heard_ns = self.heard_ns.filter(|heard_ns| *heard_ns < t_ns);
    }

    /// Sets the level by a window of the same recording, for sweeps from `t_ns` on: this is no
    /// pause.
    pub fn begin_at(&mut self, at: &Features, t_ns: i64) {
        (self.level, self.heard_ns) = (self.kind.to * at, t_ns.checked_sub(1));
    }

    /// How many looks [`Head::shot`] rests on.
    pub fn looks_within(&self) -> f64 {
        self.within.looks
    }

    /// Takes in the next sweep, and learns from it unless it shows another head. `t_ns`: not before
    /// the last sweep's; `no_rings`: number of further channels whose signals are no rings.
    pub fn sweep(&mut self, t_ns: i64, looks: &[Look], no_rings: usize) -> SweepOutcome {
        let looks = &as_large_as_most(looks, self.kind.ring)[..];

        let before = (self.covariance, self.wider);
        let paused = self.walk(t_ns);
        let found = match paused {
            true => self.find_aged(looks, no_rings),
            false => self.find(looks, no_rings, false),
        };
        let Some(explained) = found else { return SweepOutcome::Unknown };

        // what may be the same head, or one like it in its place
        if !matches!(explained.by, Move::Strange) {
            if paused && self.are_others(looks, &explained) {
                // another head: what was known of channels that this sweep did not look at goes, too
                self.channels.clear();
                self.replaced.clear();
                self.swapped_ns.get_or_insert(t_ns);
            }
            self.still_paused = false;
            self.learn(t_ns, looks, &explained);
            self.watch(looks);

            // the mean of these few channels is off by chance from that of all that such heads have
            let by_chance = self.lasting() / self.channels.len().max(1) as f64;
            let of_kind = self.covariance + Matrix4::from_diagonal(&by_chance);
            let sd = self.kind.covariance_from(&of_kind).diagonal().map(f64::sqrt);
            return match explained.alike >= process::MAJORITY {
                true => SweepOutcome::Level { level: self.level(), sd },
                false => SweepOutcome::Unknown,
            };
        }

        // while another head is heard nothing is learned of where this one went
        (self.covariance, self.wider) = before;
        self.still_paused = paused;
        SweepOutcome::Strange { level: self.kind.from * explained.level }
    }

    /// Lets the level walk once, however long ago the last sweep was, and tells whether it paused.
    fn walk(&mut self, t_ns: i64) -> bool {
        let dt_ns = self.heard_ns.map_or(u64::MAX, |before| t_ns.abs_diff(before));
        self.heard_ns = Some(t_ns);
        let paused = dt_ns > PAUSE_NS || self.still_paused;
        let of_look = self.kind.spread.add_scalar(1.0);
        self.covariance += Matrix4::from_diagonal(&(of_look * process::WALK));
        if paused {
            self.heard.clear();
            self.channels.values_mut().for_each(|of| of.resume(t_ns));
        }
        paused
    }

    /// Whether most channels that were known before the pause, `FEWEST` or more, are others now.
    fn are_others(&self, looks: &[Look], of: &Explained) -> bool {
        let known = looks.iter().zip(&of.responsibilities);
        let known = known.filter(|(look, _)| self.channels.contains_key(&look.channel));
        let replaced: Vec<bool> = known.map(|(_, r)| r.replaced > 0.5).collect();
        let others = replaced.iter().filter(|is| **is).count();
        replaced.len() >= FEWEST && 2 * others > replaced.len()
    }

    fn member(&self, look: &Look, paused: bool) -> Member {
        let new = Channel::default();
        let channel = self.channels.get(&look.channel).unwrap_or(&new);
        let at = self.kind.to * look.features;
        let is_first = paused || !self.heard.contains(&look.channel);
        let by = Variances {
            noise: self.noise(),
            lasting: self.lasting(),
            spread: self.kind.spread.component_mul(&self.wider),
            per_k: self.kind.variances_per_k(),
        };
        let looks = look.drive * look.drive;
        Member::new(FromLevel { at, looks, warmer: look.warmer }, channel, &by, is_first)
    }

    /// The level that explains a sweep after a pause. Where the channels agree on none, they are taken
    /// to lie two, four or eight times as far apart as before, whichever is likeliest.
    fn find_aged(&mut self, looks: &[Look], no_rings: usize) -> Option<Explained> {
        let mut best = self.find(looks, no_rings, true)?;
        if best.alike >= process::MAJORITY {
            return Some(best);
        }
        let (before, mut wider) = (self.wider, self.wider);
        for times in [4.0, 16.0, 64.0] {
            self.wider = before * times;
            let found = self.find(looks, no_rings, true)?;
            if found.alike >= process::MAJORITY && found.ln_density > best.ln_density {
                (best, wider) = (found, self.wider);
            }
        }
        self.wider = wider;
        Some(best)
    }

    /// `None`: too few channels. `explain` always finds a likeliest level; here it is asked whether
    /// this head can move so far, and whether the channels have moved with it.
    fn find(&mut self, looks: &[Look], no_rings: usize, paused: bool) -> Option<Explained> {
        if looks.is_empty() || self.channels.len().max(looks.len()) < FEWEST {
            return None;
        }
        let members: Vec<Member> = looks.iter().map(|look| self.member(look, paused)).collect();
        let expected = Expected::new(self.level, &self.covariance, &self.kind, paused)?;

        // a channel whose signal is no ring does not agree with the likeliest level
        let rings = members.len() as f64 / (members.len() + no_rings) as f64;
        let mut of = explain(&expected, &members);
        of.alike *= rings;

        // a move too large for walk and leap together is another head's, unless it leads back to where the design
        // learned such heads, as fresh ink or a cleaning of all channels does
        let move_by = of.level - self.level;
        let allowed = (self.covariance + self.kind.leap).try_inverse()?;
        if move_by.dot(&(allowed * move_by)) > NOT_THIS_HEAD {
            let of_heads = self.kind.spread.add_scalar(1.0) * process::OF_HEADS;
            let from_design = of.level.zip_map(&of_heads, |d, v| d * d / v).sum();
            of.by = if from_design > NOT_THIS_HEAD { Move::Strange } else { Move::Leap };
        }

        // a head moves with all of its channels but the faulty ones, so a move that leaves too many
        // behind is not believed
        let is_left = alike(&members, &self.level) * rings <= 0.5 * process::MAJORITY;
        if of.by != Move::Walk && !(is_left && of.alike >= process::MAJORITY) {
            of = explain(&expected.as_it_walks(), &members);
            of.alike *= rings;
            of.by = Move::Walk;
        }
        Some(of)
    }

    /// Updates the level, the scatter and the channels. If too few looks agree, the first two stay.
    fn learn(&mut self, t_ns: i64, looks: &[Look], of: &Explained) {
        let spread = self.kind.spread;

        if of.by == Move::Leap {
            self.covariance += self.kind.leap;
        }
        let is_known = of.alike >= process::MAJORITY;
        if is_known {
            self.update(of);
        }
        let (uncertain, noise) = (self.covariance, self.noise());
        for (look, r) in looks.iter().zip(&of.responsibilities) {
            let at = self.kind.to * look.features - self.level;
            let precision = look.drive * look.drive;
            let channel = self.channels.entry(look.channel).or_default();

            let own = channel.healthy();
            if is_known && own.looks >= 1.0 && r.healthy > 0.5 {
                // less the variances of the level, of a smaller drive, and of the mean of looks before
                let off = at - own.mean();
                let of_drive = 1.0 / precision - 1.0;
                let of_warmth = self.kind.per_k * (look.warmer - own.warmer()).powi(2);
                let taken_off = uncertain + Matrix4::from_diagonal_element(of_drive) + of_warmth;
                let square = off * off.transpose() - taken_off;
                // a square says the less the more of it is another temperature's
                let share = noise.component_div(&(noise + of_warmth.diagonal())).min().powi(2);
                self.within.learn(square / (1.0 + 1.0 / own.looks), r.healthy * share);
            }

            // an uncertain level makes the look's position less certain
            let of_level = uncertain.diagonal().component_div(&noise).mean();
            let looks = 1.0 / (1.0 / precision + of_level);
            if r.replaced > 0.5 && own.looks >= process::FEW {
                self.replaced.insert(look.channel, (t_ns, own));
            }
            let look_at = FromLevel { at, looks, warmer: look.warmer };
            channel.learn(t_ns, look_at, *r, (&spread, &noise));
            self.heard.insert(look.channel);
        }
    }

    fn watch(&mut self, looks: &[Look]) {
        let (spread, noise) = (self.kind.spread, self.noise());

        let by = (&noise, &self.kind.variances_per_k());
        let of = |look: &Look| self.channels.get(&look.channel).map(|of| of.moved(&spread, by));
        let moved: Vec<_> = looks.iter().filter_map(of).collect();

        // where each is while it is healthy: many that are faulty lie apart, and widen nothing
        let place = |look: &Look| self.channels.get(&look.channel)?.healthy_place(&spread, &noise);
        let places: Vec<Features> = looks.iter().filter_map(place).collect();
        // of channels without a past nothing else is known than that: that they lie further apart than the design says is
        // believed only where chance seldom leads to it, or a fault would itself make faults less rare
        let at_first = Apart::learn(&places, RARELY);

        // how far all have moved over each span of days, and, last, how far they lie from the level
        let apart: [Apart; RUNGS + 1] = std::array::from_fn(|rung| {
            let of_rung = || moved.iter().filter_map(|of| of[rung]).collect();
            let known: Vec<Features> = if rung == RUNGS { places.clone() } else { of_rung() };
            // a design's spread was itself learned from few channels; moving over days is taken for
            // chance as long as it may be
            let is_of_head = rung == RUNGS;
            let is_aged = is_of_head && self.wider.max() > ALIKE;
            let is_asked = is_aged || known.iter().any(|of| of.norm_squared() > BOUNDS[rung]);
            let chance = if is_of_head { 0.0 } else { OFTEN };
            if is_asked { Apart::learn(&known, chance) } else { Apart::as_known() }
        });
        self.wider += (apart[RUNGS].wider() - self.wider) * process::OF_SWEEP;

        let all_age = apart[..RUNGS].iter().any(|of| of.each_its_own_way);
        for (look, moved) in looks.iter().zip(moved) {
            let Some(channel) = self.channels.get_mut(&look.channel) else { continue };
            let times = |rung: usize| channel.times_as_long(rung);
            let of = |rung: usize| match rung == RUNGS && !channel.has_past() {
                true => &at_first,
                false => &apart[rung],
            };
            let square =
                |rung: usize| moved[rung].map_or(0.0, |by| of(rung).square(&by, times(rung)));
            let is_within =
                |rung: usize| moved[rung].is_none_or(|of| apart[rung].holds(&of, times(rung)));
            let squares = std::array::from_fn(square);
            let moves = all_age && (0..RUNGS).all(is_within);
            channel.watch(squares, AsOthers { moves, lies: is_within(RUNGS) });
        }
    }

    /// Channels that ring otherwise than before a pause, as another channel in their place would: not by the
    /// first look alone, but where the mean of the looks since lies beyond what a channel moves by from day to
    /// day ([`DRIFTED`]). None in a recording that is earlier than what is known: it shows the channel before.
    pub fn replaced(&self) -> impl Iterator<Item = OtherChannel> {
        let of_looks = self.noise() * process::BETWEEN.powi(2);
        let per_k = self.kind.variances_per_k();
        let told = self.replaced.iter().filter(|_| !self.is_earlier);
        told.filter_map(move |(&channel, &(since_ns, before))| {
            let now = self.channels.get(&channel)?.healthy();
            let of_warmth = per_k * (now.warmer() - before.warmer()).powi(2);
            let of_now = self.noise() / now.looks.max(f64::MIN_POSITIVE);
            let variance = of_looks * 2.0 + of_now + of_warmth;
            let by = now.mean() - before.mean();
            let is_other = by.component_div(&variance.map(f64::sqrt)).norm_squared() > DRIFTED;
            (is_other && now.looks >= process::FEW).then(|| OtherChannel {
                channel,
                since_ns,
                by: self.kind.from * by,
            })
        })
    }

    fn update(&mut self, of: &Explained) {
        let precision = of.evidence.precision.map(|p| p.max(1e-12));
        let at = of.evidence.sum.component_div(&precision);
        let of_looks = Matrix4::from_diagonal(&precision.map(|p| 1.0 / p));
        if let Some(inverse) = (self.covariance + of_looks).try_inverse() {
            let gain = self.covariance * inverse;
            self.level += gain * (at - self.level);
            let left = self.covariance - gain * self.covariance;
            self.covariance = (left + left.transpose()) * 0.5;
        }
    }

    fn noise(&self) -> Features {
        self.within.noise(&self.kind.spread)
    }

    /// Covariance of features of one channel's looks beyond the noise.
    pub fn shot(&self) -> Matrix4<f64> {
        self.kind.covariance_from(&(self.within.of_look(&self.kind.spread) - Matrix4::identity()))
    }

    /// Share of what healthy signals differ by that is their channels' own for good.
    pub fn lasting_share(&self) -> f64 {
        let spread = &self.kind.spread;
        self.within.lasting(spread).sum() / spread.sum().max(f64::MIN_POSITIVE)
    }

    /// How many times as far apart the channels lie as the design says, in the widest coordinate.
    pub fn wider(&self) -> f64 {
        self.wider.max().sqrt()
    }

    /// `Head::wider` over what so few channels show by chance.
    pub fn surely_wider(&self) -> f64 {
        self.wider() / rarely_apart(self.channels.len())
    }

    /// Variances of the channels' own places about the level, canonical.
    fn lasting(&self) -> Features {
        self.within.lasting(&self.kind.spread).component_mul(&self.wider)
    }

    /// Covariance of features of a healthy look at the reference drive, noise apart, about the place
    /// where its channel is expected by `looks` looks, at a temperature `apart` K from theirs.
    pub fn scatter(&self, looks: f64, apart: f64) -> Matrix4<f64> {
        let (noise, lasting) = (self.noise(), self.lasting());
        let (_, of_level) = Sum { looks, ..Sum::default() }.posterior(&lasting, &noise);
        let of_level = Matrix4::from_diagonal(&of_level) + self.kind.per_k * apart.powi(2);
        self.shot() + self.kind.covariance_from(&of_level)
    }

    /// How many K above its model's reference temperature its channels' healthy looks were: the median. NaN: none.
    pub fn warmer(&self) -> f64 {
        let healthy = self.channels.values().map(Channel::healthy);
        median_of(healthy.filter(|of| of.looks > 0.0).map(|of| of.warmer()))
    }

    pub fn own(&self) -> impl Iterator<Item = OwnLevel> {
        let (from, noise) = (self.kind.from, self.noise());
        let lasting = self.lasting();
        self.channels.iter().map(move |(channel, of)| {
            let healthy = of.healthy();
            let at = from * healthy.posterior(&lasting, &noise).0;
            let fault = of.knows_fault().then(|| from * of.faulty.mean());
            OwnLevel { channel: *channel, looks: healthy.looks, at, off: of.off, fault }
        })
    }
}

/// Squared distances, as by [`Channel::moved`], beyond which channels are compared with all.
const BOUNDS: [f64; RUNGS + 1] = [DRIFTED, DRIFTED, DRIFTED, ODD_ONE];
/// Up to this value of `Head::wider` channels count as lying as the design says.
const ALIKE: f64 = 1.01;
