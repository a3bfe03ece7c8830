//! An opened device: everything that lives as long as the device.

use std::collections::BTreeSet;
use std::ffi::CString;
use std::ops::{Deref, DerefMut};
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::SystemTime;

use anyhow::{Context, Result};
use ash::{ext, khr, vk};
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme, Allocator};
use gpu_allocator::{AllocationError, MemoryLocation};
use raw_window_handle::{HasDisplayHandle, RawDisplayHandle};

use super::capabilities::{Capabilities, Feature};
use super::error::{Unavailable, describe};
use super::instance::{Instance, Validation};
use super::memory_budget::MemoryBudget;
use super::pipeline_cache::{CachedPipelines, Check, PipelineCache};
use super::pipeline_statistics::{Executable, Executables};
use super::pipelines::Pipelines;
use super::reload::ShaderFolder;
use super::submission::Slot;
use super::survey::{self, DeviceChoice};
use crate::host_memory::OutOfMemory;

/// A device, its queue and its memory. Cheap to clone.
#[derive(Clone)]
pub struct Device(pub(super) Arc<Shared>);

pub(super) struct Shared {
    pub raw: ash::Device,
    pub push_descriptor: khr::push_descriptor::Device,
    pub debug: Option<ext::debug_utils::Device>,
    pub fault: Option<ext::device_fault::Device>,
    pub executables: Option<Executables>,
    /// Sources that replace the shaders built into the program.
    pub shaders: Option<ShaderFolder>,
    pub capabilities: Capabilities,
    /// The missing-barrier check and the stage markers are on.
    pub checked: bool,
    pub queue: Mutex<Queue>,
    /// Counts submissions. Every submission waits for the one before it.
    pub timeline: vk::Semaphore,
    /// Idle slots, kept for later recordings.
    pub slots: Mutex<Vec<Slot>>,
    pub pipelines: Mutex<Pipelines>,
    /// What earlier runs left, and what this one leaves.
    pub pipeline_cache: Option<PipelineCache>,
    pub budget: MemoryBudget,
    /// Taken out in `drop`, to be dropped before the device.
    pub allocator: Mutex<Option<Allocators>>,
    pub instance: Arc<Instance>,
}

/// The allocators of a device: of its memory, and of the memory of the host if that is another.
pub(super) struct Allocators {
    pub device: Allocator,
    pub host: Option<Allocator>,
}

/// The memory of a resource.
pub(super) struct Held {
    allocation: Allocation,
    is_of_host: bool,
}

impl Deref for Held {
    type Target = Allocation;

    fn deref(&self) -> &Allocation {
        &self.allocation
    }
}

impl DerefMut for Held {
    fn deref_mut(&mut self) -> &mut Allocation {
        &mut self.allocation
    }
}

pub(super) struct Queue {
    pub raw: vk::Queue,
    /// The timeline value of the newest submission.
    pub submitted: u64,
}

impl Device {
    /// Opens the device that `choice` names.
    ///
    /// # Errors
    /// [`Unavailable`] if no device fits or the validation layer is required but missing.
    pub fn open(choice: &DeviceChoice, validation: Validation) -> Result<Self> {
        Self::open_on(choice, validation, None)
    }

    /// Like [`Device::open`], for a device that can show windows on `display`.
    pub fn open_for(choice: &DeviceChoice, validation: Validation, display: &dyn HasDisplayHandle) -> Result<Self> {
        Self::open_on(choice, validation, Some(display.display_handle().context("the display is gone")?.as_raw()))
    }

