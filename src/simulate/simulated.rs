//! A recording on its way, and what is true of it until faults are put in.

use super::scenario::RecordingOptions;
use crate::burst::Burst;
use crate::labels::{Channels, Label};

/// One recording of a scenario, not yet made: its bursts come in time order, as they are asked for.
pub struct SimulatedRecording {
    /// File stem: `train`, `test`, `calibration`, `print_run`.
    pub stem: String,
    pub bursts: Box<dyn Iterator<Item = Burst> + Send>,
    pub options: RecordingOptions,
}

pub fn healthy_everywhere(printhead: &str) -> Label {
    Label {
        printhead: printhead.to_owned(),
        channel: Channels::All,
        from_ns: None,
        to_ns: None,
        state: crate::fault::HEALTHY.to_owned(),
        severity: None,
    }
}
