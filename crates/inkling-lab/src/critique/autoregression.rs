//! Whether correlated noise is what it is named, an autoregression of first order x_k = rho x_{k-1} + e_k.
//!
//! In: what the signals, made white by y_k - t y_{k-1}, leave beside their own rings ([`Residual`]). Out: how
//! surprising that is if the noise was an autoregression. Noise of two levels, flicker and the like are correlated
//! at lag one as well, and differ in two things:
//!
//! * *higher lags* (`lags`): an autoregression is then white at every lag but for the converter's rounding. A
//!   slower part leaves correlations that fall with the lag l as p^l, at the rate p of its own.
//! * *levels* (`levels`): the innovations e of an autoregression do not depend on what was before. Noise that
//!   jumps between two levels is correlated alike, but a large e leads away from the level.

use super::chance::{ONCE_IN_100, surprise};
use super::ensemble::{Residual, mean_of};
use super::tuned::SLOWER;
use super::whiteness::Lags;
use nalgebra::DVector;

/// An autoregression as it was found.
#[derive(Clone, Copy, Debug)]
pub struct Autoregression {
    pub rho: f64,
    /// The number t by which the signals were made white.
    pub whitened_by: f64,
    /// Variance of the converter's rounding over that of the whitened noise.
    pub rounding: f64,
}

impl Autoregression {
    /// -ln of the probability that an autoregression leaves as much, all looks counted.
    pub fn surprise_of(&self, left: &[Residual]) -> f64 {
        let looks = [self.lags(left), self.levels(left)];
        (looks.into_iter().fold(0.0, f64::max) - (looks.len() as f64).ln()).max(0.0)
    }

    /// The likeliest of the slower parts.
    ///
    /// With autocorrelations of mean 0 and covariance C in white noise (`whiteness.rs`), correlations r of the noise
    /// make their mean (m + 2) C r, where m is the number of samples that a fit leaves free. So
    /// the statistic of r is (r^T off)² / r^T C r. Of each r the part along rho's own, rho^l, is left out, since rho
    /// was estimated; and what the rounding leaves at all lags but the first, t rho^(l-1) of it, is subtracted.
    fn lags(&self, left: &[Residual]) -> f64 {
        let all: Vec<Lags> = left.iter().map(|l| Lags::of(l.u.clone(), &l.q)).collect();
        let Some(Lags { mut off, covariance }) = Lags::sum(all.iter()) else { return 0.0 };
        let lags = off.len();
        let falling = |p: f64| DVector::from_fn(lags, |l, _| p.powi(l as i32));
        let own = falling(self.rho);
        let free = (left[0].u.len() - left[0].q.ncols() + 2) as f64;
        let mut rounded = &own * (self.whitened_by * self.rounding * free);
        rounded[0] = 0.0;
        off -= &covariance * rounded;

        let beside_rho = |r: DVector<f64>| {
            let of_own = &covariance * &own;
            &r - &own * (of_own.dot(&r) / of_own.dot(&own))
        };
        // signals that scatter by more than white noise widen the covariance
        let scatter = all.iter().filter_map(Lags::statistic).sum::<f64>();
        let wider = (scatter / (all.len() * lags) as f64).max(1.0);
        let statistic = |r: &DVector<f64>| r.dot(&off).powi(2) / r.dot(&(&covariance * r)) / wider;
        let tried = SLOWER.len() as f64;
        let slower =
            SLOWER.map(|p| surprise(statistic(&beside_rho(falling(p))), 1, tried, f64::INFINITY));
        slower.into_iter().fold(0.0, f64::max)
    }

