"""Meshes in a volume's scene, read by trimesh; isosurfaces; planes that show unshaded values."""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.colors import from_srgb
from resample.messages import choices_in, parts_of
from resample.painting.meshes import mesh_of
from resample.painting.scenes import check_places
from resample.reading.limits import check_file
from resample.reading.meshes import check_mesh, trimesh_resolver, unreadable
from resample.reading.native import plain
from resample.types import NO_TRIANGLES, Doubles, Triangles
from resample_volume.classification.presets import colormap
from resample_volume.classification.scales import scale_named
from resample_volume.classification.transfer import TransferFunction, from_points
from resample_volume.classification.value_statistics import survey
from resample_volume.data.values import require_memory
from resample_volume.types import Volume
from resample_volume.voxels.framing import planes
from resample_volume.voxels.gathered import Gathered, check_iso
from resample_volume.voxels.shading import PAD
from resample_volume.voxels.visible import finite_range, lattice_of

SUFFIXES = (".ply", ".obj", ".stl", ".glb")
GRAY = 0.6  # linear, of a mesh without colors
SMOOTH = 40.0  # greatest angle between triangles of one smooth surface, degrees
ALLOWED = "color and opacity, as in stent.ply:color=tomato,opacity=0.5"
ISO_FORM = "give a value, and after a colon color and opacity, as in 300:color=ivory,opacity=0.5"


@dataclass(frozen=True, eq=False)
class SceneMesh:
    """A triangle mesh in the volume's scene.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_volume import scene_mesh
    >>> corner = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    >>> mesh = scene_mesh(corner, np.array([[0, 1, 2]]), opacity=0.5)
    >>> mesh.face.shape, mesh.normal[0]
    ((1, 3), array([0., 0., 1.]))
    """

    corner: Doubles  # (V, 3) scene units
    normal: Doubles  # (V, 3)
    color: Doubles  # (V, 3) linear
    face: NDArray[np.int64]  # (T, 3) corners
    opacity: float = 1.0

    def __post_init__(self) -> None:
        if not 0 <= self.opacity <= 1:
            raise ValueError(f"opacity {self.opacity} of a mesh; give 0 to 1")


def scene_mesh(
    corner: Doubles,
    face: NDArray[np.int64],
    color: tuple[float, float, float] | Doubles = (GRAY, GRAY, GRAY),
    opacity: float = 1.0,
    smooth: float = SMOOTH,
) -> SceneMesh:
    """Make a mesh of vertices (V, 3) and triangles (T, 3), smooth where it bends little.

    Parameters
    ----------
    corner
        Vertices in the volume's scene.
    face
        Indices of the triangles' vertices.
    color
        Linear RGB, for all or (V, 3) per vertex.
    opacity
        0 to 1.
    smooth
        Greatest angle between neighbouring triangles that share normals, degrees.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_volume import Appearance, render, scene_mesh
    >>> corner = np.array([[0.0, 0, 4], [7, 0, 4], [0, 7, 4]])
    >>> mesh = scene_mesh(corner, np.array([[0, 1, 2]]), color=(1, 0, 0))
    >>> look = Appearance("9..99", classification="post", meshes=(mesh,))
    >>> render(np.zeros((8, 8, 8), np.uint8), look, "top", size=(32, 32))  # it alone
    Frame(32 × 32 px, 10.3 % covered, depth from 32.59)
    """
    import trimesh

    corner, face = np.asarray(corner, np.float64), np.asarray(face, np.int64)
    check_places(corner, "a mesh's corner")
    if face.size and not 0 <= face.min() <= face.max() < len(corner):
        raise ValueError(
            f"a mesh's triangles name corners {face.min()} to {face.max()}; it has {len(corner)}"
        )
    colors = np.broadcast_to(np.asarray(color, np.float64), (len(corner), 3))
    whole = trimesh.Trimesh(corner, face, process=False)
    whole.vertex_attributes["color"] = colors
    _, first, back = np.unique(corner, axis=0, return_index=True, return_inverse=True)
    first = np.asarray(first[back.reshape(-1)], np.int64)
    joined = trimesh.Trimesh(corner, first[face], process=False)
    parts = trimesh.graph.connected_components(
        joined.face_adjacency[joined.face_adjacency_angles <= np.radians(smooth)],
        nodes=np.arange(len(face)),
        min_len=1,
    )
    group = np.empty(len(face), np.int64)
    for number, part in enumerate(parts):
        group[part] = number
    # Normals (3 T, 3) of triangles' corners: means over a smoothing group around them
    triangle = np.asarray(joined.triangles, np.float64)
    normal = np.cross(triangle[:, 1] - triangle[:, 0], triangle[:, 2] - triangle[:, 0])
    key = np.stack([first[face].reshape(-1), np.repeat(group, 3)], axis=1)
    _, place = np.unique(key, axis=0, return_inverse=True)
    place, each = place.reshape(-1), np.repeat(normal, 3, axis=0)
    total = np.stack([np.bincount(place, each[:, axis]) for axis in range(3)], axis=1)
    normal = np.asarray(total[place])
    corners = corner[face].reshape(-1, 3)
    count = np.arange(len(corners)).reshape(-1, 3)
    return SceneMesh(corners, normal, colors[face].reshape(-1, 3), count, opacity)


