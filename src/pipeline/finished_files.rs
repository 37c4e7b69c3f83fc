//! The files of a judged recording: complete on disk first, and only then named.

use super::PipelineError;
use super::metadata::Document;
use inkling_io::episode_table::EpisodeWriter;
use inkling_io::part_file::{self, CompleteFile};
use inkling_io::verdict_table::VerdictWriter;
use inkling_io::{stored, summary_file};
use std::path::{Path, PathBuf};

/// Writes the tables of verdicts and episodes to their ends, before any file gets its name; that of verdicts is the last.
pub fn complete_tables(
    verdicts: VerdictWriter,
    document: String,
    episodes: Option<EpisodeWriter>,
    of_episodes: String,
) -> Result<Vec<CompleteFile>, PipelineError> {
    std::thread::scope(|both| {
        // each waits for the disk
        let episodes = both.spawn(|| episodes.map(|table| table.complete(of_episodes)).transpose());
        let verdicts = verdicts.complete(document);
        let episodes = episodes.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        Ok(episodes?.into_iter().chain([verdicts?]).collect())
    })
}

/// Writes the summary beside the verdicts.
pub fn complete_summary(
    verdicts: &Path,
    summary: &Document,
) -> Result<CompleteFile, PipelineError> {
    let path = summary_file::path_beside(verdicts);
    let failed = |source| PipelineError::Write { path: path.clone(), source };
    let mut text = serde_json::to_string_pretty(summary).map_err(|e| failed(e.into()))?;
    text.push('\n');
    part_file::completed(&path, text.as_bytes()).map_err(failed)
}

/// Gives the files their names. An earlier run's files go before the first of these gets its name: at no instant do tables
/// of two runs lie side by side.
pub fn name_all(files: Vec<CompleteFile>) -> Result<(), PipelineError> {
    let failed = |path: &Path, source| PipelineError::Write { path: path.into(), source };
    for file in files.iter().rev() {
        stored::remove(file.path()).map_err(|e| failed(file.path(), e))?;
    }
    let paths: Vec<PathBuf> = files.iter().map(|file| file.path().to_path_buf()).collect();
    for file in files {
        let path = file.path().to_path_buf();
        file.name().map_err(|e| failed(&path, e))?;
    }
    let mut dirs: Vec<&PathBuf> = paths.iter().collect();
    dirs.dedup_by_key(|path| path.parent());
    dirs.iter().try_for_each(|path| part_file::sync_directory_of(path).map_err(|e| failed(path, e)))
}
