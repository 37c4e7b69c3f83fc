//! Which recordings are meant, and where their verdicts go.
//!
//! In: files, directories and glob patterns as the user gave them. Out: [`Input`]s, each file once,
//! in the order given and sorted within a directory or pattern.

use globset::GlobBuilder;
use std::collections::{HashMap, HashSet};
use std::path::{Component, Path, PathBuf};
use thiserror::Error;
use walkdir::WalkDir;

/// A recording to read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Input {
    pub path: PathBuf,
    /// Below the directory that was searched; kept under the output directory.
    pub relative_dir: PathBuf,
}

#[derive(Debug, Error)]
pub enum InputsError {
    #[error("no recording found; searched {searched}")]
    Nothing { searched: String },
    #[error("{path}: no such file or directory")]
    Missing { path: PathBuf },
    #[error("`{pattern}`: not a glob pattern: {source}")]
    Pattern { pattern: String, source: globset::Error },
    #[error("{path}: cannot be searched: {source}")]
    Walk { path: PathBuf, source: walkdir::Error },
    #[error(
        "{first} and {second} would both write {verdicts}; rename one, or give them different --out directories"
    )]
    SameVerdicts { first: PathBuf, second: PathBuf, verdicts: PathBuf },
}

/// Files are taken whatever their name. Directories are searched through for `*.mcap`, glob patterns
/// (`*`, `?`, `[ab]`, `{a,b}`, `**`) for the files they match; both leave out hidden files and `.part`.
pub fn find_recordings(args: &[PathBuf]) -> Result<Vec<Input>, InputsError> {
    let mut found = Vec::new();
    let mut searched = Vec::new();
    for arg in args {
        if arg.is_dir() {
            searched.push(format!("{} (for *.mcap, and below)", arg.display()));
            let mcap =
                |below: &Path| below.extension().is_some_and(|e| e.eq_ignore_ascii_case("mcap"));
            search(arg, mcap, &mut found)?;
        } else if arg.exists() {
            found.push(Input { path: arg.clone(), relative_dir: PathBuf::new() });
        } else if let Some((base, pattern)) = split_glob(arg) {
            searched.push(format!("{} (pattern)", arg.display()));
            let glob = GlobBuilder::new(&pattern)
                .literal_separator(true)
                .build()
                .map_err(|source| InputsError::Pattern {
                    pattern: arg.display().to_string(),
                    source,
                })?
                .compile_matcher();
            let base = if base.as_os_str().is_empty() { PathBuf::from(".") } else { base };
            if base.is_dir() {
                search(&base, |below| glob.is_match(below), &mut found)?;
            }
        } else {
            return Err(InputsError::Missing { path: arg.clone() });
        }
    }
    let mut seen = HashSet::new();
    found.retain(|input| {
        seen.insert(input.path.canonicalize().unwrap_or_else(|_| input.path.clone()))
    });
    if found.is_empty() {
        if searched.is_empty() {
            searched.push("nothing: no recording was named".to_string());
        }
        let searched = searched.join(", ");
        return Err(InputsError::Nothing { searched });
    }
    Ok(found)
}

/// Files below `base` whose path below it is `wanted`, sorted.
fn search(
    base: &Path,
    wanted: impl Fn(&Path) -> bool,
    found: &mut Vec<Input>,
) -> Result<(), InputsError> {
    let visible = |entry: &walkdir::DirEntry| {
        let hidden = entry.file_name().to_string_lossy().starts_with('.');
        entry.depth() == 0 || !hidden
    };
    let walk = WalkDir::new(base).follow_links(true).sort_by_file_name().into_iter();
    for entry in walk.filter_entry(visible) {
        let entry = match entry {
            Ok(entry) => entry,
            // A link back up: everything in it is found anyway.
            Err(e) if e.loop_ancestor().is_some() => continue,
            Err(source) => {
                let path = source.path().unwrap_or(base).to_path_buf();
                let below = path.strip_prefix(base).unwrap_or(&path);
                let dead_link = path.symlink_metadata().is_ok_and(|m| m.is_symlink());
                if dead_link && !wanted(below) {
                    continue;
                }
                return Err(InputsError::Walk { path, source });
            }
        };
        let below = entry.path().strip_prefix(base).unwrap_or(entry.path());
        let part = below.extension().is_some_and(|e| e == "part");
        if entry.file_type().is_file() && !part && wanted(below) {
            let relative_dir = below.parent().unwrap_or(Path::new("")).to_path_buf();
            let path = if base == Path::new(".") { below } else { entry.path() };
            found.push(Input { path: path.to_path_buf(), relative_dir });
        }
    }
    Ok(())
}

/// The literal directories before the first pattern, and the pattern; `None` without a pattern.
fn split_glob(arg: &Path) -> Option<(PathBuf, String)> {
    let special = |c: &Component| c.as_os_str().to_string_lossy().contains(['*', '?', '[', '{']);
    let at = arg.components().position(|c| special(&c))?;
    let base = arg.components().take(at).collect();
    let pattern: PathBuf = arg.components().skip(at).collect();
    Some((base, pattern.to_str()?.to_string()))
}

