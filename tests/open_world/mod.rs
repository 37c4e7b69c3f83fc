//! The open world: signals that no model explains, healthy channels of any shape, faults that no one
//! has labelled. Generators and measurements are written from the contract and from (2-2)'s shape
//! alone; they know nothing of how inkling judges, and share no constant with its simulator.
//!
//! `tests/open_world_goals.rs` asserts what must be true.

pub mod broken;
pub mod chance;
pub mod disturbance;
pub mod drift;
pub mod family;
pub mod lab;
pub mod model_error;
pub mod pattern;
pub mod plant;
pub mod ranges;
pub mod recording;
pub mod ring;
pub mod scatter;
pub mod stranger;
pub mod tables;
pub mod unexplained;
pub mod verdicts;
