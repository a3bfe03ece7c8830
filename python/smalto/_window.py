"""Windows that show a scene while Python goes on."""

import atexit
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import threading
from typing import Any

from ._smalto import DeviceError, Error, Scene, UnreadableError

_open: set["Window"] = set()

# Scenes that are no files.
_MADE = ("cactus", "room", "plain", "town", "few-large", "many-small")


class Window:
    """A window of `smalto view`, in a process of its own. It closes when Python ends, unless Python is killed."""

    def __init__(self, scene: Scene | str | os.PathLike[str], *arguments: str | os.PathLike[str]) -> None:
        if not isinstance(scene, Scene) and str(scene).split(":")[0] not in _MADE and not os.path.exists(scene):
            raise UnreadableError(f"{os.fspath(scene)}: there is no such file")
        self._folder = tempfile.TemporaryDirectory(prefix="smalto-")
        self._file = pathlib.Path(self._folder.name) / "scene.ply" if isinstance(scene, Scene) else None
        if self._file is not None:
            scene.write(self._file)
        command = [sys.executable, "-m", "smalto", "view", os.fspath(self._file or scene), "--follow", "--events"]
        # An interrupt is for Python, which closes the window when it ends.
        self._process = subprocess.Popen(
            [*command, *map(os.fspath, arguments)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        self._is_shown, self._said, self._events = threading.Event(), list[str](), list[Any]()
        self._readers = [threading.Thread(target=read, daemon=True) for read in (self._read_events, self._read_errors)]
        for reader in self._readers:
            reader.start()
        _open.add(self)
        self._is_shown.wait()
        if self._process.poll() is not None and self._process.returncode != 0:
            self.close()
            said = self._said[-1].removeprefix("smalto: ") if self._said else "the window closed at once"
            raise (DeviceError if self._process.returncode == 3 else Error)(said)

    def update(self, scene: Scene) -> None:
        """Shows another scene, from the same view. Errors: ValueError if the window shows a file, which it follows by
        itself; smalto.Error if it is closed."""
        if self._file is None:
            raise ValueError("the window shows a file, and reads it again when that changes")
        if not self.is_open:
            raise Error("the window is closed")
        scene.write(self._file)

    @property
    def is_open(self) -> bool:
        """False once the window is closed."""
        return self._process.poll() is None

    def wait(self) -> None:
        """Waits until the window is closed."""
        self._process.wait()
        self.close()

    def close(self) -> None:
        """Closes the window."""
        if self.is_open:
            self._process.terminate()
        self._process.wait()
        for reader in self._readers:
            reader.join()
        self._folder.cleanup()
        _open.discard(self)

    def __enter__(self) -> "Window":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"Window({'open' if self.is_open else 'closed'})"

    def _read_events(self):
        try:
            with self._process.stdout as events:
                for line in events:
                    try:
                        event = json.loads(line)
                    except ValueError:
                        # A driver may print there, too.
                        continue
                    self._events = [*self._events, event][-20:]
                    self._is_shown.set()
            self._process.wait()
        finally:
            self._is_shown.set()

    def _read_errors(self):
        with self._process.stderr as errors:
            for line in errors:
                self._said = [*self._said, line.rstrip()][-20:]


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


@atexit.register
def _close_all() -> None:
    for window in list(_open):
        window.close()
