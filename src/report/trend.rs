//! Whether a fault gets worse or better.
//!
//! In: a channel's severities over time, pooled in bins (`Course`, which `watch` fills). Out: a
//! `Trend`, the slope per day by least squares with a 95 % interval (`trend`).
//!
//! The steps:
//! 1. A line through the means of the bins by least squares (`line`). The bins are not weighted by
//!    their numbers of signals. Errors of neighbouring bins are correlated, because they share what
//!    the ink does (temperature, meniscus). The interval is widened by the correlation of the
//!    residuals from bin to bin, as for an autoregressive process of first order. The estimate of a
//!    correlation rho from the residuals of n bins about a fitted polynomial of p coefficients is biased low by
//!    (p + (p + 2) rho) / n; this is corrected.
//! 2. A fault that just began grows first and then stays, and one line through both phases says
//!    nothing. If the later half does not follow the line through all bins, only the later half is
//!    used, and so on (`latest_line`). Severities of less than an hour give no trend: minutes say
//!    how a fault began, but nothing about the day.
//!    Nights differ of themselves, by another temperature or another start of the ink, and the bins of one night share
//!    that. So the line goes through the means of nights (`nights`), and its interval has as many degrees of freedom
//!    as these leave. Two nights leave none: of them the later one alone is used.
//! 3. Signals without a size are often the smaller ones, since only signals with a name have a
//!    size. The mean of the sizes then lies above that of the fault, most where the fewest signals
//!    have one. Nobody can tell whether it is so; therefore a trend's interval holds two lines, the
//!    one through the means as they are and the one through means that are corrected for it
//!    (`Severities::selected`).

use super::bins::{Pooled, TimeBins};
use super::night::PAUSE_NS;
use inkling_core::model::normal::normal_quantile;
use inkling_core::model::student::student_quantile;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// Of fewer points the correlation cannot be estimated.
const LEAST_BINS: usize = 8;
/// Of fewer nights nobody can tell how they wander about a curve from how the fault grows: asked at eight nights, that
/// hid one in three faults that grow by 5 % a night, with a scatter of 3 % (simulated).
const LEAST_OF_CURVE: usize = 14;

/// What a line goes through.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Points {
    /// Bins of one night, which share what the ink does.
    Bins,
    Nights,
}

impl Points {
    /// With fewer there is no line: of bins the correlation cannot be estimated, and two nights leave no degree of
    /// freedom.
    fn least(self) -> usize {
        match self {
            Points::Bins => LEAST_BINS,
            Points::Nights => 3,
        }
    }
}

/// Least time span of a trend, days.
const LEAST_SPAN: f64 = 1.0 / 24.0;
/// Upper limit of the correlation between neighbouring bins: beyond it the residuals are a random
/// walk and no scatter about a line. Somewhat arbitrary.
const MOST_CORRELATION: f64 = 0.95;
const DAY_NS: f64 = 86_400e9;

/// The contents of one bin: sums over its signals, from which mean and variance follow.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Severities {
    /// Number of signals with a size, the sum of their sizes, and the sum of the squares of these.
    pub n: f64,
    sum: f64,
    sum_of_squares: f64,
    /// Sum of their times, ns.
    sum_t_ns: f64,
    /// Number of flagged signals of the fault that have no size in this quantity.
    pub(super) missed: f64,
    /// t_a of the last signal with a size and a name, ns, and its size.
    last: Option<(i64, f64)>,
}

impl Pooled for Severities {
    /// Most bins that a channel's severities are pooled in.
    const MOST_BINS: usize = 96;
    /// About a second: a trend takes an hour at least, and finer bins would only be memory.
    const FINEST_NS: i64 = 1_000_000 << 10;

    fn pool(&mut self, other: Severities) {
        self.n += other.n;
        self.sum += other.sum;
        self.sum_of_squares += other.sum_of_squares;
        self.sum_t_ns += other.sum_t_ns;
        self.missed += other.missed;
        let all = self.last.into_iter().chain(other.last);
        self.last = all.max_by_key(|(t_ns, _)| *t_ns);
    }
}

