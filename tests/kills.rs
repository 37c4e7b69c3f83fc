//! A run that is killed, locked out, out of room, or whose recording changes under it: nothing is
//! mixed, nothing half done looks done, the rest is judged.
#![cfg(unix)]

use crate::house::{House, signal, wait_until};
use crate::nights::{journal, on_day, results, some};
use crate::not_judged::report;
use crate::recorded::sample;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

pub fn start(house: &House, args: &str) -> Child {
    let mut inkling = house.inkling(&format!("{args} --out out --design sample_logs/design.json"));
    inkling.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
}

fn parts(house: &House) -> usize {
    house.files("out").iter().filter(|name| name.ends_with(".part")).count()
}

pub fn wait_for_a_part(house: &House) {
    wait_until("a table is begun", || parts(house) > 0);
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
    let house = House::new();
    for i in 0..3 {
        house.record(&format!("rec/{i}/a.mcap"), &on_day(i, 10));
    }
    const ARGS: &str = "rec --baseline own.json";
    let started = Instant::now();
    let states = reach(&house, &mut start(&house, &format!("replay {ARGS}")), usize::MAX);
    let undisturbed = started.elapsed();
    let (reference, own) = (results(&house), house.read("own.json"));
    assert_eq!(reference.len(), 9);
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

/// A state that learned from the third without the second could never judge the second as an undisturbed run does.
#[test]
fn a_state_does_not_pass_over_a_recording_whose_tables_cannot_be_written() {
    let house = House::new();
    for i in 0..3 {
        house.record(&format!("rec/{i}/a.mcap"), &on_day(i, 10));
    }
    const ARGS: &str = "rec --baseline own.json";
    house.replay(ARGS).exits(0);
    let undisturbed = (results(&house), house.read("own.json"));
    house.remove("out");
    house.remove("own.json");
    house.write("out/1", "a file where a directory is to be");
    house
        .replay(ARGS)
        .exits(1)
        .says("cannot be written")
        .says("recordings after it are not judged");
    let run = house.read_json("out/run.json");
    assert_eq!((&run["end"], &run["totals"]["not_reached"]), (&"broken".into(), &1.into()));
    house.remove("out/1");
    house.replay(ARGS).exits(0).says("2 judged, 1 skipped");
    assert!((results(&house), house.read("own.json")) == undisturbed);
}

#[test]
fn second_run_into_a_directory_is_refused_until_the_first_is_gone() {
    let house = House::new();
    house.record("rec/a.mcap", &some(0, 60));
    house.record("rec/b.mcap", &some(0, 3));
    let mut first = start(&house, "replay rec/a.mcap --pace recorded");
    wait_for_a_part(&house);
    let refused = house.replay("rec/b.mcap").exits(1);
    refused.says(&format!("process {} since 2", first.id())).says("another --out");
    house.replay("rec/b.mcap --dry-run").exits(0).says("judge 1");
    house.run("replay rec/b.mcap --out elsewhere").exits(0);
    first.kill().unwrap();
    first.wait().unwrap();
    assert!(parts(&house) > 0, "killed while it wrote");
    house.replay("rec").exits(0).says("2 judged");
    assert_eq!(parts(&house), 0, "leftovers are swept");
    assert_eq!(results(&house).len(), 6);
}

#[test]
fn interrupted_run_says_what_it_did_not_reach() {
    let house = House::new();
    house.record("rec/a.mcap", &some(0, 2));
    house.record("rec/b.mcap", &some(0, 60));
    house.record("rec/c.mcap", &some(0, 2));
    house.replay("rec/a.mcap").exits(0);
    let child = start(&house, "replay rec --pace recorded");
    wait_for_a_part(&house);
    signal(child.id(), "-TERM");
    let ended = child.wait_with_output().unwrap();
    assert_eq!(ended.status.code(), Some(1));
    let run = house.read_json("out/run.json");
    assert_eq!((&run["end"], &run["exit"]), (&"interrupted".into(), &1.into()));
    assert_eq!((&run["totals"]["skipped"], &run["totals"]["not_reached"]), (&1.into(), &2.into()));
    // of what was found nothing is to be cleaned, and two recordings nobody looked at
    let told = report(&house, "out", 0);
    told.leads_with("Not judged. b.mcap: not reached: ");
    assert!(told.terminal.contains("c.mcap: not reached: "), "{}", told.terminal);
    house.replay("rec").exits(0).says("2 judged, 1 skipped");
    assert!(!house.ok("report out -o r.html").contains("not reached"));
}

#[test]
fn recording_that_grows_or_vanishes_while_it_is_read() {
    use std::io::Write;
    let house = House::new();
    house.record("rec/a.mcap", &some(0, 6));
    // half a second a burst
    let grow = start(&house, "replay rec --pace 100");
    wait_for_a_part(&house);
    let mut file = std::fs::File::options().append(true).open(house.path("rec/a.mcap")).unwrap();
    file.write_all(&[0; 100]).unwrap();
    let ended = grow.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&ended.stderr).into_owned();
    assert_eq!(ended.status.code(), Some(3), "{said}");
    assert!(said.contains("it grew by 100 bytes"), "{said}");
    // closed properly, it is judged again
    house.record("rec/a.mcap", &some(0, 7));
    house.replay("rec --dry-run").exits(0).says("the recording changed");

    let vanish = start(&house, "replay rec --pace 100 --set identify.first=19");
    std::thread::sleep(Duration::from_millis(50));
    wait_for_a_part(&house);
    house.remove("rec/a.mcap");
    // what is open can be read to its end
    assert_eq!(vanish.wait_with_output().unwrap().status.code(), Some(0));
    assert_eq!(journal(&house).len(), 2);
}

