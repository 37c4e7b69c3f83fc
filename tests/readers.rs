//! Everything that reads what others wrote, by the name of its directory in `tests/corpus/`; for the
//! tests here and for the fuzz targets in `fuzz/`. A message or a result, no panic.

use bytes::Bytes;
use inkling::burst::Acquisition;
use inkling::io::baseline_file::BaselineFile;
use inkling::io::block_reader::BlockReader;
use inkling::io::burst_codec::BurstDecoder;
use inkling::io::dialect::guess::guess;
use inkling::io::journal::Journal;
use inkling::io::recording::Recording;
use inkling::io::table_file::Columns;
use inkling::io::verdict_reader::VerdictReader;
use inkling::io::{Limits, columnar, csv_table, design_file, episode_table, labels_file};
use inkling::settings::Settings;
use std::path::Path;
use std::sync::Arc;

/// Reads a file; of the journal it is `journal.jsonl` in a directory of its own.
pub type Reader = fn(&Path);

pub const READERS: [(&str, Reader); 11] = [
    ("burst", burst),
    ("recording", recording),
    ("foreign", foreign),
    ("table", |path| {
        let columns = Columns::default();
        match columnar::is_parquet(path) {
            Ok(true) => drop(columnar::read(path, &columns)),
            _ => drop(csv_table::read(path, &columns)),
        }
    }),
    ("labels", |path| drop(labels_file::read(path))),
    ("settings", |path| drop(Settings::load(Some(path), None, &[]))),
    ("design", |path| drop(design_file::read(path))),
    ("baseline", |path| drop(BaselineFile::read(path, None))),
    ("verdicts", |path| {
        if let Ok(rows) = VerdictReader::open(path) {
            rows.take_while(Result::is_ok).for_each(drop);
        }
    }),
    ("episodes", |path| drop(episode_table::read(path))),
    ("journal", |path| drop(Journal::read(path.parent().unwrap()))),
];

/// The reader of this name, and the name that the file it reads must have.
pub fn reader(name: &str) -> (&str, Reader) {
    let (_, read) = READERS.iter().find(|(of, _)| *of == name).expect("a reader");
    (if name == "journal" { "journal.jsonl" } else { name }, *read)
}

fn burst(path: &Path) {
    let bytes = Bytes::from(std::fs::read(path).unwrap());
    let topic: Arc<str> = "topic".into();
    if let Acquisition::Usable(burst) =
        BurstDecoder::new(Limits::default()).decode(bytes, 1, &topic)
    {
        let mut signal = vec![0.0; burst.samples_per_channel as usize];
        burst.copy_signal(burst.channels as usize - 1, &mut signal);
    }
}

fn recording(path: &Path) {
    if let Ok(recording) = Recording::open(path, Limits::default()) {
        read_whole(&recording);
    }
}

/// A recording of others: listed, guessed at, and read.
fn foreign(path: &Path) {
    let dialects = ["format=\"s16le\",schema=\"acme.Wave\"", "layout=\"sample-major\""].map(|own| {
        format!(
            "{{topic=\"**\",samples=\"data\",channels=2,period_s=1e-6,printhead=\"{{topic.0}}\",{own}}}"
        )
    });
    let set = format!("input.dialect=[{}]", dialects.join(","));
    let settings = Settings::load(None, None, &[set]).expect("settings of our own");
    if let Ok(recording) = Recording::open(path, Limits::default()) {
        let mut reader = recording.reader().counting();
        read_all(&recording, &mut reader);
        for topic in reader.topics() {
            if let (Some(written), Some(message)) = (topic.written(), &topic.first_message) {
                drop(guess(&written, &[message], &[&topic.topic]));
            }
        }
    }
    let dialects = settings.input.dialects();
    let Ok(recording) = Recording::open_with(path, Limits::default(), &dialects) else { return };
    drop(recording.dialects_used(1));
    read_whole(&recording);
}

fn read_whole(recording: &Recording) {
    read_all(recording, &mut recording.reader());
    drop(recording.digest());
}

fn read_all(recording: &Recording, reader: &mut BlockReader) {
    for block in recording.blocks().flatten() {
        reader.load(&block);
        while reader.next_piece(1 << 12).is_some() {}
    }
}
