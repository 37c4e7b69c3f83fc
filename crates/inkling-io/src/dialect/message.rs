//! A message of any encoding, and what a path finds in it: a value, or a time.
//!
//! In, from `plan.rs`: a message that `protobuf.rs`, `ros.rs` or `json.rs` took as one. Out: a
//! [`Value`], the same for all encodings; a time in ns since 1970, also where a mere number says it ([`ns_of`]).

use super::fields::{NANOSECONDS, SECONDS};
use super::json;
use super::path::FieldPath;
use super::protobuf::ProtobufMessage;
use super::ros::RosMessage;
use super::value::{Number, Value};

#[derive(Debug)]
pub enum Message {
    Protobuf(ProtobufMessage),
    Ros(RosMessage),
    Json(serde_json::Value),
}

impl Message {
    /// The value to which a path leads; `None`: the message has none there.
    pub fn find(&self, path: &FieldPath) -> Option<Value<'_>> {
        match self {
            Message::Protobuf(message) => message.find(path.steps()),
            Message::Ros(message) => message.find(path.steps()),
            Message::Json(message) => json::find(message, path.steps()),
        }
    }

    /// The first field of the message at `path` that has one of these names.
    fn first(&self, path: &FieldPath, names: &[&str]) -> Option<Value<'_>> {
        names.iter().find_map(|name| self.find(&path.child(name)))
    }

    /// What the message at `path` says that is no time.
    pub fn time_in_words(&self, path: &FieldPath) -> String {
        let word = |names: &[&str]| match self.first(path, names).and_then(|of| of.number()) {
            Some(number) => number.to_string(),
            None => "no".into(),
        };
        let (seconds, nanoseconds) = (word(&SECONDS), word(&NANOSECONDS));
        format!("{seconds} seconds and {nanoseconds} nanoseconds")
    }

    /// The time, ns since 1970, that the message at `path` says as seconds and nanoseconds.
    /// `None`: it has neither, or they are no time.
    pub fn time_ns(&self, path: &FieldPath) -> Option<i64> {
        let (seconds, nanoseconds) = (self.first(path, &SECONDS), self.first(path, &NANOSECONDS));
        if seconds.is_none() && nanoseconds.is_none() {
            return None;
        }
        let whole = |value: Option<Value>| value.map_or(Some(0), |value| value.number()?.integer());
        let nanoseconds = whole(nanoseconds).filter(|ns| (0..1_000_000_000).contains(ns))?;
        let ns = whole(seconds)?.checked_mul(1_000_000_000)?.checked_add(nanoseconds)?;
        i64::try_from(ns).ok()
    }
}

/// The time that a number means, in ns since 1970. `named`: ns of the unit that its field is named for. Else
/// whole numbers are nanoseconds and floats are seconds. Where that is far from the log time, another unit is
/// taken that is not; beside a log without dates, one that gives a date. `None`: an i64 cannot hold it.
pub fn ns_of(number: Number, named: Option<i64>, log_ns: i64) -> Option<i64> {
    let usual = named.unwrap_or(match number {
        Number::Integer(_) => 1,
        Number::Float(_) => 1_000_000_000,
    });
    // the number as ns, if its unit is `unit` ns long
    let of = |unit: i64| match number {
        Number::Integer(i) => i64::try_from(i.checked_mul(unit.into())?).ok(),
        Number::Float(x) => {
            let ns = (x * unit as f64).round();
            (ns.abs() < 9.2e18).then_some(ns as i64)
        }
    };
    let is_dated = DATED_NS.contains(&log_ns);
    let far = if is_dated { 366 * DAY_NS } else { DAY_NS };
    let is_near = |t_ns: &i64| log_ns != 0 && t_ns.abs_diff(log_ns) < far;
    let others = || UNITS.into_iter().filter_map(of);
    let dated = || [usual].into_iter().chain(UNITS).filter_map(of).find(|t| DATED_NS.contains(t));
    let usual_ns = of(usual);
    let found = usual_ns.filter(is_near).or_else(|| dated().filter(|_| !is_dated));
    found.or_else(|| others().find(is_near)).or(usual_ns)
}

/// The time that a number means that is a date, in ns since 1970; `None`: it is none. `named`: see [`ns_of`].
pub fn date_of(number: Number, named: Option<i64>) -> Option<i64> {
    ns_of(number, named, 0).filter(|t_ns| DATED_NS.contains(t_ns))
}

/// Units of times, ns.
const UNITS: [i64; 4] = [1, 1_000, 1_000_000, 1_000_000_000];
const DAY_NS: u64 = 86_400 * 1_000_000_000;
/// Times of 2000 to 2100. Numbers of such times are none of them in two units.
const DATED_NS: std::ops::Range<i64> = 946_684_800_000_000_000..4_102_444_800_000_000_000;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_of_the_unit_that_lies_near_the_log_time() {
        let log_ns = 1_793_491_200_250_000_000;
        let at = 1_793_491_200_000_000_000;
        for unit in UNITS {
            // also where the field's name does not fit, and beside a log without times
            for (log_ns, named) in [(log_ns, None), (log_ns, Some(1_000)), (0, None)] {
                let whole = Number::Integer(i128::from(at / unit));
                assert_eq!(ns_of(whole, named, log_ns), Some(at), "{unit}");
                let float = ns_of(Number::Float(at as f64 / unit as f64), named, log_ns).unwrap();
                assert!(float.abs_diff(at) < 1_000, "{unit}: {float}");
            }
        }
        // beside a log that counts from its begin, dates are such all the same
        let float = Number::Float(at as f64 / 1e9);
        assert_eq!(ns_of(float, None, 9_000_000_000), Some(at));
        assert_eq!(ns_of(Number::Integer(at.into()), None, 9_000_000_000), Some(at));
        // a clock that began at 0: as they stand, or as their field is named
        assert_eq!(ns_of(Number::Integer(5), None, 9_000_000_000), Some(5));
        assert_eq!(ns_of(Number::Integer(5_000), None, log_ns), Some(5_000));
        assert_eq!(ns_of(Number::Integer(5_000), Some(1_000), log_ns), Some(5_000_000));
        assert_eq!(ns_of(Number::Float(1.5), None, log_ns), Some(1_500_000_000));
        assert_eq!(ns_of(Number::Float(1.5), Some(1_000_000), 0), Some(1_500_000));
        assert_eq!(ns_of(Number::Float(f64::NAN), None, log_ns), None);
        assert_eq!(ns_of(Number::Integer(i128::MAX), None, log_ns), None);
    }
}
