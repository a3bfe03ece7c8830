//! What a Vulkan device is and can do, read before it is opened.

use std::ffi::CStr;

use anyhow::Result;
use ash::{ext, khr, vk};
use serde::Serialize;

use super::device::Validation;
use super::error::{Unavailable, describe};
use super::instance::{Instance, NO_DRIVER};

/// Which device to use.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum DeviceChoice {
    /// Discrete before integrated before virtual before CPU.
    #[default]
    Best,
    /// By the number that `doctor` lists.
    Index(usize),
    /// By a part of its name, whatever the case.
    Name(String),
}

impl From<&str> for DeviceChoice {
    fn from(text: &str) -> Self {
        match text.parse() {
            Ok(index) => Self::Index(index),
            Err(_) => Self::Name(text.to_owned()),
        }
    }
}

/// What was read from one physical device.
#[derive(Clone, Debug, Serialize)]
pub struct DeviceFacts {
    pub name: String,
    /// discrete, integrated, virtual, CPU or other.
    pub kind: &'static str,
    pub driver: String,
    pub vulkan: String,
    /// Tells one of several equal devices from the others; the driver's own tools print it too.
    pub uuid: String,
    /// Invocations in a subgroup: smallest and largest.
    pub subgroup_size: [u32; 2],
    /// Device-local memory in bytes; what is free of it, where the driver tells.
    pub memory_bytes: u64,
    pub memory_free_bytes: Option<u64>,
    pub limits: Limits,
    /// Optional features, used when present.
    pub optional: Vec<(&'static str, bool)>,
    /// What smalto needs and this device lacks; empty when it can be used.
    pub missing: Vec<String>,
    /// Loop iterations that an invocation may run before the driver ends it silently.
    pub loop_limit: Option<u32>,
    /// Once triangles have been drawn, the driver takes a timestamp only when the next one is written.
    #[serde(skip)]
    pub(super) has_late_timestamps: bool,
    #[serde(skip)]
    pub(super) raw: vk::PhysicalDevice,
    #[serde(skip)]
    pub(super) queue_family: u32,
    #[serde(skip)]
    pub(super) rank: u32,
}

/// The limits that bound a scene or an image.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Limits {
    /// Largest storage buffer range, in bytes.
    pub storage_range: u64,
    /// Largest buffer and largest allocation, in bytes.
    pub buffer: u64,
    pub allocation: u64,
    /// Widest and highest image.
    pub image: u32,
    /// Storage buffers that a stage may bind.
    pub storage_buffers: u32,
    /// Workgroup memory in bytes.
    pub workgroup_memory: u32,
    pub workgroup_invocations: u32,
    pub push_constants: u32,
    /// Nanoseconds of a timestamp tick; 0 when there are no timestamps.
    pub timestamp_ns: f32,
    pub timestamp_bits: u32,
}

impl DeviceFacts {
    /// Whether the stages of the fast path run on it.
    pub(crate) fn has_fast_path(&self) -> bool {
        let [smallest, largest] = self.subgroup_size;
        smallest == largest
            && (8..=64).contains(&smallest)
            && self.has(SHUFFLES)
            && self.limits.workgroup_invocations >= 1024
    }

    pub(super) fn has(&self, optional: &str) -> bool {
        self.optional.iter().any(|(name, present)| *name == optional && *present)
    }
}

/// What a stage may bind: that many are required of a device.
pub(super) const MAX_STORAGE_BUFFERS: u32 = 24;
pub(super) const HALF_FLOATS: &str = "f16 arithmetic";
pub(super) const MEMORY_BUDGET: &str = "memory budget";
pub(super) const PORTABILITY_SUBSET: &str = "portability subset";
pub(super) const DEVICE_FAULT: &str = "device fault";
pub(super) const EXECUTABLES: &str = "pipeline statistics";
pub(super) const SWAPCHAINS: &str = "windows";
pub(super) const SHUFFLES: &str = "subgroup shuffles";
pub(super) const ANY_FORMAT: &str = "image stores of any format";

