//! Least squares on the trajectory, in the metric of the noise: the fit of the critique of decays.
//!
//! In: a [`Fit`] to start from (decays, terms, numbers) and the [`Noise`]. Out: a [`Fit`] at the nearest
//! minimum, never worse than the start.
//!
//! The cost is the sum of squares of the whitened misfit: each output's noise is an autoregression
//! ([`Colour`], from a fit's own misfit), and whitening subtracts from each sample what those before it
//! predict, and divides by the standard deviation of the rest. What is linear, the amplitudes of lines and an offset of
//! each series, is eliminated: it is 0 numbers to the descent, which is that of Levenberg and Marquardt
//! (variable projection: G. H. Golub and V. Pereyra, SIAM J. Numer. Anal. 10, 1973). A term that moves the phase is fitted to a first stretch, then to ever longer ones (`follow`),
//! because least squares over a whole decay does not find a phase again that is off by half a swing.

use super::decays::Decays;
use super::motion::Motion;
use super::plant::{OMEGA, Plant, Wave, motion, path, placed, plain_numbers, start_of, waves_of};
use super::terms::Term;
use inkling_core::model::descent::{Damping, descend};
use nalgebra::{DMatrix, DVector};
use std::f64::consts::{PI, TAU};
use std::ops::{AddAssign, Range};

const MOST_ORDER: usize = 12;
/// Damping of a descent's steps, and largest numbers of them: to converge, and to compare starts.
const DAMPING: Damping = Damping { first: 1e-3, down: 0.1, least: 1e-12, up: 10.0, most: 3e8 };
const MOST_STEPS: usize = 60;
const FEW_STEPS: usize = 8;
/// A harmonic may lie above half the sampling rate, where it is seen at its mirror image.
const MOST_TURN: f64 = 8.0 * PI;

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

    /// Sum of squares of a misfit, of so many samples in a series, as this noise sees it.
    pub fn seen(&self, misfit: &[f64], samples: usize) -> f64 {
        let mut misfit = misfit.to_vec();
        misfit.chunks_mut(samples).enumerate().for_each(|(i, series)| self.apply_to(i, series));
        misfit.iter().map(|w| w * w).sum()
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
    /// Amplitudes of all columns of waves, in the terms' order, one for each series.
    pub free: Vec<Vec<f64>>,
    pub cost: f64,
}

impl<'a> Fit<'a> {
    /// No motion, and an offset of each series.
    pub fn zero(decays: &'a Decays) -> Fit<'a> {
        let p = vec![0.0; plain_numbers(decays)];
        let still = Fit { decays, terms: Vec::new(), p, free: Vec::new(), cost: f64::INFINITY };
        still.with(Term::Offset)
    }

    pub fn placed(&self) -> impl Iterator<Item = (Term, usize)> {
        placed(self.decays, &self.terms)
    }

    /// Index in `p` at which each line's numbers begin, and its waves.
    pub fn lines(&self) -> impl Iterator<Item = (usize, Vec<Wave>)> {
        let lines = self.placed().filter(|(term, _)| term.is_line());
        lines.map(|(term, at)| (at, waves_of(term, at, &self.p)))
    }

    /// Which rows of `free` belong to each term.
    pub fn rows(&self) -> impl Iterator<Item = Range<usize>> {
        self.placed().scan(0, |next, (term, at)| {
            let first = *next;
            *next += columns_of(&waves_of(term, at, &self.p));
            Some(first..*next)
        })
    }

    /// How many numbers are fitted, amplitudes among them.
    pub fn parameters(&self) -> usize {
        self.p.len() + self.free.len() * self.decays.bursts * self.decays.outputs
    }

    pub fn degrees_of_freedom(&self) -> f64 {
        self.decays.y.len() as f64 - self.parameters() as f64
    }

    pub fn sizes(&self) -> Vec<f64> {
        sizes(&self.misfit(), self.decays)
    }

    pub fn noise(&self) -> Noise {
        let Decays { outputs, .. } = *self.decays;
        let (misfit, share) = (self.misfit(), self.parameters() as f64 / outputs as f64);
        let series = |output| self.decays.of_output(&misfit, output).collect::<Vec<&[f64]>>();
        let colours = (0..outputs).map(|output| Colour::of(&series(output), share)).collect();
        Noise { colours, held_out: Vec::new() }
    }

    /// With one more term, whose numbers are 0; not fitted anew.
    pub fn with(&self, term: Term) -> Fit<'a> {
        let mut fit = Fit { cost: f64::INFINITY, ..self.clone() };
        fit.terms.push(term);
        let at = self.p.len();
        fit.p.resize(at + term.numbers(), 0.0);
        let columns = columns_of(&waves_of(term, at, &fit.p));
        let still = vec![0.0; self.decays.bursts * self.decays.outputs];
        fit.free.extend(std::iter::repeat_n(still, columns));
        fit
    }

