//! Copies of one night's results, each a day later, to try `inkling report` on many:
//! `cargo run --release --example many_nights -- out/print_run many/ 50`.

use inkling::episodes::Episode;
use inkling::io::episode_table::{self, EpisodeWriter};
use inkling::io::verdict_reader::VerdictReader;
use inkling::io::verdict_table::{TableOptions, TimestampUnit, VerdictWriter};
use serde_json::Value;
use std::error::Error;
use std::path::Path;

const DAY_NS: i64 = 86_400_000_000_000;

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [stem, into, nights] = args.as_slice() else {
        return Err("give the results' stem, a directory, how many".into());
    };
    let verdicts = format!("{stem}.verdicts.parquet");
    let episodes = episode_table::read(&episode_table::path_beside(Path::new(&verdicts)))?;
    let summary: Value = serde_json::from_slice(&std::fs::read(format!("{stem}.summary.json"))?)?;
    for night in 0..nights.parse::<i64>()? {
        let mut document = summary.clone();
        document["recording"]["digest"] = format!("copy {night}").into();
        let to = |kind: &str| Path::new(into).join(format!("{night:04}.{kind}"));
        copy(Path::new(&verdicts), &to("verdicts.parquet"), night * DAY_NS, &document)?;
        let later = |e: &Episode| Episode {
            raised_at_ns: e.raised_at_ns + night * DAY_NS,
            began_at_ns: e.began_at_ns + night * DAY_NS,
            ended_at_ns: e.ended_at_ns.map(|t| t + night * DAY_NS),
            ..e.clone()
        };
        let mut table =
            EpisodeWriter::create(&to("episodes.parquet"), TimestampUnit::Ns, "r.mcap")?;
        table.write(episodes.iter().map(later).collect())?;
        table.complete(document.to_string())?.name()?;
        std::fs::write(to("summary.json"), document.to_string())?;
    }
    Ok(())
}

fn copy(from: &Path, to: &Path, later_ns: i64, document: &Value) -> Result<(), Box<dyn Error>> {
    let reader = VerdictReader::open(from)?;
    let options = TableOptions {
        recording: "r.mcap".into(),
        classes: reader.classes().to_vec(),
        categories: reader.categories().to_vec(),
        weights: false,
        timestamp_unit: TimestampUnit::Ns,
    };
    let mut writer = VerdictWriter::create(to, options)?;
    for columns in reader {
        let mut columns = columns?;
        columns.acquired_at_ns.iter_mut().for_each(|t| *t += later_ns);
        writer.write(&columns.into())?;
    }
    Ok(writer.complete(document.to_string())?.name()?)
}
