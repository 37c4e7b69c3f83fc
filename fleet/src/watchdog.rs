//! Notices that a job does not go on: its executors may hang, or there may be none.
use std::time::{Duration, Instant};

/// Bites if nothing has changed for as long as its patience lasts.
#[derive(Debug)]
pub struct Watchdog<T> {
    patience: Duration,
    /// What was seen last, and since when it is the same.
    seen: Option<T>,
    since: Instant,
}

impl<T: PartialEq> Watchdog<T> {
    pub fn new(patience: Duration, now: Instant) -> Watchdog<T> {
        Watchdog { patience, seen: None, since: now }
    }

    /// Whether the patience is over at `now`. `seen` is whatever changes while there is progress.
    pub fn bites(&mut self, seen: T, now: Instant) -> bool {
        if self.seen.as_ref() != Some(&seen) {
            (self.seen, self.since) = (Some(seen), now);
        }
        now.duration_since(self.since) >= self.patience
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_bites_once_nothing_has_changed_for_as_long_as_its_patience() {
        let start = Instant::now();
        let at = |s: u64| start + Duration::from_secs(s);
        let mut watchdog = Watchdog::new(Duration::from_secs(10), start);
        assert!(!watchdog.bites(0, at(0)) && !watchdog.bites(0, at(9)));
        assert!(!watchdog.bites(1, at(9)) && !watchdog.bites(1, at(18)));
        assert!(watchdog.bites(1, at(19)) && watchdog.bites(1, at(30)));
        assert!(!watchdog.bites(2, at(31)), "late progress is progress");
    }
}
