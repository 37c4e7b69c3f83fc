//! One printhead: its level, and each of its channels from there, filtered sweep by sweep in the order of time.

use super::ageing::Apart;
use super::canonical::{Canonical, Features};
use super::channel::{Channel, FromLevel, RUNGS, Sum};
use super::level::{Expected, Explained, Member, Move, Variances, explain};
use super::process::{self, DRIFTED, FEWEST, NOT_THIS_HEAD, ODD_ONE, PAUSE_NS};
use nalgebra::{Matrix4, Vector4};
use std::collections::{BTreeMap, BTreeSet};

/// How a kind of head scatters and moves: what a design says of it.
#[derive(Clone, Debug)]
pub struct Kind {
    pub canonical: Canonical,
    /// Covariance of a leap, canonical.
    leap: Matrix4<f64>,
}

impl Kind {
    /// Covariances of features: of one look's noise at the reference drive, of healthy channels, of what moves all
    /// channels at once (another drive, another temperature). `None`: `noise` is no covariance.
    pub fn new(noise: &Matrix4<f64>, spread: &Matrix4<f64>, leap: &Matrix4<f64>) -> Option<Kind> {
        let canonical = Canonical::new(noise, spread)?;
        let leap = canonical.covariance(leap);
        Some(Kind { canonical, leap })
    }
}

/// One look at a channel in a sweep.
#[derive(Clone, Copy, Debug)]
pub struct Look {
    pub channel: u32,
    /// From the head's base ring, per unit drive.
    pub features: Features,
    /// Relative drive.
    pub drive: f64,
}

/// Where a channel is expected by itself while it is healthy.
#[derive(Clone, Copy, Debug)]
pub struct OwnLevel {
    pub channel: u32,
    /// Looks behind it.
    pub looks: f64,
    /// Features from the head's level.
    pub at: Features,
    /// How far beyond the bound its level lay when it left that place; 0: it did not.
    pub off: f64,
}

#[derive(Clone, Debug)]
pub struct Head {
    kind: Kind,
    /// Canonical, from the base ring; and its covariance.
    pub(super) level: Features,
    pub(super) covariance: Matrix4<f64>,
    pub(super) channels: BTreeMap<u32, Channel>,
    pub(super) within: Within,
    /// When it was heard last, ns.
    pub(super) heard_ns: Option<i64>,
    /// When it turned out that all its channels are others than those that were remembered, ns.
    swapped_ns: Option<i64>,
    /// Channels heard since the last pause.
    heard: BTreeSet<u32>,
    /// How many times as far its channels lie from each other as the design says, squared: they have aged. Canonical.
    pub(super) wider: Features,
}

/// How far healthy looks lie off their own channels: noise, and what differs from drop to drop. Canonical variances.
///
/// A design knows how far healthy signals differ, noise and all, and not how much of that is a channel's own for
/// good and how much is drawn anew for each drop. A head begins with nothing lasting, and its looks tell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Within {
    /// Mean square.
    pub square: Features,
    pub looks: f64,
}

impl Within {
    /// Nothing of what healthy signals differ by is a channel's own. `spread`: variances of that, noise apart.
    fn unknown(spread: &Features) -> Within {
        Within { square: spread.add_scalar(1.0), looks: process::of_beginning() }
    }

    /// Variance of one look about its channel, never below the noise of the design.
    fn noise(&self) -> Features {
        self.square.map(|v| v.max(1.0))
    }

    /// Variance of healthy channels about their head: what is left of how far healthy signals differ.
    fn lasting(&self, spread: &Features) -> Features {
        (spread.add_scalar(1.0) - self.noise()).map(|v| v.max(0.0))
    }

    fn learn(&mut self, square: Features, weight: f64) {
        self.looks = (self.looks + weight).min(process::most_within());
        self.square += (square - self.square) * (weight / self.looks);
    }
}

