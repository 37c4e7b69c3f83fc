//! An open world: signals of no class, healthy channels of any shape, heads that drift. The generators are written from the
//! contract and from the shape of thesis (2-2) alone: they know nothing of how inkling judges, and share no constant with its
//! simulator. Seeds are fixed, none that anything was tuned on; each bound is widened by what chance alone makes of so many
//! signals.

mod foreign;
mod plant;

use crate::goals::{Goals, Rate};
use crate::house::House;
use crate::recorded::{Said, said};
use foreign::Family;
use inkling::burst::{Burst, Format, Layout};
use plant::{
    BOX, DRIFTS, Deviate, Drift, FAULTS, GAUSSIAN, LASTING, PERIOD_S, Ring, SHAPES, Scatter, clean,
    drawn, noisy, normal, random, student,
};
use rand::RngExt;
use rand::seq::SliceRandom;

const SEED: u64 = 913_000;
/// The default of `detect.false_alarm_rate`.
const STATED: f64 = 7e-4;
const BY_DESIGN: &str = "--design design.json --identify design";
const BY_WINDOWS: &str = "--design design.json --identify windows";
const HEALTHY: &str = "healthy";
const START_NS: i64 = 1_750_000_000_000_000_000;

/// Signals with their truth, in the order of a recording: all channels, and then all again.
struct Signals {
    /// Of the head, and of each burst.
    channels: usize,
    per_burst: usize,
    /// From one moment to the next.
    every_s: usize,
    states: Vec<&'static str>,
    samples: Vec<Vec<f32>>,
}

impl Signals {
    fn new([channels, per_burst, every_s]: [usize; 3]) -> Signals {
        Signals { channels, per_burst, every_s, states: Vec::new(), samples: Vec::new() }
    }

    fn push(&mut self, state: &'static str, samples: Vec<f64>) {
        self.states.push(state);
        self.samples.push(samples.into_iter().map(|y| y as f32).collect());
    }

    /// So many healthy ones and so many of each class, in random order.
    fn of(healthy: usize, per_class: usize, seed: u64) -> Signals {
        let mut rng = random(seed, 0);
        let mut states = vec![(HEALTHY, None); healthy];
        for (fault, from) in FAULTS {
            states.extend(vec![(fault, Some(from)); per_class]);
        }
        states.shuffle(&mut rng);
        let mut signals = Signals::new([128, 128, 1]);
        for (place, (state, from)) in states.into_iter().enumerate() {
            let ring = match from {
                None => BOX.ring(seed, place % signals.channels, &mut rng),
                Some(from) => drawn(from, &mut rng),
            };
            signals.push(state, noisy(clean(ring), normal, &mut rng));
        }
        signals
    }

    fn t_ns(&self, place: usize) -> i64 {
        START_NS + (place / self.channels * self.every_s) as i64 * 1_000_000_000
    }

    fn bursts(&self) -> Vec<Burst> {
        let burst = |(i, some): (usize, &[Vec<f32>])| Burst {
            t_acq_ns: self.t_ns(i * self.per_burst),
            first_channel: (i * self.per_burst % self.channels) as u32,
            ..Burst::of(some, PERIOD_S, Format::F32Le, Layout::ChannelMajor)
        };
        self.samples.chunks(self.per_burst).enumerate().map(burst).collect()
    }

    /// What is said of each, in their order. What was skipped or damaged is no failure.
    fn judged(&self, house: &House, how: &str) -> Vec<Said> {
        house.record("r.mcap", &self.bursts());
        let ended = house.run(&format!("replay r.mcap --out out --force {how}"));
        assert!(matches!(ended.code(), Some(0 | 3)), "{how}: {}", ended.stderr());
        let said = said(&house.path("out/r.verdicts.parquet"));
        assert_eq!(said.len(), self.states.len(), "every signal has a verdict: {how}");
        said
    }
}