def read_mesh(text: str) -> SceneMesh:
    """Read a mesh, with optional color and opacity: stent.ply:color=tomato,opacity=0.5.

    Raises
    ------
    ValueError
        A choice is unknown or not allowed, or the file holds no triangles.
    OSError
        There is no such file.

    Examples
    --------
    >>> import tempfile
    >>> import trimesh
    >>> from resample_volume import read_mesh
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = trimesh.creation.box().export(f"{folder}/box.ply")
    ...     mesh = read_mesh(f"{folder}/box.ply:color=tomato,opacity=0.5")
    >>> mesh.opacity, mesh.face.shape
    (0.5, (12, 3))
    """
    import trimesh

    name, colon, tail = text.rpartition(":")
    tail = tail if colon and "=" in tail else ""
    path = Path(name if tail else text)
    own, opacity = look_of("mesh", text, tail, f"known are {ALLOWED}")
    check_file(path)
    if path.suffix.lower() not in SUFFIXES:
        raise ValueError(f"{path}: meshes are read from {', '.join(SUFFIXES)}")
    check_mesh(path)
    try:
        scene = trimesh.load_scene(plain(path), resolver=trimesh_resolver(path), process=False)
        parts = [one for one in scene.dump() if len(getattr(one, "faces", ()))]
    except Exception as error:  # trimesh and its parsers raise exceptions of any type
        raise unreadable(str(path), error) from None
    if not parts:
        raise ValueError(f"{path} holds no triangles")
    made = []
    try:
        for part in parts:
            color: Any = own or (GRAY, GRAY, GRAY)
            if own is None and part.visual.kind is not None:
                is_texture = part.visual.kind == "texture"
                with np.errstate(invalid="ignore"):  # of NaN texture coordinates
                    visual = part.visual.to_color() if is_texture else part.visual
                levels = np.asarray(visual.vertex_colors)[:, :3].astype(np.float32)
                color = np.asarray(from_srgb(levels / 255), np.float64)
            corner, face = np.asarray(part.vertices, np.float64), np.asarray(part.faces, np.int64)
            made.append(scene_mesh(corner, face, color, opacity))
    except (TypeError, LookupError, AttributeError) as error:  # trimesh left objects unfinished
        raise unreadable(str(path), error) from None
    return SceneMesh(*_joined(made), opacity)


def choices_of(
    kind: str, text: str, tail: str, known: Collection[str], form: str
) -> tuple[dict[str, str], float]:
    """Parse choices `a=b,c=d` by name, and the opacity, by default 1."""
    choices = dict(choices_in(tail))
    unknown = [key for key in choices if key not in known]
    if unknown:
        raise ValueError(f"{kind} {text!r}: unknown {', '.join(unknown)}; {form}")
    try:
        return choices, float(choices.get("opacity", "1"))
    except ValueError:
        raise ValueError(f"opacity {choices['opacity']!r} of a {kind}; give 0 to 1") from None


def look_of(
    kind: str, text: str, tail: str, form: str
) -> tuple[tuple[float, float, float] | None, float]:
    """Parse `color=tomato,opacity=0.5` to linear light, if there is a color, and opacity."""
    from resample.console import linear_color

    choices, opacity = choices_of(kind, text, tail, ("color", "opacity"), form)
    if "color" not in choices:
        return None, opacity
    if (color := linear_color(choices["color"])) is None:
        raise ValueError(f"color 'none' of a {kind}; give a color's name or #rrggbb")
    return color, opacity


