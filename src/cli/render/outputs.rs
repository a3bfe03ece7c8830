//! The files that are written for a picture: layers, kinds and names.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use clap::ValueEnum;

use super::Args;
use crate::camera::Camera;
use crate::cli::Usage;
use crate::pixels::{Alpha, Depths, FileKind, Integers, Pixels};
use crate::rules::Background;

/// One picture.
pub(super) struct Shot {
    /// Position of the camera in its file.
    pub index: usize,
    /// Name of the camera in its file; `None` if it is not from a file.
    pub name: Option<String>,
    pub camera: Camera,
    pub outputs: Vec<Output>,
    pub certificate: Option<PathBuf>,
}

/// A layer of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, ValueEnum)]
pub(super) enum Layer {
    /// Colours of the picture
    #[value(alias = "color")]
    Colour,
    /// Coverage of each pixel, 0 to 1
    Alpha,
    /// Expected depth: mean of the blended splats, weighted by their contributions; NaN if there are none
    Depth,
    /// Depth of the splat at which the transmittance falls to 0.5; NaN if it never does
    MedianDepth,
    /// Number of blended splats
    Counts,
}

/// The naming of pictures in a folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Names {
    /// Position of the camera in its file: 00000, 00001 and so on
    Index,
    /// Image of the camera, without its extension
    Image,
}

/// A file to write.
pub(super) struct Output {
    pub layer: Layer,
    pub kind: FileKind,
    pub path: PathBuf,
}

/// The destination of all files of a run.
pub(super) struct Outputs {
    layers: Vec<Layer>,
    /// The kind of files with colours or alpha.
    kind: FileKind,
    target: Target,
}

enum Target {
    File(PathBuf),
    Folder(PathBuf),
}

impl Layer {
    pub fn name(self) -> String {
        self.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
    }

    /// True for layers of the picture itself. The others need a pass of their own.
    pub fn is_of_picture(self) -> bool {
        matches!(self, Self::Colour | Self::Alpha)
    }

    /// The kind of its files if pictures are of the kind `of_pictures`.
    fn kind(self, of_pictures: FileKind) -> FileKind {
        if self.is_of_picture() || of_pictures.holds_floats() { of_pictures } else { FileKind::Exr }
    }
}

impl Output {
    /// The integers that the file holds, if the GPU rounds to them just as the host does. Straight alpha takes a
    /// division, which GPUs round in their own ways.
    pub fn integers(&self, background: Background) -> Option<Integers> {
        match (self.layer, self.kind) {
            (Layer::Alpha, FileKind::Png) => Some(Integers::Grey8),
            (Layer::Alpha, FileKind::Png16) => Some(Integers::Grey16),
            (Layer::Colour, FileKind::Png) if background != Background::Transparent => Some(Integers::Rgb8),
            (Layer::Colour, FileKind::Png16) if background != Background::Transparent => Some(Integers::Rgb16),
            _ => None,
        }
    }

    /// The path relative to the folder of the run.
    pub fn within(&self, folder: &Path) -> &Path {
        self.path.strip_prefix(folder).unwrap_or(&self.path)
    }

    /// Writes a layer of the picture.
    pub fn write_picture(&self, pixels: &Pixels, args: &Args) -> Result<()> {
        let alpha = Alpha::of(args.background == Background::Transparent);
        match self.layer {
            Layer::Alpha => pixels.alpha().write_as(self.kind, args.compression, &self.path),
            _ => pixels.write_as(self.kind, args.compression, &self.path, alpha),
        }
    }

    /// Writes a layer of depths or counts.
    pub fn write_depths(&self, depths: &Depths, args: &Args) -> Result<()> {
        let plane = match self.layer {
            Layer::MedianDepth => &depths.median,
            Layer::Counts => &depths.counts,
            _ => &depths.expected,
        };
        plane.write_as(self.kind, args.compression, &self.path)
    }
}

impl Outputs {
    /// The outputs that `args` ask for, for one picture or `several`.
    pub fn of(args: &Args, several: bool) -> Result<Self> {
        let mut layers = args.layers.clone();
        layers.sort_unstable();
        layers.dedup();
        let is_of_picture = layers.iter().any(|layer| layer.is_of_picture());
        let kind = args.format.unwrap_or(if is_of_picture { FileKind::Png } else { FileKind::Exr });
        let target = match target(args, several)? {
            Some(target) => target,
            None => {
                let suffix = if is_of_picture { String::new() } else { format!(".{}", layers[0].name()) };
                Target::File(PathBuf::from(format!("{}{suffix}.{}", args.scene.stem(), kind.extension())))
            }
        };
        let kind = match &target {
            Target::File(file) => kind_of_file(file, args.format)?,
            Target::Folder(_) => kind,
        };
        if let Target::File(file) = &target
            && layers.len() > 1
            && file.extension().is_none()
        {
            let why = "several layers need a folder, or a file with an ending";
            return Err(Usage(format!("--output {}: {why}", file.display())).into());
        }
        if !is_of_picture && !kind.holds_floats() {
            let name = layers[0].name();
            return Err(Usage(format!("--layers {name} needs .exr or .npy: PNG cannot hold floats")).into());
        }
        Ok(Self { layers, kind, target })
    }

    /// No pictures: the frames of a video are not written to files.
    pub fn none() -> Self {
        Self { layers: Vec::new(), kind: FileKind::Png, target: Target::File(PathBuf::new()) }
    }

    pub fn folder(&self) -> Option<&Path> {
        match &self.target {
            Target::File(_) => None,
            Target::Folder(folder) => Some(folder),
        }
    }

    pub fn has(&self, layer: Layer) -> bool {
        self.layers.contains(&layer)
    }

    pub fn layers(&self) -> impl Iterator<Item = Layer> {
        self.layers.iter().copied()
    }

