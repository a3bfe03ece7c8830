//! Buckets: Gaussians of one part of the Morton curve, few enough to be sorted in memory, as records in a temporary
//! file.

use std::fs::File;
use std::io::{BufWriter, Write};

use anyhow::{Result, ensure};
use rayon::prelude::*;

use crate::files::{Checkpoint, read_exact_at};
use crate::host_memory::host_zeros;
use crate::scene::{CanonicalBuilder, Curve, Gaussians, sh_coefficients};

/// Most buckets: each is an open file.
const MOST: usize = 500;

/// Bytes of memory per byte of a record while a bucket is sorted and packed.
const SORTED: usize = 3;

/// The borders of the buckets along the Morton curve.
pub struct BucketBounds {
    curve: Curve,
    /// The first key of each bucket but the first, ascending.
    first_keys: Vec<u64>,
}

impl BucketBounds {
    /// Chooses borders so that buckets of `count` Gaussians are sorted within `memory` bytes, estimated from a sample.
    pub fn new(curve: Curve, sample: &[[f32; 3]], count: usize, sh_degree: u32, memory: usize) -> Self {
        let largest = (memory / (SORTED * 4 * record_words(sh_degree))).max(1);
        let buckets = (count.div_ceil(largest) * 5 / 4).clamp(1, MOST);
        let mut keys: Vec<u64> = sample.par_iter().map(|mean| curve.key(*mean)).collect();
        keys.par_sort_unstable();
        let mut first_keys: Vec<u64> =
            (1..buckets).filter_map(|i| keys.get(i * keys.len() / buckets).copied()).collect();
        first_keys.dedup();
        Self { curve, first_keys }
    }

    fn bucket(&self, mean: [f32; 3]) -> usize {
        let key = self.curve.key(mean);
        self.first_keys.partition_point(|first| *first <= key)
    }

    pub fn buckets(&self) -> usize {
        self.first_keys.len() + 1
    }
}

/// The name of a bucket.
pub fn name(bucket: usize) -> String {
    format!("bucket.{bucket}")
}

/// The files of all buckets while they are filled.
pub struct BucketWriter<'k> {
    checkpoint: &'k Checkpoint,
    bounds: &'k BucketBounds,
    files: Vec<BufWriter<File>>,
    counts: Vec<usize>,
    words: Vec<Vec<u32>>,
}

impl<'k> BucketWriter<'k> {
    /// Empty buckets.
    ///
    /// # Errors
    /// If a file cannot be made.
    pub fn new(checkpoint: &'k Checkpoint, bounds: &'k BucketBounds) -> Result<Self> {
        let file = |bucket| Ok(BufWriter::with_capacity(1 << 16, checkpoint.file(&name(bucket))?));
        let files = (0..bounds.buckets()).map(file).collect::<Result<Vec<_>>>()?;
        Ok(Self { checkpoint, bounds, counts: vec![0; files.len()], words: vec![Vec::new(); files.len()], files })
    }

    /// Adds Gaussians, the first of which is number `first` of the scene.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn add(&mut self, gaussians: &Gaussians, first: usize) -> Result<()> {
        let buckets: Vec<usize> = gaussians.means().par_iter().map(|mean| self.bounds.bucket(*mean)).collect();
        for (index, bucket) in buckets.into_iter().enumerate() {
            put_record(gaussians, index, (first + index) as u32, &mut self.words[bucket]);
            self.counts[bucket] += 1;
        }
        for (file, words) in self.files.iter_mut().zip(&mut self.words) {
            file.write_all(bytemuck::cast_slice(words)).map_err(|error| self.checkpoint.failed(&error))?;
            words.clear();
        }
        Ok(())
    }

    /// The number of Gaussians in each bucket.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn finish(mut self) -> Result<Vec<usize>> {
        for file in &mut self.files {
            file.flush().and_then(|()| file.get_ref().sync_data()).map_err(|error| self.checkpoint.failed(&error))?;
        }
        Ok(self.counts)
    }
}

/// The records in `before`, and then those of a bucket of `count` Gaussians.
///
/// # Errors
/// If the bucket cannot be read, or its length has changed.
pub fn records(
    checkpoint: &Checkpoint,
    bucket: usize,
    count: usize,
    before: &[u32],
    sh_degree: u32,
) -> Result<Vec<u32>> {
    let file = checkpoint.file(&name(bucket))?;
    let words = count * record_words(sh_degree);
    ensure!(file.metadata()?.len() == 4 * words as u64, "{} has lost bytes", checkpoint.path(&name(bucket)).display());
    let mut records = host_zeros(before.len() + words, "bucket")?;
    records[..before.len()].copy_from_slice(before);
    read_exact_at(&file, bytemuck::cast_slice_mut(&mut records[before.len()..]), 0)?;
    Ok(records)
}

/// Words of a record: the index in the scene, then mean, scale, rotation, opacity and spherical harmonics.
pub fn record_words(sh_degree: u32) -> usize {
    12 + 3 * sh_coefficients(sh_degree)
}

/// Appends the record of a Gaussian.
pub fn put_record(gaussians: &Gaussians, index: usize, id: u32, words: &mut Vec<u32>) {
    words.push(id);
    let floats = gaussians.means()[index].into_iter();
    let floats = floats.chain(gaussians.scales()[index]).chain(gaussians.rotations()[index]);
    words.extend(floats.chain([gaussians.opacities()[index]]).map(f32::to_bits));
    words.extend(gaussians.sh(index).as_flattened().iter().map(|value| value.to_bits()));
}

/// The mean in a record.
pub fn mean_of(record: &[u32]) -> [f32; 3] {
    std::array::from_fn(|axis| f32::from_bits(record[1 + axis]))
}

/// The Gaussians in records.
///
/// # Errors
/// If memory runs out, or the records are damaged.
pub fn gaussians_of(records: &[u32], sh_degree: u32) -> Result<Gaussians> {
    let each = record_words(sh_degree);
    let mut parts = CanonicalBuilder::new(sh_degree, records.len() / each)?;
    let stride = sh_coefficients(sh_degree);
    for (index, record) in records.chunks_exact(each).enumerate() {
        let float = |i: usize| f32::from_bits(record[i]);
        parts.means[index] = mean_of(record);
        parts.scales[index] = std::array::from_fn(|i| float(4 + i));
        parts.rotations[index] = std::array::from_fn(|i| float(7 + i));
        parts.opacities[index] = float(11);
        let sh = parts.sh[index * stride..][..stride].as_flattened_mut();
        sh.iter_mut().zip(&record[12..]).for_each(|(to, from)| *to = f32::from_bits(*from));
    }
    parts.finish()
}
