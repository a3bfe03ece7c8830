#!/usr/bin/env python3
"""Runs smalto in hostile surroundings at random moments, and counts what it does wrong.

    python3 tests/hostile.py [PROGRAM] [SECONDS]

PROGRAM is target/release/smalto by default. Every kind of trial gets its share of SECONDS, 240 by default. As root,
threads are limited for the user `nobody` (util-linux's setpriv), and full disks are file systems of their own. The exit
code is 1 if any count but `runs`, `allocations` and `of drivers` is not 0. `allocations` are aborts by Rust's allocator
("memory allocation of N bytes failed"), which small allocations end in; `of drivers` are other deaths by a signal under
a limit of memory, threads or descriptors: lavapipe does not check all of its own allocations.
"""

import collections
import hashlib
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time

PROGRAM = os.path.abspath(sys.argv[1] if len(sys.argv) > 1 else "target/release/smalto")
SECONDS = float(sys.argv[2]) if len(sys.argv) > 2 else 240
COUNTS = ["runs", "panics", "signals", "hangs", "leftovers", "torn", "wrong codes", "allocations", "of drivers"]
CODES = range(7)
PATIENCE = 60  # seconds, after which a run hangs
RANDOM = random.Random(7)
table = collections.OrderedDict()
faults = []


class Trial:
    """A kind of trial: its row of counts, and a folder that is emptied before each run."""

    def __init__(self, name, share):
        self.name, self.until = name, time.time() + share * SECONDS
        self.counts = table.setdefault(name, collections.Counter())
        self.folder = tempfile.mkdtemp(prefix="hostile-")
        os.chmod(self.folder, 0o777)

    def goes_on(self):
        return time.time() < self.until

    def close(self):
        shutil.rmtree(self.folder, ignore_errors=True)

    def path(self, name):
        return os.path.join(self.folder, name)

    def fault(self, kind, what):
        self.counts[kind] += 1
        if kind not in ("allocations", "of drivers"):
            faults.append(f"{self.name}: {kind}: {what}")

    def run(self, arguments, signals=(), expected=CODES, limits=(), prefix=(), stdin=None, limited=False, **environment):
        """Runs the program, and ends it by one of `signals` at a random moment. Returns its exit code."""

        def prepare():
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGPIPE):
                signal.signal(number, signal.SIG_DFL)
            for what, limit in limits:
                resource.setrlimit(what, (limit, limit))

        self.counts["runs"] += 1
        environment = dict(os.environ, TMPDIR=self.folder, RUST_BACKTRACE="0", **environment)
        command = [*prefix, PROGRAM, *arguments]
        process = subprocess.Popen(command, stdin=stdin or subprocess.DEVNULL, stdout=subprocess.DEVNULL,
                                   stderr=subprocess.PIPE, cwd=self.folder, env=environment, preexec_fn=prepare)
        sent = None
        try:
            if signals:
                try:
                    process.wait(RANDOM.uniform(0.02, 2.0))
                except subprocess.TimeoutExpired:
                    sent = RANDOM.choice(signals)
                    process.send_signal(sent)
            error = process.communicate(timeout=PATIENCE)[1].decode(errors="replace")
        except subprocess.TimeoutExpired:
            process.kill()
            error = process.communicate()[1].decode(errors="replace")
            self.fault("hangs", f"{arguments}: {error[-200:]}")
            return None
        code = process.returncode
        what = f"{arguments} {limits or ''}: {code}: {error[-300:]}"
        if "panicked" in error:
            self.fault("panics", what)
        elif code == -signal.SIGABRT and "memory allocation of" in error:
            self.fault("allocations", what)
        elif code < 0 and -code != sent:
            self.fault("of drivers" if limited else "signals", what)
        elif code >= 0 and code not in expected:
            self.fault("wrong codes", what)
        return code

    def check_names(self, allowed, what):
        """Counts names in the folder that no run may leave."""
        left = [name for name in os.listdir(self.folder) if not allowed(name)]
        if left:
            self.fault("leftovers", f"{what}: {left}")
        for name in left:
            path = self.path(name)
            shutil.rmtree(path) if os.path.isdir(path) else os.remove(path)


def digest(path):
    with open(path, "rb") as file:
        return hashlib.blake2b(file.read()).hexdigest()


ENDING = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)


def killed_outputs(trial, command, output, kinds):
    """A signal leaves the old output or the new one, and no part of a file; a part stays after SIGKILL."""
    trial.run([*command, output])
    new = digest(trial.path(output))
    while trial.goes_on():
        with open(trial.path(output), "w") as file:
            file.write("old")
        old = digest(trial.path(output))
        kill = RANDOM.random() < 0.25
        trial.run([*command, output], signals=(signal.SIGKILL,) if kill else ENDING)
        if digest(trial.path(output)) not in (old, new):
            trial.fault("torn", f"{command} {output}")
        if kill:
            time.sleep(0.1)
            for name in os.listdir(trial.folder):
                if ".part" in name:
                    os.remove(trial.path(name))
        trial.check_names(lambda name: name == output or name in kinds, f"{command} {output}")


