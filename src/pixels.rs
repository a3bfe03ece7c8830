//! An image in memory, and PNG files that appear whole or not at all.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use anyhow::{Context, Result, ensure};
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use tempfile::NamedTempFile;

/// Row by row from the top left, four floats a pixel: colour over the background as displayed (no transfer function
/// is applied, as in the original 3DGS), and coverage 1 - T. Over nothing, colour is premultiplied by coverage.
#[derive(Clone, Debug, PartialEq)]
pub struct Pixels {
    /// Width and height.
    pub size: [u32; 2],
    pub rgba: Vec<[f32; 4]>,
}

impl Pixels {
    /// Pixel (x, y).
    pub fn at(&self, x: u32, y: u32) -> [f32; 4] {
        self.rgba[y as usize * self.size[0] as usize + x as usize]
    }

    /// Red, green, blue in 8 bits, rounded to the nearest step.
    pub fn to_rgb8(&self) -> Vec<u8> {
        self.rgba.iter().flat_map(|p| [byte(p[0]), byte(p[1]), byte(p[2])]).collect()
    }

    /// Red, green, blue and alpha in 8 bits, alpha not multiplied in, as PNG wants it.
    pub fn to_rgba8(&self) -> Vec<u8> {
        let straight = |p: &[f32; 4]| {
            let [r, g, b, a] = *p;
            let scale = if a > 0.0 { 1.0 / a } else { 0.0 };
            [byte(r * scale), byte(g * scale), byte(b * scale), byte(a)]
        };
        self.rgba.iter().flat_map(straight).collect()
    }

    /// Writes an 8-bit PNG, with an alpha channel if `transparent`.
    pub fn write_png(&self, path: &Path, transparent: bool) -> Result<()> {
        let (bytes, kind) = if transparent {
            (self.to_rgba8(), ExtendedColorType::Rgba8)
        } else {
            (self.to_rgb8(), ExtendedColorType::Rgb8)
        };
        write_whole(path, |file| {
            let [width, height] = self.size;
            Ok(PngEncoder::new(file).write_image(&bytes, width, height, kind)?)
        })
    }
}

fn byte(value: f32) -> u8 {
    // The cast saturates, and turns NaN into 0.
    (value.clamp(0.0, 1.0) * 255.0).round() as u8
}

/// Writes a file under a temporary name beside `path` and renames it when it is complete.
pub fn write_whole(path: &Path, write: impl FnOnce(&mut BufWriter<&File>) -> Result<()>) -> Result<()> {
    let target = || format!("cannot write {}", path.display());
    let file = unfinished(path)?;
    let mut writer = BufWriter::new(file.as_file());
    write(&mut writer).and_then(|()| Ok(writer.flush()?)).with_context(target)?;
    drop(writer);
    file.persist(path).map_err(|e| e.error).with_context(target)?;
    Ok(())
}

/// Fails if [`write_whole`] would: for what takes long to make.
pub fn check_writable(path: &Path) -> Result<()> {
    ensure!(!path.is_dir(), "cannot write {}: it is a folder", path.display());
    unfinished(path).map(drop)
}

/// A file beside `path` that goes when it is dropped.
fn unfinished(path: &Path) -> Result<NamedTempFile> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut builder = tempfile::Builder::new();
    builder.prefix(".smalto-").suffix(".part");
    #[cfg(unix)]
    {
        // Temporary files are private by default; a result has the permissions of any other new file.
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    builder.tempfile_in(folder).with_context(|| format!("cannot write {}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_round_to_the_nearest_step_and_clamp() {
        let pixels = Pixels { size: [2, 1], rgba: vec![[0.5, -1.0, 2.0, 1.0], [f32::NAN, 0.0019, 0.0020, 1.0]] };
        assert_eq!(pixels.to_rgb8(), [128, 0, 255, 0, 0, 1]);
    }

    #[test]
    fn pixels_without_background_are_written_with_straight_alpha() {
        let pixels = Pixels { size: [2, 1], rgba: vec![[0.25, 0.5, 0.0, 0.5], [0.0; 4]] };
        assert_eq!(pixels.to_rgba8(), [128, 255, 0, 128, 0, 0, 0, 0]);
    }

    #[test]
    fn a_failed_write_leaves_the_old_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        std::fs::write(&path, "old").unwrap();
        let result = write_whole(&path, |file| {
            file.write_all(b"half")?;
            anyhow::bail!("no")
        });
        assert!(result.is_err());
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
