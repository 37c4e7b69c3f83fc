//! The average of a healthy window, robust against the faulty minority (thesis Fig. 3-2).
//!
//! In: the signals of a window of one printhead ([`SignalSet`]: n signals of N samples, counts,
//! with their covariates). Out: which of them agree with the majority ([`agreeing`]), and the mean
//! of signals per unit drive with the noise of one signal ([`average`]), which `grey_box` fits.
//!
//! * A signal is proportional to its relative drive s, so the mean is the least-squares response
//!   sum s_i y_i / sum s_i^2.
//! * Signals agree whose squared distance from the sample-wise median signal is at most four times
//!   the median of all squared distances; this is refined once, with the mean of those that agreed.

use super::damped_cosine::damped_cosine;
use super::{IdentifyError, SignalSet};
use crate::model::inner_product::dot;
use crate::model::median::median;
use std::borrow::Cow;

pub const FEWEST_SIGNALS: usize = 16;

pub fn enough(found: usize) -> Result<(), IdentifyError> {
    match found < FEWEST_SIGNALS {
        true => Err(IdentifyError::TooFewSignals { found, needed: FEWEST_SIGNALS }),
        false => Ok(()),
    }
}

#[derive(Clone, Debug)]
pub struct MeanSignal {
    /// The mean signal per unit drive, counts.
    pub y: Vec<f64>,
    /// Standard deviation of one sample of one signal about the mean, counts, noise included.
    pub scatter: f64,
    /// Standard deviation of one sample's noise alone, counts (`white_noise`).
    pub noise: f64,
    pub n_signals: usize,
    pub n_channels: usize,
}

impl MeanSignal {
    /// Standard error of one sample of the mean, counts. The scatter beyond noise is taken for
    /// lasting differences of channels, which average out only over channels.
    pub fn standard_error(&self) -> f64 {
        let shared = (self.scatter.powi(2) - self.noise.powi(2)).max(0.0);
        (self.noise.powi(2) / self.n_signals as f64 + shared / self.n_channels as f64).sqrt()
    }
}

/// The signal per unit drive by least squares, N counts, summed in row order. `kept`: indices.
fn response(set: &SignalSet, kept: impl Iterator<Item = usize>) -> Vec<f64> {
    let (mut y, mut weight) = (vec![0.0; set.samples], 0.0);
    for i in kept {
        let s = set.drive[i];
        y.iter_mut().zip(set.signal(i)).for_each(|(sum, &v)| *sum += s * f64::from(v));
        weight += s * s;
    }
    y.iter_mut().for_each(|v| *v /= weight);
    y
}

pub fn average(set: &SignalSet) -> Result<MeanSignal, IdentifyError> {
    enough(set.len())?;
    let y = response(set, 0..set.len());
    let square: f64 = distances(set, &y).iter().sum();
    let mut channels = set.channel.clone();
    channels.sort_unstable();
    channels.dedup();
    Ok(MeanSignal {
        scatter: (square / (set.len() * set.samples) as f64).sqrt(),
        noise: white_noise(set),
        y,
        n_signals: set.len(),
        n_channels: channels.len(),
    })
}

/// Indices of the signals that agree with the majority. A window of which less than `least_share`
/// agrees is refused: nobody knows what is healthy.
pub fn agreeing(set: &SignalSet, least_share: f64) -> Result<Vec<usize>, IdentifyError> {
    const REACH: f64 = 4.0;
    enough(set.len())?;
    let mut centre = median_signal(set);
    let mut keep = Vec::new();
    for _ in 0..2 {
        let distances = distances(set, &centre);
        let limit = REACH * median(&mut distances.clone());
        keep = (0..set.len()).filter(|&i| distances[i] <= limit).collect();
        if (keep.len() as f64) < least_share * set.len() as f64 {
            let (inliers, signals, least) = (keep.len(), set.len(), least_share);
            return Err(IdentifyError::NoMajority { inliers, signals, least });
        }
        enough(keep.len())?;
        centre = response(set, keep.iter().copied());
    }
    Ok(keep)
}

