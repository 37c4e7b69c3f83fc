//! Decides in which directory below that of results the files of a recording lie.
//!
//! In, from `job.rs`: a recording that was named, and its day. Out: the directory
//! ([`Layout::directory`]). A recording's day is that on which it begins ([`day_of`]).

use super::Limits;
use super::dialect::Dialects;
use super::inputs::Input;
use super::recording::Recording;
use super::stored::{DAY, HIVE};
use super::when;
use chrono::DateTime;
use serde::{Deserialize, Serialize};
use std::convert::Infallible;
use std::path::{Path, PathBuf};

/// How results are laid out in directories (setting `output.layout`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Layout {
    /// If a directory or a pattern was named, the path of a recording below it is kept.
    #[default]
    Tree,
    /// A directory for each day (UTC), by when the recording begins, such as `2026-11-01`.
    Date,
    /// Each kind of table has a directory of its own, with a directory for each day such as `day=2026-11-01`.
    /// So `verdicts/` is one data set for tools that know this layout.
    Hive,
}

impl Layout {
    /// Whether the time at which the recording begins decides on the place.
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

/// The day (UTC) on which a recording begins by what most of its bursts say, such as `2026-11-01`.
pub fn day_of(path: &Path, dialects: &Dialects) -> Option<String> {
    let recording = Recording::open_with(path, Limits::default(), dialects).ok()?;
    let Ok(begin) = when::begin(&recording, || Ok::<_, Infallible>(()));
    let first = DateTime::from_timestamp_nanos(begin?.t_ns);
    Some(first.format("%Y-%m-%d").to_string())
}
