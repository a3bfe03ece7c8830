//! The window itself: events to the session, frames back, and what to do when the device or the surface is gone.

use std::str::FromStr;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result};
use winit::application::ApplicationHandler;
use winit::dpi::PhysicalSize;
use winit::event::{StartCause, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop, EventLoopProxy};
use winit::window::{Fullscreen, Window, WindowId};

use super::events::Event;
use super::jobs::Jobs;
use super::screen::{Screen, Shown};
use super::session::{Session, Turn};
use super::state::{Setup, Viewer, Wish};
use crate::gpu::{Device, DeviceChoice, DeviceLost, Unavailable, Validation};
use crate::host_memory::OutOfMemory;

/// How a window is opened.
#[derive(Clone)]
pub struct Opening {
    pub setup: Setup,
    pub size: [u32; 2],
    pub is_full_screen: bool,
    pub device: DeviceChoice,
    pub validation: Validation,
    /// To see what comes of it.
    pub fault: Option<Fault>,
}

/// What is to go wrong, at which frame: `device@100`, `surface@100` or `memory@100`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fault {
    kind: FaultKind,
    frame: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum FaultKind {
    DeviceLost,
    SurfaceLost,
    OutOfMemory,
}

impl FromStr for Fault {
    type Err = anyhow::Error;

    fn from_str(text: &str) -> Result<Self> {
        let (kind, frame) = text.split_once('@').context("expected device@N, surface@N or memory@N")?;
        let kind = match kind {
            "device" => FaultKind::DeviceLost,
            "surface" => FaultKind::SurfaceLost,
            "memory" => FaultKind::OutOfMemory,
            _ => anyhow::bail!("there is no fault {kind}"),
        };
        Ok(Self { kind, frame: frame.parse().context("expected the number of a frame")? })
    }
}

/// Tells the window that threads have news.
#[derive(Debug)]
struct Wake;

/// Opens a window and stays until it is closed. What the validation layer complained of is a failure.
pub fn run(opening: Opening) -> Result<()> {
    let events = EventLoop::<Wake>::with_user_event().build();
    let events = events.map_err(|e| no_window(&e))?;
    let proxy = events.create_proxy();
    let mut program = Program { opening, proxy, window: None, failure: None, started: Instant::now() };
    events.run_app(&mut program).context("the window's events ended")?;
    let complaints = program.window.take().map_or_else(Vec::new, Open::close);
    match program.failure {
        Some(failure) => Err(failure),
        None => {
            anyhow::ensure!(complaints.is_empty(), "validation: {}", complaints.join("\n"));
            Ok(())
        }
    }
}

/// Why there is no window, without the place in the source where that was found.
fn no_window(problem: &dyn std::error::Error) -> Unavailable {
    let told = problem.to_string();
    let reason = told.rsplit_once(".rs:").and_then(|(_, rest)| Some(rest.split_once(": ")?.1)).unwrap_or(&told);
    Unavailable(format!("no window can be opened: {}", reason.trim_end_matches('.')))
}

struct Program {
    opening: Opening,
    proxy: EventLoopProxy<Wake>,
    window: Option<Open>,
    failure: Option<anyhow::Error>,
    started: Instant,
}

/// An open window.
struct Open {
    session: Session,
    input: egui_winit::State,
    window: Arc<Window>,
    /// When the next frame is due.
    due: Option<Instant>,
    is_hidden: bool,
    frames: u64,
    /// Devices that were lost one after the other, with no frame between them.
    losses: u32,
    fault: Option<Fault>,
    /// About devices that were lost.
    complaints: Vec<String>,
}

/// Frames on the GPU are looked after this often.
const POLL: Duration = Duration::from_millis(2);

/// A device that is lost again and again is broken.
const MOST_LOSSES: u32 = 3;

