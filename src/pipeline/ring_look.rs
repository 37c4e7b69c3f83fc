//! Looks at a recording's first bursts: whether they are ring-downs as they are laid out, whether they ring at
//! frequencies at which printheads do, whether something clipped them, and whether they are copies of each other.
//!
//! In: a recording, from `not_judged` and from `inspect`. Out: a [`Doubt`] for each printhead whose signals speak
//! against their layout, sample period or number format, are clipped or copies ([`doubts`]), before faults are made of
//! that. Where a design judges, layout and period are only looked at where its ring is not found, and fewer bursts for the
//! rest. Printheads whose bursts come later than the first blocks are not looked at. No signal is judged by it.
//!
//! A layout is doubted if neighbouring samples of a channel hardly correlate; also if it is implausible, since channels
//! have little in common, and the exchanged one is plausible ([`RowLayout`]). A sample period is wrong if the mean signal would
//! ring outside of 500 Hz to 2 MHz, or holds less than one period. Signals are clipped where many of them stand still
//! at the largest value that any of them has, or at the smallest one. All these limits are heuristic.

use super::batches::usable;
use super::numbers::{ALIKE_BURSTS, CLIPPED, STAND_STILL, WRAPS};
use crate::report::{numbered, three_digits};
use inkling_core::burst::{Burst, Format, Layout};
use inkling_core::model::row_layout::{LEAST_NEIGHBOURS, RowLayout, periods};
use inkling_io::recording::Recording;
use std::collections::{BTreeMap, HashMap};

/// Maximum number of blocks that are read, and of bursts of a printhead that are kept.
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
/// Bursts of a printhead that are looked at where a design judges, and everywhere for clipping, and channels of each then.
const FEW_BURSTS: usize = 8;
const CLIPPING_CHANNELS: u32 = 64;
/// Channels of more than this many times the median channel's energy say nothing of a layout.
const MOST_ENERGY: f64 = 100.0;

/// Why the signals of a printhead may not be what they are read as.
#[derive(Debug, PartialEq)]
pub struct Doubt {
    pub printhead: String,
    pub what: String,
    /// Whether it concerns most of its channels, so that its verdicts say nothing of nozzles.
    pub is_of_most: bool,
    /// Whether a design of such signals would settle it: it is about how they lie, or how far apart samples are.
    pub is_settled_by_design: bool,
}

/// What a design says of signals, before they are looked at.
#[derive(Clone, Copy, Debug)]
pub enum Known<'a> {
    /// There is no design.
    Nothing,
    /// How signals lie, and how far apart their samples are; its ring is not found in the signals of these printheads.
    But(&'a [&'a str]),
}

pub fn doubts(recording: &Recording, by_design: Known) -> Vec<Doubt> {
    let has_design = matches!(by_design, Known::But(_));
    let most = if has_design { FEW_BURSTS } else { MOST_BURSTS };
    let doubt = |(printhead, bursts): (String, Vec<Burst>)| {
        let of_ring = match by_design {
            Known::Nothing => of_layout(&bursts).or_else(|| of_period(&bursts)),
            // noise may be the reason, too
            Known::But(others) if others.contains(&&*printhead) => of_other_layout(&bursts),
            Known::But(_) => None,
        };
        if let Some(what) = of_ring {
            let is_settled_by_design = !has_design;
            return Some(Doubt { printhead, what, is_of_most: true, is_settled_by_design });
        }
        match of_format(&bursts).or_else(|| of_clipping(&bursts)) {
            Some(what) => {
                Some(Doubt { printhead, what, is_of_most: true, is_settled_by_design: false })
            }
            None => of_copies(printhead, &bursts),
        }
    };
    first_bursts(recording, most).into_iter().filter_map(doubt).take(MOST_TOLD).collect()
}

