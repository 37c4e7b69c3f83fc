//! Progress: bars on a terminal, plain lines otherwise, always on stderr.

use super::output::is_quiet;
use crate::pipeline::Control;
use crate::report::grouped;
use indicatif::{HumanBytes, HumanDuration, MultiProgress, ProgressBar, ProgressStyle};
use inkling_io::damage::Damage;
use inkling_io::printable;
use std::cell::RefCell;
use std::io::{IsTerminal, Write};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Once};
use std::thread::Thread;
use std::time::{Duration, Instant};

/// Between two looks; between two lines where there is no terminal.
const TICK: Duration = Duration::from_millis(100);
const LINE_EVERY: Duration = Duration::from_secs(10);

/// Characters of one message.
const MOST_OF_A_MESSAGE: usize = 20_000;
/// Before what makes a result less certain.
const WARNING: &str = "warning: ";
/// Characters of a name in a message.
const MOST_OF_A_NAME: usize = 64;

/// A line on stderr, or for the program that called; what it repeats from files moves no cursor. `eprintln!` would
/// panic where nobody can read it; the exit status still says it.
pub fn complain(message: &str) {
    let message = printable::lines(message, MOST_OF_A_MESSAGE);
    if is_called() {
        TOLD.with_borrow_mut(|told| told.push(message));
    } else {
        let _ = writeln!(std::io::stderr(), "{message}");
    }
}

thread_local! {
    /// Who interrupts what this thread does, where it works for another program.
    static CALLER: RefCell<Option<Arc<Control>>> = const { RefCell::new(None) };
    /// What that program is to be told of it; lines.
    static TOLD: RefCell<Vec<String>> = const { RefCell::new(Vec::new()) };
}

fn is_called() -> bool {
    CALLER.with_borrow(Option::is_some)
}

/// What was to be told on this thread since this was asked last, where it works for another program; sentences.
pub fn told() -> Vec<String> {
    let sentence = |line: &String| {
        let line = line.strip_prefix(WARNING).unwrap_or(line);
        line.strip_prefix("inkling: ").unwrap_or(line).to_owned()
    };
    TOLD.take().iter().map(sentence).collect()
}

/// What it does on this thread another program interrupts, by `control`; signals are that program's own.
pub fn called_by<T>(control: &Arc<Control>, work: impl FnOnce() -> T) -> T {
    CALLER.set(Some(control.clone()));
    let done = work();
    CALLER.set(None);
    done
}

/// Ends what was interrupted and has no other end: the process, or for another program this thread.
pub fn end_here() -> ! {
    match is_called() {
        true => std::panic::resume_unwind(Box::new(Interrupted)),
        false => std::process::exit(1),
    }
}

/// What [`end_here`] unwinds with.
pub struct Interrupted;

/// A shared control that Ctrl-C or a request to terminate interrupts; the second one ends the run where
/// it is.
pub fn interruptible() -> Arc<Control> {
    handle_interrupts(|_| false)
}

/// The same; `takes` may take a Ctrl-C for something else.
pub fn handle_interrupts(takes: impl Fn(&Control) -> bool + Send + 'static) -> Arc<Control> {
    static ONCE: Once = Once::new();
    if let Some(control) = CALLER.with_borrow(Clone::clone) {
        return control;
    }
    let control = Arc::new(Control::default());
    let handle = control.clone();
    ONCE.call_once(|| {
        // without a handler Ctrl-C still ends the run; only the .part file is left behind
        let _ = ctrlc::set_handler(move || {
            if takes(&handle) {
                return;
            }
            if handle.interrupted() {
                std::process::exit(1);
            }
            handle.interrupt();
        });
    });
    control
}

/// Draws the current recording and, where there are several, the whole, until `done`.
pub struct Progress {
    bars: MultiProgress,
    overall: Option<Overall>,
    terminal: bool,
}

/// Where there are several recordings: how far all of them are.
struct Overall {
    /// On a terminal.
    bar: Option<ProgressBar>,
    recordings: usize,
    bytes: u64,
    started: Instant,
    done_recordings: AtomicUsize,
    done_bytes: AtomicU64,
    done_signals: AtomicU64,
}

