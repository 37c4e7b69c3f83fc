//! The maximum-likelihood ring of one signal: its amplitude, damping, frequency, and its phase if
//! that is free. Detection's second look, isolation and model critique rest on this fit.
//!
//! In: a signal (N samples, counts), and the healthy [`Ring`] with which it is compared. Out:
//! [`Features`], log ratios to that ring, and the square misfit. The noise is taken to be white, so
//! the fit is least squares of y on a p + b q: p is the in-phase column of the ring (the damped
//! pair, plus the real pole's part), q its quadrature column (the pair a quarter turn ahead). a and
//! b enter linearly and are eliminated (variable projection, Golub and Pereyra 1973); amplitude and
//! phase are those of a + i b. The search over damping and frequency:
//!
//! 1. A coarse search over a grid (`ring_grid`), unless the caller knows a start.
//! 2. A few damped Gauss-Newton steps (`ring_gauss_newton`, whose sums are in `ring_gram`).
//!
//! The real pole's rate and its share of the in-phase amplitude are held at the healthy ring's,
//! since one signal does not determine them.

use super::inner_product::dot;
use super::ring::Ring;
use super::ring_gauss_newton::{Optimum, Progress, Search, Start, WIDTH};
use super::ring_gram::Frame;
use super::ring_grid::Grid;
use crate::processor::for_processor;
use nalgebra::{DMatrix, Matrix4, Vector4};
use std::sync::OnceLock;

/// A ring relative to the healthy one: ln (A/A0), ln (sigma/sigma0), ln (f/f0), and phi - phi0, rad
/// (where the phase is not free it is 0, or pi if the signal is upside down).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Features {
    pub ln_amplitude: f64,
    pub ln_damping: f64,
    pub ln_frequency: f64,
    pub phase_rad: f64,
}

impl Features {
    pub const HEALTHY: Features =
        Features { ln_amplitude: 0.0, ln_damping: 0.0, ln_frequency: 0.0, phase_rad: 0.0 };

    pub fn coordinates(&self) -> Vector4<f64> {
        Vector4::new(self.ln_amplitude, self.ln_damping, self.ln_frequency, self.phase_rad)
    }

    /// A start for a fit, clamped to the range for which Gauss-Newton is good.
    fn start(&self) -> [f64; 2] {
        [self.ln_damping.clamp(-3.0, 2.0), self.ln_frequency.clamp(-0.9, 0.5)]
    }
}

impl From<Vector4<f64>> for Features {
    fn from(x: Vector4<f64>) -> Features {
        let [ln_amplitude, ln_damping, ln_frequency, phase_rad] = x.into();
        Features { ln_amplitude, ln_damping, ln_frequency, phase_rad }
    }
}

#[derive(Clone, Copy, Debug)]
pub struct Fit {
    pub features: Features,
    /// Square norm of what the fit leaves, ||y - fit||^2, counts².
    pub misfit: f64,
    /// Square norm of the signal, ||y||^2, counts².
    pub square: f64,
}

#[derive(Clone, Debug)]
pub struct RingFitter {
    pub ring: Ring,
    pub dt_s: f64,
    pub samples: usize,
    /// The real pole's part of the in-phase column, per unit amplitude, N.
    real: Vec<f64>,
    frame: Frame,
    grid: OnceLock<Grid>,
}

#[derive(Clone, Debug, Default)]
pub struct FitBuffers {
    decimated: Vec<f32>,
    /// The signals that are being fitted: N samples, each of all lanes.
    interleaved: Vec<[f64; WIDTH]>,
    signal: Vec<f64>,
}

impl RingFitter {
    pub fn new(ring: Ring, dt_s: f64, samples: usize) -> RingFitter {
        let real: Vec<f64> = (0..samples)
            .map(|k| ring.real_share * (-ring.lambda_per_s * k as f64 * dt_s).exp())
            .collect();
        let lambda_dt = ring.lambda_per_s * dt_s;
        let frame = Frame {
            samples,
            sigma_dt: ring.damping_per_s * dt_s,
            omega_dt: 2.0 * std::f64::consts::PI * ring.frequency_hz * dt_s,
            first: (ring.phase_rad.cos(), ring.phase_rad.sin()),
            real_share: ring.real_share,
            real_ratio: (-lambda_dt).exp(),
            real_over_all: (-lambda_dt * samples as f64).exp(),
            real_square: dot(&real, &real),
        };
        RingFitter { ring, dt_s, samples, real, frame, grid: OnceLock::new() }
    }

    fn grid(&self) -> &Grid {
        let columns = |damping, frequency| self.columns(damping, frequency);
        self.grid.get_or_init(|| Grid::new(self.frame.omega_dt, self.samples, columns))
    }

