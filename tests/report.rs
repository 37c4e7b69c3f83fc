//! `inkling report` at the process boundary: fifteen days with six faulty channels are six lines with
//! their onsets; hostile names are inert; what is missing is said.

use crate::house::{House, between, shipped};
use crate::nights::days_later;
use crate::recorded::{batches, bursts, cells, sample, texts, with_samples};
use crate::several::fault;
use arrow_array::RecordBatch;
use arrow_array::types::{Float32Type, TimestampNanosecondType, UInt32Type};
use inkling::burst::Burst;
use inkling::episodes::Episode;
use inkling::io::episode_table::EpisodeWriter;
use inkling::io::verdict_table::{TableOptions, TimestampUnit, VerdictWriter};
use inkling::verdict::{Outcome, VerdictColumns};
use serde_json::json;
use std::sync::Arc;

const HOUR_S: i64 = 3600;
const DAY_S: i64 = 24 * HOUR_S;
/// 2025-01-01T08:00:00Z, when scenarios begin.
const START_S: i64 = 1_735_718_400;

/// A row of `report.faults.parquet`.
#[derive(Clone, Debug)]
struct Row {
    printhead: String,
    channel: u32,
    category: Option<String>,
    /// s since the start of the scenario.
    began_s: i64,
    ended_s: Option<i64>,
    recordings: u32,
    episodes: u32,
    per_day: Option<f32>,
    urgency: f32,
    action: String,
    sentence: String,
}

fn faults(house: &House, name: &str) -> Vec<Row> {
    batches(&house.path(name)).iter().flat_map(rows).collect()
}

fn rows(batch: &RecordBatch) -> Vec<Row> {
    let text = |name: &str, i: usize| texts(batch, name)[i].clone();
    let time = |name: &str, i: usize| {
        cells::<TimestampNanosecondType>(batch, name)[i].map(|ns| ns / 1_000_000_000 - START_S)
    };
    let count = |name: &str, i: usize| cells::<UInt32Type>(batch, name)[i].unwrap();
    let float = |name: &str, i: usize| cells::<Float32Type>(batch, name)[i];
    (0..batch.num_rows())
        .map(|i| Row {
            printhead: text("printhead", i).unwrap(),
            channel: count("channel", i),
            category: text("category", i),
            began_s: time("began_at", i).unwrap(),
            ended_s: time("ended_at", i),
            recordings: count("recordings", i),
            episodes: count("episodes", i),
            per_day: float("severity_per_day", i),
            urgency: float("urgency", i).unwrap(),
            action: text("action", i).unwrap(),
            sentence: text("sentence", i).unwrap(),
        })
        .collect()
}

/// Between two bursts of a channel, s.
const EVERY_S: i64 = 720;
const DAYS: i64 = 15;
/// Recordings begin every six hours, and take three.
const RECORDING_S: i64 = 6 * HOUR_S;

/// What is faulty from when (days) to when.
const FAULTS: [(&str, u32, &str, f64, f64); 5] = [
    ("cyan-1", 3, "IDN", 1.8, 8.3),
    ("cyan-1", 10, "PBN", 0.4, 2.55),
    ("magenta-1", 5, "EC", 0.35, 12.1),
    ("magenta-1", 7, "BN", 0.97, 5.6),
    ("magenta-1", 20, "AB3", 4.0, 13.9),
];
/// Dries every night, and is cured.
const EVERY_NIGHT: (&str, u32, &str, f64) = ("cyan-1", 17, "DDN", 2.5);

fn scenario() -> String {
    let text = shipped("sample_logs/scenarios/sample.toml");
    let (physics, _) = text.split_once("[print_run]").unwrap();
    let mut scenario = physics.replace("swing_c = 4.0", "swing_c = 0.5");
    let bursts = DAYS * DAY_S / EVERY_S;
    scenario += &format!(
        "[print_run]\nprintheads = 2\nnames = [\"cyan-1\", \"magenta-1\"]\nchannels = 24\n\
         bursts_per_channel = {bursts}\ninterval_s = {EVERY_S}.0\n"
    );
    let s = |days: f64| days * DAY_S as f64;
    for (head, channel, class, severity, from) in FAULTS {
        let span = (s(from), s(DAYS as f64));
        scenario += &fault((head, channel as usize), (class, severity), span);
    }
    let (head, channel, class, severity) = EVERY_NIGHT;
    for day in 0..DAYS {
        let span = (s(day as f64 + 0.74), s((day as f64 + 1.12).min(DAYS as f64)));
        scenario += &fault((head, channel as usize), (class, severity), span);
    }
    scenario
}

