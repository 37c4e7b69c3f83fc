//! All recordings' verdicts, looked at once. In: every recording's episodes, then its verdicts batch by
//! batch. Out: [`Survey`]: per printhead its map, per channel its counts, per channel with an episode
//! its [`Watch`]. Memory grows with printheads and channels, not with bursts.

use super::map::{HeadMap, class, level, ratio};
use super::watch::{DISTANCE, Size, Spell, Watch};
use inkling_core::episodes::Episode;
use inkling_core::fault;
use inkling_core::verdict::{Outcome, Reason, VerdictColumns};
use std::collections::{BTreeMap, HashMap};
use std::ops::Range;
use std::sync::Arc;

/// Printheads that are drawn: those with most episodes, then as they come.
const MOST_MAPS: usize = 24;
/// Channels of a printhead that are told apart.
const MOST_CHANNELS: usize = 1 << 16;
/// Printheads that are told apart.
const MOST_PRINTHEADS: usize = 1 << 12;
/// Signals of a channel from which they tell when it is heard: a scan may come to each of its channels once.
const SEVERAL: u64 = 4;
/// Flagged signals of a channel that are no false alarms where they are most of its signals.
const AGAIN: u64 = 3;

/// Signals of one recording and printhead.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tally {
    pub judged: u64,
    pub flagged: u64,
    /// Rejected, or of a printhead that is not the one that is known.
    pub rejected: u64,
    /// Why what was not judged was not.
    pub reasons: BTreeMap<Reason, u64>,
    /// The lowest and the highest that was judged.
    pub channels: Option<[u32; 2]>,
    /// Of its first and its last signal, judged or not.
    pub from_ns: Option<i64>,
    pub to_ns: Option<i64>,
}

impl Tally {
    pub fn not_judged(&self) -> u64 {
        self.rejected
    }

    /// Of what was not judged: no model fits.
    pub fn mismatched(&self) -> u64 {
        let of = |reason| self.reasons.get(&reason).copied().unwrap_or_default();
        of(Reason::DesignMismatch) + of(Reason::NoModel)
    }

    fn spans(&mut self, t_ns: i64) {
        self.from_ns = Some(self.from_ns.map_or(t_ns, |from| from.min(t_ns)));
        self.to_ns = Some(self.to_ns.map_or(t_ns, |to| to.max(t_ns)));
    }
}

/// One channel over all recordings.
#[derive(Clone, Copy, Debug, Default)]
pub struct ChannelCount {
    pub channel: u32,
    pub judged: u64,
    pub flagged: u64,
    /// In the latest recording that has it.
    last: InRecording,
    /// Its place among the watches of its head.
    watch: Option<usize>,
}

/// One channel in one recording.
#[derive(Clone, Copy, Debug, Default)]
struct InRecording {
    recording: usize,
    /// Of its first and its last signal.
    from_ns: i64,
    to_ns: i64,
    judged: u64,
    flagged: u64,
    rejected: u64,
}

impl ChannelCount {
    /// Whether half of its signals, at least, were judged in the latest recording that has it.
    pub fn is_known_now(&self) -> bool {
        self.last.judged >= self.last.rejected
    }

    /// Whether it is flagged again and again, and no recording has enough of that for an episode.
    pub fn is_doubtful(&self) -> bool {
        let often = self.flagged >= AGAIN && 2 * self.flagged > self.judged;
        let now = self.last.flagged >= 2 && self.last.flagged == self.last.judged;
        !self.is_watched() && (often || now)
    }

    /// Whether it was heard until the end of what its head was heard in. `from_ns`: of the last night.
    pub fn is_heard(&self, from_ns: i64, head: &Head) -> bool {
        let InRecording { recording, to_ns, judged, rejected, .. } = self.last;
        let span = head.tallies.get(&recording).and_then(|of| of.from_ns.zip(of.to_ns));
        let fell_silent = span.is_some_and(|(from, to)| to_ns - from < (to - from) / 2);
        to_ns >= from_ns && !(fell_silent && judged + rejected >= SEVERAL)
    }

    fn look(&mut self, recording: usize, t_ns: i64, is_judged: bool) {
        let is_new = recording != self.last.recording || self.last.judged + self.last.rejected == 0;
        if is_new && t_ns >= self.last.from_ns {
            self.last =
                InRecording { recording, from_ns: t_ns, to_ns: t_ns, ..InRecording::default() };
        }
        if recording == self.last.recording {
            self.last.to_ns = self.last.to_ns.max(t_ns);
            self.last.judged += u64::from(is_judged);
            self.last.rejected += u64::from(!is_judged);
        }
    }

