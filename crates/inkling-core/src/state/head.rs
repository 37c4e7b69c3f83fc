//! One printhead: its level, and each of its channels from there, filtered sweep by sweep in the
//! order of time.
//!
//! In: a sweep, that is, looks at many channels of the head within one stretch of time ([`Look`]).
//! Out: what the sweep tells of the level ([`SweepOutcome`]), and afterwards the channels' own
//! levels ([`Head::own`]) and how far healthy looks scatter ([`Head::scatter`]), by which
//! `src/pipeline/head.rs` moves the judges. A sweep ([`Head::sweep`]) has four steps:
//!
//! 1. `walk`: the level has become less certain since the last sweep.
//! 2. `find`: the level that explains the sweep (`level.rs`), and whether it is believed or is
//!    another head's.
//! 3. `learn`: Kalman's update of the level, of the scatter within channels, and of each channel.
//! 4. `watch`: which channels have drifted slowly from their past, or lie apart (`ageing.rs`).
//!
//! Inside, positions are canonical (`kind.rs`); what comes in and goes out are features from the
//! base ring.

use super::ageing::{Apart, rarely_apart};
use super::channel::{Channel, FromLevel, RUNGS, Sum};
use super::kind::{Features, Kind, at_least};
use super::level::{Expected, Explained, Member, Move, Variances, alike, explain};
use super::process::{self, DRIFTED, FEWEST, NOT_THIS_HEAD, ODD_ONE, PAUSE_NS};
use crate::model::median::median_of;
use nalgebra::{Matrix4, Vector4};
use std::collections::{BTreeMap, BTreeSet};

/// One look at a channel in a sweep.
#[derive(Clone, Copy, Debug)]
pub struct Look {
    pub channel: u32,
    /// The signal's ring relative to the head's base ring, per unit drive.
    pub features: Features,
    /// Drive voltage over the reference voltage.
    pub drive: f64,
}

/// The looks with their drives reduced by how much smaller most rings are than the ring whose noise
/// is 1. `ring`: that ring's ln amplitude, from the base ring. The noise of a ring's features is
/// that of its samples over its amplitude, so that looks at small rings say less. Larger rings are
/// no reason to believe looks more, so drives are never raised.
fn as_large_as_most(looks: &[Look], ring: f64) -> Vec<Look> {
    let size = (median_of(looks.iter().map(|look| look.features[0])) - ring).exp().min(1.0);
    looks.iter().map(|look| Look { drive: look.drive * size, ..*look }).collect()
}

/// Where a channel is expected by itself while it is healthy.
#[derive(Clone, Copy, Debug)]
pub struct OwnLevel {
    pub channel: u32,
    /// Number of looks that the expectation rests on; 0: it is the head's level itself.
    pub looks: f64,
    /// Where the channel is expected: features from the head's level.
    pub at: Features,
    /// At least 1: the channel's level has drifted from that place or lies apart from all channels,
    /// by this multiple of the bound; its signals are flagged. 0: it has not.
    pub off: f64,
}

/// What is known of a printhead now; [`Head::sweep`] takes in what is heard of it next.
#[derive(Clone, Debug)]
pub struct Head {
    /// The coordinates, and what a design says of such heads.
    pub(super) kind: Kind,
    /// The level: what all channels have in common, from the base ring, and its covariance; both
    /// canonical.
    pub(super) level: Features,
    pub(super) covariance: Matrix4<f64>,
    /// What is known of each channel, by its number.
    pub(super) channels: BTreeMap<u32, Channel>,
    /// How far looks scatter about their own channels.
    pub(super) within: Within,
    /// When the head was heard last, ns; `None`: never, or what is known of it is from later than
    /// now.
    pub(super) heard_ns: Option<i64>,
    /// Whether only another head was heard since the last pause.
    still_paused: bool,
    /// When it turned out that all channels are others than those that were remembered, ns.
    swapped_ns: Option<i64>,
    /// Channels heard since the last pause.
    heard: BTreeSet<u32>,
    /// How many times as far the channels lie from each other as the design says, squared,
    /// coordinate by coordinate (canonical): 1, and more where the channels have aged.
    pub(super) wider: Features,
}

/// How far healthy looks lie off their own channels: noise, and what differs from drop to drop.
/// Canonical.
///
/// A design knows how far healthy signals differ, noise and all, and not how much of that is a
/// channel's own for good and how much is drawn anew for each drop. A head begins with nothing
/// lasting: everything is taken to be drawn anew. Its looks then tell how much is, by how far looks
/// lie from the mean of their own channel's looks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Within {
    /// Mean square, as a matrix, of healthy looks' distances from the mean of their channel's looks
    /// before. What drops differ by, the amplitude alone for example, has its own direction in the
    /// canonical coordinates, which the variances along these do not tell.
    pub covariance: Matrix4<f64>,
    /// Number of looks that `covariance` is the mean of.
    pub looks: f64,
}

