//! The observable poles of an ink channel from its rates: one damped pair and one real pole.
//!
//! In: the rates a, b, g, d. Out: damping, frequency and decay rate of the real pole. They are the
//! roots of p3(s) = s^3 + (g+d) s^2 + (gd+a+b) s + (ad+bg), thesis (2-2).

use super::InkChannel;
use super::ring_down::Poles;
use std::f64::consts::TAU;

impl InkChannel {
    /// `None`: the pair is overdamped, or the rates are not all positive and finite.
    ///
    /// p3(-g) = a (d - g) and p3(-d) = b (g - d) have opposite signs, so a real pole -lambda lies
    /// between -g and -d. Division by (s + lambda) leaves s^2 + 2 sigma s + q with 2 sigma = p2 -
    /// lambda and q = p0 / lambda, and omega^2 = q - sigma^2.
    pub fn poles(&self) -> Option<Poles> {
        if !self.rates().iter().all(|r| *r > 0.0 && r.is_finite()) {
            return None;
        }
        let (g, d) = (self.g_per_s, self.d_per_s);
        let [p2, p1, p0] = self.cubic();

        // p3(-x) is positive at the smaller of g, d; bisect until no number lies between
        let p3_at_minus = |x: f64| ((p2 - x) * x - p1) * x + p0;
        let (mut low, mut high) = (g.min(d), g.max(d));
        while let mid = 0.5 * (low + high)
            && low < mid
            && mid < high
        {
            if p3_at_minus(mid) > 0.0 {
                low = mid;
            } else {
                high = mid;
            }
        }
        let lambda_per_s = 0.5 * (low + high);

        let damping_per_s = 0.5 * (p2 - lambda_per_s);
        let omega2 = p0 / lambda_per_s - damping_per_s * damping_per_s;
        let frequency_hz = omega2.sqrt() / TAU;
        (omega2 > 0.0).then_some(Poles { damping_per_s, frequency_hz, lambda_per_s })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::ring_down::eigenvalues;

    const NOMINAL: InkChannel = InkChannel::NOMINAL;

    #[test]
    fn nominal_poles_are_the_published_ones() {
        let p = NOMINAL.poles().unwrap();
        assert!((p.damping_per_s / 2.917e4 - 1.0).abs() < 2e-4, "{p:?}");
        assert!((p.frequency_hz / 64.69e3 - 1.0).abs() < 2e-4, "{p:?}");
        assert!((p.lambda_per_s / 3.767e4 - 1.0).abs() < 2e-4, "{p:?}");
    }

    #[test]
    fn poles_are_eigenvalues_of_a() {
        for d_per_s in [8.0e4, 2.0e4, 1.6e4, 1.0e4] {
            let channel = InkChannel { d_per_s, ..NOMINAL };
            let p = channel.poles().unwrap();
            let eigenvalues = eigenvalues(&channel);
            let has = |re: f64, im: f64| {
                eigenvalues.iter().any(|z| ((z.re - re).hypot(z.im - im)) < 1e-6 * 4e5)
            };
            assert!(has(-p.damping_per_s, TAU * p.frequency_hz), "{eigenvalues:?} {p:?}");
            assert!(has(-p.lambda_per_s, 0.0), "{eigenvalues:?} {p:?}");
        }
    }

    #[test]
    fn an_overdamped_channel_has_no_pair() {
        assert!(InkChannel { g_per_s: 5e6, d_per_s: 4e6, ..NOMINAL }.poles().is_none());
        assert!(InkChannel { a_per_s2: f64::NAN, ..NOMINAL }.poles().is_none());
    }
}
