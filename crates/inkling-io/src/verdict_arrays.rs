//! Verdicts as Arrow arrays: the rows of the verdict table (`schemas/verdicts.md`) for a caller in this process.
//!
//! In: verdict columns, batch by batch in the recording's order; at the end the metadata document. Out: record batches of
//! the table's schema.

use super::column::{RunColumn, text, text_of};
use super::column_types::times;
use super::verdict_cells::{push_runs, weights};
use super::verdict_columns::{TableOptions, columns, dictionary, schema};
use super::verdict_table::METADATA_KEY;
use arrow_array::builder::PrimitiveBuilder;
use arrow_array::types::{ArrowPrimitiveType, Float32Type, Int64Type, UInt32Type};
use arrow_array::{
    ArrayRef, DictionaryArray, Float32Array, PrimitiveArray, RecordBatch, StringArray, UInt16Array,
};
use arrow_schema::{ArrowError, SchemaRef};
use inkling_core::verdict::{Cells, CellsAt, Column, HealthyRun, Part, Verdicts};
use parquet::arrow::ArrowSchemaConverter;
use parquet::errors::{ParquetError, Result};
use parquet::schema::types::ColumnDescPtr;
use std::sync::Arc;

/// Those of a recording, as far as it was judged.
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

    /// Appends a batch of verdicts.
    pub fn write(&mut self, of: &Verdicts) -> Result<(), ArrowError> {
        let failed = |e: ParquetError| ArrowError::InvalidArgumentError(e.to_string());
        let described = ArrowSchemaConverter::new().convert(&self.schema).map_err(failed)?;
        let array = |(k, column)| self.array(column, described.column(k), of).map_err(failed);
        let arrays = columns(&self.options).enumerate().map(array).collect::<Result<_, _>>()?;
        self.batches.push(RecordBatch::try_new(self.schema.clone(), arrays)?);
        self.rows += of.len() as u64;
        Ok(())
    }

    /// All rows are there; `document`: the table's metadata.
    pub fn complete(mut self, document: String) -> VerdictArrays {
        let metadata = [(METADATA_KEY.to_owned(), document)].into();
        self.schema = Arc::new(self.schema.as_ref().clone().with_metadata(metadata));
        self
    }

    fn array(&self, column: &Column, described: ColumnDescPtr, of: &Verdicts) -> Result<ArrayRef> {
        Ok(match &column.cells {
            Cells::Time(at) => {
                let run = |out: &mut PrimitiveBuilder<Int64Type>, run: &HealthyRun| {
                    out.append_value_n(run.t_ns, run.signals.len());
                };
                let ns = built(of, at, run, |ns| Some(*ns));
                times(ns.iter(), self.options.timestamp_unit)
            }
            Cells::Channel(at) => {
                let run = |out: &mut PrimitiveBuilder<UInt32Type>, run: &HealthyRun| {
                    let first = run.first_channel;
                    out.extend((0..run.signals.len() as u32).map(|k| Some(first + k)));
                };
                Arc::new(built(of, at, run, |k| Some(*k)))
            }
            Cells::Statistic(at) => numbers(of, at, Some(&of.tests.statistic)),
            Cells::Misfit(at) => numbers(of, at, Some(&of.tests.misfit)),
            Cells::Number(at) => numbers(of, at, None),
            Cells::Weights => Arc::new(weights(of, self.options.classes.len())?),
            cells => {
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
                        // Parquet has no 16-bit integers
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

/// `healthy`: appends what a run's signals say; `row`: of a row's cell.
fn built<P: ArrowPrimitiveType, T>(
    of: &Verdicts,
    at: &CellsAt<T>,
    mut healthy: impl FnMut(&mut PrimitiveBuilder<P>, &HealthyRun),
    row: impl Fn(&T) -> Option<P::Native>,
) -> PrimitiveArray<P> {
    let mut out = PrimitiveBuilder::with_capacity(of.len());
    for part in &of.parts {
        match part {
            Part::Healthy(run) => healthy(&mut out, run),
            Part::Rows(rows) => out.extend(at.of(&of.rows)[rows.clone()].iter().map(&row)),
        }
    }
    out.finish()
}

/// `healthy`: of every signal, NaN: null; without it healthy signals have none.
fn numbers(of: &Verdicts, at: &CellsAt<Option<f32>>, healthy: Option<&Vec<f32>>) -> ArrayRef {
    let run = |out: &mut PrimitiveBuilder<Float32Type>, run: &HealthyRun| match healthy {
        None => out.append_nulls(run.signals.len()),
        Some(all) => {
            let of_run = &all[run.signals.clone()];
            match of_run.iter().any(|v| v.is_nan()) {
                false => out.append_slice(of_run),
                true => out.extend(of_run.iter().map(|v| (!v.is_nan()).then_some(*v))),
            }
        }
    };
    Arc::new(built(of, at, run, |v| *v))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arrow_cells::{self, inside, numbers};
    use crate::column_types::TimestampUnit;
    use crate::verdict_reader::plain_texts;
    use crate::verdict_table::VerdictWriter;
    use crate::verdict_table::tests::{options, rows};
    use inkling_core::verdict::{Part, Test, Tests};
    use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;

    #[test]
    fn arrays_are_what_the_file_of_the_same_verdicts_holds() {
        let dir = tempfile::tempdir().unwrap();
        let rows = rows(0, 500, &["K1", "K2"]);
        let run = HealthyRun {
            t_ns: 1_700_000_000_000_001_000,
            printhead: 1,
            first_channel: 7,
            model: 3,
            along: Test::Ring,
            threshold: 2.5,
            beside: 1.5,
            signals: 0..3,
        };
        let tests = Tests {
            statistic: vec![0.5, 0.25, 2.0],
            misfit: vec![1.0, f32::NAN, 0.0],
            beside: vec![false, true, false],
            healthy: vec![true; 3],
        };
        let parts = vec![Part::Rows(0..200), Part::Healthy(run), Part::Rows(200..500)];
        let of = Verdicts { rows, tests, parts };
        for unit in [TimestampUnit::Ns, TimestampUnit::Us] {
            let path = dir.path().join("r.verdicts.parquet");
            let mut file = VerdictWriter::create(&path, options(true, unit)).unwrap();
            file.write(&of).unwrap();
            file.finish("{}".into()).unwrap();
            let file = std::fs::File::open(&path).unwrap();
            let builder = ParquetRecordBatchReaderBuilder::try_new(file).unwrap();
            let written = builder.with_batch_size(1000).build().unwrap().next().unwrap().unwrap();
            let mut arrays = VerdictArrays::new(options(true, unit));
            arrays.write(&of).unwrap();
            let made = &arrays.batches[0];
            assert_eq!(made.schema().fields(), written.schema().fields());
            for (a, b) in made.columns().iter().zip(written.columns()) {
                assert_eq!(plain_texts(a), plain_texts(b));
                assert_eq!(numbers(a), numbers(b));
                assert_eq!(arrow_cells::times(a), arrow_cells::times(b));
                let lists = |of: &ArrayRef| -> Vec<_> {
                    (0..503).map(|row| inside(of, row).map(|list| numbers(&list))).collect()
                };
                assert_eq!(lists(a), lists(b));
            }
        }
    }
}
