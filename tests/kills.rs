//! A run that is killed anywhere, on a full disk, or may not read: nothing is mixed, nothing half done looks done, the rest
//! is judged. More such runs are in `tests/golden/kills.txt`.
#![cfg(unix)]

use crate::house::House;
use crate::recipes::{on_day, results, some};
use crate::recorded::sample;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeMap;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

fn start(house: &House, args: &str) -> Child {
    let mut inkling = house.inkling(&format!("{args} --out out --design sample_logs/design.json"));
    inkling.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
}

/// Waits until `out` has been seen in so many other states, by its names and its journal, or until the run
/// has ended; says how many there were.
fn reach(house: &House, run: &mut Child, states: usize) -> usize {
    let state = || {
        let journal = std::fs::metadata(house.path("out/journal.jsonl"));
        (house.files("out"), journal.map_or(0, |of| of.len()))
    };
    let (mut seen, mut reached) = (state(), 0);
    while reached < states {
        let has_ended = run.try_wait().unwrap().is_some();
        let now = state();
        reached += usize::from(now != seen);
        seen = now;
        if has_ended {
            break;
        }
        std::thread::sleep(Duration::from_micros(50));
    }
    reached
}

#[test]
fn killed_anywhere_and_resumed_is_the_same_as_undisturbed() {
    const KILLS: usize = 72;
    let house = three_nights();
    const ARGS: &str = "rec --baseline own.json";
    let started = Instant::now();
    let states = reach(&house, &mut start(&house, &format!("replay {ARGS}")), usize::MAX);
    let undisturbed = started.elapsed();
    let (reference, own) = (results(&house), house.read("own.json"));
    assert_eq!(reference.len(), 13);
    let mut random = ChaCha8Rng::seed_from_u64(16);
    let mut resumed_in_the_middle = 0;
    for kill in 0..KILLS {
        // sometimes into what an earlier run finished: then it is done again
        let again = kill % 3 == 2;
        if !again {
            house.remove("out");
        }
        house.remove("own.json");
        let mut child = start(&house, &format!("replay {ARGS}"));
        // right behind each state that a run leaves, in turn, and anywhere
        match kill % 2 {
            0 => drop(reach(&house, &mut child, kill / 2 % (states + 1))),
            _ => std::thread::sleep(undisturbed.mul_f64(random.random_range(0.0..1.1))),
        }
        child.kill().unwrap(); // SIGKILL
        child.wait().unwrap();
        let journal = std::fs::read_to_string(house.path("out/journal.jsonl"));
        let done = journal.map_or(0, |text| text.lines().count());
        resumed_in_the_middle += usize::from(!again && (1..3).contains(&done));
        house.replay(ARGS).exits(0);
        assert!(results(&house) == reference, "kill {kill}: {:?}", results(&house).keys());
        assert!(house.read("own.json") == own, "kill {kill}: baselines");
    }
    println!("{states} states, {resumed_in_the_middle} of {KILLS} kills between two recordings");
}

fn three_nights() -> House {
    let house = House::new();
    for i in 0..3 {
        house.record(&format!("rec/{i}/a.mcap"), &on_day(i, 10));
    }
    house
}

/// The results, and the state.
fn left(house: &House) -> (BTreeMap<String, Vec<u8>>, Vec<u8>) {
    (results(house), house.read("own.json"))
}

/// By other settings all is judged again, and the state, which rests on these recordings alone, with them: as if for the
/// first time, wherever that is killed. One that has learned from others, too, stays, and is taught nothing.
#[test]
fn what_a_state_rests_on_alone_is_judged_again_from_the_begin() {
    const OTHER: &str = "rec --baseline own.json --set isolate.certainty=0.9";
    let house = three_nights();
    house.replay(OTHER).exits(0);
    let (reference, own) = left(&house);
    for kill in 0..6 {
        house.remove("out");
        house.remove("own.json");
        house.replay("rec --baseline own.json").exits(0);
        let mut child = start(&house, &format!("replay {OTHER}"));
        reach(&house, &mut child, 2 * kill);
        child.kill().unwrap();
        child.wait().unwrap();
        house.replay(OTHER).exits(0);
        assert!(left(&house) == (reference.clone(), own.clone()), "kill {kill}");
    }
    house.record("later.mcap", &on_day(3, 10));
    house.replay_to("elsewhere", "later.mcap --baseline own.json").exits(0);
    let taught = house.read("own.json");
    house.replay("rec --baseline own.json").exits(0).says("taught it nothing");
    assert!(house.read("own.json") == taught);
}

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
    let all_may = std::fs::File::open(house.path("rec/shut.mcap")).is_ok(); // as root
    let ended = house.replay("rec");
    allow("rec/closed", 0o700);
    match all_may {
        true => drop(ended.exits(0)),
        false => drop(ended.exits(3).says("shut.mcap").says("closed").says("1 judged, 2 failed")),
    }
}

#[cfg(target_os = "linux")]
#[test]
#[ignore = "mounts a small disk, which not every machine allows: .ci/run does it where it may"]
fn full_disk_ends_the_run_with_what_to_do() {
    let house = House::new();
    for i in 0..40 {
        house.record(&format!("rec/{i:02}.mcap"), &some(i, 2));
    }
    std::fs::create_dir(house.path("out")).unwrap();
    let script = "mount -t tmpfs -o size=400k none out && INKLING --quiet; code=$?; \
                  cp out/run.json out/journal.jsonl . ; ls -A out | grep -c part >parts; exit $code";
    let inkling = env!("CARGO_BIN_EXE_inkling");
    let replay =
        format!("{inkling} replay rec --out out --design {}", sample("design.json").display());
    let mut command = Command::new("unshare");
    command.args(["-rm", "sh", "-c", &script.replace("INKLING", &replay)]);
    let ended = command.current_dir(house.path(".")).output().unwrap();
    let (code, said) = (ended.status.code(), String::from_utf8_lossy(&ended.stderr));
    assert!(!said.contains("unshare:") && !said.contains("mount:"), "no mounts here: {said}");
    assert_eq!(code, Some(1), "{said}");
    assert_eq!(said.matches("no room left").count(), 1, "one message, not one per file: {said}");
    assert!(said.contains("run the same command again"), "{said}");
    assert_eq!(house.read("parts"), b"0\n", "nothing half is left");
    let lines = house.text("journal.jsonl");
    assert!((1..40).contains(&lines.lines().count()));
}