/// What is taken for healthy: the signals that agree if a `least` share has to, else all.
pub fn healthy(set: &SignalSet, least: Option<f64>) -> Result<Cow<'_, SignalSet>, IdentifyError> {
    Ok(match least {
        Some(least) => Cow::Owned(set.select(&agreeing(set, least)?)),
        None => Cow::Borrowed(set),
    })
}

/// The squared distance ||y_i - s_i centre||^2 of every signal, counts².
fn distances(set: &SignalSet, centre: &[f64]) -> Vec<f64> {
    let mut off = vec![0.0; set.samples];
    let of = |i: usize| {
        let s = set.drive[i];
        let signal = set.signal(i).iter().zip(centre);
        off.iter_mut().zip(signal).for_each(|(off, (&v, c))| *off = f64::from(v) - s * c);
        dot(&off, &off)
    };
    (0..set.len()).map(of).collect()
}

fn median_signal(set: &SignalSet) -> Vec<f64> {
    medians(set, |y, drive| y / drive)
}

/// Where the signals stand while nothing rings, counts: the constant beside the damped cosine that is nearest to the
/// median signal. It does not grow with the drive. `None`: nothing rings.
pub fn offset(set: &SignalSet, dt_s: f64) -> Option<f64> {
    let found = damped_cosine(&medians(set, |y, _| y), dt_s)?;
    Some(found.constant).filter(|offset| offset.is_finite())
}

/// The median over signals of each sample, as `of` makes it of sample and relative drive.
fn medians(set: &SignalSet, of: impl Fn(f64, f64) -> f64) -> Vec<f64> {
    let column = |k: usize| -> Vec<f64> {
        (0..set.len()).map(|i| of(set.data[i * set.samples + k].into(), set.drive[i])).collect()
    };
    (0..set.samples).map(|k| median(&mut column(k))).collect()
}

