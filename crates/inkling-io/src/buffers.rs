//! Memory for chunks that is used again, so that a long recording allocates little.
//!
//! A buffer is taken, filled, and frozen: from then on bursts share it as `Bytes`. This file keeps
//! a further reference to it. Once that reference is the only one (all bursts of the chunk are done
//! with), the buffer can be taken again. Each `ChunkLoader` has a set of its own, and so has the
//! digester.

use bytes::{Bytes, BytesMut};
use std::collections::VecDeque;

#[derive(Debug, Default)]
pub(super) struct Buffers {
    given: VecDeque<Bytes>,
}

impl Buffers {
    /// Larger buffers are not kept: bounded memory is worth a few page faults for each huge chunk.
    const KEPT_BYTES: usize = 8 << 20;
    const KEPT: usize = 24;

    /// A buffer of exactly `bytes` bytes, whose content is undefined (old bytes or zeros).
    pub(super) fn take(&mut self, bytes: usize) -> BytesMut {
        // free buffers, the last one given out first: the processor's cache may still hold it
        let free = self.given.iter().enumerate().rev().filter(|(_, b)| b.is_unique());
        // The smallest buffer that is large enough, as growing one fills it with zeros first. Too
        // small buffers come last; one is taken out, and replaced below unless its capacity, which
        // may exceed its length, suffices.
        let free = free.min_by_key(|(_, b)| if b.len() < bytes { usize::MAX } else { b.len() });
        let free = free.map(|(i, _)| i).and_then(|i| self.given.remove(i));
        match free.and_then(|b| b.try_into_mut().ok()) {
            Some(mut buffer) if buffer.capacity() >= bytes => {
                buffer.resize(bytes, 0);
                buffer
            }
            _ => BytesMut::zeroed(bytes),
        }
    }

    pub(super) fn freeze(&mut self, buffer: BytesMut) -> Bytes {
        let frozen = buffer.freeze();
        if frozen.len() <= Self::KEPT_BYTES {
            self.given.push_back(frozen.clone());
            if self.given.len() > Self::KEPT {
                self.given.pop_front();
            }
        }
        frozen
    }
}
