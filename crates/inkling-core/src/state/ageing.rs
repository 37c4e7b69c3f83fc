//! How far a head's channels have moved apart: what most do is ageing, what one does is a fault.
//!
//! In: for each channel of a sweep how far it has moved (`Channel::moved`): 4 numbers, in standard
//! deviations of what healthy channels move by. Out: the covariance of these over the channels
//! ([`Apart`]), and each channel's squared distance by it.
//!
//! The covariance is robust (`robust`): what fewer than half of the channels do hardly changes it.
//! It is a full one, because ageing moves features together. Healthy channels that do not age have
//! the covariance 1, and one that chance gives every other such head is taken for 1. A distance by
//! that of few channels becomes the chi-squared that is as rare (`as_if_known`).

use super::kind::Features;
use super::process::DRIFTED;
use crate::model::median::median_of;
use nalgebra::{Matrix4, Vector4};

const FEWEST: usize = 8;
const STEPS: usize = 10;
/// Medians of chi-squared with one and with four degrees of freedom, and the value that chi-squared
/// with four exceeds with a probability of 2.5 %.
const MEDIAN_1: f64 = 0.4549;
const MEDIAN_4: f64 = 3.3567;
const UPPER_4: f64 = 11.143;
/// The largest eigenvalue of the covariance of `n` healthy channels exceeds (1 + c / sqrt(n))^2 in
/// about every other draw with c = `OFTEN`, and in about one of a hundred with c = `RARELY`.
pub const OFTEN: f64 = 1.15;
pub const RARELY: f64 = 2.7;
/// From n channels `robust`'s covariance scatters as a sample covariance of `EFFICIENCY` n channels
/// does: chosen by Gaussian draws of 8 to 128 channels, for the upper points of chi-squared.
const EFFICIENCY: f64 = 0.4;
/// Variance beyond which channels age: they move more than twice as far as healthy ones.
const AGED: f64 = 4.0;
/// What the mean square of the channels within `UPPER_4` is multiplied by, since it lacks the tail.
/// Normal distributions would need .975 / .916; the numbers above were chosen with this one.
const OF_WITHIN: f64 = 0.975 / 0.94;

pub struct Apart {
    /// The covariance's principal directions, in columns, and the variances along these, 1 or more.
    axes: Matrix4<f64>,
    variances: Features,
    /// Degrees of freedom of the covariance; `None`: it is that of healthy channels, 1.
    learned_from: Option<f64>,
    /// Whether the channels age: along some direction they have moved more than twice as far as
    /// healthy ones, and along each such direction to both sides. One way, it is a fault of most.
    pub each_its_own_way: bool,
}

impl Apart {
    pub fn as_known() -> Apart {
        let (axes, variances) = (Matrix4::identity(), Vector4::repeat(1.0));
        Apart { axes, variances, learned_from: None, each_its_own_way: false }
    }

    /// Learns the covariance. It is taken for 1 where channels are too few, and where chance leads to so large a variance
    /// as often as `chance` says ([`OFTEN`], [`RARELY`]).
    pub fn learn(moved: &[Features], chance: f64) -> Apart {
        let edge = by_chance(chance, moved.len());
        let eigen = robust(moved).map(|of| of.symmetric_eigen());
        let Some(eigen) = eigen.filter(|of| of.eigenvalues.max() > edge) else {
            return Apart::as_known();
        };
        let (axes, variances) = (eigen.eigenvectors, eigen.eigenvalues.map(|v| v.max(1.0)));
        Apart {
            axes,
            variances,
            learned_from: Some(EFFICIENCY * moved.len() as f64),
            each_its_own_way: variances.max() > AGED
                && (0..4)
                    .all(|k| variances[k] <= AGED || is_even(moved, &axes.column(k).into_owned())),
        }
    }

    /// How many times as far apart the channels lie as healthy ones, squared, by coordinate.
    pub fn wider(&self) -> Features {
        (self.axes * Matrix4::from_diagonal(&self.variances) * self.axes.transpose()).diagonal()
    }

    /// As a chi-squared of four degrees of freedom. `times`: the channel's past lies so many times
    /// as long ago as the others' (`Channel::times_as_long`): ageing moved it so many times as far.
    pub fn square(&self, moved: &Features, times: f64) -> f64 {
        let square = self.by_variances(moved, times);
        self.learned_from.map_or(square, |n| as_if_known(square, n))
    }

    /// Whether a channel moved no further than the others did, and so may have aged. This is stricter
    /// than a bound on [`Apart::square`]: to be healthy again takes more than not to be faulty.
    pub fn holds(&self, moved: &Features, times: f64) -> bool {
        self.by_variances(moved, times) < DRIFTED
    }

    /// Squared Mahalanobis distance; what the variances have beyond 1 is ageing.
    fn by_variances(&self, moved: &Features, times: f64) -> f64 {
        let along = self.axes.transpose() * moved;
        let of = |x: f64, v: f64| x * x / (1.0 + (v - 1.0) * times * times);
        along.zip_map(&self.variances, of).sum()
    }
}

/// The largest eigenvalue that chance leads to in so many healthy channels, as often as `c` says.
fn by_chance(c: f64, channels: usize) -> f64 {
    (1.0 + c / (channels.max(1) as f64).sqrt()).powi(2)
}

/// Factor by which chance raises healthy channels' standard deviation in one of a hundred heads.
pub fn rarely_apart(channels: usize) -> f64 {
    by_chance(RARELY, channels).sqrt()
}