/// A house with a design that was learned from as many signals as the thesis has.
fn trained(seed: u64) -> House {
    let (house, signals) = (House::new(), Signals::of(2475, 225, seed));
    house.record("train.mcap", &signals.bursts());
    let label = |(place, state): (usize, &&str)| {
        let (channel, from) = (place % signals.channels, signals.t_ns(place));
        format!("p,{channel},{from},{},{state},\n", from + 1)
    };
    let labels: String = signals.states.iter().enumerate().map(label).collect();
    house.write("labels.csv", format!("printhead,channel,from,to,state,severity\n{labels}"));
    house.ok("train train.mcap --labels labels.csv -o design.json");
    house
}

/// Of each family at most 2 % are called healthy, of gross ones .5 %, and at most 2 % are named.
#[test]
fn nothing_gross_is_called_healthy_and_nothing_foreign_is_named() {
    let (house, mut goals, each) = (trained(SEED), Goals::default(), 192);
    // the first window is healthy, and the only one: what comes after it is not
    let window = 20 * 128;
    let mut signals = Signals::of(window, 0, SEED + 1);
    let families = Family::all();
    for (stream, family) in families.iter().enumerate() {
        let mut rng = random(SEED + 2, stream as u64);
        (0..each).for_each(|_| signals.push("", family.signal(&mut rng)));
    }
    for way in [BY_DESIGN, BY_WINDOWS] {
        let said = signals.judged(&house, way);
        for (family, said) in families.iter().zip(said[window..].chunks(each)) {
            let healthy = Rate::of(said.iter().map(Said::is_healthy));
            let named = Rate::of(said.iter().map(Said::is_named));
            let most = if family.energy >= Some(1600.0) { 0.005 } else { 0.02 };
            let what = format!("{} {:?} {way}", family.name, family.energy);
            goals.at_most(&format!("{what}: called healthy"), healthy, most);
            goals.at_most(&format!("{what}: named"), named, 0.02);
        }
    }
    goals.all_are_met();
}

/// Of healthy signals and of others, how many are flagged.
fn flagged(said: &[Said], signals: &Signals) -> [Rate; 2] {
    let [mut healthy, mut ill] = [Rate::default(); 2];
    for (said, state) in said.iter().zip(&signals.states) {
        let rate = if *state == HEALTHY { &mut healthy } else { &mut ill };
        rate.add(said.is_flagged());
    }
    [healthy, ill]
}

/// Healthy channels that scatter so, and so many signals of faults anywhere: twice the stated rate at most and recall
/// .97, by windows and without a design, though the design was trained on a box.
fn of_scatter(house: &House, scatter: &Scatter, faulty: f64, noise: Deviate) -> Goals {
    let (mut goals, mut rng) = (Goals::default(), random(SEED + 2, 1));
    // of lasting differences there must be many; twenty seconds hold 2560 signals, as usual
    let mut signals = Signals::new([512, 512, 4]);
    for channel in (0..signals.channels).cycle().take(23_040) {
        let (state, ring) = match rng.random_bool(faulty) {
            false => (HEALTHY, scatter.ring(SEED + 2, channel, &mut rng)),
            true => {
                let (fault, of) = FAULTS[rng.random_range(0..FAULTS.len())];
                (fault, drawn(of, &mut rng))
            }
        };
        signals.push(state, noisy(clean(ring), noise, &mut rng));
    }
    for way in [BY_WINDOWS, ""] {
        let said = signals.judged(house, way);
        // 0 would say that a ring fits like nothing else does, where none was fitted
        assert!(said.iter().all(|said| said.misfit.is_none_or(|misfit| misfit > 0.3)));
        let [healthy, ill] = flagged(&said, &signals);
        let what = format!("{}, {faulty} faulty {way}", scatter.name);
        goals.at_most(&format!("{what}: false alarms"), healthy, 2.0 * STATED);
        // with the heaviest tails .93 to .94 at a fifth of the stated false alarms: 20 s do not tell such a tail (60 s: .95)
        let least = if scatter.name == "Student of 5" { 0.93 } else { 0.97 };
        goals.at_least(&format!("{what}: recall"), ill, least);
    }
    goals
}

