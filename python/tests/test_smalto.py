"""The package as it is installed. The device is that of SMALTO_DEVICE; with SMALTO_VALIDATION=1, any complaint fails."""

import copy
import gc
import json
import multiprocessing
import os
import pickle
import subprocess
import sys
import threading

import numpy as np
import pytest
import smalto

SIZE = (160, 120)


@pytest.fixture(scope="module")
def scene():
    return smalto.Scene.read("cactus:5000")


@pytest.fixture(scope="module")
def renderer(scene):
    renderer = smalto.Renderer(scene, preset="exact")
    yield renderer
    assert renderer.validation_messages == []


def arrays(scene):
    return {name: getattr(scene, name) for name in ("means", "quats", "scales", "opacities", "sh")}


def test_five_lines_give_the_picture_of_the_command(tmp_path):
    scene = smalto.Scene.read("cactus:5000")
    smalto.Renderer(scene).render(scene.camera(*SIZE)).save(tmp_path / "module.png")
    command = ["-m", "smalto", "render", "cactus:5000", "--size", "160x120", "-o", tmp_path / "command.png"]
    subprocess.run([sys.executable, *command], check=True)
    assert (tmp_path / "module.png").read_bytes() == (tmp_path / "command.png").read_bytes()


def test_exit_codes_are_those_of_the_program():
    wrong = [(["render", "no-such-file.ply"], 4), (["render", "--no-such-flag"], 2), (["--version"], 0)]
    for arguments, code in wrong:
        ended = subprocess.run([sys.executable, "-m", "smalto", *arguments], capture_output=True)
        assert ended.returncode == code, arguments


def test_arrays_have_their_shapes_and_agree_with_the_reference(scene, renderer):
    camera = scene.camera(*SIZE)
    picture = renderer.render(camera, layers=("color", "alpha", "depth"))
    assert picture.color.shape == (120, 160, 3) and picture.color.dtype == np.float32
    assert picture.color8.dtype == np.uint8
    assert picture.alpha.shape == picture.depth.shape == (120, 160)
    assert picture.visible > 0 and picture.timings["frame"] > 0
    reference = smalto.reference(scene, camera, preset="exact")
    assert smalto.compare(picture, reference)["psnr_db"] > 90
    both = ~np.isnan(picture.depth) & ~np.isnan(reference.depth)
    assert np.abs(picture.depth - reference.depth)[both].max() < 1e-2


def test_a_scene_from_arrays_draws_the_same_bits(scene, renderer):
    camera = scene.camera(*SIZE)
    again = smalto.Scene.from_arrays(**arrays(scene))
    for name, values in arrays(scene).items():
        assert np.array_equal(values, getattr(again, name)), name
    expected = renderer.render(camera).color
    assert np.array_equal(smalto.Renderer(again, preset="exact").render(camera).color, expected)


def test_the_psnr_of_levels_is_measured_and_kept(tmp_path):
    file = tmp_path / "cactus.smalto"
    command = ["-m", "smalto", "lod", "cactus:20000", "-o", file]
    subprocess.run([sys.executable, *command], check=True, capture_output=True)
    scene = smalto.Scene.read(file)
    camera = scene.camera(*SIZE)
    levels, whole = smalto.Renderer(scene, lod_psnr=35), smalto.Renderer(scene)
    measured = smalto.compare(levels.render(camera), whole.render(camera))["psnr_db"]
    assert 35 <= measured < 45
    assert levels.measure_levels(camera) == pytest.approx((measured, 0), abs=1e-4)
    psnr, error = levels.measure_levels(camera, patches=2)
    assert error > 0 and psnr != measured
    with pytest.raises(ValueError, match="the pictures have no levels"):
        whole.measure_levels(camera)
    with pytest.raises(ValueError, match="patches: expected 2 or more"):
        levels.measure_levels(camera, patches=1)


