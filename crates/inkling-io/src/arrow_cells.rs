//! Reads cells of Arrow arrays that any program may have written, as the few types that readers of
//! this crate ask for: numbers, times, texts, lists.
//!
//! There are two ways in. `columnar.rs` (`inkling convert`) asks cell by cell, by the free
//! functions [`number`], [`inside`], [`counted`]; a cell of an unfit type is `None`.
//! `verdict_reader.rs` and `row_table.rs` read whole columns of our own tables, which other tools
//! may have rewritten, by [`ReadColumn`]; an unfit type or value is an error in words that names
//! the column.

use arrow_array::cast::AsArray;
use arrow_array::types::{Float16Type, Float32Type, Float64Type, Int32Type, Int64Type, UInt32Type};
use arrow_array::{Array, ArrayRef, downcast_integer_array, make_array};
use arrow_schema::{DataType, TimeUnit};
use std::collections::HashMap;
use std::fmt::Display;

/// The numbers of a column of any numeric type; `None`: it has none. f64 holds u16, u32 and f32, the types of
/// the verdict table, exactly.
fn numbers(column: &ArrayRef) -> Option<Vec<Option<f64>>> {
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

/// A cell as a number; NaN where the cell is null. `None`: the array's type holds no numbers.
pub fn number(array: &dyn Array, row: usize) -> Option<f64> {
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

/// The unit of a column of times or durations, ns; `None` of any other type.
pub fn unit_ns(of: &DataType) -> Option<i64> {
    let (DataType::Timestamp(unit, _) | DataType::Duration(unit)) = of else { return None };
    Some(match unit {
        TimeUnit::Nanosecond => 1,
        TimeUnit::Microsecond => 1_000,
        TimeUnit::Millisecond => 1_000_000,
        TimeUnit::Second => 1_000_000_000,
    })
}

/// A column of times or durations as the whole numbers (i64, in the column's own unit) that Arrow
/// stores; any other column as it is.
pub fn counted(column: &ArrayRef) -> ArrayRef {
    let data = || column.to_data().into_builder().data_type(DataType::Int64).build().ok();
    unit_ns(column.data_type()).and_then(|_| data()).map_or_else(|| column.clone(), make_array)
}

pub fn is_list(of: &DataType) -> bool {
    matches!(of, DataType::List(_) | DataType::LargeList(_) | DataType::FixedSizeList(..))
}

pub fn is_list_of_lists(of: &DataType) -> bool {
    use DataType::{FixedSizeList, LargeList, List};
    matches!(of, List(of) | LargeList(of) | FixedSizeList(of, _) if is_list(of.data_type()))
}

pub fn inside(array: &ArrayRef, row: usize) -> Option<ArrayRef> {
    match array.data_type() {
        _ if array.is_null(row) => None,
        DataType::List(_) => Some(array.as_list::<i32>().value(row)),
        DataType::LargeList(_) => Some(array.as_list::<i64>().value(row)),
        DataType::FixedSizeList(..) => Some(array.as_fixed_size_list().value(row)),
        _ => None,
    }
}

#[derive(Clone, Copy)]
pub struct ReadColumn<'a> {
    pub name: &'static str,
    pub array: &'a ArrayRef,
}

/// The cells of a column, `None` where they are null.
type Read<T> = Result<Vec<Option<T>>, String>;

impl ReadColumn<'_> {
    /// An error about the column.
    fn wrong(self, what: impl Display) -> String {
        format!("column `{}` {what}", self.name)
    }

    fn unfit(self, array: &ArrayRef) -> String {
        self.wrong(format_args!("has type {}, which does not fit", array.data_type()))
    }

    fn out_of_range(self, value: impl Display) -> String {
        self.wrong(format_args!("has {value}, which is out of range"))
    }

    /// The cells as numbers. NaN counts as null, because tools without nulls write it.
    pub fn numbers(self) -> Read<f64> {
        let all = numbers(self.array).ok_or_else(|| self.unfit(self.array))?;
        Ok(all.into_iter().map(|v| v.filter(|v| !v.is_nan())).collect())
    }

    /// The same as f32.
    pub fn floats(self) -> Read<f32> {
        if self.array.null_count() == self.array.len() {
            return Ok(vec![None; self.array.len()]);
        }
        match self.array.data_type() {
            DataType::Float32 => {
                let all = self.array.as_primitive::<Float32Type>();
                Ok(all.iter().map(|v| v.filter(|v| !v.is_nan())).collect())
            }
            _ => Ok(self.numbers()?.into_iter().map(|v| v.map(|v| v as f32)).collect()),
        }
    }

    /// The cells as whole numbers from 0 on; others, and nulls, are an error.
    pub fn counts(self) -> Result<Vec<u32>, String> {
        match self.array.data_type() {
            DataType::UInt32 if self.array.null_count() == 0 => {
                Ok(self.array.as_primitive::<UInt32Type>().values().to_vec())
            }
            _ => self.required(self.whole()?),
        }
    }

    /// The cells as whole numbers from 0 on; others are an error.
    pub fn whole<T: TryFrom<u64>>(self) -> Read<T> {
        let one = |v: f64| {
            // numbers of other tools may be floats; u32 is the widest whole number of our tables
            let n = (v >= 0.0 && v <= f64::from(u32::MAX) && v.fract() == 0.0).then_some(v as u64);
            n.and_then(|n| T::try_from(n).ok()).ok_or_else(|| self.out_of_range(v))
        };
        self.numbers()?.into_iter().map(|v| v.map(one).transpose()).collect()
    }

    /// The cells as ns since 1970. A column of plain i64 counts as ns.
    pub fn times(self) -> Read<i64> {
        let (factor, all) = (self.unit_ns()?, counted(self.array));
        let one = |v: i64| v.checked_mul(factor).ok_or_else(|| self.out_of_range(v));
        all.as_primitive::<Int64Type>().iter().map(|v| v.map(one).transpose()).collect()
    }

    /// The same of a column that may have no null.
    pub fn all_times(self) -> Result<Vec<i64>, String> {
        let all = counted(self.array);
        match self.unit_ns()? {
            1 if all.null_count() == 0 => Ok(all.as_primitive::<Int64Type>().values().to_vec()),
            _ => self.required(self.times()?),
        }
    }

    fn unit_ns(self) -> Result<i64, String> {
        match self.array.data_type() {
            DataType::Int64 => Ok(1), // other tools may have dropped the type
            of => unit_ns(of).ok_or_else(|| self.unfit(self.array)),
        }
    }

    /// The cells as texts. All texts come as dictionaries (`parquet_file.rs`), in which a text may stand several times.
    pub fn texts(self) -> Result<Texts, String> {
        if self.array.data_type() == &DataType::Null {
            return Ok(Texts { keys: vec![None; self.array.len()], values: Vec::new() });
        }
        let dictionary = self.array.as_dictionary_opt::<Int32Type>();
        let dictionary = dictionary.ok_or_else(|| self.unfit(self.array))?;
        let texts = dictionary.values().as_string_opt::<i32>();
        let texts = texts.ok_or_else(|| self.unfit(self.array))?;
        let mut places: Vec<Option<u32>> = vec![None; texts.len()];
        let (mut index, mut values) = (HashMap::new(), Vec::new());
        let mut key = |at: i32| {
            let place = places.get_mut(usize::try_from(at).ok()?)?;
            if place.is_none() && texts.is_valid(at as usize) {
                let text = texts.value(at as usize);
                *place = Some(*index.entry(text).or_insert_with(|| {
                    values.push(text.to_owned());
                    values.len() as u32 - 1
                }));
            }
            *place
        };
        let keys = dictionary.keys();
        let keys = keys.iter().map(|at| at.and_then(&mut key)).collect();
        Ok(Texts { keys, values })
    }

    /// Each row's text as one of the values that `known` gives; a text that is none of them is an error.
    pub fn parsed<T: Copy>(self, mut known: impl FnMut(&str) -> Option<T>) -> Read<T> {
        let Texts { keys, values } = self.texts()?;
        let unknown = |text| self.wrong(format_args!("has `{text}`, which is unknown"));
        let parsed = values.iter().map(|text| known(text).ok_or_else(|| unknown(text)));
        let parsed = parsed.collect::<Result<Vec<T>, String>>()?;
        Ok(keys.into_iter().map(|key| key.map(|key| parsed[key as usize])).collect())
    }

    /// A column of lists of numbers: for each row the index in the second vector at which its list
    /// begins (`None`: the row is null), and the numbers of all lists one after the other. A list
    /// ends where the next one begins. A null within a list becomes NaN.
    pub fn lists(self) -> Result<(Vec<Option<u32>>, Vec<f32>), String> {
        let (mut starts, mut all) = (Vec::with_capacity(self.array.len()), Vec::new());
        for row in 0..self.array.len() {
            let list = inside(self.array, row);
            if list.is_none() && self.array.is_valid(row) {
                return Err(self.unfit(self.array));
            }
            starts.push(list.as_ref().and_then(|_| u32::try_from(all.len()).ok()));
            if let Some(list) = list {
                let of_row = numbers(&list).ok_or_else(|| self.unfit(&list))?;
                all.extend(of_row.iter().map(|w| w.unwrap_or(f64::NAN) as f32));
            }
        }
        Ok((starts, all))
    }

    /// The cells of a column that may have no null; a null is an error.
    pub fn required<T>(self, cells: Vec<Option<T>>) -> Result<Vec<T>, String> {
        cells.into_iter().collect::<Option<_>>().ok_or_else(|| self.has_null())
    }

    pub fn has_null(self) -> String {
        self.wrong("has a null, and may have none")
    }
}

/// A column of texts. `keys` has for each row the index of its text in `values`, `None` where the
/// row is null; `values` has each distinct text once, in the order of first appearance.
pub struct Texts {
    pub keys: Vec<Option<u32>>,
    pub values: Vec<String>,
}

impl Texts {
    pub fn cells(self) -> Vec<Option<String>> {
        self.keys.iter().map(|key| Some(self.values[(*key)? as usize].clone())).collect()
    }
}
