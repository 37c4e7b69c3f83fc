//! `inkling replay --follow --rotate SPAN`: parts of the verdict table that can be read while the recording
//! is still being written.

use super::exit::Failure;
use super::output;
use super::progress::thousands;
use super::report::printable_path;
use crate::pipeline::{ClosedPart, rfc3339};
use crate::report::clock;
use inkling_io::objects::in_object_store;
use serde_json::json;
use std::ops::RangeInclusive;
use std::path::Path;
use std::time::Duration;

/// Recording times that a part may have. Shorter ones give more files than anybody reads, and no recording
/// reaches the end of a longer one.
const SPANS: RangeInclusive<Duration> =
    Duration::from_secs(1)..=Duration::from_secs(366 * 24 * 3600);

/// Reads a time span such as `10min` or `1h 30min`.
pub fn span(text: &str) -> Result<Duration, String> {
    let such = "give a span of recording time such as 10min or 1h";
    let span = humantime::parse_duration(text).map_err(|e| format!("{e}; {such}"))?;
    match SPANS.contains(&span) {
        true => Ok(span),
        false => Err(format!("a part is of 1s to 366days; {such}")),
    }
}

/// Refuses parts where there can be none, with what to do instead.
pub fn check(rotate: Option<Duration>, follow: bool, out: &Path) -> Result<(), Failure> {
    let why = match rotate {
        Some(_) if !follow => {
            "parts are closed while a recording is being written: add --follow; without it the table \
             is there when the run ends"
        }
        Some(_) if in_object_store(out) => {
            "parts are files that go when the recording is closed: give a directory by --out"
        }
        _ => return Ok(()),
    };
    Err(Failure::usage(format!("--rotate: {why}")))
}

/// Tells a part when it is closed.
pub fn tell(recording: &str, part: &ClosedPart, json: bool) -> std::io::Result<()> {
    let path = part.path.to_string_lossy();
    let document = || {
        json!({
            "event": "part",
            "recording": recording,
            "number": part.number,
            "file": path,
            "rows": part.rows,
            "from": rfc3339(part.from_ns),
            "to": rfc3339(part.to_ns),
        })
    };
    output::tell(json, document, || {
        let (from, to) = (clock(part.from_ns), clock(part.to_ns));
        let (rows, path) = (thousands(part.rows), printable_path(&path));
        format!("{to}  part {}, {rows} rows since {from}: {path}", part.number)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_are_of_a_second_to_a_year() {
        assert_eq!(span("10min"), Ok(Duration::from_secs(600)));
        assert_eq!(span("1h 30min"), Ok(Duration::from_secs(5400)));
        for bad in ["", "0", "0s", "999ms", "367days", "9999999years", "10", "soon", "-5min"] {
            let words = span(bad).unwrap_err();
            assert!(words.contains("10min"), "{bad}: {words}");
        }
    }
}
