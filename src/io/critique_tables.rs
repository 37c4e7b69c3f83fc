//! What a critique rests on, as Parquet: `evidence.parquet` and `residuals.parquet`.
//!
//! In: a [`Critique`]. Out: files under their names once they are complete.

use super::row_table;
use super::verdict_table::TableError;
use crate::critique::finding::{Compared, Critique};
use arrow_array::{ArrayRef, BooleanArray, Float64Array, RecordBatch, StringArray, UInt32Array};
use std::path::Path;
use std::sync::Arc;

fn number(values: impl Iterator<Item = f64>) -> ArrayRef {
    // what is no number is null, not NaN
    Arc::new(values.map(|v| v.is_finite().then_some(v)).collect::<Float64Array>())
}

fn text<'a>(values: impl Iterator<Item = &'a str>) -> ArrayRef {
    Arc::new(StringArray::from_iter_values(values))
}

/// One row per candidate and selection step.
pub fn write_evidence(path: &Path, critique: &Critique) -> Result<(), TableError> {
    let rows = &critique.evidence;
    let columns: Vec<(&str, ArrayRef)> = vec![
        ("step", Arc::new(UInt32Array::from_iter_values(rows.iter().map(|e| e.step)))),
        ("id", text(rows.iter().map(|e| e.id.name()))),
        ("statistic", number(rows.iter().map(|e| e.statistic))),
        ("threshold", number(rows.iter().map(|e| e.threshold))),
        ("p", number(rows.iter().map(|e| e.p))),
        ("delta_bic", number(rows.iter().map(|e| e.delta_bic))),
        ("strength_dl", number(rows.iter().map(|e| e.strength_dl))),
        ("value", number(rows.iter().map(|e| e.value))),
        ("sd", number(rows.iter().map(|e| e.sd))),
        ("tested", Arc::new(rows.iter().map(|e| Some(e.tested)).collect::<BooleanArray>())),
        ("accepted", Arc::new(rows.iter().map(|e| Some(e.accepted)).collect::<BooleanArray>())),
        ("why_not", text(rows.iter().map(|e| e.why_not.as_str()))),
    ];
    write(path, columns)
}

/// One row per figure, series and point: the numbers behind the report's pictures.
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
    let columns: Vec<(&str, ArrayRef)> = vec![
        ("figure", text(rows.iter().map(|r| r.0))),
        ("series", text(rows.iter().map(|r| r.1.as_str()))),
        ("x", number(rows.iter().map(|r| r.2))),
        ("y", number(rows.iter().map(|r| r.3))),
        ("low", number(rows.iter().map(|r| r.4))),
        ("high", number(rows.iter().map(|r| r.5))),
    ];
    write(path, columns)
}

fn write(path: &Path, columns: Vec<(&str, ArrayRef)>) -> Result<(), TableError> {
    let batch = RecordBatch::try_from_iter(columns)
        .map_err(|source| TableError::Columns { path: path.into(), source })?;
    row_table::write(path, &batch)
}
