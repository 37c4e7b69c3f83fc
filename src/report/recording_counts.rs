//! One pass over the verdicts of one recording.
//!
//! In: the episodes of the recording, then its verdicts batch by batch ([`RecordingCounts::add`]). Out: what a report
//! needs of them: counts and a map of each printhead, counts of each channel, and what the bursts of channels with
//! episodes say ([`Watched`]). It does not grow with bursts, and `survey` adds up those of all recordings; so it is
//! kept beside the verdicts (`cli/counts_file.rs`), since the verdicts of a year take hours to read.
//!
//! Episodes come first, because they decide which channels are watched. Then `HeadCounts::burst` looks at each row
//! once. A row counts as judged unless it was rejected, or the head changed or its channel froze, and as flagged if
//! it was judged and not healthy.

use super::counts::{InRecording, MOST_CHANNELS, Places, Tally};
use super::map::{HeadMap, class};
use super::night::whole;
use super::watch::{Flagged, Size, Watched};
use inkling_core::episodes::Episode;
use inkling_core::fault;
use inkling_core::verdict::{Outcome, Reason, VerdictColumns};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

/// Most printheads of a recording that get a map, those with episodes first.
const MOST_MAPS: usize = 96;
/// Most printheads that are counted one by one; rows of further printheads are left out.
pub const MOST_PRINTHEADS: usize = 1 << 12;

/// What a report needs of the verdicts of one recording.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RecordingCounts {
    pub heads: Vec<HeadCounts>,
    /// `KNOWN_CATEGORIES`, then others in the order in which they are met.
    pub categories: Vec<String>,
    /// Number of rows beyond `MOST_PRINTHEADS` and `MOST_CHANNELS`. Nothing else counts them.
    pub left_out: u64,
    /// Into `heads`, while rows are added.
    #[serde(skip)]
    places: Places<Arc<str>>,
}

/// One printhead in one recording.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct HeadCounts {
    pub name: Arc<str>,
    pub tally: Tally,
    pub channels: Vec<InRecording>,
    /// Those of channels with episodes, by channel number.
    pub watched: BTreeMap<u32, Watched>,
    pub map: Option<HeadMap>,
    /// Into `channels`, while rows are added.
    #[serde(skip)]
    places: Places<u32>,
}

/// The names to which the indices in a recording's columns refer.
#[derive(Clone, Copy, Debug)]
pub struct Names<'a> {
    pub classes: &'a [String],
    pub categories: &'a [String],
}

/// The categories of the thesis's fault classes. Those of own classes come after them.
pub const KNOWN_CATEGORIES: [&str; 4] =
    ["dried_nozzle", "blocked_nozzle", "air_bubble", "empty_channel"];

impl RecordingCounts {
    /// The counts of a recording with these episodes, without any verdicts yet.
    pub fn new(episodes: &[Episode]) -> RecordingCounts {
        let mut of_head: BTreeMap<Arc<str>, BTreeMap<u32, Vec<&Episode>>> = BTreeMap::new();
        for episode in episodes {
            let channels = of_head.entry(episode.printhead.clone()).or_default();
            channels.entry(episode.channel).or_default().push(episode);
        }
        let categories = KNOWN_CATEGORIES.map(str::to_owned).to_vec();
        let mut counts = RecordingCounts { categories, ..RecordingCounts::default() };
        for (name, channels) in of_head {
            let Some(at) = counts.head(&name) else { continue };
            let watched = channels.into_iter().map(|(channel, of)| (channel, Watched::new(of)));
            counts.heads[at].watched = watched.collect();
        }
        counts
    }

    /// The time of the first signal, ns since 1970; `None`: there is none.
    pub fn begin_ns(&self) -> Option<i64> {
        self.heads.iter().filter_map(|head| Some(head.tally.span?.0)).min()
    }

    /// Whether any channel is watched. Without one, what flagged rows say is not asked.
    pub fn has_episodes(&self) -> bool {
        self.heads.iter().any(|head| !head.watched.is_empty())
    }

    /// Adds one batch of verdicts.
    pub fn add(&mut self, c: &VerdictColumns, names: Names) {
        let code = |name: &String| code(&mut self.categories, name);
        let codes: Vec<u8> = names.categories.iter().map(code).collect();
        let heads: Vec<Option<usize>> = c.printheads.iter().map(|name| self.head(name)).collect();

        // Rows of one printhead and time follow each other: each such run is one burst.
        let mut from = 0;
        while from < c.len() {
            let (head, t_ns) = (c.printhead[from], c.acquired_at_ns[from]);
            let same = |row: &usize| c.printhead[*row] == head && c.acquired_at_ns[*row] == t_ns;
            let to = from + (from..c.len()).take_while(same).count();
            self.left_out += match heads.get(head as usize).copied().flatten() {
                Some(at) => self.heads[at].burst(c, from..to, names, &codes),
                None => (to - from) as u64,
            };
            from = to;
        }
    }

