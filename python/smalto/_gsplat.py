"""The function `rasterization` of gsplat 1.5.3, drawn by smalto."""

import math
import sys
import threading

import numpy as np

from ._cuda import Frames, is_same_device
from ._smalto import Camera, Error, Renderer, Scene

# The constant of the spherical harmonic of degree 0.
_C0 = 0.28209479177387814
# The most channels that one picture holds.
_CHANNELS = 3

_lock = threading.Lock()
_kept = None


class _Kept:
    """A renderer, with copies of the arrays of its scene: they tell whether the next call draws the same scene."""

    def __init__(self, options, arrays):
        self.options, self.frames = options, {}
        device, near, antialiased = options
        scene = Scene.from_arrays(*arrays)
        self.renderer = Renderer(scene, device=device, preset="gsplat", near=near, antialiased=antialiased)
        self._keep(arrays)

    def update(self, arrays):
        self.renderer.update(Scene.from_arrays(*arrays))
        self._keep(arrays)

    def _keep(self, arrays):
        self.arrays, self.extent = [_copy(values) for values in arrays], _extent(arrays[0])


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
    means,
    quats,
    scales,
    opacities,
    colors,
    viewmats,
    Ks,
    width,
    height,
    near_plane=0.01,
    far_plane=1e10,
    radius_clip=0.0,
    eps2d=0.3,
    sh_degree=None,
    packed=True,
    tile_size=16,
    backgrounds=None,
    render_mode="RGB",
    sparse_grad=False,
    absgrad=False,
    rasterize_mode="classic",
    channel_chunk=32,
    distributed=False,
    camera_model="pinhole",
    segmented=False,
    covars=None,
    with_ut=False,
    with_eval3d=False,
    radial_coeffs=None,
    tangential_coeffs=None,
    thin_prism_coeffs=None,
    ftheta_coeffs=None,
    rolling_shutter=None,
    viewmats_rs=None,
    *,
    device=None,
):
    """Draws a batch of pictures, with the arguments and results of gsplat 1.5.3, by its rules. There are no gradients.

    Arguments are arrays of NumPy, or tensors of PyTorch that are all on one device; the results are of the same kind.
    Leading axes (...) are batches of scenes.

    means (..., N, 3), quats (..., N, 4) as w, x, y, z, scales (..., N, 3), opacities (..., N) from 0 to 1.
    colors: without `sh_degree`, (..., N, D) or (..., C, N, D) of any D channels; with it, coefficients of spherical
        harmonics (..., N, K, 3) or (..., C, N, K, 3), of which those up to `sh_degree`, at most 4, are used.
    viewmats (..., C, 4, 4) from world to view, Ks (..., C, 3, 3) in pixels, backgrounds (..., C, D).
    render_mode: RGB, D (depth times coverage), ED (mean depth), RGB+D or RGB+ED, with depth as the last channel.
    rasterize_mode: classic or antialiased. `near_plane` and `far_plane` are view depths in world units.
    device: the Vulkan device, as for `Renderer`.

    packed, tile_size, sparse_grad, absgrad, channel_chunk and segmented change no picture and are ignored. What is not
    drawn (radius_clip, another eps2d, other camera models, covars, distortion, rolling shutter, several ranks) is
    refused.

    Returns colors (..., C, height, width, X) and alphas (..., C, height, width, 1) in float32, and a dictionary with
    width, height, n_cameras, and `timings`, the GPU milliseconds of each picture. The scene of the last call stays on
    the device, with a copy of its arrays, and is used again if they are equal; `release` frees both.
    Errors: TypeError, ValueError, and smalto.Error where a gradient is expected.
    """
    refused = {
        "radius_clip": radius_clip > 0,
        "eps2d": not math.isclose(eps2d, 0.3),
        "distributed": bool(distributed),
        "camera_model": camera_model != "pinhole",
        "covars": covars is not None,
        "with_ut": bool(with_ut),
        "with_eval3d": bool(with_eval3d),
        "radial_coeffs": radial_coeffs is not None,
        "tangential_coeffs": tangential_coeffs is not None,
        "thin_prism_coeffs": thin_prism_coeffs is not None,
        "ftheta_coeffs": ftheta_coeffs is not None,
        "rolling_shutter": getattr(rolling_shutter, "name", "GLOBAL") != "GLOBAL",
        "viewmats_rs": viewmats_rs is not None,
    }
    for name in (name for name, is_set in refused.items() if is_set):
        raise ValueError(f"{name}: smalto draws pinhole cameras with gsplat's default for {name} only")
    _one_of("render_mode", render_mode, ["RGB", "D", "ED", "RGB+D", "RGB+ED"])
    _one_of("rasterize_mode", rasterize_mode, ["classic", "antialiased"])
    if sh_degree is not None and sh_degree not in range(5):
        raise ValueError(f"sh_degree: expected 0 to 4, found {sh_degree}")
    if not near_plane < far_plane:
        raise ValueError(f"near_plane: {near_plane} is not less than far_plane, {far_plane}")

    arrays = {
        "means": means,
        "quats": quats,
        "scales": scales,
        "opacities": opacities,
        "colors": colors,
        "viewmats": viewmats,
        "Ks": Ks,
        "backgrounds": backgrounds,
    }
    result, arrays = _checked_kind({name: values for name, values in arrays.items() if values is not None})
    batch = _checked_shapes(arrays, sh_degree)
    count, cameras = math.prod(batch), arrays["viewmats"].shape[-3]
    scenes = {name: values.reshape(count, *values.shape[len(batch) :]) for name, values in arrays.items()}
    # gsplat draws what lies on the near plane, smalto only what lies beyond.
    near = max(float(np.nextafter(np.float32(near_plane), np.float32(-np.inf))), float(np.finfo(np.float32).tiny))
    options = (device, near, rasterize_mode == "antialiased")

    depth_mode = render_mode.split("+")[-1] if render_mode != "RGB" else None
    has_color = render_mode.startswith("RGB")
    channels = (3 if sh_degree is not None else arrays["colors"].shape[-1]) if has_color else 0
    size = (int(width), int(height))
    shapes = [(count, cameras, size[1], size[0], n) for n in (channels + (depth_mode is not None), 1)]
    timings = []
    with _lock:
        canvas = _canvas(options, arrays["means"], shapes)
        for b in range(count):
            one = {name: values[b] for name, values in scenes.items()}
            _draw(one, options, size, sh_degree, far_plane, has_color, depth_mode, (canvas, b, timings))
    colors, alphas = canvas.colors, canvas.alphas
    if backgrounds is not None and has_color:
        ground = scenes["backgrounds"] if isinstance(canvas, _Device) else _host(scenes["backgrounds"])
        colors[..., :channels] += (1 - alphas) * ground[:, :, None, None, :]
    meta = {"width": size[0], "height": size[1], "n_cameras": cameras, "timings": timings}
    return result(colors.reshape(*batch, *colors.shape[1:])), result(alphas.reshape(*batch, *alphas.shape[1:])), meta


