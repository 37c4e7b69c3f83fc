//! How much of an effect the healthy model of a run, the baseline, cannot explain: what it can explain by other
//! parameters of its channels, nobody can find.
//!
//! In: what an effect changes in each signal, counts ([`Change`], from `strength.rs`). Out:
//! [`Baseline::misfit`], the chi-squared that is left when each channel's own six parameters, its freedoms,
//! are fitted again.
//!
//! A channel's decay at nominal drive is A e^{-sigma t} cos(omega t - phi) + A kappa e^{-lambda t}, with
//! lambda between the nominal channel's resistive rates R_r/I_r and R_n/I_n: without that bound the real pole
//! would swallow whatever is slow. The freedoms scatter from channel to channel about a mean that is free
//! (but for the place of the real pole, which has a prior), and from burst to burst about their channel. So
//! chi-squared is the minimum, over the channels' freedoms and their mean, of the squared misfit of all
//! signals in the metric of noise and scatter, plus the squared distance of the channels from the mean in the
//! metric of their scatter.
//!
//! The fit is Gauss-Newton to its end, and each step is linearised anew at each channel's refitted freedoms.
//! So what a change of frequency and damping explains is no misfit, however large the change.

use super::run::Base;
use crate::simulate::draws::{Purpose, part, stream};
use crate::simulate::sensor::{NOMINAL_DRIVE_V, at_viscosity};
use inkling_core::model::InkChannel;
use nalgebra::{DMatrix, DVector, SMatrix, SVector};
use std::f64::consts::TAU;

/// Number of channels that are drawn to estimate how the freedoms scatter from channel to channel.
const DRAWN: usize = 200;
/// Share that is added to the variance of each freedom over channels, so that the covariance can be inverted.
const RIDGE: f64 = 1e-4;
const MOST_STEPS: usize = 40;
/// Largest change of each freedom in one step, in the order of [`Freedom`].
const LONGEST_STEP: [f64; 6] = [0.3, 0.3, 0.3, 0.2, 0.02, 1.0];
/// Prior standard deviation of the mean of u over channels: that of a logistic variable.
const POLE_SD: f64 = 1.81;

/// A covariance or an information matrix over the six freedoms.
pub type Freedoms = SMatrix<f64, 6, 6>;
/// The freedoms: ln A at the nominal drive, phi, kappa, ln sigma, ln omega, and the place u of the real pole:
/// lambda = low + (high - low)/(1 + e^-u).
pub type Freedom = SVector<f64, 6>;

/// What an effect changes in one signal.
pub struct Change<'a> {
    pub channel: usize,
    /// Drive over the nominal drive.
    pub drive: f64,
    /// The channel's own freedoms, without the effect.
    pub own: &'a Freedom,
    /// What the effect adds to the samples, counts.
    pub samples: DVector<f64>,
}

#[derive(Clone, Copy)]
pub struct Frame {
    pub samples: usize,
    pub period_s: f64,
    /// Lowest and highest rate lambda of the real pole.
    pub poles_per_s: [f64; 2],
}

impl Frame {
    pub fn of(base: &Base) -> Frame {
        let (g, d) = (base.rates.g_per_s, base.rates.d_per_s);
        let samples = base.physics.acquisition.samples;
        Frame { samples, period_s: base.dt_s(), poles_per_s: [g.min(d), g.max(d)] }
    }

    /// The freedoms of a channel with these rates and a gain of 1; `None`: it does not ring.
    pub fn freedom(&self, base: &Base, rates: &InkChannel) -> Option<Freedom> {
        let poles = rates.poles()?;
        let [low, high] = self.poles_per_s;
        let place = ((poles.lambda_per_s - low) / (high - low)).clamp(1e-3, 1.0 - 1e-3);
        let mut of = Freedom::zeros();
        of[3] = poles.damping_per_s.ln();
        of[4] = (TAU * poles.frequency_hz).ln();
        of[5] = (place / (1.0 - place)).ln();
        let [a, b, c] = self.amplitudes(&base.linear(rates, NOMINAL_DRIVE_V), &of)?;
        let amplitude = a.hypot(b);
        (of[0], of[1], of[2]) = (amplitude.ln(), b.atan2(a), c / amplitude);
        of.iter().all(|x| x.is_finite()).then_some(of)
    }

