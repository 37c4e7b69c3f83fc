//! Parses names on a command line that are patterns (`nights/*.mcap`).
//!
//! In, from `inputs.rs`: a name with wildcards. Out: a [`Pattern`].

use super::dialect::matcher;
use super::inputs::InputsError;
use globset::GlobMatcher;
use std::path::{Component, Path, PathBuf};

/// A name with one of these characters is a pattern, unless a file or directory is called so.
pub(super) const WILDCARDS: [char; 4] = ['*', '?', '[', '{'];

pub(super) struct Pattern {
    /// The directory that the pattern begins with, up to the first part with a wildcard.
    pub root: PathBuf,
    /// How many levels below `root` a file that fits may lie.
    pub depth: usize,
    pub matcher: GlobMatcher,
}

/// Parses a pattern. `.` parts and doubled slashes, which mean nothing in a path, are left out.
pub(super) fn pattern(text: &str) -> Result<Pattern, InputsError> {
    if text.ends_with('/') {
        let what = "no valid pattern: it ends in a slash, and a pattern stands for files";
        return Err(InputsError::bad_pattern(text, what));
    }
    let parts = || Path::new(text).components().filter(|c| *c != Component::CurDir);
    let whole: PathBuf = parts().collect();
    let matcher = glob(&whole.to_string_lossy())?;
    let literal = |c: &Component| !c.as_os_str().to_string_lossy().contains(WILDCARDS);
    let root: PathBuf = parts().take_while(literal).collect();
    // `**` fits any number of directories, and so may braces around a slash: `{a,b/c}`
    let of_any_depth = |c: Component| {
        let part = c.as_os_str().to_string_lossy();
        part.contains("**") || part.matches('{').count() != part.matches('}').count()
    };
    let depth = match parts().any(of_any_depth) {
        true => usize::MAX,
        false => parts().skip_while(literal).count(),
    };
    let root = if root.as_os_str().is_empty() { PathBuf::from(".") } else { root };
    if !root.exists() {
        return Err(InputsError::missing(&root));
    }
    Ok(Pattern { root, depth, matcher })
}

pub(super) fn glob(text: &str) -> Result<GlobMatcher, InputsError> {
    matcher(text).map_err(|what| InputsError::bad_pattern(text, what))
}
