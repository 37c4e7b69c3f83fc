//! What is shown of results.

use crate::house::{House, between};
use crate::recorded::{Acquired, cells, rows, table_rows, texts};
use arrow_array::types::{Float32Type, TimestampNanosecondType, UInt32Type};
use arrow_array::{Array, RecordBatch};
use arrow_schema::DataType;
use inkling::burst::Burst;
use inkling::episodes::Episode;
use inkling::io::verdict_reader::VerdictReader;
use inkling::verdict::Outcome;
use parquet::file::reader::{FileReader, SerializedFileReader};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs::File;

/// Every file below `out` by its path, but for what tells when and how fast.
pub fn results(house: &House) -> BTreeMap<String, Vec<u8>> {
    results_in(house, "out")
}

/// The same of another directory.
pub fn results_in(house: &House, out: &str) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    for name in house.files(out) {
        let mut bytes = house.read(&format!("{out}/{name}"));
        if name.ends_with(".summary.json") {
            let mut summary: Value = serde_json::from_slice(&bytes).unwrap();
            let of_time = ["rates", "timings", "phases"];
            summary.as_object_mut().unwrap().retain(|key, _| !of_time.contains(&key.as_str()));
            bytes = summary.to_string().into_bytes();
        }
        if !["journal.jsonl", "run.json", ".inkling.lock"].contains(&name.as_str()) {
            found.insert(name, bytes);
        }
    }
    found
}

/// What stands at some places of a JSON file: `totals.judged`, `recordings.*.outcome`. Of lines the first is `0`.
pub fn shown(text: &str, places: &str) -> String {
    let lines = text.lines().map(serde_json::from_str::<Value>);
    let of: Value = serde_json::from_str(text)
        .or_else(|_| lines.collect::<Result<Vec<_>, _>>().map(Value::from))
        .expect("JSON");
    let line =
        |place: &str| format!("{place}: {}\n", at(&of, &place.split('.').collect::<Vec<_>>()));
    places.split(' ').map(line).collect()
}

fn at(of: &Value, place: &[&str]) -> Value {
    match place {
        [] => of.clone(),
        ["*", rest @ ..] => {
            let all = of.as_array().map_or(&[][..], |all| all);
            all.iter().map(|one| at(one, rest)).collect()
        }
        [key, rest @ ..] => {
            let one = key.parse().map_or_else(|_| &of[*key], |nth: usize| &of[nth]);
            at(one, rest)
        }
    }
}

/// The document in a table's metadata.
pub fn metadata(house: &House, name: &str) -> String {
    let file = SerializedFileReader::new(File::open(house.path(name)).unwrap()).unwrap();
    let entries = file.metadata().file_metadata().key_value_metadata().unwrap().clone();
    entries.into_iter().find(|entry| entry.key == "inkling").unwrap().value.unwrap()
}

/// What is said of each signal, however many rows it has, and the episodes, in no order of the file's.
fn sorted(house: &House, stem: &str) -> (Vec<(Acquired, String)>, Vec<String>) {
    let mut said = table_rows(&house.path(&format!("{stem}.verdicts.parquet")));
    said.sort();
    // whose they are is all that may differ
    let plain = |of: Episode| format!("{:?}", Episode { recording: Default::default(), ..of });
    let mut episodes: Vec<String> = house.episodes(stem).into_iter().map(plain).collect();
    episodes.sort();
    (said, episodes)
}

/// How many verdicts and episodes two runs have, once these say the same.
pub fn same(house: &House, stem: &str, other: &str) -> String {
    let (one, two) = (sorted(house, stem), sorted(house, other));
    assert!(one.0 == two.0, "{other}: other verdicts than {stem}");
    assert!(one.1 == two.1, "{other}: other episodes than {stem}");
    format!("{} verdicts, {} episodes\n", one.0.len(), one.1.len())
}

/// Of the last ten seconds the share that is flagged, of every so many-th channel and of the others.
pub fn late(house: &House, stem: &str, every: u32) -> String {
    let rows = house.verdicts(stem);
    let end = rows.keys().map(|key| key.0).max().unwrap();
    let share = |of: &dyn Fn(u32) -> bool| {
        let late = rows.iter().filter(|(key, said)| {
            key.0 > end - 10_000_000_000 && of(key.2) && !said.starts_with("Rejected")
        });
        let late: Vec<bool> = late.map(|(_, said)| !said.starts_with("Healthy")).collect();
        100 * late.iter().filter(|flagged| **flagged).count() / late.len().max(1)
    };
    let (of, others) = (share(&|c| c % every == 0), share(&|c| c % every != 0));
    format!("flagged at the end: {of} % of every {every}., {others} % of the others\n")
}

