"""`rasterization` against gsplat's own PyTorch functions, whose results are stored in gsplat.npz."""

import math
import pathlib

import gsplat_cases
import numpy as np
import pytest
import smalto

CASES = gsplat_cases.cases()
RESULTS = np.load(pathlib.Path(gsplat_cases.__file__).parent / "gsplat.npz")


@pytest.mark.parametrize("name", CASES)
def test_pictures_are_those_of_gsplat(name):
    colors, alphas, meta = smalto.rasterization(**CASES[name])
    for found, what in ((colors, "colors"), (alphas, "alphas")):
        expected = RESULTS[f"{name}: {what}"]
        assert found.shape == expected.shape and found.dtype == np.float32
        assert expected.std() > 0.02
        assert np.abs(found - expected).max() < 1e-4, what
    assert (meta["width"], meta["height"], meta["n_cameras"]) == (*gsplat_cases.SIZE, gsplat_cases.CAMERAS)


def features_scene(count=400):
    """Gaussians with features before a camera; the first one is behind it."""
    random = np.random.RandomState(0)
    means = random.uniform(-1, 1, (count, 3)) + [0, 0, 4]
    means[0] = [0, 0, -50]
    return {
        "means": means.astype(np.float32),
        "quats": np.tile(np.float32([1, 0, 0, 0]), (count, 1)),
        "scales": np.full((count, 3), 0.1, np.float32),
        "opacities": np.full(count, 0.7, np.float32),
        "colors": random.uniform(0, 1, (count, 3)).astype(np.float32),
        "viewmats": np.eye(4, dtype=np.float32)[None],
        "Ks": np.float32([[[40, 0, 24], [0, 40, 16], [0, 0, 1]]]),
        "width": 48,
        "height": 32,
    }


def draw(arguments, **change):
    return smalto.rasterization(**(arguments | change))[0]


def test_features_of_any_size_are_drawn_to_the_precision_of_what_is_seen():
    arguments = features_scene()
    colors = arguments["colors"]
    expected = draw(arguments)
    for value in (-1.0, -1e2, -1e6, 1e30):
        odd = colors.copy()
        odd[0] = value
        assert np.array_equal(draw(arguments, colors=odd), expected), "a Gaussian that is not seen changes nothing"
    # Pictures are linear in features: of any size, and of any sign.
    for factor in (1e-6, -1.0, -3e5):
        found = draw(arguments, colors=colors * np.float32(factor))
        assert np.abs(found / factor - expected).max() < 1e-5


def test_opacities_that_rounding_moved_out_of_range_are_drawn():
    arguments = features_scene()
    exact, rounded = (arguments["opacities"].copy() for _ in range(2))
    exact[:2], rounded[:2] = [1, 0], [1.0000002, -1e-7]
    assert np.array_equal(draw(arguments, opacities=rounded), draw(arguments, opacities=exact))


def test_features_of_many_channels_are_those_of_three_each():
    arguments = features_scene()
    colors = np.random.RandomState(1).uniform(-2, 2, (400, 11)).astype(np.float32)
    arguments["opacities"][7:9] = 0
    together = draw(arguments, colors=colors)
    again = draw(arguments, colors=colors)
    for i in range(0, 11, 3):
        alone = draw(arguments, colors=colors[:, i : i + 3])
        assert np.array_equal(together[..., i : i + 3], alone) and np.array_equal(again[..., i : i + 3], alone)


def test_geometry_is_brought_once_for_all_channels(monkeypatch):
    from smalto import _gsplat

    made, brought = [], []

    class Counting:
        def __init__(self, scene, **options):
            made.append(scene)
            self.renderer = smalto.Renderer(scene, **options)

        def __getattr__(self, name):
            if name == "_bring":
                brought.append(name)
            assert name != "update"
            return getattr(self.renderer, name)

    smalto.release()
    monkeypatch.setattr(_gsplat, "Renderer", Counting)
    arguments = features_scene() | {"colors": np.ones((400, 12), np.float32)}
    for _ in range(3):
        draw(arguments)
    assert (len(made), len(brought)) == (1, 4)
    arguments["colors"][0] = 2
    draw(arguments)
    smalto.release()
    assert (len(made), len(brought)) == (1, 8)


