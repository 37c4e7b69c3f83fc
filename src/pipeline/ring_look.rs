//! Looks at a recording's first bursts: whether they are ring-downs as they are laid out, whether they ring at
//! frequencies at which printheads do, and whether something clipped them.
//!
//! In: a recording, from `recording_report` and from `inspect`. Out: a sentence for each printhead whose signals speak
//! against their layout or sample period, or are clipped ([`doubts`]), before faults are made of that. Where a design
//! judges, only clipping is looked for, in the printheads that the first bursts are of. No signal is judged by it.
//!
//! A layout is wrong if neighbouring samples of a channel hardly correlate, or if channels have little in common,
//! while with rows and columns exchanged both hold ([`RowLayout`]). A sample period is wrong if the mean signal would
//! ring outside of 500 Hz to 2 MHz, or holds less than one period. Signals are clipped where many of them stand still
//! at the largest value that any of them has, or at the smallest one. All these limits are heuristic.

use super::batches::usable;
use crate::report::three_digits;
use inkling_core::burst::{Burst, Layout};
use inkling_core::model::row_layout::{LEAST_NEIGHBOURS, RowLayout, periods};
use inkling_io::recording::Recording;
use std::collections::BTreeMap;

/// Maximum number of blocks that are read, and number of bursts after which no more are decoded.
const MOST_BLOCKS: usize = 4;
const MOST_BURSTS: usize = 64;
/// Maximum number of rows decoded at a time.
const MOST_ROWS: usize = 4096;
/// Frequencies, Hz, between which printheads ring, with room on both sides.
const RINGS_WITHIN: [f64; 2] = [500.0, 2e6];
/// Maximum number of printheads that are told of.
const MOST_TOLD: usize = 8;
/// Of fewer channels a single faulty one makes them unlike each other.
const FEWEST_ALIKE: usize = 6;
/// Signals are clipped that have so many samples in a row at one value, if this share of all signals is so. Both are
/// arbitrary: tried on the sample, clipped at three quarters of its amplitude and not clipped, and on rings in few codes.
const STAND_STILL: usize = 3;
const CLIPPED: f64 = 0.25;
/// So many bursts, and of each so many channels, are looked at for that.
const MOST_CLIPPED_BURSTS: usize = 8;
const MOST_CLIPPED_CHANNELS: u32 = 64;
/// Channels of more than this many times the median channel's energy are left out.
const MOST_ENERGY: f64 = 100.0;

/// `has_design`: whether a design judges, which knows how its signals lie and how far apart their samples are.
pub fn doubts(recording: &Recording, has_design: bool) -> Vec<(String, String)> {
    let mut by_printhead: BTreeMap<String, Vec<Burst>> = BTreeMap::new();
    let most = if has_design { MOST_CLIPPED_BURSTS } else { MOST_BURSTS };
    for burst in first_bursts(recording, most) {
        by_printhead.entry(burst.printhead.to_string()).or_default().push(burst);
    }
    let doubt = |(name, bursts): (String, Vec<Burst>)| {
        let of_ring = || of_layout(&bursts).or_else(|| of_period(&bursts));
        let what = if has_design { None } else { of_ring() };
        Some((name, what.or_else(|| of_clipping(&bursts))?))
    };
    by_printhead.into_iter().filter_map(doubt).take(MOST_TOLD).collect()
}

fn first_bursts(recording: &Recording, most: usize) -> Vec<Burst> {
    let (mut reader, mut all) = (recording.reader(), Vec::new());
    for block in recording.blocks().filter_map(Result::ok).take(MOST_BLOCKS) {
        reader.load(&block);
        while let Some(piece) = reader.next_piece(MOST_ROWS) {
            all.extend(piece.acquisitions.iter().filter_map(usable).cloned());
            if all.len() >= most {
                return all;
            }
        }
    }
    all
}

/// A channel's samples, counts.
fn signal(burst: &Burst, channel: u32) -> Vec<f64> {
    let mut signal = vec![0.0; burst.samples_per_channel as usize];
    burst.copy_signal(channel as usize, &mut signal);
    signal
}

