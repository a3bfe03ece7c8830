"""What gsplat reports beside a picture, computed when it is read: the projection of every Gaussian to every camera."""

import math
import sys
from collections.abc import Iterator, MutableMapping
from typing import Any

import numpy as np

# Standard deviations from the mean to the border of a splat with the opacity 1, and the least alpha (gsplat).
_EXTENT, _ALPHA_MIN = 3.33, 1 / 255
# px^2, gsplat's default for `eps2d`.
_LOW_PASS = 0.3
# Smallest factor of an opacity that compensates for the low-pass (gsplat).
_COMPENSATION_MIN = 0.005

_PROJECTED = ("radii", "means2d", "depths", "conics", "opacities")
_IDS = ("batch_ids", "camera_ids", "gaussian_ids")
_TILED = ("tiles_per_gauss", "isect_ids", "flatten_ids", "isect_offsets")


class Meta(MutableMapping[str, Any]):
    """A dictionary with the keys of gsplat's `meta`, and `timings`, the GPU milliseconds of each picture.

    width, height, tile_size, tile_width, tile_height, n_batches and n_cameras are integers. The other values are
    computed when they are first read, from the arrays of the call, on their device, in float64:

    radii (..., C, N, 2) in pixels, 0 for Gaussians that are not drawn; means2d (..., C, N, 2) in pixels, depths
    (..., C, N), conics (..., C, N, 3), opacities (..., C, N), with the compensation of `antialiased`: 0 where radii are.
    If the call was `packed`, they have one row for each Gaussian that is drawn, and batch_ids, camera_ids and
    gaussian_ids name it; these are None otherwise. tiles_per_gauss counts the tiles of the box of the radii; isect_ids,
    flatten_ids and isect_offsets list them. There are no gradients: strategies that read some need gsplat.
    Pictures through lenses have sizes, counts and timings only.
    """

    def __init__(self, known: dict[str, Any], project, packed: bool):
        self._values, self._project, self._packed = dict(known), project, packed
        self._lazy = [*_IDS, *_PROJECTED, *_TILED] if project is not None else []

    def __getitem__(self, key: str) -> Any:
        if key not in self._values and key in self._lazy:
            made = self._tiles() if key in _TILED else self._project(self._packed)
            # What the caller has set stays.
            self._values = {name: made[name] for name in made if name in self._lazy} | self._values
        return self._values[key]

    def __setitem__(self, key: str, value: Any) -> None:
        self._values[key] = value

    def __delitem__(self, key: str) -> None:
        if key in self._lazy:
            self._lazy.remove(key)
            self._values.pop(key, None)
        else:
            del self._values[key]

    def __iter__(self) -> Iterator[str]:
        return iter(dict.fromkeys([*self._lazy, *self._values]))

    def __len__(self) -> int:
        return len(list(iter(self)))

    def __contains__(self, key: object) -> bool:
        return key in self._values or key in self._lazy

    def __repr__(self) -> str:
        return f"Meta({', '.join(self)})"

    def _tiles(self):
        dense = self._project(False)
        like = dense["radii"]
        dense = {name: _host(dense[name]) for name in ("radii", "means2d", "depths")}
        grid = (self["tile_width"], self["tile_height"])
        found = _intersections(dense, grid, self["tile_size"])
        if self._packed:
            counts = found["tiles_per_gauss"]
            is_drawn = (dense["radii"] > 0).all(-1)
            found["tiles_per_gauss"] = counts[is_drawn]
            row = np.cumsum(is_drawn.reshape(-1)) - 1
            found["flatten_ids"] = row[found["flatten_ids"]].astype(np.int32)
        return {name: _like(like, values) for name, values in found.items()}


