//! One window's life without the window: news come in, panels are laid out, pictures are drawn and shown.

use std::time::{Duration, Instant};

use anyhow::Result;
use egui::{ClippedPrimitive, FullOutput, PlatformOutput, RawInput};

use super::comparison::With;
use super::events::Event;
use super::jobs::Side;
use super::pictures::{Drawn, Kept};
use super::screen::{Arrangement, Pair, Screen, Shown};
use super::state::{Viewer, Wish};
use super::{hands, panels};
use crate::render::{Compare, Quantity};

/// A viewer with the device that it draws on.
pub struct Session {
    pub viewer: Viewer,
    pub pair: Pair,
    pub screen: Screen,
    context: egui::Context,
    /// When the frame before was prepared, and whether it was one of a motion that went on.
    before: Option<(Instant, bool)>,
    has_shown_scene: bool,
    laid: Laid,
    /// The way of looking that was told last.
    sight: usize,
}

/// The panels as they were laid out last.
struct Laid {
    at: Option<Instant>,
    triangles: Vec<ClippedPrimitive>,
    pixels_per_point: f32,
    /// When they want to be laid out again.
    again_in: Duration,
}

/// What a frame leaves to be done by whoever owns the window.
pub struct Turn {
    /// If the panels were laid out.
    pub platform: Option<PlatformOutput>,
    /// When the next frame is due, if nothing happens before.
    pub again_in: Duration,
    pub wishes: Vec<Wish>,
    pub shown: Shown,
}

impl Session {
    pub fn new(viewer: Viewer, screen: Screen, context: egui::Context) -> Self {
        let laid = Laid { at: None, triangles: Vec::new(), pixels_per_point: 1.0, again_in: Duration::MAX };
        let sight = viewer.looks.sight;
        Self { viewer, pair: Pair::default(), screen, context, before: None, has_shown_scene: false, laid, sight }
    }

    pub fn context(&self) -> &egui::Context {
        &self.context
    }

    /// A new screen in place of one that is gone, with nothing on it yet.
    pub fn replace_screen(&mut self, screen: Screen) {
        self.pair = Pair::default();
        self.screen = screen;
        self.forget_letters();
        self.viewer.building = [false; 2];
        self.viewer.refused = [None, None];
        self.viewer.is_stale = true;
        self.viewer.comparison.is_stale = true;
    }

    /// Gives the pictures up, and the memory that they take.
    pub fn drop_pictures(&mut self) {
        for (side, _) in self.pair.drawn() {
            self.viewer.refused[side as usize] = self.viewer.plan(side).ok().flatten();
        }
        self.pair = Pair::default();
        self.viewer.is_stale = true;
    }

    /// The panels send their letters again, to another surface.
    pub fn forget_letters(&mut self) {
        let (context, style) = (egui::Context::default(), self.context.global_style());
        context.set_global_style(style);
        self.context = context;
        self.laid.at = None;
        self.laid.triangles.clear();
    }

    /// Whether all that was asked for is read, and on the screen.
    pub fn is_settled(&self) -> bool {
        let viewer = &self.viewer;
        let is_read = !viewer.is_reading() && !viewer.is_reading_cameras;
        let is_asked = viewer.wishes.is_empty() && viewer.export.progress.is_none();
        let is_measured = !viewer.is_measuring && !viewer.budget.is_choosing;
        let is_compared = viewer.comparison.with == With::Nothing || self.pair.second.is_some();
        let is_built = viewer.layers.is_empty() || self.pair.first.is_some() && is_compared;
        is_asked
            && is_measured
            && is_read
            && is_built
            && !viewer.comparison.is_drawing
            && !viewer.building.contains(&true)
            && !viewer.is_stale
    }

    /// Hears what threads report, without showing anything.
    pub fn hear(&mut self) {
        self.viewer.jobs.news().into_iter().for_each(|news| self.take(news));
    }

    /// Waits until another frame may be on its way: before its input is taken, so that this is as fresh as can be.
    pub fn make_room(&mut self) -> Result<()> {
        self.screen.make_room(&mut self.pair)
    }

