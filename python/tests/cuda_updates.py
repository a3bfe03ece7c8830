"""Times updates of a scene from CUDA tensors, on the device and through the host, and compares their pictures.

    python cuda_updates.py [COUNT]
"""

import hashlib
import sys
import time

import numpy as np
import smalto
import torch


def steps(count, number):
    """Tensors of `number` steps of a training: each changes all values a little."""
    generator = torch.Generator("cuda").manual_seed(0)
    normal = lambda *shape: torch.randn(*shape, generator=generator, device="cuda")  # noqa: E731
    means, quats, logs = normal(count, 3), normal(count, 4), 0.5 * normal(count, 3) - 5.5
    logits, sh = 2 * normal(count), torch.cat([normal(count, 1, 3), 0.05 * normal(count, 15, 3)], dim=1)
    for step in range(number):
        shift = 1e-3 * step
        yield [means + shift, quats + shift, (logs + shift).exp(), (logits - shift).sigmoid(), sh - shift]


def camera():
    viewmat = np.eye(4)
    viewmat[2, 3] = 6
    return smalto.Camera(K=[[1200, 0, 960], [0, 1200, 540], [0, 0, 1]], size=(1920, 1080), viewmat=viewmat)


def timed(call):
    torch.cuda.synchronize()
    begin = time.perf_counter()
    result = call()
    torch.cuda.synchronize()
    return 1e3 * (time.perf_counter() - begin), result


def digest(picture):
    return hashlib.sha256(np.ascontiguousarray(picture).tobytes()).hexdigest()[:12]


def row(name, times):
    first, rest = times[0], sorted(times[1:])
    print(f"{name:<52} {first:>9.2f} {rest[len(rest) // 2]:>9.2f} {rest[0]:>9.2f} {rest[-1]:>9.2f}", flush=True)


def parts_of_update(renderer, tensors):
    """The copy, and the packing with the wait for it."""
    kept = renderer._arrays

    def copy():
        for part, values in zip(kept.parts, tensors):
            part.copy_(values)

    return timed(copy)[0], timed(lambda: renderer._take(kept.memory, False, False))[0]


def updates(count, preset):
    tensors = list(steps(count, 12))
    renderer = smalto.Renderer(smalto.Scene.from_arrays(*tensors[0]), preset=preset)
    renderer.render(camera())
    on_host = []
    for values in tensors[:4]:
        on_host.append(timed(lambda: renderer.update(smalto.Scene.from_arrays(*values)))[0])
    row(f"{preset}: update(Scene.from_arrays())", on_host)
    expected = [smalto.Renderer(smalto.Scene.from_arrays(*values), preset=preset).render(camera()) for values in tensors[:3]]
    on_device, copies, packs = [], [], []
    for values in tensors:
        on_device.append(timed(lambda: renderer.update_arrays(*values))[0])
    assert renderer._arrays is not None, "the device packed the arrays"
    row(f"{preset}: update_arrays()", on_device)
    for values in tensors:
        copy, pack = parts_of_update(renderer, values)
        copies.append(copy)
        packs.append(pack)
    row(f"{preset}:   copy", copies)
    row(f"{preset}:   examine and pack", packs)
    loop = [timed(lambda: (renderer.update_arrays(*values), renderer.render(camera())))[0] for values in tensors]
    row(f"{preset}: update_arrays() and render()", loop)
    alone = [timed(lambda: renderer.render(camera()))[0] for _ in tensors]
    row(f"{preset}: render() alone", alone)
    for values, host in zip(tensors, expected):
        renderer.update_arrays(*values)
        drawn = renderer.render(camera())
        psnr = smalto.compare(drawn, host)["psnr_db"]
        same = "equal" if np.array_equal(drawn.color, host.color) else "different"
        print(f"  {preset}: {digest(drawn.color)} {digest(host.color)} {same}, PSNR {psnr} dB", flush=True)


def rasterized(count, sh_degree):
    K = torch.tensor([[[1200.0, 0, 960], [0, 1200, 540], [0, 0, 1]]], device="cuda")
    viewmat = torch.eye(4, device="cuda")[None]
    viewmat[0, 2, 3] = 6
    tensors = list(steps(count, 8))
    if sh_degree is None:
        for values in tensors:
            values[4] = values[4][:, 0].abs()

    def draw(values):
        return smalto.rasterization(*values, viewmat, K, 1920, 1080, sh_degree=sh_degree)[0]

    with torch.no_grad():
        changed = [timed(lambda: draw(values))[0] for values in tensors]
        row(f"rasterization(sh_degree={sh_degree}), changed tensors", changed)
        row(f"rasterization(sh_degree={sh_degree}), equal tensors", [timed(lambda: draw(tensors[-1]))[0] for _ in tensors])
        found = draw(tensors[-1]).cpu()
        smalto.release()
        expected = draw(tensors[-1]).cpu()
        same = "equal" if torch.equal(found, expected) else "different"
        print(f"  {digest(found.numpy())} {digest(expected.numpy())} {same}", flush=True)
        smalto.release()


count = int(sys.argv[1]) if len(sys.argv) > 1 else 1_800_000
print(f"{torch.cuda.get_device_name()}, {count} Gaussians of degree 3, 1920x1080; ms")
print(f"{'':<52} {'first':>9} {'median':>9} {'least':>9} {'most':>9}")
for preset in ("gsplat", "balanced"):
    updates(count, preset)
for sh_degree in (3, None):
    rasterized(count, sh_degree)
