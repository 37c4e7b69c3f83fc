//! Information and score of every linear extension of the model at once.
//!
//! In: a fitted model and its signals. Out: [`Space`], K = sum X^T V^-1 X and g = sum X^T V^-1 r over
//! X = [any shape in time, times the drive to the power 0..3 | every covariate on every parameter |
//! the tail of the previous ring]. V holds the noise and both scatters (Woodbury; first the bursts',
//! then the channels'). A candidate is a direction in this space: its likelihood-ratio statistic, with
//! whatever nuisance, is linear algebra on K and g, and the signals are read once.

use super::covariates::{COVARIATES, Covariates, ONE};
use super::curvature::beyond_the_likeliest;
use super::matrices::{Matrix5, Vector5, scaled};
use super::model::{Linear, Model, PATTERNS};
use super::observations::Observations;
use super::tuned::LN_LAMBDA_SD;
use inkling_core::model::free_decay::{ALL, FREE, Theta};
use nalgebra::{Const, DMatrix, DVector, Dyn, OMatrix, SMatrix};
use std::ops::Range;

type Matrix6 = SMatrix<f64, ALL, ALL>;

/// Channels whose part of K is held until it is added as one product.
const AT_A_TIME: usize = 64;
/// Of larger sets, this many signals (whole channels, evenly) tell how the scatter hides shapes.
const MOST_FOR_SCATTER: usize = 1024;

/// How a channel's own parameters count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channels {
    /// As good as free: for shapes in time. What a shape does to a channel's parameters it does to the
    /// mean of all, which is free anyway; and to first order that knowledge would be biased, by as much
    /// as the tangent turns from channel to channel.
    Free,
    /// Drawn from the population: for covariates. Shapes are left out.
    Scattered,
}

/// Standard deviation of a free channel over that of a scattered one. The real pole's amplitude is not
/// freed: its tangent does not turn from channel to channel, and free it would swallow what is slow.
const FREEDOM: [f64; FREE] = [100.0, 100.0, 100.0, 100.0, 1.0];

fn freed(between: &Matrix5) -> Matrix5 {
    Matrix5::from_fn(|i, j| between[(i, j)] * FREEDOM[i] * FREEDOM[j])
}

#[derive(Clone, Debug)]
pub struct Space {
    pub samples: usize,
    /// ln lambda beyond what its prior expects.
    pub lambda_off: f64,
    /// Amplitude of the real pole, and what it is expected within, counts.
    pub slow: [f64; 2],
    pub k: DMatrix<f64>,
    pub g: DVector<f64>,
    pub signals: usize,
    pub units: usize,
    /// -2 ln likelihood at no extension, up to a constant.
    pub deviance: f64,
}

/// A direction: blocks of numbers at places of the space.
#[derive(Clone, Debug)]
pub struct Direction(pub Vec<(usize, Vec<f64>)>);

impl Direction {
    /// A shape that scales as the drive to the power `pattern`. `shape`: N.
    pub fn shape(pattern: usize, shape: Vec<f64>) -> Direction {
        Direction(vec![(pattern * shape.len(), shape)])
    }

    /// A change of the parameters with a covariate.
    pub fn covariate(samples: usize, which: usize, v: [f64; ALL]) -> Direction {
        Direction(vec![(PATTERNS * samples + which * ALL, v.to_vec())])
    }

    /// Of one parameter alone.
    pub fn parameter(samples: usize, which: usize, j: usize) -> Direction {
        let mut v = [0.0; ALL];
        v[j] = 1.0;
        Direction::covariate(samples, which, v)
    }

    pub fn tail(samples: usize) -> Direction {
        Direction(vec![(PATTERNS * samples + COVARIATES * ALL, vec![1.0])])
    }

    fn dot(&self, x: &DVector<f64>) -> f64 {
        self.0
            .iter()
            .map(|(at, v)| v.iter().enumerate().map(|(i, v)| v * x[at + i]).sum::<f64>())
            .sum()
    }
}

impl Space {
    pub fn dimension(samples: usize) -> usize {
        PATTERNS * samples + COVARIATES * ALL + 1
    }

