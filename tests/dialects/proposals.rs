//! What `inspect` proposes for messages of others: what they say, or a question.

use inkling::io::dialect::guess::guess;
use inkling::io::dialect::plan::{ChannelDescription, Schema};

fn ring(channels: usize, samples: usize, sample_major: bool) -> Vec<i16> {
    let y = |c: usize, k: usize| {
        let (c, k) = (c as f64, k as f64);
        (3000.0 * (1.0 + 0.02 * (c * 1.7).sin()) * (-0.03 * k).exp() * (0.4 * k).cos()) as i16
    };
    match sample_major {
        true => (0..samples).flat_map(|k| (0..channels).map(move |c| y(c, k))).collect(),
        false => (0..channels).flat_map(|c| (0..samples).map(move |k| y(c, k))).collect(),
    }
}

const ARRAY: &str = "std_msgs/MultiArrayLayout layout\nint16[] data\n====\nMSG: std_msgs/MultiArrayLayout\n\
    std_msgs/MultiArrayDimension[] dim\nuint32 data_offset\n====\nMSG: std_msgs/MultiArrayDimension\n\
    string label\nuint32 size\nuint32 stride\n";

/// An array of ROS with these dimensions, each a label and a size.
fn array(dims: &[(&str, usize)], offset: usize, data: &[i16]) -> Vec<u8> {
    let mut out = vec![0, 1, 0, 0];
    let mut put = |bytes: &[u8], align: usize| {
        out.resize(out.len().next_multiple_of(align), 0);
        out.extend_from_slice(bytes);
    };
    let number = |n: usize| (n as u32).to_le_bytes();
    put(&number(dims.len()), 4);
    for (label, size) in dims {
        put(&number(label.len() + 1), 4);
        put(format!("{label}\0").as_bytes(), 1);
        put(&number(*size), 4);
        put(&number(0), 4);
    }
    put(&number(offset), 4);
    put(&number(offset + data.len()), 4);
    put(&vec![0; 2 * offset], 1);
    data.iter().for_each(|y| put(&y.to_le_bytes(), 1));
    out
}

/// The block that is proposed for a message; empty: none.
fn block(encoding: &str, schema: Option<&Schema>, message: Vec<u8>, topics: &[&str]) -> String {
    let of = ChannelDescription { topic: topics[0], message_encoding: encoding, schema };
    guess(&of, &[&message.into()], topics).map_or(String::new(), |of| of.toml)
}

#[test]
fn arrays_of_ros_have_the_channels_that_their_layout_says_or_their_samples() {
    let (name, encoding) = ("std_msgs/msg/Int16MultiArray".into(), "ros2msg".into());
    let schema = Schema { name, encoding, data: ARRAY.into() };
    let by_layout = |channels: usize| format!("channels = \"layout.dim[{channels}].size\"");
    for (dims, offset, (channels, samples, sample_major), says) in [
        (&[("channel", 48), ("sample", 128)][..], 0, (48, 128, false), by_layout(0)),
        (&[("a", 24), ("b", 100)], 16, (24, 100, false), by_layout(0)),
        (&[("time", 128), ("nozzle", 32)], 0, (32, 128, true), by_layout(1)),
        (&[], 0, (48, 128, false), "channels = 48 ".into()),
        (&[], 0, (16, 128, false), "channels = 16 ".into()),
        (&[], 0, (20, 96, true), "channels = 20 ".into()),
        (&[], 0, (3, 128, false), "channels = 3 ".into()),
        (&[("data", 768)], 0, (8, 96, false), "channels = 8 ".into()),
        (&[("channel", 7), ("sample", 3)], 0, (8, 96, false), "channels = 8 ".into()),
    ] {
        let message = array(dims, offset, &ring(channels, samples, sample_major));
        let block = block("cdr", Some(&schema), message, &["/heads/K/ring"]);
        assert!(block.contains(&says), "{dims:?} {channels} x {samples}: {block}");
        let layout = if sample_major { "sample-major" } else { "channel-major" };
        assert!(block.contains(&format!("layout = \"{layout}\"")), "{block}");
        assert_eq!(block.contains("offset = \"layout.data_offset\""), offset > 0, "{block}");
    }
}