impl Program {
    fn open(&mut self, events: &ActiveEventLoop) -> Result<Open> {
        let opening = &self.opening;
        let [width, height] = opening.size;
        let attributes = Window::default_attributes()
            .with_title("smalto")
            .with_inner_size(PhysicalSize::new(width, height))
            .with_fullscreen(opening.is_full_screen.then_some(Fullscreen::Borderless(None)));
        let window =
            events.create_window(attributes).map_err(|e| Unavailable(format!("no window can be opened: {e}")))?;
        let window = Arc::new(window);
        let device = Device::open_for(&opening.device, opening.validation, &*window)?;
        let size = window.inner_size();
        let screen = Screen::of_window(&device, &window, opening.setup.vsync)?;
        let proxy = self.proxy.clone();
        let wake = Arc::new(move || drop(proxy.send_event(Wake)));
        let mut viewer = Viewer::new(opening.setup.clone(), Jobs::new(wake), [size.width.max(1), size.height.max(1)]);
        viewer.started = self.started;
        if let Some(refresh) = window.current_monitor().and_then(|monitor| monitor.refresh_rate_millihertz()) {
            viewer.refresh_ms = 1e6 / f64::from(refresh.max(1));
        }
        viewer.events.tell(&Event::Open { device: device.facts().name.clone(), size: viewer.size });
        let context = egui::Context::default();
        let input = input_of(&context, &window);
        window.request_redraw();
        let session = Session::new(viewer, screen, context);
        let fault = opening.fault;
        Ok(Open {
            session,
            input,
            window,
            due: None,
            is_hidden: false,
            frames: 0,
            losses: 0,
            fault,
            complaints: Vec::new(),
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

impl ApplicationHandler<Wake> for Program {
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
            && let Err(failure) = open.look_after().or_else(|failure| open.recover(failure, &self.opening))
        {
            self.fail(events, failure);
        }
    }

    fn user_event(&mut self, _: &ActiveEventLoop, _: Wake) {
        if let Some(open) = &mut self.window {
            // A hidden window draws nothing, but hears.
            if open.is_hidden {
                open.session.hear();
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
                    open.session.viewer.input_at.get_or_insert_with(Instant::now);
                    open.window.request_redraw();
                }
                Ok(())
            }
        };
        if let Err(failure) = outcome.or_else(|failure| open.recover(failure, &self.opening)) {
            self.fail(events, failure);
        }
    }

    fn about_to_wait(&mut self, events: &ActiveEventLoop) {
        let Some(open) = &self.window else { return };
        let poll = open.session.screen.is_busy().then(|| Instant::now() + POLL);
        let next = [open.due, poll].into_iter().flatten().min();
        events.set_control_flow(next.map_or(ControlFlow::Wait, ControlFlow::WaitUntil));
    }

    fn exiting(&mut self, _: &ActiveEventLoop) {
        if let Some(open) = &mut self.window {
            // What is on its way is waited for; what is lost by now is of no interest.
            let _ = open.session.land(true);
            open.session.viewer.events.tell(&open.session.closing());
        }
    }
}

impl Open {
    /// Closes the window: all that was complained of meanwhile.
    fn close(self) -> Vec<String> {
        let (device, mut complaints) = (self.session.screen.device().clone(), self.complaints);
        drop(self.session);
        complaints.extend(device.complaints());
        complaints
    }

    /// Learns from frames that are done, and begins one that is due.
    fn look_after(&mut self) -> Result<()> {
        let has_news = self.session.land(false)?;
        let is_due = self.due.is_some_and(|due| due <= Instant::now());
        if has_news && !self.is_hidden || is_due {
            self.window.request_redraw();
        }
        Ok(())
    }

    fn resize(&mut self, size: PhysicalSize<u32>) -> Result<()> {
        let size = [size.width, size.height];
        let shown = self.session.screen.fit(size);
        self.session.viewer.events.tell(&Event::Resized { size });
        self.heed(shown)?;
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
        let turn = match fault {
            Some(FaultKind::DeviceLost) => Err(DeviceLost("the GPU was lost (as was asked for)".to_owned()).into()),
            Some(FaultKind::OutOfMemory) => Err(OutOfMemory {
                name: "a buffer".to_owned(),
                bytes: Some(1 << 50),
                reason: "as was asked for".to_owned(),
            }
            .into()),
            Some(FaultKind::SurfaceLost) => {
                self.heed(Ok(Shown::Lost))?;
                self.window.request_redraw();
                return Ok(());
            }
            None => self.session.make_room().and_then(|()| {
                let input = || self.input.take_egui_input(&self.window);
                self.session.turn(input, size)
            }),
        };
        self.finish(turn?, events)
    }

    /// Does what a frame left to be done.
    fn finish(&mut self, turn: Turn, events: &ActiveEventLoop) -> Result<()> {
        let Turn { platform, again_in, wishes, shown } = turn;
        if let Some(platform) = platform {
            self.input.handle_platform_output(&self.window, platform);
        }
        for wish in wishes {
            self.grant(wish, events)?;
        }
        self.hide(shown == Shown::Hidden);
        if shown == Shown::Yes {
            self.losses = 0;
        }
        if shown != Shown::Yes && shown != Shown::Hidden {
            let size = self.window.inner_size();
            let shown = match shown {
                Shown::Again => self.session.screen.fit([size.width, size.height]),
                other => Ok(other),
            };
            self.heed(shown)?;
            self.window.request_redraw();
        } else if again_in.is_zero() {
            self.window.request_redraw();
        } else if again_in < Duration::from_secs(3600) {
            self.due = Some(Instant::now() + again_in);
        }
        Ok(())
    }

    fn grant(&mut self, wish: Wish, events: &ActiveEventLoop) -> Result<()> {
        match wish {
            Wish::FullScreen => {
                let full = self.window.fullscreen().is_none().then_some(Fullscreen::Borderless(None));
                self.window.set_fullscreen(full);
            }
            Wish::Quit => events.exit(),
            Wish::Vsync(vsync) => {
                self.session.viewer.vsync = vsync;
                let size = self.window.inner_size();
                let shown = self.session.screen.set_vsync(vsync, [size.width, size.height]);
                self.heed(shown)?;
            }
            Wish::Copy(text) => self.input.set_clipboard_text(text),
            _ => unreachable!("the session does the rest"),
        }
        Ok(())
    }

    fn hide(&mut self, is_hidden: bool) {
        if self.is_hidden != is_hidden {
            self.is_hidden = is_hidden;
            self.session.viewer.events.tell(&Event::Hidden { is_hidden });
        }
    }

    /// Opens another surface where one is gone.
    fn heed(&mut self, shown: Result<Shown>) -> Result<()> {
        if shown? == Shown::Lost {
            let device = self.session.screen.device().clone();
            self.session.land(true)?;
            // A window has one surface at a time.
            self.session.screen.close();
            self.session.viewer.messages.note("the window's surface was lost, and is open again");
            self.session.screen = Screen::of_window(&device, &self.window, self.session.viewer.vsync)?;
            self.session.forget_letters();
            self.renew_input();
        }
        Ok(())
    }

    /// Goes on after a failure, if there is a way: with a device opened anew, or without the scene that does not fit.
    fn recover(&mut self, failure: anyhow::Error, opening: &Opening) -> Result<()> {
        let viewer = &mut self.session.viewer;
        if failure.is::<OutOfMemory>() {
            viewer.messages.error(format!("there is not enough memory to go on: {failure:#}. Close or hide a scene"));
            self.session.drop_pictures();
        } else if failure.is::<DeviceLost>() && self.losses < MOST_LOSSES {
            self.losses += 1;
            self.complaints.extend(self.session.screen.device().complaints());
            viewer.messages.error(format!("{failure:#}; it is opened anew"));
            self.session.drop_pictures();
            self.session.screen.close();
            let device = Device::open_for(&opening.device, opening.validation, &*self.window)?;
            let screen = Screen::of_window(&device, &self.window, self.session.viewer.vsync)?;
            self.session.replace_screen(screen);
            self.renew_input();
        } else {
            return Err(failure);
        }
        self.window.request_redraw();
        Ok(())
    }

    /// The panels begin anew with their letters.
    fn renew_input(&mut self) {
        self.input = input_of(self.session.context(), &self.window);
    }
}
