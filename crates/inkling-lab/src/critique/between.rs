//! What bursts have in common along one direction of single signals' parameters.
//!
//! In: signals, with their channel, burst and covariates. Out: [`Contrasts`]: independent differences between
//! bursts, free of channels' own means and of the covariates that signals or bursts follow. A covariate that
//! is constant over a burst costs one contrast, so it is taken out only where bursts follow it by more than
//! chance: with a run's time, temperature and drive and their squares taken out, 9 of 15 would be left, and
//! these tell a variance only by a factor of seven.

use super::chance::{ONCE_IN_100, maximum};
use super::covariates::COVARIATES;
use super::tuned::few;
use nalgebra::{DMatrix, Matrix4, Vector4};

/// Fewest contrasts that tell a variance, and fewest degrees of freedom of single signals.
const FEWEST: usize = 8;

/// One signal's phase, gain, ln sigma and ln omega about its model, and the covariance that noise gives
/// these.
pub struct Scatter {
    pub x: Vector4<f64>,
    pub noise: Matrix4<f64>,
    pub unit: usize,
    pub burst: usize,
    pub beside: [f64; COVARIATES],
}

/// Independent contrasts between bursts, each with variance `own + weight * common`.
pub struct Contrasts {
    each: Vec<Contrast>,
    /// Variance of a single signal, noise included; relative to the weights by which signals were scaled.
    own: f64,
}

/// One contrast, scaled such that single signals give it the variance `own`.
struct Contrast {
    value: f64,
    weight: f64,
}

impl Contrasts {
    /// Contrasts along a direction. `scatter`: variance of single signals along it, beyond noise. `None`: too
    /// few are left.
    pub fn of(each: &[Scatter], direction: usize, scatter: f64) -> Option<Contrasts> {
        let sums = (!each.is_empty()).then(|| Sums::of(each, direction, scatter))?;
        sums.contrasts(&sums.followed())
    }

    /// -2 ln likelihood of a variance that bursts have in common, up to a constant.
    pub fn deviance(&self, common: f64) -> f64 {
        let of = |c: &Contrast| {
            let var = self.own + c.weight * common;
            var.ln() + c.value * c.value / var
        };
        self.each.iter().map(of).sum()
    }

    /// Fisher information of the common variance.
    pub fn information(&self, common: f64) -> f64 {
        let of = |c: &Contrast| 0.5 * (c.weight / (self.own + c.weight * common)).powi(2);
        self.each.iter().map(of).sum()
    }
}

/// Gram matrix over signals of these columns: one indicator per burst, the covariates, and the signal itself;
/// each less its channel's weighted mean.
struct Sums {
    gram: DMatrix<f64>,
    bursts: usize,
    channels: usize,
    signals: usize,
}

impl Sums {
    /// Forms the products. Signals are weighed by the inverse of their variance.
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

    /// Covariates to be taken out: those that vary within bursts, and those that bursts follow by more than
    /// chance.
    fn followed(&self) -> Vec<usize> {
        let Basis { axes, weights } = Basis::of(&self.gram, self.bursts);
        // what the differences between bursts hold of the covariates and of the signal
        let mut held =
            axes.tr_mul(&self.gram.view((0, self.bursts), (self.bursts, COVARIATES + 1)));
        held.row_iter_mut().zip(&weights).for_each(|(mut row, w)| row /= w.sqrt());
        // a covariate that bursts hold nearly all of is constant over a burst, any other varies within bursts
        let all = |c: usize| self.gram[(self.bursts + c, self.bursts + c)];
        let within = |c: &usize| held.column(*c).norm_squared() < (1.0 - few()) * all(*c);
        let (mut out, mut constant): (Vec<usize>, Vec<usize>) =
            (0..COVARIATES).filter(|c| all(*c) > 1e-9 * self.signals as f64).partition(within);
        // of the constant ones, take out the one that bursts follow most, as long as one is significant
        for taken in 1.. {
            let said = held.column(COVARIATES).norm_squared();
            let told = |c: usize| {
                let square = held.column(c).norm_squared();
                // a covariate of which those before have taken nearly all says nothing
                let own = square > few() * all(c);
                if own {
                    held.column(c).dot(&held.column(COVARIATES)).powi(2) / square
                } else {
                    0.0
                }
            };
            let best = constant.iter().copied().max_by(|p, q| told(*p).total_cmp(&told(*q)));
            let Some((best, told)) = best.map(|c| (c, told(c))) else { break };
            let left = (held.nrows() as f64 - 1.0 - taken as f64).max(1.0);
            if told <= ONCE_IN_100.powi(2) * (said - told) / left {
                break;
            }
            let unit = held.column(best).normalize();
            held -= &unit * unit.tr_mul(&held);
            constant.retain(|c| *c != best);
            out.push(best);
        }
        out
    }

    /// The contrasts with some covariates taken out.
    fn contrasts(&self, out: &[usize]) -> Option<Contrasts> {
        let (left, taken) = self.without(out);
        let Basis { axes, weights } = Basis::of(&left, self.bursts);
        let last = left.ncols() - 1;
        let scores = axes.tr_mul(&left.view((0, last), (self.bursts, 1)));
        let each: Vec<Contrast> = (scores.iter().zip(&weights))
            .map(|(score, weight)| Contrast { value: score / weight.sqrt(), weight: *weight })
            .collect();
        let between: f64 = each.iter().map(|c| c.value * c.value).sum();
        // what single signals have left in degrees of freedom, and the variance that they leave
        let free = self.signals as f64 - (self.channels + taken + each.len()) as f64;
        let own = (left[(last, last)] - between).max(1e-300) / free;
        (each.len().min(free as usize) >= FEWEST).then_some(Contrasts { each, own })
    }

    /// The products with some covariates taken out, and the number of these that said anything beside those
    /// before.
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

/// Directions between bursts that signals say something about, with their eigenvalues as weights.
struct Basis {
    axes: DMatrix<f64>,
    weights: Vec<f64>,
}

impl Basis {
    fn of(gram: &DMatrix<f64>, bursts: usize) -> Basis {
        let eigen = gram.view((0, 0), (bursts, bursts)).into_owned().symmetric_eigen();
        let least = few() * eigen.eigenvalues.max();
        let kept: Vec<usize> = (0..bursts).filter(|k| eigen.eigenvalues[*k] > least).collect();
        Basis {
            axes: eigen.eigenvectors.select_columns(&kept),
            weights: kept.iter().map(|k| eigen.eigenvalues[*k]).collect(),
        }
    }
}

/// Replaces each row by its deviation from the weighted mean of its channel, times the root of its weight.
/// Returns the number of channels.
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

/// The variance (rad², relative²) at which a deviance is least: a scan over powers of e, then the golden
/// section.
pub fn least(deviance: impl Fn(f64) -> f64) -> f64 {
    let at = |ln: f64| deviance(ln.exp());
    let middle = (-30..=2).map(f64::from).min_by(|p, q| at(*p).total_cmp(&at(*q))).unwrap_or(0.0);
    let found = maximum(|ln| -at(ln), middle, 1.0).exp();
    if deviance(0.0) <= deviance(found) { 0.0 } else { found }
}
