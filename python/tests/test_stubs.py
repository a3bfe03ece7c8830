"""The stubs for editors and type checkers name what the module has."""

import ast
import inspect
import pathlib
import subprocess
import sys

import docstrings
import pytest
import smalto
from smalto import _smalto

TEXT = (pathlib.Path(smalto.__file__).parent / "_smalto.pyi").read_text()
STUBS = ast.parse(TEXT)


def parameters(function):
    args = function.args
    names = [arg.arg for arg in args.posonlyargs + args.args + args.kwonlyargs + [args.vararg, args.kwarg] if arg]
    return [name for name in names if name != "self"]


def check(stub, found, where):
    assert parameters(stub) == [name for name in inspect.signature(found).parameters if name != "self"], where
    assert where.startswith("_smalto") or found.__doc__, f"{where} has no docstring"


def test_stubs_name_what_there_is():
    private = {"Channels", "DeviceArrays", "Exported", "device_for_cuda", "main"}
    named = set()
    for node in STUBS.body:
        if isinstance(node, ast.FunctionDef):
            named.add(node.name)
            if node.name not in private:
                check(node, getattr(_smalto, node.name), node.name)
        if isinstance(node, ast.ClassDef):
            named.add(node.name)
            found = getattr(_smalto, node.name)
            members = {member.name for member in node.body if isinstance(member, ast.FunctionDef)}
            public = {name for name in vars(found) if not name.startswith("_")}
            assert public == {name for name in members if not name.startswith("_")}, node.name
            for member in (member for member in node.body if isinstance(member, ast.FunctionDef)):
                if member.name == "__init__":
                    check(member, found, node.name)
                elif not member.name.startswith("_") and callable(getattr(found, member.name)):
                    if node.name not in private:
                        check(member, getattr(found, member.name), f"{node.name}.{member.name}")
        if isinstance(node, ast.AnnAssign):
            named.add(node.target.id)
    assert named >= {name for name in vars(_smalto) if not name.startswith("__")}


def test_stubs_have_the_docstrings_of_the_module():
    assert TEXT == docstrings.documented(TEXT, _smalto), "python/tests/docstrings.py writes them"
    for node, found in docstrings.public(STUBS, _smalto):
        assert ast.get_docstring(node), node.name
        assert "Ellipsis" not in str(getattr(found, "__text_signature__", "")), node.name


def test_presets_of_the_stubs_are_those_of_the_module():
    scene = smalto.Scene.read("cactus:100")
    with pytest.raises(ValueError, match="preset: expected one of") as error:
        smalto.Renderer(scene, preset="none")
    found = str(error.value).split("one of ")[1].split(", found")[0].split(", ")
    line = next(line for line in TEXT.splitlines() if line.startswith("Preset = "))
    assert [name.strip('" ') for name in line.split("[")[1].strip("]").split(",")] == found


# What runs, and what does not: lines with a comment "error" are refused by type checkers, and no others.
USER = """
import numpy as np
import smalto

scene = smalto.Scene.read("cactus:100")
camera = scene.camera(np.int64(16), 12)
renderer = smalto.Renderer(scene, preset="exact", device=0, sh_degree=1)
picture = renderer.render(camera, background=[1, 1, 1], layers=["depth"], dtype=np.uint8)
renderer.render(camera, background=np.ones(3), layers=("color",), dtype="float32")
for picture in renderer.render_many([camera.resized(np.array([16, 12]))], background=None):
    print(picture.color.mean())
again = smalto.Camera(K=camera.K, size=[16, 12], c2w=camera.c2w)
print(again == camera, hash(again))
colors, alphas, meta = smalto.rasterization(
    scene.means, scene.quats, scene.scales, scene.opacities, scene.sh, camera.viewmat[None], camera.K[None], 16, 12,
    sh_degree=0, render_mode="RGB+ED",
)
print(colors.shape, meta["radii"])
smalto.release()


def window(scene: smalto.Scene) -> None:
    with smalto.view(scene, "--size", "64x48") as shown:
        shown.update(scene)


smalto.Renderer(scene, preset="exakt")  # error
renderer.render(camera, layers=("normals",))  # error
renderer.render(camera, dtype="float16")  # error
smalto.rasterization(1, 2, 3, 4, 5, 6, 7, 8, 9, render_mode="rgb")  # error
"""


def refused_lines(command, output):
    checked = subprocess.run(command, capture_output=True, text=True)
    lines = {int(line.split(":")[output]) for line in checked.stdout.splitlines() if ": error" in line or "- error" in line}
    return lines, checked.stdout


@pytest.mark.parametrize("checker", ["mypy", "pyright"])
def test_type_checkers_accept_what_runs_and_refuse_what_does_not(checker, tmp_path):
    pytest.importorskip(checker, reason=f"{checker} is not installed")
    # The package pyright brings its program from the network.
    if subprocess.run([sys.executable, "-m", checker, "--version"], capture_output=True).returncode != 0:
        pytest.skip(f"{checker} does not run here")
    file = tmp_path / "user.py"
    file.write_text(USER)
    command = [sys.executable, "-m", "mypy", "--strict", "--cache-dir", tmp_path / "cache", file]
    if checker == "pyright":
        command = [sys.executable, "-m", "pyright", "--pythonpath", sys.executable, file]
    found, said = refused_lines(command, 1)
    assert found == {i for i, line in enumerate(USER.splitlines(), 1) if line.endswith("# error")}, said
