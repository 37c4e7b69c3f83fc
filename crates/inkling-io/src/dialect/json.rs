//! Reads JSON messages: walks one as text, takes the wanted values, and passes over the rest.
//! Numbers of arrays are gathered without a tree of values, so that memory stays near the message's
//! own size. Also lists the fields of a message for errors and proposals.
//!
//! In, from `plan.rs`: a message and the tree of wanted fields. Out: [`SlotValues`]. `serde_json`
//! finds where each value ends and checks that it is JSON; this file looks only into values that
//! are wanted. JSON has no schema, so what kind a field is shows only here: a field that is not
//! what the dialect says is [`ReadError::Unfit`].

use super::fields::{FieldInfo, Kind, MOST_DEPTH, MOST_FIELDS, NANOSECONDS, SECONDS};
use super::value::{Gathered, Number, ReadError, SlotValues, Value};
use super::wanted::{Slot, Then, Wanted, WantedField};
use serde::de::IgnoredAny;
use serde_json::Value as Json;

/// A larger message is not parsed to list its fields.
const MOST_SAMPLE_BYTES: usize = 8 << 20;

/// Walks one message and puts the values of wanted fields into `values`.
pub fn walk(message: &[u8], wanted: &Wanted, values: &mut SlotValues) -> Result<(), ReadError> {
    let message = message.trim_ascii();
    match message.first() {
        Some(b'{') => {}
        _ if serde_json::from_slice::<IgnoredAny>(message).is_err() => {
            return Err(ReadError::Malformed);
        }
        _ => return Err(unfit("it is no object")),
    }
    match object(message, wanted, values)? {
        [] => Ok(()),
        _ => Err(ReadError::Malformed),
    }
}

/// `text` begins with the object's opening bracket. Gives the text behind its closing bracket.
fn object<'m>(
    text: &'m [u8],
    wanted: &Wanted,
    values: &mut SlotValues,
) -> Result<&'m [u8], ReadError> {
    let mut members = Members::of(text);
    while let Some(Member { key, value }) = members.member()? {
        for field in wanted.fields.iter().filter(|field| field.at.name == key) {
            take(field, value, values)?;
        }
    }
    Ok(members.rest)
}

fn unfit(what: &str) -> ReadError {
    ReadError::Unfit(what.to_owned())
}

/// A member of an object, or an element of an array (then `key` is empty). The value is still text.
struct Member<'m> {
    key: String,
    value: &'m [u8],
}

/// The members of an object, or the elements of an array, one after the other. Each value is
/// checked to be JSON before it is given out, so that the functions below may trust its first byte
/// to say what kind of value it is.
struct Members<'m> {
    rest: &'m [u8],
    /// The closing bracket: `}` or `]`.
    end: u8,
    is_first: bool,
}

impl<'m> Members<'m> {
    fn of(text: &'m [u8]) -> Members<'m> {
        let end = if text.starts_with(b"{") { b'}' } else { b']' };
        Members { rest: &text[1..], end, is_first: true }
    }

    /// The next member. `None`: the closing bracket was met.
    fn member(&mut self) -> Result<Option<Member<'m>>, ReadError> {
        if self.passes(self.end) {
            return Ok(None);
        }
        if !std::mem::take(&mut self.is_first) && !self.passes(b',') {
            return Err(ReadError::Malformed);
        }
        let mut key = String::new();
        if self.end == b'}' {
            key = text(self.value()?)?;
            if !self.passes(b':') {
                return Err(ReadError::Malformed);
            }
        }
        Ok(Some(Member { key, value: self.value()? }))
    }

    fn passes(&mut self, byte: u8) -> bool {
        let text = self.rest.trim_ascii_start();
        let behind = text.strip_prefix(&[byte]);
        self.rest = behind.unwrap_or(text);
        behind.is_some()
    }

