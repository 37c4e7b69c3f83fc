//! Where an executor may read and write: below its roots, whatever a job says.
use inkling::io::objects::in_object_store;
use std::io;
use std::path::{Component, Path, PathBuf};

/// The directories and prefixes that the executor was started with.
#[derive(Clone, Debug)]
pub struct Roots {
    /// Directories with all links resolved, or prefixes of object stores.
    roots: Vec<PathBuf>,
}

impl Roots {
    /// Resolves the roots. An error: one of them is not there.
    pub fn new(named: &[PathBuf]) -> Result<Roots, String> {
        let resolved = |root: &PathBuf| match in_object_store(root) {
            true => Ok(root.clone()),
            false => root.canonicalize().map_err(|e| format!("{}: {e}", root.display())),
        };
        Ok(Roots { roots: named.iter().map(resolved).collect::<Result<_, _>>()? })
    }

    /// Refuses a path that is not below a root. Links count by where they lead. The error says why, in words.
    pub fn check(&self, path: &Path) -> Result<(), String> {
        let refused = |why: &str| {
            let roots: Vec<_> = self.roots.iter().map(|root| root.display().to_string()).collect();
            Err(format!(
                "{}: {why} this executor's roots ({}); start it with --root, or move it",
                path.display(),
                roots.join(", ")
            ))
        };
        if path.components().any(|part| part == Component::ParentDir) {
            return refused("names a directory above itself, and might leave");
        }
        let resolved = match in_object_store(path) {
            true => path.to_path_buf(),
            false => match resolve(path) {
                Ok(resolved) => resolved,
                Err(e) => return Err(format!("{}: {e}", path.display())),
            },
        };
        match self.roots.iter().any(|root| resolved.starts_with(root)) {
            true => Ok(()),
            false => refused("is outside of"),
        }
    }
}

/// A path with all links resolved, as far as it exists; the rest of it is appended.
pub fn resolve(path: &Path) -> io::Result<PathBuf> {
    for there in path.ancestors() {
        // a link that leads nowhere is there, and must not be written through
        if there.symlink_metadata().is_ok() {
            let rest = path.strip_prefix(there).unwrap_or(Path::new(""));
            return Ok(there.canonicalize()?.join(rest));
        }
    }
    Ok(path.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_lies_or_leads_outside_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        for name in ["in/deep", "inside-by-name-only", "out"] {
            std::fs::create_dir_all(at(name)).unwrap();
        }
        std::os::unix::fs::symlink(at("out"), at("in/link")).unwrap();
        std::os::unix::fs::symlink(at("out/nothing"), at("in/dangling")).unwrap();
        std::os::unix::fs::symlink(at("in/deep"), at("out/back")).unwrap();
        let bucket = PathBuf::from("s3://nights/a");
        let roots = Roots::new(&[at("in"), bucket]).unwrap();
        for inside in ["in", "in/deep/new/x.mcap", "out/back/x.mcap"] {
            roots.check(&at(inside)).unwrap();
        }
        for outside in
            ["out/x", "inside-by-name-only/x", "in/link/x", "in/dangling", "in/deep/../../out", ""]
        {
            assert!(roots.check(&at(outside)).is_err(), "{outside}");
        }
        assert!(roots.check(Path::new("s3://nights/a/2026/x.mcap")).is_ok());
        for outside in ["s3://nights/ab/x.mcap", "s3://days/a/x.mcap", "s3://nights/a/../b"] {
            assert!(roots.check(Path::new(outside)).is_err(), "{outside}");
        }
        assert!(Roots::new(&[at("not-there")]).unwrap_err().contains("not-there"));
    }
}
