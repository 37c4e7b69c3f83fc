//! How far the channels of a head have moved apart: what most of them do is ageing, what one does is a fault.
//!
//! In: what each channel moved by, in standard deviations of what a healthy one moves by. Out: the covariance of it,
//! whatever fewer than half of the channels do. A full one: what ages moves features together, and a channel that
//! went four deviations along the way of all would lie eight off by each feature alone.

use super::kind::Features;
use super::process::DRIFTED;
use crate::model::median::median_of;
use nalgebra::{Matrix4, Vector4};

/// From so many channels on a covariance is estimated: twice as many as features.
const FEWEST: usize = 8;
/// Steps of the search for the half of the channels that lies closest together, at most: it rarely takes five.
const STEPS: usize = 10;
/// Median of chi-squared with one and with four degrees of freedom; upper 2.5 % of the latter.
const MEDIAN_1: f64 = 0.4549;
const MEDIAN_4: f64 = 3.3567;
const UPPER_4: f64 = 11.143;
/// The largest eigenvalue of what `n` healthy channels moved by lies beyond (1 + c / sqrt(n))^2, by the
/// estimate below: in every other draw with the first c, in one of a hundred with the second (2.0 would be
/// the edge of the Marchenko-Pastur law).
const OFTEN: f64 = 1.15;
const RARELY: f64 = 2.7;
/// Channels that a sample covariance would need to scatter as this estimate does, over those that there are.
/// Of .4 to 1, tried on Gaussian draws of 8 to 128 channels, the one with which no more lie beyond the upper
/// 1e-3 and 1e-4 than that says (to 1.6 times; twice as much, .8, is up to 92 times at 20 channels and 9 at
/// 60).
const EFFICIENCY: f64 = 0.4;
/// Channels that move twice as far as healthy ones are told to age, squared.
const TOLD: f64 = 4.0;
/// Variance of a Gaussian over that of what is left of it within `UPPER_4`.
const OF_WITHIN: f64 = 0.975 / 0.94;

/// How far channels lie from where they were, or from each other, in squares that compare with chi-squared of
/// four degrees of freedom.
pub struct Apart {
    /// Principal directions in which the channels lie apart, and the variances along these, at least 1.
    axes: Matrix4<f64>,
    variances: Features,
    /// Degrees of freedom of the covariance, if it was learned; `None`: the channels move as healthy ones do,
    /// whose covariance is 1.
    learned_from: Option<f64>,
    /// Channels have moved at least twice as far as healthy ones, and not one way: what most of them do alike
    /// is a fault.
    pub each_its_own_way: bool,
}

impl Apart {
    pub fn as_known() -> Apart {
        let (axes, variances) = (Matrix4::identity(), Vector4::repeat(1.0));
        Apart { axes, variances, learned_from: None, each_its_own_way: false }
    }

    /// Learns the covariance from what channels moved by; no variance is below 1. `is_known`: 1 is what is
    /// expected, and the covariance stays 1 unless the channels lie farther apart than chance leads to in
    /// every other head.
    pub fn learn(moved: &[Features], is_known: bool) -> Apart {
        let edge = by_chance(OFTEN, moved.len());
        let eigen = robust(moved).map(|of| of.symmetric_eigen());
        let Some(eigen) = eigen.filter(|of| !is_known || of.eigenvalues.max() > edge) else {
            return Apart::as_known();
        };
        let (axes, variances) = (eigen.eigenvectors, eigen.eigenvalues.map(|v| v.max(1.0)));
        Apart {
            axes,
            variances,
            learned_from: Some(EFFICIENCY * moved.len() as f64),
            each_its_own_way: variances.max() > TOLD
                && (0..4)
                    .all(|k| variances[k] <= TOLD || is_even(moved, &axes.column(k).into_owned())),
        }
    }

    /// Variances of the features themselves, rather than along the directions.
    pub fn wider(&self) -> Features {
        (self.axes * Matrix4::from_diagonal(&self.variances) * self.axes.transpose()).diagonal()
    }

    /// Squared distance of what a channel moved by. `times`: its past lies so many times as long ago as the
    /// others' pasts, and as ageing goes on at its pace, it has moved so many times as far by ageing.
    pub fn square(&self, moved: &Features, times: f64) -> f64 {
        let square = self.by_variances(moved, times);
        self.learned_from.map_or(square, |n| as_if_known(square, n))
    }

    /// Whether a channel moved no further than the others, the variances of these taken as they are: to be
    /// healthy again takes more than not to be surely faulty.
    pub fn holds(&self, moved: &Features, times: f64) -> bool {
        self.by_variances(moved, times) < DRIFTED
    }

    fn by_variances(&self, moved: &Features, times: f64) -> f64 {
        let along = self.axes.transpose() * moved;
        let of = |x: f64, v: f64| x * x / (1.0 + (v - 1.0) * times * times);
        along.zip_map(&self.variances, of).sum()
    }
}

