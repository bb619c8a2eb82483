"""Show maps of particles in colors, on a linear or logarithmic scale, with a bar."""

import math
from dataclasses import dataclass

import numpy as np

from resample.colors import Background, mapped
from resample.types import Doubles, Floats
from resample_particles.density import DensityMap
from resample_points.data.columns import LEVELS, span_of
from resample_points.data.parts import span_in

DECADES = 5.0  # powers of ten that a logarithmic scale shows below the greatest value, at most
LONGEST = 18  # characters of a bar's title
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
Span = tuple[float, float]


@dataclass(frozen=True, eq=False)
class MapPicture:
    """A map in colors."""

    rgba: Floats  # (H, W, 4) linear light; transparent without a value
    span: Span  # values of the first and the last color
    is_log: bool
    colors: Floats  # (LEVELS, 3) of the scale
    title: str

    def bar(self, background: Background | None = None) -> Floats:
        """Return a picture of the scale (H, B, 4) as high as the map."""
        from resample.measuring.color_bars import plain_bar, ticks_of

        low, high = map(math.log10, self.span) if self.is_log else self.span
        return plain_bar(
            self.colors,
            (low, high),
            self.rgba.shape[0],
            title=self.title,
            background=background or (0.0, 0.0, 0.0),
            ticked=decades if self.is_log else ticks_of,
        )


def map_picture(
    values: DensityMap,
    *,
    colormap: str = "inferno",
    span: str | Span | None = None,
    log: bool | None = None,
) -> MapPicture:
    """Show a map in colors.

    Parameters
    ----------
    colormap
        One of matplotlib's.
    span
        Values at the ends: two numbers, or text `low,high`; each may be a quantile as in
        `2%,98%`. Default: all values, of a logarithmic scale at most 5 powers of ten.
    log
        Whether the scale is logarithmic. None: for densities.

    Raises
    ------
    ValueError
        The span is invalid, or a logarithmic scale has no value above 0.
    """
    is_log = values.name.endswith("density") if log is None else log
    shown = values.value
    counted = shown[shown > 0] if is_log else shown.ravel()
    whole = span_in(counted)
    if whole is None:
        raise ValueError(f"the {values.name} is nowhere above 0" if is_log else "the map is empty")
    if is_log:
        whole = max(whole[0], whole[1] * 10.0**-DECADES), whole[1]
    low, high = span_of(span, counted, whole)
    if is_log and not low > 0:
        raise ValueError(f"a logarithmic range begins above 0, not at {low:g}; or leave out --log")
    share = _shares(shown, (low, high), is_log=is_log)
    known = np.isfinite(share)
    rgba = np.zeros((*shown.shape, 4), np.float32)
    rgba[known, :3] = mapped(colormap, share[known])
    rgba[known, 3] = 1.0
    colors = mapped(colormap, (np.arange(LEVELS) + 0.5) / LEVELS)
    return MapPicture(rgba, (low, high), is_log, colors, _title(values))


def _shares(values: Doubles, span: Span, *, is_log: bool) -> Doubles:
    """Return positions of values in a span, from 0 to 1; NaN without a value."""
    low, high = span
    if is_log:
        low, high = math.log10(low), math.log10(high)
        values = np.log10(values, out=np.full(values.shape, low), where=values > 0)
    if not low < high:
        return np.where(np.isfinite(values), 0.5, np.nan)
    return np.clip((values - low) / (high - low), 0.0, 1.0)


def _title(values: DensityMap) -> str:
    whole = f"{values.name}, {raised(values.units)}" if values.units else values.name
    return whole if len(whole) <= LONGEST else raised(values.units) or whole


def raised(units: str) -> str:
    """Return units with raised powers of ten.

    Examples
    --------
    >>> from resample_particles.mapping import raised
    >>> raised("10^10 Msun/kpc²")
    '10¹⁰ Msun/kpc²'
    """
    first, mark, rest = units.partition("^")
    if not mark:
        return units
    count = len(rest) - len(rest.lstrip("-0123456789"))
    return first + rest[:count].translate(RAISED) + raised(rest[count:])


def decades(span: Span, most: float) -> dict[float, str]:
    """Return the marks of a logarithmic bar: powers of ten, or 1, 2 and 5 times these.

    `span`: logarithms. `most`: marks that fit.
    """
    low, high = span
    powers = range(math.floor(low), math.ceil(high) + 1)
    if high - low >= 2.0:
        every = max(1, math.ceil((high - low) / max(most, 1.0)))
        return {
            float(n): f"10{str(n).translate(RAISED)}"
            for n in powers
            if low <= n <= high and n % every == 0
        }
    steps = {n + math.log10(k): k * 10.0**n for n in powers for k in (1, 2, 5)}
    inside = {place: f"{value:.4g}" for place, value in steps.items() if low <= place <= high}
    if len(inside) > 1:
        return inside
    return {low: f"{10.0**low:.4g}", high: f"{10.0**high:.4g}"}
