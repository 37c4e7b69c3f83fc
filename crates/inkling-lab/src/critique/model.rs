//! The mixed-effects model of all signals (thesis (2-2) as it shows in the output), and its linearisation
//! about each signal.
//!
//! In: `Observations`. Out: `Model`, whose `Model::linearise` gives one signal's residual and Jacobian to
//! every other file of this room. `start.rs` makes the first model, `settle.rs` moves channels and signals,
//! `scatter.rs` estimates covariances, mean and noise (`Model::fit`), and `refit.rs` adds causes.
//!
//! The model expects of signal i, in counts at time t after t_a:
//!
//! ```text
//! y_i(t) = s f(theta_i; t) + sum over p = 0..3 of s^p shape_p(t) + s g f(theta_i; t + idle_i) + noise
//! theta_i = units[channel of i] + each[i] + sum over covariates c of beta_c z_ic
//! ```
//!
//! s: drive over the mean drive; f: the free decay (`free_decay.rs`); shapes, g and beta: what causes add
//! (`Additions`); z: standardised covariates. The scatter is split: `units` of a channel ~ N(mean,
//! `between`), `each` of a signal ~ N(0, `within`) from burst to burst. The model is linearised about each
//! signal's own theta_i, since channels' frequencies scatter by per cents.

use super::covariates::COVARIATES;
use super::matrices::{Matrix5, Vector5};
use super::observations::Observations;
use inkling_core::model::free_decay::{self, ALL, FREE, Tangent, Theta};
use inkling_core::model::inner_product::dot;
use inkling_core::numbers::LITTLE;
use nalgebra::DMatrix;
use std::f64::consts::{PI, TAU};

/// Number of powers of the drive (0 to 3) with which a shape may scale.
pub const PATTERNS: usize = 4;
/// Largest changes of ln damping (and ln lambda/sigma) and of ln frequency in one step of `Model::shift` and
/// `Model::shift_lambda`: a linear step cannot leave the range in which it means something.
const MOST: [f64; 2] = [0.3, 0.05];
/// Least variance of the noise before a coarse converter rounds it, counts².
const LEAST_BEFORE_ROUNDING: f64 = 0.09;
/// Rate of the real pole over the damping, lambda/sigma, that is expected of an ink channel: it follows from
/// the cross-sections and the ratio of inertances, thesis (2-3), (2-4).
pub const LAMBDA_OVER_SIGMA: f64 = 1.27;
/// Bounds of lambda/sigma: lambda lies between R_r/I_r and R_n/I_n, here over a typical sigma.
const LAMBDA_BOUNDS: (f64, f64) = (0.55, 2.7);
/// Ratio g/d of the resistive rates R_r/I_r and R_n/I_n, which is A_n/A_r by thesis (2-3), (2-4). The output
/// does not tell it, so it is held wherever flows inside the channel are needed.
pub const RATIO_OF_RATES: f64 = 0.2;

/// The fitted model of all signals. Parameters are a `Theta`: ln sigma and ln omega (rates per signal
/// length), the amplitudes a, b, c (counts at mean drive), and a sixth one for the real pole.
#[derive(Clone, Debug)]
pub struct Model {
    /// Parameters of the mean channel. As [`Theta`], but the last one is ln lambda/sigma and not ln lambda: a
    /// change of the losses moves both poles by the same factor.
    pub mean: Theta,
    /// Covariance of the five free parameters from channel to channel, in the parameters' own units.
    pub between: Matrix5,
    /// The same from burst to burst within a channel; zero where every channel was heard once.
    pub within: Matrix5,
    /// Whether both were estimated, or are still the wide guesses of the start.
    pub estimated: bool,
    /// Variance of the white noise of a sample, counts².
    pub noise_var: f64,
    pub added: Additions,
    /// Parameters of each channel, by `Row::unit`; the last one is not used, it is always the mean's.
    pub units: Vec<Theta>,
    /// Deviation of each signal's own parameters from its channel's, by row; the last one is not used.
    pub each: Vec<Theta>,
    /// Of the converter of each printhead, by `Row::printhead`; empty: nothing is known.
    pub codes: Vec<Codes>,
}

/// What is known of a converter.
#[derive(Clone, Debug, Default)]
pub struct Codes {
    /// Its limits: samples that are expected or measured beyond `Rail::from` count for nothing.
    pub rails: Vec<Rail>,
    /// `[step, first]` of a coarse one, counts: all codes are `first` plus a multiple of `step`.
    pub lattice: Option<[f64; 2]>,
}

