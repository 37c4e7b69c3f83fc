//! `inkling acknowledge`: says what people know of results, so that it is no news any more: a damaged recording, a
//! replaced channel or printhead, a fault. It appends a line to `acknowledged.csv` beside the results, which people
//! may edit as well (`schemas/acknowledged.md`).
//!
//! In: the options. Out: the line. Whoever tells of results reads all lines by [`read`]; what a line means
//! `report/acknowledged.rs` says.

use super::exit::{Exit, Failure};
use super::output;
use super::progress::complain;
use super::report_page::ACCOUNT_NAME;
use crate::report::{ACKNOWLEDGED_COLUMNS as COLUMNS, Acknowledged, acknowledged_time, clock};
use clap::ArgGroup;
use inkling_core::state::Replaced;
use inkling_io::file_error::FileError;
use inkling_io::journal::{self, Journal};
use inkling_io::regular_file::{self, if_there};
use inkling_io::table_text::{TextError, TextOptions, TextTable};
use inkling_io::{part_file, printable};
use serde_json::Value;
use std::io::Write;
use std::path::{Path, PathBuf};

pub const ACKNOWLEDGED_NAME: &str = "acknowledged.csv";
/// Most bytes of that file that are read: a hundred thousand lines.
const MOST_BYTES: u64 = 16 << 20;
/// Most bytes of an account.
const MOST_ACCOUNT_BYTES: u64 = 1 << 30;
const OPTIONS: TextOptions = TextOptions { skip_lines: 0, comments: true, most_bytes: MOST_BYTES };
/// Most mistakes that are told of one file.
const MOST_MISTAKES: usize = 20;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  inkling acknowledge verdicts --damage n12.mcap --note 'never written'
      its damage is no news any more: not for the exit status, not in the
      mail, not at the top of the page
  inkling acknowledge verdicts --replaced HB:21 --from 2026-11-08
      from that day on the channel begins anew, with its own past where
      there is a state; HB alone means the whole printhead
  inkling acknowledge verdicts --known HA:40 --note 'waits for the spare'
      the fault stays in tables and on the page, marked, and is no news;
      another fault that begins later is

A line of verdicts/acknowledged.csv each: what is removed there counts no longer.")]
#[command(group(ArgGroup::new("what").required(true).args(["damage", "replaced", "known"])))]
pub struct Args {
    /// Directory of results
    out: PathBuf,
    /// A recording that is known to be damaged, empty or not judged: its path, or the end of it
    #[arg(long, value_name = "RECORDING")]
    damage: Option<String>,
    /// A channel, or a whole printhead, that was replaced
    #[arg(long, value_name = "HEAD[:CHANNEL]", requires = "from")]
    replaced: Option<String>,
    /// A channel whose fault is known
    #[arg(long, value_name = "HEAD:CHANNEL")]
    known: Option<String>,
    /// Since when: 2026-01-31, 2026-01-31 12:00 (UTC), or RFC 3339
    #[arg(long, value_name = "TIME", conflicts_with = "damage")]
    from: Option<String>,
    /// With --known: faults that begin from then on are news again [default: now]
    #[arg(long, value_name = "TIME", requires = "known")]
    until: Option<String>,
    /// Kept with it, and told beside it
    #[arg(long, value_name = "TEXT", default_value = "")]
    note: String,
}

