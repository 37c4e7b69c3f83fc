//! When converted bursts began.
//!
//! In: what a table says of each, and where the first stands. Out: ns since the epoch. Times beyond 1979 are
//! taken as they are; others count from the first burst. A burst that would begin before an earlier one ends
//! (times that start at 0 again) follows it.

use chrono::{DateTime, NaiveDate};

/// Times up to here (year 2200) leave room in i64 nanoseconds.
pub const LATEST_NS: f64 = 7.258e18;
/// Since the epoch; from there on times are no more counted from anything else: 1979. ns.
const ABSOLUTE_NS: f64 = 3e17;
/// 2025-01-01T08:00:00Z
const SOME_START_NS: i64 = 1_735_718_400_000_000_000;

#[derive(Default)]
pub struct BurstClock {
    start_ns: Option<i64>,
    every_ns: Option<f64>,
    /// Time of the first burst, as written; of bursts given out.
    first_ns: Option<f64>,
    given: u64,
    free_from_ns: f64,
    /// Bursts that were put after the one before them.
    pub moved: usize,
    /// Bursts without a time of their own.
    untimed: u64,
    absolute: bool,
}

impl BurstClock {
    pub fn new(start_ns: Option<i64>, every_s: Option<f64>) -> BurstClock {
        let (every_ns, free_from_ns) = (every_s.map(|s| s * 1e9), f64::NEG_INFINITY);
        BurstClock { start_ns, every_ns, free_from_ns, ..BurstClock::default() }
    }

    /// The next burst: when it began, as written, and how long it and one of its samples are, ns.
    /// `None`: beyond what is understood.
    pub fn next(&mut self, time_ns: Option<f64>, length_ns: f64, period_ns: f64) -> Option<i64> {
        let first_ns = *self.first_ns.get_or_insert(time_ns.unwrap_or(0.0));
        let number = self.given as f64;
        self.given += 1;
        self.untimed += u64::from(time_ns.is_none());
        if let (None, Some(t), None) = (self.every_ns, time_ns, self.start_ns)
            && first_ns >= ABSOLUTE_NS
        {
            self.absolute = true;
            return later(0, t);
        }
        let start_ns = self.start_ns.unwrap_or(SOME_START_NS);
        if let Some(every_ns) = self.every_ns {
            return later(start_ns, number * every_ns);
        }
        let own = time_ns.map_or(f64::NEG_INFINITY, |t| t - first_ns);
        // a hair below: bursts that follow each other without a gap stay where they are
        let begins = match own < self.free_from_ns - 1e-6 * period_ns {
            true => self.free_from_ns,
            false if time_ns.is_none() => 0.0,
            false => own,
        };
        self.moved += usize::from(time_ns.is_some() && begins != own);
        self.free_from_ns = begins + length_ns;
        later(start_ns, begins)
    }

    /// Nothing said when the first burst was.
    pub fn invented(&self) -> bool {
        self.start_ns.is_none() && !self.absolute && self.given > 0
    }

    /// Nothing said when a burst was after the one before it.
    pub fn in_a_row(&self) -> bool {
        self.every_ns.is_none() && self.untimed > 1
    }
}

fn later(start_ns: i64, after_ns: f64) -> Option<i64> {
    let good = (0.0..LATEST_NS).contains(&(start_ns as f64 + after_ns));
    good.then(|| start_ns + after_ns.round() as i64)
}

/// A date and time in a file's name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TimeInName {
    /// UTC, since the epoch.
    pub ns: i64,
    /// The name without it, or whole where nothing else is in it.
    pub without: String,
}

/// The first date and time in a file's name, UTC: `20261101T080000`, `2026-11-01_08-00-00`, `20261101`.
pub fn time_in_name(name: &str) -> Option<TimeInName> {
    let starts = name.char_indices().filter(|(_, c)| c.is_ascii_digit()).map(|(at, _)| at);
    starts.filter(|at| !name[..*at].ends_with(|c: char| c.is_ascii_digit())).find_map(|at| {
        let (ns, rest) = date_time(&name.as_bytes()[at..])?;
        let between = |c: char| "-_. ".contains(c);
        let (before, after) = (&name[..at], &name[name.len() - rest.len()..]);
        let parts = [before.trim_end_matches(between), after.trim_matches(between)];
        let parts: Vec<&str> = parts.into_iter().filter(|part| !part.is_empty()).collect();
        let without = if parts.is_empty() { name.to_owned() } else { parts.join("_") };
        Some(TimeInName { ns, without })
    })
}

