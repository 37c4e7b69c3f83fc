//! Labels files: CSV to [`Labels`] and back (contract, "In: labels").
//!
//! In: CSV with the header `printhead,channel,from,to,state,severity`, columns in any order, others
//! ignored. Out: its labels; or the line that is wrong, and what belongs there.

use super::part_file::PartFile;
use crate::labels::{Label, Labels};
use chrono::{DateTime, SecondsFormat};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use thiserror::Error;

const COLUMNS: [&str; 6] = ["printhead", "channel", "from", "to", "state", "severity"];

#[derive(Debug, Error)]
pub enum LabelsFileError {
    #[error("{path}: {source}")]
    Io { path: PathBuf, source: std::io::Error },
    #[error("{path}: CSV: {source}")]
    Csv { path: PathBuf, source: csv::Error },
    #[error(
        "{path}: line 1: no column `{column}`; the header must be `printhead,channel,from,to,state,severity`"
    )]
    Header { path: PathBuf, column: &'static str },
    #[error("{path}: line {line}: {what}")]
    Row { path: PathBuf, line: u64, what: String },
}

pub fn read_labels(path: &Path) -> Result<Labels, LabelsFileError> {
    let file = std::fs::File::open(path)
        .map_err(|source| LabelsFileError::Io { path: path.to_path_buf(), source })?;
    read_from(std::io::BufReader::new(file), path)
}

fn read_from(reader: impl Read, path: &Path) -> Result<Labels, LabelsFileError> {
    let csv_failed = |source| LabelsFileError::Csv { path: path.to_path_buf(), source };
    let mut reader =
        csv::ReaderBuilder::new().trim(csv::Trim::All).flexible(true).from_reader(reader);
    let header = reader.headers().map_err(csv_failed)?;
    let mut places = [0; COLUMNS.len()];
    for (place, column) in places.iter_mut().zip(COLUMNS) {
        *place = header
            .iter()
            .position(|name| name == column)
            .ok_or_else(|| LabelsFileError::Header { path: path.to_path_buf(), column })?;
    }
    let mut rows = Vec::new();
    for record in reader.records() {
        let record = record.map_err(csv_failed)?;
        let line = record.position().map_or(0, csv::Position::line);
        let cells = places.map(|place| record.get(place).unwrap_or_default());
        let label = label(cells).map_err(|what| LabelsFileError::Row {
            path: path.to_path_buf(),
            line,
            what,
        })?;
        rows.push(label);
    }
    Ok(Labels::new(rows))
}

fn label([printhead, channel, from, to, state, severity]: [&str; 6]) -> Result<Label, String> {
    let channel = match channel {
        "*" => None,
        number => Some(number.parse().map_err(|_| {
            format!("channel `{number}` is neither a channel number nor `*` for all channels")
        })?),
    };
    let (from_ns, to_ns) = (time(from, "from")?, time(to, "to")?);
    if from_ns.zip(to_ns).is_some_and(|(from, to)| from >= to) {
        return Err(format!("from `{from}` is not before to `{to}`; the span holds nothing"));
    }
    if state.is_empty() {
        return Err("state is empty; it is `healthy` or a fault class, such as `EC`".into());
    }
    let severity = match severity {
        "" => None,
        number => Some(number.parse::<f64>().ok().filter(|s| s.is_finite()).ok_or_else(|| {
            format!("severity `{number}` is not a finite number; leave it empty if unknown")
        })?),
    };
    let (printhead, state) = (printhead.to_string(), state.to_string());
    Ok(Label { printhead, channel, from_ns, to_ns, state, severity })
}

/// RFC 3339 or integer nanoseconds since 1970; empty is unbounded.
fn time(text: &str, column: &str) -> Result<Option<i64>, String> {
    if text.is_empty() {
        return Ok(None);
    }
    if let Ok(ns) = text.parse::<i64>() {
        return Ok(Some(ns));
    }
    let time = DateTime::parse_from_rfc3339(text).map_err(|_| {
        format!(
            "{column} `{text}` is no time: write RFC 3339 with a time zone, \
             such as 2026-01-31T12:00:00.5Z, or integer nanoseconds since 1970"
        )
    })?;
    let out_of_range = || format!("{column} `{text}` is beyond the years 1678 to 2261");
    time.timestamp_nanos_opt().map(Some).ok_or_else(out_of_range)
}

