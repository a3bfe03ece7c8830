//! Draws pictures and shows them with panels over them, in a window or in an offscreen image. Up to two frames are in
//! flight.

use std::collections::VecDeque;
use std::sync::Arc;

use anyhow::Result;
use egui::{ClippedPrimitive, TexturesDelta};

use crate::camera::Camera;
use crate::gpu::{
    Access, Acquisition, Commands, Device, Image, InFlight, Overlay, Presentation, Swapchain, Timestamps, Timing, Vsync,
};
use crate::render::{Compare, Display, Path, Picture, Quantity, Recorded, Totals, upload_pixels};
use crate::rules::Background;
use crate::viewer::model::{Pair, Second, Side};

/// Frames in flight: the GPU draws one while the next is prepared.
const FRAMES_IN_FLIGHT: usize = 2;

/// The target on which pictures are shown, and the frames in flight.
pub struct Screen {
    device: Device,
    target: Target,
    display: Display,
    overlay: Option<Overlay>,
    /// Textures of the panels to create and free with the next frame.
    textures: TexturesDelta,
    /// Shown while there is no picture.
    blank: Option<Image>,
    frames: VecDeque<FrameInFlight>,
    /// Results of finished frames, kept until the next [`Screen::retire`].
    retired: Vec<RetiredFrame>,
    /// The pictures recorded by [`Screen::draw`] and not yet shown.
    drawing: Option<Drawing>,
}

enum Target {
    Window(Swapchain),
    Offscreen(Image),
    /// The window was released.
    Closed,
}

/// A frame on the GPU.
struct FrameInFlight {
    commands: InFlight,
    /// The pictures drawn in it.
    pictures: Vec<RecordedPicture>,
}

/// Recorded pictures. They are submitted with what shows them: each submission costs time on the GPU.
struct Drawing {
    commands: Commands,
    pictures: Vec<RecordedPicture>,
}

struct RecordedPicture {
    side: Side,
    generation: u64,
    path: Path,
    recorded: Recorded,
    /// Other devices drew bands of it.
    is_shared: bool,
}

/// The results of a finished frame.
pub struct RetiredFrame {
    pub timings: Vec<Timing>,
    /// The pictures drawn in it.
    pub pictures: Vec<RetiredPicture>,
}

/// The results of a picture in a finished frame.
pub struct RetiredPicture {
    pub side: Side,
    pub path: Path,
    /// The counts of the frame; `None` if it is incomplete because a buffer was too small.
    pub totals: Option<Totals>,
    /// Other devices drew bands of it.
    pub is_shared: bool,
    /// Its time on the GPU in milliseconds; of shared ones, that in which the bands were joined.
    pub gpu_ms: f64,
}

/// The outcome of showing a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shown {
    Yes,
    /// The window has changed; show the frame again.
    Again,
    /// The window has no pixels.
    Hidden,
    /// The surface of the window is gone; open a new screen.
    Lost,
}

/// The combination of pictures and panels into a frame.
pub struct Arrangement<'a> {
    pub compare: Compare,
    pub quantity: Quantity,
    /// The panels.
    pub triangles: &'a [ClippedPrimitive],
    pub pixels_per_point: f32,
}

impl Screen {
    /// The screen of a window. `device` was opened for the window's display.
    pub fn of_window(device: &Device, window: &Arc<winit::window::Window>, vsync: Vsync) -> Result<Self> {
        let mut swapchain = Swapchain::new(device, window, vsync)?;
        let size = window.inner_size();
        swapchain.fit([size.width, size.height])?;
        let display = Display::new(device, swapchain.is_stored_directly()?, swapchain.is_bgra()?)?;
        Ok(Self::new(device, Target::Window(swapchain), display))
    }

    /// A screen without a window: an image of this size in pixels.
    pub fn offscreen(device: &Device, size: [u32; 2]) -> Result<Self> {
        let target = Target::Offscreen(Image::screen(device, "screen", size)?);
        Ok(Self::new(device, target, Display::new(device, true, false)?))
    }

    fn new(device: &Device, target: Target, display: Display) -> Self {
        Self {
            device: device.clone(),
            target,
            display,
            overlay: None,
            textures: TexturesDelta::default(),
            blank: None,
            frames: VecDeque::new(),
            retired: Vec::new(),
            drawing: None,
        }
    }

    /// Releases the window for another screen.
    pub fn close(&mut self) {
        self.frames.clear();
        self.drawing = None;
        self.overlay = None;
        self.target = Target::Closed;
    }

    pub fn device(&self) -> &Device {
        &self.device
    }

    /// Width and height in pixels; `None` while the window has no pixels.
    pub fn size(&self) -> Option<[u32; 2]> {
        match &self.target {
            Target::Window(swapchain) => swapchain.size(),
            Target::Offscreen(image) => Some(image.size()),
            Target::Closed => None,
        }
    }

