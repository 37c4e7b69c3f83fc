//! What anybody may hand to the process: absurd recordings, designs, places to write to. Each gives
//! rows with a reason or a message and the contract's exit status; nothing unfinished gets a name.

use crate::house::{Ended, House};
use crate::recorded::{bursts, rows, sample, slower, with_samples};
use inkling::burst::Burst;
use inkling::design::Design;
use inkling::io::verdict_reader::VerdictReader;
use inkling::verdict::Outcome;
use serde_json::{Value, json};
use std::process::{Command, Stdio};

const SECOND_NS: i64 = 1_000_000_000;
const BY_DESIGN: &str = "--design sample_logs/design.json";

/// The first bursts of one printhead of the sample run.
fn some(n: usize) -> Vec<Burst> {
    crate::nights::some(0, n)
}

fn changed(all: &[Burst], change: impl Fn(usize, &mut Burst)) -> Vec<Burst> {
    let mut all = all.to_vec();
    all.iter_mut().enumerate().for_each(|(i, burst)| change(i, burst));
    all
}

fn replay(house: &House, name: &str, more: &str) -> Ended {
    house.run(&format!("replay {name} --out out {more}"))
}

/// The summary, its counts checked against the table: one row for every signal found.
#[track_caller]
fn summary(house: &House, stem: &str) -> Value {
    let summary = house.read_json(&format!("out/{stem}.summary.json"));
    let (mut rows, mut rejected) = (0u64, 0u64);
    let table = house.path(&format!("out/{stem}.verdicts.parquet"));
    for columns in VerdictReader::open(&table).unwrap() {
        let c = columns.unwrap();
        rows += c.len() as u64;
        for i in 0..c.len() {
            let judged = c.outcome[i] != Outcome::Rejected;
            rejected += u64::from(!judged);
            assert_eq!(judged, c.statistic[i].is_some(), "NaN is read as null");
            if c.outcome[i] == Outcome::Healthy {
                assert!(c.statistic[i] <= c.threshold[i]);
            }
        }
    }
    let counts = &summary["counts"];
    let by_reason: u64 =
        counts["rejected"].as_object().unwrap().values().map(|n| n.as_u64().unwrap()).sum();
    assert_eq!(counts["signals"], rows);
    assert_eq!(rejected, by_reason);
    assert_eq!(counts["judged"].as_u64().unwrap() + by_reason, rows);
    summary
}

/// Of recordings; what a run keeps for itself apart.
fn files(house: &House, dir: &str) -> Vec<String> {
    let mut names = house.files(dir);
    names.retain(|name| !["journal.jsonl", "run.json", ".inkling.lock"].contains(&name.as_str()));
    names
}

#[test]
fn recording_cut_anywhere_never_panics_and_what_is_whole_is_judged() {
    let house = House::new();
    house.record_in_chunks("whole.mcap", &some(12));
    let (whole, mut most) = (house.read("whole.mcap"), 0);
    for k in 0..24 {
        let cut = whole.len() * k / 24;
        house.write("cut.mcap", &whole[..cut]);
        let ended = replay(&house, "cut.mcap", BY_DESIGN);
        if ended.stdout().is_empty() {
            ended.exits(1).says("cut.mcap");
            assert!(files(&house, "out").is_empty(), "cut at {cut}");
        } else {
            ended.exits(3).says("warning");
            let summary = summary(&house, "cut");
            assert!(!summary["damage"].as_array().unwrap().is_empty());
            let judged = summary["counts"]["judged"].as_u64().unwrap();
            assert!(judged >= most, "cut at {cut}");
            most = judged;
            std::fs::remove_dir_all(house.path("out")).unwrap();
        }
    }
    assert!(most > 0);
}

#[test]
fn absurd_covariates_never_make_a_signal_healthy() {
    let house = House::new();
    let run = some(40);
    let channels = u64::from(run[0].channels);
    let volts = [f64::INFINITY, -1.0, 0.0, f64::NAN, 1e308, 1e-308];
    let all = changed(&run, |i, b| {
        if i < volts.len() {
            b.drive_voltage_v = Some(volts[i]);
        } else if i == 6 {
            b.temperature_c = Some(f64::NEG_INFINITY);
        } else if i == 7 {
            b.idle_time_s = vec![f32::NAN; 3];
            b.neighbours_fired = vec![9; 3].into();
        }
    });
    house.record("volts.mcap", &all);
    for mode in ["", "--identify windows"] {
        replay(&house, "volts.mcap", &format!("{} {mode}", BY_DESIGN)).exits(3);
        // 1e308 V expects more than numbers hold, and per 1e-308 V a signal is more; the others are
        // as if not recorded
        let rejected = &summary(&house, "volts")["counts"]["rejected"];
        assert_eq!(rejected, &json!({"non_finite": 2 * channels}));
    }
}

