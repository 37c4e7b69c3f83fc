//! Nearest neighbours, the thesis's method of comparison (§4-3-1): a signal is given to the classes
//! of those training residuals that lie nearest to its own.
//!
//! In, from `design/isolator.rs`: once the labelled training residuals, N counts each, and the
//! number k of neighbours; then per signal its residual. (With `isolate.signal` = `deviation` all
//! are deviations instead.) Out: the share of each class among the k residuals at the smallest
//! Euclidean distance. All distances are computed, in f32 and without an index, which suffices
//! since only flagged signals get here.

use super::{IsolateError, MAX_CLASSES};

/// The training residuals and their classes.
#[derive(Clone, Debug, PartialEq)]
pub struct Neighbours {
    /// N, the number of samples of a residual.
    samples: usize,
    /// n_f, the number of classes.
    classes: usize,
    /// k, how many neighbours vote.
    neighbours: usize,
    /// The residuals one after another, `samples` counts each.
    residuals: Vec<f32>,
    /// The class of each residual.
    class_of: Vec<u16>,
}

impl Neighbours {
    /// Keeps the training residuals. `residuals`: N counts each; `class_of`: the class of each;
    /// `classes`: how many classes there are; `neighbours`: k, 1 to the number of residuals.
    /// Errors: numbers that do not fit each other, and residuals that are not finite in f32.
    pub fn new(
        residuals: &[&[f64]],
        class_of: &[u16],
        classes: usize,
        neighbours: usize,
    ) -> Result<Neighbours, IsolateError> {
        if classes == 0 || classes > MAX_CLASSES {
            return Err(IsolateError::ClassCount { found: classes });
        }
        if class_of.len() != residuals.len() {
            let (found, expected) = (class_of.len(), residuals.len());
            return Err(IsolateError::WrongLength { what: "list of classes", found, expected });
        }
        if neighbours == 0 || neighbours > residuals.len() {
            return Err(IsolateError::NeighbourCount { neighbours, found: residuals.len() });
        }
        if let Some(&class) = class_of.iter().find(|class| usize::from(**class) >= classes) {
            return Err(IsolateError::UnknownClass { class, classes });
        }
        let samples = residuals[0].len();
        let mut flat = Vec::with_capacity(samples * residuals.len());
        for residual in residuals {
            if residual.len() != samples {
                let (found, expected) = (residual.len(), samples);
                return Err(IsolateError::WrongLength { what: "residual", found, expected });
            }
            if let Some(index) = residual.iter().position(|v| !(*v as f32).is_finite()) {
                return Err(IsolateError::NotFinite { what: "residual", index });
            }
            flat.extend(residual.iter().map(|v| *v as f32));
        }
        let class_of = class_of.to_vec();
        Ok(Neighbours { samples, classes, neighbours, residuals: flat, class_of })
    }

    /// Writes the share of each class among the k nearest residuals into `weights` (n_f, with the
    /// sum 1). Of equally near residuals the earlier counts. A residual that is not finite gives
    /// NaN in all weights; one of another length is an error.
    pub fn weigh(&self, residual: &[f64], weights: &mut [f64]) -> Result<(), IsolateError> {
        for (what, found, expected) in
            [("residual", residual.len(), self.samples), ("weights", weights.len(), self.classes)]
        {
            if found != expected {
                return Err(IsolateError::WrongLength { what, found, expected });
            }
        }
        let r: Vec<f32> = residual.iter().map(|v| *v as f32).collect();
        if r.iter().any(|v| !v.is_finite()) {
            weights.fill(f64::NAN);
            return Ok(());
        }
        // squared distance to each training residual, and that residual's number, which decides between equal
        // distances
        let mut distances: Vec<(f32, u32)> = (0..self.class_of.len())
            .map(|i| {
                let known = &self.residuals[i * self.samples..(i + 1) * self.samples];
                (known.iter().zip(&r).map(|(a, b)| (a - b) * (a - b)).sum(), i as u32)
            })
            .collect();
        // only which residuals are the k nearest matters, not their order
        distances.select_nth_unstable_by(self.neighbours - 1, |p, q| {
            p.0.total_cmp(&q.0).then(p.1.cmp(&q.1))
        });
        weights.fill(0.0);
        for (_, i) in &distances[..self.neighbours] {
            weights[usize::from(self.class_of[*i as usize])] += 1.0 / self.neighbours as f64;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Five residuals on a line, the first two of class 0 and the others of class 1, of three
    /// classes.
    fn on_a_line(k: usize) -> Neighbours {
        let at: Vec<[f64; 2]> = [0.0, 1.0, 2.0, 10.0, 11.0].map(|x| [x, 0.0]).to_vec();
        let slices: Vec<&[f64]> = at.iter().map(|p| p.as_slice()).collect();
        Neighbours::new(&slices, &[0, 0, 1, 1, 1], 3, k).unwrap()
    }

    #[test]
    fn weights_are_the_classes_shares_among_the_nearest() {
        let mut w = [0.0; 3];
        on_a_line(1).weigh(&[1.9, 0.0], &mut w).unwrap();
        assert_eq!(w, [0.0, 1.0, 0.0]);
        on_a_line(3).weigh(&[1.2, 5.0], &mut w).unwrap();
        assert!((w[0] - 2.0 / 3.0).abs() < 1e-15 && (w[1] - 1.0 / 3.0).abs() < 1e-15);
        on_a_line(5).weigh(&[0.0, 0.0], &mut w).unwrap();
        assert!((w.iter().sum::<f64>() - 1.0).abs() < 1e-15);
    }

    #[test]
    fn of_equally_near_ones_the_earlier_counts() {
        let mut w = [0.0; 3];
        on_a_line(1).weigh(&[1.5, 0.0], &mut w).unwrap();
        assert_eq!(w, [1.0, 0.0, 0.0]);
    }

    #[test]
    fn what_is_no_number_gives_no_number_and_senseless_sets_are_errors() {
        let mut w = [0.0; 3];
        on_a_line(1).weigh(&[f64::NAN, 0.0], &mut w).unwrap();
        assert!(w.iter().all(|w| w.is_nan()));
        assert!(on_a_line(1).weigh(&[1.0], &mut w).is_err());
        let one: &[&[f64]] = &[&[1.0]];
        assert!(Neighbours::new(one, &[0], 1, 2).is_err());
        assert!(Neighbours::new(one, &[1], 1, 1).is_err());
        assert!(Neighbours::new(one, &[0, 0], 1, 1).is_err());
        assert!(Neighbours::new(&[], &[], 1, 1).is_err());
        assert!(Neighbours::new(&[&[f64::NAN]], &[0], 1, 1).is_err());
    }
}
