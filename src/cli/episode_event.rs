//! Events of episodes as JSON, as `replay --follow` tells them. The keys are those of the table of episodes
//! (`schemas/journal.md`).

use crate::pipeline::{EpisodeEvent, rfc3339};
use serde_json::{Value, json};

/// The event as JSON. A revised or withdrawn episode has the earlier one under `revises`.
pub fn of(recording: &str, happened: EpisodeEvent) -> Value {
    // a withdrawn episode is both the one that is told and the one that it revises
    let (episode, before) = match happened {
        EpisodeEvent::Raised(now) | EpisodeEvent::Ended(now) => (now, None),
        EpisodeEvent::Revised { now, before } => (now, Some(before)),
        EpisodeEvent::Withdrawn(before) => (before, Some(before)),
    };
    let mut event = json!(episode);
    let untold = ["ended_at", "severity_first", "severity_max"];
    if let Some(keys) = event.as_object_mut() {
        keys.retain(|key, _| !untold.contains(&key.as_str()));
    }
    event["event"] = json!("episode");
    event["recording"] = json!(recording);
    event["raised_at"] = json!(rfc3339(episode.raised_at_ns));
    event["began_at"] = json!(rfc3339(episode.began_at_ns));
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