    /// Prepares and shows one frame of a window of `size` pixels. `input` is what happened since it was taken last.
    pub fn turn(&mut self, input: impl FnOnce() -> RawInput, size: [u32; 2]) -> Result<Turn> {
        let now = Instant::now();
        self.viewer.is_stale |= self.viewer.size != size;
        self.viewer.size = size;
        self.hear();
        self.land(false)?;
        // More often than twice a refresh, nobody sees panels or moves a hand.
        let layout_stays = Duration::from_secs_f64(self.viewer.refresh_ms / 2000.0);
        let stays = self.laid.at.map(|at| layout_stays.saturating_sub(now - at)).unwrap_or_default();
        let (platform, wishes) = if stays.is_zero() {
            self.lay_out(input(), now)?
        } else if self.viewer.is_stale {
            Default::default()
        } else {
            // Too early to ask hands, and nothing to draw.
            return Ok(Turn { platform: None, again_in: stays, wishes: Vec::new(), shown: Shown::Yes });
        };
        for (is_error, text) in self.viewer.messages.fresh() {
            self.viewer.events.tell(&Event::Message { is_error, text });
        }
        self.build();
        self.fit_picture()?;
        self.look()?;
        self.viewer.is_stale |= self.lacks_size();
        let draws = self.viewer.is_stale;
        if draws {
            self.draw()?;
        }
        // What changed no picture needs no answer.
        self.viewer.input_at = None;
        let shown = self.screen.show(&mut self.pair, &arrangement(&self.viewer, &self.laid))?;
        if shown == Shown::Yes {
            self.note_shown(now, draws);
        }
        let again_in = self.again_in();
        self.before = Some((now, draws && again_in <= layout_stays));
        Ok(Turn { platform, again_in, wishes, shown })
    }

    /// Lets hands act and lays the panels out; what whoever owns the window has to do then.
    fn lay_out(&mut self, input: RawInput, now: Instant) -> Result<(Option<PlatformOutput>, Vec<Wish>)> {
        let seconds = self.laid.at.map_or(0.0, |before| (now - before).as_secs_f64());
        let moved_before = self.viewer.view();
        let (viewer, pair) = (&mut self.viewer, &self.pair);
        if !input.events.is_empty() {
            viewer.input_at.get_or_insert(now);
        }
        let output = self.context.clone().run_ui(input, |ui| {
            hands::follow(viewer, ui, seconds.min(0.1));
            panels::show(viewer, pair, ui);
        });
        let FullOutput { platform_output, textures_delta, shapes, pixels_per_point, viewport_output, .. } = output;
        self.screen.add_textures(textures_delta);
        let again_in = viewport_output.values().map(|viewport| viewport.repaint_delay).min().unwrap_or(Duration::MAX);
        let triangles = self.context.tessellate(shapes, pixels_per_point);
        self.laid = Laid { at: Some(now), triangles, pixels_per_point, again_in };
        let mut wishes = std::mem::take(&mut self.viewer.wishes);
        self.grant(&mut wishes)?;
        self.viewer.is_stale |= self.viewer.view() != moved_before;
        Ok((Some(platform_output), wishes))
    }

    /// Whether a picture has another size than the window.
    fn lacks_size(&self) -> bool {
        self.pair.first.as_ref().is_some_and(|drawn| drawn.still.size() != self.viewer.size)
    }

    fn draw(&mut self) -> Result<()> {
        let (camera, background) = (self.viewer.view(), self.viewer.background);
        // At a new size there is nothing to show in place of a frame that does not find room.
        for (_, drawn) in self.pair.drawn() {
            if drawn.still.size() != camera.size_px {
                drawn.still.render(&camera, background)?;
            }
        }
        self.screen.draw(&mut self.pair, &camera, background)?;
        self.viewer.is_stale = false;
        self.viewer.pace.drawn += u64::from(self.pair.first.is_some());
        if let Some(at) = self.viewer.input_at.take() {
            self.viewer.pace.answer(at.elapsed().as_secs_f64() * 1e3);
        }
        Ok(())
    }

    fn look(&mut self) -> Result<()> {
        let mut has_changed = false;
        for (side, drawn) in self.pair.drawn() {
            has_changed |= self.viewer.looks.apply(side, drawn)?;
        }
        if has_changed {
            self.viewer.is_stale = true;
            self.viewer.history.clear();
        }
        // Some ways of looking show other sides of the same drawing.
        if has_changed || self.sight != self.viewer.looks.sight {
            self.sight = self.viewer.looks.sight;
            self.viewer.events.tell(&Event::Look { look: self.viewer.looks.sight().name.to_owned() });
        }
        Ok(())
    }

