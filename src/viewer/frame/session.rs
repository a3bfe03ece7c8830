//! A viewer with its device, without the window: handles job events, lays panels out, draws and shows pictures.

use std::time::{Duration, Instant};

use anyhow::Result;
use egui::{ClippedPrimitive, FullOutput, PlatformOutput, RawInput};

use super::job_events;
use super::screen::{Arrangement, RetiredPicture, Screen, Shown};
use crate::gpu::DeviceLost;
use crate::measure::bench::ClockProbe;
use crate::render::{Compare, Inspection, LostDevice, Marker, Quantity};
use crate::rules::Response;
use crate::viewer::model::{
    CompareTarget, Counts, Event, InspectionSettings, Pair, Request, Side, Viewer, WindowRequest, needs_whole,
};
use crate::viewer::panels;

/// The interval at which the shaders that are compiled at run time are checked for changes.
const SHADER_POLL: Duration = Duration::from_millis(250);

/// The interval of polls for loaded pages.
const PAGES_POLL: Duration = Duration::from_millis(4);

/// The least time between readings of the device's clocks.
const CLOCKS_POLL: Duration = Duration::from_millis(500);

/// A viewer with the device that it draws on.
pub struct Session {
    pub viewer: Viewer,
    pub pair: Pair,
    pub screen: Screen,
    context: egui::Context,
    /// When the previous frame was prepared, and whether another one was due right after it.
    previous: Option<(Instant, bool)>,
    /// Set once a frame with a scene was shown: true if it showed the whole scene.
    has_shown: Option<bool>,
    shaders_polled: Option<Instant>,
    /// The reader of the device's clocks, and when it read them last.
    clocks: Option<(ClockProbe, Instant)>,
    layout: UiLayout,
    /// Number of messages in the last layout.
    laid_out_messages: usize,
    /// The settings in the last event about the inspection.
    reported: InspectionSettings,
    /// Notices about the paths that were reported.
    reported_notices: Vec<String>,
    /// Marks Gaussians on the device, once an edit needs it.
    pub(super) marker: Option<Marker>,
    /// The numbers in the last event about edits.
    pub(super) reported_edits: Counts,
    /// The last event about pages: true if no page was loading, and true if no page was missing.
    pub(crate) reported_pages: Option<(bool, bool)>,
}

/// The last layout of the panels.
struct UiLayout {
    at: Option<Instant>,
    triangles: Vec<ClippedPrimitive>,
    pixels_per_point: f32,
    /// The time after which the panels need another layout.
    repaint_delay: Duration,
}

/// The results of a frame for the owner of the window.
pub struct FrameOutput {
    /// The platform output of egui; `None` if the panels were not laid out.
    pub platform: Option<PlatformOutput>,
    /// The time until the next frame is due, if nothing happens before.
    pub repaint_delay: Duration,
    pub requests: Vec<WindowRequest>,
    pub shown: Shown,
}

impl Session {
    /// A session that opens the scenes of the viewer's setup.
    pub fn new(mut viewer: Viewer, screen: Screen, context: egui::Context) -> Self {
        viewer.open_setup();
        panels::theme::set(&context);
        Self {
            reported: InspectionSettings::default(),
            reported_notices: Vec::new(),
            reported_pages: None,
            marker: None,
            reported_edits: Counts::default(),
            viewer,
            pair: Pair::default(),
            screen,
            context,
            previous: None,
            laid_out_messages: 0,
            has_shown: None,
            shaders_polled: None,
            clocks: None,
            layout: UiLayout { at: None, triangles: Vec::new(), pixels_per_point: 1.0, repaint_delay: Duration::MAX },
        }
    }

    pub fn context(&self) -> &egui::Context {
        &self.context
    }

    /// Replaces a screen whose device was lost. The pictures are built again.
    pub fn replace_screen(&mut self, screen: Screen) {
        self.pair = Pair::default();
        (self.marker, self.clocks) = (None, None);
        let editing = &mut self.viewer.editing;
        (editing.values, editing.contributions, editing.is_finding) = (None, None, false);
        self.viewer.requests.retain(|request| !matches!(request, Request::Select(_)));
        self.screen = screen;
        self.reset_font_atlas();
        (self.viewer.pictures.building, self.viewer.pictures.is_sharing) = ([None; 2], false);
        self.viewer.pictures.refused = [None, None];
        self.viewer.pictures.are_stale = true;
        self.viewer.comparison.is_stale = true;
    }

