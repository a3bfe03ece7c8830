//! What becomes of news: scenes that were read, pictures that were built, and what is to be built next.

use std::path::Path;
use std::sync::Arc;

use anyhow::Result;

use super::comparison::{With, fitted};
use super::events::Event;
use super::jobs::{News, Side};
use super::pictures::Drawn;
use super::screen::Second;
use super::session::Session;
use crate::host_memory::OutOfMemory;
use crate::render::upload_pixels;
use crate::scene::Unreadable;

impl Session {
    pub(super) fn take(&mut self, news: News) {
        let viewer = &mut self.viewer;
        match news {
            News::Reading(number, fraction) => {
                if let Some(layer) = viewer.layers.iter_mut().find(|layer| layer.number == number) {
                    layer.progress = Some(fraction);
                }
            }
            News::Partial(number, gaussians) => {
                let Some(layer) = viewer.layers.iter_mut().find(|layer| layer.number == number) else { return };
                layer.gaussians = Some(gaussians.clone());
                if !viewer.has_view {
                    viewer.set_first_view(&gaussians);
                }
            }
            News::Read(number, scene) => viewer.take_scene(number, scene),
            News::Cameras(path, cameras) => viewer.take_cameras(&path, cameras),
            News::Built(side, drawn) => self.take_built(side, drawn),
            News::Picture(name, pixels) => {
                viewer.comparison.is_drawing = false;
                match pixels {
                    Ok(pixels) => {
                        let is_reference = viewer.comparison.drawn_for.is_some();
                        viewer.comparison.with = if is_reference { With::Reference } else { With::Picture };
                        viewer.comparison.picture = Some((name, Arc::new(pixels)));
                        viewer.comparison.is_stale = true;
                    }
                    Err(problem) => {
                        viewer.messages.error(format!("{name}: {problem:#}"));
                        viewer.failure.get_or_insert(Unreadable::new(Path::new(&name), &problem).into());
                    }
                }
            }
            News::Measured(costs) => {
                viewer.is_measuring = false;
                match costs {
                    Ok(costs) => viewer.costs = Some(costs),
                    Err(problem) => viewer.messages.error(format!("cannot measure: {problem:#}")),
                }
            }
            News::Chosen(choice) => {
                viewer.budget.is_choosing = false;
                match choice {
                    Ok((options, why)) => {
                        viewer.options = options;
                        viewer.messages.note(why);
                    }
                    Err(problem) => viewer.messages.error(format!("{problem:#}")),
                }
            }
            News::Writing(fraction) => viewer.export.progress = Some(fraction),
            News::Written(story) => {
                viewer.export.progress = None;
                match story {
                    Ok(story) => {
                        viewer.events.tell(&Event::Written { text: story.clone() });
                        viewer.messages.note(story);
                    }
                    Err(problem) => viewer.messages.error(format!("{problem:#}")),
                }
            }
        }
    }

    fn take_built(&mut self, side: Side, drawn: Result<Box<Drawn>>) {
        let viewer = &mut self.viewer;
        viewer.building[side as usize] = false;
        match drawn {
            // Of a device that is gone.
            Ok(drawn) if !drawn.scene.is_on(self.screen.device()) => {}
            Ok(drawn) => {
                viewer.is_stale = true;
                match side {
                    Side::First => {
                        let is_new = self.pair.first.as_ref().is_none_or(|old| !old.plan.has_scene_of(&drawn.plan));
                        if is_new && !viewer.is_reading() {
                            let (gaussians, scenes) = (drawn.gaussians.len(), drawn.plan.parts.len());
                            viewer.events.tell(&Event::Scene { gaussians, scenes });
                        }
                        if is_new {
                            viewer.explanation = None;
                            viewer.looks.isolated = None;
                        }
                        self.pair.first = Some(*drawn);
                    }
                    Side::Second => self.pair.second = Some(Second::Drawn(drawn)),
                }
            }
            Err(problem) => {
                viewer.refused[side as usize] = viewer.plan(side).ok().flatten();
                let story = match problem.downcast_ref::<OutOfMemory>() {
                    Some(_) => format!("this scene does not fit: {problem:#}"),
                    None => format!("{problem:#}"),
                };
                viewer.messages.error(story);
                viewer.failure.get_or_insert(problem);
            }
        }
    }

    /// Builds what is wanted and not there.
    pub(super) fn build(&mut self) {
        for side in [Side::First, Side::Second] {
            let i = side as usize;
            let wanted = match self.viewer.plan(side) {
                Ok(wanted) => wanted,
                Err(problem) => {
                    self.viewer.messages.note(format!("{problem:#}"));
                    continue;
                }
            };
            let there = match side {
                Side::First => self.pair.first.as_ref(),
                Side::Second => self.pair.second.as_ref().and_then(Second::drawn),
            };
            let Some(wanted) = wanted else {
                // The last scene was closed, or nothing is compared.
                let is_loading = self.viewer.is_reading();
                if there.is_some() && !(side == Side::First && is_loading) {
                    match side {
                        Side::First => self.pair.first = None,
                        Side::Second => self.pair.second = None,
                    }
                    self.viewer.is_stale = true;
                }
                continue;
            };
            let is_there = there.is_some_and(|drawn| drawn.plan.is_same(&wanted));
            let is_refused = self.viewer.refused[i].as_ref().is_some_and(|refused| refused.is_same(&wanted));
            if is_there || is_refused || self.viewer.building[i] {
                continue;
            }
            let before = there.or(self.pair.first.as_ref()).map(Drawn::kept);
            self.viewer.building[i] = true;
            self.viewer.refused[i] = None;
            let (device, view, background) = (self.screen.device().clone(), self.viewer.view(), self.viewer.background);
            let generation = self.viewer.next_generation();
            self.viewer.jobs.start(
                move |_| wanted.build(&device, before, &view, background, generation).map(Box::new),
                move |drawn| News::Built(side, drawn),
            );
        }
    }

    /// Brings a picture from elsewhere to the window's size.
    pub(super) fn fit_picture(&mut self) -> Result<()> {
        let comparison = &mut self.viewer.comparison;
        match comparison.with {
            With::Reference | With::Picture => {}
            With::Nothing | With::Options(_) => {
                if self.pair.second.as_ref().is_some_and(|second| second.drawn().is_none()) {
                    self.pair.second = None;
                }
                return Ok(());
            }
        }
        let size = self.viewer.size;
        let has_size = matches!(&self.pair.second, Some(Second::Image(image)) if image.size() == size);
        if let Some((name, pixels)) = &comparison.picture
            && (!has_size || comparison.is_stale)
        {
            let pixels = fitted(pixels, size, self.viewer.background);
            self.pair.second = Some(Second::Image(upload_pixels(self.screen.device(), name, &pixels)?));
            comparison.is_stale = false;
        }
        Ok(())
    }
}
