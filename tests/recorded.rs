//! Bursts, recordings and tables as tests read, write and change them.

use crate::house::root;
use arrow_array::cast::AsArray;
use arrow_array::types::ArrowPrimitiveType;
use arrow_array::{Array, RecordBatch};
use inkling::burst::{Acquisition, Burst, Format, Layout};
use inkling::io::Limits;
use inkling::io::recording::Recording;
use inkling::io::recording_writer::{RecordingWriter, WriterOptions};
use inkling::io::verdict_reader::VerdictReader;
use inkling::verdict::{Outcome, VerdictColumns};
use parquet::arrow::arrow_reader::{ArrowReaderOptions, ParquetRecordBatchReaderBuilder};
use std::collections::BTreeMap;
use std::fs::File;
use std::path::Path;

pub fn sample(name: &str) -> std::path::PathBuf {
    root().join("sample_logs").join(name)
}

pub fn bursts(path: &Path) -> Vec<Burst> {
    let recording = Recording::open(path, Limits::default()).unwrap();
    let mut reader = recording.reader();
    let blocks: Vec<_> = recording.blocks().map(Result::unwrap).collect();
    blocks
        .iter()
        .flat_map(|block| reader.read(block).acquisitions)
        .map(|acquisition| match acquisition {
            Acquisition::Usable(burst) => burst,
            Acquisition::Unusable(u) => panic!("unusable: {u:?}"),
        })
        .collect()
}

pub fn write(path: &Path, bursts: &[Burst], options: WriterOptions) {
    let mut writer = RecordingWriter::create(path, options).unwrap();
    for (i, burst) in bursts.iter().enumerate() {
        writer.write(burst, 1_000_000_000 + i as u64).unwrap(); // log time says nothing
    }
    writer.finish().unwrap();
}

/// When and of which channel a signal was acquired: time, printhead, channel.
pub type Acquired = (i64, String, u32);

/// What is said of each signal.
pub type Verdicts = BTreeMap<Acquired, String>;

/// The rows of a table in their order: of which signal, and what `said` makes of it.
pub fn each_row<T>(path: &Path, said: impl Fn(&VerdictColumns, usize) -> T) -> Vec<(Acquired, T)> {
    let row = |c: &VerdictColumns, i: usize| {
        let printhead = c.printheads[c.printhead[i] as usize].to_string();
        ((c.acquired_at_ns[i], printhead, c.channel[i]), said(c, i))
    };
    let batches = VerdictReader::open(path).unwrap().map(Result::unwrap);
    batches.flat_map(|c| (0..c.len()).map(|i| row(&c, i)).collect::<Vec<_>>()).collect()
}

/// The rows of a table in their order: of which signal, and all that is said of it.
pub fn table_rows(path: &Path) -> Vec<(Acquired, String)> {
    each_row(path, |c, i| {
        format!(
            "{:?} {:?} {:?} {:?} {:?} {:?} {:?} {:?} {:?} {:?} {:?} {:?}",
            c.outcome[i],
            c.category[i],
            c.fault[i],
            c.candidate[i],
            c.certainty[i],
            c.statistic[i],
            c.threshold[i],
            c.test[i],
            c.misfit[i],
            c.severity[i],
            c.severity_sd[i],
            c.reason[i]
        )
    })
}

pub fn verdicts(path: &Path) -> Verdicts {
    let mut verdicts = Verdicts::new();
    for (of, said) in table_rows(path) {
        assert!(verdicts.insert(of, said).is_none(), "a signal has two rows");
    }
    verdicts
}

pub fn signal(burst: &Burst, row: usize) -> Vec<f64> {
    let mut y = vec![0.0; burst.samples_per_channel as usize];
    burst.copy_signal(row, &mut y);
    y
}

pub fn rows(burst: &Burst) -> Vec<Vec<f64>> {
    (0..burst.channels as usize).map(|row| signal(burst, row)).collect()
}

/// The burst with other signals, of as many samples, and in another form.
pub fn with_signals(burst: &Burst, signals: &[Vec<f32>], (format, layout): Form) -> Burst {
    let of = Burst::of(signals, burst.sample_period_s, format, layout);
    Burst { format, layout, channels: of.channels, samples: of.samples, ..burst.clone() }
}

