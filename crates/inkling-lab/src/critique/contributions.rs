//! What each signal, and each channel, adds to the information and score of every linear extension.
//!
//! In: signals about a model. Out: [`Part`], the sums over some channels, which `space.rs` adds up and
//! completes. Each channel adds X^T V^-1 X to the information K and X^T V^-1 r to the score g: X is what the
//! extensions look like in its signals (samples x `dimension`), r their residual about the mean channel, and
//! V their covariance:
//!
//! V = v 1 + J within J^T (in each signal) + J between J^T (over all signals of the channel), with the
//! variance v of the noise and the derivatives J of a signal by its FREE own parameters.
//!
//! V^-1 is applied by Woodbury's identity, with inverses of FREE x FREE matrices only: per signal for the
//! scatter within channels (`Whitened`), then per channel for that between them (`Sums::close_channel`).

use super::covariates::COVARIATES;
use super::curvature::posterior_mean;
use super::matrices::{Matrix5, Vector5, inverse_or_zero, scaled};
use super::model::{Linear, Model, PATTERNS, powers};
use super::observations::Observations;
use inkling_core::model::free_decay::{ALL, FREE, Theta};
use nalgebra::{Const, DMatrix, DVector, Dyn, OMatrix, SMatrix};
use std::ops::Range;

/// What a covariate may move in a signal: its ALL parameters, and the share of the previous ring in it.
pub const MOVED: usize = ALL + 1;

/// What so many signals, or channels, take off K is subtracted as one product; only the speed depends on it.
const AT_A_TIME: usize = 64;
const STRIP: usize = 64;

/// Dimension of the space of extensions: a shape's N samples for each of the PATTERNS powers of the drive, and
/// what each of the COVARIATES may move.
fn dimension(samples: usize) -> usize {
    PATTERNS * samples + COVARIATES * MOVED
}

/// Standard deviations of a free channel's parameters over those of a scattered one. The real pole's
/// amplitude is not freed: it would swallow what is slow.
const FREEDOM: [f64; FREE] = [100.0, 100.0, 100.0, 100.0, 1.0];

fn freed(between: &Matrix5) -> Matrix5 {
    Matrix5::from_fn(|i, j| between[(i, j)] * FREEDOM[i] * FREEDOM[j])
}

/// Sums over the signals of some channels; sizes are those of `dimension` d.
pub struct Part {
    /// Information K without `diagonal`, d x d; only its lower triangle is filled.
    pub k: DMatrix<f64>,
    pub g: DVector<f64>,
    /// -2 ln likelihood up to a constant, without the priors of the real pole.
    pub deviance: f64,
    /// What the noise alone gives K, which connects a sample of a shape with the same sample alone. One row
    /// for each pair (p, q) of powers of the drive, at p PATTERNS + q; one column for each sample.
    pub diagonal: DMatrix<f64>,
}

impl Part {
    /// Sums over `rows`, which must hold whole channels, with the own parameters of channels treated in two
    /// ways.
    ///
    /// First, channels are as good as free, for tests of shapes in time. This loses little, since what a
    /// shape does to a channel's parameters it does to the mean of all channels, too, which is free anyway;
    /// and it avoids a bias as large, to first order, as the tangent turns from channel to channel.
    ///
    /// Second, channels are drawn from the population, for tests of covariates, which must be told from
    /// differences between channels. K and g are 0 for shapes there.
    pub fn of(model: &Model, data: &Observations, rows: Range<usize>) -> [Part; 2] {
        let mut all = [
            Sums::new(model, data, PATTERNS, freed(&model.between)),
            Sums::new(model, data, 0, model.between),
        ];
        let mut linear = Linear::default();
        for channel in data.channels().filter(|channel| rows.contains(&channel.start)) {
            let unit = data.rows[channel.start].unit;
            for row in channel {
                model.linearise(row, data, &mut linear);
                let off = model.units[unit] + model.each[row] - model.mean;
                let s = data.beside.drive[row];
                let signal = Whitened::of(&linear, &model.theta(row, data), &off, s, model);
                for sums in &mut all {
                    sums.add_signal(&signal, powers(s), &data.beside.z[row]);
                    sums.hide_behind_signal(&signal, powers(s));
                }
            }
            all.iter_mut().for_each(Sums::close_channel);
        }
        all.map(Sums::finish)
    }

