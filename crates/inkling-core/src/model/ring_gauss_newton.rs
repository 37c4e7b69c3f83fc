//! Gauss-Newton on the misfit of a ring, for several signals at once: one signal in each SIMD lane.
//!
//! In: signals, interleaved sample by sample, each with a start. Out: damping, frequency and
//! amplitudes of the least misfit, for `ring_fit`, which also gives a lane whose fit has ended the
//! next signal. A *trial* is a pair (ln damping, ln frequency), relative to the healthy ring. One
//! iteration, for all lanes together:
//!
//! 1. Evaluate each lane's trial (`portable`): the sums over samples (`ring_gram`), then
//!    (`evaluate_one`) the best amplitudes a, b of the columns p, q, their misfit, and the
//!    Gauss-Newton step. The amplitudes enter linearly and are eliminated (variable projection).
//! 2. A trial whose misfit is not higher is accepted (`Lane::advance`), and its own step leads to the
//!    next trial. Otherwise the step that led to it is shortened to a quarter.
//!
//! A lane's arithmetic depends neither on the other lanes nor on the processor: no multiplication
//! is fused with an addition.

use super::ring_gram::{Complex, Frame, NormalEquations, goertzel, normal_equations, powers};
use super::simd_math::{exp, sin_cos};
use crate::processor::for_processor;
use std::ops::ControlFlow;

pub const WIDTH: usize = 16;
/// Number of accepted trials, the start included, after which a fit ends, converged or not.
const MOST_TRIALS: u8 = 13;
/// A misfit that rises by no more than this share of ||y||² is rounding, and counts as not risen.
const ROUNDING: f64 = 1e-13;
/// A fit has converged if the step would lower the misfit by less than this share of the noise
/// variance (misfit / N): the step is below a hundredth of the fit's standard deviation.
const NO_GAIN: f64 = 1e-4;
/// The last step is applied to first order, without another evaluation, if it changes both the
/// phase at the signal's end, rad, and ln damping by less than this.
const SMALL: f64 = 0.05;
/// Bounds on one step of ln damping and of ln frequency.
const MOST_DAMPING: f64 = 0.7;
const MOST_FREQUENCY: f64 = 0.06;
/// Bound on |ln damping| and |ln frequency|.
const FARTHEST: f64 = 30.0;
/// Number of steps rejected one after the other after which a fit ends.
const REJECTIONS: u8 = 4;

#[derive(Clone, Copy, Debug)]
pub struct Start {
    pub trial: [f64; 2],
    /// ||y||², counts².
    pub square: f64,
    /// Inner product of y with the real pole's part of a ring of unit amplitude, counts.
    pub along_real: f64,
}

#[derive(Clone, Copy, Debug)]
pub struct Optimum {
    pub trial: [f64; 2],
    /// Amplitudes of the columns p and q, counts; b is 0 where the phase is held.
    pub a: f64,
    pub b: f64,
    pub misfit: f64,
}

#[derive(Clone, Copy, Debug, Default)]
struct Evaluation {
    a: f64,
    b: f64,
    misfit: f64,
    step: Step,
}

#[derive(Clone, Copy, Debug, Default)]
struct Step {
    damping: f64,
    frequency: f64,
    /// Change of the amplitudes that goes with the step, counts.
    a: f64,
    b: f64,
    /// By how much the step would lower the misfit if the ring were linear in the trial, counts²;
    /// NaN: there is no step.
    gain: f64,
}

#[derive(Clone, Copy, Debug, Default)]
struct Lane {
    trial: [f64; 2],
    accepted: Evaluation,
    /// Share of the accepted evaluation's step that is tried next: 1, or less after rejections.
    trust: f64,
    /// Accepted trials so far, the start included, and rejections since the last of them.
    accepted_trials: u8,
    rejections: u8,
}

/// `Break`: a lane's fit has ended, with `None` if the signal is no ring.
pub type Progress = ControlFlow<Option<Optimum>>;

#[derive(Clone, Debug)]
pub struct Search<const W: usize> {
    frame: Frame,
    phase: bool,
    lanes: [Option<Lane>; W],
    trial: [[f64; W]; 2],
    square: [f64; W],
    along_real: [f64; W],
}

impl<const W: usize> Search<W> {
    pub fn new(frame: Frame, phase: bool) -> Search<W> {
        let zero = [0.0; W];
        Search { frame, phase, lanes: [None; W], trial: [zero; 2], square: zero, along_real: zero }
    }

    /// From now on the caller gives the signal's samples in that lane to `iterate`.
    pub fn begin(&mut self, lane: usize, start: Start) {
        let Start { trial, square, along_real } = start;
        self.lanes[lane] = Some(Lane { trust: 1.0, ..Lane::default() });
        [self.trial[0][lane], self.trial[1][lane]] = trial;
        (self.square[lane], self.along_real[lane]) = (square, along_real);
    }