/// `<out>/<relative_dir>/<stem>.verdicts.parquet`.
pub fn verdict_path(out: &Path, input: &Input) -> PathBuf {
    let mut name = input.path.file_stem().unwrap_or_default().to_os_string();
    name.push(".verdicts.parquet");
    out.join(&input.relative_dir).join(name)
}

/// Refuses recordings that would write the same verdict file.
pub fn check_verdict_paths(out: &Path, inputs: &[Input]) -> Result<(), InputsError> {
    let mut taken: HashMap<PathBuf, &Path> = HashMap::new();
    for input in inputs {
        let verdicts = verdict_path(out, input);
        if let Some(first) = taken.insert(verdicts.clone(), &input.path) {
            let (first, second) = (first.to_path_buf(), input.path.clone());
            return Err(InputsError::SameVerdicts { first, second, verdicts });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    /// a.mcap, b.MCAP, notes.csv, c.mcap.part, .hidden.mcap, deep/er/a.mcap, [odd]/x.mcap
    fn tree() -> tempfile::TempDir {
        let dir = tempfile::tempdir().unwrap();
        fs::create_dir_all(dir.path().join("deep/er")).unwrap();
        fs::create_dir_all(dir.path().join("[odd]")).unwrap();
        for name in [
            "a.mcap",
            "b.MCAP",
            "notes.csv",
            "c.mcap.part",
            ".hidden.mcap",
            "deep/er/a.mcap",
            "[odd]/x.mcap",
        ] {
            fs::write(dir.path().join(name), name).unwrap();
        }
        dir
    }

    fn names(dir: &Path, args: &[&str]) -> Vec<String> {
        let args: Vec<PathBuf> = args.iter().map(|a| dir.join(a)).collect();
        let found = find_recordings(&args).unwrap();
        let name = |i: &Input| {
            let below = i.path.strip_prefix(dir).unwrap().display().to_string();
            format!("{below} @{}", i.relative_dir.display())
        };
        found.iter().map(name).collect()
    }

    #[test]
    fn directories_files_and_patterns_give_their_recordings_once_and_sorted() {
        let tree = tree();
        let dir = tree.path();
        let all = ["[odd]/x.mcap @[odd]", "a.mcap @", "b.MCAP @", "deep/er/a.mcap @deep/er"];
        assert_eq!(names(dir, &["."]), all);
        assert_eq!(names(dir, &["notes.csv"]), ["notes.csv @"]);
        assert_eq!(names(dir, &["*.mcap"]), ["a.mcap @"]);
        assert_eq!(names(dir, &["**/*.mcap"]), [all[0], all[1], all[3]]);
        assert_eq!(names(dir, &["deep/*/a.mcap"]), ["deep/er/a.mcap @er"]);
        assert_eq!(names(dir, &["{a,b}.*"]), ["a.mcap @", "b.MCAP @"]);
        assert_eq!(names(dir, &["[odd]/x.mcap"]), ["[odd]/x.mcap @"]);
        assert_eq!(names(dir, &["a.mcap", "deep/../a.mcap", "*"]).len(), 3);
    }

    #[cfg(unix)]
    #[test]
    fn links_in_a_circle_and_dead_links_to_other_files_do_no_harm() {
        use std::os::unix::fs::symlink;
        let tree = tree();
        symlink("..", tree.path().join("deep/up")).unwrap();
        symlink("nowhere.csv", tree.path().join("dead.csv")).unwrap();
        symlink("a.mcap", tree.path().join("link.mcap")).unwrap();
        assert_eq!(names(tree.path(), &["."]).len(), 4);
        symlink("nowhere", tree.path().join("dead.mcap")).unwrap();
        let error = find_recordings(&[tree.path().to_path_buf()]).unwrap_err().to_string();
        assert!(error.contains("dead.mcap"), "{error}");
    }

    #[test]
    fn nothing_found_says_what_was_searched() {
        let dir = tempfile::tempdir().unwrap();
        let error = |arg: &str| find_recordings(&[dir.path().join(arg)]).unwrap_err().to_string();
        assert!(error("").contains("*.mcap, and below"));
        assert!(error("x/*.mcap").contains("x/*.mcap (pattern)"));
        assert!(error("none.mcap").contains("no such file"));
        assert!(error("a[.mcap").contains("glob pattern"));
        assert!(find_recordings(&[]).unwrap_err().to_string().contains("nothing"));
    }

    #[test]
    fn verdicts_keep_the_path_below_and_two_recordings_never_share_a_file() {
        let tree = tree();
        let inputs = find_recordings(&[tree.path().to_path_buf()]).unwrap();
        let out = Path::new("out");
        let last = verdict_path(out, &inputs[3]);
        assert_eq!(last, Path::new("out/deep/er/a.verdicts.parquet"));
        assert!(check_verdict_paths(out, &inputs).is_ok());
        let args = ["a.mcap", "deep/er/a.mcap"].map(|a| tree.path().join(a));
        let inputs = find_recordings(&args).unwrap();
        let error = check_verdict_paths(out, &inputs).unwrap_err().to_string();
        assert!(
            error.contains("deep/er/a.mcap") && error.contains("a.verdicts.parquet"),
            "{error}"
        );
    }
}
