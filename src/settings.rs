//! Reads `pipeline.toml` into [`Settings`], which hold the settings of every room, and checks them.
//!
//! In: the path of a settings file, a preset, and overrides `KEY=VALUE`, from the verbs in `cli`.
//! Out: [`Settings`] whose values and combinations were checked, or a [`FileError`] that names the
//! place and the key of the mistake.
//!
//! There are four layers, of which later ones win: the defaults, the file, `--preset`, the
//! overrides (`--set KEY=VALUE`). All layers are merged in one TOML table, which is turned into
//! [`Settings`] at the end. `cli/replay.rs` also puts what a design keeps of its training before
//! the user's overrides ([`Settings::kept_by_design`]). Unknown keys are refused. Relative paths in
//! a file are relative to that file, those of the later layers to the working directory.
//!
//! `pipeline.toml` at the top of the repository explains each key with its unit and its reason.

use crate::report::ReportSettings;
use inkling_core::design::{DetectSettings, IsolateSettings};
use inkling_core::episodes::EpisodeSettings;
use inkling_core::identify::GreyBoxSettings;
use inkling_core::model::Geometry;
use inkling_core::ranges::{check, check_between};
use inkling_io::dialect::settings::Dialect;
use inkling_io::dialect::{Dialects, IgnoredTopics};
use inkling_io::file_error::FileError;
use inkling_io::layout::Layout;
use inkling_io::objects::in_object_store;
use inkling_io::verdict_table::TimestampUnit;
use inkling_io::{printable, regular_file};
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};
use std::collections::BTreeMap;
use std::path::Path;
use std::str::FromStr;
use toml::{Table, Value};

/// A mistake in settings that come from `place` (a file, a preset, an option).
fn mistaken(place: impl Into<String>, what: impl Into<String>) -> FileError {
    FileError::Mistaken { place: place.into(), what: what.into() }
}

/// All settings, one field for each section of `pipeline.toml`. Most sections belong to other
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
    /// begin and replaced after each recording. Empty: no states are kept.
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

/// Which models judge where there is a design. Without a design windows give the models, and
/// `replay` refuses the other mode.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum IdentifyMode {
    /// Identify models again on the recording's healthy windows.
    #[default]
    Windows,
    /// Judge by the design's models as they are.
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
    /// Time from the begin of one window to that of the next, s; 0: there is only one window.
    #[serde(deserialize_with = "seconds")]
    pub every: f64,
    /// Healthy windows as [from, to] in RFC 3339, instead of first/every.
    pub spans: Vec<[String; 2]>,
    /// Least share (0 to 1) of a window's signals that must agree with each other, where no labels
    /// say which signals are healthy. A window in which fewer agree gives no model.
    pub least_agreeing: f64,
    /// Largest relative change (.01 is 1 %) of the resonance at which a window's model is accepted.
    /// It is counted from the design's model, or without a design from the first model that was
    /// accepted.
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
    /// Dimensions and ink, if they are known: they give the guess of `grey_box`, and let `identify` state
    /// individual inertances, resistances and the compliance.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub geometry: Option<Geometry>,
}