    /// `y`: N samples, each of all lanes, counts. A lane whose fit has ended is free afterwards.
    pub fn iterate(&mut self, y: &[[f64; W]]) -> [Progress; W] {
        // a single signal gains nothing from vector instructions
        let evaluations = if W == 1 { portable(self, y) } else { evaluate_lanes(self, y) };
        let mut progress = [Progress::Continue(()); W];
        for (l, progress) in progress.iter_mut().enumerate() {
            let Some(lane) = &mut self.lanes[l] else { continue };
            let trial = [self.trial[0][l], self.trial[1][l]];
            match lane.advance(trial, &evaluations[l], &self.frame, ROUNDING * self.square[l]) {
                Ok(next) => [self.trial[0][l], self.trial[1][l]] = next,
                Err(optimum) => {
                    *progress = Progress::Break(optimum);
                    self.lanes[l] = None;
                }
            }
        }
        progress
    }
}

for_processor! {
    fn evaluate_lanes<const W: usize>(of: &Search<W>, y: &[[f64; W]]) -> [Evaluation; W] { portable }
}

impl Lane {
    /// Accepts or rejects a trial. `Ok`: the next trial. `Err`: the fit has ended, with `None` if
    /// the signal is no ring. `rounding`: by how much a misfit may rise, counts².
    fn advance(
        &mut self,
        trial: [f64; 2],
        evaluation: &Evaluation,
        frame: &Frame,
        rounding: f64,
    ) -> Result<[f64; 2], Option<Optimum>> {
        let Evaluation { a, b, misfit, step } = *evaluation;
        let finite = misfit.is_finite() && a.is_finite() && b.is_finite();

        let is_start = self.accepted_trials == 0;
        if finite && (is_start || misfit <= self.accepted.misfit + rounding) {
            (self.trial, self.accepted) = (trial, *evaluation);
            (self.trust, self.rejections) = (1.0, 0);
            self.accepted_trials += 1;
            if self.accepted_trials == MOST_TRIALS {
                return Err(self.optimum(&Step::default()));
            }
            // a place without a step: what is there is no ring
            if !step.gain.is_finite() {
                return Err(None);
            }
            let samples = frame.samples as f64;
            if step.gain * samples <= NO_GAIN * misfit + rounding {
                let phase = frame.omega_dt * exp(trial[1]) * step.frequency * samples;
                let small = phase.abs() < SMALL && step.damping.abs() < SMALL;
                return Err(self.optimum(&if small { step } else { Step::default() }));
            }
        } else {
            self.trust /= 4.0;
            self.rejections += 1;
            if is_start {
                return Err(None);
            }
            if self.rejections == REJECTIONS {
                return Err(self.optimum(&Step::default()));
            }
        }

        let (step, trust) = (&self.accepted.step, self.trust);
        let next = [
            self.trial[0] + (trust * step.damping).clamp(-MOST_DAMPING, MOST_DAMPING),
            self.trial[1] + (trust * step.frequency).clamp(-MOST_FREQUENCY, MOST_FREQUENCY),
        ];
        Ok(next.map(|x| x.clamp(-FARTHEST, FARTHEST)))
    }

    /// The end of the fit: the trial that was accepted last, moved by `last` to first order.
    fn optimum(&self, last: &Step) -> Option<Optimum> {
        Some(Optimum {
            trial: [self.trial[0] + last.damping, self.trial[1] + last.frequency],
            a: self.accepted.a + last.a,
            b: self.accepted.b + last.b,
            misfit: (self.accepted.misfit - last.gain).max(0.0),
        })
    }
}

