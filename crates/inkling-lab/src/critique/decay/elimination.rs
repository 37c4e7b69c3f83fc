//! The amplitudes of lines and what series show at rest, eliminated: they are linear, so the best ones are known
//! for any numbers of the rest (variable projection: G. H. Golub and V. Pereyra, SIAM J. Numer. Anal. 10, 1973).
//!
//! In: a [`Fit`] and the noise. Out: the misfit beside the best amplitudes ([`reached`]), and
//! the normal equations of the numbers ([`normal`]), whatever the number of decays few for each output.

use super::decays::Decays;
use super::noise::Noise;
use super::plant::Fit;
use nalgebra::{Complex, DMatrix, DVector};
use std::ops::AddAssign;

/// The columns of all waves as one output's noise sees them: q r, with q orthonormal. A column that others
/// hold is 0 in q, and takes nothing: with an infinite diagonal in r its amplitude is 0.
#[derive(Default)]
pub struct Basis {
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
            r[(j, j)] = if is_new { left } else { f64::INFINITY };
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
    pub fn sd_of_the_first(&self) -> f64 {
        let unit = DVector::from_fn(self.r.ncols(), |j, _| if j == 0 { 1.0 } else { 0.0 });
        self.r.tr_solve_upper_triangular(&unit).map_or(0.0, |solved| solved.norm())
    }

    /// Amplitudes of the columns from coordinates in q.
    fn amplitudes(&self, taken: &DMatrix<f64>) -> Vec<f64> {
        let solved = self.r.solve_upper_triangular(taken);
        solved.map_or_else(|| vec![0.0; taken.len()], |solved| solved.as_slice().to_vec())
    }
}

/// What a point of the descent has come to: for each output the basis, and for each series the whitened
/// misfit and the amplitudes of all columns.
#[derive(Default)]
pub struct Reached {
    pub bases: Vec<Basis>,
    misfits: Vec<DMatrix<f64>>,
    pub free: Vec<Vec<f64>>,
}

/// Columns of the plant's samples as the noise of a series, or of its output, sees them.
fn whitened(mut columns: Vec<Vec<f64>>, fit: &Fit, noise: &Noise, series: usize) -> DMatrix<f64> {
    columns.iter_mut().for_each(|column| noise.apply_to(series, column));
    DMatrix::from_vec(fit.upto, columns.len(), columns.concat())
}

/// Sum of squares of the whitened misfit (infinite where the motion is lost).
pub fn reached(fit: &Fit, noise: &Noise) -> (f64, Reached) {
    let Decays { work, outputs, .. } = fit.decays;
    work.goes_on();
    let columns = fit.columns();
    let bases: Vec<Basis> =
        (0..*outputs).map(|o| Basis::of(whitened(columns.clone(), fit, noise, o))).collect();
    let mut all = Reached { bases, ..Reached::default() };
    let mut sum = 0.0;
    let measured = fit.decays.y.chunks(fit.decays.samples);
    for (i, (moved, measured)) in fit.moved().into_iter().zip(measured).enumerate() {
        let misfit = measured.iter().zip(moved).map(|(y, x)| y - x).collect();
        let mut misfit = whitened(vec![misfit], fit, noise, i);
        let basis = &all.bases[i % outputs];
        let taken = basis.remove_from(&mut misfit);
        sum += misfit.norm_squared();
        all.free.push(basis.amplitudes(&taken));
        all.misfits.push(misfit);
    }
    (if sum.is_finite() { sum } else { f64::INFINITY }, all)
}

/// J^T J and J^T r of the numbers, summed series by series, with what the free amplitudes take removed (L.
/// Kaufman, BIT 15, 1975). The derivatives of waves are those of few columns for all series of an output,
/// weighted by each series' amplitudes.
pub fn normal(fit: &Fit, noise: &Noise, reached: &Reached) -> (DMatrix<f64>, DVector<f64>) {
    let numbers = fit.p.len();
    let (mut gram, mut product) = (DMatrix::zeros(numbers, numbers), DVector::zeros(numbers));
    let Decays { bursts, outputs, .. } = *fit.decays;
    // time times the drift and the damped cosines and sines of all waves
    let constant = fit.at_rest.columns().min(1);
    let mut in_time = fit.columns().split_off(constant);
    for column in &mut in_time {
        column.iter_mut().enumerate().for_each(|(k, x)| *x *= k as f64);
    }
    let turns = |output: usize| {
        let mut turns = whitened(in_time.clone(), fit, noise, output);
        reached.bases[output].remove_from(&mut turns);
        turns
    };
    let turns: Vec<DMatrix<f64>> = (0..outputs).map(turns).collect();
    for burst in 0..bursts {
        fit.decays.work.goes_on();
        for (output, slopes) in fit.slopes(burst).into_iter().enumerate() {
            let series = burst * outputs + output;
            let (at, columns): (Vec<usize>, Vec<Vec<f64>>) = slopes.into_iter().unzip();
            let mut moved = whitened(columns, fit, noise, output);
            reached.bases[output].remove_from(&mut moved);
            let all: Vec<_> = moved.column_iter().chain(turns[output].column_iter()).collect();
            let all = DMatrix::from_columns(&all);
            let by = by_numbers(&at, fit, &reached.free[series][constant..]);
            gram += by.tr_mul(&(all.tr_mul(&all) * &by));
            product += by.tr_mul(&all.tr_mul(&reached.misfits[series])).column(0);
        }
    }
    (gram, product)
}

/// How much of each column is in the derivative by each number: first come the columns of the motion, each the
/// derivative by the number `at` its place, then those of the drift and of waves in time. `free`: their amplitudes in
/// a series. A wave is the real part of (a - i b) e^{-(sigma - i omega) t}.
fn by_numbers(at: &[usize], fit: &Fit, free: &[f64]) -> DMatrix<f64> {
    let mut by = DMatrix::zeros(at.len() + free.len(), fit.p.len());
    at.iter().enumerate().for_each(|(row, number)| by[(row, *number)] = 1.0);
    if let Some(rate) = fit.drift() {
        by[(at.len(), rate)] = -free[0];
    }
    let before = usize::from(fit.drift().is_some());
    for (place, wave) in fit.waves().iter().enumerate() {
        let first = before + 2 * place;
        let row = at.len() + first;
        let amplitude = Complex::new(free[first], -free[first + 1]);
        for (number, [falls, turns]) in &wave.by {
            let moved = amplitude * Complex::new(-falls, *turns);
            by[(row, *number)] += moved.re;
            by[(row + 1, *number)] -= moved.im;
        }
    }
    by
}
