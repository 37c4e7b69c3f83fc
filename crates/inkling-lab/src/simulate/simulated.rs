//! A simulated recording before it is made, and the labels of what is healthy.

use super::burst_shape::{Acquired, bursts};
use super::scenario::{PrintRun, RecordingOptions};
use inkling_core::burst::Burst;
use inkling_core::labels::{Channels, Label};

/// One recording of a scenario, not yet made: its bursts are made in the order of their times, when they are
/// asked for.
pub struct SimulatedRecording {
    /// Stem of the file name: `train`, `test`, `calibration`, `print_run`.
    pub stem: String,
    pub bursts: Box<dyn Iterator<Item = Burst> + Send>,
    pub options: RecordingOptions,
}

impl SimulatedRecording {
    /// The recording of a print run. `acquire` gets the printhead and the step of each acquisition, and makes
    /// it.
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

/// Labels that say that all printheads of a run are healthy.
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