/// Of the long run, the first three of every six hours: 60 recordings.
fn record(house: &House) {
    house.write("scenario.toml", scenario());
    house.ok("simulate scenario.toml -o run");
    let all = bursts(&house.path("run/print_run.mcap"));
    let of = |b: &Burst| b.t_acq_ns / 1_000_000_000 - START_S;
    for k in 0..DAYS * DAY_S / RECORDING_S {
        let from = k * RECORDING_S;
        let within = |b: &&Burst| (from..from + RECORDING_S / 2).contains(&of(b));
        let some: Vec<Burst> = all.iter().filter(within).cloned().collect();
        house.record(&format!("rec/{k:02}.mcap"), &some);
    }
}

/// A sensor line that says nothing but a little noise.
pub fn deadened(burst: &Burst, dead: usize) -> Burst {
    let turn = usize::try_from(burst.t_acq_ns / 1_000_000).unwrap(); // no two bursts have the same noise
    with_samples(burst, |row, k, y| match row == dead {
        true => ((k * k * 31 + k * (17 + turn % 5) + turn) % 7) as f64 - 3.0,
        false => y,
    })
}

/// The first burst in a recording from a time on, s.
fn first_seen(from_s: i64) -> i64 {
    let burst = (from_s + EVERY_S - 1) / EVERY_S * EVERY_S;
    match burst % RECORDING_S {
        within if within < RECORDING_S / 2 => burst,
        _ => (burst / RECORDING_S + 1) * RECORDING_S,
    }
}

#[test]
fn sixty_recordings_with_six_faulty_channels_are_six_lines_with_their_onsets() {
    let house = House::new();
    record(&house);
    let ended = house.replay("rec").exits(0);
    let closing = ended.stdout();
    let (_, list) = closing.split_once("to clean after").expect("the list comes last");
    assert!(list.lines().count() < 15, "{list}");

    let told = house.ok("report out -o page/report.html");
    assert!(told.contains("6 channels"), "{told}");
    let found = faults(&house, "page/report.faults.parquet");
    let mut channels: Vec<(&str, u32)> =
        found.iter().map(|row| (row.printhead.as_str(), row.channel)).collect();
    channels.sort_unstable();
    let mut truth: Vec<(&str, u32)> = FAULTS.iter().map(|f| (f.0, f.1)).collect();
    truth.push((EVERY_NIGHT.0, EVERY_NIGHT.1));
    truth.sort_unstable();
    assert_eq!(channels, truth, "{found:#?}");

    let row = |head: &str, channel: u32| {
        found.iter().find(|row| row.printhead == head && row.channel == channel).unwrap()
    };
    // faults grow over five bursts, and the onset is an estimate
    let tolerance_s = 5 * EVERY_S;
    for (head, channel, class, _, from) in FAULTS {
        let row = row(head, channel);
        let since = first_seen((from * DAY_S as f64) as i64);
        assert!((row.began_s - since).abs() <= tolerance_s, "{class} since {since} s: {row:?}");
        assert_eq!(row.ended_s, None, "{row:?}");
        assert!(row.recordings >= 4 && row.urgency > 0.0, "{row:?}");
        assert_eq!(row.category.as_deref(), Some(inkling::fault::category(class)), "{row:?}");
    }
    let night = row(EVERY_NIGHT.0, EVERY_NIGHT.1);
    let since = first_seen((0.74 * DAY_S as f64) as i64);
    assert!((night.began_s - since).abs() <= tolerance_s, "since {since} s: {night:?}");
    assert!(night.sentence.contains("times"), "cures are told: {night:?}");
    assert!(night.episodes >= 15, "{night:?}");
    assert!(found.is_sorted_by(|a, b| a.urgency >= b.urgency), "most urgent first");

    // the page says what the table says
    let page = house.text("page/report.html");
    assert!(page.len() < 5_000_000, "{} bytes", page.len());
    for row in &found {
        assert!(page.contains(&format!("<b>{}</b>", row.action)), "{row:?}");
    }
    assert_eq!(page.matches("data:image/png;base64,").count(), 2, "a map a printhead");
    is_inert(&page);
}

/// Nothing runs, nothing is loaded: every tag is one of ours, and none has an address or a handler.
#[track_caller]
fn is_inert(page: &str) {
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

/// Tables made by hand: what another channel, another printer, another replay may write.
struct Tables<'a> {
    house: &'a House,
    printhead: &'a str,
}

const CHANNELS: u32 = 6;

/// An episode of a table made by hand.
#[derive(Clone, Copy)]
struct Spell {
    channel: u32,
    began_s: i64,
    ended_s: Option<i64>,
}