    pub fn with(mut self, other: Part) -> Part {
        self.k += other.k;
        self.g += other.g;
        self.deviance += other.deviance;
        self.diagonal += other.diagonal;
        self
    }

    /// Subtracts M M^T from K, where M has the collected `columns` of so many `rows` each; does nothing with
    /// less than `fewest` columns. The upper triangle is not needed, so strips of columns are subtracted.
    fn take_off(&mut self, columns: &mut Vec<f64>, rows: usize, fewest: usize) {
        if columns.len() >= fewest * rows {
            let m = DMatrix::from_vec(rows, columns.len() / rows, std::mem::take(columns));
            for first in (0..rows).step_by(STRIP) {
                let (width, height) = (STRIP.min(rows - first), rows - first);
                let mut block = self.k.view_mut((first, first), (height, width));
                let across = m.rows(first, width).transpose();
                block.gemm(-1.0, &m.rows(first, height), &across, 1.0);
            }
        }
    }
}

/// One signal in the metric of its noise and of the scatter from burst to burst: V^-1 = 1/v - L L^T. J: the
/// signal's tangent, and what the previous ring adds per unit of its share; N x MOVED.
struct Whitened {
    /// L, N x FREE.
    l: OMatrix<f64, Dyn, Const<FREE>>,
    /// V^-1 J, N x MOVED, and J^T V^-1 J.
    w: DMatrix<f64>,
    h: SMatrix<f64, MOVED, MOVED>,
    /// Score of shapes: V^-1 r of the residual r about the mean channel, where the output f is replaced by its
    /// mean E[f] over the signal's posterior (`curvature.rs`).
    of_shapes: DVector<f64>,
    /// Score of what moves: J^T V^-1 r, and what the curvature adds to that of parameters.
    along_residual: SMatrix<f64, MOVED, 1>,
    counts: Vec<f64>,
    /// ln |V| and r^T V^-1 r.
    ln_determinant: f64,
    square: f64,
}

impl Whitened {
    /// `linear`: about the signal's own parameters `theta`. `off`: the deviation of these from the mean of
    /// all channels, as far as it is not due to covariates. `drive`: relative to the mean drive.
    fn of(linear: &Linear, theta: &Theta, off: &Theta, drive: f64, model: &Model) -> Whitened {
        let (n, v) = (linear.residual.len(), model.noise_var);

        // the residual about the mean channel, to first order: V accounts for the deviation of the signal's
        // own parameters, so it is added back
        let t = &linear.tangent.columns;
        let r = DVector::from_fn(n, |k, _| {
            linear.residual[k] + (0..FREE).map(|j| t[j][k] * off[j]).sum::<f64>()
        });

        // Woodbury: (v + J within J^T)^-1 = 1/v - J M J^T / v² with M = within (1 + G within)^-1 and G = J^T
        // J/v over the FREE columns; so L = J M^1/2 / v
        let j7 = DMatrix::from_fn(n, MOVED, |k, j| if j < ALL { t[j][k] } else { linear.tail[k] });
        let gram = j7.tr_mul(&j7) / v;
        let gram5: Matrix5 = gram.fixed_view::<FREE, FREE>(0, 0).into_owned();
        let inner = Matrix5::identity() + gram5 * model.within;
        let inverse = inverse_or_zero(inner);
        let m = model.within * inverse;
        let m = (m + m.transpose()) * 0.5;
        let j5 = j7.columns(0, FREE).into_owned();
        let l = &j5 * square_root(&m) / v;
        let w = &j7 / v - &l * (l.tr_mul(&j7));
        let of_residual = &r / v - &l * (l.tr_mul(&r));

        let beyond = posterior_mean(theta, linear, drive, &m, v);
        let of_mean = inverse * beyond.slope;
        Whitened {
            h: SMatrix::from_fn(|a, b| j7.column(a).dot(&w.column(b))),
            // Without curvature, the score of the mean's parameters, J^T V^-1 r, is within^-1 times the
            // posterior mean of the signal's deviation. Curvature moves that mean by M slope, so the score by
            // within^-1 M slope = (1 + G within)^-1 slope.
            along_residual: SMatrix::from_fn(|a, _| {
                w.column(a).dot(&r) + of_mean.get(a).copied().unwrap_or(0.0)
            }),
            of_shapes: &of_residual - DVector::from_vec(beyond.expected) / v,
            counts: linear.counts.clone(),
            ln_determinant: inner.determinant().max(f64::MIN_POSITIVE).ln()
                + linear.counted() * v.ln(),
            square: r.dot(&of_residual),
            l,
            w,
        }
    }
}

