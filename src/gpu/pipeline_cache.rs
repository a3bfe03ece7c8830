//! The pipeline cache of a device: compiled pipelines, and the self-tests that it passed, kept between runs.

use std::collections::BTreeSet;
use std::sync::{Mutex, MutexGuard};

use ash::vk;

/// The fingerprint of a check.
pub type Check = [u8; 32];

/// Compiled pipelines in the format of the driver, and the checks that the device passed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CachedPipelines {
    pub pipelines: Vec<u8>,
    pub passed: BTreeSet<Check>,
}

impl CachedPipelines {
    /// The bytes of a file: a hash of the rest, the number of checks, the checks, the pipelines.
    pub fn to_bytes(&self) -> Vec<u8> {
        let count = (self.passed.len() as u32).to_le_bytes();
        let checks = self.passed.iter().flatten().copied();
        let content: Vec<u8> = count.into_iter().chain(checks).chain(self.pipelines.iter().copied()).collect();
        [blake3::hash(&content).as_bytes().as_slice(), &content].concat()
    }

    /// The content of a file; `None` if it is damaged.
    pub fn of_bytes(bytes: &[u8]) -> Option<Self> {
        let (hash, content) = bytes.split_first_chunk::<32>()?;
        let (count, rest) = content.split_first_chunk::<4>().filter(|_| blake3::hash(content) == *hash)?;
        let (checks, pipelines) = rest.split_at_checked(32 * u32::from_le_bytes(*count) as usize)?;
        Some(Self { pipelines: pipelines.to_owned(), passed: checks.as_chunks().0.iter().copied().collect() })
    }
}

/// The pipeline cache of an open device.
pub(crate) struct PipelineCache {
    pub cache: vk::PipelineCache,
    earlier: CachedPipelines,
    passed: Mutex<BTreeSet<Check>>,
    keep: Box<dyn Fn(&CachedPipelines) + Send + Sync>,
}

impl PipelineCache {
    /// A pipeline cache with the state of an earlier run. `None` if the driver cannot make it.
    pub fn new(
        raw: &ash::Device,
        earlier: CachedPipelines,
        keep: impl Fn(&CachedPipelines) + Send + Sync + 'static,
    ) -> Option<Self> {
        let info = vk::PipelineCacheCreateInfo::default().initial_data(&earlier.pipelines);
        // SAFETY: clauses 1 and 5, the device owns this cache. The driver refuses data of other drivers and devices.
        let cache = unsafe { raw.create_pipeline_cache(&info, None) }.ok()?;
        let passed = Mutex::new(earlier.passed.clone());
        Some(Self { cache, earlier, passed, keep: Box::new(keep) })
    }

    /// The checks that the device passed.
    pub fn passed(&self) -> MutexGuard<'_, BTreeSet<Check>> {
        self.passed.lock().expect("no holder of the passed checks panics")
    }

    /// Passes a changed state to `keep`, and frees the cache.
    pub fn close(self, raw: &ash::Device) {
        // SAFETY: clauses 1 and 3, the device is being dropped: nothing else uses the cache.
        let pipelines = unsafe { raw.get_pipeline_cache_data(self.cache) };
        let now = pipelines.map(|pipelines| CachedPipelines { pipelines, passed: self.passed().clone() });
        // SAFETY: as above.
        unsafe { raw.destroy_pipeline_cache(self.cache, None) };
        if let Some(now) = now.ok().filter(|now| *now != self.earlier) {
            (self.keep)(&now);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::gpu::{Device, DeviceChoice, Validation};

    #[test]
    fn a_changed_state_is_kept_when_the_device_is_closed() {
        let kept = Arc::new(Mutex::new(Vec::new()));
        let open = |earlier: CachedPipelines| {
            let kept = kept.clone();
            let device = Device::open(&DeviceChoice::Best, Validation::IfInstalled).unwrap();
            device.with_pipeline_cache(earlier, move |now| kept.lock().unwrap().push(now.clone()))
        };
        let device = open(CachedPipelines { pipelines: b"of another driver".to_vec(), passed: [[1; 32]].into() });
        device.remember_passed([2; 32]);
        assert!(device.has_passed(&[1; 32]) && device.has_passed(&[2; 32]) && !device.has_passed(&[3; 32]));
        drop(device);
        let first = kept.lock().unwrap().pop().expect("the state has changed");
        assert_eq!(first.passed, [[1; 32], [2; 32]].into());
        drop(open(first));
        assert!(kept.lock().unwrap().is_empty(), "the state is the same");
    }

    #[test]
    fn a_cache_is_read_as_it_was_written_and_damage_is_found() {
        let cached = CachedPipelines { pipelines: vec![1, 2, 3], passed: [[7; 32], [9; 32]].into() };
        let bytes = cached.to_bytes();
        assert_eq!(CachedPipelines::of_bytes(&bytes), Some(cached));
        assert_eq!(CachedPipelines::of_bytes(&CachedPipelines::default().to_bytes()), Some(CachedPipelines::default()));
        for at in 0..bytes.len() {
            let mut damaged = bytes.clone();
            damaged[at] ^= 1;
            assert_eq!(CachedPipelines::of_bytes(&damaged), None, "byte {at} is changed");
            assert_eq!(CachedPipelines::of_bytes(&bytes[..at]), None, "the file ends at byte {at}");
        }
    }
}