def projector(scenes, batch, size, planes, radius_clip, antialiased):
    """What makes the projections: of batched arrays, for images of this size, with near and far plane."""
    rules = (radius_clip, antialiased)
    # Not the colors, whose memory would stay as long as the results.
    needed = [scenes[name] for name in ("means", "quats", "scales", "opacities", "viewmats", "Ks")]

    def project(packed):
        means, quats, scales, opacities, viewmats, Ks = needed
        parts = [
            projected((means[b], quats[b], scales[b], opacities[b]), viewmats[b, c], Ks[b, c], size, planes, *rules)
            for b in range(len(means))
            for c in range(viewmats.shape[1])
        ]
        xp, shape = _module(means), (*batch, viewmats.shape[1], means.shape[1])
        found = {name: _stack(xp, means, parts, name).reshape(*shape, *rest) for name, rest in _ROWS.items()}
        if not packed:
            return found | dict.fromkeys(_IDS)
        is_drawn = (found["radii"] > 0).all(-1)
        where = is_drawn.reshape(len(means), *shape[-2:]).nonzero()
        where = where.unbind(-1) if xp is not np else where
        return {name: values[is_drawn] for name, values in found.items()} | dict(zip(_IDS, where))

    return project


# The axes of a row of each result.
_ROWS = {"radii": (2,), "means2d": (2,), "depths": (), "conics": (3,), "opacities": ()}


def projected(gaussians, pose, K, size, planes, radius_clip, antialiased):
    """The splats of a scene in a picture, by the rules of gsplat (ProjectionEWA3DGSFused.cu): arrays by name."""
    xp = _module(gaussians[0])
    means, quats, scales, opacities, pose = (_double(values) for values in (*gaussians, pose))
    K = _host(_double(K))
    (fx, fy), (cx, cy), (width, height) = (K[0, 0], K[1, 1]), (K[0, 2], K[1, 2]), size
    turn = pose[:3, :3]
    x, y, z = (means @ turn.T + pose[:3, 3]).T
    near, far = planes
    is_drawn = (z >= near) & (z <= far)
    z_or_1 = xp.where(is_drawn, z, xp.ones_like(z))
    # The slope in the Jacobian ends 15 % of the image beyond each edge.
    tx, ty = (
        xp.clip(at / z_or_1, -(c + 0.15 * side) / f, (1.15 * side - c) / f)
        for at, c, f, side in ((x, cx, fx, width), (y, cy, fy, height))
    )
    axes = (turn @ _rotations(xp, quats)) * scales[:, None, :]
    v0 = (fx / z_or_1)[:, None] * (axes[:, 0] - tx[:, None] * axes[:, 2])
    v1 = (fy / z_or_1)[:, None] * (axes[:, 1] - ty[:, None] * axes[:, 2])
    a, b, c = (v0 * v0).sum(-1), (v0 * v1).sum(-1), (v1 * v1).sum(-1)
    # The determinant as a sum of squares (Cauchy-Binet), without cancellation.
    sharp = sum((v0[:, i] * v1[:, j] - v0[:, j] * v1[:, i]) ** 2 for i, j in ((0, 1), (1, 2), (2, 0)))
    determinant = sharp + _LOW_PASS * (a + c) + _LOW_PASS**2
    if antialiased:
        opacities = opacities * xp.sqrt(xp.clip(sharp / determinant, _COMPENSATION_MIN**2, 1.0))
    a, c = a + _LOW_PASS, c + _LOW_PASS
    is_drawn = is_drawn & (opacities >= _ALPHA_MIN)
    extent = xp.sqrt(2 * xp.log(xp.clip(opacities / _ALPHA_MIN, 1.0, math.inf)))
    extent = xp.clip(extent, 0.0, _EXTENT)
    rx, ry = xp.ceil(extent * xp.sqrt(a)), xp.ceil(extent * xp.sqrt(c))
    px, py = fx * x / z_or_1 + cx, fy * y / z_or_1 + cy
    is_drawn = is_drawn & (px + rx > 0) & (px - rx < width) & (py + ry > 0) & (py - ry < height)
    is_drawn = is_drawn & ((rx > radius_clip) | (ry > radius_clip))
    rows = {
        "radii": xp.stack([rx, ry], -1),
        "means2d": xp.stack([px, py], -1),
        "depths": z,
        "conics": xp.stack([c / determinant, -b / determinant, a / determinant], -1),
        "opacities": opacities,
    }
    return {name: _masked(xp, name, values, is_drawn) for name, values in rows.items()}


def _masked(xp, name, values, is_drawn):
    mask = is_drawn if values.ndim == 1 else is_drawn[:, None]
    values = xp.where(mask, values, xp.zeros_like(values))
    if name == "radii":
        # A radius beyond 32 bits covers every picture.
        values = xp.clip(values, 0.0, 2.0**31 - 256)
        return values.astype(np.int32) if xp is np else values.int()
    return values.astype(np.float32) if xp is np else values.float()