/// Runs the verb.
pub fn run(args: Args) -> Result<Exit, Failure> {
    if !args.out.is_dir() {
        let out = args.out.display();
        return Err(Failure::usage(format!(
            "{out}: no directory of results: give that of a replay"
        )));
    }
    let mut cells = cells(&args)?;
    let understood = |cells: &[String; COLUMNS.len()]| {
        let mut all = Acknowledged::default();
        let added = all.add(cells.each_ref().map(|cell| cell.as_str()));
        added.map(|()| all).map_err(Failure::usage)
    };
    let mut checked = understood(&cells)?;
    let journal = Journal::read(&args.out).unwrap_or_default();
    if journal.recordings().next().is_none() {
        complain(&format!("warning: {}: no replay has written results here", args.out.display()));
    } else if args.damage.is_some() {
        match recordings_called(&checked, &journal)?.as_deref() {
            Some(path) => cells[1] = path.to_owned(),
            None => complain("warning: no recording that was judged here is called so"),
        }
        checked = understood(&cells)?;
    }
    append(&args.out.join(ACKNOWLEDGED_NAME), &cells)?;
    let [what, recording, printhead, channel, from, until, _] = &cells;
    if let Some(account) = account(&args.out).filter(|_| args.damage.is_none()) {
        warn_of_the_unknown(&account, printhead, channel, args.known.is_some());
    }
    // where the clock here is behind that of the recordings, these say what is still to come
    let heard_ns = account(&args.out).and_then(|of| latest_ns(&of));
    let is_to_come = |of: &&Replaced| Some(of.from_ns) > now_ns().max(heard_ns);
    if let Some(of) = checked.replaced.iter().find(is_to_come) {
        let from = clock(of.from_ns);
        complain(&format!("warning: {from} is still to come: until then nothing is changed by it"));
    }
    let begin = if args.known.is_some() { ", faults that began" } else { "" };
    let times = [("from", from), ("before", until)].into_iter();
    let times = times.filter(|(_, time)| !time.is_empty());
    let times: String = times.map(|(word, time)| format!(" {word} {time}")).collect();
    let times = if times.is_empty() { times } else { format!("{begin}{times}") };
    let of = match (recording.as_str(), channel.as_str()) {
        ("", "") => format!("all of {printhead}"),
        ("", channel) => format!("{printhead} channel {channel}"),
        (recording, _) => recording.to_owned(),
    };
    let (of, place) = (printable::cell(&of), args.out.join(ACKNOWLEDGED_NAME));
    writeln!(
        output::report(),
        "{what}: {of}{times}; remove its line in {} to undo it",
        place.display()
    )?;
    Ok(Exit::Done)
}

/// As much of the path of the recording that is called so as tells it from all others that were judged, and from those
/// of the same name that come later into another directory. `None`: none is called so; an error if several are.
fn recordings_called(named: &Acknowledged, journal: &Journal) -> Result<Option<String>, Failure> {
    let all = || journal.recordings().map(|of| Path::new(&of.recording.path));
    let is_named = |path: &&Path| named.knows_recording(&path.to_string_lossy()).is_some();
    let mut found: Vec<&Path> = all().filter(is_named).collect();
    found.sort(); // the journal has no order of its own
    match found[..] {
        [] => Ok(None),
        [path] => {
            let ends = path.ancestors().skip(2).filter_map(|above| path.strip_prefix(above).ok());
            let is_its_own = |end: &&Path| all().filter(|of| of.ends_with(end)).count() == 1;
            let end = ends.into_iter().find(is_its_own).unwrap_or(path);
            Ok(Some(end.to_string_lossy().into_owned()))
        }
        [first, second, ..] => Err(Failure::usage(format!(
            "{} recordings are called so, {} and {} among them: give more of the path",
            found.len(),
            printable::cell(&first.to_string_lossy()),
            printable::cell(&second.to_string_lossy())
        ))),
    }
}

/// This moment, ns since 1970; `None` where that cannot be said.
fn now_ns() -> Option<i64> {
    chrono::Utc::now().timestamp_nanos_opt()
}

/// What was told of the results last; `None`: there is no account of them.
fn account(out: &Path) -> Option<Value> {
    let text = regular_file::read(&out.join(ACCOUNT_NAME), MOST_ACCOUNT_BYTES).ok()?;
    serde_json::from_slice(&text).ok()
}

/// The time of the latest signal that an account tells of, ns since 1970.
fn latest_ns(account: &Value) -> Option<i64> {
    acknowledged_time("as_of", account["as_of"].as_str()?).ok()?
}

