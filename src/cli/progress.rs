//! Progress, messages, and the interruption of a run.
//!
//! Progress and messages always go to stderr: bars on a terminal, plain lines otherwise. Within
//! another program (`called`) messages are collected instead, on the thread that works for that
//! program. In: the counters of [`Control`], which the pipeline advances. Out: what a person sees
//! while a run goes on.
//!
//! Ctrl-C sets a flag of the [`Control`], which all work asks for now and then; a second Ctrl-C
//! ends the process at once.

use super::output::is_quiet;
use crate::pipeline::Control;
use crate::report::grouped;
use indicatif::{
    HumanBytes, MultiProgress, ProgressBar, ProgressDrawTarget, ProgressFinish, ProgressStyle,
};
use inkling_io::damage::Damage;
use inkling_io::inputs::Input;
use inkling_io::{part_file, printable, stored};
use std::cell::RefCell;
use std::io::{IsTerminal, Write};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::sync::{Arc, Once};
use std::time::{Duration, Instant};

/// Time between two updates of the bars.
const TICK: Duration = Duration::from_millis(100);
/// Time between two lines if there is no terminal.
const LINE_EVERY: Duration = Duration::from_secs(10);

/// How long whoever looks at a control has to end.
const IN_TIME: Duration = Duration::from_millis(1500);

const MOST_OF_A_MESSAGE: usize = 20_000;
/// Whether anything was told on stderr.
pub static COMPLAINED: AtomicBool = AtomicBool::new(false);
/// Prefix of messages about what makes a result less certain.
const WARNING: &str = "warning: ";
const MOST_OF_A_NAME: usize = 64;
/// Bars of what is read to its end, and of what is being written.
const THROUGH: &str = "{spinner} {prefix:<16!} {bar:30} {percent:>3} %  {msg}  {eta} left";
const FOLLOWED: &str = "{spinner} {prefix:<16!} followed for {elapsed}, {msg}; Ctrl-C ends it";

/// Writes a message to stderr, or collects it for the program that called. An error of writing is
/// ignored, since the exit status still tells the failure; `eprintln!` would panic.
pub fn complain(message: &str) {
    COMPLAINED.store(true, Ordering::Relaxed);
    let message = printable::lines(message, MOST_OF_A_MESSAGE);
    if is_called() {
        MESSAGES.with_borrow_mut(|messages| messages.push(message));
    } else {
        let _ = writeln!(std::io::stderr(), "{message}");
    }
}

thread_local! {
    /// The control by which another program interrupts this thread, if the thread works for one.
    static CALLER: RefCell<Option<Arc<Control>>> = const { RefCell::new(None) };
    static MESSAGES: RefCell<Vec<String>> = const { RefCell::new(Vec::new()) };
}

/// Whether this thread works for another program.
pub(super) fn is_called() -> bool {
    CALLER.with_borrow(Option::is_some)
}

/// Takes the messages that were collected on this thread for another program, without their
/// prefixes `warning: ` and `inkling: `.
pub fn take_messages() -> Vec<String> {
    let sentence = |line: &String| {
        let line = line.strip_prefix(WARNING).unwrap_or(line);
        line.strip_prefix("inkling: ").unwrap_or(line).to_owned()
    };
    MESSAGES.take().iter().map(sentence).collect()
}

/// Does `work` for another program, which interrupts it by `control`. Signals of the system are left to that
/// program.
pub fn called_by<T>(control: &Arc<Control>, work: impl FnOnce() -> T) -> T {
    CALLER.set(Some(control.clone()));
    let done = work();
    CALLER.set(None);
    done
}

/// What ends interrupted work of this thread, and of threads that it starts, that has no other way out: it exits
/// the process, or unwinds the thread if it works for another program.
pub fn end_of_work() -> fn() {
    match is_called() {
        true => || std::panic::resume_unwind(Box::new(Interrupted)),
        false => || std::process::exit(1),
    }
}

/// The payload with which [`end_of_work`] unwinds.
pub struct Interrupted;

/// Ends this process at once. Every result gets its name when it is whole, so nothing half is left.
fn end_at_once() -> ! {
    part_file::remove_unfinished();
    complain("inkling: interrupted; nothing unfinished was kept");
    std::process::exit(1)
}

/// For work that looks at no control: Ctrl-C or a request to terminate ends the process at once. Within another
/// program that program ends it.
pub fn end_when_asked() {
    if !is_called() {
        at_each_request_to_end(|| end_at_once());
    }
}

/// A control that Ctrl-C or a request to terminate interrupts. The second one ends the process at once, and the
/// first one as well if whoever should look at the control does not in time.
pub fn interruptible() -> Arc<Control> {
    handle_interrupts(|_| false)
}

