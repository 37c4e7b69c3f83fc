//! Reads one object of a store by offset, and ahead of the reader. Recordings in a store are read
//! through it (`source.rs`).
//!
//! In: a name. Out: bytes at offsets, by requests for parts of 4 MiB. Where parts are read one
//! after the other, the following parts are asked for before they are needed. How many doubles from
//! part to part, 1, 2, 4, up to 6, so that the network's rate and not its delay limits the reading;
//! a jump begins again with none. (These sizes are heuristic.) A few parts that were read lately
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
use object_store::{GetOptions, GetRange, ObjectMeta, ObjectStore, ObjectStoreExt};
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::io::{self, ErrorKind};
use std::panic::AssertUnwindSafe;
use std::path::Path;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use tokio::task::{self, AbortHandle};

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
    /// Shared with the tasks that fetch the parts.
    parts: Arc<Parts>,
}

/// The parts, and how readers wait for a part that is on its way.
#[derive(Debug, Default)]
struct Parts {
    cache: Mutex<PartCache>,
    /// Wakes all waiting readers after a part arrived, failed or was let go of.
    arrived: Condvar,
}

/// The parts of an object that were read lately or are asked for, by their numbers in the object,
/// from 0. This type decides which parts to ask for and which to let go of; it makes no request
/// itself, so it can be tested without a server.
#[derive(Debug, Default)]
struct PartCache {
    parts: BTreeMap<u64, Fetch>,
    /// The highest number that was read since the last jump. A jump is a read that lies more than
    /// [`MOST_AHEAD`] parts off, in either direction.
    furthest: u64,
    /// How many parts after the one that is read are asked for, too. A read of the part after
    /// `furthest` doubles the number, from 1 up to [`MOST_AHEAD`]; a jump sets it to 0; other reads
    /// leave it as it is.
    ahead: u64,
}

/// What has become of the request for a part.
#[derive(Debug)]
enum Fetch {
    /// The request is under way; the handle can end it.
    Coming(AbortHandle),
    /// The request gave the whole part.
    Here(Bytes),
    /// The request's last try failed.
    Failed(ErrorKind, String),
}

impl Parts {
    /// Locks the cache. A thread that panicked while it held the lock has left whole entries, so
    /// its panic is ignored.
    fn lock(&self) -> MutexGuard<'_, PartCache> {
        self.cache.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Begins a request in a task of its own. The task puts the answer into the cache as part
    /// `number`, unless that part was let go of meanwhile, and wakes the readers. The caller holds
    /// the lock of the cache until it has put the handle there.
    fn begin(
        self: &Arc<Self>,
        number: u64,
        request: impl Future<Output = io::Result<Bytes>> + Send + 'static,
    ) -> io::Result<AbortHandle> {
        let parts = self.clone();
        let task = runtime()?.spawn(async move {
            // a panic becomes an answer, too: without one, readers would wait for ever
            let part = match AssertUnwindSafe(request).catch_unwind().await {
                Ok(Ok(bytes)) => Fetch::Here(bytes),
                Ok(Err(e)) => Fetch::Failed(e.kind(), e.to_string()),
                Err(_) => Fetch::Failed(ErrorKind::Other, "the request panicked".into()),
            };
            // only the task whose handle is in the cache may answer; a later request may have
            // replaced it
            if let Some(kept) = parts.lock().parts.get_mut(&number)
                && matches!(kept, Fetch::Coming(of) if of.id() == task::id())
            {
                *kept = part;
            }
            parts.arrived.notify_all();
        });
        Ok(task.abort_handle())
    }
}

impl Object {
    /// Asks for the object's size and state.
    pub fn open(path: &Path) -> io::Result<Object> {
        let place = Place::of(path)?;
        let meta = runtime()?.block_on(async { place.store.head(&place.key).await });
        Ok(Object { meta: meta.map_err(failed)?, place, parts: Arc::default() })
    }

    /// The object's size and time of change when it was opened.
    pub fn stamp_then(&self) -> Stamp {
        stamp_of(&self.meta)
    }

    /// The object's size and time of change now; asks the server. If the tag is another one than
    /// when the object was opened, so is the content: then the stamp has no time, so that it
    /// differs from the first stamp even if size and time are the same.
    pub fn stamp(&self) -> io::Result<Stamp> {
        let head = async { self.place.store.head(&self.place.key).await };
        let now = runtime()?.block_on(head).map_err(failed)?;
        let stamp = stamp_of(&now);
        let same = now.e_tag == self.meta.e_tag;
        Ok(if same { stamp } else { Stamp { modified_ns: None, ..stamp } })
    }

    /// Fills `buffer` with the bytes from `offset` on.
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

