//! Reads JSON messages, which `serde_json` decodes, and lists the fields of a message for errors and
//! proposals.
//!
//! In, from `plan.rs`: a message ([`decode`]), and the paths that are wanted of it ([`find`]). Out:
//! [`Value`]s. JSON has no schema, so what kind a field is shows only in a message ([`field`]).
//!
//! `serde_json` keeps each number as a value of 32 bytes, where the message has two. So the values of
//! a message are counted before it is decoded, and one of more than [`MOST_VALUES`] is `too_large`.
//! A text, also one of samples in base64, is one value whatever its length.

use super::fields::{FieldInfo, Kind, MOST_DEPTH, MOST_FIELDS, NANOSECONDS, SECONDS};
use super::path::{FieldPath, Step};
use super::value::{Gathered, Number, Value};
use inkling_core::verdict::Reason;
use serde_json::Value as Json;

/// Most values of a message: decoded they take 130 MiB, and up to 200 MiB while their list grows.
pub const MOST_VALUES: usize = 1 << 22;
/// A list counts as so many values: it takes room for four as soon as it has one.
const VALUES_OF_A_LIST: usize = 4;
/// An object counts as so many values: even with a single field it takes a node of a tree, of some
/// 700 bytes.
const VALUES_OF_AN_OBJECT: usize = 16;

pub fn decode(message: &[u8]) -> Result<Json, Reason> {
    if most_values(message) > MOST_VALUES {
        return Err(Reason::TooLarge);
    }
    let decoded = serde_json::from_slice(message);
    let decoded = decoded.or_else(|_| serde_json::from_slice(&with_nulls(message)));
    decoded.map_err(|_| Reason::Undecodable)
}

/// The most values that a message can hold, without looking where its texts are: one stands behind
/// each comma. A member of an object has a name, which counts as two.
fn most_values(message: &[u8]) -> usize {
    let weight = |byte: &u8| match byte {
        b',' => 1,
        b'[' => VALUES_OF_A_LIST,
        b':' => 2,
        b'{' => VALUES_OF_AN_OBJECT,
        _ => 0,
    };
    message.iter().map(weight).sum()
}

/// The message with `null` for each number that is not finite. JSON has no words for these, and
/// writers write them all the same (`NaN`, `-Infinity`, `1e400`). A sample that is `null` costs its
/// channel alone, where a message that is no JSON costs them all.
fn with_nulls(message: &[u8]) -> Vec<u8> {
    let is_of_word = |byte: &u8| byte.is_ascii_alphanumeric() || b"+-.".contains(byte);
    let (mut out, mut rest) = (Vec::with_capacity(message.len()), message);
    while let Some(first) = rest.first() {
        let end = match first {
            b'"' => end_of_text(rest),
            _ => rest.iter().position(|byte| !is_of_word(byte)).unwrap_or(rest.len()).max(1),
        };
        let (token, behind) = rest.split_at(end);
        let number = str::from_utf8(token).ok().and_then(|token| token.parse::<f64>().ok());
        let is_finite = number.is_none_or(f64::is_finite);
        out.extend_from_slice(if is_finite { token } else { b"null" });
        rest = behind;
    }
    out
}

/// The number of bytes of the quoted text that begins here, with its quotes.
fn end_of_text(quoted: &[u8]) -> usize {
    let mut is_escaped = false;
    let closes = |byte: &u8| {
        let closes = *byte == b'"' && !is_escaped;
        is_escaped = *byte == b'\\' && !is_escaped;
        closes
    };
    quoted[1..].iter().position(closes).map_or(quoted.len(), |at| at + 2)
}

/// The value to which a path leads. `None`: the message has none, or `null`, or an array that ends
/// before it.
pub fn find<'m>(message: &'m Json, path: &[Step]) -> Option<Value<'m>> {
    Some(match at(message, path)? {
        Json::Null => return None,
        Json::Number(of) => Value::Number(number(of)),
        Json::String(text) => Value::Text(text),
        Json::Array(all) => numbers(all),
        Json::Bool(_) | Json::Object(_) => Value::Other,
    })
}

