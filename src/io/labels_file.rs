//! Labels as CSV (contract, "In: labels").

use super::part_file::PartFile;
use crate::labels::{Label, Labels};
use chrono::{DateTime, SecondsFormat};
use std::io::Write;
use std::path::{Path, PathBuf};
use thiserror::Error;

const HEADER: [&str; 6] = ["printhead", "channel", "from", "to", "state", "severity"];

#[derive(Debug, Error)]
pub enum LabelsError {
    #[error("{path}: cannot be read: {source}")]
    Read { path: PathBuf, source: csv::Error },
    #[error("{path}: cannot be written: {source}")]
    Write { path: PathBuf, source: std::io::Error },
    #[error(
        "{path}: no column `{column}`; labels begin with \
         printhead,channel,from,to,state,severity"
    )]
    NoColumn { path: PathBuf, column: &'static str },
    #[error("{path}, line {line}: {what}")]
    Row { path: PathBuf, line: u64, what: String },
}

/// Reads and checks labels. Further columns are ignored.
pub fn read(path: &Path) -> Result<Labels, LabelsError> {
    let failed = |source| LabelsError::Read { path: path.into(), source };
    let mut csv = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .flexible(true)
        .from_path(path)
        .map_err(failed)?;
    let header = csv.headers().map_err(failed)?.clone();
    let mut places = [0; HEADER.len()];
    for (place, column) in places.iter_mut().zip(HEADER) {
        *place = header
            .iter()
            .position(|h| h.trim_start_matches('\u{feff}') == column)
            .ok_or(LabelsError::NoColumn { path: path.into(), column })?;
    }
    let mut rows = Vec::new();
    for record in csv.records() {
        let record = record.map_err(failed)?;
        let line = record.position().map_or(0, csv::Position::line);
        let fields = places.map(|place| record.get(place).unwrap_or(""));
        rows.push(parse(fields).map_err(|what| LabelsError::Row {
            path: path.into(),
            line,
            what,
        })?);
    }
    Ok(Labels::new(rows))
}

fn parse([printhead, channel, from, to, state, severity]: [&str; 6]) -> Result<Label, String> {
    let label = Label {
        printhead: printhead.into(),
        channel: match channel {
            "*" => None,
            n => Some(n.parse().map_err(|_| format!("channel \"{n}\": give a number or *"))?),
        },
        from_ns: time("from", from)?,
        to_ns: time("to", to)?,
        state: match state {
            "" => return Err("state is empty: give `healthy` or a fault class".into()),
            state => state.into(),
        },
        severity: match severity {
            "" => None,
            s => Some(
                s.parse()
                    .ok()
                    .filter(|v: &f64| v.is_finite())
                    .ok_or_else(|| format!("severity \"{s}\": give a number or nothing"))?,
            ),
        },
    };
    match (label.from_ns, label.to_ns) {
        (Some(from), Some(to)) if from > to => Err("`from` is later than `to`".into()),
        _ => Ok(label),
    }
}

/// RFC 3339 or integer nanoseconds; empty: unbounded.
fn time(column: &str, text: &str) -> Result<Option<i64>, String> {
    if text.is_empty() {
        return Ok(None);
    }
    let ns = text
        .parse()
        .ok()
        .or_else(|| DateTime::parse_from_rfc3339(text).ok()?.timestamp_nanos_opt());
    ns.map(Some).ok_or_else(|| {
        format!("{column} \"{text}\": give RFC 3339 (2026-01-31T12:00:00Z), integer ns, or nothing")
    })
}

pub fn write(path: &Path, labels: &[Label]) -> Result<(), LabelsError> {
    let failed = |source| LabelsError::Write { path: path.into(), source };
    let mut text = csv::Writer::from_writer(Vec::new());
    let mut put = |fields: [String; 6]| text.write_record(&fields).map_err(|e| failed(e.into()));
    put(HEADER.map(String::from))?;
    for label in labels {
        let time = |ns: Option<i64>| {
            ns.map_or(String::new(), |ns| {
                DateTime::from_timestamp_nanos(ns).to_rfc3339_opts(SecondsFormat::Nanos, true)
            })
        };
        put([
            label.printhead.clone(),
            label.channel.map_or("*".into(), |c| c.to_string()),
            time(label.from_ns),
            time(label.to_ns),
            label.state.clone(),
            label.severity.map_or(String::new(), |s| s.to_string()),
        ])?;
    }
    let bytes = text.into_inner().map_err(|e| failed(e.into_error()))?;
    let (part, mut file) = PartFile::create(path).map_err(failed)?;
    file.write_all(&bytes).map_err(failed)?;
    part.finish(&file).map_err(failed)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reading(text: &str) -> Result<Labels, LabelsError> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("labels.csv");
        std::fs::write(&path, text).unwrap();
        read(&path)
    }

    #[test]
    fn labels_survive_the_round_trip() {
        let rows = vec![
            Label {
                printhead: "a, \"b\"".into(),
                channel: None,
                from_ns: None,
                to_ns: Some(1_700_000_000_123_456_789),
                state: "healthy".into(),
                severity: None,
            },
            Label {
                printhead: "c".into(),
                channel: Some(7),
                from_ns: Some(-1),
                to_ns: None,
                state: "own class".into(),
                severity: Some(0.25),
            },
        ];
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("labels.csv");
        write(&path, &rows).unwrap();
        assert_eq!(read(&path).unwrap().rows(), rows);
    }

    #[test]
    fn channel_number_beats_star_and_later_beats_earlier() {
        let labels = reading(
            "printhead,channel,from,to,state,severity\n\
             p,3,10,20,EC,\np,3,15,20,BN,0.9\np,*,,,healthy,\n",
        )
        .unwrap();
        let state = |c, t| labels.at("p", c, t).map(|l| l.state.as_str());
        assert_eq!(state(3, 10), Some("EC"));
        assert_eq!(state(3, 15), Some("BN"));
        assert_eq!(state(3, 20), Some("healthy"));
        assert_eq!(state(4, 15), Some("healthy"));
        assert_eq!(labels.at("q", 3, 15), None);
    }

    #[test]
    fn bad_rows_are_named_by_line() {
        for (row, word) in [
            ("p,x,,,healthy,", "channel"),
            ("p,1,yesterday,,healthy,", "yesterday"),
            ("p,1,,,,", "state"),
            ("p,1,,,EC,much", "severity"),
            ("p,1,2,1,EC,", "later"),
        ] {
            let text = format!("printhead,channel,from,to,state,severity\n{row}\n");
            let message = reading(&text).unwrap_err().to_string();
            assert!(message.contains(word) && message.contains("line 2"), "{message}");
        }
        assert!(reading("a,b\n1,2\n").unwrap_err().to_string().contains("printhead"));
    }
}
