//! The cameras of a command: all cameras of a file, a split of them, or frames along a camera path.

use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::Arc;

use anyhow::{Result, bail};
use clap::ValueEnum;
use glam::DVec3;

use super::headings::{CAMERAS, MANY};
use super::scenes::SceneArg;
use super::values::whole;
use super::{Usage, numbers, remark};
use crate::camera::{self, Camera, Lens, LensChoice, MAX_POSITION, NamedCamera, Split, Timeline, Up};
use crate::procedural::{Procedural, TownPath};
use crate::scene::{Focus, Unreadable};

/// The choice of a split.
#[derive(clap::Args)]
pub(super) struct SplitArg {
    /// Only the cameras of a split: all, train, val or test
    ///
    /// They keep their positions in the file as numbers. If the file names no split, every eighth camera in the order
    /// of names is in test (beginning with the first), and all others are in train.
    #[arg(long, help_heading = CAMERAS, value_enum, value_name = "SPLIT", default_value = "all")]
    #[arg(hide_possible_values = true)]
    split: Choice,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Choice {
    All,
    Train,
    Val,
    Test,
}

/// The cameras of a file that a split leaves.
pub(super) struct Numbered {
    /// Each with its position in the file, in the order of the file. At least one.
    pub cameras: Vec<(usize, NamedCamera)>,
    /// Number of all cameras in the file.
    pub count: usize,
}

impl SplitArg {
    /// Reads the cameras of the split. Those whose size is nowhere stated get the size `default_px`. Prints the notices
    /// of the reader to stderr.
    pub fn read(&self, file: &Path, default_px: Option<[u32; 2]>, lens: &LensArgs) -> Result<Numbered> {
        let read = camera::read_at(file, default_px).and_then(|read| lens.choice().applied(read));
        let read = read.map_err(|problem| Unreadable::new(file, &problem))?;
        for notice in &read.notices {
            remark(&format!("note: {}: {notice}", file.display()));
        }
        let count = read.cameras.len();
        let split = match self.split {
            Choice::All => return Ok(Numbered { cameras: read.cameras.into_iter().enumerate().collect(), count }),
            Choice::Train => Split::Train,
            Choice::Val => Split::Val,
            Choice::Test => Split::Test,
        };
        let cameras = read.numbered(split);
        if cameras.is_empty() {
            let (name, file) = (format!("{split:?}").to_lowercase(), file.display());
            return Err(Usage(format!("--split {name}: {file} has {count} cameras, and none is in this split")).into());
        }
        Ok(Numbered { cameras, count })
    }

    /// Fails if a split is given without a camera file.
    pub fn check_no_file(&self) -> Result<(), Usage> {
        if self.split == Choice::All {
            return Ok(());
        }
        Err(Usage("--split needs a camera file, and there is none".to_owned()))
    }
}

/// The cameras of the file on the command line, or of the one found next to the scene or in a folder above it, with a
/// note. A file that was only found and cannot be used counts as none, also with a note.
pub(super) fn named_or_found(
    named: Option<&Path>,
    scene: &SceneArg,
    split: &SplitArg,
    default_px: Option<[u32; 2]>,
    lens: &LensArgs,
) -> Result<Option<(PathBuf, Numbered)>> {
    if let Some(named) = named {
        return Ok(Some((named.to_owned(), split.read(named, default_px, lens)?)));
    }
    let Some(found) = scene.path().and_then(|path| camera::find(&path)) else { return Ok(None) };
    match split.read(&found, default_px, lens) {
        Ok(cameras) => {
            remark(&format!("note: cameras of {}", found.display()));
            Ok(Some((found, cameras)))
        }
        Err(problem) => match problem.downcast::<Unreadable>() {
            Ok(unreadable) => {
                remark(&format!("note: {}", unreadable.as_passed_over()));
                Ok(None)
            }
            Err(problem) => Err(problem),
        },
    }
}

/// The lenses of cameras.
#[derive(clap::Args, Clone, Debug, Default)]
pub(super) struct LensArgs {
    /// The lens of all cameras, like FISHEYE or FOV:0.9
    ///
    /// A model of COLMAP with the numbers that follow its focal lengths and principal point, which stay those of the
    /// camera, like OPENCV_FISHEYE:0.01,-0.002,0,0; ORTHOGRAPHIC; EQUIRECTANGULAR, which fills the picture; or PINHOLE.
    /// The default is the lens of the file. docs/cameras.md has all models.
    #[arg(long, help_heading = CAMERAS, value_name = "MODEL[:K,...]", value_parser = parse_lens)]
    #[arg(allow_hyphen_values = true)]
    lens: Option<NamedLens>,
    /// Draw cameras with lenses as pinholes of the same poses
    #[arg(long, help_heading = CAMERAS, conflicts_with = "lens")]
    undistort: bool,
}

/// A lens of the command line; none for a pinhole.
#[derive(Clone, Debug)]
struct NamedLens(Option<Arc<Lens>>);

impl LensArgs {
    /// All cameras are pinholes.
    pub fn pinholes() -> Self {
        Self { lens: None, undistort: true }
    }