/// The same as [`interruptible`], but a Ctrl-C for which `takes` returns true is used for something
/// else. The handler is installed once per process: a later call gives a control that Ctrl-C does
/// not reach. Within another program the control is that program's, and no handler is installed.
pub fn handle_interrupts(takes: impl Fn(&Control) -> bool + Send + 'static) -> Arc<Control> {
    static ONCE: Once = Once::new();
    if let Some(control) = CALLER.with_borrow(Clone::clone) {
        return control;
    }
    let control = Arc::new(Control::default());
    let handle = control.clone();
    ONCE.call_once(|| {
        at_each_request_to_end(move || {
            if takes(&handle) {
                return;
            }
            if handle.interrupted() {
                end_at_once();
            }
            handle.interrupt();
            std::thread::spawn(|| {
                std::thread::sleep(IN_TIME);
                end_at_once();
            });
        });
    });
    control
}

/// Calls `then`, on a thread of its own, whenever Ctrl-C or another program asks this one to end. Where there
/// are no signals, or no handler can be installed, the request ends the process itself, and a `.part` file
/// stays behind.
fn at_each_request_to_end(then: impl Fn() + Send + 'static) {
    #[cfg(unix)]
    {
        use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
        if let Ok(mut signals) = signal_hook::iterator::Signals::new([SIGINT, SIGTERM, SIGHUP]) {
            std::thread::spawn(move || signals.forever().for_each(|_| then()));
        }
    }
    #[cfg(not(unix))]
    drop(then);
}

/// Shows the progress through the current recording and, if there are several, through all of them.
pub struct Progress {
    /// Holds the bar; it is hidden if stderr is no terminal, or with `--quiet`.
    bars: MultiProgress,
    overall: Option<Overall>,
}

/// The progress through all recordings, if there are several.
struct Overall {
    bar: ProgressBar,
    /// Number of recordings in all, and of those that are done, with the bytes of the latter.
    recordings: usize,
    done_recordings: AtomicUsize,
    done_bytes: AtomicU64,
}

impl Overall {
    /// `12 of 60 recordings, `
    fn in_words(&self) -> String {
        let number = (self.done_recordings.load(Ordering::Relaxed) + 1).min(self.recordings);
        let [number, of] = [number, self.recordings].map(|n| thousands(n as u64));
        format!("{number} of {of} recordings, ")
    }
}

impl Progress {
    /// Progress through so many recordings, which have `total_bytes` together. That number is not
    /// used for a single recording.
    pub fn new(recordings: usize, total_bytes: u64) -> Progress {
        let bars = MultiProgress::new(); // draws nothing where stderr is no terminal
        if is_quiet() {
            bars.set_draw_target(ProgressDrawTarget::hidden());
        }
        let overall = (recordings > 1).then(|| {
            let bar = bars.add(ProgressBar::new(total_bytes));
            bar.set_style(style(THROUGH));
            Overall { bar, recordings, done_recordings: 0.into(), done_bytes: 0.into() }
        });
        Progress { bars, overall }
    }

    /// Progress through recordings that are all read from begin to end.
    pub fn through(recordings: &[Input]) -> Progress {
        // a single recording has a bar of its own, and in a store each length is a request
        let several = if recordings.len() > 1 { recordings } else { &[] };
        let bytes = several.iter().map(|input| stored::bytes(&input.path));
        Progress::new(recordings.len(), bytes.sum())
    }

    /// Runs `job` on this thread, and shows its progress through the `bytes` of the recording
    /// `name` from a second thread (`watch`), which reads the counters of `control`. `bytes`:
    /// `None` if their number is not known. Returns what `job` does.
    pub fn during<T>(
        &self,
        name: &str,
        bytes: impl Into<Option<u64>>,
        control: &Control,
        job: impl FnOnce() -> T,
    ) -> T {
        let bytes = bytes.into();
        // the control counts signals over the whole run
        let signals_before = control.signals.load(Ordering::Relaxed);
        let result = std::thread::scope(|scope| {
            // the watcher ends when `_under_way` is dropped, also by a panic of the job: otherwise
            // the scope would wait for it forever
            let (_under_way, end) = channel();
            scope.spawn(move || self.watch(name, bytes, control, signals_before, &end));
            job()
        });
        if let (Some(overall), Some(bytes)) = (&self.overall, bytes) {
            overall.done_recordings.fetch_add(1, Ordering::Relaxed);
            overall.done_bytes.fetch_add(bytes, Ordering::Relaxed);
        }
        result
    }

    /// Tells a message above the bars, unless quiet. Another program that works through us is
    /// always quiet; it is told warnings all the same.
    pub fn say(&self, message: &str) {
        if !is_quiet() || (is_called() && message.starts_with(WARNING)) {
            self.fail(message);
        }
    }

    /// Tells a message above the bars, even if quiet.
    pub fn fail(&self, message: &str) {
        self.bars.suspend(|| complain(message));
    }

