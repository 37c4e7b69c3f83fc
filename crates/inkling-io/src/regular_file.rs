//! Opens and reads files that a person or another program wrote: settings, labels, scenarios,
//! designs, critiques, tables.
//!
//! In: a path, which may be a name in an object store. Out: the file's bytes, and no more than the
//! caller allows. Only regular files are opened, because a pipe or a device may never end. Tables that are read
//! record by record go through `table_text.rs`.

use super::objects::{self, in_object_store};
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

pub const MOST_SETTINGS_BYTES: u64 = 4 << 20;
pub const MOST_CRITIQUE_BYTES: u64 = 64 << 20;

/// Opens a regular file; anything else is an error of kind `InvalidInput`.
pub fn open(path: &Path) -> io::Result<File> {
    if in_object_store(path) {
        return objects::fetch(path);
    }
    let regular = |metadata: std::fs::Metadata| {
        let what = "not a file (a directory, a pipe or a device)";
        let refused = io::Error::new(io::ErrorKind::InvalidInput, what);
        metadata.is_file().then_some(()).ok_or(refused)
    };
    // checked before the file is opened, because opening a pipe waits for a writer, and again
    // after, because the file may have been replaced meanwhile
    regular(path.metadata()?)?;
    let file = File::open(path)?;
    regular(file.metadata()?)?;
    Ok(file)
}

/// The first bytes of a regular file; fewer where it ends before.
pub fn start(path: &Path, bytes: u64) -> io::Result<Vec<u8>> {
    let mut start = Vec::new();
    open(path)?.take(bytes).read_to_end(&mut start)?;
    Ok(start)
}

/// The result of reading, where a missing file is `None` instead of an error.
pub fn if_there<T>(read: io::Result<T>) -> io::Result<Option<T>> {
    match read {
        Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(None),
        read => read.map(Some),
    }
}

/// All bytes of a regular file; more than `most_bytes` are an error of kind `FileTooLarge`.
pub fn read(path: &Path, most_bytes: u64) -> io::Result<Vec<u8>> {
    let beyond = || too_large(format!("more than {most_bytes} bytes: not what is asked for here"));
    let mut bytes = Vec::new();
    if in_object_store(path) && objects::stamp(path)?.bytes > most_bytes {
        return Err(beyond()); // before the object is fetched
    }
    open(path)?.take(most_bytes.saturating_add(1)).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most_bytes { Err(beyond()) } else { Ok(bytes) }
}

/// All of a regular file as text, like [`read`]; anything but UTF-8 is an error of kind
/// `InvalidData`.
pub fn read_text(path: &Path, most_bytes: u64) -> io::Result<String> {
    String::from_utf8(read(path, most_bytes)?)
        .map_err(|_| io::Error::new(io::ErrorKind::InvalidData, "is not UTF-8 text"))
}

pub(super) fn too_large(what: String) -> io::Error {
    io::Error::new(io::ErrorKind::FileTooLarge, what)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::{assert_refused, place};

    #[test]
    fn no_more_is_read_than_stated() {
        let (_dir, path) = place("x");
        std::fs::write(&path, "12345").unwrap();
        assert_eq!(read(&path, 5).unwrap(), b"12345");
        assert_refused(read(&path, 4), &["more than 4 bytes"]);
        std::fs::write(&path, [0xff, 0xfe]).unwrap();
        assert_refused(read_text(&path, 4), &["UTF-8"]);
    }
}