@pytest.mark.parametrize("size", [1e-4, 1e-3])
def test_poses_are_used_as_they_are(size):
    arguments = features_scene()
    pose = np.eye(4)
    pose[:3, :3] += np.random.RandomState(3).normal(size=(3, 3)) * size
    pose[:3, 3] = [0.1, -0.2, 0.3]
    found = smalto.rasterization(**(arguments | {"viewmats": pose[None]}))
    seen = arguments["means"] @ pose[:3, :3].T + pose[:3, 3]
    expected = seen[:, :2] / seen[:, 2:] * 40 + [24, 16]
    assert np.abs(found[2]["means2d"] - expected[found[2]["gaussian_ids"]]).max() < 1e-4
    # Rounding may decide the stop of a pixel the other way, at 1e-4 of the light. A rotation in the place of the matrix
    # is 6e-3 off.
    assert np.abs(found[0][0] - blended(found[2], arguments["colors"], (48, 32))).max() < 5e-4
    with pytest.raises(ValueError, match="viewmats.*R R\\^T differs"):
        draw(arguments, viewmats=(pose * [[1.01], [1], [1], [1]])[None])


def blended(meta, colors, size):
    """The picture of the projected splats of one camera, in float64."""
    order = np.argsort(meta["depths"], kind="stable")
    x, y = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
    picture, left = np.zeros((size[1], size[0], colors.shape[-1])), np.ones((size[1], size[0]))
    for i in order:
        a, b, c = meta["conics"][i].astype(np.float64)
        dx, dy = x - meta["means2d"][i, 0], y - meta["means2d"][i, 1]
        alpha = np.minimum(meta["opacities"][i] * np.exp(-0.5 * (a * dx * dx + c * dy * dy) - b * dx * dy), 0.999)
        alpha = np.where((alpha < 1 / 255) | (left * (1 - alpha) <= 1e-4), 0, alpha)
        left_after = left * (1 - alpha)
        picture += (alpha * left)[..., None] * colors[meta["gaussian_ids"][i]]
        left = left_after
    return picture


def test_meta_has_the_projection_of_what_is_drawn():
    arguments = CASES["antialiased"] | {"near_plane": 3.5}
    _, _, packed = smalto.rasterization(**arguments)
    _, _, dense = smalto.rasterization(**arguments, packed=False)
    assert set(packed) == set(dense) >= {"radii", "means2d", "depths", "conics", "opacities", "tiles_per_gauss"}
    assert packed.get("radii") is not None and "radii" in packed and packed.get("none") is None
    n, (width, height) = gsplat_cases.GAUSSIANS, gsplat_cases.SIZE
    assert dense["radii"].shape == (2, n, 2) and dense["radii"].dtype == np.int32
    assert dense["camera_ids"] is None and dense["gaussian_ids"] is None
    seen = (dense["radii"] > 0).all(-1)
    assert 0 < seen.sum() < 2 * n
    assert np.array_equal(packed["camera_ids"], seen.nonzero()[0])
    assert np.array_equal(packed["gaussian_ids"], seen.nonzero()[1])
    for name in ("radii", "means2d", "depths", "conics", "opacities", "tiles_per_gauss"):
        assert np.array_equal(packed[name], dense[name][seen]), name
        assert not dense[name][~seen].any(), name
    assert (packed["tile_width"], packed["tile_height"]) == (2, 2) and packed["n_batches"] == 1
    total = dense["tiles_per_gauss"].sum()
    assert len(dense["isect_ids"]) == len(packed["flatten_ids"]) == total
    assert (np.diff(dense["isect_ids"]) >= 0).all()
    assert dense["isect_offsets"].shape == (2, 2, 2) and dense["isect_offsets"].max() <= total
    camera = smalto.Camera(K=arguments["Ks"][0], viewmat=arguments["viewmats"][0], size=(width, height))
    scene = smalto.Scene.from_arrays(
        *[arguments[name] for name in ("means", "quats", "scales", "opacities", "colors")], antialiased=True
    )
    # The GPU counts what touches a pixel centre, gsplat what may by its rounded box.
    assert 0.8 < smalto.Renderer(scene, preset="gsplat", near=3.5).render(camera).visible / seen[0].sum() <= 1
    dense["own"] = 1
    del dense["radii"]
    assert "own" in dense and "radii" not in dense


