//! Notices of the lenses of a file's cameras: how the pictures of pinholes differ from theirs, and where lenses end.

use std::collections::BTreeSet;
use std::sync::Arc;

use anyhow::{Context, Result, ensure};
use glam::DVec2;

use super::{Camera, CameraFile, Lens, NamedCamera};

/// Statistics of the cameras of a file that have lenses.
#[derive(Default)]
struct Distortion {
    /// All cameras, and those with lenses.
    of: usize,
    cameras: usize,
    models: BTreeSet<String>,
    /// Largest shift of a corner of a pinhole.
    farthest_px: f64,
    /// Corners whose rays, as those of a pinhole, no lens sees.
    unseen_corners: usize,
    ended: Option<Ended>,
    last: Option<(Camera, Arc<Lens>, Picture)>,
}

/// Cameras whose lenses end within the picture.
struct Ended {
    cameras: usize,
    pixels: f64,
    blind_pixels: f64,
    /// Some of the lenses ends where it folds, not where its base does.
    folds: bool,
    /// Smallest and largest field of the lenses in radians.
    fields: [f64; 2],
}

/// How the picture of a lens differs from that of a pinhole.
#[derive(Clone, Copy)]
struct Picture {
    farthest_px: f64,
    unseen_corners: usize,
    /// Fraction of the pixels that see nothing.
    blind: f64,
}

/// Pixels along each side of a picture at which the part that sees nothing is sampled.
const SAMPLES: u32 = 64;

impl Camera {
    /// The pinhole of the same pose, focal lengths and principal point: the camera as if its lens did not distort.
    ///
    /// # Errors
    /// If the lens sees what no pinhole does: all around, or along parallel rays.
    pub fn undistorted(&self) -> Result<Self> {
        if let Some(lens) = &self.lens {
            let is_central = !lens.is_sphere() && !lens.is_parallel();
            ensure!(is_central, "no pinhole sees what its model {} does", lens.model());
        }
        Ok(Self { lens: None, ..self.clone() })
    }
}

impl CameraFile {
    /// The same cameras without their lenses: pinholes of the same poses. Notices say how their pictures differ.
    ///
    /// # Errors
    /// If a lens sees what no pinhole does: all around, or along parallel rays.
    pub fn into_pinholes(mut self) -> Result<Self> {
        let distortion = Distortion::of(&self.cameras);
        for NamedCamera { name, camera } in &mut self.cameras {
            *camera = camera.undistorted().with_context(|| format!("camera {name:?}"))?;
        }
        self.notices.splice(0..0, distortion.as_pinholes());
        Ok(self)
    }

    /// What a user should know of the lenses of the cameras, a sentence each.
    pub fn lens_notices(&self) -> Vec<String> {
        Distortion::of(&self.cameras).through_lenses()
    }
}

impl Distortion {
    /// Looks at the cameras of a file.
    fn of(cameras: &[NamedCamera]) -> Self {
        let mut distortion = Self { of: cameras.len(), ..Self::default() };
        cameras.iter().for_each(|named| distortion.add(&named.camera));
        distortion
    }

    fn add(&mut self, camera: &Camera) {
        let Some(lens) = &camera.lens else { return };
        self.cameras += 1;
        if !self.models.contains(lens.model()) {
            self.models.insert(lens.model().to_owned());
        }
        let picture = self.picture(camera, lens);
        self.farthest_px = self.farthest_px.max(picture.farthest_px);
        self.unseen_corners += picture.unseen_corners;
        if picture.blind > 0.0 {
            let none = Ended { cameras: 0, pixels: 0.0, blind_pixels: 0.0, folds: false, fields: [lens.field(); 2] };
            let ended = self.ended.get_or_insert(none);
            let pixels = camera.size_px.map(f64::from).iter().product::<f64>();
            ended.cameras += 1;
            ended.pixels += pixels;
            ended.blind_pixels += pixels * picture.blind;
            ended.folds |= lens.folds();
            let [low, high] = ended.fields;
            ended.fields = [low.min(lens.field()), high.max(lens.field())];
        }
    }