    /// The columns p and q, N each, per unit amplitude, of a ring whose damping and frequency are
    /// these multiples of the healthy ring's.
    fn columns(&self, damping: f64, frequency: f64) -> [Vec<f64>; 2] {
        let decay = (-self.frame.sigma_dt * damping).exp();
        let (sin, cos) = (self.frame.omega_dt * frequency).sin_cos();
        let mut columns = [vec![0.0; self.samples], vec![0.0; self.samples]];
        fill_columns(&self.real, self.frame.first, (decay * cos, decay * sin), &mut columns);
        columns
    }

    /// `y`: N counts; `phase`: whether it is free, or held at the healthy ring's. `None`: `y` is
    /// zero or not finite, or the search came to a place without a Gauss-Newton step.
    pub fn fit(&self, y: &[f64], phase: bool, work: &mut FitBuffers) -> Option<Fit> {
        self.refine(y, self.grid().search(y, &mut work.decimated)?, phase)
    }

    /// Fits one signal as [`RingFitter::fit`] does, but starts from the ring `near`.
    pub fn fit_from(&self, y: &[f64], near: &Features, phase: bool) -> Option<Fit> {
        self.refine(y, near.start(), phase)
    }

    fn refine(&self, y: &[f64], start: [f64; 2], phase: bool) -> Option<Fit> {
        let start = self.start_of(y, start)?;
        let mut search = Search::<1>::new(self.frame, phase);
        search.begin(0, start);
        loop {
            match search.iterate(y.as_chunks::<1>().0) {
                [Progress::Continue(())] => {}
                [Progress::Break(optimum)] => return self.fit_of(optimum?, start.square),
            }
        }
    }

    fn start_of(&self, y: &[f64], trial: [f64; 2]) -> Option<Start> {
        let (square, along_real) = (dot(y, y), dot(y, &self.real));
        (square > 0.0 && square.is_finite()).then_some(Start { trial, square, along_real })
    }

    fn fit_of(&self, optimum: Optimum, square: f64) -> Option<Fit> {
        let Optimum { trial: [ln_damping, ln_frequency], a, b, misfit } = optimum;
        let features = Features {
            ln_amplitude: 0.5 * ((a * a + b * b) / self.ring.amplitude.powi(2)).ln(),
            ln_damping,
            ln_frequency,
            phase_rad: b.atan2(a),
        };
        let finite = features.coordinates().iter().all(|v| v.is_finite());
        finite.then_some(Fit { features, misfit, square })
    }

    /// Fits many signals, sixteen side by side, each with the bits that [`RingFitter::fit`] or
    /// [`RingFitter::fit_from`] would give. A lane whose fit has ended takes the next signal.
    ///
    /// `starts`: per signal the ring to start from; `None`: the coarse search. `signal` writes the
    /// signal of that index, N counts; it is asked for each once, in their order.
    pub fn fit_all(
        &self,
        phase: bool,
        work: &mut FitBuffers,
        starts: &[Option<Features>],
        mut signal: impl FnMut(usize, &mut [f64]),
    ) -> Vec<Option<Fit>> {
        let mut fits = vec![None; starts.len()];
        let mut interleaved = std::mem::take(&mut work.interleaved);
        let mut y = std::mem::take(&mut work.signal);
        interleaved.resize(self.samples, [0.0; WIDTH]);
        y.resize(self.samples, 0.0);
        let mut search = Search::<WIDTH>::new(self.frame, phase);
        let mut squares = [0.0; WIDTH];
        let mut of_lane: [Option<usize>; WIDTH] = [None; WIDTH];
        let mut waiting = starts.iter().enumerate();
        loop {
            for lane in 0..WIDTH {
                while of_lane[lane].is_none()
                    && let Some((number, near)) = waiting.next()
                {
                    signal(number, &mut y);
                    let start = match near {
                        Some(near) => Some(near.start()),
                        None => self.grid().search(&y, &mut work.decimated),
                    };
                    // what cannot be started keeps no fit
                    if let Some(start) = start.and_then(|start| self.start_of(&y, start)) {
                        interleaved.iter_mut().zip(&y).for_each(|(all, y)| all[lane] = *y);
                        search.begin(lane, start);
                        squares[lane] = start.square;
                        of_lane[lane] = Some(number);
                    }
                }
            }
            if of_lane.iter().all(Option::is_none) {
                break;
            }

            for (lane, progress) in search.iterate(&interleaved).into_iter().enumerate() {
                if let (Progress::Break(optimum), Some(number)) = (progress, of_lane[lane]) {
                    fits[number] = optimum.and_then(|of| self.fit_of(of, squares[lane]));
                    of_lane[lane] = None;
                }
            }
        }
        (work.interleaved, work.signal) = (interleaved, y);
        fits
    }