def test_several_devices_draw_the_bytes_of_one(scene, renderer):
    camera = scene.camera(160, 240)
    split = smalto.SplitRenderer(scene, [renderer.device, renderer.device], preset="exact")
    assert split.devices == [renderer.device] * 2
    layers = ("color", "alpha", "depth")
    expected = renderer.render(camera, layers=layers, background=(0.2, 0.4, 0.6))
    for _ in range(3):
        picture = split.render(camera, layers=layers, background=(0.2, 0.4, 0.6))
        for name in ("color", "alpha", "depth"):
            assert np.array_equal(getattr(picture, name), getattr(expected, name), equal_nan=True), name
    top = 0
    for band in split.bands:
        assert band["top"] == top and band["gpu_ms"] > 0 and band["ms"] > 0
        top += band["rows"]
    assert top == 240 and len(split.bands) == 2
    assert picture.visible is None and picture.timings["frame"] > 0
    small = split.render(camera.resized((100, 150)), dtype="uint8")
    assert np.array_equal(small.color, renderer.render(camera.resized((100, 150)), dtype="uint8").color)
    assert small.alpha.dtype == np.uint8 and small.alpha.shape == (150, 100)
    assert split.validation_messages == []


def test_written_scenes_are_read_again(scene, tmp_path):
    scene.write(tmp_path / "scene.ply")
    assert len(smalto.Scene.read(tmp_path / "scene.ply")) == len(scene)
    with pytest.raises(ValueError, match="scenes are written as"):
        scene.write(tmp_path / "scene.txt")


def test_files_are_turned_as_they_are_read(scene, tmp_path):
    file = tmp_path / "scene.ply"
    scene.write(file)
    x, y, z = scene.means.T
    assert np.array_equal(smalto.Scene.read(file, flip="yz").means, np.stack([x, -y, -z], -1))
    assert np.allclose(smalto.Scene.read(file, up="z").means, np.stack([x, -z, y], -1))
    with pytest.raises(ValueError, match="up: expected x, y, z"):
        smalto.Scene.read(file, up="w")
    with pytest.raises(ValueError, match="flip: expected some of"):
        smalto.Scene.read(file, flip="w")
    with pytest.raises(ValueError, match="level"):
        smalto.Scene.read(file, sog_level=3)


def test_many_pictures_are_those_drawn_alone_in_their_order(scene, renderer):
    cameras = [scene.camera(64 + 8 * i, 48) for i in range(7)]
    alone = [renderer.render(camera).color for camera in cameras]
    together = [picture.color for picture in renderer.render_many(iter(cameras))]
    assert len(together) == 7
    assert all(np.array_equal(a, b) for a, b in zip(alone, together))


def test_a_camera_keeps_its_matrices(scene):
    camera = scene.camera(*SIZE)
    again = smalto.Camera(K=camera.K, size=SIZE, viewmat=camera.viewmat)
    assert np.allclose(again.viewmat, camera.viewmat, atol=1e-12)
    assert np.allclose(again.viewmat @ again.c2w, np.eye(4), atol=1e-12)
    inverse = smalto.Camera(K=camera.K, size=SIZE, c2w=camera.c2w)
    assert np.allclose(inverse.viewmat, camera.viewmat, atol=1e-12)


def test_certificates_bound_the_distance_to_what_leaves_nothing_out(scene):
    camera = scene.camera(*SIZE)
    picture = smalto.Renderer(scene, preset="fast", certified=True, near=0.01).render(camera)
    complete = smalto.reference(scene, camera, near=0.01, alpha_min=1e-9)
    assert picture.certificate.shape == (120, 160, 4)
    assert np.abs(picture.color - complete.color).max() < picture.certificate[..., :3].max() + 0.01


def test_an_updated_renderer_draws_the_new_scene(scene):
    renderer = smalto.Renderer(scene)
    camera = scene.camera(*SIZE)
    before = renderer.render(camera).alpha
    thinner = arrays(scene)
    thinner["opacities"] = thinner["opacities"] * 0.1
    renderer.update(smalto.Scene.from_arrays(**thinner))
    assert renderer.render(camera).alpha.mean() < before.mean() - 0.1


def test_a_renderer_draws_by_the_rules_of_its_scene_of_now(scene):
    camera = scene.camera(*SIZE)
    smooth = smalto.Scene.from_arrays(**arrays(scene), antialiased=True)
    renderer = smalto.Renderer(scene)
    plain = renderer.render(camera).color.copy()
    renderer.update(smooth)
    expected = smalto.Renderer(smooth).render(camera).color
    assert np.array_equal(renderer.render(camera).color, expected) and not np.array_equal(plain, expected)
    forced = smalto.Renderer(scene, antialiased=True)
    forced.update(scene)
    assert np.array_equal(forced.render(camera).color, expected)


