//! A scene file that is read front to back, with progress and cancelling.

use std::fs::File;
use std::io::{self, BufRead, BufReader, ErrorKind, Read, Seek, SeekFrom};
use std::path::Path;

use anyhow::{Context, Result, anyhow, bail, ensure};
use rayon::prelude::*;

use crate::files::{describe, open_regular, read_exact_at};
use crate::host_memory::{OutOfMemory, host_vec};
use crate::scene::{BLOCK, Builder, Cancelled, Gaussians, Placement, Placer, Watch};

/// Bytes that a thread reads at a time.
const PART: usize = 1 << 20;

/// Callback that gets the next block of Gaussians, and the number of Gaussians that the file claims to hold.
pub(crate) type TakeBlock<'t> = &'t mut dyn FnMut(Gaussians, usize) -> Result<()>;

/// A scene file that is read front to back. Errors name the byte.
pub(crate) struct Input<'w> {
    reader: BufReader<File>,
    len: u64,
    position: u64,
    watch: &'w Watch<'w>,
    /// Position of the next progress report.
    next_report: u64,
    is_cancelled: bool,
    /// Number of Gaussians of the next partial scene.
    next_partial: usize,
    /// Fraction of the progress that stands for reading bytes; the rest stands for decoding.
    read_fraction: f64,
    placement: Placement,
}

impl<'w> Input<'w> {
    /// Opens a regular file.
    pub fn open(path: &Path, watch: &'w Watch<'w>) -> Result<Self> {
        let file = open_regular(path)?;
        let len = file.metadata()?.len();
        let reader = BufReader::with_capacity(PART, file);
        let (position, next_report, next_partial, read_fraction) = (0, 0, BLOCK, 1.0);
        let placement = Placement::IDENTITY;
        Ok(Self {
            reader,
            len,
            position,
            watch,
            next_report,
            is_cancelled: false,
            next_partial,
            read_fraction,
            placement,
        })
    }

    /// Opens the file of a scene whose Gaussians are placed there.
    pub fn placed(path: &Path, watch: &'w Watch<'w>, placement: Placement) -> Result<Self> {
        Ok(Self { placement, ..Self::open(path, watch)? })
    }

    /// Where the Gaussians of the file lie.
    pub fn placement(&self) -> Placement {
        self.placement
    }

    /// A builder of this many Gaussians of this SH degree, which places them.
    ///
    /// # Errors
    /// [`OutOfMemory`] if they cannot be allocated.
    pub fn builder(&self, sh_degree: u32, capacity: usize) -> Result<Builder, OutOfMemory> {
        let mut builder = Builder::new(sh_degree, capacity)?;
        builder.place(Placer::new(&self.placement));
        Ok(builder)
    }

    /// The input at the same position, with further progress reported to `watch`.
    pub fn watched_by<'v>(self, watch: &'v Watch<'v>) -> Input<'v> {
        let Self { reader, len, position, next_report, is_cancelled, next_partial, read_fraction, placement, .. } =
            self;
        Input { reader, len, position, watch, next_report, is_cancelled, next_partial, read_fraction, placement }
    }

    /// Sets the fraction of the progress that stands for reading, for a format whose bytes are all read before most
    /// Gaussians are decoded.
    pub fn set_read_fraction(&mut self, fraction: f64) {
        self.read_fraction = fraction;
    }

    /// Reports the fraction of the Gaussians that is decoded, after all bytes were read.
    pub fn report_decoded(&self, fraction: f64) {
        (self.watch.progress)(self.read_fraction + (1.0 - self.read_fraction) * fraction);
    }

    /// Must be called before each block of Gaussians is decoded. Reports the partial scene whenever it has doubled, so
    /// that all partial scenes together are smaller than twice the scene. Fails if reading was cancelled.
    pub fn before_block(&mut self, so_far: &Builder) -> Result<()> {
        ensure!(!(self.watch.is_cancelled)(), Cancelled);
        if so_far.len() >= self.next_partial {
            (self.watch.partial)(so_far);
            self.next_partial = 2 * so_far.len();
        }
        Ok(())
    }

    /// Length of the file in bytes.
    pub fn len(&self) -> u64 {
        self.len
    }

    /// Bytes that are not yet read.
    pub fn left(&self) -> u64 {
        self.len.saturating_sub(self.position)
    }

    /// The next bytes, at most `count`, without consuming them.
    pub fn peek(&mut self, count: usize) -> Result<&[u8]> {
        let bytes = self.reader.fill_buf()?;
        Ok(&bytes[..count.min(bytes.len())])
    }

    /// Fills `bytes` from the file. `what` names them in the error if the file ends first.
    pub fn fill(&mut self, bytes: &mut [u8], what: &str) -> Result<()> {
        let start = self.position;
        let read = if bytes.len() > PART { self.read_parts(bytes) } else { self.read_exact(bytes) };
        read.map_err(|error| match error.kind() {
            ErrorKind::UnexpectedEof => {
                let end = start + bytes.len() as u64;
                anyhow!("the file ends at byte {}, inside {what} at bytes {start} to {end}", self.len)
            }
            _ => anyhow!("cannot be read: {}", describe(&error)),
        })
    }

