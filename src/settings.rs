//! The settings of every room ([`Settings`]): the sections of `pipeline.toml` with their defaults,
//! and the check of their values and combinations. [`Settings::load`] (`settings/layers.rs`) makes
//! them from a settings file and of what the command line sets.
//!
//! `pipeline.toml` at the top of the repository explains each key with its unit and its reason.

mod layers;
mod removed;

pub use layers::{Preset, keys};
pub use removed::option as removed_option;

use crate::report::ReportSettings;
use inkling_core::design::{DetectSettings, IsolateSettings};
use inkling_core::episodes::EpisodeSettings;
use inkling_core::identify::GreyBoxSettings;
use inkling_core::model::Geometry;
use inkling_core::ranges::{check, check_between};
use inkling_io::dialect::settings::Dialect;
use inkling_io::dialect::{Dialects, IgnoredTopics};
use inkling_io::layout::Layout;
use inkling_io::verdict_table::TimestampUnit;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};
use std::str::FromStr;
use toml::Value;

/// All settings, one field for each section of `pipeline.toml`. Half of the sections belong to other
/// rooms, which define and check them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    pub input: InputSettings,
    pub identify: IdentifySettings,
    pub detect: DetectSettings,
    pub isolate: IsolateSettings,
    pub episodes: EpisodeSettings,
    pub output: OutputSettings,
    pub replay: ReplaySettings,
    pub report: ReportSettings,
}

/// The section `[input]`: what is read, and how.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct InputSettings {
    /// Files, directories (searched for `*.mcap`) or glob patterns.
    pub recordings: Vec<String>,
    /// Path of the design; empty: there is none, and replay identifies and detects only.
    pub design: String,
    /// Path of the file of `--baseline`, the states of printheads and channels: it is read at the
    /// beginning and replaced after each recording. Empty: no states are kept.
    pub baseline: String,
    /// The rails (lowest and highest value of the converter), counts: two or more consecutive
    /// samples at or beyond a rail are saturated.
    pub rails: [f64; 2],
    /// Topics that look like bursts and are not meant to be read. Other such topics lead to a
    /// warning or to exit status 4, these do not.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub ignore: Vec<String>,
    /// How messages of other loggers become bursts; of several dialects the
    /// first that fits a message is taken.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub dialect: Vec<Dialect>,
}

/// The rails of a converter of 16 bit, counts.
pub const INT16_RAILS: [f64; 2] = [i16::MIN as f64, i16::MAX as f64];

impl Default for InputSettings {
    fn default() -> Self {
        InputSettings {
            recordings: Vec::new(),
            design: String::new(),
            baseline: String::new(),
            rails: INT16_RAILS,
            ignore: Vec::new(),
            dialect: Vec::new(),
        }
    }
}

impl InputSettings {
    /// The dialects, ready to read recordings. They were checked when the settings were.
    pub fn dialects(&self) -> Dialects {
        Dialects::new(&self.dialect).unwrap_or_default()
    }

    /// The topics that nobody wants, ready to match. They were checked when the settings were.
    pub fn ignored(&self) -> IgnoredTopics {
        IgnoredTopics::new(&self.ignore).unwrap_or_default()
    }
}

/// Which models judge where there is a design. Without a design windows give the models.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum IdentifyMode {
    /// Identify models again on the recording's healthy windows.
    Windows,
    /// Judge by the design's models as they are.
    #[default]
    Design,
}

/// The section `[identify]`: from which signals healthy models are learned, and which are accepted.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct IdentifySettings {
    /// Where the models come from.
    pub mode: IdentifyMode,
    /// Path of labels that say which signals of a window are healthy; empty: healthy
    /// signals are found by agreement.
    pub labels: String,
    /// Length of a healthy window, s (or "20 s", "5 min").
    #[serde(deserialize_with = "seconds")]
    pub first: f64,
    /// Least share (0 to 1) of a window's signals that must agree with each other, where no labels
    /// say which signals are healthy. A window in which fewer agree gives no model.
    pub least_agreeing: f64,
    /// Largest relative change (.01 is 1 %) of the resonance at which a window's model is accepted.
    /// It is counted from the design's model.
    pub max_frequency_drift: f64,
    /// Largest relative change of the damping at which a window's model is accepted, counted
    /// likewise.
    pub max_damping_drift: f64,
    /// Whether channels are judged about what moves all of a printhead's channels alike, sweep by sweep. It
    /// has no effect where nothing shows it (another method than sensitivity, a design with an extension, few
    /// channels), and it is always on with `--baseline`.
    pub common_change: bool,
    /// Maximum number of signals of a window that are kept to learn from.
    pub window_signals: usize,
    /// How a model is fitted to an average signal, thesis §3-1.
    pub grey_box: GreyBoxSettings,
    /// Dimensions and ink, if they are known: they give the guess of `grey_box`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub geometry: Option<Geometry>,
}

impl Default for IdentifySettings {
    fn default() -> Self {
        IdentifySettings {
            mode: IdentifyMode::default(),
            labels: String::new(),
            first: 20.0,
            least_agreeing: 0.55,
            max_frequency_drift: 0.01,
            max_damping_drift: 0.10,
            common_change: true,
            window_signals: 8192,
            grey_box: GreyBoxSettings::default(),
            geometry: None,
        }
    }
}

