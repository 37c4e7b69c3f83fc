//! Puts samples into bursts. In: one acquisition of a printhead, as counts. Out: the bursts that a recording
//! holds, in the number of channels, layout and format that the scenario's `[recording]` asks for. None of
//! these changes a sample.

use super::scenario::RecordingOptions;
use bytes::Bytes;
use inkling_core::burst::{Burst, Format, Layout};

/// One acquisition of a printhead: a burst of all its channels without samples, number of channels, layout and
/// format; and its counts, channels x samples_per_channel, channel by channel.
pub type Acquired = (Burst, Vec<i16>);

/// A sample as the converter gives it: rounded, and clamped to the range of int16.
pub fn digitise(y_counts: f64) -> i16 {
    // the cast truncates towards zero and saturates; `round` would be a library call per sample
    (y_counts + 0.5_f64.copysign(y_counts)) as i16
}

/// The acquisition as bursts of at most `channels_per_burst` channels (default: one burst).
pub fn bursts((whole, counts): Acquired, options: &RecordingOptions) -> Vec<Burst> {
    let n = whole.samples_per_channel as usize;
    let channels = counts.len() / n;
    let step = options.channels_per_burst.map_or(channels, |c| c as usize).max(1);
    let burst = |first: usize| {
        let last = channels.min(first + step);
        let (format, layout) = (options.format, options.layout);
        // a single idle time holds for all channels, so it is not cut
        let idle = whole.idle_time_s.get(first..last).filter(|_| whole.idle_time_s.len() > 1);
        let neighbours = whole.neighbours_fired.get(first..last).unwrap_or_default();
        Burst {
            first_channel: whole.first_channel + first as u32,
            channels: (last - first) as u32,
            format,
            layout,
            samples: pack(&counts[first * n..last * n], n, format, layout),
            idle_time_s: idle.unwrap_or(&whole.idle_time_s).to_vec(),
            neighbours_fired: Bytes::copy_from_slice(neighbours),
            ..whole.clone()
        }
    };
    (0..channels).step_by(step).map(burst).collect()
}

/// The samples as bytes, little endian. `rows`: channels x n samples, channel by channel.
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
                    let whole = Burst {
                        printhead: "p".into(),
                        first_channel: 10,
                        samples_per_channel: n as u32,
                        idle_time_s: (0..7_u8).map(f32::from).collect(),
                        neighbours_fired: (0..7).collect(),
                        ..Burst::default()
                    };
                    let options = RecordingOptions {
                        format,
                        layout,
                        channels_per_burst,
                        ..Default::default()
                    };
                    let mut seen = 0;
                    for burst in bursts((whole, counts.clone()), &options) {
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
                            assert_eq!(burst.idle_time_s[row], seen as f32);
                            seen += 1;
                        }
                    }
                    assert_eq!(seen, channels);
                }
            }
        }
    }
}
