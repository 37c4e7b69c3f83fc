//! Tells faulty from healthy signals: the residual generator, the detection statistics and their
//! thresholds. thesis §3-2.
//!
//! In: a healthy model, and deviations of signals from what it expects. Out: a filter whose output
//! ignores what the model explains, statistics of a signal, and the values above which a signal
//! counts as faulty. `design/` puts these parts together.
//!
//! * The filter: numerators ([`null_space`], [`numerator`], [`linear_programme`]), denominators
//!   ([`poles`]), and the filter itself ([`residual_generator`]).
//! * Statistics: the distance along the model's sensitivities ([`sensitivity`]) with a second test
//!   beside them ([`misfit`]); the thesis's energy r'r.
//! * Thresholds: of healthy signals ([`threshold`], `pareto_tail`) and of windows in which some are
//!   faulty ([`contamination`], `mixture`).
//! * Streams, the distance of many signals at once in f32: [`row_projection`], [`lane_sensitivity`]
//!   and [`lane_expectation`].

pub mod contamination;
pub mod lane_expectation;
pub mod lane_sensitivity;
pub mod linear_programme;
pub mod misfit;
mod mixture;
pub mod null_space;
pub mod numerator;
mod pareto_tail;
pub mod poles;
pub mod residual_generator;
pub mod row_projection;
pub mod sensitivity;
mod settings;
pub mod threshold;
pub mod tuned;

pub use residual_generator::ResidualGenerator;
pub use settings::{
    Denominator, DetectMethod, DetectSettings, THESIS_OSCILLATIONS_OF_RING, ThresholdMethod,
};
pub use threshold::Threshold;

#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DetectError {
    #[error("{what} is {value}: it must be {must}")]
    BadNumber { what: &'static str, value: f64, must: &'static str },
    #[error("{what} holds a number that is not finite, at index {index}")]
    NotFinite { what: &'static str, index: usize },
    #[error(
        "filter degree {degree} is larger than {max}: choose the observable order or a little more"
    )]
    DegreeTooLarge { degree: usize, max: usize },
    #[error(
        "filter degree {degree} leaves no left null space of H-bar: {observable_order} states are observable through 1 output(s); raise the degree"
    )]
    DegreeTooSmall { degree: usize, observable_order: usize },
    #[error(
        "left null space of H-bar has dimension {found} where {expected} is due (degree {degree}, observable order {observable_order}): the model is too close to an unobservable one, or the degree is below the observability index"
    )]
    WrongNullity { found: usize, expected: usize, degree: usize, observable_order: usize },
    #[error(
        "singular value decomposition of a {rows} x {columns} matrix did not converge or lost its accuracy: check the model's scaling"
    )]
    Decomposition { rows: usize, columns: usize },
    #[error(
        "no unique numerator rejects an offset at degree {degree}: the model has an observable pole at 0 itself; use degree {observable_order}"
    )]
    AmbiguousNumerator { degree: usize, observable_order: usize },
    #[error(
        "numerator has {numerator} coefficients and denominator {denominator}: equal numbers are needed, at least one"
    )]
    UnequalDegrees { numerator: usize, denominator: usize },
    #[error("leading coefficient of the denominator is {value}: it must be 1")]
    NotMonic { value: f64 },
    #[error("healthy deviations leave no residual energy: a ratio to it means nothing")]
    NoHealthyEnergy,
    #[error(
        "healthy signal {index}: its residual has the energy {value}: its samples are no counts that a model could \
         follow; look at their format and unit, or label the signal `ignore`"
    )]
    NotAnEnergy { value: f64, index: usize },
    #[error(
        "{found} healthy signals are too few for a threshold by {method}: at least {needed} are needed"
    )]
    TooFewSignals { found: usize, needed: usize, method: &'static str },
    #[error(
        "{channels} channels are too few, or too unlike, for a threshold at confidence {confidence}: train on more channels or lower the confidence"
    )]
    TooFewChannels { channels: usize, confidence: f64 },
    #[error(
        "all {signals} healthy signals are the same, sample by sample: without noise there is no threshold; were they \
         copied, or simulated without noise?"
    )]
    NoEnergy { signals: usize },
}
