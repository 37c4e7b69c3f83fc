//! The noise of decays: of each output an autoregression ([`Colour`]), from a fit's own misfit.
//!
//! In: misfits. Out: how this noise sees a series ([`Noise::apply_to`]): what the samples before predict is
//! subtracted from each sample, and what is left is divided by its standard deviation.

use super::decays::Decays;
use std::f64::consts::TAU;

const MOST_ORDER: usize = 12;
/// A misfit that is smaller, relative to the largest deviation, is that of samples rounded to f32.
pub const ROUNDED: f64 = 1e-6;

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
    (0..decays.outputs).map(|output| (square(output) / count).sqrt().max(ROUNDED)).collect()
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
    pub fn apply_to(&self, i: usize, series: &mut [f64]) {
        self.colours[i % self.colours.len()].whiten(series);
        for (w, _) in series.iter_mut().zip(&self.held_out).filter(|(_, held)| **held) {
            *w = 0.0;
        }
    }
}