/// Every device of this machine, usable or not, in the loader's order.
pub fn survey() -> Result<Vec<DeviceFacts>> {
    devices(&*Instance::new(Validation::Off, None)?)
}

pub(super) fn devices(instance: &Instance) -> Result<Vec<DeviceFacts>> {
    // SAFETY: clause 1.
    let devices =
        unsafe { instance.raw.enumerate_physical_devices() }.map_err(|e| describe("vkEnumeratePhysicalDevices", e))?;
    devices.into_iter().map(|device| read(instance, device)).collect()
}

/// The device that `choice` names, or a sentence that says why there is none.
pub(super) fn choose(devices: &[DeviceFacts], choice: &DeviceChoice) -> Result<DeviceFacts, Unavailable> {
    if devices.is_empty() {
        return Err(Unavailable(NO_DRIVER.to_owned()));
    }
    let list = || {
        let lines = devices.iter().enumerate().map(|(i, d)| format!("{i} {}", d.name));
        lines.collect::<Vec<_>>().join(", ")
    };
    let candidates: Vec<&DeviceFacts> = match choice {
        DeviceChoice::Best => devices.iter().collect(),
        DeviceChoice::Index(index) => devices.get(*index).into_iter().collect(),
        DeviceChoice::Name(part) => {
            let part = part.to_lowercase();
            devices.iter().filter(|d| d.name.to_lowercase().contains(&part)).collect()
        }
    };
    if candidates.is_empty() {
        let asked = match choice {
            DeviceChoice::Index(index) => format!("number {index}"),
            DeviceChoice::Name(name) => format!("named '{name}'"),
            DeviceChoice::Best => unreachable!("the best of a non-empty list exists"),
        };
        return Err(Unavailable(format!("there is no Vulkan device {asked}; there are: {}", list())));
    }
    match candidates.iter().filter(|d| d.missing.is_empty()).min_by_key(|d| d.rank) {
        Some(device) => Ok((*device).clone()),
        None => {
            let reasons = candidates.iter().map(|d| format!("{} lacks {}", d.name, d.missing.join(", ")));
            Err(Unavailable(format!(
                "no Vulkan device can be used: {}; a newer driver may help",
                reasons.collect::<Vec<_>>().join("; ")
            )))
        }
    }
}

