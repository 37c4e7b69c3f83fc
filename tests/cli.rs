//! The process boundary: exit statuses and messages that help.

use crate::house::House;

#[test]
fn exit_code_2_for_wrong_usage_and_settings() {
    let house = House::new();
    house.run("replay").exits(2).says("no recordings");
    house.run("fly").exits(2);
    house.run("replay x.mcap --set detect.colour=1").exits(2).says("colour");
    house.run("replay x.mcap --set detect.mu").exits(2).says("KEY=VALUE");
    house.run("replay x.mcap --config missing.toml").exits(2).says("missing.toml");
    house.run("train x.mcap -o d.json").exits(2).says("--labels");
    house.run("simulate missing.toml -o out").exits(2).says("missing.toml");
    house.run("--help").exits(0).says("Examples");
    house.run("replay --help").exits(0).says("--pace");
}

/// Against the sample's recording and design.
#[test]
fn a_setting_that_cannot_take_effect_is_refused_with_what_to_do() {
    let house = House::new();
    let replay = "replay sample_logs/print_run.mcap --out out".to_owned();
    let judge = format!("{replay} --design sample_logs/design.json");
    let labelled = "sample_logs/train.mcap --labels sample_logs/labels.csv -o d.json";
    let (train, identify) = (format!("train {labelled}"), format!("identify {labelled}"));
    let seeing = format!("{identify} --detectability");
    for (command, set, said) in [
        (&judge, "isolate.pulse_s=8e-6", "train"),
        (&judge, "isolate.unlabelled_classes=false", "train"),
        (&judge, "isolate.neighbours=3", "neighbours"),
        (&judge, "isolate.signal=deviation", "residual-matching"),
        (&judge, "isolate.method=neighbours", "train with --set isolate.method=neighbours"),
        (&judge, "detect.false_alarm_rate=1e-3", "train again"),
        (&judge, "isolate.classes={Eigene=[\"EC\"]}", "trained without it"),
        (&replay, "isolate.classes={Eigene=[\"EC\"]}", "no design"),
        (&replay, "isolate.certainty=0.9", "--design"),
        (&replay, "output.weights=true", "--design"),
        (&replay, "detect.mu=2", "max"),
        (&replay, "detect.fault=EC", "eigenvalues"),
        (&replay, "detect.denominator=eigenvalues", "train"),
        (&replay, "detect.oscillations=7", "residual-energy"),
        (&replay, "report.rows=2", "report"),
        (&train, "identify.first=5", "replay"),
        (&train, "detect.decouple=[\"offset\"]", "residual-energy"),
        (&train, "detect.decouple=[\"sun\"]", "offset"),
        (&train, "output.dir=x", "replay"),
        (&identify, "detect.oscillations=7", "detects nothing"),
        (&seeing, "detect.mu=2", "--detectability"),
    ] {
        house.run(&format!("{command} --set {set}")).exits(2).says(said);
        assert!(!house.path("out").exists() && !house.path("d.json").exists(), "{set}");
    }
    for set in [
        "isolate.certainty=.9",
        "detect.false_alarm_rate=7e-4",
        "identify.first=5",
        "episodes.false_per_million=1",
    ] {
        house.run(&format!("{judge} --dry-run --set {set}")).exits(0);
    }
}

#[test]
fn exit_code_1_where_nothing_can_be_done() {
    let house = House::new();
    house.run("replay missing*.mcap").exits(1).says("missing*.mcap");
    std::fs::create_dir(house.path("empty")).unwrap();
    house.run("replay empty").exits(1).says("mcap");
    house.write("zero.mcap", b"");
    house.run("replay zero.mcap").exits(1).says("empty");
    house.run("inspect zero.mcap").exits(1).says("empty");
    house.write("text.mcap", b"printhead,channel,from,to,state,severity\n");
    house.run("replay text.mcap").exits(1).says("not an MCAP");
    house.write("broken.json", b"{\"version\": 1}");
    house.run("replay text.mcap --design broken.json").exits(2).says("broken.json");
    assert!(!house.path("verdicts/text.verdicts.parquet").exists());
}

#[test]
fn what_is_said_says_what_to_do_and_mistyped_input_is_wrong_usage() {
    let house = House::new();
    // a recording is no result
    house
        .run("report sample_logs/train.mcap -o r.html")
        .exits(2)
        .says("is a recording")
        .says("inkling replay");
    // labels and designs that are not there, or are of another version
    house.run("train sample_logs/train.mcap --labels no.csv -o d.json").exits(2).says("no.csv");
    house.run("replay sample_logs/train.mcap --design no.json").exits(2).says("no.json");
    house.write("old.json", r#"{"version": 2, "made_by": "inkling 0.0.9", "classes": 3}"#);
    house
        .run("replay sample_logs/train.mcap --design old.json")
        .exits(2)
        .says("design version 2, made by inkling 0.0.9")
        .says("inkling 0.0.9 reads it, or train again");
    house.write(
        "few.csv",
        "printhead,channel,from,to,state,severity\ndataset,1,,,healthy,\ndataset,3-4,,,healthy,\n",
    );
    house
        .run("train sample_logs/train.mcap --labels few.csv -o d.json")
        .exits(2)
        .says("few.csv: 3 usable signals are labelled `healthy`")
        .says("label more");
    // options of one convention
    house.ok("replay sample_logs/print_run.mcap --design sample_logs/design.json -o out");
    let told = house.json("report out -o r.html --json");
    let faults = told["faults"].as_array().unwrap();
    assert!(faults.len() > 5 && faults[0]["sentence"].is_string(), "{told}");
}

#[test]
fn what_no_terminal_shows_has_no_progress() {
    let house = House::new();
    let ended = house.run("simulate sample_logs/scenarios/sample.toml -o run").exits(0);
    assert!(ended.stderr().is_empty(), "{}", ended.stderr());
}