#[test]
fn pauses_and_stray_timestamps_do_not_refuse_the_recording() {
    let house = House::new();
    let run = some(60);
    let half = run.len() / 2;
    let paused = changed(&run, |i, b| b.t_acq_ns += if i < half { 0 } else { 86_400 * SECOND_NS });
    house.record("paused.mcap", &paused);
    let short = "--identify windows --set identify.first=10 --set identify.every=20";
    replay(&house, "paused.mcap", &format!("{} {short}", BY_DESIGN)).exits(0);
    let models = summary(&house, "paused")["models"].as_array().unwrap().len();
    assert!(models >= 2, "{models} models: a window on each side of the night");

    for stray in [0, i64::MAX - 1] {
        let strayed = changed(&run, |i, b| {
            if i == 5 {
                b.t_acq_ns = stray;
            }
        });
        house.record("stray.mcap", &strayed);
        let ended = replay(&house, "stray.mcap", &format!("{} --identify windows", BY_DESIGN));
        assert!([Some(0), Some(3)].contains(&ended.code()), "{}", ended.stderr());
        let summary = summary(&house, "stray");
        assert_eq!(summary["counts"]["judged"], summary["counts"]["signals"]);
    }
}

#[test]
fn window_of_noise_or_of_two_halves_is_refused() {
    let house = House::new();
    let run = some(40);
    let noise = changed(&run, |i, b| {
        let n = b.samples_per_channel as usize;
        *b = with_samples(b, |row, k, _| {
            let number = (row * n + k) as u64 + 1;
            let x = number.wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(i as u32);
            ((x.wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 40) % 400) as f64 - 200.0
        });
    });
    house.record("noise.mcap", &noise);
    replay(&house, "noise.mcap", "").exits(4).says("nothing rings");
    assert_eq!(summary(&house, "noise")["counts"]["judged"], 0);

    let halves: Vec<Burst> = run
        .iter()
        .map(|b| {
            let (other, half) = (rows(&slower(b)), b.channels as usize / 2);
            with_samples(b, |row, k, y| if row < half { y } else { other[row][k] })
        })
        .collect();
    house.record("halves.mcap", &halves);
    replay(&house, "halves.mcap", "").exits(4).says("window of");
    assert_eq!(summary(&house, "halves")["counts"]["judged"], 0);
}

#[test]
fn hostile_printhead_names_move_no_cursor_and_huge_ones_are_rows() {
    let house = House::new();
    let names = ["a\nb", "\u{1b}[2J", "\"';,", "../../etc", "💧", "nul\0", &"x".repeat(1 << 20)];
    let all = changed(&some(14), |i, b| b.printhead = names[i % names.len()].into());
    let channels = u64::from(all[0].channels);
    house.record("names.mcap", &all);
    let ended = replay(&house, "names.mcap", BY_DESIGN).exits(3);
    assert!(!(ended.stdout() + &ended.stderr()).contains(['\u{1b}', '\0']));
    let counts = &summary(&house, "names")["counts"];
    assert_eq!(counts["rejected"]["too_large"], 2);
    assert_eq!(counts["signals"], 12 * channels + 2);
    assert_eq!(
        files(&house, "out"),
        ["names.episodes.parquet", "names.summary.json", "names.verdicts.parquet"]
    );
    let inspected = house.run("inspect names.mcap").exits(3).stdout();
    assert!(!inspected.contains(['\u{1b}', '\0']));
}

