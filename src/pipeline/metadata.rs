//! Makes the document that goes with the verdicts, in the Parquet file's metadata and in summary.json
//! (`schemas/verdicts.md` explains its keys).
//!
//! In: from `finish`, a finished recording with its counts and models ([`document`]). Out: a [`Document`], which is
//! serialised to JSON.

use super::judges::Judges;
use super::resume::effective;
use super::run::Replay;
use super::tally::Counts;
use crate::report::rfc3339;
use inkling_core::design::HealthyModel;
use inkling_core::fault::categories;
use inkling_io::recording::Recording;
use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};
use serde_json::{Map, Value, json};

/// Models are serialised directly: as JSON values, thousands of them would take much more memory.
#[derive(Serialize)]
pub struct Document<'a> {
    #[serde(flatten)]
    pub of_run: Map<String, Value>,
    models: Vec<Model<'a>>,
}

/// The keys of the document that the table of episodes has, too.
const OF_EPISODES: [&str; 6] =
    ["version", "recording", "design", "classes", "categories", "counts"];

impl Document<'_> {
    /// The metadata of the table of episodes, as JSON.
    pub fn text_of_episodes(&self) -> serde_json::Result<String> {
        let mut of = self.of_run.clone();
        of.retain(|key, _| OF_EPISODES.contains(&key.as_str()));
        serde_json::to_string(&of)
    }
}

/// The document of a finished recording, the same for any number of threads and any output directory.
pub fn document<'a>(
    replay: &Replay,
    recording: &Recording,
    digest: &str,
    judges: &'a Judges,
    counts: &Counts,
) -> Document<'a> {
    let recording = json!({"name": recording.name, "bytes": recording.bytes, "digest": digest});
    let mut of_run = of(replay, recording);
    of_run.insert("counts".into(), json!(counts));
    let model = |(number, (of, reference_v))| Model { number, of, reference_v };
    let models = (0..=u16::MAX).zip(judges.models()).map(model);
    Document { of_run, models: models.collect() }
}

fn of(replay: &Replay, recording: Value) -> Map<String, Value> {
    let classes = replay.classes();
    let (category_names, _) = categories(&replay.fault_classes());
    // of the settings, those that may change a verdict or a table, and where the labels of windows lie
    let mut settings = effective(&replay.settings);
    settings["identify"]["labels"] = json!(replay.settings.identify.labels);
    settings["input"].as_object_mut().map(|input| input.remove("ignore"));
    settings.as_object_mut().map(|sections| sections.remove("replay"));
    let all = [
        ("version", json!(env!("CARGO_PKG_VERSION"))),
        ("recording", recording),
        ("design", json!(replay.design_digest)),
        ("settings", settings),
        ("classes", json!(classes)),
        ("categories", json!(category_names)),
    ];
    all.into_iter().map(|(key, value)| (key.to_owned(), value)).collect()
}

/// An entry of the document's `models`.
struct Model<'a> {
    /// By this number rows refer to it.
    number: u16,
    of: &'a HealthyModel,
    /// Drive voltage at which it expects its signals, V.
    reference_v: Option<f64>,
}

impl Serialize for Model<'_> {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        let (m, id) = (self.of, &self.of.identification);
        let mut entry = to.serialize_map(None)?;
        entry.serialize_entry("model", &self.number)?;
        entry.serialize_entry("printhead", &m.printhead)?;
        // the first burst of its printhead; null: it is a design's
        entry.serialize_entry("valid_from", &m.valid_from_ns.map(rfc3339))?;
        // a, b, g and d of thesis (2-2)
        entry.serialize_entry("parameters", &id.channel)?;
        entry.serialize_entry("cubic", &id.cubic)?;
        entry.serialize_entry("poles", &id.poles)?;
        entry.serialize_entry("acquisition_state", &id.acquisition_state)?;
        entry.serialize_entry("drive_voltage_v", &self.reference_v)?;
        entry.serialize_entry("temperature_c", &m.temperature_c)?;
        // what a K of temperature changes
        entry.serialize_entry("damping_per_k", &m.damping_per_k)?;
        entry.serialize_entry("frequency_per_k", &m.frequency_per_k)?;
        entry.serialize_entry("uncertainty", &id.uncertainty)?;
        entry.serialize_entry("covariance", &id.uncertainty.cubic_covariance_us)?;
        entry.serialize_entry("held_fixed", &id.held_fixed)?;
        entry.serialize_entry("not_identifiable", &id.not_identifiable)?;
        entry.serialize_entry("at_bounds", &id.at_bounds)?;
        entry.serialize_entry("convergence", &id.convergence)?;
        entry.serialize_entry("fit_percent", &id.fit_percent)?;
        entry.serialize_entry("signals", &m.n_signals)?;
        entry.serialize_entry("channels", &m.n_channels)?;
        entry.serialize_entry("threshold", &m.threshold)?;
        entry.serialize_entry("generator", &m.generator)?;
        entry.end()
    }
}
