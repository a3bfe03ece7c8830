//! Actions that make the second picture of a comparison.

use std::path::{Path, PathBuf};

use glam::DVec2;

use crate::pixels::Pixels;
use crate::render::Quantity;
use crate::rules::Background;
use crate::viewer::frame::{Side, needs_whole};
use crate::viewer::jobs::{JobEvent, Reporter};
use crate::viewer::model::{
    CompareTarget, Comparison, Depicted, Drag, Request, Tab, Viewer, WindowRequest, camera_of, fitted, fitted_range,
    part,
};

/// Most marks: three lie in a plane.
const MARKS: usize = 3;

/// Longest side of a photograph that is shown small, in pixels.
const THUMBNAIL_PX: u32 = 440;

impl Viewer {
    /// True if somebody asks for the values of pixels.
    pub fn wants_still(&self) -> bool {
        let inside = self.kept.tab == Tab::Inside && !self.panels.are_hidden;
        self.comparison.target != CompareTarget::Nothing || self.inspection.quantity() != Quantity::Colour || inside
    }

    /// True while the view moves by itself or by the user.
    pub fn moves(&self) -> bool {
        self.is_flying || self.navigator.is_gliding() || self.film.is_playing || self.drag.is_some_and(Drag::moves_view)
    }

    /// Compares the two pictures that were read back, on another thread, if they were not compared yet.
    pub fn compare_stills(&mut self) {
        let comparison = &mut self.comparison;
        let area = comparison.area;
        let Some(still) = &self.still else { return };
        let is_known =
            comparison.apart.as_ref().is_some_and(|apart| (apart.number, apart.area) == (still.number, area));
        if comparison.is_measuring || is_known || comparison.target == CompareTarget::Nothing {
            return;
        }
        if let Some(work) = still.apart(area) {
            comparison.is_measuring = true;
            self.jobs.start(move |_| Ok(work()), JobEvent::Compared);
        }
    }

    /// Fits the ends of the scale to the values of the first picture.
    pub fn fit_range(&mut self) {
        let quantity = self.inspection.quantity();
        match self.still.as_ref().and_then(|still| fitted_range(&still.first, quantity)) {
            Some(range) => self.inspection.ranges[self.inspection.mode] = range,
            None => self.messages.note("there are no values to fit the scale to yet"),
        }
    }

    /// Marks the point that a pixel shows, copies its place, and says how far it is from the mark before; `depth` is
    /// its view z in world units.
    pub fn mark(&mut self, pixel: [u32; 2], depth: Option<f32>) {
        let Some(depth) = depth else { return self.messages.note("there is nothing at this pixel") };
        let point = self.view().unprojected(DVec2::from(pixel.map(f64::from)) + 0.5, f64::from(depth));
        if self.marks.len() == MARKS {
            self.marks.remove(0);
        }
        self.marks.push(point);
        let place = format!("{:.6}, {:.6}, {:.6}", point.x, point.y, point.z);
        let distance = match self.marks[..] {
            [.., before, now] => format!("; {:.6} world units from the mark before", before.distance(now)),
            _ => String::new(),
        };
        self.messages.note(format!("marked and copied: {place}{distance}"));
        self.requests.push(Request::Window(WindowRequest::Copy(place)));
    }

    /// Reads a picture to compare with, on another thread. If it is the photograph of a camera by its name, goes there.
    pub fn compare_with_picture(&mut self, path: &Path) {
        let camera = camera_of(path, &self.cameras);
        self.read_picture(path.to_owned(), camera);
        if let Some(camera) = camera {
            self.go_to_camera(camera, false);
        }
    }

    /// Goes to the camera whose photograph is compared, where that was opened before the cameras.
    pub fn find_camera_of_picture(&mut self) {
        let Comparison { picture, drawn_of: None, of_camera: None, .. } = &self.comparison else { return };
        let camera = picture.as_ref().and_then(|(name, _)| camera_of(Path::new(name), &self.cameras));
        if let Some(camera) = camera {
            self.comparison.of_camera = Some(camera);
            self.go_to_camera(camera, true);
        }
    }

