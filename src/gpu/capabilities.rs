//! The properties of a Vulkan device and what it can do.

use std::fmt;

use ash::vk;
use schemars::JsonSchema;
use serde::{Serialize, Serializer};

/// How memory is handed over to other APIs.
pub(super) const EXPORT_HANDLE: vk::ExternalMemoryHandleTypeFlags = vk::ExternalMemoryHandleTypeFlags::OPAQUE_FD;

/// How host memory is handed over to devices.
pub(super) const HOST_HANDLE: vk::ExternalMemoryHandleTypeFlags =
    vk::ExternalMemoryHandleTypeFlags::HOST_ALLOCATION_EXT;

/// The uses of every buffer that shaders bind.
pub(super) const BUFFER_USAGE: vk::BufferUsageFlags = vk::BufferUsageFlags::from_raw(
    vk::BufferUsageFlags::STORAGE_BUFFER.as_raw()
        | vk::BufferUsageFlags::INDIRECT_BUFFER.as_raw()
        | vk::BufferUsageFlags::TRANSFER_SRC.as_raw()
        | vk::BufferUsageFlags::TRANSFER_DST.as_raw(),
);

/// The uses of every buffer in host memory.
pub(super) const STAGING_USAGE: vk::BufferUsageFlags = vk::BufferUsageFlags::from_raw(
    vk::BufferUsageFlags::TRANSFER_SRC.as_raw() | vk::BufferUsageFlags::TRANSFER_DST.as_raw(),
);

/// Host memory for devices is allocated in blocks of this many bytes, whose addresses are multiples of their size.
pub(super) const HOST_BLOCK: usize = 0x10000;

/// The properties, limits and features of one physical device.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct Capabilities {
    pub name: String,
    pub kind: DeviceKind,
    pub driver: String,
    pub vulkan: String,
    /// Distinguishes several devices of the same model. The driver's own tools print it too.
    pub uuid: String,
    /// Invocations in a subgroup: smallest and largest.
    pub subgroup_size: [u32; 2],
    /// Device-local memory in bytes: the total, and the free part if the driver reports it.
    pub memory_bytes: u64,
    pub memory_free_bytes: Option<u64>,
    pub limits: Limits,
    /// Every optional feature, and whether the device has it.
    #[serde(rename = "optional")]
    #[schemars(with = "Vec<(String, bool)>")]
    pub features: Vec<(Feature, bool)>,
    /// Requirements of smalto that this device does not meet; empty if it can be used.
    pub missing: Vec<String>,
    /// Loop iterations that an invocation may run before the driver ends it silently.
    pub loop_limit: Option<u32>,
    /// The subgroup sizes that a compute stage can be asked for.
    #[serde(skip)]
    pub(super) required_subgroups: RequiredSubgroups,
    /// Once triangles have been drawn, the driver takes a timestamp only when the next one is written.
    #[serde(skip)]
    pub(super) has_late_timestamps: bool,
    /// Changes with every version of the driver that compiles pipelines otherwise.
    #[serde(skip)]
    pub pipeline_uuid: [u8; 16],
    #[serde(skip)]
    pub(super) raw: vk::PhysicalDevice,
    #[serde(skip)]
    pub(super) queue_family: u32,
}

/// The limits that bound a scene or an image.
#[derive(Clone, Copy, Debug, Serialize, JsonSchema)]
pub struct Limits {
    /// Largest storage buffer range, in bytes.
    pub storage_range: u64,
    /// Largest buffer and largest allocation, in bytes.
    pub buffer: u64,
    pub allocation: u64,
    /// Largest width and height of an image.
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

/// The kind of a device. [`DeviceChoice::Best`](super::DeviceChoice::Best) takes the first of this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum DeviceKind {
    Discrete,
    Integrated,
    Virtual,
    #[serde(rename = "CPU")]
    Cpu,
    Other,
}

