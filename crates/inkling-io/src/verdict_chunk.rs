//! One column of the verdict table in a row group that is being filled.
//!
//! In: verdicts, batch by batch. Out: the column's encoded chunk, to be appended to the file. This
//! file chooses by the column's kind which encoder of `column/` takes it; `verdict_cells.rs` does
//! the pushing.

use super::column::{NumberColumn, RunColumn, StepColumn};
use super::verdict_cells;
use super::verdict_columns::{TableOptions, dictionary, floats};
use inkling_core::verdict::{Cells, Column, Verdicts};
use parquet::arrow::arrow_writer::ArrowColumnWriter;
use parquet::errors::Result;
use parquet::file::writer::SerializedRowGroupWriter;
use parquet::schema::types::ColumnDescPtr;
use std::io::Write;

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
            _ => Chunk::Runs(Box::new(RunColumn::new(of, dictionary(column, options).into_iter()))),
        }
    }

    pub fn push(&mut self, column: &Column, of: &Verdicts, options: &TableOptions) -> Result<()> {
        match self {
            Chunk::Runs(out) => verdict_cells::push_runs(out, column, of),
            Chunk::Steps(out) => {
                verdict_cells::push_steps(out, column, of, options.timestamp_unit);
                Ok(())
            }
            Chunk::Numbers(out) => verdict_cells::push_numbers(&mut **out, column, of),
            Chunk::Weights(out) => {
                verdict_cells::push_weights(out, column, of, options.classes.len())
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
