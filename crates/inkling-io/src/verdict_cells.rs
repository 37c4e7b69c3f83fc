//! Pushes the verdicts of a batch into the columns of the verdict table, one function for each kind
//! of column.
//!
//! In: [`Verdicts`], which consist of parts in the recording's order: runs of healthy signals of
//! one burst, kept as a few vectors, and rows for all other signals. Out: pushes into a column,
//! which is a file's chunk (`verdict_chunk.rs`) or becomes an Arrow array (`verdict_arrays.rs`). A
//! healthy run is pushed as a run, whatever its length; rows are pushed one by one, or together
//! where neighbours are equal.

use super::column::{self, Numbers, RunColumn, Steps};
use super::column_types::TimestampUnit;
use super::verdict_columns::weight_field;
use arrow_array::{ArrayRef, FixedSizeListArray, Float32Array};
use arrow_buffer::NullBuffer;
use arrow_schema::{DataType, Field};
use inkling_core::verdict::{Cells, CellsAt, Column, HealthyRun, Outcome, Part, Test, Verdicts};
use parquet::arrow::arrow_writer::{ArrowColumnWriter, compute_leaves};
use parquet::errors::{ParquetError, Result};
use std::sync::Arc;

pub fn push_steps(out: &mut impl Steps, column: &Column, of: &Verdicts, unit: TimestampUnit) {
    for part in &of.parts {
        match (&column.cells, part) {
            (Cells::Time(_), Part::Healthy(run)) => {
                // all signals of a run are of one burst
                out.push(unit.of_ns(run.t_ns), 0, run.signals.len());
            }
            (Cells::Time(at), Part::Rows(range)) => at.of(&of.rows)[range.clone()]
                .chunk_by(|p, q| p == q)
                .for_each(|run| out.push(unit.of_ns(run[0]), 0, run.len())),
            (Cells::Channel(_), Part::Healthy(run)) => {
                out.push(run.first_channel.into(), 1, run.signals.len());
            }
            (Cells::Channel(at), Part::Rows(range)) => at.of(&of.rows)[range.clone()]
                // channels of rows are pushed as far as they go on by one
                .chunk_by(|p, q| p.checked_add(1) == Some(*q))
                .for_each(|run| out.push(run[0].into(), 1, run.len())),
            _ => unreachable!("a column's chunk is of its kind"),
        }
    }
}

/// Pushes a column whose value is the same over many rows, as keys into the column's dictionary.
pub fn push_runs(out: &mut RunColumn, column: &Column, of: &Verdicts) -> Result<()> {
    // the value of all healthy signals, such as `healthy`, or null
    let same = |key| move |_: &HealthyRun, _: &mut RunColumn| RunKey::Same(key);
    match &column.cells {
        Cells::Recording => out.push(Some(0), of.len()),
        Cells::Printhead(at) => {
            let key = |place: u32, out: &mut RunColumn| {
                let name = of.rows.printheads.get(place as usize)?;
                Some(out.key(&column::text(name)))
            };
            let healthy = |run: &HealthyRun, out: &mut _| RunKey::Same(key(run.printhead, out));
            by_runs(of, at, out, healthy, |place, out| key(*place, out))
        }
        Cells::Outcome(at) => {
            by_runs(of, at, out, same(Some(Outcome::Healthy as u32)), |o, _| Some(*o as u32))
        }
        Cells::Category(at) | Cells::Class(at) => {
            by_runs(of, at, out, same(None), |k, _| k.map(u32::from))
        }
        Cells::Reason(at) => by_runs(of, at, out, same(None), |r, _| r.map(|r| r as u32)),
        Cells::Model(at) => {
            // Parquet has no 16-bit integers
            let key = |model: u16, out: &mut RunColumn| out.key(&i32::from(model).to_le_bytes());
            let healthy = |run: &HealthyRun, out: &mut _| RunKey::Same(Some(key(run.model, out)));
            by_runs(of, at, out, healthy, |m, out| m.map(|m| key(m, out)))
        }
        Cells::Test(at) => {
            let healthy = |run: &HealthyRun, _: &mut _| {
                RunKey::OfTest([run.along, Test::Misfit].map(|t| t as u32))
            };
            by_runs(of, at, out, healthy, |t, _| t.map(|t| t as u32))
        }
        Cells::Threshold(at) => {
            let key = |value: f32, out: &mut RunColumn| out.key(&value.to_le_bytes());
            let healthy = |run: &HealthyRun, out: &mut RunColumn| {
                RunKey::OfTest([run.threshold, run.beside].map(|value| key(value, out)))
            };
            by_runs(of, at, out, healthy, |v, out| v.map(|v| key(v, out)))
        }
        _ => unreachable!("a column's chunk is of its kind"),
    }
}

