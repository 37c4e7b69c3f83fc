//! Method III of the FD filter: extra zeros M(z) in the numerator, which raise faulty residuals
//! above healthy ones. thesis §3-2-1 III, Appendix A.
//!
//! In: N(z)L(z), a denominator with room for M, and the deviations of healthy and of faulty
//! signals, counts. Out: the coefficients of M(z); the filter's numerator becomes M N L.
//!
//! The residual is linear in M's coefficients m, so its mean energy over some signals is a quadratic
//! form m' Q m. The m sought maximises m' Q_f m / m' Q_h m (f: faulty, h: healthy signals): it is
//! the eigenvector of the largest eigenvalue of Q_f m = ratio Q_h m.
//!
//! Departs: Appendix A takes M(s) = det(Q_x - sI), which has only real nonnegative roots, whatever
//! the data. And faulty energy is compared with healthy energy, since faulty
//! energy alone rises with any gain. The same maximisation serves (3-3b): at degree d the left null
//! space of H-bar consists of M p3 with any M of degree d - 3.

use super::{DetectError, ResidualGenerator};
use nalgebra::{DMatrix, SymmetricEigen};

/// What is added to the diagonal of Q_h, relative to its largest entry, lest a small healthy set that
/// has no energy in some direction make its gain infinite.
const RIDGE: f64 = 1e-9;

/// The M, of unit norm. `numerator`: N L, and `denominator`: alpha, of a higher degree, both in
/// descending powers; `healthy`, `faulty`: deviations, N counts each.
pub fn enhancement(
    numerator: &[f64],
    denominator: &[f64],
    healthy: &[Vec<f64>],
    faulty: &[Vec<f64>],
    dt_s: f64,
) -> Result<Vec<f64>, DetectError> {
    let terms = denominator.len() - numerator.len() + 1;
    // one filter z^k N L / alpha per coefficient of M
    let shifted = |k: usize| {
        let mut p = vec![0.0; denominator.len()];
        p[k..k + numerator.len()].copy_from_slice(numerator);
        p
    };
    let basis = (0..terms)
        .map(|k| ResidualGenerator::new(shifted(k), denominator.to_vec(), dt_s))
        .collect::<Result<Vec<_>, _>>()?;

    let q_healthy = mean_energy(&basis, healthy, "healthy deviation")?;
    let q_faulty = mean_energy(&basis, faulty, "faulty deviation")?;
    let size = q_healthy.diagonal().amax();
    let ridge = DMatrix::identity(terms, terms) * (RIDGE * size);
    let factor = (q_healthy + ridge).cholesky().filter(|_| size > 0.0);
    let l = factor.ok_or(DetectError::NoHealthyEnergy)?.l();

    // by m = L^-T v an ordinary eigenvalue problem, L^-1 Q_f L^-T v = ratio v
    let failed = || DetectError::Decomposition { rows: terms, columns: terms };
    let half = l.solve_lower_triangular(&q_faulty).ok_or_else(failed)?;
    let whitened = l.solve_lower_triangular(&half.transpose()).ok_or_else(failed)?;
    let symmetric = (&whitened + whitened.transpose()) * 0.5;
    let eigen = SymmetricEigen::try_new(symmetric, f64::EPSILON, 10_000).ok_or_else(failed)?;
    let v = eigen.eigenvectors.column(eigen.eigenvalues.imax()).into_owned();
    let m = l.transpose().solve_upper_triangular(&v).ok_or_else(failed)?.normalize();
    Ok(m.iter().copied().collect())
}

pub fn product(m: &[f64], n: &[f64]) -> Vec<f64> {
    let mut product = vec![0.0; m.len() + n.len() - 1];
    for (k, m) in m.iter().enumerate() {
        for (p, n) in product[k..].iter_mut().zip(n) {
            *p += m * n;
        }
    }
    product
}

