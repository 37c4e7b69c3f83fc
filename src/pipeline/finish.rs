//! Finishes a recording that went through the stages.
//!
//! In: what the stages left behind ([`StageResults`]), from `replay`. Out: the recording's report, and its files
//! ([`Run::report`]).
//!
//! The order of the files makes a killed run harmless. The tables and the summary are completed under names of
//! their own. Then the files of an earlier run are removed, the summary first, and the new ones named, the
//! summary last. So where a summary lies, the tables beside it are whole and belong to it.

use super::clock_words;
use super::metadata::{self, Document};
use super::not_judged;
use super::recording_report::RecordingReport;
use super::run::Run;
use super::tally::{Counts, Tally};
use super::timings::PhaseTiming;
use super::wiring::{StageResults, Table};
use super::{PipelineError, Result, locked};
use inkling_io::damage::Damage;
use inkling_io::episode_table::EpisodeWriter;
use inkling_io::file_error::FileError;
use inkling_io::part_file::{self, CompleteFile};
use inkling_io::recording::Recording;
use inkling_io::verdict_table::VerdictWriter;
use inkling_io::{labels_file, stored, summary_file};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

impl Run<'_> {
    /// Checks what the stages left behind, makes the report and completes the files. `started`: when the stages
    /// began.
    ///
    /// # Errors
    /// The recording holds no bursts, labels do not fit it, rows are missing, or a file cannot be written.
    pub fn report(&self, results: StageResults, started: Instant) -> Result<RecordingReport> {
        // 1. the recording and what the stages left
        let (opening, stages, finishing) =
            (self.recording.opening, started.elapsed(), Instant::now());
        let Run { replay, recording, verdicts, control, .. } = *self;
        let paced = self.pacer.map(|pacer| locked(pacer).kept);

        // a recording that was followed is opened again as a whole
        let dialects = replay.settings.input.dialects();
        let closed = recording.is_growing().then(|| recording.closed(&dialects)).transpose()?;
        let recording = closed.as_ref().unwrap_or(recording);
        let StageResults { mut judges, mut tally, table, episodes, moved, digest, .. } = results;
        let (odd_times, wrong_times) = clock_words::told(results.clocks);

        // 2. warnings by printhead
        let mut warnings: Vec<_> = judges.wide_thresholds(false).collect();
        let signals = |name: &str| tally.printheads.get(name).map_or(0, |of| of.signals);
        let identify = &replay.settings.identify;
        let changes = moved.iter().flat_map(|of| {
            let told = of.warnings(identify).into_iter();
            told.map(|what| (of.printhead.clone(), what))
        });
        let temperatures = results.temperatures.warnings(signals).into_iter();
        let head_changes: Vec<(Arc<str>, String)> = temperatures.chain(changes).collect();
        warnings.extend(head_changes.iter().cloned());

        // 3. damage, and what makes the recording fail
        recording.check_read()?;
        let damage = all_damage(recording, results.scan_damage, &mut tally, digest.damage);
        check_rows(&tally.counts, table.rows())?;
        if tally.counts.bursts == 0 {
            let (silent, others) = (recording.silent.clone(), recording.others.clone());
            let recording = recording.path.display().to_string();
            return Err(PipelineError::NoBursts { recording, silent, others, damage });
        }

        if let Some(labels) = &replay.labels {
            labels_file::check(Path::new(&identify.labels), labels, &tally.met())?;
        }

        // 4. the report; what is not known yet is filled in below
        let (episodes, episode_table) = episodes;
        let mut report = RecordingReport {
            name: recording.name.clone(),
            digest: digest.text,
            stamp: recording.stamp,
            damage,
            refusals: std::mem::take(&mut judges.refusals),
            not_judged: Vec::new(),
            unread: results.topics.told(recording),
            odd_times,
            wrong_times,
            moved,
            warnings,
            head_changes,
            models: judges.models().len(),
            seconds: 0.0,
            verdicts: verdicts.map(Path::to_path_buf).unwrap_or_default(),
            episodes,
            paced,
            phases: Vec::new(),
            timings: results.timings,
            tally,
            baselines: results.memory,
            cut_off: recording.is_cut_off(),
            arrays: None,
        };
        // that many channels are flagged at once is told only of printheads without such a warning
        for (name, of) in &report.tally.printheads {
            let at_once = of.at_once.longest().filter(|_| !report.has_moved(name));
            report.warnings.extend(at_once.map(|of| (name.clone(), of.in_words())));
        }
        not_judged::note(&mut report, (replay, recording), &judges);

        // 5. the tables, with the document in their metadata, completed on disk
        let counts = &report.tally.counts;
        let mut document = metadata::document(replay, recording, &report.digest, &judges, counts);
        control.check()?;
        let place = verdicts.unwrap_or(&recording.path);
        let unwritten = |e: serde_json::Error| FileError::unwritten(place)(e.into());
        let text = serde_json::to_string(&document).map_err(unwritten)?;
        let of_episodes = document.text_of_episodes().map_err(unwritten)?;
        let mut files = Vec::new();
        match table {
            Table::Arrays(rows) => report.arrays = Some(rows.complete(text)),
            Table::File(table) => files = complete_tables(table, text, episode_table, of_episodes)?,
        }
        report.seconds = (opening + started.elapsed()).as_secs_f64();
        let phases = [("open", opening), ("stages", stages), ("finish", finishing.elapsed())];
        let phase =
            |(phase, took): (_, Duration)| PhaseTiming { phase, seconds: took.as_secs_f64() };
        report.phases = phases.map(phase).into();

        report.summary(&mut document.of_run, recording);

        // 6. the names; the summary comes last, as it says that all files are there
        if let Some(verdicts) = verdicts {
            files.push(complete_summary(verdicts, &document)?);
            name_all(files)?;
        }
        Ok(report)
    }
}

