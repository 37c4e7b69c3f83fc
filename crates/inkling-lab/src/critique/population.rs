//! Where a model expects a signal before its channel was heard, and where the signal's parameters are most probable.
//!
//! In: a model that was fitted to other signals. Out: [`Population`] of each channel, [`Predictor::at_rest`] of each
//! signal.

use super::matrices::{Matrix5, Vector5, floored, inverse, scaled};
use super::model::{Linear, Model, dot, free_products};
use super::observations::Observations;
use inkling_core::model::free_decay::FREE;

/// Fewer channels than this are split by time alone.
pub const FEWEST_UNITS: usize = 6;
/// So many channels' weight has the guess that the scatter's parts are independent: the fewest that an inverse Wishart
/// prior with a mean needs.
pub const SHRINKAGE: f64 = FREE as f64 + 1.0;
/// Gauss-Newton from the population to a signal's own parameters: steps at most, and the squared step, in its
/// own errors, that is none.
const MOST_STEPS: usize = 6;
const AT_REST: f64 = 1e-3;

/// Where a signal's parameters are expected, in units of [`Model::scale`].
#[derive(Clone, Copy)]
pub struct Population {
    /// From the model's mean.
    shift: Vector5,
    spread: Matrix5,
}

/// The scatter between channels is known from as many channels as were heard. Its matrix is drawn towards
/// scatter of amplitude, phase and the rest alone (Ledoit and Wolf 2004, weight of [`SHRINKAGE`] channels),
/// and the mean's own error is added. `without`: as if that channel had not been heard.
pub fn population(model: &Model, without: Option<usize>) -> Population {
    let scale = model.scale();
    let (mut between, mut shift) = (scaled(&model.between, &scale), Vector5::zeros());
    let mut units = model.units.len() as f64;
    if let Some(unit) = without.filter(|_| units >= FEWEST_UNITS as f64) {
        let off = (model.units[unit] - model.mean).fixed_rows::<FREE>(0).component_div(&scale);
        let own = off * off.transpose() * (units / (units - 1.0));
        between = (between * (units - 1.0) - own) / (units - 2.0);
        shift = -off / (units - 1.0);
        units -= 1.0;
    }
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

/// A signal's own parameters at their most probable values, beside where its channel may lie.
pub struct AtRest {
    pub linear: Linear,
    pub gram: Matrix5,
    pub product: Vector5,
    /// From the population's mean, in units of [`Model::scale`].
    pub about: Vector5,
    /// Square of the misfit about the population's mean.
    pub square: f64,
}

/// A model, and where it expects each channel's parameters before these signals were heard.
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
        // about the mean, not about the channels' own parameters
        let mut mean = model.clone();
        mean.units = vec![model.mean; data.units];
        mean.each = vec![Default::default(); data.len()];
        Predictor { data, of_unit, scale: model.scale(), mean }
    }

    pub fn spread(&self, i: usize) -> Matrix5 {
        self.of_unit[self.data.rows[i].unit].spread
    }

    /// Channels differ by per cents: linear about the population is not enough.
    pub fn at_rest(&mut self, i: usize) -> AtRest {
        let Population { shift, spread } = self.of_unit[self.data.rows[i].unit];
        let precision = spread.try_inverse().unwrap_or_else(Matrix5::zeros);
        let v = self.mean.noise_var;
        let (mut linear, mut square) = (Linear::default(), f64::NAN);
        let mut step = 0;
        loop {
            self.mean.linearise(i, self.data, &mut linear);
            let (gram, product) = free_products(&linear, &self.scale);
            let own = self.mean.each[i].fixed_rows::<FREE>(0).component_div(&self.scale);
            let about = own - shift;
            if step == 0 {
                square = dot(&linear.residual, &linear.residual);
            }
            let hessian = gram / v + precision;
            let by = hessian.try_inverse().map(|m| m * (product / v - precision * about));
            let on = by.filter(|by| step < MOST_STEPS && by.dot(&(hessian * by)) >= AT_REST);
            let Some(by) = on else {
                self.mean.each[i] = Default::default();
                return AtRest { linear, gram, product, about, square };
            };
            for j in 0..FREE {
                let most = [0.3, 0.05].get(j).copied().unwrap_or(f64::INFINITY);
                self.mean.each[i][j] += (by[j] * self.scale[j]).clamp(-most, most);
            }
            step += 1;
        }
    }
}

impl Population {
    /// Of channels that a model was not fitted to.
    pub fn unheard(model: &Model) -> Population {
        population(model, None)
    }

    /// Of a channel that it was fitted to, by so many signals.
    pub fn heard(model: &Model, unit: usize, signals: f64) -> Population {
        let scale = model.scale();
        let shift = (model.units[unit] - model.mean).fixed_rows::<FREE>(0).component_div(&scale);
        let within = floored(&scaled(&model.within, &scale));
        let of_within = within.try_inverse().unwrap_or_else(Matrix5::zeros) * signals;
        let of_between = inverse(&scaled(&model.between, &scale));
        let unknown = (of_within + of_between).try_inverse().unwrap_or_else(Matrix5::zeros);
        Population { shift, spread: floored(&(within + unknown)) }
    }
}
