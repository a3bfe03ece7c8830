//! Lists the Vulkan devices of this machine, reads their capabilities and chooses one.

use std::ffi::CStr;

use anyhow::Result;
use ash::{ext, khr, vk};

use super::capabilities::{
    BUFFER_USAGE, Capabilities, DeviceKind, EXPORT_HANDLE, Feature, HOST_BLOCK, HOST_HANDLE, Limits,
    MAX_STORAGE_BUFFERS, RequiredSubgroups, STAGING_USAGE,
};
use super::error::{Unavailable, describe};
use super::instance::{Instance, NO_DRIVER, Validation};

/// The device to open.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum DeviceChoice {
    /// The first usable device by [`DeviceKind`]: discrete before integrated before virtual before CPU.
    #[default]
    Best,
    /// The number that `smalto doctor` prints.
    Index(usize),
    /// A part of the name; case is ignored.
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

/// Lists every device of this machine, usable or not, in the loader's order.
///
/// # Errors
/// [`Unavailable`] if there is no Vulkan loader or driver.
pub fn survey() -> Result<Vec<Capabilities>> {
    devices(&*Instance::new(Validation::Off, None)?)
}

pub(super) fn devices(instance: &Instance) -> Result<Vec<Capabilities>> {
    // SAFETY: clause 1.
    let devices =
        unsafe { instance.raw.enumerate_physical_devices() }.map_err(|e| describe("vkEnumeratePhysicalDevices", e))?;
    devices.into_iter().map(|device| read(instance, device)).collect()
}