impl Overall {
    /// `12 of 60 recordings, 3 400 000 signals/s, 4 minutes left`; `bytes`, `signals`: of the one at hand.
    fn in_words(&self, bytes: u64, signals: u64) -> String {
        let number = self.done_recordings.load(Ordering::Relaxed) + 1;
        let spent_s = self.started.elapsed().as_secs_f64().max(1e-9);
        let signals = self.done_signals.load(Ordering::Relaxed) + signals;
        let done = (self.done_bytes.load(Ordering::Relaxed) + bytes) as f64;
        let left = (self.bytes as f64 - done).max(0.0);
        let left = match done > 0.0 {
            true => {
                format!(", {} left", HumanDuration(Duration::from_secs_f64(spent_s * left / done)))
            }
            false => String::new(),
        };
        let number = thousands(number.min(self.recordings) as u64);
        let (of, rate) =
            (thousands(self.recordings as u64), thousands((signals as f64 / spent_s) as u64));
        format!("{number} of {of} recordings, {rate} signals/s{left}")
    }
}

impl Progress {
    pub fn new(recordings: usize, total_bytes: u64) -> Progress {
        let terminal = std::io::stderr().is_terminal() && !is_quiet();
        let bars = MultiProgress::new();
        let overall = (recordings > 1).then(|| Overall {
            bar: terminal.then(|| {
                let bar = ProgressBar::new(total_bytes);
                bar.set_style(style("{spinner} all recordings   {bar:30} {percent:>3} %  {msg}"));
                bars.add(bar)
            }),
            recordings,
            bytes: total_bytes,
            started: Instant::now(),
            done_recordings: AtomicUsize::new(0),
            done_bytes: AtomicU64::new(0),
            done_signals: AtomicU64::new(0),
        });
        Progress { bars, overall, terminal }
    }

    /// Runs `job` while its progress through `bytes` of `name` is shown (`None`: nobody knows how many).
    pub fn during<T>(
        &self,
        name: &str,
        bytes: impl Into<Option<u64>>,
        control: &Control,
        job: impl FnOnce() -> T,
    ) -> T {
        let bytes = bytes.into();
        let done = AtomicBool::new(false);
        let signals_before = control.signals.load(Ordering::Relaxed);
        let result = std::thread::scope(|scope| {
            let watcher = scope.spawn(|| self.watch(name, bytes, control, signals_before, &done));
            // also where the job panics: the scope waits for the watcher
            let _ended = Ended { done: &done, watcher: watcher.thread().clone() };
            job()
        });
        if let (Some(overall), Some(bytes)) = (&self.overall, bytes) {
            let signals = control.signals.load(Ordering::Relaxed).saturating_sub(signals_before);
            overall.done_recordings.fetch_add(1, Ordering::Relaxed);
            overall.done_signals.fetch_add(signals, Ordering::Relaxed);
            let done = overall.done_bytes.fetch_add(bytes, Ordering::Relaxed) + bytes;
            overall.bar.iter().for_each(|bar| bar.set_position(done));
        }
        result
    }

    /// A message above the bars. A program that called is told warnings alone.
    pub fn say(&self, message: &str) {
        if !is_quiet() || (is_called() && message.starts_with(WARNING)) {
            self.fail(message);
        }
    }

    /// The same, also where all else is quiet.
    pub fn fail(&self, message: &str) {
        if self.terminal {
            self.bars.suspend(|| complain(message));
        } else {
            complain(message);
        }
    }

    /// The first few damages of a recording.
    pub fn say_damage(&self, name: &str, damage: &[Damage]) {
        const MOST: usize = 10;
        for d in damage.iter().take(MOST) {
            let (from, to) = (d.from_byte, d.to_byte);
            self.say(&format!(
                "warning: {}: bytes {from} to {to}: {}",
                printable::line(name, MOST_OF_A_NAME),
                d.what
            ));
        }
        if damage.len() > MOST {
            let more = damage.len() - MOST;
            self.say(&format!(
                "warning: {}: {more} damages more",
                printable::line(name, MOST_OF_A_NAME)
            ));
        }
    }

