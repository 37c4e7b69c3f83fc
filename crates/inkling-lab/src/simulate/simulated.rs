//! A recording on its way, and what is true of it until faults are put in.

use super::burst_shape::Frame;
use super::scenario::{PrintRun, RecordingOptions};
use inkling_core::burst::Burst;
use inkling_core::labels::{Channels, Label};

/// One recording of a scenario, not yet made: its bursts come in time order, as they are asked for.
pub struct SimulatedRecording {
    /// File stem: `train`, `test`, `calibration`, `print_run`.
    pub stem: String,
    pub bursts: Box<dyn Iterator<Item = Burst> + Send>,
    pub options: RecordingOptions,
}

impl SimulatedRecording {
    /// Of a print run: `acquire` is asked for each printhead's bursts, step by step.
    pub fn of_run(
        run: &PrintRun,
        options: RecordingOptions,
        mut acquire: impl FnMut(usize, usize) -> Frame + Send + 'static,
    ) -> SimulatedRecording {
        let (heads, shape) = (run.printheads, options.clone());
        let each = 0..run.bursts_per_channel * heads;
        let bursts = each.flat_map(move |i| acquire(i % heads, i / heads).into_bursts(&shape));
        SimulatedRecording { stem: "print_run".to_owned(), bursts: Box::new(bursts), options }
    }
}

/// Of all printheads of a run.
pub fn healthy_heads(run: &PrintRun) -> Vec<Label> {
    (0..run.printheads).map(|head| healthy_everywhere(&run.name(head))).collect()
}

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
