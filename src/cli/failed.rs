//! What an error means for the rest of a run.

use std::error::Error;
use std::io::{self, ErrorKind};

/// Whether an error means that there is no room left, so that nothing of any recording can be written.
pub fn no_room(e: &(dyn Error + 'static)) -> bool {
    matches!(kind(e), Some(ErrorKind::StorageFull | ErrorKind::QuotaExceeded))
}

/// An error in words, with what the user can do if the system's own text does not say it.
pub fn in_words(e: &(dyn Error + 'static)) -> String {
    match kind(e) {
        Some(ErrorKind::FileTooLarge) => {
            format!("{e}; no larger file may be written here (see `ulimit -f`)")
        }
        _ => e.to_string(),
    }
}

/// The kind of the first I/O error in the chain of causes.
fn kind(e: &(dyn Error + 'static)) -> Option<ErrorKind> {
    let mut at = Some(e);
    while let Some(e) = at {
        if let Some(e) = e.downcast_ref::<io::Error>() {
            return Some(e.kind());
        }
        at = e.source();
    }
    None
}

/// Makes a file that exceeds the process's size limit an error like others. By default the signal SIGXFSZ
/// would end the process, and leave unfinished files.
pub fn outlive_file_size_limits() {
    #[cfg(unix)]
    {
        use signal_hook::consts::SIGXFSZ;
        use std::sync::{Arc, atomic::AtomicBool};
        // if the handler cannot be installed, such a limit still ends the run
        let _ = signal_hook::flag::register(SIGXFSZ, Arc::new(AtomicBool::new(false)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::PipelineError;
    use inkling_io::file_error::FileError;
    use std::path::Path;

    #[test]
    fn a_full_disk_is_known_however_deep_it_lies() {
        let io = |kind: ErrorKind| io::Error::from(kind);
        let write = |kind| PipelineError::from(FileError::unwritten(Path::new("x"))(io(kind)));
        assert!(no_room(&write(ErrorKind::StorageFull)));
        assert!(no_room(&io(ErrorKind::QuotaExceeded)));
        assert!(!no_room(&write(ErrorKind::PermissionDenied)));
        assert!(in_words(&write(ErrorKind::FileTooLarge)).contains("ulimit -f"));
    }
}