def test_nothing_has_a_meta_too():
    arguments = features_scene(1)
    nothing = {name: arguments[name][:0] for name in ("means", "quats", "scales", "opacities", "colors")}
    for change in (nothing, {"viewmats": arguments["viewmats"][:0], "Ks": arguments["Ks"][:0]}):
        for packed in (True, False):
            colors, _, meta = smalto.rasterization(**(arguments | change), packed=packed)
            assert not colors.any() and meta["radii"].size == meta["isect_ids"].size == meta["flatten_ids"].size == 0


def test_splats_of_small_radii_are_left_out():
    arguments = CASES["degree 3"]
    meta = smalto.rasterization(**arguments, packed=False)[2]
    clip = int(np.median(meta["radii"]))
    for camera in range(gsplat_cases.CAMERAS):
        one = arguments | {name: arguments[name][camera : camera + 1] for name in ("viewmats", "Ks")}
        rows = (meta["radii"][camera] > clip).any(-1)
        assert 0 < rows.sum() < gsplat_cases.GAUSSIANS
        rest = {name: arguments[name][rows] for name in ("means", "quats", "scales", "opacities", "colors")}
        found, _, clipped = smalto.rasterization(**one, radius_clip=clip)
        assert np.array_equal(found, draw(one, **rest)) and not np.array_equal(found, draw(one))
        assert np.array_equal(clipped["gaussian_ids"], rows.nonzero()[0])


def test_covariances_take_the_place_of_rotations_and_scales():
    arguments = CASES["RGB+ED"]
    w, x, y, z = arguments["quats"].T.astype(np.float64)
    turns = np.stack([
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    ], -1).reshape(-1, 3, 3)  # fmt: skip
    roots = turns * arguments["scales"][:, None, :]
    covars = roots @ roots.transpose(0, 2, 1)
    found = draw(arguments, covars=covars, quats=None, scales=None)
    assert np.abs(found - RESULTS["RGB+ED: colors"]).max() < 1e-4
    torch, devices_found = devices()
    for device in devices_found:
        tensors = on_torch(torch, arguments | {"covars": covars, "quats": None, "scales": None}, device)
        assert np.abs(draw(tensors).cpu().numpy() - found).max() < 1e-4


def test_keywords_of_gsplat_1_6_are_ignored_at_their_defaults():
    arguments = features_scene()
    expected = draw(arguments)
    MixedBatch = type("RendererConfig_MixedBatch", (), {})
    defaults = {
        "return_normals": False,
        "global_z_order": True,
        "rays": None,
        "lidar_coeffs": None,
        "external_distortion_coeffs": None,
        "ut_params": object(),
        "extra_signals": None,
        "extra_signals_sh_degree": None,
        "renderer_config": MixedBatch(),
        "tile_size": None,
    }
    assert np.array_equal(draw(arguments, **defaults), expected)
    for name in ("return_normals", "rays", "lidar_coeffs", "extra_signals", "renderer_config"):
        with pytest.raises(ValueError, match=f"{name}: smalto draws"):
            draw(arguments, **{name: 1})
    for mode in ("d", "Ed", "RGB-d", "RGB-Ed"):
        with pytest.raises(ValueError, match=f"render_mode: {mode} is a distance"):
            draw(arguments, render_mode=mode)


def test_depths_need_no_colors():
    arguments = CASES["ED"]
    expected = RESULTS["ED: colors"]
    assert np.abs(draw(arguments, colors=None, sh_degree=None) - expected).max() < 1e-4
    with pytest.raises(TypeError, match="colors: render_mode RGB needs them"):
        draw(arguments, colors=None, render_mode="RGB")


def test_harmonics_may_be_shared_by_a_batch():
    arguments = CASES["batch"]
    shared = arguments["colors"][0]
    expected = draw(arguments, colors=np.stack([shared, shared]))
    assert np.array_equal(draw(arguments, colors=shared), expected)


def test_half_precision_is_widened_before_the_arithmetic():
    arguments = CASES["degree 3"]
    halves = {name: values.astype(np.float16) for name, values in arguments.items() if isinstance(values, np.ndarray)}
    wide = {name: values.astype(np.float32) for name, values in halves.items()}
    assert np.array_equal(draw(arguments, **halves), draw(arguments, **wide))
    doubles = {name: arguments[name].astype(np.float64) for name in ("means", "colors", "viewmats")}
    assert np.array_equal(draw(arguments, **doubles), draw(arguments))


