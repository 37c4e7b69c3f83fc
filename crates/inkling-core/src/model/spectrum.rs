//! Spectrum of series of one length, and its highest peaks; angular frequencies are in rad per sample.

use nalgebra::Complex;
use std::f64::consts::PI;

/// Fast Fourier transform in place (radix two, decimation in time); the length is a power of two from 2 on.
fn transform(y: &mut [Complex<f64>]) {
    let n = y.len();
    // put the samples into bit-reversed order
    for i in 0..n {
        let j = i.reverse_bits() >> (usize::BITS - n.trailing_zeros());
        if i < j {
            y.swap(i, j);
        }
    }
    let mut length = 2;
    while length <= n {
        let step = Complex::from_polar(1.0, -2.0 * PI / length as f64);
        for part in y.chunks_mut(length) {
            let (low, high) = part.split_at_mut(length / 2);
            let mut turn = Complex::from(1.0);
            for (p, q) in low.iter_mut().zip(high) {
                let turned = *q * turn;
                (*p, *q) = (*p + turned, *p - turned);
                turn *= step;
            }
        }
        length *= 2;
    }
}

/// Periodogram |sum over k of y_k e^{-i omega k}|^2 / n of n samples, at omega = 2 pi j / length for j from 0
/// to length / 2. `length` is the first power of two from 4 n on: zero padding interpolates the spectrum.
/// White noise has its variance as the mean at every omega.
fn power(y: &[f64]) -> Vec<f64> {
    let length = (4 * y.len()).next_power_of_two();
    let mut all: Vec<Complex<f64>> = y.iter().map(|y| Complex::from(*y)).collect();
    all.resize(length, Complex::ZERO);
    transform(&mut all);
    all[..=length / 2].iter().map(|z| z.norm_sqr() / y.len() as f64).collect()
}

/// Sum of the periodograms of several series of one length, each times `weight`.
pub fn total<Series: AsRef<[f64]>>(all: impl Iterator<Item = Series>, weight: f64) -> Vec<f64> {
    let mut sum: Vec<f64> = Vec::new();
    for power in all.map(|series| power(series.as_ref())) {
        sum.resize(power.len(), 0.0);
        sum.iter_mut().zip(power).for_each(|(s, p)| *s += weight * p);
    }
    sum
}

/// Frequencies of at most `count` peaks of a spectrum, rad per sample, the highest first. `power`: at equal
/// steps from 0 to pi, which do not count. Peaks closer than `apart` to a higher one are left out.
pub fn peaks(power: &[f64], lowest: f64, apart: f64, count: usize) -> Vec<f64> {
    let step = PI / (power.len() - 1) as f64;
    let mut order: Vec<usize> = (1..power.len() - 1)
        .filter(|&j| {
            power[j] >= power[j - 1] && power[j] > power[j + 1] && j as f64 * step >= lowest
        })
        .collect();
    order.sort_by(|p, q| power[*q].total_cmp(&power[*p]));
    let mut found: Vec<f64> = Vec::new();
    for j in order {
        let omega = j as f64 * step;
        if found.iter().all(|f| (f - omega).abs() >= apart) {
            found.push(omega);
        }
        if found.len() >= count {
            break;
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cosine_peaks_at_its_frequency_with_n_times_a_quarter_of_its_amplitude_squared() {
        let y: Vec<f64> = (0..300).map(|k| 2.0 * (0.7 * f64::from(k) + 0.3).cos()).collect();
        let power = power(&y);
        let omega = peaks(&power, 0.05, 0.05, 1)[0];
        assert!((omega - 0.7).abs() < 2e-3, "{omega}");
        let top = power.iter().copied().fold(0.0, f64::max);
        assert!((top / 300.0 - 1.0).abs() < 0.02);
    }
}
