//! Progress: bars on a terminal, plain lines otherwise, always on stderr.

use super::output::is_quiet;
use super::report::printable;
use crate::io::recording::Damage;
use crate::pipeline::Control;
use indicatif::{HumanBytes, MultiProgress, ProgressBar, ProgressStyle};
use std::io::{IsTerminal, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Once};
use std::thread::Thread;
use std::time::{Duration, Instant};

/// Between two looks; between two lines where there is no terminal.
const TICK: Duration = Duration::from_millis(100);
const LINE_EVERY: Duration = Duration::from_secs(10);

/// Characters of one message.
const MOST_OF_A_MESSAGE: usize = 20_000;

/// A line on stderr; what it repeats from files moves no cursor. `eprintln!` would panic where nobody
/// can read it; the exit status still says it.
pub fn complain(message: &str) {
    let message = crate::io::printable::lines(message, MOST_OF_A_MESSAGE);
    let _ = writeln!(std::io::stderr(), "{message}");
}

/// A shared control that Ctrl-C or a request to terminate interrupts; the second one ends the run where
/// it is.
pub fn interruptible() -> Arc<Control> {
    static ONCE: Once = Once::new();
    let control = Arc::new(Control::default());
    let handle = control.clone();
    ONCE.call_once(|| {
        // without a handler Ctrl-C still ends the run; only the .part file is left behind
        let _ = ctrlc::set_handler(move || {
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
    overall: Option<ProgressBar>,
    terminal: bool,
}

impl Progress {
    pub fn new(recordings: usize, total_bytes: u64) -> Progress {
        let terminal = std::io::stderr().is_terminal() && !is_quiet();
        let bars = MultiProgress::new();
        let overall = (terminal && recordings > 1).then(|| {
            let bar = ProgressBar::new(total_bytes);
            bar.set_style(style("{spinner} all recordings   {bar:30} {percent:>3} %  {eta} left"));
            bars.add(bar)
        });
        Progress { bars, overall, terminal }
    }

    /// Runs `job` while its progress through `bytes` of `name` is shown.
    pub fn during<T>(
        &self,
        name: &str,
        bytes: u64,
        control: &Control,
        job: impl FnOnce() -> T,
    ) -> T {
        let done = AtomicBool::new(false);
        let signals_before = control.signals.load(Ordering::Relaxed);
        let result = std::thread::scope(|scope| {
            let watcher = scope.spawn(|| self.watch(name, bytes, control, signals_before, &done));
            // also where the job panics: the scope waits for the watcher
            let _ended = Ended { done: &done, watcher: watcher.thread().clone() };
            job()
        });
        if let Some(overall) = &self.overall {
            overall.inc(bytes);
        }
        result
    }

    /// A message above the bars.
    pub fn say(&self, message: &str) {
        if !is_quiet() {
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
            self.say(&format!("warning: {}: bytes {from} to {to}: {}", printable(name), d.what));
        }
        if damage.len() > MOST {
            let more = damage.len() - MOST;
            self.say(&format!("warning: {}: {more} damages more", printable(name)));
        }
    }

    fn watch(&self, name: &str, bytes: u64, control: &Control, before: u64, done: &AtomicBool) {
        let started = Instant::now();
        let rate = || {
            let signals = control.signals.load(Ordering::Relaxed).saturating_sub(before);
            signals as f64 / started.elapsed().as_secs_f64().max(1e-9)
        };
        let bar = self.terminal.then(|| {
            let bar = self.bars.add(ProgressBar::new(bytes));
            bar.set_style(style(
                "{spinner} {prefix:<16!} {bar:30} {percent:>3} %  {msg}  {eta} left",
            ));
            bar.set_prefix(printable(name));
            bar
        });
        let mut last_line = Instant::now();
        while !done.load(Ordering::Relaxed) {
            std::thread::park_timeout(TICK); // the end of the job wakes it
            let read = control.bytes_read.load(Ordering::Relaxed).min(bytes);
            if let Some(bar) = &bar {
                bar.set_position(read);
                bar.set_message(format!("{} signals/s", thousands(rate() as u64)));
            } else if last_line.elapsed() >= LINE_EVERY && !is_quiet() {
                last_line = Instant::now();
                complain(&format!(
                    "{}: {} of {}, {} signals/s",
                    printable(name),
                    HumanBytes(read),
                    HumanBytes(bytes),
                    thousands(rate() as u64)
                ));
            }
        }
        if let Some(bar) = bar {
            bar.finish_and_clear();
        }
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
    let digits = n.to_string();
    let mut out = String::new();
    for (i, d) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push(' ');
        }
        out.push(d);
    }
    out
}
