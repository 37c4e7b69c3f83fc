//! Rates, what chance alone makes of them, and the goals that they meet or miss.

#[derive(Clone, Copy, Default)]
pub struct Rate {
    pub count: usize,
    pub of: usize,
}

impl Rate {
    pub fn of(all: impl Iterator<Item = bool>) -> Rate {
        let mut rate = Rate::default();
        all.for_each(|counts| rate.add(counts));
        rate
    }

    pub fn add(&mut self, counts: bool) {
        self.count += usize::from(counts);
        self.of += 1;
    }

    pub fn share(self) -> f64 {
        self.count as f64 / self.of.max(1) as f64
    }

    /// Not so many that a true rate of `rate` could hardly give them: once in a thousand runs.
    fn is_at_most(self, rate: f64) -> bool {
        let mut log_term = self.of as f64 * (-rate).ln_1p();
        let mut below = 0.0;
        for k in 0..self.count {
            below += log_term.exp();
            log_term += ((self.of - k) as f64 / (k + 1) as f64).ln() + rate.ln() - (-rate).ln_1p();
        }
        1.0 - below > 1e-3
    }
}

/// A failure tells all that is missed, not only the first of it.
#[derive(Default)]
pub struct Goals {
    pub missed: Vec<String>,
}

impl Goals {
    pub fn at_most(&mut self, what: &str, rate: Rate, most: f64) {
        self.met(
            rate.is_at_most(most),
            format!("{what}: {:.2e} of {}, at most {most}", rate.share(), rate.of),
        );
    }

    pub fn at_least(&mut self, what: &str, rate: Rate, least: f64) {
        let others = Rate { count: rate.of - rate.count, of: rate.of };
        self.met(
            others.is_at_most(1.0 - least),
            format!("{what}: {:.4} of {}, at least {least}", rate.share(), rate.of),
        );
    }

    pub fn met(&mut self, is_met: bool, what: String) {
        println!("{what}");
        if !is_met {
            self.missed.push(what);
        }
    }

    #[track_caller]
    pub fn all_are_met(self) {
        assert!(self.missed.is_empty(), "missed:\n{}", self.missed.join("\n"));
    }
}

#[test]
fn chance_is_known() {
    assert!(Rate { count: 7, of: 1000 }.is_at_most(0.002));
    assert!(!Rate { count: 12, of: 1000 }.is_at_most(0.002));
    let mut goals = Goals::default();
    goals.at_least("960 of 1000", Rate { count: 960, of: 1000 }, 0.97);
    assert!(goals.missed.is_empty());
    goals.at_least("930 of 1000", Rate { count: 930, of: 1000 }, 0.97);
    assert_eq!(goals.missed.len(), 1);
}
