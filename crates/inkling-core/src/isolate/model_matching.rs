//! Model matching: one residual generator per fault class, and the class whose residual is
//! smallest. thesis §3-3-1. The filters are made and run in `design/fault_class.rs`.

/// The class with the smallest energy (counts²·s) among those whose energy is at most their own
/// bound; of equals the first. `None`: the signal fits no class. NaN is within no bound.
pub fn best_class(energies: &[f64], bounds: &[f64]) -> Option<u16> {
    let within = energies.iter().zip(bounds).enumerate().filter(|(_, (e, bound))| e <= bound);
    within.reduce(|best, next| if next.1.0 < best.1.0 { next } else { best }).map(|(i, _)| i as u16)
}

#[cfg(test)]
mod tests {
    use super::best_class;

    #[test]
    fn the_smallest_energy_wins_among_the_classes_whose_bounds_it_meets() {
        assert_eq!(best_class(&[3.0, 1.0, 2.0], &[4.0; 3]), Some(1));
        assert_eq!(best_class(&[3.0, 1.0], &[30.0, 0.5]), Some(0));
    }

    #[test]
    fn a_signal_that_fits_no_class_is_rejected_and_so_is_no_number() {
        assert_eq!(best_class(&[3.0, 5.0], &[1.0, 1.0]), None);
        assert_eq!(best_class(&[f64::NAN, f64::INFINITY], &[1.0, 1.0]), None);
        assert_eq!(best_class(&[f64::NAN, 0.5], &[1.0, 1.0]), Some(1));
        assert_eq!(best_class(&[], &[]), None);
    }
}
