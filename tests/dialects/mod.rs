//! Recordings of others are judged as ours are, or it is said what is wrong and what there is.

mod hostile;
mod proposals;
mod tables;
pub mod writers;

use crate::house::{Ended, House};
use crate::recipes::{own_messages, some};
use crate::recorded::{Verdicts, sample, verdicts};
use inkling::burst::Burst;
use inkling::io::burst_codec;
use writers::{Messages, Samples, Written, json, protobuf, ros2};

/// Of two printheads, one without temperatures.
fn bursts() -> Vec<Burst> {
    let mut all = some(0, 40);
    let second = some(40, 20).into_iter().map(|b| Burst {
        printhead: "second head".into(),
        temperature_c: None,
        first_channel: 1000,
        idle_time_s: vec![0.25; b.channels as usize],
        ..b
    });
    all.extend(second);
    all
}

pub fn replay(house: &House, recording: &str, more: &str) -> Ended {
    house.replay(&format!("{recording} {more}"))
}

pub fn judged(house: &House, recording: &str, more: &str) -> Verdicts {
    replay(house, recording, more).exits(0);
    verdicts(&house.path(&format!("out/{}.verdicts.parquet", recording.trim_end_matches(".mcap"))))
}

pub fn native(house: &House, bursts: &[Burst]) -> Verdicts {
    house.record("native.mcap", bursts);
    judged(house, "native.mcap", "")
}

/// The settings of a dialect: what is its own, and fields of the same names in all.
macro_rules! dialect {
    ($own:literal) => {
        concat!(
            "[[input.dialect]]\n",
            $own,
            "\nperiod_s = \"period\"\ntime = \"header.stamp\"\nidle = \"idle\"\n\
             voltage = \"drive_voltage\"\nneighbours = \"near\"\n"
        )
    };
}

const PROTOBUF: &str = dialect!(
    r#"topic = "/heads/*/burst"
schema = "acme.Wave"
samples = "waves[0].SAMPLES"
channels = "waves[0].channels"
samples_per_channel = "waves[0].n"
first_channel = "first"
printhead = "{header.id}"
temperature = "temp_c""#
);

const JSON: &str = dialect!(
    r#"topic = "/heads/*/burst"
samples = "samples"
channels = "channels"
first_channel = "heads[1].first"
printhead = "{topic.1}"
temperature = "temp_c""#
);

const ROS: &str = dialect!(
    r#"topic = "/heads/**"
samples = "waves[0].data"
channels = "waves[0].channels"
first_channel = "first"
printhead = "{header.frame_id}"
temperature = "temp_c[0]""#
);

