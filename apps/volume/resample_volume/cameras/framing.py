"""Cameras around a volume."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

from resample_volume.types import Volume

if TYPE_CHECKING:
    from resample.cameras.models import Camera
    from resample.types import Doubles, Floats, View
    from resample_volume.voxels.fields import FieldVoxels
    from resample_volume.voxels.visible import Voxels


FARTHEST = 1e15  # scene units from the origin; its square, in px, is still a float32
ROW = 512  # places looked at together
AXES = ("x", "y", "z", "-x", "-y", "-z")


@dataclass(frozen=True)
class Orbit:
    """A camera on a sphere around the middle of what is visible.

    Parameters
    ----------
    azimuth, elevation
        Degrees; see `resample.cameras.models.orbit`.
    zoom
        At 1 the sphere around all visible voxels just fits the picture; at 2 the camera is at half
        the distance, and a parallel one shows everything at twice the size.
    fov
        Degrees along the picture's shorter side; 0 is parallel projection.
    up
        Axis that points upwards: x, y, z, -x, -y or -z.

    Raises
    ------
    ValueError
        The zoom is not between 1e-6 and 1e6, the field of view is not in 0 to 180, an angle is not
        finite, or `up` is no axis.
    """

    azimuth: float = 30.0
    elevation: float = 20.0
    zoom: float = 1.0
    fov: float = 30.0
    up: str = "z"

    def __post_init__(self) -> None:
        if not 1e-6 <= self.zoom <= 1e6:  # beyond, float32 has no digits left
            raise ValueError(f"a zoom of {self.zoom:g}; it must be above 0, 1e-06 to 1e+06")
        if not 0 <= self.fov < 180:
            raise ValueError(f"a field of view of {self.fov} degrees; 0 to below 180 are allowed")
        if not abs(self.azimuth) + abs(self.elevation) < float("inf"):
            raise ValueError(
                f"azimuth {self.azimuth}, elevation {self.elevation}; both must be finite"
            )
        if self.up not in AXES:
            raise ValueError(f"up is {self.up!r}; it can be {', '.join(AXES)}")

    def around(self, sphere: "Sphere", height: int, width: int) -> "Camera":
        """Camera for a picture of that size in px."""
        import numpy as np

        from resample.cameras.models import Orthographic, Pinhole, orbit

        center, radius = sphere
        if self.fov == 0:
            scale = min(height, width) / (2 * radius) * self.zoom
            pose = orbit(center, 2 * radius, self.azimuth, self.elevation, self.up)
            return Orthographic(scale, scale, width / 2, height / 2, pose)
        distance = radius / np.sin(np.radians(self.fov) / 2) / self.zoom
        pose = orbit(center, distance, self.azimuth, self.elevation, self.up)
        return Pinhole.from_fov(self.fov, height=height, width=width, world_to_camera=pose)


class Sphere(NamedTuple):
    """A ball that holds what is to be seen."""

    center: "Doubles"  # (3,) scene units
    radius: float  # scene units, > 0


def sphere_around(voxels: "Voxels | FieldVoxels", volume: Volume) -> Sphere:
    """Ball around all visible voxels, or around the volume where none is visible.

    Raises
    ------
    ValueError
        It is larger than float32 can reckon with.
    """
    import numpy as np

    voxel = float(np.linalg.norm(voxels.lattice, axis=0).max())
    position = voxels.position
    if not position.size:
        last = np.array(volume.values.shape[::-1]) - 1
        ends = volume.origin + np.stack([last * 0, last]) @ voxels.lattice.T
        position = ends.astype(np.float32)
    low, high = _bounds(position)
    if not np.abs([low, high]).max() < FARTHEST:
        raise ValueError(
            f"the volume reaches from {low} to {high} scene units; {FARTHEST:g} is the most, so "
            "give another spacing"
        )
    center = (low + high) / 2
    away = position - center.astype(np.float32)
    farthest = float(np.sqrt(np.einsum("nd,nd->n", away, away).max()))
    return Sphere(center, farthest + voxel)


def _bounds(position: "Floats") -> "tuple[Doubles, Doubles]":
    """Least and greatest coordinates of places (N, 3); in two steps, as NumPy likes long rows."""
    import numpy as np

    whole = len(position) // ROW * ROW
    some = position[whole:]
    if whole:
        rows = position[:whole].reshape(-1, 3 * ROW)
        ends = [end.reshape(-1, 3) for end in (rows.min(axis=0), rows.max(axis=0))]
        some = np.concatenate([some, *ends])
    return some.min(axis=0).astype(np.float64), some.max(axis=0).astype(np.float64)


@dataclass(frozen=True)
class Spot:
    """A camera at a place in the scene, for a picture of any size."""

    eye: Sequence[float]  # (3,) scene units
    target: Sequence[float]  # (3,) scene units
    up: Sequence[float]  # (3,)
    fov: float  # degrees along the picture's shorter side
    near: float  # scene units

    def sized(self, height: int, width: int) -> "Camera":
        """Camera for a picture of that size in px."""
        from resample.cameras.models import Pinhole, look_at

        pose = look_at(self.eye, self.target, self.up)
        return Pinhole.from_fov(
            self.fov, height=height, width=width, world_to_camera=pose, near=self.near
        )


Viewpoint: TypeAlias = "Orbit | Spot | Camera"


@dataclass(frozen=True, eq=False)
class Shifted:
    """A camera in a scene whose origin was moved to `origin`, (3,) in the camera's own scene."""

    camera: "Camera"
    origin: "Doubles"

    def view(self) -> "View":
        view = self.camera.view()
        return view._replace(translation=view.translation + view.rotation @ self.origin)


def centered(volume: Volume) -> "tuple[Volume, Doubles]":
    """Volume around the scene's origin, and where its middle was, (3,) scene units.

    Far from the origin, float32 would not tell neighbouring voxels apart.
    """
    import numpy as np

    last = np.array(volume.values.shape[::-1]) - 1.0
    half = volume.direction @ (volume.spacing * last) / 2
    return volume._replace(origin=-half), volume.origin + half


def parse_camera(text: str, fov: float, up: str) -> Viewpoint:
    """Camera from `azimuth/elevation/zoom`, of which the last may be left out, or from a file.

    Raises
    ------
    ValueError
        The text is neither, or the file's content is no camera.
    OSError
        The file cannot be read.
    """
    if text.lower().endswith(".toml"):
        from resample_volume.cameras.files import read_camera

        return read_camera(Path(text))
    parts = text.split("/")
    try:
        numbers = [float(part) for part in parts]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 3):
        raise ValueError(
            f"camera {text!r}; give azimuth/elevation/zoom, such as 30/20/1.5, of which the zoom "
            "may be left out, or a .toml file"
        )
    return Orbit(numbers[0], numbers[1], numbers[2] if len(numbers) == 3 else Orbit.zoom, fov, up)
