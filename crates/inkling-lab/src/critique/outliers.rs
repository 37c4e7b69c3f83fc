//! Finds signals that ring unlike the others, such as those of faulty channels in a recording that nobody
//! labelled.
//!
//! In: signals, and the first model (`Model::start`). Out: [`Outliers`]. The steps:
//!
//! 1. fit every signal alone, and take a trend of its features along the head away, which is no fault;
//! 2. a signal is odd if its ln amplitude, ln damping or ln frequency lies beyond [`OUTLYING`] robust
//!    standard deviations of the median, or if the square of its misfit is far more than the median one;
//! 3. a channel with several odd signals is left out altogether;
//! 4. of the signals that ring like the others but leave more, ask whether the misfit has a shape: odd
//!    samples of one sign in a row come from heavy-tailed noise only as seldom as chance puts them there.
//!
//! An effect that all signals share in widens the robust deviation, and so leaves nobody out.

use super::chance::surprise_of_count;
use super::covariates::POSITION;
use super::held_out::FEWEST_UNITS;
use super::model::Model;
use super::observations::Observations;
use super::tuned::{LEAST_SCATTER, ODD_IN_A_ROW, OUTLYING, STANDS_OUT};
use inkling_core::model::median::{median, median_of, robust_sd};
use inkling_core::numbers::LITTLE;
use std::ops::Range;

/// Slope of feature j along the head, per unit of the standardised position: the median, over pairs of
/// channels, of the slope between their medians (Theil and Sen). 0 if there are too few channels.
fn trend(data: &Observations, features: &[[f64; 3]], j: usize) -> f64 {
    let of_channel = |rows: Range<usize>| {
        (data.beside.z[rows.start][POSITION], median_of(rows.map(|i| features[i][j])))
    };
    let at: Vec<(f64, f64)> = data.channels().map(of_channel).collect();
    let mut slopes = Vec::new();
    for (k, p) in at.iter().enumerate() {
        let later = at[k + 1..].iter().filter(|q| q.0 != p.0);
        slopes.extend(later.map(|q| (q.1 - p.1) / (q.0 - p.0)));
    }
    let enough = at.len() >= FEWEST_UNITS && !slopes.is_empty();
    if enough { median(&mut slopes) } else { 0.0 }
}

/// For each channel whether more than one of its signals, and more than a tenth of them, are `odd`. Its other
/// signals may belong to a fault that begins or ends, and are not trusted either.
fn faulty_channels(data: &Observations, odd: &[bool]) -> Vec<bool> {
    let faulty = |rows: Range<usize>| {
        let (all, count) = (rows.len() as f64, odd[rows].iter().filter(|odd| **odd).count());
        count > 1 && count as f64 > LITTLE * all
    };
    data.channels().map(faulty).collect()
}

#[derive(Clone, Debug, Default)]
pub struct Outliers {
    pub out: Vec<bool>,
    /// -ln of the probability that noise, however heavy its tails, gives such misfits to signals that ring
    /// like the others but leave more.
    pub shape_surprise: f64,
}

/// -ln of the probability of so many misfits, among those that `some` selects, with a run of odd samples of
/// one sign, if odd samples are independent. `sd`: root mean square of the typical misfit, counts.
fn shape_surprise(misfits: &[Vec<f64>], sd: f64, some: impl Fn(usize) -> bool) -> f64 {
    let sign = |x: &f64| if x.abs() > OUTLYING * sd { x.signum() as i32 } else { 0 };
    let signs: Vec<Vec<i32>> = misfits.iter().map(|r| r.iter().map(sign).collect()).collect();
    let samples: usize = signs.iter().map(Vec::len).sum();
    let odd = signs.iter().flatten().filter(|s| **s != 0).count();
    let share = (odd as f64 + 1.0) / samples as f64;
    let run = |w: &[i32]| w[0] != 0 && w.iter().all(|s| *s == w[0]);
    let runs = |signs: &Vec<i32>| signs.windows(ODD_IN_A_ROW).any(run);
    let found = signs.iter().enumerate().filter(|(i, s)| some(*i) && runs(s)).count() as f64;
    // Expected number of runs: at each of `samples` places the first sample is odd with probability `share`,
    // with either sign; each of the others with the same sign, `share`/2.
    let expected = samples as f64 * share * (share / 2.0).powi(ODD_IN_A_ROW as i32 - 1);
    surprise_of_count(found, expected)
}

struct SingleFits {
    /// ln damping, ln frequency and ln amplitude of each signal, without the trend along the head.
    features: Vec<[f64; 3]>,
    misfits: Vec<Vec<f64>>,
}

impl SingleFits {
    /// Fits every signal as if it were a channel of its own.
    fn of(data: &Observations, model: &Model) -> SingleFits {
        let mut alone = data.clone();
        alone.rows.iter_mut().enumerate().for_each(|(i, row)| row.unit = i);
        alone.units = alone.len();
        let mut each = model.clone();
        each.each = vec![Default::default(); data.len()];
        each.units =
            data.rows.iter().zip(&model.each).map(|(r, own)| model.units[r.unit] + own).collect();
        each.fit_units(&alone, 6);
        let mut features: Vec<[f64; 3]> =
            each.units.iter().map(|u| [u[0], u[1], u[2].hypot(u[3]).max(1e-300).ln()]).collect();
        for j in 0..3 {
            let slope = trend(data, &features, j);
            for (feature, z) in features.iter_mut().zip(&data.beside.z) {
                feature[j] -= slope * z[POSITION];
            }
        }
        SingleFits { misfits: each.of_each(&alone, |_, linear| linear.residual.clone()), features }
    }