impl Default for IdentifySettings {
    fn default() -> Self {
        IdentifySettings {
            mode: IdentifyMode::Windows,
            labels: String::new(),
            first: 20.0,
            every: 60.0,
            spans: Vec::new(),
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
    /// Number of workers of single stages; 0: `threads`.
    pub readers: usize,
    pub filters: usize,
    pub isolators: usize,
}

impl Settings {
    /// Reads `file` (if given), then applies the preset and the `KEY=VALUE` overrides, and checks
    /// the result. Of two overrides with one key the later one wins.
    ///
    /// # Errors
    /// [`FileError::Read`] if the file cannot be read; else [`FileError::Mistaken`], with
    /// the file, the preset or the override in which the mistake stands.
    pub fn load(
        file: Option<&Path>,
        preset: Option<Preset>,
        overrides: &[String],
    ) -> Result<Settings, FileError> {
        // 1. the file, as a table. A value that is out of range in the file may be overridden
        // later, so the complaint about it is only remembered, to be told with the file's name if
        // it still holds at the end.
        let mut table = Table::new();
        let mut of_file = None;
        if let Some(path) = file {
            let text = regular_file::read_text(path, regular_file::MOST_SETTINGS_BYTES)
                .map_err(FileError::unread(path))?;
            let no_settings = |what: String| {
                let what = format!("{what}; a settings file has the sections of pipeline.toml");
                mistaken(path.display().to_string(), what)
            };
            table = text
                .parse::<Table>()
                .map_err(|e| no_settings(printable::of_parser(&e).trim_end().to_owned()))?;
            let from_file = Settings::deserialize(table.clone())
                .map_err(|e: toml::de::Error| no_settings(printable::of_parser(&e)))?;
            of_file = from_file.check().err().map(|what| (path, what));
            // now, before later layers are merged in: their paths are relative to the working
            // directory
            root(&mut table, path.parent().unwrap_or(Path::new(".")));
        }

        // 2. the preset and the overrides replace keys of that table
        if let Some(preset) = preset {
            for (key, value) in preset.overrides() {
                insert(&mut table, key, value, "--preset")?;
            }
        }

        for pair in overrides {
            let both = pair.split_once('=').filter(|(key, _)| !key.trim().is_empty());
            let (key, value) = both.ok_or_else(|| {
                mistaken(format!("--set {pair}"), "expected KEY=VALUE, as detect.mu=2")
            })?;
            let (key, value) = (key.trim(), value_of(key.trim(), value.trim()));
            insert(&mut table, key, value, &format!("--set {pair}"))?;
        }

        // between layers one of these two keys replaces the other (`insert`); within a layer
        // neither is later
        let sets = |key: &str| keys(overrides).any(|set| set == key);
        if sets("detect.oscillations") && sets("detect.oscillations_of_ring") {
            return Err(mistaken(
                "--set detect.oscillations",
                "beside detect.oscillations_of_ring: both say n_o; give one",
            ));
        }
        // 3. the merged table becomes settings; `place`: where a mistake in the merged table may
        // stand
        let place = match (overrides, file) {
            ([], Some(path)) => path.display().to_string(),
            ([], None) => "settings".into(),
            (pairs, _) => format!("settings with --set {}", pairs.join(" ")),
        };

        let mut settings =
            Settings::deserialize(table).map_err(|e| mistaken(&place, printable::of_parser(&e)))?;
        if let Some(geometry) = &settings.identify.geometry {
            // the geometry gives the rates a, b, g and d from which the fit starts, thesis
            // (2-3)..(2-5)
            let rates = geometry.ink_channel();
            let guess = &mut settings.identify.grey_box;
            (guess.a_per_s2, guess.b_per_s2) = (rates.a_per_s2, rates.b_per_s2);
            (guess.g_per_s, guess.d_per_s) = (rates.g_per_s, rates.d_per_s);
        }

        // 4. values and combinations are checked once, as merged
        settings.check().map_err(|message| match of_file {
            // the file alone has the same mistake, so the mistake stands in the file
            Some((path, what)) if what == message => mistaken(path.display().to_string(), message),
            _ => mistaken(place, message),
        })?;
        Ok(settings)
    }

    /// Checks values and their combinations; the error names the setting.
    fn check(&self) -> Result<(), String> {
        if self.input.rails[0] >= self.input.rails[1] || self.input.rails.iter().any(|v| v.is_nan())
        {
            return Err(format!("input.rails = {:?}: the lower one first", self.input.rails));
        }

        Dialects::new(&self.input.dialect)?;
        IgnoredTopics::new(&self.input.ignore).map_err(|e| format!("input.ignore: {e}"))?;

        let IdentifySettings { first, every, window_signals, .. } = self.identify;
        check_between("identify.first", first, 0.0, 1e7)?;
        check("identify.every", every, 0.0..1e9, "0 (once) or more, below 1e9 s")?;
        for (key, share, below) in [
            ("identify.least_agreeing", self.identify.least_agreeing, 1.0),
            ("identify.max_frequency_drift", self.identify.max_frequency_drift, 10.0),
            ("identify.max_damping_drift", self.identify.max_damping_drift, 10.0),
        ] {
            check_between(key, share, 0.0, below)?;
        }
        check("identify.window_signals", window_signals, 64..=1_000_000, "64 .. 1000000")?;
        if every > 0.0 && every < first {
            return Err(format!(
                "identify.every = {every:?} is shorter than identify.first = {first:?}: windows would overlap"
            ));
        }

        let replay = &self.replay;
        for (key, n) in [
            ("threads", replay.threads),
            ("readers", replay.readers),
            ("filters", replay.filters),
            ("isolators", replay.isolators),
        ] {
            check(&format!("replay.{key}"), n, ..=1024, "at most 1024")?;
        }

        // each room checks its own section; the error gets the section's name
        self.identify.grey_box.check().map_err(|e| format!("identify.grey_box.{e}"))?;
        self.detect.check().map_err(|e| format!("detect.{e}"))?;
        self.episodes.check().map_err(|e| format!("episodes.{e}"))?;
        self.report.check().map_err(|e| format!("report.{e}"))?;
        self.isolate.check().map_err(|e| format!("isolate.{e}"))
    }
}

/// The keys of overrides, which are `KEY=VALUE`.
pub fn keys(overrides: &[String]) -> impl Iterator<Item = &str> {
    overrides.iter().map(|pair| pair.split_once('=').map_or(&**pair, |(key, _)| key).trim())
}

/// Settings that are paths or lists of paths, by section and key.
const PATHS: [(&str, &str); 5] = [
    ("input", "recordings"),
    ("input", "design"),
    ("input", "baseline"),
    ("identify", "labels"),
    ("output", "dir"),
];

/// Puts `dir` before all paths of the settings (`PATHS`), except those in an object store.
/// Absolute paths stay as they are, as joining them to a directory gives the absolute path.
fn root(table: &mut Table, dir: &Path) {
    let root = |path: &mut Value| match path {
        Value::String(path) if !path.is_empty() && !in_object_store(Path::new(path)) => {
            *path = dir.join(&*path).to_string_lossy().into_owned();
        }
        _ => {}
    };
    for (section, key) in PATHS {
        match table.get_mut(section).and_then(|section| section.get_mut(key)) {
            Some(Value::Array(paths)) => paths.iter_mut().for_each(root),
            Some(path) => root(path),
            None => {}
        }
    }
}

/// Sets of choices that belong together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Preset {
    /// The thesis's own method: the model is identified on the plain mean; the residual energy is
    /// compared with the largest healthy one, thesis (3-4) with mu = 1; residual matching names the
    /// fault, of every signal and not only of flagged ones (Tables 4-3ff). The FD filter's
    /// denominator is the one that reproduces the thesis's figures (n_o = 1.12 f0 T, which is 7.25
    /// for its channels; other poles 5e5 1/s twice). What still differs is marked `Departs:` where
    /// it stands.
    Thesis,
}

impl Preset {
    /// The settings that the preset makes, as dotted key and value.
    fn overrides(self) -> Vec<(&'static str, Value)> {
        match self {
            Preset::Thesis => vec![
                ("identify.grey_box.plain_mean", true.into()),
                ("detect.method", "residual-energy".into()),
                ("detect.denominator", "resonance".into()),
                (
                    "detect.oscillations_of_ring",
                    inkling_core::detect::THESIS_OSCILLATIONS_OF_RING.into(),
                ),
                ("detect.other_poles_per_s", vec![5e5, 5e5].into()),
                ("detect.threshold", "max".into()),
                ("detect.mu", 1.0.into()),
                ("isolate.method", "residual-matching".into()),
                ("isolate.gate", false.into()),
                ("isolate.certainty", 0.8.into()),
            ],
        }
    }
}

/// The keys of `[isolate]` that a design keeps. The classes and densities of isolation are part of it anyway.
const KEPT_OF_ISOLATE: [&str; 6] =
    ["method", "signal", "neighbours", "gate", "certainty", "physics"];

impl Settings {
    /// The settings that a design keeps of its training, beside those of its detection: how windows
    /// are averaged and fitted, and how faults are isolated. They are given as dotted key and
    /// value, as far as the value is not the default. `train` stores them as `Design::chosen`, and
    /// `replay` applies them before its own `--set`, so that a recording is judged as the design
    /// was trained.
    pub fn kept_by_design(&self) -> BTreeMap<String, serde_json::Value> {
        // the settings that may be kept, as dotted keys with their values
        let leaves = |of: &Settings| {
            let all = serde_json::to_value(of).unwrap_or_default();
            let section = |of: &serde_json::Value| of.as_object().cloned().unwrap_or_default();
            let grey_box = section(&all["identify"]["grey_box"]).into_iter();
            let grey_box = grey_box.map(|(key, v)| (format!("identify.grey_box.{key}"), v));
            let isolate = section(&all["isolate"]).into_iter();
            let isolate = isolate.filter(|(key, _)| KEPT_OF_ISOLATE.contains(&key.as_str()));
            let isolate = isolate.map(|(key, v)| (format!("isolate.{key}"), v));
            grey_box.chain(isolate).collect::<BTreeMap<_, _>>()
        };
        let (mut kept, default) = (leaves(self), leaves(&Settings::default()));
        kept.retain(|key, value| default.get(key) != Some(value) && !value.is_null());
        kept
    }
}

/// The value of a key, as an override writes it. A key whose default is a text takes any text as it
/// is: a directory may be called 7 or 2026-11-01, which are a number and a date in TOML.
fn value_of(key: &str, text: &str) -> Value {
    let value = literal(text);
    let defaults = serde_json::to_value(Settings::default()).unwrap_or_default();
    let default = defaults.pointer(&format!("/{}", key.replace('.', "/")));
    match default.is_some_and(serde_json::Value::is_string) && !value.is_str() {
        true => Value::String(text.into()),
        false => value,
    }
}

/// Reads a value as a TOML literal, or else as a plain string: `--set output.dir=out` needs no quotes.
fn literal(text: &str) -> Value {
    // TOML wants a digit before the point, so `.5` is read as `0.5`
    let digit = match text.strip_prefix('.').is_some_and(|rest| rest.parse::<u64>().is_ok()) {
        true => "0",
        false => "",
    };
    format!("v = {digit}{text}")
        .parse::<Table>()
        .ok()
        .and_then(|mut t| t.remove("v"))
        .unwrap_or_else(|| Value::String(text.into()))
}

/// Sets the value of a dotted key, and makes the sections that it lies in. `place`: the layer that
/// the key comes from, for errors.
fn insert(table: &mut Table, key: &str, value: Value, place: &str) -> Result<(), FileError> {
    let (path, last) = match key.rsplit_once('.') {
        Some((path, last)) => (path.split('.').collect(), last),
        None => (Vec::new(), key),
    };
    // walk down to the section, and make those that are missing
    let mut at = table;
    for part in path {
        at = at
            .entry(part)
            .or_insert_with(|| Value::Table(Table::new()))
            .as_table_mut()
            .ok_or_else(|| mistaken(place, format!("{part} is not a section")))?;
    }
    // both keys say n_o: the one of a later layer replaces the one of an earlier layer
    match key {
        "detect.oscillations" => drop(at.remove("oscillations_of_ring")),
        "detect.oscillations_of_ring" => drop(at.remove("oscillations")),
        _ => {}
    }
    at.insert(last.into(), value);
    Ok(())
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

#[cfg(test)]
mod tests {
    use super::*;

    fn with(pairs: &[&str]) -> Result<Settings, FileError> {
        let pairs: Vec<String> = pairs.iter().map(|s| s.to_string()).collect();
        Settings::load(None, None, &pairs)
    }

    #[test]
    fn set_overrides_any_key_and_takes_bare_words() {
        let s = with(&["output.dir=my out", "identify.every=5 min", "detect.mu=2"]).unwrap();
        assert_eq!(s.output.dir, "my out");
        assert_eq!(s.identify.every, 300.0);
        assert_eq!(s.detect.mu, 2.0);
        let s =
            with(&["output.dir=2026-11-01", "input.design=7", "identify.labels=\"8\""]).unwrap();
        assert_eq!((&*s.output.dir, &*s.input.design), ("2026-11-01", "7"));
        assert_eq!(s.identify.labels, "8");
        assert_eq!(with(&["replay.pace=1000"]).unwrap().replay.pace, Pace::Signals(1000.0));
    }

    #[test]
    fn unknown_keys_and_absurd_values_are_refused_by_name() {
        for (pair, word) in [
            ("detect.colour=1", "colour"),
            ("identify.first=-1", "identify.first"),
            ("detect.false_alarm_rate=2", "false_alarm_rate"),
            ("nonsense", "KEY=VALUE"),
            ("identify.every=soon", "soon"),
            ("identify.every=-1", "give 0 (once) or more"),
            ("identify.first=1e300", "= 1e300"),
            ("episodes.false_per_million=1e-300", "= 1e-300"),
            ("identify.grey_box.bound_factor=1e308", "= 1e308"),
            ("isolate.guess_sd=-1e-200", "= -1e-200"),
        ] {
            let message = with(&[pair]).unwrap_err().to_string();
            assert!(message.contains(word), "{pair}: {message}");
        }
    }

    #[test]
    fn paths_in_a_file_are_relative_to_it_and_paths_on_the_command_line_are_not() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("pipeline.toml");
        std::fs::write(&file, "[input]\nrecordings = [\"logs\"]\n[output]\ndir = \"out\"\n")
            .unwrap();
        let s = Settings::load(Some(&file), None, &["output.dir=here".into()]).unwrap();
        assert_eq!(s.input.recordings, [dir.path().join("logs").to_string_lossy()]);
        assert_eq!(s.output.dir, "here");
    }

    #[test]
    fn thesis_preset_sets_the_reproduction() {
        let s = Settings::load(None, Some(Preset::Thesis), &[]).unwrap();
        assert_eq!((s.detect.oscillations, s.detect.oscillations_of_ring), (None, Some(1.12)));
        assert!(!s.isolate.gate && s.identify.grey_box.plain_mean);
        let set = ["detect.oscillations=6.5".to_owned()];
        let s = Settings::load(None, Some(Preset::Thesis), &set).unwrap();
        assert_eq!((s.detect.oscillations, s.detect.oscillations_of_ring), (Some(6.5), None));
    }
}
