//! One pass over the verdicts of all recordings.
//!
//! In: the episodes of every recording (`Survey::new`), then the verdicts of each, batch by batch
//! (`Survey::add`), in any order of recordings. Out: a `Survey` with a map of each printhead, counts
//! of each printhead in each recording (`Tally`) and of each channel (`ChannelCount`), and a [`Watch`]
//! of each channel that had an episode. Memory does not grow with bursts.
//!
//! The episodes come first, because they decide which channels are watched, and which printheads
//! get a map. Then `Head::burst` looks at each row once. A row counts as judged unless it was
//! rejected, or the head changed or its channel froze, and as flagged if it was judged and not
//! healthy.

use super::counts::{ChannelCount, Tally};
use super::map::{HeadMap, Picture, class};
use super::night::whole;
use super::watch::{Flagged, Size, Spell, Watch};
use inkling_core::episodes::Episode;
use inkling_core::fault;
use inkling_core::verdict::{Outcome, Reason, VerdictColumns};
use std::collections::{BTreeMap, HashMap};
use std::ops::Range;
use std::sync::Arc;

/// Number of printheads that get a map, those with the most faulty channels first.
const MOST_MAPS: usize = 24;
/// Most channels of a printhead that are counted one by one; rows of further channels are left out.
const MOST_CHANNELS: usize = 1 << 16;
/// Most printheads that are counted one by one; rows of further printheads are left out.
const MOST_PRINTHEADS: usize = 1 << 12;
/// One printhead over all recordings.
#[derive(Clone, Debug, Default)]
pub struct Head {
    pub name: Arc<str>,
    pub channels: Vec<ChannelCount>,
    /// Index into `channels`, by channel number.
    pub(super) places: HashMap<u32, usize>,
    pub watches: Vec<Watch>,
    /// The map of the printhead; `None` if it is beyond the number of printheads that are drawn.
    pub map: Option<HeadMap>,
    /// Counts by recording.
    pub tallies: BTreeMap<usize, Tally>,
}

/// What all recordings hold, by printhead and channel.
#[derive(Debug, Default)]
pub struct Survey {
    pub heads: Vec<Head>,
    /// Index into `heads`, by name.
    by_name: HashMap<Arc<str>, usize>,
    /// `KNOWN_CATEGORIES`, then others in the order in which they are met.
    pub categories: Vec<String>,
    /// Number of rows beyond `MOST_PRINTHEADS` and `MOST_CHANNELS`, by recording. Nothing else counts them.
    pub left_out: BTreeMap<usize, u64>,
    /// Number of printheads that get a map; 0 if only counts and stories are wanted.
    maps: usize,
}

/// The names to which the indices in a recording's columns refer.
#[derive(Clone, Copy, Debug)]
pub struct Names<'a> {
    pub classes: &'a [String],
    pub categories: &'a [String],
}

/// The categories of the thesis's fault classes. Those of own classes come after them.
const KNOWN_CATEGORIES: [&str; 4] =
    ["dried_nozzle", "blocked_nozzle", "air_bubble", "empty_channel"];

