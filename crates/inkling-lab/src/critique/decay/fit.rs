//! Least squares on the trajectory, in the metric of the noise: the fit of the critique of decays.
//!
//! In: a [`Fit`] to start from (decays, terms, numbers) and the [`Noise`]. Out: a [`Fit`] at the nearest
//! minimum, never worse than the start.
//!
//! The cost is the sum of squares of the whitened misfit: each output's noise is an autoregression
//! ([`Colour`], from a fit's own misfit), and whitening subtracts from each sample what those before it
//! predict, and divides by the standard deviation of the rest. The descent is that of Levenberg and
//! Marquardt. A term that moves the phase is fitted to a first stretch, then to ever longer ones (`follow`),
//! because least squares over a whole decay does not find a phase again that is off by half a swing.

use super::decays::Decays;
use super::motion::Motion;
use super::plant::{OMEGA, Plant, motion, placed, plain_numbers};
use super::terms::Term;
use inkling_core::model::descent::{Damping, descend};
use nalgebra::{DMatrix, DVector};
use std::f64::consts::{PI, TAU};

const MOST_ORDER: usize = 12;
/// Damping of a descent's steps, and largest numbers of them: to converge, and to compare starts.
const DAMPING: Damping = Damping { first: 1e-3, down: 0.1, least: 1e-12, up: 10.0, most: 3e8 };
const MOST_STEPS: usize = 60;
const FEW_STEPS: usize = 8;

/// The noise of one output: linear predictors of order 0, 1 ... p, and the standard deviation of what each
/// leaves. That of order m expects sum_j phi_j y_{k-1-j} of sample k, over j < m.
#[derive(Clone, Debug)]
pub struct Colour {
    pub predictors: Vec<Vec<f64>>,
    /// The first one is that of the misfits themselves.
    pub sds: Vec<f64>,
}

impl Colour {
    pub fn white(sd: f64) -> Colour {
        Colour { predictors: vec![Vec::new()], sds: vec![sd] }
    }

    pub fn order(&self) -> usize {
        self.predictors.len() - 1
    }

    /// The autoregression of misfits, of the order that the Bayesian information criterion chooses (Levinson,
    /// Durbin). `series`: stretches of the misfit of one output; `spent`: number of parameters that were
    /// fitted to them.
    pub fn of(series: &[&[f64]], spent: f64) -> Colour {
        let count: usize = series.iter().map(|s| s.len()).sum();
        let longest = series.iter().map(|s| s.len()).max().unwrap_or(0);
        let most = MOST_ORDER.min(longest / 8);
        let free = (count as f64 - spent).max(1.0);
        let lag = |j: usize| -> f64 {
            let products = series.iter().flat_map(|s| s.iter().zip(&s[j.min(s.len())..]));
            products.map(|(a, b)| a * b).sum::<f64>() / free
        };
        let zero = lag(0).max(1e-300);
        let mut all = Colour { predictors: vec![Vec::new()], sds: vec![zero.sqrt()] };
        let (mut variance, mut phi) = (zero, Vec::<f64>::new());
        let (mut best, mut least) = (0, free * zero.ln());

        // Levinson's recursion: the next predictor is the last one, less its mirror image times the partial
        // correlation (`mirror`), its own new coefficient; the variance falls by its square
        for p in 1..=most {
            let reached: f64 = phi.iter().enumerate().map(|(j, f)| f * lag(p - 1 - j)).sum();
            let mirror = ((lag(p) - reached) / variance).clamp(-0.9999, 0.9999);
            let old = phi.clone();
            phi.iter_mut().zip(old.iter().rev()).for_each(|(f, o)| *f -= mirror * o);
            phi.push(mirror);
            variance *= 1.0 - mirror * mirror;
            all.predictors.push(phi.clone());
            all.sds.push(variance.max(1e-300).sqrt());
            let criterion = free * variance.ln() + p as f64 * free.ln();
            if criterion < least {
                (best, least) = (p, criterion);
            }
        }
        all.predictors.truncate(best + 1);
        all.sds.truncate(best + 1);
        all
    }

