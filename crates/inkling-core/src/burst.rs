//! What the piezos measured: bursts, the signals in them, and the batches that stages hand on.
//!
//! A *burst* is one acquisition of one printhead, a matrix of channels x samples; a *row* of it is
//! one channel's *signal*, the ring-down that is judged. In: messages of a recording, decoded by
//! `inkling-io` (`schemas/burst.proto` is the contract). Out: rows, or a sample of some rows, in
//! counts. Only this file knows how samples lie in memory; they are shared with the block of the
//! file that they were read from, and only converted when a signal is asked for.

use crate::processor::for_processor;
use crate::verdict::Reason;
use bytes::Bytes;
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::sync::Arc;

/// Sample type of a burst, numbered as in `schemas/burst.proto`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Format {
    #[default]
    S16Le,
    F32Le,
}

impl Format {
    pub fn bytes(self) -> usize {
        match self {
            Format::S16Le => 2,
            Format::F32Le => 4,
        }
    }
}

impl TryFrom<i32> for Format {
    type Error = i32;

    fn try_from(number: i32) -> Result<Format, i32> {
        [Format::S16Le, Format::F32Le].into_iter().find(|of| *of as i32 == number).ok_or(number)
    }
}

/// Order of the samples in a burst, numbered as in `schemas/burst.proto`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Layout {
    /// One signal after the other: the samples of a channel are consecutive.
    #[default]
    ChannelMajor,
    /// One sample time after the other: the channels of a sample time are consecutive.
    SampleMajor,
}

impl TryFrom<i32> for Layout {
    type Error = i32;

    fn try_from(number: i32) -> Result<Layout, i32> {
        let all = [Layout::ChannelMajor, Layout::SampleMajor];
        all.into_iter().find(|of| *of as i32 == number).ok_or(number)
    }
}

/// How the chunks of a recording are compressed, by the names that scenarios use.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Compression {
    Zstd,
    Lz4,
    None,
}

/// One acquisition of (some channels of) one printhead. `samples` has exactly `channels *
/// samples_per_channel * format.bytes()` bytes: the codec in `inkling-io` has checked that.
#[derive(Clone, Debug, Default)]
pub struct Burst {
    /// Time t_a of the first sample, ns since the epoch, UTC.
    pub t_acq_ns: i64,
    /// When it was recorded, ns since the epoch, by the clock of the recorder (MCAP's log time).
    pub logged_ns: i64,
    /// Number of the topic that it came by (MCAP's channel id).
    pub topic: u16,
    pub printhead: Arc<str>,
    /// Channel number of the first row; the next rows count on.
    pub first_channel: u32,
    pub channels: u32,
    pub samples_per_channel: u32,
    pub sample_period_s: f64,
    pub format: Format,
    pub layout: Layout,
    /// Raw little-endian samples, shared with the block they were read from.
    pub samples: Bytes,
    /// Ink temperature, °C; `None`: not recorded.
    pub temperature_c: Option<f64>,
    /// Voltage of the actuation that the signals ring from; `None`: not recorded.
    pub drive_voltage_v: Option<f64>,
    /// Time from the previous actuation to t_a, s: of each channel, or one for all; empty: not
    /// recorded; NaN: there was none.
    pub idle_time_s: Vec<f32>,
    /// Number of neighbours that were actuated with each channel; empty: not recorded.
    pub neighbours_fired: Bytes,
}

impl Burst {
    pub fn copy_signal(&self, row: usize, out: &mut [f64]) {
        let (channels, n) = (self.channels as usize, self.samples_per_channel as usize);
        let (start, stride) = match self.layout {
            Layout::ChannelMajor => (row * n, 1),
            Layout::SampleMajor => (row, channels),
        };
        let of = &self.samples[start * self.format.bytes()..];
        let out = out[..n].iter_mut();
        match self.format {
            Format::S16Le => {
                let of = of.as_chunks::<2>().0;
                // consecutive int16 samples, which most recordings hold, have a vectorised loop
                if stride == 1 {
                    int16(of, out.into_slice());
                } else {
                    let of = of.iter().step_by(stride);
                    out.zip(of).for_each(|(y, b)| *y = i16::from_le_bytes(*b).into());
                }
            }
            Format::F32Le => {
                let of = of.as_chunks::<4>().0.iter().step_by(stride);
                out.zip(of).for_each(|(y, b)| *y = f32::from_le_bytes(*b).into());
            }
        }
    }

