"""CPU seconds of `warp` and of OpenCV's: `python timed_warp.py PICTURE ROUNDS`.

The only file here that imports the product: a user's script, run in a process of its own.
"""

import statistics
import sys
import time
from collections.abc import Callable

import cv2
import numpy as np
from PIL import Image

from resample_texture import warp

picture, rounds = sys.argv[1:]
photo = np.asarray(Image.open(picture).convert("RGB"))
image = cv2.resize(photo, (1000, 1000), interpolation=cv2.INTER_CUBIC)
matrix = np.array([[0.95, 0.06, 10], [-0.05, 0.97, 40], [3e-5, 2e-5, 1]])
jobs: dict[str, Callable[[], object]] = {
    "ours": lambda: warp(image, matrix, (1000, 1000)),
    "peer": lambda: cv2.warpPerspective(image, matrix, (1000, 1000), flags=cv2.INTER_LANCZOS4),
}
took: dict[str, list[float]] = {name: [] for name in jobs}
for _ in range(int(rounds) + 1):
    for name, job in jobs.items():
        start = time.process_time()
        job()
        took[name].append(time.process_time() - start)
sys.stdout.write(" ".join(str(statistics.median(times[1:])) for times in took.values()))