impl Severities {
    /// Mean time of the signals with a size, ns; 0 in a bin that has none.
    pub fn t_ns(&self) -> f64 {
        self.sum_t_ns / self.n.max(1.0)
    }

    /// Mean size; 0 in a bin without sizes.
    pub fn mean(&self) -> f64 {
        self.sum / self.n.max(1.0)
    }

    /// What it does to mean and variance if the signals that have a size are the largest ones of a
    /// Gaussian (a truncated normal distribution). The first number says how many standard
    /// deviations of all signals their mean lies too high, l = phi(z) / q; the second one is their
    /// variance over that of all signals, 1 - l (l - z). Here q is the share of signals that have a
    /// size, z the quantile that their sizes exceed, and phi the normal density. (0, 1) if all have
    /// one.
    fn selected(&self) -> (f64, f64) {
        let share = self.n / (self.n + self.missed);
        if share >= 1.0 {
            return (0.0, 1.0);
        }
        let z = normal_quantile(1.0 - share);
        let l = (-0.5 * z * z).exp() / std::f64::consts::TAU.sqrt() / share;
        (l, 1.0 - l * (l - z))
    }

    /// Standard error of the mean; `None` if there is a single value.
    pub fn standard_error(&self) -> Option<f64> {
        (self.n >= 2.0).then(|| (self.squares() / (self.n - 1.0) / self.n).sqrt())
    }

    /// Sum of squares of the sizes about their mean.
    fn squares(&self) -> f64 {
        (self.sum_of_squares - self.n * self.mean().powi(2)).max(0.0)
    }
}

/// The severities of a channel over time, in one quantity.
pub type Course = TimeBins<Severities>;

impl Course {
    /// Adds one severity, unless it is infinite or NaN. `is_named`: the signal is certain enough for a name, so that it
    /// may be quoted as the last size.
    pub fn add(&mut self, t_ns: i64, severity: f64, is_named: bool) {
        if severity.is_finite() {
            self.at(t_ns).pool(Severities {
                n: 1.0,
                sum: severity,
                sum_of_squares: severity * severity,
                sum_t_ns: t_ns as f64,
                last: is_named.then_some((t_ns, severity)),
                ..Severities::default()
            });
        }
    }

    /// The size of the last signal with a name from one time until before another.
    pub fn last(&self, from_ns: i64, to_ns: i64) -> Option<f64> {
        let all = self.values().filter_map(|bin| bin.last);
        let within = all.filter(|(t_ns, _)| (from_ns..to_ns).contains(t_ns));
        within.max_by_key(|(t_ns, _)| *t_ns).map(|(_, size)| size)
    }

    /// Adds a signal of the fault that has no size in this quantity.
    pub fn miss(&mut self, t_ns: i64) {
        self.at(t_ns).pool(Severities { missed: 1.0, ..Severities::default() });
    }
}

/// Change of severity per day, in the unit of the severity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trend {
    pub per_day: f64,
    /// 95 % confidence interval of `per_day`.
    pub interval: [f64; 2],
    /// Time over which the change was seen, days. A forecast further ahead than that is a guess.
    pub span_days: f64,
}

/// What the interval says of the slope's sign.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    Worse,
    Better,
    /// The interval contains 0.
    Steady,
}

impl Trend {
    /// The trend with its interval widened by the uncertainty of the scale of sizes, of which `relative` is the
    /// relative standard deviation: all sizes of a channel may be off by one factor. The outer bound is
    /// multiplied by 1 + 1.96 `relative`, a bound on the near side of 0 divided by it, so the trend keeps its
    /// direction.
    pub fn of_scale(self, relative: f64) -> Trend {
        let wider = 1.0 + 1.96 * relative;
        let [low, high] = self.interval;
        let low = if low > 0.0 { low / wider } else { low * wider };
        let high = if high > 0.0 { high * wider } else { high / wider };
        Trend { interval: [low, high], ..self }
    }

