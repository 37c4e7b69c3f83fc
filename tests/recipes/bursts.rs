//! Bursts by words: those of the sample, changed in named ways.

use super::unescaped;
use crate::house::shipped;
use crate::recorded::{
    AS_RECORDED, SAMPLE_MAJOR_FLOATS, bursts, counts, rows, sample, slower, with_samples,
    with_signals,
};
use inkling::burst::{Burst, Format, Layout};
use std::collections::BTreeSet;
use std::ops::Range;

const DAY_NS: i64 = 86_400_000_000_000;

/// Bursts by words: `some 0 6 | called k-2 + some 6 6 | day 1`.
pub fn made(words: &str) -> Vec<Burst> {
    words
        .split(" + ")
        .flat_map(|part| {
            let mut steps = part.split(" | ");
            let from: Vec<&str> = steps.next().expect("where from").split(' ').collect();
            let source = match from[..] {
                ["some", first, n] => some(first.parse().unwrap(), n.parse().unwrap()),
                ["none"] => Vec::new(),
                [of] => bursts(&sample(&format!("{of}.mcap"))),
                _ => panic!("no bursts are called {part}"),
            };
            steps.fold(source, changed)
        })
        .collect()
}

/// Changes bursts: `at 2..4 saturate 1` those from the second on, before the fourth, `each 3 deaden 9` every third one,
/// from the first on, `of cyan-1 half` those of a printhead.
fn changed(mut bursts: Vec<Burst>, step: &str) -> Vec<Burst> {
    let words: Vec<&str> = step.split(' ').collect();
    let n = bursts.len();
    let (which, change): (Vec<usize>, &[&str]) = match words[..] {
        ["at", range, ..] => (self::range(range).collect(), &words[2..]),
        ["of", head, ..] => {
            ((0..n).filter(|i| &*bursts[*i].printhead == head).collect(), &words[2..])
        }
        ["each", k, ..] => ((0..n).step_by(k.parse().unwrap()).collect(), &words[2..]),
        _ => ((0..n).collect(), &words),
    };
    let first = bursts.first().map(rows).unwrap_or_default();
    let times: Vec<i64> = bursts.iter().map(|burst| burst.t_acq_ns).collect();
    match *change {
        ["day", days] => days_later(bursts, days.parse().unwrap()),
        ["backward"] => bursts.into_iter().rev().collect(),
        // the messages of each moment
        ["moments_backward"] => {
            bursts.chunk_by_mut(|a, b| a.t_acq_ns == b.t_acq_ns).for_each(<[Burst]>::reverse);
            bursts
        }
        ["divided", most] => {
            bursts.iter().flat_map(|b| divided(b, most.parse().unwrap())).collect()
        }
        ["dry", every] => {
            let (start, end) = (*times.iter().min().unwrap(), *times.iter().max().unwrap());
            let share = |i: usize| (times[i] - start) as f64 / (end - start) as f64;
            for i in which {
                bursts[i] = dried(&bursts[i], every.parse().unwrap(), share(i));
            }
            bursts
        }
        // the signals of the k-th further on, at the times that were
        ["rotate", k] => {
            let later = |i: usize| &bursts[(i + k.parse::<usize>().unwrap()) % n];
            (0..n).map(|i| Burst { t_acq_ns: bursts[i].t_acq_ns, ..later(i).clone() }).collect()
        }
        ["times", k] => bursts.into_iter().flat_map(|b| vec![b; k.parse().unwrap()]).collect(),
        _ => {
            for i in which {
                bursts[i] = other(&bursts[i], change, &first);
            }
            bursts
        }
    }
}

fn range(words: &str) -> Range<usize> {
    let (from, to) = words.split_once("..").expect("a range");
    from.parse().unwrap()..to.parse().unwrap()
}

