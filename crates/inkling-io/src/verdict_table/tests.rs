use super::*;
use crate::documented::is_documented;
use crate::fixtures::{names, place};
use crate::verdict_reader::{VerdictReader, document_of};
use inkling_core::verdict::{COLUMNS, Cells, HealthyRun, Outcome, Reason, Test, VerdictColumns};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// The metadata document of a table with the names of [`options`].
const DOCUMENT: &str =
    r#"{"classes":["EC","AB1","my,own"],"categories":["empty_channel","air_bubble"]}"#;

pub(crate) fn options(weights: bool, timestamp_unit: TimestampUnit) -> TableOptions {
    let list = |of: &[&str]| of.iter().map(|s| s.to_string()).collect();
    TableOptions {
        recording: "night/1.mcap".into(),
        classes: list(&["EC", "AB1", "my,own"]),
        categories: list(&["empty_channel", "air_bubble"]),
        weights,
        timestamp_unit,
    }
}

/// Rows with every outcome, reason and pattern of nulls, numbered from `from`.
pub(crate) fn rows(from: u32, rows: u32, printheads: &[&str]) -> VerdictColumns {
    let (known, reasons) = (printheads.len() as u32, Reason::ALL.len());
    let printheads: Vec<Arc<str>> = printheads.iter().map(|&p| p.into()).collect();
    let mut c = VerdictColumns { printheads, ..Default::default() };
    for i in from..from + rows {
        let k = i as usize;
        let t_ns = 1_700_000_000_123_456_000 + i64::from(i) * 1000;
        for (place, column) in COLUMNS.iter().enumerate() {
            // every n-th row has a value: which of them
            let n = place % 6 + 1;
            let nth = k.is_multiple_of(n).then_some(k / n);
            let number = nth.map(|m| m as f32 / 7.0);
            match &column.cells {
                Cells::Time(at) => at.of_mut(&mut c).push(t_ns),
                Cells::Printhead(at) => at.of_mut(&mut c).push(i % known),
                Cells::Channel(at) if i == from => at.of_mut(&mut c).push(u32::MAX),
                Cells::Channel(at) => at.of_mut(&mut c).push(i),
                Cells::Outcome(at) => at.of_mut(&mut c).push(Outcome::ALL[k % 4]),
                Cells::Category(at) => at.of_mut(&mut c).push(nth.map(|m| m as u16 % 2)),
                Cells::Class(at) => at.of_mut(&mut c).push(nth.map(|m| m as u16 % 3)),
                Cells::Test(at) => at.of_mut(&mut c).push(nth.map(|m| Test::ALL[m % 3])),
                Cells::Reason(at) => {
                    at.of_mut(&mut c).push(nth.map(|m| Reason::ALL[m % reasons]));
                }
                Cells::Model(at) => at.of_mut(&mut c).push(nth.map(|m| m as u16)),
                Cells::Statistic(at)
                | Cells::Threshold(at)
                | Cells::Misfit(at)
                | Cells::Temperature(at)
                | Cells::Drive(at)
                | Cells::Number(at) => at.of_mut(&mut c).push(number),
                Cells::Recording => {}
                Cells::Weights => {
                    let start = (i % 3 > 0).then_some(c.weights.len() as u32);
                    c.weights_start.push(start);
                    c.weights.extend(start.iter().flat_map(|_| [i as f32, 0.25, -1.0]));
                }
            }
        }
    }
    c
}

/// Rows and runs of healthy signals, in any order.
pub(crate) fn rows_and_runs(rng: &mut ChaCha8Rng, batch: u32) -> Verdicts {
    let (mut tests, mut parts, mut next) = (Tests::default(), Vec::new(), 0);
    for part in 0..rng.random_range(1..20u32) {
        if rng.random_bool(0.3) {
            let from = next;
            next += rng.random_range(1..=25);
            parts.push(Part::Rows(from..next));
            continue;
        }
        let from = tests.statistic.len();
        for _ in 0..rng.random_range(1..200) {
            let known = rng.random_bool(0.9);
            tests.statistic.push(rng.random_range(0.0..9.0));
            tests.misfit.push(if known { rng.random_range(0.5..2.0) } else { f32::NAN });
            tests.beside.push(part % 2 == 1 && rng.random_bool(0.4));
            tests.healthy.push(true);
        }
        parts.push(Part::Healthy(HealthyRun {
            t_ns: 1_700_000_000_000_000_000 + i64::from(batch) * 1_000_000,
            printhead: rng.random_range(0..2),
            first_channel: rng.random_range(0..u32::MAX - 200),
            signals: from..tests.statistic.len(),
            model: rng.random_range(0..3),
            along: Test::Ring,
            threshold: 18.5,
            temperature_c: rng.random_bool(0.8).then_some(31.0 + batch as f32),
            drive_voltage_v: Some(27.5),
            beside: 11.0 + f32::from(rng.random_range(0..2u8)),
        }));
    }
    Verdicts { rows: rows(batch * 500, 500, &["K1", "K2"]), tests, parts }
}

