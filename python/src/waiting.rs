//! Work that Ctrl-C can end: it runs on a thread of its own, while the calling thread waits without the
//! interpreter's lock.
use crate::{Error, failed};
use crossbeam_channel::{RecvTimeoutError, bounded};
use inkling::cli::called::called;
use inkling::cli::exit::Failure;
use inkling::pipeline::Control;
use pyo3::prelude::*;
use std::sync::Arc;
use std::thread;
use std::time::Duration;

/// Time between two looks for signals.
const TICK: Duration = Duration::from_millis(50);
/// How long work that was interrupted may take to end. Work that computes on is left behind; it writes
/// nothing.
const PATIENCE: Duration = Duration::from_secs(5);

/// Does `work` and gives its result. If a signal handler raises an exception, as Ctrl-C does, the work is
/// interrupted and the exception is given instead.
pub fn for_<T: Send + 'static>(
    py: Python,
    work: impl FnOnce(&Control) -> Result<T, Failure> + Send + 'static,
) -> PyResult<T> {
    let control = Arc::new(Control::default());
    let (done, ends) = bounded(1);
    let by = control.clone();
    // if the caller has left, nobody hears of the end
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
