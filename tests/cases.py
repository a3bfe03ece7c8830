#!/usr/bin/env python3
"""Runs the inputs and scripts of a folder of cases, and compares each with its expected result.

    python3 tests/cases.py FOLDER [PROGRAM] [PYTHON]

FOLDER has small files that other programs write, or that are damaged (its README says what each stands for). PROGRAM is
target/release/smalto by default; PYTHON, the Python whose package `smalto` the scripts `py-*.py` import, is
target/python-fresh/bin/python of python/build.sh. The exit code is 1 if a case differs from what is expected here.
"""

import json
import os
import re
import struct
import subprocess
import sys
import tempfile

if len(sys.argv) < 2:
    sys.exit(__doc__)
CASES = os.path.abspath(sys.argv[1])
PROGRAM = os.path.abspath(sys.argv[2] if len(sys.argv) > 2 else "target/release/smalto")
PYTHON = os.path.abspath(sys.argv[3] if len(sys.argv) > 3 else "target/python-fresh/bin/python")
OUT = tempfile.mkdtemp(prefix="cases-")
VIEW = ["--eye", "2.5,-1.5,-3", "--target", "0.3,0.3,0.3", "--size", "320x180"]
BASE = "00-base.ply"


def case(name):
    return os.path.join(CASES, name)


def run(*arguments, code=0):
    """Runs the program and returns standard output and errors as one text."""
    ran = subprocess.run([PROGRAM, *arguments], capture_output=True, text=True, timeout=300)
    assert ran.returncode == code, f"exit code {ran.returncode}, expected {code}: {ran.stderr}"
    return ran.stdout + ran.stderr


def render(name, *options, view=VIEW):
    out = os.path.join(OUT, name.replace("/", "-") + ".exr")
    return out, run("render", case(name), *view, "--preset", "exact", "-o", out, *options)


def psnr(first, second):
    pair = json.loads(run("compare", first, second, "--json", "-"))["pairs"][0]
    decibels = pair["difference"]["psnr_db"]
    return float("inf") if decibels is None else decibels


def draws(name, expected, at_least=60.0, says=()):
    """The picture of a file is that of another, and the program says these words."""
    (picture, said), (wanted, _) = render(name), render(expected)
    decibels = psnr(picture, wanted)
    assert decibels >= at_least, f"{decibels:.1f} dB"
    for words in says:
        assert words in said, said
    return f"{decibels:.1f} dB to {expected}"


def georeferenced():
    out = os.path.join(OUT, "moved.ply")
    run("convert", case("06-georeferenced-doubles.ply"), out, "--transform", "translate=-500123.37,-5301234.61,-412.125")
    expected = [(0, 0, 0), (0.3, 0, 0), (0, 0.3, 0), (0, 0, 0.3), (0.21, 0.21, 0.06)]
    data = open(out, "rb").read()
    body = data.index(b"end_header\n") + 11
    names = re.findall(r"property float (\w+)", data[:body].decode())
    worst = 0.0
    for row, position in enumerate(expected):
        start = body + 4 * len(names) * row
        read = struct.unpack_from("<3f", data, start + 4 * names.index("x"))
        worst = max([worst, *(abs(a - b) for a, b in zip(read, position))])
    assert worst < 1e-4, worst
    note = run("info", case("06-georeferenced-doubles.ply"))
    assert "round" in note, note
    return f"means within {worst:.1e}; a note without a transform"


def near_plane():
    out = os.path.join(OUT, "near.png")
    cameras = case("07-near-plane.cameras.json")
    said = run("render", case("07-near-plane.ply"), "--cameras", cameras, "--camera", "0", "-o", out)
    assert "near plane" in said and "--near" in said, said
    return re.search(r"note: (.*near plane.*)", said)[1]


def stray_camera():
    _, said = render("08-stray-camera-file/a/b/scene.ply", view=["--size", "64x36"])
    assert "not used" in said, said
    return "a note and the default view"


def camera_path():
    folder = os.path.join(OUT, "film")
    run("render", case(BASE), "--path", case("10-nerfstudio-camera-path.json"), "-o", folder)
    pictures = [name for name in os.listdir(folder) if name.endswith(".png")]
    assert len(pictures) == 5, pictures
    return "5 pictures"


def refuses(name, *words, code=4):
    said = run("info", case(name), code=code)
    for word in words:
        assert word in said, said
    return f"exit code {code}: " + said.strip().splitlines()[-1].replace(CASES, "")[:100]


def nodes():
    counted = json.loads(run("info", case("adv-nodes-8000.glb"), "--json", "-"))
    assert re.search(r"2400000", json.dumps(counted)), counted
    return "2,400,000 Gaussians, counted first"


