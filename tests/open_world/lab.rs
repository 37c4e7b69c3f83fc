//! A directory and the inkling command: it trains designs on these signals, and judges them.

use super::head::Scatter;
use super::plant::{Plant, random};
use crate::house::House;
use crate::recorded::{Said, said};
use inkling::burst::{Burst, Format, Layout};
use rand::seq::SliceRandom;

pub const HEALTHY: &str = "healthy";

/// Signals of known state: so many healthy ones, and of each class.
#[derive(Clone, Copy)]
pub struct Library {
    pub scatter: Scatter,
    pub healthy: usize,
    pub per_class: usize,
}

/// Signals with their truth, in the order of a recording: all channels, and then all again.
#[derive(Default)]
pub struct Signals {
    /// Of the head, and of each burst.
    pub channels: usize,
    pub per_burst: usize,
    /// From one moment to the next.
    pub every_s: usize,
    pub states: Vec<&'static str>,
    pub samples: Vec<Vec<f32>>,
}

const START_NS: i64 = 1_750_000_000_000_000_000;

impl Signals {
    pub fn new(channels: usize) -> Signals {
        Signals { channels, per_burst: channels, every_s: 1, ..Signals::default() }
    }

    pub fn push(&mut self, state: &'static str, samples: Vec<f64>) {
        self.states.push(state);
        self.samples.push(samples.into_iter().map(|y| y as f32).collect());
    }

    /// Of a library, in random order.
    pub fn of(library: &Library, plant: &Plant, seed: u64) -> Signals {
        let mut rng = random(seed, 0);
        let mut states = vec![(HEALTHY, None); library.healthy];
        for (fault, from) in &plant.faults {
            states.extend(vec![(*fault, Some(*from)); library.per_class]);
        }
        states.shuffle(&mut rng);
        let mut signals = Signals::new(128);
        for (place, (state, from)) in states.into_iter().enumerate() {
            let ring = match from {
                None => library.scatter.ring(plant, seed, place % signals.channels, &mut rng),
                Some(from) => plant.drawn(from, &mut rng),
            };
            signals.push(state, plant.signal(&ring, &mut rng));
        }
        signals
    }

    fn t_ns(&self, place: usize) -> i64 {
        START_NS + (place / self.channels * self.every_s) as i64 * 1_000_000_000
    }

    fn bursts(&self, plant: &Plant) -> Vec<Burst> {
        let burst = |(i, some): (usize, &[Vec<f32>])| Burst {
            t_acq_ns: self.t_ns(i * self.per_burst),
            first_channel: (i * self.per_burst % self.channels) as u32,
            ..Burst::of(some, plant.period_s(), Format::F32Le, Layout::ChannelMajor)
        };
        self.samples.chunks(self.per_burst).enumerate().map(burst).collect()
    }
}

pub struct Lab(pub House);

impl Lab {
    /// A design that was learned from signals of the library.
    pub fn trained(library: &Library, plant: &Plant, seed: u64) -> Lab {
        let (house, signals) = (House::new(), Signals::of(library, plant, seed));
        house.record("train.mcap", &signals.bursts(plant));
        let label = |(place, state): (usize, &&str)| {
            let (channel, from) = (place % signals.channels, signals.t_ns(place));
            format!("p,{channel},{from},{},{state},\n", from + 1)
        };
        let labels: String = signals.states.iter().enumerate().map(label).collect();
        house.write("labels.csv", format!("printhead,channel,from,to,state,severity\n{labels}"));
        let own = plant.faults.iter().filter(|(fault, _)| fault.starts_with('K'));
        let own: String = own.map(|(fault, _)| format!(" --new-class {fault}")).collect();
        house.ok(&format!("train train.mcap --labels labels.csv -o design.json{own}"));
        Lab(house)
    }

    /// What is said of each signal, in its order. What was skipped or damaged is no failure.
    pub fn judged(&self, signals: &Signals, plant: &Plant, how: &str) -> Vec<Said> {
        self.0.record("r.mcap", &signals.bursts(plant));
        let ended = self.0.run(&format!("replay r.mcap --out out --force {how}"));
        assert!(matches!(ended.code(), Some(0 | 3)), "{how}: {}", ended.stderr());
        let said = said(&self.0.path("out/r.verdicts.parquet"));
        assert_eq!(said.len(), signals.states.len(), "every signal has a verdict: {how}");
        said
    }
}
