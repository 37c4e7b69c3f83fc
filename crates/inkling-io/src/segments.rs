//! Tells times that are several acquisitions in one table, and times that were written with too few digits,
//! from times that lack rows.
//!
//! In: the times of a decay. Out: its segments, as decays of their own ([`cut`]); or whether its times are
//! rounded ([`standing`], [`are_rounded`]) or stand in several rows ([`rows_of_each`], [`mean_step`]). Instruments that record
//! segments export all of them in one table: the times go on after a gap, or begin again, after equally many
//! samples each time, but for the last one, which may have been cut off.

use super::sampling_times::{MOST_OFF_STEP, fitted_period};
use super::table_file::Decay;
use inkling_core::model::median::{median, median_of};

/// Fewest samples of a segment, and how many usual steps the gap between two must have at least. A table
/// that lacks some rows has shorter gaps, and not after equally many rows.
const FEWEST_SAMPLES: usize = 16;
pub(super) const FEWEST_STEPS: f64 = 10.0;
/// A step that is no exception makes up this share of all steps.
const COMMON: usize = 50;

/// Cuts decays whose times are those of several acquisitions. Gives the decays, and how many were cut out of
/// longer ones.
pub(super) fn cut(decays: Vec<Decay>) -> (Vec<Decay>, usize) {
    let (mut all, mut segments) = (Vec::new(), 0);
    // rows of one decay stand below each other
    let is_alone = decays.len() == 1;
    for decay in decays {
        let Some(length) = length(&decay.times, FEWEST_STEPS) else {
            all.push(decay);
            continue;
        };
        for from in (0..decay.times.len()).step_by(length) {
            let to = (from + length).min(decay.times.len());
            let (number, after) = (all.len() + 1, if is_alone { from as u64 } else { 0 });
            segments += 1;
            all.push(Decay {
                name: format!("{} segment {number}", decay.name).trim().to_owned(),
                printhead: decay.printhead.clone(),
                line: decay.line + after,
                times: decay.times[from..to].to_vec(),
                base: decay.base,
                outputs: decay.outputs.iter().map(|of| of[from..to].to_vec()).collect(),
                beside: decay.beside.iter().map(|of| of[from..to].to_vec()).collect(),
            });
        }
    }
    (all, segments)
}

/// The samples of each segment, where the times are those of several with gaps of so many usual steps between them;
/// the last one may have fewer.
pub(super) fn length(times: &[f64], fewest_steps: f64) -> Option<usize> {
    let steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    // times with few digits stand still for most rows
    let mut moved: Vec<f64> = steps.iter().copied().filter(|step| *step != 0.0).collect();
    let far = if moved.is_empty() { 0.0 } else { fewest_steps * median(&mut moved) };
    // rows that were swapped go back by a step or so, and not to the begin
    let begins = |at: usize| {
        let is_back = steps[at - 1] < 0.0 && times[at] <= times[0];
        is_back || steps[at - 1].abs() > far
    };
    let length = (1..times.len()).find(|at| begins(*at)).filter(|n| *n >= FEWEST_SAMPLES)?;
    let last = times.len() % length;
    let is_regular = (1..times.len()).all(|at| begins(at) == at.is_multiple_of(length));
    let are_whole = last == 0 || last >= FEWEST_SAMPLES && !is_one_with_gap(times, length);
    (far > 0.0 && is_regular && are_whole).then_some(length)
}

/// Whether times are those of one burst that lacks samples behind so many of them: no two stretches are equally long,
/// and times go on after a whole number of periods.
fn is_one_with_gap(times: &[f64], length: usize) -> bool {
    let gap = (times[length] - times[length - 1]) / fitted_period(&times[..length]);
    times.len() < 2 * length && gap > 0.0 && (gap - gap.round()).abs() < MOST_OFF_STEP
}

/// How many times are those of the row before; 0: too few for times with too few digits, or a time goes back.
pub(super) fn standing(times: &[f64]) -> usize {
    let steps = || times.windows(2).map(|pair| pair[1] - pair[0]);
    let again = steps().filter(|step| *step == 0.0).count();
    let is_rounded = again * 10 > times.len() && times.len() >= FEWEST_SAMPLES;
    if is_rounded && steps().all(|step| step >= 0.0) { again } else { 0 }
}

/// In how many rows each time stands, one below the other, where it is more than one and fewer than there are times:
/// these are rows of several channels, or copies.
pub(super) fn rows_of_each(times: &[f64]) -> Option<usize> {
    let mut runs = times.chunk_by(|a, b| a == b).map(<[f64]>::len);
    let rows = runs.next().filter(|rows| (2..times.len() / rows).contains(rows))?;
    runs.all(|of| of == rows).then_some(rows)
}

/// The mean time from row to row, by the rows in which times begin to be others: the first may have begun before the
/// table, and the last go on behind it. `None`: they move too rarely to tell.
pub(super) fn mean_step(times: &[f64]) -> Option<f64> {
    let rows: Vec<usize> = times.chunk_by(|a, b| a == b).map(<[f64]>::len).collect();
    let (first, last) = (*rows.first()?, *rows.last()?);
    let usual = median_of(rows.iter().map(|rows| *rows as f64));
    let from = if (first as f64) < usual { first } else { 0 };
    let to = times.len() - last;
    let step = (times[to] - times.get(from)?) / to.checked_sub(from)? as f64;
    (step > 0.0).then_some(step)
}

