//! One column of the verdict table in a row group that is being filled.
//!
//! In: [`Verdicts`], batch by batch. They consist of parts in the recording's order: runs of healthy
//! signals of one burst, kept as a few vectors, and rows for all other signals. Out: the column's
//! encoded chunk, to be appended to the file. A healthy run is pushed into an encoder of `column/`
//! as a run, whatever its length; rows are pushed one by one, or together where neighbours are
//! equal.

use super::column::{self, NumberColumn, RunColumn, StepColumn};
use super::verdict_columns::{TableOptions, floats, names, weight_field, weights};
use arrow_array::ArrayRef;
use arrow_schema::{DataType, Field};
use inkling_core::verdict::{Cells, Column, Part, Verdicts};
use parquet::arrow::arrow_writer::{ArrowColumnWriter, compute_leaves};
use parquet::errors::Result;
use parquet::file::writer::SerializedRowGroupWriter;
use parquet::schema::types::ColumnDescPtr;
use std::io::Write;
use std::sync::Arc;

/// The encoder of a column: one of `column/`, or for weights, which are lists, the parquet crate's
/// own writer.
pub enum Chunk {
    Runs(Box<RunColumn>),
    Steps(StepColumn),
    Numbers(Box<NumberColumn>),
    Weights(Box<ArrowColumnWriter>),
}

impl Chunk {
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
            _ => {
                let known = names(column, options).into_iter().map(column::text);
                Chunk::Runs(Box::new(RunColumn::new(of, known)))
            }
        }
    }

    pub fn push(&mut self, column: &Column, of: &Verdicts, options: &TableOptions) -> Result<()> {
        match self {
            Chunk::Runs(out) => push_runs(out, &column.cells, of),
            Chunk::Steps(out) => {
                push_steps(out, &column.cells, of, options);
                Ok(())
            }
            Chunk::Numbers(out) => push_numbers(out, &column.cells, of),
            Chunk::Weights(out) => {
                let classes = options.classes.len();
                let array: ArrayRef = Arc::new(weights(&of.spelled_out(), classes)?);
                let list = DataType::FixedSizeList(weight_field(), classes as i32);
                let field = Field::new(column.name, list, true);
                compute_leaves(&field, &array)?.iter().try_for_each(|leaf| out.write(leaf))
            }
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

    pub fn close<W: Write + Send>(self, column: &Column) -> Result<Append<W>> {
        let pages = match self {
            // statistics stand where a query can skip row groups by them: time, printhead, numbers
            Chunk::Runs(runs) => runs.close(matches!(column.cells, Cells::Printhead(_)))?,
            Chunk::Steps(steps) => steps.close()?,
            Chunk::Numbers(numbers) => numbers.close()?,
            Chunk::Weights(weights) => {
                let chunk = weights.close()?;
                return Ok(Box::new(|group| chunk.append_to_row_group(group)));
            }
        };
        Ok(Box::new(|group| pages.append_to(group)))
    }
}

/// Appends an encoded chunk to a row group as its next column.
pub type Append<W> = Box<dyn FnOnce(&mut SerializedRowGroupWriter<'_, W>) -> Result<()> + Send>;

fn push_steps(out: &mut StepColumn, cells: &Cells, of: &Verdicts, options: &TableOptions) {
    let unit = options.timestamp_unit;
    for part in &of.parts {
        match (cells, part) {
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

/// Pushes a column whose cells are names, or repeat over many rows.
fn push_runs(out: &mut RunColumn, cells: &Cells, of: &Verdicts) -> Result<()> {
    // a name that is known from the beginning has its place in the list as its key in the column;
    // what comes with the rows has the key that the column gives it
    let in_column = |key: Option<u32>, out: &mut RunColumn| match cells {
        Cells::Printhead(_) => {
            let name = of.rows.printheads.get(key? as usize)?;
            Some(out.key(&column::text(name)))
        }
        // Parquet has no 16-bit integers: models take four bytes, too
        Cells::Model(_) | Cells::Threshold(_) | Cells::Temperature(_) | Cells::Drive(_) => {
            key.map(|key| out.key(&key.to_le_bytes()))
        }
        _ => key,
    };
    for part in &of.parts {
        match part {
            Part::Healthy(run) => {
                let beside = &of.tests.beside[run.signals.clone()];
                match run.keys(cells).map(|key| in_column(key, out)) {
                    [Some(one), Some(other)] if one != other => {
                        out.push_either([one, other], beside)?;
                    }
                    [one, _] => out.push(one, beside.len())?,
                }
            }
            Part::Rows(range) => {
                let mut row = range.start;
                while row < range.end {
                    let key = cells.key(&of.rows, row);
                    let goes_on = |row: &usize| cells.key(&of.rows, *row) == key;
                    let rows = 1 + (row + 1..range.end).take_while(goes_on).count();
                    let key = in_column(key, out);
                    out.push(key, rows)?;
                    row += rows;
                }
            }
        }
    }
    Ok(())
}

fn push_numbers(out: &mut NumberColumn, cells: &Cells, of: &Verdicts) -> Result<()> {
    let (at, healthy) = match cells {
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