    pub fn choice(&self) -> LensChoice {
        match &self.lens {
            _ if self.undistort => LensChoice::Undistorted,
            Some(NamedLens(lens)) => LensChoice::All(lens.clone()),
            None => LensChoice::Own,
        }
    }

    /// Gives a camera the lens of the command line, if there is one.
    pub fn apply(&self, camera: &mut Camera) {
        self.choice().apply(camera);
    }

    /// The camera of `--eye` with the lens of the command line and this horizontal field of view. A parallel lens sees
    /// what the pinhole sees at `distance`.
    fn seeing(&self, pinhole: Camera, fov: f64, distance: f64) -> Result<Camera, Usage> {
        let mut camera = pinhole;
        self.apply(&mut camera);
        let Some(lens) = camera.lens.clone() else {
            let why = || Usage(format!("--fov {fov}: a pinhole sees at most {WIDEST_PINHOLE} degrees: see --lens"));
            return (fov <= WIDEST_PINHOLE).then_some(camera).ok_or_else(why);
        };
        camera.seeing(fov, distance).ok_or_else(|| {
            let widest = 2.0 * lens.field().to_degrees();
            Usage(format!("--fov {fov}: the lens {} sees less than {widest:.1} degrees", lens.model()))
        })
    }
}

fn parse_lens(text: &str) -> Result<NamedLens> {
    Ok(NamedLens(Lens::parse(text)?.map(Arc::new)))
}

/// A camera by its place, instead of one of a camera file.
#[derive(clap::Args, Clone, Copy)]
pub(super) struct EyeArgs {
    /// Draw from this point, in world units, not from cameras of a file
    ///
    /// With --up, the point is one of the turned scene.
    #[arg(long, help_heading = CAMERAS, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = parse_point)]
    #[arg(conflicts_with_all = ["cameras", "split", "undistort"])]
    eye: Option<DVec3>,
    /// The point that --eye looks at [default: the middle of the scene]
    #[arg(long, help_heading = CAMERAS, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = parse_point)]
    target: Option<DVec3>,
    /// The direction that --eye sees upwards, like 0,0,1 [default: 0,-1,0]
    #[arg(long, help_heading = CAMERAS, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = parse_point)]
    camera_up: Option<DVec3>,
    /// Horizontal field of view of --eye, in degrees [default: 50]
    ///
    /// Up to 179, or what --lens sees.
    #[arg(long, help_heading = CAMERAS, value_name = "DEGREES", value_parser = parse_angle)]
    fov: Option<f64>,
}

const DEFAULT_FOV: f64 = 50.0;

/// Degrees.
const WIDEST_PINHOLE: f64 = 179.0;

/// Sine of the angle below which two directions count as parallel: the rounding of decimal coordinates.
const PARALLEL: f64 = 1e-6;

impl EyeArgs {
    /// The values of these four options.
    #[cfg(feature = "viewer")]
    pub fn of(eye: Option<DVec3>, target: Option<DVec3>, camera_up: Option<DVec3>, fov: Option<f64>) -> Self {
        Self { eye, target, camera_up, fov }
    }

