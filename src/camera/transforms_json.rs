//! `transforms.json` of nerfstudio, instant-ngp and the Blender data sets: camera-to-world matrices in the axes of
//! OpenGL, with intrinsics for all frames or for each.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, anyhow, ensure};
use glam::{DMat3, DVec2, DVec3};
use image::ImageReader;
use serde_json::{Map, Value};

use super::dataparser::{self, Dataparser};
use super::{Camera, CameraFile, Lens, MAX_SIDE, NamedCamera, Split, centre};

/// Splits, their names in file names, and the member that lists their frames.
const SPLITS: [(Split, &str, &str); 3] = [
    (Split::Train, "train", "train_filenames"),
    (Split::Val, "val", "val_filenames"),
    (Split::Test, "test", "test_filenames"),
];

/// The cameras of the file at `path`, in its order. Those whose size is nowhere stated and whose focal length is an
/// angle get the size `default_px`.
pub(super) fn parse(file: &Map<String, Value>, path: &Path, default_px: Option<[u32; 2]>) -> Result<CameraFile> {
    let frames = file.get("frames").and_then(Value::as_array);
    let frames = frames.context("is neither a cameras.json nor a transforms.json: it has no array `frames`")?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let placed = Dataparser::beside(folder, file)?;
    let mut cameras: Vec<NamedCamera> = Vec::new();
    let mut is_k4_of_r8 = false;
    for (i, frame) in frames.iter().enumerate() {
        let own = frame.as_object().with_context(|| format!("frame {i} is not an object"))?;
        let frame = Frame { own, file, default_px };
        let mut named = frame.camera(i, folder, placed.as_ref()).with_context(|| format!("frame {i}"))?;
        // Most frames have the lens of the frame before.
        if let Some(last) = cameras.last().filter(|last| last.camera.lens == named.camera.lens) {
            named.camera.lens = last.camera.lens.clone();
        }
        is_k4_of_r8 |= frame.is_k4_of_r8()?;
        cameras.push(named);
    }
    let splits = splits(file, path, &cameras)?;
    let moved = placed.map(|_| format!("the transform in {} is applied to the cameras", dataparser::FILE));
    let meaning = is_k4_of_r8.then(|| "k4 is the coefficient of r^8, as in nerfstudio, no denominator".to_owned());
    let notices = meaning.into_iter().chain(moved).collect();
    Ok(CameraFile { splits, notices, cameras })
}

/// The splits of each camera: those whose lists name it, or the one in the name of a file of a Blender data set.
fn splits(file: &Map<String, Value>, path: &Path, cameras: &[NamedCamera]) -> Result<Option<Vec<Vec<Split>>>> {
    if !SPLITS.iter().any(|(_, _, list)| file.contains_key(*list)) {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let named = SPLITS.iter().find(|(_, name, _)| stem.strip_prefix("transforms_") == Some(*name));
        return Ok(named.map(|(split, _, _)| vec![vec![*split]; cameras.len()]));
    }
    let mut by_name: HashMap<&str, Vec<Split>> = HashMap::new();
    for (split, _, list) in SPLITS {
        let Some(names) = file.get(list) else { continue };
        let names = names.as_array().map(|names| names.iter().map(Value::as_str).collect::<Option<Vec<_>>>());
        for name in names.flatten().with_context(|| format!("{list} is not an array of names"))? {
            let splits = by_name.entry(plain(name)).or_default();
            if !splits.contains(&split) {
                splits.push(split);
            }
        }
    }
    let of = |camera: &NamedCamera| by_name.get(camera.name.as_str()).cloned().unwrap_or_default();
    Ok(Some(cameras.iter().map(of).collect()))
}

/// The name of a photograph without a leading `./`.
fn plain(name: &str) -> &str {
    name.strip_prefix("./").unwrap_or(name)
}

/// One frame. Members that it lacks are taken from the file.
struct Frame<'f> {
    own: &'f Map<String, Value>,
    file: &'f Map<String, Value>,
    default_px: Option<[u32; 2]>,
}

