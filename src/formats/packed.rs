//! Files around scenes: a gzip stream is unpacked, other archives are named.

use std::io::Read;

use anyhow::{Context, Result, ensure};
use flate2::bufread::{GzDecoder, MultiGzDecoder};

use super::GZIP;
use super::input::Input;
use crate::files::Scratch;

/// First bytes of a file that a signature may need: those of tar begin at byte 257.
const BEGIN: u64 = 512;
/// Largest accepted compression ratio: a scene without colours of degrees above 0 is full of zeros.
const MAX_RATIO: u64 = 64;

/// Files that are no scenes, by their first bytes.
const OTHERS: [(&[u8], &str); 12] = [
    (GZIP, "a gzip stream: unpack it first"),
    (b"PK\x03\x04", "a zip archive: unpack it first"),
    (b"7z\xbc\xaf\x27\x1c", "a 7z archive: unpack it first"),
    (b"Rar!\x1a\x07", "a RAR archive: unpack it first"),
    (b"\x28\xb5\x2f\xfd", "a zstd stream: unpack it first"),
    (b"\xfd7zXZ\0", "an xz stream: unpack it first"),
    (b"BZh", "a bzip2 stream: unpack it first"),
    (b"\x04\x22\x4d\x18", "an LZ4 stream: unpack it first"),
    (b"PXR-USDC", "a USD file, which is not read"),
    (b"#usda", "a USD file, which is not read"),
    (b"version https://git-lfs", "a pointer of Git LFS: `git lfs pull` gets the file itself"),
    (b"<", "HTML or XML, perhaps the message of a failed download"),
];

/// What a file is that begins with these bytes, if it is a known one but no scene.
pub(crate) fn other(begin: &[u8]) -> Option<&'static str> {
    if begin.get(257..262) == Some(b"ustar") {
        return Some("a tar archive: unpack it first");
    }
    OTHERS.iter().find(|(signature, _)| begin.starts_with(signature)).map(|(_, what)| *what)
}

/// The first bytes of the content of a gzip stream; `None` if the file is none, or its content cannot be read.
pub(crate) fn gzip_content(input: &mut Input) -> Result<Option<Vec<u8>>> {
    let packed = input.peek(usize::MAX)?;
    let mut begin = Vec::new();
    if packed.starts_with(GZIP) {
        // The peeked bytes may end before the stream does.
        _ = GzDecoder::new(packed).take(BEGIN).read_to_end(&mut begin);
    }
    Ok((!begin.is_empty()).then_some(begin))
}

/// The first bytes of a file, for [`other`].
pub(crate) fn begin<'i>(input: &'i mut Input) -> Result<&'i [u8]> {
    input.peek(BEGIN as usize)
}

/// Unpacks a gzip stream into a temporary file without a name.
pub(crate) fn unpack_gzip(input: Input) -> Result<Scratch> {
    let most = input.len().saturating_mul(MAX_RATIO).min(u64::MAX - 1);
    let mut content = MultiGzDecoder::new(input).take(most + 1);
    let scratch = Scratch::of(&mut content).context("the gzip stream cannot be unpacked")?;
    ensure!(content.limit() > 0, "it unpacks to over {MAX_RATIO} times its size: unpack it first");
    Ok(scratch)
}
