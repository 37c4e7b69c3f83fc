//! Reads a recording on ahead of the stages, piece by piece. This is needed because what judges the first
//! bursts of a printhead is known only from later ones ([`super::models`]).

use super::batches::MOST_ROWS;
use super::{Control, PipelineError};
use crossbeam_channel::{Receiver, Sender, bounded};
use inkling_core::burst::{Acquisition, Place};
use inkling_io::block::Block;
use inkling_io::block_reader::{BlockReader, Definitions, Piece};
use inkling_io::recording::Recording;
use inkling_io::scan::Blocks;
use std::collections::VecDeque;
use std::thread;

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

/// Number of blocks, per reader thread, that are being read or wait for it.
const BLOCKS_PER_READER: usize = 2;
/// Once such blocks hold that many bytes, no more are handed to the threads.
const MANY_BYTES: u64 = 16 << 20;

/// Hands out the pieces of a recording from a position on. Where the file's summary names all channels,
/// threads read several blocks side by side, and the pieces still come in the recording's order.
#[derive(Debug)]
pub struct ReadAhead {
    blocks: Blocks,
    /// Where blocks are sent to be read; `None`: they are read one after another, by the caller.
    workers: Option<Sender<Job>>,
    /// Readers that no block uses.
    idle: Vec<BlockReader>,
    /// The blocks that threads read now, or have read and nobody has taken yet, in the recording's order: their
    /// bytes, and where they come from.
    pending: VecDeque<(u64, Receiver<LoadedBlock>)>,
    /// The block whose pieces are being handed out.
    open: Option<LoadedBlock>,
    next: Place,
}

/// The order to a thread to read a block, with the channel to which it sends what it read.
struct Job {
    block: Block,
    reader: BlockReader,
    done: Sender<LoadedBlock>,
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

/// Starts threads that read blocks; they end when the returned sender is dropped.
fn workers(readers: usize) -> Sender<Job> {
    let (jobs, next) = bounded::<Job>(readers * BLOCKS_PER_READER);
    for _ in 0..readers {
        let next = next.clone();
        thread::spawn(move || {
            for Job { block, reader, done } in next {
                let _ = done.send(LoadedBlock::load(block, reader)); // else nobody wants it any more
            }
        });
    }
    jobs
}

impl ReadAhead {
    /// Begins at `position`; up to `readers` threads read, where the recording allows it.
    pub fn of(recording: &Recording, position: &ReadPosition, readers: usize) -> ReadAhead {
        let side_by_side = readers > 1 && recording.channels_known_upfront;
        let at_once = if side_by_side { readers * BLOCKS_PER_READER } else { 1 };
        let reader = || recording.reader().knowing(position.definitions.as_ref());
        let mut ahead = ReadAhead {
            blocks: recording.blocks().after(position.block.as_ref()),
            workers: side_by_side.then(|| workers(readers)),
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

    /// Waits until the next block was read, and meanwhile gives the threads the blocks after it.
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

            // without threads, the block is read here and now
            let Some(workers) = &self.workers else {
                return Ok(Some(LoadedBlock::load(block, reader)));
            };
            let (done, receiver) = bounded(1);
            let gone = workers.send(Job { block, reader, done }).is_err();
            if gone {
                break;
            }
            bytes += block.bytes;
            self.pending.push_back((block.bytes, receiver));
        }

        // the blocks are taken in the recording's order, so the first that was handed out is waited for
        match self.pending.pop_front() {
            None => Ok(None),
            Some((_, loaded)) => {
                loaded.recv().map(Some).map_err(|_| PipelineError::Panicked("identify"))
            }
        }
    }
}
