//! Decides where below the directory of results the files of a recording go.
//!
//! In, from `src/cli` (`plan.rs`): the recordings that a command line means, and a
//! [`Layout`]. Out: for each a [`PlacedRecording`] with the path of its verdict table; all other
//! results lie beside that table ([`super::stored::beside`]). No two recordings may get the same
//! place ([`refuse_shared`]).

use super::Limits;
use super::dialect::Dialects;
use super::inputs::{Input, InputsError};
use super::journal::Source;
use super::objects::in_object_store;
use super::recording::Recording;
use super::stored::{DAY, HIVE};
use chrono::DateTime;
use inkling_core::burst::Acquisition;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::path::{Component, Path, PathBuf};

/// Rows that are decoded at a time in search of the first burst.
const MOST_ROWS: usize = 32_768;

/// How results are laid out in directories (setting `output.layout`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Layout {
    /// If a directory or a pattern was named, the path of a recording below it is kept.
    #[default]
    Tree,
    /// A directory for each day (UTC), by the recording's first burst, such as `2026-11-01`.
    Date,
    /// All recordings' results side by side.
    Flat,
    /// Each kind of table has a directory of its own, with a directory for each day such as `day=2026-11-01`.
    /// So `verdicts/` is one data set for tools that know this layout.
    Hive,
}

impl Layout {
    /// Whether the time of the recording's first burst decides on the place.
    pub fn is_by_day(self) -> bool {
        matches!(self, Layout::Date | Layout::Hive)
    }
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PlacedRecording {
    pub input: Input,
    /// As the journal names it; `plan` stamps it.
    pub source: Source,
    /// Path of the verdict table below the directory of results, with `/` between its parts.
    pub verdicts: String,
    pub printheads: Vec<String>,
}

impl PlacedRecording {
    pub fn new(layout: Layout, input: Input, day: impl FnOnce(&str) -> String) -> PlacedRecording {
        let absolute = || match in_object_store(&input.path) {
            true => input.path.clone(),
            false => std::path::absolute(&input.path).unwrap_or_else(|_| input.path.clone()),
        };
        let source = input.path.canonicalize().unwrap_or_else(|_| absolute());
        let source_path = source.to_string_lossy().into_owned();
        let day = layout.is_by_day().then(|| day(&source_path));
        let stem = input.path.file_stem().unwrap_or_default().to_string_lossy();
        let file = format!("{stem}.verdicts.parquet");
        let below = match (layout, &day) {
            (Layout::Tree, _) => input.below.clone(),
            (Layout::Date, Some(day)) => day.into(),
            (Layout::Hive, Some(day)) => Path::new(HIVE).join(format!("{DAY}{day}")),
            _ => PathBuf::new(),
        };
        let parts = below.components().filter_map(|part| match part {
            Component::Normal(part) => Some(part.to_string_lossy().into_owned()),
            _ => None,
        });
        let verdicts = parts.chain([file]).collect::<Vec<_>>().join("/");
        let source = Source { path: source_path, day, ..Source::default() };
        PlacedRecording { input, source, verdicts, printheads: Vec::new() }
    }

    /// What people call the recording: its path below the directory that was named.
    pub fn label(&self) -> String {
        let name = self.input.path.file_name().unwrap_or_default();
        self.input.below.join(name).to_string_lossy().into_owned()
    }

    pub fn verdicts_in(&self, out: &Path) -> PathBuf {
        self.verdicts.split('/').fold(out.to_path_buf(), |path, part| path.join(part))
    }
}

/// Refuses two recordings of one run with the same verdict table; those of earlier runs are up to `resume`.
pub fn refuse_shared(placed: &[PlacedRecording]) -> Result<(), InputsError> {
    let mut taken: HashMap<&str, &PlacedRecording> = HashMap::new();
    for this in placed {
        if let Some(first) = taken.insert(&this.verdicts, this) {
            let [first, second] = [first, this].map(|placed| placed.input.path.display());
            let message = format!(
                "{first} and {second} would both be written to {}: name the directory above both, \
                 whose tree is then kept (--layout tree), lay them out by day (--layout date), or \
                 rename one",
                this.verdicts
            );
            return Err(InputsError::failed(second, message));
        }
    }
    Ok(())
}

/// The day of a recording without a burst that could be dated.
pub const UNDATED: &str = "undated";

/// The day (UTC) of the first usable burst in the file, such as `2026-11-01`.
pub fn day_of(path: &Path, dialects: &Dialects) -> Option<String> {
    let recording = Recording::open_with(path, Limits::default(), dialects).ok()?;
    let first = DateTime::from_timestamp_nanos(first_burst_ns(&recording)?);
    Some(first.format("%Y-%m-%d").to_string())
}

/// The time of the first usable burst in the order of the file, ns since 1970.
fn first_burst_ns(recording: &Recording) -> Option<i64> {
    let mut reader = recording.reader();
    for block in recording.blocks().filter_map(Result::ok) {
        reader.load(&block);
        while let Some(piece) = reader.next_piece(MOST_ROWS) {
            let usable = piece.acquisitions.iter().find_map(|acquisition| match acquisition {
                Acquisition::Usable(burst) => Some(burst.t_acq_ns),
                Acquisition::Unusable(_) => None,
            });
            if usable.is_some() {
                return usable;
            }
        }
    }
    None
}
