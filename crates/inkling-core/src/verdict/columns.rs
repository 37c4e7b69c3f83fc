//! The columns of the verdict table, as one list at the end of this file. Out, by the macro
//! `columns!`: [`VerdictColumns`], which holds a batch's rows column by column, and [`COLUMNS`],
//! from which `inkling-io` makes the file's schema, its writer and its reader.
//!
//! A line of the list is `field: type, Kind "name";` with the field of [`VerdictColumns`], the type
//! of a cell, the variant of [`Cells`], and the column's name in the file. Their meaning stands in
//! `schemas/verdicts.md`.

use super::{Outcome, Reason, Test};
use std::ops::Range;
use std::sync::Arc;

pub struct Column {
    pub name: &'static str,
    pub nullable: bool,
    pub cells: Cells,
}

/// What a column's cells are, and where [`VerdictColumns`] has them.
pub enum Cells {
    /// Nanoseconds since 1970.
    Time(CellsAt<i64>),
    /// The recording's name, the same in every row; a batch has no cells of it.
    Recording,
    /// Indices into the batch's `printheads`.
    Printhead(CellsAt<u32>),
    Channel(CellsAt<u32>),
    Outcome(CellsAt<Outcome>),
    /// Indices into the run's categories.
    Category(CellsAt<Option<u16>>),
    Class(CellsAt<Option<u16>>),
    Test(CellsAt<Option<Test>>),
    Reason(CellsAt<Option<Reason>>),
    /// Indices into the metadata's models.
    Model(CellsAt<Option<u16>>),
    /// The statistic of the test that decided; every judged signal has one.
    Statistic(CellsAt<Option<f32>>),
    /// The threshold of that test, which is the same over many rows.
    Threshold(CellsAt<Option<f32>>),
    Misfit(CellsAt<Option<f32>>),
    /// As recorded with the burst, the same for all of its rows: temperature, and voltage of the drive.
    Temperature(CellsAt<Option<f32>>),
    Drive(CellsAt<Option<f32>>),
    Number(CellsAt<Option<f32>>),
    /// One number per class: `weights` from `weights_start` on.
    Weights,
}

pub struct CellsAt<T: 'static> {
    cells: fn(&VerdictColumns) -> &[T],
    vec: fn(&mut VerdictColumns) -> &mut Vec<T>,
}

impl Cells {
    /// A cell as a number, where a cell is a name or repeats over many rows: the place of the name
    /// in its list ([`Outcome::ALL`], the run's classes, and so on), or the bits of a threshold.
    /// `None`: it is null, or the cells are of another kind.
    pub fn key(&self, of: &VerdictColumns, row: usize) -> Option<u32> {
        match self {
            Cells::Recording => Some(0),
            Cells::Printhead(at) => Some(at.of(of)[row]),
            Cells::Outcome(at) => Some(at.of(of)[row] as u32),
            Cells::Category(at) | Cells::Class(at) | Cells::Model(at) => {
                at.of(of)[row].map(u32::from)
            }
            Cells::Test(at) => at.of(of)[row].map(|test| test as u32),
            Cells::Reason(at) => at.of(of)[row].map(|reason| reason as u32),
            Cells::Threshold(at) | Cells::Temperature(at) | Cells::Drive(at) => {
                at.of(of)[row].map(f32::to_bits)
            }
            _ => None,
        }
    }
}

impl<T> CellsAt<T> {
    pub fn of<'a>(&self, columns: &'a VerdictColumns) -> &'a [T] {
        (self.cells)(columns)
    }

    pub fn of_mut<'a>(&self, columns: &'a mut VerdictColumns) -> &'a mut Vec<T> {
        (self.vec)(columns)
    }
}

// The time has a group of its own, since the recording's name follows it in the table.
macro_rules! columns {
    (
        first { $(#[$when:meta])* $first:ident: $time:ty, $of_time:ident $called:literal; }
        required { $($(#[$about:meta])* $required:ident: $type:ty, $kind:ident $name:literal;)* }
        nullable { $($(#[$of:meta])* $nullable:ident: $value:ty, $sort:ident $title:literal;)* }
    ) => {
        /// The verdicts of one batch as columns, one entry per row; `None` is null.
        #[derive(Clone, Debug, Default, PartialEq)]
        pub struct VerdictColumns {
            $(#[$when])* pub $first: Vec<$time>,
            $($(#[$about])* pub $required: Vec<$type>,)*
            $($(#[$of])* pub $nullable: Vec<Option<$value>>,)*
            pub printheads: Vec<Arc<str>>,
            /// Per row the index in `weights` of its first weight, up to the last row that has any.
            pub weights_start: Vec<Option<u32>>,
            /// One weight per class of the run, row after row, of the rows that have weights.
            pub weights: Vec<f32>,
        }

        pub static COLUMNS: &[Column] = &[
            Column { name: $called, nullable: false, cells: Cells::$of_time(columns!(at $first)) },
            Column { name: "recording", nullable: false, cells: Cells::Recording },
            $(Column { name: $name, nullable: false, cells: Cells::$kind(columns!(at $required)) },)*
            $(Column { name: $title, nullable: true, cells: Cells::$sort(columns!(at $nullable)) },)*
            Column { name: "weights", nullable: true, cells: Cells::Weights },
        ];

        impl VerdictColumns {
            pub fn clear(&mut self) {
                self.$first.clear();
                $(self.$required.clear();)*
                $(self.$nullable.clear();)*
                self.printheads.clear();
                self.weights_start.clear();
                self.weights.clear();
            }

            /// Makes every nullable column as long as the time column, by nulls.
            pub fn fill_up(&mut self) {
                let rows = self.len();
                $(self.$nullable.resize(rows, None);)*
            }

            /// Appends these rows of other columns, but for their weights.
            pub fn extend(&mut self, of: &VerdictColumns, rows: Range<usize>) {
                self.$first.extend_from_slice(&of.$first[rows.clone()]);
                $(self.$required.extend_from_slice(&of.$required[rows.clone()]);)*
                $(self.$nullable.extend_from_slice(&of.$nullable[rows.clone()]);)*
            }

            pub fn lengths(&self) -> Vec<usize> {
                vec![self.$first.len(), $(self.$required.len(),)* $(self.$nullable.len(),)*]
            }
        }
    };
    (at $field:ident) => { CellsAt { cells: |c| &c.$field, vec: |c| &mut c.$field } };
}

columns! {
    first {
        acquired_at_ns: i64, Time "acquired_at";
    }
    required {
        printhead: u32, Printhead "printhead";
        channel: u32, Channel "channel";
        outcome: Outcome, Outcome "outcome";
    }
    nullable {
        category: u16, Category "category";
        fault: u16, Class "fault";
        /// The class of largest weight, named or not: index into the run's classes.
        candidate: u16, Class "candidate";
        certainty: f32, Number "certainty";
        statistic: f32, Statistic "statistic";
        threshold: f32, Threshold "threshold";
        test: Test, Test "test";
        /// Mean square that no ring explains, over that of healthy signals.
        misfit: f32, Misfit "misfit";
        severity: f32, Number "severity";
        severity_sd: f32, Number "severity_sd";
        resonance_hz: f32, Number "resonance_hz";
        damping_per_s: f32, Number "damping_per_s";
        model: u16, Model "model";
        reason: Reason, Reason "reason";
        temperature_c: f32, Temperature "temperature_c";
        drive_voltage_v: f32, Drive "drive_voltage_v";
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
