//! The window: passes events to the session, shows its frames, and recovers from a lost device or surface.
//!
//! - `setup` - the settings of a window
//! - `offscreen` - the viewer without a window
//! - `fault` - faults injected by SMALTO_FAULT

mod fault;
mod offscreen;
mod setup;

pub use fault::Fault;
pub use offscreen::{Offscreen, PATH_FPS, PageCounts, Summary, run as run_offscreen};
pub use setup::{DEFAULT_SIZE, WindowSetup};

use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result};
use winit::application::ApplicationHandler;
use winit::dpi::PhysicalSize;
use winit::event::{StartCause, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop, EventLoopProxy};
use winit::window::{Fullscreen, Window, WindowId};

use self::fault::FaultKind;
use crate::gpu::{Device, DeviceLost, Unavailable, different_kinds};
use crate::host_memory::OutOfMemory;
use crate::viewer::frame::{FrameOutput, Screen, Session, Shown};
use crate::viewer::model::{Event, Jobs, Viewer, WindowRequest};
#[cfg(unix)]
use crate::viewer::remote::Control;

/// Wakes the event loop: a job has sent an event.
#[derive(Debug)]
struct Wake;

/// Opens a window and returns when it is closed.
///
/// # Errors
/// No window can be opened, the device is lost again and again, or the validation layer reported something.
pub fn run(setup: WindowSetup) -> Result<()> {
    let events = EventLoop::<Wake>::with_user_event().build().map_err(|e| no_window(&e))?;
    let proxy = events.create_proxy();
    #[cfg(unix)]
    let control = {
        let proxy = proxy.clone();
        let wake = Arc::new(move || drop(proxy.send_event(Wake)));
        setup.control.as_deref().map(|path| Control::listen(path, wake)).transpose()?
    };
    let mut app = App {
        setup,
        proxy,
        window: None,
        failure: None,
        started: Instant::now(),
        #[cfg(unix)]
        control,
    };
    events.run_app(&mut app).context("the event loop of the window failed")?;
    let validation = app.window.take().map_or_else(Vec::new, OpenWindow::close);
    match app.failure {
        Some(failure) => Err(failure),
        None => {
            anyhow::ensure!(validation.is_empty(), "validation: {}", validation.join("\n"));
            Ok(())
        }
    }
}

/// The reason why no window can be opened, without the source location that winit puts before it.
fn no_window(problem: &dyn std::error::Error) -> Unavailable {
    let text = problem.to_string();
    let reason = text.rsplit_once(".rs:").and_then(|(_, rest)| Some(rest.split_once(": ")?.1)).unwrap_or(&text);
    Unavailable(format!("no window can be opened: {}", reason.trim_end_matches('.')))
}

struct App {
    setup: WindowSetup,
    proxy: EventLoopProxy<Wake>,
    window: Option<OpenWindow>,
    failure: Option<anyhow::Error>,
    started: Instant,
    #[cfg(unix)]
    control: Option<Control>,
}

/// An open window.
struct OpenWindow {
    session: Session,
    input: egui_winit::State,
    window: Arc<Window>,
    /// When the next frame is due.
    due: Option<Instant>,
    is_hidden: bool,
    frames: u64,
    title: String,
    /// Devices lost in a row, with no frame shown between them.
    losses: u32,
    fault: Option<Fault>,
    #[cfg(unix)]
    control: Option<Control>,
    /// Validation messages of devices that were lost.
    validation: Vec<String>,
}

/// Interval at which frames in flight are polled.
const POLL: Duration = Duration::from_millis(2);

/// Losses in a row after which the device counts as broken.
const MAX_LOSSES: u32 = 3;

