//! Decodes one message of another logger into a burst, by the [`Plan`] of its channel.
//!
//! In, from `block_reader.rs`: a message's bytes, its times (ns since 1970), and the plan. Out: an
//! [`Acquisition`]: a burst whose samples share the message's bytes wherever they lie in it as a
//! burst has them, or an unusable burst with the reason. A burst is checked by the same function,
//! and has the same reasons, as messages of `inkling.Burst` ([`burst_codec`]).
//!
//! Steps: the message is decoded; the printhead's name is put together; then first channel, time,
//! channels, period, samples are found, in this order; the burst is checked; last come idle times and
//! neighbours.

use super::fields::listed;
use super::message::{Message, ns_of};
use super::path::FieldPath;
use super::plan::Plan;
use super::settings::{Part, Source, TimeSource};
use super::value::{Number, Samples, Value};
use crate::Limits;
use crate::burst_codec::{self, NoBurst, PrintheadNames, take_name, unread};
use crate::printable;
use bytes::Bytes;
use inkling_core::burst::{Acquisition, Burst, Format, UnusableBurst};
use inkling_core::verdict::Reason;
use std::sync::Arc;

/// When a message was recorded (log time) and published, ns since 1970.
#[derive(Clone, Copy, Debug)]
pub struct Times {
    pub log_ns: i64,
    pub publish_ns: i64,
}

#[derive(Debug)]
pub struct DialectDecoder {
    limits: Limits,
    names: PrintheadNames,
}

impl DialectDecoder {
    pub fn new(limits: Limits) -> DialectDecoder {
        DialectDecoder { limits, names: PrintheadNames::default() }
    }

    /// Decodes one message. `topic_printhead` is the printhead that the topic names, for a message that names
    /// none. Whatever is wrong with a message, it becomes an acquisition: an unusable one with the reason.
    pub fn decode(
        &mut self,
        plan: &Plan,
        message: Bytes,
        times: Times,
        topic_printhead: &Arc<str>,
    ) -> Acquisition {
        let decoded = plan.reading.decode(&message);
        let mut head = unread(times.log_ns, topic_printhead, Reason::Undecodable);

        // the name is found first, so that a message with any later fault still counts for its printhead
        let found = decoded.as_ref().map(|message| ReadMessage { plan, message });
        let read = self.name(plan, found.as_ref().ok(), &mut head);
        let read = read.and_then(|()| match found {
            Ok(found) => self.burst(&found, times, &mut head),
            Err(why) => Err(NoBurst { why: *why, what: plan.reading.wrong(&message) }),
        });
        if matches!(&read, Err(NoBurst { why: Reason::Undecodable, .. })) {
            head.t_acq_ns = times.log_ns;
        }
        burst_codec::acquisition(read, head)
    }

    fn burst(
        &self,
        found: &ReadMessage,
        times: Times,
        head: &mut UnusableBurst,
    ) -> Result<Burst, NoBurst> {
        let dialect = &found.plan.dialect;
        head.first_channel = found.count(&dialect.first_channel)?;
        head.t_acq_ns = match &dialect.time {
            TimeSource::LogTime => times.log_ns,
            TimeSource::PublishTime => times.publish_ns,
            TimeSource::Path(path) => found.time_ns(path, times.log_ns).ok_or_else(|| {
                found.wrong(
                    path,
                    "is no time: a number, or a text with its zone such as 2025-01-01T08:00:00Z",
                )
            })?,
        };

        let channels = found.count(&dialect.channels)?;
        let sample_period_s = match (&dialect.rate_hz, &dialect.period_s) {
            (Some(rate), _) => 1.0 / found.number(rate)?.float(),
            (None, Some(period)) => found.number(period)?.float(),
            (None, None) => f64::NAN, // refused when the settings were read
        };

        let mut samples = found.samples(self.limits.samples_bytes)?;
        if let Some(offset) = &dialect.offset {
            let before = (found.count(offset)? as usize).saturating_mul(samples.format.bytes());
            samples.bytes =
                samples.bytes.get(before..).map_or(Bytes::new(), |of| samples.bytes.slice_ref(of));
        }
        let samples_per_channel = match &dialect.samples_per_channel {
            Some(source) => found.count(source)?,
            None => columns(&samples, channels)?,
        };
        if samples.too_many {
            return Err(Reason::TooLarge.into());
        }

        // neighbours are added after the check, which bounds the number of channels
        let burst = Burst {
            t_acq_ns: head.t_acq_ns,
            logged_ns: times.log_ns,
            topic: 0,
            printhead: head.printhead.clone(),
            first_channel: head.first_channel,
            channels,
            samples_per_channel,
            sample_period_s,
            format: samples.format,
            layout: dialect.layout,
            samples: samples.bytes,
            temperature_c: found.measured(dialect.temperature.as_ref()),
            drive_voltage_v: found.measured(dialect.voltage.as_ref()),
            idle_time_s: found.floats(dialect.idle.as_ref(), channels as usize),
            neighbours_fired: Bytes::new(),
        };
        let burst = burst_codec::checked(burst, &self.limits)?;
        let channels = channels as usize;
        let neighbours = found.floats(dialect.neighbours.as_ref(), channels);
        Ok(Burst { neighbours_fired: fired(&neighbours, channels), ..burst })
    }