/// Whether channels moved along an axis to both sides: their sum is less than three standard
/// deviations from zero, or for few channels, less than if half of them moved by one amount.
fn is_even(moved: &[Features], axis: &Features) -> bool {
    let along = moved.iter().map(|of| of.dot(axis));
    let (sum, squares) = along.fold((0.0, 0.0), |(sum, squares), x| (sum + x, squares + x * x));
    sum * sum < (0.5 * moved.len() as f64).min(9.0) * squares
}

/// The value of chi-squared with four degrees of freedom that is exceeded as rarely as `square` is
/// by Hotelling's T² of four features with a covariance of `n` degrees of freedom. With z = 1 / (1 +
/// square / n) and m = (n - 3) / 2 the tail of T² is z^m (1 + m (1 - z)), and that of chi-squared
/// beyond 2 x is e^-x (1 + x). So x = ln (1 + x) - ln (tail of T²), which is iterated.
fn as_if_known(square: f64, n: f64) -> f64 {
    let half = (n - 3.0) / 2.0;
    if half <= 0.0 {
        return 0.0; // a covariance of so few degrees of freedom says nothing
    }
    let z = 1.0 / (1.0 + square / n);
    let ln_tail = half * z.ln() + (half * (1.0 - z)).ln_1p();
    let mut x = -ln_tail;
    for _ in 0..30 {
        x = x.ln_1p() - ln_tail;
    }
    2.0 * x
}

/// Covariance about zero of what most channels moved by: the minimum covariance determinant
/// (Rousseeuw 1984), reweighted. `None`: too few channels, or a covariance has no inverse.
fn robust(moved: &[Features]) -> Option<Matrix4<f64>> {
    if moved.len() < FEWEST {
        return None;
    }

    let by_feature =
        Vector4::from_fn(|k, _| median_of(moved.iter().map(|m| m[k] * m[k])) / MEDIAN_1);
    let mut of = Matrix4::from_diagonal(&by_feature);

    // Each step takes the half of the channels that lies closest by the covariance so far, and
    // scales their mean square such that the median squared distance is that of chi-squared.
    let half = moved.len().div_ceil(2);
    let mut closest = Vec::new();
    for _ in 0..STEPS {
        let distances = squares(moved, &of)?;
        let mut next: Vec<usize> = (0..moved.len()).collect();
        next.sort_by(|&p, &q| distances[p].total_cmp(&distances[q]));
        next.truncate(half);
        let scatter = mean_square(next.iter().map(|&k| &moved[k]));
        of = scatter * (median_of(squares(moved, &scatter)?.into_iter()) / MEDIAN_4);
        if next == closest {
            break;
        }
        closest = next;
    }

    // reweighting: all channels but those that lie far out have less scatter than half of them
    let within = moved.iter().zip(squares(moved, &of)?).filter(|(_, square)| *square < UPPER_4);
    Some(mean_square(within.map(|(m, _)| m)) * OF_WITHIN)
}

fn squares(moved: &[Features], covariance: &Matrix4<f64>) -> Option<Vec<f64>> {
    let inverse = covariance.try_inverse().filter(|of| of.iter().all(|v| v.is_finite()))?;
    Some(moved.iter().map(|m| m.dot(&(inverse * m))).collect())
}

fn mean_square<'a>(of: impl Iterator<Item = &'a Features>) -> Matrix4<f64> {
    let zero = (Matrix4::zeros(), 0.0);
    let (sum, n) = of.fold(zero, |(sum, n), m| (sum + m * m.transpose(), n + 1.0));
    sum / n
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
        // upper 1e-3 of F(4, 20) is 7.096 (tables); T^2 = 4 n / (n - 3) F, n = 23; of chi-squared
        // 18.467
        let t2 = 4.0 * 23.0 / 20.0 * 7.096;
        assert!((as_if_known(t2, 23.0) / 18.467 - 1.0).abs() < 1e-3, "{}", as_if_known(t2, 23.0));
        assert!((as_if_known(30.0, 1e9) / 30.0 - 1.0).abs() < 1e-6);
        assert_eq!(as_if_known(1e9, 3.0), 0.0);
    }

    /// The upper 1e-3 of chi-squared (18.47) is exceeded by at most about that share of the
    /// channels, in heads that have aged in whatever directions and in heads that have not.
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
                let apart = Apart::learn(&moved, OFTEN);
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

    /// Of few channels of which none or up to three in eight are faulty it is seldom said that they
    /// surely lie twice as far apart.
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
                let wider = Apart::learn(&moved, 0.0).wider().max().sqrt();
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
            alike += usize::from(Apart::learn(&moved, OFTEN).each_its_own_way);
            let moved: Vec<Features> = draws(8, &mut rng).iter().map(|m| m * 5.0).collect();
            aged += usize::from(Apart::learn(&moved, OFTEN).each_its_own_way);
        }
        assert!(alike <= 20 && aged >= 160, "{alike} and {aged} of 200");
    }

    /// Ageing whose tail is heavier than a Gaussian's is not covered: of Student's t with five
    /// degrees of freedom .4 % of the channels of a head of 60 lie beyond a bound that is meant for
    /// one in a million.
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
            let apart = Apart::learn(&moved, OFTEN);
            beyond += moved.iter().filter(|m| apart.square(m, 1.0) > 33.38).count();
        }
        let rate = f64::from(beyond as u32) / f64::from(60 * heads);
        assert!((1e-3..8e-3).contains(&rate), "{rate}");
    }

    /// Ageing that ties the features together is found, though two in five channels do something
    /// else.
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
        let apart = Apart::learn(&moved, OFTEN);
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
