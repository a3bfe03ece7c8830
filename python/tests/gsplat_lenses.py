"""Camera models of `rasterization`, and what gsplat makes of them.

    git clone https://github.com/nerfstudio-project/gsplat      the results are those of its commit 90d7b4b3
    python gsplat_lenses.py gsplat      needs PyTorch, NumPy and `rich`; neither a GPU nor CUDA

writes gsplat_lenses.npz beside it: places of directions, rays of pixels and pictures along rays of gsplat's own PyTorch
functions in float64, by which test_lenses.py judges the package. It is part of the repository, so that the test needs
neither PyTorch nor gsplat.
"""

import math
import pathlib
import sys
import types

import numpy as np

HERE = pathlib.Path(__file__).parent
SIZE = (32, 24)
GAUSSIANS = 60
ROWS = 4  # the rays of one of as many rows are kept
K = np.array([[20.0, 0, 15.5], [0, 21, 12.25], [0, 0, 1]])
LOW_PASS = 0.3  # px^2
BENT = {"with_ut": True, "with_eval3d": True}


def f_theta(**change):
    """gsplat's FThetaCameraDistortionParameters, which needs CUDA."""
    forward = {
        "reference_poly": 1,
        "pixeldist_to_angle_poly": [0.0] * 6,
        "angle_to_pixeldist_poly": [0.0, 22.0, 0.5, -0.4, 0.0, 0.0],
        "max_angle": 1.2,
        "linear_cde": [1.01, 0.02, -0.01],
    }
    return types.SimpleNamespace(**(forward | change))


def models():
    """The camera arguments of each model, by its name."""
    single = lambda *values: np.array([values])
    weak = {"radial_coeffs": single(-0.1, 0.02, 0.003, 0.05, -0.01, 0.002)}
    bent = {"tangential_coeffs": single(0.003, -0.002), "thin_prism_coeffs": single(0.004, -0.001, -0.003, 0.002)}
    inverse = {"reference_poly": 0, "pixeldist_to_angle_poly": [0.0, 1 / 22, 1e-4, 0, 0, 0]}
    return {
        "pinhole": BENT,
        "pinhole, rational": BENT | weak | bent,
        "pinhole, strong": BENT | {"radial_coeffs": single(-0.25, 0.05, 0, 0, 0, 0)},
        "ortho": BENT | {"camera_model": "ortho"},
        "fisheye": BENT | {"camera_model": "fisheye"},
        "fisheye, coefficients": BENT | {"camera_model": "fisheye", "radial_coeffs": single(-0.02, 1e-3, 0, 0)},
        "ftheta": BENT | {"camera_model": "ftheta", "ftheta_coeffs": f_theta()},
        "ftheta, inverse": BENT | {"camera_model": "ftheta", "ftheta_coeffs": f_theta(**inverse)},
    }


def directions():
    """Points of view axes up to 84 degrees from the axis, which all models are asked for."""
    random = np.random.RandomState(4)
    angle, azimuth = random.uniform(0, 1.47, 400), random.uniform(0, 2 * np.pi, 400)
    return np.stack([np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), np.cos(angle)], -1)


def scene():
    """Gaussians around the axis, the arguments of `rasterization` besides the camera's."""
    random = np.random.RandomState(9)
    quats = random.randn(GAUSSIANS, 4)
    return {
        "means": random.uniform([-1.2, -1, 1.2], [1.2, 1, 4], (GAUSSIANS, 3)).astype(np.float32),
        "quats": (quats / np.linalg.norm(quats, axis=-1, keepdims=True)).astype(np.float32),
        "scales": np.exp(random.uniform(-3.5, -1, (GAUSSIANS, 3))).astype(np.float32),
        "opacities": random.uniform(0.2, 1, GAUSSIANS).astype(np.float32),
        "colors": random.uniform(0, 1, (GAUSSIANS, 3)).astype(np.float32),
        "viewmats": np.eye(4, dtype=np.float32)[None],
        "Ks": K[None].astype(np.float32),
        "width": SIZE[0],
        "height": SIZE[1],
    }


def rotations(quats):
    w, x, y, z = quats.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def footprint(places, mean, is_parallel):
    """The covariance across a direction, in world units, that a camera maps to LOW_PASS px^2: gsplat has no low-pass
    along rays, so that a Gaussian is made wider by it."""
    far = 1.0 if is_parallel else np.linalg.norm(mean)
    normal = np.array([0.0, 0.0, 1.0]) if is_parallel else mean / far
    first = np.cross(normal, [1.0, 0, 0] if abs(normal[0]) < 0.5 else [0.0, 1, 0])
    across = np.stack([first / np.linalg.norm(first), np.cross(normal, first / np.linalg.norm(first))])
    step = 1e-6
    at = lambda move: places((mean / far + move)[None])[0][0]
    jacobian = np.stack([(at(step * axis) - at(-step * axis)) / (2 * step) for axis in across], -1)
    return far**2 * across.T @ (LOW_PASS * np.linalg.inv(jacobian.T @ jacobian)) @ across


