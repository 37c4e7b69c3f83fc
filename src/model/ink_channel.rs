//! The ink channel, thesis (2-2), in its four rates.

use super::Plant;
use nalgebra::{DMatrix, dmatrix};

/// Thesis (2-2) in the rates that its A depends on.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct InkChannel {
    /// 1/(I_r B_t), 1/s².
    pub a_per_s2: f64,
    /// 1/(I_n B_t), 1/s².
    pub b_per_s2: f64,
    /// R_r/I_r, 1/s.
    pub g_per_s: f64,
    /// R_n/I_n, 1/s.
    pub d_per_s: f64,
}

impl Plant for InkChannel {
    fn a(&self) -> DMatrix<f64> {
        let InkChannel { a_per_s2: a, b_per_s2: b, g_per_s: g, d_per_s: d } = *self;
        dmatrix![
            0.0, 0.0, 1.0, 0.0;
            0.0, 0.0, 0.0, 1.0;
            -a, -a, -g, 0.0;
            -b, -b, 0.0, -d]
    }

    /// Thesis §3-1: C = [0 0 1 1]; the counts per flow are in the state's unit.
    fn c(&self) -> DMatrix<f64> {
        dmatrix![0.0, 0.0, 1.0, 1.0]
    }
}

impl InkChannel {
    /// (p2, p1, p0) of the observable polynomial s^3 + p2 s^2 + p1 s + p0, in 1/s, 1/s², 1/s³.
    /// Departs: thesis §3-2-1 II has N(s)L(s) = det(A - sI); the pole at 0 is unobservable, so the
    /// numerator is this cubic (physics of (1, -1, 0, 0): C maps the eigenvector of 0 to 0).
    pub fn cubic(&self) -> [f64; 3] {
        let InkChannel { a_per_s2: a, b_per_s2: b, g_per_s: g, d_per_s: d } = *self;
        [g + d, g * d + a + b, a * d + b * g]
    }
}