/// Training ends with this look at what it made, and an executor of a fleet begins with it.
#[test]
fn a_design_with_numbers_that_no_filter_can_use_is_told_by_their_key() {
    let good: Value =
        serde_json::from_slice(&std::fs::read(sample("design.json")).unwrap()).unwrap();
    let numerator = good["pooled"]["generator"]["numerator"].as_array().unwrap().len();
    for (place, value, word) in [
        ("/models/0/expected/3", json!(1e308), "`expected`"),
        ("/models/0/generator/denominator/1", json!(-30.0), "unstable"),
        ("/models/0/median_statistic", json!(1e-300), "`median_statistic`"),
        ("/models/0/identification/poles/frequency_hz", json!(0), "frequency_hz`"),
        ("/pooled/noise", json!(-17.0), "`noise`"),
        ("/pooled/generator/numerator", json!(vec![0.0; numerator]), "lets nothing through"),
    ] {
        let mut design = good.clone();
        *design.pointer_mut(place).unwrap_or_else(|| panic!("no {place}")) = value;
        let design: Design = serde_json::from_value(design).unwrap();
        let told = design.check().unwrap_err().to_string();
        assert!(told.contains(word), "{place}: {told}");
    }
}

#[test]
fn a_design_that_was_changed_is_refused_and_one_that_was_indented_anew_is_not() {
    let house = House::new();
    house.record("run.mcap", &some(3));
    let good: Value =
        serde_json::from_slice(&std::fs::read(sample("design.json")).unwrap()).unwrap();
    let mut of_noise = good.clone();
    of_noise["pooled"]["noise"] = json!(17.0);
    let mut without = good.clone();
    without.as_object_mut().unwrap().remove("checksum");
    let mut newer = good.clone();
    newer["version"] = json!(99);
    for (design, exit, word) in [
        (of_noise, 2, "was changed"),
        (without, 2, "no checksum"),
        (newer, 2, "version 99"),
        (json!([1]), 2, "no JSON object"),
        (good, 0, ""),
    ] {
        house.write("edited.json", design.to_string());
        let ended = replay(&house, "run.mcap", "--design edited.json").exits(exit);
        assert!(exit == 0 || ended.stderr().contains("edited.json"), "{}", ended.stderr());
        ended.says(word);
    }
}

#[test]
fn result_files_are_written_although_nobody_reads_stdout() {
    let house = House::new();
    house.record("in/a.mcap", &some(12));
    house.record("in/b.mcap", &some(12));
    let deaf = |args: &str| {
        let mut inkling = house.inkling(args);
        let mut child = inkling.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        drop(child.stdout.take()); // as `| head -0` does
        child.wait().unwrap().code()
    };
    assert_eq!(deaf(&format!("replay in --out out {}", BY_DESIGN)), Some(0));
    assert_eq!(files(&house, "out").len(), 6, "{:?}", files(&house, "out"));
    assert_eq!(deaf("identify in/a.mcap -o model.json"), Some(0));
    assert!(house.path("model.json").exists());
}

#[cfg(target_os = "linux")]
#[test]
fn stderr_that_takes_nothing_is_no_panic() {
    let house = House::new();
    let full = std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let status = house.inkling("inspect missing*.mcap").stderr(full).status().unwrap();
    assert_eq!(status.code(), Some(1));
}

#[test]
fn verdicts_get_no_name_where_their_summary_cannot_be_written() {
    let house = House::new();
    house.record("run.mcap", &some(3));
    std::fs::create_dir_all(house.path("out/run.summary.json")).unwrap();
    replay(&house, "run.mcap", BY_DESIGN).exits(1).says("run.summary.json");
    assert!(files(&house, "out").is_empty(), "{:?}", files(&house, "out"));
    house.write("file", "");
    house.run("replay run.mcap --out file").exits(2).says("file");
}

#[cfg(unix)]
#[test]
fn pipes_and_links_to_nowhere_are_named_and_the_rest_is_judged() {
    let house = House::new();
    house.record("in/good.mcap", &some(3));
    std::os::unix::fs::symlink("nowhere", house.path("in/gone.mcap")).unwrap();
    std::os::unix::fs::symlink("nowhere", house.path("in/other")).unwrap();
    replay(&house, "in", BY_DESIGN).exits(3).says("gone.mcap");
    assert_eq!(
        files(&house, "out"),
        ["good.episodes.parquet", "good.summary.json", "good.verdicts.parquet"]
    );

    assert!(Command::new("mkfifo").arg(house.path("pipe")).status().unwrap().success());
    house.run("inspect pipe").exits(1).says("not a file");
}

