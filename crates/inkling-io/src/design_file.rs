//! Reads and writes the file of a design (JSON, `schemas/design.md`).
//!
//! In: a path. Out: a `Design` that was checked, with the digest of the file's bytes, by which
//! results and baselines name the design; `train` writes one. A file that is something else, or a
//! design of another version, is refused with words that say what it is.

use super::file_error::FileError;
use super::{digest, part_file, printable, regular_file, result_file};
use inkling_core::design::{Design, VERSION, other_version};
use serde::Deserialize;
use std::path::Path;

/// Most bytes that are read. A design of 64 classes and 1000 printheads at 512 samples takes some 50 MB.
const MOST_BYTES: u64 = 1 << 30;

/// What designs of every version say of themselves, so that one of another version can be refused by name.
#[derive(Deserialize)]
struct Origin {
    version: u32,
    #[serde(default = "somebody")]
    made_by: String,
}

/// Who made a design that does not say it.
fn somebody() -> String {
    "another inkling".into()
}

/// Reads and checks a design. Also gives the digest of the file: `xxh3:` and 32 hexadecimal digits.
pub fn read(path: &Path) -> Result<(Design, String), FileError> {
    let text = read_text(path)?;
    Ok((parse(path, &text)?, digest::of_bytes(&text)))
}

/// The bytes of a file that may be a design; larger files than `MOST_BYTES` are refused.
pub fn read_text(path: &Path) -> Result<Vec<u8>, FileError> {
    regular_file::read(path, MOST_BYTES).map_err(FileError::unread(path))
}

/// The design that a text holds, checked.
pub fn parse(path: &Path, text: &[u8]) -> Result<Design, FileError> {
    let not = |what: String| {
        let what = result_file::instead_or(path, "design", &what);
        FileError::mistaken(path, format!("not a design{what}; `inkling train` makes one"))
    };
    let design: Design = serde_json::from_slice(text).map_err(|e| {
        // a design of another version may not parse at all; if its version can be read, that is what is said
        let made: Option<Origin> = serde_json::from_slice(text).ok();
        let other = made.filter(|made| made.version != VERSION);
        let of_version =
            |made: Origin| other_version(made.version, &printable::cell(&made.made_by));
        not(other.map_or_else(|| printable::of_parser(&e), of_version))
    })?;
    design.check().map_err(|e| not(e.to_string()))?;
    Ok(design)
}

/// Writes a design, complete or not at all.
pub fn write(path: &Path, design: &Design) -> Result<(), FileError> {
    let text = text(design).map_err(|e| FileError::unwritten(path)(e.into()))?;
    write_text(path, &text)
}

/// Writes the text of a design, as [`text`] gives it.
pub fn write_text(path: &Path, text: &[u8]) -> Result<(), FileError> {
    part_file::write(path, text).map_err(FileError::unwritten(path))
}

pub fn text(design: &Design) -> serde_json::Result<Vec<u8>> {
    let mut text = serde_json::to_vec_pretty(design)?;
    text.push(b'\n');
    Ok(text)
}