/// Returns the device that `choice` names, or an error that says why there is none.
pub(super) fn choose(devices: &[Capabilities], choice: &DeviceChoice) -> Result<Capabilities, Unavailable> {
    if devices.is_empty() {
        return Err(Unavailable(NO_DRIVER.to_owned()));
    }
    let list = || {
        let lines = devices.iter().enumerate().map(|(i, d)| format!("{i} {}", d.name));
        lines.collect::<Vec<_>>().join(", ")
    };
    let candidates: Vec<&Capabilities> = match choice {
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
    match candidates.iter().filter(|d| d.missing.is_empty()).min_by_key(|d| d.kind) {
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

fn read(instance: &Instance, raw: vk::PhysicalDevice) -> Result<Capabilities> {
    // SAFETY: clause 1.
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
    // SAFETY: clause 1.
    unsafe { instance.raw.get_physical_device_properties2(raw, &mut properties) };
    let properties = properties.properties;

    let mut features11 = vk::PhysicalDeviceVulkan11Features::default();
    let mut features12 = vk::PhysicalDeviceVulkan12Features::default();
    let mut features13 = vk::PhysicalDeviceVulkan13Features::default();
    let mut fault = vk::PhysicalDeviceFaultFeaturesEXT::default();
    let mut queried = vk::PhysicalDeviceFeatures2::default()
        .push_next(&mut features11)
        .push_next(&mut features12)
        .push_next(&mut features13);
    let mut executables = vk::PhysicalDevicePipelineExecutablePropertiesFeaturesKHR::default();
    let has_executables = offers(khr::pipeline_executable_properties::NAME);
    if has_executables {
        queried = queried.push_next(&mut executables);
    }
    let has_fault_extension = offers(ext::device_fault::NAME);
    if has_fault_extension {
        queried = queried.push_next(&mut fault);
    }
    // SAFETY: clause 1.
    unsafe { instance.raw.get_physical_device_features2(raw, &mut queried) };
    let core = queried.features;

    // SAFETY: clause 1.
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
        ("25 storage buffers in a stage", storage_buffers >= MAX_STORAGE_BUFFERS),
        ("32 KiB of workgroup memory", properties.limits.max_compute_shared_memory_size >= 32 << 10),
    ];
    let missing = requirements.iter().filter(|(_, met)| !met).map(|(what, _)| (*what).to_owned()).collect();
    let features = vec![
        (Feature::HalfFloats, features12.shader_float16 == vk::TRUE),
        (Feature::DoubleFloats, core.shader_float64 == vk::TRUE),
        (Feature::Storage8, features12.storage_buffer8_bit_access == vk::TRUE),
        (Feature::Storage16, features11.storage_buffer16_bit_access == vk::TRUE),
        (Feature::SubgroupSizeControl, features13.subgroup_size_control == vk::TRUE),
        (Feature::RobustBufferAccess, core.robust_buffer_access == vk::TRUE),
        (Feature::MemoryBudget, offers(ext::memory_budget::NAME)),
        (Feature::PortabilitySubset, offers(khr::portability_subset::NAME)),
        (Feature::DeviceFault, has_fault_extension && fault.device_fault == vk::TRUE),
        (Feature::PipelineStatistics, has_executables && executables.pipeline_executable_info == vk::TRUE),
        (Feature::SubgroupShuffles, subgroup.supported_operations.contains(vk::SubgroupFeatureFlags::SHUFFLE)),
        (Feature::Windows, offers(khr::swapchain::NAME) && draws),
        (Feature::AnyImageFormat, core.shader_storage_image_write_without_format == vk::TRUE),
        (Feature::ExportedMemory, offers(khr::external_memory_fd::NAME) && exports(instance, raw)),
        (Feature::SharedHostMemory, offers(ext::external_memory_host::NAME) && imports_host(instance, raw)),
    ];

    let kind = match properties.device_type {
        vk::PhysicalDeviceType::DISCRETE_GPU => DeviceKind::Discrete,
        vk::PhysicalDeviceType::INTEGRATED_GPU => DeviceKind::Integrated,
        vk::PhysicalDeviceType::VIRTUAL_GPU => DeviceKind::Virtual,
        vk::PhysicalDeviceType::CPU => DeviceKind::Cpu,
        _ => DeviceKind::Other,
    };
    let (memory_bytes, memory_free_bytes) = memory(instance, raw, offers(ext::memory_budget::NAME));
    let limits = properties.limits;
    let is_llvmpipe = driver.driver_id == vk::DriverId::MESA_LLVMPIPE;
    let text =
        |bytes: Result<&CStr, _>| bytes.map_or_else(|_| "?".to_owned(), |s: &CStr| s.to_string_lossy().into_owned());
    Ok(Capabilities {
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
        features,
        missing,
        required_subgroups: RequiredSubgroups {
            in_compute: subgroup_sizes.required_subgroup_size_stages.contains(vk::ShaderStageFlags::COMPUTE),
            per_workgroup: subgroup_sizes.max_compute_workgroup_subgroups,
            default_size: subgroup.subgroup_size,
        },
        // llvmpipe's loop limiter, LP_MAX_TGSI_LOOP_ITERATIONS; summed over all loops of an invocation.
        loop_limit: is_llvmpipe.then_some(65_535),
        has_late_timestamps: is_llvmpipe,
        pipeline_uuid: properties.pipeline_cache_uuid,
        raw,
        queue_family: family.unwrap_or(0) as u32,
    })
}

/// True if buffers can have memory that other APIs open.
fn exports(instance: &Instance, raw: vk::PhysicalDevice) -> bool {
    let features = external(instance, raw, BUFFER_USAGE, EXPORT_HANDLE);
    features.contains(vk::ExternalMemoryFeatureFlags::EXPORTABLE)
}

/// True if buffers can have memory of the host, in blocks as this program allocates them.
fn imports_host(instance: &Instance, raw: vk::PhysicalDevice) -> bool {
    let mut host = vk::PhysicalDeviceExternalMemoryHostPropertiesEXT::default();
    let mut properties = vk::PhysicalDeviceProperties2::default().push_next(&mut host);
    // SAFETY: clause 1.
    unsafe { instance.raw.get_physical_device_properties2(raw, &mut properties) };
    let features = external(instance, raw, STAGING_USAGE, HOST_HANDLE);
    host.min_imported_host_pointer_alignment <= HOST_BLOCK as u64
        && features.contains(vk::ExternalMemoryFeatureFlags::IMPORTABLE)
}

/// What can be done with the memory of buffers of this usage.
fn external(
    instance: &Instance,
    raw: vk::PhysicalDevice,
    usage: vk::BufferUsageFlags,
    handle: vk::ExternalMemoryHandleTypeFlags,
) -> vk::ExternalMemoryFeatureFlags {
    let info = vk::PhysicalDeviceExternalBufferInfo::default().usage(usage).handle_type(handle);
    let mut found = vk::ExternalBufferProperties::default();
    // SAFETY: clause 1.
    unsafe { instance.raw.get_physical_device_external_buffer_properties(raw, &info, &mut found) };
    found.external_memory_properties.external_memory_features
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