    /// Two threads, half of the channels each: the sums are the same however many processors there are.
    pub fn of(
        model: &Model,
        data: &Observations,
        beside: &Covariates,
        channels: Channels,
    ) -> Space {
        let n = data.samples;
        let d = Space::dimension(n);
        let shapes = PATTERNS * n;
        let mut middle = data.len() / 2;
        while middle > 0 && data.rows[middle].unit == data.rows[middle - 1].unit {
            middle -= 1;
        }
        let part = |rows: Range<usize>| Part::of(model, data, beside, channels, rows);
        let both = std::thread::scope(|scope| {
            let other = scope.spawn(|| part(middle..data.len()));
            let first = part(0..middle);
            first.with(other.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
        });
        let Part { mut k, g, mut deviance, diagonal } = both;
        for (a, of_sample) in diagonal.iter().enumerate() {
            for p in 0..PATTERNS {
                for q in 0..PATTERNS {
                    k[(p * n + a, q * n + a)] += of_sample[p][q];
                }
            }
        }
        // the lower left block was filled; mirror it
        for row in shapes..d {
            for column in 0..shapes {
                k[(column, row)] = k[(row, column)];
            }
        }
        for c in shapes..d - 1 {
            k[(c, d - 1)] = k[(d - 1, c)];
        }
        let off = model.lambda_off();
        deviance += (off / LN_LAMBDA_SD).powi(2);
        let slow = [model.mean[4], model.slow_sd()];
        deviance += (slow[0] / slow[1]).powi(2);
        Space {
            samples: n,
            lambda_off: off,
            slow,
            k,
            g,
            signals: data.len(),
            units: data.units,
            deviance,
        }
    }

    /// K x for a direction.
    pub fn times(&self, x: &Direction) -> DVector<f64> {
        let mut out = DVector::zeros(self.k.nrows());
        for (at, v) in &x.0 {
            let block = self.k.columns(*at, v.len());
            out += block * DVector::from_column_slice(v);
        }
        out
    }
}

/// What the signals of some channels add.
struct Part {
    k: DMatrix<f64>,
    g: DVector<f64>,
    deviance: f64,
    /// What each sample adds to its own place, per pair of powers of the drive.
    diagonal: Vec<[[f64; PATTERNS]; PATTERNS]>,
}

impl Part {
    fn of(
        model: &Model,
        data: &Observations,
        beside: &Covariates,
        channels: Channels,
        rows: Range<usize>,
    ) -> Part {
        let n = data.samples;
        let d = Space::dimension(n);
        let (patterns, between) = match channels {
            Channels::Free => (PATTERNS, freed(&model.between)),
            Channels::Scattered => (0, model.between),
        };
        let stride = data.len().div_ceil(MOST_FOR_SCATTER).max(1);
        let chosen_units = data.units.div_ceil(stride);
        let mut sums = Sums {
            model,
            data,
            beside,
            between,
            patterns,
            stride,
            inflate: (data.units as f64 / chosen_units as f64).sqrt(),
            part: Part {
                k: DMatrix::zeros(d, d),
                g: DVector::zeros(d),
                deviance: 0.0,
                diagonal: vec![[[0.0; PATTERNS]; PATTERNS]; n],
            },
            of_signals: Vec::new(),
            of_channels: Vec::new(),
        };
        let mut i = rows.start;
        while i < rows.end {
            let unit = data.rows[i].unit;
            let mut end = i;
            while end < rows.end && data.rows[end].unit == unit {
                end += 1;
            }
            sums.add_channel(unit, i..end);
            i = end;
        }
        let Sums { mut part, mut of_signals, mut of_channels, .. } = sums;
        part.take_off(&mut of_signals, PATTERNS * n);
        part.take_off(&mut of_channels, PATTERNS * n);
        part
    }

    /// What both add.
    fn with(mut self, other: Part) -> Part {
        self.k += other.k;
        self.g += other.g;
        self.deviance += other.deviance;
        let of_other = other.diagonal.as_flattened().as_flattened();
        let own = self.diagonal.as_flattened_mut().as_flattened_mut();
        own.iter_mut().zip(of_other).for_each(|(sum, v)| *sum += v);
        self
    }

