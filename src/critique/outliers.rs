//! Signals that ring unlike the others: faulty channels in a recording that nobody labelled.
//!
//! In: observations. Out: which to leave out. Each signal is fitted alone; one that lies beyond
//! [`FAR`] robust deviations of the median in amplitude, damping or frequency, or that leaves far more
//! than the others, is left out. What spreads over all signals widens the deviation and stays in.

use super::covariates::Covariates;
use super::model::{Linear, Model};
use super::observations::Observations;

const FAR: f64 = 7.0;
/// Deviations below these (ln damping, ln frequency, ln amplitude) are never far.
const LEAST: [f64; 3] = [0.025, 0.004, 0.015];
/// Misfit of one signal over the median one.
const NOISIER: f64 = 3.0;

fn median(values: &mut [f64]) -> f64 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// For each row whether it is an outlier.
pub fn outliers(data: &Observations, beside: &Covariates, model: &Model) -> Vec<bool> {
    let mut alone = data.clone();
    for (i, row) in alone.rows.iter_mut().enumerate() {
        row.unit = i;
    }
    alone.units = alone.len();
    let mut each = model.clone();
    each.each = vec![Default::default(); data.len()];
    each.units = data.rows.iter().map(|r| model.units[r.unit]).collect();
    each.fit_units(&alone, beside, 6);
    let mut features: Vec<[f64; 3]> =
        each.units.iter().map(|u| [u[0], u[1], u[2].hypot(u[3]).max(1e-300).ln()]).collect();
    let mut linear = Linear::default();
    let left: Vec<f64> = (0..alone.len())
        .map(|i| {
            each.linearise(i, &alone, beside, &mut linear);
            linear.residual.iter().map(|r| r * r).sum()
        })
        .collect();
    let typical = median(&mut left.clone());
    let mut spread = [(0.0, 1.0); 3];
    for (j, spread) in spread.iter_mut().enumerate() {
        let mut values: Vec<f64> = features.iter().map(|f| f[j]).collect();
        let centre = median(&mut values);
        let mut off: Vec<f64> = values.iter().map(|v| (v - centre).abs()).collect();
        *spread = (centre, (1.4826 * median(&mut off)).max(LEAST[j]));
    }
    features
        .drain(..)
        .zip(left)
        .map(|(f, left)| {
            left > NOISIER * typical
                || (0..3).any(|j| {
                    let (centre, sd) = spread[j];
                    let off = (f[j] - centre).abs() / sd;
                    off > FAR || off.is_nan()
                })
        })
        .collect()
}
