"""Pictures that PyTorch reads on the device that drew them, and Gaussians that it writes there: memory of Vulkan, opened
in CUDA."""

import ctypes
import os
import sys
import threading

from ._smalto import MAX_SH_DEGREE, Error, Exported

_OPAQUE_FD = 1
_DEDICATED = 1

_lock = threading.Lock()
# The constant basis function of spherical harmonics.
_BASIS_0 = 0.28209479177387814
_COEFFICIENTS = [(degree + 1) ** 2 for degree in range(MAX_SH_DEGREE + 1)]


class _Handle(ctypes.Structure):
    """CUDA_EXTERNAL_MEMORY_HANDLE_DESC of cuda.h, of which a file is the first member of a union of two pointers."""

    _fields_ = [
        ("type", ctypes.c_int),
        ("file", ctypes.c_int64),
        ("unused", ctypes.c_void_p),
        ("size", ctypes.c_uint64),
        ("flags", ctypes.c_uint),
        ("reserved", ctypes.c_uint * 16),
    ]


class _Range(ctypes.Structure):
    """CUDA_EXTERNAL_MEMORY_BUFFER_DESC of cuda.h."""

    _fields_ = [
        ("offset", ctypes.c_uint64),
        ("size", ctypes.c_uint64),
        ("flags", ctypes.c_uint),
        ("reserved", ctypes.c_uint * 16),
    ]


class _Mapped:
    """Memory of the device, as PyTorch reads it. CUDA keeps it until this is dropped."""

    def __init__(self, cuda, file, size, shape):
        self._cuda, self._memory, pointer = cuda, ctypes.c_void_p(), ctypes.c_uint64()
        handle = _Handle(type=_OPAQUE_FD, file=file, size=size, flags=_DEDICATED)
        try:
            _check(cuda, cuda.cuImportExternalMemory(ctypes.byref(self._memory), ctypes.byref(handle)))
        except Error:
            os.close(file)
            raise
        whole = _Range(offset=0, size=size)
        _check(cuda, cuda.cuExternalMemoryGetMappedBuffer(ctypes.byref(pointer), self._memory, ctypes.byref(whole)))
        self._pointer = pointer
        # PyTorch takes no memory that is marked as read-only.
        self.__cuda_array_interface__ = {"version": 3, "shape": shape, "typestr": "<f4", "data": (pointer.value, False)}

    def __del__(self):
        if self._memory:
            if getattr(self, "_pointer", None):
                self._cuda.cuMemFree_v2(self._pointer)
            self._cuda.cuDestroyExternalMemory(self._memory)


class Arrays:
    """Memory for the arrays of Gaussians of one number and SH degree: `parts` are its means, quats, scales, opacities and
    spherical harmonics, as PyTorch writes them."""

    def __init__(self, torch, device, renderer, shapes):
        self.key = (device, shapes)
        self.memory = renderer._device_arrays(shapes[0][0], shapes[4][1])
        bounds = self.memory.parts()
        # Tensors of inference mode could not be written outside of it.
        with torch.cuda.device(device), torch.inference_mode(False):
            mapped = _Mapped(ctypes.CDLL("libcuda.so.1"), *self.memory.handle(), (bounds[-1][1],))
            words = torch.as_tensor(mapped, device=device)
            self.parts = [words[start:stop].view(shape) for (start, stop), shape in zip(bounds, shapes)]


def update(renderer, arrays, antialiased, has_features=False):
    """Draws the Gaussians of these arrays from now on, if they are tensors on the device that draws. Returns copies there,
    which hold until the next update, or None if the host has to read the arrays: then it judges them."""
    torch, shapes = sys.modules.get("torch"), tuple(tuple(getattr(values, "shape", ())) for values in arrays)
    if torch is None or not all(isinstance(values, torch.Tensor) and values.is_cuda for values in arrays):
        return None
    count, coefficients = shapes[3][0] if shapes[3] else 0, shapes[4][1] if len(shapes[4]) == 3 else 0
    wanted = ((count, 3), (count, 4), (count, 3), (count,), (count, coefficients, 3))
    device = arrays[0].device
    if (
        not count
        or shapes != wanted
        or coefficients not in _COEFFICIENTS
        or any(values.device != device or not _is_number(values) for values in arrays)
        or not is_same_device(torch, device, renderer._for_cuda())
    ):
        return None
    with _lock:
        kept = renderer._arrays
        if kept is None or kept.key != (device, shapes):
            # The old memory is free before the new is taken.
            kept = None
            renderer._keep_arrays(None)
            try:
                kept = Arrays(torch, device, renderer, shapes)
            except (Error, MemoryError):
                return None
        for part, values in zip(kept.parts, arrays):
            part.copy_(values.detach())
        torch.cuda.current_stream(device).synchronize()
        # An interrupted call still reads the memory in the background: then it is not used again.
        renderer._keep_arrays(None)
        if renderer._take(kept.memory, has_features, antialiased) is not None:
            return None
        renderer._keep_arrays(kept)
        return kept.parts


