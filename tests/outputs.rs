//! Results overwrite no input of their command and nothing that inkling did not make; an earlier result is replaced.

use crate::house::House;

/// A table of a decay.
fn decay() -> String {
    let row =
        |k: i32| format!("{}e-6,{}\n", k, f64::from(400 - 5 * k) * (0.4 * f64::from(k)).cos());
    "t_s,volt\n".to_owned() + &(0..80).map(row).collect::<String>()
}

fn house() -> House {
    let house = House::new();
    for name in
        ["train.mcap", "print_run.mcap", "labels.csv", "design.json", "scenarios/sample.toml"]
    {
        house.copy(name, name);
    }
    house.write("decay.csv", decay());
    house.ok("replay print_run.mcap --design design.json --baseline b.json --out out --quiet");
    house
}

#[test]
fn what_is_not_an_earlier_result_of_the_kind_stays_as_it_is() {
    let house = house();
    house.write("theirs/page.html", "<!doctype html>\n<html><title>ours</title></html>");
    house.write("theirs/page.faults.parquet", "PAR1....PAR1");
    house.write("theirs/labels.csv", "printhead,channel,from,to,state,severity\n*,*,,,healthy,\n");
    house.write(
        "theirs/night.mcap",
        b"\x89MCAP0\r\n\x01\x10\0\0\0\0\0\0\0\0\0\0\0\x08\0\0\0mcap-cpp",
    );
    house.write("theirs/report.html", "<p>ours");
    house.write("theirs/tables.md", "| ours |");
    house.write("theirs/run.json", "{\"name\": \"ours\"}");
    house.write("theirs/inkling.1", "ours");
    house.write("theirs/settings.toml", "[input]");
    house.write("recorded/print_run.mcap", house.read("theirs/night.mcap"));
    house.write("figures/fig_3-2_average.svg", "<svg>");
    house.write("plots/identify_dataset.csv", "ours");
    house.write("tables/r.faults.parquet", house.read("out/print_run.verdicts.parquet"));
    house.write("written/journal.jsonl", "{\"ours\": 1}\n");
    let train = "train train.mcap --labels labels.csv -o";
    for (command, stays) in [
        (format!("{train} train.mcap"), "train.mcap"),
        (format!("{train} labels.csv"), "labels.csv"),
        (format!("{train} b.json"), "b.json"),
        (format!("{train} out/print_run.summary.json"), "out/print_run.summary.json"),
        ("identify train.mcap -o design.json".into(), "design.json"),
        ("identify train.mcap --labels labels.csv -o labels.csv".into(), "labels.csv"),
        ("score out --labels labels.csv --report theirs/page.html".into(), "theirs/page.html"),
        ("score out --labels labels.csv --report labels.csv".into(), "labels.csv"),
        ("report out -o theirs/page.html".into(), "theirs/page.html"),
        ("report out -o theirs/page.htm".into(), "theirs/page.faults.parquet"),
        ("convert decay.csv -o decay.csv".into(), "decay.csv"),
        ("convert decay.csv -o theirs/night.mcap".into(), "theirs/night.mcap"),
        ("convert decay.csv -o design.json".into(), "design.json"),
        ("simulate scenarios/sample.toml -o theirs".into(), "theirs/labels.csv"),
        ("simulate scenarios/sample.toml -o recorded".into(), "recorded/print_run.mcap"),
        ("critique train.mcap --labels labels.csv -o theirs".into(), "theirs/report.html"),
        ("thesis --seeds 1 -o theirs".into(), "theirs/tables.md"),
        ("thesis --seeds 1 -o figures".into(), "figures/fig_3-2_average.svg"),
        ("identify train.mcap -o m.json --plot plots".into(), "plots/identify_dataset.csv"),
        ("report out -o tables/r.html".into(), "tables/r.faults.parquet"),
        ("generate man -o theirs".into(), "theirs/inkling.1"),
        ("inspect print_run.mcap --write theirs/settings.toml".into(), "theirs/settings.toml"),
        ("replay print_run.mcap --out theirs".into(), "theirs/run.json"),
        ("replay print_run.mcap --out written".into(), "written/journal.jsonl"),
    ] {
        let before = house.read(stays);
        house.run(&command).exits(2).says(stays.rsplit('/').next().unwrap());
        assert!(house.read(stays) == before, "{command}: {stays} is another");
    }
    // beside verdicts that are ours lies a recording that is not
    let theirs = house.read("theirs/night.mcap");
    house.write("annotated/print_run.annotations.mcap", &theirs);
    for annotate in ["", " --annotate"] {
        let command =
            format!("replay print_run.mcap --design design.json --out annotated{annotate}");
        house.run(&command).exits(1).says("print_run.annotations.mcap: is no file of annotations");
        assert!(house.read("annotated/print_run.annotations.mcap") == theirs);
    }
    assert_eq!(house.files("theirs").len(), 9, "nothing was written beside them");
}

#[test]
fn an_earlier_result_is_replaced() {
    let house = house();
    for command in [
        "train train.mcap --labels labels.csv -o d.json",
        "identify train.mcap --labels labels.csv -o m.json",
        "convert decay.csv -o decay.mcap",
        "report out -o r.html",
        "score out --labels labels.csv --report e.html",
        "simulate scenarios/sample.toml -o run",
        "critique train.mcap --labels labels.csv -o c",
        "generate man -o man",
        "replay print_run.mcap --design design.json --baseline b.json --out out",
    ] {
        for _ in 0..2 {
            house.ok(command);
        }
    }
}
