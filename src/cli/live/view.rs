//! The live view that is served: the state of a followed recording, and the token that it needs.

use super::place::Place;
use super::state::State;
use crate::pipeline::Control;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread;
use std::time::Duration;

/// Time that open pages get to be told of the end before the process goes on.
const LAST_WORDS: Duration = Duration::from_millis(300);

/// Everything that the threads of the live view share.
pub struct Live {
    pub state: State,
    pub place: Place,
    pub recording: String,
    pub path: PathBuf,
    pub control: Arc<Control>,
}

impl Live {
    /// Tells open pages that the recording has been judged.
    pub fn end(&self) {
        self.state.end();
        thread::sleep(LAST_WORDS);
    }

    /// Bytes of the recording that were written and not read yet.
    pub fn behind_bytes(&self) -> u64 {
        let written = std::fs::metadata(&self.path).map_or(0, |of| of.len());
        written.saturating_sub(self.control.bytes_read.load(Ordering::Relaxed))
    }

    /// Whether a token is the right one. The comparison takes the same time wherever the first difference
    /// lies, so that a token cannot be guessed piece by piece.
    pub fn admits(&self, given: &str) -> bool {
        let Some(token) = &self.place.token else { return true };
        let differ = token.bytes().zip(given.bytes()).fold(0, |sum, (a, b)| sum | (a ^ b));
        differ == 0 && token.len() == given.len()
    }
}
