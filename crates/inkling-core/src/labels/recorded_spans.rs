//! Finds labels that cover nothing of the recordings that were read, and tells which of these are
//! mistakes: a printhead's name that is misspelt, a time in seconds where nanoseconds are due.
//!
//! In, from whoever reads recordings with labels: printhead, time and channels of every burst; then
//! the labels. Out: sentences: an error ([`RecordedSpans::mistake`], where a row was surely meant
//! otherwise), or a warning ([`RecordedSpans::unused`]).
//!
//! Of each printhead only the span of all its times and channels is kept. So a row that lies in a
//! gap between two recordings counts as covering some signals.

use super::{EVERY_PRINTHEAD, Label, Labels, nearest};
use chrono::{DateTime, SecondsFormat};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// Largest number of printheads that are remembered, and of those that a sentence names.
const MOST_HEADS: usize = 1 << 16;
const MOST_NAMED: usize = 6;
/// Times at which recordings are made: 1990 to 2100, as ns since 1970.
const OF_THIS_AGE: std::ops::Range<i64> = 631_152_000_000_000_000..4_102_444_800_000_000_000;

#[derive(Clone, Debug, Default)]
pub struct RecordedSpans {
    heads: BTreeMap<Arc<str>, Span>,
}

/// Where and when the signals of a printhead or burst were; t_a, ns since the epoch. All included.
#[derive(Clone, Copy, Debug)]
pub struct Span {
    pub from_ns: i64,
    pub to_ns: i64,
    pub first_channel: u32,
    pub last_channel: u32,
}

/// A time of a label that is implausible in ns, but would be of `OF_THIS_AGE` in another unit.
struct OtherUnit {
    /// The number as it was read, taken for ns.
    number: i64,
    unit: &'static str,
    /// Number of zeros to append to get ns.
    zeros: usize,
    meant_ns: i64,
}

impl RecordedSpans {
    pub fn see(&mut self, printhead: &str, span: Span) {
        if let Some(known) = self.heads.get_mut(printhead) {
            known.from_ns = known.from_ns.min(span.from_ns);
            known.to_ns = known.to_ns.max(span.to_ns);
            known.first_channel = known.first_channel.min(span.first_channel);
            known.last_channel = known.last_channel.max(span.last_channel);
        } else if self.heads.len() < MOST_HEADS {
            self.heads.insert(printhead.into(), span);
        }
    }

    pub fn printheads(&self) -> Vec<&str> {
        self.heads.keys().map(|name| &**name).collect()
    }

    /// What somebody mistyped: a misspelt printhead, else a time in another unit.
    pub fn mistake(&self, labels: &Labels) -> Option<String> {
        self.misspelt(labels).or_else(|| self.of_other_unit(labels))
    }

    /// How many rows cover none of the signals, and which of their printheads were not met.
    pub fn unused(&self, labels: &Labels) -> Option<String> {
        let rows = labels.rows();
        let unused: Vec<&Label> = rows.iter().filter(|row| !self.covers_any(row)).collect();
        let strange: BTreeSet<&str> =
            unused.iter().map(|row| &*row.printhead).filter(|name| !self.knows(name)).collect();
        let mut others = String::new();
        if !strange.is_empty() {
            let more = if strange.len() > MOST_NAMED { " and others" } else { "" };
            let named: Vec<&str> = strange.into_iter().take(MOST_NAMED).collect();
            others = format!("; of {}{more} there is nothing in them", named.join(", "));
        }
        let (none, all) = (unused.len(), rows.len());
        let first = unused.first()?;
        let which = match first.channel.bounds() {
            [0, u32::MAX] => "all channels".to_owned(),
            [from, to] if from == to => format!("channel {from}"),
            [from, to] => format!("channels {from}-{to}"),
        };
        let which = format!("the first: {}, {which}, {}", first.printhead, first.state);
        Some(format!("{none} of {all} rows cover no signal of these recordings ({which}){others}"))
    }

    fn knows(&self, printhead: &str) -> bool {
        printhead == EVERY_PRINTHEAD || self.heads.contains_key(printhead)
    }

    fn covers_any(&self, row: &Label) -> bool {
        let mut of = self.heads.iter();
        of.any(|(name, span)| [name, EVERY_PRINTHEAD].contains(&&*row.printhead) && span.meets(row))
    }

