//! Reads one object of a store by offset, and ahead of the reader. Recordings in a store are read
//! through it (`source.rs`).
//!
//! In: a name. Out: bytes at offsets, by requests for parts of 4 MiB. Where parts are read one
//! after the other, the following parts are asked for before they are needed. Their number doubles from
//! part to part (1, 2, 4, at most 6), so that the network's rate and not its delay limits the reading;
//! a jump sets it back to 0. (These sizes are heuristic.) A few parts that were read lately
//! are kept for other readers of the same recording.
//!
//! All parts are of one state of the object: if the object is changed meanwhile, reading fails,
//! because verdicts of two states must not be mixed. States are told apart by the tag (ETag) that
//! the server gives each of them. Where an S3 server gives no tag, a change is found once all is
//! read, by size and time of change (`Recording::changed`).

use super::store::{CHANGED, Place, failed, runtime};
use super::transfer::stamp_of;
use crate::stamp::Stamp;
use bytes::Bytes;
use futures_util::FutureExt;
use futures_util::future::{BoxFuture, Shared};
use object_store::{GetOptions, GetRange, ObjectMeta, ObjectStore, ObjectStoreExt};
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::io::{self, ErrorKind};
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use tokio::task::AbortHandle;

/// Bytes of one part, which is what one request asks for. Only the last part of an object is smaller.
const PART_BYTES: u64 = 4 << 20;
/// Most parts after the one that is read that are asked for before they are needed.
const MOST_AHEAD: u64 = 6;
/// Most parts that are kept, here or on their way: those ahead, those that several readers are at,
/// and the end of the recording with its summary, which is read again and again.
const MOST_KEPT: usize = MOST_AHEAD as usize + 6;

/// An object that was opened. Several threads may read it at once.
#[derive(Debug)]
pub struct Object {
    place: Place,
    /// What the server said of the object when it was opened.
    meta: ObjectMeta,
    parts: Mutex<PartCache>,
}

/// The parts that were read lately or are asked for, by their numbers in the object, from 0. This
/// type makes no request itself, so it can be tested without a server.
#[derive(Debug, Default)]
struct PartCache {
    parts: BTreeMap<u64, Request>,
    /// The highest number that was read since the last jump. A jump is a read that lies more than
    /// [`MOST_AHEAD`] parts off, in either direction.
    furthest: u64,
    /// How many parts after the one that is read are asked for, too. A read of the part after
    /// `furthest` doubles the number, from 1 up to [`MOST_AHEAD`]; a jump sets it to 0; other reads
    /// leave it as it is.
    ahead: u64,
}

#[derive(Debug)]
struct Request {
    task: AbortHandle,
    /// Any number of readers may wait for it.
    answer: Shared<BoxFuture<'static, Answer>>,
}

/// The whole part, or why the request's last try failed.
type Answer = Result<Bytes, (ErrorKind, String)>;

impl Request {
    fn begin(
        request: impl Future<Output = io::Result<Bytes>> + Send + 'static,
    ) -> io::Result<Request> {
        let task = runtime()?.spawn(request);
        let abort = task.abort_handle();
        let answer = task.map(|done| match done {
            Ok(answer) => answer.map_err(|e| (e.kind(), e.to_string())),
            // none is ended while somebody waits for it
            Err(_) => Err((ErrorKind::Other, "the request panicked".into())),
        });
        Ok(Request { task: abort, answer: answer.boxed().shared() })
    }
}

impl Object {
    pub fn open(path: &Path) -> io::Result<Object> {
        let place = Place::of(path)?;
        let meta = runtime()?.block_on(async { place.store.head(&place.key).await });
        Ok(Object { meta: meta.map_err(failed)?, place, parts: Mutex::default() })
    }

    /// The stamp that the object had when it was opened.
    pub fn stamp_then(&self) -> Stamp {
        stamp_of(&self.meta)
    }

