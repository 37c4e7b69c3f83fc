//! Least squares on the trajectory, in the metric of the noise: the fit of the critique of decays.
//!
//! In: a [`Fit`] to start from (decays, terms, numbers) and the [`Noise`]. Out: a [`Fit`] at the nearest
//! minimum, never worse than the start.
//!
//! The cost is the sum of squares of the misfit as the noise sees it (`noise`), beside the best amplitudes of
//! all that is linear (`elimination`). The descent is that of Levenberg and Marquardt. A term that moves the
//! phase is fitted to a first stretch, then to ever longer ones (`follow`), because least squares over a whole
//! decay does not find a phase again that is off by half a swing.

use super::decays::Decays;
use super::elimination::{Basis, Reached, normal, reached};
use super::motion::Motion;
use super::noise::{Colour, Noise, sizes};
use super::plant::{AtRest, Fit, OMEGA, SIGMA, plain_numbers, start_of};
use super::terms::Term;
use inkling_core::model::descent::{Damping, descend};
use nalgebra::{DMatrix, DVector};
use std::f64::consts::{PI, TAU};
use std::ops::Range;

/// Damping of a descent's steps, and largest numbers of them: to converge, and to compare starts.
const DAMPING: Damping = Damping { first: 1e-3, down: 0.1, least: 1e-12, up: 10.0, most: 3e8 };
const MOST_STEPS: usize = 60;
const FEW_STEPS: usize = 8;
/// A harmonic may lie above half the sampling rate, where it is seen at its mirror image.
const MOST_TURN: f64 = 8.0 * PI;

impl<'a> Fit<'a> {
    /// No motion, and an offset of each series that is still to be found.
    pub fn zero(decays: &'a Decays) -> Fit<'a> {
        let mut p = vec![0.0; plain_numbers(decays)];
        p[OMEGA] = decays.lowest_line();
        let free = vec![Vec::new(); decays.bursts * decays.outputs];
        let (terms, cost, upto) = (Vec::new(), f64::INFINITY, decays.samples);
        Fit { decays, at_rest: AtRest::Offset, terms, p, free, cost, upto }
    }

    pub fn lines(&self) -> usize {
        self.terms.iter().filter(|term| term.is_line()).count()
    }

    /// How many numbers are fitted, amplitudes among them.
    pub fn parameters(&self) -> usize {
        let columns = self.at_rest.columns() + 2 * self.waves().len();
        self.p.len() + columns * self.decays.bursts * self.decays.outputs
    }

    pub fn degrees_of_freedom(&self) -> f64 {
        self.decays.y.len() as f64 - self.parameters() as f64
    }

    pub fn sizes(&self) -> Vec<f64> {
        sizes(&self.misfit(), self.decays)
    }

    /// Misfit over movement, the largest of all outputs.
    pub fn left(&self) -> f64 {
        let shares =
            self.sizes().into_iter().zip(self.decays.movement()).map(|(left, all)| left / all);
        shares.fold(0.0, f64::max)
    }

    pub fn noise(&self) -> Noise {
        self.noise_within(std::slice::from_ref(&(0..self.decays.samples)))
    }

    /// What it leaves in these ranges of all series, as noise that counts everywhere.
    pub fn noise_within(&self, ranges: &[Range<usize>]) -> Noise {
        let Decays { outputs, .. } = *self.decays;
        let (misfit, share) = (self.misfit(), self.parameters() as f64 / outputs as f64);
        let colour = |output| {
            let series = self.decays.of_output(&misfit, output);
            let parts = series.flat_map(|y| ranges.iter().map(move |range| &y[range.clone()]));
            Colour::of(&parts.collect::<Vec<&[f64]>>(), share)
        };
        Noise { colours: (0..outputs).map(colour).collect(), held_out: Vec::new() }
    }

    /// With one more term, whose numbers are 0; not fitted anew, so that its amplitudes are none of this model.
    pub fn with(&self, term: Term) -> Fit<'a> {
        let mut fit = Fit { cost: f64::INFINITY, ..self.clone() };
        fit.terms.push(term);
        fit.p.resize(self.p.len() + term.numbers(), 0.0);
        fit
    }

