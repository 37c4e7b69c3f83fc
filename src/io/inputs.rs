//! Which files a command line means.

use globset::{GlobBuilder, GlobMatcher};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};
use thiserror::Error;
use walkdir::WalkDir;

#[derive(Debug, Error)]
pub enum InputsError {
    #[error("{path}: no such file or directory")]
    Missing { path: PathBuf },
    #[error("{path}: {what}")]
    Unreadable { path: PathBuf, what: String },
    #[error("\"{pattern}\" is no valid pattern: {what}")]
    BadPattern { pattern: String, what: String },
    #[error("nothing found: searched {searched} for {what}")]
    Nothing { searched: String, what: &'static str },
    #[error(
        "{first} and {second} would both be written to {verdicts}; \
         replay them separately or rename one"
    )]
    Shared { first: PathBuf, second: PathBuf, verdicts: PathBuf },
}

/// A file, and the directory below which its results go.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Input {
    pub path: PathBuf,
    /// Of a directory's or pattern's files the path below it is kept.
    pub below: PathBuf,
}

/// Recordings: files as named, directories searched for `*.mcap`, or patterns.
pub fn find_recordings(named: &[String]) -> Result<Vec<Input>, InputsError> {
    find(named, ".mcap", "*.mcap files")
}

/// Verdict files, likewise.
pub fn find_verdicts(named: &[String]) -> Result<Vec<Input>, InputsError> {
    find(named, ".verdicts.parquet", "*.verdicts.parquet files")
}

fn find(named: &[String], ending: &str, what: &'static str) -> Result<Vec<Input>, InputsError> {
    let mut found: Vec<Input> = Vec::new();
    let mut seen = BTreeSet::new();
    for name in named {
        let path = Path::new(name);
        let inputs = if path.is_dir() {
            search(path, |p| name_ends(p, ending))?
        } else if path.exists() {
            vec![Input { path: path.into(), below: PathBuf::new() }]
        } else if name.contains(['*', '?', '[', '{']) {
            let (root, matcher) = pattern(name)?;
            search(&root, |p| matcher.is_match(p.strip_prefix("./").unwrap_or(p)))?
        } else {
            return Err(InputsError::Missing { path: path.into() });
        };
        for input in inputs {
            let real = input.path.canonicalize().unwrap_or_else(|_| input.path.clone());
            if seen.insert(real) {
                found.push(input);
            }
        }
    }
    if found.is_empty() {
        return Err(InputsError::Nothing { searched: named.join(", "), what });
    }
    Ok(found)
}

fn name_ends(path: &Path, ending: &str) -> bool {
    path.file_name().is_some_and(|n| n.to_string_lossy().ends_with(ending))
}

fn input_below(root: &Path, path: &Path) -> Input {
    let below = path.strip_prefix(root).ok().and_then(Path::parent).unwrap_or(Path::new(""));
    Input { path: path.to_path_buf(), below: below.to_path_buf() }
}

/// Files below `root`, sorted. Links to directories are followed, loops are not.
fn search(root: &Path, wanted: impl Fn(&Path) -> bool) -> Result<Vec<Input>, InputsError> {
    let mut found = Vec::new();
    for entry in WalkDir::new(root).follow_links(true).sort_by_file_name() {
        let entry = match entry {
            Ok(entry) => entry,
            Err(e) if e.loop_ancestor().is_some() => continue,
            Err(e) => {
                let path = e.path().unwrap_or(root).to_path_buf();
                // A link to nowhere: if it is named like what is searched, reading it will say so,
                // and the others are read all the same.
                if path.is_symlink() {
                    if wanted(&path) && !name_ends(&path, ".part") {
                        found.push(input_below(root, &path));
                    }
                    continue;
                }
                return Err(InputsError::Unreadable { path, what: e.to_string() });
            }
        };
        let path = entry.path();
        let part = name_ends(path, ".part");
        if entry.file_type().is_file() && !part && wanted(path) {
            found.push(input_below(root, path));
        }
    }
    Ok(found)
}

