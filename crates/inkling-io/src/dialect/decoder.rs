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

use super::message::Message;
use super::path::FieldPath;
use super::plan::Plan;
use super::settings::{Part, Source, TimeSource};
use super::value::{Number, Samples, Value};
use crate::Limits;
use crate::burst_codec::{self, PrintheadNames, take_name, unread};
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

/// The time that a number means, in ns since 1970. Usually whole numbers are nanoseconds and floats
/// are seconds. If that gives a time over a year from the log time, the first other unit that gives
/// a nearer one is taken. `None`: an i64 cannot hold it.
fn ns_of(number: Number, log_ns: i64) -> Option<i64> {
    let (usual, others) = match number {
        Number::Integer(_) => (1, [1_000, 1_000_000, 1_000_000_000]),
        Number::Float(_) => (1_000_000_000, [1_000_000, 1_000, 1]),
    };
    // the number as ns, if its unit is `unit` ns long
    let of = |unit: i64| match number {
        Number::Integer(i) => i64::try_from(i.checked_mul(unit.into())?).ok(),
        Number::Float(x) => {
            let ns = (x * unit as f64).round();
            (ns.abs() < 9.2e18).then_some(ns as i64)
        }
    };
    let is_near = |t_ns: &i64| t_ns.abs_diff(log_ns) < YEAR_NS;
    let usual = of(usual);
    usual.filter(is_near).or_else(|| others.into_iter().filter_map(of).find(is_near)).or(usual)
}

