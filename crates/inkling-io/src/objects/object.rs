//! An object read by offset, ahead of whoever reads.
//!
//! In: a name. Out: bytes at offsets, by requests for parts of one size. Where parts are read one after the other, those
//! that follow are asked for before they are needed, more and more at once up to a bound, so that the network
//! and not its delay limits the rate. All parts are of one state of the object: of another, reading fails.

use super::store::{CHANGED, Place, failed, runtime};
use super::transfer::stamp_of;
use crate::stamp::Stamp;
use bytes::Bytes;
use object_store::{GetOptions, GetRange, ObjectMeta, ObjectStore, ObjectStoreExt};
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::io::{self, ErrorKind};
use std::path::Path;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use tokio::task::AbortHandle;

const PART_BYTES: u64 = 4 << 20;
/// Parts that are asked for before they are needed.
const MOST_AHEAD: u64 = 6;
/// Parts kept: those ahead, those that several readers are at, the last for its summary.
const MOST_KEPT: usize = MOST_AHEAD as usize + 6;

#[derive(Debug)]
pub struct Object {
    place: Place,
    /// When it was opened.
    meta: ObjectMeta,
    parts: Arc<Parts>,
}

#[derive(Debug, Default)]
struct Parts {
    of: Mutex<PartCache>,
    arrived: Condvar,
}

/// The parts of an object that were read lately.
#[derive(Debug, Default)]
struct PartCache {
    parts: BTreeMap<u64, Kind>,
    /// The furthest part that was read, and how far ahead of it is asked.
    furthest: u64,
    ahead: u64,
}

#[derive(Debug)]
enum Kind {
    Coming(AbortHandle),
    Here(Bytes),
    Failed(ErrorKind, String),
}

impl Parts {
    fn lock(&self) -> MutexGuard<'_, PartCache> {
        self.of.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Object {
    pub fn open(path: &Path) -> io::Result<Object> {
        let place = Place::of(path)?;
        let meta = runtime()?.block_on(async { place.store.head(&place.key).await });
        Ok(Object { meta: meta.map_err(failed)?, place, parts: Arc::default() })
    }

    /// When it was opened.
    pub fn stamp_then(&self) -> Stamp {
        stamp_of(&self.meta)
    }

    /// As it is now; of another content, another stamp.
    pub fn stamp(&self) -> io::Result<Stamp> {
        let head = async { self.place.store.head(&self.place.key).await };
        let now = runtime()?.block_on(head).map_err(failed)?;
        let stamp = stamp_of(&now);
        let same = now.e_tag == self.meta.e_tag;
        Ok(if same { stamp } else { Stamp { modified_ns: None, ..stamp } })
    }

    /// Fills `buffer` from `offset`; an object that ends before is an error.
    pub fn read_at(&self, offset: u64, buffer: &mut [u8]) -> io::Result<()> {
        let end = offset.checked_add(buffer.len() as u64).filter(|&end| end <= self.meta.size);
        let end = end.ok_or(ErrorKind::UnexpectedEof)?;
        let (mut at, mut left) = (offset, buffer);
        while at < end {
            let bytes = self.part(at / PART_BYTES)?;
            let from = (at % PART_BYTES) as usize;
            let here = bytes.get(from..).unwrap_or_default();
            let n = here.len().min(left.len());
            if n == 0 {
                return Err(ErrorKind::UnexpectedEof.into());
            }
            let (now, later) = left.split_at_mut(n);
            now.copy_from_slice(&here[..n]);
            (at, left) = (at + n as u64, later);
        }
        Ok(())
    }

    /// A part's bytes; waits for them, which ends with the last try.
    fn part(&self, number: u64) -> io::Result<Bytes> {
        let mut kept = self.parts.lock();
        for wanted in kept.wanted(number, self.meta.size.div_ceil(PART_BYTES)) {
            if let Entry::Vacant(free) = kept.parts.entry(wanted) {
                free.insert(Kind::Coming(self.ask(wanted)?));
            }
        }
        kept.forget(number);
        self.parts.arrived.notify_all(); // somebody may wait for what was let go of
        loop {
            match kept.parts.get(&number) {
                Some(Kind::Here(bytes)) => return Ok(bytes.clone()),
                Some(Kind::Coming(_)) => {
                    let woken = self.parts.arrived.wait(kept);
                    kept = woken.unwrap_or_else(PoisonError::into_inner);
                }
                Some(Kind::Failed(kind, what)) => {
                    let e = io::Error::new(*kind, what.clone());
                    kept.parts.remove(&number); // asked for again, if anybody does
                    return Err(e);
                }
                None => {
                    // another reader's wishes took its place
                    let coming = self.ask(number)?;
                    kept.parts.insert(number, Kind::Coming(coming));
                }
            }
        }
    }

    fn ask(&self, number: u64) -> io::Result<AbortHandle> {
        let from = number * PART_BYTES;
        let to = (from + PART_BYTES).min(self.meta.size);
        let options = GetOptions {
            range: Some(GetRange::Bounded(from..to)),
            if_match: self.meta.e_tag.clone(),
            ..GetOptions::default()
        };
        let (Place { store, key, .. }, e_tag) = (self.place.clone(), self.meta.e_tag.clone());
        let parts = self.parts.clone();
        let task = runtime()?.spawn(async move {
            let got = async {
                let answer = store.get_opts(&key, options).await.map_err(failed)?;
                // a server that knows no conditions
                if answer.meta.e_tag != e_tag {
                    return Err(io::Error::new(ErrorKind::InvalidData, CHANGED));
                }
                answer.bytes().await.map_err(failed)
            };
            let part = match got.await {
                Ok(bytes) if bytes.len() as u64 == to - from => Kind::Here(bytes),
                Ok(_) => Kind::Failed(ErrorKind::InvalidData, CHANGED.into()),
                Err(e) => Kind::Failed(e.kind(), e.to_string()),
            };
            parts.lock().parts.insert(number, part);
            parts.arrived.notify_all();
        });
        Ok(task.abort_handle())
    }
}

impl PartCache {
    /// The part and those ahead of it.
    fn wanted(&mut self, number: u64, parts: u64) -> std::ops::Range<u64> {
        if number == self.furthest + 1 {
            self.ahead = (self.ahead * 2).clamp(1, MOST_AHEAD);
        } else if number.abs_diff(self.furthest) > MOST_AHEAD {
            self.ahead = 0;
        }
        let near = number.abs_diff(self.furthest) <= MOST_AHEAD;
        self.furthest = if near { self.furthest.max(number) } else { number };
        number..(number + 1 + self.ahead).min(parts).max(number + 1)
    }