    /// Copies sample `k` of some rows into `out`, in counts; only for sample-major bursts.
    #[inline]
    pub fn copy_sample(&self, k: usize, rows: Range<usize>, out: &mut [f32]) {
        let of = k * self.channels as usize + rows.start;
        let bytes = self.format.bytes();
        let of = &self.samples[of * bytes..(of + rows.len()) * bytes];
        match self.format {
            Format::S16Le => {
                let of = of.as_chunks::<2>().0;
                out.iter_mut().zip(of).for_each(|(y, b)| *y = i16::from_le_bytes(*b).into());
            }
            Format::F32Le => {
                let of = of.as_chunks::<4>().0;
                out.iter_mut().zip(of).for_each(|(y, b)| *y = f32::from_le_bytes(*b));
            }
        }
    }

    /// Four samples of a row as raw bytes, from an eighth of the signal on, where the ring is large.
    /// Two different signals mostly differ in these, which spares comparisons of whole ones.
    pub fn glance(&self, row: usize) -> [u8; 16] {
        let (channels, n) = (self.channels as usize, self.samples_per_channel as usize);
        let bytes = self.format.bytes();
        let mut glance = [0; 16];
        // channel-major int16, which most recordings hold, in one go
        let eight = 2 * (row * n + n / 8);
        if let (Layout::ChannelMajor, Format::S16Le, 5..) = (self.layout, self.format, n)
            && let Some(of) = self.samples[eight..].first_chunk::<8>()
        {
            glance[..8].copy_from_slice(of);
            return glance;
        }
        for (k, of) in glance.as_chunks_mut::<4>().0.iter_mut().enumerate() {
            let sample = (n / 8 + k).min(n - 1); // of a short row the last sample is repeated
            let at = match self.layout {
                Layout::ChannelMajor => row * n + sample,
                Layout::SampleMajor => sample * channels + row,
            };
            of[..bytes].copy_from_slice(&self.samples[at * bytes..(at + 1) * bytes]);
        }
        glance
    }

    /// The bytes of `rows` signals. `None`: the burst is no channel-major int16, or has fewer rows.
    pub fn int16_rows(&self, row: usize, rows: usize) -> Option<&[u8]> {
        let bytes = self.samples_per_channel as usize * Format::S16Le.bytes();
        let aligned = self.layout == Layout::ChannelMajor && self.format == Format::S16Le;
        aligned.then(|| self.samples.get(row * bytes..(row + rows) * bytes)).flatten()
    }

    pub fn beside(&self, row: usize) -> Beside {
        let idle_s = match self.idle_time_s(row) {
            None => f64::NAN,
            // NaN stands for no actuation before, which is an infinite time
            Some(idle) if idle.is_nan() => f64::INFINITY,
            Some(idle) => f64::from(idle),
        };
        Beside {
            channel: self.first_channel.saturating_add(row as u32), // checked: there are so many
            t_acq_ns: self.t_acq_ns,
            drive_v: self.drive_voltage_v.unwrap_or(f64::NAN),
            temperature_c: self.temperature_c.unwrap_or(f64::NAN),
            idle_s,
            neighbours: self.neighbours_fired.get(row).copied().map_or(f64::NAN, f64::from),
        }
    }

    /// Idle time of row `row`, s: `None` if it was not recorded, NaN if there was no actuation.
    pub fn idle_time_s(&self, row: usize) -> Option<f32> {
        match self.idle_time_s.as_slice() {
            [] => None,
            [one] => Some(*one),
            each => each.get(row).copied(),
        }
    }
}

