//! Stand-ins for the functions of object stores in a build without the feature `object-store`. They
//! have the same names and types as the real functions, so that callers need no `cfg`. Every
//! function fails with an error that names the feature and a way to do without it.

use crate::stamp::Stamp;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

fn absent<T>() -> io::Result<T> {
    const WHAT: &str = "inkling was built without the feature object-store: cargo build --features object-store; or \
        copy it to a directory first (aws s3 sync, gcloud storage rsync, azcopy)";
    Err(io::Error::new(io::ErrorKind::Unsupported, WHAT))
}

#[derive(Debug)]
pub enum Object {}

impl Object {
    /// Always an error. So the methods below, which need an object, can never run.
    pub fn open(_: &Path) -> io::Result<Object> {
        absent()
    }

    pub fn stamp_then(&self) -> Stamp {
        match *self {}
    }

    pub fn stamp(&self) -> io::Result<Stamp> {
        match *self {}
    }

    pub fn read_at(&self, _: u64, _: &mut [u8]) -> io::Result<()> {
        match *self {}
    }
}

macro_rules! absent {
    ($($name:ident($($of:ty),*) -> $what:ty;)*) => {
        $(pub fn $name($(_: $of),*) -> io::Result<$what> {
            absent()
        })*
    };
}

absent! {
    check(&Path) -> ();
    stamp(&Path) -> Stamp;
    list(&Path) -> Vec<PathBuf>;
    fetch(&Path) -> File;
    temporary() -> File;
    send(&File, &Path) -> ();
    remove(&Path) -> ();
    rename(&Path, &Path) -> ();
}
