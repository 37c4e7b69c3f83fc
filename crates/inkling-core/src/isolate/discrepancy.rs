//! How far the physics of one kind of fault lies off signals that were labelled with a size
//! (Kennedy and O'Hagan, 2001): learned with its own uncertainty, instead of assumed.
//!
//! In: per channel and labelled size the mean features (the four of a ring) of these signals, less those of
//! the fault curve; all sizes of a channel together weigh as one, as they are not independent. Out: a [`Discrepancy`], by which
//! [`super::fault_curve`] moves and widens the curve:
//!
//! ```text
//! features - curve(s) = rows(s) c + e,    c ~ N(0, I),    e ~ N(0, channels' own changes + noise)
//! ```
//!
//! c holds the errors of the rates and the pulse, and per feature the coefficients of six Legendre polynomials of the
//! size, in units of what a law may be wrong by. A Kalman update by each mean gives the mean and the covariance of c, and
//! how much likelier the law alone is, as it is believed, than the law with c. A user's own class, of which the law says
//! nothing, is learned by the same rows.

use super::fault_simulator::{CHANGES, Changes, Point, Square};
use super::posterior::sum_of;
use super::tuned;
use crate::model::faults::Law;
use crate::numbers::{FEW, GUESSED_RATE, LITTLE};
use nalgebra::{DMatrix, DVector, Matrix4, SMatrix, SymmetricEigen, Vector4};
use serde::{Deserialize, Serialize};

const TERMS: usize = 6;
const UNKNOWNS: usize = CHANGES + 4 * TERMS;
pub(super) type Rows = SMatrix<f64, 4, UNKNOWNS>;

/// The mean of the signals of one channel that are labelled with one size.
#[derive(Clone, Debug)]
pub(super) struct Shown {
    /// One over the number of sizes of its channel.
    pub share: f64,
    /// Features less those of the curve.
    pub off: Vector4<f64>,
    pub rows: Rows,
    /// Covariance of the features by errors of the rates as believed.
    pub belief: Matrix4<f64>,
    /// Covariance of the features by the channel's own changes and by noise.
    pub scatter: Matrix4<f64>,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Discrepancy {
    /// ln of how much likelier the labelled signals are if the law holds, with the rates as uncertain as
    /// [`Shown::belief`] says, than if it does not; `None`: the law says nothing.
    ln_odds: Option<f64>,
    /// If the law does not hold: mean of c, its covariance, and the covariance of what else the features of
    /// labelled signals scatter by, column by column. Empty: nothing was learned.
    mean: Vec<f64>,
    covariance: Vec<f64>,
    rest: Vec<f64>,
}

/// The same in a form to compute with.
pub(super) struct Learned {
    mean: DVector<f64>,
    covariance: DMatrix<f64>,
    rest: Matrix4<f64>,
}

impl Discrepancy {
    pub fn unknown(law: &Law) -> Discrepancy {
        let ln_odds = (!law.changes_nothing()).then_some(0.0);
        Discrepancy { ln_odds, mean: Vec::new(), covariance: Vec::new(), rest: Vec::new() }
    }

    /// Probability that the law holds, at even odds; `None`: the law says nothing.
    pub fn holds(&self) -> Option<f64> {
        Some(1.0 / (1.0 + (-self.ln_odds?).exp()))
    }

    /// The same, where the law held with the probability `before` (between 0 and 1) before any label: to be asked once.
    pub fn given(&self, before: f64) -> Discrepancy {
        let ln_odds = self.ln_odds.map(|odds| odds + (before / (1.0 - before)).ln());
        Discrepancy { ln_odds, ..self.clone() }
    }

