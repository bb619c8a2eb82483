"""Transfer functions by name: presets, tissues, colormaps, files, materials."""

import os
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from resample.messages import choices_in, parts_of
from resample_volume.classification import TISSUES
from resample_volume.classification.automatic import automatic, ramp, tomographic
from resample_volume.classification.regions import Faded, Region, RegionTransfer
from resample_volume.classification.scales import on_scale
from resample_volume.classification.transfer import (
    SUFFIXES,
    Materials,
    Transfer,
    TransferFunction,
    from_points,
    spread,
)
from resample_volume.classification.value_statistics import Survey, survey, tissue
from resample_volume.types import Volume

BLACK, WHITE, RED = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (0.85, 0.12, 0.08)
BLUE, SAND = (0.15, 0.25, 0.55), (0.95, 0.85, 0.6)
GLASS, AMBER = (0.55, 0.65, 0.75), (1.0, 0.6, 0.2)

# `auto` for generated volumes with a look of their own.
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
    # Boundaries of thin, medium and dense material, in data of any kind.
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


NUMBER = r"[-+]?[0-9]*\.?[0-9]+(?:e[-+]?[0-9]+)?"
RANGE = re.compile(rf"({NUMBER})?\.\.({NUMBER})?", re.IGNORECASE)  # of values: 300..900, 500..
JOINT = re.compile(r"(?<![0-9][eE])\+(?!1024\b)")  # between materials, not in 1e+5 or hu+1024
BETWEEN = re.compile(r",(?!\s*(?:opacity|low|color|gradient)=)")  # looks of channels
# Points of value, color as displayed, and opacity: 40,red,0 90,white,0.5 or 40/red/0,90/white/0.5.
POINT, SLASHED = (rf"{NUMBER}{by}[^/,:+\s]+{by}{NUMBER}" for by in ",/")
POINTS = re.compile(rf"{POINT}(?:\s+{POINT})*|{SLASHED}(?:,{SLASHED})*", re.IGNORECASE)
SOFT = 0.1  # of a range of values, over which its opacity rises and falls
# Colormaps of two colors with a neutral middle: it is transparent, and zero if there is one.
DIVERGING = re.compile(
    "(PiYG|PRGn|BrBG|PuOr|RdGy|RdBu|RdYlBu|RdYlGn|Spectral|coolwarm|bwr|seismic|berlin|managua|"
    "vanimo)(_r)?"
)

Window = tuple[float, float]  # least and greatest value


