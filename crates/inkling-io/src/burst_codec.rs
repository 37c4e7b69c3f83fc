//! Decodes messages of schema `inkling.Burst` (`schemas/burst.proto`, protobuf) into bursts, and
//! encodes bursts as such messages. It opens no file: `block_reader.rs` calls the decoder for each
//! message, and the writers of recordings call [`encode`].
//!
//! In: a message's bytes, its log time (ns since 1970), and the printhead that its topic names.
//! Out: an [`Acquisition`]: a burst (channels x samples of int16 or f32 counts) whose samples are a
//! slice of the message's bytes and no copy, or an unusable burst with the reason, which becomes
//! one rejected row. It never fails otherwise.
//!
//! The steps of [`BurstDecoder::decode`]: parse the message; take first channel, time and name into
//! a head that stays even if a later step fails; then check (`checked`) that the numbers fit each other,
//! the limits and the length of the samples. `dialect::decoder` makes bursts of other loggers'
//! messages with the same head, check and reasons.

use super::Limits;
use bytes::Bytes;
use inkling_core::burst::{Acquisition, Burst, UnusableBurst};
use inkling_core::verdict::Reason;
use prost::Message as _;
use std::collections::HashSet;
use std::sync::Arc;

/// Generated from `schemas/burst.proto` (`tests/wire.rs`).
mod wire {
    #![allow(clippy::all, missing_docs)]
    include!("wire/burst.rs");
}

/// The schema as every recording that we write carries it: the compiled `schemas/burst.proto`, with the
/// schema of Timestamp that it imports.
pub const FILE_DESCRIPTOR_SET: &[u8] = include_bytes!("wire/burst.fds");
pub const SCHEMA_NAME: &str = "inkling.Burst";
pub const MESSAGE_ENCODING: &str = "protobuf";

/// Longest name of a printhead; a burst with a longer one is `too_large`.
const MOST_NAME_BYTES: usize = 1024;

/// The topic of a printhead's bursts, by convention.
pub fn topic(printhead: &str) -> String {
    format!("/printhead/{printhead}/bursts")
}

/// The printhead that a topic names, if it follows the convention.
pub fn topic_printhead(topic: &str) -> Option<&str> {
    topic.strip_prefix("/printhead/")?.strip_suffix("/bursts")
}

/// Why a message is no burst.
pub(super) struct NoBurst {
    pub why: Reason,
    /// What is wrong, with field and value, where it could not be decoded; else empty.
    pub what: String,
}

impl NoBurst {
    pub fn undecodable(what: impl Into<String>) -> NoBurst {
        NoBurst { why: Reason::Undecodable, what: what.into() }
    }
}

impl From<Reason> for NoBurst {
    fn from(why: Reason) -> NoBurst {
        NoBurst { why, what: String::new() }
    }
}

#[derive(Debug)]
pub struct BurstDecoder {
    limits: Limits,
    message: wire::Burst,
    names: PrintheadNames,
}

/// The head of a burst before anything of its message was read: the log time stands for its time,
/// the topic's printhead for its name, and channel 0 for the first channel.
pub(super) fn unread(log_time_ns: i64, topic_printhead: &Arc<str>, why: Reason) -> UnusableBurst {
    let printhead = topic_printhead.clone();
    let t_acq_ns = log_time_ns;
    UnusableBurst { t_acq_ns, printhead, first_channel: 0, why, what: String::new() }
}

/// Puts the printhead that a message names into the head. An empty name, or one longer than
/// `MOST_NAME_BYTES` (an error), leaves the topic's printhead there.
pub(super) fn take_name(
    head: &mut UnusableBurst,
    name: &str,
    names: &mut PrintheadNames,
) -> Result<(), Reason> {
    if name.len() > MOST_NAME_BYTES {
        return Err(Reason::TooLarge);
    }
    if !name.is_empty() {
        head.printhead = names.intern(name);
    }
    Ok(())
}

impl BurstDecoder {
    pub fn new(limits: Limits) -> BurstDecoder {
        BurstDecoder { limits, message: wire::Burst::default(), names: PrintheadNames::default() }
    }

    /// The samples are not copied. `log_time_ns` and `topic_printhead` are used where the message
    /// does not tell its own. Where several things are wrong, the reason is the first of:
    /// undecodable, too_large (the printhead's name), unknown_format, unknown_layout, no_channels,
    /// bad_period, too_large (the numbers), wrong_length.
    pub fn decode(
        &mut self,
        message: Bytes,
        log_time_ns: i64,
        topic_printhead: &Arc<str>,
    ) -> Acquisition {
        let mut head = unread(log_time_ns, topic_printhead, Reason::Undecodable);
        let burst = self.burst(message, log_time_ns, &mut head);
        acquisition(burst, head)
    }

    fn burst(
        &mut self,
        message: Bytes,
        logged_ns: i64,
        head: &mut UnusableBurst,
    ) -> Result<Burst, NoBurst> {
        self.message.clear();
        self.message.merge(message).map_err(|e| NoBurst::undecodable(e.to_string()))?;
        let message = &mut self.message;
        head.first_channel = message.first_channel;
        // Without a time a burst has no place among the others, so it counts as undecodable.
        let stamp = message.timestamp.ok_or_else(|| NoBurst::undecodable("it has no timestamp"))?;
        head.t_acq_ns = nanoseconds(&stamp).ok_or_else(|| {
            let prost_types::Timestamp { seconds, nanos } = stamp;
            NoBurst::undecodable(format!("timestamp: {seconds} s and {nanos} ns are no time"))
        })?;
        take_name(head, &message.printhead, &mut self.names)?;

        let format = message.format.try_into().map_err(|_| Reason::UnknownFormat)?;
        let layout = message.layout.try_into().map_err(|_| Reason::UnknownLayout)?;
        let burst = Burst {
            t_acq_ns: head.t_acq_ns,
            logged_ns,
            topic: 0,
            printhead: head.printhead.clone(),
            first_channel: message.first_channel,
            channels: message.channels,
            samples_per_channel: message.samples_per_channel,
            sample_period_s: message.sample_period_s,
            format,
            layout,
            samples: std::mem::take(&mut message.samples),
            temperature_c: message.temperature_c.filter(|t| t.is_finite()),
            drive_voltage_v: message.drive_voltage_v.filter(|v| v.is_finite()),
            idle_time_s: std::mem::take(&mut message.idle_time_s),
            neighbours_fired: std::mem::take(&mut message.neighbours_fired),
        };
        checked(burst, &self.limits)
    }
}

