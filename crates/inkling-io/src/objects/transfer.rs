//! Handles whole objects of a store: stamps, lists, fetches, sends, removes and renames them.
//! Everything but recordings comes and goes this way; `stored.rs`, `part_file.rs`,
//! `regular_file.rs`, `inputs.rs` and `journal.rs` call it. All functions block until the store has
//! answered.

use super::store::{Place, failed, runtime};
use crate::stamp::Stamp;
use bytes::Bytes;
use futures_util::TryStreamExt;
use object_store::{MultipartUpload, ObjectMeta, ObjectStore, ObjectStoreExt};
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use tokio::task::{JoinError, JoinSet};

/// A larger object is sent in such parts (S3's multipart upload wants 5 MiB a part at least).
const PART_BYTES: usize = 8 << 20;
/// Parts on their way at once; with the bytes of a part this bounds the memory of sending.
const MOST_PARTS: usize = 3;

pub fn stamp_of(meta: &ObjectMeta) -> Stamp {
    Stamp { bytes: meta.size, modified_ns: meta.last_modified.timestamp_nanos_opt() }
}

pub fn stamp(path: &Path) -> io::Result<Stamp> {
    let Place { store, key, .. } = Place::of(path)?;
    let meta = runtime()?.block_on(async { store.head(&key).await }).map_err(failed)?;
    Ok(stamp_of(&meta))
}

/// The full names of all objects whose keys lie below a name, sorted.
pub fn list(path: &Path) -> io::Result<Vec<PathBuf>> {
    let Place { store, key, root } = Place::of(path)?;
    let below = (!key.as_ref().is_empty()).then_some(&key);
    let all = async {
        let name = |meta: ObjectMeta| PathBuf::from(format!("{root}/{}", meta.location));
        store.list(below).map_ok(name).try_collect::<Vec<PathBuf>>().await
    };
    let mut names = runtime()?.block_on(all).map_err(failed)?;
    names.sort_unstable();
    Ok(names)
}

/// A file without a name, on disk. It is gone with its last handle, even if the process is killed.
pub fn temporary() -> io::Result<File> {
    tempfile::tempfile()
}

/// Fetches an object into a temporary file, which is returned at its beginning.
pub fn fetch(path: &Path) -> io::Result<File> {
    let Place { store, key, .. } = Place::of(path)?;
    let mut file = temporary()?;
    runtime()?.block_on(async {
        let mut parts = store.get(&key).await.map_err(failed)?.into_stream();
        while let Some(part) = parts.try_next().await.map_err(failed)? {
            file.write_all(&part)?;
        }
        Ok::<_, io::Error>(())
    })?;
    file.seek(SeekFrom::Start(0))?;
    Ok(file)
}

/// Sends a whole file, whatever its position is. The object appears with the last request, or not at all.
pub fn send(file: &File, path: &Path) -> io::Result<()> {
    let Place { store, key, .. } = Place::of(path)?;
    let mut file = file.try_clone()?;
    file.seek(SeekFrom::Start(0))?;
    runtime()?.block_on(async {
        let first = next_part(&mut file)?;
        // a small object takes one request
        if first.len() < PART_BYTES {
            return store.put(&key, first.into()).await.map(drop).map_err(failed);
        }
        let mut upload = store.put_multipart(&key).await.map_err(failed)?;
        let sent = match send_parts(&mut *upload, first, &mut file).await {
            Ok(()) => upload.complete().await.map(drop).map_err(failed),
            e => e,
        };
        if sent.is_err() {
            let _ = upload.abort().await; // the first error is the one that is reported
        }
        sent
    })
}

fn next_part(file: &mut File) -> io::Result<Bytes> {
    let mut bytes = Vec::new();
    Read::by_ref(file).take(PART_BYTES as u64).read_to_end(&mut bytes)?;
    Ok(bytes.into())
}

async fn send_parts(
    upload: &mut dyn MultipartUpload,
    first: Bytes,
    file: &mut File,
) -> io::Result<()> {
    let arrived = |part: Result<object_store::Result<()>, JoinError>| match part {
        Ok(part) => part.map_err(failed),
        Err(e) => Err(io::Error::other(e)),
    };
    let mut under_way = JoinSet::new();
    let mut part = first;
    while !part.is_empty() {
        under_way.spawn(upload.put_part(part.into()));
        if under_way.len() >= MOST_PARTS
            && let Some(part) = under_way.join_next().await
        {
            arrived(part)?;
        }
        part = next_part(file)?;
    }
    while let Some(part) = under_way.join_next().await {
        arrived(part)?;
    }
    Ok(())
}

/// Removes an object. Whether it is an error that there is none depends on the store.
pub fn remove(path: &Path) -> io::Result<()> {
    let Place { store, key, .. } = Place::of(path)?;
    runtime()?.block_on(async { store.delete(&key).await }).map_err(failed)
}

/// Renames an object within its bucket, which stores do by a copy. `to` must lie in the same
/// bucket; its bucket is not looked at.
pub fn rename(from: &Path, to: &Path) -> io::Result<()> {
    let Place { store, key, .. } = Place::of(from)?;
    let to = Place::of(to)?.key;
    runtime()?.block_on(async { store.rename(&key, &to).await }).map_err(failed)
}