    fn open_on(choice: &DeviceChoice, validation: Validation, display: Option<RawDisplayHandle>) -> Result<Self> {
        let instance = Instance::new(validation, display)?;
        let capabilities = survey::choose(&survey::devices(&instance)?, choice)?;
        let presents = display.is_some();
        if presents && !capabilities.has(Feature::Windows) {
            return Err(Unavailable(format!("{} cannot show windows", capabilities.name)).into());
        }
        let checked = validation != Validation::Off;

        let mut extensions = vec![khr::push_descriptor::NAME.as_ptr()];
        if capabilities.has(Feature::MemoryBudget) {
            extensions.push(ext::memory_budget::NAME.as_ptr());
        }
        if capabilities.has(Feature::DeviceFault) {
            extensions.push(ext::device_fault::NAME.as_ptr());
        }
        if capabilities.has(Feature::PipelineStatistics) {
            extensions.push(khr::pipeline_executable_properties::NAME.as_ptr());
        }
        if capabilities.has(Feature::PortabilitySubset) {
            extensions.push(khr::portability_subset::NAME.as_ptr());
        }
        if capabilities.has(Feature::ExportedMemory) {
            extensions.push(khr::external_memory_fd::NAME.as_ptr());
        }
        if capabilities.has(Feature::SharedHostMemory) {
            extensions.push(ext::external_memory_host::NAME.as_ptr());
        }
        if presents {
            extensions.push(khr::swapchain::NAME.as_ptr());
        }
        let queue =
            vk::DeviceQueueCreateInfo::default().queue_family_index(capabilities.queue_family).queue_priorities(&[1.0]);
        let robust = checked && capabilities.has(Feature::RobustBufferAccess);
        let core = vk::PhysicalDeviceFeatures::default()
            .robust_buffer_access(robust)
            .shader_float64(capabilities.has(Feature::DoubleFloats))
            .shader_storage_image_write_without_format(capabilities.has(Feature::AnyImageFormat));
        let mut features12 = vk::PhysicalDeviceVulkan12Features::default()
            .scalar_block_layout(true)
            .timeline_semaphore(true)
            .host_query_reset(true)
            .subgroup_broadcast_dynamic_id(true)
            .shader_float16(capabilities.has(Feature::HalfFloats));
        let mut features13 = vk::PhysicalDeviceVulkan13Features::default()
            .synchronization2(true)
            .compute_full_subgroups(true)
            .subgroup_size_control(capabilities.has(Feature::SubgroupSizeControl))
            .dynamic_rendering(capabilities.has(Feature::Windows));
        let mut fault = vk::PhysicalDeviceFaultFeaturesEXT::default().device_fault(true);
        let mut executables =
            vk::PhysicalDevicePipelineExecutablePropertiesFeaturesKHR::default().pipeline_executable_info(true);
        let mut info = vk::DeviceCreateInfo::default()
            .queue_create_infos(std::slice::from_ref(&queue))
            .enabled_extension_names(&extensions)
            .enabled_features(&core)
            .push_next(&mut features12)
            .push_next(&mut features13);
        if capabilities.has(Feature::DeviceFault) {
            info = info.push_next(&mut fault);
        }
        if capabilities.has(Feature::PipelineStatistics) {
            info = info.push_next(&mut executables);
        }
        // SAFETY: clause 4, every extension and feature was found in `capabilities`.
        let raw = unsafe { instance.raw.create_device(capabilities.raw, &info, None) }
            .map_err(|e| describe("vkCreateDevice", e))?;
        // SAFETY: clause 1, for this and the calls below: `shared` owns what is made, and frees it on every path.
        let queue = unsafe { raw.get_device_queue(capabilities.queue_family, 0) };
        let mut shared = Shared {
            push_descriptor: khr::push_descriptor::Device::new(&instance.raw, &raw),
            debug: instance.has_debug_utils.then(|| ext::debug_utils::Device::new(&instance.raw, &raw)),
            fault: capabilities.has(Feature::DeviceFault).then(|| ext::device_fault::Device::new(&instance.raw, &raw)),
            executables: capabilities
                .has(Feature::PipelineStatistics)
                .then(|| Executables::new(khr::pipeline_executable_properties::Device::new(&instance.raw, &raw))),
            shaders: None,
            queue: Mutex::new(Queue { raw: queue, submitted: 0 }),
            timeline: vk::Semaphore::null(),
            slots: Mutex::default(),
            pipelines: Mutex::default(),
            pipeline_cache: None,
            budget: MemoryBudget::new(None, None),
            allocator: Mutex::new(None),
            checked,
            capabilities,
            raw,
            instance,
        };
        let mut kind = vk::SemaphoreTypeCreateInfo::default().semaphore_type(vk::SemaphoreType::TIMELINE);
        let info = vk::SemaphoreCreateInfo::default().push_next(&mut kind);
        // SAFETY: as above.
        shared.timeline =
            unsafe { shared.raw.create_semaphore(&info, None) }.map_err(|e| describe("vkCreateSemaphore", e))?;
        shared.name(shared.timeline, "timeline");
        let allocators = shared.make_allocators()?;
        shared.allocator = Mutex::new(Some(allocators));
        Ok(Self(Arc::new(shared)))
    }

    /// The properties, limits and features of the device.
    pub fn capabilities(&self) -> &Capabilities {
        &self.0.capabilities
    }

