//! Verdicts as Arrow arrays: the rows of the verdict table (`schemas/verdicts.md`) for a caller in this process.
//!
//! In: verdict columns, batch by batch in the recording's order; at the end the metadata document. Out: record batches of
//! the table's schema.

use super::column_types::TimestampUnit;
use super::verdict_cells::{Is, each, weights};
use super::verdict_columns::{TableOptions, columns, schema};
use super::verdict_table::METADATA_KEY;
use crate::verdict::{Cells, CellsAt, Column, HealthyRun, Outcome, Reason, Test, Verdicts};
use arrow_array::builder::PrimitiveBuilder;
use arrow_array::types::{
    ArrowPrimitiveType, Float32Type, Int32Type, TimestampMicrosecondType, TimestampNanosecondType,
    UInt16Type, UInt32Type,
};
use arrow_array::{ArrayRef, DictionaryArray, PrimitiveArray, RecordBatch, StringArray};
use arrow_schema::{ArrowError, SchemaRef};
use parquet::errors::ParquetError;
use std::sync::Arc;

/// Those of a recording, as far as it was judged.
#[derive(Debug)]
pub struct VerdictArrays {
    options: TableOptions,
    pub schema: SchemaRef,
    pub batches: Vec<RecordBatch>,
    pub rows: u64,
    texts: Texts,
}

/// What text columns say, by key.
#[derive(Debug)]
struct Texts {
    recording: ArrayRef,
    classes: ArrayRef,
    categories: ArrayRef,
    outcomes: ArrayRef,
    tests: ArrayRef,
    reasons: ArrayRef,
}

fn texts<T: AsRef<str>>(of: impl IntoIterator<Item = T>) -> ArrayRef {
    Arc::new(StringArray::from_iter_values(of))
}

impl VerdictArrays {
    pub fn new(options: TableOptions) -> VerdictArrays {
        let texts = Texts {
            recording: texts([&options.recording]),
            classes: texts(&options.classes),
            categories: texts(&options.categories),
            outcomes: texts(Outcome::ALL.map(Outcome::as_str)),
            tests: texts(Test::ALL.map(Test::as_str)),
            reasons: texts(Reason::ALL.map(Reason::as_str)),
        };
        let schema = Arc::new(schema(&options));
        VerdictArrays { options, schema, batches: Vec::new(), rows: 0, texts }
    }