/// Whether times are regular but for their rounding: they lie as far from a grid as rounding moves them, and no step
/// is an exception, as where a row is missing.
pub(super) fn are_rounded(decay: &Decay) -> bool {
    let (times, period) = (&decay.times, fitted_period(&decay.times));
    let off = times.iter().zip(0u32..).map(|(t, k)| t - times[0] - f64::from(k) * period);
    let off: Vec<f64> = off.collect();
    let (least, most) = span(off.iter().copied());
    // Rounding moves all times, by .29 of the last digit on the average and by half of it at most; the period is
    // estimated from the same times, and allows for more (heuristic).
    let n = off.len() as f64;
    let mean = off.iter().sum::<f64>() / n;
    let usual = (off.iter().map(|t| (t - mean).powi(2)).sum::<f64>() / n).sqrt();
    let fits = |digit: &f64| most - least <= 1.25 * digit && usual >= 0.1 * digit;
    let is_near = last_digits(decay).iter().flatten().any(fits);
    let far = times.windows(2).filter(|pair| pair[1] - pair[0] > 1.5 * period).count();
    is_near && (far == 0 || far * COMMON > times.len())
}

/// The least and the largest number.
pub(super) fn span(of: impl Iterator<Item = f64>) -> (f64, f64) {
    of.fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), x| (least.min(x), most.max(x)))
}

/// The values of the last digit of the largest time, if they all have few decimals, few digits, or the bits of an
/// f32 or an f64.
fn last_digits(decay: &Decay) -> [Option<f64>; 4] {
    let all = || decay.times.iter().map(|t| decay.base as f64 + t);
    let most = all().fold(0.0_f64, |most, t| most.max(t.abs()));
    // what is left of a short number in f32 or f64, and in texts of nine digits
    let are = |short: &dyn Fn(f64) -> f64| all().all(|t| (short(t) - t).abs() <= 5e-9 * t.abs());
    let in_digits = |n: i32| {
        let digits = usize::try_from(n).unwrap_or(0);
        are(&|t| format!("{t:.digits$e}").parse().unwrap_or(t))
    };
    let digit = |n: i32| 10f64.powi(most.log10().floor() as i32 - n);
    let of_f32 = are(&|t| f64::from(t as f32)).then_some(most * f64::from(f32::EPSILON));
    [
        last_digit(&decay.times),
        (1..6).find(|n| in_digits(*n)).map(digit),
        of_f32,
        Some(most * f64::EPSILON),
    ]
}

/// The value of the last digit with which times were written. `None`: there are more than f64 holds.
fn last_digit(times: &[f64]) -> Option<f64> {
    const MOST_WHOLE: f64 = 1e12;
    let is_whole = |t: &f64, scale: f64| {
        let t = t * scale;
        t.abs() < MOST_WHOLE && (t - t.round()).abs() < 1e-3
    };
    let digits = (0..=12).find(|digits| times.iter().all(|t| is_whole(t, 10f64.powi(*digits))))?;
    Some(10f64.powi(-digits))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decay(times: Vec<f64>) -> Decay {
        let [outputs, beside] = [(); 2].map(|()| vec![times.clone()]);
        Decay { line: 2, outputs, beside, times, ..Decay::default() }
    }

    fn grid(samples: usize, begins: f64) -> impl Iterator<Item = f64> {
        (0..samples).map(move |k| begins + k as f64)
    }

    #[test]
    fn segments_of_equal_length_are_cut_whether_times_go_on_or_begin_again() {
        for (begins, last, segments) in [
            ([0.0, 1000.0, 2000.0], 20, 3),
            ([-5.0, -5.0, -5.0], 20, 3),
            ([0.0, 1000.0, 2000.0], 17, 3),
            ([0.0, 1000.0, 2000.0], 3, 0),
            ([0.0, 25.0, 50.0], 20, 0), // as if five rows were missing
            ([0.0, 18.0, 36.0], 20, 0), // as if rows were out of order
        ] {
            let times = begins
                .iter()
                .enumerate()
                .flat_map(|(n, t)| grid(if n == 2 { last } else { 20 }, *t));
            let (decays, n) = cut(vec![decay(times.collect())]);
            assert_eq!((n, decays.len()), (segments, segments.max(1)), "{begins:?} {last}");
            assert!(n == 0 || (decays[1].line, &*decays[1].name) == (22, "segment 2"));
            assert!(decays.iter().all(|decay| decay.outputs[0] == decay.times));
            assert!(decays.iter().all(|decay| decay.beside[0][0] == decay.times[0]));
        }
    }

    #[test]
    fn what_lacks_rows_or_jitters_is_not_taken_for_rounded() {
        let rounded = |period: f64| {
            (0..200).map(|k| (f64::from(k) * period * 100.0).round() / 100.0).collect()
        };
        let gaps: Vec<f64> = (0..200).filter(|k| k % 60 != 59).map(f64::from).collect();
        let mut jitter: Vec<f64> = grid(200, 0.0).collect();
        jitter[40] += 0.4;
        for (times, is_rounded) in
            [(rounded(0.014), true), (rounded(0.117), true), (gaps, false), (jitter, false)]
        {
            assert_eq!(are_rounded(&decay(times.clone())), is_rounded, "{:?}", &times[..9]);
            assert_eq!(standing(&times), 0);
        }
        // as f32, with three digits, and in seconds since 1970 as f64
        let short: [fn(f64) -> f64; 3] = [
            |t| f64::from((5.0 + t) as f32),
            |t| format!("{t:.2e}").parse().unwrap(),
            |t| 1_772_536_953.0 + t,
        ];
        for of in short {
            let times: Vec<f64> = (0..128).map(|k| of(f64::from(k) * 7.8125e-7)).collect();
            let lacking = times.iter().enumerate().filter(|(k, _)| *k != 60).map(|(_, t)| *t);
            let lacking: Vec<f64> = lacking.collect();
            assert!(are_rounded(&decay(times)));
            assert!(!are_rounded(&decay(lacking)));
        }
        assert!(standing(&rounded(0.004)) > 100);
    }
}
