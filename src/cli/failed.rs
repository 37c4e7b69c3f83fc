//! What an error means for the rest of a batch.

use std::error::Error;
use std::io::{self, ErrorKind};

/// Nothing more can be written, of no recording.
pub fn no_room(e: &(dyn Error + 'static)) -> bool {
    matches!(kind(e), Some(ErrorKind::StorageFull | ErrorKind::QuotaExceeded))
}

/// With what a person can do about it, where the system's words do not say.
pub fn in_words(e: &(dyn Error + 'static)) -> String {
    match kind(e) {
        Some(ErrorKind::FileTooLarge) => {
            format!("{e}; no larger file may be written here (see `ulimit -f`)")
        }
        _ => e.to_string(),
    }
}

/// Of the input or output error that it comes from.
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

/// A file that grows beyond what its process may write is an error like others; by default the
/// system would end the process, and leave unfinished files.
pub fn outlive_file_size_limits() {
    #[cfg(unix)]
    {
        use signal_hook::consts::SIGXFSZ;
        use std::sync::{Arc, atomic::AtomicBool};
        // where it cannot be asked for, such a limit still ends the run
        let _ = signal_hook::flag::register(SIGXFSZ, Arc::new(AtomicBool::new(false)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::PipelineError;

    #[test]
    fn a_full_disk_is_known_however_deep_it_lies() {
        let io = |kind: ErrorKind| io::Error::from(kind);
        let write = |kind| PipelineError::Write { path: "x".into(), source: io(kind) };
        assert!(no_room(&write(ErrorKind::StorageFull)));
        assert!(no_room(&io(ErrorKind::QuotaExceeded)));
        assert!(!no_room(&write(ErrorKind::PermissionDenied)));
        assert!(in_words(&write(ErrorKind::FileTooLarge)).contains("ulimit -f"));
    }
}
