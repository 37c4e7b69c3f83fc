//! Where most of some features lie, whatever the others do.
//!
//! In: (ln amplitude, ln damping, ln frequency, phase) of channels, and how healthy ones scatter. Out: an M-estimate of
//! their middle, its variance, and how much of them counts.

use nalgebra::Vector4;

/// Of a ring's ln amplitude, ln damping, ln frequency and phase, rad.
pub type Change = Vector4<f64>;

/// In standard deviations, what counts for nothing: nine tenths of a mean's efficiency for a Gaussian, and a
/// past that is of few looks.
const FAR: f64 = 4.5;

/// Tukey's weight of what lies `off`, by the feature that lies farthest.
pub(super) fn bisquare(off: Change, sd: &Change) -> f64 {
    let far = off.component_div(sd).amax() / FAR;
    (1.0 - far * far).max(0.0).powi(2)
}

/// Where most of some features lie.
#[derive(Clone, Copy, Debug)]
pub(super) struct Location {
    pub middle: Change,
    /// Of one about it.
    pub variance: Change,
    /// What counts, in whole features.
    pub weight: f64,
}

impl Location {
    /// Tukey's M-estimate from the middles of the shortest halves on: it redescends, so that what lies far off in
    /// one feature counts for nothing, and moves smoothly with every value (Maronna, Martin, Yohai 2006,
    /// sections 2.2 and 6.4). `sd`: of healthy ones. At least one value.
    pub fn of(values: &[Change], sd: &Change) -> Location {
        let middle = Vector4::from_fn(|k, _| shortest_half(values.iter().map(|v| v[k])));
        Location::near(middle, values, sd)
    }

    /// The same from where it is expected: it stays with those that are still there, and goes with most of them where
    /// they go together.
    pub fn near(mut middle: Change, values: &[Change], sd: &Change) -> Location {
        const STEPS: usize = 12;
        /// In standard deviations: far below the middle's own.
        const CONVERGED: f64 = 1e-5;
        for _ in 0..STEPS {
            let (mut sum, mut weight) = (Vector4::zeros(), 0.0);
            for v in values {
                let w = bisquare(v - middle, sd);
                (sum, weight) = (sum + w * v, weight + w);
            }
            if weight <= 0.0 {
                break;
            }
            let last = std::mem::replace(&mut middle, sum / weight);
            if (middle - last).component_div(sd).amax() < CONVERGED {
                break;
            }
        }
        let (mut square, mut weight) = (Vector4::zeros(), 0.0);
        for v in values {
            let w = bisquare(v - middle, sd);
            square += w * (v - middle).map(|d| d * d);
            weight += w;
        }
        Location { middle, variance: square / weight.max(f64::MIN_POSITIVE), weight }
    }

    pub fn variance_of_middle(&self) -> Change {
        self.variance / self.weight.max(1.0)
    }
}

/// The middle of the shortest interval that holds half of some numbers.
fn shortest_half(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_unstable_by(f64::total_cmp);
    let half = values.len().div_ceil(2);
    let length = |from: usize| values[from + half - 1] - values[from];
    let first = (0..=values.len() - half).min_by(|&p, &q| length(p).total_cmp(&length(q)));
    first.map_or(0.0, |p| 0.5 * (values[p] + values[p + half - 1]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    fn normal(rng: &mut ChaCha8Rng) -> f64 {
        StandardNormal.sample(rng)
    }

    #[test]
    fn location_is_the_middle_of_a_gaussian_as_well_as_a_mean_nearly() {
        let mut rng = ChaCha8Rng::seed_from_u64(9);
        let (mut square, mut sd) = (0.0, 0.0);
        let one = Vector4::repeat(1.0);
        for _ in 0..2000 {
            let values: Vec<_> =
                (0..32).map(|_| Vector4::from_fn(|_, _| normal(&mut rng))).collect();
            let found = Location::of(&values, &one);
            square += found.middle.norm_squared() / 4.0 / 2000.0;
            sd += found.variance[0].sqrt() / 2000.0;
        }
        // a mean's variance is 1/32
        assert!(square < 1.25 / 32.0, "{square}");
        assert!((0.7..1.05).contains(&sd), "{sd}");
        // two in five lie elsewhere: the middle stays within the healthy ones
        let (mut off, mut most) = (0.0, 0.0f64);
        for _ in 0..500 {
            let healthy = (0..60).map(|_| normal(&mut rng));
            let values = healthy.chain((0..40).map(|i| 4.0 + 0.1 * f64::from(i)));
            let values: Vec<_> = values.map(|v| Vector4::new(v, 0.0, 0.0, 0.0)).collect();
            let found = Location::of(&values, &one).middle[0];
            (off, most) = (off + found / 500.0, most.max(found));
        }
        assert!(off.abs() < 0.3 && most < 1.0, "{off} {most}");
    }
}
