//! Finds verdict tables of the same recording, so that a report and a score count its verdicts once.
//!
//! In: the tables of a report or score, each with its metadata. Out: which of them are left out
//! ([`left_out`]). Two tables are of the same recording if their metadata have the same digest of
//! the recording. Another file of the same bursts (compressed otherwise, say) has another digest:
//! so tables with the same number of signals and the same first signal are compared row by row.

use inkling_core::verdict::{Outcome, VerdictColumns};
use inkling_io::verdict_reader::{self, VerdictReader};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

#[derive(Clone, Copy)]
pub struct Table<'a> {
    pub path: &'a Path,
    pub document: &'a Value,
}

/// For each table, in their order: `None` if it stays, or the sentence to say if it is left out
/// because another table is of the same recording. Of such tables the one with the most judged
/// signals stays, and of equal ones the first.
pub fn left_out(tables: &[Table]) -> Vec<Option<String>> {
    let mut met = MetRecordings::default();
    // of each table the first one of its recording, and by that one the table that stays
    let first: Vec<usize> =
        (0..tables.len()).map(|at| met.first_of_its_recording(tables, at)).collect();
    let mut stays: BTreeMap<usize, usize> = BTreeMap::new();
    for (at, first) in first.iter().enumerate() {
        let kept = stays.entry(*first).or_insert(at);
        if judged(&tables[at]) > judged(&tables[*kept]) {
            *kept = at;
        }
    }
    let note = |(at, first): (usize, &usize)| {
        let kept = stays[first];
        let (file, kept_file) = (tables[at].path.display(), tables[kept].path.display());
        let what = "verdicts of a recording that is there already";
        (at != kept).then(|| format!("{file}: {what} ({kept_file}): left out"))
    };
    first.iter().enumerate().map(note).collect()
}

fn judged(table: &Table) -> u64 {
    table.document["counts"]["judged"].as_u64().unwrap_or_default()
}

/// Recordings that were met, by the index of their first table. A recording counts as met if its digest was,
/// or if its table holds the same signals, as for another file of the same bursts.
#[derive(Default)]
struct MetRecordings<'a> {
    /// The first table of a recording, by the recording's digest.
    digests: BTreeMap<&'a str, usize>,
    /// Tables by their number of signals and their first signal. Only tables that agree in both are compared
    /// in full.
    alike: BTreeMap<(u64, First), Vec<usize>>,
}

/// A table's first signal: its time, ns, printhead and channel.
type First = (i64, Arc<str>, u32);

impl<'a> MetRecordings<'a> {
    /// The index of the first table of the same recording: `at` itself if the recording was not met before.
    fn first_of_its_recording(&mut self, tables: &[Table<'a>], at: usize) -> usize {
        let Table { path, document } = tables[at];
        let digest = document["recording"]["digest"].as_str();
        if let Some(&first) = digest.and_then(|digest| self.digests.get(digest)) {
            return first;
        }

        // another digest, or none: is there a table with the same signals?
        let signals = document["counts"]["signals"].as_u64();
        let mut first = at;
        if let Some(key) = signals.zip(first_signal(path)) {
            let alike = self.alike.entry(key).or_default();
            match alike.iter().find(|other| holds_the_same(tables[**other].path, path)) {
                Some(same) => first = *same,
                None => alike.push(at),
            }
        }
        // later tables with this digest are of that recording, too
        digest.map(|digest| self.digests.insert(digest, first));
        first
    }
}

/// Keys of the metadata that say by what means a table was made.
const MEANS: [&str; 3] = ["version", "design", "settings"];
/// The columns that identify a signal, and those that hold its result.
const COLUMNS: [&str; 5] = ["acquired_at", "printhead", "channel", "outcome", "statistic"];

/// The first signal of a table; `None` if it is empty or cannot be read.
fn first_signal(path: &Path) -> Option<First> {
    let mut reader = VerdictReader::open_columns(path, &COLUMNS).ok()?;
    let c = reader.next()?.ok()?;
    let printhead = c.printheads.get(*c.printhead.first()? as usize)?;
    Some((*c.acquired_at_ns.first()?, printhead.clone(), *c.channel.first()?))
}

/// Whether two tables hold the same signals: the same channels at the same times, the same of them rejected,
/// and, if the same means judged both, with the same outcomes and statistics. A table that cannot be read is
/// taken for a different one; the error is told where the table is read for the report.
fn holds_the_same(a: &Path, b: &Path) -> bool {
    let [of_a, of_b] = [a, b].map(verdict_reader::document_of);
    let same_means = MEANS.iter().all(|key| of_a[*key] == of_b[*key]);
    let open = |path| VerdictReader::open_columns(path, &COLUMNS);
    let (Ok(mut a), Ok(mut b)) = (open(a), open(b)) else { return false };
    loop {
        let next = (a.next(), b.next());
        let (Some(Ok(a)), Some(Ok(b))) = next else { return matches!(next, (None, None)) };
        // batch by batch; indices of printheads may differ between tables, so names are compared
        let same_signals = a.acquired_at_ns == b.acquired_at_ns
            && a.channel == b.channel
            && heads(&a).eq(heads(&b))
            && rejected(&a).eq(rejected(&b));
        let same_result = || a.outcome == b.outcome && statistics(&a).eq(statistics(&b));
        if !same_signals || same_means && !same_result() {
            return false; // mostly in the first batch
        }
    }
}

fn heads(c: &VerdictColumns) -> impl Iterator<Item = &str> {
    c.printhead.iter().map(|k| &*c.printheads[*k as usize])
}

fn rejected(c: &VerdictColumns) -> impl Iterator<Item = bool> {
    c.outcome.iter().map(|outcome| *outcome == Outcome::Rejected)
}

/// The statistics as bits, so that NaN equals itself.
fn statistics(c: &VerdictColumns) -> impl Iterator<Item = Option<u32>> {
    c.statistic.iter().map(|statistic| statistic.map(f32::to_bits))
}
