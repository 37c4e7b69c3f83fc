//! How much memory a piece of work holds at most: counted where it is asked for, so that it is the same on every
//! machine, and what is only claimed counts, too. (What C libraries take by themselves, zstd's windows, does not.)
//!
//! Other tests in the process would be counted with it: work that is measured runs in a process of its own.

use crate::house::{House, shipped};
use crate::recipes::some;
use crate::recorded::{sample, write};
use inkling::burst::Burst;
use inkling::io::dialect::Dialects;
use inkling::io::journal::Journal;
use inkling::io::recording::Recording;
use inkling::io::recording_writer::{Compression, WriterOptions};
use inkling::io::{Limits, design_file};
use inkling::pipeline::{self, Control, Replay, Watch};
use inkling::settings::Settings;
use std::alloc::{GlobalAlloc, Layout, System};
use std::path::Path;
use std::process::Command;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

#[global_allocator]
static COUNTING: Counting = Counting;

const HOUR_NS: i64 = 3_600_000_000_000;

static HELD: AtomicUsize = AtomicUsize::new(0);
static MOST: AtomicUsize = AtomicUsize::new(0);

/// The system's, counted.
struct Counting;

fn take(bytes: usize) {
    let held = HELD.fetch_add(bytes, Relaxed) + bytes;
    MOST.fetch_max(held, Relaxed);
}

// SAFETY: all is the system's own; the counts touch no memory but themselves
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        take(layout.size());
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        take(layout.size());
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, at: *mut u8, layout: Layout, bytes: usize) -> *mut u8 {
        take(bytes); // both are held while it is moved
        HELD.fetch_sub(layout.size(), Relaxed);
        unsafe { System.realloc(at, layout, bytes) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        HELD.fetch_sub(layout.size(), Relaxed);
        unsafe { System.dealloc(at, layout) }
    }
}

/// How many bytes more than before were held at once while it was done.
pub fn most_of<T>(work: impl FnOnce() -> T) -> (T, usize) {
    let before = HELD.load(Relaxed);
    MOST.store(before, Relaxed);
    let done = work();
    (done, MOST.load(Relaxed).saturating_sub(before))
}

/// Runs the calling test in a process of its own: the work is done there alone.
pub fn alone(work: impl FnOnce()) {
    const ALONE: &str = "INKLING_TEST_ALONE";
    // the harness names the thread of a test after it
    let thread = std::thread::current();
    let test = thread.name().expect("the name of a test");
    if std::env::var_os(ALONE).is_some() {
        return work();
    }
    let ended = Command::new(std::env::current_exe().unwrap())
        .args([test, "--exact", "--nocapture"])
        .env(ALONE, "1")
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&ended.stdout) + String::from_utf8_lossy(&ended.stderr);
    print!("{said}");
    assert!(ended.status.success() && said.contains("1 passed"), "{test}: {}", ended.status);
}

#[test]
fn what_is_held_is_counted() {
    alone(|| {
        let (held, most) = most_of(|| vec![1u8; 3 << 20]);
        assert!((3 << 20..4 << 20).contains(&most), "{most}");
        let (_, most) = most_of(|| {
            let mut grows = held;
            grows.reserve_exact(8 << 20);
            grows
        });
        assert!((11 << 20..12 << 20).contains(&most), "moved: {most}");
        let (_, most) = most_of(|| (0..100).for_each(|_| drop(vec![0u8; 1 << 20])));
        assert!((1 << 20..2 << 20).contains(&most), "one after the other: {most}");
        let (_, most) = most_of(|| std::thread::spawn(|| vec![0u8; 1 << 20].len()).join());
        assert!(most >= 1 << 20, "other threads, too: {most}");
    });
}

/// A replay by the design in a file.
pub fn by_design(path: &Path, settings: Settings) -> Option<Replay> {
    let (design, digest) = design_file::read(path).ok()?;
    Some(Replay {
        settings,
        design: Some(design),
        design_digest: Some(digest),
        ..Replay::default()
    })
}

