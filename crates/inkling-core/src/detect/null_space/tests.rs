use super::*;
use crate::detect::poles::from_poles;
use nalgebra::Complex;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

pub const DT_S: f64 = 0.78125e-6;
pub const INK: InkChannel = InkChannel::NOMINAL;

/// A decay of this channel from one and the same state.
pub fn decay(channel: &InkChannel) -> Vec<f64> {
    let x_a = nalgebra::dvector![1e-4, 0.0, 900.0, 400.0];
    crate::model::ring_down::ring_down(channel, &x_a, DT_S, 128)
}

/// The monic numerator N(z)L(z) of any plant of one output.
fn numerator(
    a: &DMatrix<f64>,
    c: &DMatrix<f64>,
    dt_s: f64,
    degree: usize,
) -> Result<Vec<f64>, DetectError> {
    annihilator(a, c, dt_s, degree)?.offset_rejection()
}

/// The largest |sum_k p_k y_k+j|, relative to max |y|.
pub fn left_by(p: &[f64], y: &[f64]) -> f64 {
    let left = |w: &[f64]| p.iter().rev().zip(w).map(|(p, y)| p * y).sum::<f64>().abs();
    let size = y.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
    y.windows(p.len()).map(left).fold(0.0, f64::max) / size
}

/// What is left of 128 samples y_k = C A_d^k x: the worst of a few random x.
fn misses(p: &[f64], a_d: &DMatrix<f64>, c: &DMatrix<f64>, rng: &mut ChaCha8Rng) -> f64 {
    let mut worst: f64 = 0.0;
    for _ in 0..5 {
        let mut x = DVector::from_fn(a_d.nrows(), |_, _| rng.random_range(-1.0..1.0));
        let y: Vec<f64> = (0..128)
            .map(|_| {
                let out = (c * &x)[0];
                x = a_d * &x;
                out
            })
            .collect();
        worst = worst.max(left_by(p, &y));
    }
    worst
}

/// A stable system of `n` states in random orthogonal coordinates, and its observable poles (1/s). The
/// last `hidden` states do not reach the output. The poles are apart, as in a real plant.
fn random_system(
    n: usize,
    hidden: usize,
    rng: &mut ChaCha8Rng,
) -> (DMatrix<f64>, DMatrix<f64>, Vec<Complex<f64>>) {
    let mut blocks = DMatrix::zeros(n, n);
    let mut poles = Vec::new();
    let seen = n - hidden;
    let mut i = 0;
    while i < n {
        let room = if i < seen { seen - i } else { n - i };
        let damping = rng.random_range(1e4..8e4) * (1.0 + i as f64);
        blocks[(i, i)] = -damping;
        if room >= 2 && rng.random_bool(0.7) {
            let omega = rng.random_range(2e5..3e5) * (1.0 + i as f64);
            blocks[(i + 1, i + 1)] = -damping;
            blocks[(i, i + 1)] = omega;
            blocks[(i + 1, i)] = -omega;
            if i < seen {
                poles.push(Complex::new(-damping, omega));
                poles.push(Complex::new(-damping, -omega));
            }
            i += 2;
        } else {
            if i < seen {
                poles.push(Complex::new(-damping, 0.0));
            }
            i += 1;
        }
    }
    for (i, j) in (seen..n).flat_map(|i| (0..seen).map(move |j| (i, j))) {
        blocks[(i, j)] = rng.random_range(-1e5..1e5); // hidden states are driven, not seen
    }
    let mut c = DMatrix::from_fn(1, n, |_, _| rng.random_range(0.5..1.5));
    c.columns_mut(seen, hidden).fill(0.0);
    let q = DMatrix::from_fn(n, n, |_, _| rng.random_range(-1.0..1.0)).qr().q();
    (&q * blocks * q.transpose(), c * q.transpose(), poles)
}

#[test]
fn the_numerator_annihilates_random_systems_of_order_2_to_8_with_and_without_hidden_states() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    for n in 2..=8 {
        for hidden in 0..=(n / 2) {
            for trial in 0..10 {
                let (a, c, poles) = random_system(n, hidden, &mut rng);
                let order = n - hidden;
                for degree in order..=order + 1 {
                    let p = numerator(&a, &c, DT_S, degree).unwrap_or_else(|e| {
                        panic!("n {n} hidden {hidden} trial {trial} degree {degree}: {e}")
                    });
                    let left = misses(&p, &discretise(&a, DT_S), &c, &mut rng);
                    assert!(left <= 1e-12, "n {n} hidden {hidden} degree {degree}: {left:e}");
                }
                // The unique one again, from the poles.
                let p = numerator(&a, &c, DT_S, order).unwrap();
                for (p, q) in p.iter().zip(from_poles(&poles, DT_S)) {
                    assert!((p - q).abs() < 1e-6, "n {n} hidden {hidden}: {p} {q}");
                }
            }
        }
    }
}

