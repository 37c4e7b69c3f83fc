//! Times of a decay before they are put on a grid: what period they have, and what is wrong with them.
//!
//! In, from `sampling.rs`: a decay. Out: its sample period ([`fitted_period`], [`median_step`]); or a sentence that
//! refuses times that do not increase ([`check`]) or lack rows ([`check_gaps`]), and says what to do.

use super::segments;
use super::table_file::Decay;
use super::time_column::{has_word_for_time, is_time};
use inkling_core::model::median::median_of;

/// How far a time may lie from the regular grid, in sample periods.
pub(super) const MOST_OFF_GRID: f64 = 0.03;
pub(super) const FEWEST_SAMPLES: usize = 4;
/// How far a step may lie from a whole number of sample periods, in these, where rows are missing.
pub(super) const MOST_OFF_STEP: f64 = 0.1;
/// So many periods tell one better than the usual step does, however times were rounded.
const PERIODS_OF_ONE: f64 = 16.0;

/// The column of times.
#[derive(Clone, Copy, Debug)]
pub struct TimeColumn<'a> {
    pub name: &'a str,
    /// The unit of its times, s.
    pub unit_s: f64,
}

impl TimeColumn<'_> {
    /// What to do about times with too few digits: their rows are samples one after the other.
    pub(super) fn by_rows(self, decay: &Decay) -> String {
        let TimeColumn { name, unit_s } = self;
        let mean = segments::mean_step(&decay.times);
        let mean =
            mean.map_or(String::new(), |mean| format!(" {} (about)", rounded(mean * unit_s)));
        let and = match has_word_for_time(name) {
            true => String::new(),
            false => format!(" with --time {name:?}"),
        };
        format!(
            "--period-s{mean}{and} takes rows as samples one after the other, so many seconds apart"
        )
    }
}

/// Refuses a decay that is too short, whose times do not increase, or whose times are so large that
/// f64 cannot hold steps of 3 % of a period.
pub(super) fn check(decay: &Decay, time: TimeColumn) -> Result<(), String> {
    let (times, n) = (&decay.times, decay.times.len());
    if n < FEWEST_SAMPLES {
        return Err(format!("{n} samples; a decay needs {FEWEST_SAMPLES} at least"));
    }
    if let Some(k) = (1..n).find(|&k| times[k] <= times[k - 1]) {
        return Err(not_increasing(decay, k, time));
    }
    let (last, step) = (times[n - 1].abs(), median_step(times));
    let rounding = last * f64::EPSILON;
    if rounding > MOST_OFF_GRID * step {
        return Err(format!(
            "times such as {last} are numbers that hold steps of {} at best, not those of {} between samples: {}; or \
             write times since the decay began",
            rounded(rounding),
            rounded(step),
            time.by_rows(decay)
        ));
    }
    Ok(())
}

/// Why the time of row `k`, from 0, may not be greater than that of the row before.
fn not_increasing(decay: &Decay, k: usize, time: TimeColumn) -> String {
    let [before, after] = [k - 1, k].map(|k| decay.time(k).unwrap_or_default());
    let (name, n) = (time.name, decay.times.len());
    match (segments::rows_of_each(&decay.times), segments::standing(&decay.times)) {
        (Some(rows), _) => format!(
            "each time of {name:?} stands in {rows} rows: if they are of several channels, give each channel a column of its \
             own; if one follows the other, {}",
            time.by_rows(decay)
        ),
        (None, 0) if before == after => format!(
            "rows {k} and {} have one time in {name:?}, {after}: remove one of them, or name the column that tells decays \
             apart with --burst",
            k + 1
        ),
        (None, 0) if is_one_swap(&decay.times, k) => format!(
            "{name:?}: its rows {k} and {} are out of order, {before} and then {after}: sort the rows by it",
            k + 1
        ),
        (None, 0) if is_time(name) => format!(
            "{name:?} does not increase at its row {}: {after} after {before}; sort the rows, or name \
             the column that tells decays apart with --burst (time: --time)",
            k + 1
        ),
        (None, 0) => format!(
            "{name:?}, which is not called time, does not increase at its row {}: {after} after {before}; where no column \
             is of times, --period-s says how far apart rows are; else --time names it, or --burst one that tells decays \
             apart",
            k + 1
        ),
        (None, again) => format!(
            "{name:?} has too few digits: {again} of its {n} times are those of the row before, such as {after}; {}",
            time.by_rows(decay)
        ),
    }
}

