"""One view of one volume by several primitives and footprints, measured side by side."""

import time
from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from typing import Any

from resample.cameras import Camera
from resample.compare import shown
from resample.quality import measure
from resample.resampler import Footprint, Primitive, Resampler
from resample.types import Floats, Samples
from resample_volume.session import Session

Row = dict[str, object]


def variants(
    resampler: Resampler, primitives: Sequence[str], footprints: Sequence[str]
) -> dict[str, Resampler]:
    """Renderers by name, one for each pair; names show only what differs.

    Raises
    ------
    ValueError
        A name is no primitive's or footprint's, or there is none.
    """
    if not primitives:
        raise ValueError(f"give a primitive to compare; known: {', '.join(Primitive)}")
    choice: dict[str, Resampler] = {}
    for primitive, footprint in product(primitives, footprints or [""]):
        name = " ".join(filter(None, [primitive, footprint]))
        choice[name] = replace(
            resampler,
            primitive=_member(Primitive, primitive),
            footprint=_member(Footprint, footprint) if footprint else resampler.footprint,
        )
    return choice


def _member(family: Any, name: str) -> Any:
    if name not in list(family):
        raise ValueError(f"{family.__name__.lower()} {name!r}; known: {', '.join(family)}")
    return family(name)


def compare(
    choice: dict[str, Resampler],
    samples: Samples,
    camera: Camera,
    size: tuple[int, int],
    rays: int,
) -> tuple[list[Row], dict[str, Floats]]:
    """Measure renderings against the same kernels at `rays` × `rays` rays per pixel.

    Returns
    -------
    A row for each renderer (milliseconds are of a second, warm run), and the pictures, reference
    first.
    """
    session = Session()
    first = next(iter(choice.values()))
    truth = replace(
        first,
        primitive=Primitive.SPLATS,
        footprint=Footprint.EXACT,
        subpixels=rays,
        pixel_filter=None,
    )
    title = f"reference, {rays} x {rays} rays"
    pictures = {title: session.paint(truth, samples, camera, size, None).rgba}
    rows: list[Row] = []
    for name, resampler in choice.items():
        session.paint(resampler, samples, camera, size, None)
        start = time.perf_counter()
        frame = session.paint(resampler, samples, camera, size, None)
        duration = time.perf_counter() - start
        pictures[name] = frame.rgba
        quality = measure(shown(frame.rgba), shown(pictures[title]))
        share = f"{100 * frame.statistics.splat_fraction:.1f} %"
        rows.append({"picture": name, **quality, "splats": share, "ms": 1000 * duration})
    return rows, pictures
