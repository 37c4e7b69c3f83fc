//! What a recording at several temperatures tells and one decay does not: the rates one by one.
//!
//! In: the healthy signals of a printhead, with their temperatures. Out: the ratios g/d and a/b, of
//! which (3-1) holds one and has a prior for the other. `inkling identify` prints them.
//!
//! A free decay has p2 = g + d, p1 = g d + a + b, p0 = a d + b g: three numbers from four rates. In
//! ink that is so many times as viscous, g and d are so many times as large, and a and b are the
//! same. At two temperatures that makes six numbers for five unknowns (a, b, g, d and the factor
//! between the temperatures), and each further temperature brings three numbers for one unknown.
//! The surplus numbers test that temperature changes nothing but the viscosity. Where the real pole
//! is hardly excited, the prior of (3-1) determines the numbers of each temperature; the standard
//! deviations leave it out, and are then large.
//!
//! Steps: the signals are sorted by temperature into up to four parts with the same channels; a
//! model is identified of each part; and the unknowns of all parts are fitted to the parts' cubics,
//! each weighted by its covariance (`joint`).

use super::averaging::{self, SignalSet};
use super::cubic::{RATES_PER_US, cubic_per_us};
use super::grey_box::{self, Identification};
use super::scatter::scatter;
use super::tuned;
use super::{GreyBoxSettings, IdentifyError, whiteness};
use crate::model::InkChannel;
use crate::numbers::tuned::{few, guessed_rate};
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use serde::Serialize;
use std::collections::BTreeMap;
use std::f64::consts::SQRT_2;

const MOST_BINS: usize = 4;

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ByTemperature {
    /// Mean temperature of each part of the signals, °C, and the viscosity over the first part's.
    pub temperatures_c: Vec<f64>,
    pub viscosity: Vec<f64>,
    /// g/d, that is, R_r/I_r over R_n/I_n.
    pub g_over_d: f64,
    pub g_over_d_sd: f64,
    /// a/b, that is, I_n over I_r.
    pub a_over_b: f64,
    pub a_over_b_sd: f64,
    /// Of the joint fit's misfit: small where temperature changes more than the viscosity.
    pub p_value: f64,
}

impl ByTemperature {
    /// Whether both ratios are known better than guessed, and viscosity explains what happens.
    pub fn is_known(&self) -> bool {
        let of_guess = guessed_rate() * SQRT_2;
        self.g_over_d_sd < of_guess && self.a_over_b_sd < of_guess && self.p_value > 0.01
    }
}

/// `fit`: the model of all signals together. `None`: the temperature hardly varies, a part has too
/// few signals, or the covariance of a part's cubic has no inverse. An error: a part has no model.
pub fn by_temperature(
    set: &SignalSet,
    fit: &Identification,
    dt_s: f64,
    settings: &GreyBoxSettings,
) -> Result<Option<ByTemperature>, IdentifyError> {
    let mut parts = Vec::new();
    for part in of_the_same_channels(set) {
        if part.len() < few() {
            return Ok(None);
        }
        let signals = set.select(&part);
        let mean = averaging::average(&signals)?;
        // the parts have the same channels, so only noise counts in their differences
        let noise = mean.noise / (mean.n_signals as f64).sqrt();
        let near = Some(&fit.channel);
        let mut found = grey_box::identify(&mean.y, dt_s, noise, settings, near)?;
        if let Some((_, straight)) = scatter(&signals, &found, &mean, dt_s) {
            found = grey_box::identify(&straight, dt_s, noise, settings, Some(&found.channel))?;
        }
        parts.push((signals.mean_temperature_c().unwrap_or(f64::NAN), found));
    }
    let span_k = parts.last().zip(parts.first()).map_or(0.0, |(last, first)| last.0 - first.0);
    Ok(if span_k < tuned::least_span_k() { None } else { joint(&parts, fit) })
}