    /// Appends a batch of verdicts.
    pub fn write(&mut self, of: &Verdicts) -> Result<(), ArrowError> {
        let printheads = texts(&of.rows.printheads);
        let array = |column| self.array(column, of, &printheads);
        let arrays = columns(&self.options).map(array).collect::<Result<_, ArrowError>>()?;
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

    fn array(
        &self,
        column: &Column,
        of: &Verdicts,
        printheads: &ArrayRef,
    ) -> Result<ArrayRef, ArrowError> {
        let key = |k: &Option<u16>| k.map(i32::from);
        let none = |out: &mut Keys, run: &HealthyRun| out.append_nulls(run.signals.len());
        let (keys, texts) = match &column.cells {
            Cells::Time(at) => return Ok(self.times(at, of)),
            Cells::Channel(at) => {
                let run = |out: &mut PrimitiveBuilder<UInt32Type>, run: &HealthyRun| {
                    let first = run.first_channel;
                    out.extend((0..run.signals.len() as u32).map(|k| Some(first + k)));
                };
                return Ok(Arc::new(built(of, at, run, |k| Some(*k))));
            }
            Cells::Model(at) => {
                let run = |out: &mut PrimitiveBuilder<UInt16Type>, run: &HealthyRun| {
                    out.append_value_n(run.model, run.signals.len());
                };
                return Ok(Arc::new(built(of, at, run, |m| *m)));
            }
            Cells::Statistic(at) => return Ok(numbers(of, at, Some(&of.tests.statistic))),
            Cells::Misfit(at) => return Ok(numbers(of, at, Some(&of.tests.misfit))),
            Cells::Number(at) => return Ok(numbers(of, at, None)),
            Cells::Threshold(at) => return Ok(thresholds(of, at)),
            Cells::Weights => {
                let weights = weights(of, self.options.classes.len());
                let failed = |e: ParquetError| ArrowError::InvalidArgumentError(e.to_string());
                return Ok(Arc::new(weights.map_err(failed)?));
            }
            Cells::Recording => {
                (PrimitiveArray::from_value(0, of.len()), self.texts.recording.clone())
            }
            Cells::Printhead(at) => {
                let run = |out: &mut Keys, run: &HealthyRun| {
                    out.append_value_n(run.printhead as i32, run.signals.len());
                };
                (built(of, at, run, |k| Some(*k as i32)), printheads.clone())
            }
            Cells::Outcome(at) => {
                let run = |out: &mut Keys, run: &HealthyRun| {
                    out.append_value_n(Outcome::Healthy as i32, run.signals.len());
                };
                (built(of, at, run, |o| Some(*o as i32)), self.texts.outcomes.clone())
            }
            Cells::Category(at) => (built(of, at, none, key), self.texts.categories.clone()),
            Cells::Class(at) => (built(of, at, none, key), self.texts.classes.clone()),
            Cells::Reason(at) => {
                (built(of, at, none, |r| r.map(|r| r as i32)), self.texts.reasons.clone())
            }
            Cells::Test(at) => {
                let run = |out: &mut Keys, run: &HealthyRun| {
                    let tests = [run.along as i32, Test::Misfit as i32];
                    let beside = &of.tests.beside[run.signals.clone()];
                    out.extend(beside.iter().map(|b| Some(tests[usize::from(*b)])));
                };
                (built(of, at, run, |t| t.map(|t| t as i32)), self.texts.tests.clone())
            }
        };
        Ok(Arc::new(DictionaryArray::try_new(keys, texts)?))
    }

    fn times(&self, at: &CellsAt<i64>, of: &Verdicts) -> ArrayRef {
        match self.options.timestamp_unit {
            TimestampUnit::Ns => times::<TimestampNanosecondType>(at, of, |ns| ns),
            TimestampUnit::Us => {
                times::<TimestampMicrosecondType>(at, of, |ns| ns.div_euclid(1000))
            }
        }
    }
}

type Keys = PrimitiveBuilder<Int32Type>;

/// `healthy`: appends what a run's signals say; `row`: of a row's cell.
fn built<P: ArrowPrimitiveType, T>(
    of: &Verdicts,
    at: &CellsAt<T>,
    mut healthy: impl FnMut(&mut PrimitiveBuilder<P>, &HealthyRun),
    row: impl Fn(&T) -> Option<P::Native>,
) -> PrimitiveArray<P> {
    let mut out = PrimitiveBuilder::with_capacity(of.len());
    for part in each(of) {
        match part {
            Is::Healthy(run) => healthy(&mut out, run),
            Is::Rows(rows) => out.extend(at.of(&of.rows)[rows].iter().map(&row)),
        }
    }
    out.finish()
}

fn times<P>(at: &CellsAt<i64>, of: &Verdicts, unit: impl Fn(i64) -> i64) -> ArrayRef
where
    P: ArrowPrimitiveType<Native = i64> + arrow_array::types::ArrowTimestampType,
{
    let run = |out: &mut PrimitiveBuilder<P>, run: &HealthyRun| {
        out.append_value_n(unit(run.t_ns), run.signals.len());
    };
    Arc::new(built(of, at, run, |ns| Some(unit(*ns))).with_timezone("UTC"))
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

fn thresholds(of: &Verdicts, at: &CellsAt<Option<f32>>) -> ArrayRef {
    let run = |out: &mut PrimitiveBuilder<Float32Type>, run: &HealthyRun| {
        let thresholds = [run.threshold, run.beside];
        let beside = &of.tests.beside[run.signals.clone()];
        out.extend(beside.iter().map(|b| Some(thresholds[usize::from(*b)])));
    };
    Arc::new(built(of, at, run, |v| *v))
}
