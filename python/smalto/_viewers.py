"""Viewers that show a scene while Python goes on: in a window, or in browsers."""

import atexit
import json
import os
import pathlib
import socket
import subprocess
import sys
import tempfile
import threading
from typing import Any

from ._smalto import DeviceError, Error, Scene, UnreadableError

_open: set["_Viewer"] = set()

# Scenes that are no files.
_MADE = ("cactus", "room", "plain", "town", "few-large", "many-small")


class _Viewer:
    """A viewer in a process of its own. It ends when Python ends, unless Python is killed."""

    _what: str

    def __init__(
        self,
        command: str,
        scene: Scene | str | os.PathLike[str],
        arguments: tuple[str | os.PathLike[str], ...],
        *more: str,
    ) -> None:
        if not isinstance(scene, Scene) and str(scene).split(":")[0] not in _MADE and not os.path.exists(scene):
            raise UnreadableError(f"{os.fspath(scene)}: there is no such file")
        self._folder = tempfile.TemporaryDirectory(prefix="smalto-")
        self._file = pathlib.Path(self._folder.name) / "scene.ply" if isinstance(scene, Scene) else None
        if self._file is not None:
            scene.write(self._file)
        command_line = [sys.executable, "-m", "smalto", command, os.fspath(self._file or scene), "--follow", *more]
        # An interrupt is for Python, which closes the viewer when it ends.
        self._process = subprocess.Popen(
            [*command_line, *map(os.fspath, arguments)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        self._is_ready, self._said, self._is_ended = threading.Event(), list[str](), False
        self._readers = [threading.Thread(target=read, daemon=True) for read in (self._read_lines, self._read_errors)]
        for reader in self._readers:
            reader.start()
        _open.add(self)
        self._is_ready.wait()
        if self._process.poll() is not None and self._process.returncode != 0:
            self.close()
            said = self._said[-1].removeprefix("smalto: ") if self._said else f"the {self._what} closed at once"
            raise (DeviceError if self._process.returncode == 3 else Error)(said)

    def update(self, scene: Scene) -> None:
        """Shows another scene, from the same view. Errors: ValueError if a file is shown, which is followed by itself;
        smalto.Error if it is closed."""
        if self._file is None:
            raise ValueError(f"the {self._what} shows a file, and reads it again when that changes")
        if not self.is_open:
            raise self._closed()
        scene.write(self._file)

    def _has_failed(self) -> bool:
        """True if the process ended with a failure, and not by `close`."""
        return self._process.poll() not in (None, 0) and not self._is_ended

    def _closed(self) -> Error:
        """The error of a viewer that is closed, with the reason if it failed."""
        if not self._has_failed():
            return Error(f"the {self._what} is closed")
        for reader in self._readers:
            reader.join(timeout=5)
        code = self._process.returncode
        said = self._said[-1].removeprefix("smalto: ") if self._said else f"it ended with code {code}"
        return (DeviceError if code == 3 else Error)(f"the {self._what} is closed: {said}")

    @property
    def is_open(self) -> bool:
        """False once it is closed."""
        return self._process.poll() is None

    def wait(self) -> None:
        """Waits until it is closed. Errors: smalto.Error with the reason if it failed."""
        self._process.wait()
        self.close()
        if self._has_failed():
            raise self._closed()

    def close(self) -> None:
        """Closes it."""
        if self.is_open:
            self._is_ended = True
            self._process.terminate()
        self._process.wait()
        for reader in self._readers:
            reader.join()
        self._folder.cleanup()
        _open.discard(self)

    def __enter__(self):
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _hear(self, line: str) -> bool:
        """True if a line of the process tells that it is ready."""
        raise NotImplementedError

    def _read_lines(self):
        try:
            with self._process.stdout as lines:
                for line in lines:
                    if self._hear(line):
                        self._is_ready.set()
            self._process.wait()
        finally:
            self._is_ready.set()

    def _read_errors(self):
        with self._process.stderr as errors:
            for line in errors:
                self._said = [*self._said, line.rstrip()][-20:]


class Window(_Viewer):
    """A window of `smalto view`, in a process of its own. It closes when Python ends, unless Python is killed."""

    _what = "window"

    def __init__(self, scene: Scene | str | os.PathLike[str], *arguments: str | os.PathLike[str]) -> None:
        self._events = list[Any]()
        self._lock, self._socket, self._rests = threading.Lock(), None, 0
        self._place = tempfile.TemporaryDirectory(prefix="smalto-")
        self._path = os.path.join(self._place.name, "control")
        # The path of a local socket has some hundred bytes at most.
        self._is_controlled = hasattr(socket, "AF_UNIX") and len(os.fsencode(self._path)) < 100
        control = ("--control", self._path) if self._is_controlled else ()
        super().__init__("view", scene, arguments, "--events", *control)

    def ask(self, do: str, **fields: Any) -> dict[str, Any]:
        """Asks the window to do something, and returns its state once that is done and shown:

            window.ask("preset", name="fast")
            window.ask("set", knob="sh-degree", value="1")
            window.ask("camera", index=3)
            state = window.ask("picture", file="view.png")
            print(state["gpu_ms"], state["rest"]["view"])

        docs/control.md has all messages and the state. Errors: ValueError with the reason if it cannot be done,
        smalto.Error if the window is closed."""
        if not self.is_open:
            raise self._closed()
        if not self._is_controlled:
            raise Error("this system has no local sockets, or the path of its folder for temporary files is long")
        if "file" in fields:
            fields["file"] = os.path.abspath(fields["file"])
        with self._lock:
            try:
                return self._ask({"do": do, **fields})
            except OSError as problem:
                # The process ends in this moment, or has ended.
                self._process.wait()
                raise self._closed() from problem

    def _ask(self, message):
        if self._socket is None:
            self._socket = socket.socket(socket.AF_UNIX)
            self._socket.connect(self._path)
            self._told = self._socket.makefile("r", encoding="utf-8", newline="\n")
        self._rests += 1
        lines = (message, {"do": "rest", "number": self._rests})
        self._socket.sendall("".join(json.dumps(line) + "\n" for line in lines).encode())
        refused = None
        for line in self._told:
            told = json.loads(line)
            if told["say"] == "refused":
                refused = told["why"]
                if told.get("number") == self._rests:
                    raise ValueError(refused)
            elif told["say"] == "rests" and told["number"] == self._rests:
                if refused is not None:
                    raise ValueError(refused)
                return told["state"]
        raise ConnectionError

    def close(self) -> None:
        """Closes the window."""
        super().close()
        if self._socket is not None:
            self._told.close()
            self._socket.close()
        self._place.cleanup()

    def __repr__(self) -> str:
        return f"Window({'open' if self.is_open else 'closed'})"

    def _hear(self, line):
        try:
            self._events = [*self._events, json.loads(line)][-20:]
        except ValueError:
            # A driver may print there, too.
            return False
        return True


class Server(_Viewer):
    """A server of `smalto serve`, in a process of its own. It ends when Python ends, unless Python is killed. A notebook
    shows its page."""

    _what = "server"

    def __init__(self, scene: Scene | str | os.PathLike[str], *arguments: str | os.PathLike[str]) -> None:
        self._url = ""
        super().__init__("serve", scene, arguments)

    @property
    def url(self) -> str:
        """The address of the page that `smalto serve` printed, with the token if it asks for one; that of "--proxy", if it is
        given. With "--host" it names this machine THIS_MACHINE."""
        return self._url

    def _repr_html_(self) -> str:
        frame = 'width="100%" height="600" style="border: 0" allow="clipboard-write; fullscreen"'
        return f'<iframe src="{self._url}" {frame}></iframe>'

    def __repr__(self) -> str:
        return f"Server({self._url if self.is_open else 'closed'})"

    def _hear(self, line):
        if not self._url and line.startswith(("http://", "https://")):
            self._url = line.strip()
        return bool(self._url)


def view(scene: Scene | str | os.PathLike[str], *arguments: str | os.PathLike[str]) -> Window:
    """Opens a window that shows a scene, or the scene file of this path, and returns it. Python goes on; the window can
    be flown through meanwhile, and shows a scene that trains:

        window = smalto.view(scene)
        for step in range(steps):
            ...
            if step % 100 == 0:
                window.update(smalto.Scene.from_arrays(means, quats, scales, opacities, sh))
        window.wait()

    `arguments` are those of `smalto view`, like "--preset", "fast". A scene is handed over as a file, a second for a few
    million Gaussians. While Gaussians are selected or edited in the window, it keeps them, and shows the newest scene when
    nothing is any more. Errors: DeviceError if there is no display or no device, UnreadableError if there is no such
    file, ValueError for a scene in a page file, smalto.Error.
    """
    return Window(scene, *arguments)


def serve(scene: Scene | str | os.PathLike[str], *arguments: str | os.PathLike[str]) -> Server:
    """Shows a scene, or the scene file of this path, in browsers, and returns the server. Python goes on; as with `view`,
    `update` shows a scene that trains. In a notebook, the last line of a cell shows the page in it:

        server = smalto.serve(scene)
        server

    `arguments` are those of `smalto serve`, like "--port", "8080". The page is for browsers of this machine, for those that
    `ssh -L 7007:127.0.0.1:7007` connects to it, or with "--proxy" for those that reach a proxy. Errors: DeviceError if
    there is no device, UnreadableError if there is no such file, ValueError for a scene in a page file, smalto.Error.
    """
    return Server(scene, *arguments)


@atexit.register
def _close_all() -> None:
    for viewer in list(_open):
        viewer.close()
