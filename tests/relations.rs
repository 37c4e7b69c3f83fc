//! What must not matter does not: dates, numbers and direction of channels, names and order of printheads, other
//! printheads in the file, and where a recording is cut. No truth is needed: what is said of a signal must be the same
//! in both forms. Settings and parts of the recording are drawn, in all modes.

use crate::house::House;
use crate::recorded::{
    AS_RECORDED, Acquired, SAMPLE_MAJOR_FLOATS, bursts, counts, each_row, sample, with_samples,
    with_signals,
};
use inkling::burst::Burst;
use inkling::verdict::VerdictColumns;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeMap;

const MODES: [&str; 3] = [
    "",
    "--design sample_logs/design.json --identify windows",
    "--design sample_logs/design.json --identify design",
];
const YEAR_NS: i64 = 31_536_000_000_000_000;

/// What is said of a signal: in words, and in numbers.
#[derive(Debug, PartialEq)]
struct Said {
    words: String,
    numbers: Vec<f32>,
}

impl Said {
    /// Sums over channels in another order are rounded otherwise.
    fn is_as(&self, other: &Said) -> bool {
        let near = |(p, q): (&f32, &f32)| {
            (p - q).abs() <= 1e-4 * p.abs().max(1e-3) || p.is_nan() == q.is_nan() && p.is_nan()
        };
        self.words == other.words && self.numbers.iter().zip(&other.numbers).all(near)
    }
}

fn said(house: &House, name: &str, options: &str) -> BTreeMap<Acquired, Said> {
    let ended = house.run(&format!("replay {name}.mcap {options} --out {name} --quiet --force"));
    assert!(matches!(ended.code(), Some(0 | 3 | 4)), "{options}: {}", ended.stderr());
    let row = |c: &VerdictColumns, i: usize| {
        let words = format!(
            "{:?} {:?} {:?} {:?} {:?}",
            c.outcome[i], c.category[i], c.fault[i], c.test[i], c.reason[i]
        );
        let numbers = [c.statistic[i], c.threshold[i], c.misfit[i], c.severity[i]];
        let numbers = numbers.map(|of| of.unwrap_or(f32::NAN)).to_vec();
        Said { words, numbers }
    };
    each_row(&house.path(&format!("{name}/{name}.verdicts.parquet")), row).into_iter().collect()
}

/// Some heads of the sample over some time, of 48 channels, or of two of them side by side.
fn part(draws: &mut ChaCha8Rng) -> Vec<Burst> {
    let all = bursts(&sample("print_run.mcap"));
    let start = all[0].t_acq_ns;
    let (from, seconds) = (draws.random_range(0..20), draws.random_range(15..35));
    let within = |of: &&Burst| {
        let s = (of.t_acq_ns - start) / 1_000_000_000;
        (from..from + seconds).contains(&s)
    };
    let part: Vec<Burst> = all.iter().filter(within).cloned().collect();
    if draws.random_bool(0.5) {
        return part;
    }
    // moments of two heads become moments of one that has as many channels
    let of =
        |head: &str| part.iter().filter(|of| &*of.printhead == head).cloned().collect::<Vec<_>>();
    let wide = of("cyan-1").into_iter().zip(of("black-2")).map(|(left, right)| {
        let both = [counts(&left), counts(&right)].concat();
        let of = with_signals(&left, &both, AS_RECORDED);
        Burst { idle_time_s: Vec::new(), neighbours_fired: Default::default(), ..of }
    });
    wide.collect()
}

fn mirrored(of: &Burst) -> Burst {
    let mut signals = counts(of);
    signals.reverse();
    let mirrored = with_signals(of, &signals, AS_RECORDED);
    let idle: Vec<f32> = of.idle_time_s.iter().rev().copied().collect();
    let neighbours: Vec<u8> = of.neighbours_fired.iter().rev().copied().collect();
    Burst { idle_time_s: idle, neighbours_fired: neighbours.into(), ..mirrored }
}