@dataclass(frozen=True)
class Names:
    """Resolver of names of transfer functions, with or without a volume."""

    volume: Volume | None = None
    known: Survey | None = None  # statistics of the volume's values
    window: Window | None = None  # range for functions of fractions

    def transfer(self, name: str) -> Transfer:
        """Return the transfer function of one material or of several, joined by +."""
        words = [name] if is_file(name) else JOINT.split(name)
        parts = tuple(self._part(word.strip()) for word in words)
        if len(parts) == 1 and not isinstance(parts[0], Faded):
            return parts[0]
        return Materials(parts)

    def _part(self, name: str) -> Transfer:
        if is_file(name):
            from resample_volume.classification.files import read_transfer

            return self._placed(read_transfer(Path(name)), name)
        base, _, text = name.partition(":")
        transfer = self._base(base)
        changes: dict[str, str] = {}
        try:
            for key, given in choices_in(text):
                if key not in ADJUSTMENTS:
                    raise ValueError(f"unknown parameter {key!r}; known: {', '.join(ADJUSTMENTS)}")
                changes[key] = given
            for key, change in ADJUSTMENTS.items():
                if key in changes:
                    transfer = change(transfer, changes[key])
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from None
        is_placed = base == "auto" and not transfer.normalized
        return transfer if is_placed else self._placed(transfer, name)

    def _placed(self, transfer: Transfer, name: str) -> Transfer:
        """Rescale fractions to the window, or to the robust range."""
        if self.window is not None:
            if not transfer.normalized:
                raise ValueError(
                    f"the window applies to looks of fractions, but {name} is in data units "
                    "already; leave one of them out, or take gray, auto or a colormap"
                )
            return spread(transfer, self.window)
        if self.volume is not None and self.volume.scale:
            transfer = on_scale(transfer, self.volume.scale)
        if self.known is None or self.known.is_plain:
            return transfer
        return spread(transfer, self.known.span)

    def _base(self, name: str) -> Transfer:
        """Return the transfer function before its parameters are applied."""
        if name == "auto" and self.volume is not None and self.known is not None:
            if self.window is not None:
                return ramp()
            is_ct = self.known.units.added is not None
            return (tomographic if is_ct else automatic)(self.volume, self.known)
        if ends := RANGE.fullmatch(name):
            return _of_range(name, *ends.groups())
        if POINTS.fullmatch(name):
            return _of_points(name)
        added = None if self.known is None else self.known.units.added
        if name in TISSUES and self.window is None:
            if added is not None:
                return tissue(name, added)
            if self.known is None and name not in PRESETS:
                return tissue(name)
        if name in PRESETS:
            return PRESETS[name]()
        if name in TISSUES:
            if self.window is not None or self.volume is None or self.known is None:
                raise ValueError(
                    f"{name} is in Hounsfield units, which a window would rescale; leave one out"
                )
            raise ValueError(
                f"{name} is a look for Hounsfield units, but {self.volume.name} holds "
                f"{self.known.low:g} to {self.known.high:g} and does not look like it; give its "
                "units, hu or hu+1024, or take auto or a range of values such as 300..900"
            )
        import matplotlib

        if name not in matplotlib.colormaps:
            from difflib import get_close_matches

            near = get_close_matches(name, [*PRESETS, *TISSUES, *matplotlib.colormaps], 1)
            hint = f"did you mean {near[0]!r}? " if near else ""
            raise ValueError(
                f"unknown transfer function {name!r}; {hint}known: {', '.join(PRESETS)}; in "
                "Hounsfield "
                f"units {', '.join(TISSUES)}; the name of a matplotlib colormap, a range of values "
                "such as 300..900, points such as '40,red,0 90,white,0.5', or a .json or .toml "
                "file will do"
            )
        found = colormap(name)
        if not DIVERGING.fullmatch(name):
            return found
        found = replace(found, opacity=(2 * found.value - 1) ** 2)  # noise stays faint
        if self.window is None and self.known is not None and self.known.low < 0 < self.known.high:
            limit = max(-self.known.low, self.known.high)
            return spread(found, (-limit, limit))
        return found


def transfer_for(name: str, volume: Volume, window: Window | None = None) -> Transfer:
    """Return a transfer function by name or from a file, or `auto`, which adapts to the volume.

    Fractions are of the robust range, without padding and outliers. Tissues need values in
    Hounsfield units, as stated or guessed; for these, `auto` is `ct`.
    """
    is_plain = name == "auto" and window is None
    if is_plain and volume.colors is not None and volume.colors.shape[-1] == 4:
        dtype = volume.values.dtype  # values are opacities
        most = float(np.iinfo(dtype).max) if dtype.kind in "iu" else 1.0
        return from_points([(0.0, WHITE, 0.0), (most, WHITE, 1.0)])
    own = GENERATED_VOLUMES.get(volume.name) if is_plain and not volume.scale else None
    if own is not None:
        return load_transfer(own)
    return Names(volume, survey(volume), window).transfer(name)


def load_transfer(name: str | Path) -> Transfer:
    """Return a transfer function by name or from a file.

    Parameters
    ----------
    name
        One of `PRESETS`; one of `TISSUES`, which are in Hounsfield units; a range of data
        values such as `300..900`, soft at its borders; points of value, color and opacity such as
        `40,tomato,0 120,#ffcc00,0.4`, linear between them; a matplotlib colormap, over the range of
        the data and with an opacity that rises from 0 to 1, of diverging ones (RdBu, coolwarm) from
        0 in the middle, which is zero if values have both signs; or a .json or .toml file.
        After all but a file `:opacity=0.2,low=0.3` multiplies all opacities (0..1) and makes
        transparent what is below a value (for functions of fractions 0..1 of the data's range);
        `color=tomato` takes one color, and `gradient=0.1,0.5` fades homogeneous regions, as in
        `classify`. Several materials are joined by +: `skin:opacity=0.1+bone`.

    Raises
    ------
    ValueError
        The name or a parameter is unknown, or the file's content is invalid.
    OSError
        The file cannot be read.

    Examples
    --------
    >>> from resample_volume import load_transfer
    >>> load_transfer("300..900:opacity=0.2").value.tolist()
    [300.0, 360.0, 840.0, 900.0]
    >>> load_transfer("40,tomato,0 120,#ffcc00,0.4").opacity.tolist()
    [0.0, 0.4]
    """
    return Names().transfer(str(name))


