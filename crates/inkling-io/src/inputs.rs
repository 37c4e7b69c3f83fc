//! Finds the files that the names on a command line mean. A name is a file, a directory (which is
//! searched), a pattern, or the same in an object store.
//!
//! In, from `src/cli`: names, and whether recordings (`*.mcap`) or verdict tables are searched.
//! Out: [`Input`]s, each file once, and a reason for every name that means no file. Files that are
//! still being written (`.part`) and annotations are never found by a search.

use super::file_error::meant;
use super::input_pattern::{Pattern, WILDCARDS, glob, pattern};
use super::objects::{self, in_object_store};
use super::regular_file::if_there;
use super::result_file::ResultFile;
use super::unread_file;
use globset::GlobMatcher;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::fmt::Display;
use std::io::ErrorKind;
use std::path::{Component, Path, PathBuf};
use thiserror::Error;
use walkdir::WalkDir;

/// Why a name means no file.
#[derive(Debug, Error)]
#[error("{message}")]
pub struct InputsError {
    pub subject: String,
    message: String,
    /// Whether the name itself is wrong: nothing is there, or it is no pattern. It is not where a directory is empty, or a
    /// pattern fits nothing in a directory that is there.
    pub is_usage: bool,
}

impl InputsError {
    fn usage(subject: impl Display, message: String) -> InputsError {
        InputsError { is_usage: true, ..InputsError::failed(subject, message) }
    }

    pub(super) fn failed(subject: impl Display, message: String) -> InputsError {
        InputsError { subject: subject.to_string(), message, is_usage: false }
    }

    pub(super) fn missing(path: &Path) -> InputsError {
        let (name, meant) = (path.display(), meant(path));
        InputsError::usage(&name, format!("{name}: no such file or directory{meant}"))
    }

    fn unsearched(path: &Path, what: impl Display) -> InputsError {
        let path = path.display();
        InputsError::failed(&path, format!("{path}: cannot be searched: {what}"))
    }

    pub(super) fn bad_pattern(pattern: &str, what: impl Display) -> InputsError {
        InputsError::usage(pattern, format!("\"{pattern}\" is {what}"))
    }
}

/// A file that a name on the command line stands for.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Input {
    pub path: PathBuf,
    /// The file's directory relative to the directory that was searched or that the pattern begins
    /// with; empty if the file itself was named. Results of `output.layout = "tree"` have this path, too.
    pub below: PathBuf,
}

/// The files that names stand for, and why names, or directories below them, gave none.
#[derive(Debug, Default)]
pub struct FoundInputs {
    pub inputs: Vec<Input>,
    pub lost: Vec<InputsError>,
    /// Files in searched directories that look like recordings and are not read, with their names and why.
    pub unread: Vec<(PathBuf, String)>,
}

/// It is an error if a name stands for nothing, or if a directory below one cannot be searched.
pub fn find_recordings(named: &[String]) -> Result<Vec<Input>, InputsError> {
    all_there(find_each_recording(named)?)
}

/// Finds recordings like `find_recordings`, but a name that stands for nothing is returned beside
/// the others. It is an error only if all names stand for nothing.
pub fn find_each_recording(named: &[String]) -> Result<FoundInputs, InputsError> {
    find(named, RECORDING, "*.mcap files")
}

/// Finds verdict tables (`*.verdicts.parquet`) like `find_recordings`. What lies in hidden directories is no
/// result: a fleet keeps there what its executors have not finished (`.fleet`).
pub fn find_verdicts(named: &[String]) -> Result<Vec<Input>, InputsError> {
    all_there(find(named, VERDICTS, "*.verdicts.parquet files")?)
}

/// The inputs, or the first reason why one is lost.
pub fn all_there(found: FoundInputs) -> Result<Vec<Input>, InputsError> {
    found.lost.into_iter().next().map_or(Ok(found.inputs), Err)
}

/// A file that is named twice, or by two symbolic links, is taken once. `ending`: how the names of files
/// that a search finds must end; `what`: these files in words, for errors.
fn find(named: &[String], ending: &str, what: &'static str) -> Result<FoundInputs, InputsError> {
    let nothing = |searched: &str| format!("nothing found: searched {searched} for {what}");
    let only = |found: &FoundInputs| match found.unread.first() {
        Some((path, why)) => format!("; there is {}: {why}", path.display()),
        None => String::new(),
    };
    let mut all = FoundInputs::default();
    let mut seen = BTreeSet::new();
    for name in named {
        let mut found = find_one(name, ending).unwrap_or_else(FoundInputs::without);
        found.inputs.retain(|input| ending != VERDICTS || !is_hidden(&input.below));
        if found.inputs.is_empty() && found.lost.is_empty() {
            let message = match name.contains(WILDCARDS) && !Path::new(name).is_dir() {
                true => format!("nothing found: no file fits {name}"),
                false => nothing(name) + &only(&found),
            };
            found.lost.push(InputsError::failed(name, message));
        }
        for input in found.inputs {
            // links and detours lead to the same file
            let real = input.path.canonicalize().unwrap_or_else(|_| input.path.clone());
            if seen.insert(real) {
                all.inputs.push(input);
            }
        }
        all.lost.append(&mut found.lost);
        all.unread.append(&mut found.unread);
    }

    if !all.inputs.is_empty() {
        return Ok(all);
    }
    let first = all.lost.into_iter().next();
    Err(first.unwrap_or_else(|| InputsError::failed("", nothing(""))))
}

