//! The mixed-effects model of all signals, thesis (2-2) seen from outside, and its fit.
//!
//! y_i = s_i y(theta_i) + shapes + tail + noise; theta_i = mean + channel + burst + covariates. A
//! healthy channel's own parameters are constant over its bursts, so the scatter is split: `between`
//! channels and `within` a channel from burst to burst. Both are estimated (EM), and so is the noise.
//! The model is linearised about each channel's own parameters (first order, conditional), so that
//! channels whose frequency scatters by per cents are each judged by their own decay.

use super::covariates::COVARIATES;
use super::matrices::{Matrix5, Vector5, free_part, inverse, scaled};
use super::observations::Observations;
use inkling_core::model::descent::{Damping, descend};
use inkling_core::model::free_decay::{self, ALL, FREE, Tangent, Theta};
use inkling_core::model::inner_product::dot;
use inkling_core::numbers::tuned::little;
use inkling_core::side_by_side::side_by_side;
use nalgebra::DMatrix;
use std::f64::consts::{PI, TAU};
use std::iter::repeat;

/// Powers of the drive with which a shape may scale: 0, 1, 2, 3.
pub const PATTERNS: usize = 4;
/// Largest number of steps of a descent, which otherwise ends where steps gain nothing. Long rings of high
/// quality, whose frequency scatters by per cents, need a dozen, since a step is bounded.
const STEPS: usize = 20;
/// How the steps of a descent are damped.
const DAMPING: Damping = Damping { first: 1e-4, down: 0.2, least: 1e-9, up: 20.0, most: 1e8 };
/// Largest change of ln damping, and of the real pole's ln lambda/sigma, and largest one of ln frequency in
/// one step of a fit.
const MOST_OF_DAMPING: f64 = 0.3;
const MOST_OF_FREQUENCY: f64 = 0.05;
/// Least variance of the noise before a coarse converter rounds it, square counts.
const LEAST_BEFORE_ROUNDING: f64 = 0.09;
/// Rate of the real pole over the damping, lambda/sigma: it follows from the cross-sections and the ratio of
/// inertances, thesis (2-3), (2-4).
pub const LAMBDA_OVER_SIGMA: f64 = 1.27;
/// Bounds of lambda/sigma: lambda lies between R_r/I_r and R_n/I_n, given here over the damping.
const LAMBDA_BOUNDS: (f64, f64) = (0.55, 2.7);
/// Ratio of the resistive rates, A_n/A_r, thesis (2-3), (2-4).
pub const RATIO_OF_RATES: f64 = 0.2;

/// The fitted model of all signals; the symbols are those of the module's equation.
#[derive(Clone, Debug)]
pub struct Model {
    /// Whether there is a real pole (ink channel) or none (oscillator).
    pub real: bool,
    /// Parameters of the mean channel. As [`Theta`], but the last one is ln lambda/sigma: losses move both
    /// poles of a channel alike.
    pub mean: Theta,
    /// Covariance of the free parameters from channel to channel.
    pub between: Matrix5,
    /// Covariance of the free parameters from burst to burst within a channel.
    pub within: Matrix5,
    /// Whether both were estimated, or are still those of the start.
    pub estimated: bool,
    /// Variance of the white noise of a sample, counts².
    pub noise_var: f64,
    /// What causes add to the free decays.
    pub added: Additions,
    /// Parameters of each channel (unit), about which the model is linearised.
    pub units: Vec<Theta>,
    /// Deviation of each signal's own parameters from its channel's.
    pub each: Vec<Theta>,
    /// Limits of the converter: samples that are expected beyond one are clipped, and count for nothing.
    pub rails: Vec<Rail>,
    /// Step of a coarse converter, and the remainder that all codes have when divided by it; counts.
    pub lattice: Option<[f64; 2]>,
}

/// What causes add to the free decays, or change in them.
#[derive(Clone, Debug)]
pub struct Additions {
    /// Shapes that are added to every signal, N samples for each power of the drive.
    pub shapes: [Vec<f64>; PATTERNS],
    /// Change of theta per unit of each covariate, which is a standard deviation but for the constant and for
    /// squares ([`super::covariates`]).
    pub beta: [Theta; COVARIATES],
    /// Share of the previous ring that is still left when a signal begins.
    pub tail_gain: f64,
}

