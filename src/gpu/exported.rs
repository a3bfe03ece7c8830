//! Device memory that another API on the same device opens, like CUDA.

use std::ffi::c_int;
use std::sync::Arc;

use anyhow::{Context, Result, ensure};
use ash::{khr, vk};

use super::buffer::{Buffer, External, Storage};
use super::capabilities::{BUFFER_USAGE, EXPORT_HANDLE, Feature};
use super::device::{Device, Shared};
use super::element::Element;
use super::error::describe;

/// A handle of device memory.
pub struct Handle {
    /// A file descriptor that the receiver owns: CUDA closes it when it opens the memory.
    pub file: c_int,
    /// The size of the memory, in bytes.
    pub bytes: u64,
}

impl<T: Element> Buffer<T> {
    /// Allocates a buffer like [`new`](Self::new), whose memory other APIs open.
    ///
    /// # Errors
    /// As for [`new`](Self::new); if the device exports no memory, or a limit of memory is set.
    pub fn exportable(device: &Device, name: &str, len: usize) -> Result<Self> {
        Self::check_len(device, name, len)?;
        let bytes = (len.max(1) * size_of::<T>()) as u64;
        Ok(Self::of(Storage::exportable(&device.0, name, bytes, BUFFER_USAGE)?, len))
    }

    /// A handle with which another API opens the memory.
    ///
    /// # Errors
    /// If the buffer is not exportable, or the driver makes no handle.
    pub fn export(&self) -> Result<Handle> {
        self.storage.export()
    }
}

impl Storage {
    /// A buffer whose memory can be exported.
    ///
    /// # Errors
    /// If the device exports no memory, a limit of memory is set, which such memory would not count towards, or memory
    /// runs out.
    pub(super) fn exportable(
        device: &Arc<Shared>,
        name: &str,
        bytes: u64,
        usage: vk::BufferUsageFlags,
    ) -> Result<Self> {
        let device_name = &device.capabilities.name;
        ensure!(device.capabilities.has(Feature::ExportedMemory), "{device_name} exports no memory");
        ensure!(device.budget.user_limit.is_none(), "no memory is exported under a limit of memory");
        let mut external = vk::ExternalMemoryBufferCreateInfo::default().handle_types(EXPORT_HANDLE);
        let info = vk::BufferCreateInfo::default().size(bytes).usage(usage).push_next(&mut external);
        let mut storage = Self::unbound(device, name, &info)?;
        // SAFETY: clause 1.
        let requirements = unsafe { device.raw.get_buffer_memory_requirements(storage.raw) };
        let kind = storage.memory_type(requirements.memory_type_bits, vk::MemoryPropertyFlags::DEVICE_LOCAL);
        let kind = kind.context("no device memory can be exported")?;
        let mut dedicated = vk::MemoryDedicatedAllocateInfo::default().buffer(storage.raw);
        let mut export = vk::ExportMemoryAllocateInfo::default().handle_types(EXPORT_HANDLE);
        let info = vk::MemoryAllocateInfo::default()
            .allocation_size(requirements.size)
            .memory_type_index(kind)
            .push_next(&mut dedicated)
            .push_next(&mut export);
        // SAFETY: clauses 1 and 4, the storage owns the memory and frees it on every path; the device has the
        // extension.
        let memory =
            unsafe { device.raw.allocate_memory(&info, None) }.map_err(|error| describe("vkAllocateMemory", error))?;
        storage.external = Some(External { memory, bytes: requirements.size, host: None });
        storage.bind(memory, 0)?;
        Ok(storage)
    }

    /// A new handle of the memory. It stays open for whoever opens it when the buffer is gone.
    pub(super) fn export(&self) -> Result<Handle> {
        let exported = self.external.as_ref().filter(|external| external.host.is_none());
        let exported = exported.context("this memory is not exported")?;
        let api = khr::external_memory_fd::Device::new(&self.device.instance.raw, &self.device.raw);
        let info = vk::MemoryGetFdInfoKHR::default().memory(exported.memory).handle_type(EXPORT_HANDLE);
        // SAFETY: clauses 1 and 4, the memory was made for handles of this type.
        let file = unsafe { api.get_memory_fd(&info) }.map_err(|error| describe("vkGetMemoryFdKHR", error))?;
        Ok(Handle { file, bytes: exported.bytes })
    }
}

#[cfg(all(test, unix))]
mod tests {
    use std::fs::File;
    use std::os::fd::FromRawFd;

    use super::*;
    use crate::gpu::{Access, Buffer, Commands, Device, DeviceChoice, Staging, Validation};

    #[test]
    fn exported_memory_is_opened_by_its_handle() {
        let device = Device::open(&DeviceChoice::Best, Validation::IfInstalled).unwrap();
        if !device.capabilities().has(Feature::ExportedMemory) {
            return;
        }
        let values: Vec<u32> = (0..5000).map(|i| i * 7919).collect();
        let from = Buffer::new(&device, "from", values.len()).unwrap();
        let to = Staging::exportable(&device, "to", values.len()).unwrap();
        let mut cmd = Commands::new(&device).unwrap();
        cmd.upload(&from, 0, values.len(), |words| words.copy_from_slice(&values)).unwrap();
        cmd.barrier(Access::COPY_WRITE, Access::COPY_READ);
        cmd.download(&from, &to, values.len());
        cmd.submit().unwrap().wait().unwrap();
        let bound = Buffer::exportable(&device, "bound", values.len()).unwrap();
        let mut cmd = Commands::new(&device).unwrap();
        cmd.upload(&bound, 0, values.len(), |words| words.copy_from_slice(&values)).unwrap();
        cmd.submit().unwrap().wait().unwrap();
        for handle in [to.export().unwrap(), bound.export().unwrap()] {
            assert!(handle.bytes >= 4 * values.len() as u64);
            // SAFETY: the file is the test's alone.
            let mut file = unsafe { File::from_raw_fd(handle.file) };
            // The software driver's memory is a file that can be read.
            if device.capabilities().name.contains("llvmpipe") {
                let mut found = Vec::new();
                std::io::Read::read_to_end(&mut file, &mut found).unwrap();
                let expected: &[u8] = bytemuck::cast_slice(&values);
                assert!(found.windows(expected.len()).any(|window| window == expected), "{} bytes", found.len());
            }
        }
        assert!(device.validation_messages().is_empty(), "{:?}", device.validation_messages());
    }

    #[test]
    fn a_limit_of_memory_allows_no_export() {
        let device = Device::open(&DeviceChoice::Best, Validation::IfInstalled).unwrap();
        let device = device.with_memory_limit(Some(256 << 20)).unwrap();
        assert!(Staging::<u32>::exportable(&device, "to", 8).is_err());
        let host = Staging::<u32>::new(&device, "host", 8).unwrap();
        assert!(host.export().is_err());
    }
}
