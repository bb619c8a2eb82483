"""VTK's fixed-point ray caster with our camera and transfer function, for comparison.

How settings are matched:

Camera
    VTK's camera has the same pose (its y points up, so "up" is our −y). The view angle is vertical,
    2 atan(H / 2f); a principal point off the middle is VTK's window center, (W − 2 cx) / W and
    (2 cy − H) / H. A parallel camera has the parallel scale H / 2s. Both cast rays through the
    centers of pixels. VTK only has square pixels.
Transfer function
    Tables of colors and opacities over the data's range: one entry per value where these are whole
    numbers and few, `ENTRIES` otherwise. Both classify after interpolation. Colors are passed in
    linear light, so VTK composites and averages in linear light, as we do. Opacities hold for the
    transfer function's unit, or a voxel.
Light
    The coefficients of `Light`, the light at the viewer or in a direction, Blinn's highlight. In
    homogeneous regions VTK shows only the ambient part; ours shades as if facing the light.
Antialiasing
    N × N rays per pixel are a picture N times as large, averaged in linear light.

Remaining differences: VTK interpolates linearly between 8 voxels, values of 8 bits in whole steps;
it ends at the outermost voxels' centers, ends a ray at an opacity of 99.2 %, ignores the volume's
direction, and computes in 15 bits. Pictures are read from the mapper's own 15-bit image, before a
window would round them to 8 bits.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.cameras.models import AnyCamera
from resample.painting.choices import Projection
from resample.reading.native import suppressed_output
from resample.types import Doubles, Floats, View
from resample_volume.classification.transfer import Transfer
from resample_volume.types import Volume
from resample_volume.voxels.shading import Light
from resample_volume.voxels.visible import finite_range

ENTRIES = 4096  # of the tables of colors and opacities
FULL = 32767  # of 15 bits
LARGEST_WINDOW = 16384  # px, side
BLENDS = {
    Projection.COMPOSITE: "Composite",
    Projection.MAXIMUM: "MaximumIntensity",
    Projection.MINIMUM: "MinimumIntensity",
}


@dataclass(frozen=True)
class Peer:
    """Options of VTK's renderer.

    Raises ValueError: a number is outside its range.
    """

    step: float = 1.0  # sample distance on a ray, voxels (cube roots of a voxel's volume)
    rays: int = 1  # per side of a pixel
    light: Light | None = None  # None: colors as they are
    # Number of threads at most; None: all. With a light, VTK's pictures depend slightly on it.
    threads: int | None = None
    # Composite, maximum or minimum, which its CPU ray caster supports.
    projection: Projection = Projection.COMPOSITE

    def __post_init__(self) -> None:
        if not 0 < self.step < np.inf:
            raise ValueError(f"a sample distance of {self.step} voxels; it must be above 0")
        if not 1 <= self.rays <= 64:
            raise ValueError(f"{self.rays} rays per side of a pixel; 1 to 64 are allowed")
        if self.threads is not None and self.threads < 1:
            raise ValueError(f"{self.threads} threads; give 1 or more, or None for all")
        if self.projection not in BLENDS:
            raise ValueError(
                f"VTK's CPU ray caster has no projection {self.projection}; it has "
                + ", ".join(BLENDS)
            )


DEFAULT = Peer()


class _Stage(NamedTuple):
    """VTK's objects; they refer to each other by pointers, and Python owns them here."""

    window: Any
    renderer: Any
    mapper: Any
    volume: Any


