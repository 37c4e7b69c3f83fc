//! Writes and reads the sealed truth of a simulated recording with a hidden effect.
//!
//! A critique must find the effect without knowing it. So `simulate` writes the truth (any JSON)
//! into `truth.json` in a directory of its own, and the SHA-256 of its bytes into `truth.sha256`
//! beside that directory, which can be published beforehand. `score --truth` reads the truth here,
//! which checks that nobody has changed it since.

use super::file_error::FileError;
use super::regular_file::{self, MOST_CRITIQUE_BYTES, if_there};
use super::{part_file, printable};
use serde::Serialize;
use sha2::{Digest, Sha256};
use std::path::Path;

/// How errors begin about a file that cannot be a truth.
const NO_TRUTH: &str = "is no truth of a hidden effect";

/// Writes the truth and its digest. The truth should hold a salt (the caller puts it in), without
/// which it could be guessed from its digest.
pub fn write(path: &Path, digest_path: &Path, truth: &impl Serialize) -> Result<(), FileError> {
    let json = serde_json::to_vec_pretty(truth);
    let mut json = json.map_err(|e| FileError::failed(path, format!("{NO_TRUTH}: {e}")))?;
    json.push(b'\n');
    let seal = format!("{}\n", digest(&json));
    for (path, bytes) in [(path, &json[..]), (digest_path, seal.as_bytes())] {
        part_file::write(path, bytes).map_err(FileError::unwritten(path))?;
    }
    Ok(())
}

fn digest(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// What the seal says of a truth that was read. A seal that does not hold is an error instead.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Seal {
    Holds,
    /// There is no seal, so nobody can tell whether the truth was changed.
    Missing,
}

/// Reads a truth. If there is a seal beside the directory that the truth is in, it must hold.
pub fn read(path: &Path) -> Result<(serde_json::Value, Seal), FileError> {
    let unread = FileError::unread(path);
    let bytes = regular_file::read(path, MOST_CRITIQUE_BYTES).map_err(unread)?;
    let beside = path.canonicalize().map_err(unread)?;
    // a canonical path of a file has a directory; where that is the root, the seal lies in it
    let directory = beside.parent().unwrap_or(&beside);
    let seal_path = directory.parent().unwrap_or(directory).join("truth.sha256");
    let there = if_there(regular_file::read_text(&seal_path, 1 << 16));
    let seal = match there.map_err(FileError::unread(&seal_path))? {
        None => Seal::Missing,
        Some(sealed) if sealed.trim() == digest(&bytes) => Seal::Holds,
        Some(_) => {
            let seal = seal_path.display();
            let what = "it was changed after it was sealed";
            let what = format!("its SHA-256 is not the one in {seal}: {what}");
            return Err(FileError::failed(path, what));
        }
    };
    let truth = serde_json::from_slice(&bytes).map_err(|e| {
        FileError::failed(path, format!("{NO_TRUTH}: {}", printable::of_parser(&e)))
    })?;
    Ok((truth, seal))
}
