//! Reads `cameras.bin` and `images.bin`: a 64-bit count, then little-endian records.

use std::collections::HashMap;
use std::fs::File;
use std::io::{BufRead, BufReader, ErrorKind, Read};
use std::path::Path;

use anyhow::{Context, Result, anyhow, bail, ensure};

use super::models::{Intrinsics, LEAST_PARAMETERS, Model};
use super::photograph::Photograph;
use crate::files::{describe, open_regular};

/// Longest name of a photograph in bytes.
const MAX_NAME_BYTES: u64 = 4096;

/// Bytes of id, model, width and height of a camera.
const CAMERA_BYTES: u64 = 4 + 4 + 8 + 8;
/// Bytes of id, rotation, translation and camera of a photograph.
const IMAGE_BYTES: u64 = 4 + 7 * 8 + 4;
/// Bytes of position and id of a point in a photograph.
const POINT_BYTES: u64 = 8 + 8 + 8;

/// Reads all cameras, by their ids.
pub(super) fn cameras(path: &Path) -> Result<HashMap<u32, Intrinsics>> {
    let mut source = Source::open(path)?;
    let count = source.count(CAMERA_BYTES + 8 * LEAST_PARAMETERS, "cameras")?;
    let mut cameras = HashMap::new();
    for i in 0..count {
        let id = u32::from_le_bytes(source.bytes("a camera")?);
        let intrinsics = camera(&mut source).with_context(|| format!("camera {id}, number {i}"))?;
        ensure!(cameras.insert(id, intrinsics).is_none(), "camera {id} is there twice");
    }
    source.end()?;
    Ok(cameras)
}

fn camera(source: &mut Source) -> Result<Intrinsics> {
    let model = Model::by_id(i32::from_le_bytes(source.bytes("a camera")?))?;
    let size_px = [source.u64("a camera")?, source.u64("a camera")?];
    let parameters: Result<Vec<f64>> = (0..model.parameters()).map(|_| source.f64("a camera")).collect();
    model.intrinsics(size_px, &parameters?)
}

/// Reads the photographs in the order of the file. The second value, the count in comments, exists in text files only.
pub(super) fn images(path: &Path) -> Result<(Vec<Photograph>, Option<usize>)> {
    let mut source = Source::open(path)?;
    // A name ends with a zero byte; the number of points follows.
    let count = source.count(IMAGE_BYTES + 1 + 8, "images")?;
    // Grows with the content, so a wrong count costs no memory.
    let mut images = Vec::new();
    for i in 0..count {
        images.push(image(&mut source).with_context(|| format!("image {i}"))?);
    }
    source.end()?;
    Ok((images, None))
}

fn image(source: &mut Source) -> Result<Photograph> {
    let what = "an image";
    let _id: [u8; 4] = source.bytes(what)?;
    let mut numbers = [0.0; 7];
    for number in &mut numbers {
        *number = source.f64(what)?;
    }
    let [w, x, y, z, translation @ ..] = numbers;
    let camera = u32::from_le_bytes(source.bytes(what)?);
    let name = source.name()?;
    let points = source.count(POINT_BYTES, "points")?;
    source.skip(points * POINT_BYTES)?;
    Ok(Photograph { name, rotation: [w, x, y, z], translation, camera })
}

/// A file that is read front to back. Errors name the byte.
struct Source {
    reader: BufReader<File>,
    len: u64,
    position: u64,
}

impl Source {
    fn open(path: &Path) -> Result<Self> {
        let file = open_regular(path)?;
        let len = file.metadata()?.len();
        Ok(Self { reader: BufReader::with_capacity(1 << 16, file), len, position: 0 })
    }

    fn left(&self) -> u64 {
        self.len.saturating_sub(self.position)
    }

    fn bytes<const N: usize>(&mut self, what: &str) -> Result<[u8; N]> {
        let (start, mut bytes) = (self.position, [0; N]);
        self.reader.read_exact(&mut bytes).map_err(|error| match error.kind() {
            ErrorKind::UnexpectedEof => {
                anyhow!("the file ends at byte {}, inside {what} at bytes {start} to {}", self.len, start + N as u64)
            }
            _ => anyhow!("cannot be read: {}", describe(&error)),
        })?;
        self.position += N as u64;
        Ok(bytes)
    }

    fn u64(&mut self, what: &str) -> Result<u64> {
        Ok(u64::from_le_bytes(self.bytes(what)?))
    }

    fn f64(&mut self, what: &str) -> Result<f64> {
        Ok(f64::from_le_bytes(self.bytes(what)?))
    }

    /// A count of elements of at least `bytes_each`, refused if the rest of the file cannot hold them.
    fn count(&mut self, bytes_each: u64, what: &str) -> Result<u64> {
        let count = self.u64(&format!("the number of {what}"))?;
        let most = self.left() / bytes_each;
        ensure!(count <= most, "the file claims {count} {what}, its {} bytes left hold {most} at most", self.left());
        Ok(count)
    }

    /// A text that ends with a zero byte.
    fn name(&mut self) -> Result<String> {
        let (start, mut name) = (self.position, Vec::new());
        (&mut self.reader).take(MAX_NAME_BYTES).read_until(0, &mut name)?;
        self.position += name.len() as u64;
        if name.pop() != Some(0) {
            ensure!(self.left() > 0, "the file ends at byte {}, inside a name from byte {start} on", self.len);
            bail!("the name at byte {start} has no end within {MAX_NAME_BYTES} bytes");
        }
        Ok(String::from_utf8_lossy(&name).into_owned())
    }

    /// Skips bytes that are known to exist.
    fn skip(&mut self, bytes: u64) -> Result<()> {
        self.reader.seek_relative(i64::try_from(bytes)?)?;
        self.position += bytes;
        Ok(())
    }

    fn end(&self) -> Result<()> {
        ensure!(self.left() == 0, "{} bytes follow the last one that the file counts", self.left());
        Ok(())
    }
}
