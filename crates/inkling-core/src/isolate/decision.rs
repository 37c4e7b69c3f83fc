//! What may be said of a signal on the strength of its weights per class: a class, a category of
//! classes, or neither. thesis §3-3-2, Tables 4-3ff.
//!
//! In: one weight per class (phi, or a posterior probability), the probability of any class, and the
//! rule by which something is named ([`Naming`]). Out: a [`Decision`] (`schemas/verdicts.md`).

use crate::fault::{Named, Naming};

/// What is said of one signal. Classes and categories are indices into those of a [`Naming`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Decision {
    /// The class with the largest weight; `None` if there were no weights to compare.
    pub candidate: Option<u16>,
    pub fault: Option<u16>,
    /// The category of the named class, or one that is certain although none of its classes is.
    pub category: Option<u16>,
    /// The weight of the named class, else of the named category, else of the candidate; times the
    /// probability of any class, 0 to 1.
    pub certainty: Option<f32>,
    pub likeness: Likeness,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Likeness {
    #[default]
    KnownClass,
    /// The signal is a ring, but of no known class.
    NoClass,
    NoRing,
}

impl Decision {
    pub fn of_unknown_fault(self) -> Decision {
        Decision { fault: None, category: None, likeness: Likeness::NoClass, ..self }
    }

    pub fn of_no_ring() -> Decision {
        Decision { likeness: Likeness::NoRing, ..Decision::default() }
    }

    /// With the candidate's weight as certainty, even of a category: sums of phi are no probability.
    pub fn certain_of_class(self, weights: &[f64]) -> Decision {
        let certainty = self.candidate.and_then(|k| unit(*weights.get(usize::from(k))?));
        Decision { certainty, ..self }
    }

    /// Whether nothing is named. (A named class brings its category.)
    pub fn is_uncertain(&self) -> bool {
        self.category.is_none()
    }
}

impl Naming {
    /// Whose severity belongs to a decision: the named class, the best of the named category, or the
    /// candidate.
    pub fn sized(&self, decision: &Decision, weights: &[f64]) -> Option<usize> {
        let Some(category) = decision.category else { return decision.candidate.map(usize::from) };
        let of_category = (0..self.category_of.len()).filter(|&k| self.category_of[k] == category);
        let best = of_category.max_by(|&i, &j| weights[i].total_cmp(&weights[j]));
        decision.fault.map(usize::from).or(best)
    }

    /// `weights`: one per class, with the sum 1; `of_any`: the probability of any class. If a weight
    /// is missing or not finite, there is not even a candidate.
    pub fn decide(&self, weights: &[f64], of_any: f64) -> Decision {
        let is_whole =
            weights.len() == self.category_of.len() && weights.iter().all(|w| w.is_finite());
        let named = if is_whole { self.name(weights, of_any) } else { None };
        let Some(Named { best, fault, category, certainty }) = named else {
            return Decision::default();
        };
        let (candidate, certainty) = (Some(best as u16), unit(certainty));
        Decision { candidate, fault, category, certainty, likeness: Likeness::KnownClass }
    }
}

/// A weight as a certainty; sums of weights are 1 only up to rounding.
fn unit(weight: f64) -> Option<f32> {
    Some(weight.clamp(0.0, 1.0) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fault::Class;

    /// A rule for six classes of four categories.
    fn rule(certainty: f64) -> Naming {
        Naming::new(&["EC", "AB1", "AB2", "BN", "PBN", "own"].map(Class::plain), certainty)
    }

    #[test]
    fn categories_are_the_contracts_and_a_users_class_is_its_own() {
        let rule = rule(0.8);
        assert_eq!(rule.categories, ["empty_channel", "air_bubble", "blocked_nozzle", "own"]);
        assert_eq!(rule.category_of, [0, 1, 1, 2, 2, 3]);
    }

    #[test]
    fn what_is_certain_enough_is_named_and_else_the_candidate_alone_is_told() {
        let all = |bound: f64, weights: [f64; 6]| {
            let d = rule(bound).decide(&weights, 1.0);
            assert_eq!(d.is_uncertain(), d.category.is_none());
            (d.candidate, d.fault, d.category, d.certainty.unwrap())
        };
        // a class at the bound, with its category
        let told = all(0.8, [0.0, 0.1, 0.1, 0.8, 0.0, 0.0]);
        assert_eq!(told, (Some(3), Some(3), Some(2), 0.8));
        // a category may be certain where the class is not, and need not be the best class's
        let told = all(0.8, [0.1, 0.0, 0.0, 0.5, 0.4, 0.0]);
        assert_eq!(told, (Some(3), None, Some(2), 0.9));
        let told = all(0.55, [0.4, 0.0, 0.0, 0.3, 0.3, 0.0]);
        assert_eq!((told.0, told.1, told.2), (Some(0), None, Some(2)));
        // below the bound
        let told = all(0.8, [0.5, 0.0, 0.0, 0.2, 0.2, 0.1]);
        assert_eq!(told, (Some(0), None, None, 0.5));
        // the bound 0 names the best class always, and the first of equals
        let told = all(0.0, [0.1, 0.3, 0.3, 0.1, 0.1, 0.1]);
        assert_eq!((told.1, told.2), (Some(1), Some(1)));
    }

    #[test]
    fn what_is_not_named_keeps_its_candidate_and_only_what_it_says_changes() {
        let weights = [0.0, 0.1, 0.1, 0.8, 0.0, 0.0];
        let named = rule(0.8).decide(&weights, 1.0);
        assert_eq!(named.likeness, Likeness::KnownClass);
        let unnamed = named.of_unknown_fault();
        assert!(unnamed.is_uncertain());
        let likeness = Likeness::NoClass;
        assert_eq!(unnamed, Decision { fault: None, category: None, likeness, ..named });
        // a category is as certain as two of its classes together, and by this as certain as the better one
        // alone
        let both = rule(0.8).decide(&[0.1, 0.0, 0.0, 0.5, 0.4, 0.0], 1.0);
        let alone = both.certain_of_class(&[0.1, 0.0, 0.0, 0.5, 0.4, 0.0]);
        assert_eq!(alone, Decision { certainty: Some(0.5), ..both });
    }

    #[test]
    fn weights_that_are_no_numbers_decide_nothing() {
        for weights in [&[f64::NAN; 6][..], &[1.0; 3][..], &[][..]] {
            let d = rule(0.0).decide(weights, 1.0);
            assert_eq!((d.candidate, d.certainty), (None, None));
            assert!(d.is_uncertain());
        }
    }
}
