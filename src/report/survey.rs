//! The verdicts of all recordings, added up.
//!
//! In: the episodes of every recording (`Survey::new`), then the counts of each ([`Survey::absorb`]), in any order.
//! Out: a `Survey` with a map of each printhead, counts of each printhead in each recording (`Tally`) and of each
//! channel (`ChannelCount`), and a [`Watch`] of each channel that had an episode.
//!
//! The episodes come first, because they decide which channels are watched, and which printheads
//! get a map.

use super::counts::{ChannelCount, MOST_CHANNELS, Places, Tally};
use super::map::{HeadMap, Picture};
use super::recording_counts::{
    HeadCounts, KNOWN_CATEGORIES, MOST_PRINTHEADS, RecordingCounts, code,
};
use super::watch::{Spell, Watch};
use inkling_core::episodes::Episode;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Number of printheads that get a map, those with the most faulty channels first.
const MOST_MAPS: usize = 24;

/// One printhead over all recordings.
#[derive(Clone, Debug, Default)]
pub struct Head {
    pub name: Arc<str>,
    pub channels: Vec<ChannelCount>,
    /// Into `channels`.
    places: Places<u32>,
    pub watches: Vec<Watch>,
    /// The map of the printhead; `None` if it is beyond the number of printheads that are drawn, here or in one of
    /// the recordings.
    pub map: Option<HeadMap>,
    /// Counts by recording.
    pub tallies: BTreeMap<usize, Tally>,
    /// Whether somebody has acknowledged that it was taken out after its last signal.
    pub is_gone: bool,
}

/// What all recordings hold, by printhead and channel.
#[derive(Debug, Default)]
pub struct Survey {
    pub heads: Vec<Head>,
    /// Into `heads`.
    places: Places<Arc<str>>,
    /// `KNOWN_CATEGORIES`, then others in the order in which they are met.
    pub categories: Vec<String>,
    /// Number of signals that are not counted one by one, as they are of too many printheads or channels, by recording.
    /// Nothing else counts them.
    pub left_out: BTreeMap<usize, u64>,
}

