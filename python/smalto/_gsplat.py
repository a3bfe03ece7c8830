"""The function `rasterization` of gsplat (1.5.3 and 1.6.0), drawn by smalto."""

import math
import operator
import sys
import threading
from typing import Any, Literal, TypeVar

import numpy as np

from ._cuda import Frames, bring, is_same_device, update
from ._lenses import Lenses
from ._meta import Meta, is_tensor, of_covariances, projected, projector
from ._shutter import Shutter
from ._smalto import MAX_SH_DEGREE, Error, Renderer, Scene, device_for_cuda

# An array of NumPy or a tensor of PyTorch.
_Array = TypeVar("_Array")
RenderMode = Literal["RGB", "D", "ED", "RGB+D", "RGB+ED", "d", "Ed", "RGB-d", "RGB-Ed"]

# The most channels that one picture holds.
_CHANNELS = 3
_TILE = 16

_lock = threading.Lock()
_kept = None


class _Kept:
    """A renderer, with copies of the arrays of its scene: they tell whether the next call draws the same scene."""

    def __init__(self, options, geometry, sh):
        self.options, self.frames, self.planes = options, {}, []
        device, near, antialiased, _, response = options
        scene = _scene(geometry, sh)
        rules = {"near": near, "antialiased": antialiased, "response": response}
        self.renderer = Renderer(scene, device=device, preset="gsplat", **rules)
        self._keep(geometry, sh)

    def draws(self, options, geometry, sh):
        """True if it draws this scene."""
        arrays = geometry if sh is None else [*geometry, sh]
        return self.options == options and all(_equal(*pair) for pair in zip(self.arrays, arrays))

    def update(self, geometry, sh):
        # The memory of the old ones is free before the new ones take theirs.
        self.features, self.brought = None, []
        arrays = [*geometry, _vectors(geometry[1]) if sh is None and is_tensor(geometry[1]) else sh]
        copies = update(self.renderer, arrays, self.options[2], has_features=sh is None)
        if copies is None:
            # The host leaves out rows, so that planes of features may not fit.
            self.planes = []
            self.renderer.update(_scene(geometry, sh))
        self._keep(geometry, sh, copies)

    def _keep(self, geometry, sh, copies=None):
        arrays = geometry if sh is None else [*geometry, sh]
        copies = copies or [None] * len(arrays)
        self.arrays = [
            _copy(values) if copy is None or copy.dtype != values.dtype else copy for values, copy in zip(arrays, copies)
        ]
        self.extent = _extent(geometry[0])
        self.features, self.brought = None, []

    def channels(self, features, is_kept):
        """The features on the device, three channels each. Those of the last call, if they are equal and were kept."""
        if is_kept and self.features is not None and _equal(self.features, features):
            return self.brought
        # The memory of the old ones is free before the new ones take theirs.
        self.features, self.brought = None, []
        starts = range(0, features.shape[-1], _CHANNELS)
        planes = [*self.planes, *[None] * len(starts)][: len(starts)]
        some = [features[:, start : start + _CHANNELS] for start in starts]
        self.planes = [bring(self.renderer, *pair) for pair in zip(some, planes)]
        brought = [
            self.renderer._bring(features) if plane is None else plane.channels
            for features, plane in zip(some, self.planes)
        ]
        if is_kept:
            self.features, self.brought = _copy(features), brought
        return brought


def _scene(geometry, sh):
    if sh is None:
        return Scene._of_features(*geometry)
    try:
        return Scene.from_arrays(*geometry, sh)
    except (TypeError, ValueError) as error:
        if not str(error).startswith("sh:"):
            raise
        raise type(error)(f"colors{str(error)[2:]}") from None


def _vectors(quats):
    """The vectors of rotations, (N, 1, 3): the colours of a scene until it gets features."""
    quats = quats.float()
    vectors = quats[:, None, 1:] / quats.norm(dim=-1)[:, None, None].clamp_min(float(np.finfo(np.float32).tiny))
    return vectors.clamp(-1.0, 1.0)


