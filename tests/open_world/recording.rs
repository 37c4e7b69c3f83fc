//! Signals to a recording and its labels, by the contract alone.

use super::ring::Sampling;
use inkling::burst::{Burst, Format, Layout};
use inkling::io::recording_writer::{RecordingWriter, WriterOptions};
use std::fmt::Write;
use std::path::Path;

pub const PRINTHEAD: &str = "head";
pub const HEALTHY: &str = "healthy";
const START_NS: i64 = 1_750_000_000_000_000_000;

/// How signals lie in a recording: the first ones in the first burst.
#[derive(Clone, Copy, Debug)]
pub struct Rows {
    pub channels: usize,
    /// Of one burst: several of them are one round of all channels.
    pub per_burst: usize,
    /// From round to round.
    pub every_s: f64,
}

impl Rows {
    /// Twenty seconds, the default window, hold 2560 signals, about a training set.
    pub const USUAL: Rows = Rows::whole(128);

    /// All channels in one burst, a second from burst to burst.
    pub const fn whole(channels: usize) -> Rows {
        Rows { channels, per_burst: channels, every_s: 1.0 }
    }

    pub fn channel(self, signal: usize) -> usize {
        signal % self.channels
    }

    pub fn t_ns(self, signal: usize) -> i64 {
        START_NS + ((signal / self.channels) as f64 * self.every_s * 1e9) as i64
    }
}

pub fn write(
    path: &Path,
    rows: Rows,
    sampling: Sampling,
    rounded: bool,
    signals: impl IntoIterator<Item = Vec<f32>>,
) {
    let mut writer = RecordingWriter::create(path, WriterOptions::default()).unwrap();
    let mut signals = signals.into_iter().peekable();
    let mut written = 0;
    let format = if rounded { Format::S16Le } else { Format::F32Le };
    while signals.peek().is_some() {
        let some: Vec<Vec<f32>> = signals.by_ref().take(rows.per_burst).collect();
        assert!(some.iter().all(|y| y.len() == sampling.samples));
        let t_acq_ns = rows.t_ns(written);
        let burst = Burst {
            t_acq_ns,
            printhead: PRINTHEAD.into(),
            first_channel: rows.channel(written) as u32,
            ..Burst::of(&some, sampling.period_s, format, Layout::ChannelMajor)
        };
        writer.write(&burst, t_acq_ns as u64).unwrap();
        written += some.len();
    }
    writer.finish().unwrap();
}

/// One row per signal.
pub fn write_labels(path: &Path, rows: Rows, states: &[String]) {
    let mut csv = String::from("printhead,channel,from,to,state,severity\n");
    for (signal, state) in states.iter().enumerate() {
        let t_ns = rows.t_ns(signal);
        let channel = rows.channel(signal);
        writeln!(csv, "{PRINTHEAD},{channel},{t_ns},{},{state},", t_ns + 1).unwrap();
    }
    std::fs::write(path, csv).unwrap();
}
