"""Resample scattered measurements to a grid, with the exact area that they cover.

A line of 96 sensors sweeps over a field; each reading covers its own parallelogram, and some
readings are missing. `python examples/scattered.py picture.png` draws the measured field and its
coverage.
"""

import sys
from pathlib import Path

import numpy as np

from resample import Scatter
from resample.files.saving import write_png

HEIGHT, WIDTH = 120, 200  # px


def field(x, y):
    """Values of the field, 0 to 1, at positions in px."""
    return 0.5 + 0.5 * np.sin(x / 17) * np.cos(y / 11)


def measurements():
    """Positions (N, 2), readings (N,) and Jacobians (N, 2, 2) of sensors on a swinging line."""
    rng = np.random.default_rng(14)
    time, sensor = np.meshgrid(np.arange(230.0), np.arange(96.0))
    angle = 0.3 * np.sin(time / 40)  # rad, of the line; it advances 0.8 px per step
    along, ahead = sensor * (0.5 + 0.006 * sensor) - 45, 5 + 0.8 * time
    x, y = ahead + along * np.sin(angle), 55 + along * np.cos(angle)
    # Columns: from one reading to the next in time, and from one sensor to the next.
    by_time = np.gradient(x, axis=1), np.gradient(y, axis=1)
    by_sensor = np.gradient(x, axis=0), np.gradient(y, axis=0)
    jacobian = np.stack([np.stack([a.ravel() for a in c], -1) for c in (by_time, by_sensor)], -1)
    reading = field(x, y).ravel()
    reading[rng.uniform(size=reading.size) < 0.02] = np.nan
    return np.stack([x.ravel(), y.ravel()], axis=-1), reading, jacobian


def gridded():
    """The field on a grid, and the covered area in each pixel, px²."""
    position, reading, jacobian = measurements()
    return Scatter()(position, reading, jacobian=jacobian, shape=(HEIGHT, WIDTH))


def main(path: Path) -> None:
    """Write the field and, below it, the coverage, in shades of gray."""
    value, coverage = gridded()
    value = np.nan_to_num(value) * (coverage > 0)
    gray = np.concatenate([value, np.minimum(coverage, 2) / 2]).astype(np.float32)
    write_png(path, np.stack([gray, gray, gray, np.ones_like(gray)], axis=-1))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
