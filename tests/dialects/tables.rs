//! The same signals as CSV and Parquet have the verdicts of a recording.

use super::{judged, native};
use crate::house::House;
use crate::recipes::some;
use crate::recorded::{rows, signal};
use arrow_array::builder::{Int16Builder, ListBuilder};
use arrow_array::types::Int8Type;
use arrow_array::{
    ArrayRef, DictionaryArray, Float64Array, Int32Array, Int64Array, RecordBatch, StringArray,
};
use inkling::burst::Burst;
use std::fmt::Write as _;
use std::sync::Arc;

/// 2025-01-01T08:00:00Z, as the file's name says.
const START_NS: i64 = 1_735_718_400_000_000_000;
const EVERY_NS: i64 = 500_000_000;

/// All that a table can say.
fn bursts() -> Vec<Burst> {
    let plain = |(i, burst): (usize, Burst)| Burst {
        t_acq_ns: START_NS + i as i64 * EVERY_NS,
        printhead: "K1".into(),
        first_channel: 7,
        temperature_c: Some(31.5),
        drive_voltage_v: Some(20.0),
        idle_time_s: Vec::new(),
        neighbours_fired: Default::default(),
        ..burst
    };
    let bursts: Vec<Burst> = some(0, 40).into_iter().enumerate().map(plain).collect();
    let (first, rest) = bursts.split_first().unwrap();
    let same =
        |b: &Burst| b.channels == first.channels && b.sample_period_s == first.sample_period_s;
    assert!(rest.iter().all(same));
    bursts
}

/// A row is an instant, its columns channels; long.
fn long_csv(bursts: &[Burst], comma: char) -> String {
    let mut text = format!("drop{comma}temp");
    (0..bursts[0].channels).for_each(|c| write!(text, "{comma}ch{c}").unwrap());
    for (i, burst) in bursts.iter().enumerate() {
        let rows = rows(burst);
        for k in 0..burst.samples_per_channel as usize {
            let temperature = if comma == ';' { "31,5" } else { "31.5" };
            write!(text, "\n{i}{comma}{temperature}").unwrap();
            rows.iter().for_each(|y| write!(text, "{comma}{}", y[k]).unwrap());
        }
    }
    text + "\n"
}

/// The same with the times of the samples.
fn timed(bursts: &[Burst]) -> RecordBatch {
    let n = bursts[0].samples_per_channel as usize;
    let each = |of: &dyn Fn(usize, usize) -> f64| -> Vec<f64> {
        (0..bursts.len()).flat_map(|i| (0..n).map(move |k| (i, k))).map(|(i, k)| of(i, k)).collect()
    };
    let period = bursts[0].sample_period_s;
    let name = |i: usize| format!("drop {i}");
    let names: Vec<String> = (0..bursts.len()).flat_map(|i| vec![name(i); n]).collect();
    let times = Float64Array::from(each(&|i, k| i as f64 * 0.5 + k as f64 * period));
    // as pandas writes categories
    let drops: DictionaryArray<Int8Type> = names.iter().map(|name| &**name).collect();
    let mut columns: Vec<(String, ArrayRef)> =
        vec![("t".into(), Arc::new(times)), ("drop".into(), Arc::new(drops))];
    for c in 0..bursts[0].channels as usize {
        let all: Vec<Vec<f64>> = bursts.iter().map(|b| signal(b, c)).collect();
        let y = each(&|i, k| all[i][k]).into_iter().map(|y| y as i32);
        columns.push((format!("ch{c}"), Arc::new(y.collect::<Int32Array>())));
    }
    RecordBatch::try_from_iter(columns).unwrap()
}

/// A row is a burst: times in ns, and a list of lists.
fn listed(bursts: &[Burst]) -> RecordBatch {
    let mut lists = ListBuilder::new(ListBuilder::new(Int16Builder::new()));
    for burst in bursts {
        for y in rows(burst) {
            y.iter().for_each(|y| lists.values().values().append_value(*y as i16));
            lists.values().append(true);
        }
        lists.append(true);
    }
    let times = bursts.iter().map(|b| b.t_acq_ns - START_NS).collect::<Int64Array>();
    let volts = bursts.iter().map(|_| 20.0).collect::<Float64Array>();
    let columns: Vec<(&str, ArrayRef)> = vec![
        ("t_ns", Arc::new(times)),
        ("volts", Arc::new(volts)),
        ("samples", Arc::new(lists.finish())),
    ];
    RecordBatch::try_from_iter(columns).unwrap()
}

fn parquet(batch: &RecordBatch) -> Vec<u8> {
    let mut writer =
        parquet::arrow::ArrowWriter::try_new(Vec::new(), batch.schema(), None).unwrap();
    writer.write(batch).unwrap();
    writer.into_inner().unwrap()
}

