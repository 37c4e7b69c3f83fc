//! An MCAP file that is being written: under its name once it is whole.

use super::damage::RecordingError;
use super::part_file::PartFile;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

type Writer = mcap::Writer<BufWriter<File>>;

pub(super) struct McapFile {
    // Some until finished or dropped.
    writer: Option<Writer>,
    part: Option<PartFile>,
    path: PathBuf,
}

impl McapFile {
    pub fn create(path: &Path, options: mcap::WriteOptions) -> Result<McapFile, RecordingError> {
        let (part, file) = PartFile::create(path)
            .map_err(|source| RecordingError::Write { path: path.to_path_buf(), source })?;
        let writer = options
            .create(BufWriter::with_capacity(1 << 16, file))
            .map_err(|source| RecordingError::Mcap { path: path.to_path_buf(), source })?;
        Ok(McapFile { writer: Some(writer), part: Some(part), path: path.to_path_buf() })
    }

    /// Writes something.
    pub fn with<T>(
        &mut self,
        write: impl FnOnce(&mut Writer) -> Result<T, mcap::McapError>,
    ) -> Result<T, RecordingError> {
        let written = match &mut self.writer {
            Some(writer) => write(writer),
            None => Err(mcap::McapError::AttemptedWriteAfterFailure),
        };
        written.map_err(|source| self.failed(source))
    }

    /// Completes the file and gives it its name.
    pub fn finish(mut self) -> Result<(), RecordingError> {
        self.with(|writer| writer.finish().map(drop))?;
        let (Some(writer), Some(part)) = (self.writer.take(), self.part.take()) else {
            return Ok(()); // unreachable: both are there until finish or drop
        };
        let failed = |source| RecordingError::Write { path: self.path.clone(), source };
        let file = writer.into_inner().into_inner().map_err(|e| failed(e.into_error()))?;
        part.finish(&file).map_err(failed)
    }

    fn failed(&self, source: mcap::McapError) -> RecordingError {
        let path = self.path.clone();
        match source {
            mcap::McapError::Io(source) => RecordingError::Write { path, source },
            source => RecordingError::Mcap { path, source },
        }
    }
}

impl Drop for McapFile {
    fn drop(&mut self) {
        // Not finished: without into_inner the mcap writer would write its summary first.
        if let Some(writer) = self.writer.take() {
            writer.into_inner();
        }
    }
}