    fn value(&mut self) -> Result<&'m [u8], ReadError> {
        let text = self.rest.trim_ascii_start();
        // the deserializer stops behind the first value, and says where
        let mut values = serde_json::Deserializer::from_slice(text).into_iter::<IgnoredAny>();
        let Some(Ok(_)) = values.next() else { return Err(ReadError::Malformed) };
        let (value, rest) = text.split_at(values.byte_offset());
        self.rest = rest;
        Ok(value)
    }
}

impl<'m> Iterator for Members<'m> {
    type Item = Result<Member<'m>, ReadError>;

    fn next(&mut self) -> Option<Result<Member<'m>, ReadError>> {
        self.member().transpose()
    }
}

fn text(quoted: &[u8]) -> Result<String, ReadError> {
    serde_json::from_slice(quoted).map_err(|_| ReadError::Malformed)
}

/// If a dialect wants one element of an array and the array has fewer, nothing is taken; if it
/// wants one value and there are several, the message does not fit.
fn take(field: &WantedField, value: &[u8], values: &mut SlotValues) -> Result<(), ReadError> {
    let name = &field.at.name;
    let value = match (field.at.index, value[0]) {
        (None, _) => value,
        (Some(index), b'[') => match Members::of(value).nth(index as usize) {
            Some(element) => element?.value,
            None => return Ok(()),
        },
        (Some(_), b'{') => {
            let what = format!("\"{name}\" is one object where a dialect wants one of several");
            return Err(ReadError::Unfit(what));
        }
        (Some(_), _) => return Ok(()),
    };

    // the first byte says what the value is: null, an object, an array, or a single value
    match (&field.then, value[0]) {
        (_, b'n') => Ok(()), // null: not recorded
        (Then::Into(inside), b'{') => object(value, inside, values).map(drop),
        (Then::Into(_), b'[') => {
            Err(ReadError::Unfit(format!("\"{name}\" is several values where a dialect wants one")))
        }
        (Then::Into(_), _) => Ok(()),
        (Then::Take(Slot::Time), b'{') => time(value, values),
        (Then::Take(slot), _) => {
            let value = match (slot, value[0]) {
                (Slot::Samples | Slot::Idle | Slot::Neighbours, b'[') => {
                    drop(values.take(*slot)); // if the name comes twice, the last one counts
                    let mut all = values.gathered(*slot);
                    numbers(value, *slot == Slot::Samples, &mut all)?;
                    Value::Gathered(all)
                }
                _ => scalar(name, value)?,
            };
            values.set(*slot, value);
            Ok(())
        }
    }
}

/// A text or a number; anything else does not fit.
fn scalar(name: &str, value: &[u8]) -> Result<Value, ReadError> {
    let what = match value[0] {
        b'"' => return text(value).map(Value::Text),
        b'{' => "an object where a dialect wants a value",
        b'[' => "several values where a dialect wants one",
        b't' | b'f' => "true or false where a dialect wants another value",
        _ => {
            let number = str::from_utf8(value).ok().and_then(Number::parse);
            return number.map(Value::Number).ok_or(ReadError::Malformed);
        }
    };
    Err(ReadError::Unfit(format!("\"{name}\" is {what}")))
}

/// Takes a time that is an object of seconds and nanoseconds, such as `{"sec": 1, "nanosec": 2}`;
/// it fills two slots.
fn time(value: &[u8], values: &mut SlotValues) -> Result<(), ReadError> {
    for member in Members::of(value) {
        let Member { key, value } = member?;
        let slot = match key.as_str() {
            key if SECONDS.contains(&key) => Slot::Seconds,
            key if NANOSECONDS.contains(&key) => Slot::Nanoseconds,
            _ => continue,
        };
        let number = scalar(&key, value)?.number();
        let number = number.ok_or_else(|| unfit("seconds or nanoseconds that are no number"))?;
        values.set(slot, Value::Number(number));
    }
    Ok(())
}