def test_bfloat16_is_widened_before_the_arithmetic():
    torch = pytest.importorskip("torch")
    arguments = on_torch(torch, CASES["degree 3"], "cpu")
    tensors = {name: values for name, values in arguments.items() if isinstance(values, torch.Tensor)}
    for kind in (torch.bfloat16, torch.float16):
        short = {name: values.to(kind) for name, values in tensors.items()}
        expected = draw(arguments, **{name: values.float() for name, values in short.items()})
        found = draw(arguments, **short)
        assert found.dtype == torch.float32 and torch.equal(found, expected)
    scene = smalto.Scene.from_arrays(*[tensors[name].bfloat16() for name in ("means", "quats", "scales", "opacities", "colors")])
    assert np.array_equal(scene.means, tensors["means"].bfloat16().float().numpy())


def test_pictures_are_those_of_the_reference():
    arguments = CASES["degree 3"]
    colors, alphas, _ = smalto.rasterization(**arguments)
    scene = smalto.Scene.from_arrays(
        *[arguments[name] for name in ("means", "quats", "scales", "opacities", "colors")]
    )
    for c in range(gsplat_cases.CAMERAS):
        camera = smalto.Camera(K=arguments["Ks"][c], viewmat=arguments["viewmats"][c], size=gsplat_cases.SIZE)
        reference = smalto.reference(scene, camera, preset="gsplat")
        assert smalto.compare(colors[c], reference)["psnr_db"] > 90
        assert np.abs(alphas[c, ..., 0] - reference.alpha).max() < 1e-5


def harmonics(direction, degree):
    """The basis functions in unit directions (N, 3): associated Legendre polynomials by their recurrence times waves."""
    x, y, z = direction.T
    azimuth, sine = np.arctan2(y, x), np.sqrt(1 - z * z)
    functions = []
    for l in range(degree + 1):
        for m in range(-l, l + 1):
            order = abs(m)
            last, value = np.zeros_like(z), np.prod([-(2 * k + 1) for k in range(order)]) * sine**order
            for n in range(order + 1, l + 1):
                last, value = value, ((2 * n - 1) * z * value - (n + order - 1) * last) / (n - order)
            ratio = math.factorial(l - order) / math.factorial(l + order)
            scale = math.sqrt((2 * l + 1) / (4 * math.pi) * ratio * (1 if m == 0 else 2))
            functions.append(scale * value * (np.sin(order * azimuth) if m < 0 else np.cos(m * azimuth)))
    return np.stack(functions, -1)


def test_degree_4_is_drawn_as_the_sum_of_its_harmonics():
    arguments = CASES["degree 3"]
    sh = np.random.RandomState(11).randn(gsplat_cases.GAUSSIANS, 25, 3) * 0.3
    colors = []
    for viewmat in arguments["viewmats"].astype(np.float64):
        towards = arguments["means"] + viewmat[:3, :3].T @ viewmat[:3, 3]
        basis = harmonics(towards / np.linalg.norm(towards, axis=-1, keepdims=True), 4)
        colors.append(np.maximum(0.5 + np.einsum("nk,nkc->nc", basis, sh), 0))
    drawn, _, _ = smalto.rasterization(**(arguments | {"colors": sh.astype(np.float32), "sh_degree": 4}))
    without, _, _ = smalto.rasterization(**(arguments | {"colors": sh.astype(np.float32)}))
    plain = {"colors": np.stack(colors).astype(np.float32), "sh_degree": None}
    expected, _, _ = smalto.rasterization(**(arguments | plain))
    assert np.abs(drawn - expected).max() < 1e-5
    assert np.abs(without - expected).max() > 0.1


def test_a_scene_that_changes_is_drawn_anew():
    arguments = CASES["three channels"] | {"colors": CASES["three channels"]["colors"].copy()}
    first, _, _ = smalto.rasterization(**arguments)
    again, _, _ = smalto.rasterization(**arguments)
    assert np.array_equal(first, again)
    arguments["colors"] += 0.25
    brighter, alphas, _ = smalto.rasterization(**arguments)
    assert np.allclose(brighter, first + 0.25 * alphas, atol=1e-4)
    smalto.release()
    assert np.array_equal(smalto.rasterization(**arguments)[0], brighter)


