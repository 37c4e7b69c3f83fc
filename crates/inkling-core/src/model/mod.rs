//! What the physics says: plants as linear state-space models, their free decays, and their faults.
//!
//! In: rates, geometry, severities. Out: (A, C), decays y = C e^{At} x_a, poles. thesis (2-1)..(2-5).
//! Measured signals are looked at only by what fits a ring to them, and by [`lie`]. Quantities are in SI
//! units at every signature; inside, matrices are scaled to microseconds where conditioning asks for it.

pub mod actuation;
pub mod beside_ring;
pub mod bisection;
pub mod descent;
pub mod faults;
pub mod free_decay;
pub mod geometry;
pub mod ink_channel;
pub mod inner_product;
pub mod lie;
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
pub mod simd_math;
pub mod student;
pub mod terms;

pub use actuation::{Actuation, Waveform};
pub use geometry::Geometry;
pub use ink_channel::InkChannel;