    /// Takes the squares of columns of so many rows off K, as one product.
    fn take_off(&mut self, columns: &mut Vec<f64>, rows: usize) {
        if !columns.is_empty() {
            let m = DMatrix::from_vec(rows, columns.len() / rows, std::mem::take(columns));
            let mut block = self.k.view_mut((0, 0), (rows, rows));
            block.gemm(-1.0, &m, &m.transpose(), 1.0);
        }
    }
}

/// A signal in the metric of its noise and of the scatter from burst to burst, V^-1 = 1/v - L L^T.
struct Weighed {
    /// L, N x FREE.
    l: OMatrix<f64, Dyn, Const<FREE>>,
    /// V^-1 J, N x ALL, and J^T V^-1 J.
    w: DMatrix<f64>,
    h: Matrix6,
    /// V^-1 r and J^T V^-1 r of the residual.
    of_residual: DVector<f64>,
    /// The same for shapes, which stay where they are when a signal's parameters move.
    of_shapes: DVector<f64>,
    along_residual: SMatrix<f64, ALL, 1>,
    /// The tail of the previous ring, and the same of it.
    tail: DVector<f64>,
    of_tail: DVector<f64>,
    along_tail: SMatrix<f64, ALL, 1>,
    /// 1 for every sample that counts.
    counts: Vec<f64>,
    /// ln |V| and r^T V^-1 r.
    ln_determinant: f64,
    square: f64,
}

impl Weighed {
    /// `theta`: the signal's parameters; `off`: its own less the mean of all channels.
    fn of(linear: &Linear, theta: &Theta, off: &Theta, drive: f64, model: &Model) -> Weighed {
        let (n, v) = (linear.residual.len(), model.noise_var);
        // working residual: about the mean, not about the channel's own parameters
        let t = &linear.tangent.columns;
        let r = DVector::from_fn(n, |k, _| {
            linear.residual[k] + (0..FREE).map(|j| t[j][k] * off[j]).sum::<f64>()
        });
        let j6 = DMatrix::from_fn(n, ALL, |k, j| t[j][k]);
        let gram = j6.tr_mul(&j6) / v;
        let gram5: Matrix5 = gram.fixed_view::<FREE, FREE>(0, 0).into_owned();
        let inner = Matrix5::identity() + gram5 * model.within;
        // M = within (1 + G within)^-1: V^-1 = 1/v - J M J^T / v²
        let inverse = inner.try_inverse().unwrap_or_else(Matrix5::zeros);
        let m = model.within * inverse;
        let m = (m + m.transpose()) * 0.5;
        let j5 = j6.columns(0, FREE).into_owned();
        let l = &j5 * square_root(&m) / v;
        let solve = |x: &DVector<f64>| x / v - &l * (l.tr_mul(x));
        let w = &j6 / v - &l * (l.tr_mul(&j6));
        let of_residual = solve(&r);
        let beyond = beyond_the_likeliest(theta, linear, drive, &m, v);
        let of_mean = inverse * beyond.slope;
        let tail = DVector::from_column_slice(&linear.tail);
        Weighed {
            h: Matrix6::from_fn(|a, b| j6.column(a).dot(&w.column(b))),
            // the mean is told by the posteriors' means: W^-1 D = (1 + G within)^-1
            along_residual: SMatrix::from_fn(|a, _| {
                w.column(a).dot(&r) + of_mean.get(a).copied().unwrap_or(0.0)
            }),
            of_shapes: &of_residual - DVector::from_vec(beyond.expected) / v,
            of_tail: solve(&tail),
            along_tail: SMatrix::from_fn(|a, _| w.column(a).dot(&tail)),
            counts: linear.counts.clone(),
            ln_determinant: inner.determinant().max(f64::MIN_POSITIVE).ln()
                + linear.counted() * v.ln(),
            square: r.dot(&of_residual),
            l,
            w,
            of_residual,
            tail,
        }
    }
}

/// A [`Part`] as it grows, channel by channel.
struct Sums<'a> {
    model: &'a Model,
    data: &'a Observations,
    beside: &'a Covariates,
    between: Matrix5,
    /// Powers of the drive that shapes are looked at for; none: covariates alone.
    patterns: usize,
    /// Every so manieth channel tells how the scatter hides shapes, weighed by so much.
    stride: usize,
    inflate: f64,
    part: Part,
    /// What the scatter takes off K, columns of the shapes' rows, until they are worth a product.
    of_signals: Vec<f64>,
    of_channels: Vec<f64>,
}

/// What one channel's signals add.
struct OfChannel {
    /// J^T V^-1 J and J^T V^-1 r over the free parameters.
    info: Matrix5,
    score: Vector5,
    /// X^T V^-1 J, and X^T V^-1 r.
    cross: DMatrix<f64>,
    g: DVector<f64>,
}

