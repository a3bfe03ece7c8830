//! What is written of every picture, and where: layers, kinds of files, names.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use clap::ValueEnum;

use super::Args;
use crate::cli::Usage;
use crate::rules::Background;
use crate::pixels::{Depths, FileKind, Pixels};

/// A part of what there is to know of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, ValueEnum)]
pub(super) enum Layer {
    /// The picture
    #[value(alias = "color")]
    Colour,
    /// How much of each pixel is covered
    Alpha,
    /// Expected depth: the mean over what was blended, each splat by its share; NaN where nothing was
    Depth,
    /// Depth of the splat at which half of the light is gone (transmittance 0.5); NaN where it never is
    MedianDepth,
    /// How many splats were blended
    Counts,
}

/// How pictures in a folder are named.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Names {
    /// By the camera's position in its file: 00000, 00001 and so on
    Index,
    /// By the camera's image, without its extension
    Image,
}

/// A file to write.
pub(super) struct Output {
    pub layer: Layer,
    pub kind: FileKind,
    pub path: PathBuf,
}

/// Where files go.
pub(super) struct Outputs {
    layers: Vec<Layer>,
    /// Of what holds colours.
    kind: FileKind,
    place: Place,
}

enum Place {
    File(PathBuf),
    Folder(PathBuf),
}

impl Layer {
    pub fn name(self) -> String {
        self.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
    }

    /// Whether it is part of the picture itself; the others are drawn beside it.
    pub fn is_of_picture(self) -> bool {
        matches!(self, Self::Colour | Self::Alpha)
    }

    /// What it is written as beside pictures of this kind.
    fn kind(self, of_pictures: FileKind) -> FileKind {
        if self.is_of_picture() || of_pictures.holds_floats() { of_pictures } else { FileKind::Exr }
    }
}

impl Output {
    /// Writes a layer of the picture.
    pub fn write_picture(&self, pixels: &Pixels, background: Background) -> Result<()> {
        match self.layer {
            Layer::Alpha => pixels.alpha().write_as(self.kind, &self.path),
            _ => pixels.write_as(self.kind, &self.path, background == Background::Transparent),
        }
    }

    /// Writes a layer of what lies how deep.
    pub fn write_depths(&self, depths: &Depths) -> Result<()> {
        let plane = match self.layer {
            Layer::MedianDepth => &depths.median,
            Layer::Counts => &depths.counts,
            _ => &depths.expected,
        };
        plane.write_as(self.kind, &self.path)
    }
}

impl Outputs {
    /// What `args` ask for, of one picture or `several`.
    pub fn of(args: &Args, several: bool) -> Result<Self> {
        let mut layers = args.layers.clone();
        layers.sort_unstable();
        layers.dedup();
        let is_of_picture = layers.iter().any(|layer| layer.is_of_picture());
        let kind = args.format.unwrap_or(if is_of_picture { FileKind::Png } else { FileKind::Exr });
        let place = match place(args, several)? {
            Some(place) => place,
            None => {
                let suffix = if is_of_picture { String::new() } else { format!(".{}", layers[0].name()) };
                Place::File(PathBuf::from(format!("{}{suffix}.{}", args.scene.stem(), kind.extension())))
            }
        };
        let kind = match &place {
            Place::File(file) => kind_of_file(file, args.format)?,
            Place::Folder(_) => kind,
        };
        if !is_of_picture && !kind.holds_floats() {
            let name = layers[0].name();
            return Err(Usage(format!("--layers {name} is written as .exr or .npy: PNG cannot hold it")).into());
        }
        Ok(Self { layers, kind, place })
    }

    pub fn folder(&self) -> Option<&Path> {
        match &self.place {
            Place::File(_) => None,
            Place::Folder(folder) => Some(folder),
        }
    }

    pub fn has(&self, layer: Layer) -> bool {
        self.layers.contains(&layer)
    }

