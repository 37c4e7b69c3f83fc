use super::*;
use inkling_core::burst::{Format, Layout};

fn message() -> wire::Burst {
    wire::Burst {
        timestamp: Some(prost_types::Timestamp { seconds: 10, nanos: 5 }),
        printhead: "K1".into(),
        first_channel: 7,
        channels: 3,
        samples_per_channel: 4,
        sample_period_s: 1e-6,
        samples: (0..24).collect::<Vec<u8>>().into(),
        temperature_c: Some(30.5),
        drive_voltage_v: Some(f64::NAN),
        idle_time_s: vec![1.0, f32::NAN, 3.0],
        neighbours_fired: Bytes::from_static(&[0, 1, 2]),
        ..Default::default()
    }
}

fn unusable(acquisition: Acquisition) -> UnusableBurst {
    match acquisition {
        Acquisition::Unusable(unusable) => unusable,
        other => panic!("usable: {other:?}"),
    }
}

fn decode(message: &wire::Burst) -> Acquisition {
    decode_bytes(message.encode_to_vec().into())
}

fn decode_bytes(bytes: Bytes) -> Acquisition {
    BurstDecoder::new(Limits::default()).decode(bytes, 99, &Arc::from("topic"))
}

fn usable(acquisition: Acquisition) -> Burst {
    match acquisition {
        Acquisition::Usable(burst) => burst,
        other => panic!("unusable: {other:?}"),
    }
}

#[test]
fn a_burst_survives_encode_and_decode() {
    let signals = [vec![1.5, -2.0, 3.0], vec![0.0, 9.0, -7.0]];
    for (format, layout) in
        [(Format::S16Le, Layout::SampleMajor), (Format::F32Le, Layout::ChannelMajor)]
    {
        for t_acq_ns in [i64::MIN, -1, 0, 1_700_000_000_123_456_789, i64::MAX] {
            let burst = Burst {
                t_acq_ns,
                logged_ns: 99,
                first_channel: u32::MAX - 1,
                drive_voltage_v: Some(20.0),
                idle_time_s: vec![0.5],
                neighbours_fired: Bytes::from_static(&[1, 2]),
                ..Burst::of(&signals, 2e-6, format, layout)
            };
            let back = usable(decode_bytes(encode(&burst).into()));
            assert_eq!(format!("{back:?}"), format!("{burst:?}"));
        }
    }
}

#[test]
fn samples_are_shared_with_the_message_not_copied() {
    let bytes = Bytes::from(message().encode_to_vec());
    let range = bytes.as_ptr_range();
    let burst = usable(decode_bytes(bytes.clone()));
    assert!(range.contains(&burst.samples.as_ptr()));
}

#[test]
fn each_reason_is_told_with_the_time_printhead_and_first_channel_of_the_burst() {
    use Reason::*;
    type Change = fn(&mut wire::Burst);
    let changes: [(Reason, Change); 17] = [
        (WrongLength, |m| m.samples = vec![0; 23].into()),
        (WrongLength, |m| m.samples = Bytes::new()),
        (WrongLength, |m| m.samples_per_channel = 0),
        (WrongLength, |m| m.format = 1),
        (UnknownFormat, |m| m.format = 2),
        (UnknownFormat, |m| m.format = -1),
        (UnknownLayout, |m| m.layout = 9),
        (NoChannels, |m| m.channels = 0),
        (BadPeriod, |m| m.sample_period_s = 0.0),
        (BadPeriod, |m| m.sample_period_s = -1.0),
        (BadPeriod, |m| m.sample_period_s = f64::NAN),
        (BadPeriod, |m| m.sample_period_s = f64::INFINITY),
        (TooLarge, |m| m.channels = 65_537),
        (TooLarge, |m| m.samples_per_channel = 65_537),
        (TooLarge, |m| (m.channels, m.samples_per_channel) = (65_536, 65_536)),
        (TooLarge, |m| m.channels = u32::MAX),
        (TooLarge, |m| m.first_channel = u32::MAX - 1),
    ];
    for (reason, change) in changes {
        let mut message = message();
        change(&mut message);
        let unusable = unusable(decode(&message));
        assert_eq!(unusable.why, reason);
        assert_eq!((unusable.t_acq_ns, &*unusable.printhead), (10_000_000_005, "K1"));
        assert_eq!(unusable.first_channel, message.first_channel);
    }
    let named = |bytes| wire::Burst { printhead: "x".repeat(bytes), ..message() };
    assert_eq!(usable(decode(&named(1024))).printhead.len(), 1024);
    assert_eq!(unusable(decode(&named(1025))).why, TooLarge);
}

