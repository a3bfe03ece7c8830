//! Handles what jobs report, and starts the builds of the pictures that are wanted next.

use std::path::Path;
use std::sync::Arc;

use anyhow::Result;

use super::JobEvent;
use crate::gpu::Device;
use crate::host_memory::OutOfMemory;
use crate::render::upload_pixels;
use crate::scene::{Cancelled, Unreadable};
use crate::viewer::frame::{Drawn, Pair, Second, Side};
use crate::viewer::model::{CompareTarget, Event, Held, Viewer, fitted, over};

/// Handles an event of a job. `device` is the one that the window draws on.
pub fn handle(viewer: &mut Viewer, pair: &mut Pair, device: &Device, event: JobEvent) {
    match event {
        JobEvent::Reading(number, fraction) => {
            if let Some(layer) = viewer.layers.iter_mut().find(|layer| layer.number == number) {
                layer.progress = Some(fraction);
            }
        }
        JobEvent::Partial(number, gaussians) => {
            let Some(layer) = viewer.layers.iter_mut().find(|layer| layer.number == number) else { return };
            let held = layer.held.insert(Held::Whole(gaussians)).clone();
            if !viewer.has_view {
                viewer.set_first_view(held.focus());
                viewer.begin_undo();
            }
        }
        JobEvent::Read(number, scene) => viewer.handle_scene(number, scene),
        JobEvent::Shares(selection, how, shares) => viewer.handle_shares(&selection, how, shares),
        JobEvent::Changed(number, changed) => viewer.handle_change(number, changed),
        JobEvent::Cameras(path, cameras) => viewer.handle_cameras(&path, cameras),
        JobEvent::Built(side, drawn) => handle_built(viewer, pair, device, side, drawn),
        // Another one was asked for since.
        JobEvent::Picture(number, ..) if number != viewer.comparison.asked => {}
        JobEvent::Picture(_, name, pixels) => {
            viewer.comparison.is_drawing = false;
            match pixels {
                Ok(pixels) => {
                    let is_reference = viewer.comparison.drawn_of.is_some();
                    viewer.comparison.target =
                        if is_reference { CompareTarget::Reference } else { CompareTarget::Picture };
                    viewer.comparison.picture = Some((name, Arc::new(pixels)));
                    viewer.comparison.is_stale = true;
                    viewer.find_camera_of_picture();
                }
                Err(problem) => {
                    viewer.messages.error(format!("{name}: {problem:#}"));
                    viewer.failure.get_or_insert_with(|| Unreadable::or_too_large(Path::new(&name), problem));
                }
            }
        }
        JobEvent::Edited(number, edited) => viewer.handle_edited(number, edited),
        JobEvent::Photographs(photographs) => viewer.handle_photographs(photographs),
        JobEvent::Thumbnail(camera, thumbnail) => drop(viewer.thumbnails.insert(camera, thumbnail.ok())),
        JobEvent::Evaluated(evaluation) => {
            viewer.measurement = None;
            match evaluation {
                Ok(evaluation) => viewer.evaluation = Some(evaluation),
                Err(problem) if problem.is::<Cancelled>() => viewer.messages.note("measuring was cancelled"),
                Err(problem) => viewer.messages.error(format!("cannot measure: {problem:#}")),
            }
        }
        JobEvent::Compared(apart) => {
            viewer.comparison.is_measuring = false;
            match apart {
                Ok(apart) => viewer.comparison.apart = Some(apart),
                Err(problem) => viewer.messages.error(format!("cannot compare: {problem:#}")),
            }
        }
        JobEvent::Measuring(fraction) => {
            if let Some(measurement) = &mut viewer.measurement {
                measurement.fraction = fraction;
            }
        }
        JobEvent::Measured(costs) => {
            let of = viewer.measurement.take().and_then(|measurement| measurement.of);
            match costs {
                Ok(costs) => viewer.costs = Some((costs, of)),
                Err(problem) if problem.is::<Cancelled>() => viewer.messages.note("measuring was cancelled"),
                Err(problem) => viewer.messages.error(format!("cannot measure: {problem:#}")),
            }
        }
        JobEvent::Chosen(choice) => {
            viewer.measurement = None;
            match choice {
                Ok((options, why)) => {
                    viewer.options = options;
                    viewer.messages.note(why.clone());
                    viewer.budget.chosen = Some(why);
                }
                Err(problem) if problem.is::<Cancelled>() => viewer.messages.note("choosing was cancelled"),
                Err(problem) => viewer.messages.error(format!("{problem:#}")),
            }
        }
        JobEvent::Writing(fraction) => viewer.export.progress = Some(fraction),
        JobEvent::Written(summary) => {
            viewer.export.progress = None;
            match summary {
                Ok(summary) => {
                    viewer.events.emit(&Event::Written { text: summary.clone() });
                    viewer.messages.note(summary);
                }
                Err(problem) if problem.is::<Cancelled>() => viewer.messages.note(format!("{problem:#}")),
                Err(problem) => viewer.messages.error(format!("{problem:#}")),
            }
        }
    }
}

