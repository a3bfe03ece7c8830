"""The camera models of gsplat's `rasterization`, as lenses of smalto."""

import numpy as np

from ._smalto import Camera

# What each model takes, and the count of the coefficients.
_COEFFICIENTS = {
    "pinhole": {"radial_coeffs": 6, "tangential_coeffs": 2, "thin_prism_coeffs": 4},
    "ortho": {},
    "fisheye": {"radial_coeffs": 4},
    "ftheta": {},
}
# The lens that has these coefficients in this order.
_MODELS = {"pinhole": "OPENCV_THIN_PRISM", "ortho": "ORTHOGRAPHIC", "fisheye": "OPENCV_FISHEYE"}
# gsplat counts the places of an f-theta picture from the centre of its first pixel.
_F_THETA_ORIGIN = 0.5


class Lenses:
    """The camera model of a call with its arguments, which are refused where smalto cannot draw them."""

    def __init__(self, model, with_ut, with_eval3d, coefficients, ftheta_coeffs, rolls):
        if model not in _COEFFICIENTS:
            raise ValueError(f"camera_model: smalto draws {', '.join(_COEFFICIENTS)}, found {model}")
        self.model, self.sizes = model, _COEFFICIENTS[model]
        given = [name for name, values in coefficients.items() if values is not None]
        for name in given:
            if name not in self.sizes:
                raise ValueError(f"{name}: smalto draws camera_model {model} without {name}, so pass None")
        if (ftheta_coeffs is not None) != (model == "ftheta"):
            raise ValueError("ftheta_coeffs: smalto draws them with camera_model ftheta, which needs them")
        if bool(with_ut) != bool(with_eval3d):
            name = "with_ut" if with_ut else "with_eval3d"
            raise ValueError(
                f"{name}: smalto draws lenses along rays and has no unscented transform alone, so pass with_ut and "
                "with_eval3d both True or both False"
            )
        if model == "ftheta":
            given.append("ftheta_coeffs")
        if given and not with_ut:
            raise ValueError(f"{given[0]}: smalto draws distortion along rays, so pass with_ut=True, with_eval3d=True")
        if rolls and not with_ut:
            raise ValueError("rolling_shutter: smalto draws it along rays, so pass with_ut=True, with_eval3d=True")
        self.is_pinhole = model == "pinhole" and not with_ut
        self.has_order_of_z = self.is_pinhole or model == "ortho"
        self.f_theta = None if ftheta_coeffs is None else _f_theta(ftheta_coeffs)

    def views(self, scene, size, shutter):
        """The parts of the picture of each view of a scene, whose arrays are on the host: where each part is in the
        picture (rows, columns), and its camera."""
        found = []
        for c, (K, pose) in enumerate(zip(scene["Ks"], scene["viewmats"])):
            lens = None
            if self.f_theta is not None:
                focal, lens = self.f_theta
                x, y = (float(K[axis, 2]) + _F_THETA_ORIGIN for axis in (0, 1))
                K = np.array([[focal, 0, x], [0, focal, y], [0, 0, 1]])
            elif not self.is_pinhole:
                numbers = [scene[name][c].tolist() if name in scene else [0.0] * n for name, n in self.sizes.items()]
                lens = (_MODELS[self.model], sum(numbers, []))
            last = scene["viewmats_rs"][c] if shutter.rolls else None
            parts = shutter.parts(K, size, pose, last)
            found.append([(where, Camera._as_given(*camera, lens)) for where, *camera in parts])
        return found


def _f_theta(given):
    """The focal length and the lens of gsplat's `FThetaCameraDistortionParameters`, or of what has its attributes."""
    try:
        reference = given.reference_poly
        # FThetaPolynomialType: PIXELDIST_TO_ANGLE is 0, ANGLE_TO_PIXELDIST is 1.
        is_px_to_angle = int(getattr(reference, "value", reference)) == 0
        angle_to_px = _floats(given.angle_to_pixeldist_poly, 6)
        px_to_angle = _floats(given.pixeldist_to_angle_poly, 6)
        max_angle, linear = float(given.max_angle), _floats(given.linear_cde, 3)
    except (AttributeError, TypeError, ValueError) as error:
        raise TypeError(f"ftheta_coeffs: expected gsplat's FThetaCameraDistortionParameters: {error}") from None
    return Camera._f_theta(angle_to_px, px_to_angle, is_px_to_angle, max_angle, linear)


def _floats(values, count):
    found = [float(value) for value in values]
    if len(found) != count:
        raise ValueError(f"a list has {len(found)} numbers in the place of {count}")
    return found