def killed_pictures(trial):
    command = ["render", "cactus:1000", "--orbit", "12", "--size", "96x64", "--layers", "colour,depth", "-o"]
    trial.run([*command, "whole"])
    names = sorted(name for name in os.listdir(trial.path("whole")) if not name.startswith("."))
    files = [name for name in names if os.path.isfile(trial.path("whole/" + name))]
    expected = {name: digest(trial.path("whole/" + name)) for name in files}
    while trial.goes_on():
        trial.run([*command, "killed", "--resume"], signals=(*ENDING, signal.SIGKILL))
        for name, whole in expected.items():
            if os.path.exists(trial.path("killed/" + name)) and digest(trial.path("killed/" + name)) != whole:
                trial.fault("torn", name)
        if RANDOM.random() < 0.2:
            shutil.rmtree(trial.path("killed"), ignore_errors=True)


def killed_videos(trial):
    if not shutil.which("ffmpeg"):
        print("there is no ffmpeg: no videos", file=sys.stderr)
        return
    while trial.goes_on():
        trial.run(["render", "cactus:500", "--orbit", "12", "--size", "160x90", "--video", "v.mp4"], signals=ENDING)
        time.sleep(0.4)
        trial.check_names(lambda name: name == "v.mp4", "video")


def killed_pipes(trial):
    trial.run(["convert", "cactus:20000", "c.ply"])
    while trial.goes_on():
        feed = subprocess.Popen(["sh", "-c", "cat c.ply; exec sleep 9"], stdout=subprocess.PIPE, cwd=trial.folder)
        trial.run(["info", "-"], stdin=feed.stdout, signals=(*ENDING, signal.SIGKILL))
        feed.stdout.close()
        feed.kill()
        feed.wait()
        trial.check_names(lambda name: name == "c.ply", "pipe")


def floods(trial):
    with open(trial.path("huge.json"), "wb") as file:
        file.truncate(3 << 30)
    commands = [
        ["render", "cactus:10", "--cameras", "huge.json"],
        ["render", "cactus:10", "--place", "huge.json"],
        ["bench", "cactus:10", "--size", "8x8", "--baseline", "huge.json"],
        ["render", "cactus:10", "--path", "huge.json"],
        ["view", "huge.json", "--offscreen", "4"],
        ["info", "huge.json"],
    ]
    for command in commands:
        started = time.time()
        trial.run(command, expected=(4,), limits=[(resource.RLIMIT_AS, 3 << 30)])
        if time.time() - started > 5:
            trial.fault("hangs", f"{command}: {time.time() - started:.1f} s")
    with open("/dev/zero", "rb") as zeros:
        trial.run(["info", "-"], expected=(4,), stdin=zeros)
    os.mkdir(trial.path("scene"))
    with open(trial.path("scene/cameras.json"), "wb") as file:
        file.truncate(3 << 30)
    trial.run(["convert", "cactus:100", "scene/a.ply"], expected=(0,))
    # A camera file that is found and cannot be used is a note.
    trial.run(["render", "scene/a.ply", "--size", "8x8"], expected=(0,))


def limits(trial, what, values, commands, prefix=()):
    for value in values:
        for command in commands:
            if not trial.goes_on():
                return
            trial.run(command, limits=[(what, value)], prefix=prefix, limited=True, HOME=trial.folder)
            for name in os.listdir(trial.folder):
                if ".part" in name:
                    trial.fault("leftovers", f"{command} {value}: {name}")
                    os.remove(trial.path(name))


COMMANDS = [
    ["info", "cactus:100"],
    ["convert", "cactus:2000", "c.sog"],
    ["convert", "cactus:2000", "sog/meta.json"],
    ["lod", "cactus:5000", "-o", "l.smalto"],
    ["render", "cactus:100", "--size", "16x16", "-o", "a.png"],
    ["render", "cactus:100", "--size", "16x16", "--orbit", "3", "-o", "views/"],
    ["render", "cactus:100", "--size", "16x16", "--reference", "-o", "r.png"],
    ["doctor"],
]


