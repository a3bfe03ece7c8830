//! What a window shows of pictures: one, two side by side, their difference, or a quantity in false colours.

use anyhow::Result;

use crate::render::shaders::{Room, Show, ShowBindings, ShowConstants, ShowPush, Totals};
use crate::render::renderer::Renderer;
use crate::gpu::{Access, Buffer, Commands, Device, DispatchSize, Image, Stage};
use crate::pixels::Pixels;

/// What is shown of two pictures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Compare {
    First,
    Second,
    /// The first to the left of this many pixels.
    Split(f32),
    /// Of each channel, this many times.
    Difference(f32),
}

/// What is shown of a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Quantity {
    /// Its colour.
    Colour,
    /// The number that all three channels hold.
    Number(Scale),
    /// The same, over the coverage.
    Mean(Scale),
    Coverage,
    Transmittance,
}

/// The numbers between which false colours lie.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    pub low: f32,
    pub high: f32,
    pub is_logarithmic: bool,
}

/// Makes what a window shows, in 8 bits as files have it. What was shown is kept for as long as a frame did not find room.
pub struct Display {
    device: Device,
    /// Whether the window's images take stores of shaders.
    is_direct: bool,
    stage: Stage<Show>,
    colours: Buffer<u32>,
    shown: Buffer<u32>,
    /// Takes the place of the window's images where these take no stores.
    no_screen: Image,
    no_totals: Buffer<Totals>,
}

/// A picture to show: an image, and whether it came out whole.
pub struct Picture<'a> {
    image: &'a Image,
    /// None for one that came from elsewhere.
    frame: Option<(&'a Buffer<Totals>, Room)>,
}

/// Red, green and blue at a part of the scale, from 0 for low to 1 for high.
pub fn false_colour(part: f64) -> [u8; 3] {
    let colorous::Color { r, g, b } = colorous::INFERNO.eval_continuous(part);
    [r, g, b]
}

/// Colours of the scale from low to high.
const COLOURS: usize = 256;

impl Display {
    /// `is_direct`: the window's images take stores; `is_bgra`: they have blue first.
    pub fn new(device: &Device, is_direct: bool, is_bgra: bool) -> Result<Self> {
        let colours = Buffer::new(device, "colours", COLOURS)?;
        let mut cmd = Commands::new(device)?;
        cmd.upload(&colours, 0, COLOURS, |memory: &mut [u32]| {
            for (i, word) in memory.iter_mut().enumerate() {
                let [r, g, b] = false_colour(i as f64 / (COLOURS - 1) as f64);
                *word = u32::from_le_bytes([r, g, b, 255]);
            }
        })?;
        let no_totals = Buffer::new(device, "no totals", 1)?;
        cmd.fill(&no_totals, 0);
        drop(cmd.submit()?);
        Ok(Self {
            device: device.clone(),
            is_direct,
            stage: Stage::new(device, &ShowConstants { direct: is_direct, bgra: is_bgra })?,
            colours,
            shown: Buffer::new(device, "shown", 1)?,
            no_screen: Image::screen(device, "no screen", [1, 1])?,
            no_totals,
        })
    }

    /// Records what `screen` shows of pictures of its size.
    pub fn record(
        &mut self,
        cmd: &mut Commands,
        [first, second]: [&Picture; 2],
        compare: Compare,
        quantity: Quantity,
        screen: &Image,
    ) -> Result<()> {
        let size_px = screen.size();
        let pixels = size_px[0] as usize * size_px[1] as usize;
        if self.shown.len() != pixels {
            self.shown = Buffer::new(&self.device, "shown", pixels)?;
            cmd.fill(&self.shown, 0);
            cmd.barrier(Access::COPY_WRITE, Access::SHADER);
        }
        for picture in [first, second] {
            assert_eq!(picture.image.size(), size_px, "a picture is as large as what shows it");
        }
        let (mode, split_px, gain) = match compare {
            Compare::First => (0, 0.0, 1.0),
            Compare::Second => (1, 0.0, 1.0),
            Compare::Split(x) => (2, x, 1.0),
            Compare::Difference(gain) => (3, 0.0, gain),
        };
        let none = Scale { low: 0.0, high: 1.0, is_logarithmic: false };
        let (quantity, scale) = match quantity {
            Quantity::Colour => (0, none),
            Quantity::Number(scale) => (1, scale),
            Quantity::Mean(scale) => (2, scale),
            Quantity::Coverage => (3, none),
            Quantity::Transmittance => (4, none),
        };
        let push = ShowPush {
            size_px,
            mode,
            split_px,
            gain,
            quantity,
            logarithmic: scale.is_logarithmic.into(),
            low: scale.low,
            high: scale.high,
            first_room: first.room(),
            second_room: second.room(),
        };
        let bindings = ShowBindings {
            first: first.image,
            second: second.image,
            first_totals: first.totals(&self.no_totals),
            second_totals: second.totals(&self.no_totals),
            colours: &self.colours,
            shown: &self.shown,
            screen: if self.is_direct { screen } else { &self.no_screen },
        };
        cmd.dispatch(&self.stage, bindings, push, DispatchSize::Invocations(pixels as u64));
        if !self.is_direct {
            cmd.barrier(Access::SHADER_WRITE, Access::COPY_READ);
            cmd.copy_to_screen(&self.shown, screen);
        }
        Ok(())
    }
}

impl<'a> Picture<'a> {
    /// What a still drew last.
    pub fn of(still: &'a Renderer) -> Self {
        Self { image: still.image(), frame: Some((still.totals(), still.drawn_room())) }
    }

    /// What came from elsewhere.
    pub fn whole(image: &'a Image) -> Self {
        Self { image, frame: None }
    }

    pub fn image(&self) -> &Image {
        self.image
    }

    fn room(&self) -> Room {
        let everything = Room { visible: u32::MAX, spans: u32::MAX, instances: u32::MAX, longest_list: u32::MAX };
        self.frame.as_ref().map_or(everything, |(_, room)| *room)
    }

    fn totals<'b>(&self, none: &'b Buffer<Totals>) -> &'b Buffer<Totals>
    where
        'a: 'b,
    {
        self.frame.as_ref().map_or(none, |(totals, _)| totals)
    }
}

/// An image that holds these pixels.
pub fn upload_pixels(device: &Device, name: &str, pixels: &Pixels) -> Result<Image> {
    let [width, height] = pixels.size;
    let image = Image::new(device, name, width, height)?;
    let mut cmd = Commands::new(device)?;
    cmd.upload_image(&image, &pixels.rgba)?;
    drop(cmd.submit()?);
    Ok(image)
}
