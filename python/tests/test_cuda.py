"""Gaussians that PyTorch changes on the device that draws them. Needs CUDA on the device of Vulkan."""

import numpy as np
import pytest
import smalto

NAMES = ("means", "quats", "scales", "opacities", "sh")


@pytest.fixture(scope="module")
def torch():
    torch = pytest.importorskip("torch")
    if not torch.cuda.is_available():
        pytest.skip("there is no CUDA")
    return torch


def arrays(torch, count=3000, degree=3, seed=0):
    """Gaussians of a unit ball before the camera, on the host."""
    random = np.random.RandomState(seed)
    values = (
        random.uniform(-1, 1, (count, 3)),
        random.normal(size=(count, 4)),
        np.exp(random.uniform(-5, -3, (count, 3))),
        random.uniform(0.02, 1, count),
        random.normal(size=(count, (degree + 1) ** 2, 3)) * 0.2,
    )
    return [torch.from_numpy(value.astype(np.float32)) for value in values]


def on_device(values):
    return [value.cuda() for value in values]


def camera():
    viewmat = np.eye(4)
    viewmat[2, 3] = 4
    return smalto.Camera(K=[[300, 0, 160], [0, 300, 90], [0, 0, 1]], size=(320, 180), viewmat=viewmat)


def picture(renderer):
    drawn = renderer.render(camera())
    return np.concatenate([drawn.color, drawn.alpha[..., None]], axis=-1)


def expected(values, preset, **knobs):
    return picture(smalto.Renderer(smalto.Scene.from_arrays(*values), preset=preset, **knobs))


@pytest.mark.parametrize("preset", ["gsplat", "balanced", "fast", "portable"])
def test_updated_pictures_are_those_of_the_host(torch, preset):
    renderer = smalto.Renderer(smalto.Scene.from_arrays(*arrays(torch)), preset=preset)
    for seed in (1, 2, 3):
        values = arrays(torch, seed=seed)
        renderer.update_arrays(*on_device(values))
        assert renderer._arrays is not None, "the device packed the arrays"
        assert np.array_equal(picture(renderer), expected(values, preset))
    for count, degree in ((5001, 3), (5001, 1), (1200, 0), (1200, 4), (2500, 2)):
        values = arrays(torch, count, degree)
        renderer.update_arrays(*on_device(values))
        assert renderer._arrays is not None
        assert np.array_equal(picture(renderer), expected(values, preset))
    scene = smalto.Scene.from_arrays(*arrays(torch, seed=9))
    renderer.update(scene)
    assert np.array_equal(picture(renderer), expected(arrays(torch, seed=9), preset))
    assert not renderer.validation_messages


def test_tensors_of_other_kinds_are_taken(torch):
    values = arrays(torch)
    renderer = smalto.Renderer(smalto.Scene.from_arrays(*arrays(torch, seed=1)), preset="gsplat")
    kinds = [
        [value.double().cuda() for value in values],
        [value.cuda().requires_grad_() for value in values],
        # Not contiguous.
        [value.T.contiguous().T.cuda() if value.ndim == 2 else value.cuda() for value in values],
    ]
    for kind in kinds:
        renderer.update_arrays(*on_device(arrays(torch, seed=1)))
        renderer.update_arrays(*kind)
        assert renderer._arrays is not None
        assert np.array_equal(picture(renderer), expected(values, "gsplat"))
    with torch.inference_mode():
        renderer.update_arrays(*on_device(arrays(torch, 2000)))
    renderer.update_arrays(*on_device(arrays(torch, 2000, seed=4)))
    assert np.array_equal(picture(renderer), expected(arrays(torch, 2000, seed=4), "gsplat"))


def test_transparent_gaussians_and_certificates(torch):
    values = arrays(torch)
    values[3][::5] = 0
    values[0][::5] = 1e6
    renderer = smalto.Renderer(smalto.Scene.from_arrays(*arrays(torch, seed=1)), preset="balanced", certified=True)
    renderer.update_arrays(*on_device(values))
    assert renderer._arrays is not None
    assert np.array_equal(picture(renderer), expected(values, "balanced", certified=True))


def test_wrong_values_have_the_errors_of_the_host(torch):
    renderer = smalto.Renderer(smalto.Scene.from_arrays(*arrays(torch)), preset="gsplat")
    renderer.update_arrays(*on_device(arrays(torch, seed=1)))
    before = picture(renderer)

    def changed(index, place, value):
        values = arrays(torch)
        values[index][place] = value
        return values

    wrong = [
        changed(0, (70, 1), float("nan")),
        changed(4, (2999, 15, 2), float("inf")),
        changed(2, (5, 0), -0.1),
        changed(3, 12, 1.5),
        changed(1, 40, 0),
        changed(0, (7, 0), 1e35),
        [*arrays(torch)[:4], arrays(torch)[4][:, :5]],
        [arrays(torch, 10)[0], *arrays(torch)[1:]],
    ]
    for values in wrong:
        with pytest.raises(ValueError) as on_host:
            smalto.Scene.from_arrays(*values)
        with pytest.raises(ValueError) as found:
            renderer.update_arrays(*on_device(values))
        assert str(found.value) == str(on_host.value)
        assert np.array_equal(picture(renderer), before), "the scene stays"