fn read(instance: &Instance, raw: vk::PhysicalDevice) -> Result<DeviceFacts> {
    // SAFETY: clause 1, for this and the other queries of the physical device below.
    let extensions = unsafe { instance.raw.enumerate_device_extension_properties(raw) }
        .map_err(|e| describe("vkEnumerateDeviceExtensionProperties", e))?;
    let offers = |name: &CStr| extensions.iter().any(|e| e.extension_name_as_c_str() == Ok(name));

    let mut driver = vk::PhysicalDeviceDriverProperties::default();
    let mut id = vk::PhysicalDeviceIDProperties::default();
    let mut subgroup = vk::PhysicalDeviceSubgroupProperties::default();
    let mut subgroup_sizes = vk::PhysicalDeviceSubgroupSizeControlProperties::default();
    let mut maintenance3 = vk::PhysicalDeviceMaintenance3Properties::default();
    let mut maintenance4 = vk::PhysicalDeviceMaintenance4Properties::default();
    let mut properties = vk::PhysicalDeviceProperties2::default()
        .push_next(&mut driver)
        .push_next(&mut id)
        .push_next(&mut subgroup)
        .push_next(&mut subgroup_sizes)
        .push_next(&mut maintenance3)
        .push_next(&mut maintenance4);
    unsafe { instance.raw.get_physical_device_properties2(raw, &mut properties) };
    let properties = properties.properties;

    let mut features11 = vk::PhysicalDeviceVulkan11Features::default();
    let mut features12 = vk::PhysicalDeviceVulkan12Features::default();
    let mut features13 = vk::PhysicalDeviceVulkan13Features::default();
    let mut fault = vk::PhysicalDeviceFaultFeaturesEXT::default();
    let mut features = vk::PhysicalDeviceFeatures2::default()
        .push_next(&mut features11)
        .push_next(&mut features12)
        .push_next(&mut features13);
    let mut executables = vk::PhysicalDevicePipelineExecutablePropertiesFeaturesKHR::default();
    let has_executables = offers(khr::pipeline_executable_properties::NAME);
    if has_executables {
        features = features.push_next(&mut executables);
    }
    let has_fault_extension = offers(ext::device_fault::NAME);
    if has_fault_extension {
        features = features.push_next(&mut fault);
    }
    unsafe { instance.raw.get_physical_device_features2(raw, &mut features) };
    let core = features.features;

    let families = unsafe { instance.raw.get_physical_device_queue_family_properties(raw) };
    let family_of = |wanted| families.iter().position(|f| f.queue_flags.contains(wanted));
    let draws_and_computes = family_of(vk::QueueFlags::COMPUTE | vk::QueueFlags::GRAPHICS);
    let draws = draws_and_computes.is_some() && features13.dynamic_rendering == vk::TRUE;
    let family = draws_and_computes.or_else(|| family_of(vk::QueueFlags::COMPUTE));

    let workgroup =
        properties.limits.max_compute_work_group_invocations.min(properties.limits.max_compute_work_group_size[0]);
    let storage_buffers = properties
        .limits
        .max_per_stage_descriptor_storage_buffers
        .min(properties.limits.max_descriptor_set_storage_buffers);
    let wanted_operations = vk::SubgroupFeatureFlags::BASIC
        | vk::SubgroupFeatureFlags::VOTE
        | vk::SubgroupFeatureFlags::BALLOT
        | vk::SubgroupFeatureFlags::ARITHMETIC;
    let requirements = [
        ("Vulkan 1.3", properties.api_version >= vk::API_VERSION_1_3),
        ("VK_KHR_push_descriptor", offers(khr::push_descriptor::NAME)),
        ("a compute queue", family.is_some()),
        ("scalar block layout", features12.scalar_block_layout == vk::TRUE),
        ("timeline semaphores", features12.timeline_semaphore == vk::TRUE),
        ("host query reset", features12.host_query_reset == vk::TRUE),
        ("dynamic subgroup broadcast", features12.subgroup_broadcast_dynamic_id == vk::TRUE),
        ("synchronization2", features13.synchronization2 == vk::TRUE),
        ("full subgroups", features13.compute_full_subgroups == vk::TRUE),
        (
            "subgroup vote, ballot and arithmetic in compute shaders",
            subgroup.supported_operations.contains(wanted_operations),
        ),
        (
            "subgroups of 4 to 128 invocations",
            subgroup_sizes.min_subgroup_size >= 4 && subgroup_sizes.max_subgroup_size <= 128,
        ),
        ("workgroups of 256 invocations", workgroup >= 256),
        ("24 storage buffers in a stage", storage_buffers >= MAX_STORAGE_BUFFERS),
        ("32 KiB of workgroup memory", properties.limits.max_compute_shared_memory_size >= 32 << 10),
    ];
    let missing = requirements.iter().filter(|(_, met)| !met).map(|(what, _)| (*what).to_owned()).collect();
    let optional = vec![
        (HALF_FLOATS, features12.shader_float16 == vk::TRUE),
        ("8-bit storage", features12.storage_buffer8_bit_access == vk::TRUE),
        ("16-bit storage", features11.storage_buffer16_bit_access == vk::TRUE),
        ("subgroup size control", features13.subgroup_size_control == vk::TRUE),
        ("robust buffer access", core.robust_buffer_access == vk::TRUE),
        (MEMORY_BUDGET, offers(ext::memory_budget::NAME)),
        (PORTABILITY_SUBSET, offers(khr::portability_subset::NAME)),
        (DEVICE_FAULT, has_fault_extension && fault.device_fault == vk::TRUE),
        (EXECUTABLES, has_executables && executables.pipeline_executable_info == vk::TRUE),
        (SHUFFLES, subgroup.supported_operations.contains(vk::SubgroupFeatureFlags::SHUFFLE)),
        (SWAPCHAINS, offers(khr::swapchain::NAME) && draws),
        (ANY_FORMAT, core.shader_storage_image_write_without_format == vk::TRUE),
    ];

    let (kind, rank) = match properties.device_type {
        vk::PhysicalDeviceType::DISCRETE_GPU => ("discrete", 0),
        vk::PhysicalDeviceType::INTEGRATED_GPU => ("integrated", 1),
        vk::PhysicalDeviceType::VIRTUAL_GPU => ("virtual", 2),
        vk::PhysicalDeviceType::CPU => ("CPU", 3),
        _ => ("other", 4),
    };
    let (memory_bytes, memory_free_bytes) = memory(instance, raw, offers(ext::memory_budget::NAME));
    let limits = properties.limits;
    let is_llvmpipe = driver.driver_id == vk::DriverId::MESA_LLVMPIPE;
    let text =
        |bytes: Result<&CStr, _>| bytes.map_or_else(|_| "?".to_owned(), |s: &CStr| s.to_string_lossy().into_owned());
    Ok(DeviceFacts {
        name: text(properties.device_name_as_c_str()),
        kind,
        driver: format!("{} {}", text(driver.driver_name_as_c_str()), text(driver.driver_info_as_c_str()))
            .trim()
            .to_owned(),
        vulkan: format!(
            "{}.{}.{}",
            vk::api_version_major(properties.api_version),
            vk::api_version_minor(properties.api_version),
            vk::api_version_patch(properties.api_version)
        ),
        uuid: uuid(id.device_uuid),
        subgroup_size: [subgroup_sizes.min_subgroup_size, subgroup_sizes.max_subgroup_size],
        memory_bytes,
        memory_free_bytes,
        limits: Limits {
            storage_range: limits.max_storage_buffer_range.into(),
            buffer: maintenance4.max_buffer_size,
            allocation: maintenance3.max_memory_allocation_size,
            image: limits.max_image_dimension2_d,
            storage_buffers,
            workgroup_memory: limits.max_compute_shared_memory_size,
            workgroup_invocations: workgroup,
            push_constants: limits.max_push_constants_size,
            timestamp_ns: limits.timestamp_period,
            timestamp_bits: family.map_or(0, |f| families[f].timestamp_valid_bits),
        },
        optional,
        missing,
        // llvmpipe's loop limiter, LP_MAX_TGSI_LOOP_ITERATIONS; summed over all loops of an invocation.
        loop_limit: is_llvmpipe.then_some(65_535),
        has_late_timestamps: is_llvmpipe,
        raw,
        queue_family: family.unwrap_or(0) as u32,
        rank,
    })
}