/// The key, or keys, that the signals of a healthy run have in a column.
enum RunKey {
    /// All signals have the same key; `None` is null.
    Same(Option<u32>),
    /// Each signal has one of two keys: the first key if the first test (along the ring) decided,
    /// the second if the second test (beside the ring) did.
    OfTest([u32; 2]),
}

fn by_runs<T: PartialEq>(
    of: &Verdicts,
    at: &CellsAt<T>,
    out: &mut RunColumn,
    mut healthy: impl FnMut(&HealthyRun, &mut RunColumn) -> RunKey,
    mut key: impl FnMut(&T, &mut RunColumn) -> Option<u32>,
) -> Result<()> {
    of.parts.iter().try_for_each(|part| match part {
        Part::Healthy(run) => match healthy(run, out) {
            RunKey::Same(key) => out.push(key, run.signals.len()),
            RunKey::OfTest(keys) => out.push_either(keys, &of.tests.beside[run.signals.clone()]),
        },
        Part::Rows(range) => {
            at.of(&of.rows)[range.clone()].chunk_by(|p, q| p == q).try_for_each(|run| {
                let key = key(&run[0], out);
                out.push(key, run.len())
            })
        }
    })
}

pub fn push_numbers(out: &mut impl Numbers, column: &Column, of: &Verdicts) -> Result<()> {
    let (at, healthy) = match &column.cells {
        Cells::Statistic(at) => (at, Some(&of.tests.statistic)),
        Cells::Misfit(at) => (at, Some(&of.tests.misfit)),
        Cells::Number(at) => (at, None),
        _ => unreachable!("a column's chunk is of its kind"),
    };
    of.parts.iter().try_for_each(|part| match (part, healthy) {
        (Part::Healthy(run), Some(numbers)) => out.push(&numbers[run.signals.clone()]),
        (Part::Healthy(run), None) => out.push_nulls(run.signals.len()),
        (Part::Rows(range), _) => at.of(&of.rows)[range.clone()]
            // nulls are pushed together, values one by one
            .chunk_by(|p, q| p.is_none() && q.is_none())
            .try_for_each(|run| match run[0] {
                None => out.push_nulls(run.len()),
                Some(value) => out.push(&[value]),
            }),
    })
}

/// Pushes the column of weights, a list of one number per class, by the parquet crate's own writer.
pub fn push_weights(
    out: &mut ArrowColumnWriter,
    column: &Column,
    of: &Verdicts,
    classes: usize,
) -> Result<()> {
    let array: ArrayRef = Arc::new(weights(of, classes)?);
    let list = DataType::FixedSizeList(weight_field(), classes as i32);
    let field = Field::new(column.name, list, true);
    compute_leaves(&field, &array)?.iter().try_for_each(|leaf| out.write(leaf))
}

/// The weights of all rows as lists of `classes` numbers, null for healthy runs and for rows
/// without weights. An error if a row's weights lie beyond the batch's.
pub fn weights(of: &Verdicts, classes: usize) -> Result<FixedSizeListArray> {
    let mut values = Vec::with_capacity(of.rows.len() * classes);
    let mut valid = Vec::with_capacity(of.len());
    of.parts.iter().try_for_each(|part| {
        let rows = match part {
            Part::Healthy(run) => {
                values.resize(values.len() + run.signals.len() * classes, 0.0);
                valid.resize(valid.len() + run.signals.len(), false);
                return Ok(());
            }
            Part::Rows(rows) => rows.clone(),
        };
        for row in rows {
            // a row has no weights if its signal was rejected or not named
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
