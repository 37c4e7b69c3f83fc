//! Puts the layers of the settings together.
//!
//! In: the path of a settings file, a preset, and overrides `KEY=VALUE`, from the verbs in `cli`.
//! Out: [`Settings`] whose values and combinations were checked, or a [`FileError`] that names the
//! place and the key of the mistake.
//!
//! There are four layers, of which later ones win: the defaults, the file, `--preset`, the
//! overrides (`--set KEY=VALUE`). All layers are merged in one TOML table, which is turned into
//! [`Settings`] at the end. `cli/replay` also puts what a design keeps of its training before the
//! user's overrides ([`Settings::kept_by_design`]). Unknown keys are refused. Relative paths in a
//! file are relative to that file, those of the later layers to the working directory.

use super::{Settings, removed};
use inkling_core::detect::THESIS_OSCILLATIONS_OF_RING;
use inkling_io::file_error::FileError;
use inkling_io::objects::in_object_store;
use inkling_io::{printable, regular_file};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::Path;
use toml::{Table, Value};

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
        // 1. the file. A value that is out of range there may be overridden later, so the complaint
        // about it is only remembered, to be told with the file's name if it still holds at the end.
        let (mut table, of_file) = file.map_or(Ok(Default::default()), read_file)?;

        // 2. the preset and the overrides replace keys of that table
        for (key, value) in preset.into_iter().flat_map(Preset::overrides) {
            insert(&mut table, key, value, "--preset")?;
        }
        for pair in overrides {
            let place = format!("--set {pair}");
            let both = pair.split_once('=').filter(|(key, _)| !key.trim().is_empty());
            let Some((key, value)) = both.map(|(key, value)| (key.trim(), value.trim())) else {
                return Err(mistaken(place, "expected KEY=VALUE, as detect.mu=2"));
            };
            insert(&mut table, key, value_of(key, value), &place)?;
        }

        // between layers one of these two keys replaces the other (`insert`); within a layer
        // neither is later
        let sets = |key: &str| keys(overrides).any(|set| set == key);
        if sets("detect.oscillations") && sets("detect.oscillations_of_ring") {
            let what = "beside detect.oscillations_of_ring: both say n_o; give one";
            return Err(mistaken("--set detect.oscillations", what));
        }

        // 3. the merged table becomes settings; `place`: where a mistake in it may stand
        let place = match (overrides, file) {
            ([], Some(path)) => path.display().to_string(),
            ([], None) => "settings".into(),
            (pairs, _) => format!("settings with --set {}", pairs.join(" ")),
        };
        removed::setting(&table).map_or(Ok(()), |what| Err(mistaken(&place, what)))?;
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
        settings.check().map_err(|message| match file {
            // the file alone has the same mistake, so the mistake stands in the file
            Some(path) if of_file.as_ref() == Some(&message) => {
                mistaken(path.display().to_string(), message)
            }
            _ => mistaken(place, message),
        })?;
        Ok(settings)
    }
}

/// Reads a settings file into a table, with its paths relative to the working directory, and checks
/// it by itself: the second value is the first mistake among its values.
fn read_file(path: &Path) -> Result<(Table, Option<String>), FileError> {
    let text = regular_file::read_text(path, regular_file::MOST_SETTINGS_BYTES)
        .map_err(FileError::unread(path))?;
    let no_settings = |e: toml::de::Error| {
        let what = printable::of_parser(&e);
        let what =
            format!("{}; a settings file has the sections of pipeline.toml", what.trim_end());
        mistaken(path.display().to_string(), what)
    };
    let mut table = text.parse::<Table>().map_err(no_settings)?;
    let no_longer = |what| Err(mistaken(path.display().to_string(), what));
    removed::setting(&table).map_or(Ok(()), no_longer)?;
    let settings = Settings::deserialize(table.clone()).map_err(no_settings)?;
    root(&mut table, path.parent().unwrap_or(Path::new(".")));
    Ok((table, settings.check().err()))
}