/// What one sweep over a head's channels tells of the head's level.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SweepOutcome {
    /// The level lies there: features from the base ring, and their standard deviations.
    Level { level: Features, sd: Features },
    /// The level is taken to be where it was expected: there are few channels, or they agree on nothing.
    Unknown,
    /// The head is not the one that it was: most of its channels lie there.
    Strange { level: Features },
}

impl Head {
    pub fn new(kind: Kind) -> Head {
        let of_look = kind.canonical.spread.add_scalar(1.0);
        let covariance = Matrix4::from_diagonal(&(of_look * process::of_heads()));
        Head {
            level: Vector4::zeros(),
            covariance,
            within: Within::unknown(&kind.canonical.spread),
            kind,
            channels: BTreeMap::new(),
            heard_ns: None,
            swapped_ns: None,
            heard: BTreeSet::new(),
            wider: Vector4::repeat(1.0),
        }
    }

    pub(super) fn canonical(&self) -> &Canonical {
        &self.kind.canonical
    }

    /// Where the level is, features from the base ring.
    pub fn level(&self) -> Features {
        self.kind.canonical.from * self.level
    }

    /// Before a recording that begins then: what was heard later, or then, is what is known, however it came to be.
    pub fn begin(&mut self, t_ns: i64) {
        self.heard_ns = self.heard_ns.filter(|heard_ns| *heard_ns < t_ns);
    }

    /// When it was heard last, ns.
    pub fn heard_ns(&self) -> Option<i64> {
        self.heard_ns
    }

    /// When all its channels turned out to be others than those that were remembered, ns.
    pub fn swapped_ns(&self) -> Option<i64> {
        self.swapped_ns
    }

    /// Channels that are followed.
    pub fn channels(&self) -> usize {
        self.channels.len()
    }

    pub fn knows(&self, channel: u32) -> bool {
        self.channels.contains_key(&channel)
    }

    /// Looks that [`Head::shot`] rests on.
    pub fn looks_within(&self) -> f64 {
        self.within.looks
    }

    /// Takes in the next sweep, and learns from it unless it shows another head.
    pub fn sweep(&mut self, t_ns: i64, looks: &[Look]) -> SweepOutcome {
        let before = self.covariance;
        let paused = self.walk(t_ns);
        if paused && self.is_swapped(looks) {
            self.channels.clear();
            self.swapped_ns.get_or_insert(t_ns);
        }
        let members: Vec<Member> = looks.iter().map(|look| self.member(look, paused)).collect();
        let found = self.find(looks, &members, paused);
        let Some(explained) = found else { return SweepOutcome::Unknown };
        if !matches!(explained.by, Move::Strange) {
            self.learn(t_ns, looks, &explained);
            self.watch(looks);
            let sd =
                self.kind.canonical.covariance_from(&self.covariance).diagonal().map(f64::sqrt);
            return match explained.alike >= self.least_alike() {
                true => SweepOutcome::Level { level: self.level(), sd },
                false => SweepOutcome::Unknown,
            };
        }
        // while another head is heard nothing is learned of where this one went
        self.covariance = before;
        SweepOutcome::Strange { level: self.kind.canonical.from * explained.level }
    }

    /// Time goes on. Whether there was a pause.
    fn walk(&mut self, t_ns: i64) -> bool {
        let dt_ns = self.heard_ns.map_or(i64::MAX, |before| t_ns.saturating_sub(before));
        self.heard_ns = Some(self.heard_ns.map_or(t_ns, |before| before.max(t_ns)));
        let paused = dt_ns > PAUSE_NS;
        let of_look = self.kind.canonical.spread.add_scalar(1.0);
        self.covariance += Matrix4::from_diagonal(&(of_look * process::walk()));
        if paused {
            self.heard.clear();
            self.channels.values_mut().for_each(|of| of.resume(t_ns));
        }
        paused
    }

