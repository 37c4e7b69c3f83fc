//! Tuned numbers: every number of the critique that decides something and follows from no definition,
//! calculation or physics.
//!
//! The brackets at the end of a number's comment say which recordings it was tuned on:
//!
//! * `7.1`: seeds 7 100 000 on, drawn as by `--hide`, and `--hide 1` to `259`;
//! * `400`: seeds 400 000 to 400 067 of `tests/foreign`;
//! * `7.8`: seeds 7 800 000 to 7 830 031 and 810 000 to 840 039 of both;
//! * `-`: nobody wrote down what it was tuned on.
//!
//! What is measured on other seeds stands in `docs/design/measured.md`.

// when a cause is there, and which

/// Two models whose -2 ln likelihood plus price of their parameters differs by less than this are tied:
/// the likelier one has odds of less than e² = 7. (7.8)
pub const TIE: f64 = 4.0;

// what is far more than usual

/// The ratio that counts as far more than usual: of a random tone's power to its neighbourhood's, and of
/// a signal's squared misfit to the median one. (-)
pub const STANDS_OUT: f64 = 3.0;

// what models leave of an effect to other candidates, as shares of their statistics: squares of their
// relative errors

/// Share that shapes of the mean may leave to other shapes, and causes that follow covariates to others
/// of that kind; also that of a decay's coloured misfit. (7.1)
pub const LEFT_TO_SHAPES: f64 = 0.03;
/// Share that findings in codes may leave to causes of the mean, and these to findings in noise. (7.1,
/// 7.8)
pub const LEFT_TO_UNLIKE: f64 = 0.006;
/// Share of all misfit that one named cause may leave without a name: strong causes left up to .06,
/// effects outside the catalogue .13 at least. (7.1) In decays, the share that the strongest cause may
/// leave to rivals: chosen by a look at the measured decays (`tests/measured.rs`).
pub const LEFT_BY_ALL: f64 = 0.07;
/// Relative error of the flows and volumes inside the channel, because the ratio of the resistive rates
/// g/d is held at .2. (7.1)
pub const INTERIOR: f64 = 0.05;
/// Relative error of a meniscus's compliance ratio, because g/d is held. (7.1)
pub const SPLIT: f64 = 0.15;
/// Share eta of half-order loss below which nothing is said: the scatter of the acquisition state alone
/// made it -.1 to -.25 in null recordings of `hidden_large.toml` (1152 signals), and +.05 with 8 K in
/// print runs of `physics.toml` (8192 signals).
pub const ETA_FLOOR: f64 = 0.3;

// the real pole

/// How well the real pole's rate over the damping is known: the standard deviation of ln lambda/sigma. A
/// pole of any rate stands in for a droop, one of a known rate does not. Of 84 effects (seeds 2 310 000
/// on of `tests/foreign`) .35 names 77 and misses three of four droops; .2 names 78, and of the droops
/// two; .12 names 79. Of 42 healthy recordings of another generator 40, 40 and 39 are `none`.
pub const LN_LAMBDA_SD: f64 = 0.2;

// lines

/// Largest number of lines beside the ring of a decay, largest power of the ring that is fitted to it, and largest
/// multiple of a frequency at which its lines are looked for. (-)
pub const MOST_LINES: usize = 11;
pub const MOST_HARMONIC: u8 = 5;
pub const MOST_MULTIPLE: i32 = 24;
/// A line below this share of the ring's frequency is no second mode. (-)
pub const LEAST_MODE: f64 = 0.3;
/// Statistic of a meniscus's slow mode from which on its damping is fitted. (7.1)
pub const SHOWS_ITS_LOSS: f64 = 400.0;
/// Largest factor, either way, between the fitted and the predicted damping of the slow mode. (7.1)
pub const OTHER_LOSS: f64 = 2.5;
/// Share of the movement that a forecast may miss: boards that are still driven miss .35 at least, free ones .28
/// at most (`../shared/reviews/structures`).
pub const FORESEEN: f64 = 0.3;

/// A decay was driven at first if the square of the misfit's share of the movement from its onset on is less than
/// this much of that from its first sample on: .02 and .22 in swings that were let go after the record began, .56
/// at least in records of which no sample is the first free one (`../shared/measured`).
pub const DRIVEN: f64 = 0.33;
/// The onset of a free decay lies in the first one of so many parts of its record. (-)
pub const ONSET_WITHIN: usize = 4;

// signals that ring unlike the others

/// Number of robust standard deviations beyond which a signal, or a sample, is an outlier. (signals -,
/// samples 7.8)
pub const OUTLYING: f64 = 7.0;
/// Least robust standard deviations of ln damping, ln frequency and ln amplitude. (-)
pub const LEAST_SCATTER: [f64; 3] = [0.025, 0.004, 0.015];
/// Number of outlying samples of one sign in a row that make a shape. (7.8)
pub const ODD_IN_A_ROW: usize = 3;

// noise, codes, what was recorded

/// Share of the signals, the noisiest ones, that do not count when the noise is estimated. (-)
pub const UNTOLD_NOISE: f64 = 0.01;
/// Largest ratio of a random tone's normal deviate to its excess over white noise in standard errors that
/// come from the spread over signals (`ensemble.rs`). (-)
pub const LINE_BOUND: f64 = 1.5;
/// Share of clipping's surprise that counts: the scatter of the largest signals is not modelled. (-)
pub const CLIPPED_SHARE: f64 = 0.44;
/// The last code of clipped samples holds more than so many, and than this share of those that are missing. (-)
pub const CROWDED: [f64; 2] = [4.0, 0.5];
/// Fewest signals of which noise is told, and fewest contrasts of bursts of which a jitter is. (-)
pub const FEWEST_OF_NOISE: usize = 16;
pub const FEWEST_CONTRASTS: usize = 8;
/// A change from sample to sample that is smaller, relative to the root mean square of all, is that of numbers that
/// are cut in files. (-)
pub const LEAST_CHANGE: f64 = 0.01;
/// Relative spread of the drive from which on the recording counts as a drive scan. (-)
pub const DRIVE_SCAN: f64 = 0.03;

/// Where more than this share of a decay's misfit can be predicted from the samples before, the misfit counts
/// as coloured: an autoregression stands in for something that the model lacks. In such a recording the share
/// of the misfit that is left may be so large while the causes keep their names.
pub const MOSTLY: f64 = 0.5;

// grids that searches go through

/// Places of a stop that are tried, in amplitudes, on either side of zero; zero itself has no side.
pub const PLACES: [f64; 5] = [1e-3, 0.3, -0.3, 0.6, -0.6];
/// Lags of a gain that are tried, in signal lengths; negative: the gain has settled before the signal.
pub const LAGS: [f64; 5] = [0.0, 1.0 / 30.0, 0.25, -1.0 / 30.0, -0.25];
/// Time constants of a frequency's settling in the signal; 0: it changes along a straight line.
pub const SETTLES: [f64; 3] = [0.0, 4.0, 16.0];
/// Correlations from sample to sample of a slower part that noise may have beside an autoregression.
pub const SLOWER: [f64; 4] = [0.4, 0.7, 0.9, 0.98];
/// Range of the compliance ratio B_t/B_m that is searched. With a lower end of .03, five of five menisci by
/// another generator had no name; with .001, droops of one detection limit were called menisci.
pub const MENISCUS: (f64, f64) = (0.005, 1.0);
