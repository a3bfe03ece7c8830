"""Cameras with lenses: projections against the published formulas, rays, and gsplat's camera models."""

import pathlib
import types

import gsplat_lenses
import numpy as np
import pytest
import smalto
from gsplat_lenses import f_theta as f_theta_coeffs
from smalto._lenses import Lenses
from smalto._shutter import Shutter

HERE = pathlib.Path(__file__).parent
SIZE = (60, 40)
# World units, so that a position away from the origin shows.
POSITION = np.array([0.3, -0.2, 0.5])


def slope(x, y, z):
    return x / z, y / z


def angle(x, y, z):
    rho = np.hypot(x, y)
    theta = np.arctan2(rho, z)
    return theta * x / rho, theta * y / rho


def distorted(b, k=(), under=(), p=(0, 0), s=(0, 0, 0, 0)):
    """OpenCV's radial, tangential and thin prism distortion (documentation of calib3d)."""
    x, y = b
    r2 = x * x + y * y
    over = 1 + sum(k * r2**i for i, k in enumerate(k, 1))
    factor = over / (1 + sum(k * r2**i for i, k in enumerate(under, 1)))
    u = x * factor + 2 * p[0] * x * y + p[1] * (r2 + 2 * x * x) + s[0] * r2 + s[1] * r2 * r2
    v = y * factor + p[0] * (r2 + 2 * y * y) + 2 * p[1] * x * y + s[2] * r2 + s[3] * r2 * r2
    return u, v


def radial(radius):
    """The map of a radius of slopes, as a map of points."""

    def plane(x, y, z):
        rho = np.hypot(x, y)
        return radius(rho / z) * x / rho, radius(rho / z) * y / rho

    return plane


def aria(x, y, z, k, p, s):
    """FisheyeRadTanThinPrism of Project Aria."""
    u, v = distorted(angle(x, y, z), k)
    r2, along = u * u + v * v, 2 * (u * p[0] + v * p[1])
    return u + u * along + r2 * p[0] + s[0] * r2 + s[1] * r2**2, v + v * along + r2 * p[1] + s[2] * r2 + s[3] * r2**2


def metashape(b, k, p1, p2, b2):
    """Agisoft Metashape's manual, "Camera models", with b2 in units of f + b1."""
    x, y = b
    r2 = x * x + y * y
    factor = 1 + sum(k * r2**i for i, k in enumerate(k, 1))
    u = x * factor + p1 * (r2 + 2 * x * x) + 2 * p2 * x * y
    v = y * factor + p2 * (r2 + 2 * y * y) + 2 * p1 * x * y
    return u + b2 * v, v


def f_theta(x, y, z, radius, c, d, e):
    rho = np.hypot(x, y)
    u, v = radius(np.arctan2(rho, z)) * np.stack([x, y]) / rho
    return c * u + d * v, e * u + v


def inverted(polynomial):
    """The radius at which a growing polynomial has a value, by Newton's method."""

    def radius(theta):
        r = theta.copy()
        for _ in range(50):
            r -= (polynomial(r) - theta) / polynomial.deriv()(r)
        return r

    return radius


def eucm(x, y, z, alpha, beta):
    below = alpha * np.sqrt(beta * (x * x + y * y) + z * z) + (1 - alpha) * z
    return x / below, y / below


