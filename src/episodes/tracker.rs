//! All channels of a recording: bursts in, episodes out.

use super::classes::ClassFilter;
use super::evidence::{Evidence, FIRST_IN_MEDIANS, Step, TOGETHER};
use super::explanation::{self, Instead, Rings};
use super::intermittent::Flags;
use super::order::Waiting;
use super::{Counts, Episode, EpisodeSettings, Looks, Named, Over, Untimely};
use crate::fault::Class;
use crate::model::faults::{self, Catalogue};
use crate::verdict::{Appearance, Reason};
use std::cmp::Ordering;
use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

/// Channels that are remembered, over all printheads.
const MOST_CHANNELS: usize = 1 << 20;
/// Printheads that are remembered.
const MOST_PRINTHEADS: usize = 1 << 16;
/// Signals that wait for earlier ones, over all printheads.
const MOST_WAITING: usize = 1 << 22;

/// What is said of an episode and in which words, the same for all channels.
#[derive(Debug)]
struct Naming {
    classes: Vec<Class>,
    priors: Vec<f64>,
    /// Of each class the first that is sized by the same quantity.
    quantities: Vec<usize>,
    /// Least weight of a named class, or category.
    certainty: f64,
}

/// Follows every channel. Episodes leave as they end, in an order that depends on the recording only.
#[derive(Debug)]
pub struct Tracker {
    naming: Naming,
    bound: f32,
    reorder_signals: usize,
    printheads: HashMap<Arc<str>, Printhead>,
    channels: usize,
    waiting: usize,
    told: Told,
}

/// What comes out.
#[derive(Debug, Default)]
struct Told {
    counts: Counts,
    ended: Vec<Episode>,
    /// As they were when the evidence sufficed; `None`: nobody asks.
    raised: Option<Vec<Episode>>,
}

/// What the looks of a burst share.
#[derive(Clone, Copy)]
struct Shared<'a> {
    looks: &'a Looks,
    bound: f32,
    naming: &'a Naming,
}

#[derive(Debug)]
struct Printhead {
    name: Arc<str>,
    waiting: Waiting,
    states: Vec<Channel>,
    place: HashMap<u32, usize>,
    /// Of all channels that nothing was raised of.
    flags: Flags,
    untimely: Untimely,
}

#[derive(Debug)]
struct Channel {
    number: u32,
    /// Of its last look.
    last_ns: i64,
    last_ratio: f32,
    /// Judged looks since the onset.
    looks: u64,
    onset_ns: i64,
    /// Judged it last; `None`: none did.
    model: Option<u16>,
    in_medians: f32,
    /// Whether its own baseline judged it last.
    own: bool,
    evidence: Evidence,
    found: Option<Box<Found>>,
    /// Looks since it was met, or since its last episode.
    heard: u64,
    seldom: Option<Box<Seldom>>,
}

/// What is known of a channel's flagged looks, whether in a row or not.
#[derive(Clone, Debug)]
struct Seldom {
    flagged: u64,
    /// The first of them, ns, and the looks before it.
    since_ns: i64,
    before: u64,
    found: Found,
}

/// What is known of an episode, or of what may become one.
#[derive(Clone, Debug)]
struct Found {
    raised_at_ns: i64,
    /// The first of the looks that fit the return to healthy, and the looks before it.
    fading: Option<(i64, u64)>,
    /// Of a fault that comes and goes, the share of looks that it was flagged in.
    share: Option<f64>,
    classes: ClassFilter,
    named: u64,
    fits_none: u64,
    /// Of the last signal that fits none.
    appearance: Option<Appearance>,
    rings: Option<Rings>,
    ring_looks: f64,
    /// Resonance, Hz, and damping, 1/s, of the last signal that has them.
    resonance: Option<(f32, f32)>,
    /// The name by which it was told last: category and class.
    told_as: (Option<String>, Option<String>),
    /// How often signals had no name, by why.
    reasons: BTreeMap<Reason, u64>,
    /// By the quantity that was sized: the class's category, or its own.
    sizes: Vec<Option<Sizes>>,
}

#[derive(Clone, Copy, Debug)]
struct Sizes {
    first: f32,
    max: f32,
    last: f32,
    sd: Option<f32>,
}

impl Tracker {
    /// `classes` in the order of the weights, `priors` of them (what these lack to 1 is that of no class), `certainty`: least weight of what is
    /// named.
    pub fn new(
        classes: &[Class],
        priors: &[f64],
        certainty: f64,
        settings: &EpisodeSettings,
    ) -> Tracker {
        Tracker {
            naming: Naming {
                classes: classes.to_vec(),
                priors: priors.to_vec(),
                quantities: quantities(classes),
                certainty,
            },
            bound: settings.evidence_bound() as f32,
            reorder_signals: settings.reorder_signals,
            printheads: HashMap::new(),
            channels: 0,
            waiting: 0,
            told: Told::default(),
        }
    }

    /// The same for who wants to hear of episodes as soon as they are raised: no burst waits for earlier ones,
    /// which then are left out.
    pub fn at_once(self) -> Tracker {
        let told = Told { raised: Some(Vec::new()), ..self.told };
        Tracker { reorder_signals: 0, told, ..self }
    }