impl Within {
    /// What a head begins with: nothing of what healthy signals differ by is a channel's own for
    /// good. `spread`: variances of what they differ by, noise apart.
    fn unknown(spread: &Features) -> Within {
        let covariance = Matrix4::from_diagonal(&spread.add_scalar(1.0));
        Within { covariance, looks: process::of_beginning() }
    }

    /// Variance of one look about its channel: never below the noise of the design, and never
    /// beyond what healthy signals differ by. What scatters further are faults that were taken for
    /// healthy.
    fn noise(&self, spread: &Features) -> Features {
        self.covariance.diagonal().zip_map(spread, |v, s2| v.clamp(1.0, 1.0 + s2))
    }

    /// The covariance of one look about its channel, scaled such that no variance exceeds the upper
    /// bound of `noise`, and then no less than the noise of the design in any direction.
    fn of_look(&self, spread: &Features) -> Matrix4<f64> {
        // Factors on the standard deviations. A variance that chance made negative has no root: its
        // factor is 1, and the lower bound makes it positive.
        let all = spread.add_scalar(1.0);
        let reduced =
            self.covariance.diagonal().zip_map(&all, |v, most| (most / v).sqrt().min(1.0));
        let reduced = Matrix4::from_diagonal(&reduced);
        at_least(1.0, &(reduced * self.covariance * reduced))
    }

    /// Variance of healthy channels about their head: what is left of how far healthy signals
    /// differ.
    fn lasting(&self, spread: &Features) -> Features {
        spread.add_scalar(1.0) - self.noise(spread)
    }

    /// Takes one more look into the mean. `square`: an unbiased measurement of the covariance by
    /// the look; `weight`: the probability that the look is a healthy one.
    fn learn(&mut self, square: Matrix4<f64>, weight: f64) {
        self.looks = (self.looks + weight).min(process::most_within());
        self.covariance += (square - self.covariance) * (weight / self.looks);
    }
}

/// What one sweep over a head's channels tells of the head's level.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SweepOutcome {
    /// The level lies there: features from the base ring, and their standard deviations.
    Level { level: Features, sd: Features },
    /// The level is taken to be where it was expected: there are few channels, or they agree on
    /// nothing.
    Unknown,
    /// The head is not the one that it was, since most of its channels lie there: features from the
    /// base ring.
    Strange { level: Features },
}

impl Head {
    /// A head of which nothing is known but its kind: its level is expected at the base ring.
    pub fn new(kind: Kind) -> Head {
        let of_look = kind.spread.add_scalar(1.0);

        let covariance = Matrix4::from_diagonal(&(of_look * process::of_heads()));
        Head {
            level: Vector4::zeros(),
            covariance,
            within: Within::unknown(&kind.spread),
            kind,
            channels: BTreeMap::new(),
            heard_ns: None,
            still_paused: false,
            swapped_ns: None,
            heard: BTreeSet::new(),
            wider: Vector4::repeat(1.0),
        }
    }

    /// Where the level is, features from the base ring.
    pub fn level(&self) -> Features {
        self.kind.from * self.level
    }

    /// Called before a recording that begins at `t_ns`. If the head was heard at that time or later
    /// (a recording is judged again), what is known of the head is used as it is, and the time is
    /// forgotten, so that the recording's sweeps do not come too late. The first sweep then counts
    /// as one after a pause.
    pub fn begin(&mut self, t_ns: i64) {
        self.heard_ns = self.heard_ns.filter(|heard_ns| *heard_ns < t_ns);
    }

    /// Sets the level to what a window of the same recording says, before sweeps from the time
    /// `t_ns` on are taken in: there was no pause between the two. `at`: the window's level,
    /// features from the base ring.
    pub fn begin_at(&mut self, at: &Features, t_ns: i64) {
        (self.level, self.heard_ns) = (self.kind.to * at, t_ns.checked_sub(1));
    }

    /// When the head was heard last, ns; `None`: never, or not before the recording
    /// ([`Head::begin`]).
    pub fn heard_ns(&self) -> Option<i64> {
        self.heard_ns
    }

    /// When all its channels turned out to be others than those that were remembered, ns.
    pub fn swapped_ns(&self) -> Option<i64> {
        self.swapped_ns
    }

