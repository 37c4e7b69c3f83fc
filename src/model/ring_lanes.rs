//! Ring fits of several signals side by side, one signal a lane.
//!
//! In: signals, sample by sample, with a start each. Out: damping and frequency of the least misfit,
//! found by damped Gauss-Newton steps, one evaluation of every lane at a time; a lane that has ended
//! takes the next signal, so that none waits for another. Amplitude (and phase) enter linearly and
//! are eliminated (variable projection).
//!
//! What a look rests on stands in [`super::ring_sums`]. A lane's arithmetic does not depend on the
//! other lanes, nor on the processor: nothing fuses.

use super::lane_math::{exp, sin_cos};
use super::ring_sums::{Complex, Frame, Powers, Sums, goertzel, powers, sums};
use crate::processor::for_processor;

/// Signals side by side.
pub const SIDE: usize = 16;
const STEPS: u8 = 12;
/// A rise of the misfit by this share of the signal's square norm is rounding.
const ROUNDING: f64 = 1e-13;
/// A step that gains less than this share of the noise's square, as the misfit tells it, is none: it
/// is shorter than a hundredth of the fit's own standard deviation, and is taken to first order.
const NO_GAIN: f64 = 1e-4;
/// First order will do where the last step changes the phase at the end, rad, and ln damping by less.
const SMALL: f64 = 0.05;
/// ln of the largest change of damping and of frequency in one step.
const MOST_DAMPING: f64 = 0.7;
const MOST_FREQUENCY: f64 = 0.06;
/// ln damping and ln frequency are no further from 0.
const FARTHEST: f64 = 30.0;
const REJECTIONS: u8 = 4;

/// A signal's start, and its sums.
#[derive(Clone, Copy, Debug)]
pub struct Start {
    pub ln_damping: f64,
    pub ln_frequency: f64,
    /// ||y||².
    pub square: f64,
    /// Product with the real pole's part.
    pub along_real: f64,
}

/// Where a fit ended.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    pub ln_damping: f64,
    pub ln_frequency: f64,
    /// In-phase and quadrature amplitudes, counts.
    pub a: f64,
    pub b: f64,
    pub misfit: f64,
}

/// The best amplitudes of a trial, and the step from there.
#[derive(Clone, Copy, Debug, Default)]
struct Look {
    a: f64,
    b: f64,
    misfit: f64,
    step: Step,
}

#[derive(Clone, Copy, Debug, Default)]
struct Step {
    damping: f64,
    frequency: f64,
    /// What it changes of the in-phase and quadrature amplitudes, counts.
    a: f64,
    b: f64,
    /// By how much the misfit would fall, counts²; NaN: there is no step.
    gain: f64,
    /// By how much the phase changes from sample to sample, rad.
    turn: f64,
}

/// One lane's way down.
#[derive(Clone, Copy, Debug)]
struct Lane {
    start: Start,
    /// Of the look last accepted.
    ln_damping: f64,
    ln_frequency: f64,
    look: Look,
    trust: f64,
    steps: u8,
    rejections: u8,
    begun: bool,
}

/// What came of a look.
#[derive(Clone, Copy, Debug)]
pub enum Turn {
    GoesOn,
    /// `None`: no ring.
    Ended(Option<Place>),
}

#[derive(Clone, Debug)]
pub struct Search<const W: usize> {
    frame: Frame,
    /// The phase is free.
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

    /// A signal takes a lane; its samples are to stand in the lane of `look`'s.
    pub fn begin(&mut self, lane: usize, start: Start) {
        let Start { ln_damping, ln_frequency, square, along_real } = start;
        let (look, trust) = (Look::default(), 1.0);
        let (steps, rejections, begun) = (0, 0, false);
        let new = Lane { start, ln_damping, ln_frequency, look, trust, steps, rejections, begun };
        self.lanes[lane] = Some(new);
        (self.trial[0][lane], self.trial[1][lane]) = (ln_damping, ln_frequency);
        (self.square[lane], self.along_real[lane]) = (square, along_real);
    }

    /// One look of every lane. `y`: sample by sample, lane by lane.
    pub fn look(&mut self, y: &[[f64; W]]) -> [Turn; W] {
        let looks = self.looks(y);
        let mut turns = [Turn::GoesOn; W];
        for (l, turn) in turns.iter_mut().enumerate() {
            let Some(lane) = &mut self.lanes[l] else { continue };
            let trial = [self.trial[0][l], self.trial[1][l]];
            match lane.take(trial, &looks[l], &self.frame) {
                Ok(next) => (self.trial[0][l], self.trial[1][l]) = (next[0], next[1]),
                Err(place) => {
                    *turn = Turn::Ended(place);
                    self.lanes[l] = None;
                }
            }
        }
        turns
    }

    fn looks(&self, y: &[[f64; W]]) -> [Look; W] {
        // one alone is no vector
        if W == 1 { portable(self, y) } else { looks(self, y) }
    }
}

for_processor! {
    fn looks<const W: usize>(of: &Search<W>, y: &[[f64; W]]) -> [Look; W] { portable }
}

