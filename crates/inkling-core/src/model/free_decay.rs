//! A free decay of thesis (2-2) as it shows in the output, and its derivatives by its parameters.
//! Model critique fits this form to signals.
//!
//! y(t) = e^{-sigma t} (a cos omega t + b sin omega t) + c e^{-lambda t}, counts per unit drive.
//! Time is in signal lengths (sample k of N lies at t = k / N), so that rates are near 1..100 for
//! any plant. The b and c here are amplitudes, not the rate b and the output gain c of thesis
//! (2-2).
//!
//! In: the parameters theta, and N. Out: the N samples of y, and the N x 6 Jacobian dy/d(theta).

use nalgebra::SVector;

/// Number of parameters that differ from channel to channel: all but ln lambda.
pub const FREE: usize = 5;
pub const ALL: usize = 6;

/// ln sigma, ln omega, a, b, c, ln lambda; rates per signal length, amplitudes in counts per unit
/// drive.
pub type Theta = SVector<f64, ALL>;

/// The decay y, counts per unit drive, and the columns dy/d(theta_j) of its Jacobian, N each;
/// buffers that are used again from call to call.
#[derive(Clone, Debug, Default)]
pub struct Tangent {
    pub y: Vec<f64>,
    pub columns: [Vec<f64>; ALL],
}

/// The motions that a decay is made of, e^{-sigma t} cos omega t, e^{-sigma t} sin omega t and
/// e^{-lambda t}, sample by sample from time `shift` on; `n` samples per signal length. Each sample
/// follows from the one before, so that exponentials and sines are computed only once.
fn motions(theta: &Theta, shift: f64, n: f64) -> impl Iterator<Item = [f64; 3]> {
    let (sigma, omega, lambda) = (theta[0].exp(), theta[1].exp(), theta[5].exp());
    let decay = (-sigma / n).exp();
    let (sin, cos) = (omega / n).sin_cos();
    let fall = (-lambda / n).exp();

    let start = (-sigma * shift).exp();
    let (s0, c0) = (omega * shift).sin_cos();
    let r = (-lambda * shift).exp();
    std::iter::successors(Some([start * c0, start * s0, r]), move |&[c, s, r]| {
        Some([decay * (c * cos - s * sin), decay * (s * cos + c * sin), r * fall])
    })
}

/// Adds `scale` times the decay of `theta` to `out`, from time `shift` on; `out` is taken to hold
/// one signal length.
pub fn add(theta: &Theta, shift: f64, scale: f64, out: &mut [f64]) {
    let motions = motions(theta, shift, out.len() as f64);
    for (y, [c, s, r]) in out.iter_mut().zip(motions) {
        *y += scale * (theta[2] * c + theta[3] * s + theta[4] * r);
    }
}

impl Tangent {
    /// Computes decay and Jacobian at `theta`. `weak`: the amplitude c for the column dy/d(ln
    /// lambda) = -lambda t c e^{-lambda t}. A single signal hardly determines its own c, and with
    /// so noisy a regressor the column would bias the fit (errors in variables), so the caller
    /// gives a c that rests on many signals.
    pub fn at(&mut self, theta: &Theta, weak: f64, samples: usize) {
        let n = samples as f64;
        let (sigma, omega, lambda) = (theta[0].exp(), theta[1].exp(), theta[5].exp());
        let (a, b, c_real) = (theta[2], theta[3], theta[4]);
        self.y.resize(samples, 0.0);
        self.columns.iter_mut().for_each(|column| column.resize(samples, 0.0));
        for (k, [c, s, r]) in (0..samples).zip(motions(theta, 0.0, n)) {
            let t = k as f64 / n;
            let pair = a * c + b * s;
            self.y[k] = pair + c_real * r;

            let by_omega = omega * t * (b * c - a * s);
            let slopes = [-sigma * t * pair, by_omega, c, s, r, -lambda * t * weak * r];
            self.columns.iter_mut().zip(slopes).for_each(|(column, slope)| column[k] = slope);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tangent_is_the_derivative_of_the_signal() {
        let theta = Theta::from([2.9_f64.ln(), 40.6_f64.ln(), 90.0, -40.0, 6.0, 3.7_f64.ln()]);
        let mut tangent = Tangent::default();
        tangent.at(&theta, theta[4], 128);
        let mut y = vec![0.0; 128];
        add(&theta, 0.0, 1.0, &mut y);
        assert!(y.iter().zip(&tangent.y).all(|(y, z)| (y - z).abs() < 1e-9));
        for j in 0..ALL {
            let mut step = Theta::zeros();
            step[j] = 1e-6 * theta[j].abs().max(1.0);
            let (mut up, mut down) = (vec![0.0; 128], vec![0.0; 128]);
            add(&(theta + step), 0.0, 1.0, &mut up);
            add(&(theta - step), 0.0, 1.0, &mut down);
            for k in 0..128 {
                let slope = (up[k] - down[k]) / (2.0 * step[j]);
                assert!((slope - tangent.columns[j][k]).abs() < 1e-4, "{j} {k}");
            }
        }
    }

    #[test]
    fn a_later_start_is_the_same_decay_later() {
        let theta = Theta::from([2.9_f64.ln(), 40.6_f64.ln(), 90.0, -40.0, 6.0, 3.7_f64.ln()]);
        let (mut all, mut later) = (vec![0.0; 128], vec![0.0; 64]);
        add(&theta, 0.0, 1.0, &mut all);
        // 64 samples make the grid twice as coarse, so these are every second sample of the whole
        add(&theta, 16.0 / 128.0, 1.0, &mut later);
        for k in 0..40 {
            assert!((later[k] - all[16 + 2 * k]).abs() < 1e-9);
        }
    }
}
