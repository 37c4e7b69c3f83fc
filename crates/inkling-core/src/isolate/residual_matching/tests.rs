use super::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const N: usize = 40;

/// N numbers from -1 to 1: a signature or a residual.
fn random_column(rng: &mut ChaCha8Rng) -> Vec<f64> {
    (0..N).map(|_| rng.random_range(-1.0..1.0)).collect()
}

fn matrix(columns: &[Vec<f64>]) -> SignatureMatrix {
    let slices: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
    SignatureMatrix::new(&slices).unwrap()
}

/// The mixture of these columns with these weights.
fn mix(columns: &[Vec<f64>], weights: &[f64]) -> Vec<f64> {
    (0..N).map(|k| columns.iter().zip(weights).map(|(c, w)| w * c[k]).sum()).collect()
}

/// phi of a residual by this file's solver.
fn ours(m: &SignatureMatrix, r: &[f64]) -> Vec<f64> {
    let (mut c, mut phi) = (vec![0.0; m.r.ncols()], vec![0.0; m.r.ncols()]);
    m.project(r, &mut c);
    Simplex::new(m).solve(&c, &mut phi);
    phi
}

/// The worst violation of feasibility, stationarity and complementarity, over the problem's size; from R
/// and r themselves, not from what the solver uses.
fn kkt(m: &SignatureMatrix, r: &[f64], phi: &[f64]) -> f64 {
    let x = nalgebra::DVector::from_column_slice(phi);
    let misfit = &m.r * &x - nalgebra::DVector::from_column_slice(r);
    let g = m.r.tr_mul(&misfit);
    let reach = m.r.column_iter().map(|c| c.norm()).fold(0.0, f64::max);
    let size = (reach * misfit.norm().max(reach)).max(f64::MIN_POSITIVE);
    let level = g.dot(&x);
    let sum = (x.sum() - 1.0).abs();
    let negative = x.iter().fold(0.0, |w: f64, &p| w.max(-p));
    let dual = g.iter().fold(0.0, |w: f64, g| w.max((level - g) / size));
    let slack = g.iter().zip(phi).map(|(g, p)| (p * (g - level)).abs() / size).sum::<f64>();
    [sum, negative, dual, slack].into_iter().fold(0.0, f64::max)
}

/// The problem is convex, so what meets the conditions of optimality is the solution.
fn check(columns: &[Vec<f64>], r: &[f64], what: &str) {
    let m = matrix(columns);
    let phi = ours(&m, r);
    let left = kkt(&m, r, &phi);
    assert!(left <= 1e-9, "{what}: KKT residual {left:e}, phi {phi:?}");
}

#[test]
fn random_problems_of_1_to_20_classes_are_solved() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for n in 1..=20 {
        for _ in 0..30 {
            let columns: Vec<_> = (0..n).map(|_| random_column(&mut rng)).collect();
            let far = rng.random_range(0.1..10.0);
            let r: Vec<f64> = random_column(&mut rng).iter().map(|v| v * far).collect();
            check(&columns, &r, "random");
        }
    }
}

#[test]
fn badly_conditioned_problems_are_solved() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    for decades in 1..=9 {
        for n in [2, 5, 9, 20] {
            for _ in 0..10 {
                // Columns that differ by ever less from a common one, and from each other.
                let common = random_column(&mut rng);
                let columns: Vec<Vec<f64>> = (0..n)
                    .map(|i| {
                        let own = random_column(&mut rng);
                        let part = 10f64.powf(-(decades as f64) * i as f64 / n as f64);
                        common.iter().zip(own).map(|(c, o)| c + part * o).collect()
                    })
                    .collect();
                let r = mix(&columns, &vec![1.0 / n as f64; n]);
                let noise = random_column(&mut rng);
                let r: Vec<f64> = r.iter().zip(noise).map(|(r, e)| r + 0.01 * e).collect();
                check(&columns, &r, &format!("1e-{decades}, {n}"));
            }
        }
    }
}

#[test]
fn degenerate_problems_are_solved_and_end() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    for n in 1..=20 {
        for _ in 0..10 {
            let mut columns: Vec<_> = (0..n).map(|_| random_column(&mut rng)).collect();
            let r = random_column(&mut rng);
            // a residual inside the hull, at a vertex, and far away
            let w: Vec<f64> = (0..n).map(|_| rng.random_range(0.1..1.0)).collect();
            let total: f64 = w.iter().sum();
            let inside: Vec<f64> = w.iter().map(|w| w / total).collect();
            check(&columns, &mix(&columns, &inside), "inside the hull");
            check(&columns, &columns[n / 2], "a vertex");
            let far: Vec<f64> = r.iter().map(|v| v * 1e6).collect();
            check(&columns, &far, "far away");
            // collinear and duplicated columns, and a zero column
            let middle: Vec<f64> =
                columns[0].iter().zip(&columns[n - 1]).map(|(a, b)| 0.5 * (a + b)).collect();
            columns.push(middle);
            columns.push(columns[n / 2].clone());
            columns.push(vec![0.0; N]);
            columns.push(columns[0].iter().map(|v| 2.0 * v).collect());
            check(&columns, &r, "dependent columns");
            let inside = vec![1.0 / columns.len() as f64; columns.len()];
            check(&columns, &mix(&columns, &inside), "inside, dependent columns");
            check(&columns, &columns[n], "a dependent column itself");
        }
    }
}

#[test]
fn the_scale_of_the_counts_does_not_matter() {
    let mut rng = ChaCha8Rng::seed_from_u64(6);
    let columns: Vec<_> = (0..9).map(|_| random_column(&mut rng)).collect();
    let r = random_column(&mut rng);
    let plain = ours(&matrix(&columns), &r);
    for scale in [1e-100, 1e-9, 1e9, 1e100] {
        let times = |v: &Vec<f64>| v.iter().map(|x| x * scale).collect::<Vec<f64>>();
        let scaled: Vec<_> = columns.iter().map(times).collect();
        for (p, q) in ours(&matrix(&scaled), &times(&r)).iter().zip(&plain) {
            assert!((p - q).abs() < 1e-10);
        }
    }
}

#[test]
fn one_class_takes_all_and_equal_classes_still_sum_to_1() {
    assert_eq!(ours(&matrix(&[vec![1.0; N]]), &vec![-7.0; N]), [1.0]);
    assert_eq!(ours(&matrix(&[vec![0.0; N]]), &vec![1.0; N]), [1.0]);
    for column in [vec![0.0; N], vec![3.0; N]] {
        let phi = ours(&matrix(&vec![column; 5]), &vec![1.0; N]);
        assert!(phi.iter().all(|p| *p >= 0.0) && phi.iter().sum::<f64>() == 1.0);
    }
}

#[test]
fn what_is_no_number_gives_no_number() {
    let simplex = Simplex::new(&matrix(&[vec![1.0; N], vec![2.0; N]]));
    let mut phi = [0.0; 2];
    simplex.solve(&[f64::NAN, 1.0], &mut phi);
    assert!(phi.iter().all(|p| p.is_nan()));
}
