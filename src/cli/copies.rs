//! Verdicts of one recording that are met more than once: a report and a score count them once.

use crate::io::verdict_reader::VerdictReader;
use crate::verdict::VerdictColumns;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Recordings that were met. One is there already if its digest is, or if it holds the same signals: the
/// same channels at the same times, as another file of the same bursts has them.
#[derive(Default)]
pub struct Copies {
    digests: BTreeMap<String, PathBuf>,
    /// By how many signals they hold, and the first of them: what may be the same.
    alike: BTreeMap<(u64, First), Vec<PathBuf>>,
}

/// A table's first signal: when, which printhead, which channel.
type First = (i64, Arc<str>, u32);

impl Copies {
    /// What to say of a table that is left out, because its recording was met before; `document`: its metadata.
    pub fn left_out(&mut self, document: &serde_json::Value, path: &Path) -> Option<String> {
        let first = self.before(document, path)?;
        let (file, first) = (path.display(), first.display());
        Some(format!("{file}: verdicts of a recording that is there already ({first}): left out"))
    }

    /// The file that holds it already.
    fn before(&mut self, document: &serde_json::Value, path: &Path) -> Option<PathBuf> {
        if let Some(digest) = document["recording"]["digest"].as_str() {
            if let Some(first) = self.digests.get(digest) {
                return Some(first.clone());
            }
            self.digests.insert(digest.to_owned(), path.to_owned());
        }
        let signals = document["counts"]["signals"].as_u64()?;
        let alike = self.alike.entry((signals, first_signal(path)?)).or_default();
        let same = alike.iter().find(|other| holds_the_same(other, path)).cloned();
        if same.is_none() {
            alike.push(path.to_owned());
        }
        same
    }
}

/// What tells a signal from others, and what no table is read without.
const OF_A_SIGNAL: [&str; 4] = ["acquired_at", "printhead", "channel", "outcome"];

fn first_signal(path: &Path) -> Option<First> {
    let mut reader = VerdictReader::open_columns(path, &OF_A_SIGNAL).ok()?;
    let c = reader.next()?.ok()?;
    let printhead = c.printheads.get(*c.printhead.first()? as usize)?;
    Some((*c.acquired_at_ns.first()?, printhead.clone(), *c.channel.first()?))
}

/// Whether two tables are of the same signals, whatever is said of them. What cannot be read is not: it is
/// told where it is read.
fn holds_the_same(a: &Path, b: &Path) -> bool {
    let open = |path| VerdictReader::open_columns(path, &OF_A_SIGNAL);
    let (Ok(mut a), Ok(mut b)) = (open(a), open(b)) else { return false };
    loop {
        let (a, b) = match (a.next(), b.next()) {
            (None, None) => return true,
            (Some(Ok(a)), Some(Ok(b))) => (a, b),
            _ => return false,
        };
        let heads = |c: &VerdictColumns| -> Vec<Arc<str>> {
            c.printhead.iter().map(|k| c.printheads[*k as usize].clone()).collect()
        };
        let same = a.acquired_at_ns == b.acquired_at_ns && a.channel == b.channel;
        if !same || heads(&a) != heads(&b) {
            return false; // mostly in the first batch
        }
    }
}
