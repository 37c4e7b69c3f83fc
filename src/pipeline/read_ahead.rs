//! Reads a recording on ahead of the stages, piece by piece. This is needed because what judges the first
//! bursts of a printhead is known only from later ones ([`super::models`]).

use super::batches::MOST_ROWS;
use super::{Control, PipelineError};
use inkling_core::burst::{Acquisition, Place};
use inkling_io::block::Block;
use inkling_io::block_reader::{BlockReader, Definitions, Piece};
use inkling_io::recording::Recording;
use inkling_io::scan::Blocks;
use std::collections::VecDeque;
use std::thread::{self, JoinHandle};

/// A position up to which a recording was read.
#[derive(Clone, Debug, Default)]
pub struct ReadPosition {
    /// The place of the next piece.
    pub next: Place,
    /// The block that the last piece was part of; `None`: nothing was read yet.
    pub block: Option<Block>,
    /// What the blocks up to there define, where the file's summary does not say it.
    pub definitions: Option<Definitions>,
}

/// Number of blocks, per worker, that are being read or wait to be taken.
const BLOCKS_PER_READER: usize = 2;
/// Once such blocks hold that many bytes, no more are read.
const MANY_BYTES: u64 = 16 << 20;

/// Hands out the pieces of a recording from a position on. Where the file's summary names all channels,
/// several blocks are read side by side, and the pieces still come in the recording's order.
#[derive(Debug)]
pub struct ReadAhead {
    blocks: Blocks,
    /// Readers that no block uses.
    idle: Vec<BlockReader>,
    /// The bytes of the blocks that are being read now, or were read and nobody has taken yet, in the
    /// recording's order, each with the thread that reads it.
    pending: VecDeque<(u64, JoinHandle<LoadedBlock>)>,
    /// The block whose pieces are being handed out.
    open: Option<LoadedBlock>,
    next: Place,
}

/// A block that was read, with the reader that gives its pieces.
#[derive(Debug)]
struct LoadedBlock {
    block: Block,
    reader: BlockReader,
    /// Its first piece, decoded by the thread that loaded it, until somebody takes it.
    first: Option<Piece>,
}

impl LoadedBlock {
    /// Reads a block and decodes its first piece.
    fn load(block: Block, mut reader: BlockReader) -> LoadedBlock {
        reader.load(&block);
        let first = reader.next_piece(MOST_ROWS);
        LoadedBlock { block, reader, first }
    }

    /// The next piece; `None`: the block has no more.
    fn next_piece(&mut self) -> Option<Piece> {
        self.first.take().or_else(|| self.reader.next_piece(MOST_ROWS))
    }
}

impl ReadAhead {
    /// Begins at `position`, with `readers` workers, where the recording allows several.
    pub fn of(recording: &Recording, position: &ReadPosition, readers: usize) -> ReadAhead {
        let side_by_side = readers > 1 && recording.channels_known_upfront;
        let at_once = if side_by_side { readers * BLOCKS_PER_READER } else { 1 };
        let reader = || recording.reader().knowing(position.definitions.as_ref());
        let mut ahead = ReadAhead {
            blocks: recording.blocks().after(position.block.as_ref()),
            idle: (0..at_once).map(|_| reader()).collect(),
            pending: VecDeque::new(),
            open: None,
            next: position.next,
        };
        // the position may lie within a block: load it again, and skip the pieces that were handed out
        if let Some(block) = position.block.filter(|block| block.index == position.next.block) {
            let reader = ahead.idle.pop().unwrap_or_else(reader);
            let mut open = LoadedBlock::load(block, reader);
            for _ in 0..position.next.piece {
                open.next_piece();
            }
            ahead.open = Some(open);
        }
        ahead
    }

    /// The next piece, and the position behind it; `None`: the recording has no more.
    pub fn piece(
        &mut self,
        recording: &Recording,
        control: &Control,
    ) -> Result<Option<(Vec<Acquisition>, ReadPosition)>, PipelineError> {
        loop {
            control.check()?;
            let Some(open) = &mut self.open else {
                match self.next_block(recording, control)? {
                    None => return Ok(None),
                    Some(open) => {
                        self.next = Place { block: open.block.index, piece: 0 };
                        self.open = Some(open);
                    }
                }
                continue;
            };

            match open.next_piece() {
                Some(piece) => {
                    self.next = self.next.following(piece.last);
                    let (block, definitions) = (Some(open.block), open.reader.definitions());
                    let position = ReadPosition { next: self.next, block, definitions };
                    return Ok(Some((piece.acquisitions, position)));
                }
                None => self.idle.extend(self.open.take().map(|open| open.reader)),
            }
        }
    }

    /// Waits until the next block was read, and meanwhile lets the blocks after it be read.
    fn next_block(
        &mut self,
        recording: &Recording,
        control: &Control,
    ) -> Result<Option<LoadedBlock>, PipelineError> {
        let mut bytes: u64 = self.pending.iter().map(|(bytes, _)| bytes).sum();
        while bytes < MANY_BYTES
            && let Some(reader) = self.idle.pop()
        {
            let block = match control.next_block(recording, &mut self.blocks)? {
                None => break,
                Some(Ok(block)) => block,
                Some(Err(_)) => {
                    self.idle.push(reader); // the stages tell of it
                    continue;
                }
            };
            bytes += block.bytes;
            let loading = thread::spawn(move || LoadedBlock::load(block, reader));
            self.pending.push_back((block.bytes, loading));
        }

        // the blocks are taken in the recording's order, so the first that was handed out is waited for
        let next = self.pending.pop_front().map(|(_, loading)| loading.join()).transpose();
        next.map_err(|_| PipelineError::Panicked("identify"))
    }
}
