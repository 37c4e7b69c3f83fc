//! Puts decays that others recorded on a regular grid of times, for tables whose rows are samples.
//!
//! In, from `src/cli/convert`: the decays of a table, with times in the table's unit. Out:
//! [`Sampled`], with every decay on one common sample period. A table that is not regularly sampled
//! is refused with where and how irregular it is, unless resampling is asked for.
//!
//! Without resampling: each decay's period is the least-squares slope of its times
//! (`fitted_period`); all periods must agree to 1e-3; the median is the common period; then each
//! time must lie within 3 % of a period from a regular grid (`as_written`). So times written with
//! few digits (33 and 34 ms for 1/30 s) are regular. With resampling: the period is the usual step
//! (`median_step`), unless steps differ by rounding, and each output is interpolated by a natural cubic
//! spline through the samples that are there (`resampled`). Before either, exports of several acquisitions
//! in one table are cut
//! (`segments.rs`).

use super::segments;
use super::spline::Spline;
use super::table_file::Decay;
use super::time_column::has_word_for_time;
use inkling_core::model::median::median;

/// How far a time may lie from the regular grid, in sample periods.
const MOST_OFF_GRID: f64 = 0.03;
/// How much the sample period of a decay may differ from the table's median period, relative.
const MOST_PERIOD_DIFFERENCE: f64 = 1e-3;
/// Most samples of one signal that a recording may hold.
pub const MOST_SAMPLES: usize = 65_536;
const FEWEST_SAMPLES: usize = 4;

/// Decays on one sample period, and what had to be done for that.
#[derive(Clone, Debug, Default)]
pub struct Sampled {
    /// Sample period, in the unit of the table's times.
    pub period: f64,
    pub decays: Vec<Decay>,
    /// Largest distance of a written time from the grid, in sample periods.
    pub most_off_grid: f64,
    /// How many samples were interpolated, because none was written near their time.
    pub interpolated: usize,
    /// How many cells were missing, or not numbers.
    pub missing: usize,
    /// How many decays were cut out of longer ones.
    pub segments: usize,
}

impl Sampled {
    /// Adds what had to be done for another table.
    pub fn add(&mut self, other: &Sampled) {
        self.most_off_grid = self.most_off_grid.max(other.most_off_grid);
        self.interpolated += other.interpolated;
        self.missing += other.missing;
        self.segments += other.segments;
    }
}

/// The column of times.
#[derive(Clone, Copy, Debug)]
pub struct TimeColumn<'a> {
    pub name: &'a str,
    /// The unit of its times, s.
    pub unit_s: f64,
}

impl TimeColumn<'_> {
    /// What to do about times with too few digits: their rows are samples one after the other.
    fn by_rows(self, decay: &Decay) -> String {
        let (TimeColumn { name, unit_s }, times) = (self, &decay.times);
        let last = times.len().saturating_sub(1);
        let mean = (times[last] - times[0]) / last as f64 * unit_s;
        let mean = if mean > 0.0 { format!(" {}", rounded(mean)) } else { String::new() };
        let and = match has_word_for_time(name) {
            true => String::new(),
            false => format!(" with --time {name:?}"),
        };
        format!(
            "--period-s{mean}{and} takes rows as samples one after the other, so many seconds apart"
        )
    }
}

pub fn sample(decays: Vec<Decay>, time: TimeColumn, resample: bool) -> Result<Sampled, String> {
    let (decays, segments) = segments::cut(decays);
    decays.iter().try_for_each(|decay| check(decay, time))?;
    let period = |decay: &Decay| match resample && !segments::are_rounded(decay) {
        true => median_step(&decay.times),
        false => fitted_period(&decay.times),
    };
    let periods: Vec<f64> = decays.iter().map(period).collect();
    // A decay that lacks rows is told before periods are compared, since its fitted one is none.
    let lacking = |decay: &Decay| missing(decay).map(|what| refused(decay, what));
    if !resample && let Some(refusal) = decays.iter().find_map(lacking) {
        return Err(refusal);
    }

    // the common period; without resampling, all decays must already have it
    let common = median(&mut periods.clone());
    let differs = |own: f64| (own / common - 1.0).abs() > MOST_PERIOD_DIFFERENCE;
    let other = decays.iter().zip(&periods).find(|(_, own)| !resample && differs(**own));
    if let Some((decay, own)) = other {
        let (own, common) = (rounded(*own), rounded(common));
        let what = format!("sampled every {own} time units, others every {common}");
        return Err(refused(decay, format!("{what}; --resample puts all on one sample period")));
    }

    let mut sampled =
        Sampled { period: common, missing: cells_missing(&decays), segments, ..Sampled::default() };
    for decay in decays {
        let regular = match resample {
            true => resampled(decay, common, &mut sampled)?,
            false => as_written(decay, common, time, &mut sampled)?,
        };
        sampled.decays.push(regular);
    }
    Ok(sampled)
}

