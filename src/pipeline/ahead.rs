//! Reads on ahead of the stages, piece by piece, for whoever cannot wait for them.

use super::batches::MOST_ROWS;
use super::{Control, PipelineError};
use crate::burst::{Acquisition, Place};
use crate::io::block::Block;
use crate::io::block_reader::{BlockReader, Definitions, Piece};
use crate::io::recording::Recording;
use crate::io::scan::Blocks;
use crossbeam_channel::{Receiver, Sender, bounded};
use std::collections::VecDeque;
use std::thread;

/// How far a recording was taken.
#[derive(Clone, Debug, Default)]
pub struct Reached {
    /// The next piece.
    pub next: Place,
    /// The block that the last piece was of; `None`: none was taken.
    pub block: Option<Block>,
    /// What the blocks up to there define, where the summary does not say it.
    pub definitions: Option<Definitions>,
}

/// Blocks at work or waiting, per reader.
const BLOCKS_PER_READER: usize = 2;
/// Bytes of such blocks from which on no more are taken.
const MANY_BYTES: u64 = 16 << 20;

/// Beyond what was taken.
#[derive(Debug)]
pub struct Ahead {
    blocks: Blocks,
    /// Side by side, where the summary names all channels.
    workers: Option<Sender<Job>>,
    idle: Vec<BlockReader>,
    /// In the recording's order.
    at_work: VecDeque<AtWork>,
    open: Option<Open>,
    next: Place,
}

/// A block that is to be read.
struct Job {
    block: Block,
    reader: BlockReader,
    done: Sender<Open>,
}

/// A block that is being read.
#[derive(Debug)]
struct AtWork {
    bytes: u64,
    done: Receiver<Open>,
}

/// A block that was read.
#[derive(Debug)]
struct Open {
    block: Block,
    reader: BlockReader,
    /// Its first piece, until somebody takes it.
    first: Option<Piece>,
}

impl Open {
    fn load(block: Block, mut reader: BlockReader) -> Open {
        reader.load(&block);
        let first = reader.next_piece(MOST_ROWS);
        Open { block, reader, first }
    }

    fn next_piece(&mut self) -> Option<Piece> {
        self.first.take().or_else(|| self.reader.next_piece(MOST_ROWS))
    }
}

/// Threads that read blocks until nobody asks any more.
fn workers(readers: usize) -> Sender<Job> {
    let (jobs, next) = bounded::<Job>(readers * BLOCKS_PER_READER);
    for _ in 0..readers {
        let next = next.clone();
        thread::spawn(move || {
            for Job { block, reader, done } in next {
                let _ = done.send(Open::load(block, reader)); // else nobody wants it any more
            }
        });
    }
    jobs
}

impl Ahead {
    /// `readers`: threads that read side by side, where a recording allows it.
    pub fn of(recording: &Recording, reached: &Reached, readers: usize) -> Ahead {
        let side_by_side = readers > 1 && recording.channels_known_upfront();
        let at_once = if side_by_side { readers * BLOCKS_PER_READER } else { 1 };
        let reader = || recording.reader_knowing(reached.definitions.as_ref());
        let mut ahead = Ahead {
            blocks: recording.blocks_after(reached.block.as_ref()),
            workers: side_by_side.then(|| workers(readers)),
            idle: (0..at_once).map(|_| reader()).collect(),
            at_work: VecDeque::new(),
            open: None,
            next: reached.next,
        };
        if let Some(block) = reached.block.filter(|block| block.index == reached.next.block) {
            let reader = ahead.idle.pop().unwrap_or_else(reader);
            let mut open = Open::load(block, reader);
            for _ in 0..reached.next.piece {
                open.next_piece();
            }
            ahead.open = Some(open);
        }
        ahead
    }

    /// The next piece, and how far that reaches; `None`: there is no more.
    pub fn piece(
        &mut self,
        recording: &Recording,
        control: &Control,
    ) -> Result<Option<(Vec<Acquisition>, Reached)>, PipelineError> {
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
                    let reached = Reached { next: self.next, block, definitions };
                    return Ok(Some((piece.acquisitions, reached)));
                }
                None => self.idle.extend(self.open.take().map(|open| open.reader)),
            }
        }
    }

    /// The next block, read; others are read meanwhile.
    fn next_block(
        &mut self,
        recording: &Recording,
        control: &Control,
    ) -> Result<Option<Open>, PipelineError> {
        let mut bytes: u64 = self.at_work.iter().map(|block| block.bytes).sum();
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
            let Some(workers) = &self.workers else { return Ok(Some(Open::load(block, reader))) };
            let (done, receiver) = bounded(1);
            let gone = workers.send(Job { block, reader, done }).is_err();
            if gone {
                break;
            }
            bytes += block.bytes;
            self.at_work.push_back(AtWork { bytes: block.bytes, done: receiver });
        }
        match self.at_work.pop_front() {
            None => Ok(None),
            Some(block) => {
                block.done.recv().map(Some).map_err(|_| PipelineError::Panicked("identify"))
            }
        }
    }
}