    /// The layers of depths and counts.
    pub fn depths(&self) -> impl Iterator<Item = Layer> {
        self.layers().filter(|layer| !layer.is_of_picture())
    }

    pub fn kind(&self) -> FileKind {
        self.kind
    }

    /// The folder for the files of this layer, if the output is a folder.
    pub fn layer_folder(&self, layer: Layer) -> Option<PathBuf> {
        let folder = self.folder()?;
        Some(if self.layers.len() > 1 { folder.join(layer.name()) } else { folder.to_owned() })
    }

    /// The files of one picture. In a folder, `stem` is its name without the extension.
    pub fn files(&self, stem: &str) -> Vec<Output> {
        let output = |layer: &Layer| {
            let kind = layer.kind(self.kind);
            let path = match (&self.target, self.layer_folder(*layer)) {
                (_, Some(folder)) => folder.join(format!("{stem}.{}", kind.extension())),
                (Target::File(file), None) if *layer == Layer::Colour || self.layers.len() == 1 => file.clone(),
                (Target::File(file) | Target::Folder(file), None) => {
                    file.with_extension(format!("{}.{}", layer.name(), kind.extension()))
                }
            };
            Output { layer: *layer, kind, path }
        };
        self.layers.iter().map(output).collect()
    }
}

/// The folder of pictures in place of a video.
pub(super) fn frames_of(video: &Path) -> PathBuf {
    video.with_extension("")
}

/// The target of the output; `None` for a single file that is named after the scene.
fn target(args: &Args, several: bool) -> Result<Option<Target>> {
    let needs_folder = several || args.names.is_some() || args.resume || args.shard.is_some() || args.verify;
    let Some(output) = &args.output else {
        let folder = match &args.video {
            Some(Some(file)) => frames_of(file),
            _ => PathBuf::from("renders"),
        };
        return Ok(needs_folder.then_some(Target::Folder(folder)));
    };
    if output.is_dir() || output.as_os_str().to_string_lossy().ends_with('/') {
        return Ok(Some(Target::Folder(output.clone())));
    }
    if needs_folder && names_file(output) {
        let why = "several pictures, --names, --video, --resume, --shard and --verify need a folder";
        return Err(Usage(format!("--output {}: {why}", output.display())).into());
    }
    Ok(Some(if needs_folder { Target::Folder(output.clone()) } else { Target::File(output.clone()) }))
}

/// True if the name is that of a picture, a video or standard output, not of a folder.
fn names_file(path: &Path) -> bool {
    let is_video =
        |end: &std::ffi::OsStr| ["mp4", "mkv", "mov", "webm", "avi", "gif"].iter().any(|video| end == *video);
    path == Path::new("-") || FileKind::of(path).is_ok() || path.extension().is_some_and(is_video)
}

/// The kind of `file` by `--format` or by its name. Fails if the two disagree. Names without an ending, such as that of
/// standard output, say nothing.
fn kind_of_file(file: &Path, format: Option<FileKind>) -> Result<FileKind> {
    if file.extension().is_none() {
        let why = "its name does not say which kind of file it is: add --format";
        return format.ok_or_else(|| Usage(format!("--output {}: {why}", file.display())).into());
    }
    let named = FileKind::of(file).map_err(|problem| Usage(format!("--output {problem}")))?;
    match format {
        Some(format) if format.extension() != named.extension() => {
            let (expected, file) = (format.extension(), file.display());
            Err(Usage(format!("--format needs a file that ends in .{expected}, but --output is {file}")).into())
        }
        Some(format) => Ok(format),
        None => Ok(named),
    }
}

/// Extensions of pictures. Any other text after the last dot is part of the name.
const EXTENSIONS: [&str; 10] = ["jpg", "jpeg", "png", "exr", "tif", "tiff", "webp", "bmp", "heic", "npy"];

/// The name of an image without the ending of a picture.
pub(super) fn without_ending(image: &str) -> &str {
    let is_extension = |end: &str| EXTENSIONS.iter().any(|known| end.eq_ignore_ascii_case(known));
    image.rsplit_once('.').filter(|(_, end)| is_extension(end)).map_or(image, |(stem, _)| stem)
}

/// Turns the name of an image into a relative path without extension that stays below the folder it is joined to.
pub(super) fn safe_stem(image: &str) -> Result<String> {
    let mut safe = Vec::new();
    for part in without_ending(image).split(['/', '\\']) {
        match part {
            "" | "." => {}
            ".." => _ = safe.pop(),
            part => safe.push(part.replace(is_unsafe, "_")),
        }
    }
    let name = safe.join("/");
    (!name.is_empty()).then_some(name).with_context(|| format!("the image name '{image}' is not a file name"))
}

/// True for characters that some file systems do not allow in names.
fn is_unsafe(c: char) -> bool {
    c.is_control() || "<>:\"|?*".contains(c)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_images_become_paths_that_lead_nowhere_else() {
        let safe = |image: &str| safe_stem(image).ok();
        assert_eq!(safe("DSC07956.JPG").as_deref(), Some("DSC07956"));
        assert_eq!(safe("cam 1/00.05.jpeg").as_deref(), Some("cam 1/00.05"));
        assert_eq!(safe("frame.0001").as_deref(), Some("frame.0001"));
        assert_eq!(safe("../../etc/passwd").as_deref(), Some("etc/passwd"));
        assert_eq!(safe("a/../../b/c").as_deref(), Some("b/c"));
        assert_eq!(safe("/data//a/./b.png").as_deref(), Some("data/a/b"));
        assert_eq!(safe("C:\\scans\\a?\n.tif").as_deref(), Some("C_/scans/a__"));
        assert_eq!(["", "..", "/", ".png", "../.jpg"].map(safe), [const { None }; 5]);
    }
}
