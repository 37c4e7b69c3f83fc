//! Reads and writes the file of a design (JSON, `schemas/design.md`).
//!
//! In: a path. Out: a `Design`, with the digest of the file's bytes, by which results and baselines
//! name the design; `train` writes one. A file that is something else, or a design of another
//! version, is refused with words that say what it is.
//!
//! A design is thousands of numbers that only training can make fit together, and nobody can check
//! them one by one. So the file holds a checksum of them all, and a design that was edited or
//! damaged is refused whatever was changed. Indentation and the order of keys may change.

use super::file_error::FileError;
use super::{digest, part_file, printable, regular_file, result_file};
use inkling_core::design::{Design, VERSION};
use serde::Deserialize;
use serde_json::Value;
use std::path::Path;

/// Most bytes that are read. A design of 64 classes and 1000 printheads at 512 samples takes some 50 MB.
const MOST_BYTES: u64 = 1 << 28;

/// What designs of every version say of themselves.
#[derive(Deserialize)]
struct Origin {
    version: u32,
}

/// The key of the checksum in the file.
const CHECKSUM: &str = "checksum";

pub fn read(path: &Path) -> Result<(Design, String), FileError> {
    let text = read_text(path)?;
    Ok((parse(path, &text)?, digest::of_bytes(&text)))
}

pub fn read_text(path: &Path) -> Result<Vec<u8>, FileError> {
    regular_file::read(path, MOST_BYTES).map_err(FileError::unread(path))
}

pub fn parse(path: &Path, text: &[u8]) -> Result<Design, FileError> {
    let not = |what: String| {
        let what = result_file::instead_or(path, "design", &what);
        FileError::mistaken(path, format!("not a design{what}; `inkling train` makes one"))
    };
    let of_parser = |e: serde_json::Error| not(printable::of_parser(&e));
    let mut all: Value = serde_json::from_slice(text).map_err(of_parser)?;
    if !all.is_object() {
        return Err(not("it is no JSON object".into()));
    }
    let Origin { version } = Origin::deserialize(&all).map_err(of_parser)?;
    if version != VERSION {
        let whose = match version < VERSION {
            true => "an unreleased version: train again",
            false => "a newer inkling",
        };
        return Err(not(format!("design version {version}, made by {whose}; {VERSION} is read")));
    }
    let told = all.as_object_mut().and_then(|keys| keys.remove(CHECKSUM));
    let told = told.ok_or_else(|| not("it has no checksum".into()))?;
    if told != checksum(&mut all) {
        return Err(not("it was changed since it was made".into()));
    }
    serde_json::from_value(all).map_err(of_parser)
}

/// Of everything but the checksum: keys in alphabetical order, numbers with as many digits as tell them apart.
fn checksum(all: &mut Value) -> String {
    all.sort_all_objects();
    digest::of_bytes(all.to_string().as_bytes())
}

/// Writes a design, complete or not at all.
pub fn write(path: &Path, design: &Design) -> Result<(), FileError> {
    let text = text(design).map_err(|e| FileError::unwritten(path)(e.into()))?;
    write_text(path, &text)
}

pub fn write_text(path: &Path, text: &[u8]) -> Result<(), FileError> {
    part_file::write(path, text).map_err(FileError::unwritten(path))
}

pub fn text(design: &Design) -> serde_json::Result<Vec<u8>> {
    // the file is written from the design itself, whose keys are in the order in which they are explained
    let mut text = serde_json::to_string_pretty(design)?;
    let mut all: Value = serde_json::from_str(&text)?;
    let checksum = checksum(&mut all);
    // a number that is not finite was written as null, and nobody could read such a design
    let _: Design = serde_json::from_value(all)?;
    text.insert_str(1, &format!("\n  \"{CHECKSUM}\": \"{checksum}\","));
    text.push('\n');
    Ok(text.into_bytes())
}
