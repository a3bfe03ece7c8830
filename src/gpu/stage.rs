//! A compute pipeline, built from one shader and one set of specialization constants.

use std::marker::PhantomData;
use std::sync::{Arc, MutexGuard};

use anyhow::{Context, Result, ensure};
use ash::vk;

use super::capabilities::MAX_STORAGE_BUFFERS;
use super::device::{Device, Shared};
use super::error::describe;
use super::pipeline_statistics::Executables;
use super::pipelines::{Key, Pipelines};
use super::shader::{Binding, BindingKind, Constants, Shader};

/// The pipeline of shader `S`. It holds no resources.
pub struct Stage<S> {
    pub(super) pipeline: Arc<Pipeline>,
    _shader: PhantomData<fn() -> S>,
}

pub(super) struct Pipeline {
    pub raw: vk::Pipeline,
    pub layout: vk::PipelineLayout,
    set_layout: vk::DescriptorSetLayout,
    pub(super) device: Arc<Shared>,
}

impl<S: Shader> Stage<S> {
    /// Builds the pipeline. The subgroup size is the driver's choice and may differ between workgroups.
    ///
    /// # Errors
    /// The shader needs more than the device's limits allow, or the driver refuses it.
    pub fn new(device: &Device, constants: &S::Constants) -> Result<Self> {
        Self::build(device, constants, None)
    }

    /// Builds the pipeline for subgroups of `size` invocations, such as
    /// [`Capabilities::fast_subgroup`](super::Capabilities::fast_subgroup). A device with one subgroup size gets the
    /// same pipeline as from [`Stage::new`]; one that reports a range is asked for `size`.
    ///
    /// # Errors
    /// As for [`Stage::new`], and if the device cannot run the stage with subgroups of this size.
    pub fn of_subgroups(device: &Device, constants: &S::Constants, size: u32) -> Result<Self> {
        Self::build(device, constants, Some(size))
    }

    /// A fingerprint of the stage that [`Stage::of_subgroups`] would build, without building it.
    ///
    /// # Errors
    /// The shader cannot be compiled at run time.
    pub fn fingerprint(device: &Device, constants: &S::Constants, size: u32) -> Result<blake3::Hash> {
        let mut hasher = blake3::Hasher::new();
        hasher.update(bytemuck::cast_slice(&words::<S>(&device.0)?));
        constants.entries().iter().for_each(|(id, bits)| _ = hasher.update(bytemuck::cast_slice(&[*id, *bits])));
        Ok(hasher.update(&size.to_le_bytes()).finalize())
    }

    fn build(device: &Device, constants: &S::Constants, subgroup: Option<u32>) -> Result<Self> {
        let pipeline =
            Pipeline::shared::<S>(&device.0, constants, subgroup).with_context(|| format!("stage {}", S::NAME))?;
        Ok(Self { pipeline, _shader: PhantomData })
    }
}

impl Device {
    /// Keeps every pipeline from now on, and with it the device, until the process ends: for programs that build the
    /// same stages again and again.
    pub fn keep_pipelines(&self) {
        self.0.pipelines().keep();
    }
}

impl Shared {
    fn pipelines(&self) -> MutexGuard<'_, Pipelines> {
        self.pipelines.lock().expect("no holder of the pipelines panics")
    }
}

impl Pipeline {
    /// Returns an equal pipeline that is in use, or builds one.
    fn shared<S: Shader>(device: &Arc<Shared>, constants: &S::Constants, subgroup: Option<u32>) -> Result<Arc<Self>> {
        // Statistics are collected when a pipeline is created.
        if device.executables.as_ref().is_some_and(|executables| !executables.flags().is_empty()) {
            return Ok(Arc::new(Self::new::<S>(device, constants, subgroup, &words::<S>(device)?)?));
        }
        let key = Key { words: words::<S>(device)?, constants: constants.entries(), subgroup };
        let found = device.pipelines().find(&key);
        if let Some(pipeline) = found {
            return Ok(pipeline);
        }
        let pipeline = Arc::new(Self::new::<S>(device, constants, subgroup, &key.words)?);
        device.pipelines().insert(key, &pipeline);
        Ok(pipeline)
    }

