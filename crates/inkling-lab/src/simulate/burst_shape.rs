//! Puts samples into bursts. In: one acquisition of a printhead, as counts. Out: bursts.

use super::scenario::RecordingOptions;
use bytes::Bytes;
use inkling_core::burst::{Burst, Format, Layout};
use std::sync::Arc;

/// One acquisition of all channels of a printhead, rounded and clamped to int16.
pub struct Frame {
    pub t_acq_ns: i64,
    pub printhead: Arc<str>,
    pub first_channel: u32,
    pub sample_period_s: f64,
    pub samples_per_channel: usize,
    /// Samples, channels x samples_per_channel, channel by channel.
    pub counts: Vec<i16>,
    pub temperature_c: Option<f64>,
    pub drive_voltage_v: Option<f64>,
    /// One time for all channels, or empty.
    pub idle_time_s: Vec<f32>,
    /// One number per channel, or empty.
    pub neighbours_fired: Vec<u8>,
}

/// A sample as the converter gives it: rounded, and clamped to the range of int16.
pub fn digitise(y_counts: f64) -> i16 {
    // the cast truncates towards zero and saturates; `round` would be a library call per sample
    (y_counts + 0.5_f64.copysign(y_counts)) as i16
}

impl Frame {
    /// The frame as bursts of at most `channels_per_burst` channels (default: one burst).
    pub fn into_bursts(self, options: &RecordingOptions) -> Vec<Burst> {
        let n = self.samples_per_channel;
        let channels = self.counts.len() / n;
        let step = options.channels_per_burst.map_or(channels, |c| c as usize).max(1);
        (0..channels)
            .step_by(step)
            .map(|first| {
                let last = channels.min(first + step);
                let rows = &self.counts[first * n..last * n];
                let neighbours = self.neighbours_fired.get(first..last).unwrap_or_default();
                Burst {
                    t_acq_ns: self.t_acq_ns,
                    printhead: self.printhead.clone(),
                    first_channel: self.first_channel + first as u32,
                    channels: (last - first) as u32,
                    samples_per_channel: n as u32,
                    sample_period_s: self.sample_period_s,
                    format: options.format,
                    layout: options.layout,
                    samples: pack(rows, n, options.format, options.layout),
                    temperature_c: self.temperature_c,
                    drive_voltage_v: self.drive_voltage_v,
                    idle_time_s: self.idle_time_s.clone(),
                    neighbours_fired: Bytes::copy_from_slice(neighbours),
                }
            })
            .collect()
    }
}

/// The samples as bytes. `rows`: channels x n, channel by channel.
fn pack(rows: &[i16], n: usize, format: Format, layout: Layout) -> Bytes {
    let mut bytes = Vec::with_capacity(rows.len() * format.bytes());
    let mut push = |count: i16| match format {
        Format::S16Le => bytes.extend_from_slice(&count.to_le_bytes()),
        Format::F32Le => bytes.extend_from_slice(&f32::from(count).to_le_bytes()),
    };
    match layout {
        Layout::ChannelMajor => rows.iter().for_each(|count| push(*count)),
        Layout::SampleMajor => {
            (0..n).for_each(|k| rows.iter().skip(k).step_by(n).for_each(|count| push(*count)));
        }
    }
    Bytes::from(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_are_rounded_and_held_at_the_rails() {
        assert_eq!([0.4, -0.6, 4e4, -1e9].map(digitise), [0, -1, i16::MAX, i16::MIN]);
    }

    #[test]
    fn every_layout_format_and_cut_carries_the_same_samples() {
        let (channels, n) = (7, 5);
        let counts: Vec<i16> = (0..35).map(|i| i * 700 - 12_000).collect();
        for format in [Format::S16Le, Format::F32Le] {
            for layout in [Layout::ChannelMajor, Layout::SampleMajor] {
                for channels_per_burst in [None, Some(1), Some(3), Some(7), Some(100)] {
                    let frame = Frame {
                        t_acq_ns: 5,
                        printhead: "p".into(),
                        first_channel: 10,
                        sample_period_s: 1e-6,
                        samples_per_channel: n,
                        counts: counts.clone(),
                        temperature_c: None,
                        drive_voltage_v: None,
                        idle_time_s: vec![1.0],
                        neighbours_fired: (0..7).collect(),
                    };
                    let options = RecordingOptions {
                        format,
                        layout,
                        channels_per_burst,
                        ..Default::default()
                    };
                    let mut seen = 0;
                    for burst in frame.into_bursts(&options) {
                        assert_eq!(burst.first_channel, 10 + seen);
                        let bytes = burst.channels as usize * n * format.bytes();
                        assert_eq!(burst.samples.len(), bytes);
                        for row in 0..burst.channels as usize {
                            let mut y = vec![0.0; n];
                            burst.copy_signal(row, &mut y);
                            let at = seen as usize * n;
                            let expected: Vec<f64> =
                                counts[at..at + n].iter().map(|c| f64::from(*c)).collect();
                            assert_eq!(y, expected);
                            assert_eq!(u32::from(burst.neighbours_fired[row]), seen);
                            seen += 1;
                        }
                    }
                    assert_eq!(seen, channels);
                }
            }
        }
    }
}
