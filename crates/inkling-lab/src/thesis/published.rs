//! The numbers that the thesis reports, and a test of whether this program's number could be the
//! same.
//!
//! In: the name of one of our figures (as `methods::figure` makes it) and the figure's values over
//! rounds, one share for each round. Out to `tables`: the thesis's number from `published.toml`,
//! and whether it differs from ours: whether a number as far from ours would be improbable if the thesis's
//! data set were one more of our rounds.
//!
//! The test takes our share in one more round for a variable that is normal after its arcsine transform. Its mean is the mean of our rounds; its
//! variance has three parts: the sampling error of the thesis's signals, what our rounds differ by beyond
//! their own sampling error, and the error of our mean. That is this project's choice; the thesis tests
//! nothing.

use super::outcome::{Confusion, DataSet, Spread};
use inkling_core::model::student::student_quantile;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::sync::LazyLock;

/// A share that the thesis reports (0 to 1), and of how many signals it is the share.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Published {
    pub share: f64,
    pub of: u32,
}

impl Published {
    /// The share of `n` among `of` signals.
    fn counted(n: u32, of: u32) -> Published {
        Published { share: f64::from(n) / f64::from(of), of }
    }

    /// Whether fewer than one in twenty further rounds of ours, with `of` signals each, would give a share as
    /// far from our mean as the thesis's.
    ///
    /// `ours`: the share of each round; `signals`: of how many signals each of these shares is.
    /// `None`: there are fewer than two rounds, so nobody knows by how much others would differ, or
    /// there is no signal.
    ///
    /// The share of that further round is taken to scatter about m, the mean of `ours`, with this variance (n: `of`; R: number of rounds; b: variance between rounds):
    ///
    /// ```text
    /// variance = m (1 - m) / n        sampling the thesis's n signals
    ///          + b                    what any two rounds differ by beyond sampling
    ///          + (b + m (1 - m) / signals) / R    the error of m itself
    /// b = max(0, u sd^2 - m (1 - m) / signals)    sd: standard deviation of `ours`
    /// ```
    ///
    /// u is 1, or (t / 1.96)^2 with the 97.5 % quantile t of Student's distribution where sd
    /// exceeds the sampling error significantly: then b is known only as well as R allows, and
    /// counts for more.
    pub fn differs(self, ours: &[f64], signals: f64) -> Option<bool> {
        let rounds = ours.len() as f64;
        if ours.len() < 2 || signals < 1.0 {
            return None;
        }
        let Spread { mean, sd } = Spread::of(ours);
        // The mean m of our rounds, with one signal that is half right added, so that m is never 0 or
        // 1.
        let seen = rounds * signals;
        let mean = (mean * seen + 0.5) / (seen + 1.0);

        // The parts of the variance. `is_more` is a chi-squared test at 5 %: do the rounds differ
        // by more than the sampling of `signals` signals explains?
        let sampling = mean * (1.0 - mean);
        let of_a_round = sampling / signals;
        let freedom = rounds - 1.0;
        let is_more = sd * sd * freedom > of_a_round * chi_squared_quantile_95(freedom);
        let unsure = if is_more { (student_quantile(0.975, freedom) / 1.96).powi(2) } else { 1.0 };
        let between = (unsure * sd * sd - of_a_round).max(0.0);
        let variance = sampling / f64::from(self.of) + between + (between + of_a_round) / rounds;
        // the arcsine of its root makes a share near 0 or 1 nearly normal, too; its slope is 1 / sqrt(m (1 - m))
        let normal = |share: f64| 2.0 * share.sqrt().asin();
        let off = (normal(self.share) - normal(mean)).abs();
        Some(off > 1.96 * (variance / sampling).sqrt())
    }
}

/// The 95 % quantile of chi-squared, by Wilson and Hilferty (1931): good to a per cent.
fn chi_squared_quantile_95(freedom: f64) -> f64 {
    let of = 2.0 / (9.0 * freedom);
    freedom * (1.0 - of + 1.645 * of.sqrt()).powi(3)
}

/// What `published.toml` holds.
#[derive(Deserialize)]
struct Thesis {
    numbers: BTreeMap<DataSet, Numbers>,
    matrices: Vec<Matrix>,
}

/// The numbers of one data set by our names: shares of so many signals, and counts among so many.
#[derive(Deserialize)]
struct Numbers {
    shares: BTreeMap<String, (f64, u32)>,
    counts: BTreeMap<String, (u32, u32)>,
}

/// A confusion matrix of the thesis (Tables 4-1 to 4-5). Rows are the truth, columns what was said.
#[derive(Deserialize)]
pub struct Matrix {
    pub title: String,
    pub set: DataSet,
    /// The key of our confusion among those of `Measured`.
    pub ours: String,
    #[serde(flatten)]
    pub confusion: Confusion,
}

/// The contents of `published.toml`, which is compiled in.
static THESIS: LazyLock<Thesis> = LazyLock::new(|| {
    toml::from_str(include_str!("published.toml")).expect("a test has read the same text")
});