    /// The layers that are drawn beside the picture.
    pub fn depths(&self) -> impl Iterator<Item = Layer> {
        self.layers.iter().copied().filter(|layer| !layer.is_of_picture())
    }

    pub fn kind(&self) -> FileKind {
        self.kind
    }

    /// Where the files of this layer lie, if that is a folder.
    pub fn layer_folder(&self, layer: Layer) -> Option<PathBuf> {
        let folder = self.folder()?;
        Some(if self.layers.len() > 1 { folder.join(layer.name()) } else { folder.to_owned() })
    }

    /// The files of one picture; in a folder, `stem` is its name there.
    pub fn files(&self, stem: &str) -> Vec<Output> {
        let output = |layer: &Layer| {
            let kind = layer.kind(self.kind);
            let path = match (&self.place, self.layer_folder(*layer)) {
                (_, Some(folder)) => folder.join(format!("{stem}.{}", kind.extension())),
                (Place::File(file), None) if *layer == Layer::Colour || self.layers.len() == 1 => file.clone(),
                (Place::File(file) | Place::Folder(file), None) => {
                    file.with_extension(format!("{}.{}", layer.name(), kind.extension()))
                }
            };
            Output { layer: *layer, kind, path }
        };
        self.layers.iter().map(output).collect()
    }
}

/// Where files are to go; none for the one file that is named after the scene.
fn place(args: &Args, several: bool) -> Result<Option<Place>> {
    let needs_folder = several || args.names.is_some() || args.resume;
    let Some(output) = &args.output else {
        return Ok(needs_folder.then(|| Place::Folder(PathBuf::from("renders"))));
    };
    if output.is_dir() || output.as_os_str().to_string_lossy().ends_with('/') {
        return Ok(Some(Place::Folder(output.clone())));
    }
    if needs_folder && names_file(output) {
        let why = "several pictures, --names, --video and --resume take a folder";
        return Err(Usage(format!("--output {}: {why}", output.display())).into());
    }
    Ok(Some(if needs_folder { Place::Folder(output.clone()) } else { Place::File(output.clone()) }))
}

/// Whether this is the name of a picture or a film, not of a folder.
fn names_file(path: &Path) -> bool {
    let is_film = |end: &std::ffi::OsStr| ["mp4", "mkv", "mov", "webm", "avi", "gif"].iter().any(|film| end == *film);
    FileKind::of(path).is_ok() || path.extension().is_some_and(is_film)
}

/// The kind that the file's name asks for, and `--format` if it is given.
fn kind_of_file(file: &Path, format: Option<FileKind>) -> Result<FileKind> {
    let named = FileKind::of(file).map_err(|problem| Usage(format!("--output {problem}")))?;
    match format {
        Some(format) if format.extension() != named.extension() => {
            let (expected, file) = (format.extension(), file.display());
            Err(Usage(format!("--format writes .{expected}, and --output is {file}")).into())
        }
        Some(format) => Ok(format),
        None => Ok(named),
    }
}

/// Extensions of pictures: what follows another last dot is part of a name.
const EXTENSIONS: [&str; 10] = ["jpg", "jpeg", "png", "exr", "tif", "tiff", "webp", "bmp", "heic", "npy"];

/// The name of a camera's image as a path below any folder, without its extension: nothing in it leads out of there.
pub(super) fn safe_stem(image: &str) -> Result<String> {
    let is_extension = |end: &str| EXTENSIONS.iter().any(|known| end.eq_ignore_ascii_case(known));
    let stem = image.rsplit_once('.').filter(|(_, end)| is_extension(end)).map_or(image, |(stem, _)| stem);
    let mut safe = Vec::new();
    for part in stem.split(['/', '\\']) {
        match part {
            "" | "." => {}
            ".." => _ = safe.pop(),
            part => safe.push(part.replace(is_unsafe, "_")),
        }
    }
    let name = safe.join("/");
    (!name.is_empty()).then_some(name).with_context(|| format!("the image name '{image}' names no file"))
}

/// What some file systems do not take in names.
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
