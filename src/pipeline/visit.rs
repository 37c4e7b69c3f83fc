//! Visits the bursts of a recording in one pass outside the stages, on one thread: [`Pass`]. In: an opened
//! recording, and a function. Out: the function is called with each burst in file order, and what was damaged or
//! unusable is returned. An interruption is the only error.

use super::batches::MOST_ROWS;
use super::{Control, Result};
use inkling_core::burst::{Acquisition, Burst};
use inkling_core::fault::HEALTHY;
use inkling_core::labels::Labels;
use inkling_io::block_reader::BlockReader;
use inkling_io::damage::{Damage, note};
use inkling_io::recording::Recording;
use std::sync::atomic::Ordering;

/// What a pass met besides usable bursts.
#[derive(Debug, Default)]
pub struct Lost {
    /// Number of bursts seen, usable or not.
    pub bursts: u64,
    pub unusable_bursts: u64,
    pub damage: Vec<Damage>,
}

impl Lost {
    /// All damage of the recording: what the pass and opening met, and what is missing by the file's statistics.
    pub fn all_damage(self, recording: &Recording) -> Vec<Damage> {
        let missing = recording.missing(self.bursts);
        self.damage.into_iter().chain(recording.damage.iter().cloned()).chain(missing).collect()
    }
}

/// Whether the signal of a channel in a burst counts as healthy: labels, if there are any, say that it is.
pub fn is_healthy(labels: Option<&Labels>, burst: &Burst, channel: u32) -> bool {
    labels.is_none_or(|labels| {
        let label = labels.at(&burst.printhead, channel, burst.t_acq_ns);
        label.is_some_and(|label| label.state == HEALTHY)
    })
}

#[derive(Clone, Copy, Debug)]
pub struct Pass<'a> {
    pub recording: &'a Recording,
    pub control: &'a Control,
}

impl Pass<'_> {
    /// Calls `see` with every usable burst, in file order.
    pub fn bursts(self, mut see: impl FnMut(&Burst)) -> Result<Lost> {
        let mut lost = Lost::default();
        let mut reader = self.recording.reader();
        lost.damage = self.acquisitions(&mut reader, |acquisition| {
            lost.bursts += 1;
            match acquisition {
                Acquisition::Usable(burst) => see(burst),
                Acquisition::Unusable(_) => lost.unusable_bursts += 1,
            }
        })?;
        Ok(lost)
    }

    /// Like [`Pass::bursts`], but `see` is also called with unusable bursts. Returns what is damaged.
    pub fn acquisitions(
        self,
        reader: &mut BlockReader,
        mut see: impl FnMut(&Acquisition),
    ) -> Result<Vec<Damage>> {
        let Pass { recording, control } = self;
        let mut damage = Vec::new();
        control.bytes_read.store(0, Ordering::Relaxed);
        for block in recording.blocks() {
            control.check()?;
            let block = match block {
                Ok(block) => block,
                Err(of_block) => {
                    note(&mut damage, of_block);
                    continue;
                }
            };
            reader.load(&block);
            while let Some(piece) = reader.next_piece(MOST_ROWS) {
                control.check()?;
                piece.damage.into_iter().for_each(|of_piece| note(&mut damage, of_piece));
                piece.acquisitions.iter().for_each(&mut see);
            }
            control.bytes_read.store(block.offset + block.bytes, Ordering::Relaxed);
        }
        Ok(damage)
    }
}