    /// Number of channels that are followed.
    pub fn channels(&self) -> usize {
        self.channels.len()
    }

    /// Whether the channel is followed.
    pub fn knows(&self, channel: u32) -> bool {
        self.channels.contains_key(&channel)
    }

    /// How many looks [`Head::shot`] rests on.
    pub fn looks_within(&self) -> f64 {
        self.within.looks
    }

    /// Takes in the next sweep, and learns from it unless it shows another head. `t_ns`: the
    /// sweep's time, not before the last one's; `no_rings`: number of channels that were looked at,
    /// too, and whose signals are no rings.
    pub fn sweep(&mut self, t_ns: i64, looks: &[Look], no_rings: usize) -> SweepOutcome {
        let looks = &as_large_as_most(looks, self.kind.ring)[..];

        // where the level may have gone, and the level that explains the sweep
        let before = (self.covariance, self.wider);
        let paused = self.walk(t_ns);
        let found = match paused {
            true => self.find_aged(looks, no_rings),
            false => self.find(looks, no_rings, false),
        };
        let Some(explained) = found else { return SweepOutcome::Unknown };

        // what may be the same head, or one like it in its place: what it tells is learned
        if !matches!(explained.by, Move::Strange) {
            if paused && self.are_others(looks, &explained) {
                // another head in this one's place: what was known of the channels that this sweep did
                // not look at goes, too
                self.channels.clear();
                self.swapped_ns.get_or_insert(t_ns);
            }
            self.still_paused = false;
            self.learn(t_ns, looks, &explained);
            self.watch(looks);

            // How certain the level is. The mean of these few channels is off by chance from that
            // of all channels that such heads have, which the design describes.
            let by_chance = self.lasting() / self.channels.len().max(1) as f64;
            let of_kind = self.covariance + Matrix4::from_diagonal(&by_chance);
            let sd = self.kind.covariance_from(&of_kind).diagonal().map(f64::sqrt);
            return match explained.alike >= process::MAJORITY {
                true => SweepOutcome::Level { level: self.level(), sd },
                false => SweepOutcome::Unknown,
            };
        }

        // While another head is heard nothing is learned of where this one went, and it goes on standing still.
        (self.covariance, self.wider) = before;
        self.still_paused = paused;
        SweepOutcome::Strange { level: self.kind.from * explained.level }
    }

    /// Lets the level's covariance grow by what the level walks from one sweep to the next, however
    /// long that is, and tells whether there was a pause before the sweep at `t_ns`. After a pause
    /// the channels are told.
    fn walk(&mut self, t_ns: i64) -> bool {
        let dt_ns = self.heard_ns.map_or(u64::MAX, |before| t_ns.abs_diff(before));
        self.heard_ns = Some(t_ns);
        let paused = dt_ns > PAUSE_NS || self.still_paused;
        let of_look = self.kind.spread.add_scalar(1.0);
        self.covariance += Matrix4::from_diagonal(&(of_look * process::walk()));
        if paused {
            self.heard.clear();
            self.channels.values_mut().for_each(|of| of.resume(t_ns));
        }
        paused
    }

    /// Whether most of the channels of this sweep that were known before the pause are other ones
    /// now; at least `FEWEST` have to be known.
    fn are_others(&self, looks: &[Look], of: &Explained) -> bool {
        let known = looks.iter().zip(&of.responsibilities);
        let known = known.filter(|(look, _)| self.channels.contains_key(&look.channel));
        let (mut all, mut others) = (0, 0);
        for (_, r) in known {
            all += 1;
            others += usize::from(r.replaced > 0.5);
        }
        all >= FEWEST && 2 * others > all
    }

    /// A look, prepared by what is known of its channel. `paused`: this is the first sweep after a
    /// pause.
    fn member(&self, look: &Look, paused: bool) -> Member {
        let new = Channel::default();
        let channel = self.channels.get(&look.channel).unwrap_or(&new);
        let at = self.kind.to * look.features;
        let is_first = paused || !self.heard.contains(&look.channel);
        let by = Variances {
            noise: self.noise(),
            lasting: self.lasting(),
            spread: self.kind.spread.component_mul(&self.wider),
        };
        Member::new(at, look.drive * look.drive, channel, &by, is_first)
    }

