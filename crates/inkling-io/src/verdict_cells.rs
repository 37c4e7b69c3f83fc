//! What a batch's verdicts give each kind of column of the verdict table: healthy signals as runs, others row by row.

use super::column::{self, NumberColumn, RunColumn, StepColumn};
use super::verdict_columns::{TableOptions, weight_field};
use arrow_array::{ArrayRef, FixedSizeListArray, Float32Array};
use arrow_buffer::NullBuffer;
use arrow_schema::{DataType, Field};
use inkling_core::verdict::{Cells, CellsAt, Column, HealthyRun, Outcome, Part, Test, Verdicts};
use parquet::arrow::arrow_writer::{ArrowColumnWriter, compute_leaves};
use parquet::errors::{ParquetError, Result};
use std::sync::Arc;

/// Times and channels.
pub fn push_steps(out: &mut StepColumn, column: &Column, of: &Verdicts, options: &TableOptions) {
    let unit = options.timestamp_unit;
    for part in &of.parts {
        match (&column.cells, part) {
            (Cells::Time(_), Part::Healthy(run)) => {
                out.push(unit.of_ns(run.t_ns), 0, run.signals.len());
            }
            (Cells::Time(at), Part::Rows(range)) => at.of(&of.rows)[range.clone()]
                .chunk_by(|p, q| p == q)
                .for_each(|run| out.push(unit.of_ns(run[0]), 0, run.len())),
            (Cells::Channel(_), Part::Healthy(run)) => {
                out.push(run.first_channel.into(), 1, run.signals.len());
            }
            (Cells::Channel(at), Part::Rows(range)) => at.of(&of.rows)[range.clone()]
                .chunk_by(|p, q| p.checked_add(1) == Some(*q))
                .for_each(|run| out.push(run[0].into(), 1, run.len())),
            _ => unreachable!("a column's chunk is of its kind"),
        }
    }
}

/// What is the same over many rows.
pub fn push_runs(out: &mut RunColumn, column: &Column, of: &Verdicts) -> Result<()> {
    match &column.cells {
        Cells::Recording => of.parts.iter().try_for_each(|part| match part {
            Part::Healthy(run) => out.push(Some(0), run.signals.len()),
            Part::Rows(rows) => out.push(Some(0), rows.len()),
        }),
        Cells::Printhead(at) => {
            let key = |place: u32, out: &mut RunColumn| {
                let name = of.rows.printheads.get(place as usize)?;
                Some(out.key(&column::text(name)))
            };
            by_runs(of, at, out, |run, out| key(run.printhead, out), |place, out| key(*place, out))
        }
        Cells::Outcome(at) => {
            by_runs(of, at, out, |_, _| Some(Outcome::Healthy as u32), |o, _| Some(*o as u32))
        }
        Cells::Category(at) | Cells::Class(at) => {
            by_runs(of, at, out, |_, _| None, |k, _| k.map(u32::from))
        }
        Cells::Reason(at) => by_runs(of, at, out, |_, _| None, |r, _| r.map(|r| r as u32)),
        Cells::Model(at) => {
            // Parquet has no 16-bit integers
            let key = |model: u16, out: &mut RunColumn| out.key(&i32::from(model).to_le_bytes());
            let of_row = |m: &Option<u16>, out: &mut RunColumn| m.map(|m| key(m, out));
            by_runs(of, at, out, |run, out| Some(key(run.model, out)), of_row)
        }
        Cells::Test(at) => {
            let keys = |run: &HealthyRun, _: &mut _| [run.along as u32, Test::Misfit as u32];
            by_tests(of, at, out, keys, |t, _| t.map(|t| t as u32))
        }
        Cells::Threshold(at) => {
            let key = |value: f32, out: &mut RunColumn| out.key(&value.to_le_bytes());
            let keys = |run: &HealthyRun, out: &mut RunColumn| {
                [run.threshold, run.beside].map(|value| key(value, out))
            };
            by_tests(of, at, out, keys, |v, out| v.map(|v| key(v, out)))
        }
        _ => unreachable!("a column's chunk is of its kind"),
    }
}

/// `healthy`: the key of a healthy run; `key`: of a row's value.
fn by_runs<T: PartialEq>(
    of: &Verdicts,
    at: &CellsAt<T>,
    out: &mut RunColumn,
    mut healthy: impl FnMut(&HealthyRun, &mut RunColumn) -> Option<u32>,
    mut key: impl FnMut(&T, &mut RunColumn) -> Option<u32>,
) -> Result<()> {
    of.parts.iter().try_for_each(|part| match part {
        Part::Healthy(run) => {
            let key = healthy(run, out);
            out.push(key, run.signals.len())
        }
        Part::Rows(range) => runs_of(&at.of(&of.rows)[range.clone()], out, &mut key),
    })
}

/// `healthy`: the keys of a healthy run's signals, by the test that decided; `key`: of a row's value.
fn by_tests<T: PartialEq>(
    of: &Verdicts,
    at: &CellsAt<T>,
    out: &mut RunColumn,
    mut healthy: impl FnMut(&HealthyRun, &mut RunColumn) -> [u32; 2],
    mut key: impl FnMut(&T, &mut RunColumn) -> Option<u32>,
) -> Result<()> {
    of.parts.iter().try_for_each(|part| match part {
        Part::Healthy(run) => {
            let keys = healthy(run, out);
            out.push_either(keys, &of.tests.beside[run.signals.clone()])
        }
        Part::Rows(range) => runs_of(&at.of(&of.rows)[range.clone()], out, &mut key),
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

/// Numbers that differ from row to row.
pub fn push_numbers(out: &mut NumberColumn, column: &Column, of: &Verdicts) -> Result<()> {
    let (at, healthy) = match &column.cells {
        Cells::Statistic(at) => (at, Some(&of.tests.statistic)),
        Cells::Misfit(at) => (at, Some(&of.tests.misfit)),
        Cells::Number(at) => (at, None),
        _ => unreachable!("a column's chunk is of its kind"),
    };
    of.parts.iter().try_for_each(|part| match (part, healthy) {
        (Part::Healthy(run), Some(numbers)) => out.push(&numbers[run.signals.clone()]),
        (Part::Healthy(run), None) => out.push_nulls(run.signals.len()),
        (Part::Rows(range), _) => numbers_of(&at.of(&of.rows)[range.clone()], out),
    })
}

fn numbers_of(of: &[Option<f32>], out: &mut NumberColumn) -> Result<()> {
    of.chunk_by(|p, q| p.is_none() && q.is_none()).try_for_each(|run| match run[0] {
        None => out.push_nulls(run.len()),
        Some(value) => out.push(&[value]),
    })
}

/// One number per class.
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

/// `classes` weights per row; of healthy runs none.
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
