//! Cosines and sines at the samples of a signal, and the power of a signal at one frequency. Each sample's
//! pair is the one before, rotated and attenuated, which is faster than trigonometric functions.

/// e^{-sigma k} cos(omega k) and e^{-sigma k} sin(omega k), k = 0, 1, ...; rates per sample.
pub fn waves(sigma: f64, omega: f64, samples: usize) -> [Vec<f64>; 2] {
    let mut both = [Vec::with_capacity(samples), Vec::with_capacity(samples)];
    turn(sigma, omega, samples, |c, s| {
        both[0].push(c);
        both[1].push(s);
    });
    both
}

/// Power of y at `omega` radians per sample, |sum y e^{-i omega k}|².
pub fn power_at(omega: f64, y: &[f64]) -> f64 {
    let (mut re, mut im, mut rest) = (0.0, 0.0, y.iter());
    turn(0.0, omega, y.len(), |c, s| {
        let y = rest.next().copied().unwrap_or(0.0);
        re += y * c;
        im += y * s;
    });
    re * re + im * im
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

/// Calls `each` with the damped cosine and sine of each sample, starting with (1, 0).
fn turn(sigma: f64, omega: f64, samples: usize, mut each: impl FnMut(f64, f64)) {
    let fall = (-sigma).exp();
    let (sin, cos) = omega.sin_cos();
    let (mut c, mut s) = (1.0, 0.0);
    for _ in 0..samples {
        each(c, s);
        (c, s) = (fall * (c * cos - s * sin), fall * (s * cos + c * sin));
    }
}
