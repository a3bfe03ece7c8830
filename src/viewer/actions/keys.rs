//! Actions of keys.

use super::command::Program;
use crate::viewer::model::{Action, Change, Request, SaveTarget, Tool, Viewer, WindowRequest};

impl Viewer {
    /// Closes and ends what lies over the picture, after what was requested of pixels before.
    pub fn escape(&mut self) {
        let waits = |request: &Request| matches!(request, Request::Mark(_) | Request::Pick(_));
        if self.requests.iter().any(waits) {
            return self.requests.push(Request::Escape);
        }
        self.escape_now();
    }

    /// Closes and ends at once what lies over the picture.
    pub fn escape_now(&mut self) {
        self.panels.shows_help = false;
        self.messages.close_errors();
        self.comparison.area = None;
        self.cancel_stroke();
        self.ruler.open = None;
        self.inspector.clear_explanation();
    }

    /// Does what a key does. `pixel` is the pixel under the cursor. Edits, and undo of them, wait for the edits that
    /// are requested already.
    pub fn act(&mut self, action: Action, pixel: Option<[u32; 2]>) {
        let is_undo = matches!(action, Action::Undo | Action::Redo);
        let waits = |request: &Request| matches!(request, Request::Mark(_) | Request::Focus(_));
        if action.is_edit() && self.has_requested_edits() || is_undo && self.requests.iter().any(waits) {
            self.requests.push(Request::Act(action));
        } else {
            self.act_now(action, pixel);
        }
    }

    /// True if edits are requested that were not made yet.
    fn has_requested_edits(&self) -> bool {
        self.has_running_edits() || self.requests.iter().any(Request::is_edit)
    }

    /// Does at once what a key does.
    pub fn act_now(&mut self, action: Action, pixel: Option<[u32; 2]>) {
        match action {
            Action::Forward | Action::Back | Action::Left | Action::Right | Action::Up | Action::Down => {}
            Action::Fast | Action::Slow | Action::Flicker => {}
            Action::CopyPicture => self.requests.push(Request::CopyPicture),
            Action::Screenshot => self.requests.push(Request::WritePicture(None)),
            Action::NextCamera => self.step_camera(true),
            Action::PreviousCamera => self.step_camera(false),
            Action::NearestCamera => self.go_to_nearest_camera(),
            Action::ShowCameras => self.panels.recent.shows_cameras = !self.panels.recent.shows_cameras,
            Action::FlipUp => {
                self.view.navigator.flip_up();
                self.view.camera_index = None;
            }
            Action::Frame => self.frame_scene(),
            Action::Reset => self.reset_view(),
            Action::FullScreen => self.requests.push(Request::Window(WindowRequest::ToggleFullScreen)),
            Action::HidePanels => {
                self.panels.are_hidden = !self.panels.are_hidden;
                // Stages are timed only if the panels show them.
                self.timing.frame_times.clear();
            }
            Action::Help => self.panels.shows_help = !self.panels.shows_help,
            Action::ToolView
            | Action::ToolRectangle
            | Action::ToolLasso
            | Action::ToolPolygon
            | Action::ToolBrush
            | Action::ToolBall
            | Action::ToolBox
            | Action::ToolColour
            | Action::ToolPlace => {
                if let Some((tool, ..)) = Tool::ALL.iter().find(|(_, of, ..)| *of == action) {
                    self.use_tool(*tool);
                }
            }
            // A stroke is undone once it has ended.
            Action::Undo | Action::Redo if self.pointer.stroke.is_some() => {}
            Action::Undo => self.undo(false),
            Action::Redo => self.undo(true),
            Action::ShowHidden => self.change_by_key(Change::ShowHidden),
            Action::Hide => self.change_by_key(Change::Hide),
            Action::Delete => self.change_by_key(Change::Delete),
            Action::SelectAll => self.change_by_key(Change::SelectAll),
            Action::SelectNone => self.change_by_key(Change::SelectNone),
            Action::Invert => self.change_by_key(Change::Invert),
            Action::Save => self.panels.dialog.save_file(SaveTarget::Project),
            Action::OpenFile => self.panels.dialog.open_files(),
            Action::CopyCommand => self.copy_command(Program::Render),
            Action::CopyView => self.copy_view(),
            Action::PasteView => {}
            Action::FreezeCulling => self.toggle_frozen_culling(),
            Action::Pick => self.requests.extend(pixel.map(Request::Pick)),
            Action::Mark => self.requests.extend(pixel.map(Request::Mark)),
            Action::AddKey => self.add_key(),
            Action::Play => self.film.toggle(),
            Action::NextLook | Action::PreviousLook => {
                let is_paged = self.scenes.are_paged();
                self.inspector.settings.step(action == Action::NextLook, is_paged);
            }
            Action::Quit => self.requests.push(Request::Window(WindowRequest::Quit)),
        }
    }

    fn change_by_key(&mut self, change: Change) {
        if self.is_editing() && self.pointer.stroke.is_none() {
            self.end_undo_step();
            self.change(change);
        }
    }
}