impl App {
    fn open(&mut self, events: &ActiveEventLoop) -> Result<OpenWindow> {
        let setup = &self.setup;
        let monitor = events.primary_monitor().or_else(|| events.available_monitors().next());
        let window = events
            .create_window(setup.attributes(monitor.as_ref()))
            .map_err(|e| Unavailable(format!("no window can be opened: {e}")))?;
        let window = Arc::new(window);
        let device = setup.open_device(&window)?;
        let all = Vec::from_iter(setup.viewer.other_devices.iter().chain([&device]).cloned());
        different_kinds(&all).iter().for_each(|note| (setup.viewer.remark)(note));
        let size = window.inner_size();
        let screen = Screen::of_window(&device, &window, setup.viewer.vsync)?;
        let proxy = self.proxy.clone();
        let wake = Arc::new(move || drop(proxy.send_event(Wake)));
        let mut viewer = Viewer::new(setup.viewer.clone(), Jobs::new(wake), [size.width.max(1), size.height.max(1)]);
        viewer.timing.started = self.started;
        if let Some(refresh) = window.current_monitor().and_then(|monitor| monitor.refresh_rate_millihertz()) {
            viewer.timing.refresh_ms = 1e6 / f64::from(refresh.max(1));
        }
        viewer.events.emit(&Event::Open { device: device.capabilities().name.clone(), size: viewer.view.size });
        let context = egui::Context::default();
        let input = input_of(&context, &window);
        window.request_redraw();
        let session = Session::new(viewer, screen, context);
        let fault = setup.fault;
        Ok(OpenWindow {
            session,
            input,
            window,
            due: None,
            is_hidden: false,
            frames: 0,
            title: String::new(),
            losses: 0,
            fault,
            #[cfg(unix)]
            control: self.control.take(),
            validation: Vec::new(),
        })
    }

    fn fail(&mut self, events: &ActiveEventLoop, failure: anyhow::Error) {
        self.failure = Some(failure);
        events.exit();
    }
}

fn input_of(context: &egui::Context, window: &Window) -> egui_winit::State {
    let scale = Some(window.scale_factor() as f32);
    egui_winit::State::new(context.clone(), egui::ViewportId::ROOT, window, scale, window.theme(), None)
}

impl ApplicationHandler<Wake> for App {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        if self.window.is_none() {
            match self.open(events) {
                Ok(open) => self.window = Some(open),
                Err(failure) => self.fail(events, failure),
            }
        }
    }

    fn new_events(&mut self, events: &ActiveEventLoop, cause: StartCause) {
        if let (StartCause::ResumeTimeReached { .. }, Some(open)) = (cause, &mut self.window)
            && let Err(failure) = open.poll().or_else(|failure| open.recover(failure, &self.setup))
        {
            self.fail(events, failure);
        }
    }

    fn user_event(&mut self, _: &ActiveEventLoop, _: Wake) {
        if let Some(open) = &mut self.window {
            // A hidden window draws no frames, so the events of jobs are handled here.
            if open.is_hidden {
                open.session.poll_jobs();
                open.refuse_program();
            }
            open.window.request_redraw();
        }
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let Some(open) = &mut self.window else { return };
        let response = open.input.on_window_event(&open.window, &event);
        let outcome = match event {
            WindowEvent::CloseRequested => {
                events.exit();
                Ok(())
            }
            WindowEvent::Resized(size) => open.resize(size),
            WindowEvent::RedrawRequested => open.frame(events),
            _ => {
                if response.repaint {
                    open.session.viewer.timing.input_at.get_or_insert_with(Instant::now);
                    open.window.request_redraw();
                }
                Ok(())
            }
        };
        if let Err(failure) = outcome.or_else(|failure| open.recover(failure, &self.setup)) {
            self.fail(events, failure);
        }
    }

    fn about_to_wait(&mut self, events: &ActiveEventLoop) {
        let Some(open) = &self.window else { return };
        let poll = open.session.screen.is_busy().then(|| Instant::now() + POLL);
        let next = [open.due, poll, open.session.shader_poll_due()].into_iter().flatten().min();
        events.set_control_flow(next.map_or(ControlFlow::Wait, ControlFlow::WaitUntil));
    }

    fn exiting(&mut self, _: &ActiveEventLoop) {
        if let Some(open) = &mut self.window {
            // Wait for the frames in flight; a device lost now does not matter.
            let _ = open.session.retire_frames(true);
            if open.window.fullscreen().is_none() && !open.window.is_maximized() {
                let size = open.window.inner_size();
                open.session.viewer.panels.recent.size = Some([size.width, size.height]);
            }
            open.session.viewer.save_recent_state();
            open.session.viewer.events.emit(&open.session.closing());
        }
    }
}

