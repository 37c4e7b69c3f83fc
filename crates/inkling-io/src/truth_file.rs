//! The sealed truth of a recording with a hidden effect. In: the truth. Out: truth.json, and the
//! SHA-256 of its bytes in a file of its own; and back.

use super::regular_file::{self, MOST_CRITIQUE_BYTES};
use super::{part_file, printable};
use serde::Serialize;
use sha2::{Digest, Sha256};
use std::path::{Path, PathBuf};
use thiserror::Error;

#[derive(Debug, Error)]
pub enum TruthError {
    #[error("{path}: cannot be written: {source}")]
    Write { path: PathBuf, source: std::io::Error },
    #[error("{path}: cannot be read: {source}")]
    Read { path: PathBuf, source: std::io::Error },
    #[error("{path}: is no truth of a hidden effect: {what}")]
    Content { path: PathBuf, what: String },
    #[error("{path}: its SHA-256 is not the one in {seal}: it was changed after it was sealed")]
    Broken { path: PathBuf, seal: PathBuf },
}

/// Writes the truth and its digest. The salt in the truth keeps the digest from being guessed.
pub fn write(path: &Path, digest_path: &Path, truth: &impl Serialize) -> Result<(), TruthError> {
    let mut json = serde_json::to_vec_pretty(truth)
        .map_err(|e| TruthError::Content { path: path.into(), what: e.to_string() })?;
    json.push(b'\n');
    let write = |path: &Path, bytes: &[u8]| {
        part_file::write(path, bytes)
            .map_err(|source| TruthError::Write { path: path.into(), source })
    };
    write(path, &json)?;
    write(digest_path, format!("{}\n", digest(&json)).as_bytes())
}

fn digest(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// What a truth's seal says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Seal {
    Holds,
    /// There is no seal, so nobody can tell whether the truth was changed.
    Missing,
}

/// Reads a truth; where its seal lies beside the directory it is in, the seal must hold.
pub fn read(path: &Path) -> Result<(serde_json::Value, Seal), TruthError> {
    let failed = |path: &Path| {
        let path = path.to_path_buf();
        |source| TruthError::Read { path, source }
    };
    let bytes = regular_file::read(path, MOST_CRITIQUE_BYTES).map_err(failed(path))?;
    let beside = path.canonicalize().map_err(failed(path))?;
    let seal_path = beside.parent().and_then(Path::parent).map(|dir| dir.join("truth.sha256"));
    let mut seal = Seal::Missing;
    if let Some(seal_path) = seal_path {
        match regular_file::read_text(&seal_path, 1 << 16) {
            Ok(sealed) if sealed.trim() == digest(&bytes) => seal = Seal::Holds,
            Ok(_) => return Err(TruthError::Broken { path: path.into(), seal: seal_path }),
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => {}
            Err(e) => return Err(failed(&seal_path)(e)),
        }
    }
    let truth = serde_json::from_slice(&bytes)
        .map_err(|e| TruthError::Content { path: path.into(), what: printable::of_parser(&e) })?;
    Ok((truth, seal))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digest_is_the_published_sha_256() {
        let abc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(digest(b"abc"), abc);
    }

    #[test]
    fn a_seal_holds_is_broken_or_is_missing() {
        let dir = tempfile::tempdir().unwrap();
        let (path, seal) = (dir.path().join("sealed/truth.json"), dir.path().join("truth.sha256"));
        std::fs::create_dir(dir.path().join("sealed")).unwrap();
        std::fs::write(&path, "{}").unwrap();
        assert_eq!(read(&path).unwrap().1, Seal::Missing);
        std::fs::write(&seal, digest(b"{}")).unwrap();
        assert_eq!(read(&path).unwrap().1, Seal::Holds);
        std::fs::write(&path, "{ }").unwrap();
        assert!(matches!(read(&path), Err(TruthError::Broken { .. })));
    }
}
