//! Batches of recordings, night after night: every recording accounted for, nothing done twice,
//! nothing overwritten by something else, baselines in their order or not at all.

use crate::house::House;
use crate::not_judged::report;
use crate::recorded::{bursts, sample};
use inkling::burst::Burst;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs::File;

const DAY_NS: i64 = 86_400_000_000_000;

/// Bursts of one printhead of the sample run, `n` from the `from`-th on.
pub fn some(from: usize, n: usize) -> Vec<Burst> {
    let all = bursts(&sample("print_run.mcap"));
    let one = all[0].printhead.clone();
    all.into_iter().filter(|b| b.printhead == one).skip(from).take(n).collect()
}

/// Every file below `out` by its path, but for what tells when and how fast.
pub fn results(house: &House) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    for name in house.files("out") {
        let mut bytes = house.read(&format!("out/{name}"));
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

pub fn journal(house: &House) -> Vec<Value> {
    let text = house.text("out/journal.jsonl");
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

#[test]
fn what_is_finished_is_skipped_and_the_reason_for_what_is_not_is_told() {
    let house = House::new();
    for (i, name) in ["rec/1/a.mcap", "rec/1/b.mcap", "rec/2/a.mcap"].iter().enumerate() {
        house.record(name, &some(i, 3));
    }
    house.replay("rec").exits(0).says("2/a.mcap").says("3 recordings: 3 judged");
    let first = results(&house);
    assert_eq!(first.len(), 9, "{:?}", first.keys());
    assert_eq!(journal(&house).len(), 3);
    house.replay("rec").exits(0).says("0 judged, 3 skipped");
    assert_eq!(journal(&house).len(), 3, "what was not done has no new line");

    // another time of change is no other content, and is remembered
    let path = house.path("rec/1/b.mcap");
    let later = std::time::SystemTime::now() + std::time::Duration::from_secs(3600);
    let modified = || File::options().write(true).open(&path).unwrap().set_modified(later).unwrap();
    modified();
    house.replay("rec").exits(0).says("3 skipped");
    assert_eq!(journal(&house).len(), 4);
    // the same size and time: only its content tells
    let mut bytes = std::fs::read(&path).unwrap();
    let at = bytes.len() / 2;
    let mut flip = || {
        bytes[at] ^= 1;
        std::fs::write(&path, &bytes).unwrap();
        modified();
    };
    flip();
    house.replay("rec").exits(0).says("3 skipped");
    house.replay("rec --verify --dry-run").exits(0).says("1/b.mcap  the recording changed");
    assert_eq!(journal(&house).len(), 4, "a dry run writes nothing");
    flip();

    for (more, why) in [
        ("--set identify.first=10", "settings changed: identify.first"),
        ("--force", "--force"),
        ("--set output.timestamps=us", "settings changed: output.timestamps"),
    ] {
        house.replay(&format!("rec --dry-run {more}")).exits(0).says(why).says("judge 3");
    }
    house.replay("rec --dry-run --threads 1 --pace max").exits(0).says("skip 3");
    house.remove("out/2/a.episodes.parquet");
    house.replay("rec").exits(0).says("1 judged, 2 skipped");
    house.replay("rec --force").exits(0).says("3 judged");
    let again = results(&house);
    assert_eq!(again.keys().collect::<Vec<_>>(), first.keys().collect::<Vec<_>>());
    assert!(again["1/a.verdicts.parquet"] == first["1/a.verdicts.parquet"]);
}

/// Twelve bursts in chunks, of which two thirds are there.
fn truncated(house: &House, name: &str) {
    house.record_in_chunks(name, &some(1, 12));
    let whole = house.read(name);
    house.write(name, &whole[..whole.len() * 2 / 3]);
}

#[test]
fn damage_is_news_once_and_verdicts_that_were_cut_are_made_again() {
    let house = House::new();
    house.record("rec/a.mcap", &some(0, 3));
    truncated(&house, "rec/b.mcap");
    let told = house.replay("rec").exits(3).says("2 judged").stdout();
    assert!(told.contains("damaged      b.mcap"), "{told}");
    let first = results(&house);
    for _ in 0..2 {
        let later = house.replay("rec").exits(0).says("2 skipped").stdout();
        assert!(!later.contains("b.mcap"), "told once: {later}");
        let run = house.read_json("out/run.json");
        let old = run["recordings"].as_array().unwrap().iter().find(|r| r["recording"] == "b.mcap");
        assert_eq!((&run["exit"], &old.unwrap()["outcome"]), (&0.into(), &"damaged".into()));
        assert_eq!(run["totals"]["damaged"], 1);
    }
    let verdicts = house.read("out/a.verdicts.parquet");
    house.write("out/a.verdicts.parquet", &verdicts[..verdicts.len() - 1]);
    house.replay("rec").exits(0).says("1 judged, 1 skipped");
    assert!(results(&house) == first);

    house.replay("rec --strict").exits(3).says("b.mcap");
    // a new night is judged, and what is damaged in it is news
    house.record("rec/c.mcap", &some(5, 3));
    house.replay("rec").exits(0).says("1 judged, 2 skipped");
    truncated(&house, "rec/d.mcap");
    house.replay("rec").exits(3).says("d.mcap");
}

/// The same bursts as if a logger had sampled them every 5 us: no design fits.
pub fn sampled_otherwise(from: usize, n: usize) -> Vec<Burst> {
    some(from, n).into_iter().map(|b| Burst { sample_period_s: 5e-6, ..b }).collect()
}

#[test]
fn a_night_of_which_nothing_was_judged_is_exit_4_and_says_the_numbers_that_differ() {
    let house = House::new();
    house.record("night.mcap", &sampled_otherwise(0, 3));
    let ended = house.replay("night.mcap --quiet").exits(4);
    let (told, said) = (ended.stdout(), ended.stderr());
    house.copy("design.json", "design.json");
    let design = house.read_json("design.json");
    let period_us = (design["sample_period_s"].as_f64().unwrap() * 1e12).round() / 1e6;
    let differs =
        format!("every 5 µs with {} samples a signal, the design's every ", design["samples"]);
    assert!(told.is_empty() && said.lines().count() == 1, "{told}{said}");
    assert!(said.contains(&differs) && said.contains(&format!("{period_us} µs")), "{said}");
    assert!(said.contains("none of the") && said.contains("night.mcap"), "{said}");
    let run = house.read_json("out/run.json");
    assert_eq!((&run["exit"], &run["totals"]["not_judged"]), (&4.into(), &1.into()));
    let line = &journal(&house)[0];
    assert_eq!(line["outcome"], "not_judged");
    assert!(line["not_judged"][0].as_str().unwrap().contains("5 µs"), "{line}");
    assert_eq!(house.read_json("out/night.summary.json")["not_judged"][0]["judged"], 0);
    let again = house.replay("night.mcap --quiet").exits(0);
    assert!(again.stderr().is_empty(), "told once: {}", again.stderr());
    house.replay("night.mcap --quiet --strict").exits(4);

    // neither the list nor the page says that nothing needs care
    let told = report(&house, "out", 0);
    told.leads_with("Nothing was judged. night: none of the");
    assert!(told.first_sentence().contains("5 µs") && !told.terminal.contains("needs care"));
    assert!(told.page.contains("none of 48 channels was judged"));
    assert!(!told.page.contains("needs care") && !told.page.contains("0 of 48 channels"));
}

#[test]
fn exit_4_beats_3_and_is_of_a_printhead_or_of_less_than_half() {
    let house = House::new();
    // one of two printheads
    let mut both = some(0, 6);
    let other = sampled_otherwise(0, 3).into_iter();
    both.extend(other.map(|b| Burst { printhead: "other".into(), ..b }));
    house.record("rec/a.mcap", &both);
    house.write("rec/b.mcap", b"no recording");
    house.record("rec/c.mcap", &some(7, 3));
    let ended = house.replay("rec").exits(4).says("1 not judged, 1 failed");
    ended.says("none of the").says("signals of other could be judged");
    let told = report(&house, "out", 0);
    told.leads_with("Not judged. a: none of the");
    assert!(told.terminal.contains("b.mcap: "), "{}", told.terminal);

    // less than half of a recording, of the only printhead; then more than half
    let house = House::new();
    let mixed = |otherwise: usize| {
        let mut bursts = some(0, 6);
        for burst in &mut bursts[..otherwise] {
            burst.sample_period_s = 5e-6;
        }
        bursts
    };
    house.record("most.mcap", &mixed(4));
    house.replay("most.mcap").exits(4).says("signals could be judged").says("5 µs");
    house.record("few.mcap", &mixed(2));
    house.replay("few.mcap").exits(3);
    let told = report(&house, "out/few.verdicts.parquet", 0);
    told.leads_with("Not all is known: ");
    assert!(told.terminal.contains("were not judged"), "{}", told.terminal);
    assert!(told.first_sentence().contains("were not judged"), "{}", told.first_sentence());
}

#[test]
fn of_1000_recordings_with_one_changed_one_is_done_again() {
    let house = House::new();
    let bursts = some(0, 1);
    for i in 0..1000 {
        house.record(&format!("rec/{}/{i}.mcap", i % 30), &bursts);
    }
    let judged_and_skipped = |judged: u64, skipped: u64| {
        house.replay("rec --quiet").exits(0);
        let run = house.read_json("out/run.json");
        let totals = &run["totals"];
        assert_eq!((&totals["judged"], &totals["skipped"]), (&judged.into(), &skipped.into()));
        run
    };
    judged_and_skipped(1000, 0);
    house.record("rec/7/37.mcap", &some(1, 1));
    let run = judged_and_skipped(1, 999);
    let of_run = run["recordings"].as_array().unwrap();
    let again: Vec<&Value> = of_run.iter().filter(|row| row["skipped"] == false).collect();
    assert_eq!(again.len(), 1);
    assert_eq!(again[0]["recording"], "7/37.mcap");
    assert_eq!(again[0]["why"], "the recording changed");
}

#[test]
fn another_nights_recording_of_the_same_name_overwrites_nothing() {
    let house = House::new();
    house.record("rec/1/a.mcap", &some(0, 3));
    house.record("rec/2/a.mcap", &some(5, 3));
    house.replay("rec/1").exits(0);
    let first = results(&house);
    for force in ["", "--force"] {
        let refused = house.replay(&format!("rec/2 {force}")).exits(1);
        refused.says("another recording").says("--layout date");
        assert!(results(&house) == first);
    }
    // also where only the tables tell whose they are, or nothing does
    house.remove("out/journal.jsonl");
    house.replay("rec/2").exits(1).says("another recording, a.mcap");
    house.replay("rec/1").exits(0);
    // a run that was killed while it named its files leaves the first of them
    for left in [&["a.episodes.parquet"][..], &["a.episodes.parquet", "a.verdicts.parquet"]] {
        for file in ["journal.jsonl", "a.summary.json", "a.verdicts.parquet"] {
            if !left.contains(&file) {
                house.remove(&format!("out/{file}"));
            }
        }
        house.replay("rec/2").exits(1).says("another recording, a.mcap");
        house.replay("rec/1").exits(0);
        assert!(results(&house) == first);
    }
    house.remove("out");
    house.write("out/a.verdicts.parquet", "not a table");
    house.replay("rec/1").exits(1).says("nothing says of which recording");

    // one that is refused costs itself; the same content elsewhere is the same recording
    house.remove("out");
    house.replay("rec/1").exits(0);
    house.record("rec/2/b.mcap", &some(5, 3));
    house.replay("rec/2").exits(3).says("1 judged, 1 failed");
    std::fs::rename(house.path("rec"), house.path("moved")).unwrap();
    house.replay("moved/1").exits(0).says("1 skipped");
    house.replay("moved/1 moved/2").exits(2).says("would both be written");
}

#[test]
fn layouts_keep_apart_what_a_tree_or_a_day_keeps_apart() {
    let house = House::new();
    house.record("rec/1/a.mcap", &some(0, 3));
    house.record("rec/2/a.mcap", &on_day(1, 3));
    for (night, day) in [("rec/1", "2025-01-01"), ("rec/2", "2025-01-02")] {
        house.replay(&format!("{night} --layout date")).exits(0);
        assert!(house.path(&format!("out/{day}/a.verdicts.parquet")).exists(), "{day}");
    }
    house.replay("rec --layout date").exits(0).says("2 skipped");
    // its results are known although it cannot be dated any more
    house.write("rec/2/a.mcap", b"");
    house.replay("rec --layout date").exits(3).says("1 skipped").says("1 failed");
    assert!(house.path("out/2025-01-02/a.verdicts.parquet.stale").exists());
    house.remove("out");
    house.replay("rec --layout flat").exits(2).says("would both be written");
    assert!(!house.path("out").exists(), "refused before anything is written");
    house.replay("rec --set output.layout=wide").exits(2).says("wide");
}

#[test]
fn each_kind_of_table_is_one_data_set() {
    let house = House::new();
    house.record("rec/1/a.mcap", &some(0, 3));
    house.record("rec/2/a.mcap", &on_day(1, 3));
    house.replay("rec --layout hive").exits(0);
    for ending in ["verdicts.parquet", "episodes.parquet", "summary.json"] {
        let (dir, _) = ending.split_once('.').unwrap();
        let days = ["2025-01-01", "2025-01-02"].map(|day| format!("day={day}/a.{ending}"));
        assert_eq!(house.files(&format!("out/{dir}")), days, "{dir}");
    }
    house.replay("rec --layout hive").exits(0).says("2 skipped");
    house.ok("report out -o out/report.html");
    house.replay("rec/1/a.mcap --layout hive --follow").exits(2).says("--layout tree or flat");
}

#[test]
fn one_bad_recording_costs_one_recording() {
    let house = House::new();
    house.record("good1.mcap", &some(0, 3));
    house.record("good2.mcap", &some(1, 3));
    house.write("empty.mcap", b"");
    house.write("text.mcap", b"no recording at all");
    std::fs::create_dir(house.path("bare")).unwrap();
    let ended = house.replay("good1.mcap missing.mcap empty.mcap bare text.mcap good2.mcap");
    let ended = ended.exits(3).says("missing.mcap: no such file").says("nothing found");
    assert!(ended.stdout().contains("6 recordings: 2 judged, 4 failed"), "{}", ended.stdout());
    let run = house.read_json("out/run.json");
    assert_eq!(run["exit"], 3);
    assert_eq!(run["recordings"].as_array().unwrap().len(), 6);
    assert_eq!(journal(&house).len(), 4, "what was not found has no line");
    // of a lone recording that fails there is an account, too
    house.replay("text.mcap").exits(1).says("not an MCAP");
    let run = house.read_json("out/run.json");
    assert_eq!((&run["exit"], &run["totals"]["failed"]), (&1.into(), &1.into()));
}

#[cfg(unix)]
#[test]
fn what_may_not_be_read_costs_itself() {
    use std::os::unix::fs::PermissionsExt;
    let house = House::new();
    house.record("rec/good.mcap", &some(0, 3));
    house.record("rec/shut.mcap", &some(1, 3));
    house.record("rec/closed/a.mcap", &some(2, 3));
    let allow = |name: &str, mode| {
        let permissions = std::fs::Permissions::from_mode(mode);
        std::fs::set_permissions(house.path(name), permissions).unwrap();
    };
    allow("rec/shut.mcap", 0);
    allow("rec/closed", 0);
    let all_may = File::open(house.path("rec/shut.mcap")).is_ok(); // as root
    let ended = house.replay("rec");
    allow("rec/closed", 0o700);
    match all_may {
        true => drop(ended.exits(0)),
        false => drop(ended.exits(3).says("shut.mcap").says("closed").says("1 judged, 2 failed")),
    }
}

#[test]
fn recording_that_fails_today_leaves_no_table_that_looks_current() {
    let house = House::new();
    house.record("rec/a.mcap", &some(0, 3));
    house.record("rec/b.mcap", &some(1, 3));
    house.replay("rec").exits(0);
    let before = results(&house);
    house.write("rec/a.mcap", b"something else");
    house.replay("rec").exits(3).says("a.mcap: not an MCAP");
    let now = results(&house);
    let names: Vec<&String> = now.keys().filter(|name| name.starts_with('a')).collect();
    assert_eq!(names.len(), 3);
    assert!(names.iter().all(|name| name.ends_with(".stale")), "{names:?}");
    assert!(now["b.verdicts.parquet"] == before["b.verdicts.parquet"]);
    house.record("rec/a.mcap", &some(0, 3));
    house.replay("rec").exits(0).says("1 judged, 1 skipped");
    assert!(results(&house) == before);
}

#[test]
fn warnings_are_told_once_for_all_recordings_and_counted() {
    let house = House::new();
    for i in 0..5usize {
        let mut warm = some(3 * i, 3);
        warm.iter_mut().for_each(|b| b.temperature_c = Some(60.0 + i as f64));
        house.record(&format!("rec/{i}.mcap"), &warm);
    }
    let ended = house.replay("rec --set identify.common_change=false");
    let (said, table) = (ended.stderr(), ended.stdout());
    assert_eq!(said.matches("expect false alarms").count(), 1, "{said}");
    assert!(table.contains("5 times in 5 recordings"), "{table}");
    let warnings = &house.read_json("out/run.json")["warnings"];
    assert_eq!((&warnings[0]["times"], &warnings[0]["first"]), (&5.into(), &"0.mcap".into()));
}

#[test]
fn a_temperature_that_the_design_does_not_know_is_followed_without_a_word() {
    let house = House::new();
    for name in ["rec/a.mcap", "rec/b.mcap"] {
        house.copy("print_run.mcap", name);
    }
    let said = house.replay("rec --identify design").exits(0).stderr();
    assert!(!said.contains("note: ") && !said.contains("warning: "), "{said}");
    let alone = "rec --identify design --set identify.common_change=false";
    let said = house.replay(alone).exits(0).stderr();
    assert!(said.contains("expect false alarms"), "{said}");
}

#[test]
fn scripts_get_lines_or_silence() {
    let house = House::new();
    house.record("rec/a.mcap", &some(0, 3));
    house.record("rec/b.mcap", &some(1, 3));
    house.write("rec/c.mcap", b"");
    let ended = house.replay("rec --json").exits(3);
    let events: Vec<Value> =
        ended.stdout().lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let of = |key: &str| events.iter().map(|e| e[key].clone()).collect::<Vec<_>>();
    assert_eq!(of("event"), ["recording", "recording", "recording", "run"]);
    assert_eq!(of("outcome")[..3], ["judged", "judged", "failed"]);
    assert_eq!(events[0]["counts"]["bursts"], 3);
    assert_eq!((&events[3]["exit"], &events[3]["judged"]), (&3.into(), &2.into()));
    let planned = house.replay("rec --json --dry-run").exits(0).stdout();
    assert_eq!(planned.lines().count(), 3);

    house.remove("rec/c.mcap");
    let quiet = house.replay("rec --quiet --force").exits(0);
    assert_eq!(quiet.stdout() + &quiet.stderr(), "");
    let failed = house.replay("missing.mcap --quiet").exits(2);
    assert!(failed.stdout().is_empty() && failed.stderr().contains("missing.mcap"));
    let inspected = house.json("inspect rec/a.mcap --json");
    assert_eq!((&inspected["bursts"], &inspected["whole"]), (&3.into(), &true.into()));
    let made = house.run("identify rec/a.mcap -o model.json --quiet").exits(0);
    assert_eq!(made.stdout() + &made.stderr(), "");
}

/// `n` bursts of one printhead on a day.
pub fn on_day(day: i64, n: usize) -> Vec<Burst> {
    days_later(some(5 * day as usize, n), day)
}

pub fn days_later(bursts: Vec<Burst>, days: i64) -> Vec<Burst> {
    let later = |b: Burst| Burst { t_acq_ns: b.t_acq_ns + days * DAY_NS, ..b };
    bursts.into_iter().map(later).collect()
}

#[test]
fn baselines_go_on_where_they_stopped_or_the_reason_is_told() {
    let house = House::new();
    for (day, name) in ["c", "b", "a"].iter().enumerate() {
        house.record(&format!("rec/{name}.mcap"), &on_day(day as i64, 20));
    }
    let with = |more: &str| house.replay(&format!("rec --baseline own.json {more}"));
    let third = house.read("rec/a.mcap");
    house.remove("rec/a.mcap");
    with("").exits(0).says("2 judged");
    let after_two = house.read("own.json");
    with("").exits(0).says("2 skipped");
    house.write("rec/a.mcap", &third);
    with("").exits(0).says("1 judged, 2 skipped");
    let (all, own) = (results(&house), house.read("own.json"));
    let forgotten = || {
        house.remove("own.json");
        with("").exits(0).says("3 judged");
    };
    let is_the_same = || assert!(results(&house) == all && house.read("own.json") == own);
    assert!(own != after_two, "the third taught something");
    let starts: Vec<i64> =
        journal(&house).iter().map(|e| e["recording"]["starts_at_ns"].as_i64().unwrap()).collect();
    assert!(starts.is_sorted(), "{starts:?}");

    // the same as in one go
    house.remove("out");
    forgotten();
    is_the_same();
    // a run that ended before its baselines were written; baselines that are gone
    house.write("own.json", &after_two);
    with("").exits(0).says("1 judged, 2 skipped");
    is_the_same();
    forgotten();
    is_the_same();

    // one in the middle changed: the baselines know it and what came after
    house.record("rec/b.mcap", &on_day(1, 19));
    with("").exits(1).says("b.mcap: to be judged (the recording changed)").says("baseline");
    with("--force").exits(1).says("c.mcap: to be judged (--force)");
    is_the_same();
    forgotten();
    // nor does one that failed meanwhile make them forget that they know it
    house.write("rec/a.mcap", b"");
    with("").exits(3).says("2 skipped").says("1 failed");
    house.write("rec/a.mcap", &third);
    with("").exits(1).says("a.mcap: to be judged (it failed before)");
    forgotten();
    // one that cannot be read stops nothing, tonight or later
    house.write("rec/d.mcap", b"");
    with("").exits(3).says("3 skipped").says("1 failed");
    house.record("rec/e.mcap", &on_day(3, 20));
    with("").exits(3).says("1 judged, 3 skipped").says("1 failed");
    with("").exits(3).says("4 skipped").says("1 failed");
}
