//! Turns recordings into verdicts, in six stages with bounded queues between them.
//!
//! In: an opened recording and how to judge it ([`Replay`]), from `cli`. Out: the tables of verdicts and
//! episodes, the summary, and a [`RecordingReport`]. The entries are `replay`, `judge` and `follow`.
//!
//! ```text
//!            blocks             batches of signals in columns                        rows, in order
//! reader ──▶ (decode) ──▶ identify ──▶ filter ──▶ gate ──▶ isolate ──▶ writer
//!             × threads    which model  × threads          × threads   Parquet + summary.json
//! ```
//!
//! What crosses a queue is a batch of signals: one block of the recording (a chunk, or about 1 MiB of
//! messages), or a piece of it. Batches carry their place in the recording, and the writer restores the order,
//! so any number of threads gives the same bytes. Memory is bounded by what is in flight (`in_flight`) and by
//! the sweeps that wait (`sweep`).
//!
//! The identify stage is the only one with a state. It gives each burst its judge: the design's model of the
//! printhead, or the model of its first healthy window (`judges`), moved to where the head is now (`head`).
//!
//! # The files
//!
//! ```text
//! the run          replay (ways to judge)  run (what is asked)  wiring (threads, queues)
//!                  finish recording_report not_judged metadata (what is left at the end)
//! stages           stages (six loops)  batches (what crosses queues)  in_flight (bounds, order)
//!   1 reader       pacer (--pace)
//!   2 identify     who judges: groups judges (survey sample healthy_window)
//!                  what times are worth: head_clock (log_clock, clock_words) elapsed
//!                  where the head is: heads head sweep channel_subset frozen moved_judge
//!   3 FD filter    statistics  distances  rings (deviations)  own_levels
//!   5 isolate      isolator  rings (fits)  rows
//!   6 writer       episodes  tally  at_once
//! numbers          numbers (what nobody derived)
//! warnings         head_movement temperature_check topic_overlap at_once ring_look
//! other passes     visit (bursts of a recording)  collect (signals to learn from)
//! many recordings  resume (what is finished)  chain (--baseline: in which order)
//! ```

mod at_once;
mod batches;
pub mod chain;
mod channel_subset;
pub mod clock_words;
pub mod collect;
mod distances;
mod elapsed;
pub mod episodes;
mod finish;
mod frozen;
pub mod groups;
mod head;
pub mod head_clock;
mod head_movement;
mod heads;
mod in_flight;
mod isolator;
pub mod judges;
mod log_clock;
mod metadata;
mod moved_judge;
mod not_judged;
mod numbers;
mod own_levels;
pub mod pacer;
mod recording_report;
pub mod replay;
pub mod resume;
pub mod ring_look;
mod rings;
mod rows;
mod run;
mod stages;
mod statistics;
mod sweep;
pub mod tally;
mod temperature_check;
pub mod timings;
mod topic_overlap;
pub mod visit;
mod wiring;

pub use crate::report::rfc3339;
pub use not_judged::nobody_reads;
pub use recording_report::RecordingReport;
pub use replay::{follow, is_same, judge, replay};
pub use run::{EpisodeEvent, Replay, Watch};

use crate::report::first_of;
use inkling_core::design::DesignError;
use inkling_io::block::Block;
use inkling_io::damage::{Damage, RecordingError};
use inkling_io::file_error::FileError;
use inkling_io::recording::{OtherChannel, Recording};
use inkling_io::scan::Blocks;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use thiserror::Error;

type Result<T, E = PipelineError> = std::result::Result<T, E>;

