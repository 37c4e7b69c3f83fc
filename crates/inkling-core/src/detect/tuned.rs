//! All numbers of detection that no calculation gives, with what they were chosen on;
//! docs/design/numbers.md tells what half and twice of each do. The first six are of the mixture model of
//! a window's signals (`mixture.rs`), where s is a signal's squared distance.

/// Faults of any size are uniform in the space of the features up to so many medians of s, and
/// log-uniform beyond. This number and the next five were chosen on seven shapes of scatter with
/// 0, 3 and 40 % of faults over orders of magnitude, and on 72 windows of the open world with 0
/// to 40 % of nine classes of faults (seed 913001).
pub const EVENLY: f64 = 20.0;
/// Prior standard deviation of ln gamma, the shape of the healthy distribution.
pub const GAMMA_SD: f64 = 0.25;
/// Prior mean of 1 / kappa, which says how heavy the healthy distribution's tail is.
pub const TAIL_MEAN: f64 = 0.15;
/// Smallest ln (s / median) of faults of one size: nearer, they may be healthy channels that differ.
pub const NEAREST: f64 = 2.0;
/// Prior mean of the ln of the standard deviation (in ln s) of a component of one size.
pub const WIDTH: f64 = -1.4;
/// Prior standard deviation of the ln of that standard deviation.
pub const WIDTH_SD: f64 = 0.5;
/// Share of the channels' covariance in the metric of windows, beside all of the noise's: in the
/// tail channels that differ within bounds end sooner than a Gaussian of their variance would.
/// Misses of 2025 faults at one false alarm in 2475 (thesis-form data) with the full covariance and
/// with a third of it, by how channels differ: uniform 20 and 16, Gaussian 30 and 29, gamma 62 and
/// 63, Student's t with 5 degrees of freedom 101 and 112.
pub const SPREAD_COUNTS: f64 = 0.35;
/// Share of the points that a robust core keeps (`sensitivity.rs`), whose scale factor belongs
/// to .6 and does not follow a change of this number.
pub const CORE_SHARE: f64 = 0.6;