impl Survey {
    /// A survey that knows the episodes, by the recording's index, but no counts yet.
    pub fn new(episodes: &[Vec<Episode>]) -> Survey {
        let mut of_head: BTreeMap<Arc<str>, BTreeMap<u32, Vec<Spell>>> = BTreeMap::new();
        for (recording, episodes) in episodes.iter().enumerate() {
            for episode in episodes.iter().cloned() {
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
            ..Survey::default()
        };

        // Each channel with an episode is known from now on, and is watched.
        for (name, channels) in of_head {
            let Some(at) = survey.head(&name) else { continue };
            for (channel, spells) in channels {
                let head = &mut survey.heads[at];
                if let Some(place) = head.place(channel) {
                    head.channels[place].watch = Some(head.watches.len());
                    head.watches.push(Watch::new(spells));
                }
            }
        }
        survey
    }

    /// The printhead of this name.
    pub fn get(&self, name: &Arc<str>) -> Option<&Head> {
        Some(&self.heads[self.places.get(name)?])
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

    /// Adds what the recording with this index holds.
    pub fn absorb(&mut self, recording: usize, counts: RecordingCounts) {
        let RecordingCounts { heads, categories, mut left_out, .. } = counts;
        let code = |name: &String| code(&mut self.categories, name);
        let codes: Vec<u8> = categories.iter().map(code).collect();
        for of_head in heads {
            match self.head(&of_head.name) {
                Some(at) => self.heads[at].absorb(recording, of_head, &codes),
                None => left_out += of_head.tally.signals(),
            }
        }
        if left_out > 0 {
            *self.left_out.entry(recording).or_default() += left_out;
        }
    }

    /// The index of a printhead, which is added if it is new; `None` if there are too many printheads.
    fn head(&mut self, name: &Arc<str>) -> Option<usize> {
        self.places.of(name, MOST_PRINTHEADS, |at| {
            let map = (at < MOST_MAPS).then(HeadMap::default);
            self.heads.push(Head { name: name.clone(), map, ..Head::default() });
        })
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
    /// channels.
    fn place(&mut self, channel: u32) -> Option<usize> {
        let Head { channels, map, places, .. } = self;
        places.of(&channel, MOST_CHANNELS, |place| {
            channels.push(ChannelCount::new(channel));
            map.iter_mut().for_each(|map| map.make_room(place + 1));
        })
    }

    /// Adds what a recording holds of the printhead. `codes`: here, of the recording's categories.
    fn absorb(&mut self, recording: usize, counts: HeadCounts, codes: &[u8]) {
        let HeadCounts { tally, channels, watched, map, .. } = counts;
        let places: Vec<Option<usize>> = channels.iter().map(|of| self.place(of.channel)).collect();
        self.map = self.map.take().zip(map).map(|(mut all, map)| {
            all.absorb(map, |cells| cells.placed(&places, codes));
            all
        });
        if tally != Tally::default() {
            self.tallies.insert(recording, tally);
        }
        for (counts, place) in channels.into_iter().zip(places) {
            let Some(place) = place else { continue };
            let count = &mut self.channels[place];
            match (
                count.watch.and_then(|at| self.watches.get_mut(at)),
                watched.get(&counts.channel),
            ) {
                (Some(watch), Some(watched)) => watch.absorb(recording, watched),
                (Some(watch), None) => watch.absorb_outside(&counts.bursts),
                (None, _) => {}
            }
            count.absorb(recording, counts);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::{NAMELESS, spell, verdicts};
    use super::super::map::class;
    use super::*;
    use inkling_core::verdict::Outcome;

    const NIGHT: i64 = 86_400_000_000_000;

    /// The counts of a night of 200 bursts, the channels of which are in another order each night. Channel 7 is
    /// flagged in the second half of it.
    fn night(number: i64, episodes: &[Episode]) -> RecordingCounts {
        let mut counts = RecordingCounts::new(episodes);
        for t in 0..200 {
            let outcome = |channel: u32| match channel == 7 && t >= 100 {
                true => Outcome::Undecided,
                false => Outcome::Healthy,
            };
            let channels = (0..12).map(|k| (k + 3 * number as u32) % 12);
            let burst = verdicts(
                number * NIGHT + t * 1_000_000_000,
                channels.map(|channel| (channel, outcome(channel))),
            );
            counts.add(&burst, NAMELESS);
        }
        counts
    }

    #[test]
    fn counts_that_were_kept_add_up_to_the_same_in_any_order() {
        let episode = |number: i64| {
            let began_ns = number * NIGHT + 100_000_000_000;
            spell(number as usize, began_ns, None, "dried_nozzle").episode
        };
        // the channel is watched in the second night, too, in which it has no episode
        let of_nights = [vec![episode(0)], Vec::new(), vec![episode(2)]];
        let surveyed = |order: [usize; 3], kept: bool| {
            let mut survey = Survey::new(&of_nights);
            for number in order {
                let mut counts = night(number as i64, &of_nights[number]);
                if kept {
                    let text = serde_json::to_string(&counts).unwrap();
                    counts = serde_json::from_str(&text).unwrap();
                }
                survey.absorb(number, counts);
            }
            survey
        };
        let first = surveyed([0, 1, 2], false);
        let [head] = &first.heads[..] else { panic!("{:?}", first.heads) };
        let watch = &head.watches[0];
        let within: Vec<u64> = watch.spells.iter().map(|of| of.counts.flagged).collect();
        let outside: Vec<_> = watch.outside.iter().map(|of| (of.judged, of.flagged)).collect();
        assert_eq!(within, [100, 100]);
        assert_eq!(outside, [(100, 0), (300, 100), (0, 0)], "the second night lies between them");
        let picture = head.picture().unwrap();
        let column = picture.column_of(7);
        let flagged = |line: usize, at: usize| picture.pixels[line * 12 + at] == class::FLAGGED;
        let night = picture.line_of(NIGHT + 150_000_000_000);
        assert!((0..12).all(|at| flagged(night, at) == (at == column)));

        for (order, kept) in [([0, 1, 2], true), ([2, 0, 1], true), ([1, 2, 0], false)] {
            let survey = surveyed(order, kept);
            let head_of = |survey: &Survey| {
                let head = &survey.heads[0];
                let watch = &head.watches[0];
                let mut channels: Vec<String> =
                    head.channels.iter().map(|of| format!("{of:?}")).collect();
                channels.sort();
                let counts: Vec<_> = watch.spells.iter().map(|of| of.counts.clone()).collect();
                (head.tallies.clone(), channels, counts, watch.outside.clone(), head.picture())
            };
            assert_eq!(format!("{:?}", head_of(&survey)), format!("{:?}", head_of(&first)));
        }
    }
}
