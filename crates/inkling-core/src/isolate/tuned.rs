//! All numbers of naming and sizing faults that no calculation gives; docs/numbers.md tells what
//! half and twice of each do. `numbers!` makes a function of each, such as `tuned::no_class()`.
//!
//! "Features" are ln amplitude, ln damping, ln frequency and phase (rad), in this order; "rates"
//! are a, b, g, d.

crate::numbers! {
    /// Weight, in labelled signals, of a uniform distribution over the range of severities that a
    /// class's name means, beside the severities that were labelled (`physics_density.rs`).
    name_counts = 4.0;
    /// A priori share, among what is flagged, of each of five kinds of signal that is of no class
    /// (`alternatives.rs`): healthy rings of another gain, of another clock, and late ones;
    /// channels whose rates are all a little off; and rings of any kind, of which nothing is known.
    no_class = 0.02;
    /// How far gain (ln), clock (ln) and delay (samples) may be off to either side in the first
    /// three of these alternatives.
    most_off: [f64; 3] = [1.1, 0.25, 4.0];
    /// Scales of Student's t with three degrees of freedom, for ln amplitude, ln damping and ln frequency of
    /// a ring of any kind.
    any: [f64; 3] = [0.4, 0.5, 0.25];
    /// Prior standard deviation of ln pulse, the length of the actuation pulse, of which nothing
    /// but the guess is known.
    pulse_sd = 0.1;
    /// Standard deviation, by feature, of what a law leaves out. It is the least that a fault's law
    /// may be wrong where only its direction is believed (`fault_curve.rs`), and the width of rings
    /// of another gain, clock or delay (`alternatives.rs`).
    of_law: [f64; 4] = [0.02, 0.03, 0.005, 0.03];
    /// What a fault's law may be wrong, as a share of the change that the fault makes to the
    /// feature, if that is more than `of_law`.
    share_of_law = 0.1;
}

/// Number of examples of a class from which on the ends of a range are estimated: a further example
/// lies between the least and the greatest of n with the probability (n - 1) / (n + 1), which is to
/// be .95.
pub const TELL_ENDS: usize = 39;

/// Weight, in examples, of a prior that nothing supports but the lack of anything better: as much
/// as one example says (the unit information prior of Kass and Wasserman, 1995). Two priors have
/// this weight: a uniform distribution over all severities of a kind of fault, beside the
/// severities that were labelled; and the covariance that all classes have in common, beside the
/// examples of one class.
pub const ONE_EXAMPLE: f64 = 1.0;