/// 8-4-4-4-12 hexadecimal digits.
fn uuid(bytes: [u8; 16]) -> String {
    let groups = [&bytes[..4], &bytes[4..6], &bytes[6..8], &bytes[8..10], &bytes[10..]];
    groups.map(|group| group.iter().map(|b| format!("{b:02x}")).collect::<String>()).join("-")
}

/// Device-local bytes: all, and free if the driver tells.
fn memory(instance: &Instance, raw: vk::PhysicalDevice, has_budget: bool) -> (u64, Option<u64>) {
    let mut budget = vk::PhysicalDeviceMemoryBudgetPropertiesEXT::default();
    let mut properties = vk::PhysicalDeviceMemoryProperties2::default();
    if has_budget {
        properties = properties.push_next(&mut budget);
    }
    // SAFETY: clause 1.
    unsafe { instance.raw.get_physical_device_memory_properties2(raw, &mut properties) };
    let heaps = properties.memory_properties;
    let local = (0..heaps.memory_heap_count as usize)
        .filter(|&i| heaps.memory_heaps[i].flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL))
        .max_by_key(|&i| heaps.memory_heaps[i].size);
    match local {
        None => (0, None),
        Some(i) => {
            let free = budget.heap_budget[i].saturating_sub(budget.heap_usage[i]);
            (heaps.memory_heaps[i].size, has_budget.then_some(free))
        }
    }
}
