"""Renders a scene by gsplat 1.5.3's own PyTorch functions, on the CPU in float64.

Usage: render_with_gsplat.py [--antialiased] [--depths] IN OUT.npy, with `pip install torch numpy gsplat==1.5.3`. No GPU and no CUDA
toolkit are needed. tests/gsplat.rs runs it with the Python that SMALTO_GSPLAT_PYTHON names.

IN is a folder with
    means.npy       [n, 3] f4     world units
    scales.npy      [n, 3] f4     standard deviations, not their logarithms
    rotations.npy   [n, 4] f4     unit quaternions w x y z
    opacities.npy   [n] f4        after the sigmoid
    sh.npy          [n, k, 3] f4  k = (degree + 1)^2; basis order and signs of the original 3DGS
    view.npy        [4, 4] f8     world to view: x right, y down, z forward
    intrinsics.npy  [4] f8        focal lengths x y, principal point x y, in px
    size.npy        [2] u4        width, height
OUT.npy becomes [height, width, 3] f4: colours over black, not clamped at 1; or with --depths, the expected depth (gsplat's
render mode ED), the median depth, which is 0 where the transmittance stays above a half, and the number of splats blended.

Projection and spherical harmonics are gsplat's functions (gsplat/cuda/_torch_impl.py), called unchanged. Its blending needs
CUDA; `blend` follows gsplat/cuda/csrc/RasterizeToPixels3DGSFwd.cu, lines 140 to 169.
"""

import argparse
import importlib.metadata
import importlib.util
import pathlib

import numpy as np
import torch

VERSION = "1.5.3"  # whose rules and constants these are
LOW_PASS, NEAR, FAR = 0.3, 0.01, 1e10  # gsplat's defaults
ALPHA_MAX, ALPHA_MIN, TRANSMITTANCE_MIN = 0.999, 1 / 255, 1e-4
TILE, CHUNK, BATCH = 16, 50_000, 1024  # for memory and speed: they do not change the picture