    /// Frees the memory of a lost device, before it is opened again.
    pub fn close(&mut self) {
        self.drop_pictures();
        self.screen.close();
    }

    /// Drops the pictures and their memory, and does not build them again before their plans change.
    pub fn drop_pictures(&mut self) {
        for (side, _) in self.pair.drawn() {
            self.viewer.pictures.refused[side as usize] = self.viewer.shown_plan(side).ok().flatten();
        }
        self.pair = Pair::default();
        self.viewer.pictures.are_stale = true;
    }

    /// Makes the panels upload their font atlas again, for another surface.
    pub fn reset_font_atlas(&mut self) {
        let (context, style) = (egui::Context::default(), self.context.global_style());
        panels::theme::set(&context);
        context.set_global_style(style);
        self.context = context;
        self.layout.at = None;
        self.layout.triangles.clear();
    }

    /// True if everything that was requested is read, built, drawn and on the screen, and no job measures or writes.
    pub fn is_settled(&self) -> bool {
        let viewer = &self.viewer;
        let works = viewer.export.progress.is_some() || viewer.measuring.running.is_some();
        !works && !viewer.pictures.is_sharing && self.is_at_rest()
    }

    /// True if all pictures are built that can be.
    pub fn is_built(&self) -> bool {
        let viewer = &self.viewer;
        let [is_first_refused, is_second_refused] = viewer.pictures.refused.each_ref().map(Option::is_some);
        let is_compared = viewer.comparison.target == CompareTarget::Nothing || self.pair.second.is_some();
        let has_first = is_first_refused || self.pair.first.is_some() && (is_compared || is_second_refused);
        !viewer.pictures.is_any_building() && (has_first || self.draws_nothing())
    }

    /// True if no scene is shown.
    pub fn draws_nothing(&self) -> bool {
        self.viewer.shown_plan(Side::First).is_ok_and(|plan| plan.is_none())
    }

    /// True if everything that was requested is read, built, drawn and on the screen. Jobs may measure or write.
    pub fn is_at_rest(&self) -> bool {
        let viewer = &self.viewer;
        let is_read = !viewer.scenes.are_loading() && !viewer.cameras.are_loading;
        viewer.requests.is_empty()
            && is_read
            && self.is_built()
            && !viewer.comparison.is_loading
            && !viewer.comparison.is_measuring
            && !(viewer.needs_snapshot() && viewer.inspector.snapshot.is_none() && self.pair.first.is_some())
            && self.residency().is_none_or(|residency| residency.is_settled())
            && self.has_full_scale()
            && !self.is_to_be_measured()
            && !viewer.has_running_edits()
            && !viewer.view.navigator.is_gliding()
            && !viewer.pictures.are_stale
    }

    /// Handles the events of jobs, without showing anything.
    pub fn poll_jobs(&mut self) {
        for event in self.viewer.jobs.poll() {
            job_events::handle(&mut self.viewer, &mut self.pair, self.screen.device(), event);
        }
    }

    /// Polls for changed shaders, at most once per [`SHADER_POLL`], if shaders are compiled at run time. Returns true
    /// if they changed: the next frame then starts another build.
    pub fn poll_shaders(&mut self) -> bool {
        if self.shaders_polled.is_some_and(|polled| polled.elapsed() < SHADER_POLL) {
            return false;
        }
        self.shaders_polled = Some(Instant::now());
        let newest = self.screen.device().newest_shader();
        std::mem::replace(&mut self.viewer.pictures.shaders, newest) != newest
    }

    /// The time of the next [`Session::poll_shaders`]; `None` if all shaders are built in.
    pub fn shader_poll_due(&self) -> Option<Instant> {
        self.viewer.pictures.shaders?;
        Some(self.shaders_polled? + SHADER_POLL)
    }

    /// Makes another layout due.
    pub(super) fn request_layout(&mut self) {
        self.layout.repaint_delay = Duration::ZERO;
    }

    /// Waits until another frame may be submitted. Call it before taking the input, so that the input is recent.
    pub fn wait_for_slot(&mut self) -> Result<()> {
        self.screen.wait_for_slot(&mut self.pair)
    }