    /// Whether all channels are rather others than those that were heard before the pause.
    fn is_swapped(&self, looks: &[Look]) -> bool {
        let known = |look: &&Look| self.channels.contains_key(&look.channel);
        let looks: Vec<Look> = looks.iter().filter(known).copied().collect();
        let expected = Expected::new(self.level, &self.covariance, &self.kind.leap, true);
        let Some(expected) = expected.filter(|_| looks.len() >= FEWEST) else { return false };
        let same: Vec<Member> = looks.iter().map(|look| self.member(look, true)).collect();
        let new = Channel::default();
        let other = looks.iter().map(|look| self.member_of(&new, look, false));
        let other: Vec<Member> = other.collect();
        let [same, other] = [same, other].map(|of| explain(&expected, &of).ln_density);
        other + process::swapped().ln() > same
    }

    fn member(&self, look: &Look, paused: bool) -> Member {
        let new = Channel::default();
        let channel = self.channels.get(&look.channel).unwrap_or(&new);
        self.member_of(channel, look, paused)
    }

    fn member_of(&self, channel: &Channel, look: &Look, paused: bool) -> Member {
        let at = self.kind.canonical.to * look.features;
        let is_first = paused || !self.heard.contains(&look.channel);
        let by = Variances {
            noise: self.within.noise(),
            lasting: self.lasting(),
            spread: self.kind.canonical.spread.component_mul(&self.wider),
        };
        Member::new(at, look.drive * look.drive, channel, &by, is_first)
    }

    fn find(&mut self, looks: &[Look], members: &[Member], paused: bool) -> Option<Explained> {
        let few = looks.len() < FEWEST && self.channels.len().max(looks.len()) < FEWEST;
        let expected =
            Expected::new(self.level, &self.covariance, &self.kind.leap, paused && !few)?;
        if few {
            return None;
        }
        let mut of = explain(&expected, members);
        let move_by = of.level - self.level;
        let allowed = (self.covariance + self.kind.leap).try_inverse()?;
        if move_by.dot(&(allowed * move_by)) > NOT_THIS_HEAD {
            of.by = Move::Strange;
        }
        // another head is another one in all of its channels, but for the faulty ones
        let least =
            if of.by == Move::Strange { process::least_alike_anew() } else { self.least_alike() };
        if of.by != Move::Walk && of.alike < least {
            of = explain(&expected.as_it_walks(), members);
            of.by = Move::Walk;
        }
        Some(of)
    }

    /// Share of the looks that must agree with a level, or it is not known. Channels that each lie as far from their own
    /// levels agree closely; where nothing of a channel lasts they only lie among healthy ones, and so do slight faults.
    fn least_alike(&self) -> f64 {
        let lasting = self.lasting_share();
        process::least_alike() * lasting + process::least_alike_anew() * (1.0 - lasting)
    }

    fn learn(&mut self, t_ns: i64, looks: &[Look], of: &Explained) {
        let spread = self.kind.canonical.spread;
        if of.by == Move::Leap {
            self.covariance += self.kind.leap;
        }
        if of.alike >= self.least_alike() {
            self.update(of);
        }
        let uncertain = self.covariance.diagonal();
        let noise = self.within.noise();
        for (look, r) in looks.iter().zip(&of.responsibilities) {
            let at = self.kind.canonical.to * look.features - self.level;
            let precision = look.drive * look.drive;
            let channel = self.channels.entry(look.channel).or_default();
            let own = channel.healthy();
            if own.looks >= 1.0 && r.healthy > 0.5 {
                // whatever channels differ by, a look lies that far off the mean of those before it
                let off = at - own.mean();
                let square = off.map(|d| d * d) - uncertain;
                self.within.learn(square / (1.0 / precision + 1.0 / own.looks), r.healthy);
            }
            let looks = 1.0 / (1.0 / precision + (uncertain.component_div(&noise)).mean());
            channel.learn(t_ns, FromLevel { at, looks }, *r, (&spread, &noise));
            self.heard.insert(look.channel);
        }
    }

