//! The tail of healthy energies: a generalised Pareto distribution, and how uncertain its sample
//! leaves it.
//!
//! In: the largest energies, the level that they exceed, and how many independent ones they are
//! worth. Out: the posterior of the energy that is exceeded at a given rate, which may lie far
//! beyond the sample.
//!
//! The method is peaks over threshold (Pickands 1975): whatever the distribution, excesses z over a
//! high level are about generalised Pareto distributed, P(excess > z) = (1 + xi z / scale)^(-1 /
//! xi), which at the shape xi = 0 is exponential. The steps:
//!
//! 1. The priors of xi (on a grid) and of ln scale are flat.
//! 2. For each xi find the scale of maximum likelihood. Given xi, the posterior of ln scale is
//!    Gaussian about it with variance (1 + 2 xi) / `number` (Laplace). Integrated over the scale, this
//!    gives the weight of xi.
//! 3. For each xi the excess at a given rate is scale ((1 / rate)^xi - 1) / xi. So the posterior of
//!    its ln is a mixture of Gaussians, which `ParetoTail::quantile` inverts.
//!
//! Why no estimate with a standard error: a sample that by chance lacks large values makes both too small. The
//! posterior keeps the heavier tails that such a sample allows.

use crate::model::bisection::bisected;
use crate::model::normal::upper_tail;

/// The range of shapes xi, from scatter that ends at bounds to Student's t with 4 degrees of freedom,
/// whose squares have xi = 2/4, as in windows (`mixture.rs`).
const LIGHTEST: f64 = -0.25;
const HEAVIEST: f64 = 0.5;
const SHAPES: usize = 76;

const HALVINGS: usize = 60;

/// How many independent signals the signals of a tail are worth.
#[derive(Clone, Copy, Debug)]
pub(super) struct Effective {
    /// By how much signals of one channel tend to lie in the tail together: the number of signals over the
    /// design effect of that. Mostly the smaller number of the two.
    pub number: f64,
    /// By how much the sizes of their excesses go together; only the weights of shapes use this.
    pub excesses: f64,
}

/// The posterior of the tail above a level. Without excesses `of_shapes` is empty.
#[derive(Debug)]
pub(super) struct ParetoTail {
    level: f64,
    effective: Effective,
    of_shapes: Vec<OfShape>,
}

#[derive(Debug)]
struct OfShape {
    shape: f64,
    weight: f64,
    ln_scale: f64,
}

impl ParetoTail {
    /// Fits the tail. `energies`: none below `level`.
    pub fn fit(energies: &[f64], level: f64, effective: Effective) -> ParetoTail {
        let excesses: Vec<f64> = energies.iter().map(|e| e - level).collect();
        let n = excesses.len() as f64;
        if excesses.iter().all(|e| *e <= 0.0) {
            return ParetoTail { level, effective, of_shapes: Vec::new() };
        }
        let step = (HEAVIEST - LIGHTEST) / (SHAPES - 1) as f64;
        let mut of_shapes: Vec<OfShape> = (0..SHAPES)
            .map(|i| {
                let shape = LIGHTEST + step * i as f64;
                let scale = likeliest_scale(&excesses, shape);
                // excesses that depend on each other count as fewer
                let ln_likelihood = ln_likelihood(&excesses, shape, scale) * effective.excesses / n;
                // integrated over ln scale (Laplace); a ln until it is normalised below
                let weight = ln_likelihood + 0.5 * of_ln_scale(shape).ln();
                OfShape { shape, weight, ln_scale: scale.ln() }
            })
            .collect();

        let most = of_shapes.iter().map(|of| of.weight).fold(f64::NEG_INFINITY, f64::max);
        of_shapes.iter_mut().for_each(|of| of.weight = (of.weight - most).exp());
        let sum: f64 = of_shapes.iter().map(|of| of.weight).sum();
        of_shapes.iter_mut().for_each(|of| of.weight /= sum);
        ParetoTail { level, effective, of_shapes }
    }

    pub fn shape(&self) -> f64 {
        self.of_shapes.iter().map(|of| of.weight * of.shape).sum()
    }

    /// An upper bound on the energy that a share `beyond` (below 1) of the signals above the level
    /// exceeds; it holds with the posterior probability `confidence`.
    pub fn quantile(&self, beyond: f64, confidence: f64) -> f64 {
        if self.of_shapes.is_empty() {
            return self.level;
        }
        let further = (1.0 / beyond).ln();
        // per shape: its weight, and mean and standard deviation of the ln of the quantile's excess
        let each: Vec<(f64, f64, f64)> = (self.of_shapes.iter())
            .map(|of| {
                let reach = reach(of.shape, further);
                // the ln of the share of signals above the level has the variance 1 / number
                let by_share = (of.shape * further).exp() / reach;
                let variance = of_ln_scale(of.shape) / self.effective.number
                    + by_share * by_share / self.effective.number;
                (of.weight, of.ln_scale + reach.ln(), variance.sqrt())
            })
            .collect();

        let below = |ln: f64| -> f64 {
            each.iter().map(|(w, middle, sd)| w * upper_tail((middle - ln) / sd)).sum()
        };

        const FAR: f64 = 12.0;
        let least = each.iter().map(|(_, middle, sd)| middle - FAR * sd);
        let most = each.iter().map(|(_, middle, sd)| middle + FAR * sd);
        let (least, most) =
            (least.fold(f64::INFINITY, f64::min), most.fold(f64::NEG_INFINITY, f64::max));
        self.level + halved(least, most, |ln| below(ln) < confidence).exp()
    }
}