    /// The level that explains the first sweep after a pause, in which channels may have moved
    /// apart. Where the channels agree on no level, they are taken to lie twice, four or eight
    /// times as far from each other as before, whichever is likeliest; `wider` keeps that.
    fn find_aged(&mut self, looks: &[Look], no_rings: usize) -> Option<Explained> {
        let as_before = self.find(looks, no_rings, true)?;
        let mut best = (self.wider, as_before);
        if best.1.alike >= process::MAJORITY {
            return Some(best.1);
        }
        let before = self.wider;
        for times in [4.0, 16.0, 64.0] {
            self.wider = before * times;
            let found = self.find(looks, no_rings, true)?;
            let is_likelier = found.ln_density > best.1.ln_density;
            if found.alike >= process::MAJORITY && is_likelier {
                best = (self.wider, found);
            }
        }
        self.wider = best.0;
        Some(best.1)
    }

    /// The level that explains a sweep, and how it got there. `None`: there are too few channels to
    /// tell.
    ///
    /// `explain` always finds a likeliest level. Here it is asked whether that is believed: whether
    /// the move is larger than this head can make (another head), and, if the level has moved by
    /// more than a walk, whether the channels have moved with it. `paused`: the sweep is the first
    /// after a pause.
    fn find(&mut self, looks: &[Look], no_rings: usize, paused: bool) -> Option<Explained> {
        let members: Vec<Member> = looks.iter().map(|look| self.member(look, paused)).collect();
        let members = &members[..];
        // neither this sweep nor what is known before it has enough channels for a level in common
        let few = looks.len() < FEWEST && self.channels.len().max(looks.len()) < FEWEST;
        let expected = Expected::new(self.level, &self.covariance, &self.kind, paused && !few)?;
        if few || looks.is_empty() {
            return None;
        }

        // The likeliest level. A channel whose signal is no ring does not agree with it.
        let rings = members.len() as f64 / (members.len() + no_rings) as f64;
        let mut of = explain(&expected, members);
        of.alike *= rings;

        // a move too large for walk and leap together is another head's
        let move_by = of.level - self.level;
        let allowed = (self.covariance + self.kind.leap).try_inverse()?;
        if move_by.dot(&(allowed * move_by)) > NOT_THIS_HEAD {
            of.by = Move::Strange;
        }

        // A head moves with all of its channels but the faulty ones, so that few may still be where
        // it was. A move that leaves too many behind is not believed, and the sweep is explained
        // without one.
        let is_left = alike(members, &self.level) * rings <= 0.5 * process::MAJORITY;
        if of.by != Move::Walk && !(is_left && of.alike >= process::MAJORITY) {
            of = explain(&expected.as_it_walks(), members);
            of.alike *= rings;
            of.by = Move::Walk;
        }
        Some(of)
    }

