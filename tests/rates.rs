//! Rates over many seeds: what is found, named, left unnamed, and alarmed falsely, each against its bound. Minutes, so
//! `cargo test --release` leaves it out; CI runs it, too:
//!
//! ```sh
//! cargo test --release --test rates
//! ```

#[allow(dead_code, reason = "the tests of behaviour use the rest")]
mod house; // a fresh directory and the inkling command
#[allow(dead_code, reason = "the tests of behaviour use the rest")]
mod recorded; // bursts, recordings and tables: read, written, changed

mod chapter_4; // the thesis's tables on data of its form
mod goals; // rates, what chance makes of them, what they must reach

mod foreign; // another generator: healthy families and effects whose constants are not the critique's
mod healthy_heads; // healthy heads of other makes, with a slow part, in counts and in volts: nothing is found
mod open_world; // signals of no class, healthy channels of any shape, drifting heads: found, named, left unnamed
mod unnamed; // oscillators with what the catalogue does not hold: not given the name of its neighbour

use std::sync::atomic::{AtomicUsize, Ordering};

/// Does all of it on two threads.
fn on_two_threads<T: Sync>(all: &[T], work: impl Fn(&T) + Sync) {
    let next = AtomicUsize::new(0);
    let works = || {
        while let Some(one) = all.get(next.fetch_add(1, Ordering::Relaxed)) {
            work(one);
        }
    };
    std::thread::scope(|scope| {
        scope.spawn(works);
        works();
    });
}
