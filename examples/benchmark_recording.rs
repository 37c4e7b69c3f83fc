//! Writes a recording to measure `inkling replay` with: any size, codec, burst shape and share of
//! faulty signals, made from a design. Same arguments, same bytes.
//!
//! ```sh
//! cargo run --release --example benchmark_recording -- sample_logs/design.json big.mcap \
//!     --signals 4000000 --compression zstd --channels 1024 --faulty 0.02
//! ```
//!
//! Signals are what the design expects plus white noise, rounded to int16, drawn once into a pool
//! that is larger than any chunk and dealt in turn, so that a codec finds no repetition. A faulty
//! signal is a class's mean deviation more.

use clap::Parser;
use inkling::burst::{Burst, Format, Layout};
use inkling::io::design_file;
use inkling::io::recording_writer::{Compression, RecordingWriter, WriterOptions};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};
use std::error::Error;
use std::path::PathBuf;
use std::sync::Arc;

#[derive(Parser)]
struct Args {
    design: PathBuf,
    recording: PathBuf,
    #[arg(long, default_value_t = 4_000_000)]
    signals: u64,
    /// none, lz4 or zstd
    #[arg(long, default_value = "none")]
    compression: String,
    /// Channels per burst
    #[arg(long, default_value_t = 1024)]
    channels: u32,
    /// More than 1: bursts of so many printheads in turn, the first the design's
    #[arg(long, default_value_t = 1)]
    printheads: u32,
    /// Share of faulty signals
    #[arg(long, default_value_t = 0.02)]
    faulty: f64,
}

/// Healthy signals drawn before they repeat; beyond the window of any chunk.
const POOL: usize = 1 << 16;
const FAULTY_POOL: usize = 1 << 13;

fn main() -> Result<(), Box<dyn Error>> {
    let args = Args::parse();
    let (design, _) = design_file::read(&args.design)?;
    let model = design.models.first().unwrap_or(&design.pooled);
    let n = design.samples;
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let noise = Normal::new(0.0, model.noise)?;
    let mut draw = |class: Option<usize>, pool: &mut Vec<i16>| {
        for k in 0..n {
            let deviation = class.map_or(0.0, |c| design.classes[c].deviation[k]);
            let y = model.expected[k] + deviation + noise.sample(&mut rng);
            pool.push(y.round().clamp(-32767.0, 32766.0) as i16);
        }
    };
    let (mut healthy, mut faulty) = (Vec::new(), Vec::new());
    (0..POOL).for_each(|_| draw(None, &mut healthy));
    let classes = design.classes.len();
    (0..FAULTY_POOL).for_each(|i| draw(i.checked_rem(classes), &mut faulty));

    let compression = match args.compression.as_str() {
        "none" => Compression::None,
        "lz4" => Compression::Lz4,
        "zstd" => Compression::Zstd,
        other => return Err(format!("--compression {other}: none, lz4 or zstd").into()),
    };
    let options = WriterOptions { compression, chunk_bytes: Some(1 << 20) };
    let mut writer = RecordingWriter::create(&args.recording, options)?;
    let known = model.printhead.as_deref().unwrap_or("K1");
    let name = |k: u32| if k == 0 { known.into() } else { format!("{known}-{k}").into() };
    let printheads: Vec<Arc<str>> = (0..args.printheads.max(1)).map(name).collect();
    // each burst of the next printhead; of one alone, channels follow each other
    let channels_of_all =
        if printheads.len() > 1 { args.channels } else { args.channels.max(1024) };
    let (mut next_healthy, mut next_faulty, mut written, mut first_channel, mut bursts) =
        (0, 0, 0, 0, 0);
    let mut turns = printheads.iter().cycle();
    let mut t_ns = 1_750_000_000_000_000_000_i64;
    let mut burst = Burst {
        topic: 0,
        t_acq_ns: t_ns,
        logged_ns: t_ns,
        printhead: printheads[0].clone(),
        first_channel,
        channels: args.channels,
        samples_per_channel: n as u32,
        sample_period_s: design.sample_period_s,
        format: Format::S16Le,
        layout: Layout::ChannelMajor,
        samples: Default::default(),
        temperature_c: model.temperature_c,
        drive_voltage_v: design.drive_voltage_v,
        idle_time_s: Vec::new(),
        neighbours_fired: Default::default(),
    };
    let channels = args.channels as usize;
    let mut chosen: Vec<&[i16]> = Vec::with_capacity(channels);
    while written < args.signals {
        chosen.clear();
        for _ in 0..channels {
            let (pool, next) = if rng.random_bool(args.faulty) {
                (&faulty, &mut next_faulty)
            } else {
                (&healthy, &mut next_healthy)
            };
            let at = (*next * n) % pool.len();
            chosen.push(&pool[at..at + n]);
            *next += 1;
        }
        let samples = chosen.iter().flat_map(|signal| signal.iter());
        burst.samples = samples.flat_map(|y| y.to_le_bytes()).collect::<Vec<u8>>().into();
        burst.t_acq_ns = t_ns;
        burst.first_channel = first_channel;
        burst.printhead.clone_from(turns.next().unwrap_or(&printheads[0]));
        writer.write(&burst, t_ns as u64)?;
        written += u64::from(args.channels);
        bursts += 1;
        // one printhead has 1024 channels or more, acquired about a thousand times a second
        first_channel = (first_channel + args.channels) % channels_of_all;
        if first_channel == 0 && bursts % printheads.len() == 0 {
            t_ns += 1_000_000;
        }
    }
    writer.finish()?;
    println!("{}: {written} signals", args.recording.display());
    Ok(())
}