fn check_rows(counts: &Counts, written: u64) -> Result<()> {
    let found = counts.signals;
    match counts.judged + counts.rejected.values().sum::<u64>() == found && written == found {
        true => Ok(()),
        false => Err(PipelineError::RowsLost { found, written }),
    }
}

fn all_damage(
    recording: &Recording,
    of_scan: Vec<Damage>,
    tally: &mut Tally,
    of_digest: Option<Damage>,
) -> Vec<Damage> {
    let mut damage = recording.damage.clone();
    damage.extend(of_scan);
    damage.append(&mut tally.damage);
    damage.extend(of_digest);
    damage.extend(recording.missing(tally.counts.bursts));
    damage.extend(recording.changed());
    damage.sort_by_key(|d| (d.from_byte, d.to_byte));
    damage
}

fn complete_tables(
    verdicts: VerdictWriter,
    document: String,
    episodes: Option<EpisodeWriter>,
    of_episodes: String,
) -> Result<Vec<CompleteFile>> {
    std::thread::scope(|both| {
        // side by side, since each waits for the disk
        let episodes = both.spawn(|| episodes.map(|table| table.complete(of_episodes)).transpose());
        let verdicts = verdicts.complete(document);
        let episodes = episodes.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        Ok(episodes?.into_iter().chain([verdicts?]).collect())
    })
}

fn complete_summary(verdicts: &Path, summary: &Document) -> Result<CompleteFile> {
    let path = summary_file::path_beside(verdicts);
    let failed = FileError::unwritten(&path);
    let mut text = serde_json::to_string_pretty(summary).map_err(|e| failed(e.into()))?;
    text.push('\n');
    Ok(part_file::completed(&path, text.as_bytes()).map_err(failed)?)
}

/// An earlier run's files are removed first, so that tables of two runs never lie side by side.
fn name_all(files: Vec<CompleteFile>) -> Result<()> {
    let paths: Vec<PathBuf> = files.iter().map(|file| file.path().to_path_buf()).collect();
    // the last file, which says that all are there, is removed first
    for path in paths.iter().rev() {
        stored::remove(path).map_err(FileError::unwritten(path))?;
    }
    for (file, path) in files.into_iter().zip(&paths) {
        file.name().map_err(FileError::unwritten(path))?;
    }

    // the names are on disk only when their directories are
    for of_directory in paths.chunk_by(|p, q| p.parent() == q.parent()) {
        let path = &of_directory[0];
        part_file::sync_directory_of(path).map_err(FileError::unwritten(path))?;
    }
    Ok(())
}
