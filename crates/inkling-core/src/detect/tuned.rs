//! All numbers of detection that no calculation gives, with what they were chosen on;
//! docs/numbers.md tells what half and twice of each do. `numbers!` makes a function of each, such
//! as `tuned::evenly()`.
//!
//! The first six are of the mixture model of a window's signals (`mixture.rs`), where s is a
//! signal's squared distance and "medians" are those of s.

crate::numbers! {
    /// Faults of any size are assumed to be uniform in the space of the features up to so many
    /// medians of s, and log-uniform beyond. This number and the next five were chosen on seven
    /// shapes of scatter with 0, 3 and 40 % of faults over orders of magnitude (a study apart from
    /// the tests), and on 72 windows of the open world with 0 to 40 % of nine classes of faults
    /// (seed 913001).
    evenly = 20.0;
    /// Prior standard deviation of ln gamma, the shape of the healthy distribution.
    gamma_sd = 0.25;
    /// Prior mean of 1 / kappa, which says how heavy the healthy distribution's tail is (0:
    /// Gaussian).
    tail_mean = 0.15;
    /// Smallest ln (s / median) that faults of one size may have: nearer, they may as well be healthy
    /// channels that differ.
    nearest = 2.0;
    /// Prior mean of the ln of the standard deviation (in ln s) of a component of one size.
    width = -1.4;
    /// Prior standard deviation of the ln of that standard deviation.
    width_sd = 0.5;
    /// Share of the channels' covariance in the metric of windows, beside all of the noise's. (Training chooses
    /// its share by the labelled signals, `design/learn_distances.rs`.) The threshold lies in the tail of the healthy
    /// signals, one in a thousand, and there channels that differ within bounds end sooner than a Gaussian of
    /// their variance would. Misses of 2025 faults at one false alarm in 2475 (thesis-form data) with the full
    /// covariance and with a third of it, by how channels differ: uniform 20 and 16, Gaussian 30 and 29, gamma 62
    /// and 63, Student's t with 5 degrees of freedom 101 and 112.
    spread_counts = 0.35;
    /// Share of the points that a robust core keeps (`sensitivity.rs`); the rest may be outliers.
    /// The core's scale factor there belongs to .6 and does not follow a change of this number.
    core_share = 0.6;
}