/// The samples, counts, of a burst's usual channels in the order in which they lie in memory, and the number of these
/// channels. One at a rail, or far from zero, has more energy than all others, and says nothing of the layout.
fn numbers(burst: &Burst) -> (Vec<f64>, usize) {
    let samples = burst.samples_per_channel as usize;
    let mut signals: Vec<Vec<f64>> = (0..burst.channels).map(|c| signal(burst, c)).collect();
    let energy = |signal: &Vec<f64>| signal.iter().map(|y| y * y).sum::<f64>();
    let mut energies: Vec<f64> = signals.iter().map(energy).collect();
    energies.sort_by(f64::total_cmp);
    let most = MOST_ENERGY * energies.get(energies.len() / 2).copied().unwrap_or(0.0);
    signals.retain(|signal| energy(signal) <= most);
    let numbers = match burst.layout {
        Layout::ChannelMajor => signals.concat(),
        Layout::SampleMajor => {
            (0..samples).flat_map(|k| signals.iter().map(move |of| of[k])).collect()
        }
    };
    (numbers, signals.len())
}

/// The doubt about a layout, if more than half of the bursts give it: they look like ring-downs laid out the other
/// way, or their neighbouring samples are not alike at all.
fn of_layout(bursts: &[Burst]) -> Option<String> {
    let (mut noisy, mut other_way) = (Vec::new(), Vec::new());
    for burst in bursts {
        let (all, channels) = numbers(burst);
        let sample_major = burst.layout == Layout::SampleMajor;
        let Some(here) = RowLayout::of(&all, channels, sample_major) else { continue };
        if here.neighbours < LEAST_NEIGHBOURS {
            noisy.push(here);
        }
        let other = RowLayout::of(&all, channels, !sample_major).filter(RowLayout::is_plausible);
        if let Some(other) = other.filter(|_| channels >= FEWEST_ALIKE && !here.is_plausible()) {
            other_way.push((here, other));
        }
    }

    let major = |lie: &RowLayout| if lie.sample_major { "sample-major" } else { "channel-major" };
    // the other layout is the likelier cause
    if let Some((here, other)) = other_way.first().filter(|_| 2 * other_way.len() > bursts.len()) {
        return Some(format!(
            "these are no ring-downs as laid out: {} channels have {:.2} of their energy in common, {} \
             {:.2}; look at `layout`, `channels` and `samples_per_channel`",
            major(here),
            here.alike.max(0.0),
            major(other),
            other.alike
        ));
    }
    let first = noisy.first().filter(|_| 2 * noisy.len() > bursts.len())?;
    Some(format!(
        "these are no ring-downs as laid out: neighbouring samples of a channel correlate {:.2}; look at \
         `format`, `layout`, `channels` and `samples_per_channel`",
        first.neighbours
    ))
}

/// The doubt about the sample period, by the resonance of the first burst's mean signal.
fn of_period(bursts: &[Burst]) -> Option<String> {
    let burst = bursts.first()?;
    let samples = burst.samples_per_channel as usize;
    let mut mean = vec![0.0; samples];
    for channel in 0..burst.channels {
        let row = signal(burst, channel);
        mean.iter_mut().zip(&row).for_each(|(mean, y)| *mean += y / f64::from(burst.channels));
    }

    // number of periods in the signal, and with the sample period the frequency
    let periods = periods(&mean)?;
    let hz = periods / (samples as f64 * burst.sample_period_s);
    let is_usual = (RINGS_WITHIN[0]..=RINGS_WITHIN[1]).contains(&hz);
    (!is_usual || periods < 1.0).then(|| {
        format!(
            "{periods:.2} periods in a signal, which at a sample period of {:e} s is a resonance of {} Hz; \
             printheads ring at kilohertz: look at the sample period and at `samples_per_channel`",
            burst.sample_period_s,
            three_digits(hz)
        )
    })
}

