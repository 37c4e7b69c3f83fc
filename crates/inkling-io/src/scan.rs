//! Finds where the blocks of a recording lie, and where it is damaged.
//!
//! In: an opened file. Out: [`Block`]s in file order, for workers to read and decode, and
//! [`Damage`]. Only headers of records and chunks are read, not what records hold. A block is a
//! chunk record, or a run: consecutive messages outside chunks, with the schemas and channels among
//! them, up to 1 MiB.
//!
//! Each turn of [`Blocks::poll`] looks at the record at `at` and decides on a `Step`. There are
//! two sorts of damage. A record that cannot be used (too large, or at odds with itself) is lost alone: its length is
//! followed on trial, and if that turns out to be wrong, the search goes back to where it began. Where the framing is
//! broken (a record's length cannot be true, or a record stands where it cannot be), the scan goes on at the next chunk
//! that has a checksum and verifies (`resync.rs`), because chunks hold nearly all data and can be recognised by
//! themselves. Messages outside chunks and chunks without a checksum are lost up to there.
//!
//! In a recording that is being written, a record that is not whole may still become so, and
//! [`Blocks::poll`] says that the next block is pending.

mod resync;

use super::Limits;
use super::block::{Block, BlockKind};
use super::damage::Damage;
use super::growth::{EarlyEnds, ends_early, locked};
use super::mcap_records::{ChunkHeader, MAGIC, RECORD_HEADER, RecordHeader, op};
use super::source::Source;
use std::sync::Arc;
use std::task::Poll;

/// A run ends where it would become larger than this; a larger message is a run by itself.
const RUN_BYTES: u64 = 1 << 20;
/// In a recording that is being written, a record that claims more bytes is taken for damage instead of being
/// waited for.
const MOST_AWAITED_BYTES: u64 = 1 << 32;
/// Bytes that are read at once to look at record headers.
const WINDOW_BYTES: u64 = 16 << 10;
/// Bytes that suffice for a chunk's header with a known compression.
const CHUNK_HEADER_BYTES: usize = 64;

#[derive(Debug)]
pub struct Blocks {
    source: Arc<Source>,
    limits: Limits,
    /// Where the data section ends, as the footer says; `None`: there is no footer that could be relied on.
    data_end: Option<u64>,
    /// Set if the recording is being written: what is not whole may still become so.
    growing: Option<Arc<EarlyEnds>>,
    /// The next byte that is looked at: a record should begin here.
    at: u64,
    /// A search for chunks begins here: no chunk that was not given out begins before. It may lie
    /// before `at`, inside a record that was stepped over although its length may have been false.
    known_until: u64,
    /// Where the run under way begins; `None`: there is none.
    run_from: Option<u64>,
    /// Whether the end of the data was passed: what follows is the summary.
    after_data_end: bool,
    /// Whether nothing further is given, except the run under way.
    done: bool,
    index: u64,
    /// The chunk that was given out last.
    last_chunk: Option<Block>,
    failed_resyncs: usize,
    /// The bytes of the file that were read last, and the offset at which they begin.
    window: Vec<u8>,
    window_at: u64,
}

/// What to do with the record that is looked at.
enum Step {
    /// The record holds nothing for us, and no chunk can begin in it before `known_until`.
    Skip { known_until: u64 },
    /// The record belongs to a run: it is a message, schema or channel outside chunks.
    Run,
    /// The record is a chunk; no other chunk can begin before `known_until`.
    Chunk { known_until: u64, decompressed_bytes: u64 },
    /// The record's bytes are lost, but its length is believed: the scan goes on behind it.
    Lost(String),
    /// Not even the record's length is believed: a chunk must be searched for.
    Broken(String),
    /// The record is not whole yet; only in a growing file.
    NotYet,
    /// The recording, or the part of it that holds data, ends here.
    End,
}

impl Blocks {
    pub(super) fn new(source: Arc<Source>, limits: Limits, data_end: Option<u64>) -> Blocks {
        Blocks {
            source,
            limits,
            data_end,
            growing: None,
            at: MAGIC.len() as u64,
            known_until: MAGIC.len() as u64,
            run_from: None,
            after_data_end: false,
            done: false,
            index: 0,
            last_chunk: None,
            failed_resyncs: 0,
            window: Vec::new(),
            window_at: 0,
        }
    }

    pub(super) fn growing(mut self, ends: Arc<EarlyEnds>) -> Blocks {
        self.growing = Some(ends);
        self
    }

    /// Ends the recording where it is: a record that is not whole by now does not count any more.
    pub fn close(&mut self) {
        if self.growing.is_some() && !self.done {
            self.source.cut(self.at);
        }
        (self.growing, self.done) = (None, true);
    }

    /// The blocks that follow `block`; all blocks for `None`.
    pub fn after(mut self, block: Option<&Block>) -> Blocks {
        if let Some(block) = block {
            self.at = block.offset + block.bytes;
            (self.known_until, self.index) = (self.at, block.index + 1);
        }
        self
    }