impl Frame<'_> {
    fn camera(&self, index: usize, folder: &Path, placed: Option<&Dataparser>) -> Result<NamedCamera> {
        let name = self.own.get("file_path").and_then(Value::as_str);
        let size_px = self.size_px(name.map(|name| folder.join(name)).as_deref())?;
        let (position, rotation) = self.pose()?;
        let (position, rotation) = placed.map_or((position, rotation), |placed| placed.moved(position, rotation));
        let (lens, middle) = (self.lens()?, centre(size_px));
        let [focal_px, centre_px] = if lens.as_ref().is_some_and(Lens::is_sphere) {
            Lens::sphere_px(DVec2::from(size_px.map(f64::from)))
        } else {
            let [x, y] = [self.number("cx")?, self.number("cy")?];
            [self.focal_px(size_px)?, DVec2::new(x.unwrap_or(middle.x), y.unwrap_or(middle.y))]
        };
        let camera = Camera { position, rotation, focal_px, centre_px, size_px, lens: lens.map(Arc::new) }.checked()?;
        let name = name.map_or_else(|| index.to_string(), |name| plain(name).to_owned());
        Ok(NamedCamera::new(name, camera))
    }

    /// A number of the frame, or else of the file. Null counts as missing.
    fn number(&self, name: &str) -> Result<Option<f64>> {
        [self.own, self.file].into_iter().find_map(|of| number(of, name).transpose()).transpose()
    }

    /// The position of the camera, and its rotation from the world to right, down and forward.
    fn pose(&self) -> Result<(DVec3, DMat3)> {
        let matrix = self.own.get("transform_matrix").context("it has no transform_matrix")?;
        let rows = rows(matrix).context("its transform_matrix is not 3 or 4 rows of 4 numbers")?;
        let is_affine = rows.get(3).is_none_or(|last| *last == [0.0, 0.0, 0.0, 1.0]);
        ensure!(is_affine, "the last row of its transform_matrix is not 0, 0, 0, 1");
        let column = |i: usize| DVec3::new(rows[0][i], rows[1][i], rows[2][i]);
        // The axes of OpenGL are right, up and back.
        let rotation = DMat3::from_cols(column(0), -column(1), -column(2)).transpose();
        Ok((column(3), rotation))
    }

    /// The size in the file, or else that of the photograph: Blender data sets do not state it.
    fn size_px(&self, photograph: Option<&Path>) -> Result<[u32; 2]> {
        let is_by_angle = || Ok::<_, anyhow::Error>(self.number("fl_x")?.or(self.number("fl_y")?).is_none());
        match (self.stated_size_px(photograph), self.default_px) {
            (Err(_), Some(size_px)) if is_by_angle()? => Ok(size_px),
            (stated, _) => stated,
        }
    }

    fn stated_size_px(&self, photograph: Option<&Path>) -> Result<[u32; 2]> {
        if let (Some(width), Some(height)) = (self.number("w")?, self.number("h")?) {
            let is_side = |side: f64| side.fract() == 0.0 && (1.0..=f64::from(MAX_SIDE)).contains(&side);
            let is_size = is_side(width) && is_side(height);
            ensure!(is_size, "its size {width:?}x{height:?} is not of whole numbers from 1 to {MAX_SIDE}");
            return Ok([width as u32, height as u32]);
        }
        let photograph =
            photograph.context("it has no size (w and h), and no file_path of a photograph that has one")?;
        let file = with_ending(photograph).with_context(|| {
            format!("it has no size (w and h), and its photograph {} is not there", photograph.display())
        })?;
        let size = ImageReader::open(&file).map_err(anyhow::Error::from).and_then(|r| Ok(r.into_dimensions()?));
        let unread = |e| anyhow!("it has no size (w and h), and its photograph {} has none: {e}", file.display());
        let (width, height) = size.map_err(unread)?;
        Ok([width, height])
    }

    /// Focal lengths in pixels. Members of the frame take precedence over those of the file, focal lengths over angles
    /// of view. A missing vertical focal length equals the horizontal one.
    fn focal_px(&self, size_px: [u32; 2]) -> Result<DVec2> {
        let axis = |side: u32, focal: &str, angle: &str| {
            for of in [self.own, self.file] {
                if let Some(focal_px) = number(of, focal)? {
                    return Ok(Some(focal_px));
                }
                if let Some(angle) = number(of, angle)? {
                    return Ok(Some(f64::from(side) / 2.0 / (angle / 2.0).tan()));
                }
            }
            Ok::<_, anyhow::Error>(None)
        };
        let x = axis(size_px[0], "fl_x", "camera_angle_x")?;
        let y = axis(size_px[1], "fl_y", "camera_angle_y")?;
        let x = x.or(y).context("it has no focal length: neither fl_x nor camera_angle_x")?;
        Ok(DVec2::new(x, y.unwrap_or(x)))
    }

    /// The lens; none for a pinhole. The members are those of OpenCV; frames of nerfstudio and instant-ngp have some.
    fn lens(&self) -> Result<Option<Lens>> {
        let model = match self.kind() {
            Kind::Named(model) => model,
            Kind::Fisheye if self.has_any(&["p1", "p2"])? => "THIN_PRISM_FISHEYE",
            Kind::Fisheye => "OPENCV_FISHEYE",
            Kind::Perspective if self.has_any(&OPENCV_ONLY)? => "OPENCV_THIN_PRISM",
            Kind::Perspective if self.has_any(&["k3", "k4"])? => "PERSPECTIVE",
            Kind::Perspective => "OPENCV",
        };
        let supported = Lens::parameter_names(model).filter(|_| SUPPORTED.contains(&model));
        let names = supported.with_context(|| {
            format!("its camera model {} is not supported, only pinholes and those of OpenCV", model.escape_debug())
        })?;
        let numbers: Result<Vec<f64>> = names.iter().map(|name| Ok(self.number(name)?.unwrap_or(0.0))).collect();
        Lens::named(model, &numbers?)
    }

    fn kind(&self) -> Kind<'_> {
        let member = |name| [self.own, self.file].into_iter().find_map(|of| of.get(name).filter(|v| !v.is_null()));
        let is_set = |name| member(name).and_then(Value::as_bool).unwrap_or(false);
        match member("camera_model").and_then(Value::as_str).unwrap_or("OPENCV") {
            _ if is_set("equirectangular") => Kind::Named("EQUIRECTANGULAR"),
            _ if is_set("latlong") => Kind::Named("latlong"),
            _ if is_set("orthographic") => Kind::Named("orthographic"),
            "OPENCV_FISHEYE" => Kind::Fisheye,
            _ if is_set("is_fisheye") => Kind::Fisheye,
            "SIMPLE_PINHOLE" | "PINHOLE" | "PERSPECTIVE" | "SIMPLE_RADIAL" | "RADIAL" | "OPENCV" => Kind::Perspective,
            model => Kind::Named(model),
        }
    }

    /// True if some of the members is there and not 0.
    fn has_any(&self, names: &[&str]) -> Result<bool> {
        let values: Result<Vec<_>> = names.iter().map(|name| self.number(name)).collect();
        Ok(values?.iter().flatten().any(|value| *value != 0.0))
    }

    /// True if k4 is read as the coefficient of r^8, where OpenCV's k4 would be one of the denominator.
    fn is_k4_of_r8(&self) -> Result<bool> {
        let is_perspective = matches!(self.kind(), Kind::Perspective);
        Ok(is_perspective && self.has_any(&["k4"])? && !self.has_any(&OPENCV_ONLY)?)
    }
}

