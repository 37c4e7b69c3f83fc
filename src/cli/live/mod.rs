//! `inkling replay --follow --serve ADDRESS`: serves what is known of the recording that is being written, as
//! a page for browsers, as metrics for Prometheus, and as JSON. Addresses that other machines can reach need
//! a token.

mod answers;
mod client;
mod connections;
mod place;
mod state;

pub use connections::start;
pub use place::{Live, check};
