//! Power analysis of a design by Monte Carlo: what the design promises before any data are judged.
//!
//! In: a design's pooled healthy model and its physics. Out: [`Promise`]: for each class the
//! smallest fault that is found, for each two classes how often they are mistaken for each other.
//!
//! A signal's deviation is drawn as d = fault + T u + noise: the fault's deviation by the physics,
//! the sensitivities T times a channel's features u ~ N(mean, spread) of the healthy model, and
//! white noise. Every drawn signal is judged as any signal is. The power is the share that is
//! flagged; the smallest fault is where the power reaches [`FOUND`]; the confusion counts the class
//! of largest weight among flagged signals.

use super::{Design, IsolateSettings, Judge, Result, Workspace};
use crate::detect::ThresholdMethod;
use crate::isolate::fault_physics::FaultPhysics;
use crate::model::bisection::bisected;
use crate::model::faults::Catalogue;
use crate::model::ring_fit::{Features, RingFitter};
use crate::promise::{Detectable, FOUND, Pair, Promise};
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Number of signals that are drawn of each class and size: a power of .9 is known to .02.
const DRAWS: usize = 200;
/// Number of severities of a kind of fault that are tried, at equal steps of the law's scale from
/// no fault (left out) to the largest severity.
const SIZES: usize = 40;
/// Number of bisections between the last severity that is not found and the first one that is.
const HALVINGS: usize = 5;
const ISOLATED_SIZES: usize = 12;

