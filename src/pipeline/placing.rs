//! Places a printhead's healthy windows burst by burst, in the order of the bursts' times.
//!
//! In: times of bursts. Out: windows, half-open spans of time of the length `identify.first`. The first begins
//! with the first burst, others begin every so often after it (`identify.every`). After a pause, and so after a
//! stray timestamp, windows begin anew with the first burst.
//!
//! A pause is told by bins: time is divided into spans of `every_ns` from time 0 on, and there was a pause if at
//! least one whole bin holds no burst. So only the first and last burst of each bin matter, which is all that
//! [`super::two_passes`] knows.

use super::{PipelineError, Result};

#[derive(Debug)]
pub struct Placing {
    first_ns: i64,
    /// Time from the begin of a window to that of the next, ns; 0: there is only one window.
    every_ns: i64,
    /// The stretch of time since the last pause; `None`: there was no burst yet.
    run: Option<Run>,
    /// Number of windows placed so far; one printhead may have half of the model numbers that there are.
    windows: usize,
}

#[derive(Debug)]
struct Run {
    /// Number of the last bin that held a burst; bins are spans of `every_ns` from time 0 on.
    bin: i64,
    /// Begin of the next window; `None`: it would lie beyond the end of time, or there is only one window.
    next_ns: Option<i64>,
}

impl Placing {
    pub fn new(first_ns: i64, every_ns: i64) -> Placing {
        Placing { first_ns, every_ns, run: None, windows: 0 }
    }

    pub fn bin(&self, t_ns: i64) -> i64 {
        if self.every_ns > 0 { t_ns.div_euclid(self.every_ns) } else { 0 }
    }

    /// Whether windows begin anew with a burst of that time: it is the first, or the bin before it is empty.
    pub fn begins_at(&self, t_ns: i64) -> bool {
        self.run.as_ref().is_none_or(|run| self.bin(t_ns) > run.bin + 1)
    }

    /// Takes the next burst's time, and calls `place` with the begin and end, ns, of every window that begins up
    /// to that time. An error if there are more windows than one printhead may have models.
    pub fn reach(&mut self, t_ns: i64, mut place: impl FnMut(i64, i64)) -> Result<()> {
        let (bin, begins) = (self.bin(t_ns), self.begins_at(t_ns));
        let run = match &mut self.run {
            Some(run) if !begins => run,
            run => run.insert(Run { bin, next_ns: Some(t_ns) }),
        };
        run.bin = run.bin.max(bin);

        // all windows up to here, also those in which no burst lies
        while let Some(from_ns) = run.next_ns.filter(|&next| next <= t_ns) {
            self.windows += 1;
            let (windows, most) = (self.windows as u64, u64::from(u16::MAX) / 2);
            if windows > most {
                return Err(PipelineError::TooManyWindows { windows, most });
            }
            place(from_ns, from_ns.saturating_add(self.first_ns));
            let next = from_ns.checked_add(self.every_ns);
            run.next_ns = next.filter(|_| self.every_ns > 0);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn windows(times: &[i64], first_ns: i64, every_ns: i64) -> Vec<(i64, i64)> {
        let mut placing = Placing::new(first_ns, every_ns);
        let mut windows = Vec::new();
        for &t in times {
            placing.reach(t, |from, to| windows.push((from, to))).unwrap();
        }
        windows
    }

    #[test]
    fn windows_go_on_and_begin_anew_after_a_pause() {
        assert_eq!(windows(&[3, 4, 9], 5, 0), [(3, 8)]);
        assert_eq!(windows(&[3, 12, 14, 24, 31], 5, 10), [(3, 8), (13, 18), (23, 28)]);
        // no burst lies in the bin from 20 to 29, which is a pause: 5 begins the
        // first windows, 31 those after it
        assert_eq!(windows(&[5, 19, 31, 32, 43], 5, 10), [(5, 10), (15, 20), (31, 36), (41, 46)]);
        // a window that holds no burst counts as well
        assert_eq!(windows(&[0, 9, 19], 2, 10), [(0, 2), (10, 12)]);
        assert_eq!(windows(&[i64::MIN, i64::MAX - 1], 5, 10).len(), 2);
    }

    #[test]
    fn only_what_comes_after_a_pause_begins_anew() {
        let mut placing = Placing::new(5, 10);
        assert!(placing.begins_at(3));
        placing.reach(3, |_, _| {}).unwrap();
        assert!(!placing.begins_at(4) && !placing.begins_at(19) && placing.begins_at(20));
        // a burst that is late by a little begins nothing anew
        assert!(!placing.begins_at(-1));
    }
}
