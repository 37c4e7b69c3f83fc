//! What a user mistypes: each mistake with its exit status and a part of the sentence that answers it; beside some what is none.

use crate::house::{House, root};

/// `{R}`: a recording, `{D}`: its design, `{L}`: its labels, `{T}`: a training recording, `{S}`: the scenarios, `{E}`: a
/// table of episodes, `{O}`, `{A}`, `{B}`: a directory of results, its account and a file of baselines, `{none}`: an empty
/// argument.
const MISTAKES: &[(&str, i32, &str)] = &[
    // verbs and options
    ("replay", 2, "no recordings"),
    ("replya x", 2, "'replay'"),
    ("replay {R} --desing {D}", 2, "'--design'"),
    ("replay {R} --threads 0", 2, "1..=1024"),
    ("replay {R} --threads -1", 2, "'-1'"),
    ("replay {R} --threads many", 2, "'many'"),
    ("replay {R} --pace fast", 2, "recorded, max, or signals per second"),
    ("replay {R} --pace 0", 2, "recorded, max, or signals per second"),
    ("replay {R} --pace -1", 2, "'-1'"),
    ("replay {R} --set replay.pace=fast", 2, "recorded, max, or signals per second"),
    ("replay {R} --identify window", 2, "'windows'"),
    ("replay {R} --preset thesys", 2, "'thesis'"),
    ("simulate {S}/sample.toml -o s --hide 1", 2, "--hide needs a healthy run"),
    ("simulate {S}/thesis.toml -o s --hide 1", 2, "physics"),
    ("simulate {S}/hidden.toml -o s --hide 1 --seed 2", 2, "'--seed"),
    ("replay {R} --layout dat", 2, "'date'"),
    ("critique {T} -o c --plant pendulum", 2, "ink-channel, oscillator"),
    ("thesis -o c --seeds 0", 2, "1..=10000"),
    ("thesis -o c --seeds x", 2, "'x'"),
    ("simulate {R} -o s --seed x", 2, "'x'"),
    ("generate completions fsh", 2, "'fish'"),
    // what is no longer there
    ("train {T} --labels {L} -o d.json --outcomes x.csv", 2, "the file of `--labels`"),
    ("score {O} --labels {L} --report e.html", 2, "`score --json`"),
    ("report {O} -o r.html --set report.rows=2", 2, "the map shows neighbours"),
    ("identify {T} -o m.json --plot p", 2, "`inkling critique`"),
    ("replay {R} --timings", 2, "`timings` and `phases` of the recording's summary.json"),
    ("replay {R} --layout flat", 2, "lays the recordings of one directory side by side"),
    ("replay {R} --set identify.spans=[]", 2, "label that time healthy"),
    // what is not given
    ("report", 2, "--output"),
    ("train {T} -o d.json", 2, "--labels"),
    ("train {T} --labels {L}", 2, "--out"),
    ("score", 2, "--labels"),
    ("score out", 2, "--labels"),
    ("identify {T}", 2, "--out"),
    ("inspect", 2, "<RECORDINGS>"),
    ("thesis", 2, "--out"),
    ("critique", 2, "--out"),
    ("generate man", 2, "--output"),
    ("acknowledge {O}", 2, "--damage"),
    ("acknowledge {O} --damage x --known p:1", 2, "cannot be used with"),
    ("acknowledge {O} --known p", 2, "HB:21"),
    ("acknowledge {O} --replaced p", 2, "--from"),
    ("acknowledge {O} --replaced p:1 --from noon", 2, "2026-01-31"),
    ("acknowledge {R} --damage x", 2, "no directory of results"),
    ("acknowledge {O} --known p:1 --from 2026-02-01 --until 2026-01-01", 2, "turn them round"),
    ("night", 2, "pipeline.toml"),
    ("night --config missing.toml", 2, "missing.toml"),
    // settings
    ("replay {R} --set detect.mu=abc", 2, "`detect.mu`"),
    ("replay {R} --set detect.colour=1", 2, "colour"),
    ("replay {R} --set detect.false_alarm_rate=0", 2, "more than 0 and less than 0.25"),
    ("replay {R} --set detect.false_alarm_rate=2", 2, "more than 0 and less than 0.25"),
    ("replay {R} --set identify.first=0", 2, "more than 0 and"),
    ("replay {R} --set identify.first=99999999999", 2, "more than 0 and"),
    ("replay {R} --set identify.first=soon", 2, "soon"),
    ("replay {R} --set identify.first=1e300", 2, "= 1e300"),
    ("replay {R} --set episodes.false_per_million=1e-300", 2, "false_per_million = 1e-300"),
    ("replay {R} --set episodes.reorder_signals=0", 2, "episodes.reorder_signals = 0"),
    ("replay {R} --set identify.grey_box.bound_factor=1e308", 2, "bound_factor = 1e308"),
    ("replay {R} --set identify.grey_box.a_per_s2=0", 2, "identify.grey_box.a_per_s2 = 0"),
    ("replay {R} --set identify.grey_box.b_per_s2=nan", 2, "b_per_s2 = NaN: give a positive"),
    ("replay {R} --set identify.grey_box.g_per_s=8.04e4", 2, "g_per_s = d_per_s"),
    ("replay {R} --set identify.grey_box.d_per_s=inf", 2, "d_per_s = inf: give a positive"),
    ("replay {R} --set isolate.guess_sd=-1e-200", 2, "= -1e-200"),
    ("replay {R} --set identify.every=9", 2, "identify.every is no longer there"),
    ("replay {R} --config {R}", 2, "is not UTF-8 text"),
    ("replay {R} --config missing.toml", 2, "missing.toml"),
    ("replay {R} --set output.dir=~/verdicts", 2, "write the whole path"),
    ("replay {R} --set input.design=$HOME/design.json", 2, "write the whole path"),
    ("replay {R} --config {L}", 2, "labels.csv"),
    // settings that could not take effect there
    ("replay {R} --design {D} --set isolate.pulse_s=8e-6", 2, "by this design"),
    ("replay {R} --design {D} --set isolate.unlabelled_classes=false", 2, "by this design"),
    ("replay {R} --design {D} --set isolate.neighbours=3", 2, "isolate.method = \"posterior\""),
    ("replay {R} --design {D} --set isolate.signal=deviation", 2, "isolate.method = \"posterior\""),
    ("replay {R} --design {D} --set isolate.method=neighbours", 2, "train with --set isolate"),
    ("replay {R} --design {D} --set detect.false_alarm_rate=1e-3", 2, "train again"),
    ("replay {R} --design {D} --set detect={false_alarm_rate=1e-3}", 2, "train again"),
    ("replay {R} --design {D} --set isolate.classes={Eigene=[\"EC\"]}", 2, "trained without it"),
    ("replay {R} --set isolate.classes={Eigene=[\"EC\"]}", 2, "no design"),
    ("replay {R} --set isolate.certainty=0.9", 2, "--design"),
    ("replay {R} --set output.weights=true", 2, "--design"),
    ("replay {R} --set detect.mu=2", 2, "detect.threshold = \"quantile\""),
    ("replay {R} --set detect.fault=EC", 2, "detect.denominator = \"resonance\""),
    ("replay {R} --set detect.denominator=eigenvalues", 2, "without --design"),
    ("replay {R} --set detect.oscillations=7", 2, "detect.method = \"sensitivity\""),
    ("train {T} --labels {L} -o d.json --set identify.first=5", 2, "`inkling train`"),
    ("train {T} --labels {L} -o d.json --set output.dir=x", 2, "`inkling train`"),
    (
        "identify {T} -o d.json --set detect.oscillations=7",
        2,
        "no effect here, on `inkling identify`",
    ),
    // and those that can
    ("replay {R} --design {D} --out o --dry-run --set isolate.certainty=.9", 0, ""),
    ("replay {R} --design {D} --out o --dry-run --set detect.false_alarm_rate=7e-4", 0, ""),
    ("replay {R} --design {D} --out o --dry-run --set identify.first=5", 0, ""),
    ("replay {R} --design {D} --out o --dry-run --set episodes.false_per_million=1", 0, ""),
    // what no terminal shows has no progress
    ("simulate {S}/sample.toml -o run", 0, ""),
    // files of another kind
    ("replay missing*.mcap", 1, "no file fits"),
    ("replay {R} --design missing.json", 2, "missing.json"),
    ("replay {R} --design {R}", 2, "not a design"),
    ("replay {R} --design {L}", 2, "`inkling train` makes one"),
    ("replay {L} --design {D}", 1, "`inkling convert` makes one"),
    ("replay {R} --out o --set output.dir=other", 2, "--out says that already"),
    ("replay {R} --threads 2 --set replay.threads=1", 2, "--threads says that already"),
    ("replay {R} --identify design --set identify.mode=windows", 2, "--identify says that already"),
    ("convert {L} -o d.mcap --temperature nan", 2, "give a finite number"),
    ("train {T} --labels {L} -o d.json --new-class {none}", 2, "an empty name is none"),
    ("replay {E}", 1, "not an MCAP file"),
    ("replay {none}", 2, "an empty name is no file"),
    ("report {none} -o r.html", 2, "an empty name is no file"),
    ("train {none} --labels {L} -o d.json", 2, "an empty name is no file"),
    ("inspect {none}", 2, "an empty name is no file"),
    ("train {T} --labels {L} -o d.json --config {L}", 2, "has the sections of pipeline.toml"),
    ("train {T} --labels {L} -o d.json --config {S}/sample.toml", 2, "sections of pipeline.toml"),
    ("train {T} --labels {L} -o d.json --config missing.toml", 2, "missing.toml"),
    ("replay {D}", 1, "not an MCAP file"),
    ("replay {R} --design {D} --baseline {L}", 2, "`inkling replay --baseline` makes them"),
    ("replay {R} --design {D} --out {R}", 2, "is a file, and results go into a directory"),
    ("report {R} -o r.html", 2, "but a recording that inkling made: `inkling replay` judges it"),
    ("report . -o r.html", 1, "*.verdicts.parquet"),
    ("report . -o .", 2, "give a name.html"),
    ("report {E} -o r.html", 2, "a report reads *.verdicts.parquet"),
    ("report missing -o r.html", 2, "missing: no such file"),
    ("train {T} --labels missing.csv -o d.json", 2, "missing.csv"),
    ("train {T} --labels {D} -o d.json", 2, "no column `printhead`"),
    ("train {T} --labels {R} -o d.json", 2, "print_run.mcap"),
    ("train missing.mcap --labels {L} -o d.json", 2, "missing.mcap"),
    ("train {T} --labels {L} -o .", 2, "is a directory"),
    ("identify missing.mcap -o m.json", 2, "missing.mcap"),
    ("identify {T} --labels {L} -o .", 2, "is a directory"),
    ("score {R} --labels {L}", 2, "no table of verdicts, but a recording"),
    ("score {E} --labels {L}", 2, "a score reads *.verdicts.parquet"),
    ("score missing --labels {L}", 2, "missing: no such file"),
    ("score . --labels {D}", 2, "no column `printhead`"),
    ("score --design {L}", 2, "not a design"),
    ("convert missing.csv -o d.mcap", 2, "missing.csv"),
    ("convert {L} -o d.mcap", 1, "looks like the numbers of channels"),
    ("convert {R} -o d.mcap", 2, "no table, but a recording that inkling made: `inkling replay`"),
    ("inspect {D}", 1, "not an MCAP file"),
    ("inspect missing.mcap", 2, "missing.mcap"),
    ("simulate {R} -o s", 2, "is not UTF-8 text"),
    ("simulate missing.toml -o s", 2, "missing.toml"),
    ("critique missing.mcap -o c", 2, "missing.mcap"),
    ("critique {D} -o c", 1, "not an MCAP file"),
    // one kind of file for another, with what it is for
    ("replay {R} --design {B}", 2, "not a design, but a file of baselines: --baseline takes it"),
    ("replay {R} --design {A}", 2, "but an account of a replay"),
    ("replay {R} --design {D} --baseline {D}", 2, "no baselines, but a design: --design takes it"),
    ("score --design {B}", 2, "but a file of baselines: --baseline takes it"),
    ("report {D} -o r.html", 2, "no table of verdicts, but a design: --design takes it"),
    ("report {A} -o r.html", 2, "a report reads *.verdicts.parquet of `inkling replay`"),
    ("report {L} -o r.html", 2, "no table of verdicts; a report reads"),
    ("report {O} --changes-since {D}", 2, "not the run.json of a replay, but a design"),
    ("score {D} --labels {L}", 2, "no table of verdicts, but a design"),
    ("train {T} --labels {T} -o d.json", 2, "no labels, but a recording that inkling made"),
    ("convert {D} -o d.mcap", 2, "no table, but a design"),
    // places, names and numbers
    // results that have no place are refused before their input is looked at
    ("critique no.mcap -o {L}", 2, "is a file"),
    ("simulate no.toml -o {L}/below", 2, "is a file"),
    ("thesis -o {L}", 2, "is a file"),
    ("convert no.csv -o {L}/below", 2, "is a file"),
    ("convert no.csv -o .", 2, "is a directory"),
    ("replay {R} --follow --serve 8080", 2, "such as 127.0.0.1:8080"),
    ("replay {R} --follow --serve 127.0.0.1", 2, "such as 127.0.0.1:8080"),
    ("replay {R} --follow --serve 127.0.0.1:99999", 2, "such as 127.0.0.1:8080"),
    ("replay {R} --identify design", 2, "give --design FILE"),
    ("replay {R} --set identify.mode=design", 2, "give --design FILE"),
    ("replay {R} --set isolate.priors={zz=1}", 2, "isolate.priors"),
    ("replay {R} --set =3", 2, "expected KEY=VALUE"),
    ("replay {R} --set detect.mu", 2, "expected KEY=VALUE"),
    ("replay {R} --set input.ignore=[\"a[\"]", 2, "input.ignore: no valid pattern"),
    ("train {T} --labels {L} -o d.json --set input.ignore=[\"a\"]", 2, "has no effect here"),
    ("replay {R}x", 2, "did you mean"),
    ("replay {R} --design {D}x", 2, "no such file; did you mean"),
    ("replay {R} --config {S}/sampel.toml", 2, "did you mean"),
    ("train {T} --labels {L}x -o d.json", 2, "did you mean"),
    ("simulate {S}/sampel.toml -o s", 2, "did you mean"),
    ("convert {L}x -o d.mcap", 2, "did you mean"),
    ("simulate {S}/sample.toml -o s --seed -4", 2, "invalid value '-4' for '--seed"),
    ("thesis -o c --seeds -3", 2, "invalid value '-3' for '--seeds"),
    ("convert {L} -o d.mcap --time when", 2, "no column \"when\"; there are printhead, channel"),
    ("convert {L} -o d.mcap --outputs z", 2, "no column \"z\"; there are printhead, channel"),
    ("convert {L} -o d.mcap --period-s -1", 2, "more than 0"),
];

