//! Types that columns of several tables have.

use arrow_array::{ArrayRef, TimestampMicrosecondArray, TimestampNanosecondArray};
use arrow_schema::{DataType, TimeUnit};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TimestampUnit {
    #[default]
    Ns,
    /// For readers without nanoseconds (Spark); its vectorised reader does not know the float
    /// encoding of the other either, so floats are plain then.
    Us,
}

impl TimestampUnit {
    pub fn of_ns(self, ns: i64) -> i64 {
        match self {
            TimestampUnit::Ns => ns,
            TimestampUnit::Us => ns.div_euclid(1000),
        }
    }
}

/// UTC.
pub fn time(unit: TimestampUnit) -> DataType {
    let unit = match unit {
        TimestampUnit::Ns => TimeUnit::Nanosecond,
        TimestampUnit::Us => TimeUnit::Microsecond,
    };
    DataType::Timestamp(unit, Some("UTC".into()))
}

/// A column of such times.
pub fn times(ns: impl Iterator<Item = Option<i64>>, unit: TimestampUnit) -> ArrayRef {
    let times = ns.map(|ns| ns.map(|ns| unit.of_ns(ns)));
    match unit {
        TimestampUnit::Ns => {
            Arc::new(times.collect::<TimestampNanosecondArray>().with_timezone("UTC"))
        }
        TimestampUnit::Us => {
            Arc::new(times.collect::<TimestampMicrosecondArray>().with_timezone("UTC"))
        }
    }
}

/// A text of which there are few different ones.
pub fn text() -> DataType {
    DataType::Dictionary(Box::new(DataType::Int32), Box::new(DataType::Utf8))
}

#[cfg(test)]
pub mod tests {
    use super::*;
    use arrow_schema::{Field, Schema};

    /// The table of a page in `schemas/` has these columns, of these types.
    pub fn is_documented(page: &str, schema: &Schema) {
        let documented = page.lines().filter_map(|line| {
            let mut cells = line.strip_prefix("| `")?.split(" | ");
            let name = cells.next()?.trim_end_matches('`').to_string();
            Some((name, cells.next()?.to_string()))
        });
        let in_words = |field: &Field| {
            let kind = match field.data_type() {
                DataType::Timestamp(TimeUnit::Nanosecond, Some(zone)) => {
                    format!("timestamp(ns, {zone})")
                }
                DataType::Dictionary(_, of) if **of == DataType::Utf8 => {
                    "dictionary of utf8".into()
                }
                DataType::FixedSizeList(..) => "fixed-size list of float32".into(),
                plain => plain.to_string().to_lowercase(),
            };
            let nullable = if field.is_nullable() { ", nullable" } else { "" };
            (field.name().clone(), kind + nullable)
        };
        let in_code: Vec<_> = schema.fields().iter().map(|field| in_words(field)).collect();
        assert_eq!(documented.collect::<Vec<_>>(), in_code);
    }
}