def load_gsplat():
    """gsplat's _torch_impl.py as a module of its own: `import gsplat` would look for CUDA, and may compile."""
    version = importlib.metadata.version("gsplat")
    if version != VERSION:
        raise SystemExit(f"gsplat is {version}; the rules here are those of {VERSION}")
    folder = importlib.util.find_spec("gsplat").submodule_search_locations[0]
    path = pathlib.Path(folder) / "cuda" / "_torch_impl.py"
    spec = importlib.util.spec_from_file_location("gsplat_torch_impl", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def project(gsplat, scene, view, intrinsics, width, height, antialiased, near=NEAR, far=FAR):
    """Of every visible Gaussian, nearest first: mean_px [m, 2], conic a b c [m, 3], opacity [m], colour and depth [m, d + 1],
    and half the sides of a box outside of which alpha is under the threshold [m, 2]. A scene has d "colours" or "sh", d = 3."""
    fx, fy, cx, cy = intrinsics
    k = torch.tensor([[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]], dtype=torch.float64)
    position = torch.inverse(view)[:3, 3]
    parts = []
    for start in range(0, len(scene["means"]), CHUNK):
        chunk = {name: values[start : start + CHUNK].double() for name, values in scene.items()}
        means, opacities = chunk["means"], chunk["opacities"]
        covariances, _ = gsplat._quat_scale_to_covar_preci(chunk["rotations"], chunk["scales"], compute_preci=False)
        radii, means_px, depths, conics, compensations = gsplat._fully_fused_projection(
            means, covariances, view[None], k, width, height, LOW_PASS, near, far, antialiased
        )
        if antialiased:
            opacities = opacities * compensations[0]
        # A radius of 0 says culled; one that overflowed its integer does not. The opacity is tested in
        # ProjectionEWA3DGSFused.cu, line 171, and by no function of PyTorch.
        keep = (radii[0] != 0).all(-1) & (opacities >= ALPHA_MIN)
        radii, means_px, depths, conics = (values[0][keep] for values in (radii, means_px, depths, conics))
        opacities = opacities[keep]
        if "sh" in chunk:
            degree = round(chunk["sh"].shape[1] ** 0.5) - 1
            colours = gsplat._spherical_harmonics(degree, means[keep] - position, chunk["sh"][keep])
            colours = torch.clamp_min(colours + 0.5, 0)  # gsplat/rendering.py, line 525
        else:
            colours = chunk["colours"][keep]
        colours = torch.cat((colours, depths[:, None]), 1)  # as render mode RGB+ED does
        # gsplat's radii are 3.33 sigma; alpha falls to 1/255 at sqrt(2 ln(255 opacity)) sigma, never more.
        half = radii.double().abs() * (torch.sqrt(2 * torch.log(opacities / ALPHA_MIN)) / 3.33)[:, None]
        parts.append((depths.float(), means_px, conics, opacities, colours, half + 0.01))  # px, against rounding
    depths, *splats = (torch.cat(values) for values in zip(*parts))
    order = torch.sort(depths, stable=True).indices  # gsplat sorts by the depth as a 32-bit float
    return [values[order] for values in splats]


def blend(means_px, conics, opacities, colours, half, width, height):
    """The image [height, width, d + 4], a tile after the other: colours, expected depth, median depth, number of splats,
    coverage."""
    channels = colours.shape[1] + 3
    image = torch.zeros(height, width, channels, dtype=torch.float64)
    low, high = means_px - half, means_px + half
    for top in range(0, height, TILE):
        y = torch.arange(top, min(top + TILE, height)) + 0.5
        in_rows = ((high[:, 1] >= y[0]) & (low[:, 1] <= y[-1])).nonzero()[:, 0]
        for left in range(0, width, TILE):
            x = torch.arange(left, min(left + TILE, width)) + 0.5
            ids = in_rows[(high[in_rows, 0] >= x[0]) & (low[in_rows, 0] <= x[-1])]
            splats = (means_px[ids], conics[ids], opacities[ids], colours[ids])
            tile = blend_tile(splats, x.double().repeat(len(y)), y.double().repeat_interleave(len(x)))
            image[top : top + TILE, left : left + TILE] = tile.view(len(y), len(x), channels)
    return image


def blend_tile(splats, x, y):
    """What `blend` makes of the pixels with centres at x, y."""
    transmittance = torch.ones_like(x)
    colour = torch.zeros(len(x), splats[3].shape[1], dtype=torch.float64)
    covered, median, count = (torch.zeros_like(x) for _ in range(3))
    for means_px, conics, opacities, colours in zip(*(values.split(BATCH) for values in splats)):
        # Arrays are [splat, pixel].
        dx, dy = means_px[:, :1] - x, means_px[:, 1:] - y
        a, b, c = conics.T[:, :, None]
        sigma = 0.5 * (a * dx * dx + c * dy * dy) + b * dx * dy
        alpha = (opacities[:, None] * torch.exp(-sigma)).clamp_max(ALPHA_MAX)
        alpha[(sigma < 0) | (alpha < ALPHA_MIN)] = 0  # as if it were skipped
        # Row i is what remains before splat i, row i + 1 after it.
        remaining = torch.cumprod(torch.cat((transmittance[None], 1 - alpha)), 0)
        # The splat that would leave no more than the least is not added, nor any behind it.
        is_added = remaining[1:] > TRANSMITTANCE_MIN
        weights = alpha * remaining[:-1] * is_added
        colour += weights.T @ colours
        covered += weights.sum(0)
        # The last one that is met by more than half of the light, as in RasterizeToPixels2DGSFwd.cu.
        is_median = is_added & (remaining[:-1] > 0.5) & (remaining[1:] <= 0.5)
        median += (is_median * colours[:, -1:]).sum(0)
        count += (is_added & (alpha > 0)).sum(0)
        transmittance = remaining[-1]
        if (transmittance <= TRANSMITTANCE_MIN).all():
            break
    colour[:, -1] /= covered.clamp_min(1e-10)  # gsplat/rendering.py, render mode ED
    return torch.cat((colour, median[:, None], count[:, None], covered[:, None]), 1)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", metavar="IN", type=pathlib.Path)
    parser.add_argument("out", metavar="OUT.npy", type=pathlib.Path)
    parser.add_argument("--antialiased", action="store_true", help='gsplat\'s rasterize_mode="antialiased"')
    parser.add_argument("--depths", action="store_true", help="expected depth, median depth, number of splats")
    args = parser.parse_args()

    def load(name):
        return torch.from_numpy(np.load(args.folder / f"{name}.npy"))

    scene = {name: load(name) for name in ("means", "scales", "rotations", "opacities", "sh")}
    width, height = np.load(args.folder / "size.npy").tolist()
    with torch.no_grad():
        splats = project(
            load_gsplat(), scene, load("view"), load("intrinsics").tolist(), width, height, args.antialiased
        )
        image = blend(*splats, width, height)
    image = image[..., 3:6] if args.depths else image[..., :3]
    np.save(args.out, image.numpy().astype(np.float32))


if __name__ == "__main__":
    main()