    /// Learns c and how the rest scatters, in turns. `None`: the law says nothing, and the labels lie on no single curve,
    /// as more than a little of them looks wrong by it: .35 of three kinds of air bubble under one name, 1e-5 of classes of
    /// one kind.
    pub(super) fn learn(law: &Law, shown: &[Shown]) -> Option<Discrepancy> {
        let mut learned = Learned::unknown();
        let mut ln_odds = 0.0;
        for _ in 0..ROUNDS {
            (learned, ln_odds) = Learned { rest: learned.rest, ..Learned::unknown() }.taught(shown);
            let off = learned.off(shown);
            learned.rest += off.times(off.ratio.map(|ratio| (ratio - 1.0).max(0.0)));
        }
        // the scatter of few channels is not well known: they have the variance of Student's t
        let off = learned.off(shown);
        learned.rest += off.times(off.freedom.map(|nu| nu / (nu - 2.0).max(0.5) - 1.0));
        let says_something = !law.changes_nothing();
        if !says_something && learned.wrong_share(shown) > LITTLE {
            return None;
        }
        let Learned { mean, covariance, rest } = learned;
        let [mean, covariance] = [mean.as_slice(), covariance.as_slice()].map(<[f64]>::to_vec);
        let ln_odds = says_something.then_some(ln_odds);
        Some(Discrepancy { ln_odds, mean, covariance, rest: rest.as_slice().to_vec() })
    }

    pub(super) fn learned(&self) -> Learned {
        match self.mean.len() == UNKNOWNS && self.covariance.len() == UNKNOWNS * UNKNOWNS {
            true => Learned {
                mean: DVector::from_column_slice(&self.mean),
                covariance: DMatrix::from_column_slice(UNKNOWNS, UNKNOWNS, &self.covariance),
                rest: Matrix4::from_iterator(self.rest.iter().copied().chain([0.0; 16])),
            },
            false => Learned::unknown(),
        }
    }
}

impl Learned {
    fn unknown() -> Learned {
        Learned {
            mean: DVector::zeros(UNKNOWNS),
            covariance: DMatrix::identity(UNKNOWNS, UNKNOWNS),
            rest: Matrix4::zeros(),
        }
    }

    /// One Kalman update per channel and size, all sizes of a channel weighing as one. Also returns ln of how much
    /// likelier they are if the law holds, which knows of no other scatter than theirs.
    fn taught(mut self, shown: &[Shown]) -> (Learned, f64) {
        let mut ln_odds = 0.0;
        for one in shown {
            let (across, expected, off) = self.predict(one);
            let scatter = one.scatter + self.rest;
            let if_it_holds = label(&one.off, &(one.belief + one.scatter)).ln_density;
            let label = label(&off, &(expected + scatter));
            ln_odds += one.share * (if_it_holds - label.ln_density);

            // a label that is surely wrong teaches nothing; a weight of 0 would divide the scatter by 0
            let weight = one.share * label.is_right.max(1e-9);
            let Some(inverse) = (expected + scatter / weight).try_inverse() else { continue };
            let gain = &across * DMatrix::from_column_slice(4, 4, inverse.as_slice());
            self.mean += &gain * DVector::from_column_slice(off.as_slice());
            self.covariance -= &gain * across.transpose();
        }
        (self, ln_odds)
    }

    /// Of a channel at a size: the covariance of c with its features, the covariance that c gives these, and how far they
    /// lie off what c says of them.
    fn predict(&self, one: &Shown) -> (DMatrix<f64>, Matrix4<f64>, Vector4<f64>) {
        let rows = DMatrix::from_column_slice(4, UNKNOWNS, one.rows.as_slice());
        let across = &self.covariance * rows.transpose();
        let (expected, seen) = (&rows * &across, &rows * &self.mean);
        let off = one.off - Vector4::from_column_slice(seen.as_slice());
        (across, Matrix4::from_column_slice(expected.as_slice()), off)
    }

    /// The share of the channels whose labels are wrong.
    fn wrong_share(&self, shown: &[Shown]) -> f64 {
        let is_wrong = |one: &Shown| {
            let (_, known, off) = self.predict(one);
            one.share * (1.0 - label(&off, &(known + one.scatter + self.rest)).is_right)
        };
        shown.iter().map(is_wrong).sum::<f64>() / channels_of(shown)
    }

