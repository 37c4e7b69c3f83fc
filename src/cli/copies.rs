//! Verdicts of one recording that are met more than once: a report and a score count them once.

use inkling_core::verdict::{Outcome, VerdictColumns};
use inkling_io::verdict_reader::{self, VerdictReader};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// A verdict table and its metadata.
#[derive(Clone, Copy)]
pub struct Table<'a> {
    pub path: &'a Path,
    pub document: &'a Value,
}

/// Of each table, in their order: what to say where it is left out, because another one is of the same recording. Of
/// those that of which more was judged stays, else the first.
pub fn left_out(tables: &[Table]) -> Vec<Option<String>> {
    let mut met = MetRecordings::default();
    let mut notes = vec![None; tables.len()];
    // by the first table of a recording: the one that stays
    let mut stays: BTreeMap<usize, usize> = BTreeMap::new();
    for (at, table) in tables.iter().enumerate() {
        let first = met.first_of_its_recording(tables, at);
        let Some(&before) = stays.get(&first) else {
            stays.insert(first, at);
            continue;
        };
        let is_better = judged(table) > judged(&tables[before]);
        let (kept, left) = if is_better { (at, before) } else { (before, at) };
        stays.insert(first, kept);
        let (file, kept) = (tables[left].path.display(), tables[kept].path.display());
        notes[left] = Some(format!(
            "{file}: verdicts of a recording that is there already ({kept}): left out"
        ));
    }
    notes
}

fn judged(table: &Table) -> u64 {
    table.document["counts"]["judged"].as_u64().unwrap_or_default()
}

/// Recordings that were met, by the places of their first tables. One is there already if its digest is, or if it
/// holds the same signals, as another file of the same bursts has them.
#[derive(Default)]
struct MetRecordings<'a> {
    digests: BTreeMap<&'a str, usize>,
    /// By how many signals they hold, and the first of them: what may be the same.
    alike: BTreeMap<(u64, First), Vec<usize>>,
}

/// A table's first signal: when, which printhead, which channel.
type First = (i64, Arc<str>, u32);

impl<'a> MetRecordings<'a> {
    /// Its own place, if its recording was not met before.
    fn first_of_its_recording(&mut self, tables: &[Table<'a>], at: usize) -> usize {
        let Table { path, document } = tables[at];
        let digest = document["recording"]["digest"].as_str();
        if let Some(&first) = digest.and_then(|digest| self.digests.get(digest)) {
            return first;
        }
        let signals = document["counts"]["signals"].as_u64();
        let mut first = at;
        if let Some(key) = signals.zip(first_signal(path)) {
            let alike = self.alike.entry(key).or_default();
            let same = alike.iter().find(|other| holds_the_same(tables[**other].path, path));
            match same {
                Some(same) => first = *same,
                None => alike.push(at),
            }
        }
        digest.map(|digest| self.digests.insert(digest, first));
        first
    }
}

/// By what tables were made, as their metadata say.
const MEANS: [&str; 3] = ["version", "design", "settings"];
/// What tells a signal from others, and what is said of it.
const COLUMNS: [&str; 5] = ["acquired_at", "printhead", "channel", "outcome", "statistic"];

fn first_signal(path: &Path) -> Option<First> {
    let mut reader = VerdictReader::open_columns(path, &COLUMNS).ok()?;
    let c = reader.next()?.ok()?;
    let printhead = c.printheads.get(*c.printhead.first()? as usize)?;
    Some((*c.acquired_at_ns.first()?, printhead.clone(), *c.channel.first()?))
}

/// Whether two tables are of the same signals: the same channels at the same times, of which the same were judged, and
/// with the same result where they were judged by the same means. What cannot be read is not: it is told where it is
/// read.
fn holds_the_same(a: &Path, b: &Path) -> bool {
    let means = |path| {
        let document = verdict_reader::document_of(path);
        MEANS.map(|key| document[key].clone())
    };
    let same_means = means(a) == means(b);
    let open = |path| VerdictReader::open_columns(path, &COLUMNS);
    let (Ok(mut a), Ok(mut b)) = (open(a), open(b)) else { return false };
    loop {
        let (a, b) = match (a.next(), b.next()) {
            (None, None) => return true,
            (Some(Ok(a)), Some(Ok(b))) => (a, b),
            _ => return false,
        };
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

/// Bit by bit: what is no number is the same as itself.
fn statistics(c: &VerdictColumns) -> impl Iterator<Item = Option<u32>> {
    c.statistic.iter().map(|statistic| statistic.map(f32::to_bits))
}
