//! Power analysis of a design by Monte Carlo: what the design promises before any data are judged.
//!
//! In: a design's pooled healthy model and its physics. Out: [`Promise`], which `inkling score` and
//! `inkling identify` show: for each class the smallest fault that is found, for each two classes
//! how often they are mistaken for each other.
//!
//! A signal's deviation is drawn as d = fault + T u + noise: the fault's deviation by the physics,
//! the sensitivities T times a channel's features u ~ N(mean, spread) of the healthy model, and
//! white noise. Every drawn signal is judged as any signal is. The power is the share that is
//! flagged; the smallest fault is where the power reaches [`FOUND`]; the confusion counts the class
//! of largest weight among flagged signals. The result holds as far as this model does.

use super::{Design, DesignError, IsolateSettings, Judge, Workspace};
use crate::isolate::fault_physics::FaultPhysics;
use crate::model::bisection::bisected;
use crate::model::faults::Catalogue;
use crate::model::ring_fit::{Features, RingFitter};
use crate::promise::{Detectable, FOUND, Pair, Promise};
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Number of signals that are drawn of each class and size. A power of .9 so has a standard error
/// of .02.
const DRAWS: usize = 200;
/// Number of severities of a kind of fault that are tried, at equal steps of the law's scale from
/// no fault (left out) to the largest severity.
const SIZES: usize = 40;
/// Number of bisections between the last severity that is not found and the first one that is.
const HALVINGS: usize = 5;
/// Number of severities of a class at which isolation is tried.
const ISOLATED_SIZES: usize = 12;

impl Design {
    /// The design's power analysis. `settings`: how faults are isolated. Left out are classes that
    /// stand for no law of the physics, or for laws of several kinds, since their severities have
    /// no common scale. `None`: the design knows no physics, or does not detect by sensitivities.
    pub fn promise(&self, settings: &IsolateSettings) -> Result<Option<Promise>, DesignError> {
        let Some(monte_carlo) = MonteCarlo::new(self, settings)? else { return Ok(None) };
        let mut promise =
            Promise { false_alarm_rate: monte_carlo.rate(), draws: DRAWS, ..Promise::default() };

        // Class by class. `taken_for`: of each class, the share of its flagged signals for which
        // each class is the best; `None`: the class was left out, or none of its signals is
        // flagged.
        let mut taken_for: Vec<Option<Vec<f64>>> = vec![None; self.classes.len()];
        let laws = &monte_carlo.physics.laws;
        for (k, class) in self.fault_classes().iter().enumerate() {
            let Some(kind) = laws.one_kind(&class.of) else { continue };
            let Some(range) = range_of(&class.of, laws) else { continue };
            let Some(detectable) = monte_carlo.detectable(&class.name, kind, range) else {
                continue;
            };
            promise.classes.push(detectable);
            taken_for[k] = monte_carlo.taken_for(kind, range, self.classes.len());
        }

        // Pairs of classes: how often one is taken for the other (the mean of both directions), and
        // the angle between what their faults do to a signal.
        let names = self.class_names();
        let spans: Vec<Option<DMatrix<f64>>> =
            self.fault_classes().iter().map(|class| monte_carlo.span(&class.of)).collect();
        for i in 0..names.len() {
            for j in i + 1..names.len() {
                let Some((of_one, of_other)) = taken_for[i].as_ref().zip(taken_for[j].as_ref())
                else {
                    continue;
                };
                let mistaken = 0.5 * (of_one[j] + of_other[i]);
                let classes = [names[i].clone(), names[j].clone()];
                let both = spans[i].as_ref().zip(spans[j].as_ref());
                let angle_degrees = both.map_or(f64::NAN, |(a, b)| angle_degrees(a, b));
                promise.pairs.push(Pair { classes, mistaken, angle_degrees });
            }
        }
        promise.pairs.sort_by(|a, b| b.mistaken.total_cmp(&a.mistaken));
        Ok(Some(promise))
    }
}

/// The smallest angle, in degrees, between a direction in the span of `a` and one in the span of
/// `b`, both orthonormal bases: the first principal angle, whose cosine is the largest singular
/// value of a' b.
fn angle_degrees(a: &DMatrix<f64>, b: &DMatrix<f64>) -> f64 {
    let cosine = a.tr_mul(b).singular_values().max();
    cosine.min(1.0).acos().to_degrees()
}

/// The smallest range of severities that holds the ranges of all `classes`, which are of one kind.
fn range_of(classes: &[String], laws: &Catalogue) -> Option<[f64; 2]> {
    let ranges = classes.iter().filter_map(|class| laws.law(class)).map(|law| law.range);
    ranges.reduce(|[a, b], [c, d]| [a.min(c), b.max(d)])
}

