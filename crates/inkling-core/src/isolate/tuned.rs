//! All numbers of naming and sizing faults that nobody derived; docs/numbers.md tells what half and twice of
//! each do.

crate::numbers! {
    /// Weight of a uniform distribution over the range of a name's severities, beside the severities that
    /// were labelled, in labelled signals.
    name_counts = 4.0;
    /// A priori share of each kind of signal that is of no class among what is flagged: healthy rings of
    /// another gain, of another clock, and late ones; channels whose rates are all a little off; and rings of
    /// any kind, of which nothing is known.
    no_class = 0.02;
    /// How far gain (ln), clock (ln) and delay (samples) may be off to either side in these alternatives.
    most_off: [f64; 3] = [1.1, 0.25, 4.0];
    /// Scales of Student's t with three degrees of freedom, for ln amplitude, ln damping and ln frequency of
    /// a ring of any kind.
    any: [f64; 3] = [0.4, 0.5, 0.25];
    /// A ring whose |ln damping| and |ln frequency|, relative to the healthy one, are below these is a
    /// healthy ring of another amplitude.
    near: [f64; 2] = [0.2, 0.02];
    /// Standard deviation of ln pulse, of which nothing but the guess is known.
    pulse_sd = 0.1;
    /// Standard deviation of a guessed ln rate: guesses are believed to a fifth. With twice that a design without
    /// labelled faults names more on a head of another physics, and more of it rightly (.50 at .8 instead of .32, right
    /// .74 instead of .56), and calls a stiffer actuator an air bubble in .24 instead of .01 of its signals (seed 1
    /// of `tests/outside`).
    guessed_rate = 0.2;
    /// Standard deviation, by feature, of what a law leaves out: of a fault's law where only its direction is
    /// believed (the least one), and of rings of another gain, clock or delay.
    of_law: [f64; 4] = [0.02, 0.03, 0.005, 0.03];
    /// The same as a share of the change that the fault makes to the feature.
    share_of_law = 0.1;
}

/// Number of examples from which on the ends of a range are estimated: a further one lies between the least and the
/// greatest of n with the probability (n - 1) / (n + 1), which is to be .95.
pub const TELL_ENDS: usize = 39;

/// Weight of a prior that nothing supports but the lack of anything better, in examples: as much as one of them says
/// (the unit information prior of Kass and Wasserman, 1995). So weigh a uniform distribution over all
/// severities of a kind of fault beside the severities that were labelled, and the covariance that all classes
/// have in common beside the examples of one class.
pub const ONE_EXAMPLE: f64 = 1.0;
