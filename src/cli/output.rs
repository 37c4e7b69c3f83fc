//! Where results go: stdout, as text or as one JSON line per event, or with `--quiet` nowhere.

use std::io::{self, StdoutLock, Write};
use std::sync::atomic::{AtomicBool, Ordering};

static QUIET: AtomicBool = AtomicBool::new(false);

/// From here on only what fails is told, on stderr.
pub fn be_quiet() {
    QUIET.store(true, Ordering::Relaxed);
}

pub fn is_quiet() -> bool {
    QUIET.load(Ordering::Relaxed)
}

/// Stdout, or with `--quiet` nothing. Of verbs whose result is a file; where stdout is the result, it
/// is not asked.
pub fn report() -> Report {
    Report((!is_quiet()).then(|| io::stdout().lock()))
}

/// The same of a verb that says its result on stdout where it writes no file.
pub fn result(is_file: bool) -> Report {
    if is_file { report() } else { Report(Some(io::stdout().lock())) }
}

pub struct Report(Option<StdoutLock<'static>>);

impl Write for Report {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.as_mut().map_or(Ok(bytes.len()), |out| out.write(bytes))
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.as_mut().map_or(Ok(()), Write::flush)
    }
}

/// One event, one line.
pub fn event(of: &impl serde::Serialize) -> io::Result<()> {
    let mut line = serde_json::to_string(of)?;
    line.push('\n');
    let mut out = io::stdout().lock();
    out.write_all(line.as_bytes())?;
    out.flush() // whoever reads along waits for lines
}