    /// True if a camera is given. Fails if it has no direction.
    pub fn is_given(&self) -> Result<bool, Usage> {
        if self.eye.is_some() && self.eye == self.target {
            return Err(Usage("--eye and --target are the same point".to_owned()));
        }
        if self.camera_up == Some(DVec3::ZERO) {
            return Err(Usage("--camera-up 0,0,0 is not a direction".to_owned()));
        }
        Ok(self.eye.is_some())
    }

    /// The camera, if one is given, and the largest allowed distance of its near plane.
    ///
    /// # Errors
    /// If `--camera-up` is parallel to the view direction.
    pub fn camera(
        &self,
        focus: impl FnOnce() -> Focus,
        size_px: [u32; 2],
        lens: &LensArgs,
    ) -> Result<Option<(Camera, f32)>, Usage> {
        let Some(eye) = self.eye else { return Ok(None) };
        let target = self.target.unwrap_or_else(|| DVec3::from(focus().centre));
        let up = self.camera_up.unwrap_or_else(|| Up::default().vector());
        let across = up.normalize_or_zero().cross((target - eye).normalize_or_zero());
        if self.camera_up.is_some() && across.length() < PARALLEL {
            let why = "is parallel to the view direction, so no direction of the picture can point there";
            return Err(Usage(format!("--camera-up {},{},{} {why}", up.x, up.y, up.z)));
        }
        let fov = self.fov.unwrap_or(DEFAULT_FOV);
        let distance = eye.distance(target).max(f64::from(f32::MIN_POSITIVE));
        let pinhole = Camera::looking_upright([eye, target], up, size_px, fov.min(WIDEST_PINHOLE).to_radians());
        let camera = lens.seeing(pinhole, fov, distance)?;
        Ok(Some((camera, (distance / 100.0) as f32)))
    }
}

pub(super) fn parse_point(text: &str) -> Result<DVec3> {
    match numbers::<3>(text) {
        Ok(point) if point.iter().all(|v| v.abs() <= MAX_POSITION) => Ok(DVec3::from(point)),
        _ => bail!("expected X,Y,Z: three numbers within {MAX_POSITION:e}, like 1,-2.5,0"),
    }
}

pub(super) fn parse_angle(text: &str) -> Result<f64> {
    match text.parse() {
        Ok(degrees) if (0.01..=360.0).contains(&degrees) => Ok(degrees),
        _ => bail!("expected degrees from 0.01 to 360"),
    }
}

/// A camera path and its frame rate.
#[derive(clap::Args)]
pub(super) struct FilmArgs {
    /// Frames along a camera path, into a folder; in the town: street, roof or air
    ///
    /// The file is one of `smalto view` (docs/side-files.md), any cameras.json, or a camera_path.json of nerfstudio.
    /// The paths of the town take 20 seconds along streets, around on a roof, or over the houses.
    #[arg(long, help_heading = MANY, value_name = "PATH", conflicts_with_all = ["cameras", "camera", "split", "eye"])]
    path: Option<PathBuf>,
    /// N pictures of one turn around the scene, into a folder
    ///
    /// The horizontal field of view is 60 degrees. --up says which way is up.
    #[arg(long, help_heading = MANY, value_name = "N", value_parser = whole::<usize>(1..=MAX_FRAMES as u64))]
    #[arg(conflicts_with_all = ["path", "cameras", "camera", "split", "eye", "dump"])]
    orbit: Option<usize>,
    /// Frames per second of --path and --video, like 30000/1001 [default: 30]
    ///
    /// A camera_path.json of nerfstudio has a rate of its own, which is the default for it.
    #[arg(long, help_heading = MANY, value_name = "FPS")]
    fps: Option<Fps>,
}

/// Frames per second. The text is kept, because no float is exactly 30000/1001.
#[derive(Clone, Debug)]
pub(super) struct Fps {
    text: String,
    value: f64,
}

/// Largest number of frames along a path.
const MAX_FRAMES: usize = 100_000;

impl FilmArgs {
    /// True if the views are those of a path or an orbit.
    pub fn is_given(&self) -> bool {
        self.path.is_some() || self.orbit.is_some()
    }