#[derive(Clone, Debug)]
pub struct Additions {
    /// Shapes that are added to every signal, counts at mean drive: N samples for each power of the drive.
    pub shapes: [Vec<f64>; PATTERNS],
    /// Change of theta per unit of each covariate ([`super::covariates`]).
    pub beta: [Theta; COVARIATES],
    /// Share g of the previous ring, as it goes on in this signal, that is added.
    pub tail_gain: f64,
}

impl Additions {
    pub fn none(samples: usize) -> Additions {
        Additions {
            shapes: std::array::from_fn(|_| vec![0.0; samples]),
            beta: [Theta::zeros(); COVARIATES],
            tail_gain: 0.0,
        }
    }

    /// What all shapes together add to one sample, counts. `powers`: of the signal's drive.
    pub fn shape(&self, powers: &[f64; PATTERNS], sample: usize) -> f64 {
        powers.iter().zip(&self.shapes).map(|(power, shape)| power * shape[sample]).sum()
    }
}

#[derive(Clone, Copy, Debug)]
pub struct Rail {
    /// 1 for the upper limit, -1 for the lower one.
    pub side: f64,
    pub level: f64,
    /// Value from which on a sample may be clipped: three standard deviations of the noise before `level`.
    pub from: f64,
}

impl Rail {
    pub fn clips(&self, y: f64) -> bool {
        self.side * (y - self.from) > 0.0
    }
}

/// The model linearised about one signal's parameters. Every vector has N samples; a sample that may be
/// clipped has 0 in all of them (but for `tangent.y` and `model`).
#[derive(Debug, Default)]
pub struct Linear {
    /// Jacobian of the signal by its parameters, times the drive; `tangent.y` is the decay per unit drive.
    pub tangent: Tangent,
    /// What the model expects, counts.
    pub model: Vec<f64>,
    /// Measured minus expected, counts.
    pub residual: Vec<f64>,
    /// What the previous ring adds to this signal per unit of `tail_gain`, counts.
    pub tail: Vec<f64>,
    /// 1 for every sample that counts, 0 where it is clipped.
    pub counts: Vec<f64>,
}

impl Linear {
    pub fn counted(&self) -> f64 {
        self.counts.iter().sum()
    }

    /// What is expected of the signal, counts; where a sample does not count, what was measured.
    pub fn expected(&self, signal: &[f32]) -> Vec<f64> {
        signal.iter().zip(&self.residual).map(|(y, r)| f64::from(*y) - r).collect()
    }

    /// The Jacobian by the five free parameters in units of [`Model::scale`]; N x FREE, counts.
    pub fn by_free(&self, scale: &Vector5) -> DMatrix<f64> {
        let columns = &self.tangent.columns;
        DMatrix::from_fn(self.residual.len(), FREE, |k, j| columns[j][k] * scale[j])
    }
}

pub fn powers(drive: f64) -> [f64; PATTERNS] {
    [1.0, drive, drive * drive, drive * drive * drive]
}

/// Turns a model's parameters into those of a decay: ln lambda/sigma becomes ln lambda.
pub fn with_its_pole(mut theta: Theta) -> Theta {
    theta[5] += theta[0];
    theta
}

impl Model {
    /// The share of the signals' movement about their means that is no noise.
    pub fn explained(&self, data: &Observations) -> f64 {
        let all: f64 = (0..data.len()).map(|i| data.movement(i)).sum();
        1.0 - self.noise_var * (data.len() * data.samples) as f64 / all
    }

    pub fn amplitude(&self) -> f64 {
        self.mean[2].hypot(self.mean[3])
    }

    /// Prior standard deviation of the real pole's mean amplitude about 0, counts: a tenth of the ring
    /// (`little`). The amplitude depends on how the pulse moves both flows at the end of the actuation, of
    /// which thesis (2-2) says nothing; without this bound it would swallow offset, droop and transients.
    /// Used in tests and refits (`space.rs`, `nuisance.rs`), not in the descents here.
    pub fn slow_sd(&self) -> f64 {
        LITTLE * self.amplitude().max(f64::MIN_POSITIVE)
    }