    /// One burst of a printhead, in the recording's order.
    pub fn push(&mut self, printhead: &Arc<str>, looks: Looks) {
        if !self.printheads.contains_key(printhead) {
            if self.printheads.len() >= MOST_PRINTHEADS {
                self.told.counts.signals_beyond_limit += looks.ratios.len() as u64;
                return;
            }
            self.printheads.insert(printhead.clone(), Printhead::new(printhead.clone()));
        }
        let Some(of) = self.printheads.get_mut(printhead) else { return };
        self.waiting += looks.ratios.len();
        of.waiting.push(looks);
        while of.waiting.signals() > self.reorder_signals || self.waiting > MOST_WAITING {
            let Some(looks) = of.waiting.pop() else { break };
            self.waiting -= looks.ratios.len();
            let shared = Shared { looks: &looks, bound: self.bound, naming: &self.naming };
            of.look(shared, &mut self.channels, &mut self.told);
        }
    }

    /// What has ended since it was asked last.
    pub fn take_ended(&mut self) -> Vec<Episode> {
        std::mem::take(&mut self.told.ended)
    }

    /// What was raised, or named otherwise, since it was asked last, as it was then; only [`Tracker::at_once`].
    pub fn take_raised(&mut self) -> Vec<Episode> {
        self.told.raised.as_mut().map(std::mem::take).unwrap_or_default()
    }

    /// The recording is over.
    pub fn finish(mut self) -> Over {
        let mut printheads: Vec<Printhead> = self.printheads.drain().map(|(_, p)| p).collect();
        printheads.sort_by(|a, b| a.name.cmp(&b.name));
        for of in &mut printheads {
            while let Some(looks) = of.waiting.pop() {
                let shared = Shared { looks: &looks, bound: self.bound, naming: &self.naming };
                of.look(shared, &mut self.channels, &mut self.told);
            }
        }
        for of in &mut printheads {
            of.states.sort_by_key(|channel| channel.number);
            for channel in &mut of.states {
                let Some(found) = channel.found.take().filter(|_| channel.evidence.is_raised())
                else {
                    continue;
                };
                self.told.counts.still_on += 1;
                self.told.counts.episodes += 1;
                self.told.ended.push(self.naming.episode(&of.name, channel, &found, None));
            }
        }
        let untimely = printheads.into_iter().map(|of| of.untimely);
        let untimely = untimely.filter(|of| of.at_one_time + of.too_late > 0).collect();
        Over { last: self.told.ended, counts: self.told.counts, untimely }
    }
}

impl Printhead {
    fn new(name: Arc<str>) -> Printhead {
        let untimely = Untimely { printhead: name.clone(), ..Untimely::default() };
        Printhead {
            name,
            waiting: Waiting::default(),
            states: Vec::new(),
            place: HashMap::new(),
            flags: Flags::default(),
            untimely,
        }
    }

    /// Where a channel's state is; a new one while there is room. `near`: where it probably is.
    fn place_of(&mut self, number: u32, near: usize, room: &mut usize) -> Option<usize> {
        if self.states.get(near).is_some_and(|state| state.number == number) {
            return Some(near);
        }
        if let Some(&place) = self.place.get(&number) {
            return Some(place);
        }
        if *room >= MOST_CHANNELS {
            return None;
        }
        *room += 1;
        self.place.insert(number, self.states.len());
        self.states.push(Channel {
            number,
            last_ns: i64::MIN,
            last_ratio: f32::NAN,
            looks: 0,
            onset_ns: 0,
            model: None,
            in_medians: FIRST_IN_MEDIANS,
            own: false,
            evidence: Evidence::default(),
            found: None,
            heard: 0,
            seldom: None,
        });
        Some(self.states.len() - 1)
    }

    /// Some channels from `row` on, whose states begin at `near`: those of which nothing is named and none of which is
    /// raised before or after. Which they are; `None`: the states are not theirs, and nothing was done.
    fn look_at_quiet(
        &mut self,
        looks: &Looks,
        row: u32,
        near: usize,
        named: &[Named],
        bound: f32,
    ) -> Option<[bool; TOGETHER]> {
        let ratios = looks.ratios.get(row as usize..)?.first_chunk::<TOGETHER>()?;
        let states = self.states.get_mut(near..)?.first_chunk_mut::<TOGETHER>()?;
        let first = looks.first_channel.saturating_add(row);
        let mut among = [true; TOGETHER];
        for (((i, state), ratio), among) in (0u32..).zip(&*states).zip(ratios).zip(&mut among) {
            if state.number != first.saturating_add(i) {
                return None;
            }
            *among = (state.last_ns < looks.t_ns)
                & (state.model == Some(looks.model))
                & (state.own == looks.judged_by_own(row + i))
                & !state.evidence.is_raised()
                & !ratio.is_nan();
        }
        for named in named.iter().take_while(|named| named.row < row + TOGETHER as u32) {
            among[(named.row - row) as usize] = false;
        }
        let evidence = states.each_mut().map(|state| &mut state.evidence);
        let (done, begin) = Evidence::look_at_quiet(evidence, among, ratios, bound);
        // as `Channel::look` of `Step::Quiet` and `Step::Suspect`
        for (((state, ratio), done), begins) in states.iter_mut().zip(ratios).zip(done).zip(begin) {
            if !done {
                continue;
            }
            (state.last_ns, state.last_ratio) = (looks.t_ns, *ratio);
            (state.looks, state.heard) = (state.looks + 1, state.heard + 1);
            self.flags.looks += 1;
            if begins {
                (state.onset_ns, state.looks) = (looks.t_ns, 1);
            }
            if state.found.is_some() && (begins || state.evidence.is_quiet()) {
                state.found = None;
            }
        }
        Some(done)
    }