class _Host:
    """Pictures as arrays of NumPy."""

    def __init__(self, colors, alphas):
        self.colors, self.alphas = np.empty(colors, np.float32), np.empty(alphas, np.float32)

    def draw(self, kept, cameras, has_depth):
        """Color, coverage, and the mean depth, which is 0 where there is nothing, of each camera; and GPU times."""
        layers = ("color", "alpha", "depth") if has_depth else ("color", "alpha")
        for picture in kept.renderer.render_many(cameras, layers=layers):
            depth = np.nan_to_num(picture.depth, copy=False, nan=0.0) if has_depth else None
            yield picture.color, picture.alpha, depth, picture.timings


class _Device:
    """Pictures as tensors on the device that draws them, which no copy leaves."""

    def __init__(self, torch, device, colors, alphas):
        self.torch, self.device = torch, device
        self.colors, self.alphas = (
            torch.empty(shape, dtype=torch.float32, device=device) for shape in (colors, alphas)
        )

    def draw(self, kept, cameras, has_depth):
        if not cameras:
            return
        key = (self.device, cameras[0].size, has_depth)
        if key not in kept.frames:
            kept.frames = {key: Frames(self.torch, self.device, cameras[0].size, has_depth)}
        for (pixels, *depths), timings in kept.frames[key].draw(kept.renderer, cameras):
            depth = self.torch.where(depths[0][..., 2] > 0, depths[0][..., 0], 0.0) if has_depth else None
            yield pixels[..., :3], pixels[..., 3], depth, timings


