//! One column of the verdict table in a row group: what a batch's verdicts give it.
//!
//! In: verdicts, healthy signals as runs. Out: the column's encoded chunk.

use super::column::{NumberColumn, RunColumn, StepColumn};
use super::column_types::TimestampUnit;
use super::verdict_columns::{TableOptions, dictionary, floats, weight_field};
use crate::verdict::{Cells, Column, HealthyRun, Outcome, Part, Test, Verdicts};
use arrow_array::{FixedSizeListArray, Float32Array};
use arrow_buffer::NullBuffer;
use arrow_schema::{DataType, Field};
use parquet::arrow::arrow_writer::{ArrowColumnWriter, compute_leaves};
use parquet::errors::{ParquetError, Result};
use parquet::file::writer::SerializedRowGroupWriter;
use parquet::schema::types::ColumnDescPtr;
use std::io::Write;
use std::ops::Range;
use std::sync::Arc;

pub enum Chunk {
    Runs(Box<RunColumn>),
    Steps(StepColumn),
    Numbers(Box<NumberColumn>),
    Weights(Box<ArrowColumnWriter>),
}

impl Chunk {
    /// `weights`: the parquet crate's own writer of the column.
    pub fn new(
        column: &Column,
        of: ColumnDescPtr,
        weights: ArrowColumnWriter,
        options: &TableOptions,
    ) -> Chunk {
        match column.cells {
            Cells::Time(_) | Cells::Channel(_) => Chunk::Steps(StepColumn::new(of)),
            Cells::Statistic(_) | Cells::Misfit(_) | Cells::Number(_) => {
                Chunk::Numbers(Box::new(NumberColumn::new(of, floats(options))))
            }
            Cells::Weights => Chunk::Weights(Box::new(weights)),
            _ => Chunk::Runs(Box::new(RunColumn::new(of, dictionary(column, options).into_iter()))),
        }
    }

    /// Appends what a batch has for the column.
    pub fn push(&mut self, column: &Column, of: &Verdicts, options: &TableOptions) -> Result<()> {
        let (rows, tests) = (&of.rows, &of.tests);
        match (self, &column.cells) {
            (Chunk::Steps(out), Cells::Time(at)) => {
                let unit = |ns: i64| match options.timestamp_unit {
                    TimestampUnit::Ns => ns,
                    TimestampUnit::Us => ns.div_euclid(1000),
                };
                each(of, |part| {
                    match part {
                        Is::Healthy(run) => out.push(unit(run.t_ns), 0, run.signals.len()),
                        Is::Rows(range) => at.of(rows)[range]
                            .chunk_by(|p, q| p == q)
                            .for_each(|run| out.push(unit(run[0]), 0, run.len())),
                    }
                    Ok(())
                })
            }
            (Chunk::Steps(out), Cells::Channel(at)) => each(of, |part| {
                match part {
                    Is::Healthy(run) => out.push(run.first_channel.into(), 1, run.signals.len()),
                    Is::Rows(range) => at.of(rows)[range]
                        .chunk_by(|p, q| p.checked_add(1) == Some(*q))
                        .for_each(|run| out.push(run[0].into(), 1, run.len())),
                }
                Ok(())
            }),
            (Chunk::Runs(out), Cells::Printhead(at)) => {
                let mut keys: Vec<Option<u32>> = vec![None; rows.printheads.len()];
                let mut key = |place: &u32, out: &mut RunColumn| {
                    let (name, key) =
                        rows.printheads.get(*place as usize).zip(keys.get_mut(*place as usize))?;
                    Some(*key.get_or_insert_with(|| out.key(&super::column::text(name))))
                };
                each(of, |part| match part {
                    Is::Healthy(run) => {
                        let key = key(&run.printhead, out);
                        out.push(key, run.signals.len())
                    }
                    Is::Rows(range) => runs_of(&at.of(rows)[range], out, &mut key),
                })
            }
            (Chunk::Runs(out), Cells::Outcome(at)) => by_runs(
                of,
                out,
                |_, _| Some(Outcome::Healthy as u32),
                |range, out| runs_of(&at.of(rows)[range], out, |o, _| Some(*o as u32)),
            ),
            (Chunk::Runs(out), Cells::Category(at) | Cells::Class(at)) => by_runs(
                of,
                out,
                |_, _| None,
                |range, out| runs_of(&at.of(rows)[range], out, |k, _| k.map(u32::from)),
            ),
            (Chunk::Runs(out), Cells::Reason(at)) => by_runs(
                of,
                out,
                |_, _| None,
                |range, out| runs_of(&at.of(rows)[range], out, |r, _| r.map(|r| r as u32)),
            ),
            (Chunk::Runs(out), Cells::Model(at)) => {
                // Parquet has no 16-bit integers
                let key =
                    |model: u16, out: &mut RunColumn| out.key(&i32::from(model).to_le_bytes());
                by_runs(
                    of,
                    out,
                    |run, out| Some(key(run.model, out)),
                    |range, out| runs_of(&at.of(rows)[range], out, |m, out| m.map(|m| key(m, out))),
                )
            }
            (Chunk::Runs(out), Cells::Test(at)) => each(of, |part| match part {
                Is::Healthy(run) => out.push_either(
                    [run.along as u32, Test::Misfit as u32],
                    &tests.beside[run.signals.clone()],
                ),
                Is::Rows(range) => runs_of(&at.of(rows)[range], out, |t, _| t.map(|t| t as u32)),
            }),
            (Chunk::Runs(out), Cells::Threshold(at)) => {
                let key = |value: f32, out: &mut RunColumn| out.key(&value.to_le_bytes());
                each(of, |part| match part {
                    Is::Healthy(run) => {
                        let beside = &tests.beside[run.signals.clone()];
                        let keys = [run.threshold, run.beside].map(|value| key(value, out));
                        out.push_either(keys, beside)
                    }
                    Is::Rows(range) => {
                        runs_of(&at.of(rows)[range], out, |v, out| v.map(|v| key(v, out)))
                    }
                })
            }
            (Chunk::Numbers(out), Cells::Statistic(at)) => each(of, |part| match part {
                Is::Healthy(run) => out.push(&tests.statistic[run.signals.clone()]),
                Is::Rows(range) => push_numbers(&at.of(rows)[range], out),
            }),
            (Chunk::Numbers(out), Cells::Misfit(at)) => each(of, |part| match part {
                Is::Healthy(run) => out.push(&tests.misfit[run.signals.clone()]),
                Is::Rows(range) => push_numbers(&at.of(rows)[range], out),
            }),
            (Chunk::Numbers(out), Cells::Number(at)) => each(of, |part| match part {
                Is::Healthy(run) => out.push_nulls(run.signals.len()),
                Is::Rows(range) => push_numbers(&at.of(rows)[range], out),
            }),
            (Chunk::Weights(out), Cells::Weights) => {
                let array: arrow_array::ArrayRef = Arc::new(weights(of, options.classes.len())?);
                let list = DataType::FixedSizeList(weight_field(), options.classes.len() as i32);
                let field = Field::new(column.name, list, true);
                compute_leaves(&field, &array)?.iter().try_for_each(|leaf| out.write(leaf))
            }
            _ => unreachable!("a column's chunk is of its kind"),
        }
    }