    /// One burst, the next in time.
    fn look(&mut self, of: Shared, room: &mut usize, told: &mut Told) {
        let Shared { looks, bound, .. } = of;
        let rows = looks.ratios.len() as u32; // a burst has few
        self.untimely.signals += looks.ratios.iter().filter(|ratio| !ratio.is_nan()).count() as u64;
        let mut named = looks.named.as_slice();
        let (mut row, mut near) = (0, 0);
        while row < rows {
            let done = self.look_at_quiet(looks, row, near, named, bound).unwrap_or_default();
            let next = row.saturating_add(TOGETHER as u32).min(rows);
            for (row, done) in (row..next).zip(done) {
                if done {
                    near += 1;
                    continue;
                }
                let here = named.first().filter(|first| first.row == row);
                named = &named[usize::from(here.is_some())..];
                near = self.look_alone(of, row, here, near, room, told);
            }
            row = next;
        }
    }

    /// One channel's look. `near`: where its state probably is; returns where the next one's is.
    fn look_alone(
        &mut self,
        of: Shared,
        row: u32,
        named: Option<&Named>,
        near: usize,
        room: &mut usize,
        told: &mut Told,
    ) -> usize {
        let Shared { looks, bound, naming } = of;
        let (ratio, counts) = (looks.ratios[row as usize], &mut told.counts);
        let number = looks.first_channel.saturating_add(row);
        if ratio.is_nan() {
            let is_its = self.states.get(near).is_some_and(|state| state.number == number);
            return near + usize::from(is_its);
        }
        let Some(place) = self.place_of(number, near, room) else {
            counts.signals_beyond_limit += 1;
            return near;
        };
        let channel = &mut self.states[place];
        if !channel.is_next(looks.t_ns, ratio, counts, &mut self.untimely) {
            return place + 1;
        }
        channel.judge_by(looks, looks.judged_by_own(row));
        if !channel.evidence.is_raised() {
            self.flags.looks += 1;
            self.flags.flagged += u64::from(ratio > 1.0);
        }
        if let Some(over) = channel.look(looks.t_ns, ratio, named, (bound, &self.flags), naming) {
            counts.episodes += 1;
            let end = over.fading.map(|(t_ns, _)| t_ns);
            told.ended.push(naming.episode(&self.name, channel, &over, end));
        }
        if let Some(raised) = &mut told.raised {
            raised.extend(channel.news(&self.name, looks.t_ns, named.is_some(), naming));
        }
        place + 1
    }
}

impl Channel {
    /// Its episode, if it was raised with the look at hand, or that look names it otherwise than it was told.
    fn news(
        &mut self,
        printhead: &Arc<str>,
        t_ns: i64,
        is_named: bool,
        naming: &Naming,
    ) -> Option<Episode> {
        let found = self.found.as_ref().filter(|_| self.evidence.is_raised())?;
        let is_new = found.raised_at_ns == t_ns;
        if !is_new && !is_named {
            return None;
        }
        let now = naming.episode(printhead, self, found, None);
        let told_as = (now.category.clone(), now.fault.clone());
        // what is no longer certain is no other name
        let is_other = told_as.0.is_some() && told_as != found.told_as;
        if !is_new && !is_other {
            return None;
        }
        self.found.as_mut()?.told_as = told_as;
        Some(now)
    }

    /// Whether a look is later than all before; if not, it is counted as what it is.
    fn is_next(
        &mut self,
        t_ns: i64,
        ratio: f32,
        counts: &mut Counts,
        untimely: &mut Untimely,
    ) -> bool {
        let order = t_ns.cmp(&self.last_ns);
        match order {
            Ordering::Less => {
                counts.signals_too_late += 1;
                untimely.too_late += 1;
            }
            // the same look again
            Ordering::Equal if ratio.to_bits() == self.last_ratio.to_bits() => {
                counts.signals_repeated += 1;
            }
            Ordering::Equal => {
                counts.signals_at_one_time += 1;
                (untimely.at_one_time, untimely.t_ns) = (untimely.at_one_time + 1, t_ns);
            }
            Ordering::Greater => (self.last_ns, self.last_ratio) = (t_ns, ratio),
        }
        order.is_gt()
    }

