"""Planes in a volume that show unshaded values, with their own window."""

import math
from dataclasses import dataclass, replace

import numpy as np

from resample.messages import parts_of
from resample.types import Doubles
from resample_volume.classification.presets import colormap
from resample_volume.classification.scales import scale_named
from resample_volume.classification.transfer import TransferFunction, from_points
from resample_volume.classification.value_statistics import survey
from resample_volume.surfaces.meshes import choices_of, chosen_opacity
from resample_volume.types import Volume
from resample_volume.voxels.cropping import planes
from resample_volume.voxels.visible import lattice_of

AXES = "xyz"
KEYS = ("window", "colors", "opacity")
FORM = (
    "give a voxel's index along an axis (z=40) or a percentage of its extent (x=50%), or a "
    "normal and an offset from the center along it, as for clip (1,0,-1,20); and after a colon "
    "window, colors and opacity, as in z=40:window=40,400,colors=gray,opacity=0.5"
)
WINDOW = "give a center and a width, 40,400, or both end values, -160..240"
GRAY = from_points([(0.0, (0.0,) * 3, 1.0), (1.0, (1.0,) * 3, 1.0)], normalized=True)
UNIT = Volume(np.zeros((1, 1, 1)), np.ones(3), np.zeros(3), np.eye(3), "")
Where = str | tuple[float, float, float, float]


@dataclass(frozen=True)
class ImagePlane:
    """A plane that shows the volume's values on it.

    Examples
    --------
    >>> from resample_volume import ImagePlane
    >>> ImagePlane.of("z=40:window=40,400,opacity=0.5")
    ImagePlane(where='z=40', window=(-160.0, 240.0), colors='gray', opacity=0.5)
    """

    # x=50%, z=40 or as `clip`; or a scene's plane n·p = d as four numbers, the last d, whose window
    # is on the volume's scale
    where: Where
    window: tuple[float, float] | None = (
        None  # values at both ends of the colors; None: robust range
    )
    colors: str = "gray"  # gray: linear in displayed levels; or a matplotlib colormap
    opacity: float = 1.0

    def __post_init__(self) -> None:
        if isinstance(self.where, str):
            if self.where[:1].isdigit() or self.where[:1] in ("-", "+", "."):
                planes(UNIT, None, (self.where,), "plane")  # refuses what is none of any volume
            elif _place(self.where) is None:
                raise ValueError(f"plane {self.where!r}; {FORM}")
        elif len(self.where) != 4 or not np.isfinite(self.where).all() or not any(self.where[:3]):
            raise ValueError(f"plane {self.where}; give a normal and a distance along it, x y z d")
        if not 0 <= self.opacity <= 1:
            raise ValueError(f"opacity {self.opacity} of a plane; give 0 to 1")
        if self.window is not None and not -math.inf < self.window[0] < self.window[1] < math.inf:
            raise ValueError(f"window {self.window} of a plane does not ascend; {WINDOW}")
        self.palette  # noqa: B018 - refuses unknown colors

    @property
    def numbers(self) -> tuple[float, float, float, float]:
        """Return normal and distance of a settled plane."""
        if isinstance(self.where, str):
            raise TypeError(f"the plane {self.where} is relative to a volume; settle it first")
        return self.where

    @property
    def palette(self) -> TransferFunction:
        """Return the colors of values, by fractions of the window."""
        return GRAY if self.colors == "gray" else colormap(self.colors)

    @classmethod
    def of(cls, text: str) -> "ImagePlane":
        """Parse `z=40`, `x=50%:window=40,400,colors=viridis,opacity=0.5`, `1,0,-1,20`...

        Raises
        ------
        ValueError
            The text is not of this form, or a choice is unknown or not allowed.
        """
        where, _, rest = text.partition(":")
        choices = choices_of("plane", text, rest, KEYS, FORM)
        opacity = chosen_opacity("plane", choices)
        window = _window(choices["window"]) if "window" in choices else None
        return cls(where, window, choices.get("colors", "gray"), opacity)

    def within(self, span: tuple[float, float]) -> "ImagePlane":
        """Return the plane with this window, if it has none."""
        low, high = span
        if self.window is not None:
            return self
        return replace(self, window=(low, high if high > low else low + 1.0))