    /// Without those of its terms for whose index `goes` is true; not fitted anew.
    pub fn without(&self, goes: impl Fn(usize) -> bool) -> Fit<'a> {
        let p = self.p[..plain_numbers(self.decays)].to_vec();
        let mut left = Fit { terms: Vec::new(), p, free: Vec::new(), ..self.clone() };
        let stays = self.placed().zip(self.rows()).enumerate().filter(|(i, _)| !goes(*i));
        for (_, ((term, at), rows)) in stays {
            left.terms.push(term);
            left.p.extend_from_slice(&self.p[at..at + term.numbers()]);
            left.free.extend_from_slice(&self.free[rows]);
        }
        Fit { cost: f64::INFINITY, ..left }
    }

    /// The same model of the same decays from a later sample on, not fitted anew.
    pub fn later<'b>(&self, shorter: &'b Decays, skipped: usize) -> Fit<'b> {
        let Fit { terms, mut p, free, cost, .. } = self.clone();
        let (motion, mut path_of) = (self.motion(), Vec::new());
        for burst in 0..shorter.bursts {
            path(&motion, &self.p, burst, skipped + 1, &mut path_of);
            p[start_of(burst)..][..2].copy_from_slice(&path_of[skipped]);
        }
        Fit { decays: shorter, terms, p, free, cost }
    }

    /// Turns the start of every burst back by so many samples: backwards, all that damps drives.
    pub fn turn_back(&mut self, by: usize) {
        let Motion { sigma, drag, stick, .. } = self.motion();
        let back = Motion { sigma: -sigma, drag: -drag, stick: -stick, ..self.motion() };
        let mut path_of = Vec::new();
        for burst in 0..self.decays.bursts {
            let start = &mut self.p[start_of(burst)..][..2];
            back.run([start[0], -start[1]], by + 1, &mut path_of);
            let [x, u] = path_of[by];
            start.copy_from_slice(&[x, -u]);
        }
    }

    /// What the sensor shows at rest, for each output, counts: the mean over the decays.
    pub fn offsets(&self) -> Vec<f64> {
        let Decays { bursts, outputs, scale, .. } = self.decays;
        let mean = |o: usize| self.free[0].iter().skip(o).step_by(*outputs).sum::<f64>();
        (0..*outputs).map(|o| mean(o) * scale[o] / *bursts as f64).collect()
    }

    /// Standard deviation of one decay's offset, for each output, beside all other free amplitudes.
    pub fn sd_of_offset(&self, noise: &Noise) -> Vec<f64> {
        let plant = Plant::new(self.decays, &self.terms, self.decays.samples);
        let (_, reached) = reached(&plant, &self.p, noise);
        reached.bases.iter().map(Basis::sd_of_the_first).collect()
    }

    pub fn motion(&self) -> Motion {
        motion(self.decays, &self.terms, &self.p)
    }

    /// Measured minus simulated, for all samples, ordered as `decays.y` and in its scale.
    pub fn misfit(&self) -> Vec<f64> {
        let plant = Plant::new(self.decays, &self.terms, self.decays.samples);
        let waves = plant.waves(&self.p);
        let columns: Vec<Vec<f64>> = waves.iter().flat_map(|w| w.columns(plant.upto)).collect();
        let mut misfit = self.decays.y.clone();
        let moved = plant.moved(&self.p);
        for (i, (series, moved)) in misfit.chunks_mut(plant.upto).zip(moved).enumerate() {
            series.iter_mut().zip(moved).for_each(|(y, x)| *y -= x);
            for (column, amplitudes) in columns.iter().zip(&self.free) {
                series.iter_mut().zip(column).for_each(|(y, c)| *y -= amplitudes[i] * c);
            }
        }
        misfit
    }

    /// Covariance of the numbers: the inverse of J^T J with whitened derivatives J, of which what the free
    /// amplitudes can take is removed. A number that nothing depends on is held: its rows and columns are 0.
    pub fn covariance(&self, noise: &Noise) -> DMatrix<f64> {
        let plant = Plant::new(self.decays, &self.terms, self.decays.samples);
        let (_, reached) = reached(&plant, &self.p, noise);
        let gram = normal(&plant, &self.p, noise, &reached).0;
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
        let plant = Plant::new(self.decays, &self.terms, self.decays.samples);
        let (cost, reached) = reached(&plant, &self.p, noise);
        Fit { cost, free: reached.amplitudes(), ..self.clone() }
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
        // the ring's frequency must stay between the slowest ring and half the sampling rate, and lines
        // between zero and that; what is slower than one swing in the whole record is a drift
        let lowest = (TAU / self.decays.samples as f64).min(self.p[OMEGA]);
        let is_possible = |p: &[f64]| {
            let grows = -2.0 / upto as f64;
            let mut waves = plant.waves(p).into_iter();
            p[OMEGA] >= lowest
                && p[OMEGA] < PI
                && waves
                    .all(|w| w.sigma > grows && w.omega.is_none_or(|omega| omega.abs() < MOST_TURN))
        };
        let cost = |p: &Vec<f64>| match is_possible(p) {
            true => reached(&plant, p, noise),
            false => (f64::INFINITY, Reached::default()),
        };
        let slope = |p: &Vec<f64>, reached: Reached| {
            if reached.bases.is_empty() {
                return None; // an impossible start
            }
            let (gram, product) = normal(&plant, p, noise, &reached);
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
        let free = reached(&plant, &p, noise).1.amplitudes();
        Fit { p, cost, free, ..self.clone() }
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

fn columns_of(waves: &[Wave]) -> usize {
    waves.iter().map(Wave::width).sum()
}

/// The columns of all waves as one output's noise sees them: q r, with q orthonormal. A column that others
/// hold is 0 in q, and takes nothing.
#[derive(Default)]
struct Basis {
    q: DMatrix<f64>,
    r: DMatrix<f64>,
}

impl Basis {
    /// By Gram and Schmidt, twice.
    fn of(mut q: DMatrix<f64>) -> Basis {
        let k = q.ncols();
        let mut r = DMatrix::zeros(k, k);
        for j in 0..k {
            let (before, mut rest) = q.columns_range_pair_mut(..j, j..);
            let mut column = rest.column_mut(0);
            let size = column.norm();
            for _ in 0..2 {
                let taken = before.tr_mul(&column);
                column.gemv(-1.0, &before, &taken, 1.0);
                r.view_mut((0, j), (j, 1)).add_assign(&taken);
            }
            let left = column.norm();
            let is_new = left > 1e-7 * size;
            r[(j, j)] = if is_new { left } else { 0.0 };
            column.scale_mut(if is_new { 1.0 / left } else { 0.0 });
        }
        Basis { q, r }
    }

    /// Removes what the columns can take of `y`, and returns its coordinates in q.
    fn remove_from(&self, y: &mut DMatrix<f64>) -> DMatrix<f64> {
        let taken = self.q.tr_mul(y);
        y.gemm(-1.0, &self.q, &taken, 1.0);
        taken
    }

    /// Standard deviation of the first column's amplitude: |r^-T e_1|.
    fn sd_of_the_first(&self) -> f64 {
        let mut solved: Vec<f64> = Vec::new();
        for j in 0..self.r.ncols() {
            let unit = if j == 0 { 1.0 } else { 0.0 };
            let others: f64 = solved.iter().enumerate().map(|(i, x)| self.r[(i, j)] * x).sum();
            let diagonal = self.r[(j, j)];
            solved.push(if diagonal > 0.0 { (unit - others) / diagonal } else { 0.0 });
        }
        solved.iter().map(|x| x * x).sum::<f64>().sqrt()
    }

    /// Amplitudes of the columns from coordinates in q.
    fn amplitudes(&self, taken: &DMatrix<f64>) -> Vec<f64> {
        let k = self.r.ncols();
        let mut amplitudes = vec![0.0; k];
        for j in (0..k).rev().filter(|j| self.r[(*j, *j)] > 0.0) {
            let others: f64 = (j + 1..k).map(|i| self.r[(j, i)] * amplitudes[i]).sum();
            amplitudes[j] = (taken[j] - others) / self.r[(j, j)];
        }
        amplitudes
    }
}

/// What a point of the descent has come to: for each output the basis, and for each series the whitened
/// misfit and the amplitudes of all columns.
#[derive(Default)]
struct Reached {
    bases: Vec<Basis>,
    misfits: Vec<DMatrix<f64>>,
    of_series: Vec<Vec<f64>>,
}

impl Reached {
    fn amplitudes(&self) -> Vec<Vec<f64>> {
        let columns = self.of_series.first().map_or(0, Vec::len);
        (0..columns).map(|j| self.of_series.iter().map(|of| of[j]).collect()).collect()
    }
}

/// Columns of the plant's samples as the noise of a series, or of its output, sees them.
fn whitened(
    mut columns: Vec<Vec<f64>>,
    plant: &Plant,
    noise: &Noise,
    series: usize,
) -> DMatrix<f64> {
    columns.iter_mut().for_each(|column| noise.apply_to(series, column));
    DMatrix::from_vec(plant.upto, columns.len(), columns.concat())
}

/// Sum of squares of the whitened misfit (infinite where the motion is lost).
fn reached(plant: &Plant, p: &[f64], noise: &Noise) -> (f64, Reached) {
    plant.decays.work.goes_on();
    let waves = plant.waves(p);
    let columns: Vec<Vec<f64>> = waves.iter().flat_map(|w| w.columns(plant.upto)).collect();
    let outputs = plant.decays.outputs;
    let bases: Vec<Basis> =
        (0..outputs).map(|o| Basis::of(whitened(columns.clone(), plant, noise, o))).collect();
    let mut all = Reached { bases, ..Reached::default() };
    let mut sum = 0.0;
    for (i, moved) in plant.moved(p).into_iter().enumerate() {
        let measured = plant.decays.series(i / outputs, i % outputs);
        let misfit = measured.iter().zip(moved).map(|(y, x)| y - x).collect();
        let mut misfit = whitened(vec![misfit], plant, noise, i);
        let basis = &all.bases[i % outputs];
        let taken = basis.remove_from(&mut misfit);
        sum += misfit.norm_squared();
        all.of_series.push(basis.amplitudes(&taken));
        all.misfits.push(misfit);
    }
    (if sum.is_finite() { sum } else { f64::INFINITY }, all)
}

/// J^T J and J^T r of the numbers, summed series by series, with what the free amplitudes take removed (L.
/// Kaufman, BIT 15, 1975). The derivatives of waves are those of few columns for all series of an output,
/// weighted by each series' amplitudes.
fn normal(
    plant: &Plant,
    p: &[f64],
    noise: &Noise,
    reached: &Reached,
) -> (DMatrix<f64>, DVector<f64>) {
    let numbers = p.len();
    let (mut gram, mut product) = (DMatrix::zeros(numbers, numbers), DVector::zeros(numbers));
    let waves = plant.waves(p);
    let Decays { bursts, outputs, .. } = *plant.decays;
    let turns: Vec<DMatrix<f64>> = (0..outputs)
        .map(|output| {
            let times = |w: &Wave| waves_in_time(w, plant.upto);
            let mut turns = whitened(waves.iter().flat_map(times).collect(), plant, noise, output);
            reached.bases[output].remove_from(&mut turns);
            turns
        })
        .collect();
    let grams: Vec<DMatrix<f64>> = turns.iter().map(|z| z.tr_mul(z)).collect();
    for burst in 0..bursts {
        plant.decays.work.goes_on();
        for (output, slopes) in plant.slopes(p, burst).into_iter().enumerate() {
            let series = burst * outputs + output;
            let misfit = &reached.misfits[series];
            let (at, columns): (Vec<usize>, Vec<Vec<f64>>) = slopes.into_iter().unzip();
            let mut moved = whitened(columns, plant, noise, output);
            reached.bases[output].remove_from(&mut moved);
            let (own, own_misfit) = (moved.tr_mul(&moved), moved.tr_mul(misfit));
            let by = by_numbers(&waves, &reached.of_series[series], numbers);
            let crossed = moved.tr_mul(&turns[output]) * &by;
            for (i, row) in at.iter().enumerate() {
                product[*row] += own_misfit[i];
                at.iter().enumerate().for_each(|(j, column)| gram[(*row, *column)] += own[(i, j)]);
                for number in 0..numbers {
                    gram[(*row, number)] += crossed[(i, number)];
                    gram[(number, *row)] += crossed[(i, number)];
                }
            }
            gram += by.tr_mul(&(&grams[output] * &by));
            product += by.tr_mul(&turns[output].tr_mul(misfit)).column(0);
        }
    }
    (gram, product)
}

/// Time times the damped cosine and sine of a wave that numbers move.
fn waves_in_time(wave: &Wave, samples: usize) -> Vec<Vec<f64>> {
    if wave.by.is_empty() {
        return Vec::new();
    }
    let mut columns = wave.columns(samples);
    let in_time = |column: &mut Vec<f64>| {
        column.iter_mut().enumerate().for_each(|(k, x)| *x *= k as f64);
    };
    columns.iter_mut().for_each(in_time);
    columns
}

/// How much of each column of `waves_in_time` is in the derivative by each number. `free`: the amplitudes of
/// a series.
fn by_numbers(waves: &[Wave], free: &[f64], numbers: usize) -> DMatrix<f64> {
    let moving = waves.iter().filter(|w| !w.by.is_empty());
    let mut by = DMatrix::zeros(moving.map(Wave::width).sum(), numbers);
    let (mut at, mut row) = (0, 0);
    for wave in waves {
        let columns = wave.width();
        let a = free[at];
        let b = if columns == 2 { free[at + 1] } else { 0.0 };
        at += columns;
        if wave.by.is_empty() {
            continue;
        }
        for (number, [falls, turns]) in &wave.by {
            by[(row, *number)] += b * turns - a * falls;
            if columns == 2 {
                by[(row + 1, *number)] += -a * turns - b * falls;
            }
        }
        row += columns;
    }
    by
}