impl fmt::Display for DeviceKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Discrete => "discrete",
            Self::Integrated => "integrated",
            Self::Virtual => "virtual",
            Self::Cpu => "CPU",
            Self::Other => "other",
        })
    }
}

/// A feature that is used if the device has it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Feature {
    /// Arithmetic with 16-bit floats in shaders.
    HalfFloats,
    /// Arithmetic with 64-bit floats in shaders.
    DoubleFloats,
    Storage8,
    Storage16,
    /// A stage can ask for one subgroup size.
    SubgroupSizeControl,
    RobustBufferAccess,
    MemoryBudget,
    PortabilitySubset,
    /// The driver describes what lost the device.
    DeviceFault,
    /// The driver reports registers and binary sizes of compiled shaders.
    PipelineStatistics,
    SubgroupShuffles,
    /// Swapchains, and drawing into their images.
    Windows,
    /// Image stores without a format in the shader.
    AnyImageFormat,
    /// Memory that other APIs open.
    ExportedMemory,
    /// Host memory that other devices use, too.
    SharedHostMemory,
}

impl fmt::Display for Feature {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::HalfFloats => "f16 arithmetic",
            Self::DoubleFloats => "f64 arithmetic",
            Self::Storage8 => "8-bit storage",
            Self::Storage16 => "16-bit storage",
            Self::SubgroupSizeControl => "subgroup size control",
            Self::RobustBufferAccess => "robust buffer access",
            Self::MemoryBudget => "memory budget",
            Self::PortabilitySubset => "portability subset",
            Self::DeviceFault => "device fault",
            Self::PipelineStatistics => "pipeline statistics",
            Self::SubgroupShuffles => "subgroup shuffles",
            Self::Windows => "windows",
            Self::AnyImageFormat => "image stores of any format",
            Self::ExportedMemory => "exported memory",
            Self::SharedHostMemory => "shared host memory",
        })
    }
}

impl Serialize for Feature {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// The limits of a required subgroup size (VkPhysicalDeviceSubgroupSizeControlProperties).
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct RequiredSubgroups {
    /// Compute stages can require a size.
    pub in_compute: bool,
    /// Most subgroups of a workgroup whose stage requires a size.
    pub per_workgroup: u32,
    /// The size that a stage without a requirement usually gets.
    pub default_size: u32,
}

/// Storage buffers that a stage may bind. Every device must allow this many.
pub(super) const MAX_STORAGE_BUFFERS: u32 = 25;

/// Subgroup sizes for which the stages of the fast path are written, and their largest workgroup.
const FAST_SUBGROUPS: std::ops::RangeInclusive<u32> = 8..=64;
const FAST_WORKGROUP: u32 = 1024;
/// The subgroup size that the fast path is tuned for.
const TUNED_SUBGROUP: u32 = 32;

impl Capabilities {
    pub fn has(&self, feature: Feature) -> bool {
        self.features.contains(&(feature, true))
    }

    /// The subgroup size that the stages of the fast path are built for; `None` if the device cannot run them. On a
    /// device that reports a range of sizes it is one that [`Stage::of_subgroups`](super::Stage::of_subgroups) can
    /// require.
    pub fn fast_subgroup(&self) -> Option<u32> {
        if !self.has(Feature::SubgroupShuffles) || self.limits.workgroup_invocations < FAST_WORKGROUP {
            return None;
        }
        let [smallest, largest] = self.subgroup_size;
        let single = Some(smallest).filter(|_| smallest == largest);
        let requirable = |size: &u32| self.can_require_subgroup(*size, FAST_WORKGROUP);
        let chosen = single
            .or_else(|| Some(TUNED_SUBGROUP).filter(requirable))
            .or_else(|| Some(self.required_subgroups.default_size).filter(requirable));
        chosen.filter(|size| FAST_SUBGROUPS.contains(size))
    }