    fn new<S: Shader>(
        device: &Arc<Shared>,
        constants: &S::Constants,
        subgroup: Option<u32>,
        words: &[u32],
    ) -> Result<Self> {
        let limits = &device.capabilities.limits;
        let push_bytes = size_of::<S::Push>() as u32;
        ensure!(
            push_bytes <= limits.push_constants,
            "{push_bytes} bytes of push constants, the device takes {}",
            limits.push_constants
        );
        let buffers: u32 = S::BINDINGS.iter().filter(|b| b.kind == BindingKind::Buffer).map(|b| b.count).sum();
        ensure!(buffers <= MAX_STORAGE_BUFFERS, "{buffers} storage buffers, {MAX_STORAGE_BUFFERS} at most");
        let required = required_subgroup::<S>(device, subgroup)?;

        let null = (vk::Pipeline::null(), vk::PipelineLayout::null(), vk::DescriptorSetLayout::null());
        let mut made = Self { raw: null.0, layout: null.1, set_layout: null.2, device: device.clone() };
        let slots: Vec<_> = S::BINDINGS.iter().map(set_layout_binding).collect();
        let info = vk::DescriptorSetLayoutCreateInfo::default()
            .flags(vk::DescriptorSetLayoutCreateFlags::PUSH_DESCRIPTOR_KHR)
            .bindings(&slots);
        // SAFETY: clauses 1 and 4, here and below; `made` owns each handle and frees it on every path.
        made.set_layout = unsafe { device.raw.create_descriptor_set_layout(&info, None) }
            .map_err(|e| describe("vkCreateDescriptorSetLayout", e))?;
        let range = [vk::PushConstantRange { stage_flags: vk::ShaderStageFlags::COMPUTE, offset: 0, size: push_bytes }];
        let ranges = if push_bytes == 0 { &range[..0] } else { &range[..] };
        let info = vk::PipelineLayoutCreateInfo::default()
            .set_layouts(std::slice::from_ref(&made.set_layout))
            .push_constant_ranges(ranges);
        // SAFETY: as above.
        made.layout = unsafe { device.raw.create_pipeline_layout(&info, None) }
            .map_err(|e| describe("vkCreatePipelineLayout", e))?;

        let (entries, bits): (Vec<_>, Vec<u32>) = (constants.entries().into_iter().enumerate())
            .map(|(i, (id, bits))| {
                (vk::SpecializationMapEntry { constant_id: id, offset: 4 * i as u32, size: 4 }, bits)
            })
            .unzip();
        let specialization = vk::SpecializationInfo::default().map_entries(&entries).data(bytemuck::cast_slice(&bits));
        let info = vk::ShaderModuleCreateInfo::default().code(words);
        // SAFETY: clause 5.
        let module =
            unsafe { device.raw.create_shader_module(&info, None) }.map_err(|e| describe("vkCreateShaderModule", e))?;
        let mut size = vk::PipelineShaderStageRequiredSubgroupSizeCreateInfo::default()
            .required_subgroup_size(required.unwrap_or_default());
        let mut stage = vk::PipelineShaderStageCreateInfo::default()
            .flags(vk::PipelineShaderStageCreateFlags::REQUIRE_FULL_SUBGROUPS)
            .stage(vk::ShaderStageFlags::COMPUTE)
            .module(module)
            .name(c"main")
            .specialization_info(&specialization);
        if required.is_some() {
            stage = stage.push_next(&mut size);
        }
        let flags = device.executables.as_ref().map_or(vk::PipelineCreateFlags::empty(), Executables::flags);
        let info = vk::ComputePipelineCreateInfo::default().flags(flags).stage(stage).layout(made.layout);
        let cache = device.pipeline_cache.as_ref().map_or(vk::PipelineCache::null(), |cached| cached.cache);
        // SAFETY: clauses 4 and 5; the module is not needed after the pipeline is made.
        let pipelines = unsafe {
            let pipelines = device.raw.create_compute_pipelines(cache, &[info], None);
            device.raw.destroy_shader_module(module, None);
            pipelines
        };
        made.raw = pipelines.map_err(|(_, e)| describe("vkCreateComputePipelines", e))?[0];
        if let Some(executables) = &device.executables {
            executables.note(made.raw, S::NAME)?;
        }
        device.name(made.raw, S::NAME);
        device.name(made.layout, S::NAME);
        Ok(made)
    }
}

/// The shader's module: compiled from the device's folder of shaders if it has one, else the one that is built in.
fn words<S: Shader>(device: &Shared) -> Result<Vec<u32>> {
    match &device.shaders {
        Some(folder) => folder.compile(S::PATH, S::INTERFACE),
        None => Ok(ash::util::read_spv(&mut std::io::Cursor::new(S::SPIRV))?),
    }
}

/// The subgroup size that the pipeline must be asked for: none if the device has only the one that the stage wants.
fn required_subgroup<S: Shader>(device: &Shared, wanted: Option<u32>) -> Result<Option<u32>> {
    let Some(wanted) = wanted else { return Ok(None) };
    let capabilities = &device.capabilities;
    if capabilities.subgroup_size == [wanted; 2] {
        return Ok(None);
    }
    let workgroup = S::WORKGROUP.iter().product();
    ensure!(
        capabilities.can_require_subgroup(wanted, workgroup),
        "{} cannot run workgroups of {workgroup} invocations in subgroups of {wanted}",
        capabilities.name
    );
    Ok(Some(wanted))
}

fn set_layout_binding(binding: &Binding) -> vk::DescriptorSetLayoutBinding<'static> {
    vk::DescriptorSetLayoutBinding::default()
        .binding(binding.number)
        .descriptor_type(binding.kind.descriptor_type())
        .descriptor_count(binding.count)
        .stage_flags(vk::ShaderStageFlags::COMPUTE)
}

impl BindingKind {
    pub(super) fn descriptor_type(self) -> vk::DescriptorType {
        match self {
            Self::Buffer => vk::DescriptorType::STORAGE_BUFFER,
            Self::Image => vk::DescriptorType::STORAGE_IMAGE,
        }
    }
}

impl Drop for Pipeline {
    fn drop(&mut self) {
        // SAFETY: clause 2, commands hold an Arc of this until they are done; null handles may be destroyed.
        unsafe {
            self.device.raw.destroy_pipeline(self.raw, None);
            self.device.raw.destroy_pipeline_layout(self.layout, None);
            self.device.raw.destroy_descriptor_set_layout(self.set_layout, None);
        }
    }
}
