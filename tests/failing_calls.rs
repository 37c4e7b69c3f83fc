//! Every call of the system fails in turn, once, or from then on, as on a disk that is full or breaks: the run says so,
//! and the next one leaves what an undisturbed one leaves, byte for byte.
#![cfg(target_os = "linux")]

use crate::house::House;
use crate::recipes::{on_day, results_in};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, Output};

const EIO: &str = "5";
const ENOSPC: &str = "28";
const NIGHTS: &str =
    "replay rec --quiet --out out --baseline own.json --design sample_logs/design.json";

/// What is there before the run, what is run, and what of it must be made.
struct Scene {
    house: House,
    run: String,
}

impl Scene {
    /// `before`: runs over the first so many nights.
    fn new(nights: usize, before: &[(usize, &str)], run: &str) -> Scene {
        let house = House::new();
        let library = house.path("calls.so");
        let mut cc = Command::new("cc");
        cc.args(["-O1", "-shared", "-fPIC", "-o"]).arg(&library);
        cc.arg(crate::house::root().join("tests/failing_calls.c")).arg("-ldl");
        assert!(cc.status().expect("a C compiler").success());

        // as `NIGHTS`, for `inkling night`
        let design = crate::house::root().join("sample_logs/design.json");
        let input = format!("recordings = ['rec']\ndesign = '{}'\n", design.display());
        let settings = format!("[input]\n{input}baseline = 'own.json'\n[output]\ndir = 'out'\n");
        house.write("before/pipeline.toml", settings);

        let mut recorded = 0;
        let record = |upto: usize, recorded: &mut usize| {
            for day in *recorded..upto {
                house.record(&format!("before/rec/{day}.mcap"), &on_day(day as i64, 3));
            }
            *recorded = upto;
        };
        for (upto, earlier) in before {
            record(*upto, &mut recorded);
            let ended = house.inkling(earlier).current_dir(house.path("before")).output().unwrap();
            assert!(ended.status.success(), "{earlier}: {}", said(&ended));
        }
        record(nights, &mut recorded);
        Scene { house, run: run.into() }
    }

    fn begin(&self) {
        let _ = std::fs::remove_dir_all(self.house.path("now"));
        let copied = Command::new("cp")
            .arg("-a")
            .args([self.house.path("before"), self.house.path("now")])
            .status();
        assert!(copied.unwrap().success());
    }

    /// Runs the command; the environment says which call fails.
    fn run(&self, failing: &[(&str, &str)]) -> Output {
        let now = self.house.path("now");
        let mut inkling = self.house.inkling(&self.run);
        if !failing.is_empty() {
            inkling.env("LD_PRELOAD", self.house.path("calls.so")).env("FAIL_UNDER", &now);
        }
        inkling.envs(failing.iter().copied()).current_dir(&now).output().unwrap()
    }

    /// Everything that was made, but for what tells when and how fast.
    fn made(&self) -> BTreeMap<String, Vec<u8>> {
        let mut made = results_in(&self.house, "now/out");
        made.remove("night.json"); // tells times
        for name in ["own.json", "table.mcap"] {
            let file = std::fs::read(self.house.path(&format!("now/{name}")));
            made.extend(file.ok().map(|bytes| (name.to_owned(), bytes)));
        }
        let journal = self.house.path("now/out/journal.jsonl");
        made.insert("journal".into(), last_lines(&journal).into_bytes());
        made
    }