    /// Updates the level, then for each look how far looks scatter about their channels (by the
    /// channel as it was before the look), and the look's channel. Where the level is not known
    /// (too few looks agree), it and the scatter stay as they were.
    fn learn(&mut self, t_ns: i64, looks: &[Look], of: &Explained) {
        let spread = self.kind.spread;

        // the level
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

            // how far looks scatter about their channels
            let own = channel.healthy();
            if is_known && own.looks >= 1.0 && r.healthy > 0.5 {
                // The square of the distance from the mean of the channel's looks before does not
                // depend on how far channels differ. It holds the variance of the level and what a
                // smaller drive adds, which are taken off, and the variance of that mean, for which
                // the rest is divided by 1 + 1 / looks.
                let off = at - own.mean();
                let of_drive = 1.0 / precision - 1.0;
                let taken_off = uncertain + Matrix4::from_diagonal_element(of_drive);
                let square = off * off.transpose() - taken_off;
                self.within.learn(square / (1.0 + 1.0 / own.looks), r.healthy);
            }

            // The channel. An uncertain level makes the look's position less certain, too: its
            // variance, over that of one look, is added.
            let of_level = uncertain.diagonal().component_div(&noise).mean();
            let looks = 1.0 / (1.0 / precision + of_level);
            channel.learn(t_ns, FromLevel { at, looks }, *r, (&spread, &noise));
            self.heard.insert(look.channel);
        }
    }

    /// Finds out which channels of the sweep are no longer where healthy ones are, and tells them
    /// (`Channel::watch`). What most of a head's channels do is ageing, what one does is a fault:
    /// where a channel lies beyond a bound, it is compared with how far all have moved apart
    /// (`Apart`).
    fn watch(&mut self, looks: &[Look]) {
        let (spread, noise) = (self.kind.spread, self.noise());

        // how far each channel has moved, over each span of days
        let of = |look: &Look| self.channels.get(&look.channel).map(|of| of.moved(&spread, &noise));
        let moved: Vec<_> = looks.iter().filter_map(of).collect();

        // How far all of them have moved, for each span of days (and, last, how far they lie from
        // the level), as a covariance. It costs time, and is computed only where a channel lies
        // beyond the bound.
        let apart: [Apart; RUNGS + 1] = std::array::from_fn(|rung| {
            let known: Vec<Features> = moved.iter().filter_map(|of| of[rung]).collect();
            // What a design says of how far channels lie from each other was itself learned from
            // few channels. So that is learned from these as they are, while moving over days is
            // taken for chance as long as it may be.
            let is_of_head = rung == RUNGS;
            let is_aged = is_of_head && self.wider.max() > ALIKE;
            let is_asked = is_aged || known.iter().any(|of| of.norm_squared() > BOUNDS[rung]);
            if is_asked { Apart::learn(&known, !is_of_head) } else { Apart::as_known() }
        });
        self.wider += (apart[RUNGS].wider() - self.wider) * process::of_sweep();

        // each channel by these covariances
        let all_age = apart[..RUNGS].iter().any(|of| of.each_its_own_way);
        for (look, moved) in looks.iter().zip(moved) {
            let Some(channel) = self.channels.get_mut(&look.channel) else { continue };
            let times = |rung: usize| channel.times_as_long(rung);
            let square =
                |rung: usize| moved[rung].map_or(0.0, |of| apart[rung].square(&of, times(rung)));
            let is_within =
                |rung: usize| moved[rung].is_none_or(|of| apart[rung].holds(&of, times(rung)));
            let squares = std::array::from_fn(square);
            let is_alike = all_age && (0..RUNGS).all(is_within);
            channel.watch(squares, is_alike);
        }
    }

    /// Kalman's update of the level and its covariance by what the looks say of the level.
    fn update(&mut self, of: &Explained) {
        // the looks together are one measurement: its place and its variances
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

    /// Variance of one look about where its channel lies, canonical.
    fn noise(&self) -> Features {
        self.within.noise(&self.kind.spread)
    }

    /// Covariance of features of one channel's looks beyond the noise: what differs from drop to
    /// drop.
    pub fn shot(&self) -> Matrix4<f64> {
        self.kind.covariance_from(&(self.within.of_look(&self.kind.spread) - Matrix4::identity()))
    }

    /// Share of what healthy signals differ by that is their channels' own for good.
    pub fn lasting_share(&self) -> f64 {
        let spread = &self.kind.spread;
        self.within.lasting(spread).sum() / spread.sum().max(f64::MIN_POSITIVE)
    }

    /// How many times as far the channels lie from each other as those that the design was learned
    /// from, in the canonical coordinate in which that is most.
    pub fn wider(&self) -> f64 {
        self.wider.max().sqrt()
    }

    /// `Head::wider` over what so few channels, of which some may be faulty, show by chance: what
    /// exceeds 1 is no chance.
    pub fn surely_wider(&self) -> f64 {
        self.wider() / rarely_apart(self.channels.len())
    }

    /// Variances of the channels' own places about the level, canonical; larger where the channels
    /// have aged.
    fn lasting(&self) -> Features {
        self.within.lasting(&self.kind.spread).component_mul(&self.wider)
    }

    /// Covariance of features of a healthy look at the reference drive, noise apart, about the
    /// place where its channel is expected: what differs from drop to drop, and how uncertain that
    /// place is, which rests on `looks` looks.
    pub fn scatter(&self, looks: f64) -> Matrix4<f64> {
        let (noise, lasting) = (self.noise(), self.lasting());
        let (_, of_level) = Sum { looks, sum: [0.0; 4] }.posterior(&lasting, &noise);
        self.shot() + self.kind.covariance_from(&Matrix4::from_diagonal(&of_level))
    }

    /// Where each followed channel is expected while it is healthy.
    pub fn own(&self) -> impl Iterator<Item = OwnLevel> {
        let (from, noise) = (self.kind.from, self.noise());
        let lasting = self.lasting();
        self.channels.iter().map(move |(channel, of)| {
            let healthy = of.healthy();
            let at = from * healthy.posterior(&lasting, &noise).0;
            OwnLevel { channel: *channel, looks: healthy.looks, at, off: of.off }
        })
    }
}

/// Squared distances beyond which a channel is compared with what all channels of its head did, in
/// the order of [`Channel::moved`].
const BOUNDS: [f64; RUNGS + 1] = [DRIFTED, DRIFTED, DRIFTED, ODD_ONE];
/// Up to this value of `Head::wider` channels count as lying from each other as the design says.
const ALIKE: f64 = 1.01;