impl OpenWindow {
    /// Closes the window; returns all validation messages.
    fn close(self) -> Vec<String> {
        let mut devices = self.session.viewer.setup.other_devices.clone();
        devices.push(self.session.screen.device().clone());
        let mut messages = self.validation;
        drop(self.session);
        messages.extend(devices.iter().flat_map(Device::validation_messages));
        messages
    }

    /// Takes the results of finished frames, polls for changed shaders, and requests a frame that is due.
    fn poll(&mut self) -> Result<()> {
        let has_results = self.session.retire_frames(false)?;
        let has_news = has_results | self.session.poll_shaders();
        let is_due = self.due.is_some_and(|due| due <= Instant::now());
        if has_news && !self.is_hidden || is_due {
            self.window.request_redraw();
        }
        Ok(())
    }

    fn resize(&mut self, size: PhysicalSize<u32>) -> Result<()> {
        let size = [size.width, size.height];
        let shown = self.session.screen.fit(size);
        self.session.viewer.events.emit(&Event::Resized { size });
        self.handle_shown(shown)?;
        self.window.request_redraw();
        Ok(())
    }

    fn frame(&mut self, events: &ActiveEventLoop) -> Result<()> {
        self.due = None;
        let Some(size) = self.session.screen.size() else {
            self.hide(true);
            return Ok(());
        };
        self.frames += 1;
        let fault = self.fault.take_if(|fault| fault.frame == self.frames).map(|fault| fault.kind);
        let output = match fault {
            Some(FaultKind::DeviceLost) => {
                Err(DeviceLost("the GPU was lost (injected by SMALTO_FAULT)".to_owned()).into())
            }
            Some(FaultKind::OutOfMemory) => Err(OutOfMemory {
                name: "a buffer".to_owned(),
                bytes: Some(1 << 50),
                reason: "injected by SMALTO_FAULT".to_owned(),
            }
            .into()),
            Some(FaultKind::SurfaceLost) => {
                self.handle_shown(Ok(Shown::Lost))?;
                self.window.request_redraw();
                return Ok(());
            }
            None => self.session.wait_for_slot().and_then(|()| {
                self.hear_program();
                let input = || self.input.take_egui_input(&self.window);
                self.session.frame(input, size)
            }),
        };
        self.finish(output?, events)
    }

    /// Handles the output of a frame, and executes its requests to the window.
    fn finish(&mut self, output: FrameOutput, events: &ActiveEventLoop) -> Result<()> {
        let FrameOutput { platform, repaint_delay, requests, shown } = output;
        let is_handled = platform.is_some();
        if let Some(platform) = platform {
            self.input.handle_platform_output(&self.window, platform);
        }
        for request in requests {
            self.execute(request, events)?;
        }
        self.hide(shown == Shown::Hidden);
        if shown == Shown::Yes {
            self.losses = 0;
        }
        let title = self.session.title();
        if title != self.title {
            self.window.set_title(&title);
            self.title = title;
        }
        if shown != Shown::Yes && shown != Shown::Hidden {
            let size = self.window.inner_size();
            let shown = match shown {
                Shown::Again => self.session.screen.fit([size.width, size.height]),
                other => Ok(other),
            };
            self.handle_shown(shown)?;
            self.window.request_redraw();
        } else if repaint_delay.is_zero() {
            self.window.request_redraw();
        } else if repaint_delay < Duration::from_secs(3600) {
            self.due = Some(Instant::now() + repaint_delay);
        }
        self.tell_program(is_handled);
        Ok(())
    }