impl Additions {
    /// Nothing is added to signals of so many samples.
    pub fn none(samples: usize) -> Additions {
        Additions {
            shapes: std::array::from_fn(|_| vec![0.0; samples]),
            beta: [Theta::zeros(); COVARIATES],
            tail_gain: 0.0,
        }
    }

    /// The shapes together at a sample. `powers`: of the drive.
    pub fn shape(&self, powers: &[f64; PATTERNS], sample: usize) -> f64 {
        powers.iter().zip(&self.shapes).map(|(power, shape)| power * shape[sample]).sum()
    }
}

/// A limit of the converter.
#[derive(Clone, Copy, Debug)]
pub struct Rail {
    /// 1 for the upper limit, -1 for the lower one.
    pub side: f64,
    /// The limit itself, counts.
    pub level: f64,
    /// Value from which on an expected sample may be clipped: three standard deviations of the noise before
    /// `level`.
    pub from: f64,
}

impl Rail {
    /// Whether a value lies in the region where samples may be clipped.
    pub fn clips(&self, y: f64) -> bool {
        self.side * (y - self.from) > 0.0
    }
}

/// The model linearised about one signal's parameters: the signal's residual and tangent.
#[derive(Debug, Default)]
pub struct Linear {
    pub tangent: Tangent,
    pub residual: Vec<f64>,
    /// What the previous ring adds to this signal per unit of `tail_gain`.
    pub tail: Vec<f64>,
    /// 1 for every sample that counts, 0 where it is clipped.
    pub counts: Vec<f64>,
}

impl Linear {
    /// Number of samples that count.
    pub fn counted(&self) -> f64 {
        self.counts.iter().sum()
    }

    /// What is expected of the signal, counts; where a sample does not count, what was measured.
    pub fn expected(&self, signal: &[f32]) -> Vec<f64> {
        signal.iter().zip(&self.residual).map(|(y, r)| f64::from(*y) - r).collect()
    }

    /// The tangent by the signal's own parameters, in units of [`Model::scale`]; N x FREE.
    pub fn by_free(&self, scale: &Vector5) -> DMatrix<f64> {
        let columns = &self.tangent.columns;
        DMatrix::from_fn(self.residual.len(), FREE, |k, j| columns[j][k] * scale[j])
    }
}

/// The powers of the drive that a shape may scale with.
pub fn powers(drive: f64) -> [f64; PATTERNS] {
    [1.0, drive, drive * drive, drive * drive * drive]
}

/// A step of each parameter, with those of ln damping and ln frequency bounded.
pub fn one_step(step: &[f64]) -> impl Iterator<Item = (usize, f64)> {
    let most = [MOST_OF_DAMPING, MOST_OF_FREQUENCY].into_iter().chain(repeat(f64::INFINITY));
    step.iter().zip(most).map(|(step, most)| step.clamp(-most, most)).enumerate()
}

/// Turns a model's parameters into those of a decay: the last one becomes ln lambda instead of ln
/// lambda/sigma.
pub fn with_its_pole(mut theta: Theta) -> Theta {
    theta[5] += theta[0];
    theta
}

impl Model {
    /// Typical amplitude of the damped pair at unit drive, counts.
    pub fn amplitude(&self) -> f64 {
        self.mean[2].hypot(self.mean[3])
    }

    /// Standard deviation of the real pole's amplitude about 0, as it is expected before any fit: a tenth of
    /// the ring. The amplitude depends on how the pulse moves both flows at the end of the actuation, of
    /// which thesis (2-2) says nothing. Without this bound the real pole would swallow offset, droop and
    /// transients.
    pub fn slow_sd(&self) -> f64 {
        little() * self.amplitude().max(f64::MIN_POSITIVE)
    }

    /// Mean of what rounding to a coarse step adds to an expected value: the Fourier series of the sawtooth
    /// of rounding errors, each term attenuated by the noise that the signal had before it was rounded.
    fn rounding(&self, expected: f64) -> f64 {
        let Some([step, first]) = self.lattice else { return 0.0 };
        // the variance before rounding: the fitted one includes that of uniform rounding errors, step²/12
        let var = (self.noise_var - step * step / 12.0).max(LEAST_BEFORE_ROUNDING);
        let turn = TAU * (expected - first) / step;
        let fall = (TAU / step).powi(2) * var / 2.0;
        let waves = (1..=6).map(|k| {
            let k = f64::from(k);
            let sign = if k as i32 % 2 == 0 { 1.0 } else { -1.0 };
            sign * (k * turn).sin() * (-k * k * fall).exp() / (PI * k)
        });
        step * waves.sum::<f64>()
    }

