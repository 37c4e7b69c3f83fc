//! What transcripts are made of: recordings of the sample's bursts, changed in named ways, and what is shown of results.

mod bursts;
mod shows;

pub use bursts::{made, on_day, some};
pub use shows::{is_inert, results, results_in};

use crate::by_hand::by_hand;
use crate::dialects::writers::{self, Messages, Written};
use crate::house::{House, between};
use crate::recorded::{self, batches, rows, sample};
use inkling::io::burst_codec;
use inkling::io::recording_writer::{Compression, WriterOptions};
use serde_json::json;

/// Follows a recipe in a directory; gives what it shows.
pub fn follow(house: &House, recipe: &str) -> String {
    let (verb, of) = recipe.split_once(' ').unwrap_or((recipe, ""));
    let (name, more) = of.split_once(' ').unwrap_or((of, ""));
    match verb {
        // makes
        "record" => house.record(name, &made(more)),
        "record_in_chunks" => house.record_in_chunks(name, &made(more)),
        "record_unchunked" => {
            let options = WriterOptions { compression: Compression::None, chunk_bytes: None };
            recorded::write(&house.path(name), &made(more), options);
        }
        "record_in_order" => {
            let mut bursts = made(more);
            bursts.sort_by_key(|burst| burst.t_acq_ns);
            house.record(name, &bursts);
        }
        "foreign" => drop(house.write(name, foreign(more))),
        "logged" => drop(house.write(name, logged(more))),
        "tables" => by_hand(house, name, more),
        "write" => drop(house.write(name, unescaped(more))),
        "cut" => {
            let (bytes, of_100) = (house.read(name), more.parse::<usize>().expect("percent"));
            house.write(name, &bytes[..bytes.len() * of_100 / 100]);
        }
        "flip" => {
            let mut bytes = house.read(name);
            let middle = bytes.len() / 2;
            bytes[middle] ^= 1;
            house.write(name, bytes);
        }
        // shows
        "show" => return shows::shown(&house.text(name), more),
        "counts" => return shows::counted(house, name),
        "bursts" => return shows::listed(&recorded::bursts(&house.path(name))),
        "messages" => return shows::messages(&house.read(name)),
        "rows" => return shows::distinct_rows(&batches(&house.path(name)), more),
        "metadata" => return shows::shown(&shows::metadata(house, name), more),
        "same" => return shows::same(house, name, more),
        "late" => return shows::late(house, name, more.parse().expect("every so many")),
        "report" => return shows::reported(house, of),
        "page" => {
            return shows::text_of(between(&house.text(name), &format!("<h2>{more}</h2>"), "<h2>"));
        }
        // what a run leaves, but for what tells when and how fast
        "remember" => drop(house.write("remembered", in_text(house))),
        "is_as_remembered" => assert!(house.text("remembered") == in_text(house), "it differs"),
        _ => panic!("no recipe is called {verb}"),
    }
    String::new()
}

/// What a line of text cannot hold.
fn unescaped(text: &str) -> String {
    text.replace("\\n", "\n").replace("\\e", "\u{1b}").replace("\\0", "\0")
}

/// Our own messages, for recordings that others write, too.
pub fn own_messages() -> Written {
    Written {
        schema_name: burst_codec::SCHEMA_NAME,
        schema_encoding: burst_codec::MESSAGE_ENCODING,
        schema: burst_codec::FILE_DESCRIPTOR_SET.into(),
        message_encoding: burst_codec::MESSAGE_ENCODING,
        encode: burst_codec::encode,
    }
}

/// A recording in JSON, `some 0 6`; behind `++` bursts of ours in it.
fn foreign(words: &str) -> Vec<u8> {
    let (theirs, ours) = words.split_once(" ++ ").unwrap_or((words, "none"));
    let (written, native) = (writers::json(), own_messages());
    let mut messages = Messages::default();
    messages.add_bursts(&written, &made(theirs));
    for burst in made(ours) {
        let topic = burst_codec::topic(&burst.printhead);
        messages.add(&native, &topic, 1, &burst_codec::encode(&burst));
    }
    messages.finish()
}

/// The sample as a logger writes it in JSON of its own.
fn logged(form: &str) -> Vec<u8> {
    let mut messages = Messages::default();
    for burst in recorded::bursts(&sample("print_run.mcap")) {
        let (rows, samples) = (rows(&burst), 0..burst.samples_per_channel as usize);
        let message = match form {
            "rows" => json!({
                "stamp": chrono::DateTime::from_timestamp_nanos(burst.t_acq_ns).to_rfc3339(),
                "rate_hz": (1.0 / burst.sample_period_s).round(),
                "ink_temp_c": burst.temperature_c,
                "drive_voltage": burst.drive_voltage_v,
                "ok": true,
                "data": rows,
            }),
            "flat" => {
                let values: Vec<f64> =
                    samples.flat_map(|k| rows.iter().map(move |row| row[k])).collect();
                json!({ "period_ns": burst.sample_period_s * 1e9, "values": values })
            }
            "bare" => json!({ "values": rows[0] }),
            _ => panic!("no logger writes {form}"),
        };
        let topic = format!("/press/{}/ring", burst.printhead);
        let message = message.to_string();
        messages.add(&writers::json(), &topic, burst.t_acq_ns as u64, message.as_bytes());
    }
    messages.finish()
}

fn in_text(house: &House) -> String {
    let mut of_recordings = results(house);
    // it tells of recordings without results, too
    of_recordings.remove("account.json");
    format!("{of_recordings:?}")
}
