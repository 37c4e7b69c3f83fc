//! The types of columns that verdict, episode and fault tables share: times, and texts of which
//! there are few different ones.

use arrow_array::{ArrayRef, TimestampMicrosecondArray, TimestampNanosecondArray};
use arrow_schema::{DataType, TimeUnit};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// The unit of times in the tables (setting `output.timestamps`). Times come in ns since 1970, UTC.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TimestampUnit {
    #[default]
    Ns,
    /// For readers without nanoseconds (Spark). Spark's vectorised reader does not know BYTE_STREAM_SPLIT
    /// either, so with this unit floats are written plainly.
    Us,
}

impl TimestampUnit {
    /// A time in this unit, rounded towards the past.
    pub fn of_ns(self, ns: i64) -> i64 {
        match self {
            TimestampUnit::Ns => ns,
            TimestampUnit::Us => ns.div_euclid(1000),
        }
    }
}

/// The Arrow type of a column of times, UTC.
pub fn time(unit: TimestampUnit) -> DataType {
    let unit = match unit {
        TimestampUnit::Ns => TimeUnit::Nanosecond,
        TimestampUnit::Us => TimeUnit::Microsecond,
    };
    DataType::Timestamp(unit, Some("UTC".into()))
}

/// An array of times for such a column, from ns since 1970; `None` is null.
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

pub fn text() -> DataType {
    DataType::Dictionary(Box::new(DataType::Int32), Box::new(DataType::Utf8))
}
