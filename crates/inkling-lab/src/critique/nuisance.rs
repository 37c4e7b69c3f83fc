//! Likelihood-ratio tests of directions in the space of linear extensions, beside a nuisance that is allowed
//! for.
//!
//! In: a [`Space`] and the causes that are in the model. Out: tests of further directions, which are linear
//! algebra on K and g.

use super::catalogue::CauseId;
use super::covariates::ONE;
use super::space::{Direction, Places, Space};
use super::tuned::ln_lambda_sd;
use inkling_core::model::free_decay::ALL;
use nalgebra::{DMatrix, DVector};

/// Directions that are allowed for before anything is tested: the parameters of the mean channel (rate and
/// amplitude of the real pole within their priors), and the causes that are in the model already, with what
/// their imperfect models leave.
#[derive(Clone, Debug)]
pub struct Nuisance<'a> {
    space: &'a Space,
    /// The mean's parameters first, then the causes, then what these leave.
    directions: Vec<Direction>,
    /// Where these directions have coefficients.
    places: Places,
    /// Pseudo-inverse of the information over the directions, and the score along them.
    inverse: DMatrix<f64>,
    score: DVector<f64>,
    /// What is added to the space's score, where causes are taken out of the model again.
    moved: Option<DVector<f64>>,
}

/// One thing for each of the two spaces in which causes are tested.
#[derive(Clone)]
pub struct Both<Of> {
    /// Of the space where channels are free; shapes are tested in it.
    pub shapes: Of,
    /// Of the space where channels are scattered; what follows a covariate is tested in it.
    pub covariates: Of,
}

impl<Of> Both<Of> {
    /// That of the space in which a cause is tested.
    pub fn of(&self, id: CauseId) -> &Of {
        if id.is_shape() { &self.shapes } else { &self.covariates }
    }
}

/// Result of the test of a direction, or of several together.
#[derive(Clone, Debug)]
pub struct Tested {
    /// g^T K^-1 g after the nuisance: chi-squared with as many degrees of freedom as directions.
    pub statistic: f64,
    /// Sizes along the directions, and their covariance.
    pub coefficients: Vec<f64>,
    pub covariance: DMatrix<f64>,
}