/// Whether times increase, but for row `k` and the one before, of which each stands in the other's place.
fn is_one_swap(times: &[f64], k: usize) -> bool {
    let mut times = times.to_vec();
    times.swap(k - 1, k);
    times.is_sorted_by(|a, b| a < b)
}

/// The sample period of regular times, in their unit: the slope of the times t_k over their numbers
/// k by least squares, sum (k - mean k)(t_k - mean t) / sum (k - mean k)^2, so that the rounding of
/// written times averages out.
pub(super) fn fitted_period(times: &[f64]) -> f64 {
    let n = times.len() as f64;
    let (mean_k, mean_t) = ((n - 1.0) / 2.0, times.iter().sum::<f64>() / n);
    let (mut kt, mut kk) = (0.0, 0.0);
    for (k, t) in times.iter().enumerate() {
        let k = k as f64 - mean_k;
        kt += k * (t - mean_t);
        kk += k * k;
    }
    kt / kk
}

/// The sample period of times with gaps: the median step, refined. If every step is (to 0.1) a
/// multiple of the median step, or of the period of the times before it, each time t has a number k on a grid from the
/// first time on, and the period is sum k (t - t_0) / sum k^2 (least squares). If not, the times are irregular, and
/// the median step itself is given.
pub(super) fn median_step(times: &[f64]) -> f64 {
    let step = median_of(times.windows(2).map(|w| w[1] - w[0]));
    let (mut kt, mut kk) = (0.0, 0.0);
    let mut k = 0.0;
    for pair in times.windows(2) {
        let period = if k > PERIODS_OF_ONE { kt / kk } else { step };
        let steps = ((pair[1] - pair[0]) / period).round();
        if ((pair[1] - pair[0]) / period - steps).abs() > MOST_OFF_STEP {
            return step; // no multiple of the period: the times are irregular
        }
        k += steps;
        kt += k * (pair[1] - times[0]);
        kk += k * k;
    }
    if kk > 0.0 { kt / kk } else { step }
}

/// Refuses times that lie on a grid except for missing rows, and says where rows are missing.
pub(super) fn check_gaps(decay: &Decay) -> Result<(), String> {
    const MOST_TOLD: usize = 3;
    let times = &decay.times;
    let period = median_step(times);
    let (mut gaps, mut count, mut longest, mut k) = (Vec::new(), 0, 0.0_f64, 0.0);
    for (at, pair) in times.windows(2).enumerate() {
        let steps = ((pair[1] - pair[0]) / period).round();
        k += steps;
        // twice the usual distance, because the period is estimated from the same times (heuristic)
        if steps < 1.0 || ((pair[1] - times[0]) / period - k).abs() > 2.0 * MOST_OFF_GRID {
            return Ok(());
        }
        if steps > 1.0 {
            count += steps as usize - 1;
            longest = longest.max(steps);
            gaps.extend(decay.time(at));
        }
    }
    if count == 0 || segments::are_rounded(decay) {
        return Ok(());
    }
    let told: Vec<String> = gaps.iter().take(MOST_TOLD).map(|t| format!("after t = {t}")).collect();
    let more = match gaps.len().saturating_sub(MOST_TOLD) {
        0 => String::new(),
        more => format!(" and at {more} more places"),
    };
    let samples = if count == 1 { "sample" } else { "samples" };
    // what lies between acquisitions was not sampled: none of it may be interpolated
    let are_equal = gaps.len() > 1 && segments::length(times, 1.5).is_some();
    let of_two = "needs a table of its own, or a column that --burst names";
    let advice = match are_equal || count > times.len() {
        true => format!("if acquisitions end there, each {of_two}"),
        false if longest > segments::FEWEST_STEPS => format!(
            "if acquisitions end there, each {of_two}; if not, --resample draws a curve through what was not measured"
        ),
        false => "--resample interpolates them".to_owned(),
    };
    let (told, period) = (told.join(", "), rounded(period));
    Err(format!("{count} {samples} missing {told}{more} of times every {period}; {advice}"))
}

/// A number with six significant digits, for errors.
pub(super) fn rounded(x: f64) -> f64 {
    format!("{x:.5e}").parse().unwrap_or(x)
}