/// The decays of a table whose rows count as samples one after the other; of their times only gaps between
/// acquisitions count.
pub fn as_listed(decays: Vec<Decay>) -> Result<Sampled, String> {
    let (decays, segments) = segments::cut(decays);
    decays.iter().try_for_each(|decay| too_long(decay, decay.times.len()))?;
    let missing = cells_missing(&decays);
    Ok(Sampled { period: 1.0, missing, decays, segments, ..Sampled::default() })
}

fn grid(start: f64, period: f64, samples: usize) -> Vec<f64> {
    (0..samples).map(|k| start + k as f64 * period).collect()
}

fn refused(decay: &Decay, what: String) -> String {
    match decay.name.as_str() {
        "" => format!("the table: {what}"),
        name => format!("burst {name:?} (from line {}): {what}", decay.line),
    }
}

/// Refuses a decay that is too short, whose times do not increase, or whose times are so large that
/// f64 cannot hold steps of 3 % of a period. `time`: the name of the column of times.
fn check(decay: &Decay, time: TimeColumn) -> Result<(), String> {
    let n = decay.times.len();
    if n < FEWEST_SAMPLES {
        let what = format!("{n} samples; a decay needs {FEWEST_SAMPLES} at least");
        return Err(refused(decay, what));
    }

    if let Some(k) = (1..n).find(|&k| decay.times[k] <= decay.times[k - 1]) {
        let [before, after] = [k - 1, k].map(|k| decay.time(k).unwrap_or_default());
        let name = time.name;
        if let Some(rows) = segments::rows_of_each(&decay.times) {
            let what = format!(
                "each time of {name:?} stands in {rows} rows: keep one row of each time, with a column for each channel"
            );
            return Err(refused(decay, what));
        }
        let again = segments::standing(&decay.times);
        if again > 0 {
            let what = format!(
                "{name:?} has too few digits: {again} of its {n} times are those of the row before, such as \
                 {after}; {}",
                time.by_rows(decay)
            );
            return Err(refused(decay, what));
        }
        let what = format!(
            "{name:?} does not increase at its row {}: {after} after {before}; sort the rows, or name \
             the column that tells decays apart with --burst (time: --time)",
            k + 1
        );
        return Err(refused(decay, what));
    }

    let (last, step) = (decay.times[n - 1].abs(), median_step(&decay.times));
    let rounding = last * f64::EPSILON;
    if rounding > MOST_OFF_GRID * step {
        let what = format!(
            "times such as {last} are numbers that hold steps of {} at best, not those of {} between samples: {}; or \
             write times since the decay began",
            rounded(rounding),
            rounded(step),
            time.by_rows(decay)
        );
        return Err(refused(decay, what));
    }
    Ok(())
}