    /// Worse if the whole interval is above 0, better if it is below.
    pub fn direction(&self) -> Direction {
        match self.interval {
            [low, _] if low > 0.0 => Direction::Worse,
            [_, high] if high < 0.0 => Direction::Better,
            _ => Direction::Steady,
        }
    }
}

/// The trend of the severities between two times, ns; `None` if the bins are too few or span too little.
pub fn trend(course: &Course, from_ns: i64, to_ns: i64) -> Option<Trend> {
    let time = from_ns as f64..=to_ns as f64;

    // Only bins with a size count, at the mean time of their sizes.
    let bins = course.values().filter(|bin| bin.n > 0.0 && time.contains(&bin.t_ns()));
    let bins: Vec<&Severities> = bins.collect();
    let line_of = |size: &dyn Fn(&Severities) -> f64| {
        let point = |bin: &&Severities| ((bin.t_ns() - from_ns as f64) / DAY_NS, size(bin));
        latest_line(&bins.iter().map(point).collect::<Vec<_>>())
    };

    // The standard deviation of all signals within a bin, from all bins together: each bin's
    // squares are enlarged by what the selection took away.
    let squares = bins.iter().map(|of| of.squares() / of.selected().1);
    let sd = (squares.sum::<f64>() / bins.iter().map(|of| of.n - 1.0).sum::<f64>().max(1.0)).sqrt();

    // Two lines, as if signals without a size were like the others, and as if they were the
    // smallest. The slope told is the mean of the two slopes; the interval holds both intervals.
    let sized = line_of(&Severities::mean)?;
    let all = line_of(&|of| of.mean() - of.selected().0 * sd)?;
    Some(Trend {
        per_day: 0.5 * (sized.per_day + all.per_day),
        interval: [sized.interval[0].min(all.interval[0]), sized.interval[1].max(all.interval[1])],
        span_days: sized.span_days.min(all.span_days),
    })
}

/// The line through the latest of the points (days, severity) that follow one line. If the line
/// through the later half (of the time) has a slope whose interval does not overlap that of all
/// points, the earlier half is dropped, and the later half is looked at in the same way. `None`: `line` gives none, or
/// the points span less than `LEAST_SPAN`.
fn latest_line(points: &[(f64, f64)]) -> Option<Trend> {
    let nights: Vec<&[(f64, f64)]> = nights(points).collect();
    match nights[..] {
        [] => None,
        [night] | [_, night] => latest_of(night, Points::Bins),
        _ => latest_of(&nights.iter().map(|night| mean(night)).collect::<Vec<_>>(), Points::Nights),
    }
}

/// The points of each night.
fn nights(points: &[(f64, f64)]) -> impl Iterator<Item = &[(f64, f64)]> {
    points.chunk_by(|a, b| (b.0 - a.0) * DAY_NS <= PAUSE_NS as f64)
}

fn mean(points: &[(f64, f64)]) -> (f64, f64) {
    let sum = points.iter().fold((0.0, 0.0), |(x, y), p| (x + p.0, y + p.1));
    (sum.0 / points.len() as f64, sum.1 / points.len() as f64)
}

/// See [`latest_line`].
fn latest_of(points: &[(f64, f64)], of: Points) -> Option<Trend> {
    let of_all = line(points, of)?;
    let later = points.partition_point(|p| p.0 - points[0].0 < 0.5 * of_all.span_days);
    let apart = |later: &Trend| {
        let ([a, b], [c, d]) = (later.interval, of_all.interval);
        b < c || d < a
    };
    match line(&points[later..], of).filter(apart) {
        Some(_) => latest_of(&points[later..], of),
        None => Some(of_all).filter(|trend| trend.span_days >= LEAST_SPAN),
    }
}

