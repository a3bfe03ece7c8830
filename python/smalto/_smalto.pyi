from collections.abc import Iterable, Iterator, Sequence
from os import PathLike
from typing import Any, Literal, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike, NDArray

Preset = Literal["balanced", "exact", "fast", "preview", "inria", "gsplat", "khr", "portable"]
Layer = Literal["color", "alpha", "depth"]
Kind = Literal["float32", "uint8"] | type[np.float32] | type[np.uint8] | np.dtype[np.float32] | np.dtype[np.uint8]
Size = Sequence[SupportsIndex] | NDArray[np.integer[Any]]

__version__: str
MAX_SH_DEGREE: int

class Error(RuntimeError):
    """An error of smalto."""
class DeviceError(Error):
    """No Vulkan device can be used; the message says what is missing."""
class UnreadableError(ValueError):
    """A file is not a scene or a camera file that can be drawn."""
class OutOfMemoryError(MemoryError):
    """Memory of the host or of the device runs out."""

class Scene:
    """Gaussians, in the memory of the host or in a page file."""
    @staticmethod
    def read(
        path: str | PathLike[str], *, up: str | None = None, flip: str | None = None, sog_level: int | None = None
    ) -> Scene:
        """Reads a scene file of any format that `smalto render` reads, or makes a procedural scene such as
        "cactus:100000". A page file (.smalto) stays on the disk and is drawn page by page. `up` is the axis of the file
        that points up, like "z" or "-y", `flip` names axes to reverse, like "yz", and `sog_level` is the level of a
        streamed SOG, 0 the finest. Errors: UnreadableError, MemoryError, ValueError for an axis or a level that there
        is not. Ctrl-C ends the reading."""
    @staticmethod
    def from_arrays(
        means: ArrayLike,
        quats: ArrayLike,
        scales: ArrayLike,
        opacities: ArrayLike,
        sh: ArrayLike,
        *,
        antialiased: bool = False,
    ) -> Scene:
        """A scene of N Gaussians: means (N, 3) in world units, quats (N, 4) as w, x, y, z of any length but 0, scales
        (N, 3), the standard deviations in world units, opacities (N) from 0 to 1, and sh (N, K, 3), the coefficients of
        spherical harmonics with K = 1, 4, 9, 16 or 25. Values become 32-bit floats. Gaussians with the opacity 0 are
        left out. Errors: ValueError for another shape or a value that cannot be drawn, TypeError for what is not numbers."""
    def write(self, path: str | PathLike[str]) -> None:
        """Writes the scene as .ply, .compressed.ply, .spz, .splat, .sog or .glb, and reads it back before it replaces what
        is there. Errors: ValueError for another ending or a scene in a page file, smalto.Error if it cannot be written."""
    def camera(self, width: SupportsIndex, height: SupportsIndex) -> Camera:
        """The camera of `smalto render` where none is given: it shows the whole scene."""
    @property
    def antialiased(self) -> bool:
        """True if it was trained with the antialiasing of Mip-Splatting, and is drawn so."""
    @property
    def notices(self) -> list[str]:
        """Differences between the scene and its file, a sentence each."""
    @property
    def sh_degree(self) -> int:
        """The highest degree of its spherical harmonics."""
    @property
    def means(self) -> NDArray[np.float32]:
        """The means, (N, 3) in world units: a copy."""
    @property
    def quats(self) -> NDArray[np.float32]:
        """The rotations, (N, 4) as w, x, y, z of length 1: a copy."""
    @property
    def scales(self) -> NDArray[np.float32]:
        """The standard deviations, (N, 3) in world units: a copy."""
    @property
    def opacities(self) -> NDArray[np.float32]:
        """The opacities, (N) from 0 to 1: a copy."""
    @property
    def sh(self) -> NDArray[np.float32]:
        """The coefficients of spherical harmonics, (N, K, 3): a copy."""
    def __len__(self) -> int: ...
    @staticmethod
    def _of_features(means: Any, quats: Any, scales: Any, opacities: Any) -> Scene: ...