K6, P, S = [-0.1, 0.02, 0.003, 0.05, -0.01, 0.002], [0.003, -0.002], [0.004, -0.001, -0.003, 0.002]
FORWARD = np.polynomial.Polynomial([0, 1, 0.02, -0.03, 0.004, 0.001])
MODELS = {
    "PINHOLE": ([], slope),
    "SIMPLE_PINHOLE": ([], slope),
    "SIMPLE_RADIAL": ([-0.1], lambda *at: distorted(slope(*at), [-0.1])),
    "RADIAL": ([-0.1, 0.02], lambda *at: distorted(slope(*at), [-0.1, 0.02])),
    "OPENCV": ([-0.1, 0.02, *P], lambda *at: distorted(slope(*at), [-0.1, 0.02], p=P)),
    "FULL_OPENCV": ([*K6[:2], *P, *K6[2:]], lambda *at: distorted(slope(*at), K6[:3], K6[3:], P)),
    "OPENCV_THIN_PRISM": ([*K6, *P, *S], lambda *at: distorted(slope(*at), K6[:3], K6[3:], P, S)),
    "PERSPECTIVE": ([*K6[:4], *P], lambda *at: distorted(slope(*at), K6[:4], p=P)),
    "SIMPLE_FISHEYE": ([], angle),
    "FISHEYE": ([], angle),
    "SIMPLE_RADIAL_FISHEYE": ([-0.1], lambda *at: distorted(angle(*at), [-0.1])),
    "RADIAL_FISHEYE": ([-0.1, 0.02], lambda *at: distorted(angle(*at), [-0.1, 0.02])),
    "OPENCV_FISHEYE": (K6[:4], lambda *at: distorted(angle(*at), K6[:4])),
    "THIN_PRISM_FISHEYE": (
        [*K6[:2], *P, *K6[2:4], S[0], S[2]],
        lambda *at: distorted(angle(*at), K6[:4], p=P, s=[S[0], 0, S[2], 0]),
    ),
    "RAD_TAN_THIN_PRISM_FISHEYE": ([*K6, *P, *S], lambda *at: aria(*at, K6, P, S)),
    "FOV": ([0.9], radial(lambda r: np.arctan(2 * np.tan(0.45) * r) / 0.9)),
    "SIMPLE_DIVISION": ([-0.2], radial(lambda r: 2 * r / (1 + np.sqrt(1 + 0.8 * r * r)))),
    "DIVISION": ([0.2], radial(lambda r: 2 * r / (1 + np.sqrt(1 - 0.8 * r * r)))),
    "EUCM": ([0.6, 1.1], lambda *at: eucm(*at, 0.6, 1.1)),
    "METASHAPE_FRAME": ([*K6[:4], *P, 0.01], lambda *at: metashape(slope(*at), K6[:4], *P, 0.01)),
    "METASHAPE_FISHEYE": ([*K6[:4], *P, 0.01], lambda *at: metashape(angle(*at), K6[:4], *P, 0.01)),
    "FTHETA": (
        [*FORWARD.coef[2:], 1.5, 1.01, 0.02, -0.01],
        lambda *at: f_theta(*at, FORWARD, 1.01, 0.02, -0.01),
    ),
    "FTHETA_INVERSE": (
        [*FORWARD.coef[2:], 1.5, 1.01, 0.02, -0.01],
        lambda *at: f_theta(*at, inverted(FORWARD), 1.01, 0.02, -0.01),
    ),
    "EQUIRECTANGULAR": ([], lambda x, y, z: (np.arctan2(x, z), np.arctan2(y, np.hypot(x, z)))),
    "ORTHOGRAPHIC": ([], lambda x, y, z: (x, y)),
}
INTRINSICS = np.array([[50.0, 0, 29.5], [0, 52.0, 21.25], [0, 0, 1]])


def rotation():
    """A rotation about all axes."""
    q, _ = np.linalg.qr(np.random.RandomState(3).randn(3, 3))
    return q * np.sign(np.linalg.det(q))


def camera(model, numbers=(), K=INTRINSICS):
    c2w = np.eye(4)
    c2w[:3, :3], c2w[:3, 3] = rotation(), POSITION
    return smalto.Camera(K=K, size=SIZE, c2w=c2w, lens=(model, list(numbers)))