def picture(places, rays, given, is_parallel):
    """Colors (height, width, 3) along gsplat's rays, by its distances and alphas, in the order of the distance, or of z
    if the lens is parallel."""
    import gsplat.cuda._torch_impl_eval3d as eval3d
    import torch

    values = {name: given[name].astype(np.float64) for name in ("means", "quats", "scales", "opacities", "colors")}
    turned = rotations(values["quats"]) * values["scales"][:, None]
    means = values["means"]
    wide = turned @ np.swapaxes(turned, 1, 2) + np.stack([footprint(places, mean, is_parallel) for mean in means])
    lengths, axes = np.linalg.eigh(wide)
    # What `_compute_gaussian_transform` makes of quaternions and scales.
    whiten = np.swapaxes(axes, 1, 2) / np.sqrt(lengths)[..., None]
    origins, _ = rays
    far = means[:, 2] if is_parallel else np.linalg.norm(means, axis=-1)
    colors, left = np.zeros((len(origins), 3)), np.ones(len(origins))
    is_open = np.ones(len(origins), bool)
    for i in np.argsort(far.astype(np.float32), kind="stable"):
        each = lambda value: torch.from_numpy(np.broadcast_to(value, (len(origins), *value.shape)).copy())
        gaussian = [each(value) for value in (means[i], whiten[i], np.sqrt(lengths[i]))]
        distance, _ = eval3d._compute_ray_gaussian_distance(*map(torch.from_numpy, rays), *gaussian)
        opacities = torch.full_like(distance, values["opacities"][i])
        # The package draws with the limit of the alphas of gsplat 1.5.
        alphas, _ = eval3d._compute_gaussian_alphas(distance, opacities, 1e-6)
        alphas = np.where(alphas.numpy() >= 1 / 255, alphas.numpy(), 0)
        is_open &= left * (1 - alphas) > 1e-4
        weights = np.where(is_open, left * alphas, 0)
        colors += weights[:, None] * values["colors"][i]
        left -= weights
    return colors.reshape(SIZE[1], SIZE[0], 3)


def by_gsplat(arguments):
    """Places (400, 2) of the directions, rays (height / ROWS, width, 3), the colors; which places and rays are valid."""
    import torch
    from gsplat.cuda._torch_cameras import _BaseCameraModel

    tensor = lambda values: torch.from_numpy(np.asarray(values, np.float64))
    model = arguments.get("camera_model", "pinhole")
    coefficients = {name: tensor(values[0]) for name, values in arguments.items() if name.endswith("l_coeffs")}
    if "thin_prism_coeffs" in arguments:
        coefficients["thin_prism_coeffs"] = tensor(arguments["thin_prism_coeffs"][0])
    if model == "ftheta":
        coefficients["ftheta_coeffs"] = arguments["ftheta_coeffs"]
    else:
        coefficients["focal_lengths"] = tensor(K[[0, 1], [0, 1]])
    # The checks of shapes take one batch at least.
    coefficients = {n: v[None] if torch.is_tensor(v) else v for n, v in coefficients.items()}
    camera = _BaseCameraModel.create(*SIZE, model, principal_points=tensor(K[:2, 2])[None], **coefficients)

    def places(points):
        found, valid = camera.camera_ray_to_image_point(tensor(points)[None], math.inf)
        return found[0].numpy(), valid[0].numpy()

    columns, rows = np.meshgrid(np.arange(SIZE[0]) + 0.5, np.arange(SIZE[1]) + 0.5)
    pixels = tensor(np.stack([columns.ravel(), rows.ravel()], -1))[None]
    along, is_ray = (values[0].numpy() for values in camera.image_point_to_camera_ray(pixels))
    origins = np.zeros_like(along)
    if model == "ortho":
        # The pixel gives the origin of a parallel ray.
        pose = tensor([0, 0, 0, 1, 0, 0, 0])[None]
        origins, along, is_ray = (
            values[0].numpy() for values in camera.image_point_to_world_ray_shutter_pose(pixels, pose, pose)
        )
    found, is_seen = places(directions())
    colors = picture(places, (origins, along), scene(), model == "ortho")
    rays, is_ray = along.reshape(SIZE[1], SIZE[0], 3)[::ROWS], is_ray.reshape(SIZE[::-1])[::ROWS]
    return {"places": found, "is_seen": is_seen, "rays": rays, "is_ray": is_ray, "colors": colors.astype(np.float32)}


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    sys.path.insert(0, sys.argv[1])
    results = {}
    for name, arguments in models().items():
        results |= {f"{name}: {part}": values for part, values in by_gsplat(arguments).items()}
    np.savez_compressed(HERE / "gsplat_lenses.npz", **results)