/// What is written in each encoding, and what reads it.
fn encodings() -> [(&'static str, Written, String); 6] {
    let bytes = PROTOBUF.replace("SAMPLES\"", "data\"\nformat = \"s16le\"");
    let of = |name: &str| PROTOBUF.replace("SAMPLES", name);
    [
        ("bytes", protobuf(Samples::Bytes), bytes),
        ("packed", protobuf(Samples::Packed), of("counts")),
        ("floats", protobuf(Samples::Floats), of("volts")),
        ("json", json(), JSON.into()),
        ("cdr", ros2(false), ROS.into()),
        ("cdr_big_endian", ros2(true), ROS.into()),
    ]
}

#[test]
fn the_same_signals_in_any_encoding_have_the_same_verdicts() {
    let house = House::new();
    let bursts = bursts();
    let expected = native(&house, &bursts);
    assert!(expected.values().any(|said| said.starts_with("Faulty")), "nothing faulty to compare");
    for (name, written, settings) in encodings() {
        writers::write(&house.path(&format!("{name}.mcap")), &bursts, &written);
        house.write("s.toml", &settings);
        let found = judged(&house, &format!("{name}.mcap"), "--config s.toml");
        assert_eq!(found.len(), expected.len(), "{name}");
        for (key, said) in &expected {
            assert_eq!(found.get(key), Some(said), "{name} {key:?}");
        }
        let summary = house.read_json(&format!("out/{name}.summary.json"));
        let dialect = &summary["settings"]["input"]["dialect"][0];
        assert!(dialect["samples"].is_string(), "the mapping is in the metadata: {summary}");
        assert_eq!(summary["expected"], 60);
        let inspected = house.json(&format!("inspect {name}.mcap --config s.toml --json"));
        assert_eq!((&inspected["bursts"], &inspected["whole"]), (&60.into(), &true.into()));
    }
}

#[test]
fn a_dialect_that_cannot_take_effect_says_what_there_is() {
    let house = House::new();
    let bursts = bursts();
    let set = |from: &str, to: &str| (from.to_owned(), to.to_owned());
    let proto = PROTOBUF.replace("SAMPLES", "counts");
    writers::write(&house.path("p.mcap"), &bursts, &protobuf(Samples::Packed));
    writers::write(&house.path("j.mcap"), &bursts, &json());
    writers::write(&house.path("r.mcap"), &bursts, &ros2(false));
    let p = |change: (String, String)| ("p.mcap", proto.replace(&change.0, &change.1));
    let j = |change: (String, String)| ("j.mcap", JSON.replace(&change.0, &change.1));
    let r = |change: (String, String)| ("r.mcap", ROS.replace(&change.0, &change.1));
    for ((recording, settings), says) in [
        (p(set("/heads/*/", "/head/*/")), "topics that exist: /heads/"),
        (p(set("acme.Wave", "acme.Wav")), "(topic \"/heads/*/burst\", schema \"acme.Wav\")"),
        (p(set("waves[0].counts", "waves[0].count")), "waves[0].counts (sint32[])"),
        (p(set("waves[0].counts", "waves.counts")), "\"waves\" is several: say which, waves[0]"),
        (p(set("waves[0].counts", "waves[0].data")), "is bytes: say format"),
        (p(set("waves[0].counts", "waves[0].n")), "not bytes or an array of numbers"),
        (p(set("\"period\"", "\"header.id\"")), "not a number"),
        (p(set("header.stamp", "header")), "not ns as an integer"),
        (p(set("{header.id}", "{topic.7}")), "its parts are 0: heads, 1:"),
        (p(set("schema =", "format = \"s16le\"\nschema =")), "leave format out"),
        (j(set("\"samples\"", "\"smaples\"")), "samples (number[][])"),
        (j(set("\"period\"", "\"dt\"")), "period_s = \"dt\": not in its first message"),
        (j(set("\"period\"", "\"header.id\"")), "period_s = \"header.id\": is text, not a number"),
        (j(set("\"channels\"", "\"period\"")), "channels = \"period\": is not a whole number"),
        (
            j(set("\"samples\"", "\"channels\"")),
            "samples = \"channels\": is whole number, not bytes or an array",
        ),
        (j(set("header.stamp", "header.id")), "time = \"header.id\": is text, not ns"),
        (j(set("samples =", "format = \"f32le\"\nsamples =")), "leave format out"),
        (p(set("waves[0].counts", "waves[0].volts\"\nformat = \"f32le")), "leave format out"),
        (r(set("waves[0].data", "waves[0].data\"\nformat = \"s16le")), "leave format out"),
        (r(set("waves[0].data", "waves[0].dat")), "acme_msgs/Wave has no field \"dat\""),
        (r(set("temp_c[0]", "ok")), "is bool, not a number"),
        (p(set("[[input.dialect]]", "[[input.dialect]]\nsmaples = 1")), "smaples"),
        (("p.mcap", format!("{proto}\n{proto}")), "input.dialect[1] can never take effect"),
    ] {
        house.write("s.toml", &settings);
        replay(&house, recording, "--config s.toml").exits(2).says(says);
    }
    // a key of the file is the file's, whatever is set beside it
    house.write("s.toml", JSON.replace("channels = \"channels\"", "channels = 0"));
    let ended = replay(&house, "j.mcap", "--config s.toml --set identify.first=5").exits(2);
    let ended = ended.says("s.toml: input.dialect[0]: channels = 0");
    assert!(!ended.stderr().contains("--set"), "{}", ended.stderr());
    // what `inspect` is told in vain
    house.write("s.toml", "[identify]\nfirst = 5\n");
    house.run("inspect j.mcap --config s.toml").exits(2).says("no [[input.dialect]]");
    house.write("s.toml", JSON.replace("/heads/*/", "/head/*/"));
    house.run("inspect j.mcap --config s.toml").exits(2).says("topics that exist");
    // where the recording is ours already
    house.record("ours.mcap", &bursts);
    house.write("s.toml", proto.replace("/heads/*/burst", "**").replace("schema =", "# "));
    replay(&house, "ours.mcap", "--config s.toml").exits(2).says("not inkling.Burst already");
    assert!(!house.path("out").exists(), "nothing was written");
}

#[test]
fn a_dialect_serves_training_too() {
    let house = House::new();
    let bursts = crate::recorded::bursts(&sample("train.mcap"));
    house.record("ours.mcap", &bursts);
    writers::write(&house.path("theirs.mcap"), &bursts, &ros2(false));
    house.write("s.toml", ROS);
    let labels = "--labels sample_logs/labels.csv";
    house.ok(&format!("train ours.mcap {labels} -o ours.json"));
    house.ok(&format!("train theirs.mcap {labels} -o theirs.json --config s.toml"));
    assert_eq!(house.read_json("ours.json"), house.read_json("theirs.json"));
}

#[test]
fn without_a_dialect_it_is_said_what_is_there_and_a_block_to_paste_reads_it() {
    let house = House::new();
    let bursts = bursts();
    let expected = native(&house, &bursts);
    for (name, written) in [("p", protobuf(Samples::Packed)), ("j", json()), ("r2", ros2(false))] {
        let file = format!("{name}.mcap");
        writers::write(&house.path(&file), &bursts, &written);
        replay(&house, &file, "").exits(1).says("inkling inspect").says("/heads/second head/burst");
        let inspected = house.json(&format!("inspect {file} --json"));
        assert_eq!(inspected["whole"], true);
        assert_eq!(inspected["topics"].as_array().unwrap().len(), 3);
        let block = inspected["dialects"][0].as_str();
        let block = block.unwrap_or_else(|| panic!("{name}: {inspected}")).to_owned();
        house
            .run(&format!("inspect {file}"))
            .exits(0)
            .says("[[input.dialect]]")
            .says("/heads/*/burst");
        // what only a person knows
        let [first, temperature] = match name {
            "j" => ["heads[1].first", "temp_c"],
            _ => ["first", "temp_c[0]"],
        };
        let lines = block.lines().filter(|line| !line.starts_with("first_channel"));
        let mut block = lines.collect::<Vec<_>>().join("\n");
        block +=
            &format!("\nfirst_channel = \"{first}\"\nidle = \"idle\"\nneighbours = \"near\"\n");
        if !block.contains("temperature") {
            block += &format!("temperature = \"{temperature}\"\n");
        }
        house.write("s.toml", &block);
        let found = judged(&house, &file, "--config s.toml");
        assert_eq!(found, expected, "{name}: {block}");
    }
}

/// What a logger says first may be no burst, and costs itself alone.
#[test]
fn messages_that_cannot_be_read_are_rows_and_the_others_are_judged() {
    let house = House::new();
    let bursts = bursts();
    let odd = Written {
        encode: |burst| match burst.first_channel {
            1000 => (json().encode)(burst)[..100].to_vec(),
            _ if burst.t_acq_ns == some(0, 1)[0].t_acq_ns => b"{\"hello\": 1}".to_vec(),
            _ => (json().encode)(burst),
        },
        ..json()
    };
    writers::write(&house.path("r.mcap"), &bursts, &odd);
    house.write("s.toml", JSON);
    replay(&house, "r.mcap", "--config s.toml").exits(4); // nothing of the second head
    let summary = house.read_json("out/r.summary.json");
    assert_eq!(summary["counts"]["bursts"], 60);
    assert_eq!(summary["counts"]["rejected"]["undecodable"], 21);
    let rows = verdicts(&house.path("out/r.verdicts.parquet"));
    // at the messages' log times; the topic names whose they are
    assert!((42..62).all(|log_time| rows.contains_key(&(log_time, "second head".into(), 0))));
}

/// Ten messages in JSON of which each is changed, and the dialect that reads them.
fn edited(change: impl Fn(usize, String) -> String) -> House {
    let house = House::new();
    let mut messages = Messages::default();
    for (n, burst) in some(0, 10).iter().enumerate() {
        let text = change(n, String::from_utf8((json().encode)(burst)).unwrap());
        messages.add(&json(), "/heads/K/burst", 1, text.as_bytes());
    }
    house.write("r.mcap", messages.finish());
    house.write("s.toml", JSON);
    house
}

/// As Python writes them, what overflows, and what instruments write.
#[test]
fn numbers_that_json_does_not_have_cost_their_channel_alone() {
    const WORDS: [&str; 5] = ["NaN", "-Infinity", "1e400", "null", "9.9e37"];
    let house = edited(|n, text| {
        let (before, row) = text.split_once("\"samples\":[[").unwrap();
        let (_, rest) = row.split_once(',').unwrap();
        format!("{before}\"samples\":[[{},{rest}", WORDS[n % 5])
    });
    replay(&house, "r.mcap", "--config s.toml").exits(3);
    let counts = &house.read_json("out/r.summary.json")["counts"];
    assert_eq!((&counts["bursts"], &counts["unusable_bursts"]), (&10.into(), &0.into()));
    assert_eq!(counts["rejected"], serde_json::json!({"non_finite": 10}));
}

/// Only names tell that they may be bursts, of the topic or the schema, or of a printhead; or that each message
/// is compressed.
#[test]
fn topics_that_nothing_can_read_are_told_with_quiet_too_if_they_are_called_like_bursts() {
    let of = |schema_name, schema_encoding, message_encoding| Written {
        schema_name,
        schema_encoding,
        schema: b"int16[] data".to_vec(),
        message_encoding,
        encode: |burst| burst.samples.to_vec(),
    };
    let ours = own_messages();
    for (written, topic, says) in [
        (of("acme_msgs/Ring", "ros1msg", "ros1"), "/k-2", "encoding \"ros1\" are not read"),
        (of("acme_msgs/msg/Data", "ros2idl", "cdr"), "/k-2/burst", "not by \"ros2idl\""),
        (of("acme_msgs/msg/RingDown", "ros2msg", "cdr"), "/k-2", "not what its schema says"),
        (of("acme.Data", "flatbuffer", "flatbuffer"), "/line/cyan-1/adc", "\"flatbuffer\" are not"),
        (compressed(of("acme_msgs/msg/Data", "ros2msg", "cdr")), "/k-2", "by itself (zstd)"),
        (compressed(of("acme.Data", "jsonschema", "json")), "/k-2", "by itself (zstd)"),
    ] {
        let house = House::new();
        let mut both = Messages::default();
        for burst in some(0, 6) {
            both.add(&ours, &burst_codec::topic(&burst.printhead), 1, &(ours.encode)(&burst));
            both.add(&written, topic, 1, &(written.encode)(&burst));
            let text = of("std_msgs/String", "ros1msg", "ros1");
            both.add(&text, "/k-2/log", 1, &(text.encode)(&burst));
        }
        house.write("both.mcap", both.finish());
        let told = format!("topic {topic}: its 6 messages of {}", written.schema_name);
        let ended = replay(&house, "both.mcap", "-q").exits(0).says(&told).says(says);
        let account = house.read_json("out/run.json");
        assert!(account["warnings"][0]["what"].as_str().unwrap().starts_with(&told), "{account}");
        assert!(!ended.stderr().contains("/k-2/log"), "{}", ended.stderr());
        house.run("inspect both.mcap").exits(0).says(says);
        let summary = house.read_json("out/both.summary.json");
        assert_eq!(summary["unread"][0]["topic"], topic);
    }
}

/// Messages of which each is compressed.
fn compressed(of: Written) -> Written {
    Written { encode: |burst| zstd::bulk::compress(&burst.samples, 1).unwrap(), ..of }
}

#[test]
fn what_cannot_be_decoded_is_told_with_field_and_value() {
    for (from, to, says) in [
        ("\"sec\":", "\"sec\":\"late\",\"x\":", "header.stamp: no seconds and"),
        ("\"period\":", "\"period\":\"fast\",\"x\":", "period: \"fast\" is no number"),
        (
            "\"samples\":[[",
            "\"adc\":[[",
            "samples is not in the message; fields that exist: adc (number[][])",
        ),
        ("\"channels\":", "\"channels\":-3,\"x\":", "channels: -3 is no whole number of 0 or more"),
        ("\"samples\":[[", "\"samples\":[[1],[", "samples: what it holds is no array of numbers"),
        ("{", "[", "no JSON: "),
        ("\"channels\":", "\"channels\":7,\"x\":", "samples are no multiple of 7 channels"),
    ] {
        let house = edited(|n, text| if n > 3 { text.replacen(from, to, 1) } else { text });
        let ended = replay(&house, "r.mcap", "--config s.toml -q");
        ended.says("6 messages are no bursts; the first of K is ").says(says);
        house.run("inspect r.mcap --config s.toml").says(says);
    }
}

/// With the feature: `tests/object_stores.py`.
#[test]
#[cfg_attr(feature = "object-store", ignore = "this build has object stores")]
fn a_build_without_object_stores_says_how_to_get_one() {
    let house = House::new();
    let words = "without the feature object-store: cargo build --features object-store";
    house.run("replay s3://bucket/night/ --out out").exits(1).says(words).says("aws s3 sync");
    house.run("inspect gs://bucket/night.mcap").exits(1).says(words);
    house.record("a.mcap", &some(0, 3));
    house.run("replay a.mcap --out az://bucket/out").exits(1).says(words);
    house.run("replay a.mcap --design s3://bucket/design.json --out out").exits(2).says(words);
    house.run("convert s3://bucket/a.csv -o a2.mcap").exits(1).says(words);
    house.run("thesis -o az://bucket/chapter4").exits(2).says("a directory of files");
    assert!(!house.path("az:").exists());
}

#[test]
fn relative_paths_of_a_settings_file_are_files_and_objects_stay_objects() {
    let house = House::new();
    house.write("below/s.toml", "[input]\nrecordings = [\"s3://bucket/a.mcap\", \"b.mcap\"]\n");
    let ended = house.run("replay --config below/s.toml --out out").exits(1);
    ended.says("inkling: s3://bucket/a.mcap: ");
    house.write("below/s.toml", "[input]\nrecordings = [\"b.mcap\"]\n");
    house.run("replay --config below/s.toml --out out").exits(2).says("below/b.mcap: no such file");
}

/// Cut short behind a hundred chunks of what is none of ours: only reading says what there is.
#[test]
fn bursts_that_come_late_in_a_recording_without_a_summary_are_found_and_wrong_paths_told() {
    let house = House::new();
    let bursts = some(0, 20);
    let options = mcap::WriteOptions::new().chunk_size(Some(4096)).compression(None);
    let mut messages = Messages::new(options);
    for _ in 0..100 {
        let text = format!("{{\"text\":\"{}\"}}", "x".repeat(5000));
        messages.add(&json(), "/log", 1, text.as_bytes());
    }
    for burst in &bursts {
        messages.add(&json(), "/heads/late/burst", 1, &(json().encode)(burst));
    }
    let bytes = messages.finish();
    house.write("late.mcap", &bytes[..bytes.len() - 20]);
    house.write("s.toml", JSON);
    replay(&house, "late.mcap", "--config s.toml").exits(3);
    let summary = house.read_json("out/late.summary.json");
    assert_eq!(summary["counts"]["bursts"], 20);
    assert_eq!(summary["counts"]["unusable_bursts"], 0);
    house.write("s.toml", JSON.replace("\"samples\"", "\"smaples\""));
    let wrong = replay(&house, "late.mcap", "--config s.toml --force").exits(2);
    wrong.says("samples = \"smaples\": not in its first message");
}

/// Bursts as JSON, uncompressed; `samples`: what the field of that name is called.
fn as_json(bursts: &[Burst], samples: &str) -> Vec<u8> {
    let mut messages = Messages::new(mcap::WriteOptions::new().compression(None));
    for burst in bursts {
        let text = String::from_utf8((json().encode)(burst)).unwrap();
        let text = text.replace("\"samples\"", &format!("\"{samples}\""));
        messages.add(&json(), "/heads/K/burst", 1, text.as_bytes());
    }
    messages.finish()
}

/// Whoever opened a finished recording would find that the dialect cannot read it any more.
#[test]
fn finished_recordings_are_skipped_without_being_opened_until_the_mapping_is_another() {
    let house = House::new();
    house.write("s.toml", JSON);
    let path = house.write("rec/a.mcap", as_json(&some(0, 3), "samples"));
    replay(&house, "rec", "--config s.toml").exits(0);
    house.write("other.toml", JSON.replace("{topic.1}", "{header.id}"));
    replay(&house, "rec", "--config other.toml --dry-run").exits(0).says("input.dialect");
    let then = std::fs::metadata(&path).unwrap().modified().unwrap();
    house.write("rec/a.mcap", as_json(&some(0, 3), "smaples"));
    let file = std::fs::File::options().append(true).open(&path).unwrap();
    file.set_modified(then).unwrap();
    drop(file);
    replay(&house, "rec", "--config s.toml").exits(0).says("1 skipped");
    // what is new is judged alone; other dialects are checked on all
    house.write("rec/b.mcap", as_json(&some(3, 3), "smaples"));
    replay(&house, "rec", "--config s.toml").exits(4).says("1 not judged").says("1 skipped");
    house.write("s.toml", JSON.replace("\"{topic.1}\"", "\"{topic.0}\""));
    replay(&house, "rec", "--config s.toml").exits(2).says("smaples");
}
