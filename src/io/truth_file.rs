//! The sealed truth of a recording with a hidden effect. In: [`Truth`]. Out: truth.json, and the
//! SHA-256 of its bytes in a file of its own; and back.

use super::part_file::PartFile;
use crate::simulate::hidden::Truth;
use sha2::{Digest, Sha256};
use std::io::Write;
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
pub fn write(path: &Path, digest_path: &Path, truth: &Truth) -> Result<(), TruthError> {
    let mut json = serde_json::to_vec_pretty(truth)
        .map_err(|e| TruthError::Content { path: path.into(), what: e.to_string() })?;
    json.push(b'\n');
    let put = |path: &Path, bytes: &[u8]| -> std::io::Result<()> {
        let (part, mut file) = PartFile::create(path)?;
        file.write_all(bytes)?;
        part.finish(&file)
    };
    let failed = |path: &Path| {
        let path = path.to_path_buf();
        |source| TruthError::Write { path, source }
    };
    put(path, &json).map_err(failed(path))?;
    put(digest_path, format!("{}\n", digest(&json)).as_bytes()).map_err(failed(digest_path))
}

fn digest(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Reads a truth; where its seal lies beside the directory it is in, the seal must hold.
pub fn read(path: &Path) -> Result<serde_json::Value, TruthError> {
    let bytes =
        std::fs::read(path).map_err(|source| TruthError::Read { path: path.into(), source })?;
    let seal = path.parent().and_then(Path::parent).map(|dir| dir.join("truth.sha256"));
    if let Some(seal) = seal
        && let Ok(sealed) = std::fs::read_to_string(&seal)
        && sealed.trim() != digest(&bytes)
    {
        return Err(TruthError::Broken { path: path.into(), seal });
    }
    serde_json::from_slice(&bytes)
        .map_err(|e| TruthError::Content { path: path.into(), what: e.to_string() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digest_is_the_published_sha_256() {
        let abc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(digest(b"abc"), abc);
    }
}
