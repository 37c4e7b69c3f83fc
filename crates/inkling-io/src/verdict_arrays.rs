//! Turns verdicts into Arrow arrays: the rows of the verdict table (`schemas/verdicts.md`) for a
//! caller in this process, instead of a file. The Python package takes them.
//!
//! In, from the pipeline's write stage: verdicts, batch by batch in the recording's order, and at
//! the end the metadata document. Out: record batches with the table's schema. The cells come from
//! the same functions as those of the file (`verdict_cells.rs`), so both say the same.

use super::column::{Numbers, RunColumn, Steps, text, text_of};
use super::column_types::{TimestampUnit, times};
use super::verdict_cells::{push_numbers, push_runs, push_steps, weights};
use super::verdict_columns::{TableOptions, columns, dictionary, schema};
use super::verdict_table::METADATA_KEY;
use arrow_array::builder::Float32Builder;
use arrow_array::{
    ArrayRef, DictionaryArray, Float32Array, RecordBatch, StringArray, UInt16Array, UInt32Array,
};
use arrow_schema::{ArrowError, SchemaRef};
use inkling_core::verdict::{Cells, Column, Verdicts};
use parquet::arrow::ArrowSchemaConverter;
use parquet::errors::{ParquetError, Result};
use parquet::schema::types::ColumnDescPtr;
use std::sync::Arc;

#[derive(Debug)]
pub struct VerdictArrays {
    options: TableOptions,
    pub schema: SchemaRef,
    pub batches: Vec<RecordBatch>,
    pub rows: u64,
}

impl VerdictArrays {
    pub fn new(options: TableOptions) -> VerdictArrays {
        let schema = Arc::new(schema(&options));
        VerdictArrays { options, schema, batches: Vec::new(), rows: 0 }
    }

    /// Appends a batch of verdicts. An error means that its columns do not fit each other.
    pub fn write(&mut self, of: &Verdicts) -> Result<(), ArrowError> {
        let failed = |e: ParquetError| ArrowError::InvalidArgumentError(e.to_string());
        let described = ArrowSchemaConverter::new().convert(&self.schema).map_err(failed)?;
        let array = |(k, column)| self.array(column, described.column(k), of).map_err(failed);
        let arrays = columns(&self.options).enumerate().map(array).collect::<Result<_, _>>()?;
        self.batches.push(RecordBatch::try_new(self.schema.clone(), arrays)?);
        self.rows += of.len() as u64;
        Ok(())
    }

    /// Puts the metadata document into the schema, once all rows are there.
    pub fn complete(mut self, document: String) -> VerdictArrays {
        let metadata = [(METADATA_KEY.to_owned(), document)].into();
        self.schema = Arc::new(self.schema.as_ref().clone().with_metadata(metadata));
        self
    }

    fn array(&self, column: &Column, described: ColumnDescPtr, of: &Verdicts) -> Result<ArrayRef> {
        Ok(match &column.cells {
            Cells::Time(_) | Cells::Channel(_) => {
                // times stay ns here; they are converted to the table's unit with the whole array
                let mut steps = Vec::with_capacity(of.len());
                push_steps(&mut steps, column, of, TimestampUnit::Ns);
                match &column.cells {
                    Cells::Time(_) => {
                        times(steps.into_iter().map(Some), self.options.timestamp_unit)
                    }
                    _ => Arc::new(steps.into_iter().map(|k| k as u32).collect::<UInt32Array>()),
                }
            }
            Cells::Statistic(_) | Cells::Misfit(_) | Cells::Number(_) => {
                let mut numbers = Float32Builder::with_capacity(of.len());
                push_numbers(&mut numbers, column, of)?;
                Arc::new(numbers.finish())
            }
            Cells::Weights => Arc::new(weights(of, self.options.classes.len())?),
            cells => {
                // the keys of runs become the keys of an Arrow dictionary; names of printheads are those of
                // the batch
                let known = match cells {
                    Cells::Printhead(_) => of.rows.printheads.iter().map(|p| text(p)).collect(),
                    _ => dictionary(column, &self.options),
                };
                let mut runs = RunColumn::new(described, known.into_iter());
                push_runs(&mut runs, column, of)?;
                let (keys, values) = runs.keys();
                let value = |key: Option<i32>| key.map(|key| &values[key as usize][..]);
                match cells {
                    Cells::Model(_) => {
                        // as Parquet has no 16-bit integers, the dictionary holds 32 bits; the low
                        // two bytes count
                        let model = |of: &[u8]| of.first_chunk().map(|of| u16::from_le_bytes(*of));
                        let models = keys.iter().map(|key| value(key).and_then(model));
                        Arc::new(models.collect::<UInt16Array>())
                    }
                    Cells::Threshold(_) => {
                        let number = |of: &[u8]| of.first_chunk().map(|of| f32::from_le_bytes(*of));
                        let numbers = keys.iter().map(|key| value(key).and_then(number));
                        Arc::new(numbers.collect::<Float32Array>())
                    }
                    _ => {
                        let texts = values.iter().map(|of| text_of(of));
                        let texts = Arc::new(StringArray::from_iter_values(texts));
                        Arc::new(DictionaryArray::try_new(keys, texts)?)
                    }
                }
            }
        })
    }
}

impl Steps for Vec<i64> {
    fn push(&mut self, start: i64, step: i64, rows: usize) {
        self.extend((0..rows as i64).map(|row| start + step * row));
    }
}

/// Numbers that are NaN become null, as in the file.
impl Numbers for Float32Builder {
    fn push(&mut self, of: &[f32]) -> Result<()> {
        match of.iter().any(|v| v.is_nan()) {
            false => self.append_slice(of),
            true => self.extend(of.iter().map(|v| (!v.is_nan()).then_some(*v))),
        }
        Ok(())
    }

    fn push_nulls(&mut self, rows: usize) -> Result<()> {
        self.append_nulls(rows);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::place;
    use crate::verdict_table::tests::{options, rows_and_runs, write};
    use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
    use rand::SeedableRng;

    #[test]
    fn arrays_are_what_the_file_of_the_same_verdicts_holds() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(16);
        for batch in 0..10 {
            let of = rows_and_runs(&mut rng, batch);
            for unit in [TimestampUnit::Ns, TimestampUnit::Us] {
                let (_dir, path) = place("r.verdicts.parquet");
                let rows = write(&path, options(true, unit), std::slice::from_ref(&of));
                let file = std::fs::File::open(&path).unwrap();
                let builder = ParquetRecordBatchReaderBuilder::try_new(file).unwrap();
                let written = builder.with_batch_size(rows).build().unwrap().next();
                let written = written.unwrap().unwrap();
                let mut arrays = VerdictArrays::new(options(true, unit));
                arrays.write(&of).unwrap();
                let made = &arrays.batches[0];
                assert_eq!(made.schema().fields(), written.schema().fields());
                assert_eq!(made.columns(), written.columns());
            }
        }
    }
}