fn by_chance(c: f64, channels: usize) -> f64 {
    (1.0 + c / (channels.max(1) as f64).sqrt()).powi(2)
}

/// How many times as far from each other as they are said to lie so many channels are found to lie in one of
/// a hundred heads.
pub fn rarely_apart(channels: usize) -> f64 {
    by_chance(RARELY, channels).sqrt()
}

/// Whether what channels moved by along an axis adds up to nothing, as far as chance allows (3 standard
/// deviations). Where half of them move by the same the square is half of their number, which few channels
/// reach sooner.
fn is_even(moved: &[Features], axis: &Features) -> bool {
    let along = moved.iter().map(|of| of.dot(axis));
    let (sum, squares) = along.fold((0.0, 0.0), |(sum, squares), x| (sum + x, squares + x * x));
    sum * sum < (0.5 * moved.len() as f64).min(9.0) * squares
}

/// Hotelling's T^2 of four features with a covariance of `n` degrees of freedom, as the square of chi-squared
/// with four degrees of freedom that is as rare. Of both the tail has a closed form.
fn as_if_known(square: f64, n: f64) -> f64 {
    let half = (n - 3.0) / 2.0;
    if half <= 0.0 {
        return 0.0; // so few say nothing
    }
    let z = 1.0 / (1.0 + square / n);
    let ln_tail = half * z.ln() + (half * (1.0 - z)).ln_1p();
    // exp(-x) (1 + x) has the same logarithm at half of what is looked for
    let mut x = -ln_tail;
    for _ in 0..30 {
        x = x.ln_1p() - ln_tail;
    }
    2.0 * x
}

/// The minimum covariance determinant about zero (Rousseeuw 1984), reweighted.
fn robust(moved: &[Features]) -> Option<Matrix4<f64>> {
    if moved.len() < FEWEST {
        return None;
    }
    let by_feature =
        Vector4::from_fn(|k, _| median_of(moved.iter().map(|m| m[k] * m[k])) / MEDIAN_1);
    let mut of = Matrix4::from_diagonal(&by_feature);
    let half = moved.len().div_ceil(2);
    let mut closest: Vec<&Features> = Vec::new();
    for _ in 0..STEPS {
        let mut by_distance = with_squares(moved, &of)?;
        by_distance.sort_by(|p, q| p.0.total_cmp(&q.0));
        let next: Vec<&Features> = by_distance[..half].iter().map(|of| of.1).collect();
        let scatter = mean_square(&next);
        let squares = with_squares(moved, &scatter)?.into_iter().map(|of| of.0);
        of = scatter * (median_of(squares) / MEDIAN_4);
        if next.iter().zip(&closest).filter(|(p, q)| std::ptr::eq(**p, **q)).count() == half {
            break;
        }
        closest = next;
    }
    let within = with_squares(moved, &of)?.into_iter().filter(|of| of.0 < UPPER_4);
    let within: Vec<&Features> = within.map(|of| of.1).collect();
    Some(mean_square(&within) * OF_WITHIN)
}

fn with_squares<'a>(
    moved: &'a [Features],
    covariance: &Matrix4<f64>,
) -> Option<Vec<(f64, &'a Features)>> {
    let inverse = covariance.try_inverse().filter(|of| of.iter().all(|v| v.is_finite()))?;
    Some(moved.iter().map(|m| (m.dot(&(inverse * m)), m)).collect())
}

