//! Hands verdicts to whoever reads Arrow's C stream interface, such as pyarrow, without a copy.
use arrow_array::RecordBatchIterator;
use arrow_array::ffi_stream::FFI_ArrowArrayStream;
use inkling::io::verdict_arrays::VerdictArrays;
use pyo3::prelude::*;
use pyo3::types::PyCapsule;
use std::sync::Mutex;

/// The rows of a verdict table, to be taken once.
#[pyclass(module = "inkling._inkling")]
pub struct Rows(Mutex<Option<VerdictArrays>>);

impl Rows {
    pub fn of(rows: VerdictArrays) -> Rows {
        Rows(Mutex::new(Some(rows)))
    }
}

#[pymethods]
impl Rows {
    /// Gives the rows away as a capsule, as Arrow's PyCapsule interface has it. A second call is an error.
    #[pyo3(signature = (requested_schema=None))]
    fn __arrow_c_stream__<'py>(
        &self,
        py: Python<'py>,
        requested_schema: Option<Py<PyAny>>,
    ) -> PyResult<Bound<'py, PyCapsule>> {
        drop(requested_schema); // the table has one schema; the protocol allows that
        let rows = self.0.lock().ok().and_then(|mut rows| rows.take());
        let rows = rows.ok_or_else(|| crate::Error::new_err("these rows were taken already"))?;
        let batches = RecordBatchIterator::new(rows.batches.into_iter().map(Ok), rows.schema);
        let stream = FFI_ArrowArrayStream::new(Box::new(batches));
        PyCapsule::new_with_value(py, stream, c"arrow_array_stream")
    }
}
