//! Spans of time, and the last night of recordings: what `changes` and `coverage` mean by it.
//!
//! In: when recordings began and ended. Out: when the last night began.

/// When something began and ended, ns since 1970.
pub type Span = (i64, i64);

/// The smallest span that holds all of these; `None` of none.
pub fn whole(spans: impl IntoIterator<Item = Span>) -> Option<Span> {
    spans.into_iter().reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
}

/// A longer pause than this between two recordings ends a night, ns.
pub const PAUSE_NS: i64 = 6 * 3_600_000_000_000;
/// Without such a pause the last day counts as the night, ns.
const LONGEST_NIGHT_NS: i64 = 24 * 3_600_000_000_000;

/// When the last night began: at the first recording after the last long pause, but at the earliest
/// a day before `to_ns`, the end of the last recording. A recording is never divided, so the last
/// one may be longer than a day. `spans`: those of the recordings, by ascending begin.
///
/// A pause begins where the last of all recordings before it ends, since recordings of several
/// printheads overlap.
pub fn last_night(spans: &[Span], to_ns: i64) -> i64 {
    let earliest = to_ns.saturating_sub(LONGEST_NIGHT_NS);
    // the begin of the night that the recording belongs to, and the latest end so far
    let (mut begins, mut until) = (i64::MAX, i64::MIN);
    for (k, &(from, to)) in spans.iter().enumerate() {
        if k == 0 || from.saturating_sub(until) > PAUSE_NS || begins < earliest {
            begins = from;
        }
        until = until.max(to);
    }
    begins
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_night_begins_after_a_pause_or_a_day_before_its_end() {
        let hour = 3_600_000_000_000;
        let spans = |of: &[(i64, i64)]| -> Vec<(i64, i64)> {
            of.iter().map(|(from, to)| (from * hour, to * hour)).collect()
        };
        let nights = spans(&[(0, 2), (2, 3), (24, 26), (27, 28)]);
        assert_eq!(last_night(&nights, 28 * hour), 24 * hour);
        let always = spans(&[(0, 10), (10, 20), (20, 30), (30, 40)]);
        assert_eq!(last_night(&always, 40 * hour), 20 * hour);
        assert_eq!(last_night(&spans(&[(0, 90)]), 90 * hour), 0, "one recording is one night");
        let overlapping = spans(&[(10, 30), (11, 12), (26, 28)]);
        assert_eq!(last_night(&overlapping, 30 * hour), 10 * hour, "another is still on");
    }
}
