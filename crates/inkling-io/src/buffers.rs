//! Buffers that are used again, so that a long recording allocates little.

use bytes::{Bytes, BytesMut};
use std::collections::VecDeque;

/// Buffers given out, to be taken again once no burst shares them.
#[derive(Debug, Default)]
pub(super) struct Buffers {
    given: VecDeque<Bytes>,
}

impl Buffers {
    /// Larger buffers are not kept: bounded memory beats a few page faults per huge chunk.
    const KEPT_BYTES: usize = 8 << 20;
    const KEPT: usize = 24;

    /// A buffer of `bytes` bytes of no particular content.
    pub(super) fn take(&mut self, bytes: usize) -> BytesMut {
        // the last one given, which the processor may still have at hand
        let free = self.given.iter().enumerate().rev().filter(|(_, b)| b.is_unique());
        // one of that size, so that it need not be filled up first; else any
        let free = free.min_by_key(|(_, b)| if b.len() < bytes { usize::MAX } else { b.len() });
        let free = free.map(|(i, _)| i);
        let free = free.and_then(|i| self.given.remove(i)).and_then(|b| b.try_into_mut().ok());
        match free {
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
