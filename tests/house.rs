//! A fresh directory and the inkling command in it.

use crate::recorded::{Verdicts, sample, verdicts, write};
use inkling::burst::Burst;
use inkling::episodes::Episode;
use inkling::io::recording_writer::WriterOptions;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::{Duration, Instant};

/// What takes longer than this hangs. Nothing else is asserted of times.
pub const HANGS: Duration = Duration::from_secs(300);

/// Waits until something holds.
#[track_caller]
pub fn wait_until(what: &str, mut holds: impl FnMut() -> bool) {
    let since = Instant::now();
    while !holds() {
        assert!(since.elapsed() < HANGS, "never: {what}");
        std::thread::sleep(Duration::from_millis(10));
    }
}

pub fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// A text of the repository.
pub fn shipped(path: &str) -> String {
    std::fs::read_to_string(root().join(path)).unwrap_or_else(|e| panic!("{path}: {e}"))
}

/// A JSON file of the repository.
pub fn shipped_json(path: &str) -> serde_json::Value {
    serde_json::from_str(&shipped(path)).unwrap_or_else(|e| panic!("{path}: {e}"))
}

/// What a text has between two others; up to its end where the second does not follow.
#[track_caller]
pub fn between<'a>(text: &'a str, from: &str, to: &str) -> &'a str {
    let (_, rest) = text.split_once(from).unwrap_or_else(|| panic!("no {from:?} in:\n{text}"));
    rest.split(to).next().unwrap_or(rest)
}

/// Labels that say of everything faulty that nothing is learned of it.
pub fn only_healthy(labels: &str) -> String {
    let line = |line: &str| match line.split(',').collect::<Vec<_>>()[..] {
        [head, channel, from, to, state, _] if !["healthy", "state"].contains(&state) => {
            format!("{head},{channel},{from},{to},ignore,\n")
        }
        _ => format!("{line}\n"),
    };
    labels.lines().map(line).collect()
}

/// The physical scenario.
pub fn physics() -> toml::Table {
    shipped("sample_logs/scenarios/physics.toml").parse().unwrap()
}

pub struct House {
    dir: tempfile::TempDir,
}

impl House {
    pub fn new() -> House {
        House { dir: tempfile::tempdir().expect("a temporary directory") }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    /// A path, in directories that are there.
    fn placed(&self, name: &str) -> PathBuf {
        let path = self.path(name);
        std::fs::create_dir_all(path.parent().expect("below the directory")).expect("directory");
        path
    }

    pub fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        let path = self.placed(name);
        std::fs::write(&path, bytes).expect("file written");
        path
    }

    /// A recording of these bursts.
    pub fn record(&self, name: &str, bursts: &[Burst]) {
        write(&self.placed(name), bursts, Default::default());
    }

    /// Likewise in chunks so small that some are whole where it is cut.
    pub fn record_in_chunks(&self, name: &str, bursts: &[Burst]) {
        let chunks = WriterOptions { chunk_bytes: Some(20_000), ..WriterOptions::default() };
        write(&self.placed(name), bursts, chunks);
    }

    /// A file of the sample, under a name of its own.
    pub fn copy(&self, of_sample: &str, name: &str) {
        self.write(name, std::fs::read(sample(of_sample)).expect("a file of the sample"));
    }

    /// The files below a directory, by their paths from it. They may come and go meanwhile, and there may
    /// be no directory.
    pub fn files(&self, dir: &str) -> Vec<String> {
        let root = self.path(dir);
        let (mut dirs, mut files) = (vec![root.clone()], Vec::new());
        while let Some(dir) = dirs.pop() {
            for path in std::fs::read_dir(dir).into_iter().flatten().flatten().map(|e| e.path()) {
                match path.is_dir() {
                    true => dirs.push(path),
                    false => files.push(path.strip_prefix(&root).expect("below").to_owned()),
                }
            }
        }
        files.sort();
        files.iter().map(|path| path.to_string_lossy().into_owned()).collect()
    }

