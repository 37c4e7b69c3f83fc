//! The numbers of names and sizes that nobody derived, all of them; docs/numbers.md tells what half and twice of each do.

crate::numbers! {
    /// Weight of all severities of a name's range, each as likely, beside those that were labelled, in labelled signals.
    name_counts = 4.0;
    /// The same of all severities of the kind of fault.
    any_counts = 1.0;
    /// Share, among flagged signals, of healthy rings of another size, before anything is heard.
    gain = 0.02;
    /// The same of those by another clock.
    clock = 0.01;
    /// The same of those that come late.
    delay = 0.01;
    /// The same of channels whose rates are all a little off.
    rates = 0.03;
    /// The same of rings that nobody knows anything of.
    any_ring = 0.02;
    /// How far gain (ln), clock (ln) and delay (samples) may be off to either side.
    most_off: [f64; 3] = [1.1, 0.25, 4.0];
    /// Standard deviation of what else is a little off in these, by feature.
    beside: [f64; 4] = [0.01, 0.02, 0.004, 0.03];
    /// Standard deviations of ln rates that are all a little off, each as likely.
    rates_off: [f64; 3] = [0.1, 0.2, 0.4];
    /// Of ln gain beside them.
    gain_beside = 0.05;
    /// Scales of Student's t with three degrees of freedom for ln amplitude, ln damping and ln frequency of any ring.
    any: [f64; 3] = [0.4, 0.5, 0.25];
    /// Share of the misfit's energy beyond the noise that a shape must explain for the misfit to be named after it.
    of_misfit = 0.6;
    /// A ring whose |ln damping| and |ln frequency|, relative to the healthy one, are below these is a healthy ring of another
    /// amplitude.
    near: [f64; 2] = [0.2, 0.02];
    /// Fewer examples do not determine the ends of a range: with 23 up to a tenth of a class's further signals lay outside the
    /// estimated one, with 60 one in a hundred (measured on another generator than ours).
    tell_ends: usize = 60;
    /// Weight of the prior in the physics' mixture weight, in examples.
    physics_counts = 8.0;
    /// Fewest examples of every class for a temperature of their own.
    fewest_scaled: usize = 3;
    /// Standard deviation of ln pulse, of which only the guess is known.
    pulse_sd = 0.1;
    /// The same of the ln of a common factor of a and b (stiffness), and of g and d (viscosity): of the guess only the ratios are
    /// trusted.
    scale_sd = 1.0;
    /// Standard deviation of ln damping and ln frequency of the measured healthy ring.
    ring_sd = 1e-3;
    /// Degrees of freedom of Student's t for a labelled signal's distance from the curve.
    degrees = 8.0;
    /// Standard deviation of ln (spread of g / spread of d): ln 1.5.
    alike = 0.405;
    /// The likelihood of the channels' spread counts no more channels than this: that spread is not exactly Gaussian.
    most_channels: usize = 400;
    /// Standard deviation of a guessed ln rate: guesses are believed to a fifth.
    guessed_rate = 0.2;
    /// Of a guessed ln pulse where rates are guesses.
    guessed_pulse = 0.05;
    /// Standard deviation of the error of a fault's law where only its direction is believed: of each feature at least.
    of_law: [f64; 4] = [0.02, 0.03, 0.005, 0.03];
    /// The same as a share of what the fault changes.
    share_of_law = 0.1;
    /// Weight of the covariance of all classes in that of one, in examples.
    shrinkage = 1.0;
    /// Half width below which a range of a class's features is none.
    narrowest = 0.02;
    /// Probability that a further signal of a class leaves more beside its ring than is usual for the class.
    missed = 0.0015;
    /// Fewer labelled sizes tell no line, and nothing of what lies beside it.
    fewest_sizes: usize = 20;
}
