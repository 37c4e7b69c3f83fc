//! What is served: a recording that is being followed, and who may look.

use super::state::State;
use crate::pipeline::Control;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread;
use std::time::Duration;

/// Pages that are open are told of the end for so long.
const LAST_WORDS: Duration = Duration::from_millis(300);

pub struct Live {
    pub state: State,
    pub address: SocketAddr,
    pub recording: String,
    pub path: PathBuf,
    pub token: Option<String>,
    pub control: Arc<Control>,
}

impl Live {
    /// The recording is judged; pages that are open hear of it.
    pub fn end(&self) {
        self.state.end();
        thread::sleep(LAST_WORDS);
    }

    /// Recorded, and not read yet.
    pub fn behind_bytes(&self) -> u64 {
        let written = std::fs::metadata(&self.path).map_or(0, |of| of.len());
        written.saturating_sub(self.control.bytes_read.load(Ordering::Relaxed))
    }

    /// Whether a token is the right one, in a time that does not tell how much of it is.
    pub fn admits(&self, given: &str) -> bool {
        let Some(token) = &self.token else { return true };
        let differ = token.bytes().zip(given.bytes()).fold(0, |sum, (a, b)| sum | (a ^ b));
        differ == 0 && token.len() == given.len()
    }
}
