//! Shaders that ask for denormals to become 0, on devices that cannot be asked.

use super::capabilities::Feature;
use super::device::Shared;

// SPIR-V 1.6, sections 3.31, 3.6 and 2.3.
const OP_CAPABILITY: u32 = 17;
const OP_EXECUTION_MODE: u32 = 16;
const DENORM_FLUSH_TO_ZERO_CAPABILITY: u32 = 4465;
const DENORM_FLUSH_TO_ZERO_MODE: u32 = 4460;
const HEADER_WORDS: usize = 5;

/// The module as the device takes it: without the execution mode DenormFlushToZero, and the capability for it, where
/// the device has no [`Feature::FlushedDenormals`].
pub(super) fn fitted(device: &Shared, module: Vec<u32>) -> Vec<u32> {
    if device.capabilities.has(Feature::FlushedDenormals) { module } else { without_flush(&module) }
}

fn without_flush(module: &[u32]) -> Vec<u32> {
    let (header, mut rest) = module.split_at(HEADER_WORDS);
    let mut words = header.to_vec();
    while let Some(first) = rest.first() {
        let (instruction, after) = rest.split_at((first >> 16) as usize);
        let asks = match (first & 0xffff, instruction) {
            (OP_CAPABILITY, [_, capability]) => *capability == DENORM_FLUSH_TO_ZERO_CAPABILITY,
            (OP_EXECUTION_MODE, [_, _, mode, ..]) => *mode == DENORM_FLUSH_TO_ZERO_MODE,
            _ => false,
        };
        if !asks {
            words.extend(instruction);
        }
        rest = after;
    }
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_mode_and_its_capability_are_left_out() {
        let header = [0x0723_0203, 0x0001_0600, 0, 9, 0];
        let shader = [2 << 16 | OP_CAPABILITY, 1];
        let local_size = [6 << 16 | OP_EXECUTION_MODE, 4, 17, 128, 1, 1];
        let flush = [2 << 16 | OP_CAPABILITY, DENORM_FLUSH_TO_ZERO_CAPABILITY];
        let mode = [4 << 16 | OP_EXECUTION_MODE, 4, DENORM_FLUSH_TO_ZERO_MODE, 32];
        let with = [&header[..], &shader, &flush, &local_size, &mode].concat();
        assert_eq!(without_flush(&with), [&header[..], &shader, &local_size].concat());
    }
}
