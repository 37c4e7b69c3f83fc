//! Faults that a channel has at once, and faults that grow: thesis (2-1), simulated by the command and judged.

use crate::house::{House, only_healthy, shipped};
use crate::recorded::{Said, said};

/// The sample's scenario without its faults.
fn scenario(bursts: u32, interval_s: f64) -> String {
    let text = shipped("sample_logs/scenarios/sample.toml");
    let head = text.split("[[print_run.fault]]").next().unwrap();
    head.replace("bursts_per_channel = 60", &format!("bursts_per_channel = {bursts}"))
        .replace("interval_s = 1.0", &format!("interval_s = {interval_s:?}"))
}

/// As a scenario has it.
pub fn fault(
    (printhead, channel): (&str, usize),
    (class, severity): (&str, f64),
    (from_s, to_s): (f64, f64),
) -> String {
    format!(
        "[[print_run.fault]]\nprinthead = \"{printhead}\"\nchannel = {channel}\nclass = \"{class}\"\n\
         severity = {severity:?}\nfrom_s = {from_s:?}\nto_s = {to_s:?}\n"
    )
}

/// Two faults of several categories get a name that is one of them, or no name; one pair of twelve has a twin: a small bubble
/// and a slightly dried nozzle ring as a partly blocked one does, and get its name.
#[test]
fn two_faults_at_once_are_found_and_not_given_a_third_name() {
    let pairs = [
        ("AB2", 0.4, "DDN", 2.5),
        ("AB2", 0.3, "SDN", 1.25),
        ("AB1", 0.15, "SDN", 1.3),
        ("AB1", 0.2, "IDN", 1.7),
        ("PBN", 0.3, "AB2", 0.3),
        ("PBN", 0.4, "IDN", 1.6),
        ("AB3", 4.0, "IDN", 1.7),
        ("EC", 0.3, "SDN", 1.3),
        ("AB1", 0.2, "PBN", 0.3),
        ("BN", 0.97, "AB2", 0.3),
        ("EC", 0.35, "AB1", 0.2),
        ("AB3", 3.5, "PBN", 0.4),
    ];
    let mut text = scenario(120, 1.0);
    for (k, (a, size, b, other)) in pairs.into_iter().enumerate() {
        text += &fault(("cyan-1", 4 * k), (a, size), (20.0, 120.0));
        text += &fault(("cyan-1", 4 * k), (b, other), (30.0, 120.0));
    }
    let house = House::new();
    house.write("two.toml", text.as_bytes());
    house.ok("simulate two.toml -o two --seed 3");
    house.ok("replay two/print_run.mcap --design sample_logs/design.json --out out");
    let score = house.json("score out/print_run.verdicts.parquet --labels two/labels.csv --json");
    for (a, _, b, _) in pairs {
        let mut names = [a, b];
        names.sort_unstable();
        let of = &score["by_state"][names.join("+")];
        let (signals, flagged) = (of["signals"].as_u64().unwrap(), of["flagged"].as_u64().unwrap());
        assert!(signals >= 60 && flagged == signals, "{a} and {b}: {of}");
    }
    let (mut all, mut one_of_them, mut third, mut third_but_the_twin) = (0, 0, 0, 0);
    let rows = said(&house.path("out/print_run.verdicts.parquet"));
    for Said { of: (t_ns, printhead, channel), fault, .. } in &rows {
        let since_s = (t_ns - rows[0].of.0) / 1_000_000_000;
        let is_of_pair = printhead == "cyan-1" && channel % 4 == 0;
        let pair = pairs.get(*channel as usize / 4).filter(|_| is_of_pair);
        let (Some(&(a, _, b, _)), 35..95) = (pair, since_s) else { continue };
        all += 1;
        let Some(fault) = fault.as_deref() else { continue };
        let is_third = ![a, b].contains(&fault);
        one_of_them += usize::from(!is_third);
        third += usize::from(is_third);
        third_but_the_twin += usize::from(is_third && (a, b) != ("AB2", "SDN"));
    }
    println!(
        "of {all}: one of the two {one_of_them}, a third {third}, but for the twin {third_but_the_twin}"
    );
    assert!(all == 12 * 60 && 10 * third <= all && 50 * third_but_the_twin <= all);
    assert!((all * 3 / 10..all * 7 / 10).contains(&one_of_them));
}

