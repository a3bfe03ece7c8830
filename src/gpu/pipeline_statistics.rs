//! The driver's statistics of compiled pipelines, such as registers and binary sizes.

use std::ffi::{CStr, c_char};
use std::sync::Mutex;

use anyhow::Result;
use ash::{khr, vk};

use super::error::describe;

/// The driver's statistics of one compiled shader: names and values.
#[derive(Clone, Debug)]
pub struct Executable {
    /// The name of the stage.
    pub stage: &'static str,
    pub statistics: Vec<(String, String)>,
}

/// Collects statistics of pipelines once that is switched on; asking for them may bypass the driver's cache.
pub(crate) struct Executables {
    functions: khr::pipeline_executable_properties::Device,
    found: Mutex<Option<Vec<Executable>>>,
}

impl Executables {
    pub fn new(functions: khr::pipeline_executable_properties::Device) -> Self {
        Self { functions, found: Mutex::new(None) }
    }

    pub fn record(&self) {
        *self.found() = Some(Vec::new());
    }

    pub fn take(&self) -> Vec<Executable> {
        let mut found = self.found().take().unwrap_or_default();
        // Several threads build stages.
        found.sort_by(|a, b| (a.stage, &a.statistics).cmp(&(b.stage, &b.statistics)));
        found
    }

    /// The flags for creating a pipeline.
    pub fn flags(&self) -> vk::PipelineCreateFlags {
        match *self.found() {
            Some(_) => vk::PipelineCreateFlags::CAPTURE_STATISTICS_KHR,
            None => vk::PipelineCreateFlags::empty(),
        }
    }

    /// Stores the statistics of a pipeline that was created with [`Executables::flags`].
    pub fn note(&self, pipeline: vk::Pipeline, stage: &'static str) -> Result<()> {
        let Some(found) = &mut *self.found() else { return Ok(()) };
        let info = vk::PipelineInfoKHR::default().pipeline(pipeline);
        // SAFETY: clauses 1 and 4, here and below; the pipeline was created with the flag for statistics.
        let count = unsafe { self.functions.get_pipeline_executable_properties(&info) };
        let count = count.map_err(|e| describe("vkGetPipelineExecutablePropertiesKHR", e))?.len() as u32;
        for index in 0..count {
            let info = vk::PipelineExecutableInfoKHR::default().pipeline(pipeline).executable_index(index);
            // SAFETY: as above.
            let statistics = unsafe { self.functions.get_pipeline_executable_statistics(&info) };
            let statistics = statistics.map_err(|e| describe("vkGetPipelineExecutableStatisticsKHR", e))?;
            let statistics = statistics.iter().map(|s| (text(&s.name), value(s))).collect();
            found.push(Executable { stage, statistics });
        }
        Ok(())
    }

    fn found(&self) -> std::sync::MutexGuard<'_, Option<Vec<Executable>>> {
        self.found.lock().expect("no holder of the executables panics")
    }
}

fn text(characters: &[c_char]) -> String {
    let bytes: Vec<u8> = characters.iter().map(|c| c.cast_unsigned()).collect();
    CStr::from_bytes_until_nul(&bytes).map_or_else(|_| String::new(), |text| text.to_string_lossy().into_owned())
}

fn value(statistic: &vk::PipelineExecutableStatisticKHR) -> String {
    // SAFETY: clause 4, the format says which of the fields is set.
    unsafe {
        match statistic.format {
            vk::PipelineExecutableStatisticFormatKHR::BOOL32 => (statistic.value.b32 != 0).to_string(),
            vk::PipelineExecutableStatisticFormatKHR::INT64 => statistic.value.i64.to_string(),
            vk::PipelineExecutableStatisticFormatKHR::FLOAT64 => statistic.value.f64.to_string(),
            _ => statistic.value.u64.to_string(),
        }
    }
}
