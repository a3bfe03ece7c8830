//! The settings of a window.

use std::path::PathBuf;

use anyhow::Result;
use winit::dpi::{LogicalSize, PhysicalSize, Size};
use winit::monitor::MonitorHandle;
use winit::window::{Fullscreen, Window, WindowAttributes};

use super::fault::Fault;
use crate::gpu::{Device, DeviceChoice, Validation};
use crate::viewer::model::{RecentState, Setup};

/// Name of the program and of its entry in the menus of desktops.
const NAME: &str = "smalto";

/// Default width and height of a window in points, and in pixels without a window.
pub const DEFAULT_SIZE: [u32; 2] = [1280, 720];

/// The settings with which a window is opened.
#[derive(Clone)]
pub struct WindowSetup {
    pub viewer: Setup,
    /// In pixels; `None` for that of the last window, or else [`DEFAULT_SIZE`].
    pub size: Option<[u32; 2]>,
    pub is_full_screen: bool,
    pub device: DeviceChoice,
    pub validation: Validation,
    /// Limit of device memory in bytes.
    pub memory: Option<u64>,
    /// Folder of shaders to compile at run time.
    pub shaders: Option<PathBuf>,
    /// Gives an opened device the pipeline cache of earlier runs.
    pub with_pipeline_cache: fn(Device) -> Device,
    /// Path of a socket on which a program controls the window.
    pub control: Option<PathBuf>,
    /// A fault to inject, for tests.
    pub fault: Option<Fault>,
}

impl WindowSetup {
    pub(crate) fn open_device(&self, window: &Window) -> Result<Device> {
        let device = Device::open_for(&self.device, self.validation, window)?;
        let device = device.with_shaders(self.shaders.as_deref())?.with_memory_limit(self.memory)?;
        Ok((self.with_pipeline_cache)(device))
    }

    /// The attributes of the window. Without a size, it has that of the last window or the default, if it fits on the
    /// monitor, where one is known.
    pub(crate) fn attributes(&self, monitor: Option<&MonitorHandle>) -> WindowAttributes {
        let default = LogicalSize::<u32>::from(DEFAULT_SIZE);
        let last = self.viewer.recent_file.as_deref().and_then(|file| RecentState::read(file).size);
        let last = last.filter(|size| size.iter().all(|side| *side > 0));
        let size = match (self.size, last, monitor) {
            (Some(size), ..) | (None, Some(size), None) => Size::from(PhysicalSize::<u32>::from(size)),
            (None, None, None) => default.into(),
            (None, last, Some(monitor)) => {
                let wanted = last.map_or_else(|| default.to_physical(monitor.scale_factor()), PhysicalSize::from);
                fitting(wanted, monitor.size()).into()
            }
        };
        let attributes = Window::default_attributes()
            .with_title(NAME)
            .with_inner_size(size)
            .with_fullscreen(self.is_full_screen.then_some(Fullscreen::Borderless(None)));
        // Wayland desktops find the entry of the window, with its icon, by this name.
        #[cfg(all(unix, not(target_vendor = "apple")))]
        let attributes = winit::platform::wayland::WindowAttributesExtWayland::with_name(attributes, NAME, NAME);
        attributes
    }
}

/// The size of a window that is no larger than a monitor, which may have no size.
fn fitting(size: PhysicalSize<u32>, monitor: PhysicalSize<u32>) -> PhysicalSize<u32> {
    let side = |own: u32, whole: u32| if whole > 0 { own.min(whole) } else { own };
    PhysicalSize::new(side(size.width, monitor.width), side(size.height, monitor.height))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_window_is_no_larger_than_its_monitor() {
        let fits = |size: [u32; 2], monitor: [u32; 2]| <[u32; 2]>::from(fitting(size.into(), monitor.into()));
        assert_eq!(fits([1280, 720], [1920, 1080]), [1280, 720]);
        assert_eq!(fits([2560, 1440], [1920, 1080]), [1920, 1080]);
        assert_eq!(fits([1280, 720], [0, 0]), [1280, 720]);
    }
}