/// What the members of a frame are about.
#[derive(Clone, Copy)]
enum Kind<'f> {
    Perspective,
    Fisheye,
    /// The model of this name.
    Named(&'f str),
}

/// Members of OpenCV's perspective cameras that nerfstudio lacks. With one of them, k4 to k6 are of the denominator.
const OPENCV_ONLY: [&str; 6] = ["k5", "k6", "s1", "s2", "s3", "s4"];

/// Models whose parameters are members of frames.
const SUPPORTED: [&str; 11] = [
    "OPENCV",
    "PERSPECTIVE",
    "OPENCV_THIN_PRISM",
    "FULL_OPENCV",
    "OPENCV_FISHEYE",
    "THIN_PRISM_FISHEYE",
    "SIMPLE_FISHEYE",
    "FISHEYE",
    "SIMPLE_RADIAL_FISHEYE",
    "RADIAL_FISHEYE",
    "EQUIRECTANGULAR",
];

fn number(of: &Map<String, Value>, name: &str) -> Result<Option<f64>> {
    let value = of.get(name).filter(|value| !value.is_null());
    value.map(|value| value.as_f64().with_context(|| format!("its {name} is not a number"))).transpose()
}

fn rows(matrix: &Value) -> Option<Vec<[f64; 4]>> {
    let row = |row: &Value| row.as_array()?.iter().map(Value::as_f64).collect::<Option<Vec<_>>>()?.try_into().ok();
    let rows: Vec<[f64; 4]> = matrix.as_array()?.iter().map(row).collect::<Option<_>>()?;
    [3, 4].contains(&rows.len()).then_some(rows)
}

/// The existing file of a photograph whose name may lack its extension.
fn with_ending(photograph: &Path) -> Option<PathBuf> {
    let ended = |ending: &str| {
        let mut name = photograph.as_os_str().to_owned();
        name.push(ending);
        PathBuf::from(name)
    };
    ["", ".png", ".jpg"].map(ended).into_iter().find(|file| file.is_file())
}
