//! What the physics says: plants as linear state-space models, their free decays, their faults.
//!
//! In: rates, geometry, severities. Out: (A, C), decays y = C e^{At} x_a, poles.
//! thesis (2-1)..(2-5). Never looks at measured data. SI units at every signature; matrices are
//! scaled to microseconds inside where conditioning asks for it.

pub mod actuation;
pub mod beside_ring;
pub mod faults;
pub mod free_decay;
pub mod geometry;
pub mod ink_channel;
pub mod inner_product;
pub mod median;
pub mod normal;
mod poles;
pub mod ring;
pub mod ring_down;
pub mod ring_fit;
mod ring_gauss_newton;
mod ring_gram;
mod ring_grid;
pub mod simd_math;
pub mod student;
pub mod terms;

use nalgebra::DMatrix;

pub use actuation::Actuation;
pub use geometry::Geometry;
pub use ink_channel::InkChannel;

/// An autonomous linear plant x' = A x, y = C x; it rings from a non-zero acquisition state x_a.
pub trait Plant {
    /// A, n x n, 1/s (rows of volume states and flow states mixed as in thesis (2-2)).
    fn a(&self) -> DMatrix<f64>;
    /// C, m x n.
    fn c(&self) -> DMatrix<f64>;
}
