#!/usr/bin/env python3
"""What itn.render takes beside the renderer's time by the clock: medians over calls of both, in one process.

PYTHONPATH=build/release/python build/python/bin/python tests/bench/python_overhead.py
"""

import pathlib
import statistics
import subprocess
import sys
import time

import itn

EXAMPLES = pathlib.Path(__file__).resolve().parents[2] / "client/examples"


def measure(size, spp, calls):
    scene = itn.load(EXAMPLES / "cube.textproto").resized(size)
    whole, inside = [], []
    for seed in range(calls):
        begun = time.perf_counter()
        done = itn.render(scene, sigma_t=60, albedo=0.8, g=0.3, spp=spp, seed=seed)
        whole.append(time.perf_counter() - begun)
        inside.append(done.seconds)
    beside = statistics.median(a - b for a, b in zip(whole, inside))
    print(
        f"{size} x {size}, {spp} spp: {1e3 * statistics.median(whole):.3f} ms, of which {1e3 * beside:.3f} ms "
        f"({100 * beside / statistics.median(whole):.2g} %) are not the renderer's"
    )


measure(16, 1, 400)
measure(128, 64, 15)
times = []
for _ in range(9):
    begun = time.perf_counter()
    subprocess.run([sys.executable, "-c", "import itn"], check=True)
    both = time.perf_counter() - begun
    begun = time.perf_counter()
    subprocess.run([sys.executable, "-c", "import numpy"], check=True)
    times.append((both, time.perf_counter() - begun))
print(
    "import itn: {:.3f} s with Python's start; import numpy alone: {:.3f} s".format(
        *map(statistics.median, zip(*times))
    )
)
