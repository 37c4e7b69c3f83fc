//! What was tuned: every number of the critique that follows from no definition, calculation or physics.
//!
//! In brackets, the recordings that it was tuned on: `7.1`: seeds 7 100 000 on (`tuning_recordings` in `tests/hidden`) and
//! `--hide 1` to `259`; `400`: seeds 400 000 to 400 067 of `tests/foreign`; `7.8`: seeds 7 800 000 to 7 830 031 and
//! 810 000 to 840 039 of both; `-`: nobody wrote it down. What is measured on other seeds: `docs/hidden_effects.md`.
//!
//! What half and twice of each do to how often names are right is printed by `tests/foreign/prices.rs`. It takes a day of one
//! core, and has not been run for all of them.

inkling_core::numbers! {
    // when a cause is there, and which

    /// What differs by less in -2 ln likelihood, parameters paid for, cannot be told apart: odds of seven. (7.8)
    tie = 4.0;

    // what is little of a whole, what is most of it, and what is far more than usual

    /// A tenth: signals without a covariate, left out, or of a channel that rings unlike the others; codes between a step's
    /// multiples; squares that a ring must take of a signal, and a line of a decay's misfit that follows itself; a burst's weight and a
    /// frequency's scatter that say nothing beside others; the distance of a line to a multiple of the ring. (400 the
    /// burst's weight, else -)
    few = 0.1;
    /// Of a decay's misfit. From it on an autoregression stands in for what is missing, or it is unexplained. (-;
    /// at .15 one decay that has nothing becomes `unknown`)
    mostly = 0.5;
    /// A random tone over its neighbourhood where noise is correlated, too; a signal's misfit over the median one. (-)
    stands_out = 3.0;

    // what models leave, shares of their statistics: squares of their relative errors

    /// Noise to whatever else; causes through one covariate, or the amplitude, to each other. (7.1, 7.8)
    left_to_alike = 0.1;
    /// Shapes of the mean, and what follows covariates, to others of their kind; coloured misfits of decays. (7.1)
    left_to_shapes = 0.03;
    /// Codes to what moves the mean; that to the noise. (7.1, 7.8)
    left_to_unlike = 0.006;
    /// A cause to what has no name. Strong ones left up to .06, effects outside the catalogue .13 at least. (7.1) Of
    /// decays, the strongest cause to rivals without a name: looked at on the measured ones (`tests/measured.rs`).
    left_by_all = 0.07;
    /// The ratio of the resistive rates, which is held, to amplitudes inside. (7.1)
    interior = 0.05;
    /// The same to the split of a meniscus's stiffness. (7.1)
    split = 0.15;
    /// The scatter of the acquisition state alone to half-order loss: -.1 to -.25 in null recordings of
    /// `hidden_large.toml` (1152 signals), +.05 with 8 K in print runs of `physics.toml` (8192 signals).
    eta_floor = 0.3;

    // the real pole

    /// How well its rate over the damping is known: the standard deviation of ln lambda/sigma. A pole of any rate within
    /// its bounds stands in for a droop, one of a rate that is known does not. Of 84 effects (seeds 2 310 000 on of
    /// `tests/foreign`) .35 names 77 and misses three of four droops; .2 names 78, and of the droops two, with two `unknown`;
    /// .12 names 79. Of 42 healthy recordings of another generator, whose pole is 3 to 6 % of the ring, 40, 40 and 39 are
    /// `none`.
    ln_lambda_sd = 0.2;

    // where searches begin and end

    /// The ring over the noise where a fit starts, in whatever unit.
    start_over_noise = 300.0;
    /// The farthest that a signal's own frequency is looked for from its channel's, relative.
    most_drift = 0.1;

    // lines

    /// A line below this share of the ring's frequency is no mode. (-)
    least_mode = 0.3;
    /// The statistic from which on the slow mode's damping is free. (7.1)
    shows_its_loss = 400.0;
    /// Within what factor it is free. (7.1)
    other_loss = 2.5;
    /// Lines of a decay so near a multiple of the ring are its harmonics, relative. (-; at .1 two of six decays lose
    /// their mode)
    harmonic = 0.01;

    // signals that ring unlike the others

    /// Robust deviations beyond which a signal is one, or a sample. (-, of samples 7.8)
    outlying = 7.0;
    /// The least of those deviations of ln damping; of the frequency and the amplitude in proportion. (-)
    least_scatter = 0.025;
    /// A channel with so many of them, and more than few, is faulty at times: all of it is left out. (-)
    faulty_signals = 2.0;
    /// How many far samples in a row are a shape. (7.8)
    odd_in_a_row = 3.0;

    // noise, codes, what was recorded

    /// Of the signals, the noisier share that does not tell the noise. (-)
    untold_noise = 0.01;
    /// Of a line's excess over white noise, in its own errors, what counts beside the chance of exponentials. (-)
    line_bound = 1.5;
    /// Of clipping's surprise, what counts: scatter of the largest signals is not modelled. (-)
    clipped_share = 0.44;
    /// Relative spread that makes a drive scan. (-)
    drive_scan = 0.03;
}

// grids of searches

/// Second numbers of rivals. A stop's place in amplitudes, on either side of zero and not at it, where sides are
/// undecided; a gain's lag in signal lengths, negative where the gain has settled before the signal begins; how many
/// times over a frequency has settled at the signal's end (0: it changes along a straight line).
pub const PLACES: [f64; 5] = [1e-3, 0.3, -0.3, 0.6, -0.6];
pub const LAGS: [f64; 5] = [0.0, 1.0 / 30.0, 0.25, -1.0 / 30.0, -0.25];
pub const SETTLES: [f64; 3] = [0.0, 4.0, 16.0];
/// Compliance ratios B_t/B_m that are looked for. From .03 on, five of five menisci of .012 to .033 by another generator had no name;
/// from .001 on, droops of one detection limit were called so.
pub const MENISCUS: (f64, f64) = (0.005, 1.0);