/// Gathers an array of numbers. Samples may also be an array of rows of numbers, all equally long.
fn numbers(array: &[u8], may_have_rows: bool, all: &mut Gathered) -> Result<(), ReadError> {
    // the array is known to be JSON, so its text can be split at commas and brackets
    let inside = array.strip_prefix(b"[").and_then(|inside| inside.strip_suffix(b"]"));
    let inside =
        inside.and_then(|inside| str::from_utf8(inside).ok()).ok_or(ReadError::Malformed)?;
    let inside = inside.trim();
    if !may_have_rows || !inside.starts_with('[') {
        return row(inside, all).map(drop);
    }
    // each row ends with a bracket, and brackets cannot stand within a number
    let is_between = |c: char| c == ',' || c.is_ascii_whitespace();
    let mut length = None;
    for text in inside.split(']').map(|text| text.trim_start_matches(is_between)) {
        if text.is_empty() {
            continue; // behind the last row
        }
        let text = text.strip_prefix('[').ok_or_else(|| unfit("a value among rows of numbers"))?;
        let n = row(text, all)?;
        if length.replace(n).is_some_and(|before| before != n) {
            return Err(unfit("rows of different length"));
        }
    }
    Ok(())
}

/// Gives how many numbers there are. The text is known to be JSON, so commas only stand between values.
fn row(text: &str, all: &mut Gathered) -> Result<usize, ReadError> {
    if text.trim().is_empty() {
        return Ok(0);
    }
    let mut n = 0;
    for one in text.split([',']).map(str::trim_ascii) {
        // most samples are small whole numbers, which parse faster as i32
        let x = match (one, one.parse::<i32>()) {
            (_, Ok(whole)) => Ok(f64::from(whole)),
            ("null", _) => Ok(f64::NAN),
            // not-a-number is text in JSON
            _ => one.trim_matches('"').parse(),
        };
        all.push(x.map_err(|_| unfit("another value where a number should be"))?);
        n += 1;
    }
    Ok(n)
}

/// The fields that a message has; none if it is too large to be parsed, or no JSON.
pub fn fields(message: &[u8]) -> Vec<FieldInfo> {
    let mut found = Vec::new();
    if message.len() > MOST_SAMPLE_BYTES {
        return found;
    }
    if let Ok(value) = serde_json::from_slice(message) {
        list(&value, "", 0, &mut found);
    }
    found
}

fn list(value: &Json, path: &str, depth: usize, found: &mut Vec<FieldInfo>) {
    if found.len() >= MOST_FIELDS || depth > MOST_DEPTH {
        return;
    }
    let mut add = |kind, list, type_name: &str| {
        found.push(FieldInfo::new(path.to_owned(), kind, list, type_name));
    };
    match value {
        Json::Object(map) => {
            let has = |names: &[&str]| names.iter().any(|name| map.contains_key(*name));
            // an object with seconds and nanoseconds counts as a time, as such a message does in
            // other encodings
            if has(&SECONDS) && has(&NANOSECONDS) {
                return add(Kind::Time, false, "time");
            }
            for (key, value) in map {
                let dot = if path.is_empty() { "" } else { "." };
                list(value, &format!("{path}{dot}{key}"), depth + 1, found);
            }
        }
        Json::Array(all) => match all.first() {
            Some(Json::Number(_)) | None => add(Kind::Float, true, "number"),
            Some(Json::Array(_)) => {
                let info = FieldInfo::new(path.to_owned(), Kind::Float, true, "number[]");
                found.push(FieldInfo { rows: Some(all.len()), ..info });
            }
            Some(first) => list(first, &format!("{path}[0]"), depth + 1, found),
        },
        Json::Number(n) if n.is_f64() => add(Kind::Float, false, "number"),
        Json::Number(_) => add(Kind::Integer, false, "whole number"),
        Json::String(text) if long_base64(text) => add(Kind::Bytes, false, "base64"),
        Json::String(_) => add(Kind::Text, false, "text"),
        Json::Bool(_) => add(Kind::Bool, false, "true or false"),
        Json::Null => add(Kind::Text, false, "null"),
    }
}