/// By printhead, the `most` first bursts of each: of those in the first blocks, until all that were met have as many.
fn first_bursts(recording: &Recording, most: usize) -> BTreeMap<String, Vec<Burst>> {
    let (mut reader, mut all) = (recording.reader(), BTreeMap::<String, Vec<Burst>>::new());
    for block in recording.blocks().filter_map(Result::ok).take(MOST_BLOCKS) {
        reader.load(&block);
        while let Some(piece) = reader.next_piece(MOST_ROWS) {
            for burst in piece.acquisitions.iter().filter_map(usable) {
                let of_head = all.entry(burst.printhead.to_string()).or_default();
                if of_head.len() < most {
                    of_head.push(burst.clone());
                }
            }
            if !all.is_empty() && all.values().all(|of| of.len() >= most) {
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

/// How a burst's usual channels lie, if they lie as it says. One at a rail, or far from zero, has much more energy than the
/// others, and says nothing of the layout.
fn row_layout(burst: &Burst) -> Option<RowLayout> {
    let samples = burst.samples_per_channel as usize;
    let mut signals: Vec<Vec<f64>> = (0..burst.channels).map(|c| signal(burst, c)).collect();
    let energy = |signal: &Vec<f64>| signal.iter().map(|y| y * y).sum::<f64>();
    let mut energies: Vec<f64> = signals.iter().map(energy).collect();
    energies.sort_by(f64::total_cmp);
    let most = MOST_ENERGY * energies.get(energies.len() / 2).copied().unwrap_or(0.0);
    signals.retain(|signal| energy(signal) <= most);
    let in_memory = match burst.layout {
        Layout::ChannelMajor => signals.concat(),
        Layout::SampleMajor => {
            (0..samples).flat_map(|k| signals.iter().map(move |of| of[k])).collect()
        }
    };
    RowLayout::of(&in_memory, signals.len(), burst.layout == Layout::SampleMajor)
}

/// The doubt about a layout, if more than half of the bursts give it: they look like ring-downs laid out the other
/// way, which is the likelier cause, or their neighbouring samples are not alike at all.
fn of_layout(bursts: &[Burst]) -> Option<String> {
    let noisy = || {
        let here = bursts.iter().filter_map(row_layout);
        let noisy: Vec<RowLayout> = here.filter(|of| of.neighbours < LEAST_NEIGHBOURS).collect();
        let first = noisy.first().filter(|_| 2 * noisy.len() > bursts.len())?;
        Some(format!(
            "these are no ring-downs as laid out: neighbouring samples of a channel correlate {:.2}; look at `format`, \
             `layout`, `channels` and `samples_per_channel`",
            first.neighbours
        ))
    };
    of_other_layout(bursts).or_else(noisy)
}

/// The doubt about a layout where the bursts are no ring-downs as laid out, and are if laid out the other way.
fn of_other_layout(bursts: &[Burst]) -> Option<String> {
    let other_way = |burst: &Burst| {
        let exchanged = match burst.layout {
            Layout::ChannelMajor => Layout::SampleMajor,
            Layout::SampleMajor => Layout::ChannelMajor,
        };
        let here = row_layout(burst).filter(|here| !here.is_plausible())?;
        let other = row_layout(&Burst { layout: exchanged, ..burst.clone() })?;
        let are_many = burst.channels as usize >= FEWEST_ALIKE;
        (are_many && other.is_plausible()).then_some((here, other))
    };
    let all: Vec<(RowLayout, RowLayout)> = bursts.iter().filter_map(other_way).collect();
    let (here, other) = all.first().filter(|_| 2 * all.len() > bursts.len())?;
    let major = |of: &RowLayout| if of.sample_major { "sample-major" } else { "channel-major" };
    Some(format!(
        "these are no ring-downs as laid out: {} channels have {:.2} of their energy in common, {} \
         {:.2}; look at `layout`, `channels` and `samples_per_channel`",
        major(here),
        here.alike.max(0.0),
        major(other),
        other.alike
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
    let bursts = &bursts[..bursts.len().min(FEW_BURSTS)];
    let some = |burst: &Burst| {
        let step = burst.channels.div_ceil(CLIPPING_CHANNELS).max(1);
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

/// The doubt about signed numbers: unsigned counts about the middle of their range, read as signed, jump from one end to
/// the other wherever they cross it.
fn of_format(bursts: &[Burst]) -> Option<String> {
    let bursts = bursts.iter().filter(|burst| burst.format == Format::S16Le);
    let signals = bursts.flat_map(|burst| (0..burst.channels).map(|c| signal(burst, c)));
    let (mut wrapped, mut all) = (0, 0);
    for signal in signals {
        let jumps = signal.windows(2).filter(|of| (of[1] - of[0]).abs() > WRAPS).count();
        (wrapped, all) = (wrapped + usize::from(jumps >= 2), all + 1);
    }
    (2 * wrapped > all).then(|| {
        format!(
            "{wrapped} of {all} signals jump from one end of 16 bits to the other: are they unsigned, or of another byte \
             order? Only signed little-endian counts are read"
        )
    })
}

/// The doubt about channels that hold the samples of others bit for bit, in bursts that differ from each other.
fn of_copies(printhead: String, bursts: &[Burst]) -> Option<Doubt> {
    // by channel: in how many bursts it was the copy of another, and in how many it was not
    let mut counts: BTreeMap<u32, [usize; 2]> = BTreeMap::new();
    let mut before = HashMap::new();
    for burst in bursts {
        let mut met: HashMap<Vec<u64>, Vec<u32>> = HashMap::new();
        for row in 0..burst.channels {
            let signal = signal(burst, row);
            let is_constant = signal.iter().all(|y| *y == signal[0]);
            let bits: Vec<u64> = signal.into_iter().map(f64::to_bits).collect();
            // neither a dead line, nor a channel that stands still, says that it is another's
            let channel = burst.first_channel.saturating_add(row);
            let is_new = before.insert(channel, bits.clone()).is_none_or(|old| old != bits);
            if !is_constant && is_new {
                met.entry(bits).or_default().push(channel);
            }
        }
        for channels in met.into_values() {
            let is_alone = usize::from(channels.len() == 1);
            channels.iter().for_each(|of| counts.entry(*of).or_default()[is_alone] += 1);
        }
    }
    let copies =
        counts.iter().filter(|(_, [copied, alone])| *copied >= ALIKE_BURSTS && *alone == 0);
    let copies: Vec<u32> = copies.map(|(channel, _)| *channel).collect();
    let is_of_most = 2 * copies.len() > counts.len();
    (!copies.is_empty()).then(|| {
        let what = format!(
            "{} hold the samples of each other, bit for bit: is the multiplexer stuck, or was a channel written several \
             times? What is said of them is said of one channel",
            numbered(&copies)
        );
        Doubt { printhead, what, is_of_most, is_settled_by_design: false }
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
    fn copies_and_unsigned_counts_are_told_and_what_stands_still_is_not() {
        let burst = |burst: usize, copied: std::ops::Range<usize>, offset: i32| {
            let ring = |channel: usize| -> Vec<f32> {
                let source = if copied.contains(&channel) { copied.start } else { channel };
                let sample = |k: usize| {
                    let noise = ((burst * 7919 + source * 104_729 + k * 31) % 23) as f64;
                    let k = k as f64;
                    (9000.0 * (-k / 50.0).exp() * (0.3 * k).cos() + noise).round() as i32
                };
                (0..128).map(|k| f32::from((sample(k) + offset) as u16 as i16)).collect()
            };
            let signals: Vec<Vec<f32>> = (0..16).map(ring).collect();
            Burst::of(&signals, 1e-6, Format::S16Le, Layout::ChannelMajor)
        };
        let told = |copied: std::ops::Range<usize>| {
            let bursts: Vec<Burst> = (0..5).map(|b| burst(b, copied.clone(), 0)).collect();
            of_copies("p".into(), &bursts).map(|of| (of.what, of.is_of_most))
        };
        assert_eq!(told(0..0), None);
        assert!(
            told(4..8).is_some_and(|(what, most)| what.starts_with("channels 4 to 7") && !most)
        );
        assert!(told(0..16).is_some_and(|(_, most)| most));
        let still: Vec<Burst> = (0..5).map(|_| burst(0, 0..16, 0)).collect();
        assert_eq!(of_copies("p".into(), &still), None);

        assert_eq!(of_format(&[burst(0, 0..0, 0)]), None);
        assert!(
            of_format(&[burst(0, 0..0, 32_768)]).is_some_and(|what| what.starts_with("16 of 16"))
        );
    }

    #[test]
    fn one_channel_at_a_rail_is_no_wrong_layout_and_a_wrong_layout_is() {
        for (layout, fade) in [Layout::ChannelMajor, Layout::SampleMajor]
            .into_iter()
            .flat_map(|layout| [50.0, 12.0].map(|fade| (layout, fade)))
        {
            let ring = |channel: usize| -> Vec<f32> {
                let [size, turn] = [90.0 + channel as f64, 0.3 + 1e-4 * channel as f64];
                let sample = |k: f64| size * (-k / fade).exp() * (turn * k).cos();
                (0..128).map(|k| sample(f64::from(k)) as f32).collect()
            };
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
