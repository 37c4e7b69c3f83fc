//! Nights at other ink temperatures than the design was trained at, nights whose sensor says another temperature than the
//! ink has, and nights whose cable was out: no channel is told as replaced or as faulty for that, and the fault that there
//! is stays known.
//!
//! Rings are written down: damping and resonance follow temperature exponentially, and every channel rings a little
//! otherwise. 7 K off the training's temperatures a straight line, added to every channel alike, reads 3 % of damping
//! into a channel whose resonance lies .7 % beside the others'.

use crate::house::House;
use inkling::burst::{Burst, Format, Layout};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::TAU;

const CHANNELS: usize = 48;
const SAMPLES: usize = 120;
const PERIOD_S: f64 = 1.1e-6;
const TRAINED_C: f64 = 29.0;
const FAULTY: usize = 17;
const DAY_NS: i64 = 86_400_000_000_000;

/// ln amplitude, ln damping, ln resonance and phase, from those that all channels have in common.
type Offsets = [f64; 4];

fn offsets(rng: &mut ChaCha8Rng, sds: Offsets) -> Offsets {
    sds.map(|sd| {
        let z: f64 = StandardNormal.sample(rng);
        sd * z
    })
}

/// What the sensor says of every third burst.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Sensor {
    Right,
    Nothing,
    Zero,
    /// So many K too much.
    Off(f64),
}

/// A night of 40 bursts.
struct Night {
    n: i64,
    /// K above the temperature of the training: of the ink, and as it is recorded.
    ink: f64,
    said: f64,
    sensor: Sensor,
    /// Of the rings when they begin; 0: the cable is out.
    counts: f64,
    /// Standard deviation over channels of what temperature does to them, as a share.
    differs: f64,
}

fn night(house: &House, n: i64, ink: f64, said: f64, sensor: Sensor) {
    record(house, Night { n, ink, said, sensor, counts: 5200.0, differs: 0.0 });
}

fn record(house: &House, night: Night) {
    let Night { n, ink, said, sensor, counts, differs } = night;
    let mut make = ChaCha8Rng::seed_from_u64(7);
    let own: Vec<Offsets> =
        (0..CHANNELS).map(|_| offsets(&mut make, [0.015, 0.012, 0.007, 0.012])).collect();
    let times: Vec<f64> =
        (0..CHANNELS).map(|_| 1.0 + offsets(&mut make, [differs; 4])[0]).collect();
    let mut rng = ChaCha8Rng::seed_from_u64((100 + n) as u64);
    let bursts = (0..40).map(|burst| {
        // it wanders a little
        let swing = 0.5 * (f64::from(burst) / 9.0 + n as f64).sin();
        let mut signal = |own: &Offsets, channel: usize| {
            let now = offsets(&mut rng, [0.003, 0.003, 0.0004, 0.002]);
            let of =
                |k: usize, per_k: f64| own[k] + now[k] + times[channel] * per_k * (ink + swing);
            let dried = if channel == FAULTY && n >= 3 { 1.45f64.ln() } else { 0.0 };
            let damping = 1.9e4 * (of(1, -0.018) + dried).exp();
            let turns = TAU * 49e3 * of(2, 0.0011).exp();
            let y = (0..SAMPLES).map(|k| {
                let t = k as f64 * PERIOD_S;
                let noise: f64 = StandardNormal.sample(&mut rng);
                let ring = (-damping * t).exp() * (turns * t + 0.4 + of(3, 0.0)).cos();
                (counts * of(0, -0.003).exp() * ring + 9.0 * noise).round() as f32
            });
            y.collect::<Vec<f32>>()
        };
        let signals: Vec<Vec<f32>> =
            own.iter().enumerate().map(|(channel, own)| signal(own, channel)).collect();
        let right = TRAINED_C + said + swing;
        let temperature_c = match sensor {
            Sensor::Nothing if burst % 3 == 1 => None,
            Sensor::Zero if burst % 3 == 1 => Some(0.0),
            Sensor::Off(by) if burst % 3 == 1 => Some(right + by),
            _ => Some(right),
        };
        Burst {
            t_acq_ns: 1_790_000_000_000_000_000 + n * DAY_NS + i64::from(burst) * 1_000_000_000,
            temperature_c,
            ..Burst::of(&signals, PERIOD_S, Format::S16Le, Layout::ChannelMajor)
        }
    });
    house.record(&format!("n{n}.mcap"), &bursts.collect::<Vec<_>>());
}

#[test]
fn a_warm_night_and_a_wrong_sensor_make_no_fault_and_hide_none() {
    let house = House::new();
    house.write("healthy.csv", "printhead,channel,from,to,state,severity\n*,*,,,healthy,\n");
    (0..3)
        .for_each(|n| night(&house, n, 0.8 * (n - 1) as f64, 0.8 * (n - 1) as f64, Sensor::Right));
    house.ok("train n0.mcap n1.mcap n2.mcap --labels healthy.csv -o design.json");
    // ink, what is said of it, sensor
    let nights = [
        (0.0, 0.0, Sensor::Right),
        (7.0, 7.0, Sensor::Right),
        (0.0, 7.0, Sensor::Right),
        (0.0, -7.0, Sensor::Right),
        (-6.0, -6.0, Sensor::Right),
        (-9.0, -9.0, Sensor::Nothing),
        (0.0, 0.0, Sensor::Right),
    ];
    for (n, (ink, said, sensor)) in (3i64..).zip(nights) {
        night(&house, n, ink, said, sensor);
        house.ok(&format!("replay n{n}.mcap --design design.json --baseline b.json --out out"));
        let episodes = house.episodes(&format!("out/n{n}"));
        let faulty: Vec<u32> = episodes.iter().map(|of| of.channel).collect();
        assert_eq!(faulty, [FAULTY as u32], "{ink} {said}: {episodes:?}");
        assert_eq!(episodes[0].category.as_deref(), Some("dried_nozzle"), "{ink} {said}");
        let told = house.read_json(&format!("out/n{n}.summary.json"))["head_changes"].to_string();
        assert!(!told.contains("replaced") && !told.contains("others than"), "{told}");
        // all channels lie where the sensor does not say
        assert_eq!(told.contains("moved together"), ink != said, "{ink} {said}: {told}");
    }
}

