//! How the verdict table's columns stand in Parquet: their types and encodings, and what a batch has
//! for each. Which columns there are is said in [`crate::verdict`].

use super::column_types::{TimestampUnit, text, time};
use super::run_column::{self, RunColumn};
use crate::verdict::{COLUMNS, Cells, Column, Outcome, Reason, Test, VerdictColumns};
use arrow_array::{
    ArrayRef, FixedSizeListArray, Float32Array, TimestampMicrosecondArray,
    TimestampNanosecondArray, UInt32Array,
};
use arrow_buffer::{BooleanBuffer, NullBuffer};
use arrow_schema::{ArrowError, DataType, Field, Schema};
use parquet::basic::{Compression, Encoding, ZstdLevel};
use parquet::errors::ParquetError;
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::schema::types::ColumnPath;
use std::sync::Arc;

pub const ROW_GROUP_ROWS: usize = 1 << 20;

#[derive(Clone, Debug)]
pub struct TableOptions {
    /// What `fault` and `candidate` index, and the order of the weights.
    pub classes: Vec<String>,
    /// What `category` indexes.
    pub categories: Vec<String>,
    pub weights: bool,
    pub timestamp_unit: TimestampUnit,
}

/// Without classes there is nothing to weigh.
pub fn columns(options: &TableOptions) -> impl Iterator<Item = &'static Column> {
    let has_weights = options.weights && !options.classes.is_empty();
    COLUMNS.iter().filter(move |column| has_weights || !matches!(column.cells, Cells::Weights))
}

/// The table's columns as Arrow sees them.
pub fn schema(options: &TableOptions) -> Schema {
    let field = |column: &Column| {
        let data_type = match column.cells {
            Cells::Time(_) => time(options.timestamp_unit),
            Cells::Printhead(_) | Cells::Outcome(_) | Cells::Category(_) => text(),
            Cells::Class(_) | Cells::Test(_) | Cells::Reason(_) => text(),
            Cells::Channel(_) => DataType::UInt32,
            Cells::Model(_) => DataType::UInt16,
            Cells::Number(_) | Cells::Constant(_) => DataType::Float32,
            Cells::Weights => DataType::FixedSizeList(weight_field(), options.classes.len() as i32),
        };
        Field::new(column.name, data_type, column.nullable)
    };
    Schema::new(columns(options).map(field).collect::<Vec<_>>())
}

fn weight_field() -> Arc<Field> {
    Arc::new(Field::new("element", DataType::Float32, false))
}

pub fn properties(options: &TableOptions) -> WriterProperties {
    let mut properties = WriterProperties::builder()
        .set_compression(Compression::ZSTD(ZstdLevel::default()))
        .set_statistics_enabled(EnabledStatistics::Chunk)
        // of no use without statistics per page
        .set_offset_index_disabled(true)
        .set_max_row_group_row_count(Some(ROW_GROUP_ROWS));
    let floats = match options.timestamp_unit {
        TimestampUnit::Ns => Encoding::BYTE_STREAM_SPLIT,
        TimestampUnit::Us => Encoding::PLAIN,
    };
    for column in columns(options) {
        let (path, encoding) = match column.cells {
            Cells::Time(_) | Cells::Channel(_) => {
                (vec![column.name], Encoding::DELTA_BINARY_PACKED)
            }
            Cells::Number(_) => (vec![column.name], floats),
            Cells::Weights => (vec![column.name, "list", "element"], floats),
            _ => continue, // by runs
        };
        let path = ColumnPath::new(path.into_iter().map(String::from).collect());
        properties = properties
            .set_column_dictionary_enabled(path.clone(), false)
            .set_column_encoding(path, encoding);
    }
    properties.build()
}

/// Of a column that is the same over many rows: the values known before there are any, encoded PLAIN; a
/// key is a value's place. `None`: it is written value by value.
pub fn dictionary(column: &Column, options: &TableOptions) -> Option<Vec<Vec<u8>>> {
    let texts = |of: &[String]| of.iter().map(|v| run_column::text(v)).collect();
    match column.cells {
        Cells::Time(_) | Cells::Channel(_) | Cells::Number(_) | Cells::Weights => None,
        Cells::Printhead(_) | Cells::Constant(_) | Cells::Model(_) => Some(Vec::new()),
        Cells::Outcome(_) => Some(Outcome::ALL.map(|o| run_column::text(o.as_str())).to_vec()),
        Cells::Test(_) => Some(Test::ALL.map(|t| run_column::text(t.as_str())).to_vec()),
        Cells::Reason(_) => Some(Reason::ALL.map(|r| run_column::text(r.as_str())).to_vec()),
        Cells::Category(_) => Some(texts(&options.categories)),
        Cells::Class(_) => Some(texts(&options.classes)),
    }
}

/// Pushes a batch's runs onto their column.
type PushRuns<'a> = Box<dyn Fn(&mut RunColumn) -> Result<(), ParquetError> + 'a>;

