//! Labels: what is known to be true of the channels, over time (`schemas/labels.md`).
//!
//! In: the rows of a labels file, as `inkling-io` has read and checked them. Out: for a channel and
//! a time, the row that says what is true of the channel then, or none. [`RecordedSpans`] tells which rows
//! cover nothing of the recordings.
//!
//! Rows may overlap. The narrower row wins: first the rows that name the printhead, then those for
//! all (`*`); among these a row of a single channel, then ranges, the one of fewer channels first,
//! then all channels; of equally wide rows the later one in the file. The span of time does not
//! matter for the order: a row applies or not.

mod recorded_spans;

pub use recorded_spans::{RecordedSpans, Span};

use crate::fault::{CLASSES, HEALTHY, IGNORE};
use std::collections::HashMap;
use std::fmt;
use std::str::FromStr;

pub const EVERY_PRINTHEAD: &str = "*";

#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize, serde::Deserialize,
)]
pub enum Channels {
    /// All channels, written `*`.
    All,
    One(u32),
    /// From the first to the last, both of them included.
    Range(u32, u32),
}

impl Channels {
    fn bounds(self) -> [u32; 2] {
        match self {
            Channels::All => [0, u32::MAX],
            Channels::One(one) => [one, one],
            Channels::Range(first, last) => [first, last],
        }
    }

    fn covers(self, channel: u32) -> bool {
        let [first, last] = self.bounds();
        (first..=last).contains(&channel)
    }
}

/// From the text of a labels file: `*`, a number, or `first-last`. A range of one channel is that
/// channel; one that falls is an error.
impl FromStr for Channels {
    type Err = ();

    fn from_str(text: &str) -> Result<Channels, ()> {
        if text == "*" {
            return Ok(Channels::All);
        }
        let number = |text: &str| text.trim().parse().map_err(drop);
        match text.split_once('-') {
            None => number(text).map(Channels::One),
            Some((first, last)) => match (number(first)?, number(last)?) {
                (first, last) if first < last => Ok(Channels::Range(first, last)),
                (first, last) if first == last => Ok(Channels::One(first)),
                _ => Err(()),
            },
        }
    }
}

impl fmt::Display for Channels {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Channels::All => f.write_str("*"),
            Channels::One(channel) => write!(f, "{channel}"),
            Channels::Range(first, last) => write!(f, "{first}-{last}"),
        }
    }
}

#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Label {
    /// A printhead's name, or [`EVERY_PRINTHEAD`].
    pub printhead: String,
    pub channel: Channels,
    /// The first ns, since the epoch, to which the row applies; `None`: from the beginning.
    pub from_ns: Option<i64>,
    /// The first ns to which the row no longer applies; `None`: to the end.
    pub to_ns: Option<i64>,
    /// `healthy`, `ignore` or a fault class.
    pub state: String,
    /// Size of the fault, in the unit of its class (`schemas/verdicts.md`); `None`: not known.
    pub severity: Option<f64>,
}

impl Label {
    fn covers(&self, channel: u32, t_ns: i64) -> bool {
        self.channel.covers(channel)
            && self.from_ns.is_none_or(|from| from <= t_ns)
            && self.to_ns.is_none_or(|to| t_ns < to)
    }

    pub fn is_fault(&self) -> bool {
        self.state != HEALTHY && self.state != IGNORE
    }
}

/// Indices of the rows of one printhead's name (or of `*`), the right row first.
#[derive(Clone, Debug, Default)]
struct RowsOfPrinthead {
    /// Rows of a single channel, by the channel, in the order of the file: the later row wins.
    of_channel: HashMap<u32, Vec<usize>>,
    /// Rows of several channels, the narrower first; of equally wide rows the later one first.
    wider: Vec<usize>,
}

/// Labels ready to be asked; in files, the list of their rows.
#[derive(Clone, Debug, Default, serde::Serialize, serde::Deserialize)]
#[serde(from = "Vec<Label>", into = "Vec<Label>")]
pub struct Labels {
    rows: Vec<Label>,
    /// By a name or `*`.
    by_printhead: HashMap<String, RowsOfPrinthead>,
}

