//! Puts decays that others recorded on a regular grid of times, for tables whose rows are samples.
//!
//! In, from `src/cli/convert`: the decays of a table, with times in the table's unit. Out:
//! [`Sampled`], with every decay on one common sample period. A table that is not regularly sampled
//! is refused with where and how irregular it is, unless resampling is asked for.
//!
//! Without resampling: each decay's period is the least-squares slope of its times
//! (`fitted_period`); all periods must agree to 1e-3; the median is the common period; then each
//! time must lie within 3 % of a period from a regular grid (`move_to_grid`). So times written with
//! few digits (33 and 34 ms for 1/30 s) are regular. With resampling: the period is the usual step
//! (`median_step`), unless steps differ by rounding, and each output is interpolated by a natural cubic
//! spline through the samples that are there (`interpolate`). Before either, exports of several acquisitions
//! in one table are cut (`segments.rs`), and times that no period could fit are refused (`sampling_times.rs`).

pub use super::sampling_times::TimeColumn;

use super::sampling_times::{
    FEWEST_SAMPLES, MOST_OFF_GRID, check, check_gaps, fitted_period, median_step, rounded,
};
use super::segments;
use super::spline::Spline;
use super::table_file::Decay;
use inkling_core::model::median::median_of;

/// How much the sample period of a decay may differ from the table's median period, relative.
const MOST_PERIOD_DIFFERENCE: f64 = 1e-3;
/// Most samples of one signal that a recording may hold.
pub const MOST_SAMPLES: usize = 65_536;

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

pub fn sample(decays: Vec<Decay>, time: TimeColumn, resample: bool) -> Result<Sampled, String> {
    let (mut decays, segments) = segments::cut(decays);
    for decay in &decays {
        check(decay, time).map_err(refused(decay))?;
    }
    // a decay that lacks rows is told before periods are compared, since its fitted one is none
    for decay in decays.iter().filter(|_| !resample) {
        check_gaps(decay).map_err(refused(decay))?;
    }

    // the common period; without resampling, all decays must already have it
    let period = |decay: &Decay| match resample && !segments::are_rounded(decay) {
        true => median_step(&decay.times),
        false => fitted_period(&decay.times),
    };
    let periods: Vec<f64> = decays.iter().map(period).collect();
    let common = median_of(periods.iter().copied());
    let differs = |own: f64| (own / common - 1.0).abs() > MOST_PERIOD_DIFFERENCE;
    let other = decays.iter().zip(&periods).find(|(_, own)| !resample && differs(**own));
    if let Some((decay, own)) = other {
        let (own, common) = (rounded(*own), rounded(common));
        let what = format!("sampled every {own} time units, others every {common}");
        return Err(refused(decay)(format!("{what}; --resample puts all on one sample period")));
    }

    let mut sampled =
        Sampled { period: common, missing: cells_missing(&decays), segments, ..Sampled::default() };
    for decay in &mut decays {
        let moved = match resample {
            true => interpolate(decay, common, &mut sampled),
            false => move_to_grid(decay, common, time, &mut sampled),
        };
        moved.map_err(refused(decay))?;
    }
    Ok(Sampled { decays, ..sampled })
}

/// The decays of a table whose rows count as samples one after the other; of their times only gaps between
/// acquisitions count.
pub fn as_listed(decays: Vec<Decay>) -> Result<Sampled, String> {
    let (decays, segments) = segments::cut(decays);
    for decay in &decays {
        check_length(decay.times.len()).map_err(refused(decay))?;
    }
    let missing = cells_missing(&decays);
    Ok(Sampled { period: 1.0, missing, decays, segments, ..Sampled::default() })
}

fn grid(start: f64, period: f64, samples: usize) -> Vec<f64> {
    (0..samples).map(|k| start + k as f64 * period).collect()
}

/// Says of which decay it is that something is wrong.
fn refused(decay: &Decay) -> impl Fn(String) -> String {
    let Decay { name, line, .. } = decay;
    move |what| match name.as_str() {
        "" => format!("the table: {what}"),
        name => format!("burst {name:?} (from line {line}): {what}"),
    }
}

/// How many cells have no value. A signal with such a cell cannot be judged, unless the cell is interpolated.
fn cells_missing(decays: &[Decay]) -> usize {
    decays.iter().flat_map(|d| &d.outputs).flatten().filter(|y| y.is_nan()).count()
}

fn check_length(samples: usize) -> Result<(), String> {
    match samples > MOST_SAMPLES {
        true => Err(format!(
            "{samples} samples; a recording holds {MOST_SAMPLES} per signal: cut the decay off earlier, \
             or thin it out"
        )),
        false => Ok(()),
    }
}

/// Moves the times of a decay to the nearest regular grid of this period; its samples stay as they are.
fn move_to_grid(
    decay: &mut Decay,
    period: f64,
    time: TimeColumn,
    so_far: &mut Sampled,
) -> Result<(), String> {
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
        let (least, most) = segments::span(decay.times.windows(2).map(|w| w[1] - w[0]));
        let steps = format!("steps from {} to {}", rounded(least), rounded(most));
        return Err(match segments::are_rounded(decay) {
            true => format!("times with too few digits: {steps}; {}", time.by_rows(decay)),
            false => format!(
                "irregular sampling: {steps}; {uneven} of {n} times lie more than {MOST_OFF_GRID} of a period from a \
                 regular grid, furthest {} (its row {}, {:.2} periods off); --resample interpolates to a regular one",
                decay.time(worst).unwrap_or_default(),
                worst + 1,
                off(worst)
            ),
        });
    }
    check_length(n)?;
    so_far.most_off_grid = so_far.most_off_grid.max(off(worst).abs());
    decay.times = grid(start, period, n);
    Ok(())
}

/// Interpolates a decay over the time that all its outputs cover: nothing is extrapolated. `so_far`
/// counts the samples that have no written sample within 3 % of a period.
fn interpolate(decay: &mut Decay, period: f64, so_far: &mut Sampled) -> Result<(), String> {
    // 1. for each output its samples that are there; the grid spans what all outputs cover
    let mut known = Vec::new();
    let (mut start, mut end) = (f64::NEG_INFINITY, f64::INFINITY);
    for column in &decay.outputs {
        let points = decay.times.iter().zip(column).filter(|(_, y)| !y.is_nan());
        let (t, y): (Vec<f64>, Vec<f64>) = points.unzip();
        if t.len() < FEWEST_SAMPLES {
            return Err(format!("an output with {} values: nothing to interpolate", t.len()));
        }
        (start, end) = (start.max(t[0]), end.min(t[t.len() - 1]));
        known.push((t, y));
    }
    // 2. how many steps fit; 1e-6 more, so that the last sample is not lost to rounding
    let steps = ((end - start) / period + 1e-6).floor();
    if steps.is_nan() || steps + 1.0 < FEWEST_SAMPLES as f64 {
        return Err("its outputs have no span of time in common".to_owned());
    }
    check_length(steps.min(1e15) as usize + 1)?;
    let times = grid(start, period, steps as usize + 1);
    // 3. the spline of each output, read at the grid's times
    let mut outputs = Vec::new();
    for (t, y) in &known {
        let spline = Spline::new(t, y);
        let column = times.iter().map(|at| {
            let (value, nearest) = spline.at(at.min(t[t.len() - 1]));
            so_far.interpolated += usize::from(nearest > MOST_OFF_GRID * period);
            value
        });
        outputs.push(column.collect());
    }
    (decay.times, decay.outputs) = (times, outputs);
    Ok(())
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
