//! Settings of training beside a scene, which change its picture: `cfg_args` of the original's kind, `cfg.yml` of
//! gsplat's example trainer, `config.yml` of nerfstudio.

use std::path::{Path, PathBuf};

use super::input::Input;
use super::ply::{background_notice, kernel_notice};
use crate::scene::{Scene, Watch};

/// Names of the files.
const ORIGINAL: &str = "cfg_args";
const GSPLAT: &str = "cfg.yml";
const NERFSTUDIO: &str = "config.yml";
/// Largest file of settings that is read.
const MAX_BYTES: u64 = 1 << 20;

/// The scene with what the settings beside its file ask for, and notes on what the picture lacks. A file of settings
/// that cannot be read is ignored: the user did not name it.
pub(crate) fn with_settings(mut scene: Scene, path: &Path) -> Scene {
    let Some((name, text)) = settings(path) else { return scene };
    let has = |of: &str, key: &str, value: &str| name == of && setting(&text, key) == Some(value);
    if has(ORIGINAL, "white_background", "True") || has(NERFSTUDIO, "background_color", "white") {
        scene.notices.push(format!("by {name}, {}", background_notice("white")));
    }
    let kernel = setting(&text, "kernel_size").filter(|_| name == ORIGINAL).and_then(|size| size.parse::<f64>().ok());
    let kernel = kernel.filter(|px2| *px2 > 0.0);
    scene.notices.extend(kernel.and_then(kernel_notice).map(|notice| format!("by {name}, {notice}")));
    // The kernel of Mip-Splatting always compensates opacities.
    let is_antialiased =
        kernel.is_some() || has(GSPLAT, "antialiased", "true") || has(NERFSTUDIO, "rasterize_mode", "antialiased");
    if is_antialiased && !scene.is_antialiased {
        scene.is_antialiased = true;
        scene.notices.push(format!("by {name}, it was trained with antialiasing, and is drawn with it"));
    }
    scene
}

/// The name and the text of the settings of a scene.
fn settings(scene: &Path) -> Option<(&'static str, String)> {
    let folder = scene.parent()?;
    let is_named =
        |folder: &Path, begin: &str| folder.file_name().is_some_and(|name| name.to_string_lossy().starts_with(begin));
    // MODEL/point_cloud/iteration_N/point_cloud.ply, RESULT/ply/point_cloud_N.ply, or in the same folder.
    let above = folder.parent();
    let model = above.filter(|above| is_named(folder, "iteration_") && is_named(above, "point_cloud"));
    let candidates: [Option<(&'static str, PathBuf)>; 3] = [
        model.and_then(Path::parent).map(|model| (ORIGINAL, model.join(ORIGINAL))),
        above.filter(|_| is_named(folder, "ply")).map(|result| (GSPLAT, result.join(GSPLAT))),
        Some((NERFSTUDIO, folder.join(NERFSTUDIO))),
    ];
    candidates.into_iter().flatten().find_map(|(name, path)| {
        let bytes = Input::open(&path, &Watch::NONE).ok()?.rest(MAX_BYTES, name).ok()?;
        Some((name, String::from_utf8_lossy(&bytes).into_owned()))
    })
}

/// The value of `key=value` in a printed Python namespace, or of `key: value` in YAML.
fn setting<'t>(text: &'t str, key: &str) -> Option<&'t str> {
    text.match_indices(key).find_map(|(at, _)| {
        let is_word = |c: char| c.is_alphanumeric() || c == '_';
        let value = text[at + key.len()..].trim_start_matches(' ').strip_prefix(['=', ':'])?;
        let value = value.split([',', ')', '\n']).next()?.trim().trim_matches(['\'', '"']);
        (!text[..at].ends_with(is_word)).then_some(value)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_are_found_in_namespaces_and_yaml() {
        let namespace = "Namespace(data_device='cuda', kernel_size=0.1, model_path='a', white_background=True)";
        assert_eq!(setting(namespace, "white_background"), Some("True"));
        assert_eq!(setting(namespace, "kernel_size"), Some("0.1"));
        assert_eq!(setting(namespace, "background"), None);
        let yaml = "antialiased: true\nmodel:\n  rasterize_mode: antialiased\n  background_color: \"white\"\n";
        assert_eq!(setting(yaml, "antialiased"), Some("true"));
        assert_eq!(setting(yaml, "rasterize_mode"), Some("antialiased"));
        assert_eq!(setting(yaml, "background_color"), Some("white"));
    }
}
