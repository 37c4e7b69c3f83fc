//! Events of episodes as JSON, as `replay --follow` tells them. The keys are those of the table of episodes
//! (`schemas/journal.md`).

use crate::pipeline::{EpisodeEvent, rfc3339};
use inkling_core::verdict::Reason;
use serde_json::{Value, json};

/// The event as JSON. A revised or withdrawn episode has the earlier one under `revises`.
pub fn of(recording: &str, happened: EpisodeEvent) -> Value {
    // a withdrawn episode is both the one that is told and the one that it revises
    let (episode, before) = match happened {
        EpisodeEvent::Raised(now) | EpisodeEvent::Ended(now) => (now, None),
        EpisodeEvent::Revised { now, before } => (now, Some(before)),
        EpisodeEvent::Withdrawn(before) => (before, Some(before)),
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
    if let EpisodeEvent::Withdrawn(_) = happened {
        event["event"] = json!("withdrawn");
    }
    event
}