/// The messages of a recording by topic: how many, from when to when, and whether each holds a picture.
pub fn messages(bytes: &[u8]) -> String {
    let mut topics: BTreeMap<String, Vec<(u64, bool)>> = BTreeMap::new();
    for message in mcap::MessageStream::new(bytes).unwrap() {
        let message = message.unwrap();
        let has_picture = message.data.windows(4).any(|bytes| bytes == b"\x89PNG");
        let of = topics.entry(message.channel.topic.clone()).or_default();
        of.push((message.log_time, has_picture));
    }
    let line = |(topic, of): (&String, &Vec<(u64, bool)>)| {
        let time = |ns: Option<u64>| {
            let ns = i64::try_from(ns.expect("a message")).expect("a time");
            chrono::DateTime::from_timestamp_nanos(ns).format("%FT%TZ")
        };
        let times = of.iter().map(|(time, _)| *time);
        let (from, to) = (time(times.clone().min()), time(times.max()));
        let pictures = if of.iter().all(|(_, has)| *has) { ", pictures" } else { "" };
        format!("{topic}: {} from {from} to {to}{pictures}\n", of.len())
    };
    topics.iter().map(line).collect()
}

/// Bursts with the first samples of each channel.
pub fn listed(bursts: &[Burst]) -> String {
    let line = |b: &Burst| {
        let when = chrono::DateTime::from_timestamp_nanos(b.t_acq_ns).format("%FT%T%.fZ");
        let Burst { printhead, first_channel, channels, samples_per_channel: n, .. } = b;
        let period = format!("{:.5e}", b.sample_period_s);
        let head = |y: Vec<f64>| y.iter().take(8).map(|y| format!("{y:.3}")).collect::<Vec<_>>();
        let samples: Vec<String> = rows(b).into_iter().map(|y| head(y).join(" ")).collect();
        let samples = samples.join("; ");
        format!(
            "{when} {printhead} {first_channel}: {channels} x {n} every {period} s: {samples}\n"
        )
    };
    bursts.iter().map(line).collect()
}

/// The counts of a summary, once they are those of its table: one row for every signal found.
pub fn counted(house: &House, stem: &str) -> String {
    let counts = house.read_json(&format!("{stem}.summary.json"))["counts"].take();
    let (mut rows, mut rejected) = (0u64, 0u64);
    for columns in VerdictReader::open(&house.path(&format!("{stem}.verdicts.parquet"))).unwrap() {
        let c = columns.unwrap();
        rows += c.len() as u64;
        for i in 0..c.len() {
            let judged = c.outcome[i] != Outcome::Rejected;
            rejected += u64::from(!judged);
            assert_eq!(judged, c.statistic[i].is_some(), "NaN is read as null");
            assert!(c.outcome[i] != Outcome::Healthy || c.statistic[i] <= c.threshold[i]);
        }
    }
    let reasons = counts["rejected"].as_object().unwrap().values();
    let by_reason: u64 = reasons.map(|n| n.as_u64().unwrap()).sum();
    assert_eq!((&counts["signals"], rejected), (&rows.into(), by_reason));
    assert_eq!(counts["judged"].as_u64().unwrap() + by_reason, rows);
    format!("{counts}\n")
}

/// Some columns of a table; rows that say the same once, with their number.
pub fn distinct_rows(batches: &[RecordBatch], columns: &str) -> String {
    let mut found: Vec<(String, usize)> = Vec::new();
    for batch in batches {
        let columns: Vec<Vec<String>> = columns.split(' ').map(|name| said(batch, name)).collect();
        for i in 0..batch.num_rows() {
            let row =
                columns.iter().map(|column| column[i].as_str()).collect::<Vec<_>>().join(" | ");
            match found.iter_mut().find(|(of, _)| *of == row) {
                Some((_, times)) => *times += 1,
                None => found.push((row, 1)),
            }
        }
    }
    found.iter().map(|(row, times)| format!("{times} x {row}\n")).collect()
}