/// Moments of points (x, y), and the slope of the least-squares line through them.
pub struct Moments {
    /// Mean of y.
    pub y0: f64,
    /// Sum of squares of x about its mean.
    pub sxx: f64,
    pub slope: f64,
}

impl Moments {
    /// The moments of these points. Without points, or with all at one x, some of them are NaN.
    pub fn of(points: &[(f64, f64)]) -> Moments {
        let (x0, y0) = mean(points);
        let sxx: f64 = points.iter().map(|p| (p.0 - x0).powi(2)).sum();
        let sxy: f64 = points.iter().map(|p| (p.0 - x0) * (p.1 - y0)).sum();
        Moments { y0, sxx, slope: sxy / sxx }
    }
}

/// Least-squares line through (days, severity), in the order of time; `None` with too few points.
fn line(points: &[(f64, f64)], of: Points) -> Option<Trend> {
    if points.len() < of.least() {
        return None;
    }
    let Moments { sxx, slope, .. } = Moments::of(points);
    if sxx <= 0.0 {
        return None;
    }

    let about_line = Scatter::about(points, 2);
    let half = about_line.half_interval(points, sxx);
    let span_days = points[points.len() - 1].0 - points[0].0;
    let mut interval = [slope - half, slope + half];

    // Few faults grow by a straight line. That they do not makes it less sure how fast they grow, and not whether: the
    // bound next to 0 is that of how nights wander about a curve, or of few nights as if each were by itself.
    if of == Points::Nights {
        let wander = match points.len() < LEAST_OF_CURVE {
            true => Scatter { correlation: 0.0, ..about_line },
            false => Scatter::about(points, 4),
        };
        interval[usize::from(slope < 0.0)] =
            slope - wander.half_interval(points, sxx).copysign(slope);
    }
    Some(Trend { per_day: slope, interval, span_days })
}

/// How points scatter about a polynomial.
#[derive(Clone, Copy)]
struct Scatter {
    coefficients: f64,
    /// Sum of the squares of the residuals.
    squares: f64,
    /// Correlation of the residuals from one point to the next, 0 or more.
    correlation: f64,
}

impl Scatter {
    /// About the polynomial of so many coefficients that lies nearest, by least squares.
    fn about(points: &[(f64, f64)], coefficients: usize) -> Scatter {
        let (n, p) = (points.len() as f64, coefficients as f64);
        let (first, last) = (points[0].0, points[points.len() - 1].0);
        let x = |i: usize| 2.0 * (points[i].0 - first) / (last - first) - 1.0;
        let powers =
            DMatrix::from_fn(points.len(), coefficients, |i, j| x(i).powi(j as i32)).qr().q();
        let y = DVector::from_iterator(points.len(), points.iter().map(|point| point.1));
        let residuals = &y - &powers * powers.tr_mul(&y);

        // The estimate's bias is (p + (p + 2) rho) / n, so rho = (r + p / n) / (1 - (p + 2) / n). A negative rho counts as
        // 0, so that the interval is never narrowed. Of a few nights it cannot be estimated, and they share little.
        let squares = residuals.norm_squared();
        let lagged: f64 = residuals.as_slice().windows(2).map(|w| w[0] * w[1]).sum();
        let found = if squares > 0.0 { lagged / squares } else { 0.0 };
        let correlation = match points.len() < LEAST_BINS {
            true => 0.0,
            false => ((found + p / n) / (1.0 - (p + 2.0) / n)).clamp(0.0, MOST_CORRELATION),
        };
        Scatter { coefficients: p, squares, correlation }
    }

