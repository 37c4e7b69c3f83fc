//! The variance of what all signals of one burst have in common, along one direction of their parameters;
//! `jitter.rs` asks for it along a shift in time and along the amplitude.
//!
//! In: [`Scatter`], signals' parameters with their channel, burst and covariates. Out: [`Contrasts`]:
//! independent differences between bursts, free of channels' own means and of covariates, with the likelihood
//! of that variance.
//!
//! The method is a random-effects analysis of variance by Gram matrices. Each signal is a row with an
//! indicator for each burst, the covariates, and its parameter x along the direction; rows are weighed, and
//! channels' means taken out (`Sums`). The eigenvectors of the block of the indicators are independent
//! contrasts between bursts. The score of one, its eigenvector times the products of indicators and x, has
//! the variance w own + w² common, with its eigenvalue w; divided by sqrt(w) it is own + w common.
//!
//! A covariate that is constant over a burst costs one contrast, and few contrasts tell little of a variance;
//! so it is taken out only where bursts follow it by more than chance.

use super::chance::{ONCE_IN_100, maximum};
use super::covariates::COVARIATES;
use inkling_core::numbers::LITTLE;
use nalgebra::{DMatrix, Matrix4, Vector4};

/// With fewer contrasts, or degrees of freedom of single signals, nothing is told.
const FEWEST: usize = 8;

/// How far one signal's parameters lie from what its model expects of it.
pub struct Scatter {
    /// Shift in time, rad of the ring; relative amplitude; ln sigma; ln omega.
    pub x: Vector4<f64>,
    pub noise: Matrix4<f64>,
    /// Index of its channel, without a gap.
    pub unit: usize,
    pub burst: usize,
    /// Its covariates, with the square of the drive in place of the constant.
    pub beside: [f64; COVARIATES],
}

/// Independent contrasts between bursts, each with variance `own + weight * common`.
pub struct Contrasts {
    each: Vec<Contrast>,
    /// Variance that single signals give each contrast, relative to that by which signals were weighed.
    own: f64,
}

struct Contrast {
    value: f64,
    /// About the number of signals of a burst over the variance of one.
    weight: f64,
}

impl Contrasts {
    /// Contrasts along a direction, an index of [`Scatter::x`]. `scatter`: variance of single signals along
    /// it beyond that of the noise. `None`: too few are left.
    pub fn of(each: &[Scatter], direction: usize, scatter: f64) -> Option<Contrasts> {
        let sums = (!each.is_empty()).then(|| Sums::of(each, direction, scatter))?;
        sums.contrasts(&sums.followed())
    }

    pub fn deviance(&self, common: f64) -> f64 {
        let of = |c: &Contrast| {
            let var = self.own + c.weight * common;
            var.ln() + c.value * c.value / var
        };
        self.each.iter().map(of).sum()
    }

    pub fn information(&self, common: f64) -> f64 {
        let of = |c: &Contrast| 0.5 * (c.weight / (self.own + c.weight * common)).powi(2);
        self.each.iter().map(of).sum()
    }
}

/// Inner products of the columns: one indicator for each burst, the covariates, the signals' parameter.
struct Sums {
    /// Gram matrix of the columns, after [`less_channels`].
    gram: DMatrix<f64>,
    bursts: usize,
    channels: usize,
    signals: usize,
}

impl Sums {
    /// Signals are weighed by the inverse of the variance that is expected of them.
    fn of(each: &[Scatter], direction: usize, scatter: f64) -> Sums {
        let of = |one: &Scatter| 1.0 / (scatter + one.noise[(direction, direction)]);
        let weights: Vec<f64> = each.iter().map(of).collect();
        let mut numbers: Vec<usize> = each.iter().map(|one| one.burst).collect();
        numbers.sort_unstable();
        numbers.dedup();
        let (signals, bursts) = (each.len(), numbers.len());
        let mut m = DMatrix::<f64>::zeros(signals, bursts + COVARIATES + 1);
        for (i, one) in each.iter().enumerate() {
            m[(i, numbers.partition_point(|burst| *burst < one.burst))] = 1.0;
            (0..COVARIATES).for_each(|c| m[(i, bursts + c)] = one.beside[c]);
            m[(i, bursts + COVARIATES)] = one.x[direction];
        }
        let channels = less_channels(&mut m, each, &weights);
        Sums { gram: m.tr_mul(&m), bursts, channels, signals }
    }

