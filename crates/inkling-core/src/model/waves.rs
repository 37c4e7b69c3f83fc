//! Cosines and sines at the samples of a signal, and the power of a signal at one frequency. Each sample's
//! pair is the one before, rotated and attenuated, which is faster than trigonometric functions.

use nalgebra::Complex;
use std::iter::successors;

/// e^{(-sigma + i omega) k}, k = 0, 1, ...; rates per sample.
fn turning(sigma: f64, omega: f64) -> impl Iterator<Item = Complex<f64>> {
    let step = Complex::from_polar((-sigma).exp(), omega);
    successors(Some(Complex::ONE), move |wave| Some(wave * step))
}

/// e^{-sigma k} cos(omega k) and e^{-sigma k} sin(omega k); rates per sample.
pub fn waves(sigma: f64, omega: f64, samples: usize) -> [Vec<f64>; 2] {
    let (cosine, sine) = turning(sigma, omega).take(samples).map(|wave| (wave.re, wave.im)).unzip();
    [cosine, sine]
}

/// Power of y at `omega` radians per sample, |sum y e^{-i omega k}|².
pub fn power_at(omega: f64, y: &[f64]) -> f64 {
    y.iter().zip(turning(0.0, omega)).map(|(y, wave)| wave * *y).sum::<Complex<f64>>().norm_sqr()
}

/// cos(w t) and sin(w t)/w with w² = `square`; cosh and sinh where that is negative.
pub fn swing(square: f64, t: f64) -> [f64; 2] {
    let w = square.abs().sqrt();
    match square {
        _ if w * t <= 1e-9 => [1.0, t],
        q if q > 0.0 => [(w * t).cos(), (w * t).sin() / w],
        _ => [(w * t).cosh(), (w * t).sinh() / w],
    }
}