    /// ln lambda/sigma of the model less what is expected of it.
    pub fn lambda_off(&self) -> f64 {
        self.mean[5] - LAMBDA_OVER_SIGMA.ln()
    }

    /// Parameters of the mean channel's free decay.
    pub fn decay(&self) -> Theta {
        self.sampled(with_its_pole(self.mean))
    }

    /// Keeps a frequency at or below half of the sampling rate: a ring above cannot be told from one below. A
    /// fit that runs away, as with signals that each ring at a frequency of their own, ends there.
    fn sampled(&self, mut theta: Theta) -> Theta {
        theta[1] = theta[1].min((PI * self.added.shapes[0].len() as f64).ln());
        theta
    }

    /// Moves the mean and all channels by the same step, bounded in ln damping and ln frequency.
    pub fn shift(&mut self, step: &[f64; ALL]) {
        if !step.iter().all(|v| v.is_finite()) {
            return; // nothing is known of such a shift
        }
        for (j, step) in one_step(&step[..FREE]) {
            self.mean[j] += step;
            self.units.iter_mut().for_each(|u| u[j] += step);
        }
        self.shift_lambda(step[ALL - 1]);
    }

    /// Moves ln lambda/sigma, within the bounds that the rates R_r/I_r and R_n/I_n set.
    pub fn shift_lambda(&mut self, step: f64) {
        if !step.is_finite() {
            return; // nothing is known of it
        }
        let (low, high) = LAMBDA_BOUNDS;
        let moved = self.mean[5] + step.clamp(-MOST_OF_DAMPING, MOST_OF_DAMPING);
        self.mean[5] = moved.min(high.ln()).max(low.ln());
    }

    /// Parameters of signal i's free decay: those of its channel, its own deviation, and what the covariates
    /// add.
    pub fn theta(&self, i: usize, data: &Observations) -> Theta {
        let mut theta = self.units[data.rows[i].unit] + self.each[i];
        theta[5] = self.mean[5];
        for (beta, z) in self.added.beta.iter().zip(data.beside.z[i]) {
            theta += beta * z;
        }
        self.sampled(with_its_pole(theta))
    }

    /// Writes residual y - prediction and tangent of signal i to `out`, both in counts (drive included).
    pub fn linearise(&self, i: usize, data: &Observations, out: &mut Linear) {
        let theta = self.theta(i, data);
        let n = data.samples;
        let s = data.beside.drive[i];
        out.tangent.at(&theta, self.mean[4], self.real, n);
        // A step of ln sigma moves the real pole, too, since the model holds ln lambda/sigma: so the
        // damping's column takes the pole's column in addition. That one is built with the mean amplitude of
        // the pole, not with this signal's.
        let [of_damping, .., of_pole] = &mut out.tangent.columns;
        of_damping.iter_mut().zip(of_pole).for_each(|(damping, pole)| *damping += *pole);

        // what the previous ring adds to this signal
        out.tail.clear();
        out.tail.resize(n, 0.0);
        let idle_s = data.rows[i].beside.idle_s;
        if idle_s.is_finite() && idle_s > 0.0 {
            // how far the previous ring has advanced, in signal lengths
            let shift = idle_s / data.length_s();
            free_decay::add(&theta, self.real, shift, 1.0, &mut out.tail);
        }

        // Sample by sample: scale by the drive, add tail, shapes and rounding, and subtract the sum from what
        // was measured. Where a sample may be clipped, everything is set to 0.
        out.residual.clear();
        out.counts.clear();
        out.counts.resize(n, 1.0);
        let powers = powers(s);
        for (k, &y) in data.signal(i).iter().enumerate() {
            out.tangent.columns.iter_mut().for_each(|column| column[k] *= s);
            out.tail[k] *= s;
            let shape = self.added.shape(&powers, k);
            let plain = s * out.tangent.y[k] + self.added.tail_gain * out.tail[k] + shape;
            let expected = plain + self.rounding(plain);
            out.residual.push(f64::from(y) - expected);
            let clips = |rail: &Rail| rail.clips(expected) || rail.clips(f64::from(y));
            if self.rails.iter().any(clips) || data.is_lost(i, k) {
                out.counts[k] = 0.0;
                out.residual[k] = 0.0;
                out.tail[k] = 0.0;
                out.tangent.columns.iter_mut().for_each(|column| column[k] = 0.0);
            }
        }
    }

