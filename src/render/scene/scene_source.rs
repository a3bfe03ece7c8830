//! A scene before it is on a device: Gaussians in memory or a page file, drawn once or at many scene instances.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Result, ensure};

use super::gpu_scene::GpuScene;
use crate::formats::{Reading, in_folder};
use crate::gpu::Device;
use crate::host_memory::OutOfMemory;
use crate::options::Options;
use crate::packing::Statistics;
use crate::pagefile::{self, PageFile, Pages, is_page_file};
use crate::rules::{LISTED_ALPHA, Rules};
use crate::scene::{Focus, Gaussians, Scene, SceneInstances, Watch, remarks};

/// A scene that can be uploaded to any number of devices. A clone shares it.
#[derive(Clone)]
pub struct SceneSource {
    #[doc(hidden)]
    pub content: Content,
    /// The scene is drawn once for each of these instances. Without them, it is drawn as it is.
    pub instances: Option<SceneInstances>,
    /// True if the scene was trained with the antialiasing of Mip-Splatting, and should be drawn with it.
    pub is_antialiased: bool,
    /// Differences between the file and what is drawn, a sentence each.
    pub notices: Vec<String>,
}

/// The scene has no levels of detail, and the options ask for them.
#[derive(Debug, thiserror::Error)]
#[error(
    "there are no levels of detail here: `smalto lod` makes a file with them; `render`, `bench`, `view` and `trade` \
     draw it"
)]
pub struct NoLevels;

/// The storage of the Gaussians of a scene.
#[doc(hidden)]
#[derive(Clone)]
pub enum Content {
    Memory { gaussians: Arc<Gaussians>, statistics: Arc<Statistics> },
    File(Arc<PageFile>),
}

/// Requirements of an upload beyond the options of the renderer.
#[derive(Clone, Copy, Debug)]
pub struct Upload {
    /// The scene is drawn by [`Renderer::certified`](crate::render::Renderer::certified).
    pub is_certifiable: bool,
    /// Bytes of device memory that are left free for pictures.
    pub reserve_bytes: u64,
}

impl Default for Upload {
    /// No certificates, and memory for pictures of 1920x1080.
    fn default() -> Self {
        Self { is_certifiable: false, reserve_bytes: 256 << 20 }
    }
}

impl Upload {
    /// An upload without certificates that leaves this many bytes free for pictures.
    pub fn reserving(reserve_bytes: u64) -> Self {
        Self { is_certifiable: false, reserve_bytes }
    }

    /// The options with the alpha below which Gaussians of the scene may be culled.
    pub(crate) fn culling(&self, options: &Options) -> Options {
        let alpha_min = if self.is_certifiable { LISTED_ALPHA } else { options.rules.alpha_min };
        Options { rules: Rules { alpha_min, ..options.rules }, ..*options }
    }
}