    fn watch(
        &self,
        name: &str,
        bytes: Option<u64>,
        control: &Control,
        before: u64,
        done: &AtomicBool,
    ) {
        let started = Instant::now();
        let signals = || control.signals.load(Ordering::Relaxed).saturating_sub(before);
        let rate =
            || thousands((signals() as f64 / started.elapsed().as_secs_f64().max(1e-9)) as u64);
        let bar = self.terminal.then(|| {
            let bar = bytes.map_or_else(ProgressBar::new_spinner, ProgressBar::new);
            let bar = self.bars.add(bar);
            bar.set_style(style(match bytes {
                Some(_) => "{spinner} {prefix:<16!} {bar:30} {percent:>3} %  {msg}  {eta} left",
                None => "{spinner} {prefix:<16!} followed for {elapsed}, {msg}; Ctrl-C ends it",
            }));
            bar.set_prefix(printable::line(name, MOST_OF_A_NAME));
            bar
        });
        let mut last_line = Instant::now();
        while !done.load(Ordering::Relaxed) {
            std::thread::park_timeout(TICK); // the end of the job wakes it
            let read = control.bytes_read.load(Ordering::Relaxed).min(bytes.unwrap_or(u64::MAX));
            let all = self.overall.as_ref().map(|all| (all, all.in_words(read, signals())));
            if let Some(bar) = &bar {
                bar.set_position(read);
                bar.set_message(match bytes {
                    Some(_) => format!("{} signals/s", rate()),
                    None => format!("{} signals", thousands(signals())),
                });
                if let Some((Overall { bar: Some(bar), done_bytes, .. }, words)) = all {
                    bar.set_position(done_bytes.load(Ordering::Relaxed) + read);
                    bar.set_message(words);
                }
            } else if last_line.elapsed() >= LINE_EVERY && !is_quiet() {
                last_line = Instant::now();
                let of = bytes.map_or(String::new(), |bytes| format!(" of {}", HumanBytes(bytes)));
                let all = all.map_or(String::new(), |(_, words)| format!("; {words}"));
                let (name, read) = (printable::line(name, MOST_OF_A_NAME), HumanBytes(read));
                complain(&format!("{name}: {read}{of}, {} signals/s{all}", rate()));
            }
        }
        if let Some(bar) = bar {
            bar.finish_and_clear();
        }
    }
}

/// Progress through work that reads no recording, step by step: a bar on a terminal, elsewhere nothing.
pub struct Steps {
    bar: ProgressBar,
}

impl Steps {
    /// `steps`: how many; `None`: nobody knows. `unit`: what they are.
    pub fn new(what: &str, steps: Option<u64>, unit: &'static str) -> Steps {
        if !std::io::stderr().is_terminal() || is_quiet() {
            return Steps { bar: ProgressBar::hidden() };
        }
        let bar = steps.map_or_else(ProgressBar::new_spinner, ProgressBar::new);
        bar.set_style(style(match steps {
            Some(_) => "{spinner} {prefix:<16!} {bar:30} {pos} of {len} {msg}  {eta} left",
            None => "{spinner} {prefix:<16!} {human_pos} {msg} in {elapsed}",
        }));
        bar.set_prefix(printable::line(what, MOST_OF_A_NAME));
        bar.set_message(unit);
        bar.enable_steady_tick(TICK);
        Steps { bar }
    }

    /// One more is done.
    pub fn step(&self) {
        self.bar.inc(1);
    }
}

impl Drop for Steps {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

/// Says so when it goes out of scope, however that comes.
struct Ended<'a> {
    done: &'a AtomicBool,
    watcher: Thread,
}

impl Drop for Ended<'_> {
    fn drop(&mut self) {
        self.done.store(true, Ordering::Relaxed);
        self.watcher.unpark();
    }
}

fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar())
}

/// 1234567 -> "1 234 567".
pub fn thousands(n: u64) -> String {
    grouped(n, ' ')
}