/// Covariates: what was recorded beside one signal. NaN: not recorded.
#[derive(Clone, Copy, Debug)]
pub struct Beside {
    pub channel: u32,
    pub t_acq_ns: i64,
    pub drive_v: f64,
    pub temperature_c: f64,
    /// Time since the previous actuation, s; infinite: there was none.
    pub idle_s: f64,
    pub neighbours: f64,
}

impl Beside {
    pub fn alone(channel: u32, t_acq_ns: i64) -> Beside {
        let [drive_v, temperature_c, idle_s, neighbours] = [f64::NAN; 4];
        Beside { channel, t_acq_ns, drive_v, temperature_c, idle_s, neighbours }
    }

    /// ln of the idle time in s, clamped to 1 µs .. 1 s: longer waits make no more difference.
    pub fn ln_idle(&self) -> f64 {
        self.idle_s.clamp(1e-6, 1.0).ln()
    }
}

/// A burst that cannot be used, but still counts: it becomes one rejected row on its first channel.
#[derive(Clone, Debug)]
pub struct UnusableBurst {
    /// The burst's `timestamp`, or else the message's log time; ns since the epoch.
    pub t_acq_ns: i64,
    pub printhead: Arc<str>,
    pub first_channel: u32,
    /// One of the reasons that are of a whole burst ([`Reason::is_of_burst`]).
    pub why: Reason,
    /// Which field is wrong, and its value, where a message could not be decoded; else empty.
    pub what: String,
}

#[derive(Clone, Debug)]
pub enum Acquisition {
    Usable(Burst),
    Unusable(UnusableBurst),
}

impl Acquisition {
    /// Number of rows that this acquisition has in the verdict table.
    pub fn rows(&self) -> usize {
        match self {
            Acquisition::Usable(b) => b.channels as usize,
            Acquisition::Unusable(_) => 1,
        }
    }
}

/// The position of a batch in the recording, by which the writer restores the order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Place {
    /// Number of the block of the recording (such as a chunk of the file), from 0.
    pub block: u64,
    /// Number of the batch within its block, from 0.
    pub piece: u64,
}

impl Place {
    /// The position of the next batch. `ends`: this batch is the last one of its block.
    pub fn following(self, ends: bool) -> Place {
        match ends {
            true => Place { block: self.block + 1, piece: 0 },
            false => Place { piece: self.piece + 1, ..self },
        }
    }
}

#[derive(Clone, Debug, Default)]
pub struct SignalBatch {
    pub place: Place,
    pub acquisitions: Vec<Acquisition>,
}

impl SignalBatch {
    pub fn rows(&self) -> usize {
        self.acquisitions.iter().map(Acquisition::rows).sum()
    }
}

for_processor! {
    fn int16(of: &[[u8; 2]], out: &mut [f64]) {
        out.iter_mut().zip(of).for_each(|(y, b)| *y = i16::from_le_bytes(*b).into());
    }
}

impl Burst {
    /// A burst in counts of printhead `p`, with channels from 0 on. For tests, of other crates too.
    pub fn of(signals: &[Vec<f32>], sample_period_s: f64, format: Format, layout: Layout) -> Burst {
        let (channels, n) = (signals.len(), signals[0].len());
        let mut samples = Vec::new();
        for i in 0..channels * n {
            let y = match layout {
                Layout::ChannelMajor => signals[i / n][i % n],
                Layout::SampleMajor => signals[i % channels][i / channels],
            };
            match format {
                Format::S16Le => samples.extend((y as i16).to_le_bytes()),
                Format::F32Le => samples.extend(y.to_le_bytes()),
            }
        }
        Burst {
            printhead: "p".into(),
            channels: channels as u32,
            samples_per_channel: n as u32,
            sample_period_s,
            format,
            layout,
            samples: samples.into(),
            ..Burst::default()
        }
    }
}

#[cfg(test)]
pub const FORMS: &[(Format, Layout)] = &[
    (Format::S16Le, Layout::ChannelMajor),
    (Format::S16Le, Layout::SampleMajor),
    (Format::F32Le, Layout::ChannelMajor),
    (Format::F32Le, Layout::SampleMajor),
];