fn spell(channel: u32, began_s: i64, ended_s: Option<i64>) -> Spell {
    Spell { channel, began_s, ended_s }
}

impl Spell {
    fn covers(&self, channel: u32, t_s: i64) -> bool {
        self.channel == channel && t_s >= self.began_s && self.ended_s.is_none_or(|end| t_s < end)
    }
}

impl Tables<'_> {
    /// A recording of 40 bursts, one a second, whose signals are faulty during the episodes.
    fn write(&self, name: &str, from_s: i64, episodes: &[Spell]) {
        self.write_channels(name, from_s, episodes, 0..CHANNELS, None);
    }

    /// Likewise of some channels; `single`: one more faulty signal, which is no episode.
    fn write_channels(
        &self,
        name: &str,
        from_s: i64,
        episodes: &[Spell],
        channels: impl Iterator<Item = u32> + Clone,
        single: Option<(u32, i64)>,
    ) {
        let path = self.house.path(&format!("out/{name}.verdicts.parquet"));
        let options = TableOptions {
            recording: "r.mcap".into(),
            classes: vec!["PBN".into()],
            categories: vec!["blocked_nozzle".into()],
            weights: false,
            timestamp_unit: TimestampUnit::Ns,
        };
        let mut verdicts = VerdictWriter::create(&path, options).unwrap();
        let ns = |s: i64| (START_S + s) * 1_000_000_000;
        for t_s in from_s..from_s + 40 {
            let channels: Vec<u32> = channels.clone().collect();
            let n = channels.len();
            let is_faulty =
                |c: &u32| single == Some((*c, t_s)) || episodes.iter().any(|of| of.covers(*c, t_s));
            let faulty: Vec<bool> = channels.iter().map(is_faulty).collect();
            let named: Vec<_> = faulty.iter().map(|of| of.then_some(0)).collect();
            let outcome = |of: &bool| if *of { Outcome::Faulty } else { Outcome::Healthy };
            let mut rows = VerdictColumns {
                acquired_at_ns: vec![ns(t_s); n],
                printhead: vec![0; n],
                printheads: vec![self.printhead.into()],
                outcome: faulty.iter().map(outcome).collect(),
                category: named.clone(),
                fault: named.clone(),
                candidate: named,
                certainty: vec![Some(0.9); n],
                statistic: faulty.iter().map(|of| Some(if *of { 9.0 } else { 0.2 })).collect(),
                threshold: vec![Some(1.0); n],
                severity: faulty.iter().map(|of| of.then_some(0.3)).collect(),
                channel: channels,
                ..VerdictColumns::default()
            };
            rows.fill_up();
            verdicts.write(&rows.into()).unwrap();
        }
        let document = format!("{{\"recording\":{{\"digest\":\"{name}\"}}}}");
        verdicts.complete(document.clone()).unwrap().name().unwrap();
        let episode = |of: &Spell| Episode {
            printhead: self.printhead.into(),
            channel: of.channel,
            category: Some("blocked_nozzle".into()),
            fault: Some("PBN".into()),
            raised_at_ns: ns(of.began_s + 1),
            began_at_ns: ns(of.began_s),
            ended_at_ns: of.ended_s.map(ns),
            bursts: 10,
            certainty: Some(0.9),
            severity_first: Some(0.3),
            severity_max: Some(0.3),
            severity_last: Some(0.3),
            severity_sd: Some(0.01),
            explanation: format!("channel {} of {}", of.channel, self.printhead),
            ..Episode::default()
        };
        let path = self.house.path(&format!("out/{name}.episodes.parquet"));
        let mut writer = EpisodeWriter::create(&path, TimestampUnit::Ns, "r.mcap").unwrap();
        writer.write(episodes.iter().map(episode).collect()).unwrap();
        writer.complete(document.clone()).unwrap().name().unwrap();
        self.house.write(&format!("out/{name}.summary.json"), document);
    }

    /// Channel 1 is faulty from the first night on, 3 since the last, 5 was healthy again in the last.
    fn write_three_nights(&self) {
        let day = DAY_S;
        self.write("0", 0, &[spell(1, 5, None), spell(5, 0, None)]);
        self.write("1", day, &[spell(1, day, None), spell(5, day, None)]);
        let last = 2 * day;
        let of_last =
            [spell(1, last, None), spell(3, last + 5, None), spell(5, last, Some(last + 3))];
        self.write("2", last, &of_last);
    }
}