    /// How far the channels lie off what was learned of them.
    fn off(&self, shown: &[Shown]) -> Off {
        let each = shown.iter().map(|one| (one.scatter + self.rest) * one.share);
        let scatter = each.sum::<Matrix4<f64>>() / channels_of(shown);
        let axes = SymmetricEigen::new(scatter).eigenvectors;
        let along = |of: &Matrix4<f64>| (axes.transpose() * of * axes).diagonal();
        // as if a few channels had been met that scatter as expected
        let [mut found, mut freedom] = [Vector4::repeat(FEW as f64); 2];
        for one in shown {
            let (_, known, off) = self.predict(one);
            let is_right = label(&off, &(known + one.scatter + self.rest)).is_right;
            let weight = one.share * is_right;
            let scatter = along(&(one.scatter + self.rest));
            found += along(&(off * off.transpose())).component_div(&scatter) * weight;
            // what c has taken over of a channel's deviation is not free any more
            let learned = along(&known).component_div(&scatter).map(|v| v.min(1.0));
            freedom += (Vector4::repeat(1.0) - learned) * weight;
        }
        Off { scatter: along(&scatter), ratio: found.component_div(&freedom), axes, freedom }
    }

    /// Mean and covariance of what is to be added to the features of the curve at a point.
    pub fn at(&self, law: &Law, largest: f64, point: &Point) -> (Vector4<f64>, Matrix4<f64>) {
        let rows = rows(law, largest, point);
        let rows = DMatrix::from_column_slice(4, UNKNOWNS, rows.as_slice());
        let (mean, covariance) = (&rows * &self.mean, &rows * &self.covariance * rows.transpose());
        (
            Vector4::from_column_slice(mean.as_slice()),
            Matrix4::from_column_slice(covariance.as_slice()) + self.rest,
        )
    }
}

/// How many channels they are of, 1 at least.
fn channels_of(shown: &[Shown]) -> f64 {
    shown.iter().map(|one| one.share).sum::<f64>().max(1.0)
}

/// How far channels lie off what was learned of them, in the principal directions (`axes`) of their `scatter`.
struct Off {
    axes: Matrix4<f64>,
    scatter: Vector4<f64>,
    /// Mean of the squares of these distances over what is expected of it.
    ratio: Vector4<f64>,
    /// The number of channels that tell it, less what was learned of them.
    freedom: Vector4<f64>,
}

impl Off {
    fn times(&self, factor: Vector4<f64>) -> Matrix4<f64> {
        let along = Matrix4::from_diagonal(&factor.component_mul(&self.scatter));
        self.axes * along * self.axes.transpose()
    }
}

/// How the features move with each element of c, at a point of the curve, which ends at the severity `largest`.
pub(super) fn rows(law: &Law, largest: f64, point: &Point) -> Rows {
    let [none, most] = [law.none(), largest].map(|severity| law.scale(severity));
    let t = 2.0 * (point.place - none) / (most - none) - 1.0;
    let terms = legendre(t);
    let guessed =
        Changes::from([GUESSED_RATE, GUESSED_RATE, GUESSED_RATE, GUESSED_RATE, tuned::PULSE_SD]);
    let mut rows = Rows::zeros();
    let of_rates = point.belief_slope * Square::from_diagonal(&guessed);
    rows.fixed_columns_mut::<CHANGES>(0).copy_from(&of_rates);
    for j in 0..4 {
        let of_law = match law.changes_nothing() {
            true => tuned::OF_OWN[j],
            false => tuned::OF_LAW[j].max((tuned::SHARE_OF_LAW * point.mean[j]).abs()),
        };
        // the mean variance along the curve is that of the law; at its ends, where all terms are 1 or -1, each adds the same
        let squares: f64 = (0..TERMS).map(|k| 1.0 / (2 * k + 1) as f64).sum();
        for (k, term) in terms.iter().enumerate() {
            rows[(j, CHANGES + j * TERMS + k)] = of_law * term / squares.sqrt();
        }
    }
    rows
}

/// Polynomials P_0 to P_{TERMS-1}, by (k + 1) P_{k+1} = (2 k + 1) t P_k - k P_{k-1}.
fn legendre(t: f64) -> [f64; TERMS] {
    let mut terms = [1.0; TERMS];
    terms[1] = t;
    for k in 1..TERMS - 1 {
        let n = k as f64;
        terms[k + 1] = ((2.0 * n + 1.0) * t * terms[k] - n * terms[k - 1]) / (n + 1.0);
    }
    terms
}

/// How often c and the scatter of the rest are learned in turn.
const ROUNDS: usize = 4;

struct Label {
    is_right: f64,
    ln_density: f64,
}

/// Probability that a label is right, and density of its features, where a few labels are wrong: features of a wrong one
/// may be anywhere. `off`: the features less their expectation; `scatter`: their covariance.
fn label(off: &Vector4<f64>, scatter: &Matrix4<f64>) -> Label {
    let anywhere =
        scatter + Matrix4::from_diagonal(&Vector4::from(tuned::OF_OWN).map(|sd| sd * sd));
    let right = (1.0 - tuned::WRONG_LABELS).ln() + ln_gaussian(off, scatter);
    let wrong = tuned::WRONG_LABELS.ln() + ln_gaussian(off, &anywhere);
    let ln_density = sum_of(right, wrong);
    Label { is_right: (right - ln_density).exp(), ln_density }
}

/// Up to a constant.
fn ln_gaussian(x: &Vector4<f64>, covariance: &Matrix4<f64>) -> f64 {
    let Some(cholesky) = covariance.cholesky() else { return f64::NEG_INFINITY };
    -0.5 * (cholesky.determinant().ln() + x.dot(&cholesky.solve(x)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::isolate::fault_simulator::Slope;
    use crate::model::faults::Catalogue;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    const SD: f64 = 0.02;

    fn own_class() -> Law {
        let mut laws = Catalogue::default();
        laws.add_sizes("own", [0.2, 1.0]);
        laws.law("own").unwrap().clone()
    }

    fn point(law: &Law, size: f64) -> Point {
        Point {
            place: law.scale(size),
            mean: Vector4::zeros(),
            slope: Slope::zeros(),
            belief_slope: Slope::zeros(),
            noise: Matrix4::zeros(),
        }
    }

    /// One labelled channel, whose features scatter by twice what the physics expects.
    fn shown(law: &Law, size: f64, features: Vector4<f64>, rng: &mut ChaCha8Rng) -> Shown {
        let scatter: Vector4<f64> = Vector4::from_fn(|_, _| StandardNormal.sample(rng));
        Shown {
            share: 1.0,
            off: features + 2.0 * SD * scatter,
            rows: rows(law, 1.0, &point(law, size)),
            belief: Matrix4::zeros(),
            scatter: Matrix4::from_diagonal_element(SD * SD),
        }
    }

    /// No polynomial.
    fn curve(size: f64) -> Vector4<f64> {
        Vector4::new((-3.0 * size).exp() - 1.0, 0.5 * (2.0 * size).sin(), 0.1 * size.sqrt(), size)
    }

    /// One label of twenty is that of another fault. Further channels lie as far off what was learned as it says, by
    /// the mean of chi-squared of four degrees of freedom.
    #[test]
    fn a_curve_and_the_scatter_about_it_are_learned_beside_wrong_labels() {
        let (law, mut rng) = (own_class(), ChaCha8Rng::seed_from_u64(41));
        let mut channel = |i: usize| {
            let size: f64 = rng.random_range(0.2..1.0);
            let is_wrong = i % 20 == 3;
            let wrong = Vector4::from_fn(|_, _| rng.random_range(-1.0..1.0));
            let features = if is_wrong { wrong } else { curve(size) };
            shown(&law, size, features, &mut rng)
        };
        let labelled: Vec<Shown> = (0..60).map(&mut channel).collect();
        let learned = Discrepancy::learn(&law, &labelled).unwrap().learned();
        let further: Vec<Shown> = (0..400).map(|_| channel(0)).collect();
        let square = |of: &Shown| {
            let (_, known, off) = learned.predict(of);
            let covariance = known + of.scatter + learned.rest;
            off.dot(&(covariance.try_inverse().unwrap() * off)) / 4.0
        };
        let mean = further.iter().map(square).sum::<f64>() / further.len() as f64;
        assert!((0.6..1.3).contains(&mean), "{mean}");
    }

    #[test]
    fn labels_of_two_kinds_under_one_name_are_on_no_curve() {
        let (law, mut rng) = (own_class(), ChaCha8Rng::seed_from_u64(42));
        let mut channel = |i: usize| {
            let size: f64 = rng.random_range(0.2..1.0);
            let features = if i.is_multiple_of(3) { -curve(size) } else { curve(size) };
            shown(&law, size, features, &mut rng)
        };
        let labelled: Vec<Shown> = (0..60).map(&mut channel).collect();
        assert!(Discrepancy::learn(&law, &labelled).is_none());
    }
}
