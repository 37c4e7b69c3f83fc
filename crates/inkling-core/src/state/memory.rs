//! What is remembered of printheads from one recording to the next: the file of `--baseline`, as
//! JSON.
//!
//! In: the states of all heads at the end of a recording ([`Head::memory`]), or a file that this or
//! an earlier release wrote ([`Memory::from_json`]). Out: the file's content, or the state that a
//! head begins with ([`Head::remembered`]). In the file all positions are features relative to a
//! ring, not canonical coordinates, so that a memory holds for a model that scatters otherwise,
//! too. What is read is checked, since anybody may have written it: sizes, and numbers that no run
//! writes.

use super::channel::{Channel, RUNGS, Sum};
use super::head::{Head, Within};
use super::kind::{Features, Kind, at_least};
use nalgebra::{Matrix4, Vector4};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Version of the file.
pub const VERSION: u32 = 3;
/// Channels of all printheads in a file, at most.
pub const MOST_CHANNELS: usize = 1 << 20;
/// Largest number of features or looks that a file may hold: those that runs write are far smaller.
const MOST: f64 = 1e9;

/// What `--baseline FILE` holds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Memory {
    pub version: u32,
    /// Digest of the design whose models the features are relative to; absent: there was none.
    pub design: Option<String>,
    /// The states by the names of the printheads.
    pub printheads: BTreeMap<String, HeadMemory>,
}

/// What is remembered of one printhead: the fields of [`Head`], in features.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeadMemory {
    /// The ring that features are relative to: amplitude in counts, damping in 1/s, frequency in
    /// Hz, phase in rad. Absent: the design's.
    pub ring: Option<[f64; 4]>,
    /// The level, where all channels are, and its covariance: ln amplitude, ln damping, ln
    /// frequency, phase in rad.
    pub level: [f64; 4],
    pub covariance: [[f64; 4]; 4],
    /// When the head was heard last, ns since the epoch.
    pub heard_ns: Option<i64>,
    /// Covariance of looks about their channels, noise included, and the number of looks that it
    /// rests on; 0: not known yet.
    pub within: [[f64; 4]; 4],
    pub within_looks: f64,
    /// Covariance of the channels about the level. What is below the design's spread is raised to
    /// that when it is read; 0: not known.
    pub spread: [[f64; 4]; 4],
    /// The channels by their numbers; here their sums are of features.
    pub channels: BTreeMap<u32, Channel>,
}

impl Memory {
    /// A memory of no printhead.
    pub fn new(design: Option<String>) -> Memory {
        Memory { version: VERSION, design, printheads: BTreeMap::new() }
    }

    /// Reads what this or an earlier release wrote. The error says in words what is wrong with the
    /// text.
    pub fn from_json(text: &[u8]) -> Result<Memory, String> {
        // the version alone first, for it says how to read the rest
        #[derive(Deserialize)]
        struct Head {
            version: u32,
        }
        let of_parser = |e: serde_json::Error| e.to_string();
        let Head { version } = serde_json::from_slice(text).map_err(of_parser)?;
        let memory: Memory = match version {
            1 => {
                serde_json::from_slice::<first_version::Baselines>(text).map_err(of_parser)?.into()
            }
            2 => second_version::upgraded(text).map_err(of_parser)?,
            VERSION => serde_json::from_slice(text).map_err(of_parser)?,
            other => {
                return Err(format!("version {other}: this inkling reads versions 1 to {VERSION}"));
            }
        };
        memory.check()?;
        Ok(memory)
    }

    /// Number of channels of all printheads.
    pub fn channels(&self) -> usize {
        self.printheads.values().map(|of| of.channels.len()).sum()
    }

    /// Refuses too many channels, and printheads whose numbers are not sound.
    fn check(&self) -> Result<(), String> {
        let channels = self.channels();
        if channels > MOST_CHANNELS {
            return Err(format!("{channels} channels: at most {MOST_CHANNELS}"));
        }
        let sound = |(name, of): (&String, &HeadMemory)| match of.is_sound() {
            true => Ok(()),
            false => Err(format!("printhead {name}: numbers that no run writes")),
        };
        self.printheads.iter().try_for_each(sound)
    }
}

impl HeadMemory {
    /// Whether a run may have written these numbers: they are bounded, covariances are symmetric
    /// and have no negative variance (but for rounding), counts and probabilities are in their
    /// ranges.
    fn is_sound(&self) -> bool {
        let bounded = |v: &f64| v.abs() <= MOST;
        let is_covariance = |of: &[[f64; 4]; 4]| {
            let of = matrix(of);
            let rounding = 1e-9 * of.amax();
            of.iter().all(bounded)
                && (of - of.transpose()).amax() <= rounding
                && of.symmetric_eigenvalues().min() >= -rounding
        };
        let sums = |of: &Sum| (0.0..=MOST).contains(&of.looks) && of.sum.iter().all(bounded);
        let of_channel = |of: &Channel| {
            of.past.iter().chain([&of.today, &of.faulty]).all(sums)
                && (0.0..=1.0).contains(&of.is_faulty)
                && [of.off, of.faulty_looks, of.faulty_days]
                    .iter()
                    .all(|v| (0.0..=MOST).contains(v))
        };
        let ring = |of: &[f64; 4]| of.iter().all(bounded) && of[..3].iter().all(|v| *v > 0.0);
        self.level.iter().all(bounded)
            && (0.0..=MOST).contains(&self.within_looks)
            && is_covariance(&self.covariance)
            && is_covariance(&self.within)
            && is_covariance(&self.spread)
            && self.ring.as_ref().is_none_or(ring)
            && self.channels.values().all(of_channel)
    }
}

