//! The columns of the verdict table: one list, of which the type that holds a batch's rows, the file's
//! schema, its writer and its reader are made. A new column is a line of the list and what fills it
//! (`pipeline::rows`); a test asks for its line in `schemas/verdicts.md`.

use super::{Outcome, Reason, Test};
use std::sync::Arc;

/// A column of the table.
pub struct Column {
    pub name: &'static str,
    pub nullable: bool,
    pub cells: Cells,
}

/// What a column's cells are, and where a batch has them.
pub enum Cells {
    /// Nanoseconds since 1970.
    Time(CellsAt<i64>),
    /// The recording's name, the same in every row.
    Recording,
    /// Places among the batch's `printheads`.
    Printhead(CellsAt<u32>),
    Channel(CellsAt<u32>),
    Outcome(CellsAt<Outcome>),
    /// Places among the run's categories.
    Category(CellsAt<Option<u16>>),
    /// Places among the run's classes.
    Class(CellsAt<Option<u16>>),
    Test(CellsAt<Option<Test>>),
    Reason(CellsAt<Option<Reason>>),
    /// Places among the metadata's models.
    Model(CellsAt<Option<u16>>),
    /// Of the test that decided, of every judged signal.
    Statistic(CellsAt<Option<f32>>),
    /// The same over many rows.
    Threshold(CellsAt<Option<f32>>),
    /// Of every judged signal, where there is a second test.
    Misfit(CellsAt<Option<f32>>),
    /// Numbers that only flagged signals have.
    Number(CellsAt<Option<f32>>),
    /// One number per class: `weights` from `weights_start` on.
    Weights,
}

/// Where a column's cells are.
pub struct CellsAt<T: 'static> {
    cells: fn(&VerdictColumns) -> &[T],
    vec: fn(&mut VerdictColumns) -> &mut Vec<T>,
}

impl<T> CellsAt<T> {
    pub fn of<'a>(&self, columns: &'a VerdictColumns) -> &'a [T] {
        (self.cells)(columns)
    }

    pub fn of_mut<'a>(&self, columns: &'a mut VerdictColumns) -> &'a mut Vec<T> {
        (self.vec)(columns)
    }
}

macro_rules! columns {
    (
        first { $(#[$when:meta])* $first:ident: $time:ty, $of_time:ident $called:literal; }
        required { $($(#[$about:meta])* $required:ident: $type:ty, $kind:ident $name:literal;)* }
        nullable { $($(#[$of:meta])* $nullable:ident: $value:ty, $sort:ident $title:literal;)* }
    ) => {
        /// The verdicts of one batch as columns, all of the same length, in the recording's order.
        /// `None` is null; no string per row.
        #[derive(Clone, Debug, Default, PartialEq)]
        pub struct VerdictColumns {
            $(#[$when])* pub $first: Vec<$time>,
            $($(#[$about])* pub $required: Vec<$type>,)*
            $($(#[$of])* pub $nullable: Vec<Option<$value>>,)*
            /// The printheads of this batch.
            pub printheads: Vec<Arc<str>>,
            /// `classes.len()` weights per row, concatenated over the rows that have them; `Some(start)`
            /// points at a row's first weight. Ends with the last row that has any.
            pub weights_start: Vec<Option<u32>>,
            pub weights: Vec<f32>,
        }

        /// In the table's order.
        pub static COLUMNS: &[Column] = &[
            Column { name: $called, nullable: false, cells: Cells::$of_time(columns!(at $first)) },
            Column { name: "recording", nullable: false, cells: Cells::Recording },
            $(Column { name: $name, nullable: false, cells: Cells::$kind(columns!(at $required)) },)*
            $(Column { name: $title, nullable: true, cells: Cells::$sort(columns!(at $nullable)) },)*
            Column { name: "weights", nullable: true, cells: Cells::Weights },
        ];

        impl VerdictColumns {
            /// No rows, the room kept.
            pub fn clear(&mut self) {
                self.$first.clear();
                $(self.$required.clear();)*
                $(self.$nullable.clear();)*
                self.printheads.clear();
                self.weights_start.clear();
                self.weights.clear();
            }

            /// Null wherever nothing was pushed for a row.
            pub fn fill_up(&mut self) {
                let rows = self.len();
                $(self.$nullable.resize(rows, None);)*
            }

            /// Of every column but the recording's name and the weights.
            pub fn lengths(&self) -> Vec<usize> {
                vec![self.$first.len(), $(self.$required.len(),)* $(self.$nullable.len(),)*]
            }
        }
    };
    (at $field:ident) => { CellsAt { cells: |c| &c.$field, vec: |c| &mut c.$field } };
}

columns! {
    first {
        /// t_a
        acquired_at_ns: i64, Time "acquired_at";
    }
    required {
        /// Index into `printheads`.
        printhead: u32, Printhead "printhead";
        channel: u32, Channel "channel";
        outcome: Outcome, Outcome "outcome";
    }
    nullable {
        /// Index into the run's categories.
        category: u16, Category "category";
        /// Index into the run's classes.
        fault: u16, Class "fault";
        /// Index into the run's classes.
        candidate: u16, Class "candidate";
        certainty: f32, Number "certainty";
        statistic: f32, Statistic "statistic";
        threshold: f32, Threshold "threshold";
        test: Test, Test "test";
        /// Unexplained mean square over the healthy one's.
        misfit: f32, Misfit "misfit";
        severity: f32, Number "severity";
        severity_sd: f32, Number "severity_sd";
        /// Of the ring fitted to it.
        resonance_hz: f32, Number "resonance_hz";
        damping_per_s: f32, Number "damping_per_s";
        model: u16, Model "model";
        reason: Reason, Reason "reason";
    }
}

impl VerdictColumns {
    pub fn len(&self) -> usize {
        self.acquired_at_ns.len()
    }

    pub fn is_empty(&self) -> bool {
        self.acquired_at_ns.is_empty()
    }
}