def test_pictures_do_not_depend_on_those_before(scene):
    near, far = scene.camera(*SIZE), scene.camera(*SIZE)
    far = smalto.Camera(K=far.K, size=SIZE, viewmat=far.viewmat, near=0.1)
    near = smalto.Camera(K=near.K, size=SIZE, c2w=[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.4], [0, 0, 0, 1]])
    close = smalto.Camera(K=near.K, size=SIZE, c2w=near.c2w, near=0.001)
    alone = [smalto.Renderer(scene).render(camera).color for camera in (near, close, far)]
    assert not np.array_equal(alone[0], alone[1])
    renderer = smalto.Renderer(scene)
    order = [0, 1, 2, 0, 2, 1, 0]
    together = renderer.render_many((near, close, far)[i] for i in order)
    assert all(np.array_equal(picture.color, alone[i]) for picture, i in zip(together, order))


def test_an_update_leaves_the_pictures_that_are_being_drawn(scene):
    camera = scene.camera(*SIZE)
    renderer = smalto.Renderer(scene)
    expected = renderer.render(camera).color
    pictures = renderer.render_many([camera] * 4)
    first = next(pictures)
    black = arrays(scene)
    black["sh"] = np.full_like(black["sh"], -5)[:, :1]
    renderer.update(smalto.Scene.from_arrays(**black))
    rest = list(pictures)
    assert np.array_equal(first.color, expected) and np.array_equal(rest[0].color, expected)
    assert rest[-1].color.max() == 0


def test_an_update_that_fails_leaves_the_scene(scene, tmp_path):
    levels = tmp_path / "levels.smalto"
    subprocess.run([sys.executable, "-m", "smalto", "lod", "cactus:3000", "-o", levels], check=True)
    renderer, camera = smalto.Renderer(smalto.Scene.read(levels), splats=500), scene.camera(*SIZE)
    expected = renderer.render(camera).color
    with pytest.raises(ValueError, match="levels of detail"):
        renderer.update(scene)
    assert np.array_equal(renderer.render(camera).color, expected)


def test_pictures_of_bytes_are_those_of_files(scene, renderer):
    camera = scene.camera(101, 33)
    floats, bytes_ = renderer.render(camera), renderer.render(camera, dtype="uint8")
    assert bytes_.color.dtype == bytes_.alpha.dtype == np.uint8
    assert np.array_equal(bytes_.color, floats.color8) and np.array_equal(bytes_.color8, floats.color8)
    assert np.abs(bytes_.alpha / 255 - floats.alpha).max() < 0.51 / 255
    assert smalto.compare(bytes_, bytes_.color)["psnr_db"] is None
    assert bytes_._repr_png_() == floats._repr_png_()
    with pytest.raises(ValueError, match="dtype: uint8 needs a background"):
        renderer.render(camera, dtype="uint8", background=None)
    with pytest.raises(ValueError, match="dtype: expected float32 or uint8"):
        renderer.render(camera, dtype="float16")


def test_arrays_keep_their_pixels_when_pictures_go(scene, renderer):
    cameras = [scene.camera(64, 48), scene.camera(64, 48).resized((64, 47))]
    kept = [renderer.render(camera).color for camera in cameras]
    expected = [color.copy() for color in kept]
    for picture in renderer.render_many(cameras * 8):
        del picture
    gc.collect()
    assert all(np.array_equal(a, b) for a, b in zip(kept, expected))
    with pytest.raises(ValueError, match="read-only"):
        kept[0][0] = 0


def test_the_reference_keeps_the_degree_of_harmonics(scene):
    camera = scene.camera(*SIZE)
    plain = smalto.reference(scene, camera, preset="exact", sh_degree=0)
    drawn = smalto.Renderer(scene, preset="exact", sh_degree=0).render(camera)
    assert smalto.compare(drawn, plain)["psnr_db"] > 90
    assert smalto.compare(drawn, smalto.reference(scene, camera, preset="exact"))["psnr_db"] < 60