    /// The stamp now; asks the server. If the tag is no longer that of the opened object, the stamp
    /// has no time, so that it differs from the first stamp even if size and time are the same.
    pub fn stamp(&self) -> io::Result<Stamp> {
        let head = async { self.place.store.head(&self.place.key).await };
        let now = runtime()?.block_on(head).map_err(failed)?;
        let stamp = stamp_of(&now);
        let same = now.e_tag == self.meta.e_tag;
        Ok(if same { stamp } else { Stamp { modified_ns: None, ..stamp } })
    }

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

    /// The bytes of one part; also asks for the parts ahead. It blocks until the part is here or
    /// its last try has failed ([`super::store`]).
    fn part(&self, number: u64) -> io::Result<Bytes> {
        let answer = runtime()?.block_on(self.asked(number)?);
        answer.map_err(|(kind, what)| io::Error::new(kind, what))
    }

    /// Asks for a part and for those ahead of it, where that was not done before; gives the answer
    /// to wait for.
    fn asked(&self, number: u64) -> io::Result<Shared<BoxFuture<'static, Answer>>> {
        // a thread that panicked while it held the lock has left whole entries
        let mut kept = self.parts.lock().unwrap_or_else(PoisonError::into_inner);
        // what a reader was told to have failed is asked for again
        kept.parts.retain(|_, request| !matches!(request.answer.peek(), Some(Err(_))));
        for wanted in kept.wanted(number, self.meta.size.div_ceil(PART_BYTES)) {
            if let Entry::Vacant(free) = kept.parts.entry(wanted) {
                free.insert(self.ask(wanted)?);
            }
        }
        kept.forget(number);
        Ok(kept.parts[&number].answer.clone())
    }

    /// Begins the request for a part, on the condition that the object's tag has not changed.
    fn ask(&self, number: u64) -> io::Result<Request> {
        let from = number * PART_BYTES;
        let to = (from + PART_BYTES).min(self.meta.size);
        let options = GetOptions {
            range: Some(GetRange::Bounded(from..to)),
            if_match: self.meta.e_tag.clone(),
            ..GetOptions::default()
        };
        let (Place { store, key, .. }, e_tag) = (self.place.clone(), self.meta.e_tag.clone());
        Request::begin(async move {
            let changed = || io::Error::new(ErrorKind::InvalidData, CHANGED);
            let answer = store.get_opts(&key, options).await.map_err(failed)?;
            // a server that knows no conditions may send another state all the same
            if answer.meta.e_tag != e_tag {
                return Err(changed());
            }
            let bytes = answer.bytes().await.map_err(failed)?;
            if bytes.len() as u64 == to - from { Ok(bytes) } else { Err(changed()) }
        })
    }
}

impl PartCache {
    /// Notes that part `number` is read, of an object of `parts` parts.
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

    /// Lets go of parts until [`MOST_KEPT`] are left: first those before part `number`, which is
    /// being read, then those after it, each the furthest first. A request under way goes on for whoever waits for it.
    fn forget(&mut self, number: u64) {
        let before = |n: u64| number.saturating_sub(n); // 0 for those after it
        let far = |n: &u64| (before(*n), n.abs_diff(number));
        while self.parts.len() > MOST_KEPT
            && let Some(furthest) = self.parts.keys().copied().max_by_key(far)
        {
            self.parts.remove(&furthest);
        }
    }
}

/// Requests that nobody waits for any more are ended.
impl Drop for Object {
    fn drop(&mut self) {
        let kept = self.parts.get_mut().unwrap_or_else(PoisonError::into_inner);
        kept.parts.values().for_each(|request| request.task.abort());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_request_that_panics_has_failed() {
        let panics = Request::begin(async { panic!("a test's own panic") }).unwrap();
        let answer = runtime().unwrap().block_on(panics.answer);
        assert!(matches!(answer, Err((ErrorKind::Other, _))));
    }

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
        let here = || Request::begin(async { Ok(Bytes::new()) }).unwrap();
        kept.parts.insert(999, here());
        for number in 0..100 {
            kept.parts.insert(number, here());
            kept.forget(number);
            assert!(kept.parts.len() <= MOST_KEPT && kept.parts.contains_key(&number));
        }
        assert!(kept.parts.contains_key(&999), "the end, with its summary, is read again");
    }
}
