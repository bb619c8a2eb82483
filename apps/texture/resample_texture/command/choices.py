"""What the command line lets a user choose about a warp and a mesh; no numerics in here."""

import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

from cyclopts import Parameter
from pydantic import BaseModel, ConfigDict, Field

from resample.command.settings import height_and_width

if TYPE_CHECKING:
    from resample.cameras.models import AnyCamera
    from resample.cameras.viewpoints import Viewpoint
    from resample_texture.geometry.mappings import Geometry
    from resample_texture.mesh.rendering import Mesh

Hyphen = Parameter(allow_leading_hyphen=True)  # -1,0,0 is a value, no flag
Edges = Literal["transparent", "clamp", "wrap", "mirror"]


class Target(NamedTuple):
    """Where a picture goes."""

    geometry: "Geometry"
    shape: tuple[int, int]  # height and width, px


class Place(BaseModel):
    """Where the picture's pixels go: one of matrix, corners, map, flow and lens."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    matrix: Annotated[
        str | None,
        Hyphen,
        Field(
            description="3 x 3 homography or 2 x 3 affine map from source to target: 9 or 6 "
            "numbers, or a text or .npy file; pixel centers at + 0.5."
        ),
    ] = None
    corners: Annotated[
        str | None,
        Hyphen,
        Field(
            description="x,y of four corners: where the picture's top left, top right, bottom "
            "right and bottom left go; or four points of the source -> four of the target."
        ),
    ] = None
    map: Annotated[
        Path | None,
        Field(
            description="File of the source coordinates of every target pixel: .npy (H, W, 2), "
            ".npz with x and y, or a picture of two channels; pixel centers at + 0.5."
        ),
    ] = None
    flow: Annotated[
        Path | None,
        Field(description="File of how far every source pixel moves: .flo, or as of a map."),
    ] = None
    lens: Annotated[
        str | None,
        Hyphen,
        Field(
            description="Lens: fx,fy,cx,cy,k1,k2,p1,p2[,k3...], or a .yml, .xml, .json or .toml "
            "file of OpenCV's calibration. Its distortion is taken out."
        ),
    ] = None
    convention: Annotated[
        Literal["corner", "opencv"],
        Field(
            description="Opencv counts from the first pixel's center: in matrix, corners and map."
        ),
    ] = "corner"
    inverse: Annotated[
        bool,
        Parameter(negative=""),
        Field(description="The matrix leads from target to source; a lens distorts."),
    ] = False
    size: Annotated[
        str | None,
        Field(
            description="In px: 400 for a square, 640x480 for width and height. The source's; that "
            "of the map; what holds the corners."
        ),
    ] = None

    def target(self, source_shape: tuple[int, int]) -> Target:
        """Geometry and size for a source (height, width).

        Raises
        ------
        ValueError, OSError
            A choice cannot be worked with.
        """
        name, given = self._given()
        if name == "matrix":
            return self._by_matrix(given, source_shape)
        if name == "lens":
            return self._by_lens(given, source_shape)
        if self.inverse:
            raise ValueError(f"inverse speaks about a matrix or a lens, not about a {name}")
        if name == "corners":
            return self._by_corners(given, source_shape)
        return self._by_flow(given, source_shape) if name == "flow" else self._by_map(given)

    def check(self) -> None:
        """Refuse what can be seen to be wrong without the picture."""
        self._given()
        self._size()

    def _given(self) -> tuple[str, Any]:
        names = ("matrix", "corners", "map", "flow", "lens")
        given = [(name, getattr(self, name)) for name in names if getattr(self, name) is not None]
        if len(given) != 1:
            flags = ", ".join(f"--{name}" for name in names)
            found = " and ".join(f"--{name}" for name, _ in given) or "none"
            raise ValueError(f"give one of {flags}, not {found}")
        return given[0]

    def _size(self) -> tuple[int, int] | None:
        return None if self.size is None else height_and_width(self.size)

    def _by_matrix(self, text: str, source_shape: tuple[int, int]) -> Target:
        from resample_texture.geometry.matrices import homography, parse_matrix

        matrix = homography(parse_matrix(text), convention=self.convention, inverse=self.inverse)
        return Target(matrix, self._size() or source_shape)

    def _by_corners(self, text: str, source_shape: tuple[int, int]) -> Target:
        from resample_texture.geometry.corners import from_corners, page_corners, parse_points

        before, arrow, after = text.partition("->")
        shift = 0.5 if self.convention == "opencv" else 0.0
        points = parse_points(before) + shift
        source = points if arrow else page_corners(source_shape)
        target = parse_points(after) + shift if arrow else points
        right, bottom = target.max(axis=0)
        bounds = max(1, math.ceil(bottom)), max(1, math.ceil(right))
        return Target(from_corners(source, target), self._size() or bounds)

    def _by_map(self, path: Path) -> Target:
        from resample_texture.geometry.mappings import BackwardMap
        from resample_texture.geometry.maps import read_map

        places = read_map(path) + (0.5 if self.convention == "opencv" else 0.0)
        shape = places.shape[0], places.shape[1]
        if self._size() not in (None, shape):
            raise ValueError(
                f"{path} is a map of {shape[1]} x {shape[0]} pixels, and so is what it makes; "
                "leave out the size"
            )
        return Target(BackwardMap(places[..., 0], places[..., 1]), shape)

    def _by_flow(self, path: Path, source_shape: tuple[int, int]) -> Target:
        from resample_texture.geometry.mappings import ForwardMap
        from resample_texture.geometry.maps import read_map

        flow = ForwardMap.from_flow(read_map(path))
        if flow.x.shape != source_shape:
            raise ValueError(
                f"{path} is a flow of {flow.x.shape[1]} x {flow.x.shape[0]} pixels, the picture "
                f"has {source_shape[1]} x {source_shape[0]}"
            )
        return Target(flow, self._size() or source_shape)

    def _by_lens(self, text: str, source_shape: tuple[int, int]) -> Target:
        from resample.cameras.lens_files import read_lens
        from resample_texture.geometry.lenses import distorting, undistorting

        camera, shape = read_lens(text), self._size() or source_shape
        return Target((distorting if self.inverse else undistorting)(camera, shape), shape)


class Warping(BaseModel):
    """How a picture is warped."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    method: Annotated[
        str,
        Field(description="How: such as hybrid, paper, bilinear or opencv-supersample:n=8."),
    ] = "hybrid"
    filter: Annotated[
        str | None, Field(description="Pixel filter, such as gaussian:sigma=0.6. The method's.")
    ] = None
    interpolation: Annotated[
        str | None,
        Field(description="Between texels: nearest, bilinear, catmull-rom, spline, gaussian."),
    ] = None
    quality: Annotated[
        float | None,
        Field(description="Parts that pixels are cut into per px of the target, 1 to 16."),
    ] = None
    edge: Annotated[Edges, Field(description="What lies beyond the picture's edges.")] = (
        "transparent"
    )
    linear: Annotated[
        bool, Field(description="Filter light; otherwise values as they are encoded.")
    ] = True
    total: Annotated[
        bool,
        Parameter(negative=""),
        Field(description="Values are totals, such as a flux: keep their sum, not their mean."),
    ] = False
    threads: Annotated[
        int | None, Field(ge=1, description="At most this many; pixels do not depend on it.")
    ] = None

    def check(self) -> None:
        """Refuse names that nobody knows, before any work is done.

        Raises
        ------
        ValueError, LookupError
            A plugin is unknown or refuses its parameters.
        """
        from resample import registry

        registry.build("methods", self.method)
        if self.filter is not None:
            registry.build("filters", self.filter)
        if self.interpolation is not None:
            registry.build("interpolations", self.interpolation)


