//! Recordings as others write them: schemas and messages made by hand here, nothing of the reader's.

use inkling::burst::{Burst, Format, Layout};
use mcap::records::MessageHeader;
use prost::Message as _;
use prost::encoding::{bytes, double, fixed32, float, int64, sint32, string, uint32};
use std::io::Cursor;
use std::path::Path;

/// Of one kind of message.
pub struct Written {
    pub schema_name: &'static str,
    pub schema_encoding: &'static str,
    pub schema: Vec<u8>,
    pub message_encoding: &'static str,
    pub encode: fn(&Burst) -> Vec<u8>,
}

/// A recording in the making.
pub struct Messages(mcap::Writer<Cursor<Vec<u8>>>);

impl Default for Messages {
    fn default() -> Messages {
        Messages::new(Default::default())
    }
}

impl Messages {
    pub fn new(options: mcap::WriteOptions) -> Messages {
        Messages(options.create(Cursor::default()).unwrap())
    }

    /// A message of a kind: its topic, its time, what it holds.
    pub fn add(&mut self, by: &Written, topic: &str, log_time: u64, message: &[u8]) {
        let schema = match by.schema_name {
            "" => 0,
            name => self.0.add_schema(name, by.schema_encoding, &by.schema).unwrap(),
        };
        let none = Default::default();
        let channel_id = self.0.add_channel(schema, topic, by.message_encoding, &none).unwrap();
        let header = MessageHeader { channel_id, sequence: 0, log_time, publish_time: 2 };
        self.0.write_to_known_channel(&header, message).unwrap();
    }

    /// `/heads/<printhead>/burst`, from time 2 on.
    pub fn add_bursts(&mut self, by: &Written, bursts: &[Burst]) {
        for (burst, log_time) in bursts.iter().zip(2..) {
            let topic = format!("/heads/{}/burst", burst.printhead);
            self.add(by, &topic, log_time, &(by.encode)(burst));
        }
    }

    pub fn finish(mut self) -> Vec<u8> {
        self.0.finish().unwrap();
        self.0.into_inner().into_inner()
    }
}

/// Bursts beside a topic of something else.
pub fn write(path: &Path, bursts: &[Burst], by: &Written) {
    let mut messages = Messages::default();
    messages.add(&json(), "/log", 1, b"{\"text\":\"hello\"}");
    messages.add_bursts(by, bursts);
    std::fs::write(path, messages.finish()).unwrap();
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
    int64::encode(1, &sec, &mut stamp);
    uint32::encode(2, &(nanosec as u32), &mut stamp);
    let mut head = Vec::new();
    string::encode(2, &burst.printhead.to_string(), &mut head);
    bytes::encode(1, &stamp, &mut head);
    let mut data = Vec::new();
    match samples {
        Samples::Bytes => bytes::encode(2, &burst.samples, &mut data),
        Samples::Packed => {
            let counts: Vec<i32> = int16(burst).into_iter().map(i32::from).collect();
            sint32::encode_packed(3, &counts, &mut data);
        }
        Samples::Floats => {
            // in two parts, and one number by itself: all are one array
            let all: Vec<f32> = int16(burst).into_iter().map(f32::from).collect();
            float::encode_packed(4, &all[..7], &mut data);
            float::encode(4, &all[7], &mut data);
            float::encode_packed(4, &all[8..], &mut data);
        }
    }
    uint32::encode(1, &burst.samples_per_channel, &mut data);
    uint32::encode(5, &burst.channels, &mut data);
    let mut out = Vec::new();
    bytes::encode(3, &data, &mut out);
    bytes::encode(3, &vec![2 << 3 | 2, 2, 9, 9, 1 << 3, 5], &mut out); // waves[1]: not the one
    bytes::encode(99, &b"of a later version".to_vec(), &mut out);
    bytes::encode(1, &head, &mut out);
    double::encode(8, &burst.sample_period_s, &mut out);
    burst.temperature_c.iter().for_each(|t| double::encode(9, t, &mut out));
    fixed32::encode(10, &burst.first_channel, &mut out);
    float::encode_packed(11, &burst.idle_time_s, &mut out);
    volts(burst).iter().for_each(|v| float::encode(12, v, &mut out));
    bytes::encode(13, &burst.neighbours_fired, &mut out);
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

/// Fields one after the other behind the header of CDR, aligned, in either order of bytes.
struct Out {
    bytes: Vec<u8>,
    big: bool,
}

impl Out {
    fn put<const N: usize>(&mut self, le: [u8; N]) {
        while !(self.bytes.len() - 4).is_multiple_of(N) {
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
        self.count(text.len() + 1);
        self.bytes.extend(text.as_bytes());
        self.bytes.push(0);
    }
}

fn ros(burst: &Burst, big: bool) -> Vec<u8> {
    // the second byte of the header tells the order of bytes
    let mut out = Out { bytes: vec![0, u8::from(!big), 0, 0], big };
    let (sec, nanosec) = seconds(burst);
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

pub fn ros2(big: bool) -> Written {
    Written {
        schema_name: "acme_msgs/msg/Waves",
        schema_encoding: "ros2msg",
        schema: ROS2.into(),
        message_encoding: "cdr",
        encode: match big {
            true => |burst| ros(burst, true),
            false => |burst| ros(burst, false),
        },
    }
}
