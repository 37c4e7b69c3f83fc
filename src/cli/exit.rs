//! How a run ends: the exit statuses that the README documents, and which error leads to which of them.

use crate::pipeline::PipelineError;
use crate::settings::SettingsError;
use inkling_io::damage::RecordingError;
use inkling_io::file_error::FileError;
use inkling_io::inputs::InputsError;
use std::process::ExitCode;

/// The exit status of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    Done = 0,
    /// Nothing could be done, or there was nothing to do.
    Failed = 1,
    /// Wrong usage or settings.
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

/// Why a run did not end well, in words for a person.
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

    pub fn is_usage(&self) -> bool {
        self.exit == Exit::Usage
    }
}

/// Errors of these types are the user's to correct (what was written in a file, or which file was meant), so
/// they are usage failures, except for the variants that are listed.
macro_rules! usage_but_for {
    ($($error:ident: $($other:ident)|*;)*) => {
        $(impl From<$error> for Failure {
            fn from(e: $error) -> Failure {
                match e {
                    $($error::$other { .. } => Failure::new(e),)*
                    _ => Failure::usage(e),
                }
            }
        })*
    };
}

usage_but_for! {
    SettingsError: ;
    FileError: Write | Failed;
    // a directory or a pattern may well match nothing
    InputsError: InObjectStore | Unreadable | Nothing | Shared;
}

impl From<PipelineError> for Failure {
    fn from(e: PipelineError) -> Failure {
        match e {
            PipelineError::File(e) => e.into(),
            PipelineError::TooManyWindows { .. }
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
impl From<std::io::Error> for Failure {
    fn from(e: std::io::Error) -> Failure {
        let exit =
            if e.kind() == std::io::ErrorKind::BrokenPipe { Exit::Done } else { Exit::Failed };
        Failure { exit, message: format!("cannot write the result: {e}") }
    }
}

/// For what is printed while work remains: a reader that has gone away must not stop the work.
pub fn unless_reader_gone(printed: std::io::Result<()>) -> Result<(), Failure> {
    match printed.map_err(Failure::from) {
        Err(failure) if failure.exit != Exit::Done => Err(failure),
        _ => Ok(()),
    }
}
