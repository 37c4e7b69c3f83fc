//! Reads and writes labels as CSV (`schemas/labels.md`): what is true of which channel and when.
//! `train` and `score` read them, `simulate` writes them.
//!
//! In: a CSV with the columns of `HEADER` in any order; further columns are ignored. A row says:
//! from `from` to `to` this channel of this printhead was in this state, with this severity. Out:
//! [`Labels`] of `inkling-core`, which finds the row that holds for a signal. Any mistake in a row
//! is an error that names its line.

use super::file_error::{FileError, line_of};
use super::table_text::{TextError, TextOptions, TextTable};
use super::{part_file, printable, regular_file, result_file};
use chrono::{DateTime, SecondsFormat};
use inkling_core::fault::{HEALTHY, IGNORE};
use inkling_core::labels::{Label, Labels, RecordedSpans, known_states, nearest};
use std::io::{Cursor, Read};
use std::path::Path;

/// Most bytes of labels, which is more than a million rows.
const MOST_BYTES: u64 = 256 << 20;
/// Most rows that are held in memory; each takes some 200 bytes.
const MOST_ROWS: usize = 1 << 22;

/// Largest severity of drying (a factor of viscosity) and of added compliance (relative to the
/// chamber's): far beyond what a channel can still ring with.
const MOST_FACTOR: f64 = 1e3;
const LONGEST_NAME: usize = 1024;

const HEADER: [&str; 6] = ["printhead", "channel", "from", "to", "state", "severity"];

/// Which states labels may have beside `healthy`, `ignore` and the classes of the thesis.
#[derive(Clone, Copy, Debug)]
pub enum States<'a> {
    /// Any state, because the reader asks only what is healthy, or compares with other labels.
    Any,
    /// Only the classes that somebody declared.
    Declared(&'a [&'a str]),
}

/// Reads and checks labels that may have any state. Still refused is a state that differs from a
/// known one only by its case, or that was probably meant as `healthy` or `ignore`.
pub fn read(path: &Path) -> Result<Labels, FileError> {
    read_states(LabelSource::File(path), States::Any)
}

#[derive(Clone, Copy, Debug)]
pub enum LabelSource<'a> {
    File(&'a Path),
    Text(&'a str),
}

impl LabelSource<'_> {
    pub fn name(&self) -> &Path {
        match self {
            LabelSource::File(path) => path,
            LabelSource::Text(_) => Path::new("labels"),
        }
    }
}

pub fn read_states(of: LabelSource, states: States) -> Result<Labels, FileError> {
    match of {
        LabelSource::Text(text) => {
            parse_rows(of.name(), Cursor::new(text.as_bytes().to_vec()), states)
        }
        LabelSource::File(path) => {
            parse_rows(path, regular_file::open(path).map_err(FileError::unread(path))?, states)
        }
    }
}

/// Refuses labels that cannot fit the recordings, because somebody mistyped a printhead, a channel or a time.
pub fn check(path: &Path, labels: &Labels, met: &RecordedSpans) -> Result<(), FileError> {
    let mistaken = |what: String| Err(FileError::mistaken(path, printable::line(&what, 1000)));
    met.mistake(labels).map_or(Ok(()), mistaken)
}

fn parse_rows(path: &Path, from: impl Read + 'static, states: States) -> Result<Labels, FileError> {
    let failed = |e: TextError| match e {
        TextError::Io(e) => FileError::unread(path)(e),
        TextError::NoText { .. } => {
            let (instead, columns) = (result_file::instead(path), HEADER.join(","));
            let what = format!("no labels{instead}; a text in UTF-8 is needed, CSV with {columns}");
            FileError::mistaken(path, what)
        }
    };
    let options = TextOptions { most_bytes: MOST_BYTES, ..TextOptions::default() };
    let mut text = TextTable::open(from, options).map_err(FileError::unread(path))?;
    let header = text.next_record().map_err(failed)?.map(|(_, header)| header).unwrap_or_default();
    let mut places = [0; HEADER.len()];
    for (at, column) in places.iter_mut().zip(HEADER) {
        let place = header.iter().position(|name| name.trim_matches('"') == column);
        *at = place.ok_or_else(|| {
            let columns = HEADER.join(",");
            FileError::mistaken(path, format!("no column `{column}`; labels begin with {columns}"))
        })?;
    }
    let mut rows: Vec<Label> = Vec::new();
    while let Some((line, record)) = text.next_record().map_err(failed)? {
        let mistaken = |what| FileError::Mistaken { place: line_of(path, line), what };
        if rows.len() == MOST_ROWS {
            let what = format!("more than {MOST_ROWS} rows: cut the file into several");
            return Err(mistaken(what));
        }
        let mut fields = places.map(|place| record.get(place).unwrap_or(""));
        // where commas do not separate cells, severities may have one
        let severity = fields[5].replace(',', ".");
        if text.delimiter != b',' {
            fields[5] = &severity;
        }
        let label = parse(fields).map_err(mistaken)?;
        // checking compares with many names, and most rows have the state of the row before
        if rows.last().is_none_or(|before| before.state != label.state) {
            states.check(&label.state).map_err(mistaken)?;
        }
        rows.push(label);
    }
    Ok(Labels::new(rows))
}

