//! Labels at the process boundary: states that nobody declared, what is ignored, rows that overlap, and what training
//! tells of each class.

use crate::house::{House, shipped, shipped_json};
use crate::recorded::{bursts, with_samples, write};
use inkling::burst::Burst;
use inkling::io::recording_writer::WriterOptions;
use std::collections::BTreeSet;
use std::path::Path;

/// The sample's fault library, and its labels with other states.
fn library(house: &House, renamed: impl Fn(&str) -> String) {
    house.copy("train.mcap", "train.mcap");
    let labels = shipped("sample_logs/labels.csv");
    let line = |line: &str| {
        let cells: Vec<String> = line.split(',').map(&renamed).collect();
        cells.join(",") + "\n"
    };
    house.write("labels.csv", labels.lines().map(line).collect::<String>());
}

/// Labels that say of everything faulty that nothing is learned of it.
pub fn only_healthy(labels: &str) -> String {
    let line = |line: &str| match line.split(',').collect::<Vec<_>>()[..] {
        [head, channel, from, to, state, _] if !["healthy", "state"].contains(&state) => {
            format!("{head},{channel},{from},{to},ignore,\n")
        }
        _ => format!("{line}\n"),
    };
    labels.lines().map(line).collect()
}

/// A file of labels with these rows.
fn write_labels(house: &House, name: &str, rows: &str) {
    house.write(name, format!("printhead,channel,from,to,state,severity\n{rows}"));
}

const TRAIN: &str = "train train.mcap --labels labels.csv -o d.json";

#[test]
fn a_state_that_nobody_declared_is_refused_with_the_nearest_names() {
    let house = House::new();
    let own = |state: &str| if state == "BN" { "Verstopfung".into() } else { state.to_owned() };
    library(&house, own);
    house
        .run(TRAIN)
        .exits(2)
        .says("state \"Verstopfung\": nobody has declared such a class")
        .says("--new-class Verstopfung")
        .says("line ");
    house.run(&format!("{TRAIN} --new-class Verstopfug")).exits(2).says("did you mean Verstopfug?");
    assert!(!house.path("d.json").exists());
    house.run(&format!("{TRAIN} --new-class Verstopfung")).exits(0).says("Verstopfung");
    house
        .run(&format!("{TRAIN} --new-class Verstopfung --new-class Luft"))
        .exits(2)
        .says("no row of labels.csv has that state");
    for taken in ["healthy", "BN", "unlabelled"] {
        house.run(&format!("{TRAIN} --new-class {taken}")).exits(2).says("has a meaning already");
    }
    // who does not learn of them needs no declaration, but `healthy` is not lost by a letter
    house.ok("identify train.mcap --labels labels.csv -o m.json");
    write_labels(&house, "labels.csv", "*,*,,,Healthy,\n");
    house.run("identify train.mcap --labels labels.csv -o m.json").exits(2).says("write `healthy`");
}

#[test]
fn labels_that_are_too_few_are_called_so() {
    let house = House::new();
    library(&house, str::to_owned);
    write_labels(&house, "few.csv", "dataset,0-2,,,healthy,\n");
    let few = "3 usable signals are labelled `healthy`, 16 are needed: label more channels or longer times";
    for (command, exit) in [
        ("train train.mcap --labels few.csv -o d.json", 2),
        ("identify train.mcap --labels few.csv -o m.json", 1),
        ("replay train.mcap --set identify.labels=few.csv --out out", 4),
    ] {
        let ended = house.run(command).exits(exit).says(few);
        assert!(!(ended.stdout() + &ended.stderr()).contains("widen"), "{command}");
    }
}

#[test]
fn what_is_ignored_is_neither_trained_on_nor_scored() {
    let house = House::new();
    library(&house, |state| if state == "DDN" { "ignore".into() } else { state.to_owned() });
    let told = house.json(&format!("{TRAIN} --json"));
    assert_eq!(told["signals"]["ignore"], 60);
    assert!(told["signals"]["DDN"].is_null() && told["signals"]["healthy"] == 600, "{told}");
    house.ok("replay train.mcap --design d.json --out out --quiet");
    let score = house.json("score out/ --labels labels.csv --json");
    let states = score["by_state"].as_object().unwrap();
    assert!(!states.contains_key("ignore") && states.contains_key("EC"), "{states:?}");
}

#[test]
fn rows_may_speak_of_ranges_and_of_every_printhead() {
    let house = House::new();
    library(&house, str::to_owned);
    // the same said of every printhead, what follows each other as ranges, and a wider row that says otherwise
    let labels = house.text("labels.csv");
    let mut rows: Vec<(u32, u32, String)> = Vec::new();
    let mut faults: Vec<(u32, String)> = labels
        .lines()
        .filter(|line| line.starts_with("dataset,") && !line.contains('*'))
        .map(|line| line.split(',').collect::<Vec<_>>())
        .map(|cells| (cells[1].parse().unwrap(), cells[4].to_owned()))
        .collect();
    faults.sort();
    for (channel, state) in faults {
        match rows.last_mut().filter(|row| row.1 + 1 == channel && row.2 == state) {
            Some(row) => row.1 = channel,
            None => rows.push((channel, channel, state)),
        }
    }
    let mut text = String::new();
    rows.iter().for_each(|(from, to, state)| text += &format!("*,{from}-{to},,,{state},\n"));
    text += "*,0-100000,,,healthy,\n*,*,,,EC,\n";
    assert!(rows.iter().any(|row| row.0 < row.1), "no two faults side by side");
    write_labels(&house, "labels.csv", &text);
    house.ok(TRAIN);
    // the sample's design was trained by rows of one channel of a printhead by its name
    let by_name = shipped_json("sample_logs/design.json");
    assert_eq!(house.read_json("d.json")["signals"], by_name["signals"]);
    write_labels(&house, "labels.csv", "p,20-0,,,EC,\n");
    house.run(TRAIN).exits(2).says("a range such as 0-20").says("line 2");
}

