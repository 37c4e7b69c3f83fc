//! Ring fits of several signals side by side, one signal a lane.
//!
//! In: signals, sample by sample, with a start each. Out: damping and frequency of the least misfit,
//! found by damped Gauss-Newton steps, one evaluation of every lane at a time; a lane that has ended
//! takes the next signal, so that none waits for another. Amplitude (and phase) enter linearly and
//! are eliminated (variable projection).
//!
//! With u_k = e^{i phi} z^k, z = e^{(-sigma + i omega) dt}, the columns of a ring are p = Re u + real
//! (the real pole's part) and q = -Im u. Their products with the signal are the polynomial of its
//! samples and that one's slope at z, by Goertzel's recurrence; their Gram matrix, and that of t Re u
//! and t q (t in samples), are sums over k^m z^{2k}, k^m |z|^{2k} and k^m (z l)^k, in closed form. A
//! lane's arithmetic does not depend on the other lanes, nor on the processor: nothing fuses.

use super::lane_math::{exp, sin_cos};

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

/// What all signals of a fitter have in common.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    pub samples: usize,
    /// Of the ring that ratios refer to, per sample: sigma dt and omega dt.
    pub sigma_dt: f64,
    pub omega_dt: f64,
    /// cos and sin of its phase.
    pub first: (f64, f64),
    /// The real pole's part: its share, its ratio from sample to sample and over all samples, and its
    /// square norm.
    pub real_share: f64,
    pub real_ratio: f64,
    pub real_over_all: f64,
    pub real_square: f64,
}

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

/// Of a trial: its Gram matrix of p, q, x = t Re u, z = t q (lower triangle, row by row) and their
/// products with the signal.
#[derive(Clone, Copy, Debug)]
struct Sums {
    gram: [f64; 10],
    slope: [f64; 4],
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
        Search {
            frame,
            phase,
            lanes: [None; W],
            trial: [zero; 2],
            square: zero,
            along_real: zero,
        }
    }

    /// A signal takes a lane; its samples are to stand in the lane of `look`'s.
    pub fn begin(&mut self, lane: usize, start: Start) {
        let Start { ln_damping, ln_frequency, square, along_real } = start;
        let (look, trust) = (Look::default(), 1.0);
        let (steps, rejections, begun) = (0, 0, false);
        let new =
            Lane { start, ln_damping, ln_frequency, look, trust, steps, rejections, begun };
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
        #[cfg(target_arch = "x86_64")]
        if W > 1 {
            // SAFETY: the processor was found to have what is asked of it
            if std::is_x86_feature_detected!("avx512f") {
                return unsafe { x86::with_avx512(self, y) };
            }
            // SAFETY: as above
            if std::is_x86_feature_detected!("avx2") {
                return unsafe { x86::with_avx2(self, y) };
            }
        }
        looks(self, y)
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{Look, Search, looks};

    #[target_feature(enable = "avx512f")]
    pub fn with_avx512<const W: usize>(of: &Search<W>, y: &[[f64; W]]) -> [Look; W] {
        looks(of, y)
    }

    #[target_feature(enable = "avx2")]
    pub fn with_avx2<const W: usize>(of: &Search<W>, y: &[[f64; W]]) -> [Look; W] {
        looks(of, y)
    }
}

