//! The times at which converted bursts begin.
//!
//! In: from `conversion`, for each burst the time that the table gives it, if any, and its length;
//! from the options the start of the first burst and the time between bursts. Out: t_a of each
//! burst, ns since the epoch.
//!
//! There are three cases ([`BurstClock::next`]). Times of 1979 and later are taken as they are,
//! unless options say otherwise. With `--every` bursts begin that far apart. Else times count from
//! the first burst, and a burst that would begin before an earlier one of its printhead ends (as with times that
//! start at 0 again) is put after that one; a burst without a time is put after all.

use chrono::{DateTime, NaiveDate};
use std::collections::HashMap;
use std::sync::Arc;

/// Times up to here (year 2200) leave room in i64 nanoseconds.
const LATEST_NS: f64 = 7.258e18;
/// Times from here on (1979) are taken for times since the epoch, ns.
const ABSOLUTE_NS: f64 = 3e17;
/// 2025-01-01T08:00:00Z
const SOME_START_NS: i64 = 1_735_718_400_000_000_000;

#[derive(Default)]
pub struct BurstClock {
    /// Time of the first burst by `--start`, ns since the epoch, and time between bursts by
    /// `--every`, ns; `None`: the option is not given.
    start_ns: Option<i64>,
    every_ns: Option<f64>,
    /// Time of the first burst as the table has it: ns, and what is added to them.
    first_ns: Option<(i64, f64)>,
    /// Number of bursts that have got a time.
    given: u64,
    /// End of each printhead's bursts so far, from the start of the first one, ns.
    free_from_ns: HashMap<Arc<str>, f64>,
    /// Number of bursts that were put after one before them of their printhead, against their own time.
    pub moved: usize,
    /// Number of bursts without a time of their own.
    untimed: u64,
    /// The latest time that was taken as since the epoch, ns.
    pub latest_ns: Option<i64>,
}

impl BurstClock {
    /// Begins anew, by the options `--start` and `--every`; what is told of earlier bursts stays.
    pub fn start_at(&mut self, start_ns: Option<i64>, every_s: Option<f64>) {
        let BurstClock { moved, untimed, latest_ns, .. } = *self;
        let every_ns = every_s.map(|s| s * 1e9);
        let first = BurstClock { start_ns, every_ns, ..BurstClock::default() };
        *self = BurstClock { moved, untimed, latest_ns, ..first };
    }

    /// The time of the next burst, ns since the epoch; `None` if it is not between 1970 and 2200. `time_ns`:
    /// its time as the table has it, ns and what is added to them; `length_ns`, `period_ns`: durations of the burst and
    /// of one sample.
    pub fn next(
        &mut self,
        printhead: &Arc<str>,
        time_ns: Option<(i64, f64)>,
        length_ns: f64,
        period_ns: f64,
    ) -> Option<i64> {
        let (first_ns, first_after) = *self.first_ns.get_or_insert(time_ns.unwrap_or_default());
        let number = self.given as f64;
        self.given += 1;
        self.untimed += u64::from(time_ns.is_none());

        // 1. a time since the epoch, unless the options say when bursts begin
        if let (None, Some((ns, after)), None) = (self.every_ns, time_ns, self.start_ns)
            && is_absolute((first_ns, first_after))
        {
            let time_ns = later(ns, after);
            self.latest_ns = self.latest_ns.max(time_ns);
            return time_ns;
        }
        let start_ns = self.start_ns.unwrap_or(SOME_START_NS);

        // 2. evenly spaced bursts
        if let Some(every_ns) = self.every_ns {
            return later(start_ns, number * every_ns);
        }

        // 3. a time from the first burst, or after the burst before
        let after_first =
            |(ns, after): (i64, f64)| ns.saturating_sub(first_ns) as f64 + (after - first_after);
        let own = time_ns.map_or(f64::NEG_INFINITY, after_first);
        // a millionth of a sample period is tolerated: it keeps bursts in place that follow each
        // other without a gap, whose times are rounded; the first burst begins at 0, even without a
        // time
        let counts = |of: &Arc<str>| time_ns.is_none() || of == printhead;
        let ends = self.free_from_ns.iter().filter(|(of, _)| counts(of)).map(|(_, ns)| *ns);
        let free_from_ns = ends.fold(f64::NEG_INFINITY, f64::max);
        let begins = match own < free_from_ns - 1e-6 * period_ns {
            true => free_from_ns,
            false if time_ns.is_none() => 0.0,
            false => own,
        };
        self.moved += usize::from(time_ns.is_some() && begins != own);
        self.free_from_ns.insert(printhead.clone(), begins + length_ns);
        later(start_ns, begins)
    }

