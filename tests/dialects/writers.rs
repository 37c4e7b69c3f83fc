//! Recordings as others write them: schemas and messages made by hand here, nothing of the reader's.

use inkling::burst::{Burst, Format, Layout};
use prost::Message as _;
use std::path::Path;

/// Of one kind of message.
pub struct Written {
    pub schema_name: &'static str,
    pub schema_encoding: &'static str,
    pub schema: Vec<u8>,
    pub message_encoding: &'static str,
    pub encode: fn(&Burst) -> Vec<u8>,
}

/// `/heads/<printhead>/burst`, beside a topic of something else.
pub fn write(path: &Path, bursts: &[Burst], by: &Written) {
    let file = std::fs::File::create(path).unwrap();
    let mut writer = mcap::Writer::new(std::io::BufWriter::new(file)).unwrap();
    let schema = match by.schema_name {
        "" => 0,
        name => writer.add_schema(name, by.schema_encoding, &by.schema).unwrap(),
    };
    let none = Default::default();
    let other = writer.add_channel(0, "/log", "json", &none).unwrap();
    let mut header = mcap::records::MessageHeader {
        channel_id: other,
        sequence: 0,
        log_time: 1,
        publish_time: 2,
    };
    writer.write_to_known_channel(&header, b"{\"text\":\"hello\"}").unwrap();
    for burst in bursts {
        let topic = format!("/heads/{}/burst", burst.printhead);
        header.log_time += 1;
        header.channel_id = writer.add_channel(schema, &topic, by.message_encoding, &none).unwrap();
        writer.write_to_known_channel(&header, &(by.encode)(burst)).unwrap();
    }
    writer.finish().unwrap();
}

pub fn int16(burst: &Burst) -> Vec<i16> {
    assert_eq!((burst.format, burst.layout), (Format::S16Le, Layout::ChannelMajor));
    burst.samples.chunks(2).map(|b| i16::from_le_bytes([b[0], b[1]])).collect()
}

pub fn seconds(burst: &Burst) -> (i64, i64) {
    (burst.t_acq_ns.div_euclid(1_000_000_000), burst.t_acq_ns.rem_euclid(1_000_000_000))
}

/// f32 says it exactly.
fn volts(burst: &Burst) -> Option<f32> {
    let volts = burst.drive_voltage_v.map(|v| v as f32);
    assert!(volts.map(f64::from) == burst.drive_voltage_v);
    volts
}

/// A schema as an equipment maker might have it.
const WAVE: &str = r#"
syntax = "proto3";
package acme;
message Stamp {
  int64 sec = 1;
  uint32 nanosec = 2;
}
message Head {
  Stamp stamp = 1;
  string id = 2;
}
message Data {
  uint32 n = 1;
  bytes data = 2;
  repeated sint32 counts = 3;
  repeated float volts = 4;
  uint32 channels = 5;
}
message Wave {
  Head header = 1;
  repeated Data waves = 3;
  double period = 8;
  double temp_c = 9;
  fixed32 first = 10;
  repeated float idle = 11;
  float drive_voltage = 12;
  bytes near = 13;
}
"#;

/// As recordings carry it.
fn descriptors() -> Vec<u8> {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("wave.proto"), WAVE).unwrap();
    protox::compile([dir.path().join("wave.proto")], [dir.path()]).unwrap().encode_to_vec()
}