impl<'a> States<'a> {
    /// Refuses a state that labels may not have; the error says what was probably meant.
    fn check(self, state: &str) -> Result<(), String> {
        let own: &[&'a str] = match self {
            States::Any => &[],
            States::Declared(own) => own,
        };
        let names = || known_states().map(|name| -> &'a str { name }).chain(own.iter().copied());
        if names().any(|name| name == state) {
            return Ok(());
        }
        let near = nearest(state, names());
        let said = printable::cell(state);
        if matches!(self, States::Any) {
            // classes need not be declared here, but what is healthy must not be lost by a letter
            let meant = near.first().filter(|name| {
                name.eq_ignore_ascii_case(state) || [HEALTHY, IGNORE].contains(*name)
            });
            return match meant {
                Some(meant) => Err(format!("state \"{said}\": write `{meant}`")),
                None => Ok(()),
            };
        }
        let near = match near.is_empty() {
            true => format!("there are {}.", names().collect::<Vec<_>>().join(", ")),
            false => format!("did you mean {}?", near.join(", ")),
        };
        Err(format!(
            "state \"{said}\": nobody has declared such a class; {near} A class of your own is declared by \
             --new-class {said}, or in [isolate.classes] where it is one of the thesis's by another name"
        ))
    }
}

fn parse([printhead, channel, from, to, state, severity]: [&str; 6]) -> Result<Label, String> {
    if printhead.len() > LONGEST_NAME {
        return Err(too_long("printhead", printhead));
    }
    let label = Label {
        printhead: printhead.into(),
        channel: channel.parse().map_err(|()| {
            let said = printable::cell(channel);
            format!("channel \"{said}\": give a number, a range such as 0-20, or *")
        })?,
        from_ns: time("from", from)?,
        to_ns: time("to", to)?,
        state: match state {
            "" => return Err("state is empty: give `healthy`, `ignore` or a fault class".into()),
            state if state.len() > LONGEST_NAME => return Err(too_long("state", state)),
            state => state.into(),
        },
        severity: match severity {
            "" => None,
            s => Some(size(state, s)?),
        },
    };
    match (label.from_ns, label.to_ns) {
        (Some(from), Some(to)) if from > to => Err("`from` is later than `to`".into()),
        _ => Ok(label),
    }
}

fn too_long(column: &str, text: &str) -> String {
    format!("{column} \"{}\": a name of more than {LONGEST_NAME} bytes", printable::cell(text))
}

/// Parses a severity.
fn size(state: &str, text: &str) -> Result<f64, String> {
    let said = printable::cell(text);
    let number = text.parse().ok().filter(|v: &f64| v.is_finite());
    let severity =
        number.ok_or_else(|| format!("severity \"{said}\": give a number or nothing"))?;
    let (least, most, what) = match state {
        "EC" => (0.0, 1.0, "the missing share of density"),
        "PBN" | "BN" => (0.0, 1.0, "the blocked share of the nozzle's cross-section"),
        "AB1" => (0.0, 1.0, "the share of the nozzle's length taken by air"),
        "SDN" | "IDN" | "DDN" => (1.0, MOST_FACTOR, "the viscosity factor in the nozzle"),
        "AB2" | "AB3" => (0.0, MOST_FACTOR, "the added compliance over the chamber's"),
        _ => return Ok(severity),
    };
    if (least..=most).contains(&severity) {
        return Ok(severity);
    }
    Err(format!("severity \"{said}\" of {state}: {what} lies between {least} and {most}"))
}

/// Parses a time, RFC 3339 or whole nanoseconds, to ns since 1970.
fn time(column: &str, text: &str) -> Result<Option<i64>, String> {
    if text.is_empty() {
        return Ok(None);
    }
    let ns = text
        .parse()
        .ok()
        .or_else(|| DateTime::parse_from_rfc3339(text).ok()?.timestamp_nanos_opt());
    ns.map(Some).ok_or_else(|| {
        let text = printable::cell(text);
        format!("{column} \"{text}\": give RFC 3339 (2026-01-31T12:00:00Z), integer ns, or nothing")
    })
}

pub fn write(path: &Path, labels: &[Label]) -> Result<(), FileError> {
    let rfc_3339 = |time: DateTime<_>| time.to_rfc3339_opts(SecondsFormat::Nanos, true);
    let time =
        |ns: Option<i64>| ns.map(DateTime::from_timestamp_nanos).map_or(String::new(), rfc_3339);
    let row = |label: &Label| {
        [
            label.printhead.clone(),
            label.channel.to_string(),
            time(label.from_ns),
            time(label.to_ns),
            label.state.clone(),
            label.severity.map_or(String::new(), |s| s.to_string()),
        ]
    };
    let failed = FileError::unwritten(path);
    let mut text = csv::Writer::from_writer(Vec::new());
    text.write_record(HEADER).map_err(|e| failed(e.into()))?;
    for row in labels.iter().map(row) {
        text.write_record(row).map_err(|e| failed(e.into()))?;
    }
    let bytes = text.into_inner().map_err(|e| failed(e.into_error()))?;
    part_file::write(path, &bytes).map_err(failed)
}

#[cfg(test)]
mod tests;
