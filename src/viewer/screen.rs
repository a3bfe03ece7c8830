//! Frames on their way: pictures are drawn, shown, and handed to a window or to an image of no window; two at a time.

use std::collections::VecDeque;
use std::sync::Arc;

use anyhow::Result;
use egui::{ClippedPrimitive, TexturesDelta};

use super::jobs::Side;
use super::pictures::Drawn;
use crate::camera::Camera;
use crate::gpu::{
    Access, Acquisition, Commands, Device, Image, InFlight, Overlay, Presentation, Swapchain, Timing, Vsync,
};
use crate::rules::Background;
use crate::render::{Compare, Display, Picture, Quantity, Recorded, Totals, upload_pixels};

/// Frames on the GPU at once: one is drawn while the next is prepared.
const IN_FLIGHT: usize = 2;

/// What pictures are shown on, and the frames on their way there.
pub struct Screen {
    device: Device,
    target: Target,
    display: Display,
    overlay: Option<Overlay>,
    /// Textures of panels to be made and given up with the next frame.
    textures: TexturesDelta,
    /// Where nothing is drawn.
    blank: Option<Image>,
    flights: VecDeque<Flight>,
    /// What a frame left to be said while another was prepared.
    landed: Vec<Landed>,
    /// The recording of pictures that the next frame shows.
    drawing: Option<Drawing>,
}

enum Target {
    Window(Swapchain),
    Offscreen(Image),
    /// Neither any more.
    Closed,
}

/// A frame on the GPU.
struct Flight {
    drawing: Option<Drawing>,
    show: InFlight,
}

/// Pictures on the GPU.
struct Drawing {
    commands: InFlight,
    pictures: Vec<(Side, u64, Recorded)>,
}

/// A frame that is done.
pub struct Landed {
    pub timings: Vec<Timing>,
    /// Of what was drawn: the side, what the frame counted if it came out whole.
    pub pictures: Vec<(Side, Option<Totals>)>,
}

/// The two pictures of a screen.
#[derive(Default)]
pub struct Pair {
    pub first: Option<Drawn>,
    pub second: Option<Second>,
}

/// What the first picture is held against.
pub enum Second {
    Drawn(Box<Drawn>),
    /// From elsewhere, of the window's size.
    Image(Image),
}

/// What came of showing a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shown {
    Yes,
    /// The window has changed, and the frame is to be shown again.
    Again,
    /// The window has no pixels.
    Hidden,
    /// The window's surface is gone: open the screen anew.
    Lost,
}

/// How pictures and panels make a frame.
pub struct Arrangement<'a> {
    pub compare: Compare,
    pub quantity: Quantity,
    pub triangles: &'a [ClippedPrimitive],
    pub pixels_per_point: f32,
}

impl Second {
    pub fn drawn(&self) -> Option<&Drawn> {
        match self {
            Self::Drawn(drawn) => Some(drawn),
            Self::Image(_) => None,
        }
    }
}

impl Pair {
    /// What is drawn, and on which side.
    pub fn drawn(&mut self) -> impl Iterator<Item = (Side, &mut Drawn)> {
        let second = self.second.as_mut().and_then(|second| match second {
            Second::Drawn(drawn) => Some((Side::Second, &mut **drawn)),
            Second::Image(_) => None,
        });
        self.first.as_mut().map(|drawn| (Side::First, drawn)).into_iter().chain(second)
    }
}

impl Screen {
    /// The screen of a window, on a device that was opened for its display.
    pub fn of_window(device: &Device, window: &Arc<winit::window::Window>, vsync: Vsync) -> Result<Self> {
        let mut swapchain = Swapchain::new(device, window, vsync)?;
        let size = window.inner_size();
        swapchain.fit([size.width, size.height])?;
        let display = Display::new(device, swapchain.is_stored_directly()?, swapchain.is_bgra()?)?;
        Ok(Self::new(device, Target::Window(swapchain), display))
    }

