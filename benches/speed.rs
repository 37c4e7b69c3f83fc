//! The steps of a replay, one by one: `cargo bench --bench speed`.
//!
//! Throughputs are in items: a signal of 128 samples, or a row. End to end:
//! `examples/benchmark_recording.rs` and `docs/design/streaming.md`.

use bytes::Bytes;
use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use inkling::burst::{Burst, Format, Layout};
use inkling::design::Design;
use inkling::detect::lane_sensitivity::{LaneSensitivity, Limits};
use inkling::detect::row_projection::{LANES, Projections, Room};
use inkling::io;
use inkling::io::burst_codec::{BurstDecoder, encode};
use inkling::io::design_file;
use inkling::io::verdict_table::{TableOptions, TimestampUnit, VerdictWriter};
use inkling::model::ring::Ring;
use inkling::model::ring_fit::{FitBuffers, RingFitter};
use inkling::processor::Instructions;
use inkling::verdict::{Outcome, VerdictColumns};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::path::Path;

fn main() {
    divan::main();
}

const SIGNALS: usize = 1024;
const SEED: u64 = 1;

fn design() -> Design {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("sample_logs/design.json");
    design_file::read(&path).expect("the sample's design").0
}

/// Healthy signals of the sample's model: what is expected and uniform noise.
fn burst(layout: Layout) -> Burst {
    let design = design();
    let model = &design.models[0];
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let mut noisy = |y: &f64| (y + 1.7 * model.noise * rng.random_range(-1.0..1.0)).round() as f32;
    let signals: Vec<Vec<f32>> =
        (0..SIGNALS).map(|_| model.expected.iter().map(&mut noisy).collect()).collect();
    Burst {
        temperature_c: Some(25.0),
        drive_voltage_v: design.drive_voltage_v,
        ..Burst::of(&signals, design.sample_period_s, Format::S16Le, layout)
    }
}

/// The sets of instructions, the widest last; what the processor lacks is not used.
const SETS: [Instructions; 3] = Instructions::ALL;

/// Each set with samples in either order.
fn forms() -> Vec<(Instructions, Layout)> {
    let layouts = [Layout::ChannelMajor, Layout::SampleMajor];
    layouts.into_iter().flat_map(|layout| SETS.map(|set| (set, layout))).collect()
}

const RAILS: [f64; 2] = [-32768.0, 32767.0];

/// Deviations to residual energies, in f64, eight signals side by side.
#[divan::bench(args = SETS)]
fn residual_energies(bencher: Bencher, instructions: &Instructions) {
    instructions.use_at_most();
    let (design, burst) = (design(), burst(Layout::ChannelMajor));
    let model = &design.models[0];
    let mut deviations = vec![0.0; SIGNALS * design.samples];
    for (row, d) in deviations.chunks_exact_mut(design.samples).enumerate() {
        burst.copy_signal(row, d);
        d.iter_mut().zip(&model.expected).for_each(|(y, e)| *y -= e);
    }
    bencher
        .counter(ItemsCount::new(SIGNALS))
        .bench_local(|| model.generator.energies(black_box(&deviations), design.samples));
}

/// int16 in a burst to settled verdicts, along the sensitivities.
#[divan::bench(args = forms())]
fn by_sensitivities(bencher: Bencher, &(instructions, layout): &(Instructions, Layout)) {
    instructions.use_at_most();
    let (model, burst) = (&design().models[0], burst(layout));
    let sensitivity = model.sensitivity.as_ref().expect("the sample's default method");
    let lanes = LaneSensitivity::new(sensitivity, &model.expected, None).expect("a usual model");
    let limits = Limits { near: 11.0, far: 1e3, unexplained: f64::INFINITY };
    let condition = lanes.condition(1.0, 0.0, limits, RAILS);
    let (mut products, mut room) = (Projections::default(), Room::default());
    bencher.counter(ItemsCount::new(SIGNALS)).bench_local(|| {
        let mut settled = 0;
        for first in (0..SIGNALS).step_by(LANES) {
            let rows = (&burst, first..first + LANES);
            lanes.columns.project(rows, &condition.expected, &mut products, &mut room);
            let judged = lanes.judge(&condition, &products, LANES);
            settled += judged.settled.iter().filter(|&&s| s).count();
        }
        settled
    });
}

