//! What is measured: one module a table, each a list of rows that tests assert on and people read.

pub mod closed_set;
pub mod difference;
pub mod episodes;
pub mod families;
pub mod few_labels;
pub mod healthy;
pub mod limits;
pub mod physics;
pub mod together;
pub mod training_sets;

use std::fmt;

/// The default of `detect.false_alarm_rate`.
pub const STATED: f64 = 7e-4;

/// Rows of text, shown as Markdown.
pub struct Shown {
    pub title: String,
    pub head: Vec<String>,
    pub rows: Vec<Vec<String>>,
}

impl Shown {
    /// `head`: the names of the columns, between bars.
    pub fn of<R>(
        title: impl Into<String>,
        head: &str,
        rows: impl IntoIterator<Item = R>,
        cells: impl Fn(R) -> Vec<String>,
    ) -> Shown {
        let head = head.split(" | ").map(str::to_owned).collect();
        Shown { title: title.into(), head, rows: rows.into_iter().map(cells).collect() }
    }
}

impl fmt::Display for Shown {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let all = || std::iter::once(&self.head).chain(&self.rows);
        let widths: Vec<usize> = (0..self.head.len())
            .map(|i| all().map(|row| row[i].chars().count()).max().unwrap_or(0))
            .collect();
        let line = |f: &mut fmt::Formatter, row: &[String]| {
            let cells: Vec<String> =
                row.iter().zip(&widths).map(|(cell, &width)| format!("{cell:width$}")).collect();
            writeln!(f, "| {} |", cells.join(" | "))
        };
        writeln!(f, "\n{}\n", self.title)?;
        line(f, &self.head)?;
        let rule: Vec<String> = widths.iter().map(|&width| "-".repeat(width)).collect();
        line(f, &rule)?;
        self.rows.iter().try_for_each(|row| line(f, row))
    }
}

pub fn percent(share: f64) -> String {
    match 100.0 * share {
        0.0 => "0".into(),
        p if p < 10.0 => format!("{p:.1}"),
        p => format!("{p:.0}"),
    }
}
