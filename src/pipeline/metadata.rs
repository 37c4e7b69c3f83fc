//! The document that goes with the verdicts: in the Parquet file's metadata and in summary.json.

use super::job::{ClosedPart, Replay};
use super::schedule::Schedule;
use super::tally::Counts;
use crate::design::{Judge, categories};
use crate::io::part_tables::{Beginning, PART_KEY};
use crate::io::recording::Recording;
use chrono::{DateTime, SecondsFormat};
use serde_json::{Value, json};

/// The contract's document. The same for any number of threads and any output directory: what does
/// not change a verdict is left out of `settings`.
pub fn document(
    replay: &Replay,
    recording: &Recording,
    digest: &str,
    schedule: &Schedule,
    counts: &Counts,
) -> Value {
    let recording = json!({"name": recording.name, "bytes": recording.bytes, "digest": digest});
    let models = schedule.judges.iter().map(|judge| model(judge)).collect();
    let mut document = of(replay, recording, models);
    document["counts"] = json!(counts);
    document
}

/// The same of a part of the table, while the recording is still being written: as far as it is known.
pub fn of_part<'a>(
    replay: &Replay,
    recording: &Recording,
    begins: &Beginning,
    judges: impl Iterator<Item = &'a Judge>,
    part: &ClosedPart,
) -> Value {
    let recording = json!({"name": recording.name, "begins": begins, "complete": false});
    let models = judges.map(|judge| {
        let mut model = model(judge);
        // of a judge that moves with all channels they are those of a burst
        model.as_object_mut().map(|of| of.remove("poles"));
        model
    });
    let mut document = of(replay, recording, models.collect());
    document[PART_KEY] = json!({
        "number": part.number,
        "rows": part.rows,
        "from": rfc3339(part.from_ns),
        "to": rfc3339(part.to_ns),
    });
    document
}

fn of(replay: &Replay, recording: Value, models: Vec<Value>) -> Value {
    let classes = replay.classes();
    let category_names = categories(&classes);
    let input = &replay.settings.input;
    let mut read = json!({"rails": input.rails});
    if !input.dialect.is_empty() {
        read["dialect"] = json!(input.dialect);
    }
    json!({
        "version": env!("CARGO_PKG_VERSION"),
        "recording": recording,
        "design": replay.design_digest,
        "settings": {
            "input": read,
            "identify": replay.settings.identify,
            "detect": replay.settings.detect,
            "isolate": replay.settings.isolate,
            "episodes": replay.settings.episodes,
            "output": {
                "weights": replay.settings.output.weights,
                "timestamps": replay.settings.output.timestamps,
            },
        },
        "classes": classes,
        "categories": category_names,
        "models": models,
    })
}

fn model(judge: &Judge) -> Value {
    let m = &judge.model;
    let id = &m.identification;
    json!({
        "model": judge.index,
        "printhead": m.printhead,
        "valid_from": m.valid_from_ns.map(rfc3339),
        "parameters": id.channel,
        "cubic": id.cubic,
        "poles": id.poles,
        "acquisition_state": id.acquisition_state,
        "drive_voltage_v": judge.reference_v,
        "temperature_c": m.temperature_c,
        "damping_per_k": m.damping_per_k,
        "frequency_per_k": m.frequency_per_k,
        "uncertainty": id.uncertainty,
        "covariance": id.uncertainty.cubic_covariance_us,
        "held_fixed": id.held_fixed,
        "not_identifiable": id.not_identifiable,
        "at_bounds": id.at_bounds,
        "convergence": id.convergence,
        "fit_percent": id.fit_percent,
        "signals": m.n_signals,
        "channels": m.n_channels,
        "threshold": m.threshold,
        "generator": m.generator,
    })
}

/// ns since the epoch as RFC 3339.
pub fn rfc3339(t_ns: i64) -> String {
    DateTime::from_timestamp_nanos(t_ns).to_rfc3339_opts(SecondsFormat::AutoSi, true)
}