    pub fn is_watched(&self) -> bool {
        self.watch.is_some()
    }
}

#[derive(Clone, Debug, Default)]
pub struct Head {
    pub name: Arc<str>,
    pub channels: Vec<ChannelCount>,
    places: HashMap<u32, usize>,
    pub watches: Vec<Watch>,
    /// `None`: more printheads than are drawn.
    pub map: Option<HeadMap>,
    /// By recording.
    pub tallies: BTreeMap<usize, Tally>,
}

#[derive(Debug, Default)]
pub struct Survey {
    pub heads: Vec<Head>,
    by_name: HashMap<Arc<str>, usize>,
    /// The known ones first, then others as they are met.
    pub categories: Vec<String>,
    /// Rows of printheads and channels beyond what is told apart.
    pub left_out: u64,
    /// Without: counts and stories alone.
    maps: usize,
}

/// Names that a batch's columns index.
#[derive(Clone, Copy, Debug)]
pub struct Names<'a> {
    pub classes: &'a [String],
    pub categories: &'a [String],
}

pub const KNOWN_CATEGORIES: [&str; 4] =
    ["dried_nozzle", "blocked_nozzle", "air_bubble", "empty_channel"];

impl Survey {
    /// `episodes`: of each recording.
    pub fn new(episodes: Vec<Vec<Episode>>, with_maps: bool) -> Survey {
        let mut by_channel: BTreeMap<(Arc<str>, u32), Vec<Spell>> = BTreeMap::new();
        for (recording, episodes) in episodes.into_iter().enumerate() {
            for episode in episodes {
                let key = (episode.printhead.clone(), episode.channel);
                let spell = Spell { recording, episode, looked: Default::default() };
                by_channel.entry(key).or_default().push(spell);
            }
        }
        let mut of_head: BTreeMap<Arc<str>, Vec<(u32, Vec<Spell>)>> = BTreeMap::new();
        for ((head, channel), spells) in by_channel {
            of_head.entry(head).or_default().push((channel, spells));
        }
        let mut of_head: Vec<_> = of_head.into_iter().collect();
        of_head.sort_by_key(|(_, channels)| std::cmp::Reverse(channels.len()));
        let mut survey = Survey {
            categories: KNOWN_CATEGORIES.map(str::to_owned).to_vec(),
            maps: if with_maps { MOST_MAPS } else { 0 },
            ..Survey::default()
        };
        for (name, channels) in of_head {
            let Some(at) = survey.head(&name) else { continue };
            for (channel, spells) in channels {
                let head = &mut survey.heads[at];
                if let Some(place) = head.place(channel, 0) {
                    head.channels[place].watch = Some(head.watches.len());
                    head.watches.push(Watch::new(spells));
                }
            }
        }
        survey
    }

    /// The verdicts of a recording, batch by batch.
    pub fn add(&mut self, recording: usize, c: &VerdictColumns, names: Names) {
        let codes: Vec<u8> = names.categories.iter().map(|name| self.code(name)).collect();
        let heads: Vec<Option<usize>> = c.printheads.iter().map(|name| self.head(name)).collect();
        let mut from = 0;
        while from < c.len() {
            let (head, t_ns) = (c.printhead[from], c.acquired_at_ns[from]);
            let same = |row: &usize| c.printhead[*row] == head && c.acquired_at_ns[*row] == t_ns;
            let to = from + (from..c.len()).take_while(same).count();
            match heads.get(head as usize).copied().flatten() {
                Some(at) => {
                    let head = &mut self.heads[at];
                    self.left_out += head.burst(recording, c, from..to, names.classes, &codes);
                }
                None => self.left_out += (to - from) as u64,
            }
            from = to;
        }
    }

    fn code(&mut self, category: &str) -> u8 {
        let known = self.categories.iter().position(|c| c == category);
        let at = known.unwrap_or_else(|| {
            self.categories.push(category.to_owned());
            self.categories.len() - 1
        });
        class::CATEGORY + (at as u8).min(class::CATEGORIES - 1)
    }

    fn head(&mut self, name: &Arc<str>) -> Option<usize> {
        if let Some(&at) = self.by_name.get(name) {
            return Some(at);
        }
        let at = self.heads.len();
        if at >= MOST_PRINTHEADS {
            return None;
        }
        self.by_name.insert(name.clone(), at);
        self.heads.push(Head {
            name: name.clone(),
            map: (at < self.maps).then(HeadMap::default),
            ..Head::default()
        });
        Some(at)
    }
}