def rasterization(
    means: _Array,
    quats: Any,
    scales: Any,
    opacities: Any,
    colors: Any,
    viewmats: Any,
    Ks: Any,
    width: int,
    height: int,
    near_plane: float = 0.01,
    far_plane: float = 1e10,
    radius_clip: float = 0.0,
    eps2d: float = 0.3,
    sh_degree: int | None = None,
    packed: bool = True,
    tile_size: int | None = None,
    backgrounds: Any = None,
    render_mode: RenderMode = "RGB",
    sparse_grad: bool = False,
    absgrad: bool = False,
    rasterize_mode: Literal["classic", "antialiased"] = "classic",
    channel_chunk: int = 32,
    distributed: bool = False,
    camera_model: Literal["pinhole", "ortho", "fisheye", "ftheta"] = "pinhole",
    segmented: bool = False,
    covars: Any = None,
    with_ut: bool = False,
    with_eval3d: bool = False,
    return_normals: bool = False,
    global_z_order: bool = True,
    rays: None = None,
    radial_coeffs: Any = None,
    tangential_coeffs: Any = None,
    thin_prism_coeffs: Any = None,
    ftheta_coeffs: Any = None,
    lidar_coeffs: None = None,
    external_distortion_coeffs: None = None,
    rolling_shutter: Any = None,
    viewmats_rs: Any = None,
    ut_params: Any = None,
    extra_signals: None = None,
    extra_signals_sh_degree: None = None,
    renderer_config: Any = None,
    *,
    device: str | int | None = None,
) -> tuple[_Array, _Array, Meta]:
    """Draws a batch of pictures, with the arguments and results of gsplat 1.6 and 1.5, by its rules, on any Vulkan
    device. There are no gradients.

    Arguments are arrays of NumPy, or tensors of PyTorch that are all on one device; the results are of the same kind.
    Leading axes (...) are batches of scenes. Numbers may have 16, 32 or 64 bits; the arithmetic has 32.

    means (..., N, 3), quats (..., N, 4) as w, x, y, z, scales (..., N, 3), opacities (..., N) from 0 to 1.
    colors: without `sh_degree`, (..., N, D) or (..., C, N, D) of any D channels and any sign; with it, coefficients of
        spherical harmonics (..., N, K, 3), (..., C, N, K, 3), or (N, K, 3) for all scenes, of which those up to
        `sh_degree` are used. None if `render_mode` has no RGB.
    viewmats (..., C, 4, 4) from world to view, Ks (..., C, 3, 3) in pixels, backgrounds (..., C, D). Poses are used as
        they are; the 3x3 R of one may differ from a rotation by 0.005 in an entry of R R^T - I, and else is refused.
    render_mode: RGB, D (depth times coverage), ED (mean depth), RGB+D or RGB+ED, with depth as the last channel.
    rasterize_mode: classic or antialiased. `near_plane` and `far_plane` are view depths in world units.
    device: the Vulkan device, as for `Renderer`.

    radius_clip: splats whose radii are not larger, in pixels, are left out. covars (..., N, 3, 3): in the place of
        `quats` and `scales`.

    camera_model: pinhole, ortho, fisheye or ftheta. radial_coeffs (..., C, 6) of pinhole, (..., C, 4) of fisheye;
        tangential_coeffs (..., C, 2) and thin_prism_coeffs (..., C, 4) of pinhole; ftheta_coeffs, an object of gsplat,
        of ftheta. They need `with_ut` and `with_eval3d`, which are both True or both False.
    rolling_shutter: an object of gsplat, or any with its `name`, like ROLLING_TOP_TO_BOTTOM. With it, `viewmats` are
        the poses of the first row or column in time and `viewmats_rs` (..., C, 4, 4) those of the last; it needs
        `with_ut` and `with_eval3d`. Each row or column is drawn as a picture of its own pose, in its own order, which
        takes about as long as so many small pictures.

    With `with_ut` and `with_eval3d`, and with all models but pinhole, splats are drawn along the rays of pixels, as RGB,
    with a low-pass of 0.3 px^2 (gsplat's with_eval3d has none). All models but ortho are then drawn in the order of the
    distance, which `near_plane` and `far_plane` are, too. The scene lies within `far_plane`.

    packed and tile_size are those of `meta`. sparse_grad, absgrad, channel_chunk, segmented and ut_params change no
    picture and are ignored. What is not drawn is refused by name: another eps2d, distances along rays (d, Ed,
    RGB-d, RGB-Ed), the unscented transform alone, normals, signals beside the colors, several ranks.

    Returns colors (..., C, height, width, X) and alphas (..., C, height, width, 1) in float32, and a mapping `meta`
    with gsplat's keys, whose values are computed when they are read: `help(type(meta))`. The scene of the last call
    stays on the device, with a copy of its arrays, and is used again if they are equal; `release` frees both.
    Errors: TypeError, ValueError, and smalto.Error where a gradient is expected.
    """
    coefficients = {
        "radial_coeffs": radial_coeffs,
        "tangential_coeffs": tangential_coeffs,
        "thin_prism_coeffs": thin_prism_coeffs,
    }
    shutter = Shutter(rolling_shutter, viewmats_rs)
    lenses = Lenses(camera_model, with_ut, with_eval3d, coefficients, ftheta_coeffs, shutter.rolls)
    refused = {
        "eps2d": not math.isclose(eps2d, 0.3),
        "distributed": bool(distributed),
        "return_normals": bool(return_normals),
        "global_z_order": not global_z_order and lenses.has_order_of_z,
        "rays": rays is not None,
        "lidar_coeffs": lidar_coeffs is not None,
        "external_distortion_coeffs": external_distortion_coeffs is not None,
        "extra_signals": extra_signals is not None,
        "extra_signals_sh_degree": extra_signals_sh_degree is not None,
        "renderer_config": type(renderer_config).__name__ not in ("NoneType", "RendererConfig_MixedBatch"),
    }
    for name in (name for name, is_set in refused.items() if is_set):
        raise ValueError(f"{name}: smalto draws with gsplat's default for {name} only")
    _one_of("rasterize_mode", rasterize_mode, ["classic", "antialiased"])
    if render_mode in ("d", "Ed", "RGB-d", "RGB-Ed"):
        raise ValueError(f"render_mode: {render_mode} is a distance along rays, which needs gsplat's with_eval3d")
    _one_of("render_mode", render_mode, ["RGB", "D", "ED", "RGB+D", "RGB+ED"])
    if not lenses.is_pinhole:
        _checked_for_lenses(lenses, render_mode, sh_degree, radius_clip)
    size = (_whole("width", width, 1), _whole("height", height, 1))
    tile_size = _TILE if tile_size is None else _whole("tile_size", tile_size, 1)
    if sh_degree is not None:
        sh_degree = _whole("sh_degree", sh_degree, 0, MAX_SH_DEGREE)
    if not near_plane < far_plane:
        raise ValueError(f"near_plane: {near_plane} is not less than far_plane, {far_plane}")
    has_color = render_mode.startswith("RGB")
    if has_color and colors is None:
        raise TypeError(f"colors: render_mode {render_mode} needs them")
    if not has_color:
        colors, backgrounds, sh_degree = None, None, None
    if covars is not None:
        quats, scales = None, None

    arrays = {
        "means": means,
        "quats": quats,
        "scales": scales,
        "opacities": opacities,
        "colors": colors,
        "viewmats": viewmats,
        "viewmats_rs": viewmats_rs,
        "Ks": Ks,
        "backgrounds": backgrounds,
        "covars": covars,
        **coefficients,
    }
    result, arrays = _checked_kind({name: values for name, values in arrays.items() if values is not None})
    batch = _checked_shapes(arrays, sh_degree, lenses.sizes)
    if covars is not None:
        arrays["quats"], arrays["scales"] = of_covariances(arrays.pop("covars"))
    count, cameras = math.prod(batch), arrays["viewmats"].shape[-3]
    # Spherical harmonics without the axes of a batch are those of all scenes.
    shared = {"colors"} if sh_degree is not None and len(batch) > 0 and arrays["colors"].ndim == 3 else set()
    scenes = {
        name: [values] * count if name in shared else values.reshape(count, *values.shape[len(batch) :])
        for name, values in arrays.items()
    }
    # gsplat draws what lies on the near plane, smalto only what lies beyond.
    near = max(float(np.nextafter(np.float32(near_plane), np.float32(-np.inf))), float(np.finfo(np.float32).tiny))
    response = "screen" if lenses.is_pinhole else "ray"
    options = (device, near, rasterize_mode == "antialiased", sh_degree is None, response)

    depth_mode = render_mode.split("+")[-1] if render_mode != "RGB" else None
    channels = 0 if not has_color else 3 if sh_degree is not None else arrays["colors"].shape[-1]
    shapes = [(count, cameras, size[1], size[0], n) for n in (channels + (depth_mode is not None), 1)]
    timings = []
    with _lock:
        # Pictures along rays come over the host.
        canvas = _canvas(options, arrays["means"], shapes) if lenses.is_pinhole else _Host(*shapes)
        for b in range(count):
            one = {name: values[b] for name, values in scenes.items()}
            limits, into = (near_plane, far_plane, radius_clip), (canvas, b, timings)
            _draw(one, options, size, sh_degree, limits, depth_mode, lenses, shutter, into)
    colors, alphas = canvas.colors, canvas.alphas
    if backgrounds is not None:
        ground = scenes["backgrounds"] if isinstance(canvas, _Device) else _host(scenes["backgrounds"])
        colors[..., :channels] += (1 - alphas) * ground[:, :, None, None, :]
    known = {
        "tile_width": -(-size[0] // tile_size),
        "tile_height": -(-size[1] // tile_size),
        "width": size[0],
        "height": size[1],
        "tile_size": tile_size,
        "n_batches": count,
        "n_cameras": cameras,
        "timings": timings,
    }
    rules = ((near_plane, far_plane), radius_clip, rasterize_mode == "antialiased")
    meta = Meta(known, projector(scenes, batch, size, *rules) if lenses.is_pinhole else None, bool(packed))
    return result(colors.reshape(*batch, *colors.shape[1:])), result(alphas.reshape(*batch, *alphas.shape[1:])), meta


def release() -> None:
    """Frees the memory that `rasterization` keeps from one call to the next."""
    global _kept
    with _lock:
        _kept = None


def _draw(one, options, size, sh_degree, limits, depth_mode, lenses, shutter, into):
    """Draws the views of one scene: a picture for every three channels, and one more scene for every camera that leaves
    out what lies beyond the far plane or is too small, or has its own spherical harmonics."""
    canvas, b, timings = into
    drawn, alphas = canvas.colors[b], canvas.alphas[b]
    seen_from = {name: _host(one[name]) for name in ("viewmats", "viewmats_rs", "Ks", *lenses.sizes) if name in one}
    views = lenses.views(seen_from, size, shutter)
    poses = np.concatenate([seen_from[name] for name in ("viewmats", "viewmats_rs") if name in seen_from])
    colors = one.get("colors")
    has_own_colors = colors is not None and colors.ndim == (3 if sh_degree is None else 4)
    (near_plane, far_plane, radius_clip), is_antialiased = limits, options[2]
    is_cut = _farthest(one["means"], poses) > far_plane or radius_clip > 0
    if is_cut and not lenses.is_pinhole:
        raise ValueError(f"far_plane: smalto draws all of a scene along rays, so pass more than {far_plane}")
    apart = [[c] for c in range(len(views))] if has_own_colors or is_cut else [list(range(len(views)))]
    for some in apart:
        look = colors[some[0]] if has_own_colors else colors
        geometry = [one[name] for name in ("means", "quats", "scales", "opacities")]
        if is_cut:
            view = (one["viewmats"][some[0]], one["Ks"][some[0]])
            seen = projected(geometry, *view, size, (near_plane, far_plane), radius_clip, is_antialiased)
            rows = np.flatnonzero(_host(seen["radii"]).any(-1))
            geometry, look = [_rows(values, rows) for values in geometry], None if look is None else _rows(look, rows)
        sh = None if sh_degree is None else look[:, : (sh_degree + 1) ** 2]
        kept = _keeping(options, geometry, sh)
        groups = [None]
        if look is not None and sh is None:
            groups = kept.channels(look, is_kept=len(apart) == 1)
        for group, channels in enumerate(groups):
            if channels is not None:
                kept.renderer._show(channels)
            start = _CHANNELS * group
            stop = start if look is None else min(start + _CHANNELS, drawn.shape[-1] - (depth_mode is not None))
            # All pictures of a camera have the same depths.
            has_depth = depth_mode is not None and group == 0
            parts = [(drawn[c][where], alphas[c][where], camera) for c in some for where, camera in views[c]]
            pictures = canvas.draw(kept, [camera for _, _, camera in parts], has_depth)
            for (into, coverage, _), (color, alpha, depth, times) in zip(parts, pictures):
                into[..., start:stop] = color[..., : stop - start]
                coverage[..., 0] = alpha
                if has_depth:
                    into[..., -1] = depth * alpha if depth_mode == "D" else depth
                timings.append(times)


def _canvas(options, means, shapes):
    """Where pictures go: the device of the tensors if it draws, else the host."""
    if is_tensor(means) and means.device.type == "cuda":
        torch = sys.modules["torch"]
        if is_same_device(torch, means.device, device_for_cuda(options[0])):
            return _Device(torch, means.device, *shapes)
    return _Host(*shapes)


def _keeping(options, geometry, sh):
    """What draws the scene: that of the last call, if its scene is the same."""
    global _kept
    kept = _kept
    if kept is not None and kept.draws(options, geometry, sh):
        return kept
    # If this fails, nothing is kept: the arrays and what is on the device might be of two scenes.
    _kept = None
    if kept is None or kept.options != options:
        kept = None
        kept = _Kept(options, geometry, sh)
    else:
        kept.update(geometry, sh)
    _kept = kept
    return kept


def _rows(values, rows):
    return values[rows.tolist()] if is_tensor(values) else values[rows]


def _farthest(means, poses):
    """No view depth is larger."""
    if not len(means) or not len(poses):
        return 0.0
    is_kept = _kept is not None and _equal(_kept.arrays[0], means)
    extent = _kept.extent if is_kept else _extent(means)
    return extent * math.sqrt(3) + float(np.linalg.norm(poses[:, :3, 3], axis=-1).max())


def _extent(means):
    """The largest coordinate, without its sign."""
    return float(abs(means).max()) if len(means) else 0.0


def _checked_kind(arrays):
    """What makes results of the kind of the arguments, and the arguments as arrays."""
    tensors = {name: values for name, values in arrays.items() if is_tensor(values)}
    if not tensors:
        return (lambda values: values), {name: _wide(_array(name, values)) for name, values in arrays.items()}
    torch = sys.modules["torch"]
    devices = {name: str(values.device) for name, values in tensors.items()}
    devices |= {name: "of NumPy" for name in arrays if name not in tensors}
    if len(set(devices.values())) > 1:
        found = ", ".join(f"{name} {device}" for name, device in devices.items())
        raise TypeError(f"all arguments must be on one device, found {found}")
    if torch.is_grad_enabled() and any(values.requires_grad for values in tensors.values()):
        raise Error("rasterization has no gradients: call it under torch.no_grad()")
    where = next(iter(tensors.values())).device
    detached = {name: _wide(values.detach()) for name, values in tensors.items()}
    return (lambda values: torch.as_tensor(values, device=where)), detached


def _array(name, values):
    array = np.asarray(values)
    if array.dtype.kind not in "fiu":
        raise TypeError(f"{name}: expected numbers, found an array of {array.dtype}")
    return array


def _wide(values):
    """Floats of 16 bits as floats of 32: the arithmetic of half precision shows."""
    if is_tensor(values):
        return values.float() if values.is_floating_point() and values.element_size() < 4 else values
    return values.astype(np.float32) if values.dtype == np.float16 else values


def _checked_for_lenses(lenses, render_mode, sh_degree, radius_clip):
    """Refuses what smalto cannot draw along rays."""
    if render_mode != "RGB":
        raise ValueError("render_mode: rasterization draws pictures along rays without depths, so pass RGB")
    if radius_clip > 0:
        raise ValueError("radius_clip: smalto draws pictures along rays without it, so pass 0")
    if lenses.model == "ortho" and sh_degree:
        raise ValueError(
            "sh_degree: smalto draws colors of ortho cameras as seen along z, gsplat as seen from the position, so "
            "pass sh_degree=0, or colors of each camera"
        )


def _checked_shapes(arrays, sh_degree, coefficients):
    """The axes of the batch."""
    shapes = {name: tuple(values.shape) for name, values in arrays.items()}
    if len(shapes["means"]) < 2:
        raise ValueError(f"means: expected the shape (..., N, 3), found {shapes['means']}")
    batch, n = shapes["means"][:-2], shapes["means"][-2]
    c = shapes["viewmats"][-3] if len(shapes["viewmats"]) >= 3 else None
    expected_colors = _expected_colors(shapes.get("colors"), batch, n, c, sh_degree)
    expected = {
        "means": (n, 3),
        "quats": (n, 4),
        "scales": (n, 3),
        "opacities": (n,),
        "covars": (n, 3, 3),
        "viewmats": (c, 4, 4),
        "viewmats_rs": (c, 4, 4),
        "Ks": (c, 3, 3),
        **{name: (c, count) for name, count in coefficients.items()},
        "backgrounds": (c, 3 if sh_degree is not None else shapes.get("colors", (0,))[-1]),
    }
    for name, shape in shapes.items():
        wanted = expected_colors if name == "colors" else (*batch, *expected[name])
        if len(shape) != len(wanted) or any(w not in (None, s) for s, w in zip(shape, wanted)):
            text = ", ".join("?" if w is None else str(w) for w in wanted)
            raise ValueError(f"{name}: expected the shape ({text}), found {shape}")
    if sh_degree is not None and shapes["colors"][-2] < (sh_degree + 1) ** 2:
        found = shapes["colors"][-2]
        raise ValueError(f"colors: sh_degree {sh_degree} needs {(sh_degree + 1) ** 2} coefficients, found {found}")
    if "colors" in shapes and shapes["colors"][-1] == 0:
        raise ValueError("colors: there are no channels")
    return batch


def _expected_colors(shape, batch, n, c, sh_degree):
    """The shape that colors must have, by their number of axes."""
    if shape is None:
        return None
    last = (None,) if sh_degree is None else (None, 3)
    expected = [(*batch, n, *last), (*batch, c, n, *last)]
    if sh_degree is not None:
        expected.append((n, *last))
    for wanted in expected:
        if len(wanted) == len(shape):
            return wanted
    axes = sorted({len(wanted) for wanted in expected})
    raise ValueError(f"colors: expected {' or '.join(map(str, axes))} axes, found the shape {shape}")


def _whole(name, value, low, high=None):
    try:
        number = operator.index(value)
    except TypeError:
        raise TypeError(f"{name}: expected a whole number, found {value!r}") from None
    if number < low or high is not None and number > high:
        raise ValueError(f"{name}: expected {low} {'or more' if high is None else f'to {high}'}, found {number}")
    return number


def _one_of(name, value, values):
    if value not in values:
        raise ValueError(f"{name}: expected {', '.join(values)}, found {value}")


def _host(values):
    return values.cpu().numpy() if is_tensor(values) else values


def _copy(values):
    return values.clone() if is_tensor(values) else values.copy()


def _equal(a, b):
    if is_tensor(a) != is_tensor(b) or a.shape != b.shape or a.dtype != b.dtype:
        return False
    if not is_tensor(a):
        return np.array_equal(a, b)
    return a.device == b.device and sys.modules["torch"].equal(a, b)
