//! Judges signals that a model was not fitted to. In: a model that was fitted to other signals. Out: the
//! [`Population`], a Gaussian that a signal's parameters are drawn from beforehand, and
//! [`Predictor::most_probable`], the signal linearised at its most probable parameters once it was measured.
//!
//! For a channel that was never heard, the population is N(mean, between + within), with `between` shrunk
//! because it is known from few channels (`population`); for one that was heard it is N(the channel's own
//! parameters, within + what is unknown of these) ([`Population::of_channel`]). All vectors and matrices are over
//! the five free parameters in units of `Model::scale`.

use super::matrices::{Matrix5, Vector5, floored, free_part, inverse, inverse_or_zero, scaled};
use super::model::{Linear, Model, free_products, one_step};
use super::observations::Observations;
use inkling_core::model::free_decay::FREE;
use inkling_core::model::inner_product::dot;

/// With fewer channels, held-out signals are split off by time alone.
pub const FEWEST_UNITS: usize = 6;
/// Weight, in channels, of the guess that the parameters scatter independently: the smallest with which an
/// inverse Wishart prior has a mean.
pub const SHRINKAGE: f64 = FREE as f64 + 1.0;
/// Largest number of Gauss-Newton steps to a signal's own parameters, and the squared length, in standard
/// errors, below which none is taken.
const MOST_STEPS: usize = 6;
const LEAST_STEP: f64 = 1e-3;

#[derive(Clone, Copy)]
pub struct Population {
    shift: Vector5,
    spread: Matrix5,
}

/// The population of signals of channels that were never heard. `between` is shrunk towards independent
/// scatter of amplitude, phase and the other parameters (after Ledoit and Wolf 2004, with a weight of
/// [`SHRINKAGE`] channels), and multiplied by 1 + 1/channels for the error of the mean, unless there are
/// fewer than five channels. `without`: a channel that is taken out first, as if it had not been heard;
/// ignored with fewer than [`FEWEST_UNITS`] channels.
pub fn population(model: &Model, without: Option<usize>) -> Population {
    let scale = model.scale();
    let (mut between, mut shift) = (scaled(&model.between, &scale), Vector5::zeros());
    let mut units = model.units.len() as f64;
    // the usual updates of a sample mean and a sample covariance (over n - 1) of n channels
    if let Some(unit) = without.filter(|_| units >= FEWEST_UNITS as f64) {
        let off = free_part(&(model.units[unit] - model.mean), &scale);
        let own = off * off.transpose() * (units / (units - 1.0));
        between = (between * (units - 1.0) - own) / (units - 2.0);
        shift = -off / (units - 1.0);
        units -= 1.0;
    }
    // turn (a, b) to (amplitude, phase) and shrink towards the diagonal there
    if units >= (FEWEST_UNITS - 1) as f64 {
        let mut turn = Matrix5::identity();
        let (a, b) = (model.mean[2], model.mean[3]);
        let size = a.hypot(b).max(f64::MIN_POSITIVE);
        (turn[(2, 2)], turn[(2, 3)]) = (a / size, b / size);
        (turn[(3, 2)], turn[(3, 3)]) = (-b / size, a / size);
        let own = turn * between * turn.transpose();
        let weight = SHRINKAGE / (units - 1.0 + SHRINKAGE);
        let alone = Matrix5::from_diagonal(&own.diagonal().map(|v| v.max(0.0)));
        let drawn = own * (1.0 - weight) + alone * weight;
        between = turn.transpose() * drawn * turn * (1.0 + 1.0 / units);
    }
    Population { shift, spread: floored(&(between + scaled(&model.within, &scale))) }
}

pub struct MostProbable {
    pub linear: Linear,
    /// J^T J and J^T r there, not divided by the noise.
    pub gram: Matrix5,
    pub product: Vector5,
    /// The most probable parameters relative to the population's mean, and that population's covariance.
    pub about: Vector5,
    pub spread: Matrix5,
    /// Sum of squares of the residual about the model's mean, counts².
    pub square: f64,
}

pub struct Predictor<'a> {
    data: &'a Observations,
    /// The model with all channels at its mean; `each` holds the signal that is being fitted.
    mean: Model,
    /// The population of each channel of `data`.
    of_unit: Vec<Population>,
    scale: Vector5,
}

impl Predictor<'_> {
    pub fn of<'a>(
        model: &Model,
        data: &'a Observations,
        of_unit: Vec<Population>,
    ) -> Predictor<'a> {
        let mut mean = model.clone();
        mean.units = vec![model.mean; data.units];
        mean.each = vec![Default::default(); data.len()];
        Predictor { data, of_unit, scale: model.scale(), mean }
    }

    /// Linearises signal i at its most probable parameters, by Gauss-Newton from the model's mean on. They
    /// minimise |r|²/v + about^T spread^-1 about, with the noise variance v. Channels differ by per cents, so
    /// that one linear step would not be enough.
    pub fn most_probable(&mut self, i: usize) -> MostProbable {
        let Population { shift, spread } = self.of_unit[self.data.rows[i].unit];
        let precision = inverse_or_zero(spread);
        let v = self.mean.noise_var;
        let (mut linear, mut square) = (Linear::default(), f64::NAN);
        let mut step = 0;
        loop {
            self.mean.linearise(i, self.data, &mut linear);
            let (gram, product) = free_products(&linear, &self.scale);
            let own = free_part(&self.mean.each[i], &self.scale);
            let about = own - shift;
            // the first residual is about the model's mean
            if step == 0 {
                square = dot(&linear.residual, &linear.residual);
            }
            let hessian = gram / v + precision;
            let by = hessian.try_inverse().map(|m| m * (product / v - precision * about));
            // At the end, put the signal back to the mean, so that the model is as it was.
            let on = by.filter(|by| step < MOST_STEPS && by.dot(&(hessian * by)) >= LEAST_STEP);
            let Some(by) = on else {
                self.mean.each[i] = Default::default();
                return MostProbable { linear, gram, product, about, spread, square };
            };
            for (j, step) in one_step(by.component_mul(&self.scale).as_slice()) {
                self.mean.each[i][j] += step;
            }
            step += 1;
        }
    }
}

impl Population {
    /// The population of further signals of a channel that the model was fitted to with so many `signals`.
    pub fn of_channel(model: &Model, unit: usize, signals: f64) -> Population {
        let scale = model.scale();
        let shift = free_part(&(model.units[unit] - model.mean), &scale);
        // the posterior covariance of the channel's own parameters neglects the noise of the fitted signals
        let within = floored(&scaled(&model.within, &scale));
        let of_within = inverse_or_zero(within) * signals;
        let of_between = inverse(&scaled(&model.between, &scale));
        let unknown = inverse_or_zero(of_within + of_between);
        Population { shift, spread: floored(&(within + unknown)) }
    }
}
