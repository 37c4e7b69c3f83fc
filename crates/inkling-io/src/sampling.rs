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

/// The decays of a table whose rows count as samples one after the other; of their times only gaps count: those between
/// acquisitions, and those of missing rows, which are refused.
pub fn as_listed(decays: Vec<Decay>) -> Result<Sampled, String> {
    let (decays, segments) = segments::cut(decays);
    for decay in &decays {
        check_length(decay.times.len()).map_err(refused(decay))?;
        // times that count samples, and not such as stand still within a burst, may show that some are missing
        if decay.times.is_sorted_by(|a, b| a < b) {
            let what =
                |what| format!("rows do not follow each other, as --period-s takes them: {what}");
            check_gaps(decay).map_err(what).map_err(refused(decay))?;
        }
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
mod tests;
