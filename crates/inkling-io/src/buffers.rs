//! Buffers that are used again, so that a long recording allocates little. Readers of blocks and the digester
//! have one set each.
use bytes::{Bytes, BytesMut};
use std::collections::VecDeque;

/// The buffers that were given out. Bursts share their bytes; once none does so any more, a buffer can be
/// taken again.
#[derive(Debug, Default)]
pub(super) struct Buffers {
    given: VecDeque<Bytes>,
}

impl Buffers {
    /// Larger buffers are not kept: bounded memory is worth a few page faults for each huge chunk.
    const KEPT_BYTES: usize = 8 << 20;
    /// At most so many buffers are kept.
    const KEPT: usize = 24;

    /// A buffer of `bytes` bytes, whose content is undefined.
    pub(super) fn take(&mut self, bytes: usize) -> BytesMut {
        // beginning with the last one given, which the processor's cache may still hold
        let free = self.given.iter().enumerate().rev().filter(|(_, b)| b.is_unique());
        // a buffer of the same size need not be filled with zeros first; else the smallest that is larger,
        // else any
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

    /// Shares a buffer that was filled, and remembers it.
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
