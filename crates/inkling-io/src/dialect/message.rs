//! A message of any encoding, and what a path finds in it.
//!
//! In, from `plan.rs`: a message that `protobuf.rs`, `ros.rs` or `json.rs` took as one. Out: a
//! [`Value`], the same for all encodings.

use super::fields::{NANOSECONDS, SECONDS};
use super::json;
use super::path::FieldPath;
use super::protobuf::ProtobufMessage;
use super::ros::RosMessage;
use super::value::Value;

#[derive(Debug)]
pub enum Message {
    Protobuf(ProtobufMessage),
    Ros(RosMessage),
    Json(serde_json::Value),
}

impl Message {
    /// The value to which a path leads; `None`: the message has none there.
    pub fn find(&self, path: &FieldPath) -> Option<Value<'_>> {
        match self {
            Message::Protobuf(message) => message.find(path.steps()),
            Message::Ros(message) => message.find(path.steps()),
            Message::Json(message) => json::find(message, path.steps()),
        }
    }

    fn first(&self, paths: &[FieldPath]) -> Option<Value<'_>> {
        paths.iter().find_map(|path| self.find(path))
    }

    /// What such a message says that is no time.
    pub fn time_in_words(&self, paths: &TimePaths) -> String {
        let word = |paths: &[FieldPath]| match self.first(paths).and_then(|value| value.number()) {
            Some(number) => number.to_string(),
            None => "no".into(),
        };
        let (seconds, nanoseconds) = (word(&paths.seconds), word(&paths.nanoseconds));
        format!("{seconds} seconds and {nanoseconds} nanoseconds")
    }

    /// The time, ns since 1970, that a message within this one says as seconds and nanoseconds.
    /// `None`: it has neither, or they are no time.
    pub fn time_ns(&self, paths: &TimePaths) -> Option<i64> {
        let (seconds, nanoseconds) = (self.first(&paths.seconds), self.first(&paths.nanoseconds));
        if seconds.is_none() && nanoseconds.is_none() {
            return None;
        }
        let whole = |value: Option<Value>| value.map_or(Some(0), |value| value.number()?.integer());
        let nanoseconds = whole(nanoseconds).filter(|ns| (0..1_000_000_000).contains(ns))?;
        let ns = whole(seconds)?.checked_mul(1_000_000_000)?.checked_add(nanoseconds)?;
        i64::try_from(ns).ok()
    }
}

/// Where the seconds and nanoseconds of a message that is a time may be.
#[derive(Debug)]
pub struct TimePaths {
    seconds: Vec<FieldPath>,
    nanoseconds: Vec<FieldPath>,
}

impl TimePaths {
    /// `path` leads to the message.
    pub fn of(path: &FieldPath) -> TimePaths {
        let children = |names: &[&str]| names.iter().map(|name| path.child(name)).collect();
        TimePaths { seconds: children(&SECONDS), nanoseconds: children(&NANOSECONDS) }
    }
}