    /// What `of` makes of each signal, about which the model is linearised.
    pub fn of_each<T>(
        &self,
        data: &Observations,
        mut of: impl FnMut(usize, &Linear) -> T,
    ) -> Vec<T> {
        let mut linear = Linear::default();
        let each = |i| {
            self.linearise(i, data, &mut linear);
            of(i, &linear)
        };
        (0..data.len()).map(each).collect()
    }

    /// Moves every channel's parameters to their most probable values, given the present mean and scatter,
    /// with all signals of the channel together.
    pub fn fit_units(&mut self, data: &Observations, steps: usize) {
        let mut rows = vec![Vec::new(); data.units];
        (0..data.len()).for_each(|i| rows[data.rows[i].unit].push(i));
        let scale = self.scale();
        let precision = inverse(&scaled(&self.between, &scale));
        let (own, centre): (Own, Theta) = (|model, unit| &mut model.units[unit], self.mean);
        let descent = Descent { data, own, centre, scale, precision, most: [0.5, 0.5], steps };
        let moved = |model: &mut Model, unit| model.descend(unit, &rows[unit], &descent);
        self.units = self.by_halves(self.units.len(), moved);
    }

    /// Moves each signal's own deviation to its most probable value, given its channel's parameters.
    fn fit_each(&mut self, data: &Observations, steps: usize) {
        if data.len() == data.units {
            return; // a channel that was heard once is its signal
        }
        let scale = self.scale();
        let precision = inverse(&scaled(&self.within, &scale));
        let (own, centre): (Own, Theta) = (|model, i| &mut model.each[i], Theta::zeros());
        let descent = Descent { data, own, centre, scale, precision, most: [0.2, 0.02], steps };
        self.each = self.by_halves(data.len(), |model, i| model.descend(i, &[i], &descent));
    }

    /// Applies `moved` to each of `count` channels or signals, on two threads that have a copy of the model
    /// each. This is allowed because what is moved of one does not depend on any other's.
    pub(super) fn by_halves(
        &self,
        count: usize,
        moved: impl Fn(&mut Model, usize) -> Theta + Sync,
    ) -> Vec<Theta> {
        let half = |rows: std::ops::Range<usize>| -> Vec<Theta> {
            let mut model = self.clone();
            rows.map(|i| moved(&mut model, i)).collect()
        };
        side_by_side(2, vec![0..count / 2, count / 2..count], half).concat()
    }