/// Whether what `judge` does with `long.mcap` holds hardly more of 160 hours than of 40, which fill all queues.
fn holds_no_more_of_a_longer_one(judge: impl Fn(&House, &Replay)) {
    let house = House::new();
    let hour = some(0, 60);
    let held = |hours: i64| {
        let later = |h: i64| {
            hour.iter().map(move |b| Burst { t_acq_ns: b.t_acq_ns + h * HOUR_NS, ..b.clone() })
        };
        let bursts: Vec<Burst> = (0..hours).flat_map(later).collect();
        house.record("long.mcap", &bursts);
        let run = by_design(&sample("design.json"), Settings::default()).unwrap();
        let ((), most) = most_of(|| judge(&house, &run));
        (house.read("long.mcap").len(), most)
    };
    let ((short_bytes, of_short), (long_bytes, of_long)) = (held(40), held(160));
    println!("{short_bytes} bytes: {of_short} held; {long_bytes} bytes: {of_long} held");
    let more = of_long.saturating_sub(of_short);
    assert!(more < (long_bytes - short_bytes) / 4, "{of_short} and {of_long} held");
}

#[test]
fn judging_a_longer_recording_holds_no_more() {
    alone(|| {
        holds_no_more_of_a_longer_one(|house, run| {
            let recording = Recording::open(&house.path("long.mcap"), Limits::default()).unwrap();
            let verdicts = house.path("out/long.verdicts.parquet");
            pipeline::replay(run, &recording, &verdicts, &Control::default()).unwrap();
        });
    });
}

#[test]
fn following_a_longer_recording_holds_no_more() {
    alone(|| {
        holds_no_more_of_a_longer_one(|house, run| {
            let (control, path) = (Control::default(), house.path("long.mcap"));
            let (dialects, enough) = (Dialects::default(), control.enough.clone());
            let recording = Recording::follow(&path, Limits::default(), &dialects, enough).unwrap();
            let watch = Watch { episode: &|_| (), rows: None };
            let verdicts = house.path("out/long.verdicts.parquet");
            pipeline::follow(run, &recording, &verdicts, &control, &watch).unwrap();
        });
    });
}

/// Bursts that repeat compress to little, and a few kilobytes of the file become a chunk of 32 MiB in memory.
#[test]
fn chunks_count_as_large_as_they_are_in_memory() {
    alone(|| {
        const CHUNK: usize = 32 << 20;
        let house = House::new();
        let [burst] = <[Burst; 1]>::try_from(some(0, 1)).unwrap();
        let messages = 16 * CHUNK / burst.samples.len();
        let at =
            |i: usize| Burst { t_acq_ns: burst.t_acq_ns + i as i64 * 1_000_000, ..burst.clone() };
        let bursts: Vec<Burst> = (0..messages).map(at).collect();
        let chunk_bytes = Some(CHUNK as u64);
        let chunks = WriterOptions { compression: Compression::Zstd, chunk_bytes };
        write(&house.path("packed.mcap"), &bursts, chunks);
        assert!(house.read("packed.mcap").len() < CHUNK / 4);
        let mut settings = Settings::default();
        settings.replay.threads = 4;
        let run = by_design(&sample("design.json"), settings).unwrap();
        let recording = Recording::open(&house.path("packed.mcap"), Limits::default()).unwrap();
        let verdicts = house.path("packed.verdicts.parquet");
        let judge = || pipeline::replay(&run, &recording, &verdicts, &Control::default()).unwrap();
        let (_, most) = most_of(judge);
        println!("{} MiB held", most >> 20);
        // a chunk or two in flight, and the verdicts of their signals; all chunks together would be sixteen
        assert!(most < 5 * CHUNK, "{most} bytes held");
    });
}

#[test]
fn a_finished_recording_is_remembered_in_some_2_kilobytes() {
    alone(|| {
        let house = House::new();
        let line = shipped("tests/corpus/journal/plain");
        let remembered = |n: usize| {
            let of = |i: usize| line.replace("a.verdicts", &format!("{i}/a.verdicts")) + "\n";
            house.write("journal.jsonl", (0..n).map(of).collect::<String>());
            let (journal, most) = most_of(|| Journal::read(&house.path(".")).unwrap());
            assert!(journal.of_result(&format!("{}/a.verdicts.parquet", n - 1)).is_some());
            most
        };
        let each = (remembered(4000) - remembered(1000)) / 3000;
        println!("{each} bytes each");
        assert!(each < 2500, "{each} bytes each");
    });
}