    /// Prepares and shows one frame of a window of `size` pixels. `input` returns the input since its last call; it is
    /// called only if the panels are laid out.
    pub fn frame(&mut self, input: impl FnOnce() -> RawInput, size: [u32; 2]) -> Result<FrameOutput> {
        let now = Instant::now();
        if size != self.viewer.view.window_size {
            let panels = self.viewer.view.window_size[0].saturating_sub(self.viewer.view.size[0]);
            self.viewer.pictures.are_stale |=
                self.viewer.view.set_sizes(size, [size[0].saturating_sub(panels), size[1]]);
        }
        // The size of the picture is known after the first layout.
        if self.layout.at.is_some() {
            self.poll_jobs();
        }
        self.poll_shaders();
        self.retire_frames(false)?;
        self.update_motion();
        self.poll_pages();
        self.report_notices();
        // Two layouts per refresh are enough for panels and input.
        let layout_lifetime = Duration::from_secs_f64(self.viewer.timing.refresh_ms / 2000.0);
        let remaining = self.layout.at.map(|at| layout_lifetime.saturating_sub(now - at)).unwrap_or_default();
        let (platform, requests) = if remaining.is_zero() {
            self.lay_out_ui(input(), now)?
        } else if self.viewer.pictures.are_stale {
            Default::default()
        } else {
            // It is too early for input, and there is nothing to draw.
            return Ok(FrameOutput {
                platform: None,
                repaint_delay: remaining,
                requests: Vec::new(),
                shown: Shown::Yes,
            });
        };
        for (is_error, text) in self.viewer.messages.take_new() {
            self.viewer.events.emit(&Event::Message { is_error, text });
        }
        let device = self.screen.device();
        job_events::build(&mut self.viewer, &mut self.pair, device);
        job_events::fit_picture(&mut self.viewer, &mut self.pair, device)?;
        self.apply_edits(None)?;
        self.prepare_values()?;
        self.report_edits();
        self.apply_inspection()?;
        self.viewer.pictures.are_stale |= self.has_wrong_size() || self.pair.lacks(self.quantity());
        let draws = self.viewer.pictures.are_stale;
        if draws {
            self.draw()?;
        }
        // An input that changed no picture does not count for the latency.
        self.viewer.timing.input_at = None;
        let arrangement = arrangement(&self.viewer, &self.pair, &self.layout);
        let shown = self.screen.show(&mut self.pair, &arrangement)?;
        if shown == Shown::Yes {
            self.record_shown(now, draws);
            self.report_residency();
            self.take_snapshot()?;
            self.measure_levels()?;
        }
        let repaint_delay = self.repaint_delay();
        self.previous = Some((now, draws && repaint_delay <= layout_lifetime));
        Ok(FrameOutput { platform, repaint_delay, requests, shown })
    }

    /// Handles the input, lays the panels out and executes the requests; returns the output and the requests for the
    /// owner of the window. Slow frames can have several clicks, each of which has a layout of its own.
    fn lay_out_ui(&mut self, mut raw: RawInput, now: Instant) -> Result<(Option<PlatformOutput>, Vec<WindowRequest>)> {
        let mut seconds = self.layout.at.map_or(0.0, |at| (now - at).as_secs_f64());
        let view_before = self.viewer.view.camera();
        if !raw.events.is_empty() {
            self.viewer.timing.input_at.get_or_insert(now);
        }
        let (mut platform, mut requests) = (PlatformOutput::default(), Vec::new());
        let begun = Instant::now();
        for events in by_click(std::mem::take(&mut raw.events)) {
            let input = RawInput { events, ..raw.clone() };
            raw.dropped_files.clear();
            self.lay_out_once(input, (now, std::mem::take(&mut seconds)), &mut platform);
            requests.extend(self.execute_requests()?);
        }
        self.viewer.pictures.are_stale |= self.viewer.view.camera() != view_before;
        self.viewer.timing.layout_ms = begun.elapsed().as_secs_f64() * 1e3;
        Ok((Some(platform), requests))
    }