@pytest.mark.parametrize(
    "change, error, text",
    [
        ({"render_mode": "depth"}, ValueError, "render_mode: expected RGB, D, ED"),
        ({"eps2d": 0.1}, ValueError, "eps2d: smalto draws"),
        ({"covars": np.zeros((80, 3))}, ValueError, r"covars: expected the shape \(80, 3, 3\)"),
        ({"camera_model": "lidar"}, ValueError, "camera_model: smalto draws"),
        ({"sh_degree": 9}, ValueError, "sh_degree: expected 0 to .*, found 9"),
        ({"sh_degree": 3.0}, TypeError, "sh_degree: expected a whole number, found 3.0"),
        ({"width": -1}, ValueError, "width: expected 1 or more, found -1"),
        ({"height": 1.5}, TypeError, "height: expected a whole number"),
        ({"colors": np.full((80, 16, 3), np.nan)}, ValueError, "colors: the value NaN in row 0"),
        ({"means": np.full((80, 3), "x")}, TypeError, "means: expected numbers"),
        ({"colors": np.zeros((80, 4, 3))}, ValueError, "sh_degree 3 needs 16 coefficients, found 4"),
        ({"Ks": np.zeros((3, 3, 3))}, ValueError, r"Ks: expected the shape \(2, 3, 3\), found \(3, 3, 3\)"),
        ({"colors": np.zeros(())}, ValueError, "colors: expected 3 or 4 axes, found the shape"),
        ({"means": np.zeros(3)}, ValueError, "means: expected the shape"),
        ({"opacities": np.full(80, 2.0)}, ValueError, "opacities: a value is not from 0 to 1"),
        ({"near_plane": 2.0, "far_plane": 1.0}, ValueError, "near_plane: 2.0 is not less than far_plane"),
        ({"backgrounds": np.zeros((2, 4))}, ValueError, r"backgrounds: expected the shape \(2, 3\)"),
    ],
)
def test_wrong_arguments_are_one_clear_exception(change, error, text):
    with pytest.raises(error, match=text):
        smalto.rasterization(**(CASES["degree 3"] | change))


def on_torch(torch, arguments, device):
    return {
        name: torch.from_numpy(value.copy()).to(device) if isinstance(value, np.ndarray) else value
        for name, value in arguments.items()
    }


def devices():
    torch = pytest.importorskip("torch")
    return torch, ["cpu"] + (["cuda"] if torch.cuda.is_available() else [])


@pytest.mark.parametrize("name", ["RGB+ED", "batch", "far plane", "colors of each camera"])
def test_tensors_give_the_same_bits_on_their_device(name):
    torch, found = devices()
    expected, coverage, expected_meta = smalto.rasterization(**CASES[name])
    for device in found:
        colors, alphas, meta = smalto.rasterization(**on_torch(torch, CASES[name], device))
        assert colors.device.type == alphas.device.type == device
        assert np.array_equal(colors.cpu().numpy(), expected)
        assert np.array_equal(alphas.cpu().numpy(), coverage)
        for key in ("radii", "means2d", "opacities", "camera_ids", "gaussian_ids", "flatten_ids", "isect_ids"):
            assert meta[key].device.type == device
            values, wanted = meta[key].cpu().numpy(), expected_meta[key]
            # A radius is rounded up.
            assert values.shape == wanted.shape and values.dtype == wanted.dtype, key
            assert np.allclose(values, wanted, rtol=1e-6, atol=1 if key == "radii" else 0), key


def test_gradients_and_mixed_devices_are_refused():
    torch, found = devices()
    arguments = on_torch(torch, CASES["degree 3"], "cpu")
    with pytest.raises(TypeError, match="one device, found .*viewmats of NumPy"):
        smalto.rasterization(**(arguments | {"viewmats": CASES["degree 3"]["viewmats"]}))
    if "cuda" in found:
        with pytest.raises(TypeError, match="one device, found means cuda:0, quats cpu"):
            smalto.rasterization(**(arguments | {"means": arguments["means"].cuda()}))
    arguments["means"].requires_grad_()
    with pytest.raises(smalto.Error, match="no gradients"):
        smalto.rasterization(**arguments)
    with torch.no_grad():
        smalto.rasterization(**arguments)
