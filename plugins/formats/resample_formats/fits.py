"""FITS: cubes of astronomy."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from resample.reading.limits import check_items, check_unpacked
from resample.reading.native import damage, lacking
from resample_formats.axes import SPACE, LabelledAxis, lattice_of, recording_along
from resample_volume.data.values import require_memory
from resample_volume.files.headers import (
    Check,
    OneOfAll,
)
from resample_volume.types import Recording

CELESTIAL = re.compile("RA|DEC|[GESH]L(ON|AT)|..L[NT]")  # names of axes in degrees
TYPES = {8: "u1", 16: "i2", 32: "i4", 64: "i8", -32: "f4", -64: "f8"}  # by BITPIX
BLOCK, MOST_AXES = 2880, 999  # bytes of a header's block (NAXIS is in the first); axes
AXES = re.compile(rb"NAXIS +=\s+([+-]?\d+)")
FITS_PACKED = (".gz", ".fz", ".bz2")


@dataclass(frozen=True)
class Fits(OneOfAll):
    """An image of a FITS file with three axes or more: the first, or one that is chosen.

    Celestial axes keep the proportion of their pixels; a channel of velocity or frequency is as
    deep as a pixel is wide, unless all axes are lengths of one unit. Blank values are missing.
    """

    hdu: str = ""  # name or number of the image; empty: the first with three axes

    suffixes: ClassVar[tuple[str, ...]] = (".fits", ".fit", ".fts", ".fits.gz", ".fits.fz")

    def read(self, path: Path, name: str, check: Check) -> Recording:
        try:
            from astropy.io import fits
        except ImportError as error:
            raise lacking(path.name, "astropy", error, "fits") from None
        _check_axes(path)
        with path.open("rb") as raw:
            with damage(path):
                held = fits.open(raw, memmap=False)
                count = len(held)
            check_items(path.name, count, "tables and images")
            image = _image_of(held, self.hdu, path.name)
            axes, is_scaled = _axes_of(image.header), "BSCALE" in image.header
            kind, bits = np.dtype(np.float32), image.header.get("BITPIX")
            if not is_scaled and "BLANK" not in image.header:  # blank values are missing
                if bits not in TYPES:
                    listed = ", ".join(map(str, TYPES))
                    raise ValueError(f"has values of {bits} bits; FITS has {listed}")
                kind = np.dtype(TYPES[bits])
            known = lattice_of(axes, kind, name)
            check(known)
            packed = path.name.lower().endswith(FITS_PACKED) or "ZIMAGE" in image._header
            given = path.stat().st_size
            if packed:
                check_unpacked(path.name, given, known.size)
            elif given < known.size:
                raise ValueError(f"{path.name} is cut off: {given} of {known.size} bytes are there")
            require_memory(known.size, name)
            unit = str(image.header.get("BUNIT", "")).strip()
            with damage(path):
                values = np.asarray(image.data)
            values = values.reshape([axis.size for axis in axes][::-1])
            if "BLANK" in image.header and values.dtype.kind in "iu":
                blank = values == image.header["BLANK"]
                values = np.where(blank, np.float32(np.nan), values.astype(np.float32))
            told = [f"values are in {unit}"] if unit else []
            known = known._replace(note="; ".join([*told, known.note]).strip("; "))
            return recording_along(values.astype(values.dtype.newbyteorder("=")), axes, known)


def _check_axes(path: Path) -> None:
    """Reject absurd numbers of axes: astropy would look for each."""
    count = path.stat().st_size // BLOCK
    if not count:
        return
    blocks = np.memmap(path, np.uint8, "r", shape=(count, BLOCK))
    marks = np.frombuffer(b"XTENSION", np.uint8)
    for n in (0, *np.flatnonzero((blocks[:, : marks.size] == marks).all(axis=1))):
        for digits in AXES.findall(blocks[n].tobytes()):
            if len(digits) > 5 or abs(int(digits)) > MOST_AXES:
                axes = digits[:20].decode()
                raise ValueError(f"{path.name} has {axes} axes; FITS has {MOST_AXES} at most")


def _image_of(held: Any, chosen: str, name: str) -> Any:
    """Return the image that is chosen by name or number, or the first of three axes."""
    shapes = [_shape_of(hdu) for hdu in held]
    if chosen:
        images = [hdu for n, hdu in enumerate(held) if shapes[n] and chosen in (str(n), hdu.name)]
    else:
        images = [
            hdu
            for hdu, shape in zip(held, shapes, strict=True)
            if sum(size > 1 for size in shape) >= SPACE
        ]
    if not images:
        known = ", ".join(f"{n} {hdu.name} {shapes[n] or ''}".strip() for n, hdu in enumerate(held))
        raise ValueError(
            f"{name} holds no image of three axes{f' called {chosen}' if chosen else ''}: {known}"
        )
    return images[0]


def _shape_of(hdu: Any) -> tuple[int, ...]:
    """Return the shape of an image; () for a table or a damaged header."""
    shape: Any = getattr(hdu, "shape", None) if hdu.is_image else None
    is_known = isinstance(shape, tuple) and all(isinstance(size, int) for size in shape)
    return shape if is_known else ()


def _axes_of(header: Any) -> list[LabelledAxis]:
    """Return the axes of more than one pixel, x first."""
    axes = []
    for n in range(1, header["NAXIS"] + 1):
        name, unit = (str(header.get(f"{key}{n}", "")).strip() for key in ("CTYPE", "CUNIT"))
        step = header.get(f"CDELT{n}", header.get(f"CD{n}_{n}"))
        axes.append(
            LabelledAxis(
                name or f"axis {n}",
                int(header[f"NAXIS{n}"]),
                # Skies are shown with the right ascension to the left, as they are stored.
                abs(float(step)) if isinstance(step, int | float) and step else None,
                unit or ("deg" if CELESTIAL.match(name) else ""),
            )
        )
    kept = [axis for axis in axes if axis.size > 1]
    return kept if len(kept) >= SPACE else axes[:SPACE]