    /// Compares with the photograph of the camera that the view is at or was at last, and from now on with that of
    /// every camera that it goes to.
    pub fn compare_with_photographs(&mut self) {
        let index = self.camera.unwrap_or(self.last_camera);
        let has_one = |index: &usize| self.photograph_of(*index).is_some();
        let Some(index) = std::iter::once(index).chain(0..self.cameras.len()).find(has_one) else {
            return self.messages.note("no camera has a photograph: drop their folder on the window");
        };
        self.compare_with_photograph_of(index);
    }

    /// Goes to a camera and compares with its photograph.
    pub fn compare_with_photograph_of(&mut self, index: usize) {
        if let Some(file) = self.photograph_of(index) {
            self.read_picture(file, Some(index));
            self.go_to_camera(index, false);
        }
    }

    /// Reads a camera's photograph, small, on another thread, if that was not asked for yet.
    pub fn read_thumbnail(&mut self, index: usize) {
        let Some(file) = self.photograph_of(index).filter(|_| !self.thumbnails.contains_key(&index)) else { return };
        self.thumbnails.insert(index, None);
        let work = move |_: &Reporter| {
            let whole = Pixels::read(&file)?;
            let ratio = f64::from(THUMBNAIL_PX) / f64::from(whole.size[0].max(whole.size[1]));
            let size = whole.size.map(|side| ((f64::from(side) * ratio).round() as u32).max(1));
            // The mean of whole squares first, so that little is left to a bilinear filter.
            let side = (1.0 / ratio).floor().max(1.0) as u32;
            let cut = whole.size.map(|length| (length / side * side).max(1));
            let whole = if side > 1 { part(&whole, [0, 0, cut[0], cut[1]]).averaged(side) } else { whole };
            Ok(fitted(&whole, size, Background::BLACK))
        };
        self.jobs.start(work, move |thumbnail| JobEvent::Thumbnail(index, thumbnail));
    }

    /// Compares with the photograph of a camera where the view arrives there, if photographs are compared.
    pub(super) fn follow_camera(&mut self, index: usize) {
        let Comparison { target, of_camera, is_drawing, .. } = &self.comparison;
        let follows = of_camera.is_some() && (*target == CompareTarget::Picture || *is_drawing);
        if !follows || *of_camera == Some(index) {
            return;
        }
        match self.photograph_of(index) {
            Some(file) => self.read_picture(file, Some(index)),
            None => self.messages.note(format!("{} has no photograph", self.cameras[index].name)),
        }
    }

    /// The file with the photograph of a camera.
    pub fn photograph_of(&self, index: usize) -> Option<PathBuf> {
        let camera = self.cameras.get(index)?;
        self.photographs.as_ref()?.of(camera).map(Path::to_owned)
    }

    /// Reads a picture, on another thread.
    fn read_picture(&mut self, path: PathBuf, of_camera: Option<usize>) {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        self.comparison.drawn_of = None;
        self.comparison.of_camera = of_camera;
        let number = self.ask_for_picture();
        self.jobs.start(move |_| Pixels::read(&path), move |pixels| JobEvent::Picture(number, name, pixels));
    }

    /// The number of a picture to compare with; those that were asked for before are not wanted any more.
    fn ask_for_picture(&mut self) -> u64 {
        self.comparison.is_drawing = true;
        self.comparison.asked += 1;
        self.comparison.asked
    }

    /// Draws the view with the float64 reference to compare with, on another thread.
    pub fn compare_with_reference(&mut self) {
        let Ok(Some(plan)) = self.plan(Side::First) else { return };
        if plan.is_in_pages() {
            return self.messages.error(needs_whole("the reference"));
        }
        self.comparison.drawn_of = self.depicted();
        self.comparison.of_camera = None;
        let Some(Depicted { view, rules, background, .. }) = self.comparison.drawn_of.clone() else { return };
        let number = self.ask_for_picture();
        self.jobs.start(
            move |_| {
                let scene = plan.joined()?;
                Ok(crate::reference::render(&scene, &view, &rules, background).to_pixels())
            },
            move |pixels| JobEvent::Picture(number, "float64 reference".to_owned(), pixels),
        );
    }
}