    /// Whether channels are still where healthy ones are. What most of a head's channels do is ageing, what one does is a
    /// fault: where one of them lies beyond the bound, it is compared with how far all have moved apart.
    fn watch(&mut self, looks: &[Look]) {
        let (spread, noise) = (self.kind.canonical.spread, self.within.noise());
        let of = |look: &Look| self.channels.get(&look.channel).map(|of| of.moved(&spread, &noise));
        let moved: Vec<_> = looks.iter().filter_map(of).collect();
        let apart: [Apart; RUNGS + 1] = std::array::from_fn(|rung| {
            let known: Vec<Features> = moved.iter().filter_map(|of| of[rung]).collect();
            // how far channels lie from each other was learned from few channels, too
            let is_of_head = rung == RUNGS;
            let is_aged = is_of_head && self.wider.max() > ALIKE;
            let is_asked = is_aged || known.iter().any(|of| of.norm_squared() > BOUNDS[rung]);
            if is_asked { Apart::learn(&known, !is_of_head) } else { Apart::as_known() }
        });
        self.wider += (apart[RUNGS].wider - self.wider) * process::of_sweep();
        for (look, moved) in looks.iter().zip(moved) {
            let Some(channel) = self.channels.get_mut(&look.channel) else { continue };
            let square = |rung: usize| moved[rung].map_or(0.0, |of| apart[rung].square(&of));
            channel.watch(std::array::from_fn(square));
        }
    }

    /// Kalman's update of the level by what the looks say.
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

    /// Covariance of one channel's looks beyond the noise, of features.
    pub fn shot(&self) -> Matrix4<f64> {
        let beyond = self.within.noise().add_scalar(-1.0);
        self.kind.canonical.covariance_from(&Matrix4::from_diagonal(&beyond))
    }

    /// Share of what healthy signals differ by that is their channels' own for good.
    pub fn lasting_share(&self) -> f64 {
        let spread = &self.kind.canonical.spread;
        self.within.lasting(spread).sum() / spread.sum().max(f64::MIN_POSITIVE)
    }

    /// How many times as far its channels lie from each other as those that it was learned from, in the feature in
    /// which that is most.
    pub fn wider(&self) -> f64 {
        self.wider.max().sqrt()
    }

    /// Variances of its channels about its level, canonical.
    fn lasting(&self) -> Features {
        self.within.lasting(&self.kind.canonical.spread).component_mul(&self.wider)
    }

    /// Covariance of a healthy look at the reference drive, noise apart, about a channel's expected level that rests on so
    /// many looks; of features.
    pub fn scatter(&self, looks: f64) -> Matrix4<f64> {
        let (noise, lasting) = (self.within.noise(), self.lasting());
        let (_, of_level) = Sum { looks, sum: [0.0; 4] }.posterior(&lasting, &noise);
        let all = noise.add_scalar(-1.0) + of_level;
        self.kind.canonical.covariance_from(&Matrix4::from_diagonal(&all))
    }

    /// Where channels are expected that were healthy for some looks, or are known to be faulty.
    pub fn own(&self) -> impl Iterator<Item = OwnLevel> {
        let (from, noise) = (self.kind.canonical.from, self.within.noise());
        let lasting = self.lasting();
        self.channels.iter().map(move |(channel, of)| {
            let healthy = of.healthy();
            let at = from * healthy.posterior(&lasting, &noise).0;
            OwnLevel { channel: *channel, looks: healthy.looks, at, off: of.off }
        })
    }
}

/// Squared distances beyond which a channel is compared with what all of its head's did.
const BOUNDS: [f64; RUNGS + 1] = [DRIFTED, DRIFTED, DRIFTED, ODD_ONE];
/// Channels lie from each other as the design says, or so many times as far, squared.
const ALIKE: f64 = 1.01;
