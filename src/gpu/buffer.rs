//! Buffers of plain elements in device memory.

use std::marker::PhantomData;
use std::mem::size_of;
use std::sync::Arc;

use anyhow::Result;
use ash::vk;
use gpu_allocator::MemoryLocation;

use super::capabilities::{BUFFER_USAGE, HOST_BLOCK};
use super::device::{Device, Held, Shared};
use super::element::{Element, Scalar};
use super::error::describe;
use super::id::next_id;
use crate::host_memory::OutOfMemory;

/// `len` elements of type `T` in device memory. A clone is the same buffer.
pub struct Buffer<T> {
    pub(super) storage: Arc<Storage>,
    len: usize,
    _element: PhantomData<fn() -> T>,
}

impl<T> Clone for Buffer<T> {
    fn clone(&self) -> Self {
        Self { storage: self.storage.clone(), len: self.len, _element: PhantomData }
    }
}

impl<T: Element> Buffer<T> {
    /// Allocates a buffer that shaders bind as a whole. Its content is undefined. A length of 0 is stored as 1 because
    /// Vulkan has no empty buffers.
    ///
    /// # Errors
    /// [`OutOfMemory`] if the buffer exceeds the device's largest storage range, or device memory is exhausted.
    pub fn new(device: &Device, name: &str, len: usize) -> Result<Self> {
        Self::check_len(device, name, len)?;
        let bytes = (len.max(1) * size_of::<T>()) as u64;
        Ok(Self::of(Storage::new(&device.0, name, bytes, BUFFER_USAGE, MemoryLocation::GpuOnly)?, len))
    }

    /// The buffer in this memory.
    pub(super) fn of(mut storage: Storage, len: usize) -> Self {
        (storage.scalar, storage.columns) = (T::SCALAR, size_of::<T>() / T::SCALAR.bytes());
        Self { storage: Arc::new(storage), len, _element: PhantomData }
    }

    /// Fails if a buffer of `len` elements exceeds the device's largest storage range.
    ///
    /// # Errors
    /// [`OutOfMemory`].
    pub fn check_len(device: &Device, name: &str, len: usize) -> Result<(), OutOfMemory> {
        let (limit, bytes) = (device.capabilities().limits.storage_range, (len * size_of::<T>()) as u64);
        if bytes <= limit {
            return Ok(());
        }
        let reason = format!("a shader on {} reaches at most {limit} bytes of a buffer", device.capabilities().name);
        Err(OutOfMemory { name: name.to_owned(), bytes: Some(bytes), reason })
    }

    /// The number of elements.
    pub fn len(&self) -> usize {
        self.len
    }

    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    pub fn name(&self) -> &str {
        &self.storage.name
    }

    pub fn bytes(&self) -> u64 {
        self.storage.bytes
    }

    /// True if the buffer is in the memory of this device.
    pub fn is_on(&self, device: &Device) -> bool {
        Arc::ptr_eq(&self.storage.device, &device.0)
    }

    /// The name and the size in bytes.
    pub fn footprint(&self) -> (&str, u64) {
        (self.name(), self.bytes())
    }

    /// The same buffer, seen as 32-bit words.
    ///
    /// # Panics
    /// If the size of an element is not a multiple of 4 bytes.
    pub fn words(&self) -> Buffer<u32> {
        assert!(size_of::<T>().is_multiple_of(4), "elements of `{}` are not whole words", self.name());
        Buffer { storage: self.storage.clone(), len: self.len * size_of::<T>() / 4, _element: PhantomData }
    }
}

/// Alignment of buffers in bytes. An H100 allows 16, but reading a row of 32 words that crosses a cache line takes it
/// twice as long.
const ALIGNMENT: u64 = 256;

/// The Vulkan buffer and its memory.
pub struct Storage {
    pub(super) raw: vk::Buffer,
    pub(super) name: String,
    pub(super) bytes: u64,
    /// Identifies the resource in the missing-barrier check.
    pub(super) id: u64,
    /// An element consists of `columns` numbers of this kind. Staging buffers leave both at their defaults.
    pub(super) scalar: Scalar,
    pub(super) columns: usize,
    allocation: Option<Held>,
    /// Memory that others use, too, in the place of an allocation.
    pub(super) external: Option<External>,
    pub(super) device: Arc<Shared>,
}

/// The memory of one buffer, which other APIs open, or which was imported from the host.
pub(super) struct External {
    pub memory: vk::DeviceMemory,
    pub bytes: u64,
    /// The host memory that was imported.
    pub host: Option<Arc<Vec<HostBlock>>>,
}