def short_number():
    said = run("info", case("adv-node-scale-1e30.glb"))
    assert "2.22e30" in said and not re.search(r"\d{20}", said), said
    return "2.22e30"


def script(name, *words, absent=(), fails=False):
    """A script of the Python package prints these words and none of the others."""
    ran = subprocess.run([PYTHON, case(name)], capture_output=True, text=True, timeout=600)
    said = ran.stdout + ran.stderr
    assert (ran.returncode != 0) == fails, f"exit code {ran.returncode}: {said}"
    for word in words:
        assert re.search(word, said), said
    for word in absent:
        assert not re.search(word, said), said
    return (said.strip().splitlines() or ["exit code %d" % ran.returncode])[-1][:100]


def feature_shift():
    said = subprocess.run([PYTHON, case("py-feature-shift.py")], capture_output=True, text=True, timeout=600).stdout
    errors = [float(line.rsplit(" ", 1)[1]) for line in said.splitlines()]
    assert len(errors) == 4 and max(errors) < 1e-5, said
    return f"largest error {max(errors):.1e}"


CHECKS = [
    ("01-filter-3d.ply", lambda: draws("01-filter-3d.ply", "01-filter-3d.expected.ply", says=["filter_3D"])),
    # The file has opacities of 1 where the base has 0.9.
    ("02-opacity-just-over-1.glb", lambda: draws("02-opacity-just-over-1.glb", BASE, 38, ["just above 1"])),
    ("03-mirrored-node.glb", lambda: draws("03-mirrored-node.glb", "03-mirrored-node.expected.ply")),
    ("03-stretched-node.glb", lambda: draws("03-stretched-node.glb", "03-stretched-node.expected.ply")),
    ("04-axes-z-up.spz", lambda: draws("04-axes-z-up.spz", "04-axes-z-up.expected.ply", 35)),
    ("05-empty-sh-element", lambda: draws("05-empty-sh-element.compressed.ply", BASE, 30)),
    ("06-georeferenced-doubles.ply", georeferenced),
    ("07-near-plane.ply", near_plane),
    ("08-stray-camera-file", stray_camera),
    ("09-instances.glb", lambda: draws("09-instances.glb", "09-instances.expected.glb")),
    ("10-nerfstudio-camera-path.json", camera_path),
    ("11-scene.ply.gz", lambda: draws("11-scene.ply.gz", BASE)),
    ("12-spz-3-without-gzip.spz", lambda: draws("12-spz-3-without-gzip.spz", BASE, 30)),
    ("13-sh-degree-4.ply", lambda: draws("13-sh-degree-4.ply", "13-sh-degree-4.expected.ply")),
    ("adv-nodes-8000.glb", nodes),
    ("adv-node-zero-rotation.glb", lambda: refuses("adv-node-zero-rotation.glb", "rotation")),
    ("adv-node-scale-1e30.glb", short_number),
    ("py-camera-ignored.py", lambda: script("py-camera-ignored.py", "ValueError", fails=True)),
    ("py-channels-cost.py", lambda: script("py-channels-cost.py", "24 channels")),
    ("py-colors-none.py", lambda: script("py-colors-none.py", absent=["Error"])),
    # An array type as `dtype` and a number as `device` are taken.
    ("py-errors-name.py", lambda: script("py-errors-name.py", "background: ", "layers: ", "size: ", "memory: ",
                                         absent=["OverflowError"])),
    ("py-feature-shift.py", feature_shift),
    ("py-gsplat16-keywords.py", lambda: script("py-gsplat16-keywords.py", "shared harmonics ok", absent=["TypeError"])),
    ("py-meta.py", lambda: script("py-meta.py", "radii", "(?m)^1$")),
    ("py-pickle.py", lambda: script("py-pickle.py", absent=["Error", "cannot"])),
    # A `Camera` takes the nearest rotation within a documented limit; `rasterization` takes the matrix as it is.
    ("py-pose-drift.py", lambda: script("py-pose-drift.py", r"differ by 0\.00")),
    ("py-render-many-loses.py", lambda: script("py-render-many-loses.py", "2 of 2")),
]

failed = 0
for name, check in CHECKS:
    try:
        result = check()
    except Exception as error:  # a case that fails must not end the others
        failed += 1
        result = "FAILED: " + str(error).strip().replace("\n", " ")[:300]
    print(f"{name:32} {result}", flush=True)
print(f"{len(CHECKS)} cases, {failed} failed")
sys.exit(min(failed, 1))