/// A burst that is changed by itself; `first`: the signals of the first one.
fn other(burst: &Burst, change: &[&str], first: &[Vec<f64>]) -> Burst {
    let b = burst.clone();
    let value = |text: &str| text.parse::<f64>().expect("a number");
    match *change {
        ["called", ref words @ ..] => {
            let name = unescaped(&words.join(" "));
            let long = name.strip_prefix("x*").map(|times| "x".repeat(times.parse().unwrap()));
            Burst { printhead: long.unwrap_or(name).as_str().into(), ..b }
        }
        ["from_channel", first] => Burst { first_channel: first.parse().unwrap(), ..b },
        ["period_s", s] => Burst { sample_period_s: value(s), ..b },
        ["celsius", t] => Burst { temperature_c: Some(value(t)), ..b },
        ["volts", u] => Burst { drive_voltage_v: Some(value(u)), ..b },
        ["time_ns", t] => Burst { t_acq_ns: t.parse().unwrap(), ..b },
        ["s_later", s] => Burst { t_acq_ns: b.t_acq_ns + (1e9 * value(s)) as i64, ..b },
        ["covariates_of_3"] => {
            Burst { idle_time_s: vec![f32::NAN; 3], neighbours_fired: vec![9; 3].into(), ..b }
        }
        ["half"] => {
            let (channels, bytes) = (b.channels / 2, b.samples.len() / 2);
            Burst { channels, samples: b.samples.slice(..bytes), ..b }
        }
        // sample-major bytes that somebody calls channel-major
        ["turned"] => {
            let turned = with_signals(&b, &counts(&b), (Format::S16Le, Layout::SampleMajor));
            Burst { layout: Layout::ChannelMajor, ..turned }
        }
        ["sample_major"] => with_signals(&b, &counts(&b), SAMPLE_MAJOR_FLOATS),
        ["scaled", by] => with_samples(&b, |_, _, y| value(by) * y),
        ["in_volts"] => {
            let volts = |of: Vec<f32>| of.into_iter().map(|y| 3e-4 * y).collect();
            let all: Vec<Vec<f32>> = counts(&b).into_iter().map(volts).collect();
            with_signals(&b, &all, SAMPLE_MAJOR_FLOATS)
        }
        // as a converter counts that knows no sign, and as signed numbers are read
        ["unsigned"] => with_samples(&b, |_, _, y| f64::from((y as i16).wrapping_add(i16::MIN))),
        // channels that hold the samples of the first of them
        ["copied", channels] => {
            let (all, copied) = (rows(&b), range(channels));
            with_samples(&b, |row, k, y| match copied.contains(&row) {
                true => all[copied.start][k],
                false => y,
            })
        }
        ["short"] => Burst { samples: b.samples.slice(..b.samples.len() - 2), ..b },
        // the first sample of the first channel, in floats
        ["not_a_number"] => {
            let floats = with_signals(&b, &counts(&b), SAMPLE_MAJOR_FLOATS);
            let mut samples = floats.samples.to_vec();
            samples[..4].copy_from_slice(&f32::NAN.to_le_bytes());
            Burst { samples: samples.into(), ..floats }
        }
        // two samples of the second channel, one after the other
        ["railed"] => {
            let rail = f64::from(i16::MAX);
            with_samples(&b, |row, k, y| if row == 1 && k < 2 { rail } else { y })
        }
        ["freeze"] => with_samples(&b, |row, k, _| first[row][k]),
        ["labelled", state, ref change @ ..] => labelled(&b, state, change),
        // at the converter's rail: so many channels
        ["saturate", channels] => {
            let channels = channels.parse::<usize>().expect("a number of channels");
            with_samples(&b, |row, _, y| if row < channels { i16::MAX.into() } else { y })
        }
        ["freeze", channel] => {
            let frozen: usize = channel.parse().unwrap();
            with_samples(&b, |row, k, y| if row == frozen { first[frozen][k] } else { y })
        }
        ["deaden", channel] => {
            deadened(&b, channel.parse().map_or_else(|_| range(channel), |k| k..k + 1))
        }
        ["mirrored"] => {
            let (all, last) = (rows(&b), b.channels as usize - 1);
            with_samples(&b, |row, k, _| all[last - row][k])
        }
        ["clock", times] => on_another_clock(&b, value(times)),
        ["slower"] => slower(&b),
        ["half_slower"] => {
            let (other, half) = (rows(&slower(&b)), b.channels as usize / 2);
            with_samples(&b, |row, k, y| if row < half { y } else { other[row][k] })
        }
        ["noise"] => {
            let n = b.samples_per_channel as usize;
            with_samples(&b, |row, k, _| {
                let number = (row * n + k) as u64 + 1;
                let x =
                    number.wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(b.t_acq_ns as u32 % 61);
                ((x.wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 40) % 400) as f64 - 200.0
            })
        }
        _ => panic!("bursts cannot be {change:?}"),
    }
}