class VtkRenderer:
    """A VTK window with one volume, for successive frames.

    Parameters
    ----------
    volume
        Without missing values, its axes along the scene's.
    transfer
        Colors and opacities.
    height, width
        Of the pictures, px.
    look
        Options.

    Raises
    ------
    ValueError
        VTK is not installed, or cannot render this volume or size.
    """

    def __init__(
        self,
        volume: Volume,
        transfer: Transfer,
        *,
        height: int,
        width: int,
        look: Peer = DEFAULT,
    ) -> None:
        if height < 1 or width < 1 or max(height, width) * look.rays > LARGEST_WINDOW:
            raise ValueError(
                f"a picture of {width} x {height} pixels at {look.rays} x {look.rays} rays; both"
                f" sides times the rays must be 1 to {LARGEST_WINDOW}"
            )
        if not np.allclose(volume.direction, np.eye(3), atol=1e-9):
            raise ValueError(
                f"{volume.name} is rotated or mirrored, which VTK's CPU ray caster ignores; give"
                " it a volume with the identity as direction"
            )
        if min(volume.values.shape) < 2:
            raise ValueError(f"{volume.name} is flat; VTK needs 2 voxels along each axis")
        if volume.values.dtype.kind == "f" and not np.isfinite(volume.values).all():
            raise ValueError(
                f"{volume.name} has missing values, which VTK draws as opaque; fill them first"
            )
        if transfer.needs_gradient:
            raise ValueError(
                "VTK's CPU ray caster has no functions of value and gradient; give one of values "
                "alone"
            )
        self._size, self._rays = (height, width), look.rays
        last = np.array(volume.values.shape[::-1]) - 1
        ends = np.stack(np.meshgrid(*np.stack([last * 0, last], axis=1)), axis=-1).reshape(-1, 3)
        self._corners: Doubles = volume.origin + ends * volume.spacing
        try:
            with suppressed_output():  # VTK warns about the missing display, and works without
                self._stage = _staged(volume, transfer, look)
                self._stage.window.SetSize(width * look.rays, height * look.rays)
        except ImportError as error:
            raise ValueError(
                f"VTK is not installed ({error}); pip install 'hybrid-resample[peers]'"
            ) from None

    def draw(self, camera: AnyCamera) -> None:
        """Let VTK draw a frame into its window; this is timed."""
        window, renderer, mapper, _ = self._stage
        _aim(renderer, camera.view(), self._size, self._corners)
        mapper.GetRayCastImage().ClearImage()  # one outside the view would leave the last frame
        with suppressed_output():
            window.Render()

    def render(self, camera: AnyCamera) -> Floats:
        """Render a picture (H, W, 4), premultiplied RGBA in linear light; errors as in `draw`."""
        self.draw(camera)
        fine = _read(self._stage.mapper.GetRayCastImage(), self._size, self._rays)
        height, width = self._size
        parts = fine.reshape(height, self._rays, width, self._rays, 4)
        return np.asarray(parts.mean(axis=(1, 3), dtype=np.float64) / FULL, np.float32)


def _staged(volume: Volume, transfer: Transfer, look: Peer) -> _Stage:
    """Set up everything but the camera."""
    import vtkmodules.vtkRenderingOpenGL2  # draws into windows
    import vtkmodules.vtkRenderingVolumeOpenGL2  # noqa: F401  shows what the CPU has rendered
    from vtkmodules.vtkRenderingCore import vtkRenderer, vtkRenderWindow, vtkVolume
    from vtkmodules.vtkRenderingVolume import vtkFixedPointVolumeRayCastMapper

    mapper, prop = vtkFixedPointVolumeRayCastMapper(), vtkVolume()
    voxel = float(np.cbrt(np.prod(volume.spacing)))
    mapper.SetInputData(image_of(volume))
    mapper.AutoAdjustSampleDistancesOff()
    mapper.IntermixIntersectingGeometryOff()
    mapper.SetSampleDistance(look.step * voxel)
    mapper.SetImageSampleDistance(1.0)
    getattr(mapper, f"SetBlendModeTo{BLENDS[look.projection]}")()
    if look.threads is not None:
        mapper.SetNumberOfThreads(look.threads)
    prop.SetMapper(mapper)
    _dress(prop.GetProperty(), volume, transfer, look.light)
    renderer, window = vtkRenderer(), vtkRenderWindow()
    renderer.SetBackground(0.0, 0.0, 0.0)
    renderer.AddVolume(prop)
    if look.light is not None:
        renderer.AddLight(_lamp(look.light.direction))
    window.SetOffScreenRendering(1)
    window.SetMultiSamples(0)
    window.AddRenderer(renderer)
    return _Stage(window, renderer, mapper, prop)


def image_of(volume: Volume) -> Any:
    """Convert a volume to VTK's image data."""
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonDataModel import vtkImageData

    image = vtkImageData()
    image.SetDimensions(*volume.values.shape[::-1])
    image.SetSpacing(*map(float, volume.spacing))
    image.SetOrigin(*map(float, volume.origin))
    native = volume.values.dtype.newbyteorder("=")
    values = np.ascontiguousarray(volume.values, native).ravel()
    image.GetPointData().SetScalars(numpy_to_vtk(values, deep=True))
    return image