def test_a_transparent_background_leaves_alpha():
    one = smalto.Scene.from_arrays([[0, 0, 0]], [[1, 0, 0, 0]], [[0.2, 0.2, 0.2]], [0.8], [[[1, 0, 0]]])
    renderer, camera = smalto.Renderer(one), one.camera(*SIZE)
    picture = renderer.render(camera, background=None)
    assert picture.alpha.max() > 0.7
    assert picture.alpha.min() == 0 and picture.color[picture.alpha == 0].max() == 0
    white = renderer.render(camera, background=(1, 1, 1))
    assert np.allclose(white.color, picture.color + (1 - picture.alpha)[..., None], atol=1e-5)


@pytest.mark.parametrize(
    "change, error, text",
    [
        ({"means": np.zeros((5, 2))}, ValueError, r"means: expected the shape \(N, 3\)"),
        ({"quats": np.zeros((5, 4))}, ValueError, "quats: the length is 0 in row 0"),
        ({"scales": np.full((5, 3), -1.0)}, ValueError, "scales: a standard deviation is negative in row 0"),
        ({"opacities": np.full(5, 1.5)}, ValueError, "opacities: a value is not from 0 to 1 in row 0"),
        ({"opacities": np.ones(4)}, ValueError, r"opacities: expected the shape \(5,\)"),
        ({"sh": np.zeros((5, 2, 3))}, ValueError, "sh: expected 1, 4, 9, 16 or 25 coefficients, found 2"),
        ({"means": np.full((5, 3), np.nan)}, ValueError, "means: the value NaN in row 0 is not finite"),
        ({"means": np.full((5, 3), "x")}, TypeError, "means: expected numbers"),
    ],
)
def test_wrong_arrays_are_one_clear_exception(change, error, text):
    good = {
        "means": np.zeros((5, 3)),
        "quats": np.tile([1.0, 0, 0, 0], (5, 1)),
        "scales": np.ones((5, 3)),
        "opacities": np.ones(5),
        "sh": np.zeros((5, 1, 3)),
    }
    smalto.Scene.from_arrays(**good)
    with pytest.raises(error, match=text):
        smalto.Scene.from_arrays(**(good | change))


def test_wrong_requests_are_one_clear_exception(scene, renderer, tmp_path):
    with pytest.raises(ValueError, match="preset: expected one of balanced"):
        smalto.Renderer(scene, preset="best")
    with pytest.raises(ValueError, match="there is no knob speed"):
        smalto.Renderer(scene, speed=1)
    with pytest.raises(ValueError, match="sh_degree=7: expected"):
        smalto.Renderer(scene, sh_degree=7)
    with pytest.raises(smalto.DeviceError):
        smalto.Renderer(scene, device="no such device")
    with pytest.raises(smalto.UnreadableError):
        smalto.Scene.read(tmp_path / "missing.ply")
    with pytest.raises(ValueError, match="one pose"):
        smalto.Camera(K=np.eye(3), size=(8, 8))
    with pytest.raises(ValueError, match="no depth"):
        renderer.render(scene.camera(8, 8)).depth
    with pytest.raises(ValueError, match="layers"):
        renderer.render(scene.camera(8, 8), layers=("normals",))
    with pytest.raises(ValueError, match="differ in size"):
        smalto.compare(np.zeros((4, 4, 3)), np.zeros((4, 5, 3)))


