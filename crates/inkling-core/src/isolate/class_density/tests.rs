use super::*;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};

#[derive(Clone, Copy, Debug, PartialEq)]
enum Sizes {
    Gaussian,
    Even,
    /// Uniform in the exponential of the feature.
    Tilted,
}

const ALL: [Sizes; 3] = [Sizes::Gaussian, Sizes::Even, Sizes::Tilted];

/// `n` drawn feature vectors of two coordinates, the first of which is spread by the severities.
fn draw(n: usize, sizes: Sizes) -> Vec<DVector<f64>> {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(9);
    (0..n)
        .map(|_| {
            let noise: [f64; 2] = std::array::from_fn(|_| StandardNormal.sample(&mut rng));
            let wide: f64 = StandardNormal.sample(&mut rng);
            let size = match sizes {
                Sizes::Gaussian => wide / 3f64.sqrt(),
                Sizes::Even => rng.random_range(-1.0..1.0),
                Sizes::Tilted => 2.0 * rng.random_range(0.1_f64..1.0).ln() + 1.0,
            };
            DVector::from_row_slice(&[1.0 + 0.5 * size + 0.05 * noise[0], 0.1 * noise[1]])
        })
        .collect()
}

fn noise() -> DMatrix<f64> {
    DMatrix::from_diagonal(&DVector::from_row_slice(&[0.05f64.powi(2), 0.1f64.powi(2)]))
}

fn learned(sizes: Sizes) -> ClassDensity {
    ClassDensity::learn(&draw(400, sizes), &noise(), None, true).unwrap()
}

#[test]
fn density_integrates_to_one() {
    for sizes in ALL {
        let density = learned(sizes);
        let h = 0.02;
        let at = |i: i32, j: i32| density.ln_density(&[f64::from(i) * h, f64::from(j) * h]).exp();
        let mass: f64 =
            (-400..600).flat_map(|i| (-100..100).map(move |j| (i, j))).map(|(i, j)| at(i, j)).sum();
        assert!((mass * h * h - 1.0).abs() < 1e-3, "{mass}");
        assert!(density.ln_density(&[60.0, 0.0]).is_finite());
    }
}

#[test]
fn range_of_sizes_is_told_from_a_gaussian_spread() {
    let is_range = |sizes| {
        let density = learned(sizes);
        density.axes.iter().any(|a| matches!(a, Axis::Range(r) if r.half_width > 5.0))
    };
    assert!(is_range(Sizes::Even));
    assert!(is_range(Sizes::Tilted));
    assert!(!is_range(Sizes::Gaussian));
}

#[test]
fn what_is_even_in_its_exponential_ends_where_it_ends_and_not_beyond() {
    let density = learned(Sizes::Tilted);
    let tilts = density.axes.iter().filter_map(|axis| match axis {
        Axis::Range(range) => Some((range.slope * range.half_width).abs()),
        Axis::Gaussian(_) => None,
    });
    // a factor of ten from end to end
    let tilt = tilts.fold(0.0, f64::max);
    assert!((tilt - 0.5 * 10_f64.ln()).abs() < 0.1, "{tilt}");
    // its upper end is 1.5; five standard deviations of the noise further there is nothing
    let inside = density.ln_density(&[1.45, 0.0]);
    assert!(density.ln_density(&[1.75, 0.0]) < inside - 8.0);
    let even = learned(Sizes::Even);
    let is_flat = |axis: &Axis| !matches!(axis, Axis::Range(range) if range.slope != 0.0);
    assert!(even.axes.iter().all(is_flat));
}

#[test]
fn few_examples_are_shrunk_and_none_are_refused() {
    let pooled = noise() * 4.0;
    assert!(ClassDensity::learn(&draw(1, Sizes::Even), &noise(), Some(&pooled), false).is_some());
    // Of one example nothing but the pooled spread is known; with many examples it no longer counts.
    let spread = |n: usize, more: f64| {
        let learned = ClassDensity::learn(
            &draw(n, Sizes::Gaussian),
            &noise(),
            Some(&(&pooled * more)),
            false,
        );
        let density = learned.unwrap();
        let there: Vec<f64> = density.mean.clone();
        // ln of the density at the mean falls by ln 2 for each of two axes that is twice as wide
        density.ln_density(&there)
    };
    let narrower = spread(1, 1.0) - spread(1, 4.0);
    assert!((narrower - 4_f64.ln()).abs() < 1e-9, "{narrower}");
    assert!(spread(400, 1.0) - spread(400, 4.0) < 0.02);
    assert!(ClassDensity::learn(&draw(1, Sizes::Even), &noise(), None, false).is_none());
    assert!(ClassDensity::learn(&[], &noise(), Some(&pooled), false).is_none());
}
