//! All numbers of naming and sizing faults that no calculation gives; docs/design/numbers.md tells what
//! half and twice of each do. "Features" are ln amplitude, ln
//! damping, ln frequency and phase (rad), in this order; "rates" are a, b, g, d.

/// Weight, in labelled signals, of a uniform distribution over the severities that a class's
/// name means, beside those that were labelled.
pub const NAME_COUNTS: f64 = 4.0;
/// A priori share, of what is flagged, of each of five kinds of signal of no class: healthy
/// rings of another gain, of another clock, and late ones; channels whose rates are all a
/// little off; and rings of any kind.
pub const NO_CLASS: f64 = 0.02;
/// How far gain (ln), clock (ln) and delay (samples) may be off to either side.
pub const MOST_OFF: [f64; 3] = [1.1, 0.25, 4.0];
/// Scales of Student's t for ln amplitude, ln damping and ln frequency of a ring of any kind.
pub const ANY: [f64; 3] = [0.4, 0.5, 0.25];
/// Prior standard deviation of ln pulse, the length of the actuation pulse.
pub const PULSE_SD: f64 = 0.1;
/// Least standard deviation, by feature, of what a law leaves out where only its direction is
/// believed; and the width of rings of another gain, clock or delay.
pub const OF_LAW: [f64; 4] = [0.02, 0.03, 0.005, 0.03];
/// What a fault's law may be wrong, as a share of the change of the feature, if that is more.
pub const SHARE_OF_LAW: f64 = 0.1;

/// Prior standard deviation, by feature, of where a class lies of which no law is known.
pub const OF_OWN: [f64; 4] = [0.4, 0.5, 0.25, 1.0];

/// A priori share of labels whose class or size is wrong.
pub const WRONG_LABELS: f64 = 0.02;

/// Number of examples from which on the ends of a range are estimated: a further one lies between
/// the least and the greatest of n with probability (n - 1) / (n + 1), which is to be .95.
pub const TELL_ENDS: usize = 39;

/// Weight, in examples, of a prior that nothing supports but the lack of anything better (the unit
/// information prior of Kass and Wasserman, 1995): of a uniform distribution over all severities of
/// a kind of fault, and of the covariance that all classes have in common.
pub const ONE_EXAMPLE: f64 = 1.0;