@pytest.mark.parametrize("model", MODELS)
def test_points_are_seen_where_the_published_formulas_say(model):
    numbers, plane = MODELS[model]
    random = np.random.RandomState(1)
    # Up to 37 degrees from the axis, at distances from 0.5 to 10.
    seen = np.column_stack([random.uniform(-0.5, 0.5, (500, 2)), np.ones(500)]) * random.uniform(0.5, 8, (500, 1))
    pixels, is_seen = camera(model, numbers).project(seen @ rotation().T + POSITION)
    assert pixels.dtype == np.float64 and is_seen.dtype == bool and is_seen.all()
    expected = np.stack(plane(*seen.T), -1) * [50.0, 52.0] + [29.5, 21.25]
    assert np.abs(pixels - expected).max() < 1e-10


@pytest.mark.parametrize("model", MODELS)
def test_points_on_the_rays_of_pixels_are_seen_at_their_centres(model):
    one = camera(model, MODELS[model][0])
    origins, directions = one.rays()
    assert origins.shape == directions.shape == (SIZE[1], SIZE[0], 3)
    points, is_ray = origins + 2.5 * directions, np.isfinite(directions).all(-1)
    assert is_ray.mean() > 0.9, "the lens covers the picture"
    assert np.abs(np.linalg.norm(directions[is_ray], axis=-1) - 1).max() < 1e-14
    pixels, is_seen = one.project(points[is_ray])
    rows, columns = np.indices(is_ray.shape)
    assert is_seen.all()
    assert np.abs(pixels - np.stack([columns, rows], -1)[is_ray] - 0.5).max() < 1e-8


def test_rays_of_a_parallel_lens_begin_in_the_plane_of_the_camera():
    origins, directions = camera("ORTHOGRAPHIC").rays()
    assert np.abs(directions - rotation()[:, 2]).max() < 1e-15
    assert np.abs((origins - POSITION) @ rotation()[:, 2]).max() < 1e-14
    assert np.ptp(origins.reshape(-1, 3), axis=0).max() > 0.5
    origins, _ = camera("FISHEYE").rays()
    assert (origins == POSITION).all()


def test_what_a_lens_does_not_see_is_masked():
    ahead, behind = POSITION + 2 * rotation()[:, 2], POSITION - 2 * rotation()[:, 2]
    for model in ("PINHOLE", "SIMPLE_RADIAL", "ORTHOGRAPHIC"):
        pixels, is_seen = camera(model, MODELS[model][0]).project([ahead, behind])
        assert is_seen.tolist() == [True, False] and np.isnan(pixels).tolist() == [[False] * 2, [True] * 2], model
    narrow = np.array([[10.0, 0, 30], [0, 10.0, 20], [0, 0, 1]])
    _, directions = camera("FTHETA", [0, 0, 0, 0, 1.0, 1, 0, 0], narrow).rays()
    at = (np.indices((SIZE[1], SIZE[0])) + 0.5 - np.array([20, 30])[:, None, None]) / 10
    assert np.array_equal(np.isnan(directions).any(-1), np.hypot(*at) >= 1.0), "f-theta ends at max_angle"


def test_wrong_points_are_one_clear_exception():
    one = camera("FISHEYE")
    with pytest.raises(ValueError, match=r"points: expected the shape \(N, 3\), found \(3,\)"):
        one.project([0.0, 0.0, 1.0])
    with pytest.raises(ValueError, match="points: the value NaN in row 1"):
        one.project([[0, 0, 1], [0, np.nan, 1]])
    with pytest.raises(TypeError, match="points: expected numbers"):
        one.project("points")
    assert one.project(np.zeros((0, 3)))[0].shape == (0, 2)


# Arguments of `rasterization`.
def scene(count=60):
    random = np.random.RandomState(0)
    view = np.eye(4, dtype=np.float32)
    view[:3, 3] = [0.1, -0.2, 0.3]
    return {
        "means": random.uniform([-1.5, -1, 1], [1.5, 1, 3], (count, 3)).astype(np.float32),
        "quats": random.randn(count, 4).astype(np.float32),
        "scales": random.uniform(0.05, 0.2, (count, 3)).astype(np.float32),
        "opacities": random.uniform(0.3, 0.9, count).astype(np.float32),
        "colors": random.randn(count, 4, 3).astype(np.float32) * 0.5,
        "sh_degree": 1,
        "viewmats": np.stack([view, np.eye(4, dtype=np.float32)]),
        "Ks": np.tile(np.float32([[20, 0, 30], [0, 21, 20], [0, 0, 1]]), (2, 1, 1)),
        "width": SIZE[0],
        "height": SIZE[1],
    }


