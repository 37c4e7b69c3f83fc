//! Work that Ctrl-C ends: on a thread of its own, while the calling one waits without the interpreter's lock.

use crate::{Error, failed};
use crossbeam_channel::{RecvTimeoutError, bounded};
use inkling::cli::called::called;
use inkling::cli::exit::Failure;
use inkling::pipeline::Control;
use pyo3::prelude::*;
use std::sync::Arc;
use std::thread;
use std::time::Duration;

/// Between two looks for signals.
const TICK: Duration = Duration::from_millis(50);
/// What was interrupted gets so long to end; what computes on without writing is left behind.
const PATIENCE: Duration = Duration::from_secs(5);

pub fn for_<T: Send + 'static>(
    py: Python,
    work: impl FnOnce(&Control) -> Result<T, Failure> + Send + 'static,
) -> PyResult<T> {
    let control = Arc::new(Control::default());
    let (done, ends) = bounded(1);
    let by = control.clone();
    // whoever was left behind has nobody to tell
    thread::spawn(move || drop(done.send(called(&by, || work(&by)))));
    loop {
        match py.detach(|| ends.recv_timeout(TICK)) {
            Ok(outcome) => return outcome.map_err(failed),
            Err(RecvTimeoutError::Disconnected) => {
                return Err(Error::new_err(
                    "the computation ended without a word; this is our bug",
                ));
            }
            Err(RecvTimeoutError::Timeout) => {}
        }
        if let Err(signal) = py.check_signals() {
            control.interrupt();
            let _ = py.detach(|| ends.recv_timeout(PATIENCE));
            return Err(signal);
        }
    }
}