/// A name is in this order an object's, a directory, an existing file, a pattern. So an existing
/// file with a `*` in its name is never taken for a pattern.
fn find_one(name: &str, ending: &str) -> Result<FoundInputs, InputsError> {
    let path = Path::new(name);
    if name.is_empty() {
        let what = "\"\": an empty name is no file; is a variable of the shell empty?";
        return Err(InputsError::usage(name, what.into()));
    }
    if in_object_store(path) {
        return find_objects(name, ending);
    }
    if path.is_dir() {
        return Ok(search(path, usize::MAX, &Wanted::Ending(ending)));
    }
    match path.symlink_metadata() {
        Ok(_) => return Ok(FoundInputs::only(path)),
        Err(e) if e.kind() == ErrorKind::PermissionDenied => {
            return Err(InputsError::unsearched(path, e));
        }
        Err(_) => {}
    }
    if name.contains(WILDCARDS) {
        let Pattern { root, depth, matcher } = pattern(name)?;
        return Ok(search(&root, depth, &Wanted::Fitting(matcher)));
    }
    Err(InputsError::missing(path))
}

/// Finds the objects of one name: the object that is called so, else the objects below it, or those
/// that the pattern fits.
fn find_objects(name: &str, ending: &str) -> Result<FoundInputs, InputsError> {
    let path = Path::new(name);
    let failed = |e: std::io::Error| InputsError::failed(name, format!("{name}: {e}"));
    let (_, rest) = name.split_once("://").unwrap_or_default();
    if rest.split('/').next().is_some_and(|bucket| bucket.contains(WILDCARDS)) {
        let what = "no valid pattern: the bucket has to be named, only keys may have wildcards";
        return Err(InputsError::bad_pattern(name, what));
    }
    // only a name with a key can be an object's
    let may_be_object = rest.contains('/') && !name.ends_with('/');
    if may_be_object && if_there(objects::stamp(path)).map_err(failed)?.is_some() {
        return Ok(FoundInputs::only(path));
    }

    let (root, wanted) = match name.find(WILDCARDS) {
        Some(first) => {
            // what stands before the first wildcard is listed, up to its last slash
            let root = name[..first].rsplit_once('/').map_or(name, |(root, _)| root);
            (Path::new(root), Wanted::Fitting(glob(name)?))
        }
        None => (path, Wanted::Ending(ending)),
    };
    let there = objects::list(root).map_err(failed)?;
    if there.is_empty() && matches!(wanted, Wanted::Ending(_)) {
        return Err(InputsError::missing(path));
    }
    let mut found = FoundInputs::default();
    for object in there {
        // an object that is named like annotations counts as such: looking into each would cost a request
        if !name_ends(&object, ANNOTATIONS) {
            found.add(root, object, &wanted);
        }
    }
    Ok(found)
}

/// Which of the files that are met are inputs.
enum Wanted<'a> {
    /// Those whose names end so.
    Ending(&'a str),
    Fitting(GlobMatcher),
}

impl FoundInputs {
    fn only(path: &Path) -> FoundInputs {
        let inputs = vec![Input { path: path.into(), below: PathBuf::new() }];
        FoundInputs { inputs, ..FoundInputs::default() }
    }

    /// Takes in a file that was met below `root`, or puts it aside if it looks like a recording and is not read.
    fn add(&mut self, root: &Path, path: PathBuf, wanted: &Wanted) {
        let name = name_of(&path);
        let is_input = match wanted {
            _ if name_ends(&path, ".part") => return,
            Wanted::Ending(ending) => name_ends(&path, ending),
            Wanted::Fitting(glob) => glob.is_match(path.strip_prefix("./").unwrap_or(&path)),
        };
        if is_input {
            let below = path.strip_prefix(root).ok().and_then(Path::parent);
            let below = below.unwrap_or(Path::new("")).to_path_buf();
            self.inputs.push(Input { path, below });
        } else if let (Wanted::Ending(RECORDING), Some(why)) = (wanted, unread_file::beside(&name))
        {
            self.unread.push((path, why));
        }
    }

    fn without(lost: InputsError) -> FoundInputs {
        FoundInputs { lost: vec![lost], ..FoundInputs::default() }
    }
}

fn is_hidden(directory: &Path) -> bool {
    let is_hidden = |part: Component| match part {
        Component::Normal(name) => name.as_encoded_bytes().starts_with(b"."),
        _ => false,
    };
    directory.components().any(is_hidden)
}