/// Writes a table and says of how many rows.
pub(crate) fn write(path: &Path, options: TableOptions, batches: &[Verdicts]) -> usize {
    let mut writer = VerdictWriter::create(path, options).unwrap();
    for batch in batches {
        writer.write(batch).unwrap();
    }
    let rows = writer.rows;
    assert!(!path.exists(), "no name before it is complete");
    writer.complete(DOCUMENT.into()).unwrap().name().unwrap();
    rows as usize
}

#[test]
fn rows_written_are_rows_read_back_over_batches_with_other_printheads() {
    let batches = [rows(0, 1000, &["K1", "K2"]), rows(1000, 777, &["K3"]), rows(5, 0, &["x"])];
    // the rows of a table do not depend on where batches end, but for their printheads
    let mut expected = rows(0, 1777, &["K1", "K2"]);
    expected.channel[1000] = u32::MAX;
    let name = |c: &VerdictColumns, row: usize| c.printheads[c.printhead[row] as usize].clone();
    let names_of = |c: &VerdictColumns| (0..c.len()).map(|row| name(c, row)).collect::<Vec<_>>();
    let heads: Vec<Arc<str>> = batches.iter().flat_map(names_of).collect();
    let verdicts = batches.map(Verdicts::from);
    for (with_weights, unit) in [(false, TimestampUnit::Ns), (true, TimestampUnit::Us)] {
        let (dir, path) = place("r.verdicts.parquet");
        assert_eq!(write(&path, options(with_weights, unit), &verdicts), 1777);
        assert_eq!(names(dir.path()), ["r.verdicts.parquet"]);

        let mut reader = VerdictReader::open(&path).unwrap();
        let document: serde_json::Value = serde_json::from_str(DOCUMENT).unwrap();
        assert_eq!(document_of(&path).unwrap(), document);
        let mut found = reader.next().unwrap().unwrap();
        assert!(reader.next().is_none());
        assert_eq!(names_of(&found), heads);
        found.printheads = expected.printheads.clone();
        found.printhead = expected.printhead.clone();
        if !with_weights {
            (found.weights_start, found.weights) =
                (expected.weights_start.clone(), expected.weights.clone());
        }
        assert_eq!(found, expected);
    }
    let (dir, path) = place("r.verdicts.parquet");
    drop(VerdictWriter::create(&path, options(false, TimestampUnit::Ns)).unwrap());
    assert!(names(dir.path()).is_empty());
}

#[test]
fn columns_that_do_not_fit_are_an_error() {
    let (_dir, path) = place("r.parquet");
    type Change = fn(&mut VerdictColumns);
    let changes: [Change; 5] = [
        |c| c.severity.truncate(3),
        |c| c.fault[1] = Some(3),
        |c| c.category[1] = Some(2),
        |c| c.printhead[1] = u32::MAX,
        |c| c.weights.truncate(1),
    ];
    for change in changes {
        let mut writer = VerdictWriter::create(&path, options(true, TimestampUnit::Ns)).unwrap();
        let mut wrong = rows(0, 10, &["K"]);
        change(&mut wrong);
        assert!(matches!(writer.write(&wrong.into()), Err(TableError::Wrong { .. })));
    }
    assert!(!path.exists());
}

#[test]
fn schemas_verdicts_md_is_the_schema_in_code() {
    let page = include_str!("../../../../schemas/verdicts.md");
    is_documented(page, &schema(&options(true, TimestampUnit::Ns)));
}