impl Sums<'_> {
    fn add_channel(&mut self, unit: usize, rows: Range<usize>) {
        let Sums { model, data, beside, .. } = *self;
        let d = Space::dimension(data.samples);
        let tells_scatter = unit.is_multiple_of(self.stride) && self.patterns > 0;
        let mut channel = OfChannel {
            info: Matrix5::zeros(),
            score: Vector5::zeros(),
            cross: DMatrix::zeros(d, FREE),
            g: DVector::zeros(d),
        };
        let mut linear = Linear::default();
        for row in rows {
            model.linearise(row, data, beside, &mut linear);
            let off = model.units[unit] + model.each[row] - model.mean;
            let s = beside.drive[row];
            let theta = model.theta(row, data, beside);
            let signal = Weighed::of(&linear, &theta, &off, s, model);
            let powers = [1.0, s, s * s, s * s * s];
            self.add_signal(&signal, powers, &beside.z[row], &mut channel);
            if tells_scatter {
                self.hide_behind_signal(&signal, powers);
            }
        }
        self.close_channel(channel, tells_scatter);
    }

    /// `powers`: of the signal's drive; `z`: its covariates.
    fn add_signal(
        &mut self,
        signal: &Weighed,
        powers: [f64; PATTERNS],
        z: &[f64; COVARIATES],
        channel: &mut OfChannel,
    ) {
        let (n, v) = (self.data.samples, self.model.noise_var);
        let (d, shapes) = (Space::dimension(n), PATTERNS * n);
        let Part { k, deviance, diagonal, .. } = &mut self.part;
        let OfChannel { info, score, cross, g } = channel;
        let Weighed { w, h, .. } = signal;
        *deviance += signal.ln_determinant;
        *deviance += signal.square;
        for p in 0..self.patterns {
            for a in 0..n {
                for q in 0..self.patterns {
                    diagonal[a][p][q] += signal.counts[a] * powers[p] * powers[q] / v;
                }
                g[p * n + a] += powers[p] * signal.of_shapes[a];
                for (c, zc) in z.iter().enumerate().filter(|(_, zc)| **zc != 0.0) {
                    for j in 0..ALL {
                        k[(shapes + c * ALL + j, p * n + a)] += powers[p] * zc * w[(a, j)];
                    }
                }
                k[(d - 1, p * n + a)] += powers[p] * signal.of_tail[a]; // row of the tail
                for j in 0..FREE {
                    cross[(p * n + a, j)] += powers[p] * w[(a, j)];
                }
            }
        }
        for (c, zc) in z.iter().enumerate().filter(|(_, zc)| **zc != 0.0) {
            for j in 0..ALL {
                let at = shapes + c * ALL + j;
                g[at] += zc * signal.along_residual[j];
                k[(d - 1, at)] += zc * signal.along_tail[j];
                for f in 0..FREE {
                    cross[(at, f)] += zc * h[(f, j)];
                }
                for (e, ze) in z.iter().enumerate() {
                    for b in 0..ALL {
                        k[(at, shapes + e * ALL + b)] += zc * ze * h[(j, b)];
                    }
                }
            }
        }
        g[d - 1] += signal.tail.dot(&signal.of_residual);
        k[(d - 1, d - 1)] += signal.tail.dot(&signal.of_tail);
        for f in 0..FREE {
            cross[(d - 1, f)] += signal.along_tail[f];
            score[f] += signal.along_residual[f];
        }
        *info += h.fixed_view::<FREE, FREE>(0, 0);
    }

    /// What the scatter from burst to burst hides of shapes.
    fn hide_behind_signal(&mut self, signal: &Weighed, powers: [f64; PATTERNS]) {
        let (shapes, scale) = (PATTERNS * self.data.samples, self.inflate);
        for column in signal.l.column_iter() {
            for power in powers {
                self.of_signals.extend(column.iter().map(|x| x * power * scale));
            }
        }
        if self.of_signals.len() >= AT_A_TIME * FREE * shapes {
            self.part.take_off(&mut self.of_signals, shapes);
        }
    }

    /// The scatter between channels: K -= B^T S B with S = between (1 + H between)^-1.
    fn close_channel(&mut self, channel: OfChannel, tells_scatter: bool) {
        let OfChannel { info, score, cross, g: mut g_unit } = channel;
        let d = g_unit.len();
        let shapes = PATTERNS * self.data.samples;
        let inner = Matrix5::identity() + info * self.between;
        let s = self.between * inner.try_inverse().unwrap_or_else(Matrix5::zeros);
        let s = (s + s.transpose()) * 0.5;
        self.part.deviance += inner.determinant().max(f64::MIN_POSITIVE).ln();
        self.part.deviance -= score.dot(&(s * score));
        let root = square_root(&s);
        let f = &cross * DMatrix::from_fn(FREE, FREE, |a, b| root[(a, b)]);
        g_unit -= &cross * DVector::from_column_slice((s * score).as_slice());
        if tells_scatter {
            let scale = self.inflate;
            for column in f.column_iter() {
                self.of_channels.extend(column.rows(0, shapes).iter().map(|x| x * scale));
            }
            if self.of_channels.len() >= AT_A_TIME * FREE * shapes {
                self.part.take_off(&mut self.of_channels, shapes);
            }
        }
        let low = f.rows(shapes, d - shapes).into_owned();
        let mut block = self.part.k.view_mut((shapes, 0), (d - shapes, d));
        block.gemm(-1.0, &low, &f.transpose(), 1.0);
        self.part.g += g_unit;
    }
}

