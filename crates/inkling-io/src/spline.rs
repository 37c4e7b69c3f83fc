//! Natural cubic splines, by which `sampling.rs` interpolates decays.
//!
//! In: points (t, y). Out: the curve through them at any time between the first and the last.

/// The natural cubic spline through the points (t, y), where t increases: cubic between knots, with
/// continuous first and second derivatives, and no curvature at the ends.
pub struct Spline<'a> {
    t: &'a [f64],
    y: &'a [f64],
    /// Second derivatives of the spline at the knots.
    bend: Vec<f64>,
}

impl Spline<'_> {
    /// Solves the tridiagonal equations for the second derivatives m, by the Thomas algorithm: (1 -
    /// s_i) m_(i+1) + 2 m_i + s_i m_(i-1) = 6 (difference of slopes at i) / (t_(i+1) - t_(i-1)),
    /// where s_i is the share of the step before the knot (`share`), and m is 0 at both ends.
    pub fn new<'a>(t: &'a [f64], y: &'a [f64]) -> Spline<'a> {
        let n = t.len();
        let (mut bend, mut upper) = (vec![0.0; n], vec![0.0; n]);
        for i in 1..n - 1 {
            // forward elimination, row by row; `bend` holds the factors of the back substitution
            let share = (t[i] - t[i - 1]) / (t[i + 1] - t[i - 1]);
            let pivot = share * bend[i - 1] + 2.0;
            bend[i] = (share - 1.0) / pivot;
            let slope =
                (y[i + 1] - y[i]) / (t[i + 1] - t[i]) - (y[i] - y[i - 1]) / (t[i] - t[i - 1]);
            upper[i] = (6.0 * slope / (t[i + 1] - t[i - 1]) - share * upper[i - 1]) / pivot;
        }
        bend[n - 1] = 0.0;
        for i in (0..n - 1).rev() {
            bend[i] = bend[i] * bend[i + 1] + upper[i];
        }
        Spline { t, y, bend }
    }

    /// The spline's value at a time, and how far that time lies from the nearest knot.
    pub fn at(&self, t: f64) -> (f64, f64) {
        let right = self.t.partition_point(|knot| *knot < t).clamp(1, self.t.len() - 1);
        let left = right - 1;
        let h = self.t[right] - self.t[left];
        let (a, b) = ((self.t[right] - t) / h, (t - self.t[left]) / h);
        // the chord between the two knots, and the curvature beyond it
        let bent = (a.powi(3) - a) * self.bend[left] + (b.powi(3) - b) * self.bend[right];
        let value = a * self.y[left] + b * self.y[right] + bent * h * h / 6.0;
        (value, (t - self.t[left]).abs().min((self.t[right] - t).abs()))
    }
}
