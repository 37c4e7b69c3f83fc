//! Completes the files of a judged recording on disk, and only then gives them their names.

use super::PipelineError;
use super::metadata::Document;
use inkling_io::episode_table::EpisodeWriter;
use inkling_io::file_error::FileError;
use inkling_io::part_file::{self, CompleteFile};
use inkling_io::verdict_table::VerdictWriter;
use inkling_io::{stored, summary_file};
use std::path::{Path, PathBuf};

/// Completes the tables of verdicts and episodes, before any file gets its name. That of the verdicts is the
/// last of the returned files.
pub fn complete_tables(
    verdicts: VerdictWriter,
    document: String,
    episodes: Option<EpisodeWriter>,
    of_episodes: String,
) -> Result<Vec<CompleteFile>, PipelineError> {
    std::thread::scope(|both| {
        // side by side, since each waits for the disk
        let episodes = both.spawn(|| episodes.map(|table| table.complete(of_episodes)).transpose());
        let verdicts = verdicts.complete(document);
        let episodes = episodes.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        Ok(episodes?.into_iter().chain([verdicts?]).collect())
    })
}

/// Writes the summary, complete but not named yet, to lie beside the verdicts.
pub fn complete_summary(
    verdicts: &Path,
    summary: &Document,
) -> Result<CompleteFile, PipelineError> {
    let path = summary_file::path_beside(verdicts);
    let failed = FileError::unwritten(&path);
    let mut text = serde_json::to_string_pretty(summary).map_err(|e| failed(e.into()))?;
    text.push('\n');
    Ok(part_file::completed(&path, text.as_bytes()).map_err(failed)?)
}

/// Gives the files their names. The files of an earlier run are removed before the first of these gets its
/// name, so that tables of two runs never lie side by side.
pub fn name_all(files: Vec<CompleteFile>) -> Result<(), PipelineError> {
    // the last file, which says that all are there, is removed first
    for file in files.iter().rev() {
        stored::remove(file.path()).map_err(FileError::unwritten(file.path()))?;
    }

    let paths: Vec<PathBuf> = files.iter().map(|file| file.path().to_path_buf()).collect();
    for file in files {
        let path = file.path().to_path_buf();
        file.name().map_err(FileError::unwritten(&path))?;
    }

    // the names are on disk only when their directories are
    let mut dirs: Vec<&PathBuf> = paths.iter().collect();
    dirs.dedup_by_key(|path| path.parent());
    let sync =
        |path: &PathBuf| part_file::sync_directory_of(path).map_err(FileError::unwritten(path));
    Ok(dirs.into_iter().try_for_each(sync)?)
}