    /// Lets go of what lies furthest from where it is read, bytes first.
    fn forget(&mut self, number: u64) {
        while self.parts.len() > MOST_KEPT {
            let behind = |n: u64| number.saturating_sub(n);
            let far = |n: u64| (behind(n), n.abs_diff(number));
            let Some(furthest) = self.parts.keys().copied().max_by_key(|&n| far(n)) else { return };
            if furthest == number {
                return;
            }
            if let Some(Kind::Coming(task)) = self.parts.remove(&furthest) {
                task.abort();
            }
        }
    }
}

impl Drop for Object {
    fn drop(&mut self) {
        for part in self.parts.lock().parts.values() {
            if let Kind::Coming(task) = part {
                task.abort();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_read_in_order_is_asked_for_ahead_and_what_is_not_is_not() {
        let mut kept = PartCache::default();
        let mut asked = Vec::new();
        for number in [0, 99, 0, 0, 1, 2, 3, 4, 3, 4, 50, 99] {
            let wanted = kept.wanted(number, 100);
            assert_eq!(wanted.start, number);
            asked.push(wanted.end - number - 1);
        }
        assert_eq!(asked, [0, 0, 0, 0, 1, 2, 4, 6, 6, 6, 0, 0]);
    }

    #[test]
    fn few_parts_are_kept_and_the_one_that_is_read_always() {
        let mut kept = PartCache::default();
        kept.parts.insert(999, Kind::Here(Bytes::new()));
        for number in 0..100 {
            kept.parts.insert(number, Kind::Here(Bytes::new()));
            kept.forget(number);
            assert!(kept.parts.len() <= MOST_KEPT && kept.parts.contains_key(&number));
        }
        assert!(kept.parts.contains_key(&999), "the end, with its summary, is read again");
    }
}