    /// For each signal whether a feature lies beyond [`OUTLYING`] robust standard deviations of the median. A
    /// feature that is not a number counts as far.
    fn far(&self) -> Vec<bool> {
        let mut far = vec![false; self.features.len()];
        for (j, least) in LEAST_SCATTER.iter().enumerate() {
            let mut values: Vec<f64> = self.features.iter().map(|f| f[j]).collect();
            let centre = median(&mut values);
            let sd = robust_sd(&values, centre).max(*least);
            for (far, f) in far.iter_mut().zip(&self.features) {
                let off = (f[j] - centre).abs() / sd;
                *far |= off > OUTLYING || off.is_nan();
            }
        }
        far
    }
}

/// `model`: the first model of these signals, where the fits start.
pub fn outliers(data: &Observations, model: &Model) -> Outliers {
    let alone = SingleFits::of(data, model);
    let far = alone.far();
    let left: Vec<f64> = alone.misfits.iter().map(|r| r.iter().map(|r| r * r).sum()).collect();
    let typical = median(&mut left.clone());
    let noisier = |i: usize| left[i] > STANDS_OUT * typical;
    let odd: Vec<bool> = (0..data.len()).map(|i| far[i] || noisier(i)).collect();
    let faulty = faulty_channels(data, &odd);
    let of_faulty = |i: usize| faulty[data.rows[i].unit];
    let sd = (typical / data.samples as f64).sqrt();
    let shape_surprise =
        shape_surprise(&alone.misfits, sd, |i| noisier(i) && !far[i] && !of_faulty(i));
    Outliers { out: (0..data.len()).map(|i| odd[i] || of_faulty(i)).collect(), shape_surprise }
}

#[cfg(test)]
mod tests {
    use super::super::catalogue::CauseId;
    use super::super::generator::{Run, draw};
    use super::*;

    fn left_out(run: &Run) -> Vec<bool> {
        let data = draw(run, 11);
        let model = Model::start(&data).unwrap();
        let out = outliers(&data, &model).out;
        let mut channels = vec![true; run.channels];
        for (row, out) in data.rows.iter().zip(out) {
            channels[row.beside.channel as usize] &= out;
        }
        channels
    }

    #[test]
    fn a_channel_that_is_faulty_at_times_is_left_out_altogether() {
        let data = draw(&Run { channels: 8, bursts: 10, ..Run::default() }, 12);
        let odd = |i: usize| {
            let row = &data.rows[i];
            let channel = row.beside.channel;
            channel == 3 && row.beside.t_acq_ns % 3 == 0
                || channel == 5 && row.beside.t_acq_ns == 50_000_000
        };
        let odd: Vec<bool> = (0..data.len()).map(odd).collect();
        let all = faulty_channels(&data, &odd);
        for row in &data.rows {
            assert_eq!(all[row.unit], row.beside.channel == 3, "channel {}", row.beside.channel);
        }
    }

    #[test]
    fn faulty_channels_are_left_out_and_what_all_follow_is_not() {
        let small = Run { channels: 16, bursts: 4, ..Run::default() };
        let faulty = left_out(&Run { faulty: 2, ..small.clone() });
        assert!(faulty[0] && faulty[1] && !faulty[2..].iter().any(|o| *o), "{faulty:?}");
        // a strong trend along the head, and strong scatter, concern all channels alike
        let steep = Run { effect: Some(CauseId::PositionGradient), size: 0.1, ..small.clone() };
        assert!(!left_out(&steep).iter().any(|o| *o));
        let wide = Run { spread: [0.04, 0.06, 0.025], ..small };
        assert!(!left_out(&wide).iter().any(|o| *o));
    }

    /// Misfits like white noise; the first ones get so many samples in a row of the given size.
    fn misfits(odd: &[(usize, f64)]) -> Vec<Vec<f64>> {
        let noise = |i: usize| (0..64).map(|k| ((i * 64 + k) as f64 * 1.7).sin()).collect();
        let mut all: Vec<Vec<f64>> = (0..100).map(noise).collect();
        for (i, &(samples, size)) in odd.iter().enumerate() {
            all[i][20..20 + samples].fill(size);
        }
        all
    }

    #[test]
    fn pulses_of_few_signals_have_a_shape_and_heavy_tails_have_none() {
        let of = |odd: &[(usize, f64)]| shape_surprise(&misfits(odd), 1.0, |i| i < odd.len());
        assert!(of(&[(4, 9.0), (4, 9.0)]) > 20.0);
        assert!(of(&[(4, -9.0)]) > 9.8);
        assert_eq!(of(&[(1, 30.0), (2, 9.0), (1, -12.0)]), 0.0);
        assert_eq!(of(&[(4, 4.0)]), 0.0, "as large as others");
        assert_eq!(of(&[]), 0.0);
    }
}