/// And what stands behind it.
fn date_time(mut text: &[u8]) -> Option<(i64, &[u8])> {
    let mut digits = |n: usize, separators: &[u8]| -> Option<u32> {
        if let [first, rest @ ..] = text
            && separators.contains(first)
        {
            text = rest;
        }
        let (number, rest) = text.split_at_checked(n)?;
        let number =
            std::str::from_utf8(number).ok().filter(|n| n.bytes().all(|b| b.is_ascii_digit()));
        let number = number?.parse().ok()?;
        text = rest;
        Some(number)
    };
    let (year, month, day) = (digits(4, b"")?, digits(2, b"-_.")?, digits(2, b"-_.")?);
    let date = NaiveDate::from_ymd_opt(year as i32, month, day)?;
    let mut time = || Some([digits(2, b"T_- t")?, digits(2, b"-_:.")?]);
    let [hour, minute] = time().unwrap_or([0, 0]);
    let second = digits(2, b"-_:.").unwrap_or(0);
    let at: DateTime<chrono::Utc> = date.and_hms_opt(hour, minute, second)?.and_utc();
    let ns = at.timestamp_nanos_opt().filter(|ns| (0.0..LATEST_NS).contains(&(*ns as f64)))?;
    // after the seconds a zone that is UTC
    Some((ns, text.strip_prefix(b"Z").unwrap_or(text)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn starts(clock: &mut BurstClock, times_s: &[f64], length_s: f64) -> Option<Vec<i64>> {
        let length_ns = length_s * 1e9;
        times_s.iter().map(|t| clock.next(Some(*t * 1e9), length_ns, length_ns / 10.0)).collect()
    }

    #[test]
    fn bursts_stand_where_the_table_has_them_or_follow_each_other() {
        let mut clock = BurstClock::new(Some(5_000), None);
        let at = starts(&mut clock, &[0.007, 0.1, 0.11], 0.01).unwrap();
        assert_eq!((at, clock.moved), (vec![5_000, 93_005_000, 103_005_000], 0));
        let mut clock = BurstClock::new(Some(0), None);
        let at = starts(&mut clock, &[0.0, 0.0, 3.0], 10.0).unwrap();
        assert_eq!((at, clock.moved), (vec![0, 10_000_000_000, 20_000_000_000], 2));
        assert!(starts(&mut BurstClock::new(Some(0), None), &[0.0, 1e12], 1.0).is_none());
    }

    #[test]
    fn late_times_are_utc_and_every_counts_from_the_start() {
        let mut clock = BurstClock::new(None, None);
        let at = starts(&mut clock, &[1.7e9, 1.7e9 + 0.5], 1.0).unwrap();
        assert_eq!(at, [1_700_000_000_000_000_000, 1_700_000_000_500_000_000]);
        let mut clock = BurstClock::new(Some(7), Some(0.5));
        let at: Vec<_> = (0..3).map(|_| clock.next(None, 1e9, 1e6).unwrap()).collect();
        assert_eq!(at, [7, 500_000_007, 1_000_000_007]);
        let mut clock = BurstClock::new(Some(7), None);
        let at: Vec<_> = (0..2).map(|_| clock.next(None, 1e9, 1e6).unwrap()).collect();
        assert_eq!((at, clock.moved), (vec![7, 1_000_000_007], 0));
    }

    #[test]
    fn times_are_found_in_names() {
        let at = |text: &str| {
            DateTime::parse_from_rfc3339(text).ok().and_then(|t| t.timestamp_nanos_opt())
        };
        for (name, time, without) in [
            ("K1_20261101T080003", "2026-11-01T08:00:03Z", "K1"),
            ("2026-11-01_08-00-03 night", "2026-11-01T08:00:03Z", "night"),
            ("run12_2026-11-01T08:00", "2026-11-01T08:00:00Z", "run12"),
            ("head 20261101", "2026-11-01T00:00:00Z", "head"),
            ("K1-20261101T080003Z-cold", "2026-11-01T08:00:03Z", "K1_cold"),
            ("20261101", "2026-11-01T00:00:00Z", "20261101"),
        ] {
            let found = time_in_name(name).unwrap();
            assert_eq!((Some(found.ns), &*found.without), (at(time), without), "{name}");
            assert!(at(time).is_some());
        }
        for name in ["night", "12345", "99999999", "20261301", ""] {
            assert_eq!(time_in_name(name), None, "{name}");
        }
    }
}