    /// By what it is judged from here on.
    fn judge_by(&mut self, looks: &Looks, own: bool) {
        if self.model != Some(looks.model) {
            self.change_model(looks, own);
        }
        if self.own != own {
            self.own = own;
            self.evidence.judge_by_own(own);
        }
    }

    fn change_model(&mut self, looks: &Looks, own: bool) {
        let next = if looks.in_medians > 0.0 { looks.in_medians } else { self.in_medians };
        // a baseline of its own has a threshold of its own
        let lower = if own { 1.0 } else { self.in_medians / next };
        self.evidence.change_model(lower);
        (self.model, self.in_medians) = (Some(looks.model), next);
    }

    /// The next look; what has ended with it.
    fn look(
        &mut self,
        t_ns: i64,
        ratio: f32,
        named: Option<&Named>,
        (bound, of_all): (f32, &Flags),
        naming: &Naming,
    ) -> Option<Box<Found>> {
        let was_raised = self.evidence.is_raised();
        // a healthy channel that always reads high is flagged now and then, and never far from where it reads
        let stands_out = ratio > 1.0 && self.evidence.stands_out(ratio);
        let step = self.evidence.look(ratio, bound);
        self.looks += 1;
        self.heard += 1;
        if was_raised || step == Step::Raised {
            (self.heard, self.seldom) = (0, None);
        } else if stands_out && self.is_seldom(t_ns, named, (bound, of_all), naming) {
            return None;
        }
        match step {
            Step::Quiet => {
                self.found = None;
                return None;
            }
            Step::Suspect { begins: true } => {
                (self.onset_ns, self.looks, self.found) = (t_ns, 1, None);
            }
            Step::Suspect { begins: false } => {}
            Step::Raised => self.found(naming).raised_at_ns = t_ns,
            Step::Faulty { fading: true } => {
                let before = self.looks - 1;
                self.found(naming).fading.get_or_insert((t_ns, before));
            }
            Step::Faulty { fading: false } => self.found(naming).fading = None,
            Step::Ended => {
                let before = self.looks - 1;
                let mut over = self.found.take()?;
                over.fading.get_or_insert((t_ns, before));
                return Some(over);
            }
        }
        if let Some(named) = named {
            self.found(naming).name(named, naming);
        }
        None
    }

    /// One more flagged look; whether they are too many by now for false alarms. Then a fault that comes and goes is raised.
    fn is_seldom(
        &mut self,
        t_ns: i64,
        named: Option<&Named>,
        (bound, of_all): (f32, &Flags),
        naming: &Naming,
    ) -> bool {
        let before = self.heard - 1;
        let seldom = self.seldom.get_or_insert_with(|| {
            let found = Found::new(naming);
            Box::new(Seldom { flagged: 0, since_ns: t_ns, before, found })
        });
        seldom.flagged += 1;
        named.iter().for_each(|named| seldom.found.name(named, naming));
        let flags = Flags { looks: self.heard, flagged: seldom.flagged };
        if flags.evidence(*of_all) < f64::from(bound) {
            return false;
        }
        let Some(seldom) = self.seldom.take() else { return false };
        self.evidence.raise_intermittent(flags.share() as f32);
        (self.onset_ns, self.looks) = (seldom.since_ns, self.heard - seldom.before);
        self.heard = 0;
        let share = Some(seldom.flagged as f64 / self.looks as f64);
        self.found = Some(Box::new(Found { raised_at_ns: t_ns, share, ..seldom.found }));
        true
    }

    fn found(&mut self, naming: &Naming) -> &mut Found {
        self.found.get_or_insert_with(|| Box::new(Found::new(naming)))
    }
}

impl Found {
    fn new(naming: &Naming) -> Found {
        Found {
            raised_at_ns: 0,
            fading: None,
            share: None,
            classes: ClassFilter::new(&naming.priors),
            named: 0,
            fits_none: 0,
            appearance: None,
            rings: None,
            ring_looks: 0.0,
            resonance: None,
            told_as: (None, None),
            reasons: BTreeMap::new(),
            sizes: Vec::new(),
        }
    }

    fn name(&mut self, named: &Named, naming: &Naming) {
        self.resonance = named.resonance.or(self.resonance);
        named.reason.iter().for_each(|reason| *self.reasons.entry(*reason).or_default() += 1);
        if let Some(ring) = &named.ring {
            // a running mean over about ten looks: a fault may grow
            self.ring_looks = (self.ring_looks + 1.0).min(10.0);
            let share = 1.0 / self.ring_looks;
            let f = ring.healthy_frequency_hz * ring.ln_frequency.exp();
            let damping = ring.healthy_damping_per_s * ring.ln_damping.exp();
            let of = self.rings.get_or_insert(Rings {
                frequency_hz: f,
                damping_per_s: damping,
                healthy_frequency_hz: ring.healthy_frequency_hz,
                healthy_damping_per_s: ring.healthy_damping_per_s,
            });
            of.frequency_hz += share * (f - of.frequency_hz);
            of.damping_per_s += share * (damping - of.damping_per_s);
            of.healthy_frequency_hz = ring.healthy_frequency_hz;
            of.healthy_damping_per_s = ring.healthy_damping_per_s;
        }
        if named.weights.is_empty() && !named.fits_none() {
            return;
        }
        self.appearance = named.appearance.clone().or(self.appearance.take());
        self.named += 1;
        self.fits_none += u64::from(named.fits_none());
        self.classes.look(&named.weights, &naming.priors);
        if let (Some(class), Some(size)) = (named.candidate, named.severity)
            && size.is_finite()
        {
            let Some(&quantity) = naming.quantities.get(usize::from(class)) else { return };
            self.sizes.resize(naming.classes.len(), None);
            let Some(of) = self.sizes.get_mut(quantity) else { return };
            let known = of.get_or_insert(Sizes { first: size, max: size, last: size, sd: None });
            known.max = known.max.max(size);
            (known.last, known.sd) = (size, named.severity_sd);
        }
    }
}

