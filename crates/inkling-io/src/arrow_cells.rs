//! What others write into Arrow's arrays, as the few types that we ask for.

use arrow_array::cast::AsArray;
use arrow_array::types::{Float16Type, Float32Type, Float64Type, Int64Type};
use arrow_array::{Array, ArrayRef, downcast_integer_array, make_array};
use arrow_schema::{DataType, TimeUnit};

/// Any numeric column. Exact for what the verdict table holds: u16, u32 and f32.
pub fn numbers(column: &ArrayRef) -> Option<Vec<Option<f64>>> {
    downcast_integer_array!(
        column => Some(column.iter().map(|v| v.map(|v| v as f64)).collect()),
        DataType::Float32 => {
            Some(column.as_primitive::<Float32Type>().iter().map(|v| v.map(f64::from)).collect())
        }
        DataType::Float64 => Some(column.as_primitive::<Float64Type>().iter().collect()),
        DataType::Null => Some(vec![None; column.len()]),
        _ => None
    )
}

/// A cell as a number; NaN where it is empty. `None`: its type has none.
pub fn number(array: &ArrayRef, row: usize) -> Option<f64> {
    if array.is_null(row) {
        return Some(f64::NAN);
    }
    downcast_integer_array!(
        array => Some(array.value(row) as f64),
        DataType::Float16 => Some(array.as_primitive::<Float16Type>().value(row).to_f64()),
        DataType::Float32 => Some(array.as_primitive::<Float32Type>().value(row).into()),
        DataType::Float64 => Some(array.as_primitive::<Float64Type>().value(row)),
        _ => None
    )
}

/// How long one of a column of times or of durations lasts.
pub fn unit(of: &DataType) -> Option<TimeUnit> {
    match of {
        DataType::Timestamp(unit, _) | DataType::Duration(unit) => Some(*unit),
        _ => None,
    }
}

/// Times and durations as the whole numbers that they are; any other column as it is.
pub fn counted(column: &ArrayRef) -> ArrayRef {
    let data = || column.to_data().into_builder().data_type(DataType::Int64).build().ok();
    unit(column.data_type()).and_then(|_| data()).map_or_else(|| column.clone(), make_array)
}

/// A column of times: values, and nanoseconds in one.
pub fn times(column: &ArrayRef) -> Option<(Vec<Option<i64>>, i64)> {
    let factor = match column.data_type() {
        DataType::Timestamp(TimeUnit::Nanosecond, _) | DataType::Int64 => 1,
        DataType::Timestamp(TimeUnit::Microsecond, _) => 1_000,
        DataType::Timestamp(TimeUnit::Millisecond, _) => 1_000_000,
        DataType::Timestamp(TimeUnit::Second, _) => 1_000_000_000,
        _ => return None,
    };
    Some((counted(column).as_primitive::<Int64Type>().iter().collect(), factor))
}

pub fn is_list(of: &DataType) -> bool {
    matches!(of, DataType::List(_) | DataType::LargeList(_) | DataType::FixedSizeList(..))
}

/// The list that a cell holds, if it does.
pub fn inside(array: &ArrayRef, row: usize) -> Option<ArrayRef> {
    match array.data_type() {
        _ if array.is_null(row) => None,
        DataType::List(_) => Some(array.as_list::<i32>().value(row)),
        DataType::LargeList(_) => Some(array.as_list::<i64>().value(row)),
        DataType::FixedSizeList(..) => Some(array.as_fixed_size_list().value(row)),
        _ => None,
    }
}

/// The rows of a column of texts; `None`: it is none.
pub fn texts(column: &ArrayRef) -> Option<Box<dyn Iterator<Item = Option<&str>> + '_>> {
    Some(match column.data_type() {
        DataType::Utf8 => Box::new(column.as_string::<i32>().iter()),
        DataType::LargeUtf8 => Box::new(column.as_string::<i64>().iter()),
        DataType::Utf8View => Box::new(column.as_string_view().iter()),
        DataType::Null => Box::new(std::iter::repeat_n(None, column.len())),
        _ => return None,
    })
}
