//! The groups of options in help texts, by task.

pub(super) const SCENE: &str = "Scene";
pub(super) const OUTPUT: &str = "Output";
pub(super) const CAMERAS: &str = "Cameras";
pub(super) const MANY: &str = "Many pictures";
pub(super) const LEVELS: &str = "Levels of detail";
pub(super) const ACCURACY: &str = "Accuracy";
pub(super) const MEASURING: &str = "Measuring";
pub(super) const DEVICE: &str = "Device";
pub(super) const REPORTS: &str = "Reports";