    /// dy/d(ln A, ln sigma, ln f, phi) of this ring, N x 4, counts; column 0 is the ring itself.
    pub fn tangent(&self, at: &Features) -> DMatrix<f64> {
        let (damping, frequency) = (at.ln_damping.exp(), at.ln_frequency.exp());

        let [in_phase, quadrature] = self.columns(damping, frequency);
        let amplitude = self.ring.amplitude * at.ln_amplitude.exp();
        let (sin, cos) = at.phase_rad.sin_cos();
        let (a, b) = (amplitude * cos, amplitude * sin);
        let sigma_dt = self.ring.damping_per_s * damping * self.dt_s;
        let omega_dt = self.frame.omega_dt * frequency;

        let n = self.samples;
        let mut tangent = DMatrix::zeros(n, 4);
        let (ring, rest) = tangent.as_mut_slice().split_at_mut(n);
        let (by_damping, rest) = rest.split_at_mut(n);
        let (by_frequency, by_phase) = rest.split_at_mut(n);
        let (in_phase, quadrature, real) = (&in_phase[..n], &quadrature[..n], &self.real[..n]);
        for k in 0..n {
            let (p, q, t) = (in_phase[k], quadrature[k], k as f64);
            // damping and frequency move the damped pair only, not the real pole's part
            let pair = p - real[k];
            ring[k] = a * p + b * q;
            by_damping[k] = -sigma_dt * t * (a * pair + b * q);
            by_frequency[k] = omega_dt * t * (a * q - b * pair);
            by_phase[k] = a * q - b * p;
        }
        tangent
    }

    /// Resonance, Hz, and damping, 1/s, of a ring with these features, as verdicts state them.
    pub fn frequency_and_damping(&self, of: &Features) -> [f64; 2] {
        let Ring { frequency_hz, damping_per_s, .. } = self.ring;
        [frequency_hz * of.ln_frequency.exp(), damping_per_s * of.ln_damping.exp()]
    }

    /// Features to first order. `deviation`: the signal less the healthy ring, N, counts. `None`:
    /// the sensitivities are linearly dependent.
    pub fn features_of(&self, deviation: &[f64]) -> Option<Vector4<f64>> {
        let tangent = self.tangent(&Features::HEALTHY);
        let gram = (tangent.transpose() * &tangent).try_inverse()?;
        let x = gram * tangent.transpose() * nalgebra::DVector::from_row_slice(deviation);
        Some(Vector4::from_fn(|k, _| x[k]))
    }

    /// Covariance of a fit's features due to noise (Cramer-Rao), the phase free: noise² (J'J)^-1
    /// with the sensitivities J at the ring `at`. `noise`: standard deviation, counts.
    pub fn noise_covariance(&self, at: &Features, noise: f64) -> Option<Matrix4<f64>> {
        let tangent = self.tangent(at);
        let covariance = (tangent.transpose() * &tangent).try_inverse()? * (noise * noise);
        Some(covariance.fixed_view::<4, 4>(0, 0).into())
    }
}

const AT_ONCE: usize = 8;

for_processor! {
    /// Fills the columns p and q by recurrence: p_k + i (-q_k) is e^{i phi} z^k, plus `real`, the
    /// real pole's part, N. `first`: cosine and sine of phi; `step`: z = e^{(-sigma + i omega) dt}.
    fn fill_columns(
        real: &[f64],
        first: (f64, f64),
        step: (f64, f64),
        columns: &mut [Vec<f64>; 2],
    ) { columns_at_once }
}

#[inline(always)] // compiled once per instruction set
fn columns_at_once(real: &[f64], first: (f64, f64), step: (f64, f64), columns: &mut [Vec<f64>; 2]) {
    let times = |(a, b): (f64, f64), (c, d): (f64, f64)| (a * c - b * d, a * d + b * c);

    // The first eight samples one by one; then the eight advance together, eight samples at a time.
    let (mut re, mut im) = ([first.0; AT_ONCE], [first.1; AT_ONCE]);
    for k in 1..AT_ONCE {
        (re[k], im[k]) = times((re[k - 1], im[k - 1]), step);
    }
    let (c, s) = (0..AT_ONCE.ilog2()).fold(step, |step, _| times(step, step));

    let [in_phase, quadrature] = columns;
    let parts = in_phase.chunks_mut(AT_ONCE).zip(quadrature.chunks_mut(AT_ONCE));
    for ((p, q), real) in parts.zip(real.chunks(AT_ONCE)) {
        for (k, real) in real.iter().enumerate() {
            (p[k], q[k]) = (re[k] + real, -im[k]);
        }
        for k in 0..AT_ONCE {
            (re[k], im[k]) = (c * re[k] - s * im[k], s * re[k] + c * im[k]);
        }
    }
}

#[cfg(test)]
mod tests;
