//! Host memory of frames, which returns to the pool of its device after encoding.

use crossbeam_channel::Sender;

use crate::pixels::Integers;
use crate::render::HostFrame;

/// Host memory of a frame. It returns to its pool on drop.
pub(crate) struct PooledFrame {
    pub host: HostFrame,
    pub pool: Sender<HostFrame>,
}

impl Drop for PooledFrame {
    fn drop(&mut self) {
        // The pool is closed if its device was lost.
        _ = self.pool.send(std::mem::take(&mut self.host));
    }
}

/// Red, green and blue of a frame, in 8 bits each.
pub(crate) enum Rgb8 {
    Pooled(PooledFrame),
    Owned(Vec<u8>),
}

impl Rgb8 {
    pub fn bytes(&mut self) -> &[u8] {
        match self {
            Self::Pooled(frame) => frame.host.integers(Integers::Rgb8).unwrap_or_default(),
            Self::Owned(bytes) => bytes,
        }
    }
}
