//! A design, and the state of heads and channels, held for Python. The classes that users see are in
//! `python/inkling/_design.py`; they call these.

use crate::array::Array;
use crate::table::Rows;
use crate::{failed, waiting};
use inkling::cli::called::{self, Judged, Recordings};
use inkling::cli::exit::Failure;
use inkling::design;
use inkling::io::labels_file::LabelSource;
use inkling::io::outputs::{self, ResultFile};
use inkling::io::{design_file, digest};
use inkling::state::Memory;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// A design. It is immutable; what is learned of channels while it judges goes into a [`State`].
#[pyclass(module = "inkling._inkling", frozen)]
pub struct Design {
    design: design::Design,
    /// The text of its file, byte for byte: a file may hold what this version would not write.
    text: Vec<u8>,
    /// Digest of that text.
    #[pyo3(get)]
    digest: String,
    /// Warnings from its training.
    #[pyo3(get)]
    warnings: Vec<String>,
}

/// What a design is learned from: names of recordings, or bursts.
#[derive(FromPyObject)]
pub enum Given {
    Named(Vec<String>),
    Array(Array),
}

/// Labels: the name of a file, or the text of one.
#[derive(FromPyObject)]
pub struct Labels {
    file: Option<PathBuf>,
    text: String,
}

impl Design {
    /// A design with the text of its file.
    fn new(design: design::Design, text: Vec<u8>, warnings: Vec<String>) -> Design {
        let digest = digest::of_bytes(&text);
        Design { design, text, digest, warnings }
    }

    /// A design from a text. `name` is what errors call it.
    fn parsed(name: &Path, text: Vec<u8>) -> Result<Design, Failure> {
        let design = design_file::parse(name, &text)?;
        Ok(Design::new(design, text, Vec::new()))
    }

    /// Writes the text to a file, which may replace only a design.
    fn write(&self, path: &Path) -> Result<(), Failure> {
        outputs::check_file(path, ResultFile::Design)?;
        Ok(design_file::write_text(path, &self.text)?)
    }
}

#[pymethods]
impl Design {
    /// Reads a design from a file.
    #[staticmethod]
    fn load(py: Python, path: PathBuf) -> PyResult<Design> {
        waiting::for_(py, move |_| Design::parsed(&path, design_file::read_text(&path)?))
    }

    /// A design from the text that another process has pickled.
    #[staticmethod]
    fn unpickled(py: Python, text: &[u8]) -> PyResult<Design> {
        let text = text.to_vec();
        waiting::for_(py, move |_| Design::parsed(Path::new("a pickled design"), text))
    }

    /// The text of its file, for pickling.
    #[getter]
    fn text<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.text)
    }

    /// Learns a design. `set` are settings as on the command line.
    #[staticmethod]
    fn train(
        py: Python,
        recordings: Given,
        labels: Labels,
        new_class: Vec<String>,
        set: Vec<String>,
    ) -> PyResult<Design> {
        waiting::for_(py, move |_| {
            let labels = match &labels.file {
                Some(file) => LabelSource::File(file),
                None => LabelSource::Text(&labels.text),
            };
            let learned = match &recordings {
                Given::Named(names) => {
                    called::learn(Recordings::Named(names), labels, &new_class, &set)
                }
                Given::Array(array) => {
                    let recording = Recordings::InMemory(Box::new(array.recording()?));
                    called::learn(recording, labels, &new_class, &set)
                }
            }?;
            let text = design_file::text(&learned.design).map_err(Failure::new)?;
            Ok(Design::new(learned.design, text, learned.warnings))
        })
    }

    /// Writes the design to a file.
    fn save(&self, py: Python, path: PathBuf) -> PyResult<()> {
        py.detach(|| self.write(&path)).map_err(failed)
    }

    /// What it can find, from itself alone, as JSON.
    fn promise(&self, py: Python) -> PyResult<String> {
        let design = self.design.clone();
        waiting::for_(py, move |_| called::promise(&design))
    }

    /// Verdicts and warnings. `options` are those of the command line. If a state is given, it is brought up
    /// to date.
    fn judge(
        &self,
        py: Python,
        bursts: Array,
        options: Vec<String>,
        state: Option<&State>,
    ) -> PyResult<(Rows, Vec<String>)> {
        py.detach(|| drop(self.design.curves())); // makes the fault curves, once for all calls
        // the work owns what it reads, since it may outlive this call after an interrupt
        let (design, digest) = (self.design.clone(), self.digest.clone());
        let baselines = state.map(|state| state.copy());
        let Judged { rows, state: now, warnings } = waiting::for_(py, move |control| {
            let mut replay = called::judging(design, digest, &options)?;
            replay.baselines = baselines;
            called::judge(&replay, &bursts.recording()?, control)
        })?;
        if let Some((state, now)) = state.zip(now) {
            state.set(now);
        }
        Ok((Rows::of(rows), warnings))
    }

    /// Sample period in s.
    #[getter]
    fn sample_period_s(&self) -> f64 {
        self.design.sample_period_s
    }

    /// Samples of a signal.
    #[getter]
    fn samples(&self) -> usize {
        self.design.samples
    }

    /// Names of the fault classes.
    #[getter]
    fn classes(&self) -> Vec<String> {
        self.design.class_names()
    }

    /// The printheads that have a model of their own.
    #[getter]
    fn printheads(&self) -> Vec<String> {
        self.design.models.iter().filter_map(|model| model.printhead.clone()).collect()
    }
}

/// What is known of heads and channels, from one call of `judge` to the next.
#[pyclass(module = "inkling._inkling", frozen)]
pub struct State(Mutex<Memory>);

impl State {
    pub fn of(memory: Memory) -> State {
        State(Mutex::new(memory))
    }

    /// The state as it is now; a thread that panicked while it held it has left it whole.
    fn copy(&self) -> Memory {
        self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner).clone()
    }

    /// Replaces the state.
    fn set(&self, now: Memory) {
        *self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner) = now;
    }
}

#[pymethods]
impl State {
    /// A state in which nothing is known yet. `design` is the digest of the design that it belongs to.
    #[new]
    fn new(design: String) -> State {
        State::of(Memory::new(Some(design)))
    }

    /// Writes the state to a file of baselines.
    fn save(&self, py: Python, path: PathBuf) -> PyResult<()> {
        let memory = self.copy();
        py.detach(|| called::write_state(&path, &memory)).map_err(failed)
    }

    /// The digest of the design that the state belongs to.
    #[getter]
    fn design(&self) -> Option<String> {
        self.copy().design
    }

    /// How many channels it knows.
    #[getter]
    fn channels(&self) -> usize {
        self.copy().channels()
    }
}
