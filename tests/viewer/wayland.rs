//! A window of a Wayland compositor, which draws to no screen and takes pictures of itself.
#![cfg(target_os = "linux")]

use std::fs;
use std::io::{BufRead, BufReader};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crate::common::Turn;
use crate::common::desktop::PATIENCE;
use crate::common::program::{ok, path};
use crate::common::window::view;
use smalto::pixels::Pixels;

const SOCKET: &str = "smalto-test";

/// A process that ends with the test.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn weston(folder: &Path) -> Running {
    let mut command = Command::new("weston");
    command.args(["--backend=headless-backend.so", "--use-pixman", "--debug", "--no-config", "--idle-time=0"]);
    command.args([&format!("--socket={SOCKET}"), "--width=800", "--height=600"]);
    command.env("XDG_RUNTIME_DIR", folder).stdout(Stdio::null()).stderr(Stdio::null());
    let running = command.spawn().unwrap_or_else(|e| panic!("weston does not start: {e}. Run ./setup.sh"));
    let begun = Instant::now();
    while !folder.join(SOCKET).exists() {
        assert!(begun.elapsed() < PATIENCE, "weston opens no socket");
        std::thread::sleep(Duration::from_millis(20));
    }
    Running(running)
}

/// What the compositor shows.
fn shot(folder: &Path) -> Pixels {
    let mut command = Command::new("weston-screenshooter");
    command.env("XDG_RUNTIME_DIR", folder).env("WAYLAND_DISPLAY", SOCKET).current_dir(folder);
    assert!(command.status().unwrap().success());
    let names = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let file = names.filter(|name| name.extension().is_some_and(|end| end == "png")).max().unwrap();
    let pixels = Pixels::read(&file).unwrap();
    fs::remove_file(file).unwrap();
    pixels
}

/// True if the picture is a part of the screen.
fn shows(screen: &Pixels, picture: &Pixels) -> bool {
    let row = |pixels: &Pixels, x: u32, y: u32, width: u32| {
        let first = (y * pixels.size[0] + x) as usize;
        pixels.rgba[first..first + width as usize].iter().map(|p| [p[0], p[1], p[2]]).collect::<Vec<_>>()
    };
    let [width, height] = picture.size;
    let rows: Vec<_> = (0..height).map(|y| row(picture, 0, y, width)).collect();
    let is_at = |x: u32, y: u32| (0..height).all(|i| row(screen, x, y + i, width) == rows[i as usize]);
    (0..=screen.size[1] - height).any(|y| (0..=screen.size[0] - width).any(|x| is_at(x, y)))
}

#[test]
fn a_wayland_window_shows_what_render_draws() {
    let _turn = Turn::take();
    let folder = tempfile::tempdir().unwrap();
    fs::set_permissions(folder.path(), fs::Permissions::from_mode(0o700)).unwrap();
    let file = path(&folder, "render.png");
    ok(&["render", "cactus:3000", "--size", "320x200", "-o", &file]);
    let rendered = Pixels::read(Path::new(&file)).unwrap();
    fs::remove_file(file).unwrap();

    let _compositor = weston(folder.path());
    let mut command = view(&["cactus:3000", "--size", "320x200", "--no-panels", "--events"]);
    command.env("XDG_RUNTIME_DIR", folder.path()).env("WAYLAND_DISPLAY", SOCKET).env_remove("DISPLAY");
    command.env("XDG_CONFIG_HOME", folder.path()).env("XDG_STATE_HOME", folder.path());
    let mut viewer = Running(command.stdout(Stdio::piped()).spawn().unwrap());
    let lines = BufReader::new(viewer.0.stdout.take().unwrap()).lines();
    let told = lines.map_while(Result::ok).find(|line| line.contains("first-frame") && line.contains("true"));
    assert!(told.is_some(), "it ended before it showed the scene");
    let begun = Instant::now();
    while !shows(&shot(folder.path()), &rendered) {
        assert!(begun.elapsed() < PATIENCE, "the picture is not on the screen");
        std::thread::sleep(Duration::from_millis(200));
    }
}
