//! A simulated recording before it is made: a name, and an iterator that simulates its bursts one by one, so
//! that a recording of any length needs the memory of one acquisition. And what recordings share: samples of
//! int16, and labels for what is healthy.

use super::scenario::{PrintRun, RecordingOptions};
use inkling_core::burst::Burst;
use inkling_core::labels::{Channels, Label};

/// One recording of a scenario, not yet made.
pub struct SimulatedRecording {
    /// Stem of the file name: `train`, `test`, `calibration`, `print_run`.
    pub stem: String,
    /// Simulates the bursts, in the order of their times.
    pub bursts: Box<dyn ExactSizeIterator<Item = Burst> + Send>,
    /// How the bursts are to be written.
    pub options: RecordingOptions,
}

impl SimulatedRecording {
    /// The recording of a print run. `acquire` is called with the numbers of printhead and step, step after step
    /// and, within a step, printhead after printhead; it returns the acquisition of all channels.
    pub fn of_run(
        run: &PrintRun,
        options: RecordingOptions,
        mut acquire: impl FnMut(usize, usize) -> Burst + Send + 'static,
    ) -> SimulatedRecording {
        let heads = run.printheads;
        let each = 0..run.bursts_per_channel * heads;
        let bursts = each.map(move |i| acquire(i % heads, i / heads));
        SimulatedRecording { stem: "print_run".to_owned(), bursts: Box::new(bursts), options }
    }
}

/// A sample as the converter gives it: rounded, and clamped to the range of int16.
pub fn digitise(y_counts: f64) -> i16 {
    // the cast truncates towards zero and saturates; `round` would be a library call per sample
    (y_counts + 0.5_f64.copysign(y_counts)) as i16
}

/// An acquisition as a burst. `beside`: all that is recorded with it; `counts`: channels x
/// samples_per_channel, channel by channel.
pub fn burst_of(beside: Burst, counts: &[i16]) -> Burst {
    let bytes: Vec<u8> = counts.iter().flat_map(|count| count.to_le_bytes()).collect();
    let channels = (counts.len() / beside.samples_per_channel as usize) as u32;
    Burst { channels, samples: bytes.into(), ..beside }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_are_rounded_and_held_at_the_rails() {
        assert_eq!([0.4, -0.6, 4e4, -1e9].map(digitise), [0, -1, i16::MAX, i16::MIN]);
    }

    #[test]
    fn a_burst_carries_the_counts_of_each_channel() {
        let counts: Vec<i16> = (0..35).map(|i| i * 700 - 12_000).collect();
        let burst = burst_of(Burst { samples_per_channel: 5, ..Burst::default() }, &counts);
        assert_eq!(burst.channels, 7);
        for (row, own) in counts.chunks(5).enumerate() {
            let mut y = vec![0.0; 5];
            burst.copy_signal(row, &mut y);
            assert_eq!(y, own.iter().map(|&count| f64::from(count)).collect::<Vec<f64>>());
        }
    }
}