def of_covariances(covars):
    """Quaternions and scales of covariances (..., 3, 3): their eigenvectors, and the roots of their eigenvalues."""
    xp = _module(covars)
    covars = _double(covars)
    squares, axes = xp.linalg.eigh(covars)
    # A reflection becomes a rotation; the ellipsoid is the same.
    axes = axes * xp.sign(xp.linalg.det(axes))[..., None, None]
    (a, b, c), (d, e, f), (g, h, i) = (tuple(axes[..., row, column] for column in range(3)) for row in range(3))
    # Four times the products of the largest component with each, of which one is at least 1 (Shepperd 1978).
    products = xp.stack([
        xp.stack([1 + a + e + i, h - f, c - g, d - b], -1), xp.stack([h - f, 1 + a - e - i, b + d, c + g], -1),
        xp.stack([c - g, b + d, 1 - a + e - i, f + h], -1), xp.stack([d - b, c + g, f + h, 1 - a - e + i], -1),
    ], -2)  # fmt: skip
    traces = xp.stack([products[..., k, k] for k in range(4)], -1)
    largest = traces.argmax(-1)
    quats = sum(products[..., k, :] * (largest == k)[..., None] for k in range(4))
    lengths = xp.sqrt((quats * quats).sum(-1))[..., None]
    return quats / lengths, xp.sqrt(xp.clip(squares, 0.0, math.inf))


def _rotations(xp, quats):
    w, x, y, z = (quats / xp.sqrt((quats * quats).sum(-1))[:, None]).T
    rows = [
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    ]  # fmt: skip
    return xp.stack(rows, -1).reshape(-1, 3, 3)


def _intersections(dense, grid, tile_size):
    """The tiles of each splat, and the splats of each tile from near to far."""
    images = math.prod(dense["depths"].shape[:-1])
    count = dense["depths"].shape[-1]
    means, radii = (dense[name].reshape(images * count, 2) for name in ("means2d", "radii"))
    low = np.clip(np.floor((means - radii) / tile_size), 0, grid).astype(np.int64)
    high = np.clip(np.ceil((means + radii) / tile_size), 0, grid).astype(np.int64)
    wide, tall = (high - low).T
    counts = np.where((radii > 0).all(-1), wide * tall, 0)
    splat = np.repeat(np.arange(images * count), counts)
    place = np.arange(len(splat)) - np.repeat(np.cumsum(counts) - counts, counts)
    row, column = low[splat, 1] + place // wide[splat], low[splat, 0] + place % wide[splat]
    tiles = grid[0] * grid[1]
    tile, image = row * grid[0] + column, splat // max(count, 1)
    bits = dense["depths"].reshape(-1).view(np.int32).astype(np.int64)[splat]
    ids = (image << (32 + tiles.bit_length())) | (tile << 32) | bits
    order = np.argsort(ids, kind="stable")
    lists = np.bincount(image * tiles + tile, minlength=images * tiles)
    offsets = np.cumsum(lists) - lists
    return {
        "tiles_per_gauss": counts.reshape(dense["depths"].shape).astype(np.int32),
        "isect_ids": ids[order],
        "flatten_ids": splat[order].astype(np.int32),
        "isect_offsets": offsets.reshape(*dense["depths"].shape[:-1], grid[1], grid[0]).astype(np.int32),
    }


def is_tensor(values) -> bool:
    """True for a tensor of PyTorch, which is not imported for this."""
    torch = sys.modules.get("torch")
    return torch is not None and isinstance(values, torch.Tensor)


def _module(values):
    return sys.modules["torch"] if is_tensor(values) else np


def _host(values):
    return values.cpu().numpy() if is_tensor(values) else values


def _like(like, values):
    return _module(like).as_tensor(values, device=like.device) if is_tensor(like) else values


def _double(values):
    return values.double() if is_tensor(values) else values.astype(np.float64)


def _stack(xp, means, parts, name):
    if parts:
        return xp.stack([part[name] for part in parts])
    kind = xp.int32 if name == "radii" else xp.float32
    shape = (0, means.shape[1], *_ROWS[name])
    return xp.zeros(shape, dtype=kind) if xp is np else xp.zeros(shape, dtype=kind, device=means.device)