impl Found {
    /// Why most of its signals have no name. `fits_none`: the most of all are of no known class.
    fn commonest_reason(&self, fits_none: bool) -> Reason {
        let is_asked =
            |reason: &Reason| !fits_none || matches!(reason, Reason::UnknownFault | Reason::NoRing);
        let asked = self.reasons.iter().filter(|(reason, _)| is_asked(reason));
        asked.max_by_key(|(_, n)| **n).map_or(Reason::Uncertain, |(reason, _)| *reason)
    }
}

/// [`Naming::quantities`]
fn quantities(classes: &[Class]) -> Vec<usize> {
    let laws = Catalogue::default();
    let of = |class: &Class| laws.one_kind(&class.of).and_then(faults::law);
    let first_like = |(number, class): (usize, &Class)| {
        let alike = |own: &faults::Law| {
            classes.iter().position(|other| of(other).is_some_and(|law| law.is_kind_of(own)))
        };
        of(class).and_then(alike).unwrap_or(number)
    };
    classes.iter().enumerate().map(first_like).collect()
}

impl Naming {
    /// The sums over categories, in order of first appearance.
    fn categories(&self, weights: &[f64]) -> Vec<(&str, f64)> {
        let mut sums: Vec<(&str, f64)> = Vec::new();
        for (class, weight) in self.classes.iter().zip(weights) {
            let category = class.category.as_str();
            match sums.iter_mut().find(|(name, _)| *name == category) {
                Some((_, sum)) => *sum += weight,
                None => sums.push((category, *weight)),
            }
        }
        sums
    }