    /// A sentence about the first name in the labels that no printhead has, if it is like one that
    /// no row names: so labels for several sets of recordings are no mistake.
    fn misspelt(&self, labels: &Labels) -> Option<String> {
        let named: BTreeSet<&str> = labels.rows().iter().map(|row| &*row.printhead).collect();
        let unnamed = || self.heads.keys().map(|name| &**name).filter(|name| !named.contains(name));
        let strange = named.iter().filter(|name| !self.knows(name));
        // Names that differ in digits alone, such as black-1 and black-2, are two printheads.
        let letters = |name: &str| name.replace(|c: char| c.is_ascii_digit(), "");
        let meant = |name: &&str| {
            let near = nearest(name, unnamed()).into_iter();
            let mut meant = near.filter(|near| letters(near) != letters(name));
            Some((name.to_string(), meant.next()?.to_owned()))
        };
        let (name, meant) = strange.filter_map(meant).next()?;
        let there: Vec<&str> = self.heads.keys().map(|name| &**name).take(MOST_NAMED).collect();
        Some(format!(
            "printhead \"{name}\" is in none of the recordings: did you mean {meant}? They hold {}",
            there.join(", ")
        ))
    }

    fn of_other_unit(&self, labels: &Labels) -> Option<String> {
        let is_of_this_age = |span: &Span| OF_THIS_AGE.contains(&span.from_ns);
        if self.heads.is_empty() || !self.heads.values().all(is_of_this_age) {
            return None; // a clock that counts from its own start
        }
        let bounds = labels.rows().iter().flat_map(|row| [row.from_ns, row.to_ns]).flatten();
        let OtherUnit { number, unit, zeros, meant_ns } = bounds.filter_map(other_unit).next()?;
        let clock =
            |ns| DateTime::from_timestamp_nanos(ns).to_rfc3339_opts(SecondsFormat::AutoSi, true);
        Some(format!(
            "time {number} is {}, as whole numbers are nanoseconds; were {unit} meant? Write {} ({number} and {zeros} zeros)",
            clock(number),
            clock(meant_ns)
        ))
    }
}

impl Span {
    /// Whether a row covers some time and channel of the span. Its printhead is not looked at.
    fn meets(&self, row: &Label) -> bool {
        let [first, last] = row.channel.bounds();
        row.from_ns.is_none_or(|from| from <= self.to_ns)
            && row.to_ns.is_none_or(|to| to > self.from_ns)
            && first <= self.last_channel
            && last >= self.first_channel
    }
}

/// The unit in which a number would be a time of `OF_THIS_AGE`, unless it is one in ns.
fn other_unit(number: i64) -> Option<OtherUnit> {
    let units = [("seconds", 9), ("milliseconds", 6), ("microseconds", 3)];
    units.into_iter().find_map(|(unit, zeros)| {
        let meant_ns = number.checked_mul(10_i64.pow(zeros as u32))?;
        OF_THIS_AGE.contains(&meant_ns).then_some(OtherUnit { number, unit, zeros, meant_ns })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOW_NS: i64 = 1_760_000_000_000_000_000;

    fn met(heads: &[&str], from_ns: i64) -> RecordedSpans {
        let mut met = RecordedSpans::default();
        let span =
            Span { from_ns, to_ns: from_ns + 1_000_000_000, first_channel: 0, last_channel: 7 };
        heads.iter().for_each(|name| met.see(name, span));
        met
    }

    fn labels(rows: &[(&str, &str, Option<i64>)]) -> Labels {
        let row = |(printhead, channel, from_ns): &(&str, &str, Option<i64>)| Label {
            printhead: (*printhead).into(),
            channel: channel.parse().unwrap(),
            from_ns: *from_ns,
            to_ns: None,
            state: "healthy".into(),
            severity: None,
        };
        Labels::new(rows.iter().map(row).collect())
    }

    #[test]
    fn a_misspelt_printhead_is_told_and_another_one_is_none() {
        let met = met(&["cyan-1", "black-2"], NOW_NS);
        let told = met.mistake(&labels(&[("cyan1", "*", None), ("black-2", "*", None)])).unwrap();
        assert!(told.contains("\"cyan1\"") && told.contains("did you mean cyan-1?"), "{told}");
        // its neighbour of another number, one of another name, and one that is named as well
        for other in ["cyan-2", "magenta", "*"] {
            assert_eq!(met.mistake(&labels(&[(other, "*", None)])), None, "{other}");
        }
        assert_eq!(met.mistake(&labels(&[("cyan1", "*", None), ("cyan-1", "*", None)])), None);
    }

    #[test]
    fn times_in_another_unit_are_told_unless_the_recording_counts_from_its_own_start() {
        for (said, unit) in
            [(NOW_NS / 1_000_000_000, "seconds"), (NOW_NS / 1_000_000, "milliseconds")]
        {
            let rows = labels(&[("*", "*", Some(said))]);
            let told = met(&["a"], NOW_NS).mistake(&rows).unwrap();
            assert!(told.contains(unit) && told.contains("2025-10-09T08:53:20Z"), "{told}");
            assert_eq!(met(&["a"], 1_000_000_000).mistake(&rows), None);
        }
        assert_eq!(met(&["a"], NOW_NS).mistake(&labels(&[("*", "*", Some(NOW_NS))])), None);
    }
}