def release():
    """Frees the memory that `rasterization` keeps from one call to the next."""
    global _kept
    with _lock:
        _kept = None


def _draw(one, options, size, sh_degree, far_plane, has_color, depth_mode, into):
    """Draws the views of one scene: a picture for every three channels, and one more scene for every camera that has
    its own colors or leaves out what lies beyond the far plane."""
    canvas, b, timings = into
    drawn, alphas = canvas.colors[b], canvas.alphas[b]
    poses, intrinsics = _host(one["viewmats"]), _host(one["Ks"])
    views = [Camera(K=K, size=size, viewmat=pose) for K, pose in zip(intrinsics, poses)]
    has_own_colors = one["colors"].ndim == (3 if sh_degree is None else 4)
    is_cut = _farthest(one["means"], poses) > far_plane
    apart = [[c] for c in range(len(views))] if has_own_colors or is_cut else [list(range(len(views)))]
    for some in apart:
        colors = one["colors"][some[0]] if has_own_colors else one["colors"]
        arrays = [one[name] for name in ("means", "quats", "scales", "opacities")]
        groups = _groups(colors, sh_degree) if has_color else [(slice(0, 0), 0.0, _black(arrays[0]))]
        for channels, shift, sh in groups:
            gaussians = [*arrays, sh]
            if is_cut:
                gaussians = _before(gaussians, poses[some[0]], far_plane)
            # All pictures of a camera have the same depths.
            has_depth = depth_mode is not None and channels.start == 0
            pictures = canvas.draw(_keeping(options, gaussians), [views[c] for c in some], has_depth)
            for c, (color, alpha, depth, times) in zip(some, pictures):
                width = channels.stop - channels.start
                drawn[c, ..., channels] = color[..., :width]
                if shift:
                    drawn[c, ..., channels] -= shift * alpha[..., None]
                alphas[c, ..., 0] = alpha
                if has_depth:
                    drawn[c, ..., -1] = depth * alpha if depth_mode == "D" else depth
                timings.append(times)


def _canvas(options, means, shapes):
    """Where pictures go: the device of the tensors if it draws, else the host."""
    if _is_tensor(means) and means.device.type == "cuda":
        torch = sys.modules["torch"]
        if is_same_device(torch, means.device, options[0]):
            return _Device(torch, means.device, *shapes)
    return _Host(*shapes)


def _keeping(options, arrays):
    """What draws the scene: that of the last call, if its scene is the same."""
    global _kept
    kept = _kept
    if kept is not None and kept.options == options and all(_equal(*pair) for pair in zip(kept.arrays, arrays)):
        return kept
    # If this fails, nothing is kept: the arrays and what is on the device might be of two scenes.
    _kept = None
    if kept is None or kept.options != options:
        kept = None
        kept = _Kept(options, arrays)
    else:
        kept.update(arrays)
    _kept = kept
    return kept