    fn episode(
        &self,
        printhead: &Arc<str>,
        channel: &Channel,
        found: &Found,
        ended_at_ns: Option<i64>,
    ) -> Episode {
        let largest = |weights: &mut dyn Iterator<Item = f64>| -> Option<(usize, f64)> {
            weights.enumerate().reduce(|best, next| if next.1 > best.1 { next } else { best })
        };
        let weights = found.classes.weights();
        let fits_none = found.named > 0 && found.classes.none() > 0.5;
        let named = found.named > found.fits_none;
        let best = largest(&mut weights.iter().copied()).filter(|_| named);
        let categories = self.categories(weights);
        let category = largest(&mut categories.iter().map(|c| c.1));
        let (mut fault, mut named_category, mut certainty) = (None, None, best.map(|b| b.1));
        if let (Some((class, weight)), false) = (best, fits_none) {
            if weight >= self.certainty {
                let name = &self.classes[class].name;
                fault = Some(name.clone());
                named_category = Some(self.classes[class].category.clone());
            } else if let Some((k, sum)) = category.filter(|(_, sum)| *sum >= self.certainty) {
                named_category = Some(categories[k].0.to_owned());
                certainty = Some(sum);
            }
        }
        let sizes = best.and_then(|(class, _)| *found.sizes.get(self.quantities[class])?);
        // looks that fit the return to healthy are not the fault's, unless it stayed
        let bursts = match (ended_at_ns, found.fading) {
            (Some(_), Some((_, before))) => before,
            _ => channel.looks,
        };
        let mut episode = Episode {
            recording: Arc::default(),
            printhead: printhead.clone(),
            channel: channel.number,
            category: named_category,
            fault,
            raised_at_ns: found.raised_at_ns,
            began_at_ns: channel.onset_ns,
            ended_at_ns,
            bursts,
            certainty,
            severity_first: sizes.map(|s| f64::from(s.first)),
            severity_max: sizes.map(|s| f64::from(s.max)),
            severity_last: sizes.map(|s| f64::from(s.last)),
            severity_sd: sizes.and_then(|s| s.sd).map(f64::from),
            resonance_hz: found.resonance.map(|(f, _)| f.into()),
            damping_per_s: found.resonance.map(|(_, damping)| damping.into()),
            reason: None,
            explanation: String::new(),
        };
        episode.reason = match episode.category {
            Some(_) => None,
            None => Some(found.commonest_reason(fits_none)),
        };
        let nearest = best.map(|(class, weight)| (&self.classes[class], weight));
        let is_twin =
            best.is_some_and(|(_, weight)| found.classes.none() >= Appearance::AS_WELL * weight);
        let instead = match (&found.appearance, fits_none) {
            (appearance, true) => {
                Instead::Rather(appearance.as_ref().unwrap_or(&Appearance::Other))
            }
            (Some(appearance), false) if is_twin => Instead::AsWell(appearance),
            _ => Instead::Nothing,
        };
        episode.explanation =
            explanation::sentence(&episode, found.rings.as_ref(), nearest, instead);
        if let Some(share) = found.share.filter(|share| *share < 0.5) {
            episode.explanation += &explanation::comes_and_goes(share);
        }
        episode
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::episodes::RingChange;
    use rand::{RngExt, SeedableRng};

    fn tracker(reorder_signals: usize) -> Tracker {
        let classes = ["BN", "PBN", "SDN"].map(Class::plain);
        let settings = EpisodeSettings { reorder_signals, ..EpisodeSettings::default() };
        Tracker::new(&classes, &[0.28; 3], 0.8, &settings)
    }

    /// Bursts of four channels, one per second; channel 7 is partly blocked from 50 to 80.
    fn bursts() -> Vec<Looks> {
        let burst = |step: i64| {
            let faulty = (50..80).contains(&step);
            let wiggle = |row: i64| 0.15 + 0.02 * ((step * 7 + row * 3) % 5) as f32;
            let mut ratios: Vec<f32> = (0..4).map(wiggle).collect();
            let mut named = Vec::new();
            if faulty {
                ratios[2] = 10.0;
                named.push(Named {
                    row: 2,
                    weights: vec![0.3, 0.69, 0.01],
                    candidate: Some(1),
                    severity: Some(0.2 + 0.001 * (step - 50) as f32),
                    severity_sd: Some(0.01),
                    ring: Some(RingChange {
                        ln_frequency: 0.95f64.ln(),
                        ln_damping: 1.3f64.ln(),
                        healthy_frequency_hz: 64.7e3,
                        healthy_damping_per_s: 2.9e4,
                    }),
                    ..Named::default()
                });
            }
            Looks {
                t_ns: step * 1_000_000_000,
                first_channel: 5,
                ratios,
                named,
                ..Looks::default()
            }
        };
        (0..140).map(burst).collect()
    }

    fn run(
        mut tracker: Tracker,
        bursts: impl IntoIterator<Item = Looks>,
    ) -> (Vec<Episode>, Counts) {
        let name: Arc<str> = "p".into();
        bursts.into_iter().for_each(|looks| tracker.push(&name, looks));
        let mut episodes = tracker.take_ended();
        let over = tracker.finish();
        episodes.extend(over.last);
        (episodes, over.counts)
    }

    #[test]
    fn fault_is_one_episode_with_onset_end_class_and_sentence() {
        let (episodes, counts) = run(tracker(8), bursts());
        assert_eq!((episodes.len(), counts.episodes, counts.still_on), (1, 1, 0));
        let e = &episodes[0];
        assert_eq!((e.channel, e.began_at_ns / 1_000_000_000), (7, 50));
        assert!((51..54).contains(&(e.raised_at_ns / 1_000_000_000)), "{e:?}");
        assert_eq!(e.ended_at_ns.map(|t| t / 1_000_000_000), Some(80));
        assert_eq!(e.bursts, 30);
        assert_eq!(e.fault.as_deref(), Some("PBN"));
        let sizes = [e.severity_first, e.severity_max, e.severity_last].map(|s| s.unwrap() as f32);
        assert_eq!(sizes, [0.2, 0.229, 0.229]);
        assert!(
            e.explanation
                .starts_with("channel 7: resonance 64.7 → 61.5 kHz, damping +30 %: partly")
        );
    }

    #[test]
    fn another_statistic_that_reads_higher_is_no_fault() {
        // from 20 on their own baselines judge
        let mut bursts: Vec<Looks> = bursts().into_iter().take(50).collect();
        for (step, burst) in bursts.iter_mut().enumerate() {
            match step {
                0..20 => burst.ratios.iter_mut().for_each(|r| *r *= 0.1),
                _ => burst.own = vec![true; 4],
            }
        }
        assert_eq!(run(tracker(8), bursts).1.episodes, 0);
    }

    #[test]
    fn order_within_the_window_and_repeats_do_not_matter() {
        let sorted = run(tracker(1000), bursts());
        let mut shuffled = bursts();
        for chunk in shuffled.chunks_mut(9) {
            chunk.reverse();
        }
        assert_eq!(run(tracker(1000), shuffled), sorted);
        let twice = bursts().into_iter().flat_map(|b| [b.clone(), b]);
        let (episodes, counts) = run(tracker(1000), twice);
        assert_eq!((episodes, counts.signals_repeated), (sorted.0.clone(), 4 * 140));
        // one channel per burst
        let apart = bursts().into_iter().flat_map(|b| {
            (0..4u32).map(move |row| Looks {
                t_ns: b.t_ns,
                first_channel: b.first_channel + row,
                model: b.model,
                in_medians: b.in_medians,
                ratios: vec![b.ratios[row as usize]],
                named: b
                    .named
                    .iter()
                    .filter(|n| n.row == row)
                    .map(|n| Named { row: 0, ..n.clone() })
                    .collect(),
                ..Looks::default()
            })
        });
        assert_eq!(run(tracker(1000), apart), sorted);
    }

    #[test]
    fn what_comes_too_late_is_counted_and_changes_nothing() {
        let sorted = run(tracker(8), bursts());
        let mut late = bursts();
        let first = late.remove(3);
        late.push(first);
        let (episodes, counts) = run(tracker(8), late);
        assert_eq!(episodes, sorted.0);
        assert_eq!(counts.signals_too_late, 4);
    }

    /// A recording in which everything happens: channels come and go, models and baselines change, bursts come
    /// twice or late, signals are rejected, some are faulty for a while.
    fn eventful(seed: u64) -> Vec<Looks> {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let mut bursts: Vec<Looks> = Vec::new();
        for step in 0..300i64 {
            let first_channel = if rng.random_bool(0.1) { 3 } else { 0 };
            let healthy = |rng: &mut rand_chacha::ChaCha8Rng| rng.random::<f32>().powi(4) * 1.05;
            let mut ratios: Vec<f32> = (0..37).map(|_| healthy(&mut rng)).collect();
            let mut named = Vec::new();
            for (row, ratio) in ratios.iter_mut().enumerate() {
                let (row, channel) = (row as u32, first_channel + row as u32);
                let from = i64::from(channel) * 13 % 240;
                if channel.is_multiple_of(5) && (from..from + 40).contains(&step) {
                    *ratio = rng.random_range(2.0..9.0);
                }
                if rng.random_bool(0.01) {
                    *ratio = f32::NAN;
                } else if *ratio > 1.0 {
                    named.push(Named { row, weights: vec![0.2, 0.7, 0.1], ..Named::default() });
                }
            }
            let own = (0..37)
                .map(|row| row % 3 == 0 && step > 150 || (60..120).contains(&step))
                .collect();
            let model = (step / 90) as u16;
            let in_medians = [7.0, 56.0, 3.5, 28.0][usize::from(model)];
            let t_ns = step * 1_000_000_000;
            bursts.push(Looks { t_ns, first_channel, model, in_medians, ratios, own, named });
            if rng.random_bool(0.05) {
                let before = rng.random_range(0..bursts.len());
                bursts.push(bursts[before].clone());
            }
        }
        bursts
    }

    /// One burst for each of its channels.
    fn apart(looks: &Looks) -> Vec<Looks> {
        let own = |row| looks.own.get(row).copied().into_iter().collect();
        let of_row = |row: usize| Looks {
            first_channel: looks.first_channel + row as u32,
            ratios: vec![looks.ratios[row]],
            own: own(row),
            named: (looks.named.iter().filter(|n| n.row == row as u32))
                .map(|n| Named { row: 0, ..n.clone() })
                .collect(),
            ..looks.clone()
        };
        (0..looks.ratios.len()).map(of_row).collect()
    }

    #[test]
    fn channels_that_are_looked_at_together_are_judged_as_if_each_came_alone() {
        let sorted = |(mut episodes, counts): (Vec<Episode>, Counts)| {
            episodes.sort_by_key(|e| (e.channel, e.began_at_ns));
            (episodes, counts)
        };
        for seed in 0..8 {
            // nothing waits, so that what comes late is late
            let together = sorted(run(tracker(0), eventful(seed)));
            let alone = sorted(run(tracker(0), eventful(seed).iter().flat_map(apart)));
            assert_eq!(together, alone, "seed {seed}");
            let (episodes, counts) = together;
            assert!(episodes.len() >= 7, "{}", episodes.len());
            assert!(counts.signals_repeated + counts.signals_too_late > 100, "{counts:?}");
        }
    }

    #[test]
    fn another_threshold_changes_neither_onset_nor_the_look_that_raises() {
        let one = run(tracker(8), bursts());
        let other = bursts().into_iter().enumerate().map(|(step, mut looks)| {
            let model = u16::from(step >= 30);
            if model == 1 {
                looks.ratios.iter_mut().for_each(|r| *r /= 8.0);
            }
            Looks { model, in_medians: 7.5 * f32::from(1 + 7 * model), ..looks }
        });
        let other = run(tracker(8), other);
        let times = |(episodes, _): &(Vec<Episode>, Counts)| {
            episodes.iter().map(|e| (e.began_at_ns, e.raised_at_ns)).collect::<Vec<_>>()
        };
        assert_eq!((times(&one).len(), times(&one)), (1, times(&other)));
    }

    fn naming() -> Naming {
        tracker(8).naming
    }

    #[test]
    fn a_ring_is_told_by_the_mean_of_about_ten_looks() {
        let naming = naming();
        let printhead: Arc<str> = "p".into();
        let mut of = Printhead::new(printhead);
        of.place_of(0, 0, &mut 0);
        let found = of.states[0].found(&naming);
        let mut look = |of: f64| {
            let ring = RingChange {
                ln_frequency: of.ln(),
                ln_damping: (2.0 * of).ln(),
                healthy_frequency_hz: 60e3,
                healthy_damping_per_s: 3e4,
            };
            found.name(&Named { ring: Some(ring), ..Named::default() }, &naming);
            let Rings { frequency_hz, damping_per_s, .. } = found.rings.expect("a ring");
            assert!((damping_per_s / frequency_hz - 1.0).abs() < 1e-9);
            frequency_hz / 60e3
        };
        assert!((look(0.9) - 0.9).abs() < 1e-9);
        assert!((look(0.8) - 0.85).abs() < 1e-9);
        assert!((look(0.7) - 0.8).abs() < 1e-9, "the mean of three");
        (0..7).for_each(|_| {
            look(0.8);
        });
        assert!((look(0.9) - 0.81).abs() < 1e-9, "a tenth of the way");
    }

    #[test]
    fn of_a_category_whose_classes_cannot_be_told_apart_the_category_is_named() {
        assert_eq!(
            naming().categories(&[0.5, 0.25, 0.25]),
            [("blocked_nozzle", 0.75), ("dried_nozzle", 0.25)]
        );
        let looks = bursts().into_iter().map(|mut looks| {
            for named in &mut looks.named {
                named.weights = vec![0.5, 0.49, 0.01];
            }
            looks
        });
        let (episodes, _) = run(tracker(8), looks);
        let e = &episodes[0];
        assert_eq!((e.category.as_deref(), &e.fault), (Some("blocked_nozzle"), &None));
        assert!(e.certainty.is_some_and(|c| c > 0.98), "{e:?}");
    }

    #[test]
    fn what_waits_is_what_is_held_and_no_more_than_it_may_be() {
        let mut tracker = tracker(8);
        let names: [Arc<str>; 2] = ["p".into(), "q".into()];
        for (looks, name) in bursts().into_iter().zip(names.iter().cycle()) {
            tracker.push(name, looks);
            let held: Vec<usize> =
                tracker.printheads.values().map(|of| of.waiting.signals()).collect();
            assert_eq!(tracker.waiting, held.iter().sum::<usize>());
            assert!(held.iter().all(|&held| held <= 8), "{held:?}");
        }
        assert_eq!(tracker.waiting, 16);
    }

    #[test]
    fn printheads_beyond_the_limit_are_counted() {
        let mut tracker = tracker(8);
        for p in 0..=MOST_PRINTHEADS {
            let (ratios, t_ns) = (vec![0.1; 3], 0);
            tracker.push(&p.to_string().into(), Looks { ratios, t_ns, ..Looks::default() });
        }
        assert_eq!(tracker.finish().counts.signals_beyond_limit, 3);
    }

    #[test]
    fn at_once_an_episode_is_told_with_the_burst_that_raises_it() {
        let mut tracker = tracker(1000).at_once();
        let name: Arc<str> = "p".into();
        let mut raised = Vec::new();
        for looks in bursts() {
            let t_ns = looks.t_ns;
            tracker.push(&name, looks);
            for episode in tracker.take_raised() {
                let name = |of: &Episode| (of.category.clone(), of.fault.clone());
                match raised.last() {
                    None => assert_eq!(episode.raised_at_ns, t_ns),
                    Some(before) => assert_ne!(name(before), name(&episode), "named meanwhile"),
                }
                raised.push(episode);
            }
        }
        let (told, whole) = (&raised[0], &run(self::tracker(1000), bursts()).0[0]);
        assert_eq!(raised.last().unwrap().fault, whole.fault, "what it is called at last is told");
        assert_eq!((told.channel, told.raised_at_ns), (whole.channel, whole.raised_at_ns));
        assert_eq!(told.began_at_ns, whole.began_at_ns);
        assert_eq!(told.fault, None, "by then it is not certain, at the end it is");
        assert_eq!(told.ended_at_ns, None);
        assert!(told.bursts < whole.bursts);
    }

    #[test]
    fn still_on_has_no_end_and_rejected_signals_are_no_looks() {
        let mut cut: Vec<Looks> = bursts().into_iter().take(70).collect();
        for looks in &mut cut[55..60] {
            looks.ratios.fill(f32::NAN);
            looks.named.clear();
        }
        let (episodes, counts) = run(tracker(8), cut);
        assert_eq!((episodes.len(), counts.still_on), (1, 1));
        assert_eq!((episodes[0].ended_at_ns, episodes[0].bursts), (None, 15));
    }

    #[test]
    fn without_classes_episodes_are_found_and_not_named() {
        let tracker = Tracker::new(&[], &[], 0.8, &EpisodeSettings::default());
        let unnamed = bursts().into_iter().map(|b| Looks { named: Vec::new(), ..b });
        let (episodes, _) = run(tracker, unnamed);
        assert_eq!(episodes.len(), 1);
        let e = &episodes[0];
        assert_eq!((&e.fault, &e.category, e.certainty), (&None, &None, None));
        assert_eq!(e.explanation, "channel 7: rings unlike a healthy channel: not named");
    }
}
