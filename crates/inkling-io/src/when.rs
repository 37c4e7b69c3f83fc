//! When a recording begins, by what most of its bursts say: their place in the order of recordings, and the day
//! under which results are laid out, rest on it. One burst of a clock that was not set yet must not move it.
//!
//! In: a recording. Out: the earliest time that lies among those of most bursts ([`begin`]); if most
//! cannot have been acquired when they say ([`is_misdated`]), that of their records. A few blocks, spread over the
//! file, are looked at.

use super::recording::Recording;
use inkling_core::burst::Acquisition;

/// How many blocks are looked at, unless all have to be read to know the file's channels.
const LOOKS: usize = 9;
/// How many messages a worker decodes at a time.
const MOST_ROWS: usize = 4096;
/// Most times that are kept. When there are more, every other one goes.
const MOST_TIMES: usize = 1 << 16;
/// Times count that lie no further from the median than so many median distances from it: of bursts that are
/// evenly spread the first lies two away.
const MOST_AWAY: u64 = 3;

const DAY_NS: i64 = 86_400_000_000_000;
/// 2010-01-01: MCAP is of 2022, so whatever is dated earlier was dated by a clock that nobody had set.
pub const YEAR_2010_NS: i64 = 1_262_304_000_000_000_000;

/// When a recording begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Begin {
    /// ns since 1970.
    pub t_ns: i64,
    /// Whether that is the time of the records, as those of the bursts cannot be; or whether neither can be.
    pub is_misdated: bool,
}

/// Whether a burst cannot have been acquired at `t_ns` if it was recorded at `logged_ns`: more than a day later, or by a
/// clock that nobody had set. Earlier is no mistake: a recorder may wait for the network, or copy an archive.
pub fn is_misdated(t_ns: i64, logged_ns: i64) -> bool {
    let lead_ns = t_ns.saturating_sub(logged_ns);
    logged_ns >= YEAR_2010_NS && (lead_ns > DAY_NS || t_ns < YEAR_2010_NS)
}

/// Whether a time, ns since 1970, lies ten years ahead of the clock here: so far behind that of the recordings no clock
/// is that somebody has set.
pub fn is_far_ahead(t_ns: i64) -> bool {
    let now_ns = chrono::Utc::now().timestamp_nanos_opt().unwrap_or(i64::MAX);
    t_ns > now_ns.saturating_add(10 * 365 * DAY_NS)
}

/// The earliest time of a usable burst that lies among those of most bursts, ns since 1970. `check` is called
/// before each block. `None`: there is no usable burst.
pub fn begin<E>(
    recording: &Recording,
    check: impl Fn() -> Result<(), E>,
) -> Result<Option<Begin>, E> {
    let blocks = recording.blocks().filter(Result::is_ok).count();
    let step = (blocks.saturating_sub(1) as f64 / (LOOKS - 1) as f64).max(1.0);
    let mut wanted = (0..LOOKS).map(|nth| (nth as f64 * step).round() as usize).peekable();
    let (mut reader, mut times) = (recording.reader(), Times::default());
    for (nth, block) in recording.blocks().filter_map(Result::ok).enumerate() {
        check()?;
        let is_wanted = wanted.next_if_eq(&nth).is_some();
        if !is_wanted && recording.channels_known_upfront {
            continue;
        }
        reader.load(&block);
        while let Some(piece) = reader.next_piece(MOST_ROWS) {
            for acquisition in &piece.acquisitions {
                if let Acquisition::Usable(burst) = acquisition {
                    times.add(burst.t_acq_ns, burst.logged_ns);
                }
            }
        }
    }
    Ok(times.begin())
}

/// Times, of which every so many-th is kept.
#[derive(Default)]
struct Times {
    /// Of bursts, and of their records.
    kept: Vec<(i64, i64)>,
    seen: usize,
    /// How often every other time went.
    halved: u32,
}

impl Times {
    fn add(&mut self, t_ns: i64, logged_ns: i64) {
        if self.seen.is_multiple_of(1 << self.halved) {
            self.kept.push((t_ns, logged_ns));
        }
        self.seen += 1;
        if self.kept.len() == MOST_TIMES {
            let mut nth = 0;
            self.kept.retain(|_| {
                nth += 1;
                nth % 2 == 1
            });
            self.halved += 1;
        }
    }

    fn begin(self) -> Option<Begin> {
        let misdated = self.kept.iter().filter(|(t_ns, logged_ns)| is_misdated(*t_ns, *logged_ns));
        let is_misdated = 2 * misdated.count() > self.kept.len();
        let (times, logged): (Vec<i64>, Vec<i64>) = self.kept.into_iter().unzip();
        let t_ns = first_of_most(if is_misdated { logged } else { times })?;
        Some(Begin { t_ns, is_misdated: is_misdated || is_far_ahead(t_ns) })
    }
}

fn first_of_most(mut times: Vec<i64>) -> Option<i64> {
    times.sort_unstable();
    let median = *times.get(times.len() / 2)?;
    let mut away: Vec<u64> = times.iter().map(|t| t.abs_diff(median)).collect();
    away.sort_unstable();
    let most = away[away.len() / 2].saturating_mul(MOST_AWAY);
    times.into_iter().find(|t| t.abs_diff(median) <= most)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_many_times_some_are_kept_from_begin_to_end() {
        let mut times = Times::default();
        (0..1_000_000).for_each(|t| times.add(t, t));
        assert!(times.kept.len() < MOST_TIMES);
        assert!(times.kept.last() > Some(&(990_000, 990_000)) && times.kept.is_sorted());
        assert_eq!(times.begin(), Some(Begin { t_ns: 0, is_misdated: false }));
    }

    #[test]
    fn bursts_that_cannot_have_been_acquired_then_count_as_of_their_records() {
        let recorded = 1_700_000_000_000_000_000;
        let begin = |t_ns: i64, logged_ns: i64| {
            let mut times = Times::default();
            (0..10).for_each(|k| times.add(t_ns + k, logged_ns + k));
            let begin = times.begin().unwrap();
            assert_eq!(begin.t_ns, if begin.is_misdated { logged_ns } else { t_ns });
            begin.is_misdated
        };
        let wrong = [300_000_000_000, recorded + 31 * DAY_NS, YEAR_2010_NS - DAY_NS, -1];
        assert!(wrong.into_iter().all(|t_ns| begin(t_ns, recorded)));
        // an archive, a clock in local time, and records without times
        assert!(
            !begin(recorded - 3000 * DAY_NS, recorded) && !begin(recorded + DAY_NS / 2, recorded)
        );
        assert!(begin(4_000_000_000_000_000_000, 4_000_000_000_000_000_000), "2096");
        assert!(!begin(recorded, 0) && !begin(300_000_000_000, 300_000_000_000));
    }
}