    /// Without those of its terms for whose index `goes` is true; not fitted anew, like `with`.
    pub fn without(&self, goes: impl Fn(usize) -> bool) -> Fit<'a> {
        let p = self.p[..self.own_numbers()].to_vec();
        let mut left = Fit { terms: Vec::new(), p, cost: f64::INFINITY, ..self.clone() };
        for (_, (term, at)) in self.placed().enumerate().filter(|(i, _)| !goes(*i)) {
            left.terms.push(term);
            left.p.extend_from_slice(&self.p[at..at + term.numbers()]);
        }
        left
    }

    /// With something else at rest, a drift of rate 0; not fitted anew, like `with`.
    pub fn resting(&self, at_rest: AtRest) -> Fit<'a> {
        let mut other = Fit { at_rest, cost: f64::INFINITY, ..self.clone() };
        other.p.splice(plain_numbers(self.decays)..self.own_numbers(), []);
        if let Some(at) = other.drift() {
            other.p.insert(at, 0.0);
        }
        other
    }

    /// The same model of the same decays from a later sample on, not fitted anew.
    pub fn later<'b>(&self, shorter: &'b Decays, skipped: usize) -> Fit<'b> {
        let Fit { at_rest, terms, mut p, free, cost, .. } = self.clone();
        for burst in 0..shorter.bursts {
            let now = self.path(burst, skipped + 1)[skipped];
            p[start_of(burst)..][..2].copy_from_slice(&now);
        }
        Fit { decays: shorter, at_rest, terms, p, free, cost, upto: shorter.samples }
    }

    /// With nothing but what it shows at rest.
    pub fn still(&self) -> Fit<'a> {
        let mut still = self.without(|_| true);
        (0..self.decays.bursts).for_each(|burst| still.p[start_of(burst)..][..2].fill(0.0));
        still.solved(&Noise::white(&self.sizes()))
    }

    /// Turns the start of every burst back by so many samples: backwards, all that damps drives.
    pub fn turn_back(&mut self, by: usize) {
        let Motion { sigma, drag, stick, .. } = self.motion();
        let back = Motion { sigma: -sigma, drag: -drag, stick: -stick, ..self.motion() };
        for burst in 0..self.decays.bursts {
            let start = &mut self.p[start_of(burst)..][..2];
            let [x, u] = back.run([start[0], -start[1]], by + 1)[by];
            start.copy_from_slice(&[x, -u]);
        }
    }

    /// What the sensor shows at rest after so many samples, for each output, counts: the mean over the decays.
    pub fn offsets(&self, samples: usize) -> Vec<f64> {
        let Decays { bursts, outputs, scale, .. } = self.decays;
        let drift = self.drift().map(|at| (-self.p[at] * samples as f64).exp());
        let shown = |of: &Vec<f64>| of[0] + drift.map_or(0.0, |left| left * of[1]);
        let sum = |o: usize| self.free.iter().skip(o).step_by(*outputs).map(shown).sum::<f64>();
        (0..*outputs).map(|o| sum(o) * scale[o] / *bursts as f64).collect()
    }

    /// Standard deviation of one decay's offset, for each output, beside all other free amplitudes.
    pub fn sd_of_offset(&self, noise: &Noise) -> Vec<f64> {
        reached(self, noise).1.bases.iter().map(Basis::sd_of_the_first).collect()
    }

    /// Measured minus simulated, for all samples, ordered as `decays.y` and in its scale.
    pub fn misfit(&self) -> Vec<f64> {
        let columns = self.columns();
        let mut misfit = self.decays.y.clone();
        for (i, (series, moved)) in misfit.chunks_mut(self.upto).zip(self.moved()).enumerate() {
            series.iter_mut().zip(moved).for_each(|(y, x)| *y -= x);
            for (column, amplitude) in columns.iter().zip(&self.free[i]) {
                series.iter_mut().zip(column).for_each(|(y, c)| *y -= amplitude * c);
            }
        }
        misfit
    }

    /// Covariance of the numbers: the inverse of J^T J with whitened derivatives J, of which what the free
    /// amplitudes can take is removed. A number that nothing depends on is held: its rows and columns are 0.
    pub fn covariance(&self, noise: &Noise) -> DMatrix<f64> {
        let gram = normal(self, noise, &reached(self, noise).1).0;
        // inverted with a unit diagonal; a division by an infinite scale gives the 0 of what is held
        let n = gram.nrows();
        let scale = gram.diagonal().map(|d| if d > 0.0 { d.sqrt() } else { f64::INFINITY });
        let unit = DMatrix::from_fn(n, n, |i, j| {
            gram[(i, j)] / (scale[i] * scale[j]) + if i == j { 1e-12 } else { 0.0 }
        });
        let inverse = unit.try_inverse().unwrap_or_else(|| DMatrix::identity(n, n) * 1e12);
        DMatrix::from_fn(n, n, |i, j| inverse[(i, j)] / (scale[i] * scale[j]))
    }

    /// With the amplitudes that fit best beside the numbers that it has.
    pub fn solved(&self, noise: &Noise) -> Fit<'a> {
        let (cost, Reached { free, .. }) = reached(self, noise);
        Fit { cost, free, ..self.clone() }
    }

    pub fn descend(&self, noise: &Noise) -> Fit<'a> {
        self.steps(noise, self.decays.samples, MOST_STEPS)
    }

    pub fn few_steps(&self, noise: &Noise) -> Fit<'a> {
        self.steps(noise, self.decays.samples, FEW_STEPS)
    }

    /// Descends by so many steps at most (Levenberg and Marquardt), on the first `upto` samples.
    fn steps(&self, noise: &Noise, upto: usize, most_steps: usize) -> Fit<'a> {
        // the ring's frequency must stay between the slowest ring and half the sampling rate, and lines
        // between zero and that; what is slower than one swing in the whole record is a drift
        let lowest = (TAU / self.decays.samples as f64).min(self.p[OMEGA]);
        // what falls faster than it swings creeps, and does not ring
        let creeps = |p: &[f64]| p[SIGMA] > p[OMEGA];
        let is_possible = |fit: &Fit| {
            let grows = -2.0 / upto as f64;
            let mut waves = fit.waves().into_iter();
            fit.p[OMEGA] >= lowest
                && fit.p[OMEGA] < PI
                && fit.drift().is_none_or(|at| fit.p[at] > grows)
                && (!creeps(&fit.p) || creeps(&self.p))
                && waves.all(|w| w.sigma > grows && w.omega.abs() < MOST_TURN)
        };
        let cost = |fit: &Fit<'a>| match is_possible(fit) {
            true => reached(fit, noise),
            false => (f64::INFINITY, Reached::default()),
        };
        let slope = |fit: &Fit<'a>, reached: Reached| {
            if reached.bases.is_empty() {
                return None; // an impossible start
            }
            let (gram, product) = normal(fit, noise, &reached);
            let finite = gram.iter().chain(product.iter()).all(|x| x.is_finite());
            finite.then_some((gram, product))
        };
        let step = |fit: &Fit<'a>, (gram, product): &(DMatrix<f64>, DVector<f64>), damping: f64| {
            let mut damped = gram.clone();
            let least = 1e-14 * gram.diagonal().max();
            (0..fit.p.len()).for_each(|i| damped[(i, i)] += damping * gram[(i, i)] + least);
            let step = damped.cholesky()?.solve(product);
            let p = fit.p.iter().zip(step.iter()).map(|(p, s)| p + s).collect();
            Some(Fit { p, ..fit.clone() })
        };
        let (mut taken, mut calm) = (0, 0);
        let rests = |gained: f64, left: f64| {
            taken += 1;
            calm = if gained < 1e-6 * left { calm + 1 } else { 0 };
            calm >= 2 || taken >= most_steps
        };
        let start = Fit { upto: upto.min(self.decays.samples), ..self.clone() };
        let (fit, cost) = descend(start, DAMPING, usize::MAX, cost, slope, step, rests);
        let free = reached(&fit, noise).1.free;
        Fit { cost, free, upto: self.upto, ..fit }
    }

    /// Fits a first stretch of so many samples, then ever longer ones (each by a half), then the whole.
    pub fn follow(&self, noise: &Noise, first: usize) -> Fit<'a> {
        let Decays { bursts, outputs, samples, .. } = *self.decays;
        let mut fit = self.clone();
        // a stretch needs twice as many samples as there are numbers to be fitted
        let fewest = fit.parameters() * 2 / (bursts * outputs);
        let mut upto = first.max(fewest).max(8);
        while upto < samples {
            fit = fit.steps(noise, upto, FEW_STEPS);
            upto = (upto as f64 * 1.5).ceil() as usize;
        }
        fit.descend(noise)
    }
}