def threads(trial):
    if os.getuid() != 0 or not shutil.which("setpriv"):
        print("threads are limited by root, with setpriv, only", file=sys.stderr)
        return
    # The program must be where `nobody` may run it.
    global PROGRAM
    own, PROGRAM = PROGRAM, trial.path("smalto")
    shutil.copy(own, PROGRAM)
    user = ["setpriv", "--reuid", "65534", "--regid", "65534", "--clear-groups"]
    for allowed in [2, 3, 4, 5, 6, 7, 8, 12]:
        # The limit is set for the other user: root's own processes do not count.
        shell = ["sh", "-c", f'ulimit -u {allowed}; exec "$0" "$@"']
        for command in RANDOM.sample(COMMANDS, 4):
            if trial.goes_on():
                trial.run(command, prefix=[*user, *shell], limited=True, HOME=trial.folder)
    PROGRAM = own


def full_disks(trial):
    disk = trial.path("disk")
    os.mkdir(disk)
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=2m", "none", disk], stderr=subprocess.DEVNULL).returncode:
        print("no file system can be mounted: no full disks", file=sys.stderr)
        return
    try:
        with open(disk + "/fill", "wb") as file:
            file.write(bytes(1 << 20))
        outputs = ["c.ply", "c.sog", "sog/meta.json", "l.smalto"]
        commands = [["convert", "cactus:20000", "disk/" + name] for name in outputs]
        commands += [["lod", "cactus:20000", "-o", "disk/lod-meta.json"]]
        commands += [["render", "cactus:100", "--size", "2000x2000", "--format", "exr", "-o", "disk/a.exr"]]
        for command in commands:
            trial.run(command, expected=(0, 1))
            left = [name for name in os.listdir(disk) if ".part" in name]
            if left:
                trial.fault("leftovers", f"{command}: {left}")
            for name in set(os.listdir(disk)) - {"fill"}:
                path = f"{disk}/{name}"
                shutil.rmtree(path) if os.path.isdir(path) else os.remove(path)
        with open(disk + "/fill", "ab") as file:
            try:
                file.write(bytes(4 << 20))
            except OSError:
                pass
        for command in (["doctor"], ["render", "cactus:10", "--size", "8x8", "-o", "a.png"]):
            trial.run(command, expected=(0,), XDG_CACHE_HOME=disk)
    finally:
        subprocess.run(["umount", disk])


def links(trial):
    with open(trial.path("victim"), "w") as file:
        file.write("precious")
    os.mkdir(trial.path("out"))
    os.symlink("../victim", trial.path("out/.smalto-run.jsonl"))
    trial.run(["render", "cactus:10", "--orbit", "2", "--size", "8x8", "-o", "out"], expected=(1,))
    os.mkdir(trial.path(".a.smalto.unfinished"))
    open(trial.path(".a.smalto.unfinished/unfinished"), "w").close()
    for name in ("scene", "state.json", "state.json.new", "header", "pages"):
        os.symlink("../victim", trial.path(".a.smalto.unfinished/" + name))
    trial.run(["lod", "cactus:5000", "-o", "a.smalto"], expected=(0, 1))
    with open(trial.path("victim")) as file:
        if file.read() != "precious":
            trial.fault("torn", "a link was followed")


def main():
    megabyte = 1_000_000
    trials = [
        ("convert to .sog, ended by signals", 0.1,
         lambda t: killed_outputs(t, ["convert", "cactus:6000"], "c.sog", ())),
        ("convert to .ply, ended by signals", 0.07,
         lambda t: killed_outputs(t, ["convert", "cactus:60000"], "c.ply", ())),
        ("lod to .smalto, ended by signals", 0.1,
         lambda t: killed_outputs(t, ["lod", "cactus:8000", "-o"], "l.smalto", (".l.smalto.unfinished",))),
        ("pictures, ended by signals and resumed", 0.12, killed_pictures),
        ("videos, ended by signals", 0.12, killed_videos),
        ("scenes from a pipe, ended by signals", 0.08, killed_pipes),
        ("huge files, endless pipes", 0.1, floods),
        ("links in the way", 0.05, links),
        ("threads 2 to 12", 0.12, threads),
        ("memory 0.3 to 2 GB", 0.12, lambda t: limits(
            t, resource.RLIMIT_AS, [n * megabyte for n in (300, 500, 700, 900, 1100, 1500, 2000)], COMMANDS)),
        ("descriptors 4 to 12", 0.12, lambda t: limits(t, resource.RLIMIT_NOFILE, range(4, 13), COMMANDS)),
        ("size of files 0 to 1 MB", 0.08, lambda t: limits(
            t, resource.RLIMIT_FSIZE, [0, 1000, 100_000, megabyte], COMMANDS)),
        ("full disks", 0.1, full_disks),
    ]
    for name, share, work in trials:
        trial = Trial(name, share)
        try:
            work(trial)
        finally:
            trial.close()
    print(f"{'':42}" + "".join(f"{name:>12}" for name in COUNTS))
    for name, counts in table.items():
        print(f"{name:42}" + "".join(f"{counts[kind]:>12}" for kind in COUNTS))
    print("\n".join(faults))
    sys.exit(bool(faults))


main()