/// Standard deviations of healthy channels' features in the design's model of all printheads.
fn spread(house: &House, design: &str) -> [f64; 3] {
    let of = &house.read_json(design)["pooled"]["sensitivity"]["spread"];
    std::array::from_fn(|k| of[k][k].as_f64().unwrap().sqrt())
}

/// Labels over 18 K say the same of healthy channels as labels of one temperature: what temperature does is no scatter, in
/// which a fault would hide that is there from the state's first night on. A sensor that fails for every third labelled
/// burst changes nothing of that.
#[test]
fn a_design_of_many_temperatures_sees_a_fault_of_the_first_night() {
    let house = House::new();
    house.write("healthy.csv", "printhead,channel,from,to,state,severity\n*,*,,,healthy,\n");
    let train = |times: f64, sensor: Sensor| {
        for n in -6..-1 {
            let warmer = times * (n + 4) as f64;
            night(&house, n, warmer, warmer, sensor);
        }
        let nights = "n-6.mcap n-5.mcap n-4.mcap n-3.mcap n-2.mcap";
        let trained = house.run(&format!("train {nights} --labels healthy.csv -o design.json"));
        (spread(&house, "design.json"), trained.exits(0).stderr())
    };
    let (narrow, _) = train(0.0, Sensor::Right);
    for (sensor, told) in [
        (Sensor::Nothing, "of 65 none was recorded"),
        (Sensor::Zero, "of 65 it was not that of the ink (0.0 to 0.0 °C)"),
        (Sensor::Off(-5.0), "of 65 it was not that of the ink"),
        (Sensor::Right, ""),
    ] {
        let (wide, warnings) = train(4.5, sensor);
        for k in 0..3 {
            assert!(wide[k] < 1.15 * narrow[k], "{sensor:?}: {wide:?} for {narrow:?}");
        }
        assert!(warnings.contains(told), "{sensor:?}: {warnings}");
        assert_eq!(warnings.contains("temperature of 200 bursts"), sensor != Sensor::Right);
    }
    for n in 3..6 {
        night(&house, n, 4.0 - n as f64, 4.0 - n as f64, Sensor::Right);
        house.ok(&format!("replay n{n}.mcap --design design.json --baseline b.json --out out"));
        let faulty: Vec<u32> =
            house.episodes(&format!("out/n{n}")).iter().map(|of| of.channel).collect();
        assert_eq!(faulty, [FAULTY as u32], "night {n}");
    }
}

/// Nothing of what two nights of noise show stays with the channels.
#[test]
fn two_nights_without_a_cable_move_no_channel() {
    let house = House::new();
    house.write("healthy.csv", "printhead,channel,from,to,state,severity\n*,*,,,healthy,\n");
    (-3..0).for_each(|n| night(&house, n, 0.8 * n as f64, 0.8 * n as f64, Sensor::Right));
    house.ok("train n-3.mcap n-2.mcap n-1.mcap --labels healthy.csv -o design.json");
    for n in 0..8 {
        let is_out = (3..5).contains(&n);
        let counts = if is_out { 0.0 } else { 5200.0 };
        let (ink, said, sensor) = (0.3, 0.3, Sensor::Right);
        record(&house, Night { n, ink, said, sensor, counts, differs: 0.0 });
        let command = "--design design.json --baseline b.json --out out";
        house.run(&format!("replay n{n}.mcap {command}"));
        if !is_out {
            let episodes = house.episodes(&format!("out/n{n}"));
            let faulty: Vec<u32> = episodes.iter().map(|of| of.channel).collect();
            assert_eq!(faulty, vec![FAULTY as u32; usize::from(n > 4)], "night {n}");
        }
    }
}

/// What a kelvin does to a channel is learned with the labels, and how far channels differ in that: a channel that rings
/// otherwise than the others on a warm night is no other channel and has no fault.
#[test]
fn channels_that_temperature_moves_unlike_are_neither_replaced_nor_faulty() {
    let house = House::new();
    house.write("healthy.csv", "printhead,channel,from,to,state,severity\n*,*,,,healthy,\n");
    let record = |n: i64, ink: f64| {
        let (said, sensor, counts) = (ink, Sensor::Right, 5200.0);
        record(&house, Night { n, ink, said, sensor, counts, differs: 0.06 });
    };
    (-5..0).for_each(|n| record(n, 4.0 * (n + 3) as f64));
    let nights = "n-5.mcap n-4.mcap n-3.mcap n-2.mcap n-1.mcap";
    house.ok(&format!("train {nights} --labels healthy.csv -o design.json"));
    for (n, ink) in (0i64..).zip([4.8, 1.3, -6.5, 6.0, -0.3, -5.4, 3.8, -1.7]) {
        record(n, ink);
        house.ok(&format!("replay n{n}.mcap --design design.json --baseline b.json --out out"));
        let episodes = house.episodes(&format!("out/n{n}"));
        let faulty: Vec<u32> = episodes.iter().map(|of| of.channel).collect();
        assert_eq!(faulty, vec![FAULTY as u32; usize::from(n >= 3)], "{n}: {episodes:?}");
        let told = house.read_json(&format!("out/n{n}.summary.json"))["head_changes"].to_string();
        assert!(!told.contains("replaced") && !told.contains("others than"), "{n}: {told}");
    }
}