/// A part of host memory that devices import. Its address is a multiple of its size, as they require.
#[derive(Clone)]
#[repr(align(0x10000))]
#[allow(dead_code, reason = "only devices read the bytes")]
pub(super) struct HostBlock(pub [u8; HOST_BLOCK]);

const _: () = assert!(align_of::<HostBlock>() == HOST_BLOCK);

impl Storage {
    pub(super) fn new(
        device: &Arc<Shared>,
        name: &str,
        bytes: u64,
        usage: vk::BufferUsageFlags,
        location: MemoryLocation,
    ) -> Result<Self> {
        let info = vk::BufferCreateInfo::default().size(bytes).usage(usage);
        let mut storage = Self::unbound(device, name, &info)?;
        // SAFETY: clause 1.
        let mut requirements = unsafe { device.raw.get_buffer_memory_requirements(storage.raw) };
        requirements.alignment = requirements.alignment.max(ALIGNMENT);
        let allocation = storage.allocation.insert(device.allocate(name, requirements, location, true)?);
        // SAFETY: clause 1, the storage holds the memory.
        let (memory, offset) = unsafe { (allocation.memory(), allocation.offset()) };
        storage.bind(memory, offset)?;
        Ok(storage)
    }

    /// A buffer without memory.
    pub(super) fn unbound(device: &Arc<Shared>, name: &str, info: &vk::BufferCreateInfo) -> Result<Self> {
        let (limit, bytes) = (device.capabilities.limits.buffer, info.size);
        if bytes > limit {
            let reason = format!("a buffer on {} holds at most {limit} bytes", device.capabilities.name);
            return Err(OutOfMemory { name: name.to_owned(), bytes: Some(bytes), reason }.into());
        }
        // SAFETY: clause 1, the Storage owns the buffer from here on and frees it on every path.
        let raw = unsafe { device.raw.create_buffer(info, None) }.map_err(|e| describe("vkCreateBuffer", e))?;
        device.name(raw, name);
        Ok(Self {
            raw,
            name: name.to_owned(),
            bytes,
            id: next_id(),
            scalar: Scalar::U32,
            columns: 1,
            allocation: None,
            external: None,
            device: device.clone(),
        })
    }

    /// A type of memory with these properties, one of those whose bits are set.
    pub(super) fn memory_type(&self, among: u32, properties: vk::MemoryPropertyFlags) -> Option<u32> {
        let device = &self.device;
        // SAFETY: clause 1.
        let heaps = unsafe { device.instance.raw.get_physical_device_memory_properties(device.capabilities.raw) };
        let fits = |kind: &u32| {
            let flags = heaps.memory_types[*kind as usize].property_flags;
            among & (1 << kind) != 0 && flags.contains(properties)
        };
        (0..heaps.memory_type_count).find(fits)
    }

    /// Gives the buffer memory that meets its requirements and is nobody else's.
    pub(super) fn bind(&self, memory: vk::DeviceMemory, offset: u64) -> Result<()> {
        // SAFETY: clauses 1 and 4, as said above.
        unsafe { self.device.raw.bind_buffer_memory(self.raw, memory, offset) }
            .map_err(|e| describe("vkBindBufferMemory", e))
    }

    /// The bytes of a host-visible buffer. Panics if the buffer is not host-visible, as does [`Storage::mapped_mut`].
    pub(super) fn mapped(&self) -> &[u8] {
        let bytes = self.allocation.as_ref().and_then(|a| a.mapped_slice()).expect("a staging buffer is mapped");
        &bytes[..self.bytes as usize]
    }

    pub(super) fn mapped_mut(&mut self) -> &mut [u8] {
        let bytes = self.allocation.as_mut().and_then(|a| a.mapped_slice_mut()).expect("a staging buffer is mapped");
        &mut bytes[..self.bytes as usize]
    }
}

impl Drop for Storage {
    fn drop(&mut self) {
        // SAFETY: clause 2, commands hold an Arc of this until they are done.
        unsafe { self.device.raw.destroy_buffer(self.raw, None) };
        if let Some(allocation) = self.allocation.take() {
            self.device.free(allocation);
        }
        if let Some(external) = self.external.take() {
            // SAFETY: clause 2, as above. Other APIs that opened the memory keep it; host memory is freed after this.
            unsafe { self.device.raw.free_memory(external.memory, None) };
        }
    }
}