def placed(meshes: tuple[SceneMesh, ...], middle: Doubles) -> Triangles:
    """Return all meshes for ray casting, with `middle` as the scene's origin."""
    if not meshes:
        return NO_TRIANGLES
    corner, normal, color, face = _joined(meshes)
    opacity = np.concatenate([np.full(len(mesh.face), mesh.opacity) for mesh in meshes])
    return mesh_of(corner - middle, normal, color, face, opacity)


def _joined(
    meshes: Sequence[SceneMesh],
) -> tuple[Doubles, Doubles, Doubles, NDArray[np.int64]]:
    """Return corners, normals, colors and triangles of all meshes."""
    start = np.cumsum([0, *(len(mesh.corner) for mesh in meshes)])
    face = [mesh.face + first for mesh, first in zip(meshes, start[:-1], strict=True)]
    parts = zip(*((mesh.corner, mesh.normal, mesh.color) for mesh in meshes), strict=True)
    corner, normal, color = map(np.concatenate, parts)
    return corner, normal, color, np.concatenate(face)


@dataclass(frozen=True)
class IsoSurface:
    """An isosurface of the field, shaded as meshes are.

    Examples
    --------
    >>> from resample_volume import IsoSurface
    >>> IsoSurface.of("300:opacity=0.5")
    IsoSurface(value=300.0, color=(0.6, 0.6, 0.6), opacity=0.5)
    """

    value: float  # data units
    color: tuple[float, float, float] = (GRAY, GRAY, GRAY)  # linear light
    opacity: float = 1.0

    def __post_init__(self) -> None:
        if not math.isfinite(self.value):
            raise ValueError(f"surface of {self.value}; {ISO_FORM}")
        if not 0 <= self.opacity <= 1:
            raise ValueError(f"opacity {self.opacity} of a surface; give 0 to 1")
        if find_spec("vtkmodules") is None:
            raise ValueError(
                f"the surface of {self.value:g} is found by VTK; pip install "
                "'hybrid-resample[vtk]', or show it alone by the projection first-hit"
            )

    @classmethod
    def of(cls, text: str) -> "IsoSurface":
        """Parse `300` or `300:color=ivory,opacity=0.5`.

        Raises
        ------
        ValueError
            The text is not of this form, a choice is unknown or not allowed, or VTK is missing.
        """
        number, _, rest = text.partition(":")
        color, opacity = look_of("surface", text, rest, ISO_FORM)
        try:
            value = float(number)
        except ValueError:
            raise ValueError(f"surface {text!r}; {ISO_FORM}") from None
        return cls(value, color or (GRAY, GRAY, GRAY), opacity)


AXES = "xyz"
KEYS = ("window", "colors", "opacity")
FORM = (
    "give a voxel's index along an axis (z=40) or a percentage of its extent (x=50%), or a "
    "normal and an offset from the center along it, as for clip (1,0,-1,20); and after a colon "
    "window, colors and opacity, as in z=40:window=40,400,colors=gray,opacity=0.5"
)
WINDOW = "give a center and a width, 40,400, or both end values, -160..240"
GRAYS = from_points([(0.0, (0.0,) * 3, 1.0), (1.0, (1.0,) * 3, 1.0)], normalized=True)
UNIT = Volume(np.zeros((1, 1, 1)), np.ones(3), np.zeros(3), np.eye(3), "")