    /// One layout, of which `seconds` have passed since the one before.
    fn lay_out_once(&mut self, input: RawInput, (now, mut seconds): (Instant, f64), platform: &mut PlatformOutput) {
        let (viewer, pair) = (&mut self.viewer, &self.pair);
        let laid_out = &mut self.laid_out_messages;
        let output = self.context.clone().run_ui(input, |ui| {
            // A layout can take two passes: the second one has no events, and no time passes in it.
            let events = panels::handle_input(viewer, ui, std::mem::take(&mut seconds));
            panels::show(viewer, pair, ui, events);
            // Messages are placed on the lower edge with their height of the pass before.
            let messages = viewer.messages.shown().len();
            if std::mem::replace(laid_out, messages) != messages {
                ui.ctx().request_discard("there are other messages");
            }
        });
        let FullOutput { platform_output, textures_delta, shapes, pixels_per_point, viewport_output, .. } = output;
        platform.append(platform_output);
        self.screen.add_textures(textures_delta);
        let repaint_delay =
            viewport_output.values().map(|viewport| viewport.repaint_delay).min().unwrap_or(Duration::MAX);
        let triangles = self.context.tessellate(shapes, pixels_per_point);
        self.layout = UiLayout { at: Some(now), triangles, pixels_per_point, repaint_delay };
    }

    /// Reports, once each, the reasons why a picture is not drawn on the fast path.
    fn report_notices(&mut self) {
        for (_, drawn) in self.pair.drawn() {
            let Some(notice) = drawn.renderer.notice() else { continue };
            if !self.reported_notices.iter().any(|reported| reported == notice) {
                self.reported_notices.push(notice.to_owned());
                self.viewer.remark(notice);
                self.layout.repaint_delay = Duration::ZERO;
            }
        }
    }

    /// True if the picture does not have the size that the window has room for.
    fn has_wrong_size(&self) -> bool {
        self.pair.first.as_ref().is_some_and(|drawn| drawn.renderer.size() != self.viewer.view.size)
    }

    fn draw(&mut self) -> Result<()> {
        let (camera, background) = (self.viewer.view.camera(), self.viewer.view.background);
        let inspection = self.viewer.inspector.settings.inspection();
        if self.pair.drawn().any(|(_, drawn)| drawn.renderer.refused(&camera, Some(&inspection)).is_some()) {
            return Ok(()); // the picture by other options is being made
        }
        // At a new size no older picture can be shown in place of an incomplete frame, so the frame must be complete.
        for (_, drawn) in self.pair.drawn() {
            if drawn.renderer.size() != camera.size_px {
                drawn.renderer.render(&camera, background)?;
            }
        }
        let times_stages = self.shows_times();
        let quantity = self.quantity();
        self.screen.draw(&mut self.pair, (&camera, background), quantity, times_stages)?;
        self.report_lost_devices();
        self.viewer.pictures.view = Some(camera);
        (self.viewer.inspector.snapshot, self.viewer.inspector.depths) = (None, None);
        self.viewer.pictures.are_stale = false;
        self.viewer.timing.pace.drawn += u64::from(self.pair.first.is_some());
        if let Some(at) = self.viewer.timing.input_at.take() {
            self.viewer.timing.pace.answer(at.elapsed().as_secs_f64() * 1e3);
        }
        Ok(())
    }

    /// What the view mode shows of pictures.
    fn quantity(&self) -> Quantity {
        self.viewer.inspector.settings.quantity()
    }

    /// Says which of the other devices draw no bands any more.
    fn report_lost_devices(&mut self) {
        let Some(sharing) = self.pair.first.as_mut().and_then(|first| first.sharing.as_mut()) else { return };
        for LostDevice { place, name, error } in sharing.devices.take_lost() {
            let scene = sharing.scenes.remove(place);
            // Later pictures do not try a lost device again.
            if error.is::<DeviceLost>() {
                self.viewer.setup.other_devices.retain(|device| !scene.is_on(device));
            }
            self.viewer.remark(&format!("{name} draws no bands any more: {error:#}"));
        }
    }

    /// True if the times of stages are shown, in panels or elsewhere.
    fn shows_times(&self) -> bool {
        !self.viewer.panels.are_hidden || self.viewer.panels.are_elsewhere
    }

    /// Reads the clocks of the device after a frame. The first frame does not wait for the reader.
    fn read_clocks(&mut self) {
        if self.has_shown.is_none() || !self.shows_times() {
            return;
        }
        let device = self.screen.device();
        let (probe, read) = self.clocks.get_or_insert_with(|| (ClockProbe::new(device), Instant::now() - CLOCKS_POLL));
        if read.elapsed() >= CLOCKS_POLL {
            (self.viewer.timing.clocks, *read) = (probe.now(), Instant::now());
        }
    }