#[cfg(unix)]
#[test]
fn interrupt_or_terminate_leaves_no_file() {
    let house = House::new();
    for signal in ["-INT", "-TERM"] {
        let child =
            crate::kills::start(&house, "replay sample_logs/print_run.mcap --pace recorded");
        // the handler stands before the first file does
        while files(&house, "out").is_empty() {
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        crate::house::signal(child.id(), signal);
        let ended = child.wait_with_output().unwrap();
        assert_eq!(ended.status.code(), Some(1), "{signal}");
        assert!(String::from_utf8_lossy(&ended.stderr).contains("interrupted"));
        assert!(files(&house, "out").is_empty(), "{signal}: {:?}", files(&house, "out"));
    }
}

#[test]
fn training_says_what_was_lost() {
    let house = House::new();
    house.record_in_chunks("train.mcap", &bursts(&sample("train.mcap")));
    let bytes = house.read("train.mcap");
    house.write("cut.mcap", &bytes[..bytes.len() * 3 / 4]);
    house
        .run("train cut.mcap --labels sample_logs/labels.csv -o design.json")
        .exits(3)
        .says("cut short");
    house.run("identify cut.mcap -o model.json").exits(3).says("cut short");

    let bad = changed(&some(40), |i, b| {
        if i < 2 {
            b.sample_period_s = -1.0;
        }
    });
    house.record("bad.mcap", &bad);
    house.write(
        "all.csv",
        format!("printhead,channel,from,to,state,severity\n{},*,,,healthy,\n", bad[0].printhead),
    );
    house.run("train bad.mcap --labels all.csv -o design.json").exits(3).says("rejected");
    assert_eq!(house.read_json("design.json")["signals"]["rejected"], 2);
}

#[test]
fn what_is_set_wins_over_what_a_design_implies() {
    let house = House::new();
    house.record("run.mcap", &some(40));
    let mode = |more: &str| {
        replay(&house, "run.mcap", &format!("{} {more}", BY_DESIGN)).exits(0);
        summary(&house, "run")["settings"]["identify"]["mode"].clone()
    };
    assert_eq!(mode(""), "design");
    assert_eq!(mode("--set identify.mode=windows"), "windows");
    assert_eq!(mode("--identify windows"), "windows");
    let reversed = r#"--set identify.spans=[["2026-01-02T00:00:00Z","2026-01-01T00:00:00Z"]]"#;
    replay(&house, "run.mcap", reversed).exits(2).says("ends before it begins");
}

#[cfg(unix)]
#[test]
fn text_that_never_ends_is_refused_whatever_asks_for_it() {
    let house = House::new();
    house.record("run.mcap", &some(3));
    assert!(Command::new("mkfifo").arg(house.path("pipe")).status().unwrap().success());
    let scored = "score critique.json --truth";
    house.write("critique.json", r#"{"verdict":"none"}"#);
    for endless in ["/dev/zero", "pipe", "."] {
        for (args, code) in [
            (format!("replay run.mcap --design {endless}"), 2),
            (format!("replay run.mcap --config {endless}"), 2),
            (format!("replay run.mcap --baseline {endless}"), 2),
            (format!("train run.mcap --labels {endless} -o d.json"), 2),
            (format!("score {endless} --truth critique.json"), 1),
            (format!("{scored} {endless}"), 1),
            (format!("simulate {endless} -o sim"), 2),
            (format!("convert {endless} -o t.mcap"), 1),
        ] {
            house.run(&args).exits(code).says("not a file");
        }
    }
}

#[test]
fn critiques_that_contradict_themselves_are_not_scored() {
    let house = House::new();
    house.write("sealed/truth.json", r#"{"effects":[]}"#);
    house.write("c.json", r#"{"verdict":"none"}"#);
    house.run("score c.json --truth sealed/truth.json").exits(0).says("not sealed");
    house.write("c.json", r#"{"verdict":"none","causes":[{"id":"tone"}]}"#);
    house.run("score c.json --truth sealed/truth.json").exits(1).says("c.json").says("none");
}

#[test]
fn names_from_labels_move_no_cursor() {
    let house = House::new();
    let bursts = some(3);
    house.record("run.mcap", &bursts);
    house.write(
        "l.csv",
        format!(
            "printhead,channel,from,to,state,severity\n{},*,,,E\u{1b}[31m\u{202e}C,\n",
            bursts[0].printhead
        ),
    );
    let ended = house.run("train run.mcap --labels l.csv -o d.json").exits(2).says("[31m");
    assert!(!ended.stderr().contains(['\u{1b}', '\u{202e}']), "{}", ended.stderr());
}
