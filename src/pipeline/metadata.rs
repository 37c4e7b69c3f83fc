//! Makes the document that goes with the verdicts, in the Parquet file's metadata and in summary.json.

use super::job::{ClosedPart, Replay};
use super::resume::effective;
use super::schedule::Schedule;
use super::tally::Counts;
use chrono::{DateTime, SecondsFormat};
use inkling_core::design::{HealthyModel, Judge};
use inkling_core::detect::ResidualGenerator;
use inkling_core::detect::threshold::Threshold;
use inkling_core::fault::categories;
use inkling_core::identify::identification::{Convergence, Uncertainty};
use inkling_core::model::InkChannel;
use inkling_core::model::ring_down::Poles;
use inkling_io::part_tables::{Beginning, PART_KEY};
use inkling_io::recording::Recording;
use serde::Serialize;
use serde_json::{Map, Value, json};

/// The metadata's document, to which the summary adds how the run went. Models are serialised directly:
/// thousands of them would take much more memory as JSON values.
#[derive(Serialize)]
pub struct Document<'a> {
    #[serde(flatten)]
    pub of_run: Map<String, Value>,
    models: Vec<Model<'a>>,
}

/// The keys that the table of episodes has of it. Models and settings are in the table of verdicts alone.
const OF_EPISODES: [&str; 6] =
    ["version", "recording", "design", "classes", "categories", "counts"];

impl Document<'_> {
    /// The metadata of the table of episodes, as JSON.
    pub fn text_of_episodes(&self) -> serde_json::Result<String> {
        let of: Map<String, Value> = OF_EPISODES
            .iter()
            .filter_map(|key| Some(((*key).to_owned(), self.of_run.get(*key)?.clone())))
            .collect();
        serde_json::to_string(&of)
    }

    /// The metadata of the table of verdicts, as JSON.
    pub fn text(&self) -> serde_json::Result<String> {
        serde_json::to_string(self)
    }
}

/// The document of a finished recording. It is the same for any number of threads and any output directory:
/// what does not change a verdict is left out of `settings`.
pub fn document<'a>(
    replay: &Replay,
    recording: &Recording,
    digest: &str,
    schedule: &'a Schedule,
    counts: &Counts,
) -> Document<'a> {
    let recording = json!({"name": recording.name, "bytes": recording.bytes, "digest": digest});
    let mut of_run = of(replay, recording);
    of_run.insert("counts".into(), json!(counts));
    // the schedule bounds their number
    let models = (0..=u16::MAX).zip(schedule.models());
    let models =
        models.map(|(number, (model, reference_v))| Model::new(number, model, reference_v));
    Document { of_run, models: models.collect() }
}

/// The document of a part of the table, while the recording is still being
/// written: as far as it is known then.
pub fn of_part<'a>(
    replay: &Replay,
    recording: &Recording,
    begins: &Beginning,
    judges: impl Iterator<Item = &'a Judge>,
    part: &ClosedPart,
) -> Document<'a> {
    let recording = json!({"name": recording.name, "begins": begins, "complete": false});
    // the poles of a moved judge would be those of one burst, so they are left out
    let model =
        |of: &'a Judge| Model { poles: None, ..Model::new(of.index, &of.model, of.reference_v) };
    let mut of_run = of(replay, recording);
    let of_part = json!({
        "number": part.number,
        "rows": part.rows,
        "from": rfc3339(part.from_ns),
        "to": rfc3339(part.to_ns),
    });
    of_run.insert(PART_KEY.into(), of_part);
    Document { of_run, models: judges.map(model).collect() }
}

/// What the documents of recordings and of parts have in common.
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
#[derive(Serialize)]
struct Model<'a> {
    /// Its number, by which rows refer to it.
    model: u16,
    printhead: Option<&'a str>,
    /// End of its window; `None`: it is a design's.
    valid_from: Option<String>,
    /// a, b, g and d of thesis (2-2).
    parameters: InkChannel,
    cubic: [f64; 3],
    #[serde(skip_serializing_if = "Option::is_none")]
    poles: Option<Poles>,
    acquisition_state: [f64; 4],
    /// Drive voltage and temperature at which the model expects its signals.
    drive_voltage_v: Option<f64>,
    temperature_c: Option<f64>,
    /// What a K of temperature changes.
    damping_per_k: f64,
    frequency_per_k: f64,
    uncertainty: &'a Uncertainty,
    covariance: [[f64; 3]; 3],
    held_fixed: &'a [String],
    not_identifiable: &'a [String],
    at_bounds: &'a [String],
    convergence: Convergence,
    fit_percent: f64,
    /// Number of signals and of channels that it was learned from.
    signals: usize,
    channels: usize,
    threshold: &'a Threshold,
    generator: &'a ResidualGenerator,
}

impl<'a> Model<'a> {
    /// The entry of a model. `reference_v`: drive voltage at which it expects its signals, V.
    fn new(number: u16, m: &'a HealthyModel, reference_v: Option<f64>) -> Model<'a> {
        let id = &m.identification;
        Model {
            model: number,
            printhead: m.printhead.as_deref(),
            valid_from: m.valid_from_ns.map(rfc3339),
            parameters: id.channel,
            cubic: id.cubic,
            poles: Some(id.poles),
            acquisition_state: id.acquisition_state,
            drive_voltage_v: reference_v,
            temperature_c: m.temperature_c,
            damping_per_k: m.damping_per_k,
            frequency_per_k: m.frequency_per_k,
            uncertainty: &id.uncertainty,
            covariance: id.uncertainty.cubic_covariance_us,
            held_fixed: &id.held_fixed,
            not_identifiable: &id.not_identifiable,
            at_bounds: &id.at_bounds,
            convergence: id.convergence,
            fit_percent: id.fit_percent,
            signals: m.n_signals,
            channels: m.n_channels,
            threshold: &m.threshold,
            generator: &m.generator,
        }
    }
}

/// A time in ns since the epoch, as RFC 3339.
pub fn rfc3339(t_ns: i64) -> String {
    DateTime::from_timestamp_nanos(t_ns).to_rfc3339_opts(SecondsFormat::AutoSi, true)
}