class Plane:
    """Memory for up to three features of each Gaussian of a scene."""

    def __init__(self, torch, device, channels, count):
        self.channels, self.key = channels, (device, count)
        with torch.cuda.device(device), torch.inference_mode(False):
            mapped = _Mapped(ctypes.CDLL("libcuda.so.1"), *channels.handle(), (count, 4))
            self.values = torch.as_tensor(mapped, device=device)


def bring(renderer, features, plane):
    """The plane with these features, (N, D) with D up to 3, if they are a tensor on the device that draws and each row is
    a Gaussian, else None. A `plane` of this scene is used again."""
    torch = sys.modules.get("torch")
    if torch is None or not isinstance(features, torch.Tensor) or not features.is_cuda or not _is_number(features):
        return None
    device, (count, channels), features = features.device, features.shape, features.float()
    if not is_same_device(torch, device, renderer._for_cuda()) or not bool(features.isfinite().all()):
        return None
    if plane is None or plane.key != (device, count):
        memory = renderer._channels(count)
        if memory is None:
            return None
        plane = Plane(torch, device, memory, count)
    with torch.no_grad():
        plane.values.zero_()
        plane.values[:, :channels] = features.double() / _BASIS_0
    torch.cuda.current_stream(device).synchronize()
    return plane


class Frame:
    """Memory for one picture, and for its depths."""

    def __init__(self, torch, device, shape):
        self.exported = Exported()
        self._torch, self._device, self._shape, self._planes = torch, device, shape, None

    def planes(self):
        """Color and alpha (height, width, 4), and the depths. They are there after the first picture."""
        if self._planes is None:
            cuda = ctypes.CDLL("libcuda.so.1")
            with self._torch.cuda.device(self._device):
                handles = self.exported.handles()
                mapped = []
                while handles:
                    try:
                        mapped.append(_Mapped(cuda, *handles.pop(0), self._shape))
                    except Error:
                        for file, _ in handles:
                            os.close(file)
                        raise
                self._planes = [self._torch.as_tensor(plane, device=self._device) for plane in mapped]
        return self._planes


class Frames:
    """Memory for some pictures of one size. CUDA and Vulkan take turns on the device, and a turn costs more than a copy,
    so several pictures are drawn in one."""

    MOST = 4

    def __init__(self, torch, device, size, has_depth):
        self._torch, self._device, self._has_depth = torch, device, has_depth
        self._shape, self._frames = (size[1], size[0], 4), []

    def draw(self, renderer, cameras):
        """For each camera, the planes of its picture, which hold until the next few, and its GPU times."""
        for start in range(0, len(cameras), self.MOST):
            some = cameras[start : start + self.MOST]
            while len(self._frames) < len(some):
                self._frames.append(Frame(self._torch, self._device, self._shape))
            # What PyTorch still reads, in any stream, must not be drawn over.
            self._torch.cuda.synchronize(self._device)
            views = [(camera, frame.exported) for camera, frame in zip(some, self._frames)]
            try:
                drawn = renderer._draw_exported(views, self._has_depth)
            except BaseException:
                # Memory of a picture that was not finished is gone, though PyTorch would still show it.
                self._frames = []
                raise
            for frame, timings in zip(self._frames, drawn):
                yield frame.planes(), timings


def is_same_device(torch, device, vulkan):
    """True if the device of PyTorch is that of Vulkan, and can open its memory: `vulkan` is the UUID, and whether it has
    such memory."""
    uuid, exports = vulkan
    # Earlier versions of PyTorch do not tell the UUID.
    return exports and str(getattr(torch.cuda.get_device_properties(device), "uuid", "")) == uuid


def _is_number(values):
    return not values.is_complex() and values.dtype != sys.modules["torch"].bool


def _check(cuda, code):
    if code != 0:
        text = ctypes.c_char_p()
        cuda.cuGetErrorString(code, ctypes.byref(text))
        raise Error(f"CUDA cannot open memory of Vulkan: {(text.value or b'?').decode()}")