/// The directory that a pattern begins with, and what matches it.
fn pattern(text: &str) -> Result<(PathBuf, GlobMatcher), InputsError> {
    let glob = GlobBuilder::new(text.strip_prefix("./").unwrap_or(text))
        .literal_separator(true)
        .build()
        .map_err(|e| InputsError::BadPattern { pattern: text.into(), what: e.to_string() })?;
    let literal = |c: &Component| !c.as_os_str().to_string_lossy().contains(['*', '?', '[', '{']);
    let root: PathBuf = Path::new(text).components().take_while(literal).collect();
    let root = if root.as_os_str().is_empty() { PathBuf::from(".") } else { root };
    if !root.exists() {
        return Err(InputsError::Missing { path: root });
    }
    Ok((root, glob.compile_matcher()))
}

/// `<out>/<below>/<stem>.verdicts.parquet`.
pub fn verdict_path(out: &Path, input: &Input) -> PathBuf {
    let stem = input.path.file_stem().unwrap_or_default().to_string_lossy();
    out.join(&input.below).join(format!("{stem}.verdicts.parquet"))
}

/// Before anything is written: no two recordings may share a verdict file.
pub fn refuse_shared_verdicts(out: &Path, inputs: &[Input]) -> Result<(), InputsError> {
    let mut taken: BTreeMap<PathBuf, &Path> = BTreeMap::new();
    for input in inputs {
        let verdicts = verdict_path(out, input);
        if let Some(first) = taken.insert(verdicts.clone(), &input.path) {
            return Err(InputsError::Shared {
                first: first.into(),
                second: input.path.clone(),
                verdicts,
            });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tree() -> tempfile::TempDir {
        let dir = tempfile::tempdir().unwrap();
        for name in ["a/x.mcap", "a/b/x.mcap", "a/y.txt", "a/z.mcap.part", "c.mcap"] {
            let path = dir.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, "").unwrap();
        }
        dir
    }

    fn named(dir: &Path, names: &[&str]) -> Result<Vec<Input>, InputsError> {
        let names: Vec<String> =
            names.iter().map(|n| dir.join(n).to_string_lossy().into_owned()).collect();
        find_recordings(&names)
    }

    #[test]
    fn directories_are_searched_and_the_path_below_is_kept() {
        let dir = tree();
        let found = named(dir.path(), &["a"]).unwrap();
        let paths: Vec<PathBuf> = found.iter().map(|i| verdict_path(Path::new("o"), i)).collect();
        let mut paths: Vec<_> = paths.iter().map(|p| p.to_str().unwrap()).collect();
        paths.sort_unstable();
        assert_eq!(paths, ["o/b/x.verdicts.parquet", "o/x.verdicts.parquet"]);
        assert!(refuse_shared_verdicts(Path::new("o"), &found).is_ok());
    }

    #[test]
    fn named_files_are_taken_whatever_their_ending_and_only_once() {
        let dir = tree();
        assert_eq!(named(dir.path(), &["a/y.txt", "a/y.txt"]).unwrap().len(), 1);
        assert_eq!(named(dir.path(), &["a", "a/x.mcap"]).unwrap().len(), 2);
    }

    #[test]
    fn patterns_match_below_their_literal_beginning() {
        let dir = tree();
        assert_eq!(named(dir.path(), &["a/*.mcap"]).unwrap().len(), 1);
        assert_eq!(named(dir.path(), &["**/*.mcap"]).unwrap().len(), 3);
        assert!(matches!(named(dir.path(), &["a/*.log"]), Err(InputsError::Nothing { .. })));
    }

    #[test]
    fn two_recordings_that_would_share_a_verdict_file_are_refused() {
        let dir = tree();
        let both = named(dir.path(), &["a/x.mcap", "a/b/x.mcap"]).unwrap();
        let refused = refuse_shared_verdicts(Path::new("o"), &both);
        assert!(matches!(refused, Err(InputsError::Shared { .. })));
    }

    #[test]
    fn missing_input_is_named() {
        let dir = tree();
        assert!(named(dir.path(), &["nope.mcap"]).unwrap_err().to_string().contains("nope.mcap"));
    }
}