    /// Mean of what rounding to a coarse step adds to a sample whose mean before rounding is `expected`;
    /// counts. The rounding error of a value u is a sawtooth with the Fourier series q sum (-1)^k sin(2 pi k
    /// u/q) / (pi k), q the step; Gaussian noise of variance v attenuates term k by e^{-2 (pi k/q)² v}, so
    /// that six terms suffice.
    fn rounding(&self, expected: f64, codes: Option<&Codes>) -> f64 {
        let Some([step, first]) = codes.and_then(|codes| codes.lattice) else { return 0.0 };
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

    pub fn lambda_off(&self) -> f64 {
        self.mean[5] - LAMBDA_OVER_SIGMA.ln()
    }

    pub fn decay(&self) -> Theta {
        self.sampled(with_its_pole(self.mean))
    }

    /// Limits the frequency to half of the sampling rate, omega <= pi N: a ring above cannot be told from one
    /// below.
    fn sampled(&self, mut theta: Theta) -> Theta {
        theta[1] = theta[1].min((PI * self.added.shapes[0].len() as f64).ln());
        theta
    }

    /// A step that is not finite is ignored: the data did not determine it.
    pub fn shift(&mut self, step: &[f64; ALL]) {
        if !step.iter().all(|v| v.is_finite()) {
            return;
        }
        for (j, step) in step[..FREE].iter().enumerate() {
            let most = MOST.get(j).copied().unwrap_or(f64::INFINITY);
            let step = step.clamp(-most, most);
            self.mean[j] += step;
            self.units.iter_mut().for_each(|u| u[j] += step);
        }
        self.shift_lambda(step[ALL - 1]);
    }

    /// By a bounded step, within `LAMBDA_BOUNDS`; one that is not finite is ignored.
    pub fn shift_lambda(&mut self, step: f64) {
        if !step.is_finite() {
            return;
        }
        let (low, high) = LAMBDA_BOUNDS;
        let moved = self.mean[5] + step.clamp(-MOST[0], MOST[0]);
        self.mean[5] = moved.min(high.ln()).max(low.ln());
    }

    /// Parameters of signal i's free decay, ln lambda last.
    pub fn theta(&self, i: usize, data: &Observations) -> Theta {
        let mut theta = self.units[data.rows[i].unit] + self.each[i];
        theta[5] = self.mean[5];
        for (beta, z) in self.added.beta.iter().zip(data.beside.z[i]) {
            theta += beta * z;
        }
        self.sampled(with_its_pole(theta))
    }

    /// Residual and Jacobian are in counts, for the signal's own drive. The memory of `out` is used again.
    pub fn linearise(&self, i: usize, data: &Observations, out: &mut Linear) {
        data.work.goes_on();
        let theta = self.theta(i, data);
        let n = data.samples;
        let s = data.beside.drive[i];
        out.tangent.at(&theta, self.mean[4], n);
        // A step of ln sigma moves lambda, too, so the pole's column is added: with the mean amplitude of the
        // real pole, because a single signal's is mostly noise.
        let [of_damping, .., of_pole] = &mut out.tangent.columns;
        of_damping.iter_mut().zip(of_pole).for_each(|(damping, pole)| *damping += *pole);

        // nothing where there was no actuation before (infinite), or none was recorded (NaN)
        out.tail.clear();
        out.tail.resize(n, 0.0);
        let idle_s = data.rows[i].beside.idle_s;
        if idle_s.is_finite() && idle_s > 0.0 {
            let shift = idle_s / data.length_s();
            free_decay::add(&theta, shift, 1.0, &mut out.tail);
        }

        out.model.clear();
        out.residual.clear();
        out.counts.clear();
        out.counts.resize(n, 1.0);
        let powers = powers(s);
        let codes = self.codes.get(data.rows[i].printhead);
        let rails = codes.map_or(&[][..], |codes| &codes.rails);
        for (k, &y) in data.signal(i).iter().enumerate() {
            out.tangent.columns.iter_mut().for_each(|column| column[k] *= s);
            out.tail[k] *= s;
            let shape = self.added.shape(&powers, k);
            let plain = s * out.tangent.y[k] + self.added.tail_gain * out.tail[k] + shape;
            let expected = plain + self.rounding(plain, codes);
            out.model.push(expected);
            out.residual.push(f64::from(y) - expected);
            let clips = |rail: &Rail| rail.clips(expected) || rail.clips(f64::from(y));
            if rails.iter().any(clips) || data.is_lost(i, k) {
                out.counts[k] = 0.0;
                out.residual[k] = 0.0;
                out.tail[k] = 0.0;
                out.tangent.columns.iter_mut().for_each(|column| column[k] = 0.0);
            }
        }
    }

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

    /// 1 for the two logarithms, the mean channel's amplitude (counts) for a, b, c.
    pub fn scale(&self) -> Vector5 {
        let a = self.amplitude();
        Vector5::from([1.0, 1.0, a, a, a])
    }
}

/// J^T J and J^T r of one signal over the free parameters in units of `scale`, not divided by the noise.
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