def test_what_the_host_stores_otherwise_is_left_to_it(torch):
    values = arrays(torch)
    values[4] = (values[4] * 16).round() / 16
    renderer = smalto.Renderer(smalto.Scene.from_arrays(*arrays(torch, seed=1)), preset="gsplat")
    renderer.update_arrays(*on_device(values))
    assert renderer._arrays is None
    assert np.array_equal(picture(renderer), expected(values, "gsplat"))


def test_an_update_leaves_the_pictures_that_are_being_drawn(torch):
    first, second = arrays(torch), arrays(torch, seed=1)
    renderer = smalto.Renderer(smalto.Scene.from_arrays(*first), preset="gsplat")
    renderer.update_arrays(*on_device(first))
    pictures = renderer.render_many([camera()] * 5)
    begun = [next(pictures)]
    renderer.update_arrays(*on_device(second))
    begun += [next(pictures), next(pictures)]
    for drawn in begun:
        assert np.array_equal(drawn.color, expected(first, "gsplat")[..., :3])
    assert np.array_equal(picture(renderer), expected(second, "gsplat"))


def rasterized(values, **colors):
    viewmats = np.eye(4, dtype=np.float32)[None]
    viewmats[0, 2, 3] = 4
    Ks = np.float32([[[300, 0, 160], [0, 300, 90], [0, 0, 1]]])
    if hasattr(values[0], "cuda"):
        import torch

        viewmats, Ks = (torch.from_numpy(value).to(values[0].device) for value in (viewmats, Ks))
    colors, alphas, _ = smalto.rasterization(*values, viewmats, Ks, 320, 180, **colors)
    return [np.asarray(result.cpu()) for result in (colors, alphas)]


@pytest.mark.parametrize("sh_degree", [None, 1, 3])
def test_rasterization_of_changed_tensors(torch, sh_degree):
    for seed in (0, 1, 1, 2):
        values = arrays(torch, seed=seed)
        # The host leaves these out.
        values[3][::9] = 0
        if sh_degree is None:
            values[4] = values[4][:, 1:3].reshape(-1, 6)[:, :5].contiguous()
        found = rasterized(on_device(values), sh_degree=sh_degree, render_mode="RGB+ED")
    kept = smalto._gsplat._kept
    assert kept.renderer._arrays is not None, "the device packed the arrays"
    assert [plane is not None for plane in kept.planes] == ([True] * 2 if sh_degree is None else [])
    smalto.release()
    on_host = rasterized(values, sh_degree=sh_degree, render_mode="RGB+ED")
    for a, b in zip(found, on_host):
        assert np.array_equal(a, b)
    smalto.release()


def test_features_of_scenes_from_the_device_and_the_host(torch):
    def values(on_grid, seed):
        values = arrays(torch, seed=seed)
        values[3][::9] = 0
        values[4] = values[4][:, 0]
        if on_grid:
            # Values that 8 bits hold: the host stores them.
            values[1][:] = torch.tensor([1.0, 0, 0, 0])
            values[2][:], values[3] = 0.01, (values[3] * 255).round() / 255
        return values

    # The host leaves out the rows with the opacity 0, and the device does not.
    scenes = [values(on_grid, seed) for seed, on_grid in enumerate([False, False, True, True, False])]
    found, are_packed = [], []
    for scene in scenes:
        found.append(rasterized(on_device(scene))[0])
        are_packed.append(smalto._gsplat._kept.renderer._arrays is not None)
    assert are_packed == [False, True, False, False, True]
    for scene, picture in zip(scenes, found):
        smalto.release()
        assert np.array_equal(picture, rasterized(scene)[0])
    smalto.release()


def test_features_that_are_not_finite_have_the_error_of_the_host(torch):
    values = arrays(torch)
    values[4] = values[4][:, 0]
    rasterized(on_device(values))
    values[4][7, 1] = float("nan")
    with pytest.raises(ValueError, match="colors: the value NaN in row 7 is not finite"):
        rasterized(on_device(values))
    smalto.release()


def test_rasterization_sees_tensors_that_change_in_place(torch):
    values = on_device(arrays(torch))
    first = rasterized(values, sh_degree=3)
    values[0] += 0.1
    second = rasterized(values, sh_degree=3)
    assert not np.array_equal(first[0], second[0])
    values[0] -= 0.1
    values[4][5] += 1
    third = rasterized(values, sh_degree=3)
    assert not np.array_equal(second[0], third[0])
    again = rasterized(values, sh_degree=3)
    assert np.array_equal(third[0], again[0])
    smalto.release()
