//! A *row*: what became of a recording, as a file in the run's directory. Whoever finds it may believe it as
//! far as it can be checked: it may give files their names only below the directory of results.

use crate::roots::resolve;
use inkling::cli::judge::{Judged, NotJudged};
use inkling::io::job::Job;
use inkling::io::objects::in_object_store;
use inkling::io::{part_file, stored};
use inkling::pipeline::resume;
use serde::{Deserialize, Serialize};
use std::fs;
use std::io::{self, ErrorKind};
use std::path::{Component, Path, PathBuf};

/// Directory below the directory of results, in which runs keep what they need until they are over.
pub const FLEET_DIR: &str = ".fleet";

/// What became of a recording.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Row {
    pub item: Job,
    pub ended: Result<Judged, NotJudged>,
    /// The executor that judged it: host and process.
    pub by: String,
    /// Where its verdicts lie until they have their name.
    pub staged: PathBuf,
}

impl Row {
    /// Gives the files of the recording their names, the summary's last. Everybody who finds the row does so,
    /// because the executor that wrote it may have been stopped in between. A file that has its name already
    /// keeps it.
    pub fn name(&self, out: &Path) -> io::Result<()> {
        if self.ended.is_err() {
            return Ok(());
        }
        let verdicts = self.item.verdicts_in(out);
        // a row is a file that others may have written, and so may links on its paths be
        let fleet = out.join(FLEET_DIR);
        let below = |path: &Path, dir: &Path| {
            let stays = path.strip_prefix(dir).is_ok_and(stays_below);
            Ok::<_, io::Error>(
                stays && (in_object_store(dir) || resolve(path)?.starts_with(resolve(dir)?)),
            )
        };
        if !(below(&self.staged, &fleet)? && below(&verdicts, out)?) {
            let what =
                format!("the row of {} leads out of {}", self.item.source.path, out.display());
            return Err(io::Error::new(ErrorKind::InvalidData, what));
        }
        if let Some(dir) = verdicts.parent().filter(|dir| !in_object_store(dir)) {
            fs::create_dir_all(dir)?;
        }
        for (from, to) in resume::files(&self.staged).iter().zip(&resume::files(&verdicts)) {
            match stored::rename(from, to) {
                Err(e) if e.kind() != ErrorKind::NotFound => return Err(e),
                _ => {}
            }
        }
        part_file::sync_directory_of(&verdicts)
    }

    /// Whether it is the row of this recording, for these results.
    pub fn is_of(&self, item: &Job) -> bool {
        (&self.item.source.path, &self.item.verdicts) == (&item.source.path, &item.verdicts)
    }

    /// Whether the files that it tells of are there, with the sizes that it tells.
    pub fn stands(&self, out: &Path) -> bool {
        let Ok(judged) = &self.ended else { return true };
        let files = resume::files(&self.item.verdicts_in(out));
        let bytes = judged.entry.results.iter().flat_map(|results| &results.bytes);
        files.iter().zip(bytes).all(|(file, bytes)| stored::bytes(file) == *bytes)
    }
}

/// Whether a relative path stays below where it begins, by its parts alone.
pub fn stays_below(path: &Path) -> bool {
    path.components().all(|part| matches!(part, Component::Normal(_)))
}
