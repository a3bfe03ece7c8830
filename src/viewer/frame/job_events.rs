//! Handling of the events of jobs, and starting the builds of planned pictures.

use std::path::Path;
use std::sync::Arc;

use anyhow::Result;

use crate::gpu::Device;
use crate::host_memory::OutOfMemory;
use crate::render::upload_pixels;
use crate::scene::{Cancelled, Unreadable};
use crate::viewer::model::{
    CompareTarget, Drawn, Event, JobEvent, LoadedScene, Pair, PictureOf, Second, SecondPicture, Sharing, Side, Viewer,
    covered, fitted, over,
};

/// Handles an event of a job. `device` is the one that the window draws on.
pub fn handle(viewer: &mut Viewer, pair: &mut Pair, device: &Device, event: JobEvent) {
    match event {
        JobEvent::Reading(number, fraction) => {
            if let Some(layer) = viewer.scenes.layer_mut(number) {
                layer.progress = Some(fraction);
            }
        }
        JobEvent::Partial(number, gaussians) => {
            let Some(layer) = viewer.scenes.layer_mut(number).filter(|layer| layer.part.is_none()) else { return };
            let scene = layer.scene.insert(LoadedScene::Whole(gaussians)).clone();
            if !viewer.view.is_set {
                viewer.set_first_view(scene.focus());
                viewer.reset_undo();
            }
        }
        JobEvent::Read(number, scene) => viewer.handle_scene(number, scene),
        // The device of the job was lost meanwhile.
        JobEvent::Contributions(_, Ok(found)) if !found.on_device.is_on(device) => viewer.editing.is_finding = false,
        JobEvent::Values(_, Ok(values)) if !values.all().1.is_on(device) => viewer.editing.is_finding = false,
        JobEvent::Contributions(waiting, found) => viewer.handle_contributions(waiting, found),
        JobEvent::Values(waiting, values) => viewer.handle_values(waiting, values),
        JobEvent::Changed(number, changed) => viewer.handle_change(number, changed),
        JobEvent::Cameras(path, origin, cameras) => viewer.handle_cameras(&path, origin, cameras),
        // The device of the build was lost meanwhile.
        JobEvent::Built(side, number, _) if viewer.pictures.building[side as usize] != Some(number) => {}
        JobEvent::Built(side, _, drawn) => handle_built(viewer, pair, side, drawn),
        JobEvent::Shared(generation, sharing) => handle_shared(viewer, pair, generation, sharing),
        JobEvent::Picture(number, name, of, pixels) => {
            viewer.comparison.requests_under_way -= 1;
            // Something else was requested or chosen meanwhile.
            if number != viewer.comparison.last_request {
                return;
            }
            viewer.comparison.is_loading = false;
            match pixels {
                Ok(pixels) => {
                    let is_reference = matches!(of, PictureOf::Content(_));
                    viewer.comparison.target =
                        if is_reference { CompareTarget::Reference } else { CompareTarget::Picture };
                    viewer.comparison.picture = Some(SecondPicture { name, pixels: Arc::new(pixels), of });
                    viewer.comparison.is_stale = true;
                    viewer.find_camera_of_picture();
                }
                Err(problem) => {
                    viewer.messages.error(format!("{name}: {problem:#}"));
                    viewer.messages.failure.get_or_insert_with(|| Unreadable::or_too_large(Path::new(&name), problem));
                }
            }
        }
        JobEvent::Photographs(photographs) => viewer.handle_photographs(photographs),
        JobEvent::Thumbnail(camera, thumbnail) => drop(viewer.cameras.thumbnails.insert(camera, thumbnail.ok())),
        JobEvent::Evaluated(evaluation) => {
            viewer.measuring.running = None;
            match evaluation {
                Ok(evaluation) => viewer.cameras.evaluation = Some(evaluation),
                Err(problem) if problem.is::<Cancelled>() => viewer.messages.note("measuring was cancelled"),
                Err(problem) => viewer.messages.error(format!("cannot measure: {problem:#}")),
            }
        }
        JobEvent::Compared(difference) => {
            viewer.comparison.is_measuring = false;
            match difference {
                Ok(difference) => viewer.comparison.pair_difference = Some(difference),
                Err(problem) => viewer.messages.error(format!("cannot compare: {problem:#}")),
            }
        }
        JobEvent::Measuring(fraction) => {
            if let Some(measurement) = &mut viewer.measuring.running {
                measurement.fraction = fraction;
            }
        }
        JobEvent::Measured(costs) => {
            let content = viewer.measuring.running.take().and_then(|measurement| measurement.content);
            match costs {
                Ok(costs) => viewer.measuring.costs = Some((costs, content)),
                Err(problem) if problem.is::<Cancelled>() => viewer.messages.note("measuring was cancelled"),
                Err(problem) => viewer.messages.error(format!("cannot measure: {problem:#}")),
            }
        }
        JobEvent::Chosen(choice) => {
            viewer.measuring.running = None;
            match choice {
                Ok((options, why)) => {
                    viewer.options = options;
                    viewer.messages.note(why.clone());
                    viewer.measuring.budget.chosen = Some(why);
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
                Err(problem) if problem.is::<Cancelled>() => viewer.write_nothing(format!("{problem:#}")),
                Err(problem) => viewer.fail_to_write(format!("{problem:#}")),
            }
        }
    }
}

fn handle_built(viewer: &mut Viewer, pair: &mut Pair, side: Side, drawn: Result<Box<Drawn>>) {
    viewer.pictures.building[side as usize] = None;
    if let Some(text) = viewer.pictures.shader_errors[side as usize].take() {
        viewer.messages.retract(&text);
    }
    match drawn {
        Ok(drawn) => {
            viewer.pictures.are_stale = true;
            match side {
                Side::First => {
                    let is_new = pair.first.as_ref().is_none_or(|old| !old.plan.has_scene_of(&drawn.plan));
                    // The build may contain only the part of a scene that was read until then.
                    if is_new && !viewer.scenes.are_loading() && viewer.is_current(&drawn.plan) {
                        let (gaussians, scenes) = (drawn.statistics.count, drawn.plan.scenes.len());
                        viewer.events.emit(&Event::Scene { gaussians, scenes });
                    }
                    if is_new {
                        viewer.inspector.clear_explanation();
                    }
                    (pair.first, pair.lent) = (Some(*drawn), None);
                }
                Side::Second => pair.second = Some(Second::Drawn(drawn)),
            }
        }
        Err(problem) => {
            viewer.pictures.refused[side as usize] = viewer.shown_plan(side).ok().flatten();
            let text = match problem.downcast_ref::<OutOfMemory>() {
                Some(_) => format!("this scene does not fit: {problem:#}"),
                None => format!("{problem:#}"),
            };
            if viewer.pictures.shaders.is_some() {
                viewer.pictures.shader_errors[side as usize] = Some(text.clone());
            }
            viewer.messages.error(text);
            viewer.messages.failure.get_or_insert(problem);
        }
    }
}

fn handle_shared(viewer: &mut Viewer, pair: &mut Pair, generation: u64, sharing: Result<(Sharing, Vec<String>)>) {
    viewer.pictures.is_sharing &= viewer.pictures.shared != Some(generation);
    let Some(first) = pair.first.as_mut().filter(|first| first.generation == generation) else { return };
    match sharing {
        Ok((mut sharing, failed)) => {
            sharing.devices.learn_alone(first.frame.gpu_ms());
            first.sharing = Some(sharing);
            viewer.pictures.are_stale = true;
            failed.iter().for_each(|failed| viewer.remark(&format!("a device draws no bands: {failed}")));
        }
        Err(problem) => viewer.remark(&format!("the other devices draw no bands: {problem:#}")),
    }
}

/// Prepares the other devices for the first picture, once it is drawn.
fn share(viewer: &mut Viewer, pair: &Pair, device: &Device) {
    if viewer.setup.other_devices.is_empty() || viewer.pictures.is_sharing || viewer.pictures.is_any_building() {
        return;
    }
    let first = pair.first.as_ref().filter(|first| viewer.pictures.shared != Some(first.generation));
    let Some(plan) = first.and_then(|first| first.sharing_plan(&viewer.view.camera())) else { return };
    let (device, others, generation) = (device.clone(), viewer.setup.other_devices.clone(), plan.generation);
    (viewer.pictures.shared, viewer.pictures.is_sharing) = (Some(generation), true);
    viewer.jobs.start(move |_| plan.build(&device, &others), move |sharing| JobEvent::Shared(generation, sharing));
}

/// Starts the builds of planned pictures, and drops pictures that are no longer planned.
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
            // The last scene was closed or hidden, or nothing is compared. A refused plan may be tried again later.
            viewer.pictures.refused[i] = None;
            let is_loading = viewer.scenes.are_loading();
            if current.is_some() && !(side == Side::First && is_loading) {
                match side {
                    Side::First => (pair.first, pair.lent) = (None, None),
                    Side::Second => pair.second = None,
                }
                viewer.pictures.are_stale = true;
            }
            continue;
        };
        let is_current = current.is_some_and(|drawn| drawn.suits(&planned));
        let is_refused = viewer.pictures.refused[i].as_ref().is_some_and(|refused| refused.is_same(&planned));
        if is_current || is_refused || viewer.pictures.building[i].is_some() {
            continue;
        }
        let lent = pair.lent.as_ref().filter(|lent| lent.has_scene_of(&planned)).cloned();
        let reusable = lent.or_else(|| current.or(pair.first.as_ref()).map(Drawn::reusable));
        let number = viewer.pictures.next_generation();
        viewer.pictures.building[i] = Some(number);
        viewer.pictures.refused[i] = None;
        let (device, view, background) = (device.clone(), viewer.view.camera(), viewer.view.background);
        viewer.jobs.start(
            move |_| planned.build(&device, reusable, &view, background, Some(number)).map(Box::new),
            move |drawn| JobEvent::Built(side, number, drawn),
        );
    }
    share(viewer, pair, device);
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
    let size = viewer.view.size;
    let has_size = matches!(&pair.second, Some(Second::Image(image)) if image.size() == size);
    if let Some(SecondPicture { name, pixels, .. }) = &comparison.picture
        && (!has_size || comparison.is_stale)
    {
        comparison.covered = covered(pixels.size, size);
        let pixels = match comparison.target {
            CompareTarget::Picture => fitted(&over(pixels, viewer.view.background), size, viewer.view.background),
            _ => fitted(pixels, size, viewer.view.background),
        };
        let pixels = Arc::new(pixels);
        pair.second = Some(Second::Image(upload_pixels(device, name, &pixels)?));
        comparison.fitted = Some(pixels);
        viewer.inspector.snapshot = None;
        comparison.is_stale = false;
    }
    Ok(())
}
