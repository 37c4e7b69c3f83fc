//! A simulated recording before it is made: a name, and an iterator that simulates its bursts one by one, so
//! that a recording of any length needs the memory of one acquisition. And labels for what is healthy.

use super::burst_shape::{Acquired, bursts};
use super::scenario::{PrintRun, RecordingOptions};
use inkling_core::burst::Burst;
use inkling_core::labels::{Channels, Label};

/// One recording of a scenario, not yet made.
pub struct SimulatedRecording {
    /// Stem of the file name: `train`, `test`, `calibration`, `print_run`.
    pub stem: String,
    /// Simulates the bursts, in the order of their times.
    pub bursts: Box<dyn Iterator<Item = Burst> + Send>,
    /// How the bursts are to be written.
    pub options: RecordingOptions,
}

impl SimulatedRecording {
    /// The recording of a print run. `acquire` is called with the numbers of printhead and step, step after step
    /// and, within a step, printhead after printhead; it returns the acquisition of all channels.
    pub fn of_run(
        run: &PrintRun,
        options: RecordingOptions,
        mut acquire: impl FnMut(usize, usize) -> Acquired + Send + 'static,
    ) -> SimulatedRecording {
        let (heads, shape) = (run.printheads, options.clone());
        let each = 0..run.bursts_per_channel * heads;
        let bursts = each.flat_map(move |i| bursts(acquire(i % heads, i / heads), &shape));
        SimulatedRecording { stem: "print_run".to_owned(), bursts: Box::new(bursts), options }
    }
}

/// One label per printhead of a run, which says that all its channels are healthy at all times.
pub fn healthy_heads(run: &PrintRun) -> Vec<Label> {
    (0..run.printheads).map(|head| healthy_everywhere(&run.name(head))).collect()
}

/// A label that says that all channels of a printhead are healthy at all times.
pub fn healthy_everywhere(printhead: &str) -> Label {
    Label {
        printhead: printhead.to_owned(),
        channel: Channels::All,
        from_ns: None,
        to_ns: None,
        state: inkling_core::fault::HEALTHY.to_owned(),
        severity: None,
    }
}