fn at<'m>(message: &'m Json, path: &[Step]) -> Option<&'m Json> {
    path.iter().try_fold(message, |message, step| {
        let field = message.get(&step.name)?;
        match step.index {
            Some(index) => field.get(index as usize),
            None => Some(field),
        }
    })
}

fn number(of: &serde_json::Number) -> Number {
    let whole = of.as_i64().map(i128::from).or_else(|| of.as_u64().map(i128::from));
    whole.map_or_else(|| Number::Float(of.as_f64().unwrap_or(f64::NAN)), Number::Integer)
}

/// The numbers of an array, or of an array of rows of numbers, all equally long. A row that is `null` has no
/// numbers: that costs its channel alone.
fn numbers(all: &[Json]) -> Value<'_> {
    let gathered = match all.iter().find_map(Json::as_array) {
        Some(first) => {
            let missing = vec![Json::Null; first.len()];
            let row = |row| match row {
                &Json::Null => Some(&missing),
                row => row.as_array().filter(|row| row.len() == first.len()),
            };
            let rows: Option<Vec<_>> = all.iter().map(row).collect();
            rows.and_then(|rows| Gathered::of(rows.into_iter().flatten().map(float)))
        }
        None => Gathered::of(all.iter().map(float)),
    };
    gathered.map_or(Value::Other, Value::Numbers)
}

/// A number of an array. Where JSON has no number, `null` or a text is not-a-number.
fn float(of: &Json) -> Option<f64> {
    match of {
        Json::Null => Some(f64::NAN),
        Json::Number(of) => of.as_f64(),
        Json::String(text) => text.parse().ok(),
        _ => None,
    }
}

/// The field to which a path leads in a message; an error if the message has none there.
pub fn field(message: &Json, path: &FieldPath) -> Result<FieldInfo, String> {
    let found = at(message, path.steps()).filter(|found| !found.is_null());
    let found = found.ok_or("not in its first message")?;
    Ok(info(found, path.to_string()))
}

/// The fields that a message has.
pub fn fields(message: &Json) -> Vec<FieldInfo> {
    let mut found = Vec::new();
    list(message, String::new(), 0, &mut found);
    found
}

fn list(value: &Json, path: String, depth: usize, found: &mut Vec<FieldInfo>) {
    if found.len() >= MOST_FIELDS || depth > MOST_DEPTH {
        return;
    }
    let info = info(value, path);
    match value {
        Json::Object(fields) if info.kind == Kind::Message => {
            let dot = if info.path.is_empty() { "" } else { "." };
            for (name, value) in fields {
                list(value, format!("{}{dot}{name}", info.path), depth + 1, found);
            }
        }
        Json::Array(all) if !info.is_numbers() => {
            if let Some(first) = all.first() {
                list(first, format!("{}[0]", info.path), depth + 1, found);
            }
        }
        _ => found.push(info),
    }
}

/// What a value is, as a schema would say it.
fn info(value: &Json, path: String) -> FieldInfo {
    let (kind, type_name) = match value {
        Json::Object(fields) => {
            let has = |names: &[&str]| names.iter().any(|name| fields.contains_key(*name));
            match has(&SECONDS) && has(&NANOSECONDS) {
                true => (Kind::Time, "time"),
                false => (Kind::Message, "object"),
            }
        }
        Json::Array(all) => {
            let (kind, type_name) = match all.first() {
                Some(Json::Array(_)) => (Kind::Float, "number[]"),
                Some(first) if float(first).is_none() => (Kind::Message, "value"),
                _ => (Kind::Float, "number"),
            };
            let rows = matches!(all.first(), Some(Json::Array(_))).then_some(all.len());
            return FieldInfo { rows, ..FieldInfo::new(path, kind, true, type_name) };
        }
        Json::Number(n) if n.is_f64() => (Kind::Float, "number"),
        Json::Number(_) => (Kind::Integer, "whole number"),
        // many writers make texts of integers of 64 bits and of not-a-number, and all of bytes
        Json::String(text) if text.parse::<i64>().is_ok() => (Kind::Integer, "text"),
        Json::String(text) if text.parse::<f64>().is_ok() => (Kind::Float, "text"),
        Json::String(text) if is_time(text) => (Kind::Time, "text"),
        Json::String(text) if long_base64(text) => (Kind::Bytes, "base64"),
        Json::String(_) => (Kind::Text, "text"),
        Json::Bool(_) => (Kind::Bool, "true or false"),
        Json::Null => (Kind::Text, "null"),
    };
    FieldInfo::new(path, kind, false, type_name)
}

