//! The verdict table, Parquet in: for scoring, and for whoever holds code and schema together.
//!
//! Reads what [`super::verdict_table`] wrote, and the same table rewritten by other tools (plain
//! strings instead of dictionaries, µs instead of ns).

use super::verdict_table::{METADATA_KEY, VerdictError};
use crate::verdict::{Outcome, Reason, VerdictColumns};
use arrow_array::cast::AsArray;
use arrow_array::types::{
    Float32Type, Int32Type, TimestampMicrosecondType, TimestampNanosecondType, UInt16Type,
    UInt32Type,
};
use arrow_array::{Array, RecordBatch, StringArray};
use arrow_schema::{DataType, TimeUnit};
use parquet::arrow::arrow_reader::{ParquetRecordBatchReader, ParquetRecordBatchReaderBuilder};
use serde_json::Value;
use std::collections::HashMap;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Batches of a verdict file, in its order.
pub struct Verdicts {
    path: PathBuf,
    reader: ParquetRecordBatchReader,
    metadata: Value,
    classes: Vec<String>,
    categories: Vec<String>,
}

pub fn open(path: &Path) -> Result<Verdicts, VerdictError> {
    let file = File::open(path)
        .map_err(|e| VerdictError::NotVerdicts { path: path.into(), what: e.to_string() })?;
    let parquet = |source| VerdictError::Parquet { path: path.into(), source };
    let builder = ParquetRecordBatchReaderBuilder::try_new(file).map_err(parquet)?;
    let not = |what: &str| VerdictError::NotVerdicts { path: path.into(), what: what.into() };
    let document = builder
        .metadata()
        .file_metadata()
        .key_value_metadata()
        .and_then(|pairs| pairs.iter().find(|kv| kv.key == METADATA_KEY)?.value.as_deref())
        .ok_or_else(|| not("no `inkling` metadata"))?;
    let metadata: Value =
        serde_json::from_str(document).map_err(|_| not("its `inkling` metadata is no JSON"))?;
    let names = |key: &str| -> Vec<String> {
        let list = metadata[key].as_array().into_iter().flatten();
        list.filter_map(|v| v.as_str().map(str::to_owned)).collect()
    };
    let (classes, categories) = (names("classes"), names("categories"));
    let reader = builder.with_batch_size(65_536).build().map_err(parquet)?;
    Ok(Verdicts { path: path.into(), reader, metadata, classes, categories })
}

impl Verdicts {
    /// The contract's document.
    pub fn metadata(&self) -> &Value {
        &self.metadata
    }

    pub fn classes(&self) -> &[String] {
        &self.classes
    }

    fn columns(&self, batch: &RecordBatch) -> Option<VerdictColumns> {
        let mut c = VerdictColumns::default();
        c.acquired_at_ns = times(batch.column_by_name("acquired_at")?)?;
        let mut places: HashMap<String, u32> = HashMap::new();
        for name in strings(batch.column_by_name("printhead")?)? {
            let name = name?;
            let place = match places.get(&name) {
                Some(&place) => place,
                None => {
                    c.printheads.push(Arc::from(name.as_str()));
                    places.insert(name, c.printheads.len() as u32 - 1);
                    c.printheads.len() as u32 - 1
                }
            };
            c.printhead.push(place);
        }
        c.channel =
            batch.column_by_name("channel")?.as_primitive_opt::<UInt32Type>()?.values().to_vec();
        for outcome in strings(batch.column_by_name("outcome")?)? {
            let outcome = outcome?;
            c.outcome.push(*Outcome::ALL.iter().find(|o| o.as_str() == outcome)?);
        }
        for reason in strings(batch.column_by_name("reason")?)? {
            c.reason.push(match reason {
                None => None,
                Some(reason) => Some(*Reason::ALL.iter().find(|r| r.as_str() == reason)?),
            });
        }
        let coded = |column: &str, names: &[String]| -> Option<Vec<Option<u16>>> {
            let place = |s: String| names.iter().position(|n| *n == s).map(|p| p as u16);
            let words = strings(batch.column_by_name(column)?)?;
            Some(words.into_iter().map(|s| s.and_then(place)).collect())
        };
        c.category = coded("category", &self.categories)?;
        c.fault = coded("fault", &self.classes)?;
        c.candidate = coded("candidate", &self.classes)?;
        let floats = |column: &str| -> Option<Vec<Option<f32>>> {
            Some(batch.column_by_name(column)?.as_primitive_opt::<Float32Type>()?.iter().collect())
        };
        c.certainty = floats("certainty")?;
        c.statistic = floats("statistic")?;
        c.threshold = floats("threshold")?;
        c.severity = floats("severity")?;
        c.severity_sd = floats("severity_sd")?;
        c.model = batch.column_by_name("model")?.as_primitive_opt::<UInt16Type>()?.iter().collect();
        c.weights_start = vec![None; c.acquired_at_ns.len()];
        if let Some(weights) = batch.column_by_name("weights") {
            let list = weights.as_fixed_size_list_opt()?;
            for (row, start) in c.weights_start.iter_mut().enumerate() {
                if list.is_valid(row) && !self.classes.is_empty() {
                    let values = list.value(row);
                    *start = Some(c.weights.len() as u32);
                    c.weights.extend(values.as_primitive_opt::<Float32Type>()?.values());
                }
            }
        }
        Some(c)
    }
}

impl Iterator for Verdicts {
    type Item = Result<VerdictColumns, VerdictError>;

    fn next(&mut self) -> Option<Self::Item> {
        let batch = self.reader.next()?;
        Some(match batch {
            Err(source) => Err(VerdictError::Arrow { path: self.path.clone(), source }),
            Ok(batch) => self.columns(&batch).ok_or_else(|| VerdictError::NotVerdicts {
                path: self.path.clone(),
                what: "a column is missing or of another type".into(),
            }),
        })
    }
}

fn times(array: &Arc<dyn Array>) -> Option<Vec<i64>> {
    match array.data_type() {
        DataType::Timestamp(TimeUnit::Nanosecond, _) => {
            Some(array.as_primitive_opt::<TimestampNanosecondType>()?.values().to_vec())
        }
        DataType::Timestamp(TimeUnit::Microsecond, _) => {
            let us = array.as_primitive_opt::<TimestampMicrosecondType>()?.values();
            us.iter().map(|v| v.checked_mul(1000)).collect()
        }
        _ => None,
    }
}

/// A column of words, dictionary or plain.
fn strings(array: &Arc<dyn Array>) -> Option<Vec<Option<String>>> {
    let plain = |words: &StringArray| words.iter().map(|s| s.map(str::to_owned)).collect();
    match array.data_type() {
        DataType::Dictionary(_, _) => {
            let dictionary = array.as_dictionary_opt::<Int32Type>()?;
            let words = dictionary.values().as_string_opt::<i32>()?;
            let keys = dictionary.keys().iter();
            Some(keys.map(|k| k.map(|k| words.value(k as usize).to_owned())).collect())
        }
        DataType::Utf8 => Some(plain(array.as_string_opt::<i32>()?)),
        DataType::LargeUtf8 => {
            Some(array.as_string_opt::<i64>()?.iter().map(|s| s.map(str::to_owned)).collect())
        }
        DataType::Utf8View => {
            Some(array.as_string_view_opt()?.iter().map(|s| s.map(str::to_owned)).collect())
        }
        _ => None,
    }
}