    /// Sets the inspection of the pictures, and reports a change.
    fn apply_inspection(&mut self) -> Result<()> {
        let mut has_changed = false;
        let inspection = self.viewer.inspector.settings.inspection();
        if self.pair.drawn().any(|(_, drawn)| drawn.gaussians.is_none() && !drawn.renderer.can_show(&inspection)) {
            self.viewer.messages.error(needs_whole("this look"));
            let InspectionSettings { mode, culled_from, isolated, .. } = &mut self.viewer.inspector.settings;
            (*mode, *culled_from, *isolated) = (0, None, None);
        }
        self.avoid_what_rays_do_not_show(&inspection);
        for (side, drawn) in self.pair.drawn() {
            has_changed |= self.viewer.inspector.settings.apply(side, drawn)?;
        }
        if has_changed {
            self.viewer.pictures.are_stale = true;
            self.viewer.timing.frame_times.clear();
        }
        // Some view modes show other channels of the same picture without a change of the inspection; and every new
        // picture gets the inspection without a change of the settings.
        if !self.viewer.inspector.settings.is_same(&self.reported) {
            self.reported = self.viewer.inspector.settings.clone();
            self.viewer.events.emit(&Event::Look { look: self.viewer.inspector.settings.view_mode().name.to_owned() });
        }
        Ok(())
    }

    /// Goes back to what can be drawn, with a message, where rays cannot show the scene or the look.
    fn avoid_what_rays_do_not_show(&mut self, inspection: &Inspection) {
        let camera = self.viewer.view.camera();
        let mut refused =
            |inspection| self.pair.drawn().find_map(|(_, drawn)| drawn.renderer.refused(&camera, inspection));
        let (of_look, of_scene) = (refused(Some(inspection)), refused(None));
        let Some(refused) = of_look else { return };
        let Viewer { inspector, view, options, messages, .. } = &mut self.viewer;
        let remedy = if of_scene.is_none() {
            let InspectionSettings { mode, culled_from, isolated, .. } = &mut inspector.settings;
            (*mode, *culled_from, *isolated) = (0, None, None);
            "colours are shown"
        } else if camera.lens.is_some() {
            view.navigator.set_lens(None);
            view.camera_index = None;
            "the view is a pinhole"
        } else {
            options.rules.response = Response::Screen;
            "the response is screen"
        };
        let sentence = refused.sentence([remedy, remedy]);
        if !messages.shown().iter().any(|message| message.text == sentence) {
            messages.error(sentence);
        }
        self.viewer.pictures.are_stale = true;
    }

    /// Takes the results of finished frames; returns true if there were any. With `wait`, waits for all frames.
    pub fn retire_frames(&mut self, wait: bool) -> Result<bool> {
        let retired = self.screen.retire(&mut self.pair, wait)?;
        let has_news = !retired.is_empty();
        if has_news {
            self.read_clocks();
        }
        for frame in retired {
            self.viewer.timing.frame_times.add(&frame.timings);
            self.keep_rate(&frame.timings);
            for RetiredPicture { side, path, totals, is_shared, gpu_ms } in frame.pictures {
                // An incomplete frame is drawn again, in larger buffers.
                self.viewer.pictures.are_stale |= totals.is_none();
                if let (Some(totals), Side::First, Some(first)) = (totals, side, &mut self.pair.first) {
                    first.frame.totals = totals;
                    first.path = path;
                    match &mut first.sharing {
                        Some(sharing) if is_shared => sharing.devices.learn_join(gpu_ms),
                        Some(sharing) => sharing.devices.learn_alone(gpu_ms),
                        None => {}
                    }
                }
            }
        }
        Ok(has_news)
    }

    /// Counts a frame that was shown.
    fn record_shown(&mut self, now: Instant, draws: bool) {
        let misses_pages = self.residency().is_some_and(|residency| residency.missing > 0);
        let viewer = &mut self.viewer;
        viewer.timing.pace.shown += 1;
        if let (Some((previous, true)), true) = (self.previous, draws) {
            viewer.timing.pace.interval((now - previous).as_secs_f64() * 1e3, viewer.timing.refresh_ms);
        }
        let Some(first) = self.pair.first.as_ref().filter(|_| self.has_shown != Some(true)) else { return };
        // Report the first frame with a scene, and the first frame of the whole scene.
        let is_whole = !viewer.scenes.are_loading() && viewer.is_current(&first.plan) && !misses_pages;
        if self.has_shown.is_none() || is_whole {
            self.has_shown = Some(is_whole);
            viewer.events.emit(&Event::FirstFrame { ms: viewer.timing.seconds() * 1e3, is_whole });
        }
    }