#[test]
fn gaps_are_bridged_by_what_was_seen_in_them() {
    let house = House::new();
    let tables = Tables { house: &house, printhead: "p" };
    // every ten minutes; channel 1 is measured only in the first and the last
    for k in 0..30i64 {
        let from = 600 * k;
        let edge = k == 0 || k == 29;
        let episodes = match k {
            0 | 29 => vec![spell(1, from + 10, None)], // nobody looked in between: one fault
            3 => vec![spell(2, from + 20, None)],      // cured while nobody recorded
            7 => vec![spell(4, from + 5, Some(from + 15))], // came and went
            _ => Vec::new(),
        };
        let measured = (0..CHANNELS).filter(|c| *c != 1 || edge);
        let single = (k % 9 == 0).then_some((0, from + 33));
        tables.write_channels(&format!("{k:02}"), from, &episodes, measured, single);
    }
    house.run("report out -o report.html").exits(0).says("1 channel");
    let found = faults(&house, "report.faults.parquet");
    assert_eq!(found.len(), 3, "{found:#?}");
    let of = |channel: u32| found.iter().find(|row| row.channel == channel).unwrap();
    assert_eq!((of(1).began_s, of(1).ended_s, of(1).recordings), (10, None, 2));
    assert_eq!((of(2).began_s, of(2).ended_s), (1820, Some(2400)));
    assert_eq!((of(4).began_s, of(4).ended_s, of(4).urgency), (4205, Some(4215), 0.0));
    assert_eq!(found[0].channel, 1, "what is on comes first");
    assert_eq!(of(1).per_day, None, "a constant size has no trend");
    let page = house.text("report.html");
    assert!(page.contains("Over: healthy again") && page.contains("no trend yet"));
}

#[test]
fn a_channel_is_one_line_with_its_earlier_faults_and_minutes_are_no_trend() {
    let house = House::new();
    let tables = Tables { house: &house, printhead: "p" };
    // channel 2 is faulty in the second recording, and three thousand quiet bursts later again
    for k in 0..80i64 {
        let from = 600 * k;
        let on = spell(2, from + 10, None);
        let episodes = if k == 1 || k == 79 { &[on][..] } else { &[] };
        tables.write(&format!("{k:02}"), from, episodes);
    }
    let told = house.ok("report out -o report.html");
    let found = faults(&house, "report.faults.parquet");
    let rows: Vec<&Row> = found.iter().filter(|row| row.channel == 2).collect();
    assert!(!rows.is_empty() && rows.iter().all(|row| row.per_day.is_none()), "{rows:?}");
    assert!(told.contains("1 channel,"), "{told}");
    let page = house.text("report.html");
    assert_eq!(page.matches("<b>wipe</b>").count(), 1, "a channel once");
    assert!(!page.contains("Over:"), "what is faulty again is not over");
    assert!(page.contains("cured once") || page.contains("before it"), "but its past is told");
}

#[test]
fn printheads_that_fail_as_a_whole_and_recordings_that_overlap_are_said_first() {
    let house = House::new();
    let tables = Tables { house: &house, printhead: "p" };
    let all: Vec<Spell> = (0..CHANNELS).map(|c| spell(c, 5, None)).collect();
    tables.write("a", 0, &all);
    tables.write("b", 20, &all); // goes on at 20 s, while `a` ends at 40 s
    let told = house.ok("report out -o r.html");
    assert!(told.contains("6 of its 6 channels have faults that are still on"), "{told}");
    assert!(told.contains("a and b") && told.contains("overlap in time"), "{told}");
    let page = house.text("r.html");
    let at = |text: &str| page.find(text).unwrap_or_else(|| panic!("{text}"));
    assert!(at("have faults that are still on") < at("To clean"));
}

#[test]
fn a_dead_sensor_line_is_told_as_what_it_is() {
    let house = House::new();
    let mut all = bursts(&sample("print_run.mcap"));
    for burst in all.iter_mut().filter(|b| &*b.printhead == "cyan-1") {
        if let Some(row) = 30u32.checked_sub(burst.first_channel).filter(|r| *r < burst.channels) {
            *burst = deadened(burst, row as usize);
        }
    }
    house.record("dead.mcap", &all);
    house.replay("dead.mcap").exits(0);
    let told = house.ok("report out -o r.html");
    let line = told.lines().find(|l| l.contains("check the cable")).expect(&told);
    assert!(line.contains(" 30 ") && line.contains("nothing rings"), "{line}");
    let found = faults(&house, "r.faults.parquet");
    let at = found.iter().position(|row| row.channel == 30 && row.printhead == "cyan-1").unwrap();
    let row = &found[at];
    assert!(row.urgency >= 0.5 && at + 1 < found.len(), "not the last: {found:?}");
    let page = house.text("r.html");
    assert!(page.contains(">S</text>"), "marked as the sensor line's");
    assert!(row.sentence.contains("nothing rings") && row.category.is_none(), "{row:?}");
}

