//! Host memory that several devices copy to and from, so that data go from one to another without a copy by the host.

use std::sync::Arc;

use anyhow::{Context, Result, ensure};
use ash::{ext, vk};

use super::buffer::{External, HostBlock, Storage};
use super::capabilities::{DeviceKind, Feature, HOST_BLOCK, HOST_HANDLE, STAGING_USAGE};
use super::device::{Device, Shared};
use super::element::Element;
use super::error::{DeviceLost, describe};
use super::staging::Staging;
use crate::host_memory::host_vec;

impl<T: Element> Staging<T> {
    /// The same memory on two devices. It cannot be mapped. Commands of both must not use it at the same time. `None`
    /// if a device shares no memory of the host, or if that would count towards a limit of the device's memory.
    ///
    /// # Errors
    /// If memory of the host runs out, or a device is lost.
    pub fn shared(devices: [&Device; 2], name: &str, len: usize) -> Result<Option<[Self; 2]>> {
        let shares = |device: &Device| {
            let is_counted = device.0.budget.user_limit.is_some() && device.capabilities().kind != DeviceKind::Discrete;
            device.capabilities().has(Feature::SharedHostMemory) && !is_counted
        };
        if !devices.into_iter().all(shares) {
            return Ok(None);
        }
        let blocks = (len.max(1) * size_of::<T>()).div_ceil(HOST_BLOCK);
        let mut memory = host_vec(blocks, name)?;
        memory.resize(blocks, HostBlock([0; HOST_BLOCK]));
        let memory = Arc::new(memory);
        let of = |device: &Device| -> Result<Self> {
            Ok(Self::of(Storage::importing(&device.0, name, memory.clone())?, len))
        };
        match (of(devices[0]), of(devices[1])) {
            (Ok(first), Ok(second)) => Ok(Some([first, second])),
            (Err(problem), _) | (_, Err(problem)) if problem.is::<DeviceLost>() => Err(problem),
            // A driver may refuse memory that another one has imported.
            _ => Ok(None),
        }
    }
}

impl Storage {
    /// A buffer in host memory.
    fn importing(device: &Arc<Shared>, name: &str, host: Arc<Vec<HostBlock>>) -> Result<Self> {
        let bytes = (host.len() * HOST_BLOCK) as u64;
        let mut external = vk::ExternalMemoryBufferCreateInfo::default().handle_types(HOST_HANDLE);
        let info = vk::BufferCreateInfo::default().size(bytes).usage(STAGING_USAGE).push_next(&mut external);
        let mut storage = Self::unbound(device, name, &info)?;
        // SAFETY: clause 1.
        let requirements = unsafe { device.raw.get_buffer_memory_requirements(storage.raw) };
        let api = ext::external_memory_host::Device::new(&device.instance.raw, &device.raw);
        let pointer = host.as_ptr().cast_mut().cast();
        let mut found = vk::MemoryHostPointerPropertiesEXT::default();
        // SAFETY: clause 4, the device has the extension, and the blocks have its alignment.
        unsafe { (api.fp().get_memory_host_pointer_properties_ext)(api.device(), HOST_HANDLE, pointer, &mut found) }
            .result()
            .map_err(|error| describe("vkGetMemoryHostPointerPropertiesEXT", error))?;
        let kind = storage
            .memory_type(requirements.memory_type_bits & found.memory_type_bits, vk::MemoryPropertyFlags::HOST_COHERENT)
            .with_context(|| format!("{} shares no memory of the host", device.capabilities.name))?;
        ensure!(requirements.size <= bytes, "{} needs more memory for a buffer than the buffer has", storage.name);
        let mut import = vk::ImportMemoryHostPointerInfoEXT::default().handle_type(HOST_HANDLE).host_pointer(pointer);
        let info =
            vk::MemoryAllocateInfo::default().allocation_size(bytes).memory_type_index(kind).push_next(&mut import);
        // SAFETY: clauses 1 and 4, the storage owns the memory and keeps the blocks as long; the device has the
        // extension.
        let memory =
            unsafe { device.raw.allocate_memory(&info, None) }.map_err(|error| describe("vkAllocateMemory", error))?;
        storage.external = Some(External { memory, bytes, host: Some(host) });
        storage.bind(memory, 0)?;
        Ok(storage)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::{Access, Buffer, Commands, DeviceChoice, Validation};

    #[test]
    fn a_limit_of_memory_of_the_host_allows_no_sharing() {
        let open = || Device::open(&DeviceChoice::Best, Validation::IfInstalled).unwrap();
        let limited = open().with_memory_limit(Some(256 << 20)).unwrap();
        let is_discrete = limited.capabilities().kind == DeviceKind::Discrete;
        assert_eq!(Staging::<u32>::shared([&limited, &open()], "shared", 8).unwrap().is_some(), is_discrete);
    }

    #[test]
    fn what_one_device_writes_another_reads() {
        let open = || Device::open(&DeviceChoice::Best, Validation::IfInstalled).unwrap();
        let (first, second) = (open(), open());
        for len in [1_usize, 50_000] {
            let shared = Staging::<u32>::shared([&first, &second], "shared", len).unwrap();
            let [from_first, to_second] = shared.expect("the device shares host memory");
            let values = Vec::from_iter((0..len as u32).map(|i| i * 7919 + 1));
            let buffer = Buffer::new(&first, "values", len).unwrap();
            let mut cmd = Commands::new(&first).unwrap();
            cmd.upload(&buffer, 0, len, |words| words.copy_from_slice(&values)).unwrap();
            cmd.barrier(Access::COPY_WRITE, Access::COPY_READ);
            cmd.download(&buffer, &from_first, len);
            cmd.submit().unwrap().wait().unwrap();
            assert!(from_first.is_idle());
            let copied = Buffer::new(&second, "copied", len).unwrap();
            let mut found = Staging::new(&second, "found", len).unwrap();
            let mut cmd = Commands::new(&second).unwrap();
            cmd.upload_staged(&to_second, &copied, len);
            cmd.barrier(Access::COPY_WRITE, Access::COPY_READ);
            cmd.download(&copied, &found, len);
            // The memory lives as long as commands use it.
            drop((from_first, to_second));
            cmd.submit().unwrap().wait().unwrap();
            assert!(found.map() == values);
        }
        for device in [first, second] {
            assert!(device.validation_messages().is_empty(), "{:?}", device.validation_messages());
        }
    }
}
