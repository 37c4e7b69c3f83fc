//! Moves channels and single signals of a model to their most probable parameters (`Model::settle`): damped
//! Gauss-Newton descents, one per channel or signal, under the present mean, scatter, noise and additions.

use super::matrices::{Matrix5, Vector5, free_part, inverse, scaled};
use super::model::{Linear, Model, free_products};
use super::observations::Observations;
use inkling_core::model::descent::{Damping, descend};
use inkling_core::model::free_decay::{FREE, Theta};
use inkling_core::model::inner_product::dot;
use inkling_core::side_by_side::side_by_side;
use std::ops::Range;

/// Long rings whose frequency scatters by per cents need a dozen trial steps, since each is bounded.
const STEPS: usize = 20;
const DAMPING: Damping = Damping { first: 1e-4, down: 0.2, least: 1e-9, up: 20.0, most: 1e8 };

impl Model {
    /// Moves channels and single signals, in turn and twice, to their most probable parameters.
    pub fn settle(&mut self, data: &Observations) {
        for _ in 0..2 {
            self.fit_units(data, STEPS);
            self.fit_each(data);
        }
    }

    /// Given all signals of a channel together, the signals' present own deviations, and the prior N(mean,
    /// `between`).
    pub fn fit_units(&mut self, data: &Observations, steps: usize) {
        let rows: Vec<Range<usize>> = data.channels().collect();
        let scale = self.scale();
        let precision = inverse(&scaled(&self.between, &scale));
        let (own, centre): (Own, Theta) = (|model, unit| &mut model.units[unit], self.mean);
        let descent = Descent { data, own, centre, scale, precision, most: [0.5, 0.5], steps };
        let moved = |model: &mut Model, unit| model.descend(unit, rows[unit].clone(), &descent);
        self.units = self.by_halves(self.units.len(), moved);
    }

    /// Moves each signal's own deviation (`each`) to its most probable value, under the prior N(0, `within`).
    fn fit_each(&mut self, data: &Observations) {
        if data.len() == data.units {
            return; // every channel was heard once, so its parameters are those of its signal
        }
        let precision = inverse(&scaled(&self.within, &self.scale()));
        let moved = |model: &mut Model, i| model.fit_one(i, data, Theta::zeros(), precision);
        self.each = self.by_halves(data.len(), moved);
    }

    /// The most probable deviation of signal i from its channel, under the prior of this mean and inverse covariance.
    pub fn fit_one(
        &mut self,
        i: usize,
        data: &Observations,
        centre: Theta,
        precision: Matrix5,
    ) -> Theta {
        let (own, scale, most): (Own, _, _) =
            (|model, i| &mut model.each[i], self.scale(), [0.2, 0.02]);
        let descent = Descent { data, own, centre, scale, precision, most, steps: STEPS };
        self.descend(i, i..i + 1, &descent)
    }

    /// What `moved` makes of each of `count` channels or signals, in their order. Two threads do half of the
    /// work each on a copy of the model: the descent of one does not depend on where another one's ends.
    fn by_halves(
        &self,
        count: usize,
        moved: impl Fn(&mut Model, usize) -> Theta + Sync,
    ) -> Vec<Theta> {
        let half = |rows: Range<usize>| -> Vec<Theta> {
            let mut model = self.clone();
            rows.map(|i| moved(&mut model, i)).collect()
        };
        side_by_side(2, vec![0..count / 2, count / 2..count], half).concat()
    }

    /// The most probable parameters of one channel, or one signal, by a damped descent of -2 ln posterior =
    /// |residual|²/noise_var + (theta - centre)^T precision (theta - centre). `of`: index of the channel or
    /// the signal. The caller must store the result: the model is left at the point that was tried last.
    fn descend(&mut self, of: usize, rows: Range<usize>, descent: &Descent) -> Theta {
        let Descent { own, centre, scale, precision, .. } = descent;
        let off = |theta: &Theta| free_part(&(theta - centre), scale);
        let (noise_var, start) = (self.noise_var, *own(self, of));
        let mut linear = Linear::default();
        // the cost, and the sums from which the slope at the same point follows
        let cost = |theta: &Theta| {
            *own(self, of) = *theta;
            let normal = self.normal(rows.clone(), descent, &mut linear);
            let of_prior = off(theta).dot(&(precision * off(theta)));
            (normal.square / noise_var + of_prior, normal)
        };
        // half of the negative gradient of the cost, and half of its Gauss-Newton Hessian
        let slope = |theta: &Theta, normal: Normal| {
            let gradient = normal.product / noise_var - precision * off(theta);
            Some((gradient, normal.gram / noise_var + precision))
        };
        // steps are clamped, since the linearisation says nothing of places far away
        let step = |theta: &Theta, (gradient, hessian): &(Vector5, Matrix5), damping: f64| {
            let damped = hessian + Matrix5::from_diagonal(&(hessian.diagonal() * damping));
            let step = damped.cholesky()?.solve(gradient);
            let mut trial = *theta;
            for j in 0..FREE {
                let most = descent.most.get(j).copied().unwrap_or(f64::INFINITY);
                trial[j] += (step[j] * scale[j]).clamp(-most, most);
            }
            Some(trial)
        };
        let rests = |gained: f64, _| gained < 1e-6;
        descend(start, DAMPING, descent.steps, cost, slope, step, rests).0
    }

    /// Sums over some signals at the present parameters; `linear` is used as memory.
    fn normal(
        &self,
        rows: Range<usize>,
        Descent { data, scale, .. }: &Descent,
        linear: &mut Linear,
    ) -> Normal {
        let mut sum = Normal { gram: Matrix5::zeros(), product: Vector5::zeros(), square: 0.0 };
        for i in rows {
            self.linearise(i, data, linear);
            let (gram, product) = free_products(linear, scale);
            sum.gram += gram;
            sum.product += product;
            sum.square += dot(&linear.residual, &linear.residual);
        }
        sum
    }
}

/// Selects the parameters that a descent moves: those of a channel, or one signal's own deviation.
type Own = fn(&mut Model, usize) -> &mut Theta;

struct Descent<'a> {
    data: &'a Observations,
    own: Own,
    /// Mean and inverse covariance of the prior of the moved parameters; units (`Model::scale`).
    centre: Theta,
    scale: Vector5,
    precision: Matrix5,
    /// Largest changes of ln sigma and of ln omega in one step.
    most: [f64; 2],
    steps: usize,
}

/// J^T J, J^T r and r^T r over signals, with the Jacobian J in units of `scale`, not divided by the noise.
struct Normal {
    gram: Matrix5,
    product: Vector5,
    square: f64,
}