    /// Learns from the frames that are done; whether there is something new to show. `wait`: from all of them.
    pub fn land(&mut self, wait: bool) -> Result<bool> {
        let landed = self.screen.landed(&mut self.pair, wait)?;
        let has_news = !landed.is_empty();
        for landed in landed {
            self.viewer.history.add(&landed.timings);
            for (side, totals) in landed.pictures {
                // It did not fit: again, with more room.
                self.viewer.is_stale |= totals.is_none();
                if let (Some(totals), Side::First, Some(first)) = (totals, side, &mut self.pair.first) {
                    first.frame.totals = totals;
                }
            }
        }
        Ok(has_news)
    }

    /// Does what the device is needed for; leaves the rest.
    fn grant(&mut self, wishes: &mut Vec<Wish>) -> Result<()> {
        let mut error = None;
        wishes.retain(|wish| match *wish {
            Wish::Pick(pixel) | Wish::Focus(pixel) => {
                if let (Some(first), None) = (&mut self.pair.first, &error) {
                    match first.still.explain(pixel) {
                        Ok(explanation) if matches!(wish, Wish::Pick(_)) => {
                            let colour = explanation.colour(self.viewer.background);
                            let splats = explanation.splats.len();
                            self.viewer.events.tell(&Event::Explained { pixel, splats, colour });
                            self.viewer.explanation = Some((pixel, explanation));
                        }
                        Ok(explanation) => hands::focus(&mut self.viewer, pixel, explanation.depth()),
                        Err(problem) => error = Some(problem),
                    }
                }
                false
            }
            Wish::WritePicture => {
                self.viewer.write_picture(self.screen.device(), kept(&self.pair));
                false
            }
            Wish::WriteFilm => {
                self.viewer.write_film(self.screen.device(), kept(&self.pair));
                false
            }
            Wish::Measure | Wish::Choose => {
                self.start_measuring(matches!(wish, Wish::Choose));
                false
            }
            _ => true,
        });
        error.map_or(Ok(()), Err)
    }

    fn start_measuring(&mut self, chooses: bool) {
        let Some(first) = &self.pair.first else { return };
        let device = self.screen.device().clone();
        self.viewer.start_measuring(device, (first.gaussians.clone(), first.needs.clone()), chooses);
    }

    fn note_shown(&mut self, now: Instant, draws: bool) {
        let viewer = &mut self.viewer;
        viewer.pace.shown += 1;
        if let (Some((before, true)), true) = (self.before, draws) {
            viewer.pace.interval((now - before).as_secs_f64() * 1e3, viewer.refresh_ms);
        }
        let is_whole = !viewer.is_reading();
        if !self.has_shown_scene && self.pair.first.is_some() {
            self.has_shown_scene = is_whole;
            viewer.events.tell(&Event::FirstFrame { ms: viewer.started.elapsed().as_secs_f64() * 1e3, is_whole });
        }
    }

    /// When the next frame is due, if nothing happens before.
    fn again_in(&self) -> Duration {
        let viewer = &self.viewer;
        if viewer.is_stale || viewer.navigator.is_gliding() || viewer.film.is_playing {
            return Duration::ZERO;
        }
        let flicker = viewer.comparison.until_flicker(viewer.started.elapsed().as_secs_f64());
        let note = viewer.messages.next_change().unwrap_or(Duration::MAX);
        self.laid.again_in.min(flicker).min(note)
    }

    /// How it went.
    pub fn closing(&self) -> Event {
        let pace = &self.viewer.pace;
        Event::Closed {
            frames_shown: pace.shown,
            frames_drawn: pace.drawn,
            frames_dropped: pace.dropped,
            mean_latency_ms: pace.mean_latency_ms,
            gpu_bytes: self.screen.device().allocated_bytes(),
        }
    }
}

/// What of the first picture files can be drawn from.
fn kept(pair: &Pair) -> Option<Kept> {
    pair.first.as_ref().map(Drawn::kept)
}

/// What is shown of the pictures, and over them.
fn arrangement<'a>(viewer: &Viewer, laid: &'a Laid) -> Arrangement<'a> {
    let compare = match viewer.shows_another_view() {
        true => Compare::First,
        false => viewer.comparison.shown(viewer.size[0], viewer.started.elapsed().as_secs_f64()),
    };
    // A difference is one of what would be shown.
    let quantity = match compare {
        Compare::Difference(_) => Quantity::Colour,
        _ => viewer.looks.quantity(),
    };
    Arrangement { compare, quantity, triangles: &laid.triangles, pixels_per_point: laid.pixels_per_point }
}