@pytest.mark.parametrize(
    "call, error, text",
    [
        (lambda r, c: r.render(c, background=(1, 1)), ValueError, r"background: expected the shape \(3,\), found \(2,\)"),
        (lambda r, c: r.render(c, background="red"), TypeError, "background: expected numbers"),
        (lambda r, c: r.render(c, background=...), TypeError, "background: expected numbers"),
        (lambda r, c: r.render(c, background=(1, 1, np.nan)), ValueError, "background: the value NaN"),
        (lambda r, c: r.render(c, layers="depth"), TypeError, "layers: expected some of"),
        (lambda r, c: r.render(c, layers=[3]), TypeError, "layers: expected some of .* found 3"),
        (lambda r, c: r.render(c, dtype=3), TypeError, "dtype: expected float32 or uint8, found 3"),
        (lambda r, c: r.render(3), TypeError, "camera: expected a Camera, found 3"),
        (lambda r, c: r.render_many(3), TypeError, "cameras: expected an iterable"),
        (lambda r, c: list(r.render_many([3])), TypeError, "cameras: expected cameras, found 3"),
        (lambda r, c: c.resized((-1, 5)), ValueError, "size: -1 is not from 1 to 65536"),
        (lambda r, c: c.resized((16.0, 12)), TypeError, "size: expected whole numbers"),
        (lambda r, c: c.resized(5), ValueError, r"size: expected the shape \(2,\)"),
        (lambda r, c: smalto.Renderer(SMALL, memory=-1), ValueError, "memory: expected a number of bytes"),
        (lambda r, c: smalto.Renderer(SMALL, memory="1G"), TypeError, "memory: expected a number of bytes"),
        (lambda r, c: smalto.Renderer(SMALL, device=1.5), TypeError, "device: expected the number of a device"),
        (lambda r, c: smalto.SplitRenderer(SMALL, []), ValueError, "devices: the list is empty"),
        (lambda r, c: smalto.SplitRenderer(SMALL, 1.5), TypeError, "devices: expected numbers of devices"),
        (lambda r, c: smalto.SplitRenderer(SMALL, preset="best"), ValueError, "preset: expected one of"),
        (lambda r, c: smalto.Renderer(SMALL, preset=3), TypeError, "preset: expected one of"),
        (lambda r, c: smalto.Renderer(c), TypeError, "scene: expected a Scene"),
        (lambda r, c: smalto.Scene.read(3), TypeError, "path: expected a path, found 3"),
        (lambda r, c: SMALL.camera(0, 8), ValueError, "width: 0 is not from 1"),
        (lambda r, c: SMALL.camera(8, 8.0), TypeError, "height: expected a whole number"),
        (lambda r, c: smalto.reference(SMALL, SMALL), TypeError, "camera: expected a Camera"),
        (lambda r, c: smalto.Camera(K=[[1], [2, 3]], size=(8, 8), c2w=np.eye(4)), TypeError, "K: expected numbers"),
        (lambda r, c: smalto.Camera(K=c.K + np.eye(3, k=1), size=(8, 8), c2w=np.eye(4)), ValueError, "K: expected"),
        (lambda r, c: smalto.Camera(K=c.K * 2, size=(8, 8), c2w=np.eye(4)), ValueError, "K: expected"),
        (lambda r, c: smalto.Camera(K=c.K, size=(8, 8), c2w=np.eye(4) * 2), ValueError, "c2w: the last row"),
        (lambda r, c: smalto.Camera(K=c.K, size=(8, 8), viewmat=np.tri(4)), ValueError, "viewmat: the last row"),
        *[
            (lambda r, c, near=near: smalto.Camera(K=c.K, size=(8, 8), c2w=np.eye(4), near=near), ValueError, "near: exp")
            for near in (-1, 0, float("nan"), float("inf"), 1e-60)
        ],
    ],
)
def test_wrong_arguments_are_named(renderer, call, error, text):
    with pytest.raises(error, match=text) as raised:
        call(renderer, renderer_camera(renderer))
    # Python 3.10 has no notes: the text itself names the argument.
    assert not getattr(raised.value, "__notes__", [])


SMALL = smalto.Scene.read("cactus:100")


def renderer_camera(_):
    return SMALL.camera(16, 12)


def test_arguments_may_be_lists_arrays_and_integers_of_numpy(renderer):
    camera = SMALL.camera(np.int32(16), np.uint8(12))
    assert camera.resized(np.array([8, 6])).size == camera.resized([8, 6]).size == (8, 6)
    expected = renderer.render(camera, background=(1, 1, 1)).color
    for white in ([1, 1, 1], np.ones(3), np.ones(3, np.uint8)):
        assert np.array_equal(renderer.render(camera, background=white).color, expected)
    assert renderer.render(camera, dtype=np.uint8).color.dtype == np.uint8
    assert renderer.render(camera, dtype=np.dtype("float32"), layers={"depth": 1}).depth.shape == (12, 16)


