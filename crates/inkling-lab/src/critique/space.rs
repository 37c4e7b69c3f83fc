//! Information matrix and score vector of every linear extension of the model at once, so that the signals
//! are read once for all candidates.
//!
//! In: a fitted model and its signals. Out: two [`Space`]s. A space holds K = sum X^T V^-1 X and g = sum X^T
//! V^-1 r over all signals: r is the residual, V its covariance (noise and scatter), and the columns of X are
//! all extensions, in this order:
//!
//! * `PATTERNS` x N columns: a unit impulse at each sample, times the drive to the power 0, 1, 2 or 3;
//! * `COVARIATES` x `MOVED` columns: each covariate times the derivative by each parameter, and times the tail
//!   of the previous ring.
//!
//! A candidate is a [`Direction`], a vector x over these columns. Its likelihood-ratio statistic without
//! nuisance is (x·g)² / (x·K x). Shapes are tested in the first space, where channels are as good as free;
//! what follows a covariate in the second, with scattered channels, where K and g are 0 for all shapes.

use super::contributions::{MOVED, Part};
use super::covariates::ONE;
use super::model::{Additions, Model, PATTERNS};
use super::observations::Observations;
use super::tuned::LN_LAMBDA_SD;
use inkling_core::model::free_decay::ALL;
use inkling_core::side_by_side::side_by_side;
use nalgebra::{DMatrix, DVector, DVectorView};
use std::collections::BTreeMap;
use std::ops::Range;

/// ln L(x) = -deviance/2 + x·g - x·K x/2 about a model, with the size x of each extension.
#[derive(Clone, Debug)]
pub struct Space {
    pub samples: usize,
    /// ln lambda/sigma of the model less the mean of its prior.
    pub lambda_off: f64,
    /// Amplitude of the real pole in the model, and the standard deviation of its prior; counts.
    pub slow: [f64; 2],
    /// Information matrix K, without the priors of the real pole, which `nuisance.rs` adds.
    pub k: DMatrix<f64>,
    /// Score g, without those priors.
    pub g: DVector<f64>,
    /// -2 ln likelihood of the model, up to a constant, with those priors.
    pub deviance: f64,
}

/// A sparse vector of the space: blocks of coefficients, each with the index at which it begins.
#[derive(Clone, Debug)]
pub struct Direction(pub Vec<(usize, Vec<f64>)>);

impl Direction {
    /// Adds a shape (N samples, counts at the mean drive) that scales as the drive to the power `pattern`.
    pub fn shape(pattern: usize, shape: Vec<f64>) -> Direction {
        Direction(vec![(pattern * shape.len(), shape)])
    }

    /// Moves the parameters by `v` per unit of the standardised covariate with index `which`.
    pub fn covariate(samples: usize, which: usize, v: [f64; ALL]) -> Direction {
        Direction(vec![(PATTERNS * samples + which * MOVED, v.to_vec())])
    }

    /// Moves parameter j alone, by 1 per unit of the covariate.
    pub fn parameter(samples: usize, which: usize, j: usize) -> Direction {
        let mut v = [0.0; ALL];
        v[j] = 1.0;
        Direction::covariate(samples, which, v)
    }

    /// Adds the previous ring as it goes on in the signal, the same share of it in all.
    pub fn tail(samples: usize) -> Direction {
        Direction(vec![(PATTERNS * samples + ONE * MOVED + ALL, vec![1.0])])
    }

    /// Adds `by` times this direction; a coefficient's index tells what it belongs to.
    pub fn add_to(&self, added: &mut Additions, by: f64) {
        let n = added.shapes[0].len();
        for (at, v) in self.0.iter().flat_map(|(at, v)| (*at..).zip(v)) {
            match at.checked_sub(PATTERNS * n) {
                None => added.shapes[at / n][at % n] += by * v,
                Some(at) if at % MOVED < ALL => added.beta[at / MOVED][at % MOVED] += by * v,
                Some(_) => added.tail_gain += by * v,
            }
        }
    }

    pub fn dot(&self, x: &DVector<f64>) -> f64 {
        let of_block =
            |(at, v): &(usize, Vec<f64>)| -> f64 { (*at..).zip(v).map(|(at, v)| v * x[at]).sum() };
        self.0.iter().map(of_block).sum()
    }
}

/// Where directions have coefficients: the length of each block, by the index at which it begins. Blocks of
/// two directions are the same or do not overlap.
pub type Places = BTreeMap<usize, usize>;

pub fn places<'a>(directions: impl IntoIterator<Item = &'a Direction>) -> Places {
    let blocks = directions.into_iter().flat_map(|direction| &direction.0);
    blocks.map(|(at, v)| (*at, v.len())).collect()
}

impl Space {
    /// The two spaces about a model: of free channels, and of scattered channels. Two threads sum half of the
    /// channels each; the split does not depend on the number of processors, so the sums do not either.
    pub fn of(model: &Model, data: &Observations) -> [Space; 2] {
        // a channel must not be split
        let starts = data.channels().map(|channel| channel.start);
        let middle = starts.take_while(|start| *start <= data.len() / 2).last().unwrap_or(0);
        let part = |rows: Range<usize>| Part::of(model, data, rows);
        let parts = side_by_side(2, vec![0..middle, middle..data.len()], part);
        let sum = |[free, scattered]: [Part; 2], [other_free, other]: [Part; 2]| {
            [free.with(other_free), scattered.with(other)]
        };
        let both = parts.into_iter().reduce(sum).unwrap_or_else(|| part(0..data.len()));
        both.map(|part| Space::about(model, data.samples, part))
    }

    fn about(model: &Model, n: usize, part: Part) -> Space {
        let Part { mut k, g, mut deviance, diagonal } = part;
        // White noise links a sample of a shape to the same sample of other powers of the drive only.
        for (a, of_sample) in diagonal.column_iter().enumerate() {
            for (pair, sum) in of_sample.iter().enumerate() {
                let (p, q) = (pair / PATTERNS, pair % PATTERNS);
                k[(p * n + a, q * n + a)] += sum;
            }
        }
        k.fill_upper_triangle_with_lower_triangle();
        let off = model.lambda_off();
        deviance += (off / LN_LAMBDA_SD).powi(2);
        let slow = [model.mean[4], model.slow_sd()];
        deviance += (slow[0] / slow[1]).powi(2);
        Space { samples: n, lambda_off: off, slow, k, g, deviance }
    }

    /// K x of a direction x at the places `at` alone, which saves most of the work; 0 elsewhere.
    pub fn times(&self, x: &Direction, at: &Places) -> DVector<f64> {
        let mut out = DVector::zeros(self.k.nrows());
        for (column, v) in &x.0 {
            let v = DVectorView::from_slice(v, v.len());
            for (&row, &length) in at {
                let block = self.k.view((row, *column), (length, v.len()));
                let mut rows = out.rows_mut(row, length);
                rows += block * v;
            }
        }
        out
    }

    pub fn everywhere(&self) -> Places {
        BTreeMap::from([(0, self.k.nrows())])
    }
}