    /// True if a compute stage with workgroups of this many invocations can require subgroups of `size`.
    pub(super) fn can_require_subgroup(&self, size: u32, workgroup: u32) -> bool {
        let [smallest, largest] = self.subgroup_size;
        self.has(Feature::SubgroupSizeControl)
            && self.required_subgroups.in_compute
            && size.is_power_of_two()
            && (smallest..=largest).contains(&size)
            && workgroup.div_ceil(size) <= self.required_subgroups.per_workgroup
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A device with these subgroup sizes: smallest, largest, and that of a stage without a requirement.
    fn device(smallest: u32, largest: u32, default_size: u32, features: &[Feature]) -> Capabilities {
        Capabilities {
            name: "made up".to_owned(),
            kind: DeviceKind::Integrated,
            driver: String::new(),
            vulkan: String::new(),
            uuid: String::new(),
            subgroup_size: [smallest, largest],
            memory_bytes: 0,
            memory_free_bytes: None,
            limits: Limits {
                storage_range: 0,
                buffer: 0,
                allocation: 0,
                image: 0,
                storage_buffers: 0,
                workgroup_memory: 0,
                workgroup_invocations: 1024,
                push_constants: 0,
                timestamp_ns: 0.0,
                timestamp_bits: 0,
            },
            features: features.iter().map(|feature| (*feature, true)).collect(),
            missing: Vec::new(),
            loop_limit: None,
            required_subgroups: RequiredSubgroups { in_compute: true, per_workgroup: 64, default_size },
            has_late_timestamps: false,
            pipeline_uuid: [0; 16],
            raw: vk::PhysicalDevice::null(),
            queue_family: 0,
        }
    }

    const BOTH: [Feature; 2] = [Feature::SubgroupShuffles, Feature::SubgroupSizeControl];

    #[test]
    fn a_single_subgroup_size_is_taken_as_it_is() {
        let shuffles = [Feature::SubgroupShuffles];
        assert_eq!(device(32, 32, 32, &shuffles).fast_subgroup(), Some(32)); // NVIDIA
        assert_eq!(device(8, 8, 8, &shuffles).fast_subgroup(), Some(8)); // lavapipe
        assert_eq!(device(64, 64, 64, &BOTH).fast_subgroup(), Some(64)); // AMD before RDNA
        assert_eq!(device(4, 4, 4, &BOTH).fast_subgroup(), None);
        assert_eq!(device(128, 128, 128, &BOTH).fast_subgroup(), None);
    }

    #[test]
    fn a_range_of_subgroup_sizes_is_narrowed_to_32_where_that_can_be_required() {
        assert_eq!(device(32, 64, 64, &BOTH).fast_subgroup(), Some(32)); // AMD RDNA
        assert_eq!(device(8, 32, 32, &BOTH).fast_subgroup(), Some(32)); // Intel
        assert_eq!(device(8, 16, 16, &BOTH).fast_subgroup(), Some(16)); // 32 is outside the range
        assert_eq!(device(64, 128, 64, &BOTH).fast_subgroup(), Some(64));
        assert_eq!(device(64, 128, 128, &BOTH).fast_subgroup(), None);
    }

    #[test]
    fn a_range_of_subgroup_sizes_without_size_control_has_no_fast_path() {
        assert_eq!(device(8, 32, 32, &[Feature::SubgroupShuffles]).fast_subgroup(), None);
        let mut not_in_compute = device(8, 32, 32, &BOTH);
        not_in_compute.required_subgroups.in_compute = false;
        assert_eq!(not_in_compute.fast_subgroup(), None);
        let mut few_subgroups = device(8, 32, 16, &BOTH);
        few_subgroups.required_subgroups.per_workgroup = 16;
        assert_eq!(few_subgroups.fast_subgroup(), None);
    }

    #[test]
    fn the_fast_path_needs_shuffles_and_workgroups_of_1024() {
        assert_eq!(device(32, 32, 32, &[Feature::SubgroupSizeControl]).fast_subgroup(), None);
        let mut small = device(32, 32, 32, &BOTH);
        small.limits.workgroup_invocations = 512;
        assert_eq!(small.fast_subgroup(), None);
    }
}
