//! Channels' baselines as JSON: read at the start, written at the end under another name first.

use super::part_file::PartFile;
use crate::design::Baselines;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// A million channels take some 200 MB.
const MOST_BYTES: u64 = 1 << 29;

#[derive(Debug, Error)]
pub enum BaselineFileError {
    #[error("{path}: cannot be read: {source}")]
    Read { path: PathBuf, source: std::io::Error },
    #[error("{path}: cannot be written: {source}")]
    Write { path: PathBuf, source: std::io::Error },
    #[error("{path}: more than {bytes} bytes: no baselines are that large")]
    TooLarge { path: PathBuf, bytes: u64 },
    #[error("{path}: no baselines: {what}; `inkling replay --baseline` makes them")]
    NotBaselines { path: PathBuf, what: String },
    #[error(
        "{path}: these baselines were learned with another design ({found}, not {design}): \
         give another file, or the design they belong to"
    )]
    OtherDesign { path: PathBuf, found: String, design: String },
}

/// Reads and checks baselines that belong to a design; there need not be a file yet.
pub fn read(path: &Path, design: Option<&str>) -> Result<Baselines, BaselineFileError> {
    let failed = |source| BaselineFileError::Read { path: path.into(), source };
    let file = match std::fs::File::open(path) {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
            return Ok(Baselines::new(design.map(str::to_owned)));
        }
        opened => opened.map_err(failed)?,
    };
    let mut text = Vec::new();
    file.take(MOST_BYTES + 1).read_to_end(&mut text).map_err(failed)?;
    if text.len() as u64 > MOST_BYTES {
        return Err(BaselineFileError::TooLarge { path: path.into(), bytes: MOST_BYTES });
    }
    let not = |what: String| BaselineFileError::NotBaselines { path: path.into(), what };
    let baselines: Baselines = serde_json::from_slice(&text).map_err(|e| not(e.to_string()))?;
    baselines.check().map_err(|e| not(e.to_string()))?;
    if baselines.design.as_deref() != design {
        let words = |digest: Option<&str>| digest.unwrap_or("none").to_owned();
        return Err(BaselineFileError::OtherDesign {
            path: path.into(),
            found: words(baselines.design.as_deref()),
            design: words(design),
        });
    }
    Ok(baselines)
}

pub fn write(path: &Path, baselines: &Baselines) -> Result<(), BaselineFileError> {
    let failed = |source| BaselineFileError::Write { path: path.into(), source };
    let mut text = serde_json::to_string(baselines).map_err(|e| failed(e.into()))?;
    text.push('\n');
    let (part, mut file) = PartFile::create(path).map_err(failed)?;
    file.write_all(text.as_bytes()).map_err(failed)?;
    part.finish(&file).map_err(failed)
}
