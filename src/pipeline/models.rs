//! Answers the identify stage's question which model judges a burst.
//!
//! In: batches in the recording's order ([`Models::see`]). Out: the judge of each of their bursts
//! ([`Models::judge_of`]).
//!
//! Either all models were learned before the stages started, or they are learned as the bursts come
//! (`learning`). What judges the bursts of a printhead's first window is known only after that window: this
//! stage reads the recording on ahead by itself until then ([`ReadAhead`]), and the stages read those blocks a
//! second time when their turn comes, so that batches do not pile up. `position` says up to where everything is
//! learned. It counts bursts and not pieces, since a paced recording is divided otherwise.

use super::batches::{MOST_ROWS, ReadBatch, usable};
use super::learning::Learning;
use super::visit::Pass;
use super::{PipelineError, Result};
use inkling_core::burst::{Acquisition, Burst};
use inkling_core::design::Judge;
use inkling_core::verdict::Reason;
use inkling_io::block::Block;
use inkling_io::block_reader::{BlockReader, Definitions, Piece};
use inkling_io::scan::Blocks;
use std::cmp::Ordering;
use std::collections::VecDeque;
use std::sync::Arc;
use std::thread::{self, JoinHandle};

#[derive(Debug)]
pub struct Models<'a> {
    pub learning: Learning<'a>,
    pass: Pass<'a>,
    /// Up to this position everything is learned.
    position: ReadPosition,
    /// Index of the block that the stages read last, and how many of its acquisitions they have handed over.
    seen: (u64, usize),
    /// Reads on from `position`, while that lies beyond what the stages have read.
    ahead: Option<ReadAhead<'a>>,
}

impl<'a> Models<'a> {
    pub fn new(learning: Learning<'a>, pass: Pass<'a>) -> Models<'a> {
        Models { learning, pass, position: ReadPosition::default(), seen: (0, 0), ahead: None }
    }

    pub fn see(&mut self, read: &ReadBatch) -> Result<()> {
        let acquisitions = &read.batch.acquisitions;
        let before = if self.seen.0 == read.block.index { self.seen.1 } else { 0 };
        self.seen = (read.block.index, before + acquisitions.len());
        let learned = self.position.within(read.block.index, before).min(acquisitions.len());
        let is_whole = read.leaves.is_some();
        if self.learning.over || (learned == acquisitions.len() && self.position.block.is_some()) {
            return Ok(()); // everything was learned before, or this was read ahead
        }
        let (block, taken) = (Some(read.block), (!is_whole).then_some(self.seen.1));
        self.position = ReadPosition { block, taken, definitions: read.definitions.clone() };
        self.ahead = None;
        take(&mut self.learning, &acquisitions[learned..])
    }

    /// The judge of a burst whose batch was seen, or why it is rejected; reads ahead until windows decide.
    pub fn judge_of(&mut self, burst: &Burst) -> Result<Result<Arc<Judge>, Reason>> {
        loop {
            match self.learning.judge_of(burst)? {
                Some(judge) => return Ok(judge),
                None => self.look_ahead()?,
            }
        }
    }

    /// Learns from one more piece beyond what the stages read; at the end of the recording ends the learning.
    fn look_ahead(&mut self) -> Result<()> {
        let (pass, workers) = (self.pass, self.learning.workers);
        let begin = || ReadAhead::of(pass, &self.position, workers);
        match self.ahead.get_or_insert_with(begin).piece()? {
            None => self.learning.end(),
            Some((acquisitions, position)) => {
                self.position = position;
                take(&mut self.learning, &acquisitions)
            }
        }
    }
}

fn take(learning: &mut Learning, of: &[Acquisition]) -> Result<()> {
    let mut bursts: Vec<&Burst> = of.iter().filter_map(usable).collect();
    if !bursts.is_sorted_by_key(|burst| burst.t_acq_ns) {
        bursts.sort_by_key(|burst| burst.t_acq_ns);
    }
    bursts.into_iter().try_for_each(|burst| learning.take(burst))
}

#[derive(Clone, Debug, Default)]
pub struct ReadPosition {
    /// The block that the last piece was part of; `None`: nothing was read yet.
    pub block: Option<Block>,
    /// How many acquisitions of that block were read; `None`: all.
    pub taken: Option<usize>,
    /// What the blocks up to there define, where the file's summary does not say it.
    pub definitions: Option<Definitions>,
}

impl ReadPosition {
    /// How many acquisitions of a block lie before this position, of those from number `from` of the block on.
    fn within(&self, block: u64, from: usize) -> usize {
        match self.block.map(|last| block.cmp(&last.index)) {
            Some(Ordering::Less) => usize::MAX,
            Some(Ordering::Equal) => self.taken.map_or(usize::MAX, |n| n.saturating_sub(from)),
            Some(Ordering::Greater) | None => 0,
        }
    }
}