/// Warns where nothing is told of a printhead or of a channel, since its name is most likely misspelt. The line
/// counts nevertheless: its recordings may come. `is_fault`: what is told must be a fault.
fn warn_of_the_unknown(account: &Value, printhead: &str, channel: &str, is_fault: bool) {
    let mut statements = account["statements"].as_array().into_iter().flatten();
    let is_it = |of: &Value| {
        let is_channel = channel.is_empty() || of["channel"].as_u64() == channel.parse().ok();
        of["printhead"] == printhead && is_channel && (!is_fault || of["fault"].is_object())
    };
    let mut heads = account["printheads"].as_array().into_iter().flatten();
    let is_told = statements.any(is_it);
    let has_signals = heads.any(|of| of["printhead"] == printhead);
    let name = printable::cell(printhead);
    if is_fault && !is_told {
        complain(&format!(
            "warning: no fault of {name} channel {channel} is told of these results"
        ));
    } else if !is_told && !has_signals {
        complain(&format!("warning: these results have no printhead {name}"));
    }
}

/// The cells of the line, in the order of the columns.
fn cells(args: &Args) -> Result<[String; COLUMNS.len()], Failure> {
    let (what, of) = match (&args.damage, &args.replaced, &args.known) {
        (Some(of), ..) => ("damage", of),
        (_, Some(of), _) => ("replaced", of),
        (.., Some(of)) => ("known", of),
        _ => return Err(Failure::usage("give --damage, --replaced or --known")),
    };
    let is_number = |text: &&str| !text.is_empty() && text.bytes().all(|c| c.is_ascii_digit());
    let split = of.rsplit_once(':').filter(|(_, channel)| is_number(channel));
    let (recording, (printhead, channel)) = match what {
        "damage" => (of.as_str(), ("", "")),
        "known" if split.is_none() => {
            let what = "give the printhead and the number of its channel, such as HB:21";
            return Err(Failure::usage(format!("--known {}: {what}", printable::cell(of))));
        }
        _ => ("", split.unwrap_or((of, ""))),
    };
    // a time as reports write it, so that whoever edits the line sees how
    let time = |option: &str, given: &Option<String>| {
        let ns = acknowledged_time(option, given.as_deref().unwrap_or_default());
        Ok::<_, Failure>(ns.map_err(Failure::usage)?.map_or(String::new(), clock))
    };
    let until = match (what, &args.until) {
        // where the clock here is behind that of the recordings, these say what now is
        ("known", None) => match account(&args.out).and_then(|of| latest_ns(&of)) {
            Some(heard_ns) if Some(heard_ns) >= now_ns() => clock(heard_ns + 1_000_000_000),
            _ => journal::now(),
        },
        (_, until) => time("--until", until)?,
    };
    let cells =
        [what, recording, printhead, channel, &time("--from", &args.from)?, &until, &args.note];
    Ok(cells.map(str::to_owned))
}

/// Adds a line to the file, which is made if it is not there; its columns may be in any order.
fn append(path: &Path, cells: &[String; COLUMNS.len()]) -> Result<(), Failure> {
    let there = if_there(regular_file::read(path, MOST_BYTES)).map_err(FileError::unread(path))?;
    let mut text = there.filter(|text| !text.trim_ascii().is_empty());
    let text = text.get_or_insert_with(|| (COLUMNS.join(",") + "\n").into_bytes());
    if std::str::from_utf8(text).is_err() {
        let what = "is not UTF-8 text, so that no line can be added: save it as UTF-8 (CSV UTF-8)";
        return Err(Failure::usage(format!("{}: {what}", path.display())));
    }
    if !text.ends_with(b"\n") {
        text.push(b'\n');
    }
    let mut table = TextTable::open(std::io::Cursor::new(text.clone()), OPTIONS)
        .map_err(FileError::unread(path))?;
    let names = table.next_record().ok().flatten().map(|(_, names)| names).unwrap_or_default();
    let has = |column: &str| names.iter().any(|name| name == column);
    let mut of_cells = COLUMNS.iter().zip(cells);
    if let Some((column, _)) = of_cells.find(|(column, cell)| !cell.is_empty() && !has(column)) {
        let (path, columns) = (path.display(), COLUMNS.join(","));
        let what = format!("no column `{column}`; its first line is to be {columns}");
        return Err(Failure::usage(format!("{path}: {what}")));
    }
    // one line each, whatever the note holds
    let quoted = |cell: &String| match cell.contains([',', ';', '"', '#', '\n', '\r', '\t']) {
        true => format!("\"{}\"", cell.replace('"', "\"\"").replace(['\n', '\r'], " ")),
        false => cell.clone(),
    };
    let cell = |name: &str| COLUMNS.iter().position(|of| *of == name).map(|k| quoted(&cells[k]));
    let line: Vec<String> = names.iter().map(|name| cell(name).unwrap_or_default()).collect();
    text.extend(line.join(&char::from(table.delimiter).to_string()).into_bytes());
    text.push(b'\n');
    part_file::write(path, text).map_err(|e| FileError::unwritten(path)(e).into())
}