    /// The bytes of one part; also asks for the parts ahead of it. It blocks until the part is here
    /// or its last try has failed; how long tries go on is set in [`super::store`]. If the part is
    /// let go of meanwhile, because other readers want other parts, it is asked for anew, with all
    /// of its tries.
    fn part(&self, number: u64) -> io::Result<Bytes> {
        let mut kept = self.parts.lock();
        for wanted in kept.wanted(number, self.meta.size.div_ceil(PART_BYTES)) {
            if let Entry::Vacant(free) = kept.parts.entry(wanted) {
                free.insert(Fetch::Coming(self.ask(wanted)?));
            }
        }
        kept.forget(number);
        self.parts.arrived.notify_all(); // somebody may wait for what was let go of

        // wait until the answer is there; waiting releases the lock
        loop {
            match kept.parts.get(&number) {
                Some(Fetch::Here(bytes)) => return Ok(bytes.clone()),
                Some(Fetch::Coming(_)) => {
                    let woken = self.parts.arrived.wait(kept);
                    kept = woken.unwrap_or_else(PoisonError::into_inner);
                }
                Some(Fetch::Failed(kind, what)) => {
                    let e = io::Error::new(*kind, what.clone());
                    kept.parts.remove(&number); // asked for again, if anybody does
                    return Err(e);
                }
                None => {
                    // the part was let go of for another reader's parts
                    let coming = self.ask(number)?;
                    kept.parts.insert(number, Fetch::Coming(coming));
                }
            }
        }
    }

    /// Begins the request for a part, on the condition that the object still has the tag that it
    /// had when it was opened.
    fn ask(&self, number: u64) -> io::Result<AbortHandle> {
        let from = number * PART_BYTES;
        let to = (from + PART_BYTES).min(self.meta.size);
        let options = GetOptions {
            range: Some(GetRange::Bounded(from..to)),
            if_match: self.meta.e_tag.clone(),
            ..GetOptions::default()
        };
        let (Place { store, key, .. }, e_tag) = (self.place.clone(), self.meta.e_tag.clone());
        self.parts.begin(number, async move {
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

    /// Lets go of parts until [`MOST_KEPT`] are left. First go those before part `number`, which is
    /// being read, the furthest first (readers go forwards); then those after it, again the
    /// furthest first. Requests that are under way are ended.
    fn forget(&mut self, number: u64) {
        while self.parts.len() > MOST_KEPT {
            let before = |n: u64| number.saturating_sub(n); // 0 for those after it
            let far = |n: u64| (before(n), n.abs_diff(number));
            let Some(furthest) = self.parts.keys().copied().max_by_key(|&n| far(n)) else { return };
            if furthest == number {
                return;
            }
            if let Some(Fetch::Coming(task)) = self.parts.remove(&furthest) {
                task.abort();
            }
        }
    }
}

/// Requests that nobody waits for any more are ended.
impl Drop for Object {
    fn drop(&mut self) {
        for part in self.parts.lock().parts.values() {
            if let Fetch::Coming(task) = part {
                task.abort();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use futures_util::future::pending;

    /// Waits until part `number` is no longer coming, and says whether its request failed.
    fn has_failed(parts: &Parts, number: u64) -> bool {
        let is_coming =
            |kept: &mut PartCache| matches!(kept.parts.get(&number), Some(Fetch::Coming(_)));
        let limit = std::time::Duration::from_secs(10);
        let (kept, _) = parts.arrived.wait_timeout_while(parts.lock(), limit, is_coming).unwrap();
        matches!(kept.parts.get(&number), Some(Fetch::Failed(..)))
    }

    #[test]
    fn a_request_that_panics_has_failed() {
        let parts = Arc::new(Parts::default());
        let mut kept = parts.lock();
        let coming = parts.begin(7, async { panic!("a test's own panic") }).unwrap();
        kept.parts.insert(7, Fetch::Coming(coming));
        drop(kept);
        assert!(has_failed(&parts, 7));
    }

    #[test]
    fn the_answer_to_a_request_that_was_let_go_of_is_dropped() {
        let parts = Arc::new(Parts::default());
        let mut kept = parts.lock();
        let lost = || io::Error::from(ErrorKind::ConnectionReset);
        let before = parts.begin(7, async move { Err(lost()) }).unwrap();
        let gone = parts.begin(8, async move { Err(lost()) }).unwrap();
        let newer = parts.begin(7, pending()).unwrap();
        kept.parts.insert(7, Fetch::Coming(newer.clone()));
        drop(kept);
        while !(before.is_finished() && gone.is_finished()) {
            std::thread::yield_now();
        }
        let kept = parts.lock();
        assert!(matches!(kept.parts.get(&7), Some(Fetch::Coming(of)) if of.id() == newer.id()));
        assert!(!kept.parts.contains_key(&8));
        newer.abort();
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
        kept.parts.insert(999, Fetch::Here(Bytes::new()));
        for number in 0..100 {
            kept.parts.insert(number, Fetch::Here(Bytes::new()));
            kept.forget(number);
            assert!(kept.parts.len() <= MOST_KEPT && kept.parts.contains_key(&number));
        }
        assert!(kept.parts.contains_key(&999), "the end, with its summary, is read again");
    }
}
