//! Residual matching: the mixture of known signatures that is nearest to a residual. thesis §3-3-2.
//!
//! In: the signatures R (N samples x n_f classes, [`SignatureMatrix`]) once, then c = R^T r per signal, n_f
//! numbers, counts²; of the residual r nothing else is needed. Out: phi, n_f weights, which minimises |R phi - r|
//! subject to sum phi = 1, phi >= 0. phi is a mixture weight, not a probability.
//!
//! Up to a constant, half the squared distance is q(phi) = 1/2 phi^T G phi - c^T phi with G = R^T R.
//! q is minimised by an exact primal active-set method: non-negative least squares (Lawson and Hanson 1974) with the
//! further constraint that the sum is 1, which is Wolfe's nearest point of a polytope (1976). A signal's weights then do
//! not depend on where a search was stopped. The *support* is the set of classes with a weight; its signatures are kept
//! affinely independent (`Search::settle`). The steps:
//!
//! 1. Start at the nearest single signature.
//! 2. Gradient G phi - c, whose entries on the support are equal at a minimum (to the Lagrange multiplier of the sum).
//!    The class with the lowest other entry enters; if none is lower than on the support, phi is the solution.
//! 3. Minimise q over the affine hull of the support (`Search::settle`): go towards the minimum
//!    until a weight becomes 0, drop that class, and repeat until the minimum itself is reached. Go
//!    on with step 2.
//!
//! But for rounding, which `run` bounds, every step lowers q, so no support comes back and the search ends. It allocates
//! nothing.

use super::{MAX_CLASSES, SignatureMatrix};

/// A pivot below this, relative to its diagonal, is zero: the signature depends on the others.
const DEPENDENT: f64 = 1e-11;
/// A class enters only if its gradient is lower by more than this, relative to the problem's size.
const STATIONARY: f64 = 1e-14;

/// One value per class.
type Row = [f64; MAX_CLASSES];

/// What all signals share. Since sum phi = 1, the mean signature can be subtracted from all
/// signatures and the residual, so that what signatures have in common costs no digits.
#[derive(Clone, Debug)]
pub struct Simplex {
    n: usize,
    /// Gram matrix of the centred signatures over `scale`, n x n.
    gram: Vec<f64>,
    /// (column i of R - mean) . mean, which centring subtracts from c, counts².
    shift: Vec<f64>,
    /// Largest squared norm of a centred signature, counts²; 1 if all signatures are equal.
    scale: f64,
}

impl Simplex {
    /// Prepares the problem. `signatures`: R itself, not F^T R; at most [`MAX_CLASSES`].
    pub fn new(signatures: &SignatureMatrix) -> Simplex {
        let r = &signatures.r;
        let mean = r.column_mean();
        let mut centred = r.clone();
        for mut column in centred.column_iter_mut() {
            column -= &mean;
        }
        let gram = centred.tr_mul(&centred);
        let largest = gram.diagonal().amax();
        let scale = if largest > 0.0 { largest } else { 1.0 };
        let shift = centred.tr_mul(&mean).iter().copied().collect();
        Simplex { n: r.ncols(), gram: gram.iter().map(|g| g / scale).collect(), shift, scale }
    }

    /// Writes phi, n_f, for c = R^T r. A c that is not finite gives NaN. Where signatures coincide,
    /// the first of them takes the weight.
    pub fn solve(&self, c: &[f64], phi: &mut [f64]) {
        if c.iter().any(|v| !v.is_finite()) {
            return phi.fill(f64::NAN);
        }
        // a constant in c does not matter, and without it the gradient keeps its digits
        let middle = c.iter().sum::<f64>() / self.n as f64;
        let mut b: Row = [0.0; MAX_CLASSES];
        let centred = c.iter().zip(&self.shift).map(|(c, shift)| (c - middle - shift) / self.scale);
        b.iter_mut().zip(centred).for_each(|(b, centred)| *b = centred);
        Search::new(self, b).run(phi);
    }

    /// Inner product of two centred signatures, over `scale`.
    fn gram(&self, i: usize, j: usize) -> f64 {
        self.gram[i * self.n + j]
    }

    /// Inner product (rho_i - rho_o) . (rho_j - rho_o), over `scale`.
    fn product(&self, o: usize, i: usize, j: usize) -> f64 {
        (self.gram(i, j) - self.gram(i, o)) - (self.gram(o, j) - self.gram(o, o))
    }
}