/// What is acknowledged in a directory of results; nothing where there is no such file. A file or a line that cannot
/// be understood is told in `mistakes`.
pub fn read(out: &Path) -> Acknowledged {
    let path = out.join(ACKNOWLEDGED_NAME);
    let mut all = Acknowledged::read_at(now_ns());
    let at = |line: u64, what: &str| {
        let place = path.display();
        printable::line(&format!("{place}, line {line}: {what}; the line counts for nothing"), 1000)
    };
    let read = if_there(regular_file::read(&path, MOST_BYTES));
    let text = match read {
        Ok(None) => return all,
        Ok(Some(text)) => std::io::Cursor::new(text),
        Err(e) => {
            let what = format!("{}: cannot be read: {e}; nothing is acknowledged", path.display());
            all.mistakes.push(what);
            return all;
        }
    };
    let Ok(mut table) = TextTable::open(text, OPTIONS) else {
        all.mistakes.push(at(1, "is no text"));
        return all;
    };
    let mut places: Option<[Option<usize>; COLUMNS.len()]> = None;
    while all.mistakes.len() < MOST_MISTAKES {
        let (line, record) = match table.next_record() {
            Ok(None) => break,
            Ok(Some(row)) => row,
            Err(TextError::NoText { line }) => {
                all.mistakes.push(at(line, "is not UTF-8 text: save the file as UTF-8"));
                continue;
            }
            Err(TextError::Io(e)) => {
                all.mistakes.push(at(1, &e.to_string()));
                break;
            }
        };
        if record.iter().all(str::is_empty) {
            continue;
        }
        let Some(places) = &places else {
            let found = COLUMNS.map(|column| record.iter().position(|name| name == column));
            if found[0].is_none() {
                let what = format!("no column `what`: the first line is {}", COLUMNS.join(","));
                all.mistakes.push(at(line, &what));
                break;
            }
            places = Some(found);
            continue;
        };
        let cells = places.map(|place| place.and_then(|k| record.get(k)).unwrap_or_default());
        if let Err(what) = all.add(cells) {
            all.mistakes.push(at(line, &what));
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whatever_lies_there_costs_no_more_than_its_lines() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(ACKNOWLEDGED_NAME);
        let mistakes = |text: &[u8]| {
            std::fs::write(&path, text).unwrap();
            read(dir.path()).mistakes
        };
        let header = COLUMNS.join(",");
        assert!(read(dir.path()).mistakes.is_empty(), "no file");
        assert!(mistakes(b"").is_empty());
        assert!(mistakes(b"\0\xff\xfe PAR1")[0].contains("line 1"));
        assert!(mistakes(b"a,b,c\n1,2,3\n")[0].contains("no column `what`"));
        let mixed = format!("# ours\n{header}\nlost,x\n\ndamage,n1.mcap\nknown,,p,x\n");
        let told = mistakes(mixed.as_bytes());
        assert!(told[0].contains("line 3") && told[1].contains("line 6"), "{told:?}");
        assert!(read(dir.path()).knows_recording("n1.mcap").is_some());
        let quote = format!("{header}\ndamage,\"n1.mcap\n").into_bytes();
        assert!(mistakes(&quote).len() <= 1);
        std::fs::write(&path, header.repeat(1 << 19)).unwrap();
        assert!(read(dir.path()).mistakes[0].contains("cannot be read"));
    }
}
