//! `inkling replay --follow --serve ADDRESS`: serves what is known of the recording that is being written, as
//! a page for browsers, as metrics for Prometheus, and as JSON. Addresses that other machines can reach need
//! a token.

mod answers;
mod client;
mod connections;
mod place;
mod request;
mod seat;
mod state;
mod view;

pub use place::{Place, check};
pub use view::Live;

use super::exit::Failure;
use crate::pipeline::Control;
use state::State;
use std::path::PathBuf;
use std::sync::Arc;
use std::thread;

/// Starts to serve, on threads of its own.
pub fn start(place: Place, recording: &str, control: &Arc<Control>) -> Result<Arc<Live>, Failure> {
    let Place { listener, address, token } = place;
    let path = PathBuf::from(recording);
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let live = Arc::new(Live {
        state: State::default(),
        address,
        recording: name,
        path,
        token,
        control: control.clone(),
    });
    let serving = live.clone();
    thread::Builder::new()
        .name("live".into())
        .spawn(move || connections::accept(&listener, &serving))
        .map_err(|e| Failure::new(format!("no thread: {e}")))?;
    Ok(live)
}