/// What a fault does to amplitude and phase depends on what the channel rings from.
#[test]
fn a_waveform_that_is_known_names_faults_that_nobody_labelled() {
    let text = shipped("sample_logs/scenarios/physics.toml");
    let double = "pulse_us = 14.0\nwaveform = [[0.36, 1.0], [0.22, 0.0], [0.42, -0.8]]\n#";
    let house = House::new();
    house.write("double.toml", text.replace("pulse_us = 9.0", double).as_bytes());
    house.ok("simulate double.toml -o double --seed 7");
    let labels = house.text("double/labels.csv");
    house.write("healthy.csv", only_healthy(&labels));
    let right = |actuation: &str| {
        house.ok(&format!(
            "train double/train.mcap --labels healthy.csv -o design.json --set isolate.{actuation}"
        ));
        house.ok("replay double/test.mcap --design design.json --set isolate.gate=false --out out --force");
        let score = house.json("score out/test.verdicts.parquet --labels double/labels.csv --json");
        score["isolation"]["accuracy"].as_f64().unwrap()
    };
    let known = right("waveform=[[5.04e-6,1.0],[3.08e-6,0.0],[5.88e-6,-0.8]]");
    let (one_pulse, unknown) = (right("pulse_s=14e-6"), right("guess_sd=0.05"));
    println!(
        "class right {known:.3}; by one pulse as long {one_pulse:.3}; by the default {unknown:.3}"
    );
    assert!(known > 0.96 && known > one_pulse + 0.05, "{known} {one_pulse}");
}

/// A fault that grows is told with its rate, and when it will be visible.
#[test]
fn growing_faults_have_their_rate_and_a_forecast() {
    let mut text = scenario(240, 60.0);
    let growing = [("PBN", 0.1, 0.4, 0.5), ("AB2", 0.2, 0.6, 1.0), ("SDN", 1.2, 1.7, 2.0)];
    for (k, (class, from, to, _)) in growing.into_iter().enumerate() {
        text += &fault(("cyan-1", 7 + k), (class, from), (600.0, 14_400.0));
        text += &format!("to_severity = {to:?}\n");
    }
    let house = House::new();
    house.write("grow.toml", text.as_bytes());
    house.ok("simulate grow.toml -o grow --seed 4");
    let labels = house.text("grow/labels.csv");
    let sizes: Vec<f64> = labels
        .lines()
        .filter(|line| line.starts_with("cyan-1,7,"))
        .map(|line| line.rsplit(',').next().unwrap().parse().unwrap())
        .collect();
    assert!(sizes.len() == 230 && sizes.is_sorted(), "{} rows", sizes.len());
    assert!((sizes[115] - 0.25).abs() < 0.01, "{}", sizes[115]);
    // a slightly dried nozzle that dries on is an intermediately dried one
    let states = |class: &str| {
        labels.lines().filter(|l| l.starts_with("cyan-1,9,") && l.contains(class)).count()
    };
    assert!(states(",SDN,") > 50 && states(",IDN,") > 50, "{labels}");
    house.ok(
        "replay grow/print_run.mcap --design sample_logs/design.json --identify design --out out",
    );
    let told = house.json("report out -o page.html --json");
    for (k, (class, from, to, visible)) in growing.into_iter().enumerate() {
        let of = told["faults"].as_array().unwrap().iter().find(|of| of["channel"] == 7 + k);
        let sentence = of.unwrap()["sentence"].as_str().unwrap();
        println!("{class}: {sentence}");
        let hours = (visible - to) / ((to - from) / (13_800.0 / 3600.0));
        let [low, high] = forecast(sentence);
        assert!((low..=high).contains(&hours), "{class}: {hours} h: {sentence}");
    }
}

/// The hours that a sentence says.
fn forecast(sentence: &str) -> [f64; 2] {
    let words = sentence.split("visible defect (half of a drop lost) ").nth(1).unwrap();
    let number = |text: &str| text.trim_matches(|c: char| !c.is_ascii_digit()).parse().unwrap();
    if let Some(within) = words.strip_prefix("within ") {
        return [0.0, number(within.split(' ').next().unwrap())];
    }
    let both = words.split(['(', ')']).nth(1).unwrap();
    let [low, high] = both.split(" to ").collect::<Vec<_>>()[..] else { panic!("{words}") };
    [number(low), number(high)]
}
