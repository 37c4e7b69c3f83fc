//! NumPy arrays as bursts. The samples stay where they are: bursts share the array's memory, and keep the
//! array alive.
//!
//! In: what `python/inkling/_arrays.py` has checked and arranged. Out: a recording in memory.

use bytes::Bytes;
use inkling::burst::{Burst, Format, Layout};
use inkling::cli::exit::Failure;
use inkling::io::memory_recording;
use inkling::io::recording::Recording;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::sync::Arc;

/// What errors, and the column `recording` of tables, call an array.
const NAME: &str = "array";

/// Bursts of one printhead, as `python/inkling/_arrays.py` prepares them.
#[derive(FromPyObject)]
pub struct Array {
    /// Bursts × channels × samples, int16 or float32 counts.
    #[pyo3(from_py_with = Samples::of)]
    samples: Samples,
    /// Time of the first sample of each burst, ns since 1970.
    #[pyo3(from_py_with = numbers::<i64>)]
    times_ns: Vec<i64>,
    /// Sample period in s.
    period_s: f64,
    printhead: String,
    first_channel: u32,
    /// Temperature in °C and drive voltage in V, one each for a burst; NaN, or an empty array: not recorded.
    #[pyo3(from_py_with = numbers::<f64>)]
    temperature_c: Vec<f64>,
    #[pyo3(from_py_with = numbers::<f64>)]
    voltage_v: Vec<f64>,
}

/// The samples of all bursts, in the array's own memory.
struct Samples {
    bytes: Bytes,
    /// Bursts, channels, samples.
    shape: [usize; 3],
    format: Format,
}

/// The memory of an array, which is kept alive as long as somebody reads from it.
struct Held {
    _array: Py<PyAny>,
    data: *const u8,
    bytes: usize,
}

// SAFETY: nobody writes through it, and the array that it keeps owns the memory. Whoever changes the array
// meanwhile changes what is judged, as with every library that reads arrays without the interpreter's lock.
unsafe impl Send for Held {}
unsafe impl Sync for Held {}

impl AsRef<[u8]> for Held {
    fn as_ref(&self) -> &[u8] {
        // SAFETY: NumPy says that so many bytes lie there, and the array is kept.
        unsafe { std::slice::from_raw_parts(self.data, self.bytes) }
    }
}

/// The memory of a C-contiguous array, its shape, and the type of its numbers as NumPy writes it (`<i2`).
fn memory(array: &Bound<PyAny>) -> PyResult<(Held, Vec<usize>, String)> {
    let interface = array.getattr("__array_interface__")?;
    let (address, _read_only): (usize, bool) = interface.get_item("data")?.extract()?;
    let shape: Vec<usize> = interface.get_item("shape")?.extract()?;
    let kind: String = interface.get_item("typestr")?.extract()?;
    let bytes: usize = array.getattr("nbytes")?.extract()?;
    if !interface.get_item("strides")?.is_none() {
        return Err(PyValueError::new_err("the array is not C-contiguous"));
    }
    let data = match bytes {
        0 => std::ptr::NonNull::dangling().as_ptr(),
        _ => address as *const u8,
    };
    Ok((Held { _array: array.clone().unbind(), data, bytes }, shape, kind))
}

impl Samples {
    /// Takes int16 or float32 of three axes; `_arrays.py` makes sure that there is nothing else.
    fn of(array: &Bound<PyAny>) -> PyResult<Samples> {
        let (held, shape, kind) = memory(array)?;
        let format = match kind.as_str() {
            "<i2" => Format::S16Le,
            "<f4" => Format::F32Le,
            other => return Err(PyValueError::new_err(format!("samples of type {other}"))),
        };
        let shape = <[usize; 3]>::try_from(shape).map_err(|_| {
            PyValueError::new_err("samples that are not bursts x channels x samples")
        })?;
        Ok(Samples { bytes: Bytes::from_owner(held), shape, format })
    }
}

/// A number that NumPy stores in eight bytes.
trait Number: Sized {
    const KIND: &str;
    fn of(bytes: [u8; 8]) -> Self;
}

impl Number for i64 {
    const KIND: &str = "<i8";
    fn of(bytes: [u8; 8]) -> i64 {
        i64::from_le_bytes(bytes)
    }
}

impl Number for f64 {
    const KIND: &str = "<f8";
    fn of(bytes: [u8; 8]) -> f64 {
        f64::from_le_bytes(bytes)
    }
}

/// Copies the numbers out of an array of one axis.
fn numbers<T: Number>(array: &Bound<PyAny>) -> PyResult<Vec<T>> {
    let (held, _, kind) = memory(array)?;
    match kind == T::KIND {
        true => Ok(held.as_ref().as_chunks().0.iter().map(|bytes| T::of(*bytes)).collect()),
        false => Err(PyValueError::new_err(format!("numbers of type {kind}"))),
    }
}

impl Array {
    /// The bursts as a recording in memory; an error if there are not as many times as bursts, or a burst is
    /// too large.
    pub fn recording(&self) -> Result<Recording, Failure> {
        let [bursts, channels, samples] = self.samples.shape;
        if self.times_ns.len() != bursts {
            let times = self.times_ns.len();
            return Err(Failure::usage(format!("{times} times of {bursts} bursts: give one each")));
        }
        let too_many = |_| Failure::usage(format!("{channels} channels of {samples} samples"));
        let of_all = Burst {
            topic: 0,
            t_acq_ns: 0,
            logged_ns: 0,
            printhead: Arc::from(self.printhead.as_str()),
            first_channel: self.first_channel,
            channels: channels.try_into().map_err(too_many)?,
            samples_per_channel: samples.try_into().map_err(too_many)?,
            sample_period_s: self.period_s,
            format: self.samples.format,
            layout: Layout::ChannelMajor,
            samples: Bytes::new(),
            temperature_c: None,
            drive_voltage_v: None,
            idle_time_s: Vec::new(),
            neighbours_fired: Bytes::new(),
        };
        let bytes = channels * samples * self.samples.format.bytes();
        let beside = |of: &[f64], burst: usize| of.get(burst).copied().filter(|v| v.is_finite());
        let burst = |(k, t_acq_ns): (usize, &i64)| Burst {
            t_acq_ns: *t_acq_ns,
            samples: self.samples.bytes.slice(k * bytes..(k + 1) * bytes),
            temperature_c: beside(&self.temperature_c, k),
            drive_voltage_v: beside(&self.voltage_v, k),
            ..of_all.clone()
        };
        let bursts: Vec<Burst> = self.times_ns.iter().enumerate().map(burst).collect();
        Ok(memory_recording::of_bursts(NAME, &bursts)?)
    }
}