const YEAR_NS: u64 = 366 * 86_400 * 1_000_000_000;

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
            Err(why) => Err(*why),
        });
        match read {
            Ok(burst) => Acquisition::Usable(burst),
            Err(why) => {
                if why == Reason::Undecodable {
                    head.t_acq_ns = times.log_ns;
                }
                Acquisition::Unusable(UnusableBurst { why, ..head })
            }
        }
    }

    fn burst(
        &self,
        found: &ReadMessage,
        times: Times,
        head: &mut UnusableBurst,
    ) -> Result<Burst, Reason> {
        let dialect = &found.plan.dialect;
        head.first_channel = count(found.number(&dialect.first_channel)?)?;
        head.t_acq_ns = match &dialect.time {
            TimeSource::LogTime => times.log_ns,
            TimeSource::PublishTime => times.publish_ns,
            TimeSource::Path(path) => {
                found.time_ns(path, times.log_ns).ok_or(Reason::Undecodable)?
            }
        };

        let channels = count(found.number(&dialect.channels)?)?;
        let sample_period_s = match (&dialect.rate_hz, &dialect.period_s) {
            (Some(rate), _) => 1.0 / found.number(rate)?.float(),
            (None, Some(period)) => found.number(period)?.float(),
            (None, None) => f64::NAN, // refused when the settings were read
        };

        let samples = found.samples(self.limits.samples_bytes)?;
        let samples_per_channel = match &dialect.samples_per_channel {
            Some(source) => count(found.number(source)?)?,
            None => columns(&samples, channels)?,
        };
        if samples.too_many {
            return Err(Reason::TooLarge);
        }

        // idle times and neighbours are added after the check, which bounds the number of channels
        let burst = Burst {
            t_acq_ns: head.t_acq_ns,
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
            idle_time_s: Vec::new(),
            neighbours_fired: Bytes::new(),
        };

        burst_codec::check(&burst, &self.limits)?;
        let channels = channels as usize;
        let mut idle_time_s = found.floats(dialect.idle.as_ref(), channels);
        if ![1, channels].contains(&idle_time_s.len()) {
            idle_time_s.clear(); // neither one for all nor one each: it belongs to no channel
        }
        let neighbours = found.floats(dialect.neighbours.as_ref(), channels);
        let neighbours_fired = fired(&neighbours, channels);
        Ok(Burst { idle_time_s, neighbours_fired, ..burst })
    }

    /// Puts the printhead's name together from literal text, parts of the topic and values of the
    /// message (`None`: it could not be decoded), and writes it into `head`.
    fn name(
        &mut self,
        plan: &Plan,
        found: Option<&ReadMessage>,
        head: &mut UnusableBurst,
    ) -> Result<(), Reason> {
        if let [Part::Literal(name)] = plan.name.as_slice() {
            return take_name(head, name, &mut self.names); // the usual case: one text for all
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
            let found = found.ok_or(Reason::Undecodable)?;
            match found.message.find(path) {
                Some(Value::Text(text)) => name += text,
                Some(Value::Number(number)) => {
                    name += &number.integer().ok_or(Reason::Undecodable)?.to_string();
                }
                Some(_) => return Err(Reason::Undecodable),
                None => found.left_out(())?,
            }
        }
        take_name(head, &name, &mut self.names)
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
    fn left_out<T>(&self, zero: T) -> Result<T, Reason> {
        if self.plan.names_every_field() { Err(Reason::Undecodable) } else { Ok(zero) }
    }

    /// A constant of the dialect, or the value in the message; `None` without a source, too.
    fn value(&self, source: Option<&Source>) -> Option<Value<'_>> {
        match source? {
            Source::Constant(x) => Some(Value::Number(Number::Float(*x))),
            Source::Path(path) => self.message.find(path),
        }
    }

    /// A number that a burst must have.
    fn number(&self, source: &Source) -> Result<Number, Reason> {
        match self.value(Some(source)) {
            Some(value) => value.number().ok_or(Reason::Undecodable),
            None => self.left_out(Number::Integer(0)),
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

    fn samples(&self, most_bytes: u64) -> Result<Samples, Reason> {
        let format = self.plan.dialect.format;
        match self.message.find(&self.plan.dialect.samples) {
            Some(value) => value.samples(format, most_bytes).ok_or(Reason::Undecodable),
            None => {
                let format = format.unwrap_or(Format::S16Le);
                self.left_out(Samples { bytes: Bytes::new(), format, too_many: false })
            }
        }
    }

    /// The burst's time in ns since 1970: a number, a text (a number or RFC 3339), or a message of
    /// seconds and nanoseconds. `log_ns`: when the message was recorded, which decides on the unit of
    /// numbers. A burst without a time has no place among the others.
    fn time_ns(&self, path: &FieldPath, log_ns: i64) -> Option<i64> {
        match self.message.find(path)? {
            Value::Number(number) => ns_of(number, log_ns),
            Value::Text(text) => match Number::parse(text) {
                Some(number) => ns_of(number, log_ns),
                None => chrono::DateTime::parse_from_rfc3339(text).ok()?.timestamp_nanos_opt(),
            },
            Value::Other => self.message.time_ns(self.plan.time.as_ref()?),
            Value::Array(_) | Value::Numbers(_) => None,
        }
    }
}

fn count(number: Number) -> Result<u32, Reason> {
    match number.integer() {
        Some(i) if i >= 0 => u32::try_from(i).map_err(|_| Reason::TooLarge),
        _ => Err(Reason::Undecodable),
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
fn columns(samples: &Samples, channels: u32) -> Result<u32, Reason> {
    let row = samples.format.bytes().checked_mul(channels as usize).filter(|row| *row > 0);
    let row = row.ok_or(Reason::NoChannels)?;
    match samples.bytes.len().is_multiple_of(row) {
        true => u32::try_from(samples.bytes.len() / row).map_err(|_| Reason::TooLarge),
        false => Err(Reason::WrongLength),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_of_the_unit_that_lies_near_the_log_time() {
        let log_ns = 1_793_491_200_250_000_000;
        let at = 1_793_491_200_000_000_000;
        for unit in [1, 1_000, 1_000_000, 1_000_000_000] {
            let whole = Number::Integer(i128::from(at / unit));
            assert_eq!(ns_of(whole, log_ns), Some(at), "{unit}");
            let float = ns_of(Number::Float(at as f64 / unit as f64), log_ns).unwrap();
            assert!(float.abs_diff(at) < 1_000, "{unit}: {float}");
        }
        // a clock that began at 0, and a log without times: as they stand
        assert_eq!(ns_of(Number::Integer(5), 9_000_000_000), Some(5));
        assert_eq!(ns_of(Number::Integer(5_000), log_ns), Some(5_000));
        assert_eq!(ns_of(Number::Integer(at.into()), 0), Some(at));
        assert_eq!(ns_of(Number::Float(1.5), log_ns), Some(1_500_000_000));
        assert_eq!(ns_of(Number::Float(f64::NAN), log_ns), None);
        assert_eq!(ns_of(Number::Integer(i128::MAX), log_ns), None);
    }
}
