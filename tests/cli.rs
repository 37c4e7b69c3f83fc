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

#[test]
fn exit_code_1_where_nothing_can_be_done() {
    let house = House::new();
    house.run("replay missing.mcap").exits(1).says("missing.mcap");
    std::fs::create_dir(house.path("empty")).unwrap();
    house.run("replay empty").exits(1).says("mcap");
    house.write("zero.mcap", b"");
    house.run("replay zero.mcap").exits(1).says("empty");
    house.run("inspect zero.mcap").exits(1).says("empty");
    house.write("text.mcap", b"printhead,channel,from,to,state,severity\n");
    house.run("replay text.mcap").exits(1).says("not an MCAP");
    house.write("broken.json", b"{\"version\": 1}");
    house.run("replay text.mcap --design broken.json").exits(1).says("broken.json");
    assert!(!house.path("verdicts/text.verdicts.parquet").exists());
}
