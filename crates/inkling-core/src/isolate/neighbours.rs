//! Nearest neighbours, the thesis's method of comparison (§4-3-1): a signal is given to the classes
//! of those training residuals (or deviations, by `isolate.signal`) that lie nearest to its own.
//!
//! In: once the labelled training residuals, N counts each, and the number k; then per signal its
//! residual. Out: the share of each class among the k residuals at the smallest Euclidean distance.
//! All distances are computed, in f32, which suffices since only flagged signals get here.

use super::IsolateError;

#[derive(Clone, Debug, PartialEq)]
pub struct Neighbours {
    samples: usize,
    neighbours: usize,
    /// The residuals one after another, `samples` counts each.
    residuals: Vec<f32>,
    class_of: Vec<u16>,
}

impl Neighbours {
    /// An error if k is 0 or above the number of examples, or if a residual is not finite in f32.
    pub fn new(examples: &[(u16, Vec<f64>)], neighbours: usize) -> Result<Self, IsolateError> {
        if neighbours == 0 || neighbours > examples.len() {
            return Err(IsolateError::NeighbourCount { neighbours, found: examples.len() });
        }
        let samples = examples[0].1.len();
        let class_of = examples.iter().map(|(class, _)| *class).collect();
        let residuals: Vec<f32> =
            examples.iter().flat_map(|(_, residual)| residual).map(|v| *v as f32).collect();
        match residuals.iter().position(|v| !v.is_finite()) {
            Some(k) => Err(IsolateError::NotFinite { what: "residual", index: k % samples }),
            None => Ok(Neighbours { samples, neighbours, residuals, class_of }),
        }
    }

    /// Writes the share of each class among the k nearest residuals into `weights` (n_f). Of
    /// equally near residuals the earlier counts. A residual that is not finite gives NaN.
    pub fn weigh(&self, residual: &[f64], weights: &mut [f64]) {
        let r: Vec<f32> = residual.iter().map(|v| *v as f32).collect();
        if r.iter().any(|v| !v.is_finite()) {
            return weights.fill(f64::NAN);
        }
        let square =
            |example: &[f32]| example.iter().zip(&r).map(|(a, b)| (a - b) * (a - b)).sum::<f32>();
        let squares = self.residuals.chunks_exact(self.samples).map(square);
        let mut nearest: Vec<(f32, usize)> = squares.zip(0..).collect();
        nearest.select_nth_unstable_by(self.neighbours - 1, |p, q| {
            p.0.total_cmp(&q.0).then(p.1.cmp(&q.1))
        });
        weights.fill(0.0);
        for (_, i) in &nearest[..self.neighbours] {
            weights[usize::from(self.class_of[*i])] += 1.0 / self.neighbours as f64;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Five residuals on a line, the first two of class 0 and the others of class 1, of three
    /// classes.
    fn on_a_line(k: usize) -> Neighbours {
        let line = [(0, 0.0), (0, 1.0), (1, 2.0), (1, 10.0), (1, 11.0)];
        Neighbours::new(&line.map(|(class, x)| (class, vec![x, 0.0])), k).unwrap()
    }

    #[test]
    fn weights_are_the_classes_shares_among_the_nearest() {
        let mut w = [0.0; 3];
        on_a_line(1).weigh(&[1.9, 0.0], &mut w);
        assert_eq!(w, [0.0, 1.0, 0.0]);
        on_a_line(3).weigh(&[1.2, 5.0], &mut w);
        assert!((w[0] - 2.0 / 3.0).abs() < 1e-15 && (w[1] - 1.0 / 3.0).abs() < 1e-15);
        on_a_line(5).weigh(&[0.0, 0.0], &mut w);
        assert!((w.iter().sum::<f64>() - 1.0).abs() < 1e-15);
    }

    #[test]
    fn of_equally_near_ones_the_earlier_counts() {
        let mut w = [0.0; 3];
        on_a_line(1).weigh(&[1.5, 0.0], &mut w);
        assert_eq!(w, [1.0, 0.0, 0.0]);
    }

    #[test]
    fn what_is_no_number_gives_no_number_and_senseless_sets_are_errors() {
        let mut w = [0.0; 3];
        on_a_line(1).weigh(&[f64::NAN, 0.0], &mut w);
        assert!(w.iter().all(|w| w.is_nan()));
        assert!(Neighbours::new(&[(0, vec![1.0])], 2).is_err());
        assert!(Neighbours::new(&[], 1).is_err());
        assert!(Neighbours::new(&[(0, vec![f64::NAN])], 1).is_err());
    }
}