    /// Lets each call fail in turn.
    fn plays(&self) {
        self.begin();
        let count = self.house.path("count");
        let counted = self.run(&[("FAIL_COUNT", count.to_str().unwrap())]);
        assert!(counted.status.success(), "{}", said(&counted));
        let (undisturbed, calls) = (self.made(), self.house.text("count"));
        let calls: usize = calls.trim().parse().unwrap();
        assert!(calls > 20, "{calls} calls");
        for at in 1..=calls {
            // what fails from one call on differs little from what fails from the next call on
            let fails =
                [(EIO, false), (ENOSPC, true)].into_iter().take(1 + usize::from(at % 3 == 0));
            for (error, goes_on) in fails {
                self.begin();
                let nth = at.to_string();
                let mut failing = vec![("FAIL_AT", nth.as_str()), ("FAIL_AS", error)];
                failing.extend(goes_on.then_some(("FAIL_ON", "")));
                let failed = self.run(&failing);
                let place = format!("call {at} of {calls}, {failing:?}: {}", said(&failed));
                assert!(!place.contains("panicked"), "{place}");
                let is_told = !failed.stderr.is_empty();
                match failed.status.code() {
                    Some(0) => {} // nothing rests on it, or it was made good
                    Some(1..=3) => assert!(is_told, "{place}"),
                    code => panic!("{code:?}: {place}"),
                }
                let next = self.run(&[]);
                assert!(next.status.success(), "{place}\nthen: {}", said(&next));
                let made = self.made();
                for (name, bytes) in &undisturbed {
                    let now = made.get(name).map(Vec::as_slice).unwrap_or_default();
                    assert!(now == bytes, "{name}: {}: {place}", first_difference(bytes, now));
                }
                assert!(made.len() == undisturbed.len(), "{place}: {:?}", made.keys());
            }
        }
        println!("{calls} calls");
    }
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Both from a little before the first byte that differs.
fn first_difference(a: &[u8], b: &[u8]) -> String {
    let at = a.iter().zip(b).take_while(|(a, b)| a == b).count().saturating_sub(60);
    let part = |of: &[u8]| String::from_utf8_lossy(&of[at..of.len().min(at + 200)]).into_owned();
    format!("{} is now {}", part(a), part(b))
}

/// The last line of each recording in the journal, without times and without the size of its summary, which tells
/// times.
fn last_lines(journal: &Path) -> String {
    let text = std::fs::read_to_string(journal).unwrap_or_default();
    let mut last = BTreeMap::new();
    for line in text.lines() {
        let Ok(mut entry) = serde_json::from_str::<Value>(line) else { continue }; // cut short
        (entry["at"], entry["seconds"]) = (Value::Null, Value::Null);
        if let Some(bytes) = entry.pointer_mut("/results/bytes/2") {
            *bytes = Value::Null;
        }
        last.insert(entry["recording"]["path"].to_string(), entry.to_string());
    }
    last.into_values().collect::<Vec<_>>().join("\n")
}

#[test]
fn calls_that_fail_in_the_first_night_cost_nothing_but_a_second_run() {
    Scene::new(1, &[], "night --quiet").plays();
}

#[test]
fn calls_that_fail_in_later_nights_cost_nothing_but_a_second_run() {
    Scene::new(3, &[(1, NIGHTS)], NIGHTS).plays();
}

#[test]
fn calls_that_fail_while_all_is_judged_again_cost_nothing_but_a_second_run() {
    let forced = "replay rec --quiet --out out --force --design sample_logs/design.json";
    let before = forced.replace("--force ", "");
    Scene::new(2, &[(2, &before)], forced).plays();
    let annotated = format!("{before} --annotate");
    Scene::new(1, &[(1, &before)], &annotated).plays();
}

#[test]
fn calls_that_fail_while_a_recording_is_followed_cost_nothing_but_a_second_run() {
    let followed = "replay rec/0.mcap --follow --quiet --out out --baseline own.json --design \
                    sample_logs/design.json";
    Scene::new(1, &[], followed).plays();
}

#[test]
fn calls_that_fail_while_a_table_is_converted_cost_nothing_but_a_second_run() {
    let scene = Scene::new(0, &[], "convert table.csv -o table.mcap --quiet");
    let rows = (0..4000).map(|k| format!("{}e-6,{}\n", k, (k * k) % 977));
    scene.house.write("before/table.csv", format!("t,y\n{}", rows.collect::<String>()));
    scene.plays();
}
