"""How near a trained scene is to photographs that it was not trained on: PSNR and SSIM, as gsplat's trainer evaluates.

    python evaluate.py SCENE CAMERAS PHOTOGRAPHS --with smalto

needs PyTorch, torchmetrics and Pillow, and with `--with gsplat` gsplat and a CUDA device. CAMERAS is any camera file that
smalto reads, PHOTOGRAPHS a folder with a picture for each camera that is judged, by the camera's name; they set the size.
The loop is that of examples/simple_trainer.py of gsplat 1.5.3, and does not know which of the two draws.
"""

import argparse
import pathlib
import time

import numpy as np
import smalto
import torch
from PIL import Image
from torchmetrics.image import PeakSignalNoiseRatio, StructuralSimilarityIndexMeasure


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", metavar="SCENE")
    parser.add_argument("cameras", metavar="CAMERAS")
    parser.add_argument("photographs", metavar="PHOTOGRAPHS", type=pathlib.Path)
    parser.add_argument("--with", dest="renderer", choices=["smalto", "gsplat"], default="smalto")
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu", help="the device of PyTorch")
    parser.add_argument("--repeat", type=int, default=1, help="how often each view is drawn: the last time counts")
    args = parser.parse_args()
    if args.renderer == "gsplat":
        from gsplat import rasterization
    else:
        from smalto import rasterization

    scene = smalto.Scene.read(args.scene)
    names = ("means", "quats", "scales", "opacities", "sh")
    means, quats, scales, opacities, sh = (torch.tensor(getattr(scene, name), device=args.device) for name in names)
    cameras = {camera.name: camera for camera in smalto.Camera.read(args.cameras)}
    psnr = PeakSignalNoiseRatio(data_range=1.0).to(args.device)
    ssim = StructuralSimilarityIndexMeasure(data_range=1.0).to(args.device)
    times, copied, values = [], [], []
    for path in sorted(args.photographs.iterdir()):
        if path.stem not in cameras:
            continue
        photograph = torch.tensor(np.asarray(Image.open(path).convert("RGB")), device=args.device)[None] / 255
        height, width = photograph.shape[1:3]
        camera = cameras[path.stem].resized((width, height))
        viewmats, Ks = (torch.tensor(m, dtype=torch.float32, device=args.device)[None] for m in (camera.viewmat, camera.K))
        for _ in range(args.repeat):
            started = now(args.device)
            with torch.no_grad():
                colors, _, _ = rasterization(
                    means, quats, scales, opacities, sh, viewmats, Ks, width, height, sh_degree=scene.sh_degree,
                    rasterize_mode="antialiased" if scene.antialiased else "classic",
                )
            drawn = now(args.device)
            colors.cpu()
            on_host = now(args.device)
        times.append(1e3 * (drawn - started))
        copied.append(1e3 * (on_host - started))
        found, expected = (pixels.clamp(0, 1).permute(0, 3, 1, 2) for pixels in (colors, photograph))
        values.append((psnr(found, expected).item(), ssim(found, expected).item()))
    if not values:
        parser.error(f"{args.photographs}: no picture has the name of a camera")
    mean_psnr, mean_ssim = np.mean(values, axis=0)
    print(
        f"{args.renderer}: {len(values)} views, PSNR {mean_psnr:.4f} dB, SSIM {mean_ssim:.5f}; "
        f"median {np.median(times):.2f} ms a view on {args.device}, {np.median(copied):.2f} ms with the copy to the host"
    )


def now(device):
    if device.startswith("cuda"):
        torch.cuda.synchronize()
    return time.perf_counter()


if __name__ == "__main__":
    main()