#[test]
fn the_same_signals_as_tables_have_the_same_verdicts() {
    let house = House::new();
    let bursts = bursts();
    let expected = native(&house, &bursts);
    assert!(expected.values().any(|said| said.starts_with("Faulty")), "nothing faulty to compare");
    let period = bursts[0].sample_period_s;
    let every = "--start 2025-01-01T08:00:00Z --every 0.5";
    let named = "--start name --every 0.5";
    let of_rows = format!("--burst drop --temperature temp --voltage 20 --period-s {period}");
    let timed_rows = "--burst drop --time t --temperature 31.5 --voltage 20".to_owned();
    let of_lists = format!("--time t_ns --temperature 31.5 --voltage volts --period-s {period}");
    let all: [(&str, Vec<u8>, String); 4] = [
        ("comma.csv", long_csv(&bursts, ',').into(), format!("{of_rows} {every}")),
        ("20250101T080000.csv", long_csv(&bursts, ';').into(), format!("{of_rows} {named}")),
        ("rows.parquet", parquet(&timed(&bursts)), timed_rows),
        ("lists.parquet", parquet(&listed(&bursts)), of_lists),
    ];
    for (name, bytes, options) in all {
        house.write(name, bytes);
        let recording = format!("{}.mcap", name.replace('.', "_"));
        house.ok(&format!(
            "convert {name} -o {recording} --printhead K1 --first-channel 7 {options}"
        ));
        let found = judged(&house, &recording, "");
        assert_eq!(found.len(), expected.len(), "{name}");
        for (key, said) in &expected {
            // written times give the sample period to the last digits only
            let own = found.get(key);
            match options.contains("--period-s") {
                true => assert_eq!(own, Some(said), "{name} {key:?}"),
                false => {
                    let words = |said: &str| said.split(' ').take(3).collect::<Vec<_>>().join(" ");
                    assert_eq!(own.map(|own| words(own)), Some(words(said)), "{name} {key:?}");
                }
            }
        }
    }
}

#[test]
fn each_row_of_lists_may_name_its_printhead() {
    let house = House::new();
    let listed = listed(&bursts());
    let write = |name: &str, of: [&str; 3]| {
        let names = (0..listed.num_rows()).map(|i| of[i % 3]);
        let heads: DictionaryArray<Int8Type> =
            names.map(|n| Some(n).filter(|n| !n.is_empty())).collect();
        let mut columns: Vec<(&str, ArrayRef)> = vec![("head", Arc::new(heads))];
        columns.extend(["t_ns", "samples"].map(|name| (name, listed[name].clone())));
        house.write(name, parquet(&RecordBatch::try_from_iter(columns).unwrap()));
    };
    write("t.parquet", ["cyan", "black", "black"]);
    write("gap.parquet", ["cyan", "black", ""]);
    let options = "-o t.mcap --time t_ns --period-s 1e-6 --printhead head";
    house.ok(&format!("convert t.parquet {options}"));
    let made = crate::recorded::bursts(&house.path("t.mcap"));
    let of: Vec<&str> = made.iter().take(4).map(|burst| &*burst.printhead).collect();
    assert_eq!(of, ["cyan", "black", "black", "cyan"]);
    let gap = house.run(&format!("convert gap.parquet {options}"));
    gap.exits(1).says("row 3: column \"head\": an empty cell: each row must say");
}

#[test]
fn chunks_are_compact() {
    use inkling::io::{Limits, recording::Recording};
    let house = House::new();
    let bursts = vec![bursts(); 10].concat();
    house.write("r.parquet", parquet(&listed(&bursts)));
    house.ok("convert r.parquet -o r.mcap --outputs samples --period-s 1e-6");
    let recording = Recording::open(&house.path("r.mcap"), Limits::default()).unwrap();
    let sizes: Vec<u64> = recording.blocks().map(|block| block.unwrap().bytes).collect();
    assert!(sizes.len() > 4 && sizes.iter().all(|n| *n <= 256 << 10), "{sizes:?}");
}

#[test]
fn bad_tables_are_refused_and_leave_no_recording() {
    let house = House::new();
    let names = RecordBatch::try_from_iter([
        ("t", Arc::new(Float64Array::from(vec![0.0, 1.0])) as ArrayRef),
        ("who", Arc::new(StringArray::from(vec!["a", "b"])) as ArrayRef),
    ]);
    let lists = parquet(&listed(&bursts()[..2]));
    let cases: [(&str, Vec<u8>, &str, i32, &str); 5] = [
        ("a.parquet", lists.clone(), "--outputs samples --time t_ns", 2, "--period-s"),
        (
            "a.parquet",
            lists,
            "--outputs samples --period-s 1 --first-channel 4294967295",
            2,
            "have no numbers",
        ),
        ("a.parquet", b"PAR1 and nothing".to_vec(), "", 1, "cannot be read"),
        ("a.parquet", parquet(&names.unwrap()), "", 1, "column \"who\": values of type Utf8"),
        ("a.csv", b"t,y\n0,1\n".to_vec(), "--period-s 1 --start name", 2, "no time such as"),
    ];
    for (name, bytes, options, code, says) in cases {
        house.write(name, bytes);
        house.run(&format!("convert {name} -o a.mcap {options}")).exits(code).says(says);
        assert!(!house.path("a.mcap").exists());
    }
}
