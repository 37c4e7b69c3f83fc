//! What the tests of this crate share. Not part of the product.

use std::fmt::Display;
use std::path::{Path, PathBuf};

/// A fresh directory, and a path in it where nothing is yet.
pub fn place(name: &str) -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    (dir, path)
}

/// The names of all that a directory holds.
pub fn names(dir: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(dir).unwrap().map(|entry| entry.unwrap().file_name());
    let mut names: Vec<String> = entries.map(|name| name.to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// Panics unless this is an error whose message has each of these texts.
#[track_caller]
pub fn assert_refused<T, E: Display>(result: Result<T, E>, texts: &[&str]) {
    let Err(error) = result else { panic!("taken, and not refused with {texts:?}") };
    let message = error.to_string();
    for text in texts {
        assert!(message.contains(text), "{message:?} does not say {text:?}");
    }
}
