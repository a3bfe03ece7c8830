//! Host memory that the device copies to and from, kept for several uses.

use std::marker::PhantomData;
use std::sync::Arc;

use anyhow::Result;
use ash::vk;
use gpu_allocator::MemoryLocation;

use super::buffer::{Buffer, Storage};
use super::capabilities::STAGING_USAGE;
use super::commands::Commands;
use super::device::Device;
use super::element::Element;
use super::exported::Handle;
use super::hazards::Access;

/// `len` elements of type `T` in host memory, for copies that are repeated every frame; or in device memory that other
/// APIs open, or in host memory that other devices use, too.
pub struct Staging<T> {
    storage: Arc<Storage>,
    len: usize,
    _element: PhantomData<fn() -> T>,
}

impl<T: Element> Staging<T> {
    /// Allocates the memory. Its content is undefined. A length of 0 is stored as 1.
    ///
    /// # Errors
    /// [`OutOfMemory`](crate::host_memory::OutOfMemory) if the memory cannot be allocated.
    pub fn new(device: &Device, name: &str, len: usize) -> Result<Self> {
        let bytes = (len.max(1) * size_of::<T>()) as u64;
        Ok(Self::of(Storage::new(&device.0, name, bytes, STAGING_USAGE, MemoryLocation::GpuToCpu)?, len))
    }

    /// Allocates memory of the device that other APIs open, instead of the host's. It cannot be mapped.
    ///
    /// # Errors
    /// If the device exports no memory, a limit of memory is set, or memory runs out.
    pub fn exportable(device: &Device, name: &str, len: usize) -> Result<Self> {
        let bytes = (len.max(1) * size_of::<T>()) as u64;
        Ok(Self::of(Storage::exportable(&device.0, name, bytes, STAGING_USAGE)?, len))
    }

    pub(super) fn of(storage: Storage, len: usize) -> Self {
        Self { storage: Arc::new(storage), len, _element: PhantomData }
    }

    /// A handle with which another API opens the memory.
    ///
    /// # Errors
    /// If the memory is the host's, or the driver makes no handle.
    pub fn export(&self) -> Result<Handle> {
        self.storage.export()
    }

    /// The number of elements.
    pub fn len(&self) -> usize {
        self.len
    }

    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// True if no commands that copy from or to this memory are being recorded or are on the GPU.
    pub fn is_idle(&self) -> bool {
        Arc::strong_count(&self.storage) == 1
    }

    pub(super) fn storage(&self) -> &Arc<Storage> {
        &self.storage
    }

    /// The elements.
    ///
    /// # Panics
    /// If commands that copy from or to this memory are being recorded or are on the GPU.
    pub fn map(&mut self) -> &mut [T] {
        let storage = Arc::get_mut(&mut self.storage).expect("staging memory is opened when no commands use it");
        &mut bytemuck::cast_slice_mut(storage.mapped_mut())[..self.len]
    }
}

impl Commands {
    /// Copies the first `len` elements to the host. They are there after the wait.
    ///
    /// # Panics
    /// If either side has fewer elements.
    pub fn download<T: Element>(&mut self, from: &Buffer<T>, to: &Staging<T>, len: usize) {
        assert!(len <= from.len() && len <= to.len, "the elements of `{}` lie in it and fit", from.name());
        self.reads(from.resource(), "download", Access::COPY_READ);
        self.has_readbacks = true;
        self.copy_elements::<T>(&from.storage, &to.storage, len);
    }

    /// Copies the first `len` elements to the device.
    ///
    /// # Panics
    /// If either side has fewer elements.
    pub fn upload_staged<T: Element>(&mut self, from: &Staging<T>, to: &Buffer<T>, len: usize) {
        assert!(len <= from.len && len <= to.len(), "the elements of `{}` lie in it and fit", to.name());
        self.writes(to.resource(), "upload", Access::COPY_WRITE);
        self.copy_elements::<T>(&from.storage, &to.storage, len);
    }

    /// Copies parts of the words to parts of a buffer: first word here, first word there, number of words.
    ///
    /// # Panics
    /// If a part ends outside of either side.
    pub fn upload_parts(&mut self, from: &Staging<u32>, to: &Buffer<u32>, parts: &[(usize, usize, usize)]) {
        let are_inside = parts.iter().all(|(here, there, len)| here + len <= from.len && there + len <= to.len());
        assert!(are_inside, "the parts of `{}` lie in it and fit", to.name());
        if parts.is_empty() {
            return;
        }
        self.writes(to.resource(), "upload", Access::COPY_WRITE);
        self.copy_regions(&from.storage, &to.storage, &regions(parts));
    }

    /// Copies the first words of several memories to a buffer, one after another. Each has its number of words.
    ///
    /// # Panics
    /// If a memory has fewer words, or the buffer is too small.
    pub fn upload_joined(&mut self, from: &[(&Staging<u32>, usize)], to: &Buffer<u32>) {
        self.writes(to.resource(), "upload", Access::COPY_WRITE);
        let mut end = 0;
        for (memory, len) in from {
            assert!(*len <= memory.len && end + len <= to.len(), "the memories fit into `{}`", to.name());
            self.copy_regions(&memory.storage, &to.storage, &regions(&[(0, end, *len)]));
            end += len;
        }
    }

    /// Copies parts of a buffer to parts of the words: first word there, first word here, number of words.
    ///
    /// # Panics
    /// If a part ends outside of either side.
    pub fn download_parts(&mut self, from: &Buffer<u32>, to: &Staging<u32>, parts: &[(usize, usize, usize)]) {
        let are_inside = parts.iter().all(|(there, here, len)| there + len <= from.len() && here + len <= to.len);
        assert!(are_inside, "the parts of `{}` lie in it and fit", from.name());
        self.reads(from.resource(), "download", Access::COPY_READ);
        self.has_readbacks = true;
        self.copy_regions(&from.storage, &to.storage, &regions(parts));
    }

    fn copy_elements<T>(&mut self, from: &Arc<Storage>, to: &Arc<Storage>, len: usize) {
        if len > 0 {
            let size = (len * size_of::<T>()) as u64;
            self.copy_buffer(from, to, vk::BufferCopy { src_offset: 0, dst_offset: 0, size });
        }
    }
}

/// Regions of a copy: first word of the source, first word of the target, number of words.
fn regions(parts: &[(usize, usize, usize)]) -> Vec<vk::BufferCopy> {
    let bytes = |words: usize| 4 * words as u64;
    let region = |(from, to, len): &(usize, usize, usize)| vk::BufferCopy {
        src_offset: bytes(*from),
        dst_offset: bytes(*to),
        size: bytes(*len),
    };
    parts.iter().map(region).collect()
}
