//! Sessions in a shell, kept as text in `tests/golden/`: what a command prints, complains of and ends with is compared
//! line by line, but for times, rates, digests and places.
//!
//! `INKLING_WRITE_GOLDEN=1 cargo test --release transcripts` writes them anew: read the difference before you keep it.
//!
//! ```text
//! = What must hold, as a sentence; it begins with an empty directory, in which sample_logs/ is
//! > a recipe of tests/recipes, which makes an input or shows a result
//! $ a command of the shell; below it what was printed, after ! complaints, and the exit status unless it is 0
//! $ a run in the background & begun; what is done once it has begun a table in out
//! ? 3 a command that must end with this status, and say
//! + these words
//! - and not these
//! ```
#![cfg(target_os = "linux")]

use crate::house::{House, root};
use crate::recipes;
use std::fmt::Write as _;
use std::path::Path;
use std::process::{Command, Output};

macro_rules! transcripts {
    ($($name:ident)*) => { $(#[test] fn $name() { is_as_kept(stringify!($name)); })* };
}

// one test for each file
transcripts! {
    acknowledged annotations batches changes convert evaluation follow formats hostile independent inspect kills labels layouts night nights not_judged outputs own_classes report
    scripts
}

/// A directory in which the sample lies, too.
fn fresh() -> House {
    let house = House::new();
    std::os::unix::fs::symlink(root().join("sample_logs"), house.path("sample_logs")).unwrap();
    house
}

/// Waits until the run in the background has begun a table in `out`, or has ended.
const BEGUN: &str = "begun() { until ls -A out 2>&1 | grep -q '[.]part$'; do kill -0 $! || break; sleep .01; done; }";

fn in_shell(house: &House, command: &str) -> Output {
    let built = Path::new(env!("CARGO_BIN_EXE_inkling")).parent().expect("a directory");
    let path = std::env::var("PATH").unwrap_or_default();
    let mut shell = Command::new("sh");
    shell.args(["-c", &format!("{BEGUN}; {command}")]).current_dir(house.path("."));
    shell.env("PATH", format!("{}:{path}", built.display())).env("LC_ALL", "C");
    shell.output().expect("sh runs")
}

/// Plays a session again, and compares what is said with what is kept.
fn is_as_kept(name: &str) {
    let path = root().join(format!("tests/golden/{name}.txt"));
    let kept = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{name}: {e}"));
    let (mut house, mut played, mut last) = (fresh(), String::new(), String::new());
    for (at, line) in kept.lines().enumerate() {
        let (kind, of) = line.split_at_checked(2).unwrap_or((line, ""));
        if kind == "  " {
            continue; // what was said when it was written
        }
        writeln!(played, "{line}").unwrap();
        let place = format!("tests/golden/{name}.txt:{}", at + 1);
        match kind {
            "= " => house = fresh(),
            "> " => {
                println!("{place}"); // where a recipe that cannot be followed stands
                write_below(&mut played, &house, &recipes::follow(&house, of), "");
            }
            "$ " => {
                let ended = in_shell(&house, of);
                write_below(&mut played, &house, &String::from_utf8_lossy(&ended.stdout), "");
                write_below(&mut played, &house, &String::from_utf8_lossy(&ended.stderr), "! ");
                match ended.status.code() {
                    Some(0) => {}
                    Some(status) => writeln!(played, "  exit {status}").unwrap(),
                    None => panic!("{place}: killed"),
                }
            }
            "? " => {
                let (status, command) = of.split_once(' ').expect("a status and a command");
                let ended = in_shell(&house, command);
                last = String::from_utf8_lossy(&ended.stdout).into_owned();
                last += &String::from_utf8_lossy(&ended.stderr);
                assert!(!last.contains("panicked"), "{place}: {last}");
                assert_eq!(ended.status.code(), status.parse().ok(), "{place}: {of}\n{last}");
            }
            "+ " => assert!(last.contains(of), "{place}: no \"{of}\" in:\n{last}"),
            "- " => assert!(!last.contains(of), "{place}: \"{of}\" in:\n{last}"),
            _ => assert!(line.is_empty() || line.starts_with('#'), "{place}: {line}"),
        }
    }
    if std::env::var_os("INKLING_WRITE_GOLDEN").is_some() {
        std::fs::write(&path, played).unwrap();
        return;
    }
    let differs = kept.lines().zip(played.lines()).position(|(a, b)| a != b);
    if let Some(at) = differs.or((kept.len() != played.len()).then_some(kept.lines().count())) {
        let from = |text: &str| {
            let some = text.lines().skip(at.saturating_sub(5)).take(15);
            some.collect::<Vec<_>>().join("\n")
        };
        panic!(
            "tests/golden/{name}.txt:{}\nkept:\n{}\nnow:\n{}",
            at + 1,
            from(&kept),
            from(&played)
        );
    }
}

/// Appends what was said to what is played, indented, without what differs from run to run.
fn write_below(played: &mut String, house: &House, said: &str, mark: &str) {
    let here = house.path("").display().to_string();
    for line in said.lines().filter(|line| !line.trim().is_empty()) {
        let line = without_times(&line.replace(&here, "HERE/"));
        let line: String = line
            .chars()
            .flat_map(|c| match c.is_control() {
                true => c.escape_default().collect::<Vec<_>>(),
                false => vec![c],
            })
            .collect();
        writeln!(played, "  {mark}{}", line.trim_end()).unwrap();
    }
}

/// A line with words in the place of rates, seconds, today's times, digests, processes and the version.
fn without_times(line: &str) -> String {
    let mut line = line.replace(env!("CARGO_PKG_VERSION"), "VERSION");
    // `1.2 s, 45 000 signals/s`
    if let Some((before, after)) = line.split_once(" signals/s") {
        let is_number = |c: char| c.is_ascii_digit() || " .".contains(c);
        let before = before.trim_end_matches(is_number).trim_end_matches(" s,");
        line = format!("{} SECONDS, RATE signals/s{after}", before.trim_end_matches(is_number));
    }
    for day in [0, 1] {
        let today = chrono::Utc::now() - chrono::TimeDelta::days(day);
        let today = today.format("%Y-%m-%d").to_string();
        while let Some((before, after)) = line.split_once(&today) {
            let after =
                after.trim_start_matches(|c: char| c.is_ascii_digit() || "T:.Z".contains(c));
            line = format!("{before}NOW{after}");
        }
    }
    let is_digest = |word: &str| {
        let has_letter = word.chars().any(|c| c.is_ascii_alphabetic());
        has_letter && word.len() >= 16 && word.chars().all(|c| c.is_ascii_hexdigit())
    };
    let mut masked = String::new();
    for word in line.split_inclusive(|c: char| !c.is_ascii_alphanumeric()) {
        let (digits, end) = match word.chars().last() {
            Some(last) if !last.is_ascii_alphanumeric() => {
                word.split_at(word.len() - last.len_utf8())
            }
            _ => (word, ""),
        };
        let is_process = masked.ends_with("process ") && digits.parse::<u32>().is_ok();
        masked += match () {
            () if is_digest(digits) => "DIGEST",
            () if is_process => "NUMBER",
            () => digits,
        };
        masked += end;
    }
    masked
}