    /// Number of pictures around the scene, if given.
    pub fn orbit(&self) -> Option<usize> {
        self.orbit
    }

    /// Frames per second of pictures that are not along a path.
    pub fn fps(&self) -> Fps {
        self.fps.clone().unwrap_or_default()
    }

    /// Reads the path, if one is given, and samples its frames. Those of a path of the town have this size.
    pub fn read(&self, scene: &SceneArg, size_px: [u32; 2]) -> Result<Option<(Vec<NamedCamera>, Fps)>> {
        let Some(file) = &self.path else { return Ok(None) };
        along_path(file, self.fps.as_ref(), || scene.town(), size_px).map(Some)
    }
}

/// The frames of a camera path, or of one of the `town`, and their rate: `fps`, or that of the file. Frames in the town
/// have this size.
pub(super) fn along_path(
    file: &Path,
    fps: Option<&Fps>,
    town: impl FnOnce() -> Result<Option<Procedural>>,
    size_px: [u32; 2],
) -> Result<(Vec<NamedCamera>, Fps)> {
    if let Some(path) = file.to_str().and_then(TownPath::named) {
        let fps = fps.cloned().unwrap_or_default();
        let count = (TOWN_SECONDS * fps.value).ceil() as usize;
        return Ok((town_cameras(town()?, path, size_px, count)?, fps));
    }
    if ["orbit", "orbit-zoom", "turn"].iter().any(|name| file == Path::new(name)) && !file.exists() {
        return Err(Usage("--path takes a file, street, roof or air: --orbit N draws a turn".to_owned()).into());
    }
    let (timeline, own) = Timeline::read_film(file).map_err(|problem| Unreadable::new(file, &problem))?;
    let fps = fps.cloned().or(own.map(Fps::from)).unwrap_or_default();
    let frames = timeline.frames(fps.value);
    let count = frames.len();
    if count > MAX_FRAMES {
        let seconds = timeline.duration();
        let which = format!("{seconds} s of {} at {fps} frames per second", file.display());
        return Err(Usage(format!("--path: {which} are {count} frames, over {MAX_FRAMES}")).into());
    }
    let named = |(i, camera)| NamedCamera::new(format!("frame {i}"), camera);
    Ok((frames.enumerate().map(named).collect(), fps))
}

/// Seconds of the camera paths of the town.
const TOWN_SECONDS: f64 = 20.0;

/// Cameras along a path of the town. Fails if the scene is another.
pub(super) fn town_cameras(
    scene: Option<Procedural>,
    path: TownPath,
    size_px: [u32; 2],
    count: usize,
) -> Result<Vec<NamedCamera>, Usage> {
    let views = scene.and_then(|scene| scene.views(path, count));
    let name = path.name();
    let views = views.ok_or_else(|| Usage(format!("--path {name} is a path of the town, and the scene is another")))?;
    let cameras = camera::path::looking(&views, size_px).into_iter().enumerate();
    Ok(cameras.map(|(i, camera)| NamedCamera::new(format!("{name} {i}"), camera)).collect())
}

/// The largest distance of the near plane in the town, metres.
pub(super) const TOWN_NEAR: f32 = 0.1;

impl Default for Fps {
    fn default() -> Self {
        30.0.into()
    }
}

impl From<f64> for Fps {
    fn from(value: f64) -> Self {
        Self { text: value.to_string(), value }
    }
}

impl FromStr for Fps {
    type Err = anyhow::Error;

    fn from_str(text: &str) -> Result<Self> {
        let numbers = match text.split_once('/') {
            Some((above, below)) => (above.parse::<f64>(), below.parse()),
            None => (text.parse(), Ok(1.0)),
        };
        match numbers {
            (Ok(above), Ok(below)) if above > 0.0 && below > 0.0 && above / below <= 1000.0 && below.is_finite() => {
                Ok(Self { text: text.to_owned(), value: above / below })
            }
            _ => bail!("expected frames per second, above 0 and at most 1000, like 30 or 30000/1001"),
        }
    }
}

impl fmt::Display for Fps {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&self.text)
    }
}
