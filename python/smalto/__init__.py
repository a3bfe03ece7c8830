"""A native renderer of 3D Gaussian splatting scenes on Vulkan.

    import smalto
    scene = smalto.Scene.read("garden.ply")
    camera = scene.camera(1920, 1080)
    smalto.Renderer(scene).render(camera).save("garden.png")
"""

from ._gsplat import rasterization, release
from ._smalto import (
    Camera,
    DeviceError,
    Error,
    OutOfMemoryError,
    Picture,
    Renderer,
    Scene,
    SplitRenderer,
    UnreadableError,
    __version__,
    compare,
    reference,
)
from ._viewers import Server, Window, serve, view

__all__ = [
    "Camera",
    "DeviceError",
    "Error",
    "OutOfMemoryError",
    "Picture",
    "Renderer",
    "Scene",
    "Server",
    "SplitRenderer",
    "UnreadableError",
    "Window",
    "__version__",
    "compare",
    "rasterization",
    "reference",
    "release",
    "serve",
    "view",
]