def test_cameras_are_values(tmp_path):
    camera = SMALL.camera(16, 12)
    named = smalto.Camera(K=camera.K, size=camera.size, c2w=camera.c2w, near=camera.near, name="a")
    for one in (camera, named):
        copies = [pickle.loads(pickle.dumps(one)), copy.copy(one), copy.deepcopy(one)]
        assert all(again == one and hash(again) == hash(one) and again.name == one.name for again in copies)
        assert all(np.array_equal(again.viewmat, one.viewmat) for again in copies)
    assert camera != named and camera != camera.resized((8, 6)) and camera != 3
    assert len({camera, named, copy.copy(named)}) == 2


def bent(camera, lens):
    return smalto.Camera(K=camera.K, size=camera.size, c2w=camera.c2w, lens=lens)


def test_pixels_without_a_ray_are_not_compared(scene):
    K = [[12, 0, 48], [0, 12, 32], [0, 0, 1]]  # eight radians from the left to the right
    camera = smalto.Camera(K=K, size=(96, 64), viewmat=np.eye(4), lens=("FISHEYE", []))
    blind = np.isnan(camera.rays()[1][..., 0])
    assert 1000 < blind.sum() < blind.size
    picture = smalto.Renderer(scene).render(camera)
    photograph = np.where(blind[..., None], 1.0, picture.color).astype(np.float32)
    assert smalto.compare(picture, photograph)["psnr_db"] < 10
    assert smalto.compare(picture, photograph, camera=camera)["psnr_db"] is None


def test_a_picture_through_a_lens_is_that_of_the_command(scene, tmp_path):
    lens = ("OPENCV_FISHEYE", [0.01, -0.002, 0.0, 0.1])
    turn = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
    pinhole = {"width": 160, "height": 120, "position": [0, 0, -3], "rotation": turn, "fx": 80, "fy": 81}
    file = tmp_path / "cameras.json"
    file.write_text(json.dumps([pinhole | {"lens": {"model": lens[0], "parameters": lens[1]}}, pinhole]))
    camera, plain = smalto.Camera.read(file)
    assert (camera.lens, plain.lens) == (lens, None)
    assert bent(camera, lens).lens == lens and bent(camera, lens).K.tolist() == camera.K.tolist()
    renderer = smalto.Renderer(scene)
    picture = renderer.render(camera)
    assert not np.array_equal(picture.color, renderer.render(plain).color)
    picture.save(tmp_path / "module.png")
    command = ["-m", "smalto", "render", "cactus:5000", "--cameras", file, "-o", tmp_path / "command.png"]
    subprocess.run([sys.executable, *command, "--camera", "0"], check=True)
    assert (tmp_path / "module.png").read_bytes() == (tmp_path / "command.png").read_bytes()
    assert smalto.compare(picture, smalto.reference(scene, camera))["psnr_db"] > 50
    exact = smalto.Renderer(scene, preset="exact").render(camera, layers=("depth",)).depth
    np.testing.assert_allclose(exact, smalto.reference(scene, camera, preset="exact").depth, rtol=1e-3)
    certified = smalto.Renderer(scene, preset="exact", certified=True).render(camera)
    complete = smalto.reference(scene, camera, preset="exact", alpha_min=1e-9).color
    assert np.all(np.abs(certified.color - complete).max(axis=2) <= certified.certificate[..., 0] + 1e-3)
    along_rays = smalto.Renderer(scene, response="ray").render(plain)
    assert smalto.compare(along_rays, smalto.reference(scene, plain, response="ray"))["psnr_db"] > 50
    assert not np.array_equal(along_rays.color, renderer.render(plain).color)
    assert np.array_equal(renderer.render(camera.undistorted()).color, renderer.render(plain).color)
    assert renderer.validation_messages == []