    /// The first samples of a series have fewer before them, and so are predicted by a lower order.
    pub fn whiten(&self, series: &mut [f64]) {
        let raw = series.to_vec();
        for (k, w) in series.iter_mut().enumerate() {
            let order = k.min(self.order());
            let phi = &self.predictors[order];
            let expected: f64 = phi.iter().enumerate().map(|(j, f)| f * raw[k - 1 - j]).sum();
            *w = (raw[k] - expected) / self.sds[order];
        }
    }

    pub fn ln_densities(&self, series: &[f64]) -> Vec<f64> {
        let mut ln = series.to_vec();
        self.whiten(&mut ln);
        for (k, w) in ln.iter_mut().enumerate() {
            let sd = self.sds[k.min(self.order())];
            *w = -0.5 * (*w * *w + TAU.ln()) - sd.ln();
        }
        ln
    }
}

/// Root mean square of each output's misfit, over all bursts. `misfit` is ordered as `decays.y`.
pub fn sizes(misfit: &[f64], decays: &Decays) -> Vec<f64> {
    let count = (decays.samples * decays.bursts) as f64;
    let square = |output| decays.of_output(misfit, output).flatten().map(|r| r * r).sum::<f64>();
    (0..decays.outputs).map(|output| (square(output) / count).sqrt().max(1e-12)).collect()
}

#[derive(Clone, Debug)]
pub struct Noise {
    pub colours: Vec<Colour>,
    /// For each sample of a series whether it counts for nothing; empty if all count.
    pub held_out: Vec<bool>,
}

impl Noise {
    pub fn white(sds: &[f64]) -> Noise {
        Noise { colours: sds.iter().map(|sd| Colour::white(*sd)).collect(), held_out: Vec::new() }
    }

    /// The share of the misfit's squares that the samples before predict, the largest of all outputs.
    pub fn predictable(&self) -> f64 {
        let of = |c: &Colour| 1.0 - (c.sds[c.order()] / c.sds[0]).powi(2);
        self.colours.iter().map(of).fold(0.0, f64::max)
    }

    /// Whitens the series with index i (by burst, then output), and clears what is held out.
    fn apply_to(&self, i: usize, series: &mut [f64]) {
        self.colours[i % self.colours.len()].whiten(series);
        for (w, _) in series.iter_mut().zip(&self.held_out).filter(|(_, held)| **held) {
            *w = 0.0;
        }
    }
}

#[derive(Clone, Debug)]
pub struct Fit<'a> {
    pub decays: &'a Decays,
    pub terms: Vec<Term>,
    /// Numbers (parameters), in the order of `plant.rs`.
    pub p: Vec<f64>,
    pub cost: f64,
}

impl<'a> Fit<'a> {
    pub fn zero(decays: &'a Decays) -> Fit<'a> {
        let p = vec![0.0; plain_numbers(decays)];
        Fit { decays, terms: Vec::new(), p, cost: f64::INFINITY }
    }

    pub fn placed(&self) -> impl Iterator<Item = (Term, usize)> {
        placed(self.decays, &self.terms)
    }

    /// Index in `p` at which each line's numbers begin, and its frequencies, rad per sample.
    pub fn lines(&self) -> impl Iterator<Item = (usize, Vec<f64>)> {
        self.placed().filter_map(|(term, at)| match term {
            Term::Line(line) => Some((at, line.frequencies(self.p[OMEGA], self.p[at + 1]))),
            _ => None,
        })
    }

    pub fn degrees_of_freedom(&self) -> f64 {
        self.decays.y.len() as f64 - self.p.len() as f64
    }

    pub fn sizes(&self) -> Vec<f64> {
        sizes(&self.misfit(), self.decays)
    }

    pub fn noise(&self) -> Noise {
        let Decays { outputs, .. } = *self.decays;
        let (misfit, share) = (self.misfit(), self.p.len() as f64 / outputs as f64);
        let series = |output| self.decays.of_output(&misfit, output).collect::<Vec<&[f64]>>();
        let colours = (0..outputs).map(|output| Colour::of(&series(output), share)).collect();
        Noise { colours, held_out: Vec::new() }
    }

    /// With one more term, whose numbers are 0; not fitted anew.
    pub fn with(&self, term: Term) -> Fit<'a> {
        let mut fit = Fit { cost: f64::INFINITY, ..self.clone() };
        fit.terms.push(term);
        fit.p.resize(self.p.len() + term.numbers(self.decays), 0.0);
        fit
    }