impl<'a> Nuisance<'a> {
    /// `causes`: all directions beside the mean's parameters.
    pub fn new(space: &'a Space, causes: &[Direction]) -> Nuisance<'a> {
        let unit = |j| Direction::parameter(space.samples, ONE, j);
        let mut directions: Vec<Direction> = (0..ALL).map(unit).collect();
        directions.extend(causes.iter().cloned());
        let places = Places::of(&directions);
        let k_times: Vec<DVector<f64>> =
            directions.iter().map(|x| space.times(x, &places)).collect();
        let q = directions.len();
        let mut gram = DMatrix::from_fn(q, q, |i, j| directions[i].dot(&k_times[j]));
        // the priors of the real pole's rate and of its amplitude, as information and score
        gram[(ALL - 1, ALL - 1)] += 1.0 / (ln_lambda_sd() * ln_lambda_sd());
        let mut score = DVector::from_fn(q, |i, _| directions[i].dot(&space.g));
        score[ALL - 1] -= space.lambda_off / (ln_lambda_sd() * ln_lambda_sd());
        let [slow, slow_sd] = space.slow;
        gram[(4, 4)] += 1.0 / (slow_sd * slow_sd);
        score[4] -= slow / (slow_sd * slow_sd);
        Nuisance { space, inverse: pseudo_inverse(&gram), directions, places, score, moved: None }
    }

    /// Changes the score as if `coefficient` times a direction, which is in the model, were not in it: by K
    /// times as much, to first order.
    pub fn move_score(&mut self, direction: &Direction, coefficient: f64) {
        let step = self.space.times(direction, &self.space.everywhere()) * coefficient;
        for (score, own) in self.score.iter_mut().zip(&self.directions) {
            *score += own.dot(&step);
        }
        match &mut self.moved {
            Some(moved) => *moved += step,
            None => self.moved = Some(step),
        }
    }

    /// Step that the data ask for of all directions beside the mean's parameters, jointly, with its
    /// covariance; the causes come first.
    pub fn causes(&self) -> (DVector<f64>, DMatrix<f64>) {
        let q = self.directions.len();
        let all = &self.inverse * &self.score;
        (
            all.rows(ALL, q - ALL).into_owned(),
            self.inverse.view((ALL, ALL), (q - ALL, q - ALL)).into_owned(),
        )
    }

    /// Step that the data ask for of the mean's parameters.
    pub fn mean_shift(&self) -> [f64; ALL] {
        let all = &self.inverse * &self.score;
        std::array::from_fn(|j| all[j])
    }

    /// What a step along the nuisance itself gains in -2 ln likelihood.
    pub fn gain(&self) -> f64 {
        self.score.dot(&(&self.inverse * &self.score))
    }

    /// Statistic of some directions together; 0 where they cannot be tested ([`Nuisance::test`]).
    pub fn statistic(&self, directions: &[Direction]) -> f64 {
        self.test(directions).map_or(0.0, |tested| tested.statistic)
    }

    /// Tests some directions together. `None`: the nuisance holds one of them already, or one follows from
    /// the others.
    pub fn test(&self, directions: &[Direction]) -> Option<Tested> {
        let q = directions.len();
        // information of the directions after the nuisance: the Schur complement
        let places = self.places.and(Places::of(directions));
        let k_times: Vec<DVector<f64>> =
            directions.iter().map(|x| self.space.times(x, &places)).collect();
        let cross =
            DMatrix::from_fn(self.directions.len(), q, |i, j| self.directions[i].dot(&k_times[j]));
        let raw = DMatrix::from_fn(q, q, |i, j| directions[i].dot(&k_times[j]));
        let gram = &raw - cross.tr_mul(&(&self.inverse * &cross));
        // a direction that the nuisance holds already says nothing
        if (0..q).any(|i| gram[(i, i)] <= 1e-7 * raw[(i, i)] || gram[(i, i)] <= 0.0) {
            return None;
        }
        // score of the directions after the nuisance
        let own =
            |x: &Direction| x.dot(&self.space.g) + self.moved.as_ref().map_or(0.0, |m| x.dot(m));
        let score = DVector::from_fn(q, |i, _| own(&directions[i]))
            - cross.tr_mul(&(&self.inverse * &self.score));
        let covariance = gram.cholesky()?.inverse();
        let coefficients = &covariance * &score;
        Some(Tested {
            statistic: score.dot(&coefficients),
            coefficients: coefficients.as_slice().to_vec(),
            covariance,
        })
    }

    /// The sum of directions, each by its coefficient, less its projection on the nuisance (in the metric of
    /// K and of the priors): what of it the nuisance cannot stand in for.
    pub fn efficient(&self, directions: &[Direction], coefficients: &[f64]) -> Direction {
        let mut blocks = Vec::new();
        let mut add = |direction: &Direction, by: f64| {
            let scaled = direction.0.iter();
            blocks.extend(scaled.map(|(at, v)| (*at, v.iter().map(|v| by * v).collect())));
        };
        directions.iter().zip(coefficients).for_each(|(direction, by)| add(direction, *by));
        let mut cross = DVector::zeros(self.directions.len());
        for (direction, by) in directions.iter().zip(coefficients) {
            let k_times = self.space.times(direction, &self.places) * *by;
            cross += DVector::from_fn(cross.len(), |i, _| self.directions[i].dot(&k_times));
        }
        let weight = &self.inverse * cross;
        self.directions.iter().zip(weight.iter()).for_each(|(own, by)| add(own, -by));
        Direction(blocks)
    }
}

/// Inverse of an information matrix. It is scaled to a unit diagonal first; eigenvectors whose eigenvalue
/// vanishes then, of which nothing is known, get 0.
fn pseudo_inverse(m: &DMatrix<f64>) -> DMatrix<f64> {
    let n = m.nrows();
    let scale = DVector::from_fn(n, |i, _| m[(i, i)].max(1e-300).sqrt());
    let unit = DMatrix::from_fn(n, n, |i, j| m[(i, j)] / (scale[i] * scale[j]));
    let eigen = unit.symmetric_eigen();
    let values = eigen.eigenvalues.map(|v| if v > 1e-10 { 1.0 / v } else { 0.0 });
    let inverse =
        &eigen.eigenvectors * DMatrix::from_diagonal(&values) * eigen.eigenvectors.transpose();
    DMatrix::from_fn(n, n, |i, j| inverse[(i, j)] / (scale[i] * scale[j]))
}