    /// No window: the same, into an image of this size.
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
            flights: VecDeque::new(),
            landed: Vec::new(),
            drawing: None,
        }
    }

    /// Ends the use of the window, which another screen may take over.
    pub fn close(&mut self) {
        self.flights.clear();
        self.drawing = None;
        self.overlay = None;
        self.target = Target::Closed;
    }

    pub fn device(&self) -> &Device {
        &self.device
    }

    /// Width and height in pixels; none while there are none.
    pub fn size(&self) -> Option<[u32; 2]> {
        match &self.target {
            Target::Window(swapchain) => swapchain.size(),
            Target::Offscreen(image) => Some(image.size()),
            Target::Closed => None,
        }
    }

    /// Fits the window as it is.
    pub fn fit(&mut self, size: [u32; 2]) -> Result<Shown> {
        match &mut self.target {
            Target::Window(swapchain) => match swapchain.fit(size)? {
                Presentation::Lost => Ok(Shown::Lost),
                _ => Ok(if swapchain.size().is_some() { Shown::Yes } else { Shown::Hidden }),
            },
            Target::Offscreen(_) | Target::Closed => Ok(Shown::Yes),
        }
    }

    pub fn set_vsync(&mut self, vsync: Vsync, size: [u32; 2]) -> Result<Shown> {
        if let Target::Window(swapchain) = &mut self.target {
            swapchain.set_vsync(vsync);
        }
        self.fit(size)
    }

    /// Textures that panels want, from this frame on.
    pub fn add_textures(&mut self, changes: TexturesDelta) {
        self.textures.append(changes);
    }

    /// Whether frames are on their way.
    pub fn is_busy(&self) -> bool {
        !self.flights.is_empty() || self.drawing.is_some()
    }

    /// The frames that are done since the last time. With `wait`, all of them.
    pub fn landed(&mut self, pair: &mut Pair, wait: bool) -> Result<Vec<Landed>> {
        while self.flights.front().is_some_and(|flight| wait || flight.show.is_done()) {
            self.land(pair)?;
        }
        Ok(std::mem::take(&mut self.landed))
    }

    /// Waits until fewer frames than may be are on their way.
    pub fn make_room(&mut self, pair: &mut Pair) -> Result<()> {
        while self.flights.len() >= IN_FLIGHT {
            self.land(pair)?;
        }
        Ok(())
    }

    /// Waits for the oldest frame.
    fn land(&mut self, pair: &mut Pair) -> Result<()> {
        let Some(Flight { drawing, show }) = self.flights.pop_front() else { return Ok(()) };
        let Some(Drawing { commands, pictures }) = drawing else {
            show.wait()?;
            return Ok(());
        };
        let drawn = commands.wait()?;
        let mut counted = Vec::new();
        for (side, generation, recorded) in pictures {
            // What was replaced meanwhile has nothing to learn.
            if let Some((_, there)) = pair.drawn().find(|(s, there)| (*s, there.generation) == (side, generation)) {
                counted.push((side, there.still.judge(&drawn, &recorded)?));
            }
        }
        let mut timings = drawn.timings().to_vec();
        // Of a submission of its own, behind the other.
        let end_ms = timings.iter().map(|t| t.start_ms + t.duration_ms).fold(0.0, f64::max);
        let later = |t: &Timing| Timing { start_ms: t.start_ms + end_ms, ..t.clone() };
        timings.extend(show.wait()?.timings().iter().map(later));
        self.landed.push(Landed { timings, pictures: counted });
        Ok(())
    }

    /// Draws the pictures of `pair` anew. [`Screen::show`] shows them.
    pub fn draw(&mut self, pair: &mut Pair, camera: &Camera, background: Background) -> Result<()> {
        self.make_room(pair)?;
        let mut cmd = Commands::new(&self.device)?;
        let mut pictures = Vec::new();
        for (side, drawn) in pair.drawn() {
            pictures.push((side, drawn.generation, drawn.still.record(&mut cmd, camera, background)?));
        }
        if !pictures.is_empty() {
            self.drawing = Some(Drawing { commands: cmd.submit()?, pictures });
        }
        Ok(())
    }

    /// Shows what was drawn last, with panels over it.
    pub fn show(&mut self, pair: &mut Pair, look: &Arrangement) -> Result<Shown> {
        self.make_room(pair)?;
        let acquired = match &mut self.target {
            Target::Closed => return Ok(Shown::Hidden),
            Target::Offscreen(_) => None,
            Target::Window(swapchain) => match swapchain.acquire()? {
                Acquisition::Image(acquired) => Some(acquired),
                Acquisition::Stale => return Ok(Shown::Again),
                Acquisition::Hidden => return Ok(Shown::Hidden),
                Acquisition::Lost => return Ok(Shown::Lost),
            },
        };
        let image = match (&self.target, &acquired) {
            (Target::Offscreen(image), _) => image.clone(),
            (_, Some(acquired)) => acquired.image().clone(),
            (_, None) => unreachable!("a window gives an image"),
        };
        let mut cmd = Commands::new(&self.device)?;
        self.record(&mut cmd, pair, look, &image)?;
        let (show, outcome) = match (&mut self.target, acquired) {
            (Target::Window(swapchain), Some(acquired)) => cmd.present(swapchain, acquired)?,
            _ => (cmd.submit()?, Presentation::Shown),
        };
        self.flights.push_back(Flight { drawing: self.drawing.take(), show });
        Ok(match outcome {
            Presentation::Shown => Shown::Yes,
            Presentation::Stale => Shown::Again,
            Presentation::Lost => Shown::Lost,
        })
    }

    fn record(&mut self, cmd: &mut Commands, pair: &Pair, look: &Arrangement, image: &Image) -> Result<()> {
        let size = image.size();
        let fits = |image: &Image| image.size() == size;
        let first = pair.first.as_ref().map(|drawn| Picture::of(&drawn.still)).filter(|p| fits(p.image()));
        let second = pair.second.as_ref().map(|second| match second {
            Second::Drawn(drawn) => Picture::of(&drawn.still),
            Second::Image(image) => Picture::whole(image),
        });
        let second = second.filter(|p| fits(p.image()));
        if first.is_none() && self.blank.as_ref().is_none_or(|blank| !fits(blank)) {
            let nothing = crate::pixels::Pixels { size, rgba: vec![[0.0; 4]; size[0] as usize * size[1] as usize] };
            self.blank = Some(upload_pixels(&self.device, "blank", &nothing)?);
        }
        let first = first.or_else(|| self.blank.as_ref().map(Picture::whole)).expect("a blank was made");
        let (second, compare) = match &second {
            Some(second) => (second, look.compare),
            None => (&first, Compare::First),
        };
        cmd.scope("display", |cmd| self.display.record(cmd, [&first, second], compare, look.quantity, image))?;
        if look.triangles.is_empty() {
            return Ok(());
        }
        if self.overlay.as_ref().is_none_or(|overlay| !overlay.fits(image)) {
            self.overlay = Some(Overlay::new(&self.device, image)?);
        }
        let overlay = self.overlay.as_mut().expect("an overlay was made");
        for (id, changes) in std::mem::take(&mut self.textures.set) {
            for change in changes {
                overlay.set_texture(id, &change)?;
            }
        }
        cmd.barrier(Access::SHADER_WRITE | Access::COPY_WRITE, Access::DRAW);
        cmd.scope("panels", |cmd| cmd.overlay(overlay, image, look.pixels_per_point, look.triangles))?;
        for id in std::mem::take(&mut self.textures.free) {
            overlay.free_texture(id);
        }
        Ok(())
    }

    /// What a screen without a window shows: rows of red, green, blue and alpha.
    pub fn read(&mut self, pair: &mut Pair) -> Result<Option<Vec<[u8; 4]>>> {
        while !self.flights.is_empty() {
            self.land(pair)?;
        }
        let Target::Offscreen(image) = &self.target else { return Ok(None) };
        let mut cmd = Commands::new(&self.device)?;
        let pixels = cmd.read_screen(image)?;
        Ok(Some(cmd.submit()?.wait()?.view(&pixels).to_vec()))
    }
}