def test_lenses_are_values_of_cameras():
    plain = SMALL.camera(16, 12)
    camera, other = (bent(plain, ("SIMPLE_RADIAL", [k])) for k in (-0.1, 0.1))
    as_array = bent(plain, ("SIMPLE_RADIAL", np.array([-0.1])))
    for again in (pickle.loads(pickle.dumps(camera)), copy.copy(camera), as_array):
        assert again == camera and hash(again) == hash(camera) and again.lens == ("SIMPLE_RADIAL", [-0.1])
    pinhole = camera.undistorted()
    assert pinhole.lens is None and pinhole == bent(plain, None) == bent(plain, "PINHOLE")
    assert len({camera, other, pinhole}) == 3
    assert camera.resized((8, 6)).lens == camera.lens
    for model in ("EQUIRECTANGULAR", "ORTHOGRAPHIC"):
        assert bent(plain, model).lens == (model, [])
        with pytest.raises(ValueError, match=f"no pinhole sees what its model {model} does"):
            bent(plain, model).undistorted()
    for lens, error, text in [
        ("ROUND", ValueError, "lens: its camera model ROUND is not known"),
        ("OPENCV", ValueError, "lens: OPENCV has 4 lens parameters .k1, k2, p1, p2., it has 0"),
        (("FOV", [4.0]), ValueError, "lens: its omega 4.0 is not over 0"),
        (("FOV", "wide"), TypeError, "lens: expected the name of a model"),
        (3, TypeError, "lens: expected the name of a model, or .name, parameters., found 3"),
    ]:
        with pytest.raises(error, match=text):
            bent(plain, lens)


def test_pictures_before_an_error_of_the_cameras_are_drawn(renderer):
    camera = SMALL.camera(16, 12)

    def cameras():
        yield from [camera] * 5
        raise KeyError("the camera cannot be read")

    pictures = renderer.render_many(cameras())
    assert len([next(pictures) for _ in range(5)]) == 5
    with pytest.raises(KeyError, match="cannot be read"):
        next(pictures)
    assert list(pictures) == []


def test_an_empty_scene_is_its_background():
    empty = smalto.Scene.from_arrays(
        np.zeros((0, 3)), np.zeros((0, 4)), np.zeros((0, 3)), np.zeros(0), np.zeros((0, 1, 3))
    )
    picture = smalto.Renderer(empty).render(empty.camera(8, 8), background=(0.25, 0.5, 0.75))
    assert np.array_equal(picture.color[0, 0], np.float32([0.25, 0.5, 0.75]))


def test_arrays_that_are_not_aligned_are_read(scene):
    expected = smalto.Scene.from_arrays(**arrays(scene))
    odd = {name: np.frombuffer(b" " + values.tobytes(), "<f4", offset=1).reshape(values.shape)
           for name, values in arrays(scene).items()}
    assert np.array_equal(smalto.Scene.from_arrays(**odd).means, expected.means)


def test_threads_share_a_renderer(scene, renderer):
    camera = scene.camera(*SIZE)
    expected, found = renderer.render(camera).color, []
    threads = [threading.Thread(target=lambda: found.append(renderer.render(camera).color)) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 4 and all(np.array_equal(color, expected) for color in found)


def draw_in_a_fork(results):
    try:
        smalto.Camera(K=np.eye(3), size=(8, 8), c2w=np.eye(4))
        smalto.Scene.from_arrays([[0, 0, 0]], [[1, 0, 0, 0]], [[1, 1, 1]], [1], [[[0, 0, 0]]])
        results.put("drawn")
    except smalto.Error as error:
        results.put(str(error))


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not fork")
def test_a_forked_process_is_told_to_be_spawned(renderer):
    fork = multiprocessing.get_context("fork")
    results = fork.Queue()
    child = fork.Process(target=draw_in_a_fork, args=(results,))
    child.start()
    assert "'spawn'" in results.get(timeout=60)
    child.join(60)
    assert child.exitcode == 0


def resident():
    with open("/proc/self/statm") as statm:
        return int(statm.read().split()[1]) * 4096


@pytest.mark.skipif(sys.platform != "linux", reason="the memory of a process is read from /proc")
def test_frames_and_scenes_leave_no_memory_behind():
    scene = smalto.Scene.read("cactus:200")
    renderer, camera = smalto.Renderer(scene), scene.camera(32, 24)

    def work(times):
        for _ in range(times):
            renderer.render(camera)
            smalto.Renderer(smalto.Scene.from_arrays(**arrays(scene))).render(camera)
        gc.collect()
        return resident()

    before = work(30)
    # SMALTO_REPEAT=10000 is the long form of this test.
    after = work(int(os.environ.get("SMALTO_REPEAT", 60)))
    assert after - before < 24 << 20, f"{(after - before) / 1e6:.1f} MB more"
