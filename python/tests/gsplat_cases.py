"""Calls of `rasterization`, and what gsplat makes of them.

    python gsplat_cases.py      with `pip install torch numpy gsplat==1.5.3`; no GPU, no CUDA toolkit

writes gsplat.npz beside it: the results of gsplat's own PyTorch functions in float64, by which test_rasterization.py
judges the package. It is part of the repository, so that the test needs neither PyTorch nor gsplat.
"""

import pathlib
import sys

import numpy as np

HERE = pathlib.Path(__file__).parent
SIZE = (32, 24)
GAUSSIANS, CAMERAS = 80, 2


def scene(seed):
    """Gaussians before two cameras, whose numbers are the same with every version of NumPy."""
    random = np.random.RandomState(seed)
    quats = random.randn(GAUSSIANS, 4)
    scene = {
        "means": random.uniform(-1.2, 1.2, (GAUSSIANS, 3)) + [0, 0, 4],
        "quats": quats / np.linalg.norm(quats, axis=-1, keepdims=True),
        "scales": np.exp(random.uniform(-3.5, -1.2, (GAUSSIANS, 3))),
        "opacities": random.uniform(0.1, 1, GAUSSIANS),
        "colors": random.randn(GAUSSIANS, 16, 3) * 0.4,
    }
    viewmats = np.stack([np.eye(4)] * CAMERAS)
    angle = 0.25
    viewmats[1, :3, :3] = [[np.cos(angle), 0, -np.sin(angle)], [0, 1, 0], [np.sin(angle), 0, np.cos(angle)]]
    viewmats[1, :3, 3] = [0.9, 0.1, 0.4]
    Ks = np.stack([np.array([[30.0, 0, 15.5], [0, 31, 12.25], [0, 0, 1]])] * CAMERAS)
    single = {name: values.astype(np.float32) for name, values in scene.items()}
    return single | {"viewmats": viewmats.astype(np.float32), "Ks": Ks.astype(np.float32)}


def cases():
    """The keyword arguments of each call, by its name."""
    random = np.random.RandomState(7)
    uniform = lambda *shape: random.uniform(-0.5, 1.5, shape).astype(np.float32)
    base = scene(1) | {"width": SIZE[0], "height": SIZE[1]}
    backgrounds = uniform(CAMERAS, 3)
    found = {f"degree {degree}": base | {"sh_degree": degree} for degree in range(4)}
    found["background"] = base | {"sh_degree": 1, "backgrounds": backgrounds}
    for mode in ("D", "ED", "RGB+D", "RGB+ED"):
        found[mode] = base | {"sh_degree": 0, "render_mode": mode, "backgrounds": backgrounds}
    found["antialiased"] = base | {"sh_degree": 2, "rasterize_mode": "antialiased"}
    found["three channels"] = base | {"colors": np.abs(uniform(GAUSSIANS, 3))}
    five = {"colors": uniform(GAUSSIANS, 5), "backgrounds": uniform(CAMERAS, 5)}
    found["five channels, some negative"] = base | five | {"render_mode": "RGB+D"}
    found["one channel"] = base | {"colors": uniform(GAUSSIANS, 1)}
    found["colors of each camera"] = base | {"colors": uniform(CAMERAS, GAUSSIANS, 3)}
    both = np.stack([base["colors"], base["colors"][::-1]])
    found["harmonics of each camera"] = base | {"colors": both, "sh_degree": 3}
    found["far plane"] = base | {"sh_degree": 3, "far_plane": 4.0, "render_mode": "RGB+ED"}
    found["near plane"] = base | {"sh_degree": 3, "near_plane": 3.5}
    scenes = [scene(2), scene(3)]
    batch = {name: np.stack([one[name] for one in scenes]) for name in scenes[0]}
    sizes = {"width": SIZE[0], "height": SIZE[1], "backgrounds": uniform(2, CAMERAS, 3)}
    found["batch"] = batch | sizes | {"sh_degree": 3, "render_mode": "RGB+D"}
    return found


def by_gsplat(arguments):
    """Colors and alphas of a call."""
    sys.path.insert(0, str(HERE.parent.parent / "tests" / "gsplat"))
    import render_with_gsplat as gsplat
    import torch

    if arguments["means"].ndim == 3:
        names = ("means", "quats", "scales", "opacities", "colors", "viewmats", "Ks", "backgrounds")
        parts = [by_gsplat(arguments | {name: arguments[name][b] for name in names}) for b in range(2)]
        return [np.stack(values) for values in zip(*parts)]
    functions = gsplat.load_gsplat()
    degree, mode = arguments.get("sh_degree"), arguments.get("render_mode", "RGB")
    colors, alphas = [], []
    for c in range(CAMERAS):
        own = arguments["colors"]
        own = own[c] if own.ndim == (3 if degree is None else 4) else own
        look = {"colours": own} if degree is None else {"sh": own[:, : (degree + 1) ** 2]}
        gaussians = {
            "means": arguments["means"],
            "rotations": arguments["quats"],
            "scales": arguments["scales"],
            "opacities": arguments["opacities"],
            **look,
        }
        K = arguments["Ks"][c].astype(np.float64)
        splats = gsplat.project(
            functions,
            {name: torch.from_numpy(values.copy()) for name, values in gaussians.items()},
            torch.from_numpy(arguments["viewmats"][c].astype(np.float64)),
            [K[0, 0], K[1, 1], K[0, 2], K[1, 2]],
            *SIZE,
            arguments.get("rasterize_mode") == "antialiased",
            arguments.get("near_plane", gsplat.NEAR),
            arguments.get("far_plane", gsplat.FAR),
        )
        image = gsplat.blend(*splats, *SIZE).numpy()
        alpha, picture, depth = image[..., -1:], image[..., :-4], image[..., -4:-3]
        if "backgrounds" in arguments:
            picture = picture + (1 - alpha) * arguments["backgrounds"][c]
        parts = [picture] if mode.startswith("RGB") else []
        if mode != "RGB":
            parts.append(depth if mode.endswith("ED") else depth * alpha)
        colors.append(np.concatenate(parts, -1))
        alphas.append(alpha)
    return [np.stack(values).astype(np.float32) for values in (colors, alphas)]


if __name__ == "__main__":
    results = {}
    for name, arguments in cases().items():
        results[f"{name}: colors"], results[f"{name}: alphas"] = by_gsplat(arguments)
    np.savez_compressed(HERE / "gsplat.npz", **results)
