//! Turns verdicts into Arrow arrays: the rows of the verdict table (`schemas/verdicts.md`) for a
//! caller in this process, instead of a file. The Python package takes them.
//!
//! In, from the pipeline's write stage: verdicts, batch by batch in the recording's order, and at
//! the end the metadata document. Out: record batches with the table's schema.

use super::column_types::times;
use super::verdict_columns::{TableOptions, columns, names, schema, weights};
use super::verdict_table::{METADATA_KEY, check_lengths};
use arrow_array::types::Int32Type;
use arrow_array::{
    ArrayRef, DictionaryArray, Float32Array, Int32Array, RecordBatch, StringArray, UInt16Array,
    UInt32Array,
};
use arrow_schema::{ArrowError, SchemaRef};
use inkling_core::verdict::{Cells, Column, VerdictColumns, Verdicts};
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
        check_lengths(of)?;
        let rows = of.spelled_out();
        let array = |column| array(column, &rows, &self.options);
        let arrays = columns(&self.options).map(array).collect::<Result<_, _>>()?;
        self.batches.push(RecordBatch::try_new(self.schema.clone(), arrays)?);
        self.rows += rows.len() as u64;
        Ok(())
    }

    /// Puts the metadata document into the schema, once all rows are there.
    pub fn complete(mut self, document: String) -> VerdictArrays {
        let metadata = [(METADATA_KEY.to_owned(), document)].into();
        self.schema = Arc::new(self.schema.as_ref().clone().with_metadata(metadata));
        self
    }
}

fn array(
    column: &Column,
    rows: &VerdictColumns,
    options: &TableOptions,
) -> Result<ArrayRef, ArrowError> {
    Ok(match &column.cells {
        Cells::Time(at) => times(at.of(rows).iter().copied().map(Some), options.timestamp_unit),
        Cells::Channel(at) => Arc::new(UInt32Array::from(at.of(rows).to_vec())),
        Cells::Model(at) => Arc::new(UInt16Array::from(at.of(rows).to_vec())),
        Cells::Statistic(at)
        | Cells::Threshold(at)
        | Cells::Misfit(at)
        | Cells::Temperature(at)
        | Cells::Drive(at)
        | Cells::Number(at) => {
            // NaN becomes null, as in the file
            let numbers = at.of(rows).iter().map(|number| number.filter(|v| !v.is_nan()));
            Arc::new(numbers.collect::<Float32Array>())
        }
        Cells::Weights => Arc::new(weights(rows, options.classes.len())?),
        cells => {
            let names = match cells {
                Cells::Printhead(_) => rows.printheads.iter().map(|name| &**name).collect(),
                _ => names(column, options),
            };
            let key = |row| cells.key(rows, row).map(|key| key as i32);
            let keys: Int32Array = (0..rows.len()).map(key).collect();
            let names = Arc::new(StringArray::from(names));
            Arc::new(DictionaryArray::<Int32Type>::try_new(keys, names)?)
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::column_types::TimestampUnit;
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