/// A mistake in settings that come from `place` (a file, a preset, an option).
fn mistaken(place: impl Into<String>, what: impl Into<String>) -> FileError {
    FileError::Mistaken { place: place.into(), what: what.into() }
}

/// The dotted keys that overrides set, which are `KEY=VALUE`; of a whole section, such as
/// `output={dir="x"}`, those of the values in it.
pub fn keys(overrides: &[String]) -> impl Iterator<Item = String> {
    let of_pair = |pair: &String| {
        let (key, text) = pair.split_once('=').unwrap_or((pair, ""));
        let mut keys = Vec::new();
        push_keys(key.trim().into(), &value_of(key.trim(), text.trim()), &mut keys);
        keys
    };
    overrides.iter().flat_map(of_pair)
}

/// Adds the keys of the values below `key` to `keys`; `key` itself if there is nothing below it.
fn push_keys(key: String, value: &Value, keys: &mut Vec<String>) {
    match value {
        Value::Table(section) if !section.is_empty() => {
            section.iter().for_each(|(name, v)| push_keys(format!("{key}.{name}"), v, keys));
        }
        _ => keys.push(key),
    }
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
    fn overrides(self) -> [(&'static str, Value); 10] {
        let Preset::Thesis = self;
        [
            ("identify.grey_box.plain_mean", true.into()),
            ("detect.method", "residual-energy".into()),
            ("detect.denominator", "resonance".into()),
            ("detect.oscillations_of_ring", THESIS_OSCILLATIONS_OF_RING.into()),
            ("detect.other_poles_per_s", vec![5e5, 5e5].into()),
            ("detect.threshold", "max".into()),
            ("detect.mu", 1.0.into()),
            ("isolate.method", "residual-matching".into()),
            ("isolate.gate", false.into()),
            ("isolate.certainty", 0.8.into()),
        ]
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
    let defaults = serde_json::to_value(Settings::default()).unwrap_or_default();
    let default = defaults.pointer(&format!("/{}", key.replace('.', "/")));
    let is_text = default.is_some_and(serde_json::Value::is_string);
    let value = literal(text).filter(|value| value.is_str() || !is_text);
    value.unwrap_or_else(|| text.into()) // `--set output.dir=out` needs no quotes
}

/// Reads a value as a TOML literal; `None` if it is none.
fn literal(text: &str) -> Option<Value> {
    // TOML wants a digit before the point, so `.5` is read as `0.5`
    let is_fraction = text.strip_prefix('.').is_some_and(|rest| rest.parse::<u64>().is_ok());
    let digit = if is_fraction { "0" } else { "" };
    format!("v = {digit}{text}").parse::<Table>().ok()?.remove("v")
}

/// Sets the value of a dotted key, and makes the sections that it lies in. `place`: the layer that
/// the key comes from, for errors.
fn insert(table: &mut Table, key: &str, value: Value, place: &str) -> Result<(), FileError> {
    let mut sections: Vec<&str> = key.split('.').collect();
    let last = sections.pop().unwrap_or_default();
    // walk down to the section, and make those that are missing
    let mut at = table;
    for part in sections {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Pace;

    fn with(pairs: &[&str]) -> Result<Settings, FileError> {
        let pairs: Vec<String> = pairs.iter().map(|s| s.to_string()).collect();
        Settings::load(None, None, &pairs)
    }

    #[test]
    fn set_overrides_any_key_and_takes_bare_words() {
        let s = with(&["output.dir=my out", "identify.first=5 min", "detect.mu=2"]).unwrap();
        assert_eq!(s.output.dir, "my out");
        assert_eq!(s.identify.first, 300.0);
        assert_eq!(s.detect.mu, 2.0);
        let s =
            with(&["output.dir=2026-11-01", "input.design=7", "identify.labels=\"8\""]).unwrap();
        assert_eq!((&*s.output.dir, &*s.input.design), ("2026-11-01", "7"));
        assert_eq!(s.identify.labels, "8");
        assert_eq!(with(&["replay.pace=1000"]).unwrap().replay.pace, Pace::Signals(1000.0));
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
