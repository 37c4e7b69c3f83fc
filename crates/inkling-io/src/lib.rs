//! Reads and writes all files of inkling: recordings and tables in, verdicts and labels in
//! and out, on disks and in object stores.
//!
//! In: files that anybody may have written, cut short or damaged. Out: bursts, labels and verdicts
//! of `inkling-core`, and an account of whatever was lost ([`damage::Damage`]). This crate must
//! never trust a size, panic on bad input, or leave a half-written file under its final name (the
//! journal alone is appended to, line by line).
//!
//! A recording passes through `source` (bytes), `recording` (opens, finds the summary), `scan`
//! (finds blocks), `block_reader` with `chunk_loader` and `channels` (blocks to messages),
//! `burst_codec` or `dialect` (messages to bursts). Verdicts pass through `verdict_table` (writer),
//! `verdict_chunk` and `column` (encoding), and come back by `verdict_reader`.
//!
//! ```text
//! recordings  recording mcap_summary peek source scan block block_reader chunk_loader decompress
//!             mcap_records channels burst_codec dialect followed growth digest census damage;
//!             written by recording_writer mcap_file memory_recording
//! results     verdict_* column column_types row_table episode_table summary_file annotation_writer
//!             baseline_file result_file
//! foreign     table_file table_columns table_order csv_* columnar plain_columns arrow_cells sampling*
//!             segments spline time_column; made safe by parquet_* thrift unpanicked
//! people      labels_file
//! made by other verbs than replay  design_file truth_file
//! places      inputs outputs layout job journal run_lock part_file stored objects regular_file stamp
//! what is told  file_error printable
//! ```

pub mod annotation_writer;
mod arrow_cells;
pub mod baseline_file;
pub mod block;
pub mod block_reader;
pub mod burst_codec;
pub mod census;
mod channels;
mod chunk_loader;
mod column;
pub mod column_types;
pub mod columnar;
mod csv_cells;
pub mod csv_table;
mod csv_units;
pub mod damage;
pub mod decompress;
pub mod design_file;
pub mod dialect;
pub mod digest;
pub mod episode_table;
pub mod file_error;
mod followed;
pub mod growth;
mod input_pattern;
pub mod inputs;
pub mod job;
pub mod journal;
pub mod labels_file;
pub mod layout;
mod mcap_file;
mod mcap_records;
mod mcap_summary;
pub mod memory_recording;
pub mod objects;
pub mod outputs;
mod parquet_claims;
pub mod parquet_file;
pub mod part_file;
pub mod peek;
pub mod plain_columns;
pub mod printable;
pub mod recording;
pub mod recording_writer;
pub mod regular_file;
pub mod result_file;
pub mod row_table;
pub mod run_lock;
pub mod sampling;
mod sampling_times;
pub mod scan;
mod segments;
mod source;
mod spline;
mod stamp;
pub mod stored;
pub mod summary_file;
mod table_columns;
pub mod table_file;
pub mod table_order;
pub mod table_text;
mod thrift;
pub mod time_column;
pub mod truth_file;
pub mod unpanicked;
pub mod unread_file;
pub mod verdict_arrays;
mod verdict_chunk;
mod verdict_columns;
pub mod verdict_reader;
pub mod verdict_table;
pub mod when;

#[cfg(test)]
mod documented;
#[cfg(test)]
mod fixtures;
#[cfg(test)]
mod recording_tests;

/// The largest pieces that a reader of recordings takes into memory, whatever a file claims.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// The default is 1 MiB more than `chunk_bytes`, because the record of a chunk without
    /// compression holds the chunk's header, too.
    pub record_bytes: u64,
    /// Bytes of the largest uncompressed chunk.
    pub chunk_bytes: u64,
    pub channels: u32,
    pub samples_per_channel: u32,
    pub samples_bytes: u64,
}

impl Default for Limits {
    fn default() -> Limits {
        Limits {
            record_bytes: 257 << 20,
            chunk_bytes: 256 << 20,
            channels: 65_536,
            samples_per_channel: 65_536,
            samples_bytes: 256 << 20,
        }
    }
}