/// The doubt about the largest and the smallest value. Signals at the rails of 16 bit are rejected, and told so.
fn of_clipping(bursts: &[Burst]) -> Option<String> {
    let bursts = &bursts[..bursts.len().min(MOST_CLIPPED_BURSTS)];
    let some = |burst: &Burst| {
        let step = burst.channels.div_ceil(MOST_CLIPPED_CHANNELS).max(1);
        (0..burst.channels).step_by(step as usize)
    };
    let signals = bursts.iter().flat_map(|burst| some(burst).map(|c| signal(burst, c)));
    let signals: Vec<Vec<f64>> = signals.collect();
    let all = || signals.iter().flatten().copied().filter(|y| y.is_finite());
    let (least, most) =
        (all().fold(f64::INFINITY, f64::min), all().fold(f64::NEG_INFINITY, f64::max));
    let steps = signals.iter().flat_map(|signal| signal.windows(2).map(|of| (of[1] - of[0]).abs()));
    let step = steps.filter(|step| *step > 0.0).fold(f64::INFINITY, f64::min);
    [most, least].into_iter().filter(|rail| rail.abs() < f64::from(i16::MAX)).find_map(|rail| {
        let clipped = signals.iter().filter(|signal| stands_still(signal, rail, step));
        let (n, of) = (clipped.count(), signals.len());
        (n as f64 > CLIPPED * of as f64).then(|| {
            format!(
                "{n} of {of} signals stand still at {rail} for {STAND_STILL} samples and more, beyond which no sample lies: \
                 are they clipped there? Lower the gain: what is cut off is lost"
            )
        })
    })
}

/// Whether a signal stands still at `rail` and leaves it suddenly. The peak of a ring in few codes stands still, too, and
/// leaves its code for the next ones, which lie a `step` apart.
fn stands_still(signal: &[f64], rail: f64, step: f64) -> bool {
    let is_far = |y: f64| (y - rail).abs() > STAND_STILL as f64 * step;
    signal
        .chunk_by(|a, b| (*a == rail) == (*b == rail))
        .scan(0, |at, run| {
            *at += run.len();
            Some((*at, run))
        })
        .any(|(end, run)| {
            let beside =
                [signal.get(end), end.checked_sub(run.len() + 1).and_then(|at| signal.get(at))];
            run[0] == rail
                && run.len() >= STAND_STILL
                && beside.into_iter().flatten().any(|y| is_far(*y))
        })
}

#[cfg(test)]
mod tests {
    use super::*;
    use inkling_core::burst::Format;

    #[test]
    fn signals_that_stand_still_at_one_value_are_clipped_and_flat_peaks_are_not() {
        let told = |most: f32, size: f32| {
            let ring = |channel: usize| -> Vec<f32> {
                let size = size * (1.0 + 0.001 * channel as f32);
                let sample = |k: u8| {
                    let k = f32::from(k);
                    (size * (-k / 50.0).exp() * (0.1 * k).cos()).round().min(most)
                };
                (0..128).map(sample).collect()
            };
            let signals: Vec<Vec<f32>> = (0..48).map(ring).collect();
            of_clipping(&[Burst::of(&signals, 1e-6, Format::F32Le, Layout::ChannelMajor)])
        };
        assert!(told(700.0, 1000.0).is_some_and(|what| what.contains("at 700 for")));
        for size in [1000.0, 200.0, 30.0] {
            assert_eq!(told(f32::MAX, size), None, "{size}");
        }
    }

    #[test]
    fn one_channel_at_a_rail_is_no_wrong_layout_and_a_wrong_layout_is() {
        let ring = |channel: usize| -> Vec<f32> {
            let [size, turn] = [90.0 + channel as f64, 0.3 + 1e-4 * channel as f64];
            let sample = |k: f64| size * (-k / 50.0).exp() * (turn * k).cos();
            (0..128).map(|k| sample(f64::from(k)) as f32).collect()
        };
        for layout in [Layout::ChannelMajor, Layout::SampleMajor] {
            let mut signals: Vec<Vec<f32>> = (0..48).map(ring).collect();
            signals[7] = vec![32767.0; 128];
            let burst = Burst::of(&signals, 1e-6, Format::F32Le, layout);
            assert_eq!(of_layout(&[burst]), None, "{layout:?}");
            signals[7] = ring(7);
            let right = Burst::of(&signals, 1e-6, Format::F32Le, layout);
            let other = match layout {
                Layout::ChannelMajor => Layout::SampleMajor,
                Layout::SampleMajor => Layout::ChannelMajor,
            };
            assert!(of_layout(&[Burst { layout: other, ..right }]).is_some(), "{layout:?}");
        }
    }
}
