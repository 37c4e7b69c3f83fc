//! Recordings in which effects are hidden give nothing away, and their sealed truth cannot be changed unnoticed.

use crate::house::House;
use crate::recorded::bursts;
use inkling::burst::Burst;
use inkling::simulate::hidden::effect;
use std::collections::HashSet;

#[test]
fn nothing_about_the_truth_is_in_name_size_or_structure_of_a_recording() {
    let house = House::new();
    let (mut sizes, mut digests) = (Vec::new(), Vec::new());
    for seed in 1..=12 {
        house.ok(&format!("simulate sample_logs/scenarios/hidden.toml -o {seed} --hide {seed}"));
        let names = house.files(&seed.to_string());
        assert_eq!(
            names,
            ["print_run.mcap", "sealed/labels.csv", "sealed/truth.json", "truth.sha256"]
        );
        let recording = house.read(&format!("{seed}/print_run.mcap"));
        let truth = house.text(&format!("{seed}/sealed/truth.json"));
        let ids = effect::CATALOGUE.into_iter().chain(effect::OUTSIDE).map(|e| e.id);
        // the schema itself has a field temperature_c
        let ids = ids.filter(|id| *id != "temperature");
        for word in ids.chain(["truth", "effect", "salt"]) {
            assert!(!recording.windows(word.len()).any(|w| w == word.as_bytes()), "{word}");
        }
        digests.push((house.read(&format!("{seed}/truth.sha256")), truth));
        // sizes of all bursts, in order, and of the file
        let shape = |b: &Burst| {
            let recorded = (b.temperature_c.is_some(), b.drive_voltage_v.is_some());
            (b.samples.len(), b.idle_time_s.len(), recorded, b.channels)
        };
        let bursts = bursts(&house.path(&format!("{seed}/print_run.mcap")));
        sizes.push((recording.len(), bursts.iter().map(shape).collect::<Vec<_>>()));
    }
    assert!(sizes.iter().all(|s| *s == sizes[0]), "sizes or structure differ");
    let kinds: HashSet<usize> =
        digests.iter().map(|(_, truth)| truth.matches("\"id\"").count()).collect();
    assert!(kinds.len() >= 2, "the seeds hide different things");
    assert!(digests.windows(2).all(|d| d[0] != d[1] && d[0].0.len() == 65));

    house.write("said.json", r#"{"verdict":"none","causes":[]}"#);
    house.ok("score said.json --truth 1/sealed/truth.json");
    let changed = digests[0].1.replace("\"seed\": 1", "\"seed\": 2");
    house.write("1/sealed/truth.json", changed);
    house.run("score said.json --truth 1/sealed/truth.json").exits(1).says("changed after");
    house
        .run("score said.json said.json --truth 1/sealed/truth.json")
        .exits(2)
        .says("one truth per");
}
