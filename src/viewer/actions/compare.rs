//! Actions of comparisons: the second picture, its numbers, and photographs.

use std::path::{Path, PathBuf};

use crate::pixels::Pixels;
use crate::rules::Background;
use crate::viewer::model::{
    CompareTarget, Comparison, JobEvent, PictureContent, PictureOf, Reporter, SecondPicture, Side, Viewer, camera_of,
    cropped, fitted, needs_whole,
};

/// Longest side of a thumbnail, in pixels.
const THUMBNAIL_PX: u32 = 440;

impl Viewer {
    /// Starts a job that compares the two pictures of the snapshot, unless their difference is known.
    pub fn compare_snapshot(&mut self) {
        let comparison = &mut self.comparison;
        let area = comparison.area;
        let Some(snapshot) = &self.inspector.snapshot else { return };
        let is_known = comparison
            .pair_difference
            .as_ref()
            .is_some_and(|known| (known.number, known.area) == (snapshot.number, area));
        if comparison.is_measuring || is_known || comparison.target == CompareTarget::Nothing {
            return;
        }
        if let Some(work) = snapshot.compare(area, &self.view.camera()) {
            comparison.is_measuring = true;
            self.jobs.start(move |_| Ok(work()), JobEvent::Compared);
        }
    }

    /// Fits the ends of the scale to the values of the first picture.
    pub fn fit_range(&mut self) {
        if !self.inspector.fit_range() {
            self.messages.note("there are no values to fit the scale to yet");
        }
    }

    /// Starts to read a picture to compare with. If its name is that of a camera, goes to that camera.
    pub fn compare_with_picture(&mut self, path: &Path) {
        let camera = camera_of(path, &self.cameras.list);
        self.read_picture(path.to_owned(), camera);
        if let Some(camera) = camera {
            self.go_to_camera(camera, false);
        }
    }

    /// Goes to the camera of the compared photograph, if the photograph was opened before the cameras.
    pub fn find_camera_of_picture(&mut self) {
        let Some(SecondPicture { name, of: of @ PictureOf::File(_), .. }) = &mut self.comparison.picture else {
            return;
        };
        if let Some(camera) = camera_of(Path::new(name), &self.cameras.list) {
            *of = PictureOf::Camera(camera);
            self.comparison.requested_camera = Some(camera);
            self.go_to_camera(camera, true);
        }
    }

    /// Compares with the photograph of the current or last camera, and from then on of every camera that the view goes
    /// to.
    pub fn compare_with_photographs(&mut self) {
        let index = self.view.camera_index.unwrap_or(self.view.last_camera_index);
        let has_one = |index: &usize| self.cameras.photograph_of(*index).is_some();
        let Some(index) = std::iter::once(index).chain(0..self.cameras.list.len()).find(has_one) else {
            return self.messages.note("no camera has a photograph: drop their folder on the window");
        };
        self.compare_with_photograph_of(index);
    }

    /// Goes to a camera and compares with its photograph.
    pub fn compare_with_photograph_of(&mut self, index: usize) {
        if let Some(file) = self.cameras.photograph_of(index) {
            self.read_picture(file, Some(index));
            self.go_to_camera(index, false);
        }
    }

    /// Starts to read the thumbnail of a camera's photograph, unless it was requested before.
    pub fn read_thumbnail(&mut self, index: usize) {
        let Some(file) = self.cameras.photograph_of(index).filter(|_| !self.cameras.thumbnails.contains_key(&index))
        else {
            return;
        };
        self.cameras.thumbnails.insert(index, None);
        let work = move |_: &Reporter| {
            let whole = Pixels::read(&file)?;
            let ratio = f64::from(THUMBNAIL_PX) / f64::from(whole.size[0].max(whole.size[1]));
            let size = whole.size.map(|side| ((f64::from(side) * ratio).round() as u32).max(1));
            // Means over whole squares first: a bilinear filter alone would alias.
            let side = (1.0 / ratio).floor().max(1.0) as u32;
            let cut = whole.size.map(|length| (length / side * side).max(1));
            let whole = if side > 1 { cropped(&whole, [0, 0, cut[0], cut[1]]).averaged(side) } else { whole };
            Ok(fitted(&whole, size, Background::BLACK))
        };
        self.jobs.start(work, move |thumbnail| JobEvent::Thumbnail(index, thumbnail));
    }

    /// Compares with the photograph of the camera that the view goes to, if photographs are compared.
    pub(super) fn compare_photograph_at(&mut self, index: usize) {
        let Comparison { target, requested_camera, is_loading, .. } = &self.comparison;
        let follows = requested_camera.is_some() && (*target == CompareTarget::Picture || *is_loading);
        if !follows || *requested_camera == Some(index) {
            return;
        }
        match self.cameras.photograph_of(index) {
            Some(file) => self.read_picture(file, Some(index)),
            None => self.messages.note(format!("{} has no photograph", self.cameras.list[index].name)),
        }
    }

    /// Starts to read a picture: the photograph of a camera, if it is one.
    fn read_picture(&mut self, path: PathBuf, camera: Option<usize>) {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let of = camera.map_or_else(|| PictureOf::File(path.clone()), PictureOf::Camera);
        let number = self.request_picture(camera);
        self.jobs.start(move |_| Pixels::read(&path), move |pixels| JobEvent::Picture(number, name, of, pixels));
    }

    /// The number of a new request for the second picture, the photograph of a camera if it is one. Results of earlier
    /// requests are dropped.
    fn request_picture(&mut self, camera: Option<usize>) -> u64 {
        self.comparison.requested_camera = camera;
        self.comparison.is_loading = true;
        self.comparison.last_request += 1;
        self.comparison.requests_under_way += 1;
        self.comparison.last_request
    }

    /// Starts to draw the view with the float64 reference.
    pub fn compare_with_reference(&mut self) {
        let Ok(Some(plan)) = self.plan(Side::First) else { return };
        if plan.is_paged() {
            return self.messages.error(needs_whole("the reference"));
        }
        let Some(content) = self.picture_content() else { return };
        let PictureContent { view, rules, background, .. } = content.clone();
        let of = PictureOf::Content(Box::new(content));
        let number = self.request_picture(None);
        self.jobs.start(
            move |_| {
                let scene = plan.edited()?;
                Ok(crate::reference::render(&scene, &view, &rules, background).to_pixels())
            },
            move |pixels| JobEvent::Picture(number, "float64 reference".to_owned(), of, pixels),
        );
    }
}