class MeshView(BaseModel):
    """How a mesh is seen."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    camera: Annotated[
        str,
        Hyphen,
        Field(
            description="Where from: azimuth/elevation/zoom, such as 30/20/1.5, or a file of "
            "cameras."
        ),
    ] = "30/20/1"
    fov: Annotated[
        float, Field(description="Degrees along the shorter side; 0 is parallel projection.")
    ] = 30.0
    up: Annotated[
        Literal["x", "y", "z", "-x", "-y", "-z"],
        Hyphen,
        Field(description="Axis that points upwards."),
    ] = "y"
    shading: Annotated[bool, Field(description="Light surfaces: from the eye.")] = False

    def placed(self, mesh: "Mesh", size: tuple[int, int]) -> "AnyCamera":
        """Camera for a picture (height, width) of a mesh.

        Raises
        ------
        ValueError
            These are not a camera's numbers.
        """
        from resample.cameras.viewpoints import camera_from
        from resample_texture.mesh.rendering import ball_around

        return camera_from(self.viewpoint(), ball_around(mesh), *size)

    def viewpoint(self) -> "Viewpoint":
        """Where the mesh is seen from.

        Raises
        ------
        ValueError, LookupError, OSError
            The camera is none; see `resample.cameras.files.viewpoint`.
        """
        from resample.cameras.files import viewpoint

        return viewpoint(self.camera, self.fov, self.up)


def region(text: str | None) -> tuple[int, int, int, int] | None:
    """Left, top, width and height of a text like 10,20,300,200.

    Raises
    ------
    ValueError
        These are not four whole numbers.
    """
    if text is None:
        return None
    match = re.fullmatch(r"\s*(\d+)[,\s]+(\d+)[,\s]+(\d+)[,\s]+(\d+)\s*", text, re.ASCII)
    if match is None:
        raise ValueError(f"roi {text!r}; give left,top,width,height in whole px, such as 0,0,64,64")
    left, top, width, height = (int(number) for number in match.groups())
    return left, top, width, height
