//! An episode as JSON tells it: keys as in the table of episodes (`schemas/journal.md`).

use crate::pipeline::{Telling, rfc3339};
use crate::verdict::Reason;
use serde_json::{Value, json};

pub fn of(recording: &str, told: Telling) -> Value {
    let (episode, before) = match told {
        Telling::Raised(now) | Telling::Ended(now) => (now, None),
        Telling::Revised { now, before } => (now, Some(before)),
        Telling::Withdrawn(told) => (told, Some(told)),
    };
    let mut event = json!({
        "event": "episode",
        "recording": recording,
        "printhead": &*episode.printhead,
        "channel": episode.channel,
        "category": episode.category,
        "fault": episode.fault,
        "raised_at": rfc3339(episode.raised_at_ns),
        "began_at": rfc3339(episode.began_at_ns),
        "bursts": episode.bursts,
        "certainty": episode.certainty,
        "severity_last": episode.severity_last,
        "severity_sd": episode.severity_sd,
        "resonance_hz": episode.resonance_hz,
        "damping_per_s": episode.damping_per_s,
        "reason": episode.reason.map(Reason::as_str),
        "explanation": episode.explanation,
    });
    if let Some(before) = before {
        let (raised_at, explanation) = (rfc3339(before.raised_at_ns), &before.explanation);
        event["revises"] = json!({
            "raised_at": raised_at,
            "category": before.category,
            "fault": before.fault,
            "explanation": explanation,
        });
    }
    if let Telling::Withdrawn(_) = told {
        event["event"] = json!("withdrawn");
    }
    event
}