impl Design {
    /// Left out are classes that stand for no law of the physics, or for laws of several kinds.
    /// `None`: the design knows no physics, or does not detect by sensitivities.
    pub fn promise(&self, settings: &IsolateSettings) -> Result<Option<Promise>> {
        let Some(monte_carlo) = MonteCarlo::new(self, settings)? else { return Ok(None) };
        let by_quantile = self.detect.threshold == ThresholdMethod::Quantile;
        let false_alarm_rate = by_quantile.then_some(self.detect.false_alarm_rate);
        let mut promise = Promise { false_alarm_rate, draws: DRAWS, ..Promise::default() };

        // `taken_for`: the share of its flagged signals for which each class is the best
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

/// The first principal angle, in degrees, between the spans of two orthonormal bases: its cosine is
/// the largest singular value of a' b.
fn angle_degrees(a: &DMatrix<f64>, b: &DMatrix<f64>) -> f64 {
    let cosine = a.tr_mul(b).singular_values().max();
    cosine.min(1.0).acos().to_degrees()
}

/// The smallest range of severities that holds the ranges of all `classes`, which are of one kind.
/// `None`: no law says what they do.
fn range_of(classes: &[String], laws: &Catalogue) -> Option<[f64; 2]> {
    let known = classes.iter().filter_map(|class| laws.law(class));
    let ranges = known.filter(|law| !law.changes_nothing()).map(|law| law.range);
    ranges.reduce(|[a, b], [c, d]| [a.min(c), b.max(d)])
}

struct MonteCarlo<'a> {
    design: &'a Design,
    physics: &'a FaultPhysics,
    judge: Judge,
    /// T, N x 3: sensitivities to ln amplitude, ln damping and ln frequency, counts.
    tangent: DMatrix<f64>,
    /// S, with the covariance of healthy channels' features S S'.
    spread: Matrix3<f64>,
    mean: Vector3<f64>,
    noise: f64,
}

impl<'a> MonteCarlo<'a> {
    fn new(design: &'a Design, settings: &IsolateSettings) -> Result<Option<MonteCarlo<'a>>> {
        let model = design.pooled.clone();
        let (Some(physics), Some(sensitivity)) = (&design.physics, &model.sensitivity) else {
            return Ok(None);
        };
        let fitter = RingFitter::new(physics.ring, design.sample_period_s, design.samples);
        let tangent = fitter.tangent(&Features::HEALTHY).columns(0, 3).into_owned();
        let spread = Matrix3::from_fn(|i, j| sensitivity.spread[i][j]).symmetric_eigen();
        let roots = spread.eigenvalues.map(|v| v.max(0.0).sqrt());
        let (mean, noise) = (Vector3::from(sensitivity.mean), model.noise);
        let judge = Judge::new(0, model.into(), design.drive_voltage_v, Some(design), settings)?;
        let spread = spread.eigenvectors * Matrix3::from_diagonal(&roots);
        Ok(Some(MonteCarlo { design, physics, judge, tangent, spread, mean, noise }))
    }

    /// An orthonormal basis, N x 2, of the deviations that the smallest and the largest fault of a
    /// class make, after the linear map that makes noise and the channels' spread white. `classes`:
    /// its laws. `None`: these are not of one kind, or a fault cannot be predicted.
    fn span(&self, classes: &[String]) -> Option<DMatrix<f64>> {
        let laws = &self.physics.laws;
        let (kind, [least, most]) = (laws.one_kind(classes)?, range_of(classes, laws)?);
        let deviation = |severity| self.deviation(kind, severity).map(DVector::from_vec);
        let both = DMatrix::from_columns(&[deviation(least)?, deviation(most)?]);

        // A healthy signal has the covariance noise² I + U U', with U = T S = Q R: in the
        // coordinates of Q noise² I + R R', beside the span of Q noise² I.
        let (q, r) = (&self.tangent * self.spread).qr().unpack();
        let own = r.clone() * r.transpose() + DMatrix::identity(3, 3) * self.noise.powi(2);
        let white = own.cholesky()?.l();
        let along = q.tr_mul(&both);
        let beside = (&both - &q * &along) / self.noise;
        let along = white.solve_lower_triangular(&along)?;
        Some((q * along + beside).qr().q())
    }

    /// Of a mean channel's signal, without noise, N, counts.
    fn deviation(&self, class: &str, severity: f64) -> Option<Vec<f64>> {
        let sampling = (self.design.sample_period_s, self.design.samples);
        self.physics.deviation(class, severity, sampling)
    }

    /// Deviations of [`DRAWS`] signals, N each, counts. Every class and severity gets the same
    /// channels and noise (common random numbers), so that the power does not change by chance.
    fn signals(&self, class: &str, severity: f64) -> Option<Vec<Vec<f64>>> {
        let fault = self.deviation(class, severity)?;
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let signal = |_| {
            let own = self.mean + self.spread * Vector3::from_fn(|_, _| normal());
            let of_channel = &self.tangent * DVector::from_column_slice(own.as_slice());
            let each = fault.iter().zip(of_channel.iter());
            each.map(|(fault, own)| fault + own + self.noise * normal()).collect()
        };
        Some((0..DRAWS).map(signal).collect())
    }

    fn is_flagged(&self, deviation: &[f64], work: &mut Workspace) -> bool {
        self.judge.test(self.judge.detect(deviation, 1.0, work)).is_flagged()
    }

    fn power(&self, class: &str, severity: f64) -> Option<f64> {
        let mut work = Workspace::default();
        let signals = self.signals(class, severity)?;
        let flagged = signals.iter().filter(|deviation| self.is_flagged(deviation, &mut work));
        Some(flagged.count() as f64 / DRAWS as f64)
    }

    /// The smallest fault of the class `name` that is found, and the share found of its `range`.
    /// `class`: the law in whose unit severities are counted.
    fn detectable(&self, name: &str, class: &str, range: [f64; 2]) -> Option<Detectable> {
        let laws = &self.physics.laws;
        let law = laws.law(class)?;
        let none = law.scale(law.none());
        // at SIZES severities from no fault to the largest, on one scale for all of the kind
        let most = law.scale(laws.largest(law));
        let at = |place: f64| {
            let severity = law.severity_at(place);
            Some((severity, self.power(class, severity)?))
        };
        let place = |k: usize| none + (most - none) * k as f64 / SIZES as f64;
        let powers: Vec<(f64, f64)> = (1..=SIZES).map(|k| at(place(k))).collect::<Option<_>>()?;

        // From `first` on every severity is found: the limit lies between that and `place(first)`.
        let first = powers.iter().rposition(|(_, power)| *power < FOUND).map_or(0, |k| k + 1);
        let smallest = (first < powers.len()).then(|| {
            let is_found = |place: f64| at(place).is_some_and(|(_, power)| power >= FOUND);
            let (from, to) = (place(first), place(first + 1));
            let [_, high] = bisected(from, to, HALVINGS, |place| !is_found(place));
            law.severity_at(high)
        });

        let own: Vec<f64> =
            powers.iter().filter(|(s, _)| (range[0]..=range[1]).contains(s)).map(|p| p.1).collect();
        // a range between two of the severities is as its middle
        let found = match own.is_empty() {
            true => self.power(class, 0.5 * (range[0] + range[1]))?,
            false => own.iter().sum::<f64>() / own.len() as f64,
        };
        Some(Detectable { class: name.into(), range, smallest, found })
    }

    /// Share of a class's flagged signals for which each class has the largest weight, at the
    /// middles of `ISOLATED_SIZES` equal parts of `range`. Signals that are no rings count in none.
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
                if !self.is_flagged(deviation, &mut work) {
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