    /// Indices of the covariates to be taken out: those that vary within bursts (they cost no contrast), and
    /// those that bursts follow by more than chance (forward selection by Student's t).
    fn followed(&self) -> Vec<usize> {
        let Basis { axes, weights } = Basis::of(&self.gram, self.bursts);
        // projections of the covariates and of the signals' parameter, one column each, on the contrasts
        let mut between =
            axes.tr_mul(&self.gram.view((0, self.bursts), (self.bursts, COVARIATES + 1)));
        between.row_iter_mut().zip(&weights).for_each(|(mut row, w)| row /= w.sqrt());

        // a covariate whose square lies nearly all between bursts is constant over a burst; one whose square
        // vanishes is left out altogether
        let square = |c: usize| self.gram[(self.bursts + c, self.bursts + c)];
        let within = |c: &usize| between.column(*c).norm_squared() < (1.0 - LITTLE) * square(*c);
        let (mut out, mut constant): (Vec<usize>, Vec<usize>) =
            (0..COVARIATES).filter(|c| square(*c) > 1e-9 * self.signals as f64).partition(within);

        // of the constant ones, take out the one that bursts follow most, as long as it is significant
        for taken in 1.. {
            let whole = between.column(COVARIATES).norm_squared();
            // the part of that square that a covariate explains; one of which those before have taken nearly
            // all says nothing
            let explained = |c: usize| {
                let own = between.column(c).norm_squared();
                if own > LITTLE * square(c) {
                    between.column(c).dot(&between.column(COVARIATES)).powi(2) / own
                } else {
                    0.0
                }
            };
            let best =
                constant.iter().copied().max_by(|p, q| explained(*p).total_cmp(&explained(*q)));
            let Some((best, explained)) = best.map(|c| (c, explained(c))) else { break };
            let left = (between.nrows() as f64 - 1.0 - taken as f64).max(1.0);
            if explained <= ONCE_IN_100.powi(2) * (whole - explained) / left {
                break;
            }
            let unit = between.column(best).normalize();
            between -= &unit * unit.tr_mul(&between);
            constant.retain(|c| *c != best);
            out.push(best);
        }
        out
    }

    fn contrasts(&self, out: &[usize]) -> Option<Contrasts> {
        let (left, taken) = self.without(out);
        let Basis { axes, weights } = Basis::of(&left, self.bursts);
        let last = left.ncols() - 1;
        let scores = axes.tr_mul(&left.view((0, last), (self.bursts, 1)));
        let each: Vec<Contrast> = (scores.iter().zip(&weights))
            .map(|(score, weight)| Contrast { value: score / weight.sqrt(), weight: *weight })
            .collect();
        let between: f64 = each.iter().map(|c| c.value * c.value).sum();

        let free = self.signals as f64 - (self.channels + taken + each.len()) as f64;
        let own = (left[(last, last)] - between).max(1e-300) / free;
        (each.len().min(free as usize) >= FEWEST).then_some(Contrasts { each, own })
    }

    /// The Gram matrix with some covariates projected out, one after the other; and how many of these were
    /// not yet contained in those before them.
    fn without(&self, out: &[usize]) -> (DMatrix<f64>, usize) {
        let (mut left, mut taken) = (self.gram.clone(), 0);
        for c in out.iter().map(|c| self.bursts + c) {
            if left[(c, c)] > 1e-6 * self.gram[(c, c)] {
                let column = left.column(c).into_owned();
                left -= &column * column.transpose() / column[c];
                taken += 1;
            }
        }
        (left, taken)
    }
}

/// Eigenvectors (unit vectors over bursts, in columns) and eigenvalues of the Gram matrix of the bursts'
/// indicators, but those whose eigenvalue is a tenth of the largest one, or less.
struct Basis {
    axes: DMatrix<f64>,
    weights: Vec<f64>,
}

impl Basis {
    fn of(gram: &DMatrix<f64>, bursts: usize) -> Basis {
        let eigen = gram.view((0, 0), (bursts, bursts)).into_owned().symmetric_eigen();
        let least = LITTLE * eigen.eigenvalues.max();
        let kept: Vec<usize> = (0..bursts).filter(|k| eigen.eigenvalues[*k] > least).collect();
        Basis {
            axes: eigen.eigenvectors.select_columns(&kept),
            weights: kept.iter().map(|k| eigen.eigenvalues[*k]).collect(),
        }
    }
}

/// Replaces each row, a signal, by its deviation from the weighted mean of its channel, times the root of its
/// weight. Returns the number of channels.
fn less_channels(m: &mut DMatrix<f64>, each: &[Scatter], weights: &[f64]) -> usize {
    let units = each.iter().map(|one| one.unit + 1).max().unwrap_or(0);
    let mut sums = DMatrix::<f64>::zeros(units, m.ncols());
    let mut total = vec![0.0; units];
    for (i, one) in each.iter().enumerate() {
        total[one.unit] += weights[i];
        let mut sum = sums.row_mut(one.unit);
        sum += m.row(i) * weights[i];
    }
    for (i, one) in each.iter().enumerate() {
        let centred = (m.row(i) - sums.row(one.unit) / total[one.unit]) * weights[i].sqrt();
        m.set_row(i, &centred);
    }
    units
}

/// The variance at which a deviance is least: 0, or the best power of e from -30 to 2, refined by golden
/// section.
pub fn least(deviance: impl Fn(f64) -> f64) -> f64 {
    let at = |ln: f64| deviance(ln.exp());
    let middle = (-30..=2).map(f64::from).min_by(|p, q| at(*p).total_cmp(&at(*q))).unwrap_or(0.0);
    let found = maximum(|ln| -at(ln), middle, 1.0).exp();
    if deviance(0.0) <= deviance(found) { 0.0 } else { found }
}