impl SceneSource {
    /// Opens a scene file of any format, the folder of a SOG, or a model folder of the original 3DGS. A page file
    /// (.smalto) stays on the disk and is drawn page by page; any other file is read into memory.
    ///
    /// # Errors
    /// [`Unreadable`](crate::scene::Unreadable) if the file is not a scene that can be drawn, or
    /// [`OutOfMemory`](crate::host_memory::OutOfMemory).
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        Self::open_watched(path, &Reading::default(), &Watch::NONE)
    }

    /// Like [`open`](Self::open), with corrections of the file, progress and cancelling. A page file that has to be
    /// corrected is read into memory.
    ///
    /// # Errors
    /// As [`open`](Self::open); [`NoLevel`](crate::scene::NoLevel); [`Cancelled`](crate::scene::Cancelled).
    pub fn open_watched(path: impl AsRef<Path>, reading: &Reading, watch: &Watch) -> Result<Self> {
        let path = in_folder(path.as_ref());
        if *reading == Reading::default() && is_page_file(&path) {
            return Ok(Self::of_file(PageFile::open(&path)?));
        }
        let scene = pagefile::read(reading, &path, watch)?;
        Ok(Self::of_scene(scene, &path.display().to_string()))
    }

    /// A scene that was read or generated. `name` is its name in notices.
    pub fn of_scene(scene: Scene, name: &str) -> Self {
        let notices = remarks(name, &scene.report, &scene.notices);
        Self { is_antialiased: scene.is_antialiased, notices, ..Self::of(scene.gaussians) }
    }

    /// Gaussians in memory.
    pub fn of(gaussians: Gaussians) -> Self {
        let statistics = Arc::new(Statistics::of(&gaussians));
        Self::shared(Arc::new(gaussians), statistics)
    }

    /// Gaussians whose statistics are known.
    #[doc(hidden)]
    pub fn shared(gaussians: Arc<Gaussians>, statistics: Arc<Statistics>) -> Self {
        Self::with(Content::Memory { gaussians, statistics })
    }

    /// A page file.
    #[doc(hidden)]
    pub fn of_file(file: impl Into<Arc<PageFile>>) -> Self {
        let file = file.into();
        let is_antialiased = file.header().is_antialiased;
        Self { is_antialiased, ..Self::with(Content::File(file)) }
    }

    fn with(content: Content) -> Self {
        Self { content, instances: None, is_antialiased: false, notices: Vec::new() }
    }

    /// Options that suit the scene: with the antialiasing that it was trained with, and without levels of detail if it
    /// has none.
    pub fn suited(&self, options: &Options) -> Options {
        let rules = Rules { antialiased: self.is_antialiased, ..options.rules };
        let options = Options { rules, ..*options };
        match self.has_levels() {
            true => options,
            false => Options { lod_error: 0.0, lod_psnr: 0.0, splats: 0, lod_fade: 0.0, lod_occlusion: 0.0, ..options },
        }
    }

    /// The statistics of one instance of the scene.
    #[doc(hidden)]
    pub fn statistics(&self) -> &Statistics {
        match &self.content {
            Content::Memory { statistics, .. } => statistics,
            Content::File(file) => &file.header().statistics,
        }
    }

    /// Number of Gaussians in one instance of the scene.
    pub fn count(&self) -> usize {
        self.statistics().count
    }

    /// The sphere that holds most of the scene, with all its instances.
    pub fn focus(&self) -> Focus {
        let focus = match &self.content {
            Content::Memory { gaussians, .. } => Focus::of(gaussians),
            Content::File(file) => file.header().statistics.focus,
        };
        self.instances.as_ref().map_or(focus, |instances| instances.focus(focus))
    }

    /// The Gaussians of one instance, if they are in memory.
    pub fn gaussians(&self) -> Option<&Gaussians> {
        match &self.content {
            Content::Memory { gaussians, .. } => Some(gaussians),
            Content::File(_) => None,
        }
    }

    /// True if the scene has levels of detail.
    pub fn has_levels(&self) -> bool {
        matches!(&self.content, Content::File(file) if file.levels().is_some())
    }

    /// Uploads the scene to a device, as far as its free memory allows. A page file, a scene that is too large for the
    /// device, and a scene with instances are drawn in pages, which are loaded when they are needed.
    ///
    /// # Errors
    /// If there is too little memory for some pages, a page cannot be read, or the instances have too many Gaussians;
    /// [`NoLevels`].
    pub fn upload(&self, device: &Device, options: &Options) -> Result<GpuScene> {
        self.upload_with(device, options, Upload::default())
    }

    /// As [`upload`](Self::upload), with further requirements.
    ///
    /// # Errors
    /// As [`upload`](Self::upload), and if certificates are required of a scene with instances.
    pub fn upload_with(&self, device: &Device, options: &Options, upload: Upload) -> Result<GpuScene> {
        let Upload { is_certifiable, reserve_bytes } = upload;
        // A scene without Gaussians is empty everywhere.
        let instances = self.instances.as_ref().filter(|_| self.count() > 0);
        ensure!(!is_certifiable || instances.is_none(), "pictures of scenes at places have no certificates");
        ensure!(!options.wants_levels() || self.has_levels() || self.count() == 0, NoLevels);
        let options = &upload.culling(options);
        let pages = match &self.content {
            Content::Memory { gaussians, statistics } => {
                let whole = || GpuScene::with_reserve(device, gaussians, statistics, options, reserve_bytes);
                match instances.is_none().then(whole) {
                    None => {}
                    Some(Err(error)) if error.is::<OutOfMemory>() => {}
                    Some(other) => return other,
                }
                Pages::of_gaussians(gaussians.clone(), Statistics::clone(statistics), options)
            }
            Content::File(file) => Pages::of_file(file.clone(), options),
        };
        let scene = GpuScene::of_pages(device, &pages, options, reserve_bytes)?;
        match instances {
            None => Ok(scene),
            Some(instances) => scene.placed(instances),
        }
    }
}