/// Number of blocks, per worker, that are being read or wait to be taken.
const BLOCKS_PER_READER: usize = 2;
/// Once such blocks hold that many bytes, no more are read.
const MANY_BYTES: u64 = 16 << 20;

/// Hands out the pieces of a recording, in its order, from a position on. Where the file's summary names all
/// channels, several blocks are read side by side.
#[derive(Debug)]
pub struct ReadAhead<'a> {
    pass: Pass<'a>,
    blocks: Blocks,
    /// Readers that no block uses. Their number bounds how many blocks are read at a time.
    idle: Vec<BlockReader>,
    /// The blocks that are being read, or were read and nobody has taken yet, in the recording's order: the
    /// bytes of each, and the thread that reads it.
    pending: VecDeque<(u64, JoinHandle<LoadedBlock>)>,
    /// The block whose pieces are being handed out.
    open: Option<LoadedBlock>,
}

#[derive(Debug)]
struct LoadedBlock {
    block: Block,
    reader: BlockReader,
    /// Its first piece, decoded by the thread that loaded it, until somebody takes it.
    first: Option<Piece>,
    /// How many of its acquisitions were handed out.
    taken: usize,
}

impl LoadedBlock {
    fn load(block: Block, mut reader: BlockReader) -> LoadedBlock {
        reader.load(&block);
        let first = reader.next_piece(MOST_ROWS);
        LoadedBlock { block, reader, first, taken: 0 }
    }

    fn next_piece(&mut self) -> Option<Piece> {
        self.first.take().or_else(|| self.reader.next_piece(MOST_ROWS))
    }

    fn skip(&mut self, mut n: usize) {
        self.taken = n;
        while n > 0
            && let Some(mut piece) = self.next_piece()
        {
            if piece.acquisitions.len() > n {
                piece.acquisitions.drain(..n);
                self.first = Some(piece);
                return;
            }
            n -= piece.acquisitions.len();
        }
    }
}

impl<'a> ReadAhead<'a> {
    /// Begins at `position`, with `readers` workers, where the recording allows several.
    pub fn of(pass: Pass<'a>, position: &ReadPosition, readers: usize) -> ReadAhead<'a> {
        let recording = pass.recording;
        // a block may define channels of later blocks, unless the file's summary names them all
        let side_by_side = readers > 1 && recording.channels_known_upfront;
        let at_once = if side_by_side { readers * BLOCKS_PER_READER } else { 1 };
        let reader = || recording.reader().knowing(position.definitions.as_ref());
        let mut ahead = ReadAhead {
            pass,
            blocks: recording.blocks().after(position.block.as_ref()),
            idle: (0..at_once).map(|_| reader()).collect(),
            pending: VecDeque::new(),
            open: None,
        };

        // the position may lie within a block: load the block again, and skip what was handed out
        if let (Some(block), Some(taken)) = (position.block, position.taken) {
            let reader = ahead.idle.pop().unwrap_or_else(reader);
            let mut open = LoadedBlock::load(block, reader);
            open.skip(taken);
            ahead.open = Some(open);
        }
        ahead
    }

    /// The next piece, and the position behind it; `None`: the recording has no more.
    pub fn piece(&mut self) -> Result<Option<(Vec<Acquisition>, ReadPosition)>> {
        loop {
            self.pass.control.check()?;

            if self.open.is_none() {
                self.open = self.next_block()?;
            }
            let Some(open) = &mut self.open else { return Ok(None) };

            let Some(piece) = open.next_piece() else {
                self.idle.extend(self.open.take().map(|open| open.reader));
                continue;
            };
            open.taken += piece.acquisitions.len();
            let (block, definitions) = (Some(open.block), open.reader.definitions());
            let taken = (!piece.last).then_some(open.taken);
            let position = ReadPosition { block, taken, definitions };
            return Ok(Some((piece.acquisitions, position)));
        }
    }

    /// Waits until the next block was read; meanwhile blocks after it are read, as long as not too many bytes wait.
    fn next_block(&mut self) -> Result<Option<LoadedBlock>> {
        let mut bytes: u64 = self.pending.iter().map(|(bytes, _)| bytes).sum();
        while bytes < MANY_BYTES
            && let Some(reader) = self.idle.pop()
        {
            let block = match self.pass.control.next_block(self.pass.recording, &mut self.blocks)? {
                None => break,
                Some(Ok(block)) => block,
                Some(Err(_)) => {
                    self.idle.push(reader); // the stages tell of it
                    continue;
                }
            };
            bytes += block.held_bytes();
            let loading = thread::spawn(move || LoadedBlock::load(block, reader));
            self.pending.push_back((block.held_bytes(), loading));
        }

        let next = self.pending.pop_front().map(|(_, loading)| loading.join()).transpose();
        next.map_err(|_| PipelineError::Panicked("identify"))
    }
}