/// Directions that are allowed for before anything is tested: the mean of all channels (lambda within
/// its prior), and the causes that are in the model already.
#[derive(Clone, Debug)]
pub struct Nuisance {
    directions: Vec<Direction>,
    inverse: DMatrix<f64>,
    score: DVector<f64>,
    /// What is added to the space's score: causes taken out of the model again.
    moved: Option<DVector<f64>>,
}

/// What testing a direction (or several together) gives.
#[derive(Clone, Debug)]
pub struct Tested {
    /// g^T K^-1 g after the nuisance: chi-squared with as many degrees as directions.
    pub statistic: f64,
    pub coefficients: Vec<f64>,
    pub covariance: DMatrix<f64>,
}

impl Nuisance {
    pub fn new(space: &Space, causes: &[Direction]) -> Nuisance {
        let unit = |j| Direction::parameter(space.samples, ONE, j);
        let mut directions: Vec<Direction> = (0..ALL).map(unit).collect();
        directions.extend(causes.iter().cloned());
        let k_times: Vec<DVector<f64>> = directions.iter().map(|x| space.times(x)).collect();
        let q = directions.len();
        let mut gram = DMatrix::from_fn(q, q, |i, j| directions[i].dot(&k_times[j]));
        gram[(ALL - 1, ALL - 1)] += 1.0 / (LN_LAMBDA_SD * LN_LAMBDA_SD);
        let mut score = DVector::from_fn(q, |i, _| directions[i].dot(&space.g));
        score[ALL - 1] -= space.lambda_off / (LN_LAMBDA_SD * LN_LAMBDA_SD);
        let [slow, slow_sd] = space.slow;
        gram[(4, 4)] += 1.0 / (slow_sd * slow_sd);
        score[4] -= slow / (slow_sd * slow_sd);
        Nuisance { inverse: pseudo_inverse(&gram), directions, score, moved: None }
    }

    /// Looks at the data as if a cause in the model, `coefficient` of a direction, were not in it.
    pub fn move_score(&mut self, space: &Space, direction: &Direction, coefficient: f64) {
        let step = space.times(direction) * coefficient;
        for (score, own) in self.score.iter_mut().zip(&self.directions) {
            *score += own.dot(&step);
        }
        match &mut self.moved {
            Some(moved) => *moved += step,
            None => self.moved = Some(step),
        }
    }

    /// Coefficients of the causes in the nuisance, jointly, with their covariance.
    pub fn causes(&self) -> (DVector<f64>, DMatrix<f64>) {
        let q = self.directions.len();
        let all = &self.inverse * &self.score;
        (
            all.rows(ALL, q - ALL).into_owned(),
            self.inverse.view((ALL, ALL), (q - ALL, q - ALL)).into_owned(),
        )
    }

    /// Shift of the mean parameters that the data ask for.
    pub fn mean_shift(&self) -> [f64; ALL] {
        let all = &self.inverse * &self.score;
        std::array::from_fn(|j| all[j])
    }

    /// Gain of the nuisance itself in -2 ln likelihood.
    pub fn gain(&self) -> f64 {
        self.score.dot(&(&self.inverse * &self.score))
    }