impl Head {
    /// The place of a channel; `guess`: mostly the one after the channel before.
    fn place(&mut self, channel: u32, guess: usize) -> Option<usize> {
        if self.channels.get(guess).is_some_and(|c| c.channel == channel) {
            return Some(guess);
        }
        if let Some(&place) = self.places.get(&channel) {
            return Some(place);
        }
        let place = self.channels.len();
        if place >= MOST_CHANNELS {
            return None;
        }
        self.places.insert(channel, place);
        let last = InRecording { from_ns: i64::MIN, ..InRecording::default() };
        self.channels.push(ChannelCount { channel, last, ..ChannelCount::default() });
        if let Some(map) = &mut self.map {
            map.make_room(place + 1);
        }
        Some(place)
    }

    /// One burst's rows; how many of them are left out.
    fn burst(
        &mut self,
        recording: usize,
        c: &VerdictColumns,
        rows: Range<usize>,
        classes: &[String],
        codes: &[u8],
    ) -> u64 {
        let t_ns = c.acquired_at_ns[rows.start];
        let mut left_out = 0;
        let mut places = Vec::with_capacity(rows.len());
        let mut guess = 0;
        for row in rows.clone() {
            let place = self.place(c.channel[row], guess);
            guess = place.map_or(0, |place| place + 1);
            places.push(place);
        }
        let tally = self.tallies.entry(recording).or_default();
        let mut cells = self.map.as_mut().map(|map| map.row(t_ns));
        for (row, place) in rows.zip(places) {
            let outcome = c.outcome[row];
            let of_head = c.reason[row].is_some_and(Reason::is_of_head);
            let is_judged = outcome != Outcome::Rejected && !of_head;
            let flagged = is_judged && outcome != Outcome::Healthy;
            tally.judged += u64::from(is_judged);
            tally.flagged += u64::from(flagged);
            tally.rejected += u64::from(!is_judged);
            let why = c.reason[row].filter(|_| !is_judged);
            why.into_iter().for_each(|why| *tally.reasons.entry(why).or_default() += 1);
            if !why.is_some_and(Reason::is_of_burst) {
                tally.spans(t_ns); // a burst that is no burst may have any time
            }
            let Some(place) = place else {
                left_out += 1;
                continue;
            };
            if let Some(cells) = &mut cells {
                let (class, ratio) = shown(c, row, codes);
                cells.mark(place, class, ratio);
            }
            if !why.is_some_and(Reason::is_of_burst) {
                self.channels[place].look(recording, t_ns, is_judged);
            }
            if !is_judged {
                continue;
            }
            let channel = c.channel[row];
            let [least, most] = tally.channels.unwrap_or([channel; 2]);
            tally.channels = Some([least.min(channel), most.max(channel)]);
            let count = &mut self.channels[place];
            count.judged += 1;
            count.flagged += u64::from(flagged);
            if count.last.recording == recording {
                count.last.flagged += u64::from(flagged);
            }
            if let Some(watch) = count.watch.and_then(|at| self.watches.get_mut(at)) {
                let sized = sized(c, row, classes).filter(|_| flagged);
                watch.look(recording, t_ns, flagged, c.reason[row], sized);
            }
        }
        left_out
    }
}

/// By its class, if it has one; else by how far it is from healthy: a statistic is the square of a distance.
fn sized<'a>(c: &VerdictColumns, row: usize, classes: &'a [String]) -> Option<Size<'a>> {
    let class = c.candidate[row].and_then(|k| classes.get(usize::from(k)));
    if let Some((class, severity)) = class.zip(c.severity[row]) {
        return Some(Size { quantity: fault::quantity(class), size: severity.into() });
    }
    let over = c.statistic[row].zip(c.threshold[row]).map(|(s, t)| f64::from(s / t).sqrt());
    let is_ring = c.reason[row] != Some(Reason::NoRing);
    over.filter(|_| class.is_none() && is_ring).map(|size| Size { quantity: DISTANCE, size })
}

/// What a row's cell shows.
fn shown(c: &VerdictColumns, row: usize, codes: &[u8]) -> (u8, u8) {
    let named = || c.category[row].and_then(|k| codes.get(usize::from(k))).copied();
    let class = match c.outcome[row] {
        Outcome::Healthy => class::HEALTHY,
        Outcome::Rejected => return (class::REJECTED, ratio::REJECTED),
        Outcome::Undecided => class::FLAGGED,
        Outcome::Faulty => named().unwrap_or(class::FLAGGED),
    };
    let over = c.statistic[row].zip(c.threshold[row]).map(|(s, t)| s / t);
    let ratio = over.filter(|r| !r.is_nan()).map_or(ratio::LOWEST, level);
    (class, ratio)
}