/// Indices of the signals, from cold to warm, in up to [`MOST_BINS`] parts with equally many
/// signals of each channel, so that the differences of channels are not taken for an effect of
/// temperature. With other channels at each temperature the parts are empty.
fn of_the_same_channels(set: &SignalSet) -> Vec<Vec<usize>> {
    let mut order: Vec<usize> =
        (0..set.len()).filter(|&i| set.temperature_c[i].is_finite()).collect();
    order.sort_by(|&i, &j| set.temperature_c[i].total_cmp(&set.temperature_c[j]));
    let bins = (order.len() / few()).min(MOST_BINS);
    if bins < 2 {
        return Vec::new();
    }
    let parts: Vec<&[usize]> = order.chunks(order.len().div_ceil(bins)).collect();

    let counted = |part: &&[usize]| {
        let mut counts: BTreeMap<u32, usize> = BTreeMap::new();
        part.iter().for_each(|&i| *counts.entry(set.channel[i]).or_default() += 1);
        counts
    };
    let counts: Vec<BTreeMap<u32, usize>> = parts.iter().map(counted).collect();
    let fewest = |channel: &u32| counts.iter().map(|of| of.get(channel).copied()).min().flatten();
    let kept = |part: &&[usize]| {
        let mut left: BTreeMap<u32, usize> = BTreeMap::new();
        let keep = |i: &&usize| {
            let channel = set.channel[**i];
            let left = left.entry(channel).or_insert_with(|| fewest(&channel).unwrap_or(0));
            let is_one = *left > 0;
            *left -= usize::from(is_one);
            is_one
        };
        part.iter().filter(keep).copied().collect()
    };
    parts.iter().map(kept).collect()
}

/// theta: ln of a, b, g, d in the first part, and ln viscosity over the first's of each other part.
/// `parts`: mean temperature, °C, and model. `None`: a part's covariance has no inverse.
fn joint(parts: &[(f64, Identification)], fit: &Identification) -> Option<ByTemperature> {
    let unknowns = 3 + parts.len();
    let start = fit.channel.times(RATES_PER_US).rates();
    let mut theta = DVector::from_fn(unknowns, |k, _| start.get(k).map_or(0.0, |rate| rate.ln()));

    // by part the cubic less what the unknowns give, whitened: chi-squared if the model holds
    let measured = |(_, found): &(f64, Identification)| Vector3::from(cubic_per_us(found.cubic));
    let whitening: Vec<Matrix3<f64>> = parts
        .iter()
        .map(|(_, found)| {
            let covariance = found.uncertainty.cubic_covariance_us;
            Matrix3::from_fn(|i, j| covariance[i][j]).cholesky()?.l().try_inverse()
        })
        .collect::<Option<_>>()?;
    let misfit = |theta: &DVector<f64>| {
        let mut left = DVector::zeros(3 * parts.len());
        for (k, (part, whiten)) in parts.iter().zip(&whitening).enumerate() {
            let viscosity = if k == 0 { 1.0 } else { theta[3 + k].exp() };
            let expected = cubic(theta, viscosity);
            left.fixed_rows_mut::<3>(3 * k).copy_from(&(whiten * (measured(part) - expected)));
        }
        left
    };

    let (mut here, mut normal) = (misfit(&theta), DMatrix::identity(unknowns, unknowns));
    let mut damping = 1e-3;
    for _ in 0..200 {
        let mut jacobian = DMatrix::zeros(here.len(), unknowns);
        for k in 0..unknowns {
            let (mut up, mut down) = (theta.clone(), theta.clone());
            up[k] += 1e-6;
            down[k] -= 1e-6;
            jacobian.set_column(k, &((misfit(&up) - misfit(&down)) / 2e-6));
        }
        normal = jacobian.tr_mul(&jacobian);
        let damped = &normal + DMatrix::from_diagonal(&(normal.diagonal() * damping));
        let Some(step) = damped.cholesky().map(|l| l.solve(&-jacobian.tr_mul(&here))) else {
            break;
        };
        let there = misfit(&(&theta + &step));
        if there.norm_squared() < here.norm_squared() {
            theta += &step;
            here = there;
            damping = (damping / 10.0).max(1e-12);
        } else {
            damping *= 10.0;
        }
        if step.amax() < 1e-9 || damping > 1e9 {
            break;
        }
    }

    // of the logarithm of a ratio; infinite where the unknowns ran away from each other
    let covariance = normal.try_inverse();
    let sd = |i: usize, j: usize| {
        let of_difference =
            |c: &DMatrix<f64>| (c[(i, i)] + c[(j, j)] - 2.0 * c[(i, j)]).max(0.0).sqrt();
        covariance.as_ref().map_or(f64::INFINITY, of_difference)
    };
    let freedom = here.len() - unknowns;
    Some(ByTemperature {
        temperatures_c: parts.iter().map(|(temperature, _)| *temperature).collect(),
        viscosity: std::iter::once(1.0).chain((4..unknowns).map(|k| theta[k].exp())).collect(),
        g_over_d: (theta[2] - theta[3]).exp(),
        g_over_d_sd: sd(2, 3),
        a_over_b: (theta[0] - theta[1]).exp(),
        a_over_b_sd: sd(0, 1),
        p_value: whiteness::chi_square_tail(here.norm_squared(), freedom),
    })
}

