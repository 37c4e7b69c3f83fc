//! The tables on which a critique rests, as Parquet: `evidence.parquet` and `residuals.parquet`.
//!
//! In: a [`Critique`]. Out: the files, which get their names once they are complete.

use inkling_io::plain_columns::{Cells, count, flag, number, text, write};
use inkling_io::verdict_table::TableError;
use inkling_lab::critique::finding::{Compared, Critique, Evidence};
use std::path::Path;

/// Writes the evidence: one row per candidate cause and selection step.
pub fn write_evidence(path: &Path, critique: &Critique) -> Result<(), TableError> {
    let rows = &critique.evidence;
    let why_not: Vec<String> = rows.iter().map(Evidence::why_not_in_words).collect();
    let columns: Vec<(&str, Cells)> = vec![
        ("step", count(rows.iter().map(|e| e.step))),
        ("id", text(rows.iter().map(|e| e.id.name()))),
        ("statistic", number(rows.iter().map(|e| e.statistic))),
        ("threshold", number(rows.iter().map(|e| e.threshold))),
        ("p", number(rows.iter().map(|e| e.p))),
        ("delta_bic", number(rows.iter().map(|e| e.delta_bic))),
        ("strength_dl", number(rows.iter().map(|e| e.strength_dl))),
        ("value", number(rows.iter().map(|e| e.value))),
        ("sd", number(rows.iter().map(|e| e.sd))),
        ("tested", flag(rows.iter().map(|e| e.tested()))),
        ("accepted", flag(rows.iter().map(|e| e.accepted()))),
        ("why_not", text(why_not.iter().map(String::as_str))),
    ];
    write(path, columns)
}

/// Writes the numbers behind the report's figures: one row per figure, series and point.
pub fn write_residuals(path: &Path, critique: &Critique) -> Result<(), TableError> {
    let mut rows: Vec<(&str, String, f64, f64, f64, f64)> = Vec::new();
    let mut add = |figure, of: &str, compared: &Compared| {
        for (k, x) in compared.x.iter().enumerate() {
            for (when, curve) in [("before", &compared.before), ("after", &compared.after)] {
                let series = format!("{of}{when}");
                rows.push((figure, series, *x, curve.y[k], curve.low[k], curve.high[k]));
            }
        }
    };
    add("mean_misfit", "", &critique.figures.mean_misfit);
    add("spectrum", "", &critique.figures.spectrum);
    for c in &critique.figures.covariates {
        add("covariate", &format!("{} of {}, ", c.parameter, c.covariate), &c.means);
    }
    let columns: Vec<(&str, Cells)> = vec![
        ("figure", text(rows.iter().map(|r| r.0))),
        ("series", text(rows.iter().map(|r| r.1.as_str()))),
        ("x", number(rows.iter().map(|r| r.2))),
        ("y", number(rows.iter().map(|r| r.3))),
        ("low", number(rows.iter().map(|r| r.4))),
        ("high", number(rows.iter().map(|r| r.5))),
    ];
    write(path, columns)
}