    /// Half the 95 % interval of the slope of the line through these points. `sxx`: of [`Moments`].
    fn half_interval(&self, points: &[(f64, f64)], sxx: f64) -> f64 {
        let (n, p) = (points.len() as f64, self.coefficients);
        // The variance of a mean of such noise over that of white noise widens the interval and lowers the effective
        // number of points, from which the degrees of freedom follow.
        let inflated = (1.0 + self.correlation) / (1.0 - self.correlation);
        let freedom = (n / inflated - p).max(1.0);
        // Severities in tables are f32: a change below their rounding is none.
        let rounded = n * (f64::from(f32::EPSILON) * mean(points).1).powi(2);
        let error = ((self.squares + rounded) / (n - p) / sxx * inflated).sqrt();
        student_quantile(0.975, freedom) * error
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// Approximately Gaussian noise of standard deviation 1: a sum of 12 uniforms.
    fn noise(rng: &mut ChaCha8Rng) -> f64 {
        (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0
    }

    /// Its size bends a little, as every size does, and the residuals of neighbouring nights are alike.
    #[test]
    fn a_fault_that_grows_night_after_night_goes_on_to_be_told() {
        let mut course = Course::default();
        for night in 0..24i64 {
            for k in 0..30i64 {
                let day = night as f64;
                let size = 0.3 + 0.02 * day + 0.015 * (day / 5.0).sin() + 0.002 * (k % 5) as f64;
                course.add(night * DAY_NS as i64 + k * 1_000_000_000, size, true);
            }
            let found = trend(&course, 0, i64::MAX).map(|trend| trend.direction());
            assert!(night < 5 || found == Some(Direction::Worse), "night {night}: {found:?}");
        }
    }

    /// Share of 1000 simulated lines, with autoregressive noise, whose interval holds the true slope.
    fn share_covered(correlation: f64, seed: u64) -> f64 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut covered = 0;
        for _ in 0..1000 {
            let mut e = noise(&mut rng);
            let points: Vec<(f64, f64)> = (0..60)
                .map(|k| {
                    e = correlation * e
                        + (1.0 - correlation * correlation).sqrt() * noise(&mut rng);
                    (0.25 * f64::from(k), 0.4 + 0.02 * 0.25 * f64::from(k) + 0.01 * e)
                })
                .collect();
            let t = line(&points, Points::Bins).unwrap();
            covered += usize::from(t.interval[0] < 0.02 && 0.02 < t.interval[1]);
        }
        covered as f64 / 1000.0
    }

    #[test]
    fn intervals_hold_the_true_slope_as_often_as_they_say() {
        assert!((0.925..0.975).contains(&share_covered(0.0, 1)), "{}", share_covered(0.0, 1));
        // a correlation that is estimated from sixty bins scatters, and so does the width of the interval
        assert!(share_covered(0.6, 2) > 0.90, "{}", share_covered(0.6, 2));
    }

    /// Of thirty signals a night, those above 1.1 have a size; the fault grows towards that.
    #[test]
    fn signals_that_are_too_small_for_a_size_hide_no_trend() {
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let (mut held, mut held_by_sized) = (0, 0);
        for _ in 0..200 {
            let mut course = Course::default();
            for night in 0..40 {
                let mean = 1.02 + 0.002 * f64::from(night);
                for burst in 0..30 {
                    let t_ns = (f64::from(night) * DAY_NS) as i64 + burst * 1_000_000_000;
                    let size = mean + 0.015 * noise(&mut rng);
                    if size > 1.1 { course.add(t_ns, size, true) } else { course.miss(t_ns) }
                }
            }
            let holds = |of: Option<Trend>| {
                of.is_some_and(|of| of.interval[0] < 0.002 && 0.002 < of.interval[1])
            };
            held += usize::from(holds(trend(&course, 0, i64::MAX)));
            let sized: Vec<_> = course
                .values()
                .filter(|of| of.n > 0.0)
                .map(|of| (of.t_ns() / DAY_NS, of.mean()))
                .collect();
            held_by_sized += usize::from(holds(latest_line(&sized)));
        }
        assert!(held >= 110 && held_by_sized < 20, "{held} and {held_by_sized} of 200");
    }

    /// Nights of twenty quarters of an hour scatter ten times as much as their bins.
    #[test]
    fn nights_that_differ_of_themselves_are_no_trend() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        for nights in 2..=12 {
            let mut moving = 0;
            for _ in 0..200 {
                let of_night = |night: u32, rng: &mut ChaCha8Rng| {
                    let size = 0.5 + 0.1 * noise(rng);
                    let time = |k: u32| f64::from(night) + f64::from(k) / 96.0;
                    (0..20).map(|k| (time(k), size + 0.01 * noise(rng))).collect::<Vec<_>>()
                };
                let points: Vec<_> = (0..nights).flat_map(|k| of_night(k, &mut rng)).collect();
                let told = latest_line(&points);
                moving += usize::from(told.is_some_and(|of| of.direction() != Direction::Steady));
            }
            // one in twenty would be as stated; halves that are looked at by themselves cost some more
            assert!(moving < 24, "{nights} nights: {moving} of 200 said to change");
        }
    }

