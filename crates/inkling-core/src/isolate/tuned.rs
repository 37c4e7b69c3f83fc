//! All numbers of naming and sizing faults that nobody derived; docs/numbers.md tells what half and twice of
//! each do.

crate::numbers! {
    /// Weight of a uniform distribution over the range of a name's severities, beside the severities that
    /// were labelled, in labelled signals.
    name_counts = 4.0;
    /// The same for a uniform distribution over all severities of the kind of fault.
    any_counts = 1.0;
    /// A priori share of healthy rings with another gain among flagged signals.
    gain = 0.02;
    /// The same of healthy rings sampled by another clock.
    clock = 0.01;
    /// The same of healthy rings that come late.
    delay = 0.01;
    /// The same of channels whose rates are all a little off.
    rates = 0.03;
    /// The same of rings of any kind, of which nothing is known.
    any_ring = 0.02;
    /// How far gain (ln), clock (ln) and delay (samples) may be off to either side in these alternatives.
    most_off: [f64; 3] = [1.1, 0.25, 4.0];
    /// Standard deviation, by feature, of what else may be a little off in these alternatives.
    beside: [f64; 4] = [0.01, 0.02, 0.004, 0.03];
    /// Standard deviations of ln rates where all rates are a little off; each of the three is as likely.
    rates_off: [f64; 3] = [0.1, 0.2, 0.4];
    /// Standard deviation of ln gain where all rates are a little off.
    gain_beside = 0.05;
    /// Scales of Student's t with three degrees of freedom, for ln amplitude, ln damping and ln frequency of
    /// a ring of any kind.
    any: [f64; 3] = [0.4, 0.5, 0.25];
    /// Share of the misfit's energy beyond the noise that a shape must explain for the misfit to be named
    /// after it.
    of_misfit = 0.6;
    /// A ring whose |ln damping| and |ln frequency|, relative to the healthy one, are below these is a
    /// healthy ring of another amplitude.
    near: [f64; 2] = [0.2, 0.02];
    /// Number of examples below which the ends of a range are not estimated: with 23 examples up to a tenth
    /// of a class's further signals lay outside the estimated range, with 60 one in a hundred (measured on
    /// another generator than ours).
    tell_ends: usize = 60;
    /// Weight of the prior of the physics' mixture weight, in examples.
    physics_counts = 8.0;
    /// Number of examples of every class below which the temperature is not estimated and remains 1.
    fewest_scaled: usize = 3;
    /// Standard deviation of ln pulse, of which nothing but the guess is known.
    pulse_sd = 0.1;
    /// Standard deviation of the ln of a common factor of a and b (stiffness), and of one of g and d
    /// (viscosity): of the guessed rates only the ratios are trusted.
    scale_sd = 1.0;
    /// Standard deviation of ln damping and ln frequency of the measured healthy ring.
    ring_sd = 1e-3;
    /// Degrees of freedom of Student's t for a labelled signal's distance from the curve.
    degrees = 8.0;
    /// Standard deviation of ln (spread of g / spread of d): ln 1.5.
    alike = 0.405;
    /// The likelihood of the channels' spread counts no more channels than this: that spread is not exactly
    /// Gaussian.
    most_channels: usize = 400;
    /// Standard deviation of a guessed ln rate: guesses are believed to a fifth. With twice that a design without
    /// labelled faults names more on a head of another physics, and more of it rightly (.50 at .8 instead of .32, right
    /// .74 instead of .56), and calls a stiffer actuator an air bubble in .24 instead of .01 of its signals (seed 1
    /// of `tests/outside`).
    guessed_rate = 0.2;
    /// Standard deviation of a guessed ln pulse where the rates are guesses.
    guessed_pulse = 0.05;
    /// Standard deviation of the error of a fault's law where only its direction is believed: the least one,
    /// by feature.
    of_law: [f64; 4] = [0.02, 0.03, 0.005, 0.03];
    /// The same as a share of the change that the fault makes to the feature.
    share_of_law = 0.1;
    /// Weight of the covariance that all classes have in common in the covariance of one class, in examples.
    shrinkage = 1.0;
    /// Smallest half width that a range of a class's features may have, in standard deviations of the noise.
    narrowest = 0.02;
    /// Probability that a further signal of a class leaves more beside its ring than the bound for the class.
    missed = 0.0015;
    /// Number of labelled severities below which no line from estimates to labels is fitted.
    fewest_sizes: usize = 20;
}
