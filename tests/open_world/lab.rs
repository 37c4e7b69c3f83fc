//! A directory and the inkling command: trains designs, judges recordings, hands verdicts back.

use super::plant::{Plant, random};
use super::recording::{self, HEALTHY, Rows};
use super::scatter::Scatter;
use super::verdicts::{self, Episode, Verdict};
use clap::ValueEnum;
use inkling::io::design_file;
use inkling::labels::known_states;
use rand::seq::SliceRandom;
use std::collections::BTreeSet;
use std::ffi::OsString;
use std::path::PathBuf;
use std::process::Command;

/// How inkling is called.
#[derive(Clone, Default)]
pub struct Program {
    pub command: PathBuf,
    /// What stands before the verb.
    pub first: Vec<OsString>,
    /// Further arguments of `inkling train` and of `inkling replay`.
    pub train: String,
    pub replay: String,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Mode {
    Design,
    Windows,
    NoDesign,
}

/// Signals of known state, to learn from.
#[derive(Clone, Copy, Debug)]
pub struct Library {
    pub scatter: Scatter,
    pub healthy: usize,
    pub per_class: usize,
}

impl Library {
    /// The size of the thesis's.
    pub const THESIS: Library = Library { scatter: Scatter::BOX, healthy: 2475, per_class: 225 };
}

/// Signals with their truth, in the order of a recording.
#[derive(Default)]
pub struct Signals {
    pub states: Vec<String>,
    pub samples: Vec<Vec<f32>>,
}

impl Signals {
    pub fn push(&mut self, state: &str, samples: Vec<f32>) {
        self.states.push(state.to_owned());
        self.samples.push(samples);
    }

    /// Healthy and faulty ones at random places.
    pub fn of(library: &Library, plant: &Plant, seed: u64) -> Signals {
        let mut rng = random(seed, 0);
        let mut states: Vec<&str> = vec![HEALTHY; library.healthy];
        for class in plant.faults.keys() {
            states.extend(std::iter::repeat_n(class.as_str(), library.per_class));
        }
        states.shuffle(&mut rng);
        let mut signals = Signals::default();
        for (place, state) in states.into_iter().enumerate() {
            let channel = Rows::USUAL.channel(place);
            let features = match plant.faults.get(state) {
                Some(ranges) => ranges.draw(&mut rng),
                None => library.scatter.features(plant, seed, channel, &mut rng),
            };
            signals.push(state, plant.signal(features, &mut rng));
        }
        signals
    }
}

/// What is done to a design that was learned.
pub type Mutant = fn(&mut serde_json::Value);

/// What a command said before it failed.
pub type Refusal = String;

pub struct Lab {
    program: Program,
    dir: tempfile::TempDir,
}

impl Lab {
    pub fn new(program: &Program) -> Lab {
        Lab { program: program.clone(), dir: tempfile::tempdir().unwrap() }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    /// Arguments separated by white space. What was damaged or skipped is no failure.
    pub fn run(&self, args: &str) -> Result<(), Refusal> {
        let output = Command::new(&self.program.command)
            .args(&self.program.first)
            .args(args.split_whitespace())
            .current_dir(self.dir.path())
            .output()
            .unwrap();
        match output.status.code() {
            Some(0 | 3) => Ok(()),
            code => {
                let said = String::from_utf8_lossy(&output.stderr);
                Err(format!("inkling {args}: exit status {code:?}: {}", said.trim()))
            }
        }
    }

    /// Learns `design.json` from signals of the library.
    pub fn train(&self, library: &Library, plant: &Plant, seed: u64) -> Result<(), Refusal> {
        let (signals, more) = (Signals::of(library, plant, seed), &self.program.train);
        recording::write_labels(&self.path("labels.csv"), Rows::USUAL, &signals.states);
        self.write("train", Rows::USUAL, plant, signals.samples);
        let is_own = |state: &&String| known_states().all(|known| known != **state);
        let own: BTreeSet<&String> = signals.states.iter().filter(is_own).collect();
        let own = own.iter().filter(|state| !more.contains(&***state));
        let declared: String = own.map(|state| format!(" --new-class {state}")).collect();
        let train = "train train.mcap --labels labels.csv -o design.json";
        self.run(&format!("{train} {more}{declared}"))
    }

    /// Takes something out of what was learned.
    pub fn spoil(&self, mutant: Mutant) {
        let path = self.path("design.json");
        let mut design = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
        mutant(&mut design);
        design_file::write(&path, &serde_json::from_value(design).unwrap()).unwrap();
    }

    pub fn write(
        &self,
        name: &str,
        rows: Rows,
        plant: &Plant,
        signals: impl IntoIterator<Item = Vec<f32>>,
    ) {
        let path = self.path(&format!("{name}.mcap"));
        recording::write(&path, rows, plant.sampling(), plant.is_rounded(), signals);
    }

    /// `name` may hold directories.
    pub fn judge(&self, name: &str, mode: Mode, more: &str) -> Result<Vec<Verdict>, Refusal> {
        self.run_replay(name, mode, more)?;
        Ok(verdicts::read(&self.written(name, "verdicts")))
    }

    /// The verdicts, each beside what is true of its signal.
    pub fn judge_known<'t, T>(
        &self,
        name: &str,
        mode: Mode,
        more: &str,
        truths: &'t [T],
    ) -> Result<Vec<(Verdict, &'t T)>, Refusal> {
        let verdicts = self.judge(name, mode, more)?;
        assert_eq!(verdicts.len(), truths.len(), "every signal of {name} has a verdict");
        Ok(verdicts.into_iter().zip(truths).collect())
    }

    /// The episodes alone.
    pub fn replay(&self, name: &str, mode: Mode) -> Result<Vec<Episode>, Refusal> {
        self.run_replay(name, mode, "")?;
        Ok(self.episodes(name))
    }

    /// Of the last replay of it.
    pub fn episodes(&self, name: &str) -> Vec<Episode> {
        verdicts::read_episodes(&self.written(name, "episodes"))
    }

    /// What its summary warns of.
    pub fn warnings(&self, name: &str) -> Vec<String> {
        let text = std::fs::read(self.path(&format!("out/{name}.summary.json"))).unwrap();
        let summary: serde_json::Value = serde_json::from_slice(&text).unwrap();
        let warnings = summary["warnings"].as_array().unwrap().iter();
        warnings.map(|of| of["what"].as_str().unwrap().to_owned()).collect()
    }

    fn run_replay(&self, name: &str, mode: Mode, more: &str) -> Result<(), Refusal> {
        let by = match mode {
            Mode::Design => "--design design.json --identify design",
            Mode::Windows => "--design design.json --identify windows",
            Mode::NoDesign => "",
        };
        let further = &self.program.replay;
        self.run(&format!("replay {name}.mcap {by} --out out {more} {further}"))
    }

    fn written(&self, name: &str, table: &str) -> PathBuf {
        let stem = name.rsplit('/').next().unwrap_or(name);
        self.path(&format!("out/{stem}.{table}.parquet"))
    }
}
