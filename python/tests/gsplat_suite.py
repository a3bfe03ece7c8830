"""Runs gsplat's own tests of `rasterization` with smalto's function in the place of gsplat's, on the CPU.

    git clone --branch v1.6.0 https://github.com/nerfstudio-project/gsplat
    python gsplat_suite.py gsplat      needs smalto, pytest, PyTorch and `rich`; neither CUDA nor gsplat installed

The tests are called as they are written, with the device "cpu", fewer Gaussians and a smaller picture. The expected
pictures are those of gsplat's `_rasterization`, in whose calls of CUDA gsplat's PyTorch functions and the loop of
RasterizeToPixels3DGSFwd.cu in float64 stand. Prints a table of how many cases pass, are refused, and why.
"""

import argparse
import collections
import pathlib
import sys
import tempfile
import types

import numpy as np
import pytest

GAUSSIANS, SIZE = 500, (60, 40)
ALPHA_MAX, ALPHA_MIN, TRANSMITTANCE_MIN = 0.999, 1 / 255, 1e-4
PIXELS = 256  # at a time, for memory


def without_cuda(torch):
    """Puts functions that need no CUDA in the place of those that `_rasterization` calls."""
    import gsplat.cuda._torch_impl as reference
    import gsplat.rendering as rendering

    def isect_tiles(means2d, radii, depths, *_, **__):
        # In the place of lists, what the blending below needs.
        return None, None, (radii, depths)

    def isect_offset_encode(_, images, tile_width, tile_height):
        return torch.zeros(images * tile_width * tile_height)

    def spherical_harmonics(degree, means, viewmats, coefficients, masks=None):
        directions = means[..., None, :, :] - torch.inverse(viewmats)[..., :, None, :3, 3]
        return reference._spherical_harmonics(degree, directions, coefficients)

    def rasterize_to_pixels(means2d, conics, colors, opacities, width, height, _, __, found, backgrounds=None, **___):
        radii, depths = found
        *images, n, channels = colors.shape
        flat = [values.reshape(-1, n, *values.shape[len(images) + 1 :]) for values in (means2d, conics, colors, radii)]
        means2d, conics, colors, radii = (values.double().numpy() for values in flat)
        opacities, depths = (values.reshape(-1, n).numpy() for values in (opacities, depths))
        drawn = [
            blended(*one, (width, height)) for one in zip(means2d, conics, colors, radii, opacities, depths)
        ]
        pictures, alphas = (
            torch.from_numpy(np.stack(parts).astype(np.float32)).reshape(*images, height, width, -1)
            for parts in zip(*drawn)
        )
        if backgrounds is not None:
            pictures = pictures + (1 - alphas) * backgrounds[..., None, None, :]
        return pictures, alphas

    rendering.isect_tiles, rendering.isect_offset_encode = isect_tiles, isect_offset_encode
    rendering.spherical_harmonics, reference._rasterize_to_pixels = spherical_harmonics, rasterize_to_pixels


def blended(means2d, conics, colors, radii, opacities, depths, size):
    """A picture (height, width, D) and its alphas (height, width, 1)."""
    order = np.argsort(depths.astype(np.float32), kind="stable")
    order = order[(radii[order] > 0).all(-1)]
    means2d, conics, colors, opacities = (values[order] for values in (means2d, conics, colors, opacities))
    a, b, c = conics.T[:, :, None]
    x, y = (at.ravel() + 0.5 for at in np.meshgrid(np.arange(size[0]), np.arange(size[1])))
    picture, left = np.zeros((len(x), colors.shape[-1])), np.ones(len(x))
    for start in range(0, len(x), PIXELS):
        some = slice(start, start + PIXELS)
        dx, dy = means2d[:, :1] - x[some], means2d[:, 1:] - y[some]
        sigma = 0.5 * (a * dx * dx + c * dy * dy) + b * dx * dy
        alpha = np.minimum(opacities[:, None] * np.exp(-sigma), ALPHA_MAX)
        alpha[(sigma < 0) | (alpha < ALPHA_MIN)] = 0
        # The splat that would leave no more than the least is not added, nor any behind it.
        after = np.cumprod(1 - alpha, 0)
        before = np.concatenate([np.ones_like(after[:1]), after[:-1]])
        weights = np.where(after > TRANSMITTANCE_MIN, alpha * before, 0)
        picture[some], left[some] = weights.T @ colors, 1 - weights.sum(0)
    return picture.reshape(size[1], size[0], -1), 1 - left.reshape(size[1], size[0], 1)


class Table:
    """What became of each case."""

    def __init__(self):
        self.counts = collections.Counter()

    def pytest_runtest_logreport(self, report):
        if report.when == "setup" and report.passed or report.when == "teardown":
            return
        name = report.nodeid.split("::")[-1].split("[")[0]
        if report.passed:
            why = ""
        elif report.skipped:
            why = report.longrepr[2]
        else:
            why = report.longrepr.reprcrash.message.splitlines()[0]
        outcome = "refused" if "smalto draws" in why or "render_mode: " in why else report.outcome
        self.counts[name, outcome, why.removeprefix("ValueError: ")[:90]] += 1

    def print(self):
        print(f"{'cases':>5}  {'test':42} {'outcome':8} why")
        for (name, outcome, why), count in sorted(self.counts.items()):
            print(f"{count:5}  {name[:42]:42} {outcome:8} {why}")


def adapted(source):
    """The tests for the CPU, smaller."""
    changes = [
        ('torch.device("cuda:0")', 'torch.device("cpu")'),
        ('device = "cuda"', 'device = "cpu"'),
        ("not torch.cuda.is_available()", "False"),
        ("not gsplat.has_3dgs()", "False"),
        ("not gsplat.has_3dgut()", "False"),
        ("[10_000]", f"[{GAUSSIANS}]"),
        ("= 300, 200", f"= {SIZE[0]}, {SIZE[1]}"),
        ("focal = 300.0", f"focal = {SIZE[0]:.1f}"),
    ]
    for before, after in changes:
        if before not in source:
            raise SystemExit(f"these are other tests than those of gsplat 1.6.0: they do not have {before}")
        source = source.replace(before, after)
    return source


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("checkout", type=pathlib.Path, help="the folder of gsplat's repository")
    parser.add_argument("pytest", nargs="*", help="arguments of pytest, like `-k packed`, after --")
    args = parser.parse_args()
    sys.path.insert(0, str(args.checkout.resolve()))
    import gsplat
    import gsplat.rendering
    import smalto
    import torch

    without_cuda(torch)
    gsplat.rasterization = gsplat.rendering.rasterization = smalto.rasterization
    lidar = types.ModuleType("tests.test_cameras")
    lidar.parse_lidar_camera = lambda *_, **__: pytest.skip("gsplat's tables of lidar cameras need CUDA")
    sys.modules["tests"], sys.modules["tests.test_cameras"] = types.ModuleType("tests"), lidar
    table = Table()
    with tempfile.TemporaryDirectory() as folder:
        file = pathlib.Path(folder) / "test_rasterization.py"
        file.write_text(adapted((args.checkout / "tests" / "test_rasterization.py").read_text()))
        (file.parent / "conftest.py").write_text("import pytest\n@pytest.fixture\ndef dist_init():\n    pass\n")
        options = ["-qq", "--no-summary", "-p", "no:cacheprovider", "--tb=no", "--rootdir", folder, str(file), *args.pytest]
        pytest.main(options, plugins=[table])
    table.print()


if __name__ == "__main__":
    main()