    /// Without those of its terms for whose index `goes` is true; not fitted anew.
    pub fn without(&self, goes: impl Fn(usize) -> bool) -> Fit<'a> {
        let mut left = Fit::zero(self.decays);
        left.p.clone_from_slice(&self.p[..plain_numbers(self.decays)]);
        let stays = self.placed().enumerate().filter(|(i, _)| !goes(*i));
        for (_, (term, at)) in stays {
            left.terms.push(term);
            left.p.extend_from_slice(&self.p[at..at + term.numbers(self.decays)]);
        }
        left
    }

    /// What the sensor shows at rest, for each output, counts; `None` without an offset in the model.
    pub fn offsets(&self) -> Option<Vec<f64>> {
        let (_, at) = self.placed().find(|(term, _)| *term == Term::Offset)?;
        let each = self.p[at..].iter().zip(&self.decays.scale);
        Some(each.map(|(offset, scale)| offset * scale).collect())
    }

    pub fn motion(&self) -> Motion {
        motion(self.decays, &self.terms, &self.p)
    }

    /// Measured minus simulated, for all samples, ordered as `decays.y` and in its scale.
    pub fn misfit(&self) -> Vec<f64> {
        let plant = Plant::new(self.decays, &self.terms, self.decays.samples);
        let mut misfit = plant.measured();
        misfit.iter_mut().zip(plant.predict(&self.p)).for_each(|(y, m)| *y -= m);
        misfit
    }

    /// Covariance of the numbers: the inverse of J^T J with whitened derivatives J. A number that nothing
    /// depends on, such as a tone's damping, is held: its rows and columns are 0.
    pub fn covariance(&self, noise: &Noise) -> DMatrix<f64> {
        let plant = Plant::new(self.decays, &self.terms, self.decays.samples);
        let gram = normal(&plant, &self.p, noise, &vec![0.0; plant.len()]).0;
        // inverted with a unit diagonal; a division by an infinite scale gives the 0 of what is held
        let n = gram.nrows();
        let scale = gram.diagonal().map(|d| if d > 0.0 { d.sqrt() } else { f64::INFINITY });
        let unit = DMatrix::from_fn(n, n, |i, j| {
            gram[(i, j)] / (scale[i] * scale[j]) + if i == j { 1e-12 } else { 0.0 }
        });
        let inverse = unit.try_inverse().unwrap_or_else(|| DMatrix::identity(n, n) * 1e12);
        DMatrix::from_fn(n, n, |i, j| inverse[(i, j)] / (scale[i] * scale[j]))
    }

    pub fn descend(&self, noise: &Noise) -> Fit<'a> {
        self.steps(noise, self.decays.samples, MOST_STEPS)
    }

    pub fn few_steps(&self, noise: &Noise) -> Fit<'a> {
        self.steps(noise, self.decays.samples, FEW_STEPS)
    }

    /// Descends by so many steps at most (Levenberg and Marquardt), on the first `upto` samples.
    fn steps(&self, noise: &Noise, upto: usize, most_steps: usize) -> Fit<'a> {
        let plant = Plant::new(self.decays, &self.terms, upto);
        let measured = plant.measured();

        // the ring's frequency must stay between the slowest ring and half the sampling rate; what
        // is slower than one swing in the whole record is a drift
        let lowest = (TAU / self.decays.samples as f64).min(self.p[OMEGA]);
        let cost = |p: &Vec<f64>| match p[OMEGA] >= lowest && p[OMEGA] < PI {
            true => cost(&plant, p, noise, &measured),
            false => (f64::INFINITY, Vec::new()),
        };
        let slope = |p: &Vec<f64>, r: Vec<f64>| {
            let (gram, product) = normal(&plant, p, noise, &r);
            let finite = gram.iter().chain(product.iter()).all(|x| x.is_finite());
            finite.then_some((gram, product))
        };
        let step = |p: &Vec<f64>, (gram, product): &(DMatrix<f64>, DVector<f64>), damping: f64| {
            let mut damped = gram.clone();
            let least = 1e-14 * gram.diagonal().max();
            (0..p.len()).for_each(|i| damped[(i, i)] += damping * gram[(i, i)] + least);
            let step = damped.cholesky()?.solve(product);
            Some(p.iter().zip(step.iter()).map(|(p, s)| p + s).collect())
        };
        let (mut taken, mut calm) = (0, 0);
        let rests = |gained: f64, left: f64| {
            taken += 1;
            calm = if gained < 1e-6 * left { calm + 1 } else { 0 };
            calm >= 2 || taken >= most_steps
        };
        let (p, cost) = descend(self.p.clone(), DAMPING, usize::MAX, cost, slope, step, rests);
        Fit { p, cost, ..self.clone() }
    }

    /// Fits a first stretch of so many samples, then ever longer ones (each by a half), then the whole.
    pub fn follow(&self, noise: &Noise, first: usize) -> Fit<'a> {
        let Decays { bursts, outputs, samples, .. } = *self.decays;
        let mut fit = self.clone();
        // a stretch needs twice as many samples as there are numbers to be fitted
        let fewest = fit.p.len() * 2 / (bursts * outputs);
        let mut upto = first.max(fewest).max(8);
        while upto < samples {
            fit = fit.steps(noise, upto, FEW_STEPS);
            upto = (upto as f64 * 1.5).ceil() as usize;
        }
        fit.descend(noise)
    }
}

