//! What a critique rests on, as Parquet: `evidence.parquet` and `residuals.parquet`.
//!
//! In: a [`Critique`]. Out: files under their names once they are complete.

use inkling_io::plain_columns::{Cells, count, flag, number, text, write};
use inkling_io::verdict_table::TableError;
use inkling_lab::critique::finding::Critique;
use std::path::Path;

/// One row per candidate and selection step.
pub fn write_evidence(path: &Path, critique: &Critique) -> Result<(), TableError> {
    let rows = &critique.evidence;
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
        ("tested", flag(rows.iter().map(|e| e.tested))),
        ("accepted", flag(rows.iter().map(|e| e.accepted))),
        ("why_not", text(rows.iter().map(|e| e.why_not.as_str()))),
    ];
    write(path, columns)
}

/// One row per figure, series and point: the numbers behind the report's pictures.
pub fn write_residuals(path: &Path, critique: &Critique) -> Result<(), TableError> {
    let mut rows: Vec<(&str, String, f64, f64, f64, f64)> = Vec::new();
    let f = &critique.figures;
    let m = &f.mean_misfit;
    for k in 0..m.time_s.len() {
        let t = m.time_s[k];
        rows.push((
            "mean_misfit",
            "before".into(),
            t,
            m.before[k],
            m.before_low[k],
            m.before_high[k],
        ));
        rows.push(("mean_misfit", "after".into(), t, m.after[k], m.after_low[k], m.after_high[k]));
    }
    let s = &f.spectrum;
    for k in 0..s.frequency_hz.len() {
        let (x, low, high) = (s.frequency_hz[k], s.band_low[k], s.band_high[k]);
        rows.push(("spectrum", "before".into(), x, s.before[k], low, high));
        rows.push(("spectrum", "after".into(), x, s.after[k], low, high));
    }
    for c in &f.covariates {
        for k in 0..c.centre.len() {
            let name = |when: &str| format!("{} of {}, {when}", c.parameter, c.covariate);
            let (b, bar) = (c.before[k], c.before_bar[k]);
            rows.push(("covariate", name("before"), c.centre[k], b, b - bar, b + bar));
            let (a, bar) = (c.after[k], c.after_bar[k]);
            rows.push(("covariate", name("after"), c.centre[k], a, a - bar, a + bar));
        }
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