    /// The time until the next frame is due, if nothing happens before.
    fn repaint_delay(&self) -> Duration {
        let viewer = &self.viewer;
        let moves = viewer.pictures.are_stale || viewer.view.navigator.is_gliding() || viewer.film.is_playing;
        if moves || self.is_to_be_measured() {
            return Duration::ZERO;
        }
        let flicker = viewer.comparison.until_flicker(viewer.timing.seconds());
        let note = viewer.messages.next_change().unwrap_or(Duration::MAX);
        let pages = if self.residency().is_none_or(|pages| pages.is_settled()) { Duration::MAX } else { PAGES_POLL };
        self.layout.repaint_delay.min(flicker).min(note).min(pages).min(self.until_rest())
    }

    /// The current combination of pictures and panels.
    pub(crate) fn arrangement(&self) -> Arrangement<'_> {
        arrangement(&self.viewer, &self.pair, &self.layout)
    }

    /// The event for the end of the session.
    pub fn closing(&self) -> Event {
        let pace = &self.viewer.timing.pace;
        Event::Closed {
            frames_shown: pace.shown,
            frames_drawn: pace.drawn,
            frames_dropped: pace.dropped,
            mean_input_to_submission_ms: pace.mean_latency_ms,
            gpu_bytes: self.screen.device().allocated_bytes(),
        }
    }
}

/// Splits events so that each part has one click at most, or keys: a layout knows one position of the pointer, tells
/// one click of a widget from none, and does not tell whether a click or a key was first.
fn by_click(events: Vec<egui::Event>) -> Vec<Vec<egui::Event>> {
    use egui::Event::{Copy, Cut, Key, Paste, PointerButton, PointerMoved, Text};
    let mut parts = vec![Vec::new()];
    let (mut has_button, mut has_release, mut has_key) = (false, false, false);
    for event in events {
        let is_key = matches!(event, Key { pressed: true, .. } | Text(_) | Copy | Cut | Paste(_));
        let ends = match &event {
            PointerMoved(_) => has_button,
            PointerButton { pressed: true, .. } => has_release || has_key,
            _ => is_key && has_release,
        };
        if ends {
            parts.push(Vec::new());
            (has_button, has_release, has_key) = (false, false, false);
        }
        has_key |= is_key;
        if let PointerButton { pressed, .. } = event {
            (has_button, has_release) = (true, has_release || !pressed);
        }
        if let Some(part) = parts.last_mut() {
            part.push(event);
        }
    }
    parts
}

/// The current combination of pictures and panels.
fn arrangement<'a>(viewer: &Viewer, pair: &Pair, layout: &'a UiLayout) -> Arrangement<'a> {
    let compare = match viewer.mismatch(pair).is_some() {
        true => Compare::First,
        false => viewer.comparison.shown(viewer.view.size[0], viewer.timing.seconds()),
    };
    // A difference is computed from colours.
    let quantity = match compare {
        Compare::Difference(_) => Quantity::Colour,
        _ => viewer.inspector.settings.quantity(),
    };
    Arrangement { compare, quantity, triangles: &layout.triangles, pixels_per_point: layout.pixels_per_point }
}

#[cfg(test)]
mod tests {
    use egui::{Event, Key, Modifiers, PointerButton, pos2};

    use super::by_click;

    /// A click, and what is before and after it, are parts of their own.
    #[test]
    fn parts_of_events_have_one_click_each() {
        let moved = Event::PointerMoved(pos2(1.0, 2.0));
        let button = |pressed| Event::PointerButton {
            pos: pos2(1.0, 2.0),
            button: PointerButton::Primary,
            pressed,
            modifiers: Modifiers::NONE,
        };
        let key =
            Event::Key { key: Key::Z, physical_key: None, pressed: true, repeat: false, modifiers: Modifiers::NONE };
        let [press, release] = [true, false].map(button);
        let sizes = |events: &[&Event]| {
            let parts = by_click(events.iter().map(|event| (*event).clone()).collect());
            parts.iter().map(Vec::len).collect::<Vec<_>>()
        };
        assert_eq!(sizes(&[]), [0]);
        assert_eq!(sizes(&[&moved, &press, &release, &press, &release]), [3, 2]);
        assert_eq!(sizes(&[&moved, &press, &moved, &moved, &release, &moved]), [2, 3, 1]);
        assert_eq!(sizes(&[&key, &key, &press, &release, &key, &press]), [2, 2, 1, 1]);
    }
}
