//! One pass over (some of) a recording's blocks, by a function, outside the stages.

use super::{Control, PipelineError};
use crate::burst::Burst;
use crate::io::recording::Recording;
use std::sync::atomic::Ordering;

/// Calls `see` with every usable burst of the blocks that `want`s chooses by index, in file order.
pub fn bursts(
    recording: &Recording,
    control: &Control,
    mut want: impl FnMut(u64) -> bool,
    mut see: impl FnMut(u64, &Burst),
) -> Result<(), PipelineError> {
    let mut reader = recording.reader();
    // where the channels are not known upfront, a block may define those of a later one
    let all = !recording.channels_known_upfront();
    control.bytes_read.store(0, Ordering::Relaxed);
    for block in recording.blocks().flatten() {
        control.check()?;
        let wanted = want(block.index);
        if wanted || all {
            let decoded = reader.read(&block);
            if wanted {
                for acquisition in &decoded.acquisitions {
                    if let crate::burst::Acquisition::Usable(burst) = acquisition {
                        see(block.index, burst);
                    }
                }
            }
        }
        control.bytes_read.store(block.offset + block.bytes, Ordering::Relaxed);
    }
    Ok(())
}
