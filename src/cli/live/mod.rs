//! `inkling replay --follow --serve ADDRESS`: serves what is known of the recording that is being written, as
//! a page for browsers, as metrics for Prometheus, and as JSON. Addresses that other machines can reach need
//! a token.
//!
//! `port` checks the options and binds the port; `connections` accepts clients, each on a thread
//! of its own; `client` reads a request, within a deadline; `answers` decides on it and writes the
//! answer from `state`, which `follow` feeds with rows and episodes while the pipeline judges.
//! Nobody can change anything from outside, and a slow client cannot slow the judging down.

mod answers;
mod client;
mod connections;
mod port;
mod state;

pub use connections::start;
pub use port::{Live, check};