/// What became of a message of which `head` was read first.
pub(super) fn acquisition(read: Result<Burst, NoBurst>, head: UnusableBurst) -> Acquisition {
    match read {
        Ok(burst) => Acquisition::Usable(burst),
        Err(NoBurst { why, what }) => Acquisition::Unusable(UnusableBurst { why, what, ..head }),
    }
}

/// Checks that the numbers of a burst fit each other, its samples and the limits, before anything
/// else looks at the samples. Covariates of the wrong number belong to no channel: they are dropped, the burst stays.
pub(super) fn checked(mut of: Burst, limits: &Limits) -> Result<Burst, NoBurst> {
    let Burst { channels, samples_per_channel, sample_period_s, .. } = of;
    if of.channels == 0 {
        return Err(Reason::NoChannels.into());
    }
    if !(of.sample_period_s.is_finite() && of.sample_period_s > 0.0) {
        let what = format!("its sample period is {sample_period_s} s");
        return Err(NoBurst { why: Reason::BadPeriod, what });
    }
    // u128: the product of three claimed numbers must not overflow
    let samples = u64::from(of.channels) * u64::from(of.samples_per_channel);
    let bytes = u128::from(samples) * of.format.bytes() as u128;
    // the last one: the number of the last channel must be a u32, too
    if of.channels > limits.channels
        || of.samples_per_channel > limits.samples_per_channel
        || bytes > u128::from(limits.samples_bytes)
        || of.first_channel.checked_add(of.channels - 1).is_none()
    {
        let what = format!("it says {channels} channels of {samples_per_channel} samples");
        return Err(NoBurst { why: Reason::TooLarge, what });
    }
    if of.samples_per_channel == 0 || bytes != of.samples.len() as u128 {
        let there = of.samples.len() / of.format.bytes();
        let what = format!(
            "it has {there} samples, and says {channels} channels of {samples_per_channel}"
        );
        return Err(NoBurst { why: Reason::WrongLength, what });
    }
    // one idle time is that of all channels
    if ![1, channels as usize].contains(&of.idle_time_s.len()) {
        of.idle_time_s.clear();
    }
    if of.neighbours_fired.len() != channels as usize {
        of.neighbours_fired.clear();
    }
    Ok(of)
}

/// A time in ns since the epoch, UTC; `None` if an i64 does not hold it (before 1677 or after 2262), or if
/// the nanoseconds within its second are not between 0 and 999 999 999.
fn nanoseconds(t: &prost_types::Timestamp) -> Option<i64> {
    let nanos = u32::try_from(t.nanos).ok().filter(|&n| n < 1_000_000_000)?;
    // In i128: the second in which the earliest times of an i64 lie begins before that range.
    i64::try_from(i128::from(t.seconds) * 1_000_000_000 + i128::from(nanos)).ok()
}

/// A time in ns since the epoch as whole seconds, rounded down, and the nanoseconds beyond them.
pub(super) fn timestamp(t_ns: i64) -> prost_types::Timestamp {
    prost_types::Timestamp {
        seconds: t_ns.div_euclid(1_000_000_000),
        nanos: t_ns.rem_euclid(1_000_000_000) as i32,
    }
}

/// The message of a burst, in protobuf. Equal bursts give equal bytes.
pub fn encode(burst: &Burst) -> Vec<u8> {
    let message = wire::Burst {
        timestamp: Some(timestamp(burst.t_acq_ns)),
        printhead: burst.printhead.to_string(),
        first_channel: burst.first_channel,
        channels: burst.channels,
        samples_per_channel: burst.samples_per_channel,
        sample_period_s: burst.sample_period_s,
        format: burst.format as i32,
        layout: burst.layout as i32,
        samples: burst.samples.clone(),
        temperature_c: burst.temperature_c,
        drive_voltage_v: burst.drive_voltage_v,
        idle_time_s: burst.idle_time_s.clone(),
        neighbours_fired: burst.neighbours_fired.clone(),
    };
    message.encode_to_vec()
}

/// Printhead names that were seen, so that a name that repeats is allocated once. Names longer than
/// `NAME_BYTES` are never kept, and all are forgotten when `NAMES` are kept and another comes, so
/// that a hostile recording costs time and no memory.
#[derive(Debug, Default)]
pub(super) struct PrintheadNames(HashSet<Arc<str>>);

impl PrintheadNames {
    const NAMES: usize = 64;
    const NAME_BYTES: usize = 256;

    fn intern(&mut self, name: &str) -> Arc<str> {
        if let Some(known) = self.0.get(name) {
            return known.clone();
        }
        let new: Arc<str> = Arc::from(name);
        if name.len() <= Self::NAME_BYTES {
            if self.0.len() >= Self::NAMES {
                self.0.clear();
            }
            self.0.insert(new.clone());
        }
        new
    }
}

#[cfg(test)]
mod tests;