    /// True if the validation layer is on.
    pub fn is_validated(&self) -> bool {
        self.0.instance.validated
    }

    /// From now on collects the driver's statistics of new stages. Returns false if the driver reports none.
    pub fn record_executables(&self) -> bool {
        self.0.executables.as_ref().inspect(|executables| executables.record()).is_some()
    }

    /// Returns the collected statistics, by the names of the stages, and stops collecting.
    pub fn take_executables(&self) -> Vec<Executable> {
        self.0.executables.as_ref().map_or_else(Vec::new, Executables::take)
    }

    /// All messages of the validation layer and the missing-barrier check so far. A correct program has none.
    pub fn validation_messages(&self) -> Vec<String> {
        self.0.messages().clone()
    }

    /// The number of the newest submission.
    #[cfg(feature = "viewer")]
    pub(super) fn submitted(&self) -> u64 {
        self.0.queue.lock().expect("no holder of the queue panics").submitted
    }

    /// The number of the newest finished submission.
    #[cfg(feature = "viewer")]
    pub(super) fn completed(&self) -> Result<u64> {
        super::submission::completed(&self.0).map_err(|e| describe("vkGetSemaphoreCounterValue", e))
    }

    /// Waits until every submission is done.
    pub(super) fn wait_idle(&self) -> Result<()> {
        let _queue = self.0.queue.lock().expect("no holder of the queue panics");
        // SAFETY: clause 3.
        unsafe { self.0.raw.device_wait_idle() }.map_err(|e| describe("vkDeviceWaitIdle", e))
    }

    /// The number of objects that keep the device open: its handles, and every resource, stage and recording on it.
    pub fn users(&self) -> usize {
        Arc::strong_count(&self.0)
    }

    /// The bytes of device memory that this program has allocated.
    pub fn allocated_bytes(&self) -> u64 {
        let allocators = self.0.allocator();
        let allocators = allocators.as_ref().expect("the allocator lives until drop");
        let all = std::iter::once(&allocators.device).chain(&allocators.host);
        all.map(|allocator| allocator.generate_report().total_allocated_bytes).sum()
    }

    /// Makes later stages compile their shaders from `folder`, which is laid out like `glsl/`. Without a folder, stages
    /// use the shaders built into the program.
    ///
    /// # Errors
    /// The program was built without the feature `reload`, or there is no such folder.
    ///
    /// # Panics
    /// If a buffer, stage or recording of the device exists already.
    pub fn with_shaders(mut self, folder: Option<&Path>) -> Result<Self> {
        let Some(folder) = folder else { return Ok(self) };
        let shared = Arc::get_mut(&mut self.0).expect("a device gets its folder of shaders before anything uses it");
        shared.shaders = Some(ShaderFolder::new(folder)?);
        Ok(self)
    }

    /// Makes later stages from the pipelines that an earlier run compiled, if the driver accepts them. When the device
    /// is closed, `keep` gets the new state, unless it equals `earlier`.
    ///
    /// # Panics
    /// If a buffer, stage or recording of the device exists already.
    pub fn with_pipeline_cache(
        mut self,
        earlier: CachedPipelines,
        keep: impl Fn(&CachedPipelines) + Send + Sync + 'static,
    ) -> Self {
        let shared = Arc::get_mut(&mut self.0).expect("a device gets its pipeline cache before anything uses it");
        shared.pipeline_cache = PipelineCache::new(&shared.raw, earlier, keep);
        self
    }

    /// True if the device passed this check, in this run or an earlier one.
    pub fn has_passed(&self, check: &Check) -> bool {
        self.0.pipeline_cache.as_ref().is_some_and(|cache| cache.passed().contains(check))
    }

    /// Records that the device passed this check, if it has a pipeline cache.
    pub fn remember_passed(&self, check: Check) {
        if let Some(cache) = &self.0.pipeline_cache {
            cache.passed().insert(check);
        }
    }

    /// The time of the newest change in the folder of shaders; `None` without [`Device::with_shaders`].
    pub fn newest_shader(&self) -> Option<SystemTime> {
        self.0.shaders.as_ref()?.newest()
    }
}

impl Shared {
    /// Gives a Vulkan object the name that validation messages and capture tools show.
    pub fn name(&self, object: impl vk::Handle, name: &str) {
        let Some(debug) = &self.debug else { return };
        let name = CString::new(name).expect("names contain no zero byte");
        let info = vk::DebugUtilsObjectNameInfoEXT::default().object_handle(object).object_name(&name);
        // SAFETY: clause 1. An object without a name is no failure.
        let _ = unsafe { debug.set_debug_utils_object_name(&info) };
    }

