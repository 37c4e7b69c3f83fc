//! Model matching: one residual generator per fault class, and the class whose residual is smallest.
//!
//! In: a signal's residual energy under each class's own filter, counts²·s, and each class's bound.
//! Out: the class. thesis §3-3-1.

/// The class with the smallest energy over its own bound (thesis §3-3-1); `None` if every class is
/// above its bound, that is, the signal fits none of them. `energies`, `bounds`: one per class.
///
/// Departs: the text says only that a small residual is expected and that a threshold can be chosen.
/// Classes scatter differently: energies are compared in units of their own thresholds.
pub fn best_class(energies: &[f64], bounds: &[f64]) -> Option<u16> {
    let excess = energies.iter().zip(bounds).map(|(e, bound)| e / bound);
    let within = excess.enumerate().filter(|(_, x)| *x <= 1.0);
    within.reduce(|best, next| if next.1 < best.1 { next } else { best }).map(|(i, _)| i as u16)
}

#[cfg(test)]
mod tests {
    use super::best_class;

    #[test]
    fn the_smallest_energy_wins_in_units_of_the_classes_own_bounds() {
        assert_eq!(best_class(&[3.0, 1.0, 2.0], &[4.0; 3]), Some(1));
        assert_eq!(best_class(&[3.0, 1.0], &[30.0, 2.0]), Some(0));
    }

    #[test]
    fn a_signal_that_fits_no_class_is_rejected_and_so_is_no_number() {
        assert_eq!(best_class(&[3.0, 5.0], &[1.0, 1.0]), None);
        assert_eq!(best_class(&[f64::NAN, f64::INFINITY], &[1.0, 1.0]), None);
        assert_eq!(best_class(&[f64::NAN, 0.5], &[1.0, 1.0]), Some(1));
        assert_eq!(best_class(&[], &[]), None);
    }
}