impl Lane {
    /// What to try next, or where it ended.
    fn take(&mut self, trial: [f64; 2], look: &Look, frame: &Frame) -> Result<[f64; 2], Option<Place>> {
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
fn looks<const W: usize>(of: &Search<W>, y: &[[f64; W]]) -> [Look; W] {
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
        let all = [a, b, misfit, step.damping, step.frequency, step.a, step.b, step.gain, step.turn];
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

/// Goertzel's recurrence b_k = y_k + 2 Re z b_{k+1} - |z|² b_{k+2}, and once more c_k = b_k + .. :
/// b_1, y_0 - |z|² b_2, c_3, b_2 - |z|² c_4. Then sum y_k z^k = b_1 z + (y_0 - |z|² b_2), and its slope
/// is b_1 + 2 i Im z (c_3 z + (b_2 - |z|² c_4)).
#[inline(always)] // compiled once per instruction set
fn goertzel<const W: usize>(y: &[[f64; W]], twice: &[f64; W], square: &[f64; W]) -> [[f64; W]; 4] {
    let zero = [0.0; W];
    let (mut b, mut b_above, mut c, mut c_above) = (zero, zero, zero, zero);
    let at = |k: usize| y.get(k).copied().unwrap_or(zero);
    for y in y.iter().skip(3).rev() {
        for l in 0..W {
            let next = (y[l] - square[l] * b_above[l]) + twice[l] * b[l];
            (b_above[l], b[l]) = (b[l], next);
            let next = (b[l] - square[l] * c_above[l]) + twice[l] * c[l];
            (c_above[l], c[l]) = (c[l], next);
        }
    }
    let (y_2, y_1, y_0) = (at(2), at(1), at(0));
    let mut out = [zero; 4];
    for l in 0..W {
        let b_2 = (y_2[l] - square[l] * b_above[l]) + twice[l] * b[l];
        let b_1 = (y_1[l] - square[l] * b[l]) + twice[l] * b_2;
        out[0][l] = b_1;
        out[1][l] = y_0[l] - square[l] * b_2;
        out[2][l] = c[l];
        out[3][l] = b_2 - square[l] * c_above[l];
    }
    out
}

#[derive(Clone, Copy)]
struct Complex {
    re: f64,
    im: f64,
}

impl Complex {
    #[inline(always)] // compiled once per instruction set
    fn times(self, other: Complex) -> Complex {
        Complex {
            re: self.re * other.re - self.im * other.im,
            im: self.re * other.im + self.im * other.re,
        }
    }

    #[inline(always)] // compiled once per instruction set
    fn scaled(self, by: f64) -> Complex {
        Complex { re: self.re * by, im: self.im * by }
    }

    #[inline(always)] // compiled once per instruction set
    fn less(self, other: Complex) -> Complex {
        Complex { re: self.re - other.re, im: self.im - other.im }
    }

    /// 1 / (1 - self).
    #[inline(always)] // compiled once per instruction set
    fn one_less_inverse(self) -> Complex {
        let (re, im) = (1.0 - self.re, -self.im);
        let norm = 1.0 / (re * re + im * im);
        Complex { re: re * norm, im: -im * norm }
    }
}

/// z^n, and the sums of |z|^2k, k |z|^2k and k² |z|^2k over k < n.
#[derive(Clone, Copy)]
struct Powers {
    over_all: Complex,
    squares: [f64; 3],
}

/// z^n by squaring, the sums by doubling: their closed forms cancel where nothing decays.
#[inline(always)] // compiled once per instruction set
fn powers<const W: usize>(
    n: usize,
    [re, im]: [&[f64; W]; 2],
    square: &[f64; W],
) -> ([[f64; W]; 2], [[f64; W]; 3]) {
    let ([mut all_re, mut all_im], mut decay) = ([*re, *im], *square);
    let [mut s0, mut s1, mut s2] = [[1.0; W], [0.0; W], [0.0; W]];
    let mut done = 1.0;
    let bits = usize::BITS - n.leading_zeros();
    for bit in (0..bits.saturating_sub(1)).rev() {
        let odd = n >> bit & 1 == 1;
        for l in 0..W {
            let d = decay[l];
            s2[l] += d * (s2[l] + done * (2.0 * s1[l] + done * s0[l]));
            s1[l] += d * (s1[l] + done * s0[l]);
            s0[l] += d * s0[l];
            (all_re[l], all_im[l]) =
                (all_re[l] * all_re[l] - all_im[l] * all_im[l], 2.0 * all_re[l] * all_im[l]);
            decay[l] = d * d;
        }
        done *= 2.0;
        if odd {
            for l in 0..W {
                let d = decay[l];
                s2[l] += done * done * d;
                s1[l] += done * d;
                s0[l] += d;
                (all_re[l], all_im[l]) = (
                    all_re[l] * re[l] - all_im[l] * im[l],
                    all_re[l] * im[l] + all_im[l] * re[l],
                );
                decay[l] = d * square[l];
            }
            done += 1.0;
        }
    }
    ([all_re, all_im], [s0, s1, s2])
}

const ONE: Complex = Complex { re: 1.0, im: 0.0 };

/// Sum of w^k and of k w^k over k < n. `over_all`: w^n.
#[inline(always)] // compiled once per instruction set
fn geometric(w: Complex, over_all: Complex, n: f64) -> (Complex, Complex, Complex) {
    let inverse = w.one_less_inverse();
    let zeroth = ONE.less(over_all).times(inverse);
    // (1 - w) sum k w^k = sum_{0 < k < n} w^k - (n - 1) w^n
    let first = zeroth.less(ONE).less(over_all.scaled(n - 1.0)).times(inverse);
    (zeroth, first, inverse)
}

#[inline(always)] // compiled once per instruction set
fn sums(frame: &Frame, z: Complex, powers: Powers, of_signal: [f64; 4], along_real: f64) -> Sums {
    let n = frame.samples as f64;
    let first = Complex { re: frame.first.0, im: frame.first.1 };
    let Powers { over_all, squares: [s0, s1, s2] } = powers;
    let (w, w_all) = (z.times(z), over_all.times(over_all));
    let (a0, a1, inverse) = geometric(w, w_all, n);
    // (1 - w) sum k² w^k = sum_{0 < k < n} (2 k - 1) w^k - (n - 1)² w^n
    let a2 = a1.scaled(2.0).less(a0.less(ONE)).less(w_all.scaled((n - 1.0) * (n - 1.0)));
    let turned = first.times(first);
    let (a0, a1, a2) =
        (a0.times(turned), a1.times(turned), a2.times(inverse).times(turned));
    let (c0, c1, _) =
        geometric(z.scaled(frame.real_ratio), over_all.scaled(frame.real_over_all), n);
    let share = first.scaled(frame.real_share);
    let (c0, c1) = (c0.times(share), c1.times(share));
    let gram = [
        0.5 * (s0 + a0.re) + 2.0 * c0.re + frame.real_square,
        -0.5 * a0.im - c0.im,
        0.5 * (s0 - a0.re),
        0.5 * (s1 + a1.re) + c1.re,
        -0.5 * a1.im,
        0.5 * (s2 + a2.re),
        -0.5 * a1.im - c1.im,
        0.5 * (s1 - a1.re),
        -0.5 * a2.im,
        0.5 * (s2 - a2.re),
    ];
    let [b_1, constant, c_3, of_slope] = of_signal;
    let value = Complex { re: b_1 * z.re + constant, im: b_1 * z.im }.times(first);
    let quotient = Complex { re: c_3 * z.re + of_slope, im: c_3 * z.im };
    let slope =
        Complex { re: b_1 - 2.0 * z.im * quotient.im, im: 2.0 * z.im * quotient.re };
    let slope = slope.times(z).times(first);
    Sums { gram, slope: [value.re + along_real, -value.im, slope.re, -slope.im] }
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