    /// Whether a burst has a time of its own since the epoch and the first one has none, or the other way round, and
    /// these times are to say when bursts begin.
    pub fn mixes(&self, time_ns: Option<(i64, f64)>) -> bool {
        let first_ns = self.first_ns.filter(|_| self.every_ns.is_none());
        first_ns.is_some_and(|first| is_absolute(first) != is_absolute(time_ns.unwrap_or_default()))
    }

    /// Whether nothing gave the time of the first burst.
    pub fn invented(&self) -> bool {
        self.start_ns.is_none() && self.latest_ns.is_none() && self.given > 0
    }

    /// Whether bursts follow each other without a gap because nothing gave their times.
    pub fn in_a_row(&self) -> bool {
        self.every_ns.is_none() && self.untimed > 1
    }
}

/// Whether a time of a table, ns and what is added to them, is taken for one since the epoch.
fn is_absolute((ns, after): (i64, f64)) -> bool {
    ns as f64 + after >= ABSOLUTE_NS
}

/// Whether a time, ns since the epoch, is between 1970 and 2200.
pub fn is_representable(ns: i64) -> bool {
    (0.0..LATEST_NS).contains(&(ns as f64))
}

/// `start_ns + after_ns`; `None` if that is not between 1970 and 2200.
fn later(start_ns: i64, after_ns: f64) -> Option<i64> {
    let good = (0.0..LATEST_NS).contains(&(start_ns as f64 + after_ns));
    good.then(|| start_ns + after_ns.round() as i64)
}

/// A date and time in a file's name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TimeInName {
    /// UTC, ns since the epoch.
    pub ns: i64,
    /// The name without the time, or the whole name if there is nothing else in it.
    pub without: String,
}

/// The first date and time in a file's name, UTC unless it names a zone: `20261101T080000`, `2026-11-01_08-00-00`,
/// `20261101T080000+0100`, `20261101`. `None`: there is none. It is looked for at the begin of each run of digits.
pub fn time_in_name(name: &str) -> Option<TimeInName> {
    let starts = name.char_indices().filter(|(_, c)| c.is_ascii_digit()).map(|(at, _)| at);
    starts.filter(|at| !name[..*at].ends_with(|c: char| c.is_ascii_digit())).find_map(|at| {
        let (ns, rest) = date_time(&name.as_bytes()[at..])?;
        // what is left of the name before and after the time, without the characters that separated
        // it
        let between = |c: char| "-_. ".contains(c);
        let (before, after) = (&name[..at], &name[name.len() - rest.len()..]);
        let parts = [before.trim_end_matches(between), after.trim_matches(between)];
        let parts: Vec<&str> = parts.into_iter().filter(|part| !part.is_empty()).collect();
        let without = if parts.is_empty() { name.to_owned() } else { parts.join("_") };
        Some(TimeInName { ns, without })
    })
}

/// A date and time at the beginning of `text`, ns, and the text after it. A missing time of day is
/// midnight, missing seconds are 0. Two digits after the date are an hour only if minutes follow:
/// else they are left in the text, as the number of a file (`20261101_03`). `None`: there is no
/// date there.
fn date_time(text: &[u8]) -> Option<(i64, &[u8])> {
    // takes exactly `n` digits off a text, and before them one of `separators` if there is one;
    // `None`: there are no such digits
    fn digits<'a>(text: &'a [u8], n: usize, separators: &[u8]) -> Option<(u32, &'a [u8])> {
        let text = match text {
            [first, rest @ ..] if separators.contains(first) => rest,
            _ => text,
        };
        let (digits, rest) = text.split_at_checked(n)?;
        let digits = std::str::from_utf8(digits).ok()?;
        let is_number = digits.bytes().all(|b| b.is_ascii_digit());
        Some((digits.parse().ok().filter(|_| is_number)?, rest))
    }
    let (year, text) = digits(text, 4, b"")?;
    let (month, text) = digits(text, 2, b"-_.")?;
    let (day, text) = digits(text, 2, b"-_.")?;
    let date = NaiveDate::from_ymd_opt(year as i32, month, day)?;
    let time = || {
        let (hour, text) = digits(text, 2, b"T_- t")?;
        let (minute, text) = digits(text, 2, b"-_:.")?;
        let Some((second, text)) = digits(text, 2, b"-_:.") else {
            return Some(([hour, minute, 0, 0], text));
        };
        // three, six or nine digits behind the seconds are parts of a second; three behind _ or - may number files
        let behind = match text {
            [b'.' | b',' | b'_' | b'-', rest @ ..] => rest,
            _ => text,
        };
        let n = behind.iter().take_while(|c| c.is_ascii_digit()).count();
        let may_number = n == 3 && matches!(text, [b'_' | b'-', ..]);
        let parts = digits(behind, n, b"").filter(|_| [3, 6, 9].contains(&n) && !may_number);
        let (parts, text) = parts.unwrap_or((0, text));
        Some(([hour, minute, second, parts * 10u32.pow(9 - (n as u32).min(9))], text))
    };
    let ([hour, minute, second, parts], text) = time().unwrap_or(([0; 4], text));
    let at: DateTime<chrono::Utc> = date.and_hms_nano_opt(hour, minute, second, parts)?.and_utc();
    let ns = at.timestamp_nanos_opt().filter(|ns| is_representable(*ns))?;
    let (ahead_ns, text) = zone(text);
    Some((ns - ahead_ns, text))
}