fn varint(mut value: u64, out: &mut Vec<u8>) {
    while value >= 0x80 {
        out.push(value as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}

fn bytes(number: u64, of: &[u8], out: &mut Vec<u8>) {
    varint(number << 3 | 2, out);
    varint(of.len() as u64, out);
    out.extend(of);
}

/// What of a wave's three kinds of samples is filled.
#[derive(Clone, Copy)]
pub enum Samples {
    Bytes,
    Packed,
    Floats,
}

fn wave(burst: &Burst, samples: Samples) -> Vec<u8> {
    let (sec, nanosec) = seconds(burst);
    let mut stamp = Vec::new();
    varint(1 << 3, &mut stamp);
    varint(sec as u64, &mut stamp);
    varint(2 << 3, &mut stamp);
    varint(nanosec as u64, &mut stamp);
    let mut head = Vec::new();
    bytes(2, burst.printhead.as_bytes(), &mut head);
    bytes(1, &stamp, &mut head);
    let mut data = Vec::new();
    match samples {
        Samples::Bytes => bytes(2, &burst.samples, &mut data),
        Samples::Packed => {
            let mut packed = Vec::new();
            for y in int16(burst) {
                varint(((i64::from(y) << 1) ^ (i64::from(y) >> 63)) as u64, &mut packed);
            }
            bytes(3, &packed, &mut data);
        }
        Samples::Floats => {
            // in two parts, and one number by itself: all are one array
            let all = int16(burst);
            let le = |of: &[i16]| -> Vec<u8> {
                of.iter().flat_map(|y| f32::from(*y).to_le_bytes()).collect()
            };
            bytes(4, &le(&all[..7]), &mut data);
            varint(4 << 3 | 5, &mut data);
            data.extend(le(&all[7..8]));
            bytes(4, &le(&all[8..]), &mut data);
        }
    }
    varint(1 << 3, &mut data);
    varint(burst.samples_per_channel.into(), &mut data);
    varint(5 << 3, &mut data);
    varint(burst.channels.into(), &mut data);
    let mut out = Vec::new();
    bytes(3, &data, &mut out);
    bytes(3, &[2 << 3 | 2, 2, 9, 9, 1 << 3, 5], &mut out); // waves[1]: not the one
    bytes(99, b"of a later version", &mut out);
    bytes(1, &head, &mut out);
    varint(8 << 3 | 1, &mut out);
    out.extend(burst.sample_period_s.to_le_bytes());
    if let Some(t) = burst.temperature_c {
        varint(9 << 3 | 1, &mut out);
        out.extend(t.to_le_bytes());
    }
    varint(10 << 3 | 5, &mut out);
    out.extend(burst.first_channel.to_le_bytes());
    let idle: Vec<u8> = burst.idle_time_s.iter().flat_map(|s| s.to_le_bytes()).collect();
    bytes(11, &idle, &mut out);
    if let Some(v) = volts(burst) {
        varint(12 << 3 | 5, &mut out);
        out.extend(v.to_le_bytes());
    }
    bytes(13, &burst.neighbours_fired, &mut out);
    out
}

pub fn protobuf(samples: Samples) -> Written {
    Written {
        schema_name: "acme.Wave",
        schema_encoding: "protobuf",
        schema: descriptors(),
        message_encoding: "protobuf",
        encode: match samples {
            Samples::Bytes => |burst| wave(burst, Samples::Bytes),
            Samples::Packed => |burst| wave(burst, Samples::Packed),
            Samples::Floats => |burst| wave(burst, Samples::Floats),
        },
    }
}

/// Channels as rows.
pub fn json() -> Written {
    let encode = |burst: &Burst| {
        let (sec, nanosec) = seconds(burst);
        let all = int16(burst);
        let rows: Vec<&[i16]> = all.chunks(burst.samples_per_channel as usize).collect();
        let idle: Vec<_> = burst
            .idle_time_s
            .iter()
            .map(|s| if s.is_nan() { serde_json::Value::Null } else { (*s).into() })
            .collect();
        let message = serde_json::json!({
            "note": {"samples": [1, 2, {"deep": [[]]}]},
            "header": {"stamp": {"sec": sec, "nanosec": nanosec}, "id": &*burst.printhead},
            "heads": [{"id": "nobody"}, {"id": &*burst.printhead, "first": burst.first_channel}],
            "samples": rows,
            "channels": burst.channels,
            "period": burst.sample_period_s,
            "temp_c": burst.temperature_c,
            "idle": idle,
            "drive_voltage": volts(burst),
            "near": burst.neighbours_fired.to_vec(),
        });
        message.to_string().into_bytes()
    };
    Written {
        schema_name: "",
        schema_encoding: "",
        schema: Vec::new(),
        message_encoding: "json",
        encode,
    }
}

const ROS2: &str = "# as rosbag2 writes it\nstd_msgs/Header header\nuint8 KIND=1\nuint32 first 0\n\
    bool ok\nWave[] waves\nfloat64 period\nfloat64[<=1] temp_c\nfloat32[] idle\nfloat32 drive_voltage\nuint8[] near\nstring tail\n\
    ================================================================================\n\
    MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n\
    ================================================================================\n\
    MSG: acme_msgs/Wave\nuint16 channels\nint16[] data\n";

const ROS1: &str = "Header header\nuint32 first\nbool ok\nWave[] waves\nfloat64 period\n\
    float64[] temp_c\nfloat32[] idle\nfloat32 drive_voltage\nuint8[] near\nstring tail\n\
    ================================================================================\n\
    MSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n\
    ================================================================================\n\
    MSG: acme_msgs/Wave\nuint16 channels\nint16[] data\n";

/// Fields one after the other, aligned or not, in either order of bytes.
struct Out {
    bytes: Vec<u8>,
    origin: usize,
    aligned: bool,
    big: bool,
}

impl Out {
    fn put<const N: usize>(&mut self, le: [u8; N]) {
        while self.aligned && !(self.bytes.len() - self.origin).is_multiple_of(N) {
            self.bytes.push(0);
        }
        match self.big {
            true => self.bytes.extend(le.iter().rev()),
            false => self.bytes.extend(le),
        }
    }

    fn count(&mut self, n: usize) {
        self.put((n as u32).to_le_bytes());
    }

    fn text(&mut self, text: &str) {
        self.count(text.len() + usize::from(self.aligned));
        self.bytes.extend(text.as_bytes());
        self.bytes.extend(self.aligned.then_some(0));
    }
}

fn ros(burst: &Burst, mut out: Out) -> Vec<u8> {
    let (sec, nanosec) = seconds(burst);
    if !out.aligned {
        out.put(7u32.to_le_bytes()); // seq
    }
    out.put((sec as u32).to_le_bytes());
    out.put((nanosec as u32).to_le_bytes());
    out.text(&burst.printhead);
    out.put(burst.first_channel.to_le_bytes());
    out.put([1]);
    out.count(2);
    out.put((burst.channels as u16).to_le_bytes());
    let all = int16(burst);
    out.count(all.len());
    all.iter().for_each(|y| out.put(y.to_le_bytes()));
    out.put(3u16.to_le_bytes()); // waves[1]: not the one
    out.count(3);
    (0..3i16).for_each(|y| out.put(y.to_le_bytes()));
    out.put(burst.sample_period_s.to_le_bytes());
    out.count(usize::from(burst.temperature_c.is_some()));
    burst.temperature_c.iter().for_each(|t| out.put(t.to_le_bytes()));
    out.count(burst.idle_time_s.len());
    burst.idle_time_s.iter().for_each(|s| out.put(s.to_le_bytes()));
    out.put(volts(burst).unwrap_or(f32::NAN).to_le_bytes());
    out.count(burst.neighbours_fired.len());
    burst.neighbours_fired.iter().for_each(|n| out.put([*n]));
    out.text("the end");
    out.bytes
}

pub fn ros1() -> Written {
    Written {
        schema_name: "acme_msgs/Waves",
        schema_encoding: "ros1msg",
        schema: ROS1.into(),
        message_encoding: "ros1",
        encode: |burst| {
            ros(burst, Out { bytes: Vec::new(), origin: 0, aligned: false, big: false })
        },
    }
}

pub fn ros2(big: bool) -> Written {
    Written {
        schema_name: "acme_msgs/msg/Waves",
        schema_encoding: "ros2msg",
        schema: ROS2.into(),
        message_encoding: "cdr",
        encode: match big {
            true => |burst| {
                ros(burst, Out { bytes: vec![0, 0, 0, 0], origin: 4, aligned: true, big: true })
            },
            false => |burst| {
                ros(burst, Out { bytes: vec![0, 1, 0, 0], origin: 4, aligned: true, big: false })
            },
        },
    }
}
