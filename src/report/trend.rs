//! Whether a fault gets worse or better. In: a channel's severities over time, pooled in bins. Out:
//! [`Trend`]: the slope per day by least squares, with a 95 % interval.
//!
//! Neighbouring bins share what the ink does (temperature, meniscus); their residuals' correlation
//! from bin to bin widens the interval as that of an autoregression of first order would. About a fitted
//! line a correlation rho of n bins comes out low, by (2 + 4 rho) / n: that is made good.
//!
//! A fault that just began grows, and then it does not: one line through both says nothing. Where the
//! later half does not follow the line through all, only the later half is asked. Below an hour there is
//! no trend: minutes say how a fault began, and nothing of the day.

use super::bins::{Pooled, TimeBins};
use inkling_core::model::student::student_quantile;

/// Bins of a channel's severities.
const MOST_BINS: usize = 96;
/// Below, there is no interval worth telling.
const LEAST_BINS: usize = 8;
/// Days; below, nothing is said of how it goes on.
const LEAST_SPAN: f64 = 1.0 / 24.0;
/// Of neighbouring bins, at most: more is no line but a walk.
const MOST_CORRELATION: f64 = 0.95;
const DAY_NS: f64 = 86_400e9;

/// Severities that fell into one bin.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Severities {
    pub n: f64,
    sum: f64,
    sum_of_squares: f64,
    /// ns, of all times' sum.
    sum_t_ns: f64,
}

impl Pooled for Severities {
    fn pool(&mut self, other: Severities) {
        self.n += other.n;
        self.sum += other.sum;
        self.sum_of_squares += other.sum_of_squares;
        self.sum_t_ns += other.sum_t_ns;
    }
}

impl Severities {
    pub fn t_ns(&self) -> f64 {
        self.sum_t_ns / self.n.max(1.0)
    }

    pub fn mean(&self) -> f64 {
        self.sum / self.n.max(1.0)
    }

    /// Of the mean; `None` of a single value.
    pub fn standard_error(&self) -> Option<f64> {
        let variance = (self.sum_of_squares - self.n * self.mean().powi(2)) / (self.n - 1.0);
        (self.n >= 2.0).then(|| (variance.max(0.0) / self.n).sqrt())
    }
}

/// Severities over time.
#[derive(Clone, Debug)]
pub struct Course(pub TimeBins<Severities>);

impl Default for Course {
    fn default() -> Course {
        Course(TimeBins::new(MOST_BINS))
    }
}

impl Course {
    pub fn add(&mut self, t_ns: i64, severity: f64) {
        if severity.is_finite() {
            self.0.at(t_ns).pool(Severities {
                n: 1.0,
                sum: severity,
                sum_of_squares: severity * severity,
                sum_t_ns: t_ns as f64,
            });
        }
    }
}

/// Change of severity per day.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trend {
    pub per_day: f64,
    /// 95 %.
    pub interval: [f64; 2],
    /// Over which it was seen, days: beyond, it is a guess.
    pub span_days: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    Worse,
    Better,
    /// The interval holds no change.
    Steady,
}

impl Trend {
    /// With the uncertainty of the scale that sizes are measured on, a relative standard deviation: all sizes of a channel
    /// are too large or too small by the same factor, which no scatter about the line shows. It leaves the direction.
    pub fn of_scale(self, relative: f64) -> Trend {
        let wider = 1.0 + 1.96 * relative;
        let [low, high] = self.interval;
        let low = if low > 0.0 { low / wider } else { low * wider };
        let high = if high > 0.0 { high * wider } else { high / wider };
        Trend { interval: [low, high], ..self }
    }

    pub fn direction(&self) -> Direction {
        match self.interval {
            [low, _] if low > 0.0 => Direction::Worse,
            [_, high] if high < 0.0 => Direction::Better,
            _ => Direction::Steady,
        }
    }
}

/// Of the severities of some time; `None`: too few or too short to tell.
pub fn trend(course: &Course, from_ns: i64, to_ns: i64) -> Option<Trend> {
    let time = from_ns as f64..=to_ns as f64;
    let bins = course.0.values().filter(|bin| bin.n > 0.0 && time.contains(&bin.t_ns()));
    let points: Vec<(f64, f64)> =
        bins.map(|bin| ((bin.t_ns() - from_ns as f64) / DAY_NS, bin.mean())).collect();
    latest_line(&points)
}

/// The line through (days, severity), of the latest of them that lie along one.
fn latest_line(points: &[(f64, f64)]) -> Option<Trend> {
    let of_all = line(points)?;
    let later = points.partition_point(|p| p.0 - points[0].0 < 0.5 * of_all.span_days);
    let apart = |later: &Trend| {
        let ([a, b], [c, d]) = (later.interval, of_all.interval);
        b < c || d < a
    };
    match line(&points[later..]).filter(apart) {
        Some(_) => latest_line(&points[later..]),
        None => Some(of_all).filter(|trend| trend.span_days >= LEAST_SPAN),
    }
}

/// Least squares.
fn line(points: &[(f64, f64)]) -> Option<Trend> {
    let n = points.len() as f64;
    if points.len() < LEAST_BINS {
        return None;
    }
    let mean = |of: fn(&(f64, f64)) -> f64| points.iter().map(of).sum::<f64>() / n;
    let (x0, y0) = (mean(|p| p.0), mean(|p| p.1));
    let sxx: f64 = points.iter().map(|p| (p.0 - x0).powi(2)).sum();
    let sxy: f64 = points.iter().map(|p| (p.0 - x0) * (p.1 - y0)).sum();
    if sxx <= 0.0 {
        return None;
    }
    let slope = sxy / sxx;
    let residuals: Vec<f64> = points.iter().map(|p| p.1 - y0 - slope * (p.0 - x0)).collect();
    let squares: f64 = residuals.iter().map(|r| r * r).sum();
    let lagged: f64 = residuals.windows(2).map(|w| w[0] * w[1]).sum();
    let correlation = if squares > 0.0 { lagged / squares } else { 0.0 };
    let correlation = (correlation + 2.0 / n) / (1.0 - 4.0 / n);
    let correlation = correlation.clamp(0.0, MOST_CORRELATION);
    let inflated = (1.0 + correlation) / (1.0 - correlation);
    let freedom = (n / inflated - 2.0).max(1.0);
    // tables hold single precision: what that rounds away is no change
    let rounded = n * (f64::from(f32::EPSILON) * y0).powi(2);
    let error = ((squares + rounded) / (n - 2.0) / sxx * inflated).sqrt();
    let half = student_quantile(0.975, freedom) * error;
    let span_days = points[points.len() - 1].0 - points[0].0;
    Some(Trend { per_day: slope, interval: [slope - half, slope + half], span_days })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// Sums of uniforms: about Gaussian, sd 1.
    fn noise(rng: &mut ChaCha8Rng) -> f64 {
        (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0
    }

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
            let t = line(&points).unwrap();
            covered += usize::from(t.interval[0] < 0.02 && 0.02 < t.interval[1]);
        }
        covered as f64 / 1000.0
    }

    #[test]
    fn intervals_hold_the_true_slope_as_often_as_they_say() {
        assert!((0.925..0.975).contains(&share_covered(0.0, 1)), "{}", share_covered(0.0, 1));
        // estimated from sixty bins a correlation scatters, and with it the interval
        assert!(share_covered(0.6, 2) > 0.90, "{}", share_covered(0.6, 2));
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
        assert_eq!(latest_line(&[(0.0, 1.0), (1.0, 2.0), (2.0, 3.0), (3.0, 4.0)]), None);
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