/// Draws signals of faults and has them judged by the design's pooled model.
struct MonteCarlo<'a> {
    design: &'a Design,
    physics: &'a FaultPhysics,
    judge: Judge,
    /// T, N x 3: sensitivities to ln amplitude, ln damping and ln frequency, counts.
    tangent: DMatrix<f64>,
    /// A square root S of the covariance of healthy channels' features: S S' is the covariance.
    spread: Matrix3<f64>,
    /// The mean of healthy channels' features.
    mean: Vector3<f64>,
    /// Standard deviation of one sample's noise, counts.
    noise: f64,
}

impl<'a> MonteCarlo<'a> {
    /// `None`: the design knows no physics, or its pooled model has no sensitivities.
    fn new(
        design: &'a Design,
        settings: &IsolateSettings,
    ) -> Result<Option<MonteCarlo<'a>>, DesignError> {
        let model = design.pooled.clone();
        let (Some(physics), Some(sensitivity)) = (&design.physics, &model.sensitivity) else {
            return Ok(None);
        };
        let fitter = RingFitter::new(physics.ring, design.sample_period_s, design.samples);
        let tangent = fitter.tangent(&Features::HEALTHY).columns(0, 3).into_owned();
        // the square root of the covariance, from its eigenvalues and eigenvectors
        let spread = Matrix3::from_fn(|i, j| sensitivity.spread[i][j]).symmetric_eigen();
        let roots = spread.eigenvalues.map(|v| v.max(0.0).sqrt());
        let (mean, noise) = (Vector3::from(sensitivity.mean), model.noise);
        let judge = Judge::new(0, model.into(), design.drive_voltage_v, Some(design), settings)?;
        let spread = spread.eigenvectors * Matrix3::from_diagonal(&roots);
        Ok(Some(MonteCarlo { design, physics, judge, tangent, spread, mean, noise }))
    }

    /// An orthonormal basis, N x 2, of the deviations that the smallest and the largest fault of a
    /// class make, after the linear map that makes noise and the channels' spread white. `classes`:
    /// the laws that the class stands for. `None`: these are not of one kind, or a fault cannot be
    /// predicted.
    fn span(&self, classes: &[String]) -> Option<DMatrix<f64>> {
        let laws = &self.physics.laws;
        let (kind, [least, most]) = (laws.one_kind(classes)?, range_of(classes, laws)?);
        let deviation = |severity| self.deviation(kind, severity).map(DVector::from_vec);
        let both = DMatrix::from_columns(&[deviation(least)?, deviation(most)?]);

        // A healthy signal has the covariance noise² I + U U', with U = T S = Q R. In the
        // coordinates of Q the covariance is noise² I + R R', and beside the span of Q it is noise²
        // I. So the two parts of a deviation are whitened separately, and added again.
        let (q, r) = (&self.tangent * self.spread).qr().unpack();
        let own = r.clone() * r.transpose() + DMatrix::identity(3, 3) * self.noise.powi(2);
        let white = own.cholesky()?.l();
        let along = q.tr_mul(&both);
        let beside = (&both - &q * &along) / self.noise;
        let along = white.solve_lower_triangular(&along)?;
        Some((q * along + beside).qr().q())
    }

    /// The rate of false alarms that the design's threshold is meant for; `None`: the threshold is
    /// no quantile.
    fn rate(&self) -> Option<f64> {
        let detect = &self.design.detect;
        let by_quantile = detect.threshold == crate::detect::ThresholdMethod::Quantile;
        by_quantile.then_some(detect.false_alarm_rate)
    }

    /// The deviation that a fault of the class and severity makes of a mean channel's signal,
    /// without noise, N, counts. `None`: the physics cannot predict the fault.
    fn deviation(&self, class: &str, severity: f64) -> Option<Vec<f64>> {
        let sampling = (self.design.sample_period_s, self.design.samples);
        self.physics.deviation(class, severity, sampling)
    }

    /// Deviations of [`DRAWS`] signals with a fault of that severity, N each, counts. Every class
    /// and severity gets the same channels and noise (common random numbers, the seed is fixed), so
    /// that the power changes with the severity and not by chance. `None`: the physics cannot
    /// predict the fault.
    fn signals(&self, class: &str, severity: f64) -> Option<Vec<Vec<f64>>> {
        let fault = self.deviation(class, severity)?;
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let signal = |_| {
            // the channel's own features, and to first order what they do to its signal
            let own = self.mean + self.spread * Vector3::from_fn(|_, _| normal());
            let of_channel = &self.tangent * DVector::from_column_slice(own.as_slice());
            let each = fault.iter().zip(of_channel.iter());
            each.map(|(fault, own)| fault + own + self.noise * normal()).collect()
        };
        Some((0..DRAWS).map(signal).collect())
    }

    /// Share of signals with a fault of that severity that are flagged, at the reference drive.
    fn power(&self, class: &str, severity: f64) -> Option<f64> {
        let mut work = Workspace::default();
        let flagged = |deviation: &Vec<f64>| {
            let found = self.judge.detect(deviation, 1.0, &mut work);
            self.judge.test(found).is_flagged()
        };
        let signals = self.signals(class, severity)?;
        let flagged = signals.iter().map(flagged).filter(|f| *f).count();
        Some(flagged as f64 / DRAWS as f64)
    }

    /// The smallest fault of the class `name` that is found, and the share found of the class's own
    /// range. `class`: the law in whose unit severities are counted; `range`: the severities that
    /// the class's name stands for. `None`: the physics cannot predict a severity.
    fn detectable(&self, name: &str, class: &str, range: [f64; 2]) -> Option<Detectable> {
        let laws = &self.physics.laws;
        let law = laws.law(class)?;
        let none = law.scale(law.none());
        // The power at SIZES severities, on one scale for all classes of the kind: from no fault to
        // the largest fault.
        let most = law.scale(laws.largest(law));
        let at = |place: f64| {
            let severity = law.severity_at(place);
            Some((severity, self.power(class, severity)?))
        };
        let place = |k: usize| none + (most - none) * k as f64 / SIZES as f64;
        let powers: Vec<(f64, f64)> = (1..=SIZES).map(|k| at(place(k))).collect::<Option<_>>()?;

        // `first`: index of the first severity from which on every severity is found. The limit
        // lies between that severity and the one before, `place(first)`, and is refined by
        // bisection.
        let first = powers.iter().rposition(|(_, power)| *power < FOUND).map_or(0, |k| k + 1);
        let smallest = (first < powers.len()).then(|| {
            let is_found = |place: f64| at(place).is_some_and(|(_, power)| power >= FOUND);
            let (from, to) = (place(first), place(first + 1));
            let [_, high] = bisected(from, to, HALVINGS, |place| !is_found(place));
            law.severity_at(high)
        });

        // the mean power over the severities within the class's own range
        let own: Vec<f64> =
            powers.iter().filter(|(s, _)| (range[0]..=range[1]).contains(s)).map(|p| p.1).collect();
        // a range between two of the severities is as its middle
        let found = match own.is_empty() {
            true => self.power(class, 0.5 * (range[0] + range[1]))?,
            false => own.iter().sum::<f64>() / own.len() as f64,
        };
        Some(Detectable { class: name.into(), range, smallest, found })
    }

    /// A row of the confusion matrix: of the flagged signals of a class, the share for which each
    /// class has the largest weight. The severities are the middles of `ISOLATED_SIZES` equal
    /// parts of `range` on the law's scale; `classes`: number of the design's classes. Flagged
    /// signals that get no weights (no ring explains them) count in no class, so the shares may add
    /// up to less than 1. `None`: no signal is flagged.
    fn taken_for(&self, class: &str, range: [f64; 2], classes: usize) -> Option<Vec<f64>> {
        let mut best = vec![0.0; classes];
        let mut work = Workspace::default();
        let law = self.physics.laws.law(class)?;
        let [from, to] = range.map(|severity| law.scale(severity));
        let sizes = (0..ISOLATED_SIZES)
            .map(|k| from + (to - from) * (k as f64 + 0.5) / ISOLATED_SIZES as f64)
            .map(|place| law.severity_at(place));
        let mut all = 0.0;
        for severity in sizes {
            for deviation in self.signals(class, severity).iter().flatten() {
                let found = self.judge.detect(deviation, 1.0, &mut work);
                if !self.judge.test(found).is_flagged() {
                    continue;
                }
                all += 1.0;
                if self.judge.isolate(deviation, 1.0, &mut work).is_none() {
                    continue;
                }
                let heaviest = work.weights.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1));
                heaviest.into_iter().for_each(|(k, _)| best[k] += 1.0);
            }
        }
        (all > 0.0).then(|| best.iter().map(|n| n / all).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_between_subspaces_are_the_smallest_ones() {
        let basis = |columns: &[[f64; 4]]| {
            let columns: Vec<DVector<f64>> =
                columns.iter().map(|c| DVector::from_row_slice(c).normalize()).collect();
            DMatrix::from_columns(&columns)
        };
        let plane = basis(&[[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]]);
        let beside = basis(&[[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]);
        let slanted = basis(&[[0.0, 1.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]);
        assert!((angle_degrees(&plane, &beside) - 90.0).abs() < 1e-9);
        assert!((angle_degrees(&plane, &slanted) - 45.0).abs() < 1e-9);
        assert!(angle_degrees(&plane, &plane) < 1e-5);
    }
}