def _place(where: str) -> tuple[int, float, bool] | None:
    """Parse the place of a plane perpendicular to an axis; None if it is not one.

    The axis (0: x), a number, and whether it is in percent of the extent, otherwise in voxels.
    """
    axis, _, text = where.partition("=")
    is_share = text.endswith("%")
    try:
        number = float(text.removesuffix("%"))
    except ValueError:
        return None
    if len(axis) != 1 or axis not in AXES or not math.isfinite(number):
        return None
    return AXES.index(axis), number, is_share


def _window(text: str) -> tuple[float, float]:
    """Parse a window to its end values."""
    by_ends = ".." in text
    try:
        one, two = (float(part) for part in (text.split("..") if by_ends else parts_of(text)))
    except ValueError:
        raise ValueError(f"window {text!r} of a plane; {WINDOW}") from None
    return (one, two) if by_ends else (one - two / 2, one + two / 2)


def settled(plane: ImagePlane, volume: Volume) -> ImagePlane:
    """Return the plane in scene units, with its window resolved."""
    where, by = plane.where, scale_named(volume.scale)
    if plane.window is None:
        plane = plane.within(survey(volume).span)
    elif by is not None and isinstance(where, str):
        low, high = (by.place(value, "window of a plane") for value in plane.window)
        plane = replace(plane, window=(low, high))
    if isinstance(where, str):
        if where[0] in AXES:
            # A plane perpendicular to an axis of voxels
            place = _place(where)
            if place is None:
                raise ValueError(f"plane {where!r}; {FORM}")
            axis, number, is_share = place
            count = volume.values.shape[2 - axis]
            number = number / 100 * count - 0.5 if is_share else number
            if not -0.5 <= number <= count - 0.5:
                raise ValueError(
                    f"plane {where!r} misses {volume.name}, which has {count} voxels along "
                    f"{AXES[axis]}; give 0 to {count - 1}, or 0% to 100%"
                )
            row = np.linalg.inv(lattice_of(volume))[axis]
            where = _plane(row, float(row @ volume.origin) + number)
        else:  # given like a clip plane
            ((*normal, distance),) = planes(volume, None, (where,), "plane")
            where = _plane(np.array(normal), -distance)
        if not len(outline(volume, where)):
            raise ValueError(f"plane {plane.where!r} misses {volume.name}; {FORM}")
    return replace(plane, where=where)


def _plane(normal: Doubles, distance: float) -> tuple[float, float, float, float]:
    length = float(np.linalg.norm(normal))
    x, y, z = (normal / length).tolist()
    return x, y, z, float(distance) / length


def outline(volume: Volume, where: tuple[float, float, float, float]) -> Doubles:
    """Return the polygon (N, 3) in which a plane cuts a volume; voxels along x, y, z."""
    lattice = lattice_of(volume)
    normal = np.array(where[:3]) @ lattice
    distance = where[3] - float(np.dot(where[:3], volume.origin))
    length = float(np.linalg.norm(normal))
    normal, distance = normal / length, distance / length
    ends = np.array([[-0.5, count - 0.5] for count in volume.values.shape[::-1]])
    bits = np.array(list(np.ndindex(2, 2, 2)))
    corner = ends[np.arange(3), bits]
    away = corner @ normal - distance
    away[np.abs(away) < 1e-9 * (1 + np.abs(ends).max())] = 0.0
    found = [corner[n] for n in range(8) if away[n] == 0]
    for n in range(8):
        for other in (n | 1, n | 2, n | 4):
            if other != n and away[n] * away[other] < 0:
                share = away[n] / (away[n] - away[other])
                found.append(corner[n] + share * (corner[other] - corner[n]))
    if len(found) < 3:
        return np.zeros((0, 3))
    places = np.array(found)
    first = np.eye(3)[np.abs(normal).argmin()]
    right = np.cross(normal, first)
    right /= np.linalg.norm(right)
    from_middle = places - places.mean(axis=0)
    angle = np.arctan2(from_middle @ np.cross(normal, right), from_middle @ right)
    return np.asarray(places[np.argsort(angle)])