    /// Amplitudes of cosine, sine and real pole in `y` by least squares, with sigma, omega and lambda of `of`.
    pub fn amplitudes(&self, y: &[f64], of: &Freedom) -> Option<[f64; 3]> {
        let rates = Freedom::from([0.0, 0.0, 0.0, of[3], of[4], of[5]]);
        let (_, of_cosine) = self.decay(&rates);
        // the derivatives by ln A, phi and kappa at A = 1, phi = kappa = 0 are cosine, sine and real pole
        let columns = of_cosine.columns(0, 3).into_owned();
        let x = columns.svd(true, true).solve(&DVector::from_column_slice(y), 1e-12).ok()?;
        Some([x[0], x[1], x[2]])
    }

    /// A decay at the nominal drive, N samples in counts, and its derivatives by the six freedoms, N x 6.
    pub fn decay(&self, of: &Freedom) -> (DVector<f64>, DMatrix<f64>) {
        let (mut y, mut j) = (DVector::zeros(self.samples), DMatrix::zeros(self.samples, 6));
        let [low, high] = self.poles_per_s;
        let place = 1.0 / (1.0 + (-of[5]).exp());
        let (sigma, omega) = (of[3].exp(), of[4].exp());
        let lambda = low + (high - low) * place;
        let by_place = (high - low) * place * (1.0 - place);
        for k in 0..self.samples {
            let t = k as f64 * self.period_s;
            let (sine, cosine) = (omega * t - of[1]).sin_cos();
            let pair = (of[0] - sigma * t).exp();
            let real = (of[0] - lambda * t).exp();
            y[k] = pair * cosine + of[2] * real;
            j[(k, 0)] = y[k];
            j[(k, 1)] = pair * sine;
            j[(k, 2)] = real;
            j[(k, 3)] = -sigma * t * pair * cosine;
            j[(k, 4)] = -omega * t * pair * sine;
            j[(k, 5)] = -by_place * t * of[2] * real;
        }
        (y, j)
    }

    /// Derivative of the freedoms by t_a, per second.
    pub fn later(&self, of: &Freedom) -> Freedom {
        let [low, high] = self.poles_per_s;
        let lambda = low + (high - low) / (1.0 + (-of[5]).exp());
        let (sigma, omega) = (of[3].exp(), of[4].exp());
        Freedom::from([-sigma, -omega, of[2] * (sigma - lambda), 0.0, 0.0, 0.0])
    }
}

/// The baseline of one run: how the freedoms of its channels scatter, and its noise.
pub struct Baseline {
    pub frame: Frame,
    /// Variance of a sample, rounding to whole counts included, counts².
    pub noise_var: f64,
    pub nominal: Freedom,
    /// Covariance of the freedoms from burst to burst within a channel.
    covariance: Freedoms,
    /// Inverse of the covariance of the freedoms from channel to channel.
    precision: Freedoms,
}

impl Baseline {
    /// The baseline of a run; `None`: its nominal channel, or a drawn one, does not ring.
    pub fn new(base: &Base) -> Option<Baseline> {
        let frame = Frame::of(base);
        let nominal = frame.freedom(base, &base.rates)?;
        // Derivatives of the freedoms by the seven numbers of `Conditions::shot`. The gain adds to ln A alone.
        let mut changes = vec![Freedom::from([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])];
        let (sine, cosine) = nominal[1].sin_cos();
        // A component of the state adds its own decay: resolve its amplitudes into changes of ln A, of phi
        // (which is perpendicular) and of kappa, which is relative to A.
        for y in base.components(NOMINAL_DRIVE_V) {
            let [a, b, c] = frame.amplitudes(&y, &nominal)?.map(|x| x / nominal[0].exp());
            let along = a * cosine + b * sine;
            let turned = b * cosine - a * sine;
            changes.push(Freedom::from([along, turned, c - nominal[2] * along, 0.0, 0.0, 0.0]));
        }
        // frequency and damping: differences of the freedoms over a small change of the rates
        let stiffer: fn(&InkChannel, f64) -> InkChannel =
            |c, f| InkChannel { a_per_s2: c.a_per_s2 * f * f, b_per_s2: c.b_per_s2 * f * f, ..*c };
        for change in [stiffer, at_viscosity] {
            let at = |factor| frame.freedom(base, &change(&base.rates, factor));
            changes.push((at(1.0 + 1e-3)? - at(1.0 - 1e-3)?) / 2e-3);
        }
        // the seven numbers are independent, so their covariances add up
        let mut covariance = Freedoms::zeros();
        for (change, sd) in changes.into_iter().zip(base.shot_sd()) {
            let change = change * sd;
            covariance += change * change.transpose();
        }
        Some(Baseline {
            frame,
            noise_var: base.physics.acquisition.noise_sd_counts.powi(2) + 1.0 / 12.0,
            nominal,
            covariance,
            precision: precision(base, &frame, &nominal)?,
        })
    }

