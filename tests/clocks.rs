//! A clock that was wrong changes what a recording's times say and nothing of what is told of faults: the list is that
//! of the same bursts with a right clock, by the times of the records or of the clock before it was set back.

use crate::house::House;
use crate::recorded::{bursts, sample};
use inkling::burst::Burst;

use inkling::io::recording_writer::{RecordingWriter, WriterOptions};
use serde_json::Value;

const S: i64 = 1_000_000_000;
const DAY: i64 = 86_400 * S;
const DESIGN: &str = "--design sample_logs/design.json";

/// Records a night of the sample `days` later, by a right clock; its bursts are dated by `dated`, of the time since the
/// night began.
fn night(house: &House, name: &str, days: i64, dated: impl Fn(i64) -> i64) {
    let all = bursts(&sample("print_run.mcap"));
    let began = all[0].t_acq_ns;
    let path = house.path(name);
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    let mut writer = RecordingWriter::create(&path, WriterOptions::default()).unwrap();
    for burst in all {
        let since = burst.t_acq_ns - began;
        let right = began + days * DAY + since;
        let t_acq_ns = right + dated(since);
        writer.write(&Burst { t_acq_ns, ..burst }, right as u64).unwrap();
    }
    writer.finish().unwrap();
}

/// A fault as it is told: where, what, in s since 1970 from when, and whether it is on.
type Told = (String, u64, String, i64, bool);

fn told(house: &House, out: &str) -> Vec<Told> {
    let document = house.json(&format!("report {out} -o r.html --json"));
    let text = |of: &Value, key: &str| of[key].as_str().unwrap_or_default().to_owned();
    let seconds = |time: &str| {
        chrono::DateTime::parse_from_rfc3339(time)
            .unwrap_or_else(|e| panic!("{time}: {e}"))
            .timestamp()
    };
    let fault = |of: &Value| {
        let channel = of["channel"].as_u64().unwrap();
        let began = seconds(of["began_at"].as_str().unwrap());
        (text(of, "printhead"), channel, text(of, "category"), began, of["ended_at"].is_null())
    };
    let mut all: Vec<Told> = document["faults"].as_array().unwrap().iter().map(fault).collect();
    all.sort();
    assert!(all.len() > 5, "{all:?}");
    all
}

#[test]
fn a_clock_that_was_set_back_or_never_set_or_is_wrong_once_changes_no_fault() {
    let house = House::new();
    let began = bursts(&sample("print_run.mcap"))[0].t_acq_ns;
    let step =
        |after_s: i64, by_ns: i64| move |since: i64| if since < after_s * S { 0 } else { -by_ns };
    night(&house, "right.mcap", 0, |_| 0);
    night(&house, "back_30.mcap", 0, step(40, 30 * S + 400_000_000));
    night(&house, "back_1h.mcap", 0, step(30, 3_599 * S));
    night(&house, "back_years.mcap", 0, step(30, 9_000 * DAY));
    night(&house, "uptime.mcap", 0, |_| 312 * S - began);
    night(&house, "future.mcap", 0, |_| 3_650 * DAY);
    night(&house, "once.mcap", 0, |since| if since / S == 30 { 3_600 * S } else { 0 });
    let run = |name: &str| {
        let ended = house.run(&format!("replay {name}.mcap {DESIGN} --out {name} --quiet"));
        assert_eq!(ended.code(), Some(0), "{name}: {}", ended.stderr());
        (ended.stderr(), told(&house, name))
    };
    let (nothing, right) = run("right");
    assert_eq!(nothing, "");
    for (name, words) in [
        ("back_30", "went back by 30.4 s"),
        ("back_1h", "went back by 60.0 min"),
        ("back_years", "went back by 24.6 years"),
        ("uptime", "are dated 1970-01-01 00:05:12"),
        ("future", "recorded from 2025-01-01 08:00:00 on"),
        ("once", "apart from the others"),
    ] {
        let (said, now) = run(name);
        assert_eq!(said.matches(words).count(), 3, "{name}: once for each printhead: {said}");
        let near = |(p, q): (&Told, &Told)| {
            (&p.0, p.1, &p.2, p.4) == (&q.0, q.1, &q.2, q.4) && p.3.abs_diff(q.3) <= 2
        };
        assert!(now.len() == right.len() && now.iter().zip(&right).all(near), "{name}: {now:#?}");
    }
}

#[test]
fn a_night_that_is_dated_wrongly_silences_no_other_and_teaches_nothing() {
    let house = House::new();
    let mut states = Vec::new();
    // the last one is dated by a clock that its recorder had, too
    for (case, dated, recorded) in
        [("right", 0, 1), ("ahead", 3_650 * DAY, 1), ("back", -9_000 * DAY, 1), ("both", 0, 20_000)]
    {
        for day in 0..3 {
            let name = format!("{case}/{day}.mcap");
            let is_wrong = case != "right" && day == 1;
            let [dated, recorded] = if day == 1 { [dated, recorded] } else { [0, day] };
            night(&house, &name, recorded, |_| dated);
            let state = format!("--baseline {case}.json");
            let run = house.run(&format!("replay {name} {DESIGN} {state} --out o{case} --quiet"));
            assert_eq!(run.code(), Some(0), "{name}: {}", run.stderr());
            let is_told = run.stderr().contains("and taught it nothing");
            assert_eq!(is_told, is_wrong, "{name}: {}", run.stderr());
        }
        states.push(told(&house, &format!("o{case}")));
    }
    let [right, ahead, back, both] = &states[..] else { panic!("four cases") };
    assert_eq!((ahead, back), (right, right));
    // that night is in no account, and so are the faults that came and went in it
    let second = bursts(&sample("print_run.mcap"))[0].t_acq_ns / S + 86_400;
    let is_in_it = |of: &&Told| (second..second + 86_400).contains(&of.3);
    let others: Vec<Told> = right.iter().filter(|of| !is_in_it(of)).cloned().collect();
    assert_eq!((both, right.len() - others.len()), (&others, 2));
    let lost = house.json("report oboth -o r.html --json")["coverage"]["lost"].to_string();
    assert!(lost.contains("its clock was wrong") && lost.contains("2079"), "{lost}");
}