#[test]
fn what_is_mistyped_is_answered_in_a_sentence() {
    let logs = root().join("sample_logs");
    let named = |name: &str| logs.join(name).display().to_string();
    let other = House::new();
    other.ok(&format!("replay {} --baseline b.json --out out --quiet", named("print_run.mcap")));
    for (command, status, said) in MISTAKES {
        let house = House::new();
        let command = command
            .replace("{R}", &named("print_run.mcap"))
            .replace("{T}", &named("train.mcap"))
            .replace("{D}", &named("design.json"))
            .replace("{L}", &named("labels.csv"))
            .replace("{S}", &named("scenarios"))
            .replace("{O}", &other.path("out").display().to_string())
            .replace("{A}", &other.path("out/run.json").display().to_string())
            .replace("{B}", &other.path("b.json").display().to_string())
            .replace("{E}", &other.path("out/print_run.episodes.parquet").display().to_string());
        let words = command.split_whitespace().map(|word| if word == "{none}" { "" } else { word });
        let stderr = house.run_words(&command, words).exits(*status).says(said).stderr();
        assert!(*status != 0 || stderr.is_empty(), "{command}: {stderr}");
        assert!(!stderr.contains("panicked"), "{command}: {stderr}");
        // a run that began and failed (1) keeps its journal; wrong usage never begins
        let mut left = std::fs::read_dir(house.path(".")).expect("the directory");
        assert!(*status != 2 || left.next().is_none(), "{command}: wrote something");
    }
}