/// Whether a text is a time: RFC 3339 with a zone.
fn is_time(text: &str) -> bool {
    chrono::DateTime::parse_from_rfc3339(text).is_ok()
}

/// Whether a text is so long and of such characters that it may be samples in base64.
fn long_base64(text: &str) -> bool {
    text.len() >= 64
        && text.len().is_multiple_of(4)
        && text.bytes().all(|b| b.is_ascii_alphanumeric() || b"+/=".contains(&b))
}

#[cfg(test)]
mod tests {
    use super::super::value;
    use super::*;

    #[test]
    fn what_is_not_finite_is_null_and_texts_stay() {
        let message = br#"{"a\"NaN":[NaN,-Infinity,1e400,-1.5e3,"NaN, \\",null],"b":Infinity}"#;
        let found = decode(message).unwrap();
        let expected = r#"{"a\"NaN":[null,null,null,-1500.0,"NaN, \\",null],"b":null}"#;
        assert_eq!(found, serde_json::from_str::<Json>(expected).unwrap());
        for message in
            ["", "{", "{\"a\":NaN,}", "{\"a\":nothing}", "\"NaN", "{\"a\":\"\\", "NaN NaN"]
        {
            assert_eq!(decode(message.as_bytes()), Err(Reason::Undecodable), "{message}");
        }
    }

    #[test]
    fn whole_numbers_stay_exact_and_texts_may_be_numbers() {
        let message = decode(br#"{"a":[{"t":1793491200250000001},{"t":"18446744073709551615"}]}"#);
        let message = message.unwrap();
        let number = |path: &str| {
            let path = FieldPath::try_from(path.to_owned()).unwrap();
            find(&message, path.steps()).and_then(|value| value.number())
        };
        assert_eq!(number("a[0].t"), Some(Number::Integer(1_793_491_200_250_000_001)));
        assert_eq!(number("a[1].t"), Some(Number::Integer(u64::MAX.into())));
        assert_eq!(number("a[2].t"), None);
    }

    #[test]
    fn a_row_that_is_null_has_no_numbers() {
        let message = decode(br#"{"a":[null,[1,2],[3,4]]}"#).unwrap();
        let path = FieldPath::try_from("a".to_owned()).unwrap();
        let found = find(&message, path.steps()).unwrap().samples(None, 1000).unwrap();
        let numbers: Vec<f64> = value::samples(&found.bytes, found.format).collect();
        assert!(numbers[..2].iter().all(|x| x.is_nan()) && numbers[2..] == [1.0, 2.0, 3.0, 4.0]);
    }

    #[test]
    fn an_array_that_is_no_numbers_or_rows_is_no_samples() {
        for array in
            ["[1,[2]]", "[[1],2]", "[[[1]]]", "[\"]\"]", "[[\"]\"]]", "[true]", "[[1],[2,3]]"]
        {
            let message = decode(format!("{{\"a\":{array}}}").as_bytes()).unwrap();
            let path = FieldPath::try_from("a".to_owned()).unwrap();
            let samples = find(&message, path.steps()).unwrap().samples(None, 1000);
            assert!(samples.is_none(), "{array}");
        }
    }
}
