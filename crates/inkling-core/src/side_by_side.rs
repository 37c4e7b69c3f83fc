//! Runs the same work for each of several things, by several threads at once, outside of the
//! pipeline's stages, and returns the results in the order of the things.

use std::num::NonZero;
use std::panic::resume_unwind;
use std::sync::{Mutex, PoisonError};
use std::thread::{self, ScopedJoinHandle};

pub fn cores() -> usize {
    thread::available_parallelism().map_or(1, NonZero::get)
}

/// Applies `each` to all of `of` by at most `workers` threads; with 0 or 1 of them the caller's does
/// the work. A panic in a thread becomes the caller's.
pub fn side_by_side<T: Send, R: Send>(
    workers: usize,
    of: Vec<T>,
    each: impl Fn(T) -> R + Sync,
) -> Vec<R> {
    let workers = workers.min(of.len());
    if workers <= 1 {
        return of.into_iter().map(each).collect();
    }

    // A thread that panicked does not spoil the iterator: a poisoned lock is used all the same.
    let left = Mutex::new(of.into_iter().enumerate());
    let next = || left.lock().unwrap_or_else(PoisonError::into_inner).next();
    let work = || -> Vec<(usize, R)> {
        std::iter::from_fn(next).map(|(place, of)| (place, each(of))).collect()
    };

    let mut done: Vec<(usize, R)> = thread::scope(|scope| {
        let running: Vec<_> = (0..workers).map(|_| scope.spawn(work)).collect();
        let join =
            |running: ScopedJoinHandle<_>| running.join().unwrap_or_else(|e| resume_unwind(e));
        running.into_iter().flat_map(join).collect()
    });
    done.sort_by_key(|(place, _)| *place);
    done.into_iter().map(|(_, result)| result).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_come_in_the_order_of_what_they_are_of() {
        for (workers, n) in [(0, 3), (1, 3), (2, 0), (2, 1), (3, 1000), (64, 5)] {
            let squares = side_by_side(workers, (0..n).collect(), |i: usize| i * i);
            assert_eq!(squares, (0..n).map(|i| i * i).collect::<Vec<_>>());
        }
    }

    #[test]
    fn a_panic_is_the_callers() {
        let odd = |i: i32| assert!(i % 2 == 0, "{i} is odd");
        assert!(std::panic::catch_unwind(|| side_by_side(2, vec![0, 1, 2, 4], odd)).is_err());
    }
}
