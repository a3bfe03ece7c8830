"""Draws all cameras of a scene with Ray, one shard per task: python ray_shards.py SCENE CAMERAS FOLDER SHARDS [GPUS]"""

import subprocess
import sys

import ray

scene, cameras, folder, shards = *sys.argv[1:4], int(sys.argv[4])
gpus = float(sys.argv[5]) if len(sys.argv) > 5 else 1  # of each task; 0 for a software device


@ray.remote(num_gpus=gpus, max_retries=3, retry_exceptions=True)
def draw(shard: int) -> None:
    line = ["smalto", "render", scene, "--cameras", cameras, "--camera", "all", "-o", folder + "/"]
    subprocess.run([*line, "--shard", f"{shard}/{shards}", "--resume"], check=True)


ray.init()
ray.get([draw.remote(shard) for shard in range(1, shards + 1)])