    /// Sizes wander: each night begins where the one before left off by six tenths.
    #[test]
    fn nights_that_wander_are_seldom_a_trend() {
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        for (nights, most) in [(14, 40), (24, 30), (40, 26)] {
            let mut moving = 0;
            for _ in 0..200 {
                let mut e = noise(&mut rng);
                let mut wander = |night: u32| {
                    e = 0.6 * e + 0.8 * noise(&mut rng);
                    (f64::from(night), 0.5 + 0.02 * e)
                };
                let points: Vec<_> = (0..nights).map(&mut wander).collect();
                let told = line(&points, Points::Nights).unwrap();
                moving += usize::from(told.direction() != Direction::Steady);
            }
            // taken for independent, 55 to 64 would be
            assert!(moving <= most, "{nights} nights: {moving} of 200 said to change");
        }
    }

    #[test]
    fn what_grows_every_night_is_told_after_four() {
        let mut rng = ChaCha8Rng::seed_from_u64(6);
        let mut told = 0;
        for _ in 0..200 {
            let size = |night: u32, rng: &mut ChaCha8Rng| {
                (f64::from(night), 0.1 * f64::from(night) + 0.01 * noise(rng))
            };
            let points: Vec<_> = (0..4).map(|night| size(night, &mut rng)).collect();
            let trend = latest_line(&points);
            told += usize::from(trend.is_some_and(|of| of.direction() == Direction::Worse));
        }
        assert!(told > 190, "{told} of 200");
    }

    #[test]
    fn what_grew_and_then_stays_is_steady() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut moving = 0;
        for _ in 0..300 {
            // ten quarters of an hour of growth, then sixty without
            let points: Vec<(f64, f64)> = (0..70)
                .map(|k| {
                    let size = 0.04 * f64::from(k.min(10));
                    (f64::from(k) / 96.0, size + 0.01 * noise(&mut rng))
                })
                .collect();
            moving += usize::from(latest_line(&points).unwrap().direction() != Direction::Steady);
        }
        assert!(moving < 40, "{moving} of 300 said to change");
    }

    #[test]
    fn few_points_and_points_of_little_time_tell_nothing() {
        assert_eq!(latest_line(&[]), None);
        assert_eq!(latest_line(&[(0.0, 1.0), (0.1, 2.0), (0.2, 3.0), (0.3, 4.0)]), None);
        assert_eq!(latest_line(&[(0.0, 1.0), (1.0, 2.0)]), None);
        assert_eq!(latest_line(&[(1.0, 1.0); 9]), None);
        let exact = |days: f64| -> Vec<(f64, f64)> {
            (0..20).map(|k| (days * f64::from(k), 2.0 * f64::from(k))).collect()
        };
        let t = latest_line(&exact(1.0)).unwrap();
        assert!((t.per_day - 2.0).abs() < 1e-12 && t.direction() == Direction::Worse);
        assert_eq!(latest_line(&exact(1.0 / 86_400.0)), None, "twenty seconds");
        let constant: Vec<(f64, f64)> = (0..20).map(|k| (f64::from(k), 0.3)).collect();
        assert_eq!(latest_line(&constant).unwrap().direction(), Direction::Steady);
    }
}