def is_file(name: str) -> bool:
    """Return whether a name is of a file, which may contain a + itself."""
    return _has_suffix(name) and ("+" not in name or os.path.exists(name))


def names_file(text: str) -> bool:
    """Return whether a look, or one of the looks of channels, may be read from a file."""
    looks = (text, *BETWEEN.split(text))
    words = (word for look in looks for word in (look, *JOINT.split(look)))
    return any(_has_suffix(word.strip()) for word in words)


def _has_suffix(name: str) -> bool:
    return Path(name).suffix.lower() in SUFFIXES


def _of_range(name: str, least: str | None, greatest: str | None) -> TransferFunction:
    """Return a function that shows only a range of values, with soft ends inside it."""
    low = None if least is None else float(least)
    high = None if greatest is None else float(greatest)
    if low is None and high is None:
        raise ValueError(f"{name!r} has no ends; give a range of values such as 300..900 or 300..")
    if low is not None and high is not None and not low < high:
        if low == high:
            raise ValueError(f"{name} is empty; give two values, such as {low:g}..{low + 1:g}")
        raise ValueError(f"{name} does not ascend; give {greatest}..{least}")
    width = SOFT * (high - low) if low is not None and high is not None else 0.0
    points = [] if low is None else [(low, SAND, 0.0), (low + width, SAND, 1.0)]
    if high is not None:
        points += [(high - width, SAND, 1.0), (high, SAND, 0.0)]
    return from_points(points)


def _of_points(name: str) -> TransferFunction:
    """Parse control points of the command line."""
    from resample_volume.classification.files import displayed_color

    points = []
    for part in name.split("," if "/" in name else None):
        value, color, opacity = parts_of(part)
        try:
            points.append((float(value), displayed_color(color), float(opacity)))
        except ValueError as error:
            raise ValueError(f"{part}: color {error}") from None
    return from_points(points)


def colormap(name: str) -> TransferFunction:
    """Return a colormap of matplotlib by name, over the range of the data."""
    import matplotlib

    if name not in matplotlib.colormaps:
        raise ValueError(
            f"colors {name!r}; give the name of a matplotlib colormap, such as gray, viridis or "
            "coolwarm"
        )
    position = np.linspace(0, 1, 256)
    color = np.asarray(matplotlib.colormaps[name](position))[:, :3]
    return TransferFunction(position, color, position, normalized=True)


def _number(key: str, given: str) -> float:
    try:
        return float(given)
    except ValueError:
        raise ValueError(f"{key} must be a number (got {given!r})") from None


def _thinned(transfer: Transfer, given: str) -> Transfer:
    opacity = _number("opacity", given)
    if not 0 <= opacity <= 1:
        raise ValueError(f"opacity must be between 0 and 1 (got {opacity})")
    return transfer.thinned(opacity)


def _cut(transfer: Transfer, given: str) -> Transfer:
    low = _number("low", given)
    if not np.isfinite(low) or (transfer.normalized and not 0 <= low <= 1):
        raise ValueError(f"low must be {'between 0 and 1' if transfer.normalized else 'finite'}")
    return transfer.cut(low)


def _colored(transfer: Transfer, given: str) -> Transfer:
    from resample_volume.classification.files import displayed_color

    color = displayed_color(given)
    if isinstance(transfer, RegionTransfer):
        regions = tuple(replace(region, color=color) for region in transfer.regions)
        return replace(transfer, regions=regions)
    if isinstance(transfer, TransferFunction):
        return replace(transfer, color=np.tile(color, (transfer.value.size, 1)))
    raise ValueError("color does not apply to this one")


def _faded(transfer: Transfer, given: str) -> Transfer:
    ends = [_number("gradient", part) for part in parts_of(given)]
    if len(ends) != 2:
        raise ValueError(f"gradient must be two fractions such as 0.1,0.5 (got {given!r})")
    return Faded(transfer, (ends[0], ends[1]))


# In the order of application, regardless of the order given.
ADJUSTMENTS: dict[str, Callable[[Transfer, str], Transfer]] = {
    "opacity": _thinned,
    "low": _cut,
    "color": _colored,
    "gradient": _faded,
}