    /// Does what a program has said that controls the window.
    fn hear_program(&mut self) {
        #[cfg(unix)]
        if let Some(control) = &mut self.control {
            let events = control.hear(&mut self.session);
            self.input.egui_input_mut().events.extend(events);
        }
    }

    /// Refuses what a program has said, since the window has no pixels.
    fn refuse_program(&mut self) {
        #[cfg(unix)]
        if let Some(control) = &mut self.control {
            control.refuse(&mut self.session);
        }
    }

    /// Tells the program what has changed.
    #[cfg_attr(not(unix), expect(unused_variables))]
    fn tell_program(&mut self, is_handled: bool) {
        #[cfg(unix)]
        if let Some(next) = self.control.as_mut().and_then(|control| control.tell_news(&mut self.session, is_handled)) {
            self.due = Some(self.due.map_or(next, |due| due.min(next)));
        }
    }

    fn execute(&mut self, request: WindowRequest, events: &ActiveEventLoop) -> Result<()> {
        match request {
            WindowRequest::ToggleFullScreen => {
                let full = self.window.fullscreen().is_none().then_some(Fullscreen::Borderless(None));
                self.window.set_fullscreen(full);
            }
            WindowRequest::Quit => events.exit(),
            WindowRequest::Vsync(vsync) => {
                self.session.viewer.timing.vsync = vsync;
                let size = self.window.inner_size();
                let shown = self.session.screen.set_vsync(vsync, [size.width, size.height]);
                self.handle_shown(shown)?;
            }
            WindowRequest::Copy(text) => self.input.set_clipboard_text(text),
            WindowRequest::CopyPicture(image) => {
                let commands = vec![egui::OutputCommand::CopyImage(image)];
                self.input
                    .handle_platform_output(&self.window, egui::PlatformOutput { commands, ..Default::default() });
            }
        }
        Ok(())
    }

    fn hide(&mut self, is_hidden: bool) {
        if self.is_hidden != is_hidden {
            self.is_hidden = is_hidden;
            self.session.viewer.events.emit(&Event::Hidden { is_hidden });
        }
    }

    /// Opens a new surface if the surface is lost.
    fn handle_shown(&mut self, shown: Result<Shown>) -> Result<()> {
        if shown? == Shown::Lost {
            let device = self.session.screen.device().clone();
            self.session.retire_frames(true)?;
            // A window can have only one surface at a time.
            self.session.screen.close();
            self.session.viewer.messages.note("the window's surface was lost and is open again");
            self.session.screen = Screen::of_window(&device, &self.window, self.session.viewer.timing.vsync)?;
            self.session.reset_font_atlas();
            self.reset_input();
        }
        Ok(())
    }

    /// Recovers from a lost device by opening it again, and from a lack of memory or a changed shader that does not
    /// compile by dropping the pictures. Returns other failures.
    fn recover(&mut self, failure: anyhow::Error, setup: &WindowSetup) -> Result<()> {
        let viewer = &mut self.session.viewer;
        if failure.is::<OutOfMemory>() {
            viewer.messages.error(format!("there is not enough memory: {failure:#}. Close or hide a scene"));
            self.session.drop_pictures();
        } else if failure.is::<DeviceLost>() && self.losses < MAX_LOSSES {
            self.losses += 1;
            self.validation.extend(self.session.screen.device().validation_messages());
            viewer.messages.error(format!("{failure:#}; the device is opened again"));
            self.session.close();
            let device = setup.open_device(&self.window)?;
            let screen = Screen::of_window(&device, &self.window, self.session.viewer.timing.vsync)?;
            self.session.replace_screen(screen);
            self.reset_input();
        } else if viewer.pictures.shaders.is_some() && !failure.is::<DeviceLost>() {
            viewer.messages.error(format!("{failure:#}"));
            self.session.drop_pictures();
        } else {
            return Err(failure);
        }
        self.window.request_redraw();
        Ok(())
    }

    /// Connects the input to the new context of the session.
    fn reset_input(&mut self) {
        self.input = input_of(self.session.context(), &self.window);
    }
}