struct Sums<'a> {
    model: &'a Model,
    data: &'a Observations,
    /// Covariance between channels: that of the model, or the freed one.
    between: Matrix5,
    /// Number of powers of the drive that shapes may scale with; 0: covariates alone.
    patterns: usize,
    part: Part,
    /// The sums over the channel whose signals are being added.
    channel: ChannelSums,
    /// Columns over the shapes whose products the scatter within channels, and that between them, take off K.
    hidden: Vec<f64>,
}

/// Sums over one channel's signals, with V the covariance of a signal about its channel.
struct ChannelSums {
    /// Information J^T V^-1 J of the channel's own parameters, and their score J^T V^-1 r.
    info: Matrix5,
    score: Vector5,
    /// X^T V^-1 J over all extensions X, d x FREE; and the score X^T V^-1 r of the extensions.
    cross: DMatrix<f64>,
    g: DVector<f64>,
}

impl ChannelSums {
    fn new(dimension: usize) -> ChannelSums {
        ChannelSums {
            info: Matrix5::zeros(),
            score: Vector5::zeros(),
            cross: DMatrix::zeros(dimension, FREE),
            g: DVector::zeros(dimension),
        }
    }
}

impl<'a> Sums<'a> {
    fn new(
        model: &'a Model,
        data: &'a Observations,
        patterns: usize,
        between: Matrix5,
    ) -> Sums<'a> {
        let (n, d) = (data.samples, dimension(data.samples));
        Sums {
            model,
            data,
            between,
            patterns,
            part: Part {
                k: DMatrix::zeros(d, d),
                g: DVector::zeros(d),
                deviance: 0.0,
                diagonal: DMatrix::zeros(PATTERNS * PATTERNS, n),
            },
            channel: ChannelSums::new(d),
            hidden: Vec::new(),
        }
    }

    fn finish(self) -> Part {
        let Sums { mut part, mut hidden, data, .. } = self;
        part.take_off(&mut hidden, PATTERNS * data.samples, 1);
        part
    }

    /// Adds one signal to K, to g and to its channel's sums. `powers`: of its drive; `z`: its covariates.
    ///
    /// What an extension looks like in the signal is a Kronecker product: the powers of the drive times a
    /// shape, or the covariates times J. Products of shapes with each other are left to `diagonal` (the
    /// noise) and to `hide_behind_signal` (the scatter).
    fn add_signal(&mut self, signal: &Whitened, powers: [f64; PATTERNS], z: &[f64; COVARIATES]) {
        const BLOCK: usize = COVARIATES * MOVED;
        let (shapes, of_shapes) = (PATTERNS * self.data.samples, self.patterns * self.data.samples);
        let Part { k, deviance, diagonal, .. } = &mut self.part;
        let ChannelSums { info, score, cross, g } = &mut self.channel;
        let Whitened { w, h, .. } = signal;
        let drive = DVector::from_column_slice(&powers[..self.patterns]);
        let z = DVector::from_column_slice(z);
        *deviance += signal.ln_determinant + signal.square;

        if self.patterns > 0 {
            let counts = DVector::from_column_slice(&signal.counts) / self.model.noise_var;
            *diagonal += drive.kronecker(&drive) * counts.transpose();
            let moved = drive.transpose().kronecker(&z.kronecker(&w.transpose()));
            let mut rows = k.view_mut((shapes, 0), (BLOCK, of_shapes));
            rows += moved;
            let mut scores = g.rows_mut(0, of_shapes);
            scores += drive.kronecker(&signal.of_shapes);
            let mut rows = cross.rows_mut(0, of_shapes);
            rows += drive.kronecker(&w.columns(0, FREE));
        }

        let mut block = k.view_mut((shapes, shapes), (BLOCK, BLOCK));
        block += (&z * z.transpose()).kronecker(h);
        let mut scores = g.rows_mut(shapes, BLOCK);
        scores += z.kronecker(&signal.along_residual);
        let mut rows = cross.rows_mut(shapes, BLOCK);
        rows += z.kronecker(&h.fixed_columns::<FREE>(0));
        *score += signal.along_residual.fixed_rows::<FREE>(0);
        *info += h.fixed_view::<FREE, FREE>(0, 0);
    }

    /// Collects what the scatter from burst to burst hides of shapes: L for each power of the drive.
    fn hide_behind_signal(&mut self, signal: &Whitened, powers: [f64; PATTERNS]) {
        if self.patterns == 0 {
            return;
        }
        let shapes = PATTERNS * self.data.samples;
        for column in signal.l.column_iter() {
            for power in powers {
                self.hidden.extend(column.iter().map(|x| x * power));
            }
        }
        self.part.take_off(&mut self.hidden, shapes, AT_A_TIME * FREE);
    }

    /// Accounts for the scatter between channels once all of a channel's signals are in, by Woodbury's
    /// identity: K -= B S B^T and g -= B S `score`, where B is `cross`, and S = between (1 + H between)^-1
    /// with H = `info`.
    fn close_channel(&mut self) {
        let d = self.part.g.len();
        let channel = std::mem::replace(&mut self.channel, ChannelSums::new(d));
        let ChannelSums { info, score, cross, g: mut g_unit } = channel;
        let shapes = PATTERNS * self.data.samples;
        let inner = Matrix5::identity() + info * self.between;
        let s = self.between * inverse_or_zero(inner);
        let s = (s + s.transpose()) * 0.5;

        self.part.deviance += inner.determinant().max(f64::MIN_POSITIVE).ln();
        self.part.deviance -= score.dot(&(s * score));

        // F = B S^1/2, so that B S B^T = F F^T
        let f = &cross * square_root(&s);
        g_unit -= &cross * (s * score);

        if self.patterns > 0 {
            f.column_iter().for_each(|column| self.hidden.extend(column.rows(0, shapes).iter()));
        }

        let low = f.rows(shapes, d - shapes).into_owned();
        let mut block = self.part.k.view_mut((shapes, 0), (d - shapes, d));
        block.gemm(-1.0, &low, &f.transpose(), 1.0);
        self.part.g += g_unit;
    }
}

/// A matrix R with R R^T = m, for an m that is positive semidefinite but for rounding.
fn square_root(m: &Matrix5) -> Matrix5 {
    let scale = Vector5::from_fn(|i, _| m[(i, i)].max(1e-300).sqrt());
    let eigen = scaled(m, &scale).symmetric_eigen();
    let values = eigen.eigenvalues.map(|v| v.max(0.0).sqrt());
    Matrix5::from_diagonal(&scale) * eigen.eigenvectors * Matrix5::from_diagonal(&values)
}
