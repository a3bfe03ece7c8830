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
        ({"radius_clip": 1.0}, ValueError, "radius_clip: smalto draws"),
        ({"camera_model": "fisheye"}, ValueError, "camera_model: smalto draws"),
        ({"sh_degree": 5}, ValueError, "sh_degree: expected 0 to 4, found 5"),
        ({"colors": np.zeros((80, 4, 3))}, ValueError, "sh_degree 3 needs 16 coefficients, found 4"),
        ({"Ks": np.zeros((3, 3, 3))}, ValueError, r"Ks: expected the shape \(2, 3, 3\), found \(3, 3, 3\)"),
        ({"colors": np.zeros(())}, ValueError, "colors: expected 3 or 4 axes"),
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
    expected, coverage, _ = smalto.rasterization(**CASES[name])
    for device in found:
        colors, alphas, _ = smalto.rasterization(**on_torch(torch, CASES[name], device))
        assert colors.device.type == alphas.device.type == device
        assert np.array_equal(colors.cpu().numpy(), expected)
        assert np.array_equal(alphas.cpu().numpy(), coverage)


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