/// How far the zone is ahead of UTC, ns, that is named at the beginning of `text`, such as Z, +0100 or -05:30, and the
/// text after it.
fn zone(text: &[u8]) -> (i64, &[u8]) {
    if let Some(rest) = text.strip_prefix(b"Z") {
        return (0, rest);
    }
    let digits = |from: usize| -> Option<i64> {
        let two = text.get(from..from + 2)?;
        two.iter().all(u8::is_ascii_digit).then(|| str::from_utf8(two).ok()?.parse().ok())?
    };
    let sign = match text.first() {
        Some(b'+') => 1,
        Some(b'-') => -1,
        _ => return (0, text),
    };
    let colon = usize::from(text.get(3) == Some(&b':'));
    let ends = |at: usize| !text.get(at).is_some_and(u8::is_ascii_digit);
    match (digits(1), digits(3 + colon)) {
        (Some(hours @ ..=14), Some(minutes @ (0 | 30 | 45))) if ends(5 + colon) => {
            (sign * (60 * hours + minutes) * 60_000_000_000, &text[5 + colon..])
        }
        _ => (0, text),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn begun(start_ns: Option<i64>, every_s: Option<f64>) -> BurstClock {
        let mut clock = BurstClock::default();
        clock.start_at(start_ns, every_s);
        clock
    }

    #[test]
    fn bursts_of_other_printheads_may_overlap_where_they_have_a_time() {
        let mut clock = begun(Some(0), None);
        let bursts = [("A", Some(0.0)), ("A", Some(20.0)), ("B", Some(0.0)), ("B", Some(5.0))];
        let untimed = [("A", None), ("B", None)];
        let mut next = |(head, ns): (&str, Option<f64>)| {
            clock.next(&head.into(), ns.map(|ns| (0, ns)), 10.0, 1.0).unwrap()
        };
        assert_eq!(bursts.map(&mut next), [0, 20, 0, 10]);
        assert_eq!(untimed.map(&mut next), [30, 40]);
        assert_eq!(clock.moved, 1);
    }

    #[test]
    fn times_are_found_in_names() {
        let at = |text: &str| {
            DateTime::parse_from_rfc3339(text).ok().and_then(|t| t.timestamp_nanos_opt())
        };
        for (name, time, without) in [
            ("K1_20261101T080003", "2026-11-01T08:00:03Z", "K1"),
            ("K1_20261101T080003123", "2026-11-01T08:00:03.123Z", "K1"),
            ("K1_20261101T080003.250", "2026-11-01T08:00:03.25Z", "K1"),
            ("K1_2026-11-01_08-00-03_250000", "2026-11-01T08:00:03.25Z", "K1"),
            ("K1_20261101T080003_250", "2026-11-01T08:00:03Z", "K1_250"),
            ("2026-11-01_08-00-03 night", "2026-11-01T08:00:03Z", "night"),
            ("run12_2026-11-01T08:00", "2026-11-01T08:00:00Z", "run12"),
            ("head 20261101", "2026-11-01T00:00:00Z", "head"),
            ("K1-20261101T080003Z-cold", "2026-11-01T08:00:03Z", "K1_cold"),
            ("20261101", "2026-11-01T00:00:00Z", "20261101"),
            ("K1_20261101_03", "2026-11-01T00:00:00Z", "K1_03"),
            ("20261101T080003+0100 K1", "2026-11-01T07:00:03Z", "K1"),
            ("K1_20261101T080003-05:30", "2026-11-01T13:30:03Z", "K1"),
            ("K1_20261101T080003-0012", "2026-11-01T08:00:03Z", "K1_0012"),
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