impl Survey {
    /// A survey that knows the episodes, by the recording's index, but no verdicts yet.
    pub fn new(episodes: Vec<Vec<Episode>>, with_maps: bool) -> Survey {
        let mut of_head: BTreeMap<Arc<str>, BTreeMap<u32, Vec<Spell>>> = BTreeMap::new();
        for (recording, episodes) in episodes.into_iter().enumerate() {
            for episode in episodes {
                let channels = of_head.entry(episode.printhead.clone()).or_default();
                let spells = channels.entry(episode.channel).or_default();
                spells.push(Spell { recording, episode, counts: Default::default() });
            }
        }

        // Printheads with the most faulty channels come first, as only the first ones get a map.
        let mut of_head: Vec<_> = of_head.into_iter().collect();
        of_head.sort_by_key(|(_, channels)| std::cmp::Reverse(channels.len()));
        let mut survey = Survey {
            categories: KNOWN_CATEGORIES.map(str::to_owned).to_vec(),
            maps: if with_maps { MOST_MAPS } else { 0 },
            ..Survey::default()
        };

        // Each channel with an episode is known from now on, and is watched.
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

    /// The printhead of this name.
    pub fn get(&self, name: &Arc<str>) -> Option<&Head> {
        Some(&self.heads[*self.by_name.get(name)?])
    }

    /// All channels of all printheads.
    pub fn channels(&self) -> impl Iterator<Item = &ChannelCount> {
        self.heads.iter().flat_map(|head| &head.channels)
    }

    /// The watches of all channels that had an episode.
    pub fn watches(&self) -> impl Iterator<Item = &Watch> {
        self.heads.iter().flat_map(|head| &head.watches)
    }

    /// The printheads of which a recording holds signals.
    pub fn heads_with_signals(&self) -> impl Iterator<Item = &Head> {
        self.heads.iter().filter(|head| !head.tallies.is_empty())
    }

    /// Adds one batch of the verdicts of the recording with this index.
    pub fn add(&mut self, recording: usize, c: &VerdictColumns, names: Names) {
        let codes: Vec<u8> = names.categories.iter().map(|name| self.code(name)).collect();
        let heads: Vec<Option<usize>> = c.printheads.iter().map(|name| self.head(name)).collect();

        // Rows of one printhead and time follow each other: each such run is one burst.
        let mut from = 0;
        while from < c.len() {
            let (head, t_ns) = (c.printhead[from], c.acquired_at_ns[from]);
            let same = |row: &usize| c.printhead[*row] == head && c.acquired_at_ns[*row] == t_ns;
            let to = from + (from..c.len()).take_while(same).count();
            let left_out = match heads.get(head as usize).copied().flatten() {
                Some(at) => self.heads[at].burst(recording, c, from..to, names, &codes),
                None => (to - from) as u64,
            };
            if left_out > 0 {
                *self.left_out.entry(recording).or_default() += left_out;
            }
            from = to;
        }
    }

    /// The code of a category, which is new or known. Categories beyond the number of colours share the last
    /// one.
    fn code(&mut self, category: &str) -> u8 {
        let known = self.categories.iter().position(|c| c == category);
        let at = known.unwrap_or_else(|| {
            self.categories.push(category.to_owned());
            self.categories.len() - 1
        });
        class::CATEGORY + at.min(usize::from(class::CATEGORIES) - 1) as u8
    }

    /// The index of a printhead, which is added if it is new; `None` if there are too many printheads.
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
    /// The picture of the printhead's map; `None` if it has no map, or an empty one.
    pub fn picture(&self) -> Option<Picture> {
        let channels: Vec<u32> = self.channels.iter().map(|c| c.channel).collect();
        Some(self.map.as_ref()?.picture(&channels)).filter(|of| !of.pixels.is_empty())
    }

    /// How many signals of each channel outside of its episodes were judged, and how many of them flagged.
    pub fn outside(&self) -> impl Iterator<Item = (u64, u64)> {
        let unwatched = self.channels.iter().filter(|channel| !channel.is_watched());
        let watched = self.watches.iter().map(|watch| {
            let outside = watch.outside.iter();
            outside.fold((0, 0), |(n, k), of| (n + of.judged, k + of.flagged))
        });
        unwatched.map(|channel| (channel.judged, channel.flagged)).chain(watched)
    }

    /// The recording with the latest signal of the printhead, and its counts.
    pub fn latest(&self) -> Option<(usize, &Tally)> {
        let last = self.tallies.iter().max_by_key(|(_, of)| of.span.map(|span| span.1));
        last.map(|(recording, tally)| (*recording, tally))
    }

    /// The index of a channel in `channels`, which is added if it is new; `None` if there are too many
    /// channels. `guess`: an index to try first, which saves the look-up.
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
        self.channels.push(ChannelCount::new(channel));
        if let Some(map) = &mut self.map {
            map.make_room(place + 1);
        }
        Some(place)
    }