    /// Puts the printhead's name together from literal text, parts of the topic and values of the
    /// message (`None`: it could not be decoded), and writes it into `head`.
    fn name(
        &mut self,
        plan: &Plan,
        found: Option<&ReadMessage>,
        head: &mut UnusableBurst,
    ) -> Result<(), NoBurst> {
        if let [Part::Literal(name)] = plan.name.as_slice() {
            return Ok(take_name(head, name, &mut self.names)?); // the usual case: one text for all
        }
        let mut name = String::new();
        for part in &plan.name {
            let path = match part {
                Part::Path(path) => path,
                Part::Literal(text) => {
                    name += text;
                    continue;
                }
                Part::Topic(_) => continue, // put in when the plan was made
            };
            // of a message that could not be decoded that is told
            let Some(found) = found else { return Ok(()) };
            let number = |number: Number| number.integer().map(|n| n.to_string());
            match found.message.find(path) {
                Some(Value::Text(text)) => name += text,
                Some(value) => {
                    let number = value.number().and_then(number);
                    name += &number
                        .ok_or_else(|| found.wrong(path, "is neither text nor a whole number"))?;
                }
                None => found.left_out(path, ())?,
            }
        }
        Ok(take_name(head, &name, &mut self.names)?)
    }
}

/// A decoded message with its plan.
struct ReadMessage<'a> {
    plan: &'a Plan,
    message: &'a Message,
}