    /// inkling, to be run in the directory; arguments separated by white space. `sample_logs/`, where a
    /// path begins, is the project's.
    pub fn inkling(&self, args: &str) -> Command {
        let resolved = |word: &str| match word.find("sample_logs/") {
            Some(at) if at == 0 || word[..at].ends_with('=') => {
                format!("{}{}/{}", &word[..at], root().display(), &word[at..])
            }
            _ => word.to_owned(),
        };
        let mut command = Command::new(env!("CARGO_BIN_EXE_inkling"));
        command.current_dir(self.dir.path()).args(args.split_whitespace().map(resolved));
        command
    }

    pub fn run(&self, args: &str) -> Ended {
        Ended { args: args.into(), output: self.inkling(args).output().expect("inkling runs") }
    }

    /// The same of any words; `args`: how they are told of.
    pub fn run_words<'a>(&self, args: &str, words: impl Iterator<Item = &'a str>) -> Ended {
        let output = self.inkling("").args(words).output().expect("inkling runs");
        Ended { args: args.into(), output }
    }

    /// Judges recordings by the sample's design; the results are in `out`.
    pub fn replay(&self, args: &str) -> Ended {
        self.replay_to("out", args)
    }

    /// The same with the results in another directory.
    pub fn replay_to(&self, out: &str, args: &str) -> Ended {
        self.run(&format!("replay {args} --design sample_logs/design.json --out {out}"))
    }

    pub fn ok(&self, args: &str) -> String {
        self.run(args).exits(0).stdout()
    }

    pub fn json(&self, args: &str) -> serde_json::Value {
        serde_json::from_str(&self.ok(args)).expect("JSON on stdout")
    }

    pub fn read(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
    }

    pub fn text(&self, name: &str) -> String {
        String::from_utf8(self.read(name)).expect("UTF-8")
    }

    pub fn read_json(&self, name: &str) -> serde_json::Value {
        serde_json::from_slice(&self.read(name)).expect("JSON file")
    }

    /// The table of verdicts of a recording, such as `out/print_run`.
    pub fn verdicts(&self, of: &str) -> Verdicts {
        verdicts(&self.path(&format!("{of}.verdicts.parquet")))
    }

    /// The table of episodes of a recording, such as `out/print_run`.
    pub fn episodes(&self, of: &str) -> Vec<Episode> {
        let table = self.path(&format!("{of}.episodes.parquet"));
        inkling::io::episode_table::read(&table).expect("a table of episodes")
    }

    /// Removes a file, or a directory with all that is in it.
    #[track_caller]
    pub fn remove(&self, name: &str) {
        let path = self.path(name);
        let removed = match path.is_dir() {
            true => std::fs::remove_dir_all(path),
            false => std::fs::remove_file(path),
        };
        removed.unwrap_or_else(|e| panic!("{name}: {e}"));
    }
}

pub struct Ended {
    args: String,
    output: Output,
}

/// Sends a process a signal such as `-INT`.
#[cfg(unix)]
pub fn signal(process: u32, signal: &str) {
    let ended = Command::new("kill").args([signal, &process.to_string()]).status();
    assert!(ended.expect("kill runs").success());
}

impl Ended {
    #[track_caller]
    pub fn exits(self, code: i32) -> Ended {
        assert_eq!(
            self.output.status.code(),
            Some(code),
            "inkling {}\n{}{}",
            self.args,
            self.stdout(),
            self.stderr()
        );
        self
    }

    #[track_caller]
    pub fn says(self, words: &str) -> Ended {
        let said = self.stdout() + &self.stderr();
        assert!(said.contains(words), "inkling {}: no \"{words}\" in:\n{said}", self.args);
        self
    }

    pub fn code(&self) -> Option<i32> {
        self.output.status.code()
    }

    pub fn stdout(&self) -> String {
        String::from_utf8_lossy(&self.output.stdout).into_owned()
    }

    pub fn stderr(&self) -> String {
        String::from_utf8_lossy(&self.output.stderr).into_owned()
    }
}