def pictures(arguments, lens, K=None):
    """The pictures of the same cameras, given by their lens."""
    gaussians = smalto.Scene.from_arrays(
        *(arguments[name] for name in ("means", "quats", "scales", "opacities", "colors"))
    )
    renderer = smalto.Renderer(gaussians, preset="gsplat", near=0.01)
    cameras = [
        smalto.Camera(K=arguments["Ks"][c] if K is None else K, size=SIZE, viewmat=pose, lens=lens[c])
        for c, pose in enumerate(arguments["viewmats"])
    ]
    return np.stack([p.color for p in renderer.render_many(cameras, layers=("color", "alpha"))])


BENT = {"with_ut": True, "with_eval3d": True}
RADIAL = np.float32([[-0.02, 0.001, 0.0, 0.0], [0.03, -0.002, 0.0005, 0.0]])
PRISMS = [np.float32([[*K6], [*K6[::-1]]]), np.float32([P, P]), np.float32([S, S])]
CASES = {
    "fisheye": ({"camera_model": "fisheye"}, ["FISHEYE"] * 2),
    "fisheye along rays": ({"camera_model": "fisheye", "global_z_order": False, **BENT}, ["FISHEYE"] * 2),
    "fisheye with coefficients": (
        {"camera_model": "fisheye", "radial_coeffs": RADIAL, **BENT},
        [("OPENCV_FISHEYE", row.tolist()) for row in RADIAL],
    ),
    "pinhole with coefficients": (
        {
            "radial_coeffs": PRISMS[0],
            "tangential_coeffs": PRISMS[1],
            "thin_prism_coeffs": PRISMS[2],
            **BENT,
        },
        [("OPENCV_THIN_PRISM", np.concatenate([k[c] for k in PRISMS]).tolist()) for c in range(2)],
    ),
    "tangential alone": (
        {"tangential_coeffs": PRISMS[1], **BENT},
        [("OPENCV", [0.0, 0.0, *PRISMS[1][c].tolist()]) for c in range(2)],
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_camera_models_draw_the_picture_of_their_lens(name):
    change, lens = CASES[name]
    colors, alphas, meta = smalto.rasterization(**scene(), **change)
    expected = pictures(scene(), lens)
    assert colors.shape == (2, SIZE[1], SIZE[0], 3) and alphas.std() > 0.05
    assert np.abs(colors - expected).max() < 1e-6
    plain, _, _ = smalto.rasterization(**scene())
    assert np.abs(colors - plain).max() > 0.02, "it is no pinhole"
    assert meta["n_cameras"] == 2 and "radii" not in meta


def test_ortho_is_the_orthographic_lens():
    arguments = scene() | {"colors": scene()["colors"][:, :1], "sh_degree": 0}
    colors, _, _ = smalto.rasterization(**arguments, camera_model="ortho")
    assert np.abs(colors - pictures(arguments, ["ORTHOGRAPHIC"] * 2)).max() < 1e-6


def camera_of(arguments):
    """The camera of the first view of a call of `rasterization`."""
    names = ("radial_coeffs", "tangential_coeffs", "thin_prism_coeffs")
    coefficients = {name: arguments.get(name) for name in names}
    model, f_theta = arguments.get("camera_model", "pinhole"), arguments.get("ftheta_coeffs")
    lenses = Lenses(model, True, True, coefficients, f_theta, False)
    views = lenses.views(arguments, gsplat_lenses.SIZE, Shutter(None, None))
    return views[0][0][1]


# Of the directions of gsplat_lenses.py, how many only smalto sees and how many only gsplat. gsplat refuses a pinhole
# whose distortion divides the slope by more than 1.25, and a fisheye beyond the corner of the picture; it draws beyond
# the fold of a polynomial.
ONLY_SMALTO = {"pinhole, strong": 96, "fisheye": 121, "fisheye, coefficients": 121}
ONLY_GSPLAT = {"pinhole, rational": 36}


@pytest.mark.parametrize("name", gsplat_lenses.models())
def test_camera_models_are_those_of_gsplat(name):
    arguments = gsplat_lenses.scene() | gsplat_lenses.models()[name]
    with np.load(HERE / "gsplat_lenses.npz") as file:
        gsplat = {part: file[f"{name}: {part}"] for part in ("places", "is_seen", "rays", "is_ray", "colors")}
    camera, ahead = camera_of(arguments), gsplat_lenses.directions()
    places, is_seen = camera.project(ahead)
    # gsplat inverts the polynomials of f-theta by three steps of Newton's method.
    tolerance = 1e-6 if name.startswith("ftheta") else 1e-9
    both = is_seen & gsplat["is_seen"]
    assert np.abs(places - gsplat["places"])[both].max() < tolerance, "px"
    assert np.sum(is_seen & ~gsplat["is_seen"]) == ONLY_SMALTO.get(name, 0)
    assert np.sum(~is_seen & gsplat["is_seen"]) == ONLY_GSPLAT.get(name, 0)
    assert ahead[is_seen, 2].min() > ahead[~is_seen, 2].max(initial=0), "smalto sees up to an angle from the axis"
    _, rays = camera.rays()
    rays = rays[:: gsplat_lenses.ROWS]
    assert gsplat["is_ray"].all() and np.abs(rays - gsplat["rays"]).max() < tolerance
    colors, _, _ = smalto.rasterization(**arguments)
    assert gsplat["colors"].std() > 0.1 and np.abs(colors[0] - gsplat["colors"]).max() < 2e-5


@pytest.mark.parametrize("is_inverse", [False, True])
def test_f_theta_is_its_lens_with_places_from_the_first_centre(is_inverse):
    coeffs, model, focal = f_theta_coeffs(), "FTHETA", 22.0
    numbers = [0.5 / 22, -0.4 / 22, 0.0, 0.0]
    if is_inverse:
        inverse = [0.0, 1 / 22, 1e-4, 0.0, 0.0, 0.0]
        coeffs = f_theta_coeffs(reference_poly=0, pixeldist_to_angle_poly=inverse, angle_to_pixeldist_poly=[0.0] * 6)
        model, numbers = "FTHETA_INVERSE", [1e-4 * 22**2, 0.0, 0.0, 0.0]
    colors, _, _ = smalto.rasterization(**scene(), camera_model="ftheta", ftheta_coeffs=coeffs, **BENT)
    lens = (model, [*numbers, 1.2, 1.01, 0.02, -0.01])
    K = [[focal, 0, 30.5], [0, focal, 20.5], [0, 0, 1]]
    assert np.abs(colors - pictures(scene(), [lens] * 2, K)).max() < 1e-5


def test_batches_have_coefficients_of_their_own():
    one = scene()
    names = ("means", "quats", "scales", "opacities", "colors", "viewmats", "Ks")
    batch = one | {name: np.stack([one[name]] * 2) for name in names}
    change = {"camera_model": "fisheye", **BENT}
    found, _, _ = smalto.rasterization(**batch, **change, radial_coeffs=np.stack([RADIAL, RADIAL[::-1]]))
    for colors, radial_coeffs in zip(found, (RADIAL, RADIAL[::-1])):
        expected, _, _ = smalto.rasterization(**one, **change, radial_coeffs=radial_coeffs)
        assert np.array_equal(colors, expected)


def test_channels_and_backgrounds_are_drawn_through_lenses():
    plain = scene() | {"sh_degree": None, "colors": np.random.RandomState(5).uniform(0, 1, (60, 5)).astype(np.float32)}
    colors, alphas, _ = smalto.rasterization(**plain, camera_model="fisheye")
    assert colors.shape[-1] == 5
    first, _, _ = smalto.rasterization(**(plain | {"colors": plain["colors"][:, 3:]}), camera_model="fisheye")
    assert np.abs(colors[..., 3:] - first).max() < 1e-6
    over, _, _ = smalto.rasterization(**plain, camera_model="fisheye", backgrounds=np.ones((2, 5), np.float32))
    assert np.abs(over - colors - (1 - alphas)).max() < 1e-6


@pytest.mark.parametrize("coefficients", [{}, {"radial_coeffs": np.zeros((2, 6), np.float32)}])
def test_pinholes_are_drawn_along_rays_if_asked_for(coefficients):
    arguments = scene()
    colors, _, meta = smalto.rasterization(**arguments, **BENT, **coefficients)
    gaussians = smalto.Scene.from_arrays(
        *(arguments[name] for name in ("means", "quats", "scales", "opacities", "colors"))
    )
    renderer = smalto.Renderer(gaussians, preset="gsplat", near=0.01, response="ray")
    for c, pose in enumerate(arguments["viewmats"]):
        camera = smalto.Camera(K=arguments["Ks"][c], size=SIZE, viewmat=pose)
        picture = renderer.render(camera, layers=("color", "alpha"))
        assert np.abs(colors[c] - picture.color).max() < 1e-6
    plain, _, _ = smalto.rasterization(**arguments)
    assert np.abs(colors - plain).max() > 0.01 and "radii" not in meta


def rolling(name):
    """A value of gsplat's RollingShutterType, which needs CUDA."""
    return types.SimpleNamespace(name=name)


ROLLING = {
    "ROLLING_TOP_TO_BOTTOM": (0, 1),
    "ROLLING_BOTTOM_TO_TOP": (0, -1),
    "ROLLING_LEFT_TO_RIGHT": (1, 1),
    "ROLLING_RIGHT_TO_LEFT": (1, -1),
}


@pytest.mark.parametrize("name", ROLLING)
def test_each_row_or_column_is_seen_from_its_own_pose(name):
    arguments = scene()
    if name.endswith(("TOP", "LEFT")):
        arguments |= {"camera_model": "fisheye", "radial_coeffs": RADIAL[[0, 0]]}
    angle = np.float32(0.4)
    turn = np.eye(4, dtype=np.float32)
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    turn[:3, 3] = [0.2, -0.1, 0.3]
    last = turn @ arguments["viewmats"]
    axis, sense = ROLLING[name]
    # With an odd count, the middle part has the time 1/2.
    arguments |= {"width": 31, "height": 21, "Ks": arguments["Ks"] * np.float32([[[0.5], [0.5], [1]]])}
    rolled, alphas, _ = smalto.rasterization(**arguments, **BENT, rolling_shutter=rolling(name), viewmats_rs=last)
    assert alphas.std() > 0.05

    def row_of(viewmats, k):
        still, _, _ = smalto.rasterization(**(arguments | {"viewmats": viewmats}), **BENT)
        assert np.abs(np.take(rolled - still, k, axis + 1)).max() < 2e-5
        return np.abs(rolled - still).max()

    count = rolled.shape[axis + 1]
    first_k, last_k = (0, count - 1) if sense > 0 else (count - 1, 0)
    assert row_of(arguments["viewmats"], first_k) > 0.02, "other rows are seen from elsewhere"
    assert row_of(last, last_k) > 0.02
    row_of(np.stack([_middle(*ends) for ends in zip(arguments["viewmats"], last)]), count // 2)


def _middle(first, last):
    """The pose half-way, by the square root of the rotation between both."""
    first, last = first.astype(np.float64), last.astype(np.float64)
    values, vectors = np.linalg.eig(last[:3, :3] @ first[:3, :3].T)
    pose = (first + last) / 2
    pose[:3, :3] = (vectors @ np.diag(np.sqrt(values)) @ np.linalg.inv(vectors)).real @ first[:3, :3]
    return pose.astype(np.float32)


def test_a_shutter_that_rolls_without_motion_draws_the_same_picture():
    arguments = scene() | {"camera_model": "fisheye", **BENT}
    still, _, _ = smalto.rasterization(**arguments)
    both = {"rolling_shutter": rolling("ROLLING_LEFT_TO_RIGHT"), "viewmats_rs": arguments["viewmats"]}
    rolled, _, _ = smalto.rasterization(**arguments, **both)
    assert np.abs(rolled - still).max() < 2e-5


@pytest.mark.parametrize(
    "change, text",
    [
        ({"camera_model": "lidar"}, "camera_model: smalto draws pinhole, ortho, fisheye, ftheta, found lidar"),
        ({"camera_model": "fisheye", "with_ut": True}, "with_ut: .* both True or both False"),
        ({"with_eval3d": True}, "with_eval3d: .* both True or both False"),
        ({"radial_coeffs": PRISMS[0]}, "radial_coeffs: .* so pass with_ut=True, with_eval3d=True"),
        ({"radial_coeffs": RADIAL, **BENT}, r"radial_coeffs: expected the shape \(2, 6\), found \(2, 4\)"),
        ({"radial_coeffs": np.full((2, 6), np.inf), **BENT}, "viewmats, Ks|radial_coeffs|lens: "),
        (
            {"camera_model": "fisheye", "tangential_coeffs": PRISMS[1], **BENT},
            "tangential_coeffs: .* without tangential_coeffs, so pass None",
        ),
        ({"camera_model": "ftheta", **BENT}, "ftheta_coeffs: .* which needs them"),
        ({"camera_model": "fisheye", "ftheta_coeffs": f_theta_coeffs()}, "ftheta_coeffs: "),
        ({"camera_model": "ftheta", "ftheta_coeffs": f_theta_coeffs()}, "ftheta_coeffs: .* so pass with_ut=True"),
        (
            {"camera_model": "ftheta", "ftheta_coeffs": f_theta_coeffs(angle_to_pixeldist_poly=[1.0] * 6), **BENT},
            "ftheta_coeffs: the lens cannot be used: .* is not 0 on the axis",
        ),
        ({"camera_model": "fisheye", "render_mode": "RGB+D"}, "render_mode: .* so pass RGB"),
        ({"camera_model": "fisheye", "radius_clip": 3.0}, "radius_clip: .* so pass 0"),
        ({"camera_model": "fisheye", "far_plane": 2.0}, "far_plane: .* so pass more than 2.0"),
        ({"camera_model": "ortho"}, "sh_degree: .* so pass sh_degree=0"),
        ({"camera_model": "ortho", "sh_degree": 0, "global_z_order": False}, "global_z_order: smalto draws"),
        ({"rolling_shutter": rolling("ROLLING_INWARDS")}, "rolling_shutter: smalto draws GLOBAL, .*found ROLLING_INW"),
        ({"rolling_shutter": rolling("ROLLING_TOP_TO_BOTTOM"), **BENT}, "viewmats_rs: a rolling_shutter .* needs them"),
        ({"viewmats_rs": np.stack([np.eye(4)] * 2)}, "viewmats_rs: .* only that has them"),
        (
            {"viewmats_rs": np.stack([np.eye(4)] * 2), "rolling_shutter": rolling("ROLLING_TOP_TO_BOTTOM")},
            "rolling_shutter: .* so pass with_ut=True",
        ),
    ],
)
def test_what_cannot_be_drawn_is_one_clear_exception(change, text):
    with pytest.raises(ValueError, match=text):
        smalto.rasterization(**(scene() | change))


def test_other_objects_are_no_f_theta_coefficients():
    for wrong in ([1.0], f_theta_coeffs(max_angle="wide"), f_theta_coeffs(linear_cde=[1.0])):
        with pytest.raises(TypeError, match="ftheta_coeffs: expected gsplat's"):
            smalto.rasterization(**scene(), camera_model="ftheta", ftheta_coeffs=wrong, **BENT)