/// What a batch has for a column.
pub enum Part<'a> {
    Runs(PushRuns<'a>),
    Values(ArrayRef),
}

/// Runs where there is a [`dictionary`].
pub fn part<'a>(
    column: &'static Column,
    c: &'a VerdictColumns,
    options: &TableOptions,
) -> Result<Part<'a>, ArrowError> {
    Ok(match &column.cells {
        Cells::Time(at) => Part::Values(times(at.of(c), options.timestamp_unit)),
        Cells::Printhead(at) => {
            Part::Runs(Box::new(move |out| push_printheads(at.of(c), &c.printheads, out)))
        }
        Cells::Channel(at) => Part::Values(Arc::new(UInt32Array::from(at.of(c).to_vec()))),
        Cells::Outcome(at) => runs(at.of(c), |&o, _| Some(o as u32)),
        Cells::Category(at) | Cells::Class(at) => runs(at.of(c), |k, _| k.map(u32::from)),
        Cells::Test(at) => runs(at.of(c), |t, _| t.map(|t| t as u32)),
        Cells::Reason(at) => runs(at.of(c), |r, _| r.map(|r| r as u32)),
        // Parquet has no 16-bit integers
        Cells::Model(at) => {
            runs(at.of(c), |m, out| m.map(|m| out.key(&i32::from(m).to_le_bytes())))
        }
        Cells::Constant(at) => runs(at.of(c), |v, out| v.map(|v| out.key(&v.to_le_bytes()))),
        Cells::Number(at) => {
            let (values, valid) = columnar(at.of(c));
            Part::Values(Arc::new(Float32Array::new(values.into(), valid)))
        }
        Cells::Weights => Part::Values(weights(c, options.classes.len())?),
    })
}

fn times(ns: &[i64], unit: TimestampUnit) -> ArrayRef {
    match unit {
        TimestampUnit::Ns => {
            Arc::new(TimestampNanosecondArray::from(ns.to_vec()).with_timezone("UTC"))
        }
        TimestampUnit::Us => {
            let us: Vec<i64> = ns.iter().map(|t| t.div_euclid(1000)).collect();
            Arc::new(TimestampMicrosecondArray::from(us).with_timezone("UTC"))
        }
    }
}

/// The runs of a column of a batch; `key` of a value in the dictionary.
fn runs<'a, T: PartialEq>(
    of: &'a [T],
    key: impl Fn(&T, &mut RunColumn) -> Option<u32> + 'a,
) -> Part<'a> {
    Part::Runs(Box::new(move |column| {
        of.chunk_by(|p, q| p == q).try_for_each(|run| {
            let key = key(&run[0], column);
            column.push(key, run.len())
        })
    }))
}

/// Printheads by name: a batch numbers its own.
fn push_printheads(
    places: &[u32],
    names: &[Arc<str>],
    out: &mut RunColumn,
) -> Result<(), ParquetError> {
    let mut keys: Vec<Option<u32>> = vec![None; names.len()];
    places.chunk_by(|p, q| p == q).try_for_each(|run| {
        let place = run[0] as usize;
        let (Some(name), Some(key)) = (names.get(place), keys.get_mut(place)) else {
            let known = names.len();
            return Err(ParquetError::General(format!("printhead {place} of {known}")));
        };
        let key = *key.get_or_insert_with(|| out.key(&run_column::text(name)));
        out.push(Some(key), run.len())
    })
}

/// Values, and which of them are there; `None` where all are. Without a branch per row: most columns
/// are all one or all the other.
fn columnar(of: &[Option<f32>]) -> (Vec<f32>, Option<NullBuffer>) {
    let values = of.iter().map(|v| v.unwrap_or_default()).collect();
    let missing = of.iter().filter(|v| v.is_none()).count();
    let valid = match missing {
        0 => None,
        n if n == of.len() => Some(NullBuffer::new_null(n)),
        _ => Some(NullBuffer::new(BooleanBuffer::collect_bool(of.len(), |i| of[i].is_some()))),
    };
    (values, valid)
}

/// `classes` weights per row; no weights at all: every row is null.
fn weights(c: &VerdictColumns, classes: usize) -> Result<ArrayRef, ArrowError> {
    let mut values = Vec::with_capacity(c.len() * classes);
    let mut valid = Vec::with_capacity(c.len());
    for row in 0..c.len() {
        let start = c.weights_start.get(row).copied().flatten().map(|start| start as usize);
        match start.map(|start| c.weights.get(start..start + classes)) {
            Some(Some(of_row)) => values.extend_from_slice(of_row),
            None => values.resize(values.len() + classes, 0.0),
            Some(None) => {
                let what = format!("weights of row {row} lie beyond the weights");
                return Err(ArrowError::InvalidArgumentError(what));
            }
        }
        valid.push(start.is_some());
    }
    let values = Arc::new(Float32Array::from(values));
    let valid = Some(NullBuffer::from(valid));
    let list = FixedSizeListArray::try_new(weight_field(), classes as i32, values, valid)?;
    Ok(Arc::new(list))
}
