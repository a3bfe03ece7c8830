//! Host memory that goes from a device through encoding and back.

use crossbeam_channel::Sender;

use crate::pixels::Integers;
use crate::render::HostFrame;

/// Host memory for a view. It goes back to its owner when it is dropped.
pub(crate) struct Lent {
    pub host: HostFrame,
    pub back: Sender<HostFrame>,
}

impl Drop for Lent {
    fn drop(&mut self) {
        // The owner is gone if its device was lost.
        _ = self.back.send(std::mem::take(&mut self.host));
    }
}

/// Red, green and blue of a frame, in 8 bits each.
pub(crate) enum Rgb8 {
    Lent(Lent),
    Owned(Vec<u8>),
}

impl Rgb8 {
    pub fn bytes(&mut self) -> &[u8] {
        match self {
            Self::Lent(lent) => lent.host.integers(Integers::Rgb8).unwrap_or_default(),
            Self::Owned(bytes) => bytes,
        }
    }
}