/// The cells of a column in words.
fn said(batch: &RecordBatch, name: &str) -> Vec<String> {
    let column = batch.column_by_name(name).unwrap_or_else(|| panic!("no column {name}"));
    let all: Vec<Option<String>> = match column.data_type() {
        DataType::UInt32 => in_words(cells::<UInt32Type>(batch, name), |n| n.to_string()),
        DataType::Float32 => in_words(cells::<Float32Type>(batch, name), |x| format!("{x:.2}")),
        DataType::Timestamp(..) => in_words(cells::<TimestampNanosecondType>(batch, name), |ns| {
            chrono::DateTime::from_timestamp_nanos(ns).format("%FT%TZ").to_string()
        }),
        _ => texts(batch, name),
    };
    all.into_iter().map(|cell| cell.unwrap_or("-".into())).collect()
}

fn in_words<T>(cells: Vec<Option<T>>, word: impl Fn(T) -> String) -> Vec<Option<String>> {
    cells.into_iter().map(|cell| cell.map(&word)).collect()
}

/// A report: what the terminal says, the first sentence of the page, and each printhead's light. Nowhere does it say that
/// nothing needs care where not all was judged, and its page does nothing by itself.
pub fn reported(house: &House, of: &str) -> String {
    let args = format!("report {of} -o r.html");
    let ended = house.run(&args);
    let json: Value = serde_json::from_str(&house.run(&format!("{args} --json")).stdout()).unwrap();
    let (page, terminal) = (house.text("r.html"), ended.stdout());
    is_inert(&page);
    for calm in ["none needs care", "othing to clean", "<p>Nothing.</p>"] {
        let is_calm = page.contains(calm) || terminal.contains(calm);
        assert!(!is_calm || json["coverage"]["complete"] == true, "{calm}: {terminal}");
    }
    let first = text_of(between(&page, "class=\"sentence\">", "</p>"));
    let lights = between(&page, "<p class=\"heads\">", "</p>").split("<span>").skip(1);
    let lights = lights.map(|light| {
        format!("{}: {}", text_of(light).trim(), between(light, "aria-label=\"", "\""))
    });
    let lights = lights.collect::<Vec<_>>().join(", ");
    let status = ended.code().expect("a status");
    let first = if terminal.starts_with(first.trim()) { "so, too\n" } else { &first };
    format!("{terminal}{}exit {status}, page: {first}lights: {lights}\n", ended.stderr())
}

/// Nothing runs, nothing is loaded: every tag is one of ours, and none has an address or a handler.
#[track_caller]
pub fn is_inert(page: &str) {
    const OURS: [&str; 45] = [
        "!doctype", "html", "head", "meta", "title", "style", "body", "h1", "h2", "h3", "p", "b",
        "br", "span", "code", "div", "ul", "li", "dl", "dt", "dd", "table", "tr", "th", "td",
        "svg", "g", "rect", "text", "path", "image", "polyline", "polygon", "line", "circle",
        "details", "summary", "pre", "tspan", "ellipse", "desc", "defs", "a", "input", "label",
    ];
    for tag in page.split('<').skip(1) {
        // quotes and brackets of names are escaped, so the first bracket ends the tag
        let (tag, _) = tag.split_once('>').expect("a tag ends");
        let name =
            tag.trim_start_matches('/').split([' ', '\n', '/']).next().unwrap().to_lowercase();
        assert!(OURS.contains(&name.as_str()), "<{tag}>");
        for attribute in tag.split('"').step_by(2) {
            let attribute = attribute.trim().to_lowercase();
            let loads = attribute.ends_with("src=") || attribute.starts_with("on");
            assert!(!loads, "<{tag}>");
        }
        if let Some((_, address)) = tag.split_once("href=\"") {
            let is_within = address.starts_with('#');
            assert!(is_within || address.starts_with("data:image/png;base64,"), "<{tag}>");
        }
    }
    assert!(page.contains("default-src 'none'"));
}

/// What a reader sees of a piece of a page: blocks are lines.
pub fn text_of(html: &str) -> String {
    let mut lines = vec![Vec::new()];
    for piece in html.split('<') {
        let (tag, words) = piece.split_once('>').unwrap_or(("", piece));
        let name = tag.trim_start_matches('/').split(' ').next().expect("a name");
        if ["p", "li", "tr", "ul", "table", "div"].contains(&name) {
            lines.push(Vec::new());
        }
        lines.last_mut().expect("a line").extend(words.split_whitespace());
    }
    lines.retain(|line| !line.is_empty());
    let text: String = lines.iter().map(|line| line.join(" ") + "\n").collect();
    let entities = [("&lt;", "<"), ("&gt;", ">"), ("&quot;", "\""), ("&#39;", "'"), ("&amp;", "&")];
    entities.into_iter().fold(text, |text, (entity, meant)| text.replace(entity, meant))
}
