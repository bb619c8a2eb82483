"""Meshes in a volume's scene, read by trimesh, and isosurfaces; how they look."""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.colors import from_srgb
from resample.messages import choices_in
from resample.painting.meshes import mesh_of
from resample.painting.scenes.scene import check_places
from resample.reading.limits import check_file
from resample.reading.meshes import check_mesh, trimesh_resolver, unreadable
from resample.reading.native import plain
from resample.types import NO_TRIANGLES, Doubles, Triangles

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