impl Lane {
    /// What to try next, or where it ended.
    fn take(
        &mut self,
        trial: [f64; 2],
        look: &Look,
        frame: &Frame,
    ) -> Result<[f64; 2], Option<Place>> {
        let rounding = ROUNDING * self.start.square;
        let finite = look.misfit.is_finite() && look.a.is_finite() && look.b.is_finite();
        if finite && (!self.begun || look.misfit <= self.look.misfit + rounding) {
            self.steps += u8::from(self.begun);
            [self.ln_damping, self.ln_frequency] = trial;
            (self.look, self.begun) = (*look, true);
            (self.trust, self.rejections) = (1.0, 0);
            let step = look.step;
            if self.steps == STEPS {
                return Err(self.place(&Step::default()));
            }
            if !step.gain.is_finite() {
                return Err(None);
            }
            let samples = frame.samples as f64;
            if step.gain * samples <= NO_GAIN * look.misfit + rounding {
                let turn = step.turn * samples;
                let small = turn.abs() < SMALL && step.damping.abs() < SMALL;
                return Err(self.place(&if small { step } else { Step::default() }));
            }
        } else {
            self.trust /= 4.0;
            self.rejections += 1;
            if !self.begun {
                return Err(None);
            }
            if self.rejections == REJECTIONS {
                return Err(self.place(&Step::default()));
            }
        }
        let (step, trust) = (&self.look.step, self.trust);
        let next = [
            self.ln_damping + (trust * step.damping).clamp(-MOST_DAMPING, MOST_DAMPING),
            self.ln_frequency + (trust * step.frequency).clamp(-MOST_FREQUENCY, MOST_FREQUENCY),
        ];
        Ok(next.map(|x| x.clamp(-FARTHEST, FARTHEST)))
    }

    fn place(&self, last: &Step) -> Option<Place> {
        let place = Place {
            ln_damping: self.ln_damping + last.damping,
            ln_frequency: self.ln_frequency + last.frequency,
            a: self.look.a + last.a,
            b: self.look.b + last.b,
            misfit: (self.look.misfit - last.gain).max(0.0),
        };
        Some(place)
    }
}

#[inline(always)] // compiled once per instruction set
fn portable<const W: usize>(of: &Search<W>, y: &[[f64; W]]) -> [Look; W] {
    let frame = &of.frame;
    // per sample: decay and turn of the trials
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
    let recurrence = goertzel(y, &twice, &square);
    let (over_all, squares) = powers(frame.samples, [&re, &im], &square);
    let mut out = [[0.0; W]; 9];
    for l in 0..W {
        let z = Complex { re: re[l], im: im[l] };
        let of_signal = std::array::from_fn(|j| recurrence[j][l]);
        let over_all = Complex { re: over_all[0][l], im: over_all[1][l] };
        let powers = Powers { over_all, squares: std::array::from_fn(|j| squares[j][l]) };
        let sums = sums(frame, z, powers, of_signal, of.along_real[l]);
        let look = seen(of.phase, sigma[l], omega[l], &sums, of.square[l]);
        let Look { a, b, misfit, step } = look;
        let all =
            [a, b, misfit, step.damping, step.frequency, step.a, step.b, step.gain, step.turn];
        for j in 0..9 {
            out[j][l] = all[j];
        }
    }
    std::array::from_fn(|l| {
        let [a, b, misfit, damping, frequency, of_a, of_b, gain, turn] =
            std::array::from_fn(|j| out[j][l]);
        Look { a, b, misfit, step: Step { damping, frequency, a: of_a, b: of_b, gain, turn } }
    })
}

/// The best amplitude (and phase) there, and the Gauss-Newton step of (ln damping, ln frequency) with
/// these eliminated. `sigma_dt`, `omega_dt`: of the trial; `yy`: the signal's square norm.
#[inline(always)] // compiled once per instruction set
fn seen(phase: bool, sigma_dt: f64, omega_dt: f64, sums: &Sums, yy: f64) -> Look {
    let [pp, qp, qq, xp, xq, xx, zp, zq, zx, zz] = sums.gram;
    let [up, uq, ux, uz] = sums.slope;
    // inverse of the columns' Gram matrix; with the phase held there is no second column
    let [of_p, of_q, cross] = if phase { [qq, pp, -qp] } else { [1.0, 0.0, 0.0] };
    let inverse = 1.0 / (of_p * pp + cross * qp);
    let [ip, iq, ic] = [of_p * inverse, of_q * inverse, cross * inverse];
    let (a, b) = (ip * up + ic * uq, iq * uq + ic * up);
    let misfit = yy - a * up - b * uq;
    let misfit = if misfit < 0.0 { 0.0 } else { misfit }; // NaN stays
    // products of the misfit with x and z
    let (rx, rz) = (ux - a * xp - b * xq, uz - a * zp - b * zq);
    // dy/d(ln sigma) = -sigma t (a p' + b q), dy/d(ln omega) = omega t (a q - b p')
    let of = |x: f64, z: f64| [-sigma_dt * (a * x + b * z), omega_dt * (a * z - b * x)];
    let (along_p, along_q, slopes) = (of(xp, zp), of(xq, zq), of(rx, rz));
    let (by_x, by_z) = (of(xx, zx), of(zx, zz));
    let (damping_row, frequency_row) = (of(by_x[0], by_z[0]), of(by_x[1], by_z[1]));
    // what p (and q) can do themselves is theirs
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
    let of_p = along_p[0] * damping + along_p[1] * frequency;
    let of_q = along_q[0] * damping + along_q[1] * frequency;
    let gain = damping * slopes[0] + frequency * slopes[1];
    let gain = if (h[0] > 0.0) & (det > 0.0) { gain } else { f64::NAN };
    let step = Step {
        damping,
        frequency,
        a: -(ip * of_p + ic * of_q),
        b: -(iq * of_q + ic * of_p),
        gain,
        turn: omega_dt * frequency,
    };
    Look { a, b, misfit, step }
}
