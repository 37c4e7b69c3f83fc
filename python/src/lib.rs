//! inkling for Python: the functions that `import inkling` calls. They only hand on: arrays and names of
//! files to the library, tables and sentences back. The types, words and shapes that users see are in
//! `python/inkling/`.
//!
//! Work runs on a thread of its own, without the interpreter's lock; the calling thread waits for it and for
//! Ctrl-C (`waiting.rs`).

mod array;
mod design;
mod table;
mod waiting;

use design::{Design, State};
use inkling::cli;
use inkling::cli::called::{self, Ended};
use inkling::cli::exit::Failure;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use std::ffi::OsString;
use std::io::Write;
use std::path::PathBuf;

pyo3::create_exception!(inkling, Error, PyRuntimeError, "What the command would have said.");
pyo3::create_exception!(inkling, UsageError, Error, "Wrong usage or settings: exit status 2.");

/// A failure of a command as an exception, with the command's sentence.
fn failed(failure: Failure) -> PyErr {
    match failure.is_usage() {
        true => UsageError::new_err(failure.message),
        false => Error::new_err(failure.message),
    }
}

/// Runs the command `inkling`, and gives its exit status. `argv` begins with the program's name.
#[pyfunction]
fn main(py: Python, argv: Vec<OsString>) -> u8 {
    let ended = py.detach(|| cli::run(argv));
    let _ = std::io::stdout().flush(); // nowhere left to complain if this fails
    ended as u8
}

/// Exit status and warnings of a command.
fn said(ended: Ended) -> (u8, Vec<String>) {
    (ended.exit as u8, ended.warnings)
}

/// Runs a verb of the command, which prints nothing; gives its exit status and warnings.
#[pyfunction]
fn verb(py: Python, words: Vec<String>) -> PyResult<(u8, Vec<String>)> {
    waiting::for_(py, move |_| called::verb(&words)).map(said)
}

/// Runs `inkling critique` on bursts likewise. `options` are those of the command line, `--out` among them.
#[pyfunction]
fn critique(py: Python, bursts: array::Array, options: Vec<String>) -> PyResult<(u8, Vec<String>)> {
    waiting::for_(py, move |_| called::critique(bursts.recording()?, &options)).map(said)
}

/// The state that `replay --baseline FILE` would read. `design` is the digest of the design that it must
/// belong to.
#[pyfunction]
fn read_state(py: Python, path: PathBuf, design: String) -> PyResult<State> {
    waiting::for_(py, move |_| called::read_state(&path, &design)).map(State::of)
}

#[pymodule]
fn _inkling(module: &Bound<PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("Error", module.py().get_type::<Error>())?;
    module.add("UsageError", module.py().get_type::<UsageError>())?;
    module.add_class::<Design>()?;
    module.add_class::<State>()?;
    module.add_function(wrap_pyfunction!(main, module)?)?;
    module.add_function(wrap_pyfunction!(verb, module)?)?;
    module.add_function(wrap_pyfunction!(critique, module)?)?;
    module.add_function(wrap_pyfunction!(read_state, module)?)
}