impl ReadMessage<'_> {
    /// What a missing value means: zero in protobuf, which leaves out fields that are zero, and in
    /// a ROS array that ends before the element; an error in JSON.
    fn left_out<T>(&self, path: &FieldPath, zero: T) -> Result<T, NoBurst> {
        if self.plan.names_every_field() { Err(self.missing(path)) } else { Ok(zero) }
    }

    /// The error for a value that is not what it should be.
    fn wrong(&self, path: &FieldPath, what: &str) -> NoBurst {
        let is_time = matches!(&self.plan.dialect.time, TimeSource::Path(of) if of == path);
        let value = match self.message.find(path) {
            Some(Value::Number(number)) => number.to_string(),
            Some(Value::Text(text)) => format!("{:?}", printable::cell(text)),
            Some(Value::Array(_) | Value::Numbers(_)) => "an array".into(),
            Some(Value::Other) if is_time => self.message.time_in_words(path),
            Some(Value::Other) => "what it holds".into(),
            None => return self.missing(path),
        };
        NoBurst::undecodable(format!("{path}: {value} {what}"))
    }

    /// The error for a value that is needed and not there: its field may have another name.
    fn missing(&self, path: &FieldPath) -> NoBurst {
        let there = listed(&self.plan.reading.fields(self.message));
        NoBurst::undecodable(format!("{path} is not in the message; fields that exist: {there}"))
    }

    /// A constant of the dialect, or the value in the message; `None` without a source, too.
    fn value(&self, source: Option<&Source>) -> Option<Value<'_>> {
        match source? {
            Source::Constant(x) => Some(Value::Number(Number::Float(*x))),
            Source::Path(path) => self.message.find(path),
        }
    }

    /// A number that a burst must have.
    fn number(&self, source: &Source) -> Result<Number, NoBurst> {
        match source {
            Source::Constant(x) => Ok(Number::Float(*x)),
            Source::Path(path) => match self.message.find(path) {
                Some(value) => value.number().ok_or_else(|| self.wrong(path, "is no number")),
                None => self.left_out(path, Number::Integer(0)),
            },
        }
    }

    /// A whole number that a burst must have.
    fn count(&self, source: &Source) -> Result<u32, NoBurst> {
        match (self.number(source)?.integer(), source) {
            (Some(i), _) if i >= 0 => u32::try_from(i).map_err(|_| Reason::TooLarge.into()),
            (_, Source::Path(path)) => Err(self.wrong(path, "is no whole number of 0 or more")),
            (_, Source::Constant(x)) => {
                Err(NoBurst::undecodable(format!("{x} is no whole number")))
            }
        }
    }

    /// A number that a burst may have; NaN or an infinite number counts as not recorded.
    fn measured(&self, source: Option<&Source>) -> Option<f64> {
        let number = self.value(source)?.number()?;
        Some(number.float()).filter(|value| value.is_finite())
    }

    fn floats(&self, source: Option<&Source>, channels: usize) -> Vec<f32> {
        self.value(source).map_or(Vec::new(), |value| value.floats(channels))
    }

    fn samples(&self, most_bytes: u64) -> Result<Samples, NoBurst> {
        let (format, path) = (self.plan.dialect.format, &self.plan.dialect.samples);
        match self.message.find(path) {
            Some(value) => {
                let samples = value.samples(format, most_bytes);
                samples.ok_or_else(|| {
                    self.wrong(path, "is no array of numbers, nor equally long rows of them")
                })
            }
            None => {
                let format = format.unwrap_or(Format::S16Le);
                self.left_out(path, Samples { bytes: Bytes::new(), format, too_many: false })
            }
        }
    }

    /// The burst's time in ns since 1970: a number, a text (a number or RFC 3339), or a message of
    /// seconds and nanoseconds. `log_ns`: when the message was recorded, which decides on the unit of
    /// numbers. A burst without a time has no place among the others.
    fn time_ns(&self, path: &FieldPath, log_ns: i64) -> Option<i64> {
        match self.message.find(path)? {
            Value::Number(number) => ns_of(number, self.plan.time_unit_ns, log_ns),
            Value::Text(text) => match Number::parse(text) {
                Some(number) => ns_of(number, self.plan.time_unit_ns, log_ns),
                None => chrono::DateTime::parse_from_rfc3339(text).ok()?.timestamp_nanos_opt(),
            },
            Value::Other => self.message.time_ns(path),
            Value::Array(_) | Value::Numbers(_) => None,
        }
    }
}

/// The numbers of actuated neighbours as bytes, one for each channel. One number holds for all
/// channels; any other number of numbers than that of the channels belongs to none, and gives no
/// bytes.
fn fired(neighbours: &[f32], channels: usize) -> Bytes {
    let fired: Vec<u8> = match neighbours {
        [one] => vec![*one as u8; channels],
        each if each.len() == channels => each.iter().map(|n| *n as u8).collect(),
        _ => Vec::new(),
    };
    fired.into()
}

/// Samples per channel, where no field says it: as many as there are, divided by the channels.
fn columns(samples: &Samples, channels: u32) -> Result<u32, NoBurst> {
    let all = samples.bytes.len() / samples.format.bytes();
    let whole = samples.bytes.len().is_multiple_of(samples.format.bytes());
    match all.checked_div(channels as usize) {
        None => Err(Reason::NoChannels.into()),
        Some(n) if whole && n * channels as usize == all => {
            u32::try_from(n).map_err(|_| Reason::TooLarge.into())
        }
        Some(_) => {
            let what = format!("its {all} samples are no multiple of {channels} channels");
            Err(NoBurst { why: Reason::WrongLength, what })
        }
    }
}