    pub fn report(&self, message: String) {
        self.messages().push(message);
    }

    fn messages(&self) -> MutexGuard<'_, Vec<String>> {
        self.instance.messages.lock().expect("no holder of the messages panics")
    }

    pub(super) fn allocator(&self) -> MutexGuard<'_, Option<Allocators>> {
        self.allocator.lock().expect("no holder of the allocator panics")
    }

    /// Allocates memory for one resource. `linear` is true for buffers.
    pub fn allocate(
        &self,
        name: &str,
        requirements: vk::MemoryRequirements,
        location: MemoryLocation,
        linear: bool,
    ) -> Result<Held> {
        let refuse = |reason: String| OutOfMemory { name: name.to_owned(), bytes: Some(requirements.size), reason };
        let scheme = AllocationScheme::GpuAllocatorManaged;
        let desc = AllocationCreateDesc { name, requirements, location, linear, allocation_scheme: scheme };
        let mut allocators = self.allocator();
        let allocators = allocators.as_mut().expect("the allocator lives until drop");
        let allocation = match &mut allocators.host {
            Some(host) if location != MemoryLocation::GpuOnly => {
                host.allocate(&desc).map(|allocation| Held { allocation, is_of_host: true })
            }
            _ => {
                let device = &mut allocators.device;
                let excess = self.budget.excess(|| device.generate_report(), requirements.size);
                if excess > 0 {
                    return Err(refuse(format!("it would pass the limit of memory by {excess} bytes")).into());
                }
                let mut allocation = device.allocate(&desc);
                let bytes = device.generate_report().total_capacity_bytes;
                if self.budget.limit.is_some_and(|limit| bytes > limit) && allocation.is_ok() {
                    // It did not fit into the shared block that had seemed to have room.
                    let freed = allocation.and_then(|allocation| device.free(allocation));
                    allocation = Err(freed.err().unwrap_or(AllocationError::OutOfMemory));
                }
                self.budget.record(device.generate_report().total_capacity_bytes);
                if self.budget.user_limit.is_some() {
                    self.driver_budget().inspect(|(_, used)| _ = self.budget.record_driver_used(*used));
                }
                allocation.map(|allocation| Held { allocation, is_of_host: false })
            }
        };
        allocation.map_err(|error| match error {
            AllocationError::OutOfMemory => refuse(format!(
                "{} has {} bytes in total and not enough free",
                self.capabilities.name, self.capabilities.memory_bytes
            ))
            .into(),
            other => anyhow::Error::from(other).context(format!("cannot allocate memory for {name}")),
        })
    }

    pub fn free(&self, held: Held) {
        let mut allocators = self.allocator();
        let allocators = allocators.as_mut().expect("the allocator lives until drop");
        let owner = if held.is_of_host { allocators.host.as_mut() } else { None }.unwrap_or(&mut allocators.device);
        owner.free(held.allocation).expect("an allocation is freed once, by its owner");
    }
}

impl Drop for Shared {
    fn drop(&mut self) {
        if let Some(cache) = self.pipeline_cache.take() {
            cache.close(&self.raw);
        }
        // SAFETY: clauses 1 and 2, no resource and no submission is left; the allocator frees its blocks first.
        unsafe {
            let _ = self.raw.device_wait_idle();
            for slot in self.slots.get_mut().expect("no holder of the slots panics").drain(..) {
                slot.destroy(&self.raw);
            }
            drop(self.allocator.get_mut().expect("no holder of the allocator panics").take());
            self.raw.destroy_semaphore(self.timeline, None);
            self.raw.destroy_device(None);
        }
    }
}

/// The names of devices, each once.
pub fn names_of(devices: &[Device]) -> String {
    let names: BTreeSet<&str> = devices.iter().map(|device| device.capabilities().name.as_str()).collect();
    Vec::from_iter(names).join(", ")
}

/// A note if devices are of different kinds.
pub fn different_kinds(devices: &[Device]) -> Option<String> {
    let kinds = names_of(devices);
    let are_different = devices.iter().any(|device| device.capabilities().name != kinds);
    are_different
        .then(|| format!("note: the devices are of different kinds ({kinds}): their pictures may differ by rounding"))
}
