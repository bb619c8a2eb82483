"""Transfer functions by name: presets, matplotlib's colormaps, and one made from the data."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from resample_volume.looks.regions import Region, RegionTransfer
from resample_volume.looks.transfer import SUFFIXES, Transfer, TransferFunction, from_points
from resample_volume.types import Volume
from resample_volume.voxels.visible import finite_range

BLACK, WHITE, RED = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (0.85, 0.12, 0.08)
BLUE, SAND = (0.15, 0.25, 0.55), (0.95, 0.85, 0.6)
CLAY, GLASS, AMBER = (0.7, 0.5, 0.35), (0.55, 0.65, 0.75), (1.0, 0.6, 0.2)

# What `auto` means for volumes that are made to be looked at in one way.
GENERATED_VOLUMES = {
    "checker-box": "checker",
    "vessel-tree": "vessels",
    "marschner-lobb": "viridis:opacity=0.9,low=0.5",
}

PRESETS: dict[str, Callable[[], Transfer]] = {
    # CT of a head: soft tissue lies near a quarter of the range, bone from two fifths on.
    "bone": partial(
        from_points,
        [
            (0.32, (0.55, 0.25, 0.15), 0.0),
            (0.4, (0.85, 0.65, 0.45), 0.25),
            (0.5, (0.95, 0.88, 0.75), 0.7),
            (1.0, WHITE, 0.95),
        ],
        normalized=True,
    ),
    # Angiography: brighter and denser toward the axis of a vessel.
    "vessels": partial(
        from_points,
        [
            (0.08, (0.45, 0.02, 0.02), 0.0),
            (0.2, (0.8, 0.15, 0.1), 0.3),
            (0.5, (0.95, 0.4, 0.3), 0.7),
            (1.0, (1.0, 0.9, 0.75), 0.9),
        ],
        normalized=True,
    ),
    # The block as glass around its denser parts.
    "engine": partial(
        from_points,
        [(70, GLASS, 0.0), (130, GLASS, 0.04), (175, GLASS, 0.04), (195, AMBER, 0.7)],
    ),
    # A translucent shell around white meat, as in the paper's Figure 8f; the resin ends at 30.
    "lobster": partial(
        from_points,
        [(30, RED, 0.0), (45, RED, 0.05), (95, RED, 0.12), (115, WHITE, 0.4), (150, WHITE, 0.8)],
    ),
    "checker": partial(from_points, [(64, BLUE, 1.0), (128, BLUE, 1.0), (128, SAND, 1.0)]),
    "gray": partial(from_points, [(0.0, BLACK, 0.0), (1.0, WHITE, 1.0)], normalized=True),
    # Boundaries of what is thin, middling and dense, in data of any kind.
    "surfaces": partial(
        RegionTransfer,
        (
            Region((0.05, 0.4), BLUE, 0.06, (0.2, 1.0), (0.03, 0.2)),
            Region((0.3, 0.7), SAND, 0.5, (0.25, 1.0), (0.05, 0.25)),
            Region((0.6, 1.0), AMBER, 0.7, (0.1, 1.0), (0.05, 0.2)),
        ),
        normalized=True,
    ),
    # The paper's Figure 9: 1,160,038, 114,695 and 190,815 voxels are not transparent.
    "paper-engine": partial(from_points, [(71, WHITE, 0.0), (71, WHITE, 0.3)]),
    "paper-aneurism": partial(from_points, [(25, WHITE, 0.0), (25, WHITE, 0.3)]),
    "paper-lobster": partial(
        from_points,
        [
            (65, RED, 0.0),
            (65, RED, 0.1),
            (95, RED, 0.1),
            (115, WHITE, 0.3),
            (222, WHITE, 0.3),
            (222, WHITE, 0.0),
        ],
    ),
}


def automatic(volume: Volume) -> TransferFunction:
    """Transfer function for data of which nothing is known.

    What is below Otsu's threshold (1979), the value that splits the histogram into the two most
    even classes, is transparent; from there on opacity rises quickly to a half per voxel.
    """
    import cv2

    low, high = finite_range(volume.values)
    if not low < high:
        return from_points([(0.0, SAND, 0.5)])
    step = max(1, int(np.cbrt(volume.values.size / 2e6)))
    some = np.asarray(volume.values[::step, ::step, ::step], np.float64)
    code = np.round((some[np.isfinite(some)] - low) * (255 / (high - low))).astype(np.uint8)
    threshold, _ = cv2.threshold(code, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    start = (threshold + 1) / 256
    middle = start + 0.2 * (1 - start)
    return from_points(
        [(start, CLAY, 0.0), (middle, SAND, 0.5), (1.0, WHITE, 0.8)], normalized=True
    )


def transfer_for(name: str, volume: Volume) -> Transfer:
    """Transfer function by name or from a file, or `auto`, which looks at the volume."""
    if name != "auto":
        return load_transfer(name)
    own = GENERATED_VOLUMES.get(volume.name)
    return load_transfer(own) if own else automatic(volume)


def load_transfer(name: str | Path) -> Transfer:
    """Transfer function by name or from a file.

    Parameters
    ----------
    name
        One of `PRESETS`; else a matplotlib colormap, over the range of the data and with an
        opacity that rises from 0 to 1; or a file ending in .json or .toml. After a name
        `:opacity=0.2,low=0.3` multiplies all opacities (0..1) and makes transparent what is below
        a value (for colormaps 0..1 of the data's range).

    Raises
    ------
    ValueError
        The name or a parameter is unknown, or the file's content is not what it should be.
    OSError
        The file cannot be read.
    """
    if Path(name).suffix.lower() in SUFFIXES:
        from resample_volume.looks.files import read_transfer

        return read_transfer(Path(name))
    base, _, text = str(name).partition(":")
    transfer = PRESETS[base]() if base in PRESETS else _colormap(base)
    try:
        for key, number in _parameters(text).items():
            transfer = ADJUSTMENTS[key](transfer, number)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None
    return transfer


def _colormap(name: str) -> TransferFunction:
    import matplotlib

    if name not in matplotlib.colormaps:
        raise ValueError(
            f"unknown transfer function {name!r}; known: {', '.join(PRESETS)}; the name of a "
            "matplotlib colormap or a .json or .toml file will also do"
        )
    position = np.linspace(0, 1, 256)
    color = np.asarray(matplotlib.colormaps[name](position))[:, :3]
    return TransferFunction(position, color, position, normalized=True)


def _parameters(text: str) -> dict[str, float]:
    """Numbers of `opacity=0.2,low=0.3`."""
    number = {}
    for part in filter(None, text.split(",")):
        key, _, given = part.partition("=")
        if key not in ADJUSTMENTS:
            raise ValueError(f"unknown parameter {key!r}; known: {', '.join(ADJUSTMENTS)}")
        try:
            number[key] = float(given)
        except ValueError:
            raise ValueError(f"{key} must be a number (got {given!r})") from None
    return number


def _thinned(transfer: Transfer, opacity: float) -> Transfer:
    if not 0 <= opacity <= 1:
        raise ValueError(f"opacity must be between 0 and 1 (got {opacity})")
    return transfer.thinned(opacity)


def _cut(transfer: Transfer, low: float) -> Transfer:
    if not np.isfinite(low) or (transfer.normalized and not 0 <= low <= 1):
        raise ValueError(f"low must be {'between 0 and 1' if transfer.normalized else 'finite'}")
    return transfer.cut(low)


ADJUSTMENTS = {"opacity": _thinned, "low": _cut}
