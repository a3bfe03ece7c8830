//! Sets marks of Gaussians on the device, and selects there.

use anyhow::Result;
use glam::DVec2;

use super::figure::{Figure, Outline, SelectionMode};
use crate::camera::Camera;
use crate::gpu::{Access, Buffer, Commands, Device, DispatchSize, Stage};
use crate::render::frame::view;
use crate::render::scene::GpuScene;
use crate::render::shaders::Figure as Packed;
use crate::render::shaders::marks::*;

/// The stages that change marks. Marks are sets of Gaussians: words of 32 bits, one for each Gaussian in their order.
pub struct Marker {
    device: Device,
    mark: Stage<Mark>,
    select: Stage<Select>,
    figure: Buffer<Packed>,
    /// Bound where a stage reads no values.
    no_values: Buffer<f32>,
}

/// What a figure selects of.
#[derive(Clone, Copy)]
pub struct Aim<'a> {
    /// The camera in whose picture outlines are.
    pub view: &'a Camera,
    /// The near plane, world units.
    pub near: f32,
    /// A value of each Gaussian, for [`Figure::Values`].
    pub values: Option<&'a Buffer<f32>>,
    /// The contribution of each Gaussian to the view, and the least of one that is selected.
    pub contributions: Option<(&'a Buffer<f32>, f32)>,
}

impl Marker {
    /// Builds the pipelines.
    ///
    /// # Errors
    /// If device memory runs out.
    pub fn new(device: &Device) -> Result<Self> {
        Ok(Self {
            device: device.clone(),
            mark: Stage::new(device, &())?,
            select: Stage::new(device, &())?,
            figure: Buffer::new(device, "figure", 1)?,
            no_values: Buffer::new(device, "no values", 1)?,
        })
    }