    /// Adds the rows of one burst to the printhead's counts, map, channels and watches. Returns how many
    /// rows are left out, because there are too many channels.
    fn burst(
        &mut self,
        recording: usize,
        c: &VerdictColumns,
        rows: Range<usize>,
        names: Names,
        codes: &[u8],
    ) -> u64 {
        let t_ns = c.acquired_at_ns[rows.start];
        let (mut left_out, mut has_time) = (0, false);
        // Places come first, because a new channel may coarsen the map that `cells` borrows below.
        let mut guess = 0;
        let place = |channel: &u32| {
            let place = self.place(*channel, guess);
            guess = place.map_or(0, |place| place + 1);
            place
        };
        let places: Vec<Option<usize>> = c.channel[rows.clone()].iter().map(place).collect();

        let tally = self.tallies.entry(recording).or_default();
        let mut cells = self.map.as_mut().map(|map| map.row(t_ns));
        for (row, place) in rows.zip(places) {
            let Some(place) = place else {
                left_out += 1;
                continue;
            };
            let outcome = c.outcome[row];
            // `replay` writes no undecided rows with a reason of the whole printhead; they are not judged
            let of_head = c.reason[row].is_some_and(Reason::is_of_head);
            let is_judged = outcome != Outcome::Rejected && !of_head;
            let flagged = is_judged && outcome != Outcome::Healthy;
            tally.judged += u64::from(is_judged);
            tally.flagged += u64::from(flagged);
            tally.rejected += u64::from(!is_judged);
            let why = c.reason[row].filter(|_| !is_judged);
            why.into_iter().for_each(|why| *tally.reasons.entry(why).or_default() += 1);
            if let Some(cells) = &mut cells {
                cells.mark(place, shown(c, row, codes));
            }
            // an unusable burst may have any time
            if !why.is_some_and(Reason::is_of_burst) {
                has_time = true;
                self.channels[place].count_last(recording, t_ns, is_judged, flagged);
            }
            if !is_judged {
                continue;
            }

            // what only judged rows count for
            let channel = c.channel[row];
            let [least, most] = tally.channels.unwrap_or([channel; 2]);
            tally.channels = Some([least.min(channel), most.max(channel)]);
            let count = &mut self.channels[place];
            count.judged += 1;
            count.flagged += u64::from(flagged);
            if let Some(watch) = count.watch.and_then(|at| self.watches.get_mut(at)) {
                watch.add_burst(recording, t_ns, flagged.then(|| said(c, row, names)));
            }
        }
        let of_burst = has_time.then_some((t_ns, t_ns));
        tally.span = whole(tally.span.into_iter().chain(of_burst));
        left_out
    }
}

/// What a flagged row says: a category where that is certain, and then the severity; and the distance from
/// healthy, in distances of the threshold, which is the root of statistic / threshold, as a statistic is the
/// square of a distance.
fn said<'a>(c: &VerdictColumns, row: usize, names: Names<'a>) -> Flagged<'a> {
    let class = c.candidate[row].and_then(|k| names.classes.get(usize::from(k)));
    let size = |(class, severity): (&'a String, f32)| Size {
        quantity: fault::quantity(class),
        size: severity.into(),
    };
    let is_named = c.outcome[row] == Outcome::Faulty;
    let category = c.category[row].and_then(|k| names.categories.get(usize::from(k)));
    let over = c.statistic[row].zip(c.threshold[row]).map(|(s, t)| f64::from(s / t).sqrt());
    Flagged {
        category: category.filter(|_| is_named).map(String::as_str),
        size: class.zip(c.severity[row]).filter(|_| is_named).map(size),
        distance: over.filter(|_| c.reason[row] != Some(Reason::NoRing)),
    }
}

/// The code of a row on the map.
fn shown(c: &VerdictColumns, row: usize, codes: &[u8]) -> u8 {
    let named = || c.category[row].and_then(|k| codes.get(usize::from(k))).copied();
    match c.outcome[row] {
        Outcome::Healthy => class::HEALTHY,
        Outcome::Rejected => class::REJECTED,
        Outcome::Undecided => class::FLAGGED,
        Outcome::Faulty => named().unwrap_or(class::FLAGGED),
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::{NAMELESS, verdicts};
    use super::*;

    #[test]
    fn rows_of_channels_beyond_the_limit_are_counted_as_left_out_alone() {
        let n = MOST_CHANNELS + 3;
        let columns = verdicts(0, (0..n as u32).map(|channel| (channel, Outcome::Healthy)));
        let mut survey = Survey::new(vec![Vec::new(); 2], false);
        survey.add(1, &columns, NAMELESS);
        let tally = &survey.heads[0].tallies[&1];
        assert_eq!((tally.judged, tally.rejected), (MOST_CHANNELS as u64, 0));
        assert_eq!(survey.left_out, BTreeMap::from([(1, 3)]));
    }
}