class Camera:
    """A camera: where it is, where it looks, its lens, and the pixels of its picture. Axes are those of OpenCV and COLMAP:
    x right, y down, z forward. The pixel in column i and row j is sampled at (i + 0.5, j + 0.5).

    K is the matrix [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels, `size` is (width, height). The pose is either
    `viewmat`, a 4x4 matrix from world to view, or `c2w`, its inverse. Its rotation R may be off by rounding: where an
    entry of R R^T - I is over 1e-6, it becomes the nearest rotation, and over 0.005 it is refused. `near` is the largest
    near plane, in world units, that shows what the camera looks at.

    `lens` is the name of a model of `smalto render --lens` and its parameters, like ("OPENCV_FISHEYE", [k1, k2, k3,
    k4]); the name alone is enough for a model without parameters, and by default the camera is a pinhole. The focal
    lengths of EQUIRECTANGULAR are in pixels per radian, those of ORTHOGRAPHIC in pixels per world unit.

    Cameras can be compared, pickled, and be keys of dictionaries. Errors: ValueError where a matrix has another shape or
    form, the lens is none, or no picture can be drawn."""
    def __init__(
        self,
        *,
        K: ArrayLike,
        size: Size,
        viewmat: ArrayLike | None = None,
        c2w: ArrayLike | None = None,
        near: float | None = None,
        name: str | None = None,
        lens: str | tuple[str, Sequence[float]] | None = None,
    ) -> None: ...
    @staticmethod
    def read(path: str | PathLike[str]) -> list[Camera]:
        """All cameras of a file or folder, with their lenses: cameras.json, transforms.json, the folder of a COLMAP model."""
    def resized(self, size: Size) -> Camera:
        """The same view in a picture of another size (width, height)."""
    def undistorted(self) -> Camera:
        """The pinhole of the same pose and intrinsics. Errors: ValueError for EQUIRECTANGULAR and ORTHOGRAPHIC, which see
        what no pinhole does."""
    def project(self, points: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Where points of the world (N, 3) are seen: pixels (N, 2), x before y, and a mask (N,), in float64. The mask is
        False, and the pixels are NaN, where a point is behind a pinhole or outside the domain of the lens. Pixels may lie
        outside the picture. The centre of the pixel in column i and row j is (i + 0.5, j + 0.5).

        Errors: TypeError and ValueError where `points` are not finite numbers of this shape."""
    def rays(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The rays of the centres of all pixels: origins and directions in world axes, each (height, width, 3) in float64.
        Directions have the length 1, and are NaN where the lens sees nothing. The origin is the position of the camera;
        of ORTHOGRAPHIC it is the point of the ray in the plane through the position."""
    @property
    def near(self) -> float | None:
        """The largest near plane, in world units, that shows what it looks at; None for cameras of files."""
    @property
    def name(self) -> str | None:
        """The name of its photograph, if it has one."""
    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
    @property
    def lens(self) -> tuple[str, list[float]] | None:
        """The name of the model of its lens and the parameters; None for a pinhole."""
    @property
    def K(self) -> NDArray[np.float64]:
        """The 3x3 matrix of the intrinsics, in pixels."""
    @property
    def viewmat(self) -> NDArray[np.float64]:
        """The 4x4 matrix from world to view."""
    @property
    def c2w(self) -> NDArray[np.float64]:
        """The 4x4 matrix from view to world."""
    def __eq__(self, other: object) -> bool: ...
    def __hash__(self) -> int: ...
    @staticmethod
    def _as_given(K: Any, size: Size, viewmat: Any, lens: Any = None) -> Camera: ...
    @staticmethod
    def _f_theta(
        angle_to_px: Sequence[float],
        px_to_angle: Sequence[float],
        is_px_to_angle: bool,
        max_angle: float,
        linear: Sequence[float],
    ) -> tuple[float, tuple[str, list[float]]]: ...

class Picture:
    """A picture: `color`, `alpha`, and what else was asked for. The arrays show its memory without a copy, so they cannot
    be written to; `numpy.copy` makes one that can."""
    @property
    def color(self) -> NDArray[Any]:
        """Red, green and blue as displayed, (height, width, 3) in float32, or in uint8 if it was drawn so; without a
        background, premultiplied by alpha."""
    @property
    def color8(self) -> NDArray[np.uint8]:
        """Red, green and blue in 8 bits, (height, width, 3) in uint8, as in the PNG that `smalto render` writes: a copy."""
    @property
    def alpha(self) -> NDArray[Any]:
        """The coverage of each pixel, (height, width), from 0 to 1 in float32, or to 255 in uint8 if it was drawn so."""
    @property
    def depth(self) -> NDArray[np.float32]:
        """The mean view z of what is blended at each pixel, in world units, (height, width) in float32; NaN where there is
        nothing. Errors: ValueError if the picture was drawn without depth."""
    @property
    def certificate(self) -> NDArray[np.float32] | None:
        """For each channel of each pixel, a bound on what was left out, (height, width, 4) in float32; None if the
        renderer makes no certificates."""
    @property
    def timings(self) -> dict[str, float]:
        """GPU times in milliseconds by the name of the stage; "frame" is the whole frame. Empty for a reference."""
    @property
    def visible(self) -> int | None:
        """The number of Gaussians in view; None for a reference and for a picture of several bands."""
    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
    def save(self, path: str | PathLike[str]) -> None:
        """Writes the picture as .png or .exr, as `smalto render` does. Errors: smalto.Error if it cannot be written."""

class Renderer:
    """Draws pictures of one scene on one device, and keeps what it needs for the next one.

    `preset` and any knob of `smalto render --help` set accuracy and speed, with _ in the place of -, like
    Renderer(scene, preset="fast", sh_degree=1). `device` is the number of a Vulkan device in the list of `smalto
    doctor` or a part of its name; by default SMALTO_DEVICE, or the fastest kind. `memory` is the most device memory to
    take, in bytes: a scene that does not fit is drawn in parts, and the picture is the same. With `certified`, every
    picture has a certificate. Methods may be called from several threads; they draw one after another. Errors:
    ValueError for an unknown preset or knob, DeviceError, MemoryError."""
    def __init__(
        self,
        scene: Scene,
        *,
        preset: Preset = "balanced",
        device: str | int | None = None,
        memory: SupportsIndex | None = None,
        certified: bool = False,
        **knobs: Any,
    ) -> None: ...
    def render(
        self,
        camera: Camera,
        *,
        background: ArrayLike | None = (0.0, 0.0, 0.0),
        layers: Iterable[Layer] | None = None,
        dtype: Kind = "float32",
    ) -> Picture:
        """Draws a picture. `background` is red, green, blue, by default black, or None for a transparent one. `layers`
        names what the picture is to have: color and alpha always, depth takes a second frame. With the `dtype` "uint8",
        color and alpha are rounded to 8 bits on the GPU, which is faster to bring to the host. Errors: ValueError,
        MemoryError, smalto.Error."""
    def render_many(
        self,
        cameras: Iterable[Camera],
        *,
        background: ArrayLike | None = (0.0, 0.0, 0.0),
        layers: Iterable[Layer] | None = None,
        dtype: Kind = "float32",
    ) -> Iterator[Picture]:
        """An iterator over the pictures of many cameras, in their order. The GPU draws the next ones while Python works on
        one. Arguments and errors are those of `render`. An exception of the iterator `cameras` is raised after the
        pictures of the cameras before it."""
    def measure_levels(
        self, camera: Camera, *, background: ArrayLike | None = (0.0, 0.0, 0.0), patches: int = 64
    ) -> tuple[float, float]:
        """The PSNR of the picture of a camera by levels of detail (`splats=`, `lod_error=`, `lod_psnr=` of a page file of
        `smalto lod`) against the picture of all Gaussians, and its standard error, both in dB. It is estimated from
        about `patches` squares of 64x64 pixels, or measured if there are not more that show the scene. (inf, 0.0) if no
        pixel of these differs. Errors: ValueError if the pictures have no levels."""
    def update(self, scene: Scene) -> None:
        """Draws another scene from now on, with the same preset and knobs: the next step of a training, say. The memory of
        the old one is free before the new one is brought to the device."""
    def update_arrays(
        self,
        means: ArrayLike,
        quats: ArrayLike,
        scales: ArrayLike,
        opacities: ArrayLike,
        sh: ArrayLike,
        *,
        antialiased: bool = False,
    ) -> None:
        """Draws the Gaussians of these arrays from now on, as `update(Scene.from_arrays(...))` does. Tensors on the CUDA
        device that draws do not leave it: that takes milliseconds for a million Gaussians. Memory of the device for a
        copy of the arrays is kept for the next update. Errors: those of `Scene.from_arrays`."""
    @property
    def device(self) -> str:
        """The name of the Vulkan device."""
    @property
    def validation_messages(self) -> list[str]:
        """What the validation layer said, if SMALTO_VALIDATION=1 turned it on."""
    @property
    def _arrays(self) -> Any: ...
    def _keep_arrays(self, arrays: Any) -> None: ...
    def _device_arrays(self, count: int, coefficients: int) -> DeviceArrays: ...
    def _take(self, arrays: DeviceArrays, features: bool, antialiased: bool) -> str | None: ...
    def _for_cuda(self) -> tuple[str, bool]: ...
    def _bring(self, features: Any) -> Channels: ...
    def _channels(self, count: int) -> Channels | None: ...
    def _show(self, channels: Channels) -> None: ...
    def _draw_exported(self, views: list[tuple[Camera, Exported]], has_depth: bool) -> list[dict[str, float]]: ...

class SplitRenderer:
    """Draws each picture of one scene on several devices: each draws a band of rows, and the borders follow the times.

    Pictures have the bytes of `Renderer` on a device of the same kind. That pays for scenes that take one device
    several milliseconds; small pictures are drawn faster by one, and sets of pictures by one `Renderer` for each
    device. `devices` is "all", or a list of numbers and parts of names, like [0, 1]. `memory` is the most memory to
    take on each device, in bytes. Other arguments are those of `Renderer`. A device that is lost is left out with a
    warning, and the others draw. Pictures below the scale 1, and those along rays of more than 29 megapixels, are drawn
    by the first device. Errors: ValueError, DeviceError, MemoryError."""
    def __init__(
        self,
        scene: Scene,
        devices: str | int | Iterable[str | int] = "all",
        *,
        preset: Preset = "balanced",
        memory: SupportsIndex | None = None,
        **knobs: Any,
    ) -> None: ...
    def render(
        self,
        camera: Camera,
        *,
        background: ArrayLike | None = (0.0, 0.0, 0.0),
        layers: Iterable[Layer] | None = None,
        dtype: Kind = "float32",
    ) -> Picture:
        """Draws a picture. Arguments and errors are those of `Renderer.render`. The `timings` of the picture are sums over
        all bands."""
    @property
    def bands(self) -> list[dict[str, Any]]:
        """What each device did for the last picture, from top to bottom: dictionaries of `device`, `top` (the first row),
        `rows`, `gpu_ms`, and `ms` until the pixels of the band were in host memory."""
    @property
    def devices(self) -> list[str]:
        """The names of the devices that draw."""
    @property
    def validation_messages(self) -> list[str]:
        """What the validation layer said, if SMALTO_VALIDATION=1 turned it on."""

def compare(
    a: Picture | ArrayLike, b: Picture | ArrayLike, *, camera: Camera | None = None
) -> dict[str, Any]:
    """The difference of two pictures or arrays (height, width, 3), of floats where 1 is white, or of uint8: a dictionary
    with max_error, mse, psnr_db (None if they are equal), ssim, flip and more, as `smalto compare --json` reports them.
    With `camera`, pixels without a ray through its lens do not count. Errors: ValueError if the sizes differ."""
def reference(
    scene: Scene,
    camera: Camera,
    *,
    preset: Preset = "balanced",
    background: ArrayLike | None = (0.0, 0.0, 0.0),
    **knobs: Any,
) -> Picture:
    """The picture of the f64 reference on the CPU, by the rules of the preset and the knobs, exact; of the knobs that
    trade accuracy, `sh_degree` alone counts. Takes seconds to minutes. Arguments are those of `Renderer` and `render`.
    Errors: ValueError, also for scenes in page files."""

# Private.
class Channels:
    """Up to three channels of features of a scene, on the device of its renderer."""
    def handle(self) -> tuple[int, int]:
        """A file descriptor, which the caller owns, and the size in bytes."""

class DeviceArrays:
    """Memory of the device for arrays of Gaussians, which CUDA opens."""
    def handle(self) -> tuple[int, int]:
        """A file descriptor, which the caller owns, and the size in bytes."""
    def parts(self) -> list[tuple[int, int]]:
        """Where the means, quats, scales, opacities and spherical harmonics begin and end, in numbers of 4 bytes."""

class Exported:
    """Memory of the device that holds the pixels of one picture, and opens in CUDA."""
    def handles(self) -> list[tuple[int, int]]:
        """File descriptors and sizes in bytes: of color and alpha, then of the depths. They are there after the first
        picture, and hold until one of another size or with other depths. The caller owns the files."""

def device_for_cuda(device: str | int | None) -> tuple[str, bool]:
    """The UUID of a device, by which CUDA knows it, and whether pictures can stay there for CUDA."""
def main(arguments: list[str]) -> int:
    """Runs the command line program with these arguments, the name of the program first. Returns its exit code."""