/// How the names of verdict tables end.
const VERDICTS: &str = ".verdicts.parquet";
/// How the names of recordings end.
const RECORDING: &str = ".mcap";
/// How the names of the files end that `replay --annotate` writes.
const ANNOTATIONS: &str = ".annotations.mcap";

fn is_annotation(path: &Path) -> bool {
    name_ends(path, ANNOTATIONS) && matches!(ResultFile::of(path), Ok(Some(ResultFile::Recording)))
}

fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

fn name_ends(path: &Path, ending: &str) -> bool {
    name_of(path).to_lowercase().ends_with(ending)
}

fn search(root: &Path, depth: usize, wanted: &Wanted) -> FoundInputs {
    let mut found = FoundInputs::default();
    let walk = WalkDir::new(root).follow_links(true).max_depth(depth);
    for entry in walk.sort_by_file_name() {
        let path = match entry {
            Ok(entry) if entry.file_type().is_file() => entry.into_path(),
            Ok(_) => continue,
            Err(e) if e.loop_ancestor().is_some() => continue,
            Err(e) => {
                let path = e.path().unwrap_or(root).to_path_buf();
                let is_denied =
                    e.io_error().is_some_and(|e| e.kind() == ErrorKind::PermissionDenied);
                if is_denied || !path.is_symlink() {
                    let what = e.io_error().map_or(e.to_string(), ToString::to_string);
                    found.lost.push(InputsError::unsearched(&path, what));
                    continue;
                }
                path // a link to nowhere: reading it will say what is wrong
            }
        };
        // macOS keeps the attributes of `a.mcap` in `._a.mcap` on file systems that have none
        let is_attributes = name_of(&path).starts_with("._");
        if !is_attributes && !is_annotation(&path) {
            found.add(root, path, wanted);
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::assert_refused;

    fn tree() -> tempfile::TempDir {
        let dir = tempfile::tempdir().unwrap();
        std::fs::create_dir_all(dir.path().join("a/b")).unwrap();
        for name in [
            "a/x.mcap",
            "a/b/x.MCAP",
            "a/y.txt",
            "a/z.mcap.part",
            "c.mcap",
            "a/w.mcap.zst",
            "a/b/v.bag",
        ] {
            std::fs::write(dir.path().join(name), "").unwrap();
        }
        dir
    }

    fn paths(dir: &Path, names: &[&str]) -> Vec<String> {
        names.iter().map(|n| dir.join(n).to_string_lossy().into_owned()).collect()
    }

    #[test]
    fn files_directories_and_patterns_are_found_once() {
        let dir = tree();
        for (names, files) in [
            (&["a/y.txt", "a/y.txt"][..], 1), // whatever its ending
            (&["a", "a/x.mcap"], 2),
            (&["a/b/.."], 2), // a directory by a detour
            (&["a/*.mcap"], 1),
            (&["**/*.[mM][cC][aA][pP]"], 3),
            (&["a/*"], 3), // what a pattern names is meant
            (&["a//*.mcap"], 1),
            (&["a/./*.mcap"], 1),
            (&["a/[x].mcap"], 1),
            (&["{a,b}/x.mcap"], 1),
            (&["*/x.mcap"], 1),
        ] {
            let found = find_recordings(&paths(dir.path(), names)).unwrap();
            assert_eq!(found.len(), files, "{names:?}");
        }
        std::fs::create_dir_all(dir.path().join("v/.fleet/1")).unwrap();
        for name in ["v/a.verdicts.parquet", "v/.fleet/1/a.verdicts.parquet"] {
            std::fs::write(dir.path().join(name), "").unwrap();
        }
        assert_eq!(find_verdicts(&paths(dir.path(), &["v"])).unwrap().len(), 1);
        let found = find_each_recording(&paths(dir.path(), &["."])).unwrap();
        let unread: Vec<_> = found.unread.iter().filter_map(|(path, _)| path.file_name()).collect();
        assert_eq!(
            (found.inputs.len(), unread),
            (3, vec!["v.bag".as_ref(), "w.mcap.zst".as_ref()])
        );
        let none = find_recordings(&paths(dir.path(), &["a/*.log"])).unwrap_err();
        assert!(!none.is_usage && none.to_string().contains("no file fits"), "{none}");
    }

    #[test]
    fn only_so_deep_as_a_pattern_can_fit_is_searched() {
        let of = |text: &str| {
            let Pattern { root, depth, .. } = pattern(text).unwrap();
            (root, depth)
        };
        assert_eq!(of("./*.mcap"), (".".into(), 1));
        assert_eq!(of("/tmp/*/night?.mcap"), ("/tmp".into(), 2));
        assert_eq!(of("/tmp/**/x.mcap").1, usize::MAX);
        assert_eq!(of("/tmp/{a,b}/night.mcap").1, 2);
        assert_eq!(of("/tmp/{a,b/c}.mcap").1, usize::MAX);
        assert_refused(find_recordings(&["s3://buck*/x.mcap".into()]), &["bucket"]);
    }
}