    /// The index of a printhead, which is added if it is new; `None` if there are too many printheads.
    fn head(&mut self, name: &Arc<str>) -> Option<usize> {
        self.places.of(name, MOST_PRINTHEADS, |at| {
            let map = (at < MOST_MAPS).then(HeadMap::default);
            self.heads.push(HeadCounts { name: name.clone(), map, ..HeadCounts::default() });
        })
    }
}

/// The code of a category on maps, which is added to the list if it is new. Categories beyond the number of colours
/// share the last one.
pub fn code(categories: &mut Vec<String>, category: &str) -> u8 {
    let known = categories.iter().position(|c| c == category);
    let at = known.unwrap_or_else(|| {
        categories.push(category.to_owned());
        categories.len() - 1
    });
    class::CATEGORY + at.min(usize::from(class::CATEGORIES) - 1) as u8
}

impl HeadCounts {
    /// The index of a channel in `channels`, which is added if it is new; `None` if there are too many
    /// channels. `guess`: an index to try first, which saves the look-up.
    fn place(&mut self, channel: u32, guess: usize) -> Option<usize> {
        if self.channels.get(guess).is_some_and(|c| c.channel == channel) {
            return Some(guess);
        }
        let HeadCounts { channels, map, places, .. } = self;
        places.of(&channel, MOST_CHANNELS, |place| {
            channels.push(InRecording { channel, ..InRecording::default() });
            map.iter_mut().for_each(|map| map.make_room(place + 1));
        })
    }

    /// Adds the rows of one burst to the counts, the map and the channels. Returns how many rows are left out,
    /// because there are too many channels.
    fn burst(&mut self, c: &VerdictColumns, rows: Range<usize>, names: Names, codes: &[u8]) -> u64 {
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

        let HeadCounts { tally, channels, watched, .. } = self;
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
            let of_time = !why.is_some_and(Reason::is_of_burst);
            has_time |= of_time;
            channels[place].add(t_ns, of_time, is_judged.then_some(flagged));
            if !is_judged {
                continue;
            }

            // what only judged rows count for
            let channel = c.channel[row];
            let [least, most] = tally.channels.unwrap_or([channel; 2]);
            tally.channels = Some([least.min(channel), most.max(channel)]);
            if let Some(watched) = watched.get_mut(&channel) {
                watched.add_burst(t_ns, flagged.then(|| said(c, row, names)));
            }
        }
        let of_burst = has_time.then_some((t_ns, t_ns));
        tally.span = whole(tally.span.into_iter().chain(of_burst));
        left_out
    }
}

/// What a flagged row says: a category where that is certain; the severity, unless it is of no class; and the distance from
/// healthy, in distances of the threshold, which is the root of statistic / threshold, as a statistic is the
/// square of a distance.
fn said<'a>(c: &VerdictColumns, row: usize, names: Names<'a>) -> Flagged<'a> {
    let class = c.candidate[row].and_then(|k| names.classes.get(usize::from(k)));
    let size = |(class, severity): (&'a String, f32)| Size {
        quantity: fault::quantity(class),
        size: severity.into(),
    };
    let is_named = c.outcome[row] == Outcome::Faulty;
    let is_of_class = is_named || c.reason[row] == Some(Reason::Uncertain);
    let category = c.category[row].and_then(|k| names.categories.get(usize::from(k)));
    let over = c.statistic[row].zip(c.threshold[row]).map(|(s, t)| f64::from(s / t).sqrt());
    let ring = c.resonance_hz[row].zip(c.damping_per_s[row]);
    Flagged {
        ring: ring.map(|(resonance, damping)| [resonance, damping].map(f64::from)),
        category: category.filter(|_| is_named).map(String::as_str),
        size: class.zip(c.severity[row]).filter(|_| is_of_class).map(size),
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
        let mut counts = RecordingCounts::new(&[]);
        counts.add(&columns, NAMELESS);
        let tally = &counts.heads[0].tally;
        assert_eq!((tally.judged, tally.rejected), (MOST_CHANNELS as u64, 0));
        assert_eq!(counts.left_out, 3);
    }
}
