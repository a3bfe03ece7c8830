"""Pictures that PyTorch reads on the device that drew them: memory of Vulkan, opened in CUDA."""

import ctypes
import os

from ._smalto import Error, Exported, device_for_cuda

_OPAQUE_FD = 1
_DEDICATED = 1


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
    """True if the device of PyTorch is that of Vulkan with this name, and can open its memory."""
    uuid, exports = device_for_cuda(vulkan)
    # Earlier versions of PyTorch do not tell the UUID.
    return exports and str(getattr(torch.cuda.get_device_properties(device), "uuid", "")) == uuid


def _check(cuda, code):
    if code != 0:
        text = ctypes.c_char_p()
        cuda.cuGetErrorString(code, ctypes.byref(text))
        raise Error(f"CUDA cannot open the memory of a picture: {(text.value or b'?').decode()}")