/// The thesis's number for one of our figures, if it reports one.
pub fn published(set: DataSet, key: &str) -> Option<Published> {
    let Numbers { shares, counts } = THESIS.numbers.get(&set)?;
    let share = shares.get(key).map(|&(share, of)| Published { share, of });
    share.or_else(|| counts.get(key).map(|&(n, of)| Published::counted(n, of)))
}

/// The thesis's confusion matrices, in the order of its tables.
pub fn matrices() -> &'static [Matrix] {
    &THESIS.matrices
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    /// The matrices must give the shares that the text of thesis chapter 4 states for them.
    #[test]
    fn the_published_matrices_give_the_published_shares_and_sizes() {
        for (matrix, (share, signals)) in matrices().iter().zip([
            (0.979, 4500.0),
            (1.0, 147.0),
            (0.801, 2025.0),
            (0.879, 0.532 * 2025.0),
            (0.990, 99.0),
        ]) {
            let theirs = &matrix.confusion;
            let sum: f64 = theirs.counts.iter().flatten().sum();
            // the thesis's HMA (§4-3), trace over sum: plain accuracy
            let right: f64 = (0..theirs.classes.len()).map(|i| theirs.counts[i][i]).sum();
            assert!((right / sum - share).abs() < 6e-4, "{}: {}", matrix.title, right / sum);
            assert!((sum - signals).abs() < 1.0, "{}: {sum} signals", matrix.title);
        }
    }

    #[test]
    fn a_number_of_every_table_is_found_by_our_name_for_it() {
        for (set, key, share) in [
            (DataSet::ThesisForm, "LR on y, tenth/certain", Some(0.820)),
            (DataSet::ThesisForm, "1-NN on y, half/accuracy", Some(0.782)),
            (DataSet::Drying, "LR on r, half/accuracy", Some(1.0)),
            (DataSet::ThesisForm, "practice/right", Some(0.948)),
            (DataSet::ByModel, "LR on r, all/accuracy", None),
        ] {
            assert_eq!(published(set, key).map(|p| p.share), share, "{key}");
        }
        assert_eq!(Published::counted(92, 2025).share, 92.0 / 2025.0);
    }

    /// With three seeds, 92 ± 3.6 of 99 differs from the thesis's 99.
    #[test]
    fn nearness_counts_the_sampling_error_of_both() {
        let differs = |shares: &[f64], signals, n, of| {
            Published::counted(n, of).differs(shares, signals).unwrap()
        };
        let of_99 = [88.4 / 99.0, 92.0 / 99.0, 95.6 / 99.0];
        assert!(differs(&of_99, 99.0, 99, 99));
        assert!(!differs(&of_99, 99.0, 91, 99));
        assert!(differs(&[0.75, 0.755], 2025.0, 1622, 2025));
        assert!(!differs(&[0.80, 0.805], 2025.0, 1622, 2025));
        assert_eq!(Published::counted(1622, 2025).differs(&[0.75], 2025.0), None, "one seed");
        // what seeds differ by beyond sampling makes the thesis's number uncertain, too
        assert!(!differs(&[0.04, 0.05, 0.06, 0.03, 0.05], 2025.0, 120, 2025));
        assert!(differs(&[0.046, 0.046, 0.046, 0.046, 0.046], 2025.0, 120, 2025));
        assert!(Published::counted(1, 2).differs(&[], 10.0).is_none());
        for (freedom, table) in [(1.0, 3.841), (2.0, 5.991), (19.0, 30.144)] {
            assert!((chi_squared_quantile_95(freedom) / table - 1.0).abs() < 0.03, "{freedom}");
        }
    }

    #[test]
    fn what_is_the_same_differs_as_rarely_as_stated() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(11);
        // p, its standard deviation between seeds, rounds, signals of a round and of the thesis, and the
        // largest share; where seeds differ by more than sampling, as the misses of the thesis's method do,
        // it is hardly larger
        for (p, between, rounds, signals, of, most) in [
            (0.8, 0.0, 5, 300, 300, 0.065),
            (0.03, 0.0, 8, 500, 200, 0.065),
            (0.95, 0.0, 3, 99, 99, 0.065),
            (0.05, 0.012, 3, 2025, 2025, 0.15),
            (0.05, 0.012, 5, 2025, 2025, 0.15),
            (0.05, 0.012, 20, 2025, 2025, 0.09),
        ] {
            let mut draw = |n: u32| {
                let of_seed: f64 = (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0;
                let p = (p + between * of_seed).clamp(0.0, 1.0);
                (0..n).filter(|_| rng.random::<f64>() < p).count() as u32
            };
            let differs = |_: &i32| {
                let ours: Vec<f64> =
                    (0..rounds).map(|_| f64::from(draw(signals)) / f64::from(signals)).collect();
                Published::counted(draw(of), of).differs(&ours, f64::from(signals)).unwrap()
            };
            let share = (0..1000).filter(differs).count() as f64 / 1000.0;
            assert!(share <= most, "{share} of {p}, {between}, {rounds} rounds");
        }
    }
}