impl From<Vec<Label>> for Labels {
    fn from(rows: Vec<Label>) -> Labels {
        Labels::new(rows)
    }
}

impl From<Labels> for Vec<Label> {
    fn from(labels: Labels) -> Vec<Label> {
        labels.rows
    }
}

impl Labels {
    pub fn new(rows: Vec<Label>) -> Labels {
        let mut by_printhead: HashMap<String, RowsOfPrinthead> = HashMap::new();
        for (i, row) in rows.iter().enumerate() {
            let of = by_printhead.entry(row.printhead.clone()).or_default();
            match row.channel {
                Channels::One(channel) => of.of_channel.entry(channel).or_default().push(i),
                Channels::All | Channels::Range(..) => of.wider.push(i),
            }
        }
        for of in by_printhead.values_mut() {
            let narrower = |&i: &usize| {
                let [first, last] = rows[i].channel.bounds();
                (rows[i].channel == Channels::All, last - first, std::cmp::Reverse(i))
            };
            of.wider.sort_by_key(narrower);
        }
        Labels { rows, by_printhead }
    }

    pub fn rows(&self) -> &[Label] {
        &self.rows
    }

    /// The times, ns, at which the row that applies to a channel may change, in order: the begins
    /// and ends of all rows that speak of the channel, and the first and the last time that there is.
    pub fn changes(&self, printhead: &str, channel: u32) -> Vec<i64> {
        let of = [printhead, EVERY_PRINTHEAD].into_iter().filter_map(|p| self.by_printhead.get(p));
        let rows =
            of.flat_map(|of| of.of_channel.get(&channel).into_iter().flatten().chain(&of.wider));
        let rows = rows.map(|&i| &self.rows[i]).filter(|row| row.channel.covers(channel));
        let mut times: Vec<i64> = rows.flat_map(|row| [row.from_ns, row.to_ns]).flatten().collect();
        times.extend([i64::MIN, i64::MAX]);
        times.sort_unstable();
        times.dedup();
        times
    }

    /// The row that says what is true of a channel at a time; `None`: unknown, or to be ignored.
    pub fn at(&self, printhead: &str, channel: u32, t_ns: i64) -> Option<&Label> {
        self.row_at(printhead, channel, t_ns).filter(|row| row.state != IGNORE)
    }

    /// The row that applies to a channel at a time, `ignore` included; `None`: no row does.
    pub fn row_at(&self, printhead: &str, channel: u32, t_ns: i64) -> Option<&Label> {
        [printhead, EVERY_PRINTHEAD].iter().find_map(|name| {
            let of = self.by_printhead.get(*name)?;
            // the channel's own rows, the later ones first, then the wider rows
            let own = of.of_channel.get(&channel).into_iter().flat_map(|rows| rows.iter().rev());
            let mut rows = own.chain(&of.wider).map(|&i| &self.rows[i]);
            rows.find(|row| row.covers(channel, t_ns))
        })
    }
}

pub fn known_states() -> impl Iterator<Item = &'static str> {
    [HEALTHY, IGNORE].into_iter().chain(CLASSES)
}

/// The names that a mistyped word was probably meant to be, the likeliest first.
pub fn nearest<'a>(word: &str, names: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    /// Least similarity (1 less the normalised Damerau-Levenshtein distance) of a misspelling.
    const LEAST_ALIKE: f64 = 0.5;
    const MOST_NAMED: usize = 3;
    let word = word.to_lowercase();
    let alike = |name: &str| strsim::normalized_damerau_levenshtein(&word, &name.to_lowercase());
    let mut near: Vec<(f64, &str)> = names.map(|name| (alike(name), name)).collect();
    near.retain(|(alike, _)| *alike >= LEAST_ALIKE);
    near.sort_by(|a, b| b.0.total_cmp(&a.0));
    near.into_iter().map(|(_, name)| name).take(MOST_NAMED).collect()
}