#[inline(always)] // compiled once per instruction set
fn portable<const W: usize>(of: &Search<W>, y: &[[f64; W]]) -> [Evaluation; W] {
    let frame = &of.frame;
    // the trials' pole e^{(-sigma + i omega) dt}, and the coefficients of its recurrence
    let (mut sigma, mut omega) = ([0.0; W], [0.0; W]);
    let (mut re, mut im) = ([0.0; W], [0.0; W]);
    let (mut twice, mut square) = ([0.0; W], [0.0; W]);
    for l in 0..W {
        sigma[l] = frame.sigma_dt * exp(of.trial[0][l]);
        omega[l] = frame.omega_dt * exp(of.trial[1][l]);
        let decay = exp(-sigma[l].min(700.0));
        let (sin, cos) = sin_cos(omega[l]);
        (re[l], im[l]) = (decay * cos, decay * sin);
        (twice[l], square[l]) = (2.0 * re[l], decay * decay);
    }

    let of_signal = goertzel(y, &twice, &square);
    let of_pole = powers(frame.samples, [&re, &im], &square);

    // number by number, so that the compiler turns this loop, too, into vector code
    let mut out = [[0.0; W]; 8];
    for l in 0..W {
        let pole = Complex { re: re[l], im: im[l] };
        let (of_pole, of_signal) = (of_pole.of_lane(l), of_signal.of_lane(l));
        let sums = normal_equations(frame, pole, of_pole, of_signal, of.along_real[l]);
        let Evaluation { a, b, misfit, step } =
            evaluate_one(of.phase, [sigma[l], omega[l]], &sums, of.square[l]);
        let Step { damping, frequency, a: of_a, b: of_b, gain } = step;
        let all = [a, b, misfit, damping, frequency, of_a, of_b, gain];
        for j in 0..8 {
            out[j][l] = all[j];
        }
    }
    std::array::from_fn(|l| {
        let [a, b, misfit, damping, frequency, of_a, of_b, gain] =
            std::array::from_fn(|j| out[j][l]);
        Evaluation { a, b, misfit, step: Step { damping, frequency, a: of_a, b: of_b, gain } }
    })
}

/// The best amplitudes, and the Gauss-Newton step with these eliminated. `phase`: whether it is
/// free; `pole`: sigma dt and omega dt of the trial; `yy`: ||y||².
#[inline(always)] // compiled once per instruction set
fn evaluate_one(phase: bool, pole: [f64; 2], sums: &NormalEquations, yy: f64) -> Evaluation {
    let [sigma_dt, omega_dt] = pole;
    let [pp, qp, qq, xp, xq, xx, vp, vq, vx, vv] = sums.gram;
    let [up, uq, ux, uv] = sums.slope;

    // Amplitudes by least squares: the inverse of the Gram matrix of p and q has ip, iq on the
    // diagonal and ic beside it. With the phase held there is no column q.
    let [of_p, of_q, cross] = if phase { [qq, pp, -qp] } else { [1.0, 0.0, 0.0] };
    let inverse = 1.0 / (of_p * pp + cross * qp);
    let [ip, iq, ic] = [of_p * inverse, of_q * inverse, cross * inverse];
    let (a, b) = (ip * up + ic * uq, iq * uq + ic * up);
    let misfit = yy - a * up - b * uq;
    let misfit = if misfit < 0.0 { 0.0 } else { misfit }; // NaN stays

    // inner products of x and v with what the amplitudes leave of the signal
    let (rx, rv) = (ux - a * xp - b * xq, uv - a * vp - b * vq);
    // The sensitivities are combinations of x and v: dy/d(ln sigma) = -sigma t (a p' + b q),
    // dy/d(ln omega) = omega t (a q - b p'), where p' is p without the real pole's part.
    let of = |x: f64, v: f64| [-sigma_dt * (a * x + b * v), omega_dt * (a * v - b * x)];
    let (along_p, along_q, slopes) = (of(xp, vp), of(xq, vq), of(rx, rv));
    let (by_x, by_v) = (of(xx, vx), of(vx, vv));
    let (damping_row, frequency_row) = (of(by_x[0], by_v[0]), of(by_x[1], by_v[1]));

    // The part that p (and q) span is taken out, since the amplitudes are refitted after the step:
    // h is the Schur complement, [0,0], [0,1] and [1,1] of the 2 x 2 matrix.
    let shared = |i: usize, j: usize| {
        ip * along_p[i] * along_p[j]
            + iq * along_q[i] * along_q[j]
            + ic * (along_p[i] * along_q[j] + along_q[i] * along_p[j])
    };
    let h = [
        damping_row[0] - shared(0, 0),
        frequency_row[0] - shared(0, 1),
        frequency_row[1] - shared(1, 1),
    ];

    let det = h[0] * h[2] - h[1] * h[1];
    let by = 1.0 / det;
    let damping = (h[2] * slopes[0] - h[1] * slopes[1]) * by;
    let frequency = (h[0] * slopes[1] - h[1] * slopes[0]) * by;

    // the change of the amplitudes, and the gain; no step where the matrix is not positive definite
    let of_p = along_p[0] * damping + along_p[1] * frequency;
    let of_q = along_q[0] * damping + along_q[1] * frequency;
    let gain = damping * slopes[0] + frequency * slopes[1];
    let gain = if (h[0] > 0.0) & (det > 0.0) { gain } else { f64::NAN };
    let step =
        Step { damping, frequency, a: -(ip * of_p + ic * of_q), b: -(iq * of_q + ic * of_p), gain };
    Evaluation { a, b, misfit, step }
}
