//! What is no longer there: options and settings that earlier versions had, each with what to use
//! instead. It is told until version 0.3.
//!
//! In: the name of an option that the command line does not know, or a table of settings. Out: what
//! to use instead, if an earlier version had it.

use toml::{Table, Value};

/// Options of any verb, and what to use instead.
const OPTIONS: [(&str, &str); 9] = [
    (
        "--detectability",
        "train on the same labels; `inkling score --design` says which faults are found",
    ),
    (
        "--doubts",
        "the page and `--json` list what has no name; write what you found into the labels",
    ),
    ("--mu", "--set detect.mu, for `train`; chapter 4 is for the thesis's own"),
    ("--outcomes", "write what you found into the file of `--labels`: later rows win"),
    ("--plot", "the page of `inkling critique` shows what the model leaves of the signals"),
    ("--report", "`score --json` holds the numbers"),
    ("--rotate", "the table is written at the end; `--serve` shows what is going on"),
    ("--threads", "it takes the cores that it is given (`taskset`)"),
    ("--timings", "`timings` and `phases` of the recording's summary.json say where the time went"),
];

/// Settings by their dotted keys, or values of a setting as `key=value`, and what to use instead.
const SETTINGS: [(&str, &str); 10] = [
    (
        "detect.decouple",
        "leave it out: with two other_poles_per_s or more a constant offset shows in its step alone",
    ),
    ("detect.denominator=appendix-a", "method III is `enhanced`"),
    ("detect.denominator=searched", "`resonance` misses no more"),
    ("detect.method=practice", "`inkling thesis` compares with it"),
    (
        "identify.every",
        "leave it out: a head is judged by one window, and what changes afterwards is followed",
    ),
    (
        "identify.spans",
        "label that time healthy (identify.labels), and let identify.first reach it",
    ),
    ("isolate.matching_share", "leave it out: it is .99"),
    ("output.layout=flat", "`tree` lays the recordings of one directory side by side"),
    ("report.rows", "leave it out: the map shows neighbours that fail together"),
    ("report.pitch", "leave it out: the map shows neighbours that fail together"),
];

/// What to use instead of an option, `--doubts`.
pub fn option(name: &str) -> Option<&'static str> {
    OPTIONS.iter().find(|(removed, _)| *removed == name).map(|(_, instead)| *instead)
}

/// The first setting in a table that is no longer there, and what to use instead, in words.
pub fn setting(of: &Table) -> Option<String> {
    let is_in = |(removed, _): &&(&str, &str)| {
        let (key, value) = removed.split_once('=').unwrap_or((removed, ""));
        let found = key.split('.').try_fold(None::<&Value>, |at, part| {
            let next = at.map_or(of.get(part), |section| section.get(part));
            next.map(Some)
        });
        let found = found.flatten();
        found.is_some_and(|found| value.is_empty() || found.as_str() == Some(value))
    };
    let (removed, instead) = SETTINGS.iter().find(is_in)?;
    Some(format!("{removed} is no longer there: {instead}"))
}
