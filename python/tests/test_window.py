"""Windows, on a virtual X server."""

import shutil
import subprocess
import time

import pytest
import smalto

pytestmark = pytest.mark.skipif(shutil.which("Xvfb") is None, reason="there is no Xvfb")


@pytest.fixture(scope="module")
def display():
    server = subprocess.Popen(
        ["Xvfb", "-displayfd", "1", "-screen", "0", "800x600x24", "-nolisten", "tcp"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    yield f":{server.stdout.readline().strip()}"
    server.terminate()
    server.wait()


@pytest.fixture
def desktop(display, monkeypatch):
    monkeypatch.setenv("DISPLAY", display)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)


def told(window, event):
    end = time.monotonic() + 60
    while time.monotonic() < end:
        if any(event.items() <= one.items() for one in window._events):
            return True
        time.sleep(0.02)
    return False


def test_a_window_shows_a_scene_and_its_updates(desktop, tmp_path):
    with smalto.view(smalto.Scene.read("cactus:500"), "--size", "320x200") as window:
        assert window.is_open and repr(window) == "Window(open)"
        assert told(window, {"event": "scene", "gaussians": 500})
        window.update(smalto.Scene.read("cactus:900"))
        assert told(window, {"event": "scene", "gaussians": 900})
    assert not window.is_open and repr(window) == "Window(closed)"
    with pytest.raises(smalto.Error, match="the window is closed"):
        window.update(smalto.Scene.read("cactus:500"))

    file = tmp_path / "scene.ply"
    smalto.Scene.read("cactus:300").write(file)
    with smalto.view(file, "--size", "320x200") as window:
        assert told(window, {"event": "scene", "gaussians": 300})
        with pytest.raises(ValueError, match="the window shows a file"):
            window.update(smalto.Scene.read("cactus:500"))
        smalto.Scene.read("cactus:400").write(file)
        assert told(window, {"event": "scene", "gaussians": 400})


def test_a_window_is_controlled(desktop, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with smalto.view("cactus:2000", "--size", "320x200", "--no-panels") as window:
        state = window.ask("picture", file="first.png")
        assert state["preset"] == "balanced" and (tmp_path / "first.png").is_file()
        assert window.ask("preset", name="preview")["preset"] == "preview"
        window.ask("picture", file="second.png")
        assert (tmp_path / "first.png").read_bytes() != (tmp_path / "second.png").read_bytes()
        with pytest.raises(ValueError, match="there is no preset best"):
            window.ask("preset", name="best")
        view = window.ask("look", name="depth", range=None)["rest"]["view"]
        assert window.ask("view", view=view)["rest"]["view"] == view
    with pytest.raises(smalto.Error, match="the window is closed"):
        window.ask("preset", name="fast")


def test_what_stops_a_window_is_said(desktop, monkeypatch):
    with pytest.raises(smalto.Error, match="no-such-option"):
        smalto.view("cactus:100", "--no-such-option")
    with pytest.raises(smalto.UnreadableError, match="there is no such file"):
        smalto.view("missing.ply")
    monkeypatch.delenv("DISPLAY")
    with pytest.raises(smalto.DeviceError, match="DISPLAY is set"):
        smalto.view("cactus:100")
