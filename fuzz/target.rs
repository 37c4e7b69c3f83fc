//! Every target: the reader of `tests/readers.rs` that has the target's name, on bytes from the fuzzer. To run one for
//! ten minutes, from its corpus:
//!
//! ```sh
//! cargo install cargo-fuzz
//! cargo fuzz run --sanitizer none labels tests/corpus/labels -- -max_total_time=600
//! ```

#![no_main]

#[path = "../tests/readers.rs"]
mod readers;

use std::sync::LazyLock;

/// The directory of the one file that is read; each process has its own.
static DIR: LazyLock<tempfile::TempDir> =
    LazyLock::new(|| tempfile::tempdir().expect("a temporary directory"));

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let (file, read) = readers::reader(env!("CARGO_BIN_NAME"));
    let path = DIR.path().join(file);
    std::fs::write(&path, bytes).expect("room for it");
    read(&path);
});
