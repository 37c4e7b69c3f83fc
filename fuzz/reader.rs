//! One of `tests/readers.rs` on bytes from the fuzzer. To run one for ten minutes, from its corpus:
//!
//! ```sh
//! cargo install cargo-fuzz
//! cargo fuzz run --sanitizer none labels tests/corpus/labels -- -max_total_time=600
//! ```

#[path = "../tests/readers.rs"]
mod readers;

use std::path::PathBuf;
use std::sync::OnceLock;

/// A directory for the one file that is read; each process has its own.
fn file(reader: &str) -> &'static PathBuf {
    static DIR: OnceLock<(tempfile::TempDir, PathBuf)> = OnceLock::new();
    let made = || {
        let dir = tempfile::tempdir().expect("a temporary directory");
        let name = if reader == "journal" { "journal.jsonl" } else { reader };
        let path = dir.path().join(name);
        (dir, path)
    };
    &DIR.get_or_init(made).1
}

pub fn read(reader: &str, bytes: &[u8]) {
    let path = file(reader);
    std::fs::write(path, bytes).expect("room for it");
    let (_, read) = readers::READERS.iter().find(|(name, _)| *name == reader).expect("a reader");
    read(path);
}