/// The section `[output]`: where results lie, and what they hold.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OutputSettings {
    /// Directory that verdicts are written to.
    pub dir: String,
    /// How files are laid out below `dir`.
    pub layout: Layout,
    /// Whether the verdict table holds, for each signal that was isolated, the weight of every
    /// class.
    pub weights: bool,
    /// Unit of the timestamps in the tables.
    pub timestamps: TimestampUnit,
    /// For which signals resonance and damping are written.
    pub ring: RingsOf,
}

/// The signals whose resonance and damping are in the verdict table.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RingsOf {
    #[default]
    /// Flagged signals alone.
    Flagged,
    /// All signals; of those that are not flagged, the ring is computed in closed form.
    All,
}

impl Default for OutputSettings {
    fn default() -> Self {
        OutputSettings {
            dir: "verdicts".into(),
            layout: Layout::Tree,
            weights: false,
            timestamps: TimestampUnit::Ns,
            ring: RingsOf::Flagged,
        }
    }
}

/// How fast the reader hands bursts on. It is written as `"recorded"`, `"max"` or a number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(into = "Value", try_from = "Value")]
pub enum Pace {
    /// At the speed at which they were recorded.
    Recorded,
    #[default]
    /// As fast as possible.
    Max,
    /// That many signals per second.
    Signals(f64),
}

impl From<Pace> for Value {
    fn from(pace: Pace) -> Value {
        match pace {
            Pace::Recorded => "recorded".into(),
            Pace::Max => "max".into(),
            Pace::Signals(per_s) => per_s.into(),
        }
    }
}

impl TryFrom<Value> for Pace {
    type Error = String;

    fn try_from(written: Value) -> Result<Pace, String> {
        // a string is parsed as it is; a number through its TOML text, so that one parser serves
        // both
        written.as_str().map_or_else(|| written.to_string().parse(), str::parse)
    }
}

impl FromStr for Pace {
    type Err = String;

    fn from_str(text: &str) -> Result<Pace, String> {
        match (text, text.parse::<f64>()) {
            ("recorded", _) => Ok(Pace::Recorded),
            ("max", _) => Ok(Pace::Max),
            (_, Ok(per_s)) if (1.0..=1e12).contains(&per_s) => Ok(Pace::Signals(per_s)),
            _ => Err("give recorded, max, or signals per second such as 1000000".to_owned()),
        }
    }
}

/// The section `[replay]`: how the stages of the pipeline run. Nothing of it changes a verdict.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ReplaySettings {
    /// How fast bursts are handed on.
    pub pace: Pace,
    /// Number of workers per parallel stage; 0: as many as the machine has cores.
    pub threads: usize,
}

impl Settings {
    /// Checks values and their combinations; the error names the setting.
    fn check(&self) -> Result<(), String> {
        let rails = self.input.rails;
        if rails[0] >= rails[1] || rails.iter().any(|v| v.is_nan()) {
            return Err(format!("input.rails = {rails:?}: the lower one first"));
        }
        let Settings { input, output, .. } = self;
        let paths = [&input.design, &input.baseline, &self.identify.labels, &output.dir];
        let of_a_shell = |name: &str| name == "~" || name.starts_with('$');
        let mut paths = paths.into_iter().chain(&input.recordings);
        if let Some(path) = paths.find(|path| path.split('/').any(of_a_shell)) {
            return Err(format!(
                "{path}: `~` and `$NAME` mean something to a shell alone: write the whole path"
            ));
        }
        Dialects::new(&self.input.dialect)?;
        IgnoredTopics::new(&self.input.ignore).map_err(|e| format!("input.ignore: {e}"))?;

        let IdentifySettings { first, least_agreeing, .. } = self.identify;
        let IdentifySettings { max_frequency_drift, max_damping_drift, .. } = self.identify;
        check_between("identify.first", first, 0.0, 1e7)?;
        check_between("identify.least_agreeing", least_agreeing, 0.0, 1.0)?;
        check_between("identify.max_frequency_drift", max_frequency_drift, 0.0, 10.0)?;
        check_between("identify.max_damping_drift", max_damping_drift, 0.0, 10.0)?;
        let signals = self.identify.window_signals;
        check("identify.window_signals", signals, 64..=1_000_000, "64 .. 1000000")?;

        check("replay.threads", self.replay.threads, ..=1024, "at most 1024")?;

        // each room checks its own section; the error gets the section's name
        self.identify.grey_box.check().map_err(|e| format!("identify.grey_box.{e}"))?;
        self.detect.check().map_err(|e| format!("detect.{e}"))?;
        self.episodes.check().map_err(|e| format!("episodes.{e}"))?;
        self.report.check().map_err(|e| format!("report.{e}"))?;
        self.isolate.check().map_err(|e| format!("isolate.{e}"))
    }
}

/// Reads seconds, given as a number or as text with a unit.
fn seconds<'de, D: Deserializer<'de>>(d: D) -> Result<f64, D::Error> {
    #[derive(Deserialize)]
    #[serde(
        untagged,
        expecting = "give seconds as a number, or text such as \"20 s\" or \"5 min\""
    )]
    enum Written {
        Seconds(f64),
        Text(String),
    }
    match Written::deserialize(d)? {
        Written::Seconds(s) => Ok(s),
        Written::Text(text) => humantime::parse_duration(&text)
            .map(|d| d.as_secs_f64())
            .map_err(|e| D::Error::custom(format!("\"{text}\": {e}"))),
    }
}