fn matrix(of: &[[f64; 4]; 4]) -> Matrix4<f64> {
    Matrix4::from_fn(|i, j| of[i][j])
}

/// The rows of a matrix that is symmetric but for rounding; symmetric to the last bit.
fn rows(of: &Matrix4<f64>) -> [[f64; 4]; 4] {
    std::array::from_fn(|i| std::array::from_fn(|j| 0.5 * (of[(i, j)] + of[(j, i)])))
}

/// A channel with its positions in other coordinates. `by`: the matrix that leads there.
fn mapped(of: &Channel, by: &Matrix4<f64>) -> Channel {
    let sum = |of: &Sum| Sum { looks: of.looks, sum: (by * Vector4::from(of.sum)).into() };
    let past = of.past.each_ref().map(sum);
    Channel { past, today: sum(&of.today), faulty: sum(&of.faulty), ..*of }
}

impl Head {
    /// The head as it was remembered, in the coordinates of `kind`. `from`: where the ring of the
    /// memory's time lies from the present base ring, features.
    pub fn remembered(kind: Kind, of: &HeadMemory, from: &Features) -> Head {
        let mut head = Head::new(kind.clone());

        // The level moves with the ring that it is counted from; channels are counted from the
        // level.
        head.level = kind.to * (Vector4::from(of.level) + from);
        head.covariance = kind.covariance(&matrix(&of.covariance));
        if of.within_looks > 0.0 {
            let covariance = kind.covariance(&matrix(&of.within));
            head.within = Within { covariance, looks: of.within_looks };
        }

        // How many times as far the channels lay from each other as the design says, at least 1.
        // Noise is counted in both: where channels hardly differ, the ratio of what they differ by
        // would be chance.
        let spread = kind.covariance(&matrix(&of.spread)).diagonal();
        head.wider = spread
            .zip_map(&kind.spread, |now, of_design| ((1.0 + now) / (1.0 + of_design)).max(1.0));
        head.heard_ns = of.heard_ns;
        let channels = of.channels.iter();
        head.channels = channels.map(|(k, of)| (*k, mapped(of, &kind.to))).collect();
        head
    }

    /// What is to be remembered of the head. `ring`: the base ring, if no design names it
    /// ([`HeadMemory::ring`]).
    pub fn memory(&self, ring: Option<[f64; 4]>) -> HeadMemory {
        let kind = &self.kind;
        let within = at_least(0.0, &self.within.covariance);
        let spread = Matrix4::from_diagonal(&kind.spread.component_mul(&self.wider));
        let channels = self.channels.iter();
        HeadMemory {
            ring,
            level: self.level().into(),
            covariance: rows(&kind.covariance_from(&self.covariance)),
            heard_ns: self.heard_ns,
            within: rows(&kind.covariance_from(&within)),
            within_looks: self.within.looks,
            spread: rows(&kind.covariance_from(&spread)),
            channels: channels.map(|(k, of)| (*k, mapped(of, &kind.from))).collect(),
        }
    }
}

/// Files of version 2, which hold one level of each channel's past: it is taken for all rungs.
mod second_version {
    use super::{Memory, RUNGS, VERSION};
    use serde_json::{Value, json};

    /// Reads a file of version 2: what it lacks is set to "not known".
    pub fn upgraded(text: &[u8]) -> Result<Memory, serde_json::Error> {
        let mut of: Value = serde_json::from_slice(text)?;
        of["version"] = json!(VERSION);
        let heads =
            of["printheads"].as_object_mut().into_iter().flat_map(|heads| heads.values_mut());
        let channels = heads.filter_map(|head| {
            // The file's scatter within channels is along directions that it does not name, so it
            // is dropped.
            (head["within"], head["within_looks"]) = (json!(vec![[0.0; 4]; 4]), json!(0.0));
            head["spread"] = json!(vec![[0.0; 4]; 4]);
            head["channels"].as_object_mut()
        });
        for channel in channels.flat_map(|of| of.values_mut()) {
            channel["past"] = json!(vec![channel["past"].clone(); RUNGS]);
            channel["off"] = json!(0.0);
        }
        serde_json::from_value(of)
    }
}

/// Files of version 1, which hold for each channel the mean of its healthy signals, as features
/// from the head's ring: it is taken for all rungs.
mod first_version {
    use super::{Channel, HeadMemory, Memory, RUNGS, Sum, rows};
    use nalgebra::Matrix4;
    use serde::Deserialize;
    use std::collections::BTreeMap;

    #[derive(Deserialize)]
    pub struct Baselines {
        design: Option<String>,
        printheads: BTreeMap<String, Printhead>,
    }

    #[derive(Deserialize)]
    struct Printhead {
        channels: BTreeMap<u32, Baseline>,
    }

    #[derive(Deserialize)]
    struct Baseline {
        signals: f64,
        features: [f64; 4],
    }

    /// Variance of the level: a file of version 1 holds none, and a standard deviation of a tenth
    /// in each feature says next to nothing.
    const UNSURE: f64 = 0.01;

    impl From<Baselines> for Memory {
        fn from(of: Baselines) -> Memory {
            let channel = |(k, of): (u32, Baseline)| {
                let past = Sum { looks: of.signals, sum: of.features.map(|f| f * of.signals) };
                (k, Channel { past: [past; RUNGS], ..Channel::default() })
            };
            let head = |(name, of): (String, Printhead)| {
                let covariance = rows(&Matrix4::from_diagonal_element(UNSURE));
                let channels = of.channels.into_iter().map(channel).collect();
                (name, HeadMemory { covariance, channels, ..HeadMemory::default() })
            };
            let printheads = of.printheads.into_iter().map(head).collect();
            Memory { printheads, ..Memory::new(of.design) }
        }
    }
}
