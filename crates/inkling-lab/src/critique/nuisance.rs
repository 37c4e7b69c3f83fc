//! Likelihood-ratio tests of directions in the space of linear extensions, while other directions, the
//! nuisance, are allowed to have any size.
//!
//! In: a [`Space`] (K and g) and the causes in the model. Out: [`Nuisance`], which tests further directions.
//!
//! With nuisance directions U and tested directions T, the information of T after the nuisance is the Schur
//! complement S = T^T K T - T^T K U (U^T K U)^-1 U^T K T, and its score h = T^T g - T^T K U (U^T K U)^-1 U^T
//! g. The best sizes are S^-1 h, and the statistic h^T S^-1 h is twice the gain in ln likelihood.

use super::catalogue::CauseId;
use super::covariates::ONE;
use super::space::{Direction, Places, Space, places};
use super::tuned::LN_LAMBDA_SD;
use inkling_core::model::free_decay::ALL;
use nalgebra::{DMatrix, DVector};

/// Directions that may have any size while something else is tested.
#[derive(Clone, Debug)]
pub struct Nuisance<'a> {
    space: &'a Space,
    /// The directions U: the `ALL` parameters of the mean channel, then the causes.
    directions: Vec<Direction>,
    places: Places,
    /// Pseudo-inverse of U^T K U, with the priors of the real pole.
    inverse: DMatrix<f64>,
    /// U^T g, with these priors.
    score: DVector<f64>,
    /// The space's score g, and what was added to it because causes were taken out of the model (`move_score`).
    g: DVector<f64>,
}

/// One value (a space, a nuisance) for each of the two spaces in which causes are tested.
#[derive(Clone)]
pub struct Both<Of> {
    /// That of the space where channels are free; shapes are tested in it.
    pub shapes: Of,
    /// That of the space where channels are scattered; what follows a covariate is tested in it.
    pub covariates: Of,
}

impl<Of> Both<Of> {
    /// That of the space in which a cause is tested.
    pub fn of(&self, id: CauseId) -> &Of {
        if id.is_shape() { &self.shapes } else { &self.covariates }
    }
}

#[derive(Clone, Debug)]
pub struct Tested {
    /// h^T S^-1 h (module's doc): without effect chi-squared with as many degrees of freedom as directions.
    pub statistic: f64,
    /// Best size along each direction, and the covariance of these sizes, S^-1.
    pub coefficients: Vec<f64>,
    pub covariance: DMatrix<f64>,
}

impl<'a> Nuisance<'a> {
    /// `causes`: all directions beside the mean channel's parameters, which always belong to the nuisance.
    pub fn new(space: &'a Space, causes: &[Direction]) -> Nuisance<'a> {
        // a mean parameter is that parameter by the covariate "one"
        let unit = |j| Direction::parameter(space.samples, ONE, j);
        let mut directions: Vec<Direction> = (0..ALL).map(unit).collect();
        directions.extend(causes.iter().cloned());
        let places = places(&directions);
        let k_times: Vec<DVector<f64>> =
            directions.iter().map(|x| space.times(x, &places)).collect();
        let q = directions.len();
        let mut gram = DMatrix::from_fn(q, q, |i, j| directions[i].dot(&k_times[j]));
        // The Gaussian priors of the real pole's rate (the last parameter) and of its amplitude (number 4)
        // add 1/sd² to the information, and -(value - prior mean)/sd² to the score.
        gram[(ALL - 1, ALL - 1)] += 1.0 / (LN_LAMBDA_SD * LN_LAMBDA_SD);
        let mut score = DVector::from_fn(q, |i, _| directions[i].dot(&space.g));
        score[ALL - 1] -= space.lambda_off / (LN_LAMBDA_SD * LN_LAMBDA_SD);
        let [slow, slow_sd] = space.slow;
        gram[(4, 4)] += 1.0 / (slow_sd * slow_sd);
        score[4] -= slow / (slow_sd * slow_sd);
        let (inverse, g) = (pseudo_inverse(&gram), space.g.clone());
        Nuisance { space, inverse, directions, places, score, g }
    }

    /// Changes the score as if `coefficient` times a direction, which is in the model, were not in it: to
    /// first order, the residual grows by X times the direction times the coefficient, and g by K times that.
    pub fn move_score(&mut self, direction: &Direction, coefficient: f64) {
        let step = self.space.times(direction, &self.space.everywhere()) * coefficient;
        for (score, own) in self.score.iter_mut().zip(&self.directions) {
            *score += own.dot(&step);
        }
        self.g += step;
    }

    /// Joint step that the data ask for of all directions: of the mean's `ALL` parameters first.
    pub fn step(&self) -> DVector<f64> {
        &self.inverse * &self.score
    }

    /// By how much that step lowers -2 ln likelihood.
    pub fn gain(&self) -> f64 {
        self.score.dot(&self.step())
    }

    /// Statistic of some directions together; 0 where they cannot be tested ([`Nuisance::test`]).
    pub fn statistic(&self, directions: &[Direction]) -> f64 {
        self.test(directions).map_or(0.0, |tested| tested.statistic)
    }

    /// `None`: the nuisance holds one of them already, or one of them is a combination of the others.
    pub fn test(&self, directions: &[Direction]) -> Option<Tested> {
        let q = directions.len();
        // S, the information of the directions after the nuisance
        let places = places(self.directions.iter().chain(directions));
        let k_times: Vec<DVector<f64>> =
            directions.iter().map(|x| self.space.times(x, &places)).collect();
        let cross =
            DMatrix::from_fn(self.directions.len(), q, |i, j| self.directions[i].dot(&k_times[j]));
        let raw = DMatrix::from_fn(q, q, |i, j| directions[i].dot(&k_times[j]));
        let gram = &raw - cross.tr_mul(&(&self.inverse * &cross));

        if (0..q).any(|i| gram[(i, i)] <= 1e-7 * raw[(i, i)] || gram[(i, i)] <= 0.0) {
            return None;
        }

        // h, the score of the directions after the nuisance
        let own = DVector::from_fn(q, |i, _| directions[i].dot(&self.g));
        let score = own - cross.tr_mul(&self.step());
        let covariance = gram.cholesky()?.inverse();
        let coefficients = &covariance * &score;
        Some(Tested {
            statistic: score.dot(&coefficients),
            coefficients: coefficients.as_slice().to_vec(),
            covariance,
        })
    }

    /// What the nuisance cannot stand in for: the sum x of the directions, each times its coefficient, less
    /// its projection U (U^T K U)^-1 U^T K x. The score along this part is the efficient score of x.
    pub fn efficient(&self, directions: &[Direction], coefficients: &[f64]) -> Direction {
        // a block of the result may begin at the same index as another one: blocks add up
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

/// Pseudo-inverse of a symmetric information matrix, scaled to a unit diagonal first. It is 0 along
/// combinations of which the data say nothing, so that no step is taken there.
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