    /// Returns v² J' W J, the information of one signal about its channel's freedoms, and the inner matrix of
    /// Woodbury's identity, M = S (1 + G S)^{-1} with G = v² J' J / s², so that the information is G - G M G.
    ///
    /// W = (s² + v² J S J')^{-1}: inverse covariance of the signal; J: derivatives of its decay at the
    /// nominal drive; s²: variance of the noise; S: covariance of the scatter from burst to burst; v:
    /// `drive`, relative to the nominal one; `gram`: J' J.
    fn weight(&self, gram: &Freedoms, drive: f64) -> (Freedoms, Freedoms) {
        let information = gram * (drive * drive / self.noise_var);
        let inner = (Freedoms::identity() + information * self.covariance).try_inverse();
        let inner = self.covariance * inner.unwrap_or_else(Freedoms::zeros);
        (information - information * inner * information, inner)
    }

    /// The information v² J' W J of a signal of the nominal channel at relative drive v.
    pub fn information(&self, drive: f64) -> Freedoms {
        let (_, j) = self.frame.decay(&self.nominal);
        self.weight(&gram(&j), drive).0
    }

    /// Chi-squared of the changes that is left after the baseline was refitted to the changed signals; 0 if it
    /// cannot be computed. `changes`: one per signal, those of a channel one after another. `moved`: how far
    /// the freedoms of each channel have moved from their own; the search begins and ends there.
    pub fn misfit(&self, changes: &[Change], moved: &mut Vec<Freedom>) -> f64 {
        let channels = changes.iter().map(|c| c.channel + 1).max().unwrap_or(0);
        moved.resize(channels, Freedom::zeros());
        let mut before = f64::INFINITY;
        for _ in 0..MOST_STEPS {
            let Some((total, next)) = self.step(changes, moved) else { return 0.0 };
            // Move each channel by a share of its step, such that no freedom moves farther than `LONGEST_STEP`.
            let mut rests = (before - total).abs() < 1e-4 * (1.0 + total);
            for (now, next) in moved.iter_mut().zip(next) {
                let step = next - *now;
                let longest = step.iter().zip(LONGEST_STEP).map(|(s, most)| s.abs() / most);
                let share = 1.0 / longest.fold(1.0, f64::max);
                rests &= share == 1.0;
                *now += step * share;
            }
            before = total;
            if rests {
                break;
            }
        }
        before
    }

