//! The process boundary: exit statuses and messages that help.

use crate::house::House;

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
        (&judge, "isolate.pulse_s=8e-6", "by this design"),
        (&judge, "isolate.unlabelled_classes=false", "by this design"),
        (&judge, "isolate.neighbours=3", "isolate.method = \"posterior\""),
        (&judge, "isolate.signal=deviation", "isolate.method = \"posterior\""),
        (&judge, "isolate.method=neighbours", "train with --set isolate.method=neighbours"),
        (&judge, "detect.false_alarm_rate=1e-3", "train again"),
        (&judge, "detect={false_alarm_rate=1e-3}", "train again"),
        (&judge, "isolate.classes={Eigene=[\"EC\"]}", "trained without it"),
        (&replay, "isolate.classes={Eigene=[\"EC\"]}", "no design"),
        (&replay, "isolate.certainty=0.9", "--design"),
        (&replay, "output.weights=true", "--design"),
        (&replay, "detect.mu=2", "detect.threshold = \"quantile\""),
        (&replay, "detect.fault=EC", "detect.denominator = \"resonance\""),
        (&replay, "detect.denominator=eigenvalues", "without --design"),
        (&replay, "detect.oscillations=7", "detect.method = \"sensitivity\""),
        (&train, "identify.first=5", "`inkling train`"),
        (&train, "output.dir=x", "`inkling train`"),
        (
            &identify,
            "detect.oscillations=7",
            "has no effect here, on `inkling identify` without --detectability",
        ),
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
fn what_no_terminal_shows_has_no_progress() {
    let house = House::new();
    let ended = house.run("simulate sample_logs/scenarios/sample.toml -o run").exits(0);
    assert!(ended.stderr().is_empty(), "{}", ended.stderr());
}
