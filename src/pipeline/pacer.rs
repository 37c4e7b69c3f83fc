//! Decides when bursts are handed on (`--pace`): at the recorded speed, or at a number of signals
//! per second.
//!
//! In: batches in the file's order, from the reader stage, which has one worker then ([`Pacer::wait_for`]).
//! Out: the reader is held until the batch is due; at the end, how far it was ever behind. At the recorded
//! speed a batch is due as long after the first burst as its latest burst was acquired after the earliest burst
//! of the first batch, less any time by which bursts are dated apart (`JUMP_NS`); at S signals per second, when
//! n / S seconds have passed, n signals being before it.
//!
//! A batch is one burst while the reader keeps the pace, and more while it is late, since larger batches cost
//! less.

use super::batches::{MOST_ROWS, usable};
use super::numbers::JUMP_NS;
use super::{Control, Result};
use crate::settings::Pace;
use inkling_core::burst::SignalBatch;
use std::time::{Duration, Instant};

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PaceReport {
    /// Number of bursts that were handed on at the pace.
    pub bursts: u64,
    /// The longest time by which a batch was handed on late.
    pub behind: Duration,
}

#[derive(Debug, Default)]
pub struct Pacer {
    pace: Pace,
    started: Option<Instant>,
    /// The latest t_a of the batch before, ns; in the first batch, the earliest.
    before_ns: Option<i64>,
    /// Recorded time that has passed since the first burst, ns.
    passed_ns: i64,
    /// Number of signals so far.
    signals: u64,
    /// Least number of rows of the next piece of a block: 1, which one burst has; more while the reader is late.
    pub rows: usize,
    pub kept: PaceReport,
}

impl Pacer {
    pub fn new(pace: Pace) -> Pacer {
        Pacer { pace, rows: 1, ..Pacer::default() }
    }

    /// When a batch is due, from when the first batch was handed on; counts the batch's signals. `None`: the
    /// pace is the recorded one and no burst of the batch has a time.
    fn due(&mut self, batch: &SignalBatch) -> Option<Duration> {
        let before = self.signals;
        self.signals += batch.rows() as u64;
        if let Pace::Signals(per_s) = self.pace {
            return Duration::try_from_secs_f64(before as f64 / per_s).ok();
        }
        let times = batch.acquisitions.iter().filter_map(usable).map(|burst| burst.t_acq_ns);
        let (first, last) = (times.clone().min()?, times.max()?);
        let passed = last.saturating_sub(self.before_ns.replace(last).unwrap_or(first));
        if passed.saturating_abs() <= JUMP_NS {
            self.passed_ns = self.passed_ns.saturating_add(passed);
        }
        Some(Duration::from_nanos(self.passed_ns.max(0) as u64))
    }

    pub fn wait_for(&mut self, batch: &SignalBatch, control: &Control) -> Result<()> {
        self.kept.bursts += batch.acquisitions.len() as u64;
        let Some(due) = self.due(batch) else { return Ok(()) };
        let started = *self.started.get_or_insert_with(Instant::now);
        let mut is_late = true;
        loop {
            control.check()?;
            let now = started.elapsed();
            if now >= due {
                self.kept.behind = self.kept.behind.max(now - due);
                // who is late hands on more at once, to catch up
                self.rows = if is_late { (2 * self.rows).min(MOST_ROWS) } else { 1 };
                return Ok(());
            }
            is_late = false;
            std::thread::sleep((due - now).min(Duration::from_millis(100)));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use inkling_core::burst::{Acquisition, Burst, Format, Layout, Place};

    fn batch(t_ns: i64, channels: usize) -> SignalBatch {
        let signals = vec![vec![0.0; 2]; channels];
        let burst = Burst::of(&signals, 1e-6, Format::S16Le, Layout::ChannelMajor);
        let burst = Burst { t_acq_ns: t_ns, ..burst };
        let place = Place { block: 0, piece: 0 };
        SignalBatch { place, acquisitions: vec![Acquisition::Usable(burst)] }
    }

    #[test]
    fn each_burst_is_due_when_it_was_recorded_or_when_so_many_signals_were_before_it() {
        let times = [5_000_000_000, 5_250_000_000, 5_100_000_000, 9_000_000_000];
        let due = |pace| {
            let mut pacer = Pacer::new(pace);
            times.map(|t| pacer.due(&batch(t, 50)).unwrap().as_millis())
        };
        // a burst that stands in the file after a later one is due at once
        assert_eq!(due(Pace::Recorded), [0, 250, 100, 4000]);
        assert_eq!(due(Pace::Signals(100.0)), [0, 500, 1000, 1500]);

        // nobody waits for the year 2100, nor for the way back
        let mut pacer = Pacer::new(Pace::Recorded);
        let strays = [5_000_000_000, 4_102_444_800_000_000_000, 6_000_000_000, 7_000_000_000];
        let due = strays.map(|t| pacer.due(&batch(t, 50)).unwrap().as_millis());
        assert_eq!(due, [0, 0, 0, 1000]);
    }

    #[test]
    fn a_burst_waits_for_its_time_and_who_is_late_hands_on_more_at_once() {
        let (mut pacer, control) = (Pacer::new(Pace::Recorded), Control::default());
        pacer.wait_for(&batch(0, 1), &control).unwrap();
        let began = pacer.started.unwrap();
        pacer.wait_for(&batch(30_000_000, 1), &control).unwrap();
        assert!(began.elapsed() >= Duration::from_millis(30), "handed on before its time");
        assert_eq!((pacer.rows, pacer.kept.bursts), (1, 2));
        pacer.started = began.checked_sub(Duration::from_secs(1));
        pacer.wait_for(&batch(40_000_000, 1), &control).unwrap();
        pacer.wait_for(&batch(50_000_000, 1), &control).unwrap();
        assert_eq!(pacer.rows, 4);
        assert!(pacer.kept.behind >= Duration::from_millis(900));
    }
}
