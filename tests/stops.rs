//! Stop means stop: the first request to end ends every verb, wherever it is, and leaves nothing half.
#![cfg(unix)]

use crate::house::{House, signal};
use std::process::Stdio;
use std::time::{Duration, Instant};

/// What would go on for much longer than is waited for.
const LONG: [&str; 7] = [
    "thesis --seeds 1000 -o chapter",
    "thesis many --labels sample_logs/labels.csv -o recorded",
    "simulate long.toml -o run",
    "train many --labels sample_logs/labels.csv -o design.json",
    "identify many --labels sample_logs/labels.csv -o models.json",
    "replay many --out out --baseline own.json --design sample_logs/design.json",
    "convert long.csv -o long.mcap",
];
/// Two seconds are promised; a machine that is busy with other tests has some more.
const AT_MOST: Duration = Duration::from_secs(8);

#[test]
fn the_first_request_ends_every_verb_at_any_step() {
    let house = House::new();
    for nth in 0..40 {
        house.copy("train.mcap", &format!("many/{nth}.mcap"));
    }
    let scenario = crate::house::shipped("sample_logs/scenarios/sample.toml");
    house.write(
        "long.toml",
        scenario.replace("bursts_per_channel = 60", "bursts_per_channel = 1000000"),
    );
    let row = |k: usize| format!("{}e-6,{}\n", k, (k * 7919) % 4001);
    house.write("long.csv", "t_s,volt\n".to_owned() + &(0..3_000_000).map(row).collect::<String>());
    for args in LONG {
        for (after_ms, request) in [(60, "-TERM"), (400, "-INT"), (1500, "-TERM")] {
            let mut inkling = house.inkling(args);
            let mut inkling = inkling.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
            std::thread::sleep(Duration::from_millis(after_ms));
            let asked = Instant::now();
            if inkling.try_wait().unwrap().is_some() {
                break; // this machine is faster than that
            }
            signal(inkling.id(), request);
            let ended = inkling.wait_with_output().unwrap();
            assert!(asked.elapsed() < AT_MOST, "{args} after {after_ms} ms");
            let said = String::from_utf8_lossy(&ended.stderr);
            // at the very begin there may be nobody yet who hears it, and at the very end it is done
            let is_told = after_ms < 400 || ended.status.success() || said.contains("interrupted");
            assert!(is_told, "{args}: {said}");
            let left = house.files(".");
            assert!(!left.iter().any(|file| file.ends_with(".part")), "{args}: {left:?}");
        }
    }
}
