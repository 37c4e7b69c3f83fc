//! Decides in which directory below that of results the files of a recording lie.
//!
//! In, from `job.rs`: a recording that was named, and its day. Out: the directory
//! ([`Layout::directory`]). A recording's day is that of its first burst ([`day_of`]).

use super::Limits;
use super::dialect::Dialects;
use super::inputs::Input;
use super::recording::Recording;
use super::stored::{DAY, HIVE};
use chrono::DateTime;
use inkling_core::burst::Acquisition;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

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

    /// The directory below that of results. `day`: given if the layout is by day.
    pub fn directory(self, input: &Input, day: Option<&str>) -> PathBuf {
        match (self, day) {
            (Layout::Tree, _) => input.below.clone(),
            (Layout::Date, Some(day)) => day.into(),
            (Layout::Hive, Some(day)) => Path::new(HIVE).join(format!("{DAY}{day}")),
            _ => PathBuf::new(),
        }
    }
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