/// The excess, in units of the scale, that is exceeded with probability e^-t.
fn reach(shape: f64, t: f64) -> f64 {
    if shape.abs() < 1e-9 { t } else { (shape * t).exp_m1() / shape }
}

/// Asymptotic variance of the ln of the scale given the shape, times the number of excesses.
fn of_ln_scale(shape: f64) -> f64 {
    1.0 + 2.0 * shape
}

/// The scale of largest likelihood for a shape: there (1 + xi) times the sum of z / (1 + xi z) over
/// z = excess / scale equals the number of excesses, and the sum falls as the scale grows.
fn likeliest_scale(excesses: &[f64], shape: f64) -> f64 {
    let n = excesses.len() as f64;
    let largest = excesses.iter().copied().fold(0.0, f64::max);
    let is_too_small = |scale: &f64| {
        let each = |e: &f64| e / scale / (1.0 + shape * e / scale);
        (1.0 + shape) * excesses.iter().map(each).sum::<f64>() > n
    };
    // a light tail ends at scale / -xi, which must lie beyond the largest excess
    let ends = (-shape).max(1e-6) * largest;
    halved(ends.ln(), (10.0 * largest).ln(), |ln| is_too_small(&ln.exp())).exp()
}

fn ln_likelihood(excesses: &[f64], shape: f64, scale: f64) -> f64 {
    let each = |e: &f64| match shape.abs() < 1e-9 {
        true => e / scale,
        false => (1.0 + 1.0 / shape) * (shape * e / scale).ln_1p(),
    };
    -(excesses.len() as f64) * scale.ln() - excesses.iter().map(each).sum::<f64>()
}

fn halved(low: f64, high: f64, is_below: impl Fn(f64) -> bool) -> f64 {
    let [low, high] = bisected(low, high, HALVINGS, is_below);
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The middles of `n` equally likely parts of a generalised Pareto distribution of scale 1.
    fn drawn(shape: f64, n: usize) -> Vec<f64> {
        let each = |i: usize| reach(shape, -((i as f64 + 0.5) / n as f64).ln());
        (0..n).map(each).collect()
    }

    /// All `n` signals are independent.
    fn all(n: usize) -> Effective {
        Effective { number: n as f64, excesses: n as f64 }
    }

    #[test]
    fn of_many_the_law_is_found_and_of_few_the_bound_lies_further_out() {
        const BEYOND: f64 = 1e-2;
        for shape in [-0.2, 0.0, 0.2, 0.4] {
            let truth = 7.0 + reach(shape, -BEYOND.ln());
            let above =
                |n: usize| -> Vec<f64> { drawn(shape, n).iter().map(|e| e + 7.0).collect() };
            let law = ParetoTail::fit(&above(5000), 7.0, all(5000));
            assert!((law.shape() - shape).abs() < 0.02, "{shape}: {}", law.shape());
            assert!((law.quantile(BEYOND, 0.5) / truth - 1.0).abs() < 0.02, "{shape}");
            let bounds = [5000, 500, 50].map(|n| {
                let law = ParetoTail::fit(&above(n), 7.0, all(n));
                assert!(law.quantile(BEYOND, 0.95) > law.quantile(BEYOND, 0.5));
                law.quantile(BEYOND, 0.95)
            });
            assert!(bounds.is_sorted() && bounds[0] > truth, "{shape}: {bounds:?} {truth}");
        }
    }

    #[test]
    fn excesses_that_depend_on_each_other_say_less() {
        let above = drawn(0.1, 400);
        let bound = |number: f64, excesses: f64| {
            ParetoTail::fit(&above, 0.0, Effective { number, excesses }).quantile(1e-2, 0.95)
        };
        assert!(bound(400.0, 400.0) < bound(400.0, 100.0));
        assert!(bound(400.0, 100.0) < bound(40.0, 100.0));
    }

    #[test]
    fn without_an_excess_there_is_no_tail() {
        let law = ParetoTail::fit(&[5.0; 30], 5.0, all(30));
        assert_eq!((law.quantile(1e-3, 0.95), law.shape()), (5.0, 0.0));
    }
}