def _dress(prop: Any, volume: Volume, transfer: Transfer, light: Light | None) -> None:
    """Set transfer function and light of a volume's property."""
    from vtkmodules.vtkCommonDataModel import vtkPiecewiseFunction
    from vtkmodules.vtkRenderingCore import vtkColorTransferFunction

    low, high = data_range = finite_range(volume.values)
    if low == high:
        high = low + 1.0
    whole = volume.values.dtype.kind in "iu" and high - low < ENTRIES
    table = np.linspace(low, high, int(high - low) + 1 if whole else ENTRIES)
    color, opacity = transfer.classify(table, None, data_range, 1.0)
    colors, opacities = vtkColorTransferFunction(), vtkPiecewiseFunction()
    ends = (float(table[0]), float(table[-1]), table.size)
    colors.BuildFunctionFromTable(*ends, color.ravel().tolist())
    opacities.BuildFunctionFromTable(*ends, opacity.tolist())
    voxel = float(np.cbrt(np.prod(volume.spacing)))
    prop.SetColor(colors)
    prop.SetScalarOpacity(opacities)
    prop.SetScalarOpacityUnitDistance(transfer.opacity_unit or voxel)
    prop.SetInterpolationTypeToLinear()
    if light is not None:
        prop.ShadeOn()
        prop.SetAmbient(light.ambient)
        prop.SetDiffuse(light.diffuse)
        prop.SetSpecular(light.specular)
        prop.SetSpecularPower(light.shininess)


def _lamp(direction: tuple[float, float, float] | None) -> Any:
    """Make a distant white light in a scene direction, or at the viewer."""
    from vtkmodules.vtkRenderingCore import vtkLight

    lamp = vtkLight()
    lamp.SetAmbientColor(1.0, 1.0, 1.0)  # without it there is no ambient light
    lamp.SetLightTypeToHeadlight()
    if direction is not None:
        lamp.SetLightTypeToSceneLight()
        lamp.SetPosition(*direction)
        lamp.SetFocalPoint(0.0, 0.0, 0.0)
    return lamp


def _aim(renderer: Any, view: View, size: tuple[int, int], corners: Doubles) -> None:
    """Set VTK's camera to ours; see the top of this file."""
    if not np.isclose(view.focal[0], view.focal[1], rtol=1e-9, atol=0.0):
        raise ValueError(
            f"pixels of {1 / view.focal[0]:g} x {1 / view.focal[1]:g}; VTK's are square"
        )
    height, width = size
    rotation, scale = view.rotation, float(view.focal[1])
    depth = corners @ rotation[2] + view.translation[2]
    margin = 1e-3 * float(np.ptp(depth))
    near, far = _clipped(view, float(depth.min()) - margin, float(depth.max()) + margin)
    eye = -rotation.T @ view.translation
    camera = renderer.GetActiveCamera()
    camera.SetParallelProjection(not view.perspective)
    camera.SetPosition(*eye)
    camera.SetFocalPoint(*(eye + rotation[2] * (far - min(near, 0.0))))
    camera.SetViewUp(*-rotation[1])
    camera.SetViewAngle(float(np.degrees(2 * np.arctan(height / (2 * scale)))))
    camera.SetParallelScale(height / (2 * scale))
    x, y = view.principal
    camera.SetWindowCenter(float(width - 2 * x) / width, float(2 * y - height) / height)
    camera.SetClippingRange(near, far)


def _clipped(view: View, nearest: float, farthest: float) -> tuple[float, float]:
    """Return the clipping range for a volume between two depths."""
    if not view.perspective:
        near = max(nearest, view.near)
        return near, max(farthest, near + 1e-3)
    far = max(farthest, 1e-3)
    return max(nearest, view.near, 1e-4 * far), far


def _read(image: Any, size: tuple[int, int], rays: int) -> NDArray[np.uint16]:
    """Read the mapper's picture (H × rays, W × rays, 4) of 15 bits, top row first."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonCore import vtkUnsignedShortArray

    height, width = size[0] * rays, size[1] * rays
    picture = np.zeros((height, width, 4), np.uint16)
    stride, rows = image.GetImageMemorySize()
    used_width, used_height = image.GetImageInUseSize()
    if not (used_width and used_height and stride):
        return picture
    memory = vtkUnsignedShortArray()
    memory.SetNumberOfComponents(4)
    memory.SetVoidArray(image.GetImage(), stride * rows * 4, 1)
    left, bottom = image.GetImageOrigin()
    used = vtk_to_numpy(memory).reshape(rows, stride, 4)[:used_height, :used_width]
    picture[bottom : bottom + used_height, left : left + used_width] = used
    return picture[::-1]
