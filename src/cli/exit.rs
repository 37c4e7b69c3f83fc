//! How a run ends: the exit statuses that the README documents, which error leads to which of them, and what an
//! error means for the rest of a run.
//!
//! In: the errors of the other rooms, by `From`. Out: a [`Failure`], which every verb returns, with
//! the exit status and the message for a person. What the user can correct in the command line, in
//! settings or in the files that they name gives [`Exit::Usage`]; everything else [`Exit::Failed`].

use crate::pipeline::PipelineError;
use inkling_io::damage::RecordingError;
use inkling_io::file_error::FileError;
use inkling_io::inputs::InputsError;
use std::error::Error;
use std::io::{self, ErrorKind};
use std::process::ExitCode;

/// The exit status of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    Done = 0,
    /// Nothing could be done, or there was nothing to do.
    Failed = 1,
    /// Wrong usage or settings, or a file named in them that is not what it should be.
    Usage = 2,
    /// Finished, but some input was newly found damaged or rejected, or one of several recordings failed.
    Incomplete = 3,
    /// Finished, but nothing of a printhead, or less than half of a recording's signals, could be judged.
    NotJudged = 4,
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> ExitCode {
        ExitCode::from(exit as u8)
    }
}

/// Why a run did not end well, in words for a person. With [`Exit::Done`] it stands for an output
/// whose reader has gone away, which ends the run without a message.
#[derive(Debug)]
pub struct Failure {
    pub exit: Exit,
    pub message: String,
}

impl Failure {
    /// A failure of the work itself.
    pub fn new(message: impl ToString) -> Failure {
        Failure { exit: Exit::Failed, message: message.to_string() }
    }

    /// A failure because of wrong usage or settings.
    pub fn usage(message: impl ToString) -> Failure {
        Failure { exit: Exit::Usage, message: message.to_string() }
    }

    /// Whether wrong usage or settings are the cause.
    pub fn is_usage(&self) -> bool {
        self.exit == Exit::Usage
    }
}

/// A file that cannot be read, or whose content is a mistake, is a matter of usage: the user can
/// name another one or correct it. Whatever else goes wrong with a file is a failure.
impl From<FileError> for Failure {
    fn from(e: FileError) -> Failure {
        match e {
            FileError::Write { .. } | FileError::Failed { .. } => Failure::new(with_advice(&e)),
            FileError::Read { .. } | FileError::Mistaken { .. } => Failure::usage(e),
        }
    }
}

impl From<InputsError> for Failure {
    fn from(e: InputsError) -> Failure {
        if e.is_usage { Failure::usage(e) } else { Failure::new(e) }
    }
}

impl From<PipelineError> for Failure {
    fn from(e: PipelineError) -> Failure {
        match e {
            PipelineError::File(e) => e.into(),
            PipelineError::TooManyModels
            | PipelineError::Recording(RecordingError::Dialect { .. }) => Failure::usage(e),
            _ => Failure::new(e),
        }
    }
}

impl From<RecordingError> for Failure {
    fn from(e: RecordingError) -> Failure {
        PipelineError::from(e).into()
    }
}

/// An error of writing a result. A reader that has gone away (`inkling ... | head`) is no failure.
impl From<io::Error> for Failure {
    fn from(e: io::Error) -> Failure {
        let exit = if e.kind() == ErrorKind::BrokenPipe { Exit::Done } else { Exit::Failed };
        Failure { exit, message: format!("cannot write the result: {}", with_advice(&e)) }
    }
}

/// For what is printed while work remains: a reader of the output that has gone away must not stop
/// the work, any other error of printing does.
pub fn unless_reader_gone(printed: io::Result<()>) -> Result<(), Failure> {
    match printed {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => Err(e.into()),
        _ => Ok(()),
    }
}

/// Whether an error means that there is no room left (a full disk, an exhausted quota), so that
/// nothing of any recording can be written.
pub fn no_room(e: &(dyn Error + 'static)) -> bool {
    matches!(kind(e), Some(ErrorKind::StorageFull | ErrorKind::QuotaExceeded))
}

/// An error in words, with what the user can do if the system's own text does not say it.
pub fn in_words(e: &(dyn Error + 'static)) -> String {
    let is_too_large = kind(e) == Some(ErrorKind::FileTooLarge);
    let what = "; no larger file may be written here (see `ulimit -f`)";
    format!("{e}{}", if is_too_large { what } else { "" })
}

/// The same, for an error that ends the command.
fn with_advice(e: &(dyn Error + 'static)) -> String {
    let full = if no_room(e) { "; make room there, and run it again" } else { "" };
    format!("{}{full}", in_words(e))
}

/// The kind of the first I/O error in the chain of causes.
fn kind(e: &(dyn Error + 'static)) -> Option<ErrorKind> {
    let mut causes = std::iter::successors(Some(e), |&e| e.source());
    causes.find_map(|e| Some(e.downcast_ref::<io::Error>()?.kind()))
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