fn handle_built(viewer: &mut Viewer, pair: &mut Pair, device: &Device, side: Side, drawn: Result<Box<Drawn>>) {
    viewer.building[side as usize] = false;
    if let Some(text) = viewer.shader_errors[side as usize].take() {
        viewer.messages.retract(&text);
    }
    match drawn {
        // Built on a device that was lost meanwhile.
        Ok(drawn) if !drawn.scene.is_on(device) => {}
        Ok(drawn) => {
            viewer.is_stale = true;
            match side {
                Side::First => {
                    let is_new = pair.first.as_ref().is_none_or(|old| !old.plan.has_scene_of(&drawn.plan));
                    // It may have been built of the part of a scene that was read then.
                    if is_new && !viewer.is_reading() && viewer.draws(&drawn.plan) {
                        let (gaussians, scenes) = (drawn.statistics.count, drawn.plan.parts.len());
                        viewer.events.emit(&Event::Scene { gaussians, scenes });
                    }
                    if is_new {
                        viewer.explanation = None;
                        viewer.inspection.isolated = None;
                    }
                    pair.first = Some(*drawn);
                }
                Side::Second => pair.second = Some(Second::Drawn(drawn)),
            }
        }
        Err(problem) => {
            viewer.refused[side as usize] = viewer.shown_plan(side).ok().flatten();
            let text = match problem.downcast_ref::<OutOfMemory>() {
                Some(_) => format!("this scene does not fit: {problem:#}"),
                None => format!("{problem:#}"),
            };
            if viewer.shaders.is_some() {
                viewer.shader_errors[side as usize] = Some(text.clone());
            }
            viewer.messages.error(text);
            viewer.failure.get_or_insert(problem);
        }
    }
}

/// Starts the builds of pictures that are planned and not there yet; drops pictures that are no longer planned.
pub fn build(viewer: &mut Viewer, pair: &mut Pair, device: &Device) {
    for side in [Side::First, Side::Second] {
        let i = side as usize;
        let planned = match viewer.shown_plan(side) {
            Ok(planned) => planned,
            Err(problem) => {
                viewer.messages.note(format!("{problem:#}"));
                continue;
            }
        };
        let current = match side {
            Side::First => pair.first.as_ref(),
            Side::Second => pair.second.as_ref().and_then(Second::drawn),
        };
        let Some(planned) = planned else {
            // The last scene was closed or hidden, or nothing is compared. What was refused is tried again after that.
            viewer.refused[i] = None;
            let is_loading = viewer.is_reading();
            if current.is_some() && !(side == Side::First && is_loading) {
                match side {
                    Side::First => pair.first = None,
                    Side::Second => pair.second = None,
                }
                viewer.is_stale = true;
            }
            continue;
        };
        let is_current = current.is_some_and(|drawn| drawn.plan.is_same(&planned));
        let is_refused = viewer.refused[i].as_ref().is_some_and(|refused| refused.is_same(&planned));
        if is_current || is_refused || viewer.building[i] {
            continue;
        }
        let reusable = current.or(pair.first.as_ref()).map(Drawn::reusable);
        viewer.building[i] = true;
        viewer.refused[i] = None;
        let (device, view, background) = (device.clone(), viewer.view(), viewer.background);
        let generation = Some(viewer.next_generation());
        viewer.jobs.start(
            move |_| planned.build(&device, reusable, &view, background, generation).map(Box::new),
            move |drawn| JobEvent::Built(side, drawn),
        );
    }
}

/// Resamples a picture that the GPU did not draw to the size of the window, and uploads it.
pub fn fit_picture(viewer: &mut Viewer, pair: &mut Pair, device: &Device) -> Result<()> {
    let comparison = &mut viewer.comparison;
    match comparison.target {
        CompareTarget::Reference | CompareTarget::Picture => {}
        CompareTarget::Nothing | CompareTarget::Options(_) => {
            if pair.second.as_ref().is_some_and(|second| second.drawn().is_none()) {
                pair.second = None;
            }
            return Ok(());
        }
    }
    let size = viewer.size;
    let has_size = matches!(&pair.second, Some(Second::Image(image)) if image.size() == size);
    if let Some((name, pixels)) = &comparison.picture
        && (!has_size || comparison.is_stale)
    {
        let pixels = match comparison.target {
            CompareTarget::Picture => fitted(&over(pixels, viewer.background), size, viewer.background),
            _ => fitted(pixels, size, viewer.background),
        };
        let pixels = Arc::new(pixels);
        pair.second = Some(Second::Image(upload_pixels(device, name, &pixels)?));
        comparison.fitted = Some(pixels);
        viewer.still = None;
        comparison.is_stale = false;
    }
    Ok(())
}
