//! A check for tests of tables: the columns that the code writes are those that a page of
//! `schemas/` documents. Not part of the product.

use arrow_schema::{DataType, Field, Schema, TimeUnit};

/// Panics unless the table of columns on a page of `schemas/` (`page`: its Markdown) has just the
/// columns of `schema`, with the same types and in the same order.
pub fn is_documented(page: &str, schema: &Schema) {
    let documented = page.lines().filter_map(|line| {
        let mut cells = line.strip_prefix("| `")?.split(" | ");
        let name = cells.next()?.trim_end_matches('`').to_string();
        Some((name, cells.next()?.to_string()))
    });
    let in_words = |field: &Field| {
        let kind = match field.data_type() {
            DataType::Timestamp(TimeUnit::Nanosecond, Some(zone)) => {
                format!("timestamp(ns, {zone})")
            }
            DataType::Dictionary(_, of) if **of == DataType::Utf8 => "dictionary of utf8".into(),
            DataType::FixedSizeList(..) => "fixed-size list of float32".into(),
            plain => plain.to_string().to_lowercase(),
        };
        let nullable = if field.is_nullable() { ", nullable" } else { "" };
        (field.name().clone(), kind + nullable)
    };
    let in_code: Vec<_> = schema.fields().iter().map(|field| in_words(field)).collect();
    assert_eq!(documented.collect::<Vec<_>>(), in_code);
}