/// p2, p1, p0 (per µs) from the ln of the rates (per µs), where viscosity multiplies g and d.
fn cubic(theta: &DVector<f64>, viscosity: f64) -> Vector3<f64> {
    let [a, b, g, d]: [f64; 4] = std::array::from_fn(|k| theta[k].exp());
    Vector3::from(InkChannel::of([a, b, viscosity * g, viscosity * d]).cubic())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::normal::draws;
    use crate::model::{InkChannel, ring_down};
    use rand::{RngExt, SeedableRng};
    use rand_distr::{Distribution, StandardNormal};

    const DT_S: f64 = 0.78125e-6;

    /// Adds a signal of a channel of these rates at 21 °C, whose ink is so much warmer; `stiffer`:
    /// relative change of a and b per K.
    fn push(
        set: &mut SignalSet,
        (number, rates): (u32, &InkChannel),
        (warmer, stiffer): (f64, f64),
        mut noise: impl FnMut() -> f64,
    ) {
        let (thinner, stiffness) = (1.0 - 0.02 * warmer, 1.0 + stiffer * warmer);
        let now = InkChannel {
            a_per_s2: rates.a_per_s2 * stiffness,
            b_per_s2: rates.b_per_s2 * stiffness,
            g_per_s: rates.g_per_s * thinner,
            d_per_s: rates.d_per_s * thinner,
        };
        let x_a = nalgebra::dvector![1e-4, 0.0, 900.0, 400.0];
        let y = ring_down::ring_down(&now, &x_a, DT_S, 128);
        let y: Vec<f32> = y.iter().map(|y| (y + 4.0 * noise()) as f32).collect();
        set.push(&y, number, 1.0, 21.0 + warmer);
    }

    /// Signals of channels that are alike, whose ink gets warmer by 8 K.
    fn warming(channel: &InkChannel, stiffer: f64, seed: u64) -> SignalSet {
        let mut normal = draws(seed);
        let mut set = SignalSet::new(128);
        for k in 0..1600 {
            let warmer = 8.0 * f64::from(k) / 1600.0;
            push(&mut set, (k % 40, channel), (warmer, stiffer), &mut normal);
        }
        set
    }

    /// Forty signals of each of sixty channels whose rates differ as those of the physical
    /// benchmark do; `warmer` gives by how much a channel's ink is warmer at a look.
    fn differing(kappa: f64, warmer: impl Fn(u32, u32) -> f64, seed: u64) -> SignalSet {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let (nominal, mut set) = (InkChannel::NOMINAL, SignalSet::new(128));
        for number in 0..60 {
            let mut by = |half: f64| 1.0 + half * rng.random_range(-1.0..1.0);
            let channel = InkChannel {
                a_per_s2: by(0.004) * nominal.a_per_s2,
                b_per_s2: by(0.004) * nominal.b_per_s2,
                g_per_s: by(0.05) * kappa * nominal.d_per_s,
                d_per_s: by(0.08) * nominal.d_per_s,
            };
            for look in 0..40 {
                let noise = || StandardNormal.sample(&mut rng);
                push(&mut set, (number, &channel), (warmer(number, look), 0.0), noise);
            }
        }
        set
    }

    /// What the temperatures of signals tell.
    fn told(set: &SignalSet) -> Option<ByTemperature> {
        let (settings, mean) = (GreyBoxSettings::default(), averaging::average(set).unwrap());
        let fit = grey_box::identify(&mean.y, DT_S, mean.standard_error(), &settings, None);
        by_temperature(set, &fit.unwrap(), DT_S, &settings).unwrap()
    }

    /// Tests with channels that differ: first with unlike shares of them at each temperature, then
    /// with other channels at each temperature. The latter tells nothing, since the differences of
    /// channels would be taken for an effect of temperature.
    #[test]
    fn channels_that_differ_are_no_temperature() {
        let mut within = 0;
        for (seed, kappa) in (0..12).zip([0.3, 0.4].into_iter().cycle()) {
            // half of the channels are looked at more often while it is cold
            let skewed = |channel: u32, look: u32| {
                let at = f64::from(look) / 40.0;
                8.0 * if channel.is_multiple_of(2) { at } else { at * at }
            };
            let found = told(&differing(kappa, skewed, seed)).unwrap();
            let off = (found.g_over_d / kappa).ln() / found.g_over_d_sd;
            within += usize::from(!found.is_known() || off.abs() < 1.96);
        }
        assert!(within >= 9, "95 % intervals hold {within} of 12");
        let in_turn = |channel: u32, _| 8.0 * f64::from(channel) / 60.0;
        assert_eq!(told(&differing(0.3, in_turn, 1)), None);
    }

    /// Tests with channels that have neither the ratio g/d = .2 which the settings hold, nor the
    /// ratio a/b of about .5 on which the prior is centred.
    #[test]
    fn ratios_that_one_decay_cannot_tell_are_told_by_several_temperatures() {
        let mut within = 0;
        for (seed, kappa) in (0..12).zip([0.3, 0.4, 0.5].into_iter().cycle()) {
            let channel =
                InkChannel { g_per_s: kappa * InkChannel::NOMINAL.d_per_s, ..InkChannel::NOMINAL };
            let found = told(&warming(&channel, 0.0, seed)).unwrap();
            assert!(found.is_known(), "{found:?}");
            let off = (found.g_over_d / kappa).ln() / found.g_over_d_sd;
            let true_ratio = channel.a_per_s2 / channel.b_per_s2;
            let off_ratio = (found.a_over_b / true_ratio).ln() / found.a_over_b_sd;
            within += usize::from(off.abs() < 1.96) + usize::from(off_ratio.abs() < 1.96);
            assert!((found.viscosity[3] - 0.87).abs() < 0.03, "{:?}", found.viscosity);
        }
        assert!(within >= 20, "95 % intervals hold {within} of 24");
    }

    #[test]
    fn a_temperature_that_does_more_than_thin_the_ink_is_seen_and_little_of_it_tells_nothing() {
        let found = told(&warming(&InkChannel::NOMINAL, 0.01, 1)).unwrap();
        assert!(!found.is_known() && found.p_value < 0.01, "{found:?}");
        let mut set = warming(&InkChannel::NOMINAL, 0.0, 2);
        set.temperature_c.iter_mut().for_each(|t| *t = 25.0 + 0.1 * (*t - 25.0));
        assert_eq!(told(&set), None);
        set.temperature_c.fill(f64::NAN);
        assert_eq!(told(&set), None);
    }
}
