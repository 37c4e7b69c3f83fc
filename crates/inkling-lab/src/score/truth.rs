//! What a simulation hid in a recording: the contents of the sealed `truth.json`, which a critique must not
//! know, and which [`super::blind`] compares its names with.

use serde::{Deserialize, Serialize};

/// Circumstances that make a recording awkward without being an effect: a critique must not name them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Circumstance {
    /// The channels' frequencies scatter by this standard deviation, relative.
    FrequencyScatter(f64),
    /// Every signal's own frequency scatters by this standard deviation, relative.
    BurstScatter(f64),
    /// Some 6 % of the channels ring faultily all the time.
    FaultyChannels,
    /// The temperature rises linearly over the run, so that nobody can tell the two apart.
    TemperatureFollowsTime,
    /// The noise is Student's t with four degrees of freedom, of the same variance.
    HeavyTails,
}

/// What is true of a recording. Only the effects must be there where it is scored.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Truth {
    #[serde(default)]
    pub version: u32,
    /// A random number, so that the truth cannot be guessed from its digest, which lies beside the recording.
    #[serde(default)]
    pub salt: String,
    #[serde(default)]
    pub seed: u64,
    pub effects: Vec<TrueEffect>,
    #[serde(default)]
    pub circumstances: Vec<Circumstance>,
    /// Number of all signals, and of those of faulty channels.
    #[serde(default)]
    pub signals: usize,
    #[serde(default)]
    pub faulty_signals: usize,
}

/// Its size is `value` in `unit`. Its strength is in detection limits (DL): at 1 DL a test that knows the
/// effect just finds it.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct TrueEffect {
    pub id: String,
    pub in_catalogue: bool,
    /// What `value` is the size of; not needed where the truth is scored.
    #[serde(default)]
    pub parameter: String,
    #[serde(default)]
    pub unit: String,
    pub value: f64,
    pub strength_dl: f64,
    /// Names that an honest critic may leave this effect tied with, its own among them; empty: the
    /// effect can be told from all others.
    #[serde(default)]
    pub ties: Vec<String>,
}