    fn end(&self) -> u64 {
        self.data_end.unwrap_or(self.source.bytes())
    }

    /// The bytes from `at` on: at least `want` of them, or up to the end if there are fewer.
    fn peek(&mut self, at: u64, want: u64) -> std::io::Result<&[u8]> {
        let end = self.end();
        let want_end = at.saturating_add(want).min(end);
        let window_end = self.window_at + self.window.len() as u64;
        if at < self.window_at || want_end > window_end {
            let n = WINDOW_BYTES.max(want).min(end.saturating_sub(at));
            self.window.resize(n as usize, 0);
            self.window_at = at;
            if let Err(e) = self.source.read_at(at, &mut self.window) {
                self.window.clear();
                return Err(e);
            }
        }
        Ok(&self.window[(at - self.window_at) as usize..])
    }

    /// Looks at the record at `self.at`; gives what to do with it, and where it ends. Whether it is
    /// whole is decided here, whether it can be used in `step_record`.
    fn step(&mut self) -> std::io::Result<(Step, u64)> {
        let (at, end) = (self.at, self.end());
        if at >= end {
            return Ok((self.step_at_end(), end));
        }
        let growing = self.growing.is_some();
        let Some(header) = RecordHeader::parse(self.peek(at, RECORD_HEADER as u64)?) else {
            if growing {
                return Ok((Step::NotYet, end));
            }
            let what = format!("cut short: {} bytes where a record begins", end - at);
            return Ok((Step::Broken(what), end));
        };
        let RecordHeader { opcode, body_bytes } = header;
        let body_at = at + RECORD_HEADER as u64;
        let Some(next) = body_at.checked_add(body_bytes).filter(|&next| next <= end) else {
            if growing && body_bytes <= MOST_AWAITED_BYTES {
                return Ok((Step::NotYet, end));
            }
            let what = format!(
                "cut short: record 0x{opcode:02x} claims {body_bytes} bytes where {} are left",
                end - body_at
            );
            return Ok((Step::Broken(what), end));
        };
        Ok((self.step_record(at, header, next)?, next))
    }

    fn step_record(&mut self, at: u64, header: RecordHeader, next: u64) -> std::io::Result<Step> {
        let (end, growing) = (self.end(), self.growing.is_some());
        let RecordHeader { opcode, body_bytes } = header;
        let body_at = at + RECORD_HEADER as u64;
        let skip = Step::Skip { known_until: next };
        Ok(match opcode {
            op::HEADER if at == MAGIC.len() as u64 => skip,
            _ if at == MAGIC.len() as u64 => Step::Broken("no header record".into()),
            // schemas and channels of the summary, which repeats definitions
            op::SCHEMA | op::CHANNEL if growing && self.after_data_end => skip,
            op::SCHEMA | op::CHANNEL if next - at > self.limits.record_bytes => {
                Step::Lost(format!("schema or channel of {body_bytes} bytes, beyond the limit"))
            }
            op::SCHEMA | op::CHANNEL | op::MESSAGE => Step::Run,
            op::CHUNK => self.step_chunk(body_at, body_bytes)?,
            // the length of the index's entries must fit into the record: so a record whose kind
            // was changed by damage is noticed
            op::MESSAGE_INDEX => {
                let ids = self.peek(body_at, 6)?;
                let map_bytes = ids.get(2..6).and_then(|b| b.first_chunk().copied());
                match map_bytes.map(u32::from_le_bytes) {
                    Some(n) if u64::from(n) + 6 <= body_bytes => {
                        Step::Skip { known_until: body_at + 6 + u64::from(n) }
                    }
                    _ => Step::Lost("message index that does not fit its record".into()),
                }
            }
            op::ATTACHMENT | op::METADATA => skip,
            op::DATA_END if self.data_end.is_none_or(|end| end == next) => {
                self.after_data_end = true;
                skip
            }
            op::DATA_END => Step::Lost("end of data where the data do not end".into()),
            op::CHUNK_INDEX
            | op::ATTACHMENT_INDEX
            | op::STATISTICS
            | op::METADATA_INDEX
            | op::SUMMARY_OFFSET
                if self.after_data_end =>
            {
                skip
            }
            op::FOOTER if self.after_data_end && next + MAGIC.len() as u64 == end => Step::End,
            op::FOOTER if growing && self.after_data_end && next + MAGIC.len() as u64 > end => {
                Step::NotYet
            }
            // Records of later versions and private ones are to be skipped; but not a chunk whose
            // kind was changed by damage.
            0x10..=0xff => {
                let body = self.peek(body_at, CHUNK_HEADER_BYTES as u64)?;
                if ChunkHeader::plausible(body, body_bytes, u64::MAX).is_some() {
                    Step::Lost(format!("record of unknown kind 0x{opcode:02x} that holds a chunk"))
                } else {
                    skip
                }
            }
            op::FOOTER if self.peek(next, 2 * MAGIC.len() as u64)?.starts_with(&MAGIC.repeat(2)) => {
                Step::Broken(
                    "another recording is appended here: keep each in a file of its own, or merge them (`mcap merge`)"
                        .into(),
                )
            }
            _ => Step::Broken(format!("record 0x{opcode:02x} cannot be here")),
        })
    }