#[test]
fn nullity_is_block_rows_less_observable_order() {
    for degree in 3..10 {
        let space = annihilator(&INK.a(), &INK.c(), DT_S, degree).unwrap();
        assert_eq!(space.observable_order, 3);
        assert_eq!(space.n_bar.nrows(), degree + 1 - 3);
    }
    for degree in 0..3 {
        assert!(matches!(
            annihilator(&INK.a(), &INK.c(), DT_S, degree),
            Err(DetectError::DegreeTooSmall { observable_order: 3, .. })
        ));
    }
    // Equal R/I in restrictor and nozzle: two observable states are left.
    let equal = InkChannel { d_per_s: INK.g_per_s, ..INK };
    let space = annihilator(&equal.a(), &equal.c(), DT_S, 3).unwrap();
    assert_eq!((space.observable_order, space.n_bar.nrows()), (2, 2));
}

#[test]
fn degree_3_gives_the_observable_poles_and_degree_4_a_root_at_1_besides() {
    let poles = crate::model::ring_down::eigenvalues(&INK);
    let observable: Vec<_> = poles.into_iter().filter(|s| s.norm() > 1.0).collect();
    assert_eq!(observable.len(), 3);
    let at = |p: &[f64], z: Complex<f64>| {
        p.iter().fold(Complex::new(0.0, 0.0), |v, &c| v * z + c).norm()
    };
    let p3 = numerator(&INK.a(), &INK.c(), DT_S, 3).unwrap();
    let p4 = numerator(&INK.a(), &INK.c(), DT_S, 4).unwrap();
    assert_eq!((p3.len(), p3[0], p4.len(), p4[0]), (4, 1.0, 5, 1.0));
    for s in &observable {
        let z = (s * DT_S).exp();
        assert!(at(&p3, z) < 1e-12 && at(&p4, z) < 1e-12, "{:e} {:e}", at(&p3, z), at(&p4, z));
    }
    assert!(at(&p4, Complex::new(1.0, 0.0)) < 1e-12);
    // thesis §3-2-1 II: (z - 1) p3 is the image of det(A - sI) = s p3(s).
    let shifted = [p3[0], p3[1] - p3[0], p3[2] - p3[1], p3[3] - p3[2], -p3[3]];
    for (p, q) in p4.iter().zip(shifted) {
        assert!((p - q).abs() < 1e-9);
    }
    // Independent: the polynomial made of the mapped poles. Coefficients are less well determined
    // than what they annihilate: the poles lie close together in z.
    for (p, q) in p3.iter().zip(from_poles(&observable, DT_S)) {
        assert!((p - q).abs() < 1e-9);
    }
}

#[test]
fn units_of_the_states_do_not_matter() {
    let scaled = |t: &[f64; 4]| {
        let a = INK.a();
        let a = DMatrix::from_fn(4, 4, |i, j| a[(i, j)] * t[i] / t[j]);
        let c = DMatrix::from_fn(1, 4, |_, j| INK.c()[j] / t[j]);
        numerator(&a, &c, DT_S, 4).unwrap()
    };
    let p = numerator(&INK.a(), &INK.c(), DT_S, 4).unwrap();
    for t in [[1e-12, 1e-12, 1e-6, 1e-6], [1e6, 1e6, 1.0, 1.0], [1.0, 1e3, 1e-4, 1e5]] {
        for (p, q) in p.iter().zip(scaled(&t)) {
            assert!((p - q).abs() < 1e-9, "{t:?}: {p} {q}");
        }
    }
}

#[test]
fn senseless_models_are_errors() {
    let (a, c) = (INK.a(), INK.c());
    assert!(matches!(
        numerator(&a, &c, DT_S, 65),
        Err(DetectError::DegreeTooLarge { degree: 65, .. })
    ));
    let growing = nalgebra::dmatrix![1e9];
    assert!(numerator(&growing, &nalgebra::dmatrix![1.0], 1.0, 1).is_err());
    let integrator = nalgebra::dmatrix![0.0]; // (z - 1): all multiples reject an offset
    assert!(matches!(
        numerator(&integrator, &nalgebra::dmatrix![1.0], DT_S, 2),
        Err(DetectError::AmbiguousNumerator { .. })
    ));
}