@dataclass(frozen=True)
class ImagePlane:
    """A plane that shows the volume's values on it.

    Examples
    --------
    >>> from resample_volume import ImagePlane
    >>> ImagePlane.of("z=40:window=40,400,opacity=0.5")
    ImagePlane(where='z=40', window=(-160.0, 240.0), colors='gray', opacity=0.5)
    """

    # x=50%, z=40 or as `clip`; or a scene's plane n·p = d as four numbers, the last d; its window
    # is on the volume's scale
    where: str | tuple[float, float, float, float]
    window: tuple[float, float] | None = None  # values of the first and last color; None: robust
    colors: str = "gray"  # gray: linear in displayed levels; or a matplotlib colormap
    opacity: float = 1.0

    def __post_init__(self) -> None:
        if isinstance(self.where, str):
            if self.where[:1].isdigit() or self.where[:1] in ("-", "+", "."):
                planes(UNIT, None, (self.where,), "plane")  # raises an error if no volume has it
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
        return GRAYS if self.colors == "gray" else colormap(self.colors)

    @classmethod
    def of(cls, text: str) -> "ImagePlane":
        """Parse `z=40`, `x=50%:window=40,400,colors=viridis,opacity=0.5`, `1,0,-1,20`...

        Raises
        ------
        ValueError
            The text is not of this form, or a choice is unknown or not allowed.
        """
        where, _, rest = text.partition(":")
        choices, opacity = choices_of("plane", text, rest, KEYS, FORM)
        window, given = None, choices.get("window")
        if given is not None:
            by_ends = ".." in given
            try:
                one, two = map(float, given.split("..") if by_ends else parts_of(given))
            except ValueError:
                raise ValueError(f"window {given!r} of a plane; {WINDOW}") from None
            window = (one, two) if by_ends else (one - two / 2, one + two / 2)
        return cls(where, window, choices.get("colors", "gray"), opacity)

    def within(self, span: tuple[float, float]) -> "ImagePlane":
        """Return the plane with this window, if it has none."""
        low, high = span
        if self.window is not None:
            return self
        return replace(self, window=(low, high if high > low else low + 1.0))


def _place(where: str) -> tuple[int, float, bool] | None:
    """Parse x=50% to the axis (0: x), a number, and whether it is in percent; or None."""
    axis, _, text = where.partition("=")
    is_share = text.endswith("%")
    try:
        number = float(text.removesuffix("%"))
    except ValueError:
        return None
    if len(axis) != 1 or axis not in AXES or not math.isfinite(number):
        return None
    return AXES.index(axis), number, is_share


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
            # A plane perpendicular to an axis of voxels.
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
            normal = np.linalg.inv(lattice_of(volume))[axis]
            distance = float(normal @ volume.origin) + number
        else:  # given like a clip plane
            ((*normal, distance),) = planes(volume, None, (where,), "plane")
            normal, distance = np.array(normal), -distance
        length = float(np.linalg.norm(normal))
        x, y, z = (normal / length).tolist()
        where = (x, y, z, float(distance) / length)
        if not len(outline(volume, where)):
            raise ValueError(f"plane {plane.where!r} misses {volume.name}; {FORM}")
    return replace(plane, where=where)


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
    points = np.array(found)
    first = np.eye(3)[np.abs(normal).argmin()]
    right = np.cross(normal, first)
    right /= np.linalg.norm(right)
    from_middle = points - points.mean(axis=0)
    angle = np.arctan2(from_middle @ np.cross(normal, right), from_middle @ right)
    return np.asarray(points[np.argsort(angle)])


FINEST = 8  # vertices per voxel along each axis of a plane, at most
MOST = 1 << 18  # quadrangles of a plane
CHUNK = 1 << 18  # points interpolated at a time
BYTES_PER_VOXEL = 12  # bytes of VTK's input and of a surface of typical size
STEP = 1 / 16  # voxels, step of the differences for slopes
FARTHEST = 0.5  # voxels that a vertex moves per step, at most
TURNS = 3  # Newton steps, with the initial slopes
SLAB_FORM = (
    "give its center (0 is the volume's center) and thickness in scene units along the view, or "
    "along a scene direction: 20,10 or 20,10,0,0,1"
)


def plane_mesh(plane: ImagePlane, volume: Volume, field: Gathered) -> SceneMesh:
    """Make a mesh without normals, so that colors are not shaded."""
    place, face = _grid(outline(volume, plane.numbers))
    if field.known.size:  # triangles in voxels that have values
        known = field.known.reshape([count + 2 * PAD for count in field.spline.shape])
        x, y, z = np.floor(place[face].mean(axis=1) + 0.5).astype(np.int64).T + PAD
        face = face[known[z, y, x] > 0]
    color = plane.palette.colors(values_at(field, place), plane.window or (0.0, 1.0))
    corner = np.asarray(volume.origin, np.float64) + place @ field.lattice.T
    return SceneMesh(corner, np.zeros_like(corner), color.astype(np.float64), face, plane.opacity)