    /// Tells the first few damages of a recording, with `--quiet` the first one, and how many more there are.
    pub fn say_damage(&self, name: &str, damage: &[Damage]) {
        let name = printable::line(name, MOST_OF_A_NAME);
        let all = damage.iter().map(Damage::to_string);
        let most = if is_quiet() && !is_called() { 1 } else { 10 };
        for what in first_few(all, most, |more| format!("{more} damages more")) {
            self.fail(&format!("warning: {name}: {what}"));
        }
    }

    /// Updates the bar, or prints a line now and then, until the sender of `end` is dropped. Runs on a
    /// thread beside the job. `before`: number of signals that earlier recordings had.
    fn watch(
        &self,
        name: &str,
        bytes: Option<u64>,
        control: &Control,
        before: u64,
        end: &Receiver<()>,
    ) {
        let started = Instant::now();
        let bar = match (&self.overall, bytes) {
            (Some(overall), _) => overall.bar.clone(),
            (None, Some(bytes)) => {
                self.bars.add(ProgressBar::new(bytes)).with_style(style(THROUGH))
            }
            (None, None) => self.bars.add(ProgressBar::new_spinner()).with_style(style(FOLLOWED)),
        };
        bar.set_prefix(printable::line(name, MOST_OF_A_NAME));

        let mut last_line = Instant::now();
        let mut is_under_way = true;
        while is_under_way {
            is_under_way = end.recv_timeout(TICK) == Err(RecvTimeoutError::Timeout);
            let read = control.bytes_read.load(Ordering::Relaxed).min(bytes.unwrap_or(u64::MAX));
            let signals = control.signals.load(Ordering::Relaxed).saturating_sub(before);
            let rate = signals as f64 / started.elapsed().as_secs_f64().max(1e-9);
            let (signals, rate) = (thousands(signals), thousands(rate as u64));
            let all = self.overall.as_ref().map_or(String::new(), Overall::in_words);
            // on a terminal the bar, at each tick; elsewhere a line every ten seconds
            if !self.bars.is_hidden() {
                let done =
                    self.overall.as_ref().map_or(0, |of| of.done_bytes.load(Ordering::Relaxed));
                bar.set_position(done + read);
                bar.set_message(match bytes {
                    Some(_) => format!("{all}{rate} signals/s"),
                    None => format!("{signals} signals"),
                });
            } else if last_line.elapsed() >= LINE_EVERY && !is_quiet() {
                last_line = Instant::now();
                let of = bytes.map_or(String::new(), |bytes| format!(" of {}", HumanBytes(bytes)));
                let (name, read) = (printable::line(name, MOST_OF_A_NAME), HumanBytes(read));
                complain(&format!("{all}{name}: {read}{of}, {rate} signals/s"));
            }
        }
        if self.overall.is_none() {
            bar.finish_and_clear();
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.overall.iter().for_each(|overall| overall.bar.finish_and_clear());
    }
}

/// Progress in steps through work that reads no recording: a bar on a terminal, which goes when it is dropped,
/// and nothing elsewhere. `steps`: their number, `None` if it is not known. `unit`: what is counted.
pub fn steps(what: &str, steps: Option<u64>, unit: &'static str) -> ProgressBar {
    if !std::io::stderr().is_terminal() || is_quiet() {
        return ProgressBar::hidden();
    }
    let bar = steps.map_or_else(ProgressBar::new_spinner, ProgressBar::new);
    bar.set_style(style(match steps {
        Some(_) => "{spinner} {prefix:<16!} {bar:30} {pos} of {len} {msg}  {eta} left",
        None => "{spinner} {prefix:<16!} {human_pos} {msg} in {elapsed}",
    }));
    bar.set_prefix(printable::line(what, MOST_OF_A_NAME));
    bar.set_message(unit);
    bar.enable_steady_tick(TICK);
    bar.with_finish(ProgressFinish::AndClear)
}

/// The style of a template of indicatif; the default one if the template were wrong.
fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar())
}

/// A number with its digits in groups of three: 1234567 -> "1 234 567".
pub fn thousands(n: u64) -> String {
    grouped(n, ' ')
}

/// A number with its noun in the singular or plural: `1 recording`, `2 recordings`.
pub fn counted(n: u64, what: &str) -> String {
    format!("{} {what}{}", thousands(n), if n == 1 { "" } else { "s" })
}

/// The first `most` lines, and after them what `more` says of the number of those that are left.
pub fn first_few(
    lines: impl ExactSizeIterator<Item = String>,
    most: usize,
    more: impl Fn(usize) -> String,
) -> impl Iterator<Item = String> {
    let left = lines.len().saturating_sub(most);
    lines.take(most).chain((left > 0).then(|| more(left)))
}