    /// By the mean over signals of (e³ - b e) x, with the innovation e in standard deviations, b such that normal
    /// innovations make it 0, and x, the noise one sample before.
    fn levels(&self, left: &[Residual]) -> f64 {
        let innovations = |l: &Residual| -> Vec<f64> {
            let sd = (l.u.iter().map(|u| u * u).sum::<f64>() / l.u.len() as f64).sqrt();
            l.u.iter().map(|u| u / sd).collect()
        };
        // heavy tails must decide nothing
        let cube = |e: f64| e.clamp(-ONCE_IN_100, ONCE_IN_100).powi(3);
        let all: Vec<Vec<f64>> = left.iter().map(innovations).collect();
        let each = || all.iter().flatten();
        let b = each().map(|e| cube(*e) * e).sum::<f64>() / each().map(|e| e * e).sum::<f64>();
        let of = |innovations: &Vec<f64>| -> f64 {
            let mut before = 0.0;
            let products = innovations.iter().map(|&e| {
                let product = (cube(e) - b * e) * before;
                before = self.whitened_by * before + e;
                product
            });
            products.sum()
        };
        let (mean, se) = mean_of(&all.iter().map(of).collect::<Vec<f64>>());
        surprise((mean / se.max(1e-12)).powi(2), 1, 1.0, left.len() as f64 - 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::super::chance::without_a_name;
    use super::super::ensemble::project;
    use super::*;
    use nalgebra::DMatrix;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal, StudentT};

    const RHO: f64 = 0.5;

    #[derive(Clone, Copy, Debug)]
    enum Drives {
        Normal,
        HeavyTails,
        /// Of two levels; correlated as an autoregression of the same rho is.
        Levels,
        /// White, and a slow part half as large.
        Slower,
    }

    /// The surprise of 100 signals of noise, whitened by the rho of their first lag, beside a fit of four slow
    /// columns. An autoregression has rho = .5.
    fn surprise_of(drives: Drives, seed: u64) -> f64 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let student = StudentT::new(5.0).unwrap();
        let mut signal = || -> Vec<f64> {
            let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
            let (mut x, mut slow) = (normal() / (1.0 - RHO * RHO).sqrt(), 0.7 * normal());
            let mut level = normal().signum();
            let noise = (0..97).map(|_| {
                let e: f64 = match drives {
                    Drives::HeavyTails => student.sample(&mut rng),
                    _ => StandardNormal.sample(&mut rng),
                };
                x = RHO * x + e;
                let more: f64 = StandardNormal.sample(&mut rng);
                slow = 0.9 * slow + 0.3 * more;
                level *= if rng.random::<f64>() < 0.5 * (1.0 - RHO) { -1.0 } else { 1.0 };
                match drives {
                    Drives::Levels => level,
                    Drives::Slower => e + slow,
                    _ => x,
                }
            });
            noise.collect()
        };
        let all: Vec<Vec<f64>> = (0..100).map(|_| signal()).collect();
        let products = |lag: usize| -> f64 {
            all.iter().flat_map(|x| x.iter().zip(&x[lag..]).map(|(p, q)| p * q)).sum()
        };
        let rho = products(1) / products(0) * 97.0 / 96.0;
        let j = DMatrix::from_fn(96, 4, |k, a| (0.03 * k as f64 * a as f64).cos());
        let q = j.qr().q();
        let left = all.iter().map(|x| {
            let mut u: Vec<f64> = x.windows(2).map(|w| w[1] - rho * w[0]).collect();
            project(&q, &mut u);
            Residual { u, q: q.clone(), expected: vec![0.0; 96] }
        });
        let noise = Autoregression { rho, whitened_by: rho, rounding: 0.0 };
        noise.surprise_of(&left.collect::<Vec<Residual>>())
    }

    #[test]
    fn an_autoregression_of_any_innovations_is_one() {
        for drives in [Drives::Normal, Drives::HeavyTails] {
            let all = (0..150).map(|seed| surprise_of(drives, seed));
            let beyond = |least: f64| all.clone().filter(|surprise| *surprise > least).count();
            assert!(beyond(without_a_name(1.0)) <= 1, "{drives:?}");
            // looks are counted as if they were independent, so that chance is not more than once in e³
            assert!(beyond(3.0) <= 14, "{drives:?}: {}", beyond(3.0));
        }
    }

    #[test]
    fn noise_of_two_levels_and_noise_with_a_slow_part_are_none() {
        for drives in [Drives::Levels, Drives::Slower] {
            let all = (0..20).map(|seed| surprise_of(drives, seed));
            let least = all.fold(f64::INFINITY, f64::min);
            assert!(least > without_a_name(1.0), "{drives:?}: {least}");
        }
    }
}