struct Search<'a> {
    problem: &'a Simplex,
    /// c for the centred signatures over `scale`.
    b: Row,
    phi: Row,
    /// In the order in which they entered; the first is the origin of the affine hull.
    support: [usize; MAX_CLASSES],
    size: usize,
    /// Lower Cholesky factor of the Gram matrix of the support's differences from its origin,
    /// packed by rows: row p - 1 belongs to place p of the support.
    factor: [f64; MAX_CLASSES * (MAX_CLASSES + 1) / 2],
}

impl<'a> Search<'a> {
    fn new(problem: &'a Simplex, b: Row) -> Search<'a> {
        let distance = |i: usize| 0.5 * problem.gram(i, i) - b[i];
        let nearer = |best, i| if distance(i) < distance(best) { i } else { best };
        let first = (0..problem.n).fold(0, nearer);
        let mut phi = [0.0; MAX_CLASSES];
        phi[first] = 1.0;
        let mut support = [0; MAX_CLASSES];
        support[0] = first;
        let factor = [0.0; MAX_CLASSES * (MAX_CLASSES + 1) / 2];
        Search { problem, b, phi, support, size: 1, factor }
    }

    fn run(mut self, out: &mut [f64]) {
        let n = self.problem.n;
        let size = 1.0 + self.b[..n].iter().fold(0.0, |m: f64, b| m.max(b.abs()));
        // Classes that entered and were dropped again before phi had moved, which is rounding and no descent, do not
        // enter again until it has.
        let mut barred = [false; MAX_CLASSES];
        // the bound on the number of rounds is for rounding alone
        for _ in 0..20 * n {
            // gradient of q, and its mean over the support, weighted by phi
            let mut gradient: Row = [0.0; MAX_CLASSES];
            for (j, g) in gradient[..n].iter_mut().enumerate() {
                let product: f64 = self.support[..self.size]
                    .iter()
                    .map(|&i| self.problem.gram(i, j) * self.phi[i])
                    .sum();
                *g = product - self.b[j];
            }
            let level: f64 =
                self.support[..self.size].iter().map(|&i| self.phi[i] * gradient[i]).sum();

            let lowest = level - STATIONARY * size;
            let may_enter = |j: &usize| {
                let is_free = !barred[*j] && !self.support[..self.size].contains(j);
                is_free && gradient[*j] < lowest
            };
            let lower = |best, j| if gradient[j] < gradient[best] { j } else { best };
            let Some(j) = (0..n).filter(may_enter).reduce(lower) else { break };
            self.support[self.size] = j;
            self.size += 1;
            if self.settle(&gradient) {
                barred = [false; MAX_CLASSES];
            } else {
                barred[j] = true;
            }
        }

        // the sum of phi is 1 but for rounding, which is shared out
        let sum: f64 = self.phi[..n].iter().sum();
        out.iter_mut().zip(&self.phi).for_each(|(out, phi)| *out = phi / sum);
    }

    /// Minimises over the affine hull of the support, dropping classes whose weight would become
    /// negative. `gradient`: at the phi from which it starts; along a dependence its slope is the same at every phi.
    /// Returns whether phi has moved.
    fn settle(&mut self, gradient: &Row) -> bool {
        let mut moved = false;
        while self.size > 1 {
            // to the minimum over the hull; or, if signatures are dependent, along a change of
            // weights that leaves R phi as it is
            let mut step: Row = [0.0; MAX_CLASSES];
            let flat = self.factorise();
            match flat {
                None => self.to_minimum(&mut step),
                Some(dependent) => self.along_dependence(dependent, gradient, &mut step),
            }

            // The longest part of the step that keeps phi >= 0, and the class that limits it. The
            // step to the minimum is taken whole at most; a dependence has no such bound.
            let mut reach = if flat.is_some() { f64::INFINITY } else { 1.0 };
            let mut blocking = None;
            for (p, &step) in step[..self.size].iter().enumerate() {
                let phi = self.phi[self.support[p]];
                if step < 0.0 && phi + reach.min(1e300) * step <= 0.0 {
                    reach = phi / -step;
                    blocking = Some(p);
                }
            }
            if !reach.is_finite() {
                // this happens by rounding alone: the last class to enter leaves
                blocking = Some(self.size - 1);
                reach = 0.0;
            }

            for (&i, step) in self.support[..self.size].iter().zip(&step) {
                let phi = &mut self.phi[i];
                let before = *phi;
                *phi = (*phi + reach * step).max(0.0);
                moved |= *phi != before;
            }
            let Some(p) = blocking else { return moved };
            self.phi[self.support[p]] = 0.0;
            self.support.copy_within(p + 1..self.size, p);
            self.size -= 1;
        }
        self.phi[self.support[0]] = 1.0;
        moved
    }

    /// Computes the Cholesky factor. Returns the place of the first class whose signature depends
    /// on those before it, if one does; the factor is then valid for the places before.
    fn factorise(&mut self) -> Option<usize> {
        let g = |i, j| self.problem.gram(i, j);
        let s = &self.support;
        let o = s[0];
        for p in 1..self.size {
            let row = (p - 1) * p / 2;
            for q in 1..=p {
                let other = (q - 1) * q / 2;
                let whole = self.problem.product(o, s[p], s[q]);
                let known: f64 =
                    (0..q - 1).map(|k| self.factor[row + k] * self.factor[other + k]).sum();
                let rest = whole - known;
                if q < p {
                    self.factor[row + q - 1] = rest / self.factor[other + q - 1];
                } else {
                    // Relative to the signatures, too: of two that nearly coincide the difference is rounding, five
                    // units in the last place of their squares, and no pivot.
                    let size = whole.max(1e-4 * (g(s[p], s[p]) + g(o, o)));
                    if rest.is_nan() || rest <= DEPENDENT * size {
                        return Some(p);
                    }
                    self.factor[row + p - 1] = rest.sqrt();
                }
            }
        }
        None
    }

    /// Solves L L^T x = `of` for the first `classes` places of the support. `of`: the right-hand
    /// side for a class number. Returns x by place (the origin at 0 has none), and the sum of x.
    fn solve(&self, classes: usize, of: impl Fn(usize) -> f64) -> (Row, f64) {
        let mut weights: Row = [0.0; MAX_CLASSES];
        let n = classes - 1;
        let x = &mut weights[1..classes];
        x.iter_mut().zip(&self.support[1..]).for_each(|(x, &class)| *x = of(class));
        let l = |p: usize, q: usize| self.factor[p * (p + 1) / 2 + q];
        for p in 0..n {
            let known: f64 = (0..p).map(|q| l(p, q) * x[q]).sum();
            x[p] = (x[p] - known) / l(p, p);
        }
        for p in (0..n).rev() {
            let known: f64 = (p + 1..n).map(|q| l(q, p) * x[q]).sum();
            x[p] = (x[p] - known) / l(p, p);
        }
        let sum = x.iter().sum();
        (weights, sum)
    }

    /// Writes the step from phi to the minimum over the affine hull, by place of the support.
    fn to_minimum(&self, step: &mut Row) {
        let (b, o) = (&self.b, self.support[0]);
        let g = |i, j| self.problem.gram(i, j);
        let (x, sum) = self.solve(self.size, |i| (b[i] - b[o]) - (g(i, o) - g(o, o)));
        // the origin takes what is left of 1
        for p in 1..self.size {
            step[p] = x[p] - self.phi[self.support[p]];
        }
        step[0] = (1.0 - sum) - self.phi[o];
    }

    /// Writes a direction, by place of the support, along which R phi stands still and q does not
    /// rise: the class at place `dependent` comes in, and the combination of the classes before it
    /// that equals its signature goes out, or the other way round.
    fn along_dependence(&self, dependent: usize, gradient: &Row, step: &mut Row) {
        let s = &self.support;
        let own = |i| self.problem.product(s[0], i, s[dependent]);
        let (x, sum) = self.solve(dependent, own);
        step[1..dependent].iter_mut().zip(&x[1..]).for_each(|(step, x)| *step = -x);
        step[dependent] = 1.0;
        step[0] = sum - 1.0;
        let slope: f64 = (0..=dependent).map(|p| step[p] * gradient[s[p]]).sum();
        if slope > 0.0 {
            step[..=dependent].iter_mut().for_each(|step| *step = -*step);
        }
    }
}

#[cfg(test)]
mod tests;
