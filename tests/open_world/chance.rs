//! Rates, and what chance alone makes of them.

use std::fmt;

#[derive(Clone, Copy, Debug, Default)]
pub struct Rate {
    pub count: usize,
    pub of: usize,
}

/// A bound of a test that holds fails by chance once in so many runs; seeds are fixed anyhow.
const CHANCE: f64 = 1e-3;

impl Rate {
    pub fn add(&mut self, counts: bool) {
        self.count += usize::from(counts);
        self.of += 1;
    }

    pub fn share(self) -> f64 {
        self.count as f64 / self.of.max(1) as f64
    }

    /// Wilson's, 95 %.
    pub fn interval(self) -> [f64; 2] {
        let (n, p, z) = (self.of.max(1) as f64, self.share(), 1.96);
        let centre = p + z * z / (2.0 * n);
        let half = z * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt();
        let scale = 1.0 + z * z / n;
        [if self.count == 0 { 0.0 } else { (centre - half) / scale }, (centre + half) / scale]
    }

    /// Not so many that a true rate of `rate` could hardly give them.
    pub fn is_at_most(self, rate: f64) -> bool {
        at_least(self.count, self.of, rate) > CHANCE
    }

    pub fn is_at_least(self, rate: f64) -> bool {
        Rate { count: self.of - self.count, of: self.of }.is_at_most(1.0 - rate)
    }

    /// Says `what` misses its goal, if it is more than that.
    pub fn beyond(self, most: f64, what: &str) -> Option<String> {
        (!self.is_at_most(most)).then(|| format!("{what} {self}"))
    }

    /// Likewise if it is less.
    pub fn below(self, least: f64, what: &str) -> Option<String> {
        (!self.is_at_least(least)).then(|| format!("{what} {self}"))
    }
}

/// Probability of `count` or more of `of` at `rate`.
fn at_least(count: usize, of: usize, rate: f64) -> f64 {
    let mut log_term = of as f64 * (-rate).ln_1p();
    let mut below = 0.0;
    for k in 0..count {
        below += log_term.exp();
        log_term += ((of - k) as f64 / (k + 1) as f64).ln() + rate.ln() - (-rate).ln_1p();
    }
    1.0 - below
}

impl fmt::Display for Rate {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let [low, high] = self.interval();
        match self.share() {
            share if share < 0.02 => write!(f, "{share:.1e} [{low:.1e} {high:.1e}]"),
            share => write!(f, "{share:.3} [{low:.3} {high:.3}]"),
        }
    }
}