    /// The kept marker, which is made if there is none.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn of<'m>(kept: &'m mut Option<Self>, device: &Device) -> Result<&'m Self> {
        if kept.is_none() {
            *kept = Some(Self::new(device)?);
        }
        Ok(kept.as_ref().expect("it was made"))
    }

    /// Sets the marks of all Gaussians of a scene, and waits.
    ///
    /// # Errors
    /// If memory runs out or the device is lost.
    ///
    /// # Panics
    /// If a set has not a word for every 32 Gaussians, or the scene is in pages.
    pub fn mark(&self, scene: &GpuScene, left_out: &[u32], selected: &[u32]) -> Result<()> {
        assert!(!scene.is_paged(), "pages have no marks");
        let words = scene.len().div_ceil(32);
        assert_eq!([left_out.len(), selected.len()], [words; 2], "a set has a bit for each Gaussian");
        let mut cmd = Commands::new(&self.device)?;
        let buffers = [("left out", left_out), ("selected", selected)].map(|(name, set)| {
            let buffer = Buffer::new(&self.device, name, words)?;
            cmd.upload(&buffer, 0, words, |memory| memory.copy_from_slice(set))?;
            anyhow::Ok(buffer)
        });
        let [left_out, selected] = buffers;
        cmd.barrier(Access::COPY_WRITE, Access::SHADER);
        let bindings = MarkBindings { bounds: &scene.bounds, left_out: &left_out?, selected: &selected? };
        let size = DispatchSize::Invocations(scene.len() as u64);
        cmd.scope("mark", |cmd| cmd.dispatch(&self.mark, bindings, MarkPush { gaussians: scene.len() as u32 }, size));
        cmd.submit()?.wait()?;
        Ok(())
    }

    /// Selects the Gaussians of a scene that are inside a figure, combined with the selection before, and waits.
    /// Returns the set of selected Gaussians and the duration on the GPU in milliseconds.
    ///
    /// # Errors
    /// If memory runs out or the device is lost.
    ///
    /// # Panics
    /// If the scene is in pages, or an outline is in a picture through a lens.
    pub fn select(&self, scene: &GpuScene, figure: &Figure, mode: SelectionMode, aim: Aim) -> Result<(Vec<u32>, f64)> {
        assert!(!scene.is_paged(), "pages have no marks");
        let is_outline = matches!(figure, Figure::Outline(_));
        assert!(!is_outline || aim.view.lens.is_none(), "the device does not know where a lens shows centres");
        let given = aim.values.into_iter().chain(aim.contributions.map(|(contributions, _)| contributions));
        given.for_each(|values| assert!(values.len() >= scene.len(), "every Gaussian has `{}`", values.name()));
        let points = match figure {
            Figure::Outline(Outline::Lasso(points) | Outline::Brush(points, _)) => &points[..],
            _ => &[],
        };
        let (kind, packed) = packed(figure, aim);
        let mut cmd = Commands::new(&self.device)?;
        let of_points = Buffer::<[f32; 2]>::new(&self.device, "points", points.len().max(1))?;
        cmd.upload(&self.figure, 0, 1, |memory| memory[0] = packed)?;
        cmd.upload(&of_points, 0, points.len(), |memory| {
            memory.iter_mut().zip(points).for_each(|(to, from)| *to = from.as_vec2().to_array());
        })?;
        let selected = Buffer::<u32>::new(&self.device, "selected", scene.len().div_ceil(32))?;
        cmd.barrier(Access::COPY_WRITE, Access::SHADER);
        let bindings = SelectBindings {
            bounds: &scene.bounds,
            figure: &self.figure,
            points: &of_points,
            values: aim.values.unwrap_or(&self.no_values),
            contributions: aim.contributions.map_or(&self.no_values, |(contributions, _)| contributions),
            selected: &selected,
        };
        // Figures of the world and of values need no view.
        let view = view(&aim.view.with_lens(None), aim.near);
        let (gaussians, points) = (scene.len() as u32, points.len() as u32);
        let push = SelectPush { view, gaussians, kind, mode: mode as u32, points };
        let size = DispatchSize::Invocations(scene.len() as u64);
        cmd.scope("select", |cmd| cmd.dispatch(&self.select, bindings, push, size));
        cmd.barrier(Access::SHADER_WRITE, Access::COPY_READ);
        let words = cmd.read(&selected)?;
        let results = cmd.submit()?.wait()?;
        let ms = results.timings().iter().map(|timing| timing.duration_ms).sum();
        Ok((results.view(&words).to_vec(), ms))
    }

    /// The scene with bounds of its own, whose marks do not change with those of `scene`.
    ///
    /// # Errors
    /// If memory runs out or the device is lost.
    pub fn separated(&self, scene: &GpuScene) -> Result<GpuScene> {
        let bounds = Buffer::new(&self.device, "bounds", scene.bounds.len())?;
        let mut cmd = Commands::new(&self.device)?;
        cmd.copy(&scene.bounds, &bounds);
        cmd.submit()?.wait()?;
        Ok(scene.with_bounds(bounds))
    }
}

/// The kind and the numbers of a figure, as the shader reads them.
fn packed(figure: &Figure, aim: Aim) -> (u32, Packed) {
    let flat = |[low, high]: [DVec2; 2]| [low, high].map(|corner| [corner.x as f32, corner.y as f32, 0.0]);
    let (kind, [low, high], radius) = match figure {
        Figure::Outline(outline) => {
            let corners = flat(outline.bounds());
            match outline {
                Outline::Rectangle(..) => (FIGURE_RECTANGLE, corners, 0.0),
                Outline::Lasso(_) => (FIGURE_LASSO, corners, 0.0),
                Outline::Brush(_, radius) => (FIGURE_BRUSH, corners, *radius),
            }
        }
        Figure::Ball(centre, radius) => (FIGURE_BALL, [centre.as_vec3().to_array(); 2], *radius),
        Figure::Box(low, high) => (FIGURE_BOX, [low, high].map(|corner| corner.as_vec3().to_array()), 0.0),
        Figure::Values(range) => (FIGURE_VALUES, [*range.start(), *range.end()].map(|limit| [limit, 0.0, 0.0]), 0.0),
    };
    let visible = aim.contributions.map_or(0.0, |(_, least)| least);
    (kind, Packed { low, high, radius: radius as f32, visible })
}