/// A message to a burst; an item is a burst.
#[divan::bench(args = [1, 1024])]
fn burst_codec(bencher: Bencher, channels: u32) {
    let mut burst = burst(Layout::ChannelMajor);
    burst.channels = channels;
    burst.samples = burst.samples.slice(..(channels * burst.samples_per_channel) as usize * 2);
    let message = Bytes::from(encode(&burst));
    let mut decoder = BurstDecoder::new(io::Limits::default());
    let topic = "K1".into();
    bencher
        .counter(ItemsCount::new(1_u32))
        .bench_local(|| decoder.decode(black_box(message.clone()), 0, &topic));
}

/// Rings of faulty signals: the phase free, searched everywhere; one by one and side by side.
#[divan::bench(args = ["one by one", "side by side"])]
fn ring_fit(bencher: Bencher, how: &str) {
    let design = design();
    let fitter = RingFitter::new(ring_of(), design.sample_period_s, design.samples);
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let noise = design.models[0].noise;
    let signals: Vec<Vec<f64>> = (0..SIGNALS)
        .map(|i| {
            let of = &design.classes[i % design.classes.len()].deviation;
            let expected = design.models[0].expected.iter().zip(of);
            expected.map(|(e, d)| e + d + 1.7 * noise * rng.random_range(-1.0..1.0)).collect()
        })
        .collect();
    let mut work = FitBuffers::default();
    bencher.counter(ItemsCount::new(SIGNALS)).bench_local(|| {
        let mut found = 0;
        match how {
            "one by one" => {
                for y in &signals {
                    found += usize::from(fitter.fit(y, true, &mut work).is_some());
                }
            }
            _ => {
                let copy = |i: usize, y: &mut [f64]| y.copy_from_slice(&signals[i]);
                let fits = fitter.fit_all(true, &mut work, &[None; SIGNALS], copy);
                found += fits.iter().flatten().count();
            }
        }
        found
    });
}

/// Like the sample's healthy ring.
fn ring_of() -> Ring {
    Ring {
        amplitude: 400.0,
        phase_rad: 0.4,
        damping_per_s: 2.9e4,
        frequency_hz: 64_700.0,
        real_share: 0.06,
        lambda_per_s: 3.7e4,
    }
}

/// Verdicts to a Parquet file, 2 % faulty; an item is a row.
#[divan::bench(sample_count = 10)]
fn verdict_writer(bencher: Bencher) {
    const ROWS: usize = 1 << 20;
    const BATCH: usize = 4096;
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let mut c = VerdictColumns { printheads: vec!["K1".into()], ..Default::default() };
    for row in 0..BATCH {
        let faulty = rng.random_bool(0.02);
        c.acquired_at_ns.push(1_750_000_000_000_000_000 + 1_000_000 * (row / 1024) as i64);
        c.printhead.push(0);
        c.channel.push((row % 1024) as u32);
        c.outcome.push(if faulty { Outcome::Faulty } else { Outcome::Healthy });
        c.category.push(faulty.then_some(0));
        c.fault.push(faulty.then_some(0));
        c.candidate.push(faulty.then_some(0));
        c.certainty.push(faulty.then_some(0.9));
        c.statistic.push(Some(rng.random_range(0.01..0.1)));
        c.threshold.push(Some(0.18));
        c.model.push(Some(0));
    }
    c.fill_up();
    let batch = c.into();
    let dir = tempfile::tempdir().expect("a directory for scratch");
    let path = dir.path().join("r.verdicts.parquet");
    bencher.counter(ItemsCount::new(ROWS)).bench_local(|| {
        let options = TableOptions {
            recording: "r.mcap".into(),
            classes: vec!["EC".into()],
            categories: vec!["empty_channel".into()],
            weights: false,
            timestamp_unit: TimestampUnit::Ns,
        };
        let mut writer = VerdictWriter::create(&path, options).expect("created");
        (0..ROWS / BATCH).for_each(|_| writer.write(&batch).expect("written"));
        let complete = writer.complete("{}".into()).expect("complete");
        complete.name().expect("named");
    });
}