#[test]
fn fields_with_units_in_their_names_are_proposed() {
    let adc = ring(1, 128, false);
    let of = |fields: &str, topics: &[&str]| {
        block("json", None, format!("{{\"adc\":{adc:?},{fields}}}").into(), topics)
    };
    for (fields, says) in [
        ("\"t_us\":5,\"ink_degC\":31.2", &["time = \"t_us\"", "temperature = \"ink_degC\""][..]),
        (
            "\"rate_khz\":1000,\"ch\":3",
            &["rate_hz = 1000000.0  # ? rate_khz", "first_channel = \"ch\"", "channels = 1 "],
        ),
        (
            "\"dt_us\":0.5,\"nozzle\":3",
            &["period_s = 5e-7  # ? dt_us", "first_channel = \"nozzle\""],
        ),
        ("\"interval_ns\":500", &["period_s = 5e-7  # ? interval_ns"]),
        ("\"hz\":1e6", &["rate_hz = \"hz\""]),
        ("\"ns\":128,\"t\":5", &["samples_per_channel = \"ns\"", "time = \"t\""]),
        ("\"fs_mhz\":2", &["rate_hz = 2000000.0  # ? fs_mhz"]),
        ("\"resonance_khz\":65,\"T\":31.0", &["period_s = \"?\""]),
    ] {
        let block = of(fields, &["/HA/one"]);
        says.iter().for_each(|says| assert!(block.contains(says), "{fields}: {block}"));
        assert!(!block.contains("time = \"T\""), "{block}");
    }
    // topics that differ in the channel have their printhead in another part
    let block = of("\"ch\":0", &["/HA/ch00", "/HA/ch01"]);
    assert!(block.contains("topic = \"/HA/*\"") && block.contains("{topic.0}"), "{block}");
}

#[test]
fn a_period_that_varies_between_messages_is_a_question() {
    let of = ChannelDescription { topic: "/HA", message_encoding: "json", schema: None };
    let message = |dt_us: f64| {
        bytes::Bytes::from(format!("{{\"adc\":{:?},\"dt_us\":{dt_us:?}}}", ring(1, 128, false)))
    };
    for (other, says) in [
        (0.5, "period_s = 5e-7  # ? dt_us of the"),
        (1.0, "period_s = \"?\"  # ? dt_us varies: 5e-7"),
    ] {
        let proposal =
            guess(&of, &[&message(0.5), &message(0.5), &message(other)], &["/HA"]).unwrap();
        assert!(proposal.toml.contains(says), "{}", proposal.toml);
        assert_eq!(proposal.open.contains(&"period_s".to_owned()), other != 0.5);
    }
}

/// The block that is proposed for JSON messages, each of these fields and of so many rings of 128 samples.
fn block_of(messages: &[(usize, &str)]) -> String {
    let of = ChannelDescription { topic: "/HA/adc", message_encoding: "json", schema: None };
    let message = |(channels, fields): &(usize, &str)| {
        bytes::Bytes::from(format!("{{\"adc\":{:?},{fields}}}", ring(*channels, 128, false)))
    };
    let messages: Vec<bytes::Bytes> = messages.iter().map(message).collect();
    let messages: Vec<&bytes::Bytes> = messages.iter().collect();
    guess(&of, &messages, &["/HA/adc", "/HB/adc"]).unwrap().toml
}