#[test]
fn what_changed_comes_first_and_the_list_leads_to_the_plots() {
    let house = House::new();
    let tables = Tables { house: &house, printhead: "p" };
    tables.write_three_nights();
    house.ok("report out -o r.html");
    let page = house.text("r.html");
    is_inert(&page);
    let at = |text: &str| page.find(text).unwrap_or_else(|| panic!("{text}"));
    assert!(at("What changed since the night before") < at("<h2>To clean</h2>"));
    let item = |words: &str| page[at(&format!("<b>{words}:</b>"))..].lines().next().unwrap();
    assert!(
        item("New").contains("channel 3") && !item("New").contains("channel 1<"),
        "{}",
        item("New")
    );
    assert!(item("Healthy again").contains("channel 5"));
    assert!(page.contains("1 channel as before"), "channel 1");
    // every way leads somewhere, from each line of the list at least to its map
    let ways: Vec<&str> =
        page.split("href=\"#").skip(1).map(|rest| rest.split('"').next().unwrap()).collect();
    assert!(ways.iter().all(|id| page.contains(&format!("id=\"{id}\""))), "{ways:?}");
    let lines = page.split("<tr id=\"r").skip(1);
    assert!(lines.clone().count() == 3 && lines.clone().all(|line| line.contains("href=\"#m0\"")));
    // sorted without a program, and a light with its word on each line
    assert_eq!(page.matches("type=\"radio\"").count(), 4);
    assert!(lines.clone().all(|line| line.contains("class=\"dot\"")));
    assert!(!page.contains("Drift of the healthy ring"), "no models, no drift");
    // of one night there is no night before
    house.ok("report out/0.verdicts.parquet -o one.html");
    assert!(!house.text("one.html").contains("What changed since"));
}

#[test]
fn a_mail_says_what_changed_since_an_earlier_run() {
    let house = House::new();
    let tables = Tables { house: &house, printhead: "p" };
    let gone = Tables { house: &house, printhead: "gone" };
    gone.write("0-other", 0, &[]);
    tables.write_three_nights();
    let knew = |names: &[&str]| {
        let row = |name: &&str| {
            json!({
                "recording": format!("{name}.mcap"),
                "verdicts": format!("{name}.verdicts.parquet"),
            })
        };
        let rows: Vec<_> = names.iter().map(row).collect();
        house.write("last.json", json!({ "recordings": rows }).to_string());
    };
    knew(&["0", "0-other", "1"]);
    let told = house.ok("report out --changes-since last.json");
    let under = |words: &str| {
        let lines = told.lines().skip_while(|line| !line.starts_with(words)).skip(1);
        lines.take_while(|line| line.starts_with("  ")).collect::<Vec<_>>().join("\n")
    };
    assert!(told.starts_with("1 recording since that run, from 2025-01-0"), "{told}");
    assert!(under("new: 1").contains("p channel 3: "), "{told}");
    assert!(under("healthy again: 1").contains("p channel 5: "), "{told}");
    assert!(under("not judged: 1").contains("gone: not judged in any recording since"), "{told}");
    assert!(told.ends_with("1 channel to clean as before\n"), "{told}");
    let json = house.json("report out --changes-since last.json --json");
    let channels = |key: &str| -> Vec<u64> {
        let faults = json[key].as_array().unwrap_or_else(|| panic!("{key} in {json}"));
        faults.iter().map(|fault| fault["channel"].as_u64().unwrap()).collect()
    };
    assert_eq!(["new", "back", "worse", "cured"].map(channels), [vec![3], vec![], vec![], vec![5]]);
    assert_eq!((&json["unjudged"][0]["what"], &json["still"]), (&"gone".into(), &1.into()));
    assert!(json.get("page").is_none() && json["recordings"] == 1);
    // beside a page it says the same, and the page is there
    assert!(house.ok("report out --changes-since last.json -o r.html").starts_with(&told));
    assert!(house.path("r.html").is_file() && house.path("r.faults.parquet").is_file());
    // what is no earlier run of these results
    house.run("report out --changes-since none.json").exits(2).says("none.json: cannot be read");
    house.write("last.json", "{}");
    house.run("report out --changes-since last.json").exits(2).says("not the run.json of a replay");
    knew(&["elsewhere/night"]);
    house
        .run("report out --changes-since last.json")
        .exits(2)
        .says("none of that run's recordings");
    knew(&["0", "0-other", "1", "2"]);
    let nothing = house.ok("report out --changes-since last.json");
    assert!(
        nothing.starts_with("no recording has verdicts that it had not at that run"),
        "{nothing}"
    );
    assert_eq!(house.json("report out --changes-since last.json --json")["recordings"], 0);
}

