//! The stages that mark and select Gaussians.

use std::rc::Rc;

use anyhow::Result;
use glam::DVec3;
use smalto::camera::Camera;
use smalto::gpu::{Commands, Device, DispatchSize, Stage};
use smalto::options::Options;
use smalto::procedural::cactus;
use smalto::render::shaders::Figure;
use smalto::render::shaders::marks::*;
use smalto::render::{GpuScene, view as view_of};

use crate::{Bench, random, upload};

/// `mark` of random sets, and `select` by a brush and by a lasso across the picture, for `count` Gaussians.
pub fn benches(device: &Device, count: usize) -> Result<Vec<Bench<'_>>> {
    let scene = GpuScene::new(device, &cactus(count)?.gaussians, &Options::EXACT)?;
    let bounds = Rc::new(scene.planes().next().expect("every scene has bounds").clone());
    let (gaussians, words) = (scene.len() as u32, scene.len().div_ceil(32));
    let set = |seed: u32| (0..words as u32).map(|i| random(i ^ seed)).collect::<Vec<_>>();
    let sets = [upload(device, "left out", &set(1))?, upload(device, "selected", &set(2))?];
    let size = move || DispatchSize::Invocations(gaussians.into());
    let bytes = 16 * u64::from(gaussians) + 8 * words as u64;
    let stage = Stage::<Mark>::new(device, &())?;
    let marked = bounds.clone();
    let mark = Box::new(move |cmd: &mut Commands| {
        let bindings = MarkBindings { bounds: &marked, left_out: &sets[0], selected: &sets[1] };
        cmd.scope("mark", |cmd| cmd.dispatch(&stage, bindings, MarkPush { gaussians }, size()));
    });
    let mut all = vec![Bench { stage: "mark", input: format!("{gaussians} Gaussians"), bytes, record: mark }];
    let view = Camera::looking_at(DVec3::new(3.0, -2.5, -3.0), DVec3::new(0.0, -1.0, 0.0), [1920, 1080], 0.9);
    let view = view_of(&view, 0.05);
    for (name, kind, points) in [("brush", FIGURE_BRUSH, 16_u32), ("lasso", FIGURE_LASSO, 256)] {
        let turn = |i: u32| std::f32::consts::TAU * i as f32 / points as f32;
        let place = |i: u32| [960.0 + 700.0 * turn(i).cos(), 540.0 + 400.0 * turn(i).sin()];
        let of_points = upload(device, "points", &(0..points).map(place).collect::<Vec<_>>())?;
        let figure = Figure { low: [200.0, 80.0, 0.0], high: [1720.0, 1000.0, 0.0], radius: 20.0, visible: 0.0 };
        let figure = upload(device, "figure", &[figure])?;
        let none = upload(device, "no values", &[0.0_f32])?;
        let selected = upload(device, "selected", &vec![0_u32; words])?;
        let stage = Stage::<Select>::new(device, &())?;
        let bounds = bounds.clone();
        let select = Box::new(move |cmd: &mut Commands| {
            let bindings = SelectBindings {
                bounds: &bounds,
                figure: &figure,
                points: &of_points,
                values: &none,
                contributions: &none,
                selected: &selected,
            };
            let push = SelectPush { view, gaussians, kind, mode: MODE_REPLACE, points };
            cmd.scope("select", |cmd| cmd.dispatch(&stage, bindings, push, size()));
        });
        let input = format!("{name} of {points} points, {gaussians}");
        all.push(Bench { stage: "select", input, bytes: 16 * u64::from(gaussians) + 4 * words as u64, record: select });
    }
    Ok(all)
}