    /// One step of Gauss-Newton: the chi-squared that would be left if the decays were linear in the freedoms
    /// about `moved`, and how far each channel would then have moved in all. `None`: a matrix is singular.
    fn step(&self, changes: &[Change], moved: &[Freedom]) -> Option<(f64, Vec<Freedom>)> {
        // per signal: add its chi-squared, and its information and score to those of its channel
        let n = moved.len();
        let (mut informations, mut scores) =
            (vec![Freedoms::zeros(); n], vec![Freedom::zeros(); n]);
        let mut total = 0.0;
        // channel, the decay's change so far, J and J' J at its present place, computed once per channel
        let mut at: Option<(usize, DVector<f64>, DMatrix<f64>, Freedoms)> = None;
        for change in changes {
            let by = &moved[change.channel];
            let now = change.own + by;
            if at.as_ref().is_none_or(|(channel, ..)| *channel != change.channel) {
                let (before, _) = self.frame.decay(change.own);
                let (y, j) = self.frame.decay(&now);
                let gram = gram(&j);
                at = Some((change.channel, y - before, j, gram));
            }
            let (_, followed, j, gram) = at.as_ref()?;
            // What the tangent at the present place has to explain: the change, less what the channel's move so
            // far has followed of it, plus what the tangent says of that move. So the solution is the whole
            // move from the channel's own freedoms.
            let r = &change.samples - (followed - j * by) * change.drive;
            let (information, inner) = self.weight(gram, change.drive);
            let score = Freedom::from_iterator(j.tr_mul(&r).iter().copied())
                * (change.drive / self.noise_var);
            total += r.norm_squared() / self.noise_var - score.dot(&(inner * score));
            informations[change.channel] += information;
            // v J' W r, with W = 1/s² - (v²/s⁴) J inner J'
            let raw = gram * (change.drive * change.drive / self.noise_var);
            scores[change.channel] += score - raw * (inner * score);
        }
        // Channels are drawn about a mean that is free, with the inverse covariance p. Given the mean, each
        // channel goes to (information + p)^{-1} (score + p mean). What is left is quadratic in the mean, with
        // matrix `q`, which holds the prior of the real pole's place, and right-hand side `r`.
        let p = &self.precision;
        let (mut q, mut r) = (Freedoms::zeros(), Freedom::zeros());
        q[(5, 5)] = POLE_SD.powi(-2);
        let mut inverses = Vec::with_capacity(n);
        for (information, score) in informations.iter().zip(&scores) {
            let inverse = (information + p).try_inverse()?;
            total -= score.dot(&(inverse * score));
            q += p - p * inverse * p;
            r += p * inverse * score;
            inverses.push(inverse);
        }
        let mean = q.try_inverse()? * r;
        total -= r.dot(&mean);
        let next = inverses.iter().zip(&scores).map(|(i, s)| i * (s + p * mean)).collect();
        total.is_finite().then_some((total, next))
    }
}

fn gram(j: &DMatrix<f64>) -> Freedoms {
    Freedoms::from_iterator(j.tr_mul(j).iter().copied())
}

/// Inverse covariance of the freedoms from healthy channel to healthy channel, about the nominal one, estimated
/// from `DRAWN` channels, the same in every run. `None`: one of them does not ring.
fn precision(base: &Base, frame: &Frame, nominal: &Freedom) -> Option<Freedoms> {
    let mut rng = stream(0, Purpose::Spread, part::HIDDEN);
    let mut covariance = Freedoms::identity() * 1e-12;
    for _ in 0..DRAWN {
        let made = base.draw(&mut rng);
        let mut off = frame.freedom(base, &made.rates)? - nominal;
        off[0] += made.gain.ln();
        covariance += off * off.transpose() / DRAWN as f64;
    }
    (covariance + Freedoms::from_diagonal(&covariance.diagonal()) * RIDGE).try_inverse()
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAME: Frame = Frame { samples: 64, period_s: 0.78125e-6, poles_per_s: [1.6e4, 8e4] };

    #[test]
    fn derivatives_are_those_of_the_decay() {
        let of = Freedom::from([4.5, -0.6, 0.03, 2.9e4_f64.ln(), 4.07e5_f64.ln(), -0.7]);
        let (_, j) = FRAME.decay(&of);
        for i in 0..6 {
            let mut h = Freedom::zeros();
            h[i] = 1e-6;
            let slope = (FRAME.decay(&(of + h)).0 - FRAME.decay(&(of - h)).0) / 2e-6;
            assert!((slope - j.column(i)).amax() < 1e-4 * (1.0 + j.column(i).amax()), "{i}");
        }
    }

    /// A decay that begins one sample later must be the same decay, moved by one sample.
    #[test]
    fn a_later_start_moves_the_freedoms_so() {
        let of = Freedom::from([4.5, -0.6, 0.03, 2.9e4_f64.ln(), 4.07e5_f64.ln(), -0.7]);
        let steps = 2000;
        let mut later = of;
        for _ in 0..steps {
            later += FRAME.later(&later) * (FRAME.period_s / f64::from(steps));
        }
        let (y, moved) = (FRAME.decay(&of).0, FRAME.decay(&later).0);
        for k in 0..63 {
            assert!((moved[k] - y[k + 1]).abs() < 1e-2, "{k}");
        }
    }
}
