//! `--rotate`: writes what is judged of a recording that is still being written part by part. Each part is
//! closed after a span of recording time, and is from then on a table that can be read.
//!
//! In: the batches that the writer appends to the table, from `wiring` ([`PartWriter::write`]). Out: parts
//! ([`inkling_io::part_tables`]), which get their names when they are complete, and of each a call to whoever
//! watches. When the recording is closed, `finish` removes all parts, as the table holds every row.

use super::batches::JudgedBatch;
use super::job::{ClosedPart, Rotation, Run};
use super::part_boundaries::{PartBoundaries, Section};
use super::{PipelineError, Result, metadata};
use inkling_core::design::Judge;
use inkling_io::file_error::FileError;
use inkling_io::part_file;
use inkling_io::part_tables::{Beginning, PartTables};
use inkling_io::recording::Recording;
use inkling_io::verdict_table::{TableOptions, VerdictWriter};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

pub struct PartWriter<'a> {
    rotation: Rotation<'a>,
    run: Run<'a>,
    /// As of the table.
    options: TableOptions,
    tables: PartTables,
    boundaries: PartBoundaries,
    /// How the recording begins, as the first part noted it.
    begins: Option<Beginning>,
    closed: u32,
    /// The part at hand; `None`: no row came since the last one was closed.
    open: Option<OpenPart>,
}

struct OpenPart {
    writer: VerdictWriter,
    /// t_a of its earliest and of its latest burst, ns.
    from_ns: i64,
    to_ns: i64,
    /// The judges of its signals, by their models' numbers.
    judges: BTreeMap<u16, Arc<Judge>>,
}

impl<'a> PartWriter<'a> {
    /// `verdicts`: the path that the table will have.
    pub fn new(
        rotation: Rotation<'a>,
        run: Run<'a>,
        verdicts: &Path,
        options: TableOptions,
    ) -> Self {
        let span_ns = i64::try_from(rotation.every.as_nanos()).unwrap_or(i64::MAX);
        PartWriter {
            rotation,
            run,
            options,
            tables: PartTables::beside(verdicts),
            boundaries: PartBoundaries::new(span_ns),
            begins: None,
            closed: 0,
            open: None,
        }
    }

    pub fn write(&mut self, judged: &mut JudgedBatch) -> Result<()> {
        let sections = self.boundaries.cut(&judged.verdicts);
        // a section is written as the batch with only the section's rows listed: so no row is copied
        let whole = std::mem::take(&mut judged.verdicts.parts);
        for (nth, section) in sections.into_iter().enumerate() {
            if nth > 0 {
                self.close()?;
            }
            if !section.parts.is_empty() {
                self.append(section, judged)?;
            }
        }
        judged.verdicts.parts = whole;
        Ok(())
    }

    fn append(&mut self, section: Section, judged: &mut JudgedBatch) -> Result<()> {
        let open = match &mut self.open {
            Some(open) => open,
            none => {
                let path = self.tables.path(self.closed + 1);
                let writer = VerdictWriter::create(&path, self.options.clone())?;
                let (from_ns, to_ns) = (i64::MAX, i64::MIN);
                none.insert(OpenPart { writer, from_ns, to_ns, judges: BTreeMap::new() })
            }
        };
        open.from_ns = open.from_ns.min(section.from_ns);
        open.to_ns = open.to_ns.max(section.to_ns);
        for judge in &judged.judges {
            open.judges.entry(judge.index).or_insert_with(|| judge.clone());
        }
        judged.verdicts.parts = section.parts;
        Ok(open.writer.write(&judged.verdicts)?)
    }

    fn close(&mut self) -> Result<()> {
        let Some(OpenPart { writer, from_ns, to_ns, judges }) = self.open.take() else {
            return Ok(());
        };
        let number = self.closed + 1;
        let path = self.tables.path(number);
        let failed = FileError::unwritten(&path);
        let part = ClosedPart { number, path: path.clone(), rows: writer.rows(), from_ns, to_ns };

        let begins = match &mut self.begins {
            Some(begins) => &*begins,
            none => none.insert(Beginning::of(self.run.recording).map_err(failed)?),
        };
        let judges = judges.values().map(|judge| &**judge);
        let document =
            metadata::of_part(self.run.replay, self.run.recording, begins, judges, &part);
        let document = serde_json::to_string(&document).map_err(|e| failed(e.into()))?;
        let complete = writer.complete(document)?;

        // its name; another file may have come to lie there since `make_room`
        if path.exists() {
            return Err(PipelineError::PartTaken { path });
        }
        complete.name().and_then(|()| part_file::sync_directory_of(&path)).map_err(failed)?;
        self.closed = number;
        (self.rotation.closed)(&part);
        Ok(())
    }
}

/// A part that was not closed is discarded, and the directory of parts if it is empty.
impl Drop for PartWriter<'_> {
    fn drop(&mut self) {
        self.open = None;
        self.tables.remove_empty();
    }
}

/// Removes the parts of this recording. Returns the first other file that has the name of a part.
pub fn remove(verdicts: &Path, recording: &Recording) -> Result<Option<PathBuf>> {
    let tables = PartTables::beside(verdicts);
    Ok(tables.remove_of(recording).map_err(FileError::unwritten(&tables.dir))?)
}

/// Removes the parts that an earlier run left; an error if other files are in the way of new ones.
pub fn make_room(verdicts: &Path, recording: &Recording) -> Result<()> {
    match remove(verdicts, recording)? {
        Some(path) => Err(PipelineError::PartTaken { path }),
        None => Ok(()),
    }
}
