//! Writes the faults of a report to the Parquet file `report.faults.parquet` (`schemas/faults.md`). In: the
//! report's faults, the most urgent first. Out: one row for each.

use crate::report::{self, Fault};
use inkling_io::column_types::TimestampUnit;
use inkling_io::row_table::{self, Column, Kind};
use inkling_io::verdict_table::TableError;
use serde_json::{Value, json};
use std::path::Path;
use std::sync::Arc;

/// The columns in the table's order.
static COLUMNS: [Column; 16] = [
    Column::required("printhead", Kind::Name),
    Column::required("channel", Kind::Count),
    Column::nullable("category", Kind::Name),
    Column::nullable("fault", Kind::Name),
    Column::required("began_at", Kind::Time),
    Column::nullable("ended_at", Kind::Time),
    Column::required("recordings", Kind::Count),
    Column::required("episodes", Kind::Count),
    Column::nullable("severity_first", Kind::Number),
    Column::nullable("severity_last", Kind::Number),
    Column::nullable("severity_per_day", Kind::Number),
    Column::nullable("certainty", Kind::Number),
    Column::nullable("reason", Kind::Name),
    Column::required("urgency", Kind::Number),
    Column::required("action", Kind::Name),
    Column::required("sentence", Kind::Text),
];

/// The cells of a fault, by column.
fn row(fault: &Fault) -> Value {
    let Fault { story, urgency, action, sentence, .. } = fault;
    json!({
        "printhead": story.printhead,
        "channel": story.channel,
        "category": story.category,
        "fault": story.fault,
        "began_at": story.began_at_ns,
        "ended_at": story.ended_at_ns,
        "recordings": story.recordings,
        "episodes": story.spells.len(),
        "severity_first": story.severity_first,
        "severity_last": story.severity_last,
        "severity_per_day": per_day(fault),
        "certainty": story.certainty,
        "reason": story.reason(),
        "urgency": urgency,
        "action": action,
        "sentence": sentence,
    })
}

/// The trend of the severity, if it is certain. A trend of the distance from healthy is none.
fn per_day(fault: &Fault) -> Option<f64> {
    let is_sized = fault.story.severity_last.is_some();
    report::certain_trend(&fault.story).filter(|_| is_sized).map(|trend| trend.per_day)
}

/// Writes the table. The file gets its name once it is complete.
pub fn write(path: &Path, faults: &[Fault]) -> Result<(), TableError> {
    let schema = Arc::new(row_table::schema(&COLUMNS, TimestampUnit::Ns));
    let rows: Vec<Value> = faults.iter().map(row).collect();
    let batch = row_table::batch(&COLUMNS, schema, TimestampUnit::Ns, &rows)
        .map_err(TableError::columns(path))?;
    row_table::write(path, &batch)
}

#[cfg(test)]
#[path = "../../crates/inkling-io/src/documented.rs"]
mod documented;

#[cfg(test)]
mod tests {
    use super::documented::is_documented;
    use super::*;

    #[test]
    fn schema_is_the_documented_one() {
        let page = include_str!("../../schemas/faults.md");
        is_documented(page, &row_table::schema(&COLUMNS, TimestampUnit::Ns));
    }
}