    fn step_at_end(&self) -> Step {
        match self.data_end {
            _ if self.growing.is_some() => Step::NotYet,
            Some(_) if !self.after_data_end => Step::Lost("the data have no end record".into()),
            _ => Step::End,
        }
    }

    /// A chunk's header, and the compressed bytes that it claims, must fit into its record.
    fn step_chunk(&mut self, body_at: u64, body_bytes: u64) -> std::io::Result<Step> {
        let record_bytes = body_bytes + RECORD_HEADER as u64;
        if record_bytes > self.limits.record_bytes {
            return Ok(Step::Lost(format!(
                "chunk of {body_bytes} bytes, more than the {} that are read at once",
                self.limits.record_bytes
            )));
        }
        let body = self.peek(body_at, body_bytes.min(1 << 10))?;
        let body = &body[..body.len().min(body_bytes as usize)];
        Ok(match ChunkHeader::parse(body) {
            Some(h) if h.compressed_size <= body_bytes - h.header_bytes => Step::Chunk {
                known_until: body_at + h.header_bytes + h.compressed_size,
                // one that claims more than the limit is not decompressed
                decompressed_bytes: match h.compression.is_empty() {
                    true => 0,
                    false => h.uncompressed_size.min(self.limits.chunk_bytes),
                },
            },
            _ => Step::Lost("chunk header that does not fit its record".into()),
        })
    }

    fn block(&mut self, kind: BlockKind, offset: u64, to: u64) -> Block {
        let index = self.index;
        self.index += 1;
        Block { index, offset, bytes: to - offset, decompressed_bytes: 0, kind }
    }

    /// Pending only if the recording is being written and nothing further is whole.
    pub fn poll(&mut self) -> Poll<Option<Result<Block, Damage>>> {
        let run_bytes = RUN_BYTES.min(self.limits.record_bytes);
        let growing = self.growing.clone();
        while !self.done {
            // 1. What to do with the record at `at`. Several readers scan a growing file, and all must end their runs at
            //    the same places, or their blocks have other numbers: `EarlyEnds` remembers these places, and is locked
            //    until this reader has decided.
            let mut ends = growing.as_ref().map(|ends| locked(ends));
            let (step, next) = match self.step() {
                Ok(found) => found,
                Err(e) => (Step::Broken(format!("cannot be read: {e}")), self.end()),
            };

            // 2. in a growing file: does the run under way end here for all readers?
            let is_whole = !matches!(step, Step::NotYet);
            let ends_now = ends.as_mut().filter(|_| self.run_from.is_some());
            let early = ends_now.is_some_and(|ends| ends_early(ends, self.at, is_whole));
            drop(ends);

            // 3. a run that does not go on is given out, and the record is looked at again in the
            //    next turn
            let run_goes_on = matches!(step, Step::Run)
                && !early
                && self.run_from.is_none_or(|from| next - from <= run_bytes);
            if let Some(from) = self.run_from.filter(|_| !run_goes_on) {
                self.run_from = None;
                return Poll::Ready(Some(Ok(self.block(BlockKind::Messages, from, self.at))));
            }

            // 4. the step itself
            let at = self.at;
            match step {
                Step::End => self.done = true,
                Step::Skip { known_until } => self.advance(next, known_until),
                Step::Run => {
                    self.run_from.get_or_insert(at);
                    self.advance(next, next);
                }
                Step::Chunk { known_until, decompressed_bytes } => {
                    self.advance(next, known_until);
                    let block = self.block(BlockKind::Chunk, at, next);
                    let block = Block { decompressed_bytes, ..block };
                    self.last_chunk = Some(block);
                    return Poll::Ready(Some(Ok(block)));
                }
                Step::Lost(what) => {
                    if at >= next {
                        self.done = true;
                    }
                    self.advance(next, next.min(at + 1));
                    return Poll::Ready(Some(Err(Damage { from_byte: at, to_byte: next, what })));
                }
                Step::Broken(what) => return Poll::Ready(Some(Err(self.resync(what)))),
                Step::NotYet => return Poll::Pending,
            }
        }
        let run = self.run_from.take();
        Poll::Ready(run.map(|from| Ok(self.block(BlockKind::Messages, from, self.at))))
    }

    fn advance(&mut self, next: u64, known_until: u64) {
        self.at = next;
        self.known_until = known_until;
    }
}

impl Iterator for Blocks {
    type Item = Result<Block, Damage>;

    /// The next block. A recording that is being written ends with what is whole by now.
    fn next(&mut self) -> Option<Result<Block, Damage>> {
        match self.poll() {
            Poll::Ready(found) => found,
            Poll::Pending => {
                self.close();
                None
            }
        }
    }
}