    /// Adapts the images of the screen to the size of the window.
    pub fn fit(&mut self, size: [u32; 2]) -> Result<Shown> {
        match &mut self.target {
            Target::Window(swapchain) => match swapchain.fit(size)? {
                Presentation::Lost => Ok(Shown::Lost),
                _ => Ok(if swapchain.size().is_some() { Shown::Yes } else { Shown::Hidden }),
            },
            // Frames in flight keep the image before.
            Target::Offscreen(image) if image.size() != size => {
                *image = Image::screen(&self.device, "screen", size)?;
                Ok(Shown::Yes)
            }
            Target::Offscreen(_) | Target::Closed => Ok(Shown::Yes),
        }
    }

    pub fn set_vsync(&mut self, vsync: Vsync, size: [u32; 2]) -> Result<Shown> {
        if let Target::Window(swapchain) = &mut self.target {
            swapchain.set_vsync(vsync);
        }
        self.fit(size)
    }

    /// Applies these changes to the textures of the panels with the next frame.
    pub fn add_textures(&mut self, changes: TexturesDelta) {
        self.textures.append(changes);
    }

    /// True while frames are in flight.
    pub fn is_busy(&self) -> bool {
        !self.frames.is_empty() || self.drawing.is_some()
    }

    /// True while drawn pictures are not yet known to be complete.
    pub fn is_drawing(&self) -> bool {
        self.drawing.is_some() || self.frames.iter().any(|frame| !frame.pictures.is_empty())
    }

    /// The frames that finished since the last call. With `wait`, waits for all that are in flight.
    pub fn retire(&mut self, pair: &mut Pair, wait: bool) -> Result<Vec<RetiredFrame>> {
        while self.frames.front().is_some_and(|frame| wait || frame.commands.is_done()) {
            self.retire_oldest(pair)?;
        }
        Ok(std::mem::take(&mut self.retired))
    }

    /// Waits until another frame may be submitted.
    pub fn wait_for_slot(&mut self, pair: &mut Pair) -> Result<()> {
        while self.frames.len() >= FRAMES_IN_FLIGHT {
            self.retire_oldest(pair)?;
        }
        Ok(())
    }

    /// Waits for the oldest frame.
    fn retire_oldest(&mut self, pair: &mut Pair) -> Result<()> {
        let Some(FrameInFlight { commands, pictures }) = self.frames.pop_front() else { return Ok(()) };
        let (results, is_drawn) = (commands.wait()?, !pictures.is_empty());
        let (mut retired, mut timings, mut left) = (Vec::new(), Vec::new(), results.timings());
        for RecordedPicture { side, generation, path, recorded, is_shared } in pictures {
            let own = recorded.take_timings(&mut left);
            let outermost = own.iter().filter(|timing| timing.depth == 0);
            let gpu_ms = match is_shared {
                true => recorded.own_ms(&own),
                false => outermost.map(|timing| timing.duration_ms).sum(),
            };
            timings.extend(own);
            // Counts of a picture that was replaced meanwhile are dropped.
            if let Some((_, drawn)) = pair.drawn().find(|(s, drawn)| (*s, drawn.generation) == (side, generation)) {
                let totals = drawn.renderer.judge(&results, &recorded)?;
                retired.push(RetiredPicture { side, path, totals, is_shared, gpu_ms });
            }
        }
        if is_drawn {
            timings.extend_from_slice(left);
            self.retired.push(RetiredFrame { timings, pictures: retired });
        }
        Ok(())
    }

    /// Records the drawing of the pictures of `pair`. [`Screen::show`] submits and shows them.
    /// `quantity` is what will be shown of them.
    pub fn draw(
        &mut self,
        pair: &mut Pair,
        (camera, background): (&Camera, Background),
        quantity: Quantity,
        times_stages: bool,
    ) -> Result<()> {
        let may_share = pair.may_share(quantity);
        self.wait_for_slot(pair)?;
        let mut cmd = Commands::new(&self.device)?;
        // Each timestamp costs time on the GPU, and only the panels show stages.
        cmd.set_timestamps(if times_stages { Timestamps::All } else { Timestamps::Outermost });
        let mut pictures = Vec::new();
        for (side, drawn) in pair.drawn() {
            let (recorded, is_shared) = drawn.record(&mut cmd, (camera, background), may_share)?;
            let (generation, path) = (drawn.generation, drawn.renderer.path());
            pictures.push(RecordedPicture { side, generation, path, recorded, is_shared });
        }
        if !pictures.is_empty() {
            self.drawing = Some(Drawing { commands: cmd, pictures });
        }
        Ok(())
    }