#[test]
fn stated_rates_hold_on_healthy_channels_of_any_shape_and_windows_may_hold_faulty_signals() {
    let house = trained(SEED + 1);
    let of =
        |scatter: &Scatter, faulty, noise| of_scatter(&house, scatter, faulty, noise).all_are_met();
    SHAPES.iter().for_each(|scatter| of(scatter, 0.04, normal));
    of(&BOX, 0.04, student);
    [0.0, 0.2, 0.4].iter().for_each(|share| of(&GAUSSIAN, *share, normal));
}

/// A head whose channels all drift so, some of them faulty from the 200th second on: no false episode, twice the stated
/// rate, nearly every faulty signal.
fn of_drift(
    house: &House,
    (name, [least, most], drift): (&str, [usize; 2], Drift),
    scatter: Scatter,
    [channels, per_burst, faulty]: [usize; 3],
    how: &str,
) -> Goals {
    let (mut goals, mut rng) = (Goals::default(), random(SEED + 11, 4));
    let mut signals = Signals::new([channels, per_burst, 1]);
    // evenly over the head
    let is_faulty = |channel: usize| channel * faulty % channels < faulty;
    for (second, channel) in (0..600).flat_map(|s| (0..channels).map(move |c| (s, c))) {
        let (state, ring) = match is_faulty(channel) && second >= 200 {
            false => (HEALTHY, scatter.ring(SEED, channel, &mut rng)),
            true => {
                let (fault, of) = FAULTS[[8, 4, 2][channel % 3]]; // DDN, BN, AB2
                (fault, drawn(of, &mut rng))
            }
        };
        let changes = drift(f64::from(second));
        let drifted: Ring = std::array::from_fn(|k| ring[k] * (1.0 + changes[k]));
        signals.push(state, noisy(clean(drifted), normal, &mut rng));
    }
    for way in [BY_DESIGN, BY_WINDOWS] {
        let what = format!("{name}, {faulty} faulty {way}");
        let [healthy, ill] = flagged(&signals.judged(house, &format!("{way} {how}")), &signals);
        goals.at_most(&format!("{what}: false alarms"), healthy, 2.0 * STATED);
        goals.at_least(&format!("{what}: recall"), ill, 0.99);
        let episodes = house.episodes("out/r");
        let wrong = episodes.iter().filter(|e| !is_faulty(e.channel as usize)).count();
        goals.met(wrong == 0, format!("{what}: {wrong} false episodes"));
        let warnings = house.read_json("out/r.summary.json")["warnings"].to_string();
        let told = warnings.matches("moved together").count();
        // among so many faulty channels the middle is known to half a deviation: what lies near the bounds may be told
        let is_right = (least..=most).contains(&told) || 5 * faulty > channels;
        goals.met(is_right, format!("{what}: told {told} times that all have moved"));
    }
    goals
}

#[test]
fn what_moves_all_channels_alike_is_the_heads_and_clean_recordings_raise_no_episodes() {
    let (house, half) = (trained(SEED + 10), Scatter { width: 0.5, ..LASTING });
    let of = |drift, scatter, head| of_drift(&house, drift, scatter, head, "").all_are_met();
    DRIFTS.iter().for_each(|drift| of(*drift, half, [128, 128, 3]));
    DRIFTS[..3].iter().for_each(|drift| of(*drift, half, [40, 4, 16]));
    [BOX, half].iter().for_each(|scatter| of(DRIFTS[0], *scatter, [256, 256, 0]));
    let apart = "--set identify.common_change=false";
    let alone = of_drift(&house, DRIFTS[1], half, [128, 128, 3], apart);
    assert!(alone.missed.iter().any(|missed| missed.contains("false episodes")));
}