#[test]
fn training_tells_of_each_class_what_would_be_made_of_signals_held_out() {
    let house = House::new();
    library(&house, str::to_owned);
    let counted =
        "615 of 1156 rows cover no signal of these recordings; of black-2, cyan-1, magenta-1";
    house.run(TRAIN).exits(0).says("held out").says("mistaken for").says(counted);
    let told = house.json(&format!("{TRAIN} --json"));
    let classes = told["labelled_classes"].as_array().unwrap();
    assert_eq!(classes.len(), 9);
    let of = |name: &str| classes.iter().find(|class| class["class"] == name).unwrap();
    let ec = of("EC");
    assert_eq!((&ec["labelled"], &ec["held_out"]), (&60.into(), &60.into()));
    assert!(ec["detected"] == 60 && ec["named"].as_u64().unwrap() >= 57, "{ec}");
    // slight drying is what it is: seldom detected, and never all of it named
    let sdn = of("SDN");
    assert!(
        sdn["detected"].as_u64().unwrap() < 60 && sdn["named"].as_u64() < sdn["detected"].as_u64()
    );
    // two names for one thing are mistaken for each other
    let mut n = 0;
    let labels = house.text("labels.csv");
    let split = |line: &str| {
        n += 1;
        line.replace(",EC,", if n % 2 == 0 { ",Leer," } else { ",EC," }) + "\n"
    };
    house.write("labels.csv", labels.lines().map(split).collect::<String>());
    house
        .run(&format!("{TRAIN} --new-class Leer"))
        .exits(2)
        .says("class Leer would never be named")
        .says("look more like EC");
}

/// A recording with the samples of some channels replaced: of a channel, number of a sample and what it was.
fn replaced(path: &Path, channels: &BTreeSet<u32>, sample: impl Fn(u32, usize, f64) -> f64) {
    let other = |burst: &Burst| {
        with_samples(burst, |row, k, y| match burst.first_channel + row as u32 {
            channel if channels.contains(&channel) => sample(channel, k, y),
            _ => y,
        })
    };
    write(path, &bursts(path).iter().map(other).collect::<Vec<_>>(), WriterOptions::default());
}

/// Some channels' signals are so many times as large; their noise, too.
pub fn scaled(path: &Path, channels: &BTreeSet<u32>, by: f64) {
    replaced(path, channels, |_, _, y| by * y);
}

#[test]
fn a_class_that_can_never_be_named_is_an_error_that_says_why() {
    let house = House::new();
    library(&house, |state| if state == "EC" { "Tot".into() } else { state.to_owned() });
    let labels = house.text("labels.csv");
    let dead = labels.lines().filter(|line| line.starts_with("dataset,") && line.contains(",Tot,"));
    let dead = dead.map(|line| line.split(',').nth(1).unwrap().parse().unwrap()).collect();
    // a cable without a sensor
    let noise = |channel: u32, k: usize, _| ((channel as usize * 31 + k * k * 7) % 5) as f64 - 2.0;
    replaced(&house.path("train.mcap"), &dead, noise);
    let train = format!("{TRAIN} --new-class Tot");
    house
        .run(&train)
        .exits(2)
        .says("class Tot would never be named")
        .says("do not ring")
        .says("label them `ignore`");
    assert!(!house.path("d.json").exists());
    house.write("labels.csv", labels.replace(",Tot,", ",ignore,"));
    house.run(TRAIN).exits(0);
    // what differs from healthy signals in nothing is not detected
    let is_healthy = |channel: &u32| !labels.contains(&format!("\ndataset,{channel},"));
    let quiet = (0..1140).filter(is_healthy).take(12);
    let rows: String = quiet.map(|channel| format!("dataset,{channel},,,Leise,\n")).collect();
    house.write("labels.csv", labels.replace(",Tot,", ",ignore,") + &rows);
    house
        .run(&format!("{TRAIN} --new-class Leise"))
        .exits(2)
        .says("class Leise would never be named")
        .says("differs from healthy ones");
}

#[test]
fn rows_of_no_signal_are_counted_and_misspelt_printheads_and_times_in_seconds_refused() {
    let house = House::new();
    library(&house, |cell| if cell == "dataset" { "datasett".into() } else { cell.to_owned() });
    let train = house
        .run(TRAIN)
        .exits(2)
        .says("labels.csv: printhead \"datasett\" is in none of the recordings");
    train.says("did you mean dataset?");
    assert!(!house.path("d.json").exists());
    library(&house, str::to_owned);
    house.replay("train.mcap --quiet").exits(0);
    house.run("score out --labels labels.csv").exits(0).says("615 of 1156 rows cover no signal");
    write_labels(&house, "seconds.csv", "dataset,*,1735718400,,healthy,\n");
    write_labels(&house, "misspelt.csv", "Dataset,*,,,healthy,\n");
    let judge = "replay train.mcap --set identify.labels=LABELS --out labelled";
    for verb in ["train train.mcap --labels LABELS -o e.json", "score out --labels LABELS", judge] {
        let mistaken = |labels: &str| house.run(&verb.replace("LABELS", labels)).exits(2);
        mistaken("seconds.csv").says("were seconds meant? Write 2025-01-01T08:00:00Z");
        mistaken("misspelt.csv").says("did you mean dataset?");
    }
    assert!(
        !house.path("e.json").exists() && !house.path("labelled/train.verdicts.parquet").exists()
    );
}