    /// Bytes held, about.
    pub fn memory(&self) -> usize {
        match self {
            Chunk::Runs(runs) => runs.memory(),
            Chunk::Steps(steps) => steps.memory(),
            Chunk::Numbers(numbers) => numbers.memory(),
            Chunk::Weights(weights) => weights.memory_size(),
        }
    }

    /// Appends it to the row group as its next column.
    pub fn append_to<W: Write + Send>(
        self,
        column: &Column,
        group: &mut SerializedRowGroupWriter<'_, W>,
    ) -> Result<()> {
        match self {
            // what is worth skipping row groups by: when, where, how much
            Chunk::Runs(runs) => runs.append_to(group, matches!(column.cells, Cells::Printhead(_))),
            Chunk::Steps(steps) => steps.append_to(group),
            Chunk::Numbers(numbers) => numbers.append_to(group),
            Chunk::Weights(weights) => weights.close()?.append_to_row_group(group),
        }
    }
}

/// A part of a batch.
enum Is<'a> {
    Healthy(&'a HealthyRun),
    Rows(Range<usize>),
}

fn each(of: &Verdicts, mut push: impl FnMut(Is) -> Result<()>) -> Result<()> {
    of.parts.iter().try_for_each(|part| match part {
        Part::Healthy(run) => push(Is::Healthy(run)),
        Part::Rows(rows) => push(Is::Rows(rows.clone())),
    })
}

/// `healthy`: the key of a healthy run.
fn by_runs(
    of: &Verdicts,
    out: &mut RunColumn,
    mut healthy: impl FnMut(&HealthyRun, &mut RunColumn) -> Option<u32>,
    mut rows: impl FnMut(Range<usize>, &mut RunColumn) -> Result<()>,
) -> Result<()> {
    each(of, |part| match part {
        Is::Healthy(run) => {
            let key = healthy(run, out);
            out.push(key, run.signals.len())
        }
        Is::Rows(range) => rows(range, out),
    })
}

/// Rows by their runs; `key` of a value in the dictionary.
fn runs_of<T: PartialEq>(
    of: &[T],
    out: &mut RunColumn,
    mut key: impl FnMut(&T, &mut RunColumn) -> Option<u32>,
) -> Result<()> {
    of.chunk_by(|p, q| p == q).try_for_each(|run| {
        let key = key(&run[0], out);
        out.push(key, run.len())
    })
}

fn push_numbers(of: &[Option<f32>], out: &mut NumberColumn) -> Result<()> {
    of.chunk_by(|p, q| p.is_none() && q.is_none()).try_for_each(|run| match run[0] {
        None => out.push_nulls(run.len()),
        Some(value) => out.push(&[value]),
    })
}

/// `classes` weights per row; of healthy runs none.
fn weights(of: &Verdicts, classes: usize) -> Result<FixedSizeListArray> {
    let mut values = Vec::with_capacity(of.rows.len() * classes);
    let mut valid = Vec::with_capacity(of.len());
    each(of, |part| {
        let rows = match part {
            Is::Healthy(run) => {
                values.resize(values.len() + run.signals.len() * classes, 0.0);
                valid.resize(valid.len() + run.signals.len(), false);
                return Ok(());
            }
            Is::Rows(rows) => rows,
        };
        for row in rows {
            let start = of.rows.weights_start.get(row).copied().flatten();
            let start = start.map(|start| start as usize);
            match start.map(|start| of.rows.weights.get(start..start + classes)) {
                Some(Some(of_row)) => values.extend_from_slice(of_row),
                None => values.resize(values.len() + classes, 0.0),
                Some(None) => {
                    let what = format!("weights of row {row} lie beyond the weights");
                    return Err(ParquetError::General(what));
                }
            }
            valid.push(start.is_some());
        }
        Ok(())
    })?;
    let (values, valid) = (Arc::new(Float32Array::from(values)), Some(NullBuffer::from(valid)));
    Ok(FixedSizeListArray::try_new(weight_field(), classes as i32, values, valid)?)
}