    /// The next `count` bytes. `what` names them in the error if the file has fewer.
    pub fn bytes(&mut self, count: u64, what: &str) -> Result<Vec<u8>> {
        ensure!(count <= self.left(), "{what} takes {count} bytes, the file has {} left", self.left());
        let mut bytes = host_vec(usize::try_from(count)?, what)?;
        bytes.resize(count as usize, 0);
        // In parts, so that progress is reported.
        bytes.chunks_mut(PART).try_for_each(|part| self.fill(part, what))?;
        Ok(bytes)
    }

    /// Like [`Input::line`], but the last line of the file may have no line end.
    pub fn last_line(&mut self, limit: u64, what: &str) -> Result<String> {
        if self.left() > limit {
            return self.line(limit, what);
        }
        let mut line = Vec::new();
        (&mut *self).take(limit).read_until(b'\n', &mut line)?;
        ensure!(!line.is_empty(), "the file ends at byte {}, inside {what}", self.len);
        Ok(String::from_utf8_lossy(&line).trim_end().to_owned())
    }

    /// The rest of the file. Fails if it has more than `limit` bytes; `what` names it in errors.
    pub fn rest(&mut self, limit: u64, what: &str) -> Result<Vec<u8>> {
        let bytes = self.left();
        ensure!(bytes <= limit, "{what} has {bytes} bytes, expected at most {limit}");
        self.bytes(bytes, what)
    }

    /// Skips bytes. `what` names them in the error if the file ends first.
    pub fn skip(&mut self, bytes: u64, what: &str) -> Result<()> {
        let start = self.position;
        let skipped = io::copy(&mut (&mut *self).take(bytes), &mut io::sink())?;
        let (len, end) = (self.len, start.saturating_add(bytes));
        ensure!(skipped == bytes, "the file ends at byte {len}, inside {what} at bytes {start} to {end}");
        Ok(())
    }

    /// The next line without its end, of at most `limit` bytes. `what` names the part of the file in errors.
    pub fn line(&mut self, limit: u64, what: &str) -> Result<String> {
        let mut line = Vec::new();
        (&mut *self).take(limit).read_until(b'\n', &mut line)?;
        if line.pop() != Some(b'\n') {
            ensure!(self.left() > 0, "the file ends at byte {}, inside {what}", self.len);
            bail!("a line of {what} has no end within {limit} bytes");
        }
        if line.last() == Some(&b'\r') {
            line.pop();
        }
        Ok(String::from_utf8_lossy(&line).into_owned())
    }
}

/// The little-endian 32-bit number at byte `at`.
pub(crate) fn word(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(std::array::from_fn(|i| bytes[at + i]))
}

/// A count from a file header as a length. Fails if `available` bytes cannot hold that number of elements of `bytes`
/// each.
pub(crate) fn checked_count(count: u64, bytes: u64, available: u64, what: &str) -> Result<usize> {
    let needed = count.checked_mul(bytes).with_context(|| format!("the header claims {count} {what}"))?;
    ensure!(
        needed <= available,
        "the file is truncated or its header wrong: {count} {what} need {needed} bytes, {available} are left"
    );
    Ok(usize::try_from(count)?)
}

impl Read for Input<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        self.check()?;
        let count = self.reader.read(bytes)?;
        self.advance(count);
        Ok(count)
    }
}

impl BufRead for Input<'_> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        self.check()?;
        self.reader.fill_buf()
    }

    fn consume(&mut self, count: usize) {
        self.reader.consume(count);
        self.advance(count);
    }
}

impl Input<'_> {
    /// Fills `bytes` on many threads, which copy from the page cache of the system in parallel.
    fn read_parts(&mut self, bytes: &mut [u8]) -> io::Result<()> {
        self.check()?;
        let (file, start) = (self.reader.get_ref(), self.position);
        let parts = bytes.par_chunks_mut(PART).enumerate();
        parts.try_for_each(|(i, part)| read_exact_at(file, part, start + (i * PART) as u64))?;
        self.reader.seek(SeekFrom::Start(start + bytes.len() as u64))?;
        self.advance(bytes.len());
        Ok(())
    }

    fn check(&self) -> io::Result<()> {
        if self.is_cancelled { Err(io::Error::other(Cancelled)) } else { Ok(()) }
    }

    fn advance(&mut self, count: usize) {
        self.position += count as u64;
        if self.position >= self.next_report {
            (self.watch.progress)(self.read_fraction * self.position as f64 / self.len.max(1) as f64);
            self.is_cancelled = (self.watch.is_cancelled)();
            self.next_report = self.position + self.len / 200;
        }
    }
}
