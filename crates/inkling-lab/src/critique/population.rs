//! Where a model expects a signal's parameters before its channel was heard, and where they are most probable
//! once it was.
//!
//! In: a model that was fitted to other signals. Out: the [`Population`] that each channel is drawn from, and
//! [`Predictor::at_rest`] of each signal.

use super::matrices::{Matrix5, Vector5, floored, free_part, inverse, inverse_or_zero, scaled};
use super::model::{Linear, Model, free_products, one_step};
use super::observations::Observations;
use inkling_core::model::free_decay::FREE;
use inkling_core::model::inner_product::dot;

/// With fewer channels than this, held-out signals are split off by time alone.
pub const FEWEST_UNITS: usize = 6;
/// Weight, in channels, of the guess that the scatter's parts are independent: the smallest with which an
/// inverse Wishart prior has a mean.
pub const SHRINKAGE: f64 = FREE as f64 + 1.0;
/// Gauss-Newton from the population to a signal's own parameters: largest number of steps, and the squared
/// step, in its own errors, that counts as none.
const MOST_STEPS: usize = 6;
const AT_REST: f64 = 1e-3;

/// Distribution that a signal's parameters are expected to have, in units of [`Model::scale`].
#[derive(Clone, Copy)]
pub struct Population {
    /// Mean, relative to the model's.
    shift: Vector5,
    /// Covariance of a signal's parameters.
    spread: Matrix5,
}

/// The population of channels. The scatter between channels is known from as many channels as were heard: its
/// matrix is drawn towards independent scatter of amplitude, phase and the others (Ledoit and Wolf 2004,
/// weight of [`SHRINKAGE`] channels), and the mean's own error is added. `without`: computes it as if that
/// channel had not been heard.
pub fn population(model: &Model, without: Option<usize>) -> Population {
    let scale = model.scale();
    let (mut between, mut shift) = (scaled(&model.between, &scale), Vector5::zeros());
    let mut units = model.units.len() as f64;
    // take one channel out of the mean and out of the covariance
    if let Some(unit) = without.filter(|_| units >= FEWEST_UNITS as f64) {
        let off = free_part(&(model.units[unit] - model.mean), &scale);
        let own = off * off.transpose() * (units / (units - 1.0));
        between = (between * (units - 1.0) - own) / (units - 2.0);
        shift = -off / (units - 1.0);
        units -= 1.0;
    }
    // turn (a, b) to (amplitude, phase), shrink towards the diagonal there, and turn back
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

/// A signal about its most probable parameters, given the population of its channel.
pub struct AtRest {
    pub linear: Linear,
    pub gram: Matrix5,
    pub product: Vector5,
    /// The parameters relative to the population's mean, in units of [`Model::scale`].
    pub about: Vector5,
    /// Square of the residual about the model's mean, counts². The population's mean is another one where a
    /// channel was left out of it, or heard before.
    pub square: f64,
}

/// A model, with the population of each channel before these signals were heard.
pub struct Predictor<'a> {
    data: &'a Observations,
    mean: Model,
    of_unit: Vec<Population>,
    scale: Vector5,
}

impl Predictor<'_> {
    pub fn of<'a>(
        model: &Model,
        data: &'a Observations,
        of_unit: Vec<Population>,
    ) -> Predictor<'a> {
        // linearise about the mean, not about the channels' own parameters
        let mut mean = model.clone();
        mean.units = vec![model.mean; data.units];
        mean.each = vec![Default::default(); data.len()];
        Predictor { data, of_unit, scale: model.scale(), mean }
    }

    /// Covariance that signal i's parameters are expected to have.
    pub fn spread(&self, i: usize) -> Matrix5 {
        self.of_unit[self.data.rows[i].unit].spread
    }

    /// Moves signal i's parameters to their most probable values by Gauss-Newton. Channels differ by per
    /// cents, so one linear step from the population would not be enough.
    pub fn at_rest(&mut self, i: usize) -> AtRest {
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
            if step == 0 {
                square = dot(&linear.residual, &linear.residual);
            }
            let hessian = gram / v + precision;
            let by = hessian.try_inverse().map(|m| m * (product / v - precision * about));
            // go on while there are steps left and the step is not small
            let on = by.filter(|by| step < MOST_STEPS && by.dot(&(hessian * by)) >= AT_REST);
            let Some(by) = on else {
                self.mean.each[i] = Default::default();
                return AtRest { linear, gram, product, about, square };
            };
            for (j, step) in one_step(by.component_mul(&self.scale).as_slice()) {
                self.mean.each[i][j] += step;
            }
            step += 1;
        }
    }
}

impl Population {
    /// Distribution of further signals of a channel that the model was fitted to, with so many signals.
    pub fn heard(model: &Model, unit: usize, signals: f64) -> Population {
        let scale = model.scale();
        let shift = free_part(&(model.units[unit] - model.mean), &scale);
        // scatter from burst to burst, and what is still unknown of the channel's own parameters
        let within = floored(&scaled(&model.within, &scale));
        let of_within = inverse_or_zero(within) * signals;
        let of_between = inverse(&scaled(&model.between, &scale));
        let unknown = inverse_or_zero(of_within + of_between);
        Population { shift, spread: floored(&(within + unknown)) }
    }
}