    /// The picture of a camera. The cameras of a file mostly share one.
    fn picture(&mut self, camera: &Camera, lens: &Arc<Lens>) -> Picture {
        let intrinsics = |camera: &Camera| (camera.focal_px, camera.centre_px, camera.size_px);
        if let Some((last, of, picture)) = &self.last
            && intrinsics(last) == intrinsics(camera)
            && of == lens
        {
            return *picture;
        }
        let picture = Picture::of(camera, lens);
        self.last = Some((camera.clone(), Arc::clone(lens), picture));
        picture
    }

    /// The notices where pictures are drawn through the lenses.
    fn through_lenses(&self) -> Vec<String> {
        let Self { of, cameras, .. } = self;
        let through = (*cameras > 0).then(|| {
            let drawn = "which are drawn along the rays of their pixels; --undistort draws pinholes";
            format!("{cameras} of {of} cameras have lenses ({}), {drawn}", self.models())
        });
        through.into_iter().chain(self.ended.as_ref().map(Ended::notice)).collect()
    }

    fn models(&self) -> String {
        self.models.iter().map(String::as_str).collect::<Vec<_>>().join(", ")
    }

    /// The notices where pictures are drawn as those of pinholes.
    fn as_pinholes(&self) -> Vec<String> {
        let Self { of, cameras, farthest_px, unseen_corners, .. } = self;
        let distorted = (*cameras > 0).then(|| {
            let models = self.models();
            let is_off = *farthest_px > 0.0 || *unseen_corners == 0;
            let off = is_off.then(|| format!("corners up to {farthest_px:.1} px off"));
            let unseen = match unseen_corners {
                0 => None,
                1 => Some("1 corner that the lens does not see".to_owned()),
                count => Some(format!("{count} corners that the lenses do not see")),
            };
            let corners = off.into_iter().chain(unseen).collect::<Vec<_>>().join(" and ");
            format!(
                "{cameras} of {of} cameras have lenses that distort ({models}), and are drawn as pinholes, with \
                 {corners}"
            )
        });
        distorted.into_iter().chain(self.ended.as_ref().map(Ended::notice)).collect()
    }
}

impl Ended {
    fn notice(&self) -> String {
        let Self { cameras, pixels, blind_pixels, folds, fields } = self;
        let cameras = if *cameras == 1 { "1 camera".to_owned() } else { format!("{cameras} cameras") };
        let verb = if *folds { "folds" } else { "ends" };
        let [low, high] = fields.map(|field| format!("{:.1}", field.to_degrees()));
        let angle = if low == high { low } else { format!("{low} to {high}") };
        let percent = 100.0 * blind_pixels / pixels;
        format!("the lens of {cameras} {verb} at {angle} degrees: {percent:.1} % of their pixels see nothing")
    }
}

impl Picture {
    fn of(camera: &Camera, lens: &Lens) -> Self {
        let size = DVec2::from(camera.size_px.map(f64::from));
        let plane = |part: DVec2| (part * size - camera.centre_px) / camera.focal_px;
        let corners = [DVec2::ZERO, DVec2::X, DVec2::Y, DVec2::ONE].map(plane);
        let shift_px = |corner: DVec2| Some(((lens.plane(corner.extend(1.0))? - corner) * camera.focal_px).length());
        let shifts = corners.map(shift_px);
        // The domain is a disc, but for little: if all corners see something, every pixel does.
        let sees = |plane: DVec2| lens.direction(plane).is_some();
        let blind = if corners.into_iter().all(sees) {
            0.0
        } else {
            let places = (0..SAMPLES * SAMPLES).map(|i| DVec2::new(f64::from(i % SAMPLES), f64::from(i / SAMPLES)));
            let blind = places.filter(|place| !sees(plane((place + 0.5) / f64::from(SAMPLES)))).count();
            blind as f64 / f64::from(SAMPLES * SAMPLES)
        };
        Self {
            farthest_px: shifts.iter().flatten().copied().fold(0.0, f64::max),
            unseen_corners: shifts.iter().filter(|shift| shift.is_none()).count(),
            blind,
        }
    }
}