/// Runs a script in the directory in which the recordings lie; gives its status and complaints. In the script
/// `INKLING` replays them.
fn run_script(house: &House, command: &str, args: &[&str], script: &str) -> (Option<i32>, String) {
    let inkling = env!("CARGO_BIN_EXE_inkling");
    let replay =
        format!("{inkling} replay rec --out out --design {}", sample("design.json").display());
    let script = script.replace("INKLING", &replay);
    let mut command = Command::new(command);
    let ended = command.args(args).args(["-c", &script]).current_dir(house.path(".")).output();
    let ended = ended.unwrap();
    (ended.status.code(), String::from_utf8_lossy(&ended.stderr).into_owned())
}

#[test]
fn file_size_limit_costs_what_is_too_large_and_leaves_nothing_half() {
    let house = House::new();
    house.record("rec/small1.mcap", &some(0, 1));
    house.copy("print_run.mcap", "rec/large.mcap");
    house.record("rec/small2.mcap", &some(1, 1));
    let limited = "ulimit -f 60; exec INKLING --set output.weights=true";
    let (code, said) = run_script(&house, "sh", &[], limited);
    assert_eq!(code, Some(3), "{said}");
    assert!(said.contains("large") && said.contains("ulimit -f"), "{said}");
    assert_eq!(results(&house).len(), 6, "{:?}", results(&house).keys());
    house.replay("rec --set output.weights=true").exits(0).says("1 judged, 2 skipped");
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
                  cp out/run.json out/journal.jsonl . ; ls out | grep -c part >parts; exit $code";
    let (code, said) = run_script(&house, "unshare", &["-rm", "sh"], script);
    assert!(!said.contains("unshare:") && !said.contains("mount:"), "no mounts here: {said}");
    assert_eq!(code, Some(1), "{said}");
    assert_eq!(said.matches("no room left").count(), 1, "one message, not one per file: {said}");
    assert!(said.contains("run the same command again"), "{said}");
    assert_eq!(house.read("parts"), b"0\n", "nothing half is left");
    let lines = house.text("journal.jsonl");
    assert!((1..40).contains(&lines.lines().count()));
}
