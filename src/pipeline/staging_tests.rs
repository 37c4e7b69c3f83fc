//! Measures what the division into stages costs: the same stage functions, batch by batch in one
//! thread without queues between threads (`fused`), against the stages side by side. The test is
//! ignored by default; it prints processor time and wall time of both, three times, and asserts
//! that both judge as many signals.
//!
//! ```sh
//! INKLING_RECORDING=none.mcap cargo test --release --lib staging -- --ignored --nocapture
//! ```

use super::batches::{BufferPools, ReadBatch};
use super::episodes::EpisodeTap;
use super::groups::Groups;
use super::head_clock::FileOrder;
use super::in_flight::InFlight;
use super::judges::Judges;
use super::replay::replay;
use super::run::Replay;
use super::stages::{self, BlockQueue, JudgeAssignment};
use super::tally::Tally;
use super::temperature_check::TemperatureCheck;
use super::timings::Timings;
use super::visit::Pass;
use super::{Control, Result};
use crate::settings::Settings;
use crossbeam_channel::{Receiver, Sender, unbounded};
use inkling_core::burst::{Place, SignalBatch};
use inkling_core::fault::categories;
use inkling_io::episode_table::EpisodeWriter;
use inkling_io::recording::Recording;
use inkling_io::verdict_table::{TableOptions, TimestampUnit, VerdictWriter};
use inkling_io::{Limits, design_file};
use std::path::Path;
use std::time::Instant;

/// User and system time of this process so far, s, with a resolution of .01 s.
pub(super) fn cpu_s() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap();
    let after_name = stat.rsplit(") ").next().unwrap();
    let ticks = after_name.split(' ').skip(11).take(2).map(|t| t.parse::<f64>().unwrap());
    ticks.sum::<f64>() / 100.0
}

/// Sends one batch through a stage, and returns what comes out.
fn through<A, B>(of: A, stage: impl FnOnce(Receiver<A>, Sender<B>) -> Result<()>) -> B {
    let ((to_stage, input), (out, from_stage)) = (unbounded(), unbounded());
    to_stage.send(of).unwrap();
    drop(to_stage);
    stage(input, out).unwrap();
    from_stage.recv().unwrap()
}

/// Judges a recording batch by batch in one thread, by the design's models as they are. Returns the
/// number of rows written.
fn fused(run: &Replay, recording: &Recording, verdicts: &Path) -> u64 {
    let (control, timings, pools) =
        (Control::default(), Timings::default(), BufferPools::default());
    let settings = &run.settings;
    let classes = run.classes();
    let (categories, _) = categories(&run.fault_classes());
    let beside = inkling_io::episode_table::path_beside(verdicts);
    let unit = TimestampUnit::Ns;
    let table = EpisodeWriter::create(&beside, unit, "r.mcap").unwrap();
    let mut episodes = EpisodeTap::create(run, None, Some(table)).unwrap();
    let judges = Judges::new(run, Pass { recording, control: &control });
    let temperatures = TemperatureCheck::default();
    let mut deciding = JudgeAssignment {
        groups: Groups::default(),
        judges,
        order: FileOrder::of(recording),
        clocks: Vec::new(),
        temperatures,
        following: None,
    };
    let options = TableOptions {
        recording: "r.mcap".into(),
        classes: classes.clone(),
        categories,
        weights: false,
        timestamp_unit: unit,
    };
    let mut writer = VerdictWriter::create(verdicts, options).unwrap();
    let mut tally = Tally::new(classes);

    // blocks are judged one at a time, so they always have room
    let in_flight = InFlight::new(2, u64::MAX);
    let queue = BlockQueue::new(recording, &in_flight, &control);
    let mut reader = recording.reader();
    let mut clock = timings.clock("reader");
    while let Some((block, read)) = queue.next(&mut clock).unwrap() {
        reader.load_read(&block, read);
        while let Some(piece) = reader.next_piece(32_768) {
            // each batch goes through stages of its own, for which it is the first
            let place = Place::default();
            let batch = SignalBatch { place, acquisitions: piece.acquisitions };
            let (definitions, damage) = (reader.definitions(), piece.damage);
            let read = ReadBatch { batch, block, definitions, leaves: Some(0), damage };
            let clock = |stage| timings.clock(stage);
            let assigned = through(read, |input, out| {
                let clock = clock("identify");
                stages::identify(&mut deciding, &in_flight, clock, input, out)
            });
            let filtered = stages::filter(settings.input.rails, &pools)(assigned);
            let gated = stages::gate(&pools, filtered);
            let mut judged = stages::isolate(settings, &pools)(gated);
            episodes.add(&mut judged).unwrap();
            writer.write(&judged.verdicts).unwrap();
            tally.add(&judged);
            pools.tests.give(judged.verdicts.tests);
            pools.rows.give(judged.verdicts.rows);
        }
        in_flight.leave(block.held_bytes());
    }

    queue.finish().unwrap();
    episodes.finish().unwrap();
    let rows = writer.rows();
    writer.complete("{}".into()).unwrap().name().unwrap();
    rows
}

#[test]
#[ignore = "measures: wants a recording in INKLING_RECORDING and some seconds"]
fn staging_against_one_fused_loop() {
    let recording = std::env::var_os("INKLING_RECORDING").expect("INKLING_RECORDING");
    let recording = Recording::open(Path::new(&recording), Limits::default()).unwrap();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("sample_logs/design.json");
    let (design, digest) = design_file::read(&path).unwrap();
    let mut settings = Settings::default();
    settings.identify.mode = crate::settings::IdentifyMode::Design;
    let run =
        Replay { settings, design: Some(design), design_digest: Some(digest), ..Replay::default() };
    let dir = tempfile::tempdir().unwrap();
    let verdicts = dir.path().join("r.verdicts.parquet");
    for _ in 0..3 {
        let measured = |what: &str, f: &mut dyn FnMut() -> u64| {
            let (cpu, wall) = (cpu_s(), Instant::now());
            let rows = f();
            let (cpu, wall) = (cpu_s() - cpu, wall.elapsed().as_secs_f64());
            println!("{what:<8} {rows} rows, CPU {cpu:.2} s, wall {wall:.2} s");
            rows
        };
        let alone = measured("fused", &mut || fused(&run, &recording, &verdicts));
        let staged = measured("staged", &mut || {
            let report = replay(&run, &recording, &verdicts, &Control::default()).unwrap();
            report.tally.counts.signals
        });
        // both ways judge the same signals
        assert_eq!(alone, staged);
    }
}