    /// Shows the pictures drawn last, with panels over them. If the window has no image for them, they are drawn only.
    pub fn show(&mut self, pair: &mut Pair, arrangement: &Arrangement) -> Result<Shown> {
        self.wait_for_slot(pair)?;
        let acquired = match &mut self.target {
            Target::Closed => return Ok(Shown::Hidden),
            Target::Offscreen(_) => None,
            Target::Window(swapchain) => Some(swapchain.acquire()?),
        };
        let drawing = self.drawing.take();
        let (image, acquired) = match (&self.target, acquired) {
            (Target::Offscreen(image), _) => (image.clone(), None),
            (_, Some(Acquisition::Image(acquired))) => (acquired.image().clone(), Some(acquired)),
            (_, outcome) => {
                if let Some(Drawing { commands, pictures }) = drawing {
                    self.frames.push_back(FrameInFlight { commands: commands.submit()?, pictures });
                }
                return Ok(match outcome {
                    Some(Acquisition::Stale) => Shown::Again,
                    Some(Acquisition::Lost) => Shown::Lost,
                    _ => Shown::Hidden,
                });
            }
        };
        let (mut cmd, pictures) = match drawing {
            Some(Drawing { commands, pictures }) => (commands, pictures),
            None => (Commands::new(&self.device)?, Vec::new()),
        };
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
        self.record(&mut cmd, pair, arrangement, &image)?;
        let (commands, outcome) = match (&mut self.target, acquired) {
            (Target::Window(swapchain), Some(acquired)) => cmd.present(swapchain, acquired)?,
            _ => (cmd.submit()?, Presentation::Shown),
        };
        self.frames.push_back(FrameInFlight { commands, pictures });
        Ok(match outcome {
            Presentation::Shown => Shown::Yes,
            Presentation::Stale => Shown::Again,
            Presentation::Lost => Shown::Lost,
        })
    }

    fn record(&mut self, cmd: &mut Commands, pair: &Pair, arrangement: &Arrangement, image: &Image) -> Result<()> {
        let size = image.size();
        let fits = |image: &Image| image.size()[0] <= size[0] && image.size()[1] <= size[1];
        let first = pair.first.as_ref().map(|drawn| drawn.renderer.picture()).filter(|p| fits(p.image()));
        let second = pair.second.as_ref().map(|second| match second {
            Second::Drawn(drawn) => drawn.renderer.picture(),
            Second::Image(image) => Picture::whole(image),
        });
        let second = second.filter(|p| fits(p.image()));
        let first = match (first, &second) {
            (Some(first), _) => first,
            (None, Some(second)) => Picture::whole(blank(&self.device, &mut self.blank, second.image().size())?),
            (None, None) => Picture::whole(blank(&self.device, &mut self.blank, size)?),
        };
        let second = second.filter(|second| second.image().size() == first.image().size());
        let (second, compare) = match &second {
            Some(second) => (second, arrangement.compare),
            None => (&first, Compare::First),
        };
        cmd.scope("display", |cmd| self.display.record(cmd, [&first, second], compare, arrangement.quantity, image))?;
        if arrangement.triangles.is_empty() {
            return Ok(());
        }
        let overlay = match &mut self.overlay {
            Some(overlay) if overlay.fits(image) => overlay,
            overlay => overlay.insert(Overlay::new(&self.device, image)?),
        };
        for (id, changes) in std::mem::take(&mut self.textures.set) {
            for change in changes {
                overlay.set_texture(id, &change)?;
            }
        }
        cmd.barrier(Access::SHADER_WRITE | Access::COPY_WRITE, Access::DRAW);
        cmd.scope("panels", |cmd| cmd.overlay(overlay, image, arrangement.pixels_per_point, arrangement.triangles))?;
        for id in std::mem::take(&mut self.textures.free) {
            overlay.free_texture(id);
        }
        Ok(())
    }

    /// The pixels of an offscreen screen, row by row: red, green, blue and alpha. `None` for a window.
    pub fn read(&mut self, pair: &mut Pair) -> Result<Option<Vec<[u8; 4]>>> {
        while !self.frames.is_empty() {
            self.retire_oldest(pair)?;
        }
        let Target::Offscreen(image) = &self.target else { return Ok(None) };
        let mut cmd = Commands::new(&self.device)?;
        let pixels = cmd.read_screen(image)?;
        Ok(Some(cmd.submit()?.wait()?.view(&pixels).to_vec()))
    }
}

/// A black image of this size; creates it in `current` if that has another size.
fn blank<'a>(device: &Device, current: &'a mut Option<Image>, size: [u32; 2]) -> Result<&'a Image> {
    if current.as_ref().is_none_or(|image| image.size() != size) {
        *current = None;
    }
    match current {
        Some(image) => Ok(image),
        none => {
            let black = crate::pixels::Pixels { size, rgba: vec![[0.0; 4]; size[0] as usize * size[1] as usize] };
            Ok(none.insert(upload_pixels(device, "blank", &black)?))
        }
    }
}