/// Writes a labels file, complete under its name or not at all.
pub fn write_labels(path: &Path, labels: &[Label]) -> Result<(), LabelsFileError> {
    let failed = |source| LabelsFileError::Io { path: path.to_path_buf(), source };
    let (part, mut file) = PartFile::create(path).map_err(failed)?;
    let text = to_csv(labels)
        .map_err(|source| LabelsFileError::Csv { path: path.to_path_buf(), source })?;
    file.write_all(&text).map_err(failed)?;
    part.finish(&file).map_err(failed)
}

fn to_csv(labels: &[Label]) -> Result<Vec<u8>, csv::Error> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(COLUMNS)?;
    let time = |ns: Option<i64>| {
        let text =
            |ns| DateTime::from_timestamp_nanos(ns).to_rfc3339_opts(SecondsFormat::Nanos, true);
        ns.map(text).unwrap_or_default()
    };
    for label in labels {
        writer.write_record([
            label.printhead.clone(),
            label.channel.map_or("*".into(), |channel| channel.to_string()),
            time(label.from_ns),
            time(label.to_ns),
            label.state.clone(),
            label.severity.map(|s| s.to_string()).unwrap_or_default(),
        ])?;
    }
    writer.into_inner().map_err(|e| e.into_error().into())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Labels, LabelsFileError> {
        read_from(text.as_bytes(), Path::new("labels.csv"))
    }

    #[test]
    fn labels_survive_write_and_read() {
        let label = |printhead: &str, channel, from_ns, to_ns, severity| Label {
            printhead: printhead.into(),
            channel,
            from_ns,
            to_ns,
            state: "my, \"own\" class".into(),
            severity,
        };
        let labels = [
            label("K1", None, None, None, None),
            label("K,2\nx", Some(7), Some(-1), Some(1_700_000_000_123_456_789), Some(0.1 + 0.2)),
            label("", Some(u32::MAX), Some(i64::MIN), Some(i64::MAX), Some(1e-300)),
        ];
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("labels.csv");
        write_labels(&path, &labels).unwrap();
        assert_eq!(read_labels(&path).unwrap().rows(), labels);
    }

    #[test]
    fn a_header_in_another_order_with_more_columns_a_mark_and_crlf_is_read() {
        let text = "\u{feff}note,state,channel,printhead,severity,to,from\r\nhi, EC ,*,K,,2000-01-01T00:00:00+01:00,5\r\n";
        let labels = read(text).unwrap();
        let row = &labels.rows()[0];
        assert_eq!((row.state.as_str(), row.channel, row.from_ns), ("EC", None, Some(5)));
        assert_eq!(row.to_ns, Some((946_684_800 - 3600) * 1_000_000_000));
    }

    #[test]
    fn errors_name_the_line_and_what_belongs_there() {
        let head = "printhead,channel,from,to,state,severity\nK,*,,,healthy,\n";
        for (row, hint) in [
            ("K,x,,,EC,", "`*` for all channels"),
            ("K,-1,,,EC,", "channel number"),
            ("K,1,yesterday,,EC,", "RFC 3339"),
            ("K,1,2000-01-01T00:00:00,,EC,", "time zone"),
            ("K,1,,9999-01-01T00:00:00Z,EC,", "beyond the years"),
            ("K,1,5,5,EC,", "not before"),
            ("K,1,,,,", "state is empty"),
            ("K,1,,,EC,NaN", "finite"),
            ("K,1,,,EC,much", "leave it empty"),
            ("K", "`*` for all channels"),
        ] {
            let error = read(&format!("{head}{row}\n")).unwrap_err().to_string();
            assert!(error.contains("line 3") && error.contains(hint), "{row}: {error}");
        }
        let error = read("printhead,channel,from,to,severity\n").unwrap_err().to_string();
        assert!(error.contains("`state`"), "{error}");
        assert!(read("").is_err());
        assert!(
            read_from(
                &b"printhead,channel,from,to,state,severity\n\xff,*,,,EC,\n"[..],
                Path::new("l")
            )
            .is_err()
        );
        assert_eq!(read(head).unwrap().rows().len(), 1);
    }
}
