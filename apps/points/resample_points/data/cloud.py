"""Point clouds: their type, checks of their parts, and clouds from the named columns of files."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.calling import constructed
from resample.colors import from_srgb
from resample.types import Doubles, Floats

FARTHEST = 1e15  # scene units; 4th powers of distances still fit into float32
AXES = ("x", "y", "z")
NO_ROWS = np.zeros((0, 3), np.float32)
NO_COLUMNS: Mapping[str, NDArray[Any]] = MappingProxyType({})


def _tell_colors(args: Sequence[Any], named: dict[str, Any]) -> None:
    """Report colors passed as normals, judged by some rows; convert levels."""
    if "colors" in named and "color" not in named:  # as Open3D has them
        levels = np.asarray(named.pop("colors"))
        white = 1.0 if levels.dtype.kind == "f" else 255.0
        named["color"] = from_srgb((levels / white).astype(np.float32))
    given = np.asarray(args[2] if len(args) > 2 else NO_ROWS)[:64]
    if given.ndim == 2 and len(given) >= 8 and given.shape[1] == 3:
        lengths = np.linalg.norm(given.astype(np.float64), axis=1)
        is_level = given.min() >= 0 and given.max() <= 1 and np.ptp(lengths) > 0.05
        if given.dtype.kind in "ui" or is_level:
            raise TypeError(
                "the second array of a Cloud holds normals, but these look like colors: give "
                "Cloud(position, color=...), linear light, or render(position, colors=...)"
            )


@constructed(check=_tell_colors)
class Cloud(NamedTuple):
    """N surface points; parts that are unknown have length 0.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_points import Cloud, framed, render_cloud
    >>> place = np.random.default_rng(1).normal(size=(2000, 3))
    >>> place /= np.linalg.norm(place, axis=1)[:, None]  # of a ball
    >>> cloud = Cloud(place, normal=place)
    >>> render_cloud(cloud, framed(cloud, size=(32, 24)), size=(32, 24)).statistics.samples
    2000
    """

    position: Floats | Doubles  # (N, 3) scene units
    normal: Floats = NO_ROWS  # (N, 3) outward; (0, 0, 0) or not finite where unknown; or (0, 3)
    color: Floats = NO_ROWS  # (N, 3) linear light; or (0, 3)
    radius: Floats = NO_ROWS[:, 0]  # (N,) scene units, of a point's disc; or (0,)
    columns: Mapping[str, NDArray[Any]] = NO_COLUMNS  # (N,) each: further measurements, by name

    def __repr__(self) -> str:
        """Number of points and their attributes, in one line."""
        parts = [name for name in ("normal", "color", "radius") if len(getattr(self, name))]
        return f"Cloud({', '.join([f'{len(self.position)} points', *parts, *self.columns])})"


def check_cloud(given: Any, kinds: Any) -> None:
    """Reject anything but a cloud, such as an array of places or a path."""
    if not isinstance(given, kinds):
        raise TypeError(
            f"a cloud of {type(given).__name__}; give a Cloud, the result of prepare_cloud, or "
            "read_cloud(path)"
        )


def rows_in(cloud: Cloud, rows: slice) -> Cloud:
    """Return rows of a cloud."""
    position, normal, color, radius, columns = cloud
    kept = {name: column[rows] for name, column in columns.items()}
    return Cloud(position[rows], normal[rows], color[rows], radius[rows], kept)


def some_of(cloud: Cloud, which: NDArray[Any]) -> Cloud:
    """Select points of a cloud by mask or indices."""
    if which.dtype == np.bool_:
        which = np.flatnonzero(which)
    position, normal, color, radius, columns = cloud
    place: Any = np.take(position, which, axis=0)
    return Cloud(
        place,
        np.take(normal, which, axis=0) if len(normal) else normal,
        np.take(color, which, axis=0) if len(color) else color,
        np.take(radius, which) if len(radius) else radius,
        {name: np.take(column, which) for name, column in columns.items()},
    )


def kept_columns(cloud: Cloud, wanted: Sequence[str] | None) -> Cloud:
    """Return a cloud with the wanted columns only; None: all."""
    if wanted is None:
        return cloud
    for name in wanted:
        if name not in (*cloud.columns, *AXES):
            known = ", ".join(columns_of(cloud))
            raise ValueError(f"there is no column {name!r}; known: {known}")
    kept = {name: column for name, column in cloud.columns.items() if name in wanted}
    return cloud._replace(columns=kept)


def columns_of(cloud: Cloud) -> list[str]:
    """Return the names of columns that a cloud can be colored by."""
    return [*AXES, *(name for name in cloud.columns if name not in AXES)]


def places(cloud: Cloud) -> Floats | Doubles:
    """Return the positions (N, 3) of points with one."""
    position: Floats | Doubles = part_of(cloud, "position")
    known = np.isfinite(position).all(axis=1)
    return position if known.all() else position[known]


def checked(cloud: Cloud) -> Cloud:
    """Return the points that can be drawn, in checked arrays, without columns."""
    parts = {name: part_of(cloud, name) for name in ("position", "normal", "color", "radius")}
    whole, known = Cloud(**parts), drawable(cloud)
    position, normal, color, radius, _ = whole if known.all() else some_of(whole, known)
    farthest = max(float(position.max(initial=0)), -float(position.min(initial=0)))
    if farthest > FARTHEST:
        raise ValueError(f"a coordinate of {farthest:g}; {FARTHEST:g} is the limit")
    is_normal = _are_finite(normal)
    if not is_normal.all():
        normal = np.where(is_normal[:, None], normal, 0.0)
    return Cloud(
        np.asarray(position, np.float64),
        np.asarray(normal, np.float32),
        np.asarray(color, np.float32),
        np.asarray(radius, np.float32),
    )


def drawable(cloud: Cloud) -> NDArray[np.bool_]:
    """Mark the points (N,) that can be drawn."""
    known = _are_finite(part_of(cloud, "position"))
    color, radius = part_of(cloud, "color"), part_of(cloud, "radius")
    if len(color):
        known &= _are_finite(color)
    if len(radius):
        known &= np.isfinite(radius) & (radius > 0)
    return known


def _are_finite(values: NDArray[Any]) -> NDArray[np.bool_]:
    """Tell which rows (N,) of values (N, 3) are finite."""
    are = np.isfinite(values)
    if are.all():  # much faster than a check of every row
        return np.ones(len(values), np.bool_)
    of_rows: NDArray[np.bool_] = are.all(axis=1)
    return of_rows


def part_of(cloud: Cloud, name: str) -> Any:
    """Return a part of a cloud, checking that its shape fits the positions."""
    count = len(cloud.position) if cloud.position is not None else "N"
    rest = () if name == "radius" else (3,)
    shape = f"({', '.join(map(str, (count, *rest)))}{'' if rest else ','})"
    part = getattr(cloud, name)
    if part is None:
        nothing = "" if name == "position" else f", or {(0, *rest)} where it is unknown"
        raise ValueError(f"{name} of a cloud is None; give an array of the shape {shape}{nothing}")
    array = np.asarray(part)
    lengths = {count} if name == "position" else {count, 0}
    if array.dtype.kind not in "iuf" or array.shape[1:] != rest or len(array) not in lengths:
        raise ValueError(f"{name} of a cloud has the shape {array.shape}; it must be {shape}")
    if name == "color" and array.dtype.kind in "iu" and array.max(initial=0) > 1:
        raise ValueError(
            f"color of a cloud holds levels ({array.dtype}); give linear light from 0 to 1, such "
            "as resample.colors.from_srgb(color / np.float32(255))"
        )
    return array


Fields = Mapping[str, NDArray[Any]]  # columns of a file by name, (N,) each

PLACES = (("x", "y", "z"),)
NORMALS = (("nx", "ny", "nz"), ("normal_x", "normal_y", "normal_z"))
COLORS = (
    ("red", "green", "blue"),
    ("r", "g", "b"),
    ("rf", "gf", "bf"),  # CloudCompare's, from 0 to 1
    ("diffuse_red", "diffuse_green", "diffuse_blue"),
)
PACKED = ("rgb", "rgba")  # a color packed into the bits of one number
BITS_8, BITS_16 = 255, 65535  # greatest levels
FLOATING = 2.0  # greatest float of colors that go from 0 to 1, some of them brighter than white


def cloud_of(fields: Fields, white: float | None = None) -> Cloud:
    """Make a cloud from a file's columns.

    `white`: level of colors that is white. Default: found by `white_of`.
    """
    position = _stacked(fields, PLACES)
    if position is None:
        raise ValueError(f"has no x, y and z; it has {', '.join(fields) or 'nothing'}")
    single = position.dtype.kind == "f" and position.dtype.itemsize <= 4
    normal, levels = _stacked(fields, NORMALS), _stacked(fields, COLORS)
    for name in PACKED:
        if levels is None and name in fields:
            packed, white = fields[name], BITS_8
            if packed.dtype.itemsize != 4:
                raise ValueError(f"packs colors into {packed.dtype.itemsize} bytes; 4 can be read")
            bits = np.ascontiguousarray(packed).view(np.uint32 if packed.dtype.isnative else ">u4")
            levels = np.stack([bits >> 16 & 255, bits >> 8 & 255, bits & 255], 1).astype(np.uint8)
    radius = fields.get("radius", np.zeros(0))
    known = {name for names in (*PLACES, *NORMALS, *COLORS) for name in names}
    known |= {*PACKED, "radius"}
    return Cloud(
        position.astype(np.float32 if single else np.float64),
        NO_ROWS if normal is None else normal.astype(np.float32),
        NO_ROWS if levels is None else linear(levels, white),
        radius.astype(np.float32),
        {
            name: column
            for name, column in fields.items()
            if name not in known and not name.startswith("_")  # PCD's padding
        },
    )


def _stacked(fields: Fields, names: Sequence[tuple[str, ...]]) -> Any:
    """Stack the columns (N, 3) of the first complete group of names, or return None."""
    for group in names:
        if all(name in fields for name in group):
            return np.stack([fields[name] for name in group], axis=1)
    return None


def white_of(kind: np.dtype[Any], most: float) -> float:
    """Return the level of white, from the type of levels and the greatest of them.

    Whole numbers have 8 bits, or 16 where one is above 255; wider types that exceed 16 bits have
    their range. Floats go from 0 to 1, or as whole numbers do where one is above 2.

    Examples
    --------
    >>> import numpy as np
    >>> white_of(np.dtype(np.uint16), 200), white_of(np.dtype(np.float32), 254.5)
    (255.0, 255.0)
    """
    if kind.kind == "f":
        return 1.0 if most <= FLOATING else float(BITS_8 if most <= BITS_8 else BITS_16)
    greatest = int(np.iinfo(kind).max)
    bits = BITS_8 if most <= BITS_8 else BITS_16 if most <= BITS_16 else greatest
    return float(min(bits, greatest))


def linear(levels: NDArray[Any], white: float | None = None) -> Floats:
    """Return linear light of sRGB levels; `white`: see `cloud_of`."""
    if white is None:
        white = white_of(levels.dtype, most_of(levels))
    with np.errstate(over="ignore"):  # infinite: such points are dropped
        return from_srgb(levels.astype(np.float32) / np.float32(white))


def most_of(levels: NDArray[Any]) -> float:
    """Return the greatest finite level, at least 0."""
    return float(np.nan_to_num(levels, nan=0.0, posinf=0.0).max(initial=0))
