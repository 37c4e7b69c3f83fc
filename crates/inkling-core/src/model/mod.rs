//! What the physics says of an ink channel, and the numerical tools that all other rooms share.
//!
//! * The channel by thesis (2-1)..(2-5): `ink_channel` (the rates and the matrices A, C),
//!   `geometry` (rates from dimensions), `actuation` (the state x_a from which it rings),
//!   `ring_down` (the decay y = C e^{At} x_a), `poles`, and `faults` (what each fault does to the
//!   rates).
//! * The decay as one damped pair and one real pole, a *ring*: `ring`, its fit to a signal
//!   (`ring_fit` with `ring_grid`, `ring_gauss_newton`, `ring_gram`), and `beside_ring` (what the
//!   fit leaves).
//! * For model critique and the designs that it extends: `free_decay` (the decay with its Jacobian).
//! * `row_layout`: how ring-downs are laid out in a row of numbers. The rest are tools.
//!
//! Quantities are in SI units at every signature that says nothing else.

pub mod actuation;
pub mod beside_ring;
pub mod bisection;
pub mod descent;
pub mod faults;
pub mod free_decay;
pub mod geometry;
pub mod ink_channel;
pub mod inner_product;

pub mod median;
pub mod normal;
mod poles;
pub mod programme;
pub mod ring;
pub mod ring_down;
pub mod ring_fit;
mod ring_gauss_newton;
mod ring_gram;
mod ring_grid;
pub mod row_layout;
pub mod simd_math;
pub mod spectrum;
pub mod student;
pub mod waves;

pub use actuation::{Actuation, Waveform};
pub use geometry::Geometry;
pub use ink_channel::InkChannel;