    /// Likelihood-ratio test of some directions together.
    pub fn test(&self, space: &Space, directions: &[Direction]) -> Option<Tested> {
        let q = directions.len();
        let k_times: Vec<DVector<f64>> = directions.iter().map(|x| space.times(x)).collect();
        let cross =
            DMatrix::from_fn(self.directions.len(), q, |i, j| self.directions[i].dot(&k_times[j]));
        let raw = DMatrix::from_fn(q, q, |i, j| directions[i].dot(&k_times[j]));
        let gram = &raw - cross.tr_mul(&(&self.inverse * &cross));
        // a direction that the nuisance holds already says nothing
        if (0..q).any(|i| gram[(i, i)] <= 1e-7 * raw[(i, i)] || gram[(i, i)] <= 0.0) {
            return None;
        }
        let own = |x: &Direction| x.dot(&space.g) + self.moved.as_ref().map_or(0.0, |m| x.dot(m));
        let score = DVector::from_fn(q, |i, _| own(&directions[i]))
            - cross.tr_mul(&(&self.inverse * &self.score));
        let covariance = gram.cholesky()?.inverse();
        let coefficients = &covariance * &score;
        Some(Tested {
            statistic: score.dot(&coefficients),
            coefficients: coefficients.as_slice().to_vec(),
            covariance,
        })
    }

    /// Directions together, each by so much, less what the nuisance makes of them.
    pub fn efficient(
        &self,
        space: &Space,
        directions: &[Direction],
        coefficients: &[f64],
    ) -> Direction {
        let mut blocks = Vec::new();
        let mut add = |direction: &Direction, by: f64| {
            let scaled = direction.0.iter();
            blocks.extend(scaled.map(|(at, v)| (*at, v.iter().map(|v| by * v).collect())));
        };
        directions.iter().zip(coefficients).for_each(|(direction, by)| add(direction, *by));
        let mut cross = DVector::zeros(self.directions.len());
        for (direction, by) in directions.iter().zip(coefficients) {
            let k_times = space.times(direction) * *by;
            cross += DVector::from_fn(cross.len(), |i, _| self.directions[i].dot(&k_times));
        }
        let weight = &self.inverse * cross;
        self.directions.iter().zip(weight.iter()).for_each(|(own, by)| add(own, -by));
        Direction(blocks)
    }
}

fn square_root(m: &Matrix5) -> Matrix5 {
    let scale = Vector5::from_fn(|i, _| m[(i, i)].max(1e-300).sqrt());
    let eigen = scaled(m, &scale).symmetric_eigen();
    let values = eigen.eigenvalues.map(|v| v.max(0.0).sqrt());
    Matrix5::from_diagonal(&scale) * eigen.eigenvectors * Matrix5::from_diagonal(&values)
}

fn pseudo_inverse(m: &DMatrix<f64>) -> DMatrix<f64> {
    let n = m.nrows();
    let scale = DVector::from_fn(n, |i, _| m[(i, i)].max(1e-300).sqrt());
    let unit = DMatrix::from_fn(n, n, |i, j| m[(i, j)] / (scale[i] * scale[j]));
    let eigen = unit.symmetric_eigen();
    let values = eigen.eigenvalues.map(|v| if v > 1e-10 { 1.0 / v } else { 0.0 });
    let inverse =
        &eigen.eigenvectors * DMatrix::from_diagonal(&values) * eigen.eigenvectors.transpose();
    DMatrix::from_fn(n, n, |i, j| inverse[(i, j)] / (scale[i] * scale[j]))
}

#[cfg(test)]
mod tests {
    use super::super::generator::{Run, draw};
    use super::*;

    #[test]
    fn two_halves_of_the_channels_say_what_all_say() {
        let data = draw(&Run { channels: 7, bursts: 3, ..Run::default() }, 33);
        let beside = Covariates::of(&data);
        let mut model = Model::start(&data, &beside, true).unwrap();
        model.fit(&data, &beside, 1);
        for channels in [Channels::Free, Channels::Scattered] {
            let space = Space::of(&model, &data, &beside, channels);
            let whole = Part::of(&model, &data, &beside, channels, 0..data.len());
            let near = |a: f64, b: f64, scale: f64| (a - b).abs() <= 1e-9 * scale.max(1.0);
            let scale = whole.g.amax();
            assert!(space.g.iter().zip(&whole.g).all(|(a, b)| near(*a, *b, scale)));
            let low = PATTERNS * data.samples;
            let scale = whole.k.amax();
            for row in low..space.k.nrows() {
                for column in 0..low {
                    assert!(near(space.k[(row, column)], whole.k[(row, column)], scale));
                }
            }
        }
    }
}