#[test]
fn a_run_is_an_earlier_run_of_the_same_directory() {
    let house = House::new();
    let all = bursts(&sample("print_run.mcap"));
    let judge = "replay rec --design sample_logs/design.json --out out --layout date";
    house.record("rec/a.mcap", &all[..60]);
    house.run(judge).exits(0);
    let knows_all = || drop(house.write("last/run.json", house.read("out/run.json")));
    knows_all();
    house.record("rec/b.mcap", &all[60..]);
    house.run(judge).exits(0);
    let json = house.json("report out --changes-since last --json");
    assert_eq!(json["recordings"], 1, "{json}");
    assert!(!json["new"].as_array().unwrap().is_empty(), "{json}");
    // what was judged again is not what that run had, nor is what was recorded before it
    knows_all();
    let new = || house.json("report out --changes-since last --json");
    assert_eq!(new()["recordings"], 0);
    let before = days_later(all[60..].to_vec(), -1);
    house.record("rec/late.mcap", &before);
    house.run(judge).exits(0);
    assert_eq!(new()["recordings"], 1);
    house.run(&format!("{judge} --set isolate.certainty=0.9")).exits(0);
    let json = new();
    assert_eq!(json["recordings"], 3, "{json}");
    assert!(json["still"] == 0 && !json["new"].as_array().unwrap().is_empty(), "{json}");
    house.run(judge).exits(0);
    std::fs::remove_file(house.path("rec/late.mcap")).unwrap();
    // a night of which nothing could be judged is no night without news
    knows_all();
    house.write("rec/c.mcap", "no recording");
    house.run(judge).exits(3);
    let told = house.ok("report out --changes-since last");
    assert!(told.contains("not judged: 1\n  c.mcap: "), "{told}");
}

#[test]
fn every_recording_is_accounted_for() {
    let house = House::new();
    let all = bursts(&sample("print_run.mcap"));
    house.record("rec/night.mcap", &all[..60]);
    house.record("rec/empty.mcap", &[]);
    house.write("rec/other.mcap", b"no recording");
    house.replay("rec").exits(3);
    let told = house.ok("report out -o r.html");
    let page = house.text("r.html");
    for text in [&told, &page] {
        assert!(text.contains("Not judged. empty.mcap: no inkling.Burst messages"), "{text}");
        assert!(text.contains("other.mcap: not an MCAP file"), "{text}");
    }
    assert!(page.contains("2 recordings without verdicts"), "{page}");
    let table = between(&page, "<h2>Recordings and printheads</h2>", "</table>");
    for name in ["night", "empty.mcap", "other.mcap"] {
        assert!(table.contains(name), "{name}");
    }
    // three models of the design are no drift
    assert!(!page.contains("Drift of the healthy ring"));
    // one that is read in the end is no longer missing
    house.record("rec/other.mcap", &all[60..120]);
    std::fs::remove_file(house.path("rec/empty.mcap")).unwrap();
    house.replay("rec").exits(0);
    let told = house.ok("report out -o r.html");
    assert!(!told.contains("Not judged"), "{told}");
}

#[test]
fn hostile_names_are_inert_and_stay_names_in_the_table() {
    let house = House::new();
    let name = "</title></svg><script src=x>alert('1')</script>\" onload=\"x\u{202e}\u{1b}[2J";
    let tables = Tables { house: &house, printhead: name };
    tables.write("a", 0, &[spell(1, 5, None)]);
    // and one that nobody heard of late: what is not known of it stands beside its light
    let silent = format!("{name} 2");
    Tables { house: &house, printhead: &silent }.write("0", -2 * DAY_S, &[]);
    let pairs = "--set report.actions.blocked_nozzle=<b>wipe</b>";
    let told = house.run(&format!("report out -o r.html {pairs}")).exits(0).stdout();
    assert!(!told.contains(['\u{1b}', '\u{202e}']), "{told:?}");
    let page = house.text("r.html");
    is_inert(&page);
    assert!(
        !page.contains("onload=\"") && !page.contains("<b>wipe</b>") && !page.contains('\u{1b}')
    );
    let found = faults(&house, "r.faults.parquet");
    assert_eq!((found[0].printhead.as_str(), found[0].action.as_str()), (name, "<b>wipe</b>"));
}