#[test]
fn what_cannot_be_decoded_has_the_log_time_and_the_topics_printhead() {
    let timestamp = |seconds, nanos| Some(prost_types::Timestamp { seconds, nanos });
    for t in [None, timestamp(i64::MAX, 0), timestamp(1, -1), timestamp(1, 1_000_000_000)] {
        let unusable = unusable(decode(&wire::Burst { timestamp: t, ..message() }));
        assert_eq!(unusable.why, Reason::Undecodable);
        assert_eq!((unusable.t_acq_ns, &*unusable.printhead), (99, "topic"));
    }
    let whole = message().encode_to_vec();
    for cut in 1..whole.len() {
        // A cut at a field's end is a valid shorter message; it must still give one row or a burst.
        assert!(decode_bytes(Bytes::copy_from_slice(&whole[..cut])).rows() >= 1);
    }
    let garbage = unusable(decode_bytes(Bytes::from_static(&[0xff; 40])));
    assert_eq!((garbage.why, garbage.t_acq_ns), (Reason::Undecodable, 99));
}

#[test]
fn covariates_that_fit_no_channel_count_are_not_recorded_and_nan_is_none() {
    let burst = usable(decode(&message()));
    assert_eq!((burst.temperature_c, burst.drive_voltage_v), (Some(30.5), None));
    assert_eq!((burst.idle_time_s.len(), burst.neighbours_fired.len()), (3, 3));
    let (idle_time_s, neighbours_fired) = (vec![1.0; 2], vec![1; 4].into());
    let odd = wire::Burst { idle_time_s, neighbours_fired, ..message() };
    let burst = usable(decode(&odd));
    assert!(burst.idle_time_s.is_empty() && burst.neighbours_fired.is_empty());
}

#[test]
fn a_message_leaves_nothing_behind_in_the_next() {
    let mut decoder = BurstDecoder::new(Limits::default());
    let topic = Arc::from("");
    decoder.decode(message().encode_to_vec().into(), 0, &topic);
    let bare = wire::Burst {
        timestamp: Some(Default::default()),
        channels: 1,
        samples_per_channel: 1,
        sample_period_s: 1.0,
        samples: vec![1, 2].into(),
        ..Default::default()
    };
    let burst = usable(decoder.decode(bare.encode_to_vec().into(), 0, &topic));
    assert_eq!((&*burst.printhead, burst.first_channel), ("", 0));
    assert!(burst.temperature_c.is_none() && burst.idle_time_s.is_empty());
}

#[test]
fn a_name_that_repeats_is_one_allocation_and_many_names_stay_bounded() {
    let mut names = PrintheadNames::default();
    let a = names.intern("a");
    assert!(Arc::ptr_eq(&a, &names.intern("a")));
    for i in 0..10_000 {
        assert_eq!(&*names.intern(&i.to_string()), i.to_string());
    }
    names.intern(&"x".repeat(1 << 20));
    assert!(names.0.len() <= PrintheadNames::NAMES);
    assert!(names.0.iter().all(|n| n.len() <= PrintheadNames::NAME_BYTES));
}

#[test]
fn topics_and_printheads_are_each_others_inverse() {
    assert_eq!(topic_printhead(&topic("K/1")), Some("K/1"));
    assert_eq!(topic_printhead("/camera"), None);
}
