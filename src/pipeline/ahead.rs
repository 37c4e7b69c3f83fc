//! Reads on ahead of the stages, piece by piece, for whoever cannot wait for them.

use super::batches::MOST_ROWS;
use super::{Control, PipelineError};
use crate::burst::{Acquisition, Place};
use crate::io::block::Block;
use crate::io::block_reader::{BlockReader, Definitions};
use crate::io::recording::Recording;
use crate::io::scan::Blocks;

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

/// Beyond what was taken.
#[derive(Debug)]
pub struct Ahead {
    blocks: Blocks,
    reader: BlockReader,
    /// The block that is open.
    block: Option<Block>,
    next: Place,
}

impl Ahead {
    pub fn of(recording: &Recording, reached: &Reached) -> Ahead {
        let mut ahead = Ahead {
            blocks: recording.blocks_after(reached.block.as_ref()),
            reader: recording.reader_knowing(reached.definitions.as_ref()),
            block: None,
            next: reached.next,
        };
        if let Some(block) = reached.block.filter(|block| block.index == reached.next.block) {
            ahead.reader.load(&block);
            for _ in 0..reached.next.piece {
                ahead.reader.next_piece(MOST_ROWS);
            }
            ahead.block = Some(block);
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
            if let Some(block) = self.block {
                if let Some(piece) = self.reader.next_piece(MOST_ROWS) {
                    self.next = self.next.following(piece.last);
                    let definitions = self.reader.definitions();
                    let reached = Reached { next: self.next, block: Some(block), definitions };
                    return Ok(Some((piece.acquisitions, reached)));
                }
                self.block = None;
            }
            match control.next_block(recording, &mut self.blocks)? {
                None => return Ok(None),
                Some(Err(_)) => {} // the stages tell of it
                Some(Ok(block)) => {
                    self.reader.load(&block);
                    self.next = Place { block: block.index, piece: 0 };
                    self.block = Some(block);
                }
            }
        }
    }
}