/// A change of a recording, and where a signal of it is found in the changed one.
type Relation = (&'static str, fn(Burst) -> Burst, fn(Acquired, u32) -> Acquired);

const RELATIONS: [Relation; 6] = [
    (
        "a year later",
        |b| Burst { t_acq_ns: b.t_acq_ns + YEAR_NS, ..b },
        |(t, h, c), _| (t + YEAR_NS, h, c),
    ),
    (
        "thirty years earlier",
        |b| Burst { t_acq_ns: b.t_acq_ns - 30 * YEAR_NS, ..b },
        |(t, h, c), _| (t - 30 * YEAR_NS, h, c),
    ),
    (
        "a little later",
        |b| Burst { t_acq_ns: b.t_acq_ns + 123_456_789, ..b },
        |(t, h, c), _| (t + 123_456_789, h, c),
    ),
    (
        "numbered from 5000",
        |b| Burst { first_channel: b.first_channel + 5000, ..b },
        |(t, h, c), _| (t, h, c + 5000),
    ),
    ("mirrored", |b| mirrored(&b), |(t, h, c), channels| (t, h, channels - 1 - c)),
    (
        "called otherwise",
        |b| Burst { printhead: format!("z-{}", b.printhead).into(), ..b },
        |(t, h, c), _| (t, format!("z-{h}"), c),
    ),
];

#[test]
fn what_must_not_matter_does_not() {
    let mut draws = ChaCha8Rng::seed_from_u64(641);
    for mode in MODES {
        for _ in 0..2 {
            let house = House::new();
            let original = part(&mut draws);
            let channels = original[0].channels;
            let (first, signals) = (draws.random_range(4..25), draws.random_range(300..3000));
            let options = format!(
                "{mode} --set identify.first={first} --set identify.window_signals={signals}"
            );
            house.record("as_it_is.mcap", &original);
            let as_it_is = said(&house, "as_it_is", &options);
            assert!(as_it_is.len() > 600);
            for (what, change, there) in RELATIONS {
                let changed: Vec<Burst> = original.iter().cloned().map(change).collect();
                house.record("changed.mcap", &changed);
                let changed = said(&house, "changed", &options);
                let differs = |(of, said): &(&Acquired, &Said)| {
                    !changed.get(&there((*of).clone(), channels)).is_some_and(|now| now.is_as(said))
                };
                let first = as_it_is.iter().find(differs);
                let now = first.map(|(of, _)| changed.get(&there(of.clone(), channels)));
                assert!(first.is_none(), "{what}, {options}: {first:?}, now {now:?}");
            }
        }
    }
}

#[test]
fn other_printheads_in_the_file_do_not_matter() {
    let all = bursts(&sample("print_run.mcap"));
    let start = all[0].t_acq_ns;
    for mode in MODES {
        let house = House::new();
        // one head prints ten times as fast, so that its window is over before those of the others; another one begins
        // later, or its clock is a minute ahead
        for (name, late_s, ahead_s) in [("later", 17, 0), ("ahead", 0, 60)] {
            let changed = |burst: &Burst| {
                let since = burst.t_acq_ns - start;
                let (since, is_there) = match &*burst.printhead {
                    "magenta-1" => (since / 10, true),
                    "black-2" => (since + ahead_s * 1_000_000_000, since >= late_s * 1_000_000_000),
                    _ => (since, true),
                };
                is_there.then(|| Burst { t_acq_ns: start + since, ..burst.clone() })
            };
            let with_others: Vec<Burst> = all.iter().filter_map(changed).collect();
            let alone = with_others.iter().filter(|of| &*of.printhead == "magenta-1").cloned();
            house.record("alone.mcap", &alone.collect::<Vec<_>>());
            house.record("others.mcap", &with_others);
            let options = format!("{mode} --set identify.window_signals=300");
            let (alone, others) =
                (said(&house, "alone", &options), said(&house, "others", &options));
            let differs = |(of, said): &(&Acquired, &Said)| {
                !others.get(*of).is_some_and(|now| now.is_as(said))
            };
            let first = alone.iter().find(differs);
            assert!(first.is_none(), "{name}, {mode}: {first:?}");
        }
    }
}

#[test]
fn a_stray_takes_nothing_from_the_others() {
    let all = bursts(&sample("print_run.mcap"));
    for mode in MODES {
        let house = House::new();
        house.record("run.mcap", &all);
        let as_it_is = said(&house, "run", mode);
        for (name, at, t_acq_ns) in [
            ("first", 0, 0),
            ("early", 7, 0),
            ("future", 0, 4_102_444_800_000_000_000),
            ("ahead", 9, i64::MAX),
        ] {
            let mut astray = all.clone();
            astray[at].t_acq_ns = t_acq_ns;
            house.record(&format!("{name}.mcap"), &astray);
            let said = said(&house, name, mode);
            let differ = as_it_is.iter().filter(|(of, as_it_was)| {
                said.get(*of).is_some_and(|now| now.words != as_it_was.words)
            });
            let differ = differ.count() as f64 / as_it_is.len() as f64;
            assert!(differ < 0.01, "{name}, {mode}: {differ}");
        }
    }
}

/// The same bursts with a constant number of counts in every sample.
fn raised(of: &[Burst], counts: f64) -> Vec<Burst> {
    of.iter().map(|burst| with_samples(burst, |_, _, y| y + counts)).collect()
}

/// The same signals in another unit of what is sensed, and on another scale of time.
fn scaled(of: &[Burst], [gain, time]: [f32; 2]) -> Vec<Burst> {
    let scaled = |burst: &Burst| {
        let signals = counts(burst);
        let signals: Vec<Vec<f32>> =
            signals.iter().map(|y| y.iter().map(|y| gain * y).collect()).collect();
        let sample_period_s = f64::from(time) * burst.sample_period_s;
        with_signals(&Burst { sample_period_s, ..burst.clone() }, &signals, SAMPLE_MAJOR_FLOATS)
    };
    of.iter().map(scaled).collect()
}

/// What is said of the signals by their words alone, and of how many it differs.
fn differing(as_it_is: &BTreeMap<Acquired, Said>, changed: &BTreeMap<Acquired, Said>) -> f64 {
    let differ = as_it_is.iter().filter(|(of, said)| changed[of].words != said.words).count();
    differ as f64 / as_it_is.len() as f64
}

/// Judged with nothing, and by windows and a design that was trained on recordings changed alike.
#[test]
fn what_stands_off_zero_or_has_another_unit_is_learned_where_it_stands_and_in_its_unit() {
    let house = House::new();
    let [original, train] = ["print_run.mcap", "train.mcap"].map(|name| bursts(&sample(name)));
    house.record("run.mcap", &original);
    let as_it_is = said(&house, "run", "");
    let by_design = said(&house, "run", "--design sample_logs/design.json --identify windows");
    type Change = fn(&[Burst]) -> Vec<Burst>;
    let changes: [(&str, Change); 6] = [
        ("off_by_40", |of| raised(of, 40.0)),
        ("off_by_2048", |of| raised(of, 2048.0)),
        ("off_by_minus_300", |of| raised(of, -300.0)),
        ("a_fiftieth", |of| scaled(of, [0.02, 1.0])),
        ("fifty_times", |of| scaled(of, [50.0, 1.0])),
        ("a_hundred_times_the_time", |of| scaled(of, [1.0, 100.0])),
    ];
    for (name, change) in changes {
        house.record(&format!("{name}.mcap"), &change(&original));
        let alone = differing(&as_it_is, &said(&house, name, ""));
        assert!(alone < 0.01, "{name}: {alone}");
        house.record("train.mcap", &change(&train));
        house.run("train train.mcap --labels sample_logs/labels.csv -o d.json").exits(0);
        let changed = said(&house, name, "--design d.json --identify windows");
        let with_design = differing(&by_design, &changed);
        assert!(with_design < 0.03, "{name}: {with_design}");
    }
}