/// Whether a text is so long and of such characters that it may be samples in base64.
fn long_base64(text: &str) -> bool {
    text.len() >= 64
        && text.len().is_multiple_of(4)
        && text.bytes().all(|b| b.is_ascii_alphanumeric() || b"+/=".contains(&b))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dialect::path::{FieldPath, Step};

    /// What the paths find in a message, as their slots say it.
    fn found(message: &str, paths: &[(&str, Slot)]) -> Result<SlotValues, ReadError> {
        let mut wanted = Wanted::default();
        for (path, slot) in paths {
            let path = FieldPath::try_from((*path).to_owned()).unwrap();
            wanted.want(path.steps(), *slot);
        }
        let mut values = SlotValues::new(1000);
        walk(message.as_bytes(), &wanted, &mut values).map(|()| values)
    }

    #[test]
    fn values_are_told_apart_whatever_stands_around_them() {
        let message = " {\"}\": [\"],[{\", {\"a\": {}}], \"\\u0061\\\"b\" : [1, {\"x\" : -2.5e1 } ],\n \"c\":\"\\u00b5,}\",\
            \"d\":[ [1, 2],[3 ,\"nan\"] ] , \"e\":[], \"c2\":null, \"t\":{\"sec\":\"7\",\"o\":[1],\"nanosec\":8}}\n";
        let paths = [
            ("c", Slot::Text(0)),
            ("d", Slot::Samples),
            ("e", Slot::Idle),
            ("c2", Slot::Voltage),
            ("t", Slot::Time),
            ("t.sec", Slot::FirstChannel),
        ];
        let mut values = found(message, &paths).unwrap();
        assert!(matches!(values.take(Slot::Text(0)), Some(Value::Text(text)) if text == "µ,}"));
        let samples = values.take(Slot::Samples).unwrap().floats(10);
        assert_eq!(samples[..3], [1.0, 2.0, 3.0]);
        assert!(samples.len() == 4 && samples[3].is_nan());
        assert!(values.take(Slot::Idle).unwrap().floats(10).is_empty());
        assert!(values.take(Slot::Voltage).is_none());
        for (slot, number) in [(Slot::Seconds, 7), (Slot::Nanoseconds, 8), (Slot::FirstChannel, 7)]
        {
            assert_eq!(values.number(slot), Some(Number::Integer(number)), "{slot:?}");
        }
        let mut wanted = Wanted::default();
        let at = |name: &str, index| Step { name: name.to_owned(), place: 0, index };
        wanted.want(&[at("a\"b", Some(1)), at("x", None)], Slot::Period);
        let mut values = SlotValues::new(1000);
        walk(message.as_bytes(), &wanted, &mut values).unwrap();
        assert_eq!(values.number(Slot::Period), Some(Number::Float(-25.0)));
    }

    #[test]
    fn what_is_not_what_is_wanted_is_said_and_what_is_no_json_is_malformed() {
        for array in
            ["[1,[2]]", "[[1],2]", "[[[1]]]", "[\"]\"]", "[[\"]\"]]", "[true]", "[[1],[2,3]]"]
        {
            let found = found(&format!("{{\"a\":{array}}}"), &[("a", Slot::Samples)]);
            assert!(matches!(found, Err(ReadError::Unfit(_))), "{array}");
        }
        for message in ["", "{", "{\"a\":1,}", "{\"a\":[1,]}", "{} {}", "{\"a\":01}"] {
            let found = found(message, &[("a", Slot::Period)]);
            assert!(matches!(found, Err(ReadError::Malformed)), "{message}");
        }
        assert!(matches!(found("[1]", &[("a", Slot::Period)]), Err(ReadError::Unfit(_))));
    }
}