def _groups(colors, sh_degree):
    """The channels of each picture, what is taken off them, and their spherical harmonics."""
    if sh_degree is not None:
        yield slice(0, 3), 0.0, colors[:, : (sh_degree + 1) ** 2]
        return
    for start in range(0, colors.shape[-1], _CHANNELS):
        some = colors[:, start : start + _CHANNELS]
        width = some.shape[-1]
        # A sum of spherical harmonics below 0 is black.
        shift = max(0.0, -float(some.min())) if len(some) else 0.0
        sh = (some + (shift - 0.5)) * (1 / _C0)
        if width < _CHANNELS:
            sh = sh[:, [min(i, width - 1) for i in range(_CHANNELS)]]
        yield slice(start, start + width), shift, sh[:, None]


def _black(means):
    return (means * 0)[:, None]


def _before(arrays, pose, far_plane):
    """The Gaussians that do not lie beyond the far plane."""
    means = _host(arrays[0]).astype(np.float64)
    rows = np.flatnonzero(means @ pose[2, :3] + pose[2, 3] <= far_plane)
    return [values[rows.tolist()] if _is_tensor(values) else values[rows] for values in arrays]


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


def _is_tensor(values):
    torch = sys.modules.get("torch")
    return torch is not None and isinstance(values, torch.Tensor)


def _checked_kind(arrays):
    """What makes results of the kind of the arguments, and the arguments as arrays."""
    tensors = {name: values for name, values in arrays.items() if _is_tensor(values)}
    if not tensors:
        return (lambda values: values), {name: np.asarray(values) for name, values in arrays.items()}
    torch = sys.modules["torch"]
    devices = {name: str(values.device) for name, values in tensors.items()}
    devices |= {name: "of NumPy" for name in arrays if name not in tensors}
    if len(set(devices.values())) > 1:
        found = ", ".join(f"{name} {device}" for name, device in devices.items())
        raise TypeError(f"all arguments must be on one device, found {found}")
    if torch.is_grad_enabled() and any(values.requires_grad for values in tensors.values()):
        raise Error("rasterization has no gradients: call it under torch.no_grad()")
    where = next(iter(tensors.values())).device
    detached = {name: values.detach() for name, values in tensors.items()}
    return (lambda values: torch.as_tensor(values, device=where)), detached


def _checked_shapes(arrays, sh_degree):
    """The axes of the batch."""
    shapes = {name: tuple(values.shape) for name, values in arrays.items()}
    if len(shapes["means"]) < 2:
        raise ValueError(f"means: expected the shape (..., N, 3), found {shapes['means']}")
    batch, n = shapes["means"][:-2], shapes["means"][-2]
    c = shapes["viewmats"][-3] if len(shapes["viewmats"]) >= 3 else None
    axes = (len(batch) + 2, len(batch) + 3) if sh_degree is None else (len(batch) + 3, len(batch) + 4)
    own = (c,) if len(shapes["colors"]) == axes[1] else ()
    last = (None,) if sh_degree is None else (None, 3)
    if len(shapes["colors"]) not in axes:
        raise ValueError(f"colors: expected {axes[0]} or {axes[1]} axes, found the shape {shapes['colors']}")
    expected = {
        "means": (n, 3),
        "quats": (n, 4),
        "scales": (n, 3),
        "opacities": (n,),
        "colors": (*own, n, *last),
        "viewmats": (c, 4, 4),
        "Ks": (c, 3, 3),
        "backgrounds": (c, 3 if sh_degree is not None else shapes["colors"][-1]),
    }
    for name, shape in shapes.items():
        wanted = (*batch, *expected[name])
        if len(shape) != len(wanted) or any(w not in (None, s) for s, w in zip(shape, wanted)):
            text = ", ".join("?" if w is None else str(w) for w in wanted)
            raise ValueError(f"{name}: expected the shape ({text}), found {shape}")
    if sh_degree is not None and shapes["colors"][-2] < (sh_degree + 1) ** 2:
        raise ValueError(f"colors: sh_degree {sh_degree} needs {(sh_degree + 1) ** 2} coefficients, found {shapes['colors'][-2]}")
    if sh_degree is None and shapes["colors"][-1] == 0:
        raise ValueError("colors: there are no channels")
    return batch


def _one_of(name, value, values):
    if value not in values:
        raise ValueError(f"{name}: expected {', '.join(values)}, found {value}")


def _host(values):
    return values.cpu().numpy() if _is_tensor(values) else values


def _copy(values):
    return values.clone() if _is_tensor(values) else values.copy()


def _equal(a, b):
    if _is_tensor(a) != _is_tensor(b) or a.shape != b.shape or a.dtype != b.dtype:
        return False
    if not _is_tensor(a):
        return np.array_equal(a, b)
    return a.device == b.device and sys.modules["torch"].equal(a, b)
