//! The class of a channel's fault, from the posteriors of one burst after another.
//!
//! In: a weight per class of each flagged signal (a *look*). Out: the filtered weight per class.
//!
//! The forward filter of a hidden Markov model (Rabiner 1989): a fault grows and may pass through
//! other classes on its way, so from one look to the next it becomes any class with a small probability. The
//! looks of one channel are not independent, since they share the channel's own deviation; they count as fewer.

/// Transition probability: that the class is another one at the next look.
const CHANGES: f64 = 0.02;
/// Number of looks that count as one independent observation.
const LOOKS_PER_ONE: f64 = 2.0;
/// Least weight of a class in one look: no single look excludes it.
const LEAST: f64 = 1e-3;

#[derive(Clone, Debug, PartialEq)]
pub struct ClassFilter {
    weights: Vec<f64>,
}

impl ClassFilter {
    /// `priors`: of each class, sum 1.
    pub fn new(priors: &[f64]) -> ClassFilter {
        ClassFilter { weights: priors.to_vec() }
    }

    /// Updates by the `posterior` of one look, under the same `priors`. One with NaN is ignored.
    pub fn look(&mut self, posterior: &[f32], priors: &[f64]) {
        let n = self.weights.len();
        if posterior.len() != n || posterior.iter().any(|w| !w.is_finite()) {
            return;
        }
        let each = self.weights.iter_mut().zip(posterior).zip(priors);
        for ((weight, &posterior), &prior) in each {
            let likelihood = f64::from(posterior).max(LEAST) / (prior * n as f64).max(LEAST);
            let before = *weight * (1.0 - CHANGES) + CHANGES * prior;
            *weight = before * likelihood.powf(1.0 / LOOKS_PER_ONE);
        }
        let sum: f64 = self.weights.iter().sum();
        self.weights.iter_mut().for_each(|w| *w /= sum);
    }

    /// Sum 1.
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn looks_that_agree_make_certain_and_a_grown_fault_changes_the_class() {
        let priors = [1.0 / 3.0; 3];
        let mut filter = ClassFilter::new(&priors);
        for _ in 0..8 {
            filter.look(&[0.6, 0.3, 0.1], &priors);
        }
        assert!(filter.weights()[0] > 0.8, "{filter:?}");
        for _ in 0..8 {
            filter.look(&[0.0, 0.05, 0.95], &priors);
        }
        assert!(filter.weights()[2] > 0.9, "{filter:?}");
        assert!((filter.weights().iter().sum::<f64>() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn without_news_a_class_becomes_any_other_now_and_then() {
        let priors = [0.5, 0.3, 0.2];
        let mut filter = ClassFilter { weights: vec![1.0, 0.0, 0.0] };
        filter.look(&[0.5, 0.3, 0.2], &priors);
        let expected = [1.0 - CHANGES * 0.5, CHANGES * 0.3, CHANGES * 0.2];
        for (w, expected) in filter.weights().iter().zip(expected) {
            assert!((w - expected).abs() < 1e-6, "{filter:?}");
        }
    }

    #[test]
    fn looks_that_say_nothing_leave_the_priors() {
        let priors = [0.7, 0.2, 0.1];
        let mut filter = ClassFilter::new(&priors);
        for _ in 0..50 {
            filter.look(&[0.7, 0.2, 0.1], &priors);
        }
        filter.look(&[f32::NAN, 0.2, 0.1], &priors);
        filter.look(&[0.7], &priors);
        for (w, prior) in filter.weights().iter().zip(priors) {
            assert!((w - prior).abs() < 1e-6, "{filter:?}");
        }
    }
}