#[derive(Debug, Error)]
pub enum PipelineError {
    #[error(transparent)]
    Recording(#[from] RecordingError),
    #[error(transparent)]
    Design(#[from] DesignError),
    #[error(transparent)]
    File(#[from] FileError),
    #[error(transparent)]
    Verdicts(#[from] inkling_io::verdict_table::TableError),
    #[error(
        "{recording}: no bursts in it: nothing to judge{}{}{}",
        without_messages(silent),
        instead(others),
        and_damaged(damage)
    )]
    NoBursts {
        recording: String,
        silent: Vec<String>,
        others: Vec<OtherChannel>,
        damage: Vec<Damage>,
    },
    #[error("interrupted; no finished file was written for the recording at hand")]
    Interrupted,
    #[error(
        "more than 65536 models: a verdict table cannot number them; judge fewer printheads at a time"
    )]
    TooManyModels,
    #[error("rows do not add up: {found} signals found, {written} rows written; this is our bug")]
    RowsLost { found: u64, written: u64 },
    #[error("the {0} stage panicked; this is our bug")]
    Panicked(&'static str),
    #[error(transparent)]
    Isolate(#[from] inkling_core::isolate::IsolateError),
}

impl PipelineError {
    /// Whether what is in the recording is the cause, so that it will fail again until it is changed.
    pub fn is_of_content(&self) -> bool {
        use PipelineError::{NoBursts, Recording};
        matches!(self, NoBursts { .. } | Recording(RecordingError::File(FileError::Failed { .. })))
    }
}

/// The first damage of a recording in words, as the end of a sentence; empty: there is none.
fn and_damaged(damage: &[Damage]) -> String {
    damage.first().map_or(String::new(), |d| format!("; it is damaged: {d}"))
}

/// Topics that are there for bursts and have no message, as part of a sentence.
fn without_messages(silent: &[String]) -> String {
    let topics = first_of(silent, 5, ", ");
    match silent.len() {
        0 => String::new(),
        1 => format!("; its topic {topics} has no messages"),
        _ => format!("; its topics {topics} have no messages"),
    }
}

/// What a recording holds instead of bursts, and what to do about it, as part of a sentence.
fn instead(others: &[OtherChannel]) -> String {
    const MOST_TOLD: usize = 5;
    let told = |other: &OtherChannel| {
        let of = if other.schema.is_empty() { "no schema" } else { &other.schema };
        let count = other.messages.map_or(String::new(), |n| format!(", {n} messages"));
        format!("{} ({of}, {}{count})", other.topic, other.message_encoding)
    };
    let told: Vec<String> = others.iter().map(told).collect();
    match told.is_empty() {
        true => String::new(),
        false => format!(
            "; there is {}: `inkling inspect` shows what they hold and how an [[input.dialect]] reads them",
            first_of(&told, MOST_TOLD, ", ")
        ),
    }
}

/// The content of a mutex, locked; it counts as whole also where a thread panicked that held it.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// What the caller may see of a run, and tell it, while it goes on.
#[derive(Debug, Default)]
pub struct Control {
    stop: AtomicBool,
    /// Set by the caller to end the following of a recording that is still being written.
    pub enough: Arc<AtomicBool>,
    /// Set when the writer has ended: nobody takes what the reader reads any more.
    abandoned: AtomicBool,
    /// Number of bytes of the current recording that have been read in the current pass.
    pub bytes_read: AtomicU64,
    /// Number of signals judged, rejected or looked at to learn from so far, over all recordings.
    pub signals: AtomicU64,
}

impl Control {
    pub fn interrupt(&self) {
        self.stop.store(true, Ordering::Relaxed);
    }

    pub fn interrupted(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// The next block of a recording; waits for it where the recording is still being written. `None`: there
    /// is no more, or nobody wants it. The inner error is damage, behind which reading goes on.
    fn next_block(
        &self,
        recording: &Recording,
        blocks: &mut Blocks,
    ) -> Result<Option<Result<Block, Damage>>> {
        let abandoned = || self.abandoned.load(Ordering::Relaxed);
        // `check` can end the wait only by an error, which is told from an interruption below
        let check = || if abandoned() { Err(PipelineError::Interrupted) } else { self.check() };
        match recording.next_block(blocks, check) {
            Err(PipelineError::Interrupted) if abandoned() => Ok(None),
            found => found,
        }
    }

    pub fn check(&self) -> Result<()> {
        if self.interrupted() { Err(PipelineError::Interrupted) } else { Ok(()) }
    }
}