/// Sum of squares of the whitened misfit (infinite where the motion is lost), and this misfit.
fn cost(plant: &Plant, p: &[f64], noise: &Noise, measured: &[f64]) -> (f64, Vec<f64>) {
    plant.decays.work.goes_on();
    let mut r = plant.predict(p);
    r.iter_mut().zip(measured).for_each(|(m, y)| *m = y - *m);
    r.chunks_mut(plant.upto).enumerate().for_each(|(i, series)| noise.apply_to(i, series));
    let sum: f64 = r.iter().map(|r| r * r).sum();
    (if sum.is_finite() { sum } else { f64::INFINITY }, r)
}

/// J^T J and J^T r, summed series by series, since most numbers matter to one burst alone.
fn normal(plant: &Plant, p: &[f64], noise: &Noise, r: &[f64]) -> (DMatrix<f64>, DVector<f64>) {
    let numbers = p.len();
    let (mut gram, mut product) = (DMatrix::zeros(numbers, numbers), DVector::zeros(numbers));
    let series = plant.jacobian(p).series.into_iter();
    for (i, (columns, r)) in series.zip(r.chunks(plant.upto)).enumerate() {
        plant.decays.work.goes_on();
        let whitened = |(number, mut column): (usize, Vec<f64>)| {
            noise.apply_to(i, &mut column);
            (number, DVector::from_vec(column))
        };
        let columns: Vec<(usize, DVector<f64>)> = columns.into_iter().map(whitened).collect();
        let r = DVector::from_column_slice(r);
        for (a, (row, of_row)) in columns.iter().enumerate() {
            product[*row] += of_row.dot(&r);
            for (column, of_column) in &columns[..=a] {
                gram[(*row, *column)] += of_row.dot(of_column);
            }
        }
    }
    gram.fill_upper_triangle_with_lower_triangle();
    (gram, product)
}
