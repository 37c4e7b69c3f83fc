//! The class of a channel's fault, from the posteriors of one burst after another.
//!
//! In: of each flagged signal, also before the episode is certain, isolation's weight of each class. They may sum to less
//! than 1; the rest is the weight of *no class*, a fault that none of them explains. Out: the filtered weights.
//!
//! It is the forward filter of a hidden Markov model (Rabiner 1989). A fault may pass through other
//! classes as it grows, so from one flagged look to the next its class is drawn anew, by the prior, with a small
//! probability (`CHANGES`); quiet looks in between do not count. With the weight w before a look, the
//! prior q, and the look's posterior p the weight after it is
//!
//! ```text
//! w' = ((1 - CHANGES) w + CHANGES q) (e + (1 - e) p / q)^(1 / LOOKS_PER_ONE),
//! ```
//!
//! over the sum of all w'. p / q is the look's likelihood but for a factor that all classes share.
//! e (`LEAST_RATE`) is the probability that a look says nothing of the class. Looks at one channel share their errors:
//! therefore the likelihood has this power, by which `LOOKS_PER_ONE` of them count as one look.

use super::tuned;
use crate::numbers::LEAST_RATE;

/// The filtered weights of the classes, and of no class; their sum is 1.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ClassFilter {
    pub weights: Vec<f64>,
    pub none: f64,
}

impl ClassFilter {
    pub fn new(priors: &[f64]) -> ClassFilter {
        ClassFilter { weights: priors.to_vec(), none: rest_to_one(priors.iter().copied()) }
    }

    /// Updates the weights by one look. `posterior`: weights that isolation gave by these `priors`;
    /// empty: of no class. One of another length, or with a weight that is not finite, is ignored.
    pub fn look(&mut self, posterior: &[f32], priors: &[f64]) {
        let n = self.weights.len();
        if posterior.len() != n && !posterior.is_empty() || posterior.iter().any(|w| !w.is_finite())
        {
            return;
        }

        let after = |before: f64, posterior: f64, prior: f64| {
            let seems = if prior > 0.0 { posterior / prior } else { 0.0 };
            let likelihood = LEAST_RATE + (1.0 - LEAST_RATE) * seems;
            (before * (1.0 - tuned::CHANGES) + tuned::CHANGES * prior)
                * likelihood.powf(1.0 / tuned::LOOKS_PER_ONE)
        };
        for (k, (weight, prior)) in self.weights.iter_mut().zip(priors).enumerate() {
            let posterior = posterior.get(k).map_or(0.0, |&w| f64::from(w));
            *weight = after(*weight, posterior, *prior);
        }

        let none = rest_to_one(posterior.iter().map(|&w| f64::from(w)));
        self.none = after(self.none, none, rest_to_one(priors.iter().copied()));

        let sum = self.weights.iter().sum::<f64>() + self.none;
        self.weights.iter_mut().for_each(|w| *w /= sum);
        self.none /= sum;
    }
}

/// What weights lack to 1; 0 where they lack no more than their own rounding to f32, which would
/// otherwise be evidence for no class.
fn rest_to_one(weights: impl Iterator<Item = f64>) -> f64 {
    let (n, sum) = weights.fold((0.0, 0.0), |(n, sum), w| (n + 1.0, sum + w));
    if 1.0 - sum > n * f64::from(f32::EPSILON) { 1.0 - sum } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A filter that has seen so many looks of the same weights, the one after the other.
    fn seen(priors: &[f64], looks: &[(usize, &[f32])]) -> ClassFilter {
        let mut filter = ClassFilter::new(priors);
        for (n, weights) in looks {
            (0..*n).for_each(|_| filter.look(weights, priors));
        }
        filter
    }

    #[test]
    fn looks_that_agree_make_certain_and_a_grown_fault_changes_the_class() {
        let looks: [(usize, &[f32]); 3] =
            [(8, &[0.6, 0.3, 0.1]), (8, &[0.0, 0.05, 0.95]), (8, &[0.0, 0.01, 0.02])];
        let after = |n: usize| seen(&[0.28; 3], &looks[..n]);
        assert!(after(1).weights[0] > 0.8, "{:?}", after(1));
        assert!(after(2).weights[2] > 0.9, "{:?}", after(2));
        assert!((after(2).weights.iter().sum::<f64>() + after(2).none - 1.0).abs() < 1e-12);
        assert!(after(3).none > 0.9, "what is of no class is none in the end: {:?}", after(3));
    }

    #[test]
    fn rounding_is_no_evidence_for_no_class() {
        let filter = seen(&[1.0 / 6.0; 6], &[(20, &[0.9, 0.1, 0.0, 0.0, 0.0, 0.0])]);
        assert!(filter.none == 0.0 && filter.weights[0] > 0.9, "{filter:?}");
    }

    #[test]
    fn without_news_a_class_becomes_any_other_now_and_then() {
        let priors = [0.4, 0.3, 0.2];
        let mut filter = ClassFilter { weights: vec![1.0, 0.0, 0.0], none: 0.0 };
        filter.look(&[0.4, 0.3, 0.2], &priors);
        let expected = [1.0 - tuned::CHANGES * 0.6, tuned::CHANGES * 0.3, tuned::CHANGES * 0.2];
        for (w, expected) in filter.weights.iter().zip(expected) {
            assert!((w - expected).abs() < 1e-6, "{filter:?}");
        }
    }

    /// A user may say that one class is a thousand times as frequent as the others.
    #[test]
    fn looks_at_a_frequent_class_make_it_certain_and_a_look_of_none_leaves_the_odds_of_the_classes()
    {
        let sum = 1000.0 + 8.0;
        let priors: Vec<f64> =
            (0..9).map(|k| if k == 0 { 1000.0 } else { 1.0 } * 0.86 / sum).collect();
        let mut of_first = [0.0001_f32; 9];
        of_first[0] = 0.98;
        let mut filter = seen(&priors, &[(30, &of_first)]);
        assert!(filter.weights[0] > 0.9, "{filter:?}");
        // but for the share that returns to the priors
        let stay =
            |k: usize| (1.0 - tuned::CHANGES) * filter.weights[k] + tuned::CHANGES * priors[k];
        let expected = stay(0) / stay(1);
        filter.look(&[], &priors);
        let odds = filter.weights[0] / filter.weights[1];
        assert!((odds / expected - 1.0).abs() < 1e-9, "{odds} {expected}");

        // where some class is certain beforehand, a look of none says nothing
        let filter = seen(&[0.8, 0.1, 0.1], &[(1, &[])]);
        assert!((filter.weights[0] - 0.8).abs() < 1e-9 && filter.none == 0.0, "{filter:?}");
    }

    #[test]
    fn looks_that_say_nothing_leave_the_priors() {
        let priors = [0.6, 0.2, 0.1];
        let filter =
            seen(&priors, &[(50, &[0.6, 0.2, 0.1]), (1, &[f32::NAN, 0.2, 0.1]), (1, &[0.7])]);
        for (w, prior) in filter.weights.iter().zip(priors) {
            assert!((w - prior).abs() < 1e-6, "{filter:?}");
        }
    }
}
