"""The rolling shutter of gsplat's `rasterization`: every row or column of a picture is seen from a pose of its own."""

import numpy as np

# The axis of the picture along which each shutter moves, and whether it moves towards the first row or column.
_DIRECTIONS = {
    "ROLLING_TOP_TO_BOTTOM": (1, False),
    "ROLLING_LEFT_TO_RIGHT": (0, False),
    "ROLLING_BOTTOM_TO_TOP": (1, True),
    "ROLLING_RIGHT_TO_LEFT": (0, True),
}


class Shutter:
    """The shutter of a call. Refuses a direction without the second poses, and second poses without a direction."""

    def __init__(self, rolling_shutter, viewmats_rs):
        name = getattr(rolling_shutter, "name", "GLOBAL")
        if name != "GLOBAL" and name not in _DIRECTIONS:
            raise ValueError(f"rolling_shutter: smalto draws {', '.join(['GLOBAL', *_DIRECTIONS])}, found {name}")
        self.rolls = name != "GLOBAL"
        if self.rolls != (viewmats_rs is not None):
            raise ValueError("viewmats_rs: a rolling_shutter other than GLOBAL needs them, and only that has them")
        if self.rolls:
            self.axis, self.is_backwards = _DIRECTIONS[name]

    def parts(self, K, size, first, last):
        """The parts of a picture: where each is (rows, columns), and its K, its size and its pose. `first` and `last`
        are the poses (4, 4) of the first and the last part in time; `last` is None for a shutter that does not roll.

        As in gsplat, part k of n has the time k / (n - 1), or 1/2 if it is the only one; the translations of the poses
        are interpolated linearly, their rotations on the sphere of unit quaternions.
        """
        if not self.rolls:
            return [((slice(None), slice(None)), K, size, first)]
        found, count = [], size[self.axis]
        for k in range(count):
            time = 0.5 if count == 1 else (count - 1 - k if self.is_backwards else k) / (count - 1)
            part, one, where = np.array(K, np.float64), list(size), [slice(None), slice(None)]
            part[self.axis, 2] -= k
            one[self.axis] = 1
            where[1 - self.axis] = slice(k, k + 1)
            found.append((tuple(where), part, tuple(one), _between(first, last, time)))
        return found


def _between(first, last, time):
    """The pose at a time from 0 to 1."""
    first, last = (np.asarray(pose, np.float64) for pose in (first, last))
    a, b = (_quaternion(pose[:3, :3]) for pose in (first, last))
    if a @ b < 0:
        b = -b
    angle = np.arccos(min(a @ b, 1.0))
    if angle > 1e-6:
        a, b = np.sin((1 - time) * angle) * a, np.sin(time * angle) * b
    else:
        a, b = (1 - time) * a, time * b
    pose = (1 - time) * first + time * last
    pose[:3, :3] = _rotation(a + b)
    return pose


def _quaternion(m):
    """The unit quaternion (w, x, y, z) of a rotation: an eigenvector of the largest eigenvalue (Bar-Itzhack, 2000)."""
    skew = [m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]]
    trace = np.trace(m)
    k = np.empty((4, 4))
    k[0, 0], k[0, 1:], k[1:, 0] = trace, skew, skew
    k[1:, 1:] = m + m.T - trace * np.eye(3)
    return np.linalg.eigh(k)[1][:, -1]


def _rotation(q):
    """The rotation (3, 3) of a quaternion (w, x, y, z) of any length."""
    w, x, y, z = q / np.linalg.norm(q)
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])