/// Standard deviation of one sample's noise, counts, from third differences of the difference of
/// two signals of one channel (or of different ones where too few pairs are of one): their rings
/// cancel, and what is left of them is smooth. The median, since a ring may change in between.
fn white_noise(set: &SignalSet) -> f64 {
    // neighbours in the order of channels are pairs of one channel as far as possible
    let mut by_channel: Vec<usize> = (0..set.len()).collect();
    by_channel.sort_by_key(|&i| set.channel[i]);
    let is_of_one = |pair: &[usize]| set.channel[pair[0]] == set.channel[pair[1]];
    let few_of_one = by_channel.windows(2).filter(|pair| is_of_one(pair)).count() < FEWEST_SIGNALS;
    let pairs = by_channel.windows(2).filter(|pair| few_of_one || is_of_one(pair));

    // 20 = 1 + 9 + 9 + 1 times the noise's variance, and two signals at equal drive double that
    let mut squares = Vec::with_capacity(set.len());
    for pair in pairs {
        let ratio = (set.drive[pair[1]] / set.drive[pair[0]]) as f32;
        let (p, q) = (set.signal(pair[0]), set.signal(pair[1]));
        let mut sum = 0.0;
        for k in 3..set.samples {
            let d = |k: usize| f64::from(q[k] - ratio * p[k]);
            sum += (d(k) - 3.0 * d(k - 1) + 3.0 * d(k - 2) - d(k - 3)).powi(2);
        }
        let gain = 20.0 * (1.0 + f64::from(ratio * ratio));
        squares.push(sum / gain / (set.samples.max(4) - 3) as f64);
    }
    median(&mut squares).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::burst::Beside;

    fn ringing(n: usize, faulty: usize) -> SignalSet {
        let mut set = SignalSet::new(32);
        for i in 0..n {
            let wrong = if i < faulty { 1.3 } else { 1.0 };
            let signal: Vec<f32> = (0..32)
                .map(|k| {
                    let noise = (((i * 37 + k * 101) % 17) as f32 - 8.0) * 0.5;
                    400.0 * (0.3 * wrong * k as f32).cos() + noise
                })
                .collect();
            set.push(&signal, 1.0, &Beside::alone(i as u32, 0));
        }
        set
    }

    /// Draws a ring of 64 samples, with noise of standard deviation 2.5.
    fn noisy_ring(amplitude: f64, omega: f64, normal: &mut impl FnMut() -> f64) -> Vec<f32> {
        let ring = |k: f64| amplitude * (-0.03 * k).exp() * (omega * k).cos();
        (0..64).map(|k| (ring(f64::from(k)) + 2.5 * normal()) as f32).collect()
    }

    #[test]
    fn white_noise_is_found_beside_rings_of_any_drive() {
        // The channels ring differently, and their signals come in any order. A ring of 5 samples'
        // period is little smoother than noise.
        let mut normal = crate::model::normal::draws(31);
        let rings: Vec<[f64; 2]> =
            (0..100).map(|_| [1.0 + 0.03 * normal(), 300.0 * (1.0 + 0.05 * normal())]).collect();
        for omega in [0.4, 1.2] {
            for drives in [[1.0, 1.0], [0.7, 1.4]] {
                let mut set = SignalSet::new(64);
                for i in 0..400 {
                    let (drive, channel) = (drives[i / 100 % 2], i * 37 % 100);
                    let [faster, amplitude] = rings[channel];
                    let signal = noisy_ring(drive * amplitude, faster * omega, &mut normal);
                    set.push(&signal, drive, &Beside::alone(channel as u32, 0));
                }
                let found = white_noise(&set);
                assert!((found / 2.5 - 1.0).abs() < 0.05, "{found} at {drives:?}, {omega}");
            }
        }
    }

    /// Of the only channel that is there twice the ring has changed in between.
    #[test]
    fn one_channel_does_not_tell_the_noise_of_all() {
        let mut normal = crate::model::normal::draws(32);
        let mut set = SignalSet::new(64);
        for i in 0..200_u32 {
            let omega = if i == 199 { 1.3 } else { 0.4 };
            let beside = Beside::alone(i.min(198), 0);
            set.push(&noisy_ring(300.0, omega, &mut normal), 1.0, &beside);
        }
        let found = white_noise(&set);
        assert!((found / 2.5 - 1.0).abs() < 0.05, "{found}");
    }

    #[test]
    fn temperature_is_the_mean_of_what_was_recorded() {
        let mut set = SignalSet::new(4);
        assert_eq!(set.mean_temperature_c(), None);
        for temperature_c in [f64::NAN, 20.0, 23.0, f64::NAN] {
            set.push(&[0.0; 4], 1.0, &Beside { temperature_c, ..Beside::alone(0, 0) });
        }
        assert_eq!(set.mean_temperature_c(), Some(21.5));
    }

    #[test]
    fn faulty_minority_does_not_move_the_mean() {
        let clean = average(&ringing(100, 0)).unwrap();
        let mixed = ringing(100, 20);
        let keep = agreeing(&mixed, 0.6).unwrap();
        assert_eq!(keep.len(), 80);
        let mean = average(&mixed.select(&keep)).unwrap();
        let off = mean.y.iter().zip(&clean.y).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off < 1.0, "mean moved by {off} counts");
    }

    #[test]
    fn window_without_a_majority_is_refused() {
        assert!(matches!(agreeing(&ringing(100, 45), 0.6), Err(IdentifyError::NoMajority { .. })));
    }

    #[test]
    fn drive_scales_the_expected_signal() {
        let mut set = SignalSet::new(8);
        for i in 0..32 {
            let s = if i % 2 == 0 { 1.0 } else { 0.8 };
            let signal: Vec<f32> = (0..8).map(|k| (s * 100.0 * (k as f64 + 1.0)) as f32).collect();
            set.push(&signal, s, &Beside::alone(i, 0));
        }
        let mean = average(&set).unwrap();
        assert!((mean.y[3] - 400.0).abs() < 1e-3);
        assert!(mean.scatter < 1e-3);
    }
}