fn mean_square(of: &[&Features]) -> Matrix4<f64> {
    of.iter().fold(Matrix4::zeros(), |sum, m| sum + *m * m.transpose()) / of.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::StandardNormal;

    fn draws(n: usize, rng: &mut ChaCha8Rng) -> Vec<Features> {
        (0..n).map(|_| Vector4::from_fn(|_, _| rng.sample(StandardNormal))).collect()
    }

    #[test]
    fn rarity_agrees_with_tables() {
        // upper 1e-3 of F(4, 20) is 7.096 (tables); T^2 = 4 n / (n - 3) F, n = 23; of chi-squared 18.467
        let t2 = 4.0 * 23.0 / 20.0 * 7.096;
        assert!((as_if_known(t2, 23.0) / 18.467 - 1.0).abs() < 1e-3, "{}", as_if_known(t2, 23.0));
        assert!((as_if_known(30.0, 1e9) / 30.0 - 1.0).abs() < 1e-6);
        assert_eq!(as_if_known(1e9, 3.0), 0.0);
    }

    /// Beyond the upper 1e-3 of chi-squared (18.47) lie about as many channels as that says, of heads that
    /// have aged in whatever directions, and no more of others.
    #[test]
    fn channels_are_as_rarely_far_apart_as_is_said() {
        let mut rng = ChaCha8Rng::seed_from_u64(31);
        for (n, is_aged) in [(8, true), (20, true), (60, true), (128, true), (60, false)] {
            let (heads, mut beyond) = (20_000 / n, 0);
            for _ in 0..heads {
                let mut moved = draws(n, &mut rng);
                let ages = Matrix4::from_fn(|i, j| {
                    if is_aged { rng.random_range(-5.0..5.0) } else { f64::from(u8::from(i == j)) }
                });
                moved.iter_mut().for_each(|m| *m = ages * *m);
                let apart = Apart::learn(&moved, true);
                beyond += moved.iter().filter(|m| apart.square(m, 1.0) > 18.47).count();
            }
            let rate = beyond as f64 / (heads * n) as f64;
            assert!(rate < 2e-3, "{n} channels, aged {is_aged}: {rate}");
            assert!(
                n < 60 || !is_aged || rate > 2e-4,
                "{n} channels: nothing is ever found, {rate}"
            );
        }
    }

    /// Of few channels, of which one in four or more is faulty, most are seldom said to lie twice as far apart.
    #[test]
    fn few_channels_of_which_some_are_faulty_have_not_aged() {
        let mut rng = ChaCha8Rng::seed_from_u64(34);
        for (n, faulty) in [(8, 0), (8, 2), (8, 3), (12, 3), (20, 4)] {
            let (mut raw, mut sure) = (0, 0);
            for _ in 0..400 {
                let mut moved = draws(n, &mut rng);
                for m in &mut moved[..faulty] {
                    *m += draws(1, &mut rng)[0].normalize() * 6.0;
                }
                let wider = Apart::learn(&moved, false).wider().max().sqrt();
                raw += usize::from(wider > 2.0);
                sure += usize::from(wider > 2.0 * rarely_apart(n));
            }
            assert!(sure <= 8, "{n} channels, {faulty} faulty: {sure} of 400");
            assert!(faulty < 3 || n > 8 || raw > 100, "the bound does nothing: {raw}");
        }
    }

    /// Of eight channels, too, what five do alike is no ageing, and what each does by itself is.
    #[test]
    fn few_channels_that_move_alike_do_not_age() {
        let mut rng = ChaCha8Rng::seed_from_u64(35);
        let (mut alike, mut aged) = (0, 0);
        for _ in 0..200 {
            let mut moved = draws(8, &mut rng);
            moved[..5].iter_mut().for_each(|m| m[1] += 8.0);
            alike += usize::from(Apart::learn(&moved, true).each_its_own_way);
            let moved: Vec<Features> = draws(8, &mut rng).iter().map(|m| m * 5.0).collect();
            aged += usize::from(Apart::learn(&moved, true).each_its_own_way);
        }
        println!("{alike} and {aged} of 200");
        assert!(alike <= 20 && aged >= 160, "{alike} and {aged} of 200");
    }

    /// Ageing whose tail is heavier than a Gaussian's is not covered: of Student's t with five degrees of
    /// freedom .4 % of the channels of a head of 60 lie beyond a bound that is meant for one in a million.
    #[test]
    fn heavy_tails_of_ageing_are_taken_for_faults_of_few_channels() {
        let mut rng = ChaCha8Rng::seed_from_u64(33);
        let (heads, mut beyond) = (500, 0);
        for _ in 0..heads {
            let mut moved = draws(60, &mut rng);
            for m in &mut moved {
                let chi_squared =
                    draws(2, &mut rng).iter().flatten().take(5).map(|z| z * z).sum::<f64>();
                *m += draws(1, &mut rng)[0] * (5.0 / (chi_squared / 5.0).sqrt());
            }
            let apart = Apart::learn(&moved, true);
            beyond += moved.iter().filter(|m| apart.square(m, 1.0) > 33.38).count();
        }
        let rate = f64::from(beyond as u32) / f64::from(60 * heads);
        assert!((1e-3..8e-3).contains(&rate), "{rate}");
    }

    /// Ageing that ties the features together is found, though two in five channels do something else.
    #[test]
    fn ageing_is_what_most_channels_do() {
        let mut rng = ChaCha8Rng::seed_from_u64(32);
        let way = Vector4::new(4.0, -3.0, 1.0, 0.5);
        let mut moved = draws(60, &mut rng);
        for m in &mut moved[..36] {
            *m += way * rng.sample::<f64, _>(StandardNormal);
        }
        for m in &mut moved[36..] {
            *m += Vector4::new(0.0, 12.0, 30.0, 0.0);
        }
        let apart = Apart::learn(&moved, true);
        let along = {
            let along = apart.axes.transpose() * way;
            way.norm_squared() / along.zip_map(&apart.variances, |x, v| x * x / v).sum()
        };
        assert!((10.0..80.0).contains(&along), "{along}, truly {}", 1.0 + way.norm_squared());
        let far = |m: &Features| apart.square(m, 1.0) > 33.0;
        assert_eq!(moved[..36].iter().filter(|m| far(m)).count(), 0);
        assert_eq!(moved[36..].iter().filter(|m| far(m)).count(), 24);
    }
}
