//! Pictures on a screen: one, two side by side, their difference, or a quantity in false colours.

use anyhow::Result;

use crate::gpu::{Access, Buffer, Commands, Device, DispatchSize, Image, Stage};
use crate::pixels::Pixels;
use crate::render::shaders::inspect::*;
use crate::render::shaders::{Room, Totals};

/// The way in which two pictures are shown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Compare {
    First,
    Second,
    /// The first to the left of this column (px), the second to the right.
    Split(f32),
    /// The absolute difference per channel, multiplied by this gain.
    Difference(f32),
}

/// The quantity of a pixel that is shown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Quantity {
    /// Its colour.
    Colour,
    /// The number in all three channels, in false colours.
    Number(Scale),
    /// The number divided by the coverage.
    Mean(Scale),
    Coverage,
    Transmittance,
}

/// The ends of a scale of false colours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    pub low: f32,
    pub high: f32,
    pub is_logarithmic: bool,
}

impl Quantity {
    /// The number that a pixel shows, as `show.comp` computes it; `None` for a colour, or where nothing is shown.
    pub fn value(self, [red, _, _, alpha]: [f32; 4]) -> Option<f32> {
        match self {
            Self::Colour => None,
            Self::Number(_) => Some(red),
            Self::Mean(_) => (alpha > 0.0).then(|| red / alpha),
            Self::Coverage => Some(alpha),
            Self::Transmittance => Some(1.0 - alpha),
        }
    }
}

/// Converts pictures to 8 bits for a window, with the rounding of files. The shown pixels stay while a frame is
/// incomplete.
pub struct Display {
    device: Device,
    /// True if shaders may store to the window's images.
    is_direct: bool,
    stage: Stage<Show>,
    colours: Buffer<u32>,
    shown: Buffer<u32>,
    /// Bound in place of a window's image that shaders may not store to.
    no_screen: Image,
    no_totals: Buffer<Totals>,
}

/// A picture to show: an image, and the counts by which the shader decides whether it is complete.
pub struct Picture<'a> {
    image: &'a Image,
    /// `None` if it is known to be complete.
    frame: Option<(&'a Buffer<Totals>, Room)>,
}

/// Red, green and blue at a position on the scale, 0 for low and 1 for high.
pub fn false_colour(position: f64) -> [u8; 3] {
    let colorous::Color { r, g, b } = colorous::INFERNO.eval_continuous(position);
    [r, g, b]
}

impl Display {
    /// `is_direct`: shaders may store to the window's images. `is_bgra`: these have blue first.
    pub fn new(device: &Device, is_direct: bool, is_bgra: bool) -> Result<Self> {
        let colours = Buffer::new(device, "colours", COLOURS as usize)?;
        let mut cmd = Commands::new(device)?;
        cmd.upload(&colours, 0, COLOURS as usize, |memory: &mut [u32]| {
            for (i, word) in memory.iter_mut().enumerate() {
                let [r, g, b] = false_colour(i as f64 / f64::from(COLOURS - 1));
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

    /// Records the conversion of two pictures into the upper left corner of `screen`; the rest becomes black.
    ///
    /// # Errors
    /// If device memory runs out.
    ///
    /// # Panics
    /// If the pictures have different sizes, or are larger than `screen`.
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
        let picture_px = first.image.size();
        assert_eq!(picture_px, second.image.size(), "both pictures have one size");
        assert!(picture_px[0] <= size_px[0] && picture_px[1] <= size_px[1], "a picture fits the screen that shows it");
        let (mode, split_px, gain) = match compare {
            Compare::First => (MODE_FIRST, 0.0, 1.0),
            Compare::Second => (MODE_SECOND, 0.0, 1.0),
            Compare::Split(x) => (MODE_SPLIT, x, 1.0),
            Compare::Difference(gain) => (MODE_DIFFERENCE, 0.0, gain),
        };
        let none = Scale { low: 0.0, high: 1.0, is_logarithmic: false };
        let (quantity, scale) = match quantity {
            Quantity::Colour => (QUANTITY_COLOUR, none),
            Quantity::Number(scale) => (QUANTITY_NUMBER, scale),
            Quantity::Mean(scale) => (QUANTITY_MEAN, scale),
            Quantity::Coverage => (QUANTITY_COVERAGE, none),
            Quantity::Transmittance => (QUANTITY_TRANSMITTANCE, none),
        };
        let push = ShowPush {
            size_px,
            picture_px,
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
    /// An image that a frame drew, with the counts and the capacity of the frame.
    pub(in crate::render) fn of_frame(image: &'a Image, totals: &'a Buffer<Totals>, room: Room) -> Self {
        Self { image, frame: Some((totals, room)) }
    }

    /// An image that is known to be complete.
    pub fn whole(image: &'a Image) -> Self {
        Self { image, frame: None }
    }

    pub fn image(&self) -> &Image {
        self.image
    }

    fn room(&self) -> Room {
        let everything = Room { visible: u32::MAX, spans: u32::MAX, listed: u32::MAX, longest_list: u32::MAX };
        self.frame.as_ref().map_or(everything, |(_, room)| *room)
    }

    fn totals<'b>(&self, none: &'b Buffer<Totals>) -> &'b Buffer<Totals>
    where
        'a: 'b,
    {
        self.frame.as_ref().map_or(none, |(totals, _)| totals)
    }
}

/// Uploads pixels into a new image.
pub fn upload_pixels(device: &Device, name: &str, pixels: &Pixels) -> Result<Image> {
    let [width, height] = pixels.size;
    let image = Image::new(device, name, width, height)?;
    let mut cmd = Commands::new(device)?;
    cmd.upload_image(&image, &pixels.rgba)?;
    drop(cmd.submit()?);
    Ok(image)
}