def values_at(field: Gathered, place: Doubles) -> Doubles:
    """Interpolate a field at points (N, 3), voxels along x, y and z, at most 1/2 outside."""
    from scipy.ndimage import map_coordinates

    spline = field.spline
    padded = [count + 2 * PAD for count in spline.shape]
    coefficient = spline.coefficient.reshape(padded)
    found = np.empty(len(place))
    for start in range(0, len(place), CHUNK):
        part = slice(start, start + CHUNK)
        at = place[part, ::-1].T + PAD
        map_coordinates(coefficient, at, found[part], order=3, prefilter=False)
    return np.clip(spline.zero + spline.scale * found, spline.floor, spline.ceiling)


def _grid(corner: Doubles) -> tuple[Doubles, NDArray[np.int64]]:
    """Triangulate a convex polygon (N, 3), voxels, by vertices (V, 3) and triangles (T, 3)."""
    if len(corner) == 4 and np.allclose(corner[0] + corner[2], corner[1] + corner[3]):
        first, right, both, down = corner
        patches = [np.array([first, right, down, both])]
    else:
        middle = corner.mean(axis=0)
        after = np.roll(corner, -1, axis=0)
        patches = [np.array([middle, middle, *pair]) for pair in zip(corner, after, strict=True)]
    # Measure the patches; corners are first, right, down and both, down and to the right
    lengths = []
    for first, right, down, both in patches:
        sides = (down - first, both - right, right - first, both - down)
        near, far, top, bottom = (float(np.linalg.norm(side)) for side in sides)
        lengths.append((max(near, far), max(top, bottom)))
    per = min(FINEST, math.sqrt(MOST / max(sum(map(math.prod, lengths)), 1e-9)))  # per voxel
    steps = np.maximum(1, np.ceil(per * np.array(lengths) - 1e-6)).astype(int)
    deepest = int(steps[:, 0].max())
    points, faces, start = [], [], 0
    for (first, right, down, both), across in zip(patches, steps[:, 1].tolist(), strict=True):
        v = np.linspace(0, 1, deepest + 1)[:, np.newaxis, np.newaxis]
        u = np.linspace(0, 1, across + 1)[np.newaxis, :, np.newaxis]
        place = (1 - v) * ((1 - u) * first + u * right) + v * ((1 - u) * down + u * both)
        number = start + np.arange(place.size // 3).reshape(deepest + 1, across + 1)
        a, b = number[:-1, :-1].ravel(), number[:-1, 1:].ravel()
        c, d = number[1:, :-1].ravel(), number[1:, 1:].ravel()
        points.append(place.reshape(-1, 3))
        faces += [np.stack([a, b, c], axis=1), np.stack([b, d, c], axis=1)]
        start += number.size
    return np.concatenate(points), np.concatenate(faces)


def surface_mesh(surface: IsoSurface, volume: Volume, field: Gathered) -> SceneMesh:
    """Extract an isosurface of the field as a mesh with its gradients as normals."""
    by = scale_named(volume.scale)
    value = surface.value if by is None else by.place(surface.value, "surface")
    check_iso(value, volume, finite_range(volume.values))
    require_memory(BYTES_PER_VOXEL * volume.values.size, f"a surface of {volume.name}")
    place, face = _corners(volume.values, value)
    # Move points onto the field's isosurface; also return slopes (V, 3), per voxel
    place = np.where(np.isfinite(place), place, 0.0)
    last = np.array(field.spline.shape[::-1]) - 0.5
    slope = _slope(place, field, last)
    steep = np.maximum((slope**2).sum(axis=1, keepdims=True), 1e-30)
    for _ in range(TURNS):
        move = (value - values_at(field, place))[:, np.newaxis] * slope / steep
        length = np.linalg.norm(move, axis=1, keepdims=True)
        move *= np.minimum(1.0, FARTHEST / np.maximum(length, 1e-30))
        place = np.clip(place + move, -0.5, last)
    slope = _slope(place, field, last)
    lattice = lattice_of(volume)
    corner = np.asarray(volume.origin, np.float64) + place @ lattice.T
    normal = slope @ np.linalg.inv(lattice)
    color = np.broadcast_to(np.asarray(surface.color, np.float64), corner.shape)
    return SceneMesh(corner, normal, color, face, surface.opacity)


def _corners(values: NDArray[Any], value: float) -> tuple[Doubles, NDArray[np.int64]]:
    """Return vertices (V, 3), voxels along x, y, z, and triangles (T, 3) of Flying Edges.

    Schroeder, Maynard, Geveci 2015. The outermost voxels extend by half a voxel, as in a field.
    """
    from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
    from vtkmodules.vtkCommonDataModel import vtkImageData
    from vtkmodules.vtkFiltersCore import vtkFlyingEdges3D

    padded = np.pad(values.astype(np.float32), 1, mode="edge")
    image = vtkImageData()
    image.SetDimensions(*padded.shape[::-1])
    image.SetOrigin(-1.0, -1.0, -1.0)
    image.GetPointData().SetScalars(numpy_to_vtk(padded.reshape(-1)))
    edges = vtkFlyingEdges3D()
    edges.SetInputData(image)
    edges.SetValue(0, value)
    edges.ComputeNormalsOff()
    edges.ComputeScalarsOff()
    edges.Update()
    found = edges.GetOutput()
    if not found.GetNumberOfPolys():
        return np.zeros((0, 3)), np.zeros((0, 3), np.int64)
    place = vtk_to_numpy(found.GetPoints().GetData()).astype(np.float64)
    face = vtk_to_numpy(found.GetPolys().GetConnectivityArray()).reshape(-1, 3).astype(np.int64)
    if values.dtype.kind == "f":
        # Keep triangles between eight voxels with values
        middle = place[face].mean(axis=1)
        x, y, z = np.floor(np.nan_to_num(middle) + 1).astype(np.int64).T
        known = np.asarray(np.isfinite(middle).all(axis=1))
        for down, along, right in np.ndindex(2, 2, 2):
            known &= np.isfinite(padded[z + down, y + along, x + right])
        face = face[known]
    last = np.array(values.shape[::-1]) - 0.5
    return np.clip(place, -0.5, last), face


def _slope(place: Doubles, field: Gathered, last: Doubles) -> Doubles:
    """Return the slopes (V, 3) of a field, per voxel."""
    found = np.empty_like(place)
    for axis in range(3):
        step = STEP * np.eye(3)[axis]
        before, after = np.maximum(place - step, -0.5), np.minimum(place + step, last)
        apart = after[:, axis] - before[:, axis]
        found[:, axis] = (values_at(field, after) - values_at(field, before)) / apart
    return found


class Section(NamedTuple):
    """The slab between two parallel planes."""

    center: float  # scene units from the volume's center, along the normal
    thickness: float  # scene units, > 0
    normal: tuple[float, float, float] | None = None  # scene direction; None: away from the eye

    @classmethod
    def of(cls, text: str) -> "Section":
        """Parse `center,thickness` or `center,thickness,nx,ny,nz`."""
        try:
            numbers = [float(part) for part in parts_of(text)]
        except ValueError:
            numbers = []
        if len(numbers) not in (2, 5) or not np.isfinite(numbers).all():
            raise ValueError(f"slab {text!r}; {SLAB_FORM}")
        center, thickness, *normal = numbers
        if not thickness > 0:
            raise ValueError(f"slab {text!r}: its thickness must be above 0; {SLAB_FORM}")
        if normal and not any(normal):
            raise ValueError(f"slab {text!r}: the normal must not be 0,0,0; {SLAB_FORM}")
        return cls(center, thickness, (normal[0], normal[1], normal[2]) if normal else None)

    @property
    def clips(self) -> tuple[str, ...]:
        """Both planes as `framing.planes` takes them; none for a slab across the view."""
        if self.normal is None:
            return ()
        near, far = self.center - self.thickness / 2, self.center + self.thickness / 2
        toward = ",".join(map(repr, self.normal))
        back = ",".join(repr(-part) for part in self.normal)
        return f"{toward},{near!r}", f"{back},{-far!r}"

    def planes(self, forward: Doubles) -> Doubles:
        """Return both planes (2, 4) around the scene's origin; without normal, along the view."""
        normal = np.asarray(forward if self.normal is None else self.normal, np.float64)
        normal = normal / np.abs(normal).max()
        normal /= np.linalg.norm(normal)
        near, far = self.center - self.thickness / 2, self.center + self.thickness / 2
        return np.array([[*normal, -near], [*-normal, far]])