#[test]
fn the_field_that_holds_the_number_of_channels_of_all_topics_is_proposed() {
    for (messages, says) in [
        (&[(32, "\"n_ch\":32"), (16, "\"n_ch\":16")][..], "channels = \"n_ch\"  # by the samples"),
        (&[(16, "\"n_ch\":16"), (32, "\"n_ch\":32")], "channels = \"n_ch\"  # by the samples"),
        (&[(32, "\"gain\":32"), (16, "\"gain\":32")], "channels = 32 "),
        (&[(32, "\"seq\":32"), (32, "\"seq\":33")], "channels = 32 "),
        (&[(32, "\"a\":32,\"b\":32")], "channels = \"a\"  # ? or b; by the samples"),
        (&[(6, "\"ch\":6"), (6, "\"ch\":6")], "channels = \"ch\"  # by the samples"),
        (&[(6, "\"ch\":6"), (6, "\"ch\":7")], "first_channel = \"ch\""),
        (&[(1, "\"ch\":4")], "first_channel = \"ch\""),
    ] {
        let block = block_of(messages);
        assert!(block.contains(says), "{messages:?}: {block}");
        assert_eq!(block.contains("first_channel"), says.contains("first_channel"), "{block}");
    }
}

#[test]
fn numbers_that_are_dates_are_times_and_what_is_called_time_and_cannot_be_read_is_told() {
    for (fields, says) in [
        (["\"ts\":1793516400.02", "\"ts\":1793516400.04"], "time = \"ts\"  # ? by its numbers"),
        (["\"at_ms\":1793516400020", "\"at_ms\":1793516400040"], "time = \"at_ms\"  # ?"),
        (["\"serial\":1793516400", "\"serial\":1793516400"], ""),
        (["\"crc\":1793516400", "\"crc\":1293516400"], ""),
        (["\"stamp\":[1793516400,0]", "\"stamp\":[1793516400,9]"], "as stamp is number[], not ns"),
        (
            ["\"time\":\"2026-11-01 08:00:00.000\"", "\"time\":\"\""],
            "as time is text, not ns as an",
        ),
        (["\"time_source\":\"gps\"", "\"time_source\":\"gps\""], ""),
    ] {
        let block = block_of(&fields.map(|fields| (8, fields)));
        assert!(block.contains(says), "{fields:?}: {block}");
        let is_left_out = block.contains("\n# time: left out, as ");
        assert_eq!(
            (block.contains("\ntime = "), is_left_out),
            (says.starts_with("time"), says.starts_with("as")),
            "{block}"
        );
    }
}

#[test]
fn no_single_nozzle_of_an_array_of_objects_is_proposed() {
    let objects = |n: usize| {
        let one = format!("{{\"id\":1,\"adc\":{:?}}}", ring(1, 128, false));
        format!("{{\"hz\":1e6,\"nozzles\":[{}]}}", vec![one; n].join(","))
    };
    assert!(block("json", None, objects(1).into(), &["/HA"]).contains("nozzles[0].adc"));
    assert_eq!(block("json", None, objects(4).into(), &["/HA"]), "");
    let fields = |names: &[&str]| {
        let one = |name: &&str| format!("\"{name}\":{:?},", ring(1, 128, false));
        let all: String = names.iter().map(one).collect();
        block("json", None, format!("{{{all}\"hz\":1e6}}").into(), &["/HA"])
    };
    assert_eq!(fields(&["ch0", "ch1", "ch2"]), "");
    assert!(fields(&["ch0"]).contains("samples = \"ch0\""));
    assert!(fields(&["adc1", "filtered"]).contains("samples = "));
}

#[test]
fn a_proposed_block_does_not_contradict_the_message() {
    let data = (0..128).map(|i| i.to_string()).collect::<Vec<_>>().join(",");
    let of = |fields: &str| {
        block("json", None, format!("{{\"data\":[{data}],{fields}}}").into(), &["/HA/burst"])
    };
    let both = of("\"channels\":4,\"n\":32");
    assert!(both.contains("channels = \"channels\"\nsamples_per_channel = \"n\""), "{both}");
    // 32 x 8 are not 128: one of them is something else
    let odd = of("\"channels\":32,\"n\":8");
    assert!(odd.contains("channels = \"channels\"  # ?"), "{odd}");
    assert!(!odd.contains("samples_per_channel"), "{odd}");
    let columns = of("\"n\":32");
    assert!(columns.contains("channels = 4  # ?") && columns.contains("= \"n\""), "{columns}");
    let neither = of("\"channels\":5,\"n\":7");
    assert!(neither.contains("channels = \"?\"") && !neither.contains("\"n\""), "{neither}");
}