#[test]
fn what_cannot_be_read_costs_itself_and_is_said() {
    let house = House::new();
    house.write("out/x.txt", b"");
    house.run("report out -o r.html").exits(1).says("nothing found");
    let tables = Tables { house: &house, printhead: "p" };
    for name in ["a", "b", "c"] {
        tables.write(name, 0, &[spell(1, 5, None)]);
    }
    std::fs::remove_file(house.path("out/a.episodes.parquet")).unwrap();
    std::fs::remove_file(house.path("out/a.summary.json")).unwrap();
    house.write("out/b.verdicts.parquet", b"PAR1 no more PAR1");
    let ended = house.run("report out -o r.html").exits(3);
    ended.says("a.episodes.parquet: is missing").says("b.verdicts.parquet");
    let page = house.text("r.html");
    assert!(page.contains("no episodes file"));
    assert_eq!(faults(&house, "r.faults.parquet").len(), 1);
    // the same recording twice counts once
    for kind in ["verdicts.parquet", "episodes.parquet", "summary.json"] {
        house.write(&format!("again/c.{kind}"), house.read(&format!("out/c.{kind}")));
    }
    let ended = house.run("report again out/c.verdicts.parquet -o s.html").exits(0);
    ended.says("there already");

    house.run("report out -o r.parquet").exits(2).says("name.html");
    house.run("report out -o out/a.verdicts.parquet").exits(2);
    house.run("report out -o r.html --set detect.mu=2").exits(2).says("no effect");
    house.run("report out -o r.html --set report.actions.x=").exits(2).says("say what to do");
    let misspelt = "--set report.actions.dried_nozle=spit";
    let ended = house.run(&format!("report out -o r.html {misspelt}")).exits(2);
    ended.says("dried_nozle").says("dried_nozzle");
    house.run(&format!("replay sample_logs/print_run.mcap {misspelt}")).exits(2);
}

#[test]
fn man_pages_completions_and_versions_are_there_for_every_verb() {
    let house = House::new();
    house.ok("generate man -o man");
    let page = house.text("man/inkling-report.1");
    assert!(page.contains(".TH") && page.contains("report"), "{page}");
    // an example stays a line, however narrow the page is; what explains it is filled
    let first = between(&page, ".SH EXAMPLES\n.nf\n", ".fi\n");
    assert!(first.starts_with("  inkling report verdicts/ \\-o report.html\n"), "{first}");
    assert!(between(&page, first, ".SH").contains("Reads what"), "{page}");
    for shell in ["bash", "zsh", "fish"] {
        let script = house.ok(&format!("generate completions {shell}"));
        assert!(script.contains("replay") && script.contains("critique"), "{shell}");
    }
    house.run("--help").exits(0).says("Examples");
    house.run("replay --help").exits(0).says("--pace");
    for verb in ["replay", "report", "score", "critique", "generate"] {
        let said = house.ok(&format!("{verb} --version"));
        assert!(said.contains(env!("CARGO_PKG_VERSION")), "{said}");
    }
}

#[test]
fn annotations_lie_on_the_recordings_time_line_and_do_not_outlive_their_verdicts() {
    let house = House::new();
    let recording = sample("print_run.mcap");
    let args = "replay sample_logs/print_run.mcap --design sample_logs/design.json --out out";
    house.ok(args);
    assert!(!house.path("out/print_run.annotations.mcap").exists());
    let told = house.ok(&format!("{args} --annotate")); // finished before, but not annotated
    assert!(told.contains("1 annotated") && told.contains("print_run.annotations.mcap"), "{told}");
    let bytes = house.read("out/print_run.annotations.mcap");
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    let named = |schema: &str| {
        let is_of = |c: &Arc<mcap::Channel>| c.schema.as_ref().is_some_and(|s| s.name == schema);
        let of = summary.channels.values().filter(|c| is_of(c));
        of.map(|c| c.topic.clone()).collect::<Vec<String>>()
    };
    assert_eq!(named("foxglove.Log"), ["/inkling/log"]);
    assert_eq!(named("foxglove.CompressedImage").len(), 3, "a picture of each printhead");
    assert!(named("inkling.ChannelState").len() >= 10);
    let times = summary.stats.unwrap();
    let run = |b: &Burst| b.t_acq_ns as u64;
    let bursts = bursts(&recording);
    let (first, last) = (bursts.iter().map(run).min(), bursts.iter().map(run).max());
    assert!(Some(times.message_start_time) >= first && Some(times.message_end_time) <= last);
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        if message.channel.topic.ends_with("/map") {
            assert!(message.data.windows(4).any(|w| w == b"\x89PNG"));
        }
    }
    house.ok(&format!("{args} --annotate --force"));
    assert!(bytes == house.read("out/print_run.annotations.mcap"), "the same again");
    house.ok(&format!("{args} --force"));
    assert!(!house.path("out/print_run.annotations.mcap").exists(), "of other verdicts");
}