fn mean_energy(
    basis: &[ResidualGenerator],
    deviations: &[Vec<f64>],
    what: &'static str,
) -> Result<DMatrix<f64>, DetectError> {
    let mut q = DMatrix::zeros(basis.len(), basis.len());
    for d in deviations {
        if let Some(index) = d.iter().position(|v| !v.is_finite()) {
            return Err(DetectError::NotFinite { what, index });
        }
        let mut columns = DMatrix::zeros(d.len(), basis.len());
        for (generator, mut column) in basis.iter().zip(columns.column_iter_mut()) {
            generator.filter(d, column.as_mut_slice());
        }
        q += columns.tr_mul(&columns) / deviations.len() as f64;
    }
    Ok(q)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detect::null_space::tests::{DT_S, INK, decay, left_by};
    use crate::detect::{null_space, poles};
    use crate::model::InkChannel;
    use crate::model::normal::draws;

    /// Deviations of so many healthy signals, and of as many whose nozzle has dried.
    fn deviations(count: usize, normal: &mut impl FnMut() -> f64) -> [Vec<Vec<f64>>; 2] {
        let expected = decay(&INK);
        let dried = InkChannel { d_per_s: 1.3 * INK.d_per_s, ..INK };
        [INK, dried].map(|plant| {
            let y = decay(&plant);
            let noisy = |_| y.iter().zip(&expected).map(|(y, e)| y - e + 17.6 * normal()).collect();
            (0..count).map(noisy).collect()
        })
    }

    /// Mean faulty over mean healthy residual energy of a filter.
    fn ratio(g: &ResidualGenerator, faulty: &[Vec<f64>], healthy: &[Vec<f64>]) -> f64 {
        let mean = |d: &[Vec<f64>]| d.iter().map(|d| g.energy(d)).sum::<f64>() / d.len() as f64;
        mean(faulty) / mean(healthy)
    }

    #[test]
    fn enhancement_raises_faulty_over_healthy_energy_on_signals_it_has_not_seen() {
        let mut normal = draws(1);
        let [healthy, faulty] = deviations(300, &mut normal);
        let n = null_space::numerator_of(&INK, DT_S, 4).unwrap();
        let omega = 2.0 * std::f64::consts::PI * 6.47e4;
        let alpha = poles::resonance(omega, &[2e5; 6], DT_S).unwrap();
        let m = enhancement(&n, &alpha, &healthy, &faulty, DT_S).unwrap();
        let m_n = product(&m, &n);
        let mut plain = n.clone();
        plain.resize(alpha.len(), 0.0);
        let plain = ResidualGenerator::new(plain, alpha.clone(), DT_S).unwrap();
        let raised = ResidualGenerator::new(m_n.clone(), alpha, DT_S).unwrap();
        let [healthy, faulty] = deviations(300, &mut normal);
        let (before, after) = (ratio(&plain, &faulty, &healthy), ratio(&raised, &faulty, &healthy));
        assert!(after > 1.02 * before, "{before} -> {after}");
        // thesis (3-3a) still holds: M N L annihilates what N L does.
        assert!(left_by(&m_n, &decay(&INK)) < 1e-12);
    }

    /// Tests thesis (3-3b) at degrees above the observable order.
    #[test]
    fn the_null_space_is_every_multiple_of_p3_and_no_element_of_it_shows_the_fault_more() {
        let p3 = null_space::numerator_of(&INK, DT_S, 3).unwrap();
        let ascending = |p: &[f64]| p.iter().rev().copied().collect::<Vec<f64>>();
        for degree in [4, 5, 6] {
            let space = null_space::annihilator(&INK.a(), &INK.c(), DT_S, degree).unwrap();
            let elements = space.polynomials();
            assert_eq!(elements.nrows(), degree - 2);
            let multiples = DMatrix::from_fn(degree + 1, degree - 2, |i, k| {
                ascending(&p3).get(i.wrapping_sub(k)).copied().unwrap_or(0.0)
            });
            let q = multiples.qr().q();
            for element in elements.row_iter().map(|row| row.transpose()) {
                let left = &element - &q * q.tr_mul(&element);
                assert!(left.norm() < 1e-9 * element.norm(), "degree {degree}: {:e}", left.norm());
            }
        }
        let [healthy, faulty] = deviations(100, &mut draws(2));
        let alpha = poles::resonance(4.06e5, &[2e5, 2e5], DT_S).unwrap();
        let of = |m: &[f64]| {
            let generator = ResidualGenerator::new(product(m, &p3), alpha.clone(), DT_S).unwrap();
            ratio(&generator, &faulty, &healthy)
        };
        let m = enhancement(&p3, &alpha, &healthy, &faulty, DT_S).unwrap();
        assert_eq!(m.len(), 2);
        let best = of(&m);
        for k in 0..180 {
            let angle = f64::from(k).to_radians();
            let other = of(&[angle.cos(), angle.sin()]);
            assert!(other <= best * (1.0 + 1e-6), "{angle}: {other} above {best}");
        }
        assert!(
            best > 1.001 * of(&[1.0, -1.0]),
            "no better than the element that rejects an offset"
        );
    }

    #[test]
    fn no_healthy_signals_are_an_error() {
        let d = [vec![1.0; 16]];
        let alpha = [1.0, 0.1, 0.0];
        let none = enhancement(&[1.0, 0.5], &alpha, &[], &d, DT_S);
        assert!(matches!(none, Err(DetectError::NoHealthyEnergy)));
        let nan = enhancement(&[1.0, 0.5], &alpha, &[vec![f64::NAN; 4]], &d, DT_S);
        assert!(matches!(nan, Err(DetectError::NotFinite { .. })));
    }
}