/// How many cells have no value. A signal with such a cell cannot be judged, unless the cell is interpolated.
fn cells_missing(decays: &[Decay]) -> usize {
    decays.iter().flat_map(|d| &d.outputs).flatten().filter(|y| y.is_nan()).count()
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
/// multiple of the median step, each time t has a number k on a grid from the first time on, and
/// the period is sum k (t - t_0) / sum k^2 (least squares). If not, the times are irregular, and
/// the median step itself is given.
fn median_step(times: &[f64]) -> f64 {
    let mut steps: Vec<f64> = times.windows(2).map(|w| w[1] - w[0]).collect();
    let step = median(&mut steps);
    let (mut kt, mut kk) = (0.0, 0.0);
    let mut k = 0.0;
    for pair in times.windows(2) {
        let steps = ((pair[1] - pair[0]) / step).round();
        if ((pair[1] - pair[0]) / step - steps).abs() > 0.1 {
            return step; // no multiple of the usual step: the times are irregular
        }
        k += steps;
        kt += k * (pair[1] - times[0]);
        kk += k * k;
    }
    if kk > 0.0 { kt / kk } else { step }
}

/// A decay whose samples stay as they are, moved to the nearest regular grid of this period.
fn as_written(
    decay: Decay,
    period: f64,
    time: TimeColumn,
    so_far: &mut Sampled,
) -> Result<Decay, String> {
    let n = decay.times.len();
    // the grid has the same mean as the times, so that no rounding of the first time shifts it
    let centre = decay.times.iter().sum::<f64>() / n as f64;
    let start = centre - period * (n as f64 - 1.0) / 2.0;
    let off = |k: usize| (decay.times[k] - start) / period - k as f64;
    let (mut worst, mut uneven) = (0, 0);
    for k in 0..n {
        if off(k).abs() > off(worst).abs() {
            worst = k;
        }
        uneven += usize::from(off(k).abs() > MOST_OFF_GRID);
    }

    if off(worst).abs() > MOST_OFF_GRID {
        let steps = decay.times.windows(2).map(|w| w[1] - w[0]);
        let (least, most) =
            steps.fold((f64::INFINITY, 0.0_f64), |(l, m), step| (l.min(step), m.max(step)));
        let (least, most) = (rounded(least), rounded(most));
        if segments::are_rounded(&decay) {
            let by_rows = time.by_rows(&decay);
            let what =
                format!("times with too few digits: steps from {least} to {most}; {by_rows}");
            return Err(refused(&decay, what));
        }
        let what = format!(
            "irregular sampling: steps from {least} to {most}; {uneven} of {n} times lie more than \
             {MOST_OFF_GRID} of a period from a regular grid, furthest {} (its row {}, {:.2} periods \
             off); --resample interpolates to a regular one",
            decay.time(worst).unwrap_or_default(),
            worst + 1,
            off(worst)
        );
        return Err(refused(&decay, what));
    }
    too_long(&decay, n)?;
    so_far.most_off_grid = so_far.most_off_grid.max(off(worst).abs());
    Ok(Decay { times: grid(start, period, n), ..decay })
}

/// Says in words where rows are missing, if the times lie on a grid except for missing rows.
fn missing(decay: &Decay) -> Option<String> {
    const MOST_TOLD: usize = 3;
    let times = &decay.times;
    let period = median_step(times);
    let (mut gaps, mut count, mut k) = (Vec::new(), 0, 0.0);
    for (at, pair) in times.windows(2).enumerate() {
        let steps = ((pair[1] - pair[0]) / period).round();
        k += steps;
        // twice the usual distance, because the period is estimated from the same times (heuristic)
        if steps < 1.0 || ((pair[1] - times[0]) / period - k).abs() > 2.0 * MOST_OFF_GRID {
            return None;
        }
        if steps > 1.0 {
            count += steps as usize - 1;
            gaps.extend(decay.time(at));
        }
    }
    let told: Vec<String> = gaps.iter().take(MOST_TOLD).map(|t| format!("after t = {t}")).collect();
    let more = match gaps.len().saturating_sub(MOST_TOLD) {
        0 => String::new(),
        more => format!(" and at {more} more places"),
    };
    let samples = if count == 1 { "sample" } else { "samples" };
    // what lies between acquisitions was not sampled: none of it may be interpolated
    let are_equal = gaps.len() > 1 && segments::length(times, 1.5).is_some();
    let advice = match are_equal || count > times.len() {
        true => {
            "if acquisitions end there, each needs a table of its own, or a column that --burst names"
        }
        false => "--resample interpolates them",
    };
    (count > 0 && !segments::are_rounded(decay)).then(|| {
        format!(
            "{count} {samples} missing {}{more} of times every {}; {advice}",
            told.join(", "),
            rounded(period)
        )
    })
}

/// A number with six significant digits, for errors.
fn rounded(x: f64) -> f64 {
    format!("{x:.5e}").parse().unwrap_or(x)
}

fn too_long(decay: &Decay, samples: usize) -> Result<(), String> {
    let what = format!(
        "{samples} samples; a recording holds {MOST_SAMPLES} per signal: cut the decay off earlier, \
         or thin it out"
    );
    if samples > MOST_SAMPLES { Err(refused(decay, what)) } else { Ok(()) }
}

/// A decay interpolated over the time that all its outputs cover: nothing is extrapolated. `so_far`
/// counts the samples that have no written sample within 3 % of a period.
fn resampled(decay: Decay, period: f64, so_far: &mut Sampled) -> Result<Decay, String> {
    // 1. for each output its samples that are there; the grid spans what all outputs cover
    let mut known = Vec::new();
    let (mut start, mut end) = (f64::NEG_INFINITY, f64::INFINITY);
    for column in &decay.outputs {
        let points = decay.times.iter().zip(column).filter(|(_, y)| !y.is_nan());
        let (t, y): (Vec<f64>, Vec<f64>) = points.unzip();
        if t.len() < FEWEST_SAMPLES {
            let what = format!("an output with {} values: nothing to interpolate", t.len());
            return Err(refused(&decay, what));
        }
        (start, end) = (start.max(t[0]), end.min(t[t.len() - 1]));
        known.push((t, y));
    }
    // 2. how many steps fit; 1e-6 more, so that the last sample is not lost to rounding
    let steps = ((end - start) / period + 1e-6).floor();
    if steps.is_nan() || steps + 1.0 < FEWEST_SAMPLES as f64 {
        let what = "its outputs have no span of time in common".to_owned();
        return Err(refused(&decay, what));
    }
    too_long(&decay, steps.min(1e15) as usize + 1)?;
    let n = steps as usize + 1;
    // 3. the spline of each output, read at the grid's times
    let mut outputs = Vec::new();
    for (t, y) in &known {
        let spline = Spline::new(t, y);
        let grid = (0..n).map(|k| (start + k as f64 * period).min(t[t.len() - 1]));
        let column = grid.map(|at| {
            let (value, nearest) = spline.at(at);
            so_far.interpolated += usize::from(nearest > MOST_OFF_GRID * period);
            value
        });
        outputs.push(column.collect());
    }
    Ok(Decay { times: grid(start, period, n), outputs, ..decay })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::assert_refused;

    const T: TimeColumn = TimeColumn { name: "t", unit_s: 1e-6 };

    fn decay(times: Vec<f64>, y: impl Fn(f64) -> f64) -> Decay {
        let outputs = vec![times.iter().map(|t| y(*t)).collect()];
        Decay { line: 2, times, outputs, ..Decay::default() }
    }

    #[test]
    fn times_rounded_to_milliseconds_are_regular_and_their_period_is_found() {
        let times = (1..400).map(|k| (f64::from(k) / 30.0 * 1e3).round() / 1e3).collect();
        let sampled = sample(vec![decay(times, f64::sin)], T, false).unwrap();
        assert!((sampled.period * 30.0 - 1.0).abs() < 1e-5, "{}", sampled.period);
        assert!(sampled.most_off_grid < 0.02);
        assert_eq!(sampled.interpolated, 0);
    }

    #[test]
    fn irregular_sampling_is_refused_and_says_how_much_and_where() {
        let mut times: Vec<f64> = (0..100).map(f64::from).collect();
        times[40] += 0.4;
        let sampled = sample(vec![decay(times, f64::sin)], T, false);
        assert_refused(sampled, &["irregular", "1 of 100", "40.4 (its row 41", "--resample"]);
    }

    #[test]
    fn rows_that_are_not_there_are_counted_and_told() {
        let times = |gone: &[i32]| -> Vec<f64> {
            (0..2000).filter(|k| !gone.contains(k)).map(|k| f64::from(k) / 100.0).collect()
        };
        let refused = |decays, texts: &[&str]| assert_refused(sample(decays, T, false), texts);
        for (gone, texts) in [
            (&[499, 500, 501][..], &["3 samples missing after t = 4.98 of times every 0.01;"][..]),
            (&[7], &["1 sample missing after t = 0.06 "]),
            (&[7, 100, 200, 300, 301], &["5 samples missing", "at 1 more place"]),
        ] {
            refused(vec![decay(times(gone), f64::sin)], texts);
        }
        // beside a whole decay it is the one with a gap that is to blame
        let whole = Decay { name: "whole".into(), ..decay(times(&[]), f64::sin) };
        let cut = Decay { name: "cut".into(), ..decay(times(&[999]), f64::sin) };
        refused(vec![whole, cut], &["burst \"cut\"", "1 sample missing"]);
        // written with few digits
        let coarse = times(&[1000]).iter().map(|t| (t / 0.3 * 1e3).round() / 1e3).collect();
        refused(vec![decay(coarse, f64::sin)], &["1 sample missing", "every 0.033333"]);
    }

    #[test]
    fn advice_about_rounded_times_gaps_between_acquisitions_and_rows_of_one_time_leads_to_right_data()
     {
        let grid = |k: i32| f64::from(k) * 0.78125;
        let every = |n: i32, of: &dyn Fn(i32) -> f64| (0..n).map(of).collect::<Vec<f64>>();
        let by_rows = "; --period-s 0.00000078125 takes rows as samples";
        for (times, says) in [
            (every(129, &|k| (grid(k) / 0.5).round() * 0.5), by_rows),
            (every(128, &|k| 1e6 + grid(k) + f64::from(k / 40) * 1e5), "each needs a table"),
            (every(384, &|k| grid(k + 2 * (k / 128))), "4 samples missing"),
            (every(384, &|k| grid(k + 2 * (k / 128))), "each needs a table"),
            (every(384, &|k| grid(k / 3)), "stands in 3 rows"),
        ] {
            let refusal = sample(vec![decay(times, f64::sin)], T, false).unwrap_err();
            assert!(refusal.contains(says) && !refusal.contains("--resample"), "{says}: {refusal}");
        }
        let elapsed = TimeColumn { name: "x", ..T };
        let coarse = every(100, &|k| (grid(k) / 2.0).floor());
        assert_refused(sample(vec![decay(coarse, f64::sin)], elapsed, false), &["--time \"x\""]);
        // resampled, the period is not the commonest step
        let times = every(129, &|k| (grid(k) / 0.5).round() * 0.5);
        let sampled = sample(vec![decay(times, f64::sin)], T, true).unwrap();
        assert!((sampled.period / 0.78125 - 1.0).abs() < 1e-3, "{}", sampled.period);
    }

    #[test]
    fn rows_that_are_samples_are_cut_where_acquisitions_begin() {
        let times = (0..60).map(|k| f64::from(k / 20) * 1e6 + f64::from(k % 20 / 2)).collect();
        let listed = as_listed(vec![decay(times, f64::sin)]).unwrap();
        assert_eq!((listed.segments, listed.decays[2].times[0]), (3, 2e6));
    }

    #[test]
    fn time_that_goes_back_or_stands_still_is_refused_with_its_row() {
        for again in [2.0, 3.0] {
            let times = vec![0.0, 1.0, 2.0, 3.0, again, 5.0];
            for resample in [false, true] {
                let sampled = sample(vec![decay(times.clone(), f64::sin)], T, resample);
                assert_refused(sampled, &["row 5", "--burst"]);
            }
        }
    }

    #[test]
    fn a_spline_through_a_straight_line_is_the_line_and_misses_nothing_missing() {
        let mut decay = decay(vec![0.0, 0.7, 2.0, 3.1, 4.0, 5.2, 6.0], |t| 3.0 - 2.0 * t);
        decay.outputs[0][2] = f64::NAN;
        let sampled = sample(vec![decay.clone()], T, true).unwrap();
        assert_eq!(sampled.missing, 1);
        for (k, y) in sampled.decays[0].outputs[0].iter().enumerate() {
            assert!((y - (3.0 - 2.0 * sampled.period * k as f64)).abs() < 1e-9);
        }
    }

    #[test]
    fn decays_of_different_period_are_refused_and_resampled_to_one() {
        let at = |period: f64| (0..50).map(|k| f64::from(k) * period).collect::<Vec<f64>>();
        let decays = || [1.0, 1.0, 1.5].map(|period| decay(at(period), f64::cos)).to_vec();
        assert_refused(sample(decays(), T, false), &["1.5", "--resample"]);
        let sampled = sample(decays(), T, true).unwrap();
        let lengths: Vec<usize> = sampled.decays.iter().map(|d| d.outputs[0].len()).collect();
        assert_eq!(lengths, [50, 50, 74]);
    }

    #[test]
    fn too_few_and_too_many_samples_are_refused() {
        for n in [1, 3, MOST_SAMPLES + 1] {
            let times = (0..n).map(|k| k as f64).collect();
            let sampled = sample(vec![decay(times, f64::sin)], T, false);
            assert_refused(sampled, &[&format!("{n} samples")]);
        }
        // one far time would make a grid of 1e12 samples
        let times = vec![0.0, 1.0, 2.0, 3.0, 4.0, 1e12];
        assert!(sample(vec![decay(times, f64::sin)], T, true).is_err());
    }
}
