//! What is remembered of printheads from one recording to the next: the file of `--baseline`, JSON.
//!
//! In: the states of all heads at the end of a recording, or a file, which is checked, since anybody
//! may have written it. Out: the file's content, or the state that a
//! head begins with. In the file positions are features relative to a ring, so that a memory holds
//! for a model that scatters otherwise, too.

use super::channel::{Channel, Sum};
use super::head::Head;
use super::kind::{Features, Kind, at_least_as_wide};
use super::within::Within;
use nalgebra::{Matrix4, Vector4};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

pub const VERSION: u32 = 4;
/// Channels of all printheads in a file, at most.
pub const MOST_CHANNELS: usize = 1 << 20;
/// Largest number of features or looks that a file may hold.
const MOST: f64 = 1e9;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Memory {
    pub version: u32,
    /// Digest of the design whose models the features are relative to; absent: there was none.
    pub design: Option<String>,
    pub printheads: BTreeMap<String, HeadMemory>,
    /// The replacements that have been heeded, so that each makes its channels begin anew once.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub replaced: Vec<Replaced>,
}

/// A channel, or a whole printhead, that is another one from a time on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Replaced {
    pub printhead: String,
    /// `None`: the whole printhead.
    pub channel: Option<u32>,
    /// ns since 1970.
    pub from_ns: i64,
}

/// What is remembered of one printhead: the fields of [`Head`], in features.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeadMemory {
    /// The ring that features are relative to: amplitude in counts, damping in 1/s, frequency in
    /// Hz, phase in rad. Absent: the design's.
    pub ring: Option<[f64; 4]>,
    pub level: [f64; 4],
    pub covariance: [[f64; 4]; 4],
    pub heard_ns: Option<i64>,
    /// Covariance of looks about their channels, noise included, and how many they are; 0: unknown.
    pub within: [[f64; 4]; 4],
    pub within_looks: f64,
    /// Covariance of the channels about the level, not below the design's spread; 0: not known.
    pub spread: [[f64; 4]; 4],
    /// The channels by their numbers; here their sums are of features.
    pub channels: BTreeMap<u32, Channel>,
}

impl Memory {
    pub fn new(design: Option<String>) -> Memory {
        Memory { version: VERSION, design, printheads: BTreeMap::new(), replaced: Vec::new() }
    }

    /// Forgets what is replaced when a recording begins, `at_ns`, and was not heeded yet. Which of them were is part
    /// of the memory: so a recording that is judged again by the memory of its turn meets the same one.
    pub fn begin_anew(&mut self, replaced: &[Replaced], at_ns: i64) {
        for of in replaced.iter().filter(|of| of.from_ns <= at_ns) {
            if self.replaced.contains(of) {
                continue;
            }
            match (of.channel, self.printheads.get_mut(&of.printhead)) {
                (Some(channel), Some(head)) => drop(head.channels.remove(&channel)),
                (None, Some(_)) => drop(self.printheads.remove(&of.printhead)),
                (_, None) => {}
            }
            self.replaced.push(of.clone());
        }
    }

    pub fn from_json(text: &[u8]) -> Result<Memory, String> {
        #[derive(Deserialize)]
        struct Head {
            version: u32,
        }
        let of_parser = |e: serde_json::Error| e.to_string();
        let Head { version } = serde_json::from_slice(text).map_err(of_parser)?;
        if version != VERSION {
            let whose = if version < VERSION { "an unreleased version" } else { "a newer inkling" };
            return Err(format!("state version {version}, made by {whose}: {VERSION} is read"));
        }
        let memory: Memory = serde_json::from_slice(text).map_err(of_parser)?;
        memory.check()?;
        Ok(memory)
    }

    pub fn channels(&self) -> usize {
        self.printheads.values().map(|of| of.channels.len()).sum()
    }

    fn check(&self) -> Result<(), String> {
        let channels = self.channels();
        if channels.max(self.replaced.len()) > MOST_CHANNELS {
            return Err(format!("{channels} channels: at most {MOST_CHANNELS}"));
        }
        let unsound = self.printheads.iter().find(|(_, of)| !of.is_sound());
        unsound.map_or(Ok(()), |(name, _)| {
            Err(format!("printhead {name}: numbers that no run writes"))
        })
    }
}

impl HeadMemory {
    /// Whether a run may have written these numbers: all in range, and covariances symmetric without
    /// a negative variance (but for rounding).
    fn is_sound(&self) -> bool {
        let bounded = |v: &f64| v.abs() <= MOST;
        let is_covariance = |of: &[[f64; 4]; 4]| {
            let of = matrix(of);
            let rounding = 1e-9 * of.amax();
            of.iter().all(bounded)
                && (of - of.transpose()).amax() <= rounding
                && of.symmetric_eigenvalues().min() >= -rounding
        };
        let sums = |of: &Sum| {
            (0.0..=MOST).contains(&of.looks) && of.sum.iter().chain([&of.kelvins]).all(bounded)
        };
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
            && [&self.covariance, &self.within, &self.spread].into_iter().all(is_covariance)
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
    let sum = |of: &Sum| Sum { sum: (by * Vector4::from(of.sum)).into(), ..*of };
    let past = of.past.each_ref().map(sum);
    Channel { past, today: sum(&of.today), faulty: sum(&of.faulty), ..*of }
}

impl Head {
    /// The head as it was remembered. `from`: features of the memory's ring from the present one.
    pub fn remembered(kind: Kind, of: &HeadMemory, from: &Features) -> Head {
        let mut head = Head::new(kind.clone());

        // the level moves with the ring that it is counted from; channels are counted from the level
        head.level = kind.to * (Vector4::from(of.level) + from);
        head.covariance = kind.covariance(&matrix(&of.covariance));
        if of.within_looks > 0.0 {
            let covariance = kind.covariance(&matrix(&of.within));
            head.within = Within { covariance, looks: of.within_looks };
        }

        // Noise is counted in both: where channels hardly differ, the ratio would be chance.
        let spread = kind.covariance(&matrix(&of.spread)).diagonal();
        head.wider = spread
            .zip_map(&kind.spread, |now, of_design| ((1.0 + now) / (1.0 + of_design)).max(1.0));
        head.heard_ns = of.heard_ns;
        let channels = of.channels.iter();
        head.channels = channels.map(|(k, of)| (*k, mapped(of, &kind.to))).collect();
        head
    }

    /// What is to be remembered of the head. `ring`: the base ring, if no design names it.
    pub fn memory(&self, ring: Option<[f64; 4]>) -> HeadMemory {
        let kind = &self.kind;
        let within = at_least_as_wide(0.0, &self.within.covariance);
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
