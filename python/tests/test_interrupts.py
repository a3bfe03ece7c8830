"""Ctrl-C ends a call that works for long."""

import subprocess
import sys

import pytest

CALLS = {
    "render": "renderer.render(scene.camera(3000, 3000))",
    "render_many": "any(picture is None for picture in renderer.render_many([scene.camera(3000, 3000)] * 100))",
    "reference": "smalto.reference(scene, scene.camera(3000, 3000))",
    "read": "smalto.Scene.read('town:4000000')",
    "Renderer": "smalto.Renderer(smalto.Scene.read('few-large:1000000')).render(scene.camera(3000, 3000))",
}

# Work has a thread of its own, by which the program knows that the call has begun.
PROGRAM = """
import os, signal, threading, time
import smalto

# A parent may ignore the signal, as a shell does for what runs in the background.
signal.signal(signal.SIGINT, signal.default_int_handler)
scene = smalto.Scene.read("few-large:20000")
renderer = smalto.Renderer(scene)

def threads():
    for task in os.listdir("/proc/self/task"):
        try:
            with open(f"/proc/self/task/{task}/comm") as name:
                yield task, name.read().strip()
        except OSError:
            pass

# Threads have the name of the one that started them: those of the renderer are there already.
before = set(threads())

def interrupt():
    while "smalto-call" not in {name for _, name in set(threads()) - before}:
        time.sleep(0.001)
    os.kill(os.getpid(), signal.SIGINT)

threading.Thread(target=interrupt, daemon=True).start()
try:
    CALL
    print("finished", flush=True)
except KeyboardInterrupt:
    print("interrupted", flush=True)
# What goes on in the background must not keep the test.
os._exit(0)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="threads are read from /proc")
@pytest.mark.parametrize("call", CALLS)
def test_an_interrupt_ends_a_call(call):
    program = PROGRAM.replace("CALL", CALLS[call])
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=300)
    assert ended.stdout == "interrupted\n", ended.stderr