/// Channels that the sample's labels give a state are noise, as of a cable without a sensor, or so many times as large.
fn labelled(burst: &Burst, state: &str, change: &[&str]) -> Burst {
    let labels = shipped("sample_logs/labels.csv");
    let rows = labels.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let of_state = rows.filter(|cells| cells[0] == "dataset" && cells[4] == state);
    let channels: BTreeSet<u32> = of_state.filter_map(|cells| cells[1].parse().ok()).collect();
    with_samples(burst, |row, k, y| {
        let channel = burst.first_channel + row as u32;
        match *change {
            _ if !channels.contains(&channel) => y,
            ["scaled", by] => y * by.parse::<f64>().expect("a factor"),
            ["cable"] => ((channel as usize * 31 + k * k * 7) % 5) as f64 - 2.0,
            _ => panic!("signals cannot be {change:?}"),
        }
    })
}

/// Bursts of one printhead of the sample run, `n` from the `from`-th on.
pub fn some(from: usize, n: usize) -> Vec<Burst> {
    let all = bursts(&sample("print_run.mcap"));
    let one = all[0].printhead.clone();
    all.into_iter().filter(|b| b.printhead == one).skip(from).take(n).collect()
}

/// `n` bursts of one printhead on a day.
pub fn on_day(day: i64, n: usize) -> Vec<Burst> {
    days_later(some(5 * day as usize, n), day)
}

fn days_later(bursts: Vec<Burst>, days: i64) -> Vec<Burst> {
    let later = |b: Burst| Burst { t_acq_ns: b.t_acq_ns + days * DAY_NS, ..b };
    bursts.into_iter().map(later).collect()
}

/// As on a clock that is so many times as fast, by cubic interpolation (Catmull and Rom).
fn on_another_clock(burst: &Burst, times: f64) -> Burst {
    let rows = rows(burst);
    with_samples(burst, |row, k, _| {
        let y = &rows[row];
        let at = |k: i64| y[k.clamp(0, y.len() as i64 - 1) as usize];
        let (whole, u) = ((k as f64 * times) as i64, (k as f64 * times).fract());
        let [a, b, c, d] = [-1, 0, 1, 2].map(|offset| at(whole + offset));
        let slope = [c - a, d - b].map(|twice| twice / 2.0);
        let (square, cube) = (u * u, u * u * u);
        b * (2.0 * cube - 3.0 * square + 1.0)
            + slope[0] * (cube - 2.0 * square + u)
            + c * (3.0 * square - 2.0 * cube)
            + slope[1] * (cube - square)
    })
}

/// Sensor lines that say nothing but a little noise.
fn deadened(burst: &Burst, dead: Range<usize>) -> Burst {
    let turn = usize::try_from(burst.t_acq_ns / 1_000_000).unwrap(); // no two bursts have the same noise
    with_samples(burst, |row, k, y| match dead.contains(&row) {
        true => ((k * k * 31 + k * (17 + turn % 5) + turn) % 7) as f64 - 3.0,
        false => y,
    })
}

/// Bursts of at most so many channels each, with one covariate value for all of a burst or one for each channel.
fn divided(burst: &Burst, most: u32) -> Vec<Burst> {
    let (firsts, counts) = ((0..burst.channels).step_by(most as usize), counts(burst));
    let part = |first: u32| {
        let rows = first as usize..(first + most).min(burst.channels) as usize;
        let of_rows = |covariate: &bytes::Bytes| match covariate.len() {
            0 | 1 => covariate.clone(),
            _ => covariate.slice(rows.clone()),
        };
        Burst {
            first_channel: burst.first_channel + first,
            idle_time_s: rows.clone().flat_map(|row| burst.idle_time_s(row)).collect(),
            neighbours_fired: of_rows(&burst.neighbours_fired),
            ..with_signals(burst, &counts[rows.clone()], AS_RECORDED)
        }
    };
    firsts.map(part).collect()
}

/// A burst of which every so many-th channel rings with a damping that is greater by a share of the run: at its end
/// by 40 % of the healthy damping.
fn dried(burst: &Burst, every: u32, share: f64) -> Burst {
    let extra_per_s = 1.2e4 * share;
    with_samples(burst, |row, k, y| match (burst.first_channel + row as u32) % every {
        0 => y * (-extra_per_s * k as f64 * burst.sample_period_s).exp(),
        _ => y,
    })
}