type Form = (Format, Layout);
pub const AS_RECORDED: Form = (Format::S16Le, Layout::ChannelMajor);
pub const SAMPLE_MAJOR_FLOATS: Form = (Format::F32Le, Layout::SampleMajor);

/// The burst with other samples, in counts: `other` knows the row, the number of a sample, and what it was.
pub fn with_samples(burst: &Burst, other: impl Fn(usize, usize, f64) -> f64) -> Burst {
    let count = |row: usize, k: usize, y: &f64| other(row, k, *y).round() as f32;
    let of = |(row, y): (usize, &Vec<f64>)| {
        y.iter().enumerate().map(|(k, y)| count(row, k, y)).collect()
    };
    let signals: Vec<Vec<f32>> = rows(burst).iter().enumerate().map(of).collect();
    with_signals(burst, &signals, AS_RECORDED)
}

pub fn counts(burst: &Burst) -> Vec<Vec<f32>> {
    rows(burst).iter().map(|y| y.iter().map(|y| *y as f32).collect()).collect()
}

/// Rings a quarter as long: another resonance, the same sampling.
pub fn slower(burst: &Burst) -> Burst {
    let rows = rows(burst);
    with_samples(burst, |row, k, _| rows[row][k * 3 / 4])
}

/// What is said of one signal.
#[allow(dead_code, reason = "the rates use the rest")]
pub struct Said {
    pub of: Acquired,
    pub outcome: Outcome,
    pub fault: Option<String>,
    pub has_category: bool,
    pub certainty: f32,
    pub misfit: Option<f32>,
}

#[allow(dead_code, reason = "the rates use them")]
impl Said {
    pub fn is_healthy(&self) -> bool {
        self.outcome == Outcome::Healthy
    }

    pub fn is_flagged(&self) -> bool {
        matches!(self.outcome, Outcome::Faulty | Outcome::Undecided)
    }

    /// A class or a category has a certainty of .8.
    pub fn is_named(&self) -> bool {
        self.certainty >= 0.8 && (self.fault.is_some() || self.has_category)
    }
}

/// The rows of a table of verdicts, in its order.
pub fn said(table: &Path) -> Vec<Said> {
    let mut reader = VerdictReader::open(table).unwrap();
    let mut said = Vec::new();
    while let Some(columns) = reader.next() {
        let c = columns.unwrap();
        let name = |class: u16| reader.classes()[class as usize].clone();
        said.extend((0..c.len()).map(|i| {
            let printhead = c.printheads[c.printhead[i] as usize].to_string();
            Said {
                of: (c.acquired_at_ns[i], printhead, c.channel[i]),
                outcome: c.outcome[i],
                fault: c.fault[i].map(name),
                has_category: c.category[i].is_some(),
                certainty: c.certainty[i].unwrap_or(0.0),
                misfit: c.misfit[i],
            }
        }));
    }
    said
}

/// As programs that know nothing of Arrow read them: texts are texts.
pub fn batches(path: &Path) -> Vec<RecordBatch> {
    let file = File::open(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let plain = ArrowReaderOptions::new().with_skip_arrow_metadata(true);
    let batches = ParquetRecordBatchReaderBuilder::try_new_with_options(file, plain).unwrap();
    batches.build().unwrap().map(Result::unwrap).collect()
}

/// Of a column that may be missing.
pub fn texts(batch: &RecordBatch, name: &str) -> Vec<Option<String>> {
    let column = batch.column_by_name(name).map(|c| c.as_string::<i32>());
    (0..batch.num_rows())
        .map(|i| column.filter(|c| c.is_valid(i)).map(|c| c.value(i).to_owned()))
        .collect()
}

/// Likewise of numbers and times.
pub fn cells<T: ArrowPrimitiveType>(batch: &RecordBatch, name: &str) -> Vec<Option<T::Native>> {
    let column = batch.column_by_name(name).map(|c| c.as_primitive::<T>());
    (0..batch.num_rows()).map(|i| column.filter(|c| c.is_valid(i)).map(|c| c.value(i))).collect()
}
