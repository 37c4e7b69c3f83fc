//! The ink channel of thesis (2-2), described by the four rates that its matrix A depends on.
//!
//! In: the rates a = 1/(I_r B_t), b = 1/(I_n B_t), g = R_r/I_r, d = R_n/I_n. Out: the matrices A
//! and C, the polynomial of the observable poles, and e^{A t}.

use nalgebra::{DMatrix, Matrix4, dmatrix};

/// A channel x' = A x, y = C x, which rings from an acquisition state x_a that is not zero.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InkChannel {
    pub a_per_s2: f64,
    pub b_per_s2: f64,
    pub g_per_s: f64,
    pub d_per_s: f64,
}

impl InkChannel {
    pub fn rates(&self) -> [f64; 4] {
        [self.a_per_s2, self.b_per_s2, self.g_per_s, self.d_per_s]
    }

    pub fn of(rates: [f64; 4]) -> InkChannel {
        let [a_per_s2, b_per_s2, g_per_s, d_per_s] = rates;
        InkChannel { a_per_s2, b_per_s2, g_per_s, d_per_s }
    }

    pub fn times(&self, by: [f64; 4]) -> InkChannel {
        let rates = self.rates();
        InkChannel::of(std::array::from_fn(|j| rates[j] * by[j]))
    }

    pub fn a(&self) -> DMatrix<f64> {
        let [a, b, g, d] = self.rates();
        dmatrix![
            0.0, 0.0, 1.0, 0.0;
            0.0, 0.0, 0.0, 1.0;
            -a, -a, -g, 0.0;
            -b, -b, 0.0, -d]
    }

    /// The matrix C = [0 0 1 1], thesis §3-1: flows are in counts, volumes in counts·s.
    pub fn c(&self) -> DMatrix<f64> {
        dmatrix![0.0, 0.0, 1.0, 1.0]
    }

    /// (p2, p1, p0) of the observable s^3 + p2 s^2 + p1 s + p0, in 1/s, 1/s², 1/s³. Departs: thesis
    /// §3-2-1 II has N(s)L(s) = det(A - sI) = s times this; the pole at 0 (ink that moves from
    /// restrictor to nozzle) is unobservable, so the numerator is the cubic alone.
    pub fn cubic(&self) -> [f64; 3] {
        let [a, b, g, d] = self.rates();
        [g + d, g * d + a + b, a * d + b * g]
    }

    /// A_d = e^{A t}, with x(t) = A_d x(0), in the coordinates of A. It is `ring_down::discretise`
    /// without allocation: simulating a print run needs three per signal.
    ///
    /// By scaling and squaring: volumes are counted in flow / omega with omega^2 = a + b, so that
    /// the norm of A t is about omega t. A t / 2^j, whose norm is at most 1/4, has its exponential
    /// by a Taylor series to order 12 (remainder below 1e-16), which is squared j times.
    pub fn transition(&self, t_s: f64) -> Matrix4<f64> {
        let [a, b, g, d] = self.rates();
        let omega = (a + b).sqrt();
        let tau = omega * t_s;
        let (a, b) = (tau * a / (omega * omega), tau * b / (omega * omega));
        let (g, d) = (t_s * g, t_s * d);
        let at = Matrix4::new(
            0.0, 0.0, tau, 0.0, //
            0.0, 0.0, 0.0, tau, //
            -a, -a, -g, 0.0, //
            -b, -b, 0.0, -d,
        );

        // halved until its norm (the largest sum of a row) is at most 1/4
        let norm = at.abs().column_sum().max();
        let halvings = (4.0 * norm).log2().ceil().clamp(0.0, 60.0) as i32;
        let at = at * 0.5_f64.powi(halvings);

        let mut e = Matrix4::identity();
        for k in (1..=12).rev() {
            e = Matrix4::identity() + at * e / f64::from(k);
        }
        for _ in 0..halvings {
            e *= e;
        }

        // back from volumes in flow/omega to the coordinates of A
        for i in 0..2 {
            for j in 0..2 {
                e[(i, j + 2)] /= omega;
                e[(i + 2, j)] *= omega;
            }
        }
        e
    }

    /// The nominal channel of tests and simulations, and the default guess of (3-1). The thesis
    /// states no rates; these give a plausible ring of 64.7 kHz with a damping of 2.9e4 1/s.
    pub const NOMINAL: InkChannel =
        InkChannel { a_per_s2: 5.6e10, b_per_s2: 1.11e11, g_per_s: 1.6e4, d_per_s: 8e4 };
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::ring_down::discretise;

    #[test]
    fn transition_is_the_matrix_exponential() {
        let nominal = InkChannel::NOMINAL;
        let blocked = InkChannel { b_per_s2: 5.5e8, d_per_s: 1.6e7, ..nominal };
        for channel in [nominal, blocked] {
            for t_s in [0.0, 1e-9, 0.78125e-6, 6e-6, 100e-6] {
                let (fast, slow) = (channel.transition(t_s), discretise(&channel.a(), t_s));
                for i in 0..4 {
                    for j in 0..4 {
                        let scale = 4e5_f64.powi(i32::from(i >= 2) - i32::from(j >= 2));
                        let off = (fast[(i, j)] - slow[(i, j)]).abs();
                        assert!(off < 1e-11 * scale, "{t_s} {i} {j}: {fast} {slow}");
                    }
                }
            }
        }
    }
}