/// A damaged table of one recording costs its annotations, and nothing of the others.
#[test]
fn what_cannot_be_annotated_does_not_stop_the_run() {
    let house = House::new();
    house.copy("print_run.mcap", "rec/a.mcap");
    house.copy("print_run.mcap", "rec/b.mcap");
    house.replay("rec").exits(0);
    let mut table = house.read("out/a.episodes.parquet");
    table.iter_mut().for_each(|byte| *byte ^= 0x55);
    house.write("out/a.episodes.parquet", &table);
    house.replay("rec --annotate").exits(3).says("a.episodes.parquet").says("no annotations");
    assert!(house.path("out/b.annotations.mcap").exists());
    assert!(!house.path("out/a.annotations.mcap").exists());
    let run = house.read_json("out/run.json");
    assert_eq!((&run["end"], &run["exit"]), (&"finished".into(), &3.into()), "{run}");
    // what is set aside takes its annotations with it
    house.write("rec/b.mcap", "no recording any more");
    house.replay("rec").exits(3);
    assert!(!house.path("out/b.annotations.mcap").exists());
    assert!(house.path("out/b.annotations.mcap.stale").exists());
}

#[test]
fn an_evaluation_says_on_its_page_what_it_says_on_the_terminal() {
    let house = House::new();
    house.replay("sample_logs/print_run.mcap").exits(0);
    let score = "score out --labels sample_logs/labels.csv --report e.html";
    let said = house.json(&format!("{score} --json"));
    let page = house.text("e.html");
    is_inert(&page);
    let d = &said["detection"];
    let count = |key: &str| d[key].as_u64().unwrap();
    let recall = 100.0 * count("tp") as f64 / (count("tp") + count("fn")) as f64;
    assert!(page.contains(&format!("{recall:.1} % of")), "{recall}");
    assert!(page.contains("12 labelled faults"), "rows of a growing fault are one");
    // the same recording judged a second time counts once
    house.ok("replay sample_logs/print_run.mcap --design sample_logs/design.json --out out/b");
    let twice = house.run(&format!("{score} --json")).exits(0).says("there already").stdout();
    let twice: serde_json::Value = serde_json::from_str(&twice).unwrap();
    assert_eq!(twice["detection"], *d);
    std::fs::remove_dir_all(house.path("out/b")).unwrap();
    for title in ["ROC: area", "Delay against false alarms", "Reliability", "Risk against coverage"]
    {
        assert!(page.contains(title), "{title}");
    }
    house.run("score out --labels sample_logs/labels.csv --report out").exits(2).says("directory");
    // labels of another day: nothing is scored, and nothing is drawn of nothing
    house.write("other.csv", "printhead,channel,from,to,state,severity\nnobody,*,,,healthy,\n");
    let ended = house.run("score out --labels other.csv --report none.html").exits(1);
    let ended = ended.says("nothing to score");
    assert!(ended.stdout().is_empty() && !house.path("none.html").exists());
}

#[test]
fn a_design_promises_before_any_data_are_judged() {
    let house = House::new();
    let score = "score --design sample_logs/design.json";
    let said = house.json(&format!("{score} --json"));
    let classes = said["promise"]["classes"].as_array().unwrap();
    let of = |class: &str| classes.iter().find(|c| c["class"] == class).unwrap();
    let smallest = |class: &str| of(class)["smallest"].as_f64().unwrap();
    // an empty channel rings quite differently; a little more viscosity hardly does
    assert!(of("EC")["found"].as_f64().unwrap() > 0.99, "{said}");
    assert!((1.02..1.7).contains(&smallest("SDN")), "{said}");
    assert_eq!(smallest("SDN"), smallest("DDN"), "degrees of one kind of fault");
    let pairs = said["promise"]["pairs"].as_array().unwrap();
    assert_eq!(pairs.len(), classes.len() * (classes.len() - 1) / 2);
    let both = [json!(["EC", "DDN"]), json!(["DDN", "EC"])];
    let pair = pairs.iter().find(|pair| both.contains(&pair["classes"])).unwrap();
    assert!(pair["mistaken"].as_f64().unwrap() < 0.01, "{pair}");
    let told = house.ok(&format!("{score} --report e.html"));
    assert!(told.contains("what the design promises"), "{told}");
    let page = house.text("e.html");
    is_inert(&page);
    assert!(page.contains("Detectability") && page.contains("Isolability"));
    house.run("score out --design x.json").exits(2).says("x.json");
    house.run("score out --design sample_logs/design.json").exits(2).says("together");
}