    /// Where the parameters of a channel, or of a signal, with index `of` are most probable, given some signals
    /// and a Gaussian prior. Those in this model are left where the descent looked last.
    fn descend(&mut self, of: usize, rows: &[usize], descent: &Descent) -> Theta {
        let Descent { own, centre, scale, precision, .. } = descent;
        // deviation from the centre of the prior, in units of `scale`
        let off = |theta: &Theta| free_part(&(theta - centre), scale);
        let (noise_var, start) = (self.noise_var, *own(self, of));
        let mut linear = Linear::default();
        // -2 ln posterior, up to a constant
        let cost = |theta: &Theta| {
            *own(self, of) = *theta;
            let normal = self.normal(rows, descent, &mut linear);
            let of_prior = off(theta).dot(&(precision * off(theta)));
            (normal.square / noise_var + of_prior, normal)
        };
        let slope = |theta: &Theta, normal: Normal| {
            let gradient = normal.product / noise_var - precision * off(theta);
            Some((gradient, normal.gram / noise_var + precision))
        };
        // a Gauss-Newton step with the diagonal of the Hessian increased, each part clamped
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

    /// Sums of the normal equations over some signals, at the present parameters.
    fn normal(
        &self,
        rows: &[usize],
        Descent { data, scale, .. }: &Descent,
        linear: &mut Linear,
    ) -> Normal {
        let mut sum = Normal { gram: Matrix5::zeros(), product: Vector5::zeros(), square: 0.0 };
        for &i in rows {
            self.linearise(i, data, linear);
            let (gram, product) = free_products(linear, scale);
            sum.gram += gram;
            sum.product += product;
            sum.square += dot(&linear.residual, &linear.residual);
        }
        sum
    }

    /// Units in which parameters are scaled: logarithms as they are, amplitudes relative to the ring's.
    pub fn scale(&self) -> Vector5 {
        let a = self.amplitude();
        Vector5::from([1.0, 1.0, a, a, a])
    }

    /// Linearises anew: moves channels and single signals, in turn, to their most probable values.
    pub fn settle(&mut self, data: &Observations) {
        for _ in 0..2 {
            self.fit_units(data, STEPS);
            self.fit_each(data, STEPS);
        }
    }
}

/// The parameters that a descent moves: a channel's, which all of its signals share, or one signal's own
/// deviation.
type Own = fn(&mut Model, usize) -> &mut Theta;

/// How a descent moves parameters.
struct Descent<'a> {
    data: &'a Observations,
    own: Own,
    /// Mean of the prior that the moved parameters have.
    centre: Theta,
    scale: Vector5,
    /// Inverse covariance of that prior, in units of `scale`.
    precision: Matrix5,
    /// Largest step of ln sigma and of ln omega.
    most: [f64; 2],
    steps: usize,
}

/// Sums over signals that a Gauss-Newton step needs: J^T J, J^T r, r^T r.
struct Normal {
    gram: Matrix5,
    product: Vector5,
    square: f64,
}

/// J^T J and J^T r over the free parameters, in units of `scale`.
pub fn free_products(linear: &Linear, scale: &Vector5) -> (Matrix5, Vector5) {
    let columns = &linear.tangent.columns;
    let mut gram = Matrix5::zeros();
    let mut product = Vector5::zeros();
    for i in 0..FREE {
        product[i] = dot(&columns[i], &linear.residual) * scale[i];
        for j in 0..=i {
            gram[(i, j)] = dot(&columns[i], &columns[j]) * scale[i] * scale[j];
            gram[(j, i)] = gram[(i, j)];
        }
    }
    (gram, product)
}

#[cfg(test)]
mod tests {
    use super::super::generator::{Run, draw};
    use super::*;

    /// The descent starts far off, where a plain Gauss-Newton step overshoots; it must improve every signal
    /// whatever the number of steps.
    #[test]
    fn no_step_is_kept_that_makes_a_signal_less_probable() {
        let data = draw(&Run { channels: 6, bursts: 4, ..Run::default() }, 31);
        let mut fitted = Model::start(&data, true).unwrap();
        fitted.fit(&data, 1);
        let scale = fitted.scale();
        let precision = inverse(&scaled(&fitted.within, &scale));
        let (own, centre): (Own, Theta) = (|model, i| &mut model.each[i], Theta::zeros());
        let most = [0.2, 0.02];
        let descent = Descent { data: &data, own, centre, scale, precision, most, steps: 0 };
        let costs = |model: &Model| -> Vec<f64> {
            let mut linear = Linear::default();
            let cost = |i: usize| {
                let off = free_part(&model.each[i], &scale);
                let square = model.normal(&[i], &descent, &mut linear).square;
                square / model.noise_var + off.dot(&(precision * off))
            };
            (0..data.len()).map(cost).collect()
        };
        let best = costs(&fitted);
        for (i, each) in fitted.each.iter_mut().enumerate() {
            let sign = if i % 2 == 0 { 1.0 } else { -1.0 };
            each[0] += sign;
            each[1] += 0.06 * sign;
        }
        let mut last = costs(&fitted);
        for steps in [1, 2, 3, 40] {
            let mut model = fitted.clone();
            model.fit_each(&data, steps);
            let now = costs(&model);
            assert!(now.iter().zip(&last).all(|(now, last)| now <= last), "{steps} steps");
            last = now;
        }
        // in the end it must get back to the best fit
        assert!(
            last.iter().zip(&best).all(|(last, best)| last < &(best + 1e-3)),
            "{last:?} {best:?}"
        );
    }
}
