"""Fine rays, closed forms, and the peer of volumes."""

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.scores.judging import AbsentError, Floats
from benchmarks.scores.kernels.fine_rays import FIELD, cast
from benchmarks.scores.pictures import View
from benchmarks.scores.volume_files import Spacing, Values

Points = Sequence[tuple[float, float]]  # value and opacity

POINTS: Points = ((40, 0.0), (70, 0.15), (110, 0.05), (160, 0.35), (255, 0.8))


def unit_of(spacing: Spacing) -> float:
    """Length to which opacities refer: a voxel's."""
    return float(np.cbrt(np.prod(spacing)))


def fine(
    values: Values,
    spacing: Spacing,
    view: View,
    size: int,
    rays: int,
    points: Points,
    *,
    kind: int = FIELD,
    step: float = 0.125,
) -> Floats:
    """Alpha (H, W) by own rays through the trilinear field, or through a formula.

    `rays` are those along a side of a pixel, `step` is in voxels.
    """
    extent = np.array(values.shape[::-1]) * spacing
    middle = (np.array(values.shape[::-1]) - 1) / 2 * spacing
    reach, away = np.linalg.norm(extent) / 2, np.linalg.norm(view.eye - middle)
    at, opacity = (np.ascontiguousarray(each) for each in np.array(points, float).T)
    unit, out = unit_of(spacing), np.zeros((size, size))
    cast(
        *(kind, values, np.array(spacing, float), view.eye, np.ascontiguousarray(view.turn)),
        *(view.focal, np.array(view.center, float), rays, at, opacity),
        *(unit, step * unit, float(away - reach), float(away + reach), out),
    )
    return out


def ball(
    shape: tuple[int, int, int], spacing: Spacing, radius: float, slope: float = 50
) -> NDArray[np.int16]:
    """Values (Z, Y, X) that fall linearly with the distance: 0 at the surface of a ball."""
    z, y, x = ((np.arange(n) - (n - 1) / 2) * s for n, s in zip(shape, spacing[::-1], strict=True))
    distance = np.sqrt(z[:, None, None] ** 2 + y[:, None] ** 2 + x**2)
    return np.asarray(np.rint(slope * (radius - distance)), np.int16)


def wall_area(tilt: float, level: float = 0.505) -> float:
    """Area, voxels, of the trilinear wall of 1 x 20 x 20 voxels above a level.

    It is seen along (sin tilt, cos tilt, 0), degrees.
    """
    turn = np.radians(tilt)
    across, along = np.arange(-16, 16, 0.004), np.arange(-16, 16, 0.02)
    x = across[:, None] * np.cos(turn) + along * np.sin(turn)
    y = -across[:, None] * np.sin(turn) + along * np.cos(turn)
    most = (np.clip(1 - np.abs(x), 0, 1) * np.clip(10.5 - np.abs(y), 0, 1)).max(1)
    height = 19 + 2 * (1 - level / np.maximum(most, level))
    return float(np.where(most > level, height, 0).sum() * 0.004)


class Vtk:
    """VTK's ray caster on the CPU: one thread, one ray per pixel, steps of a voxel.

    Raises
    ------
    AbsentError
        VTK is not installed.
    """

    def __init__(self, values: Values, spacing: Spacing, points: Points, size: int) -> None:
        try:
            import vtkmodules.vtkRenderingOpenGL2
            import vtkmodules.vtkRenderingVolumeOpenGL2  # noqa: F401  shows what the CPU rendered
            from vtkmodules import vtkCommonCore, vtkCommonDataModel, vtkRenderingCore
            from vtkmodules.util.numpy_support import numpy_to_vtk
            from vtkmodules.vtkRenderingVolume import vtkFixedPointVolumeRayCastMapper
        except ImportError as error:
            raise AbsentError("VTK is not installed") from error
        vtkCommonCore.vtkObject.GlobalWarningDisplayOff()
        grid = vtkCommonDataModel.vtkImageData()
        grid.SetDimensions(*values.shape[::-1])
        grid.SetSpacing(*spacing)
        self.values = numpy_to_vtk(np.ascontiguousarray(values).ravel(), deep=True)
        grid.GetPointData().SetScalars(self.values)

        opacity = vtkCommonDataModel.vtkPiecewiseFunction()
        for value, alpha in points:
            opacity.AddPoint(value, alpha)
        color, look = (
            vtkRenderingCore.vtkColorTransferFunction(),
            vtkRenderingCore.vtkVolumeProperty(),
        )
        color.AddRGBPoint(0, 1, 1, 1)
        look.SetColor(color)
        look.SetScalarOpacity(opacity)
        look.SetInterpolationTypeToLinear()
        look.SetScalarOpacityUnitDistance(unit_of(spacing))

        mapper, volume = vtkFixedPointVolumeRayCastMapper(), vtkRenderingCore.vtkVolume()
        mapper.SetInputData(grid)
        mapper.SetNumberOfThreads(1)
        mapper.SetAutoAdjustSampleDistances(0)
        mapper.SetImageSampleDistance(1)
        mapper.SetSampleDistance(unit_of(spacing))
        volume.SetMapper(mapper)
        volume.SetProperty(look)

        self.size, self.renderer = size, vtkRenderingCore.vtkRenderer()
        self.window = vtkRenderingCore.vtkRenderWindow()
        self.renderer.AddVolume(volume)
        self.window.SetOffScreenRendering(1)
        self.window.SetMultiSamples(0)
        self.window.AddRenderer(self.renderer)
        self.window.SetSize(size, size)

    def __call__(self, view: View) -> tuple[Floats, float]:
        """Alpha (H, W) and CPU s of the second of two pictures."""
        from vtkmodules.util.numpy_support import vtk_to_numpy
        from vtkmodules.vtkRenderingCore import vtkWindowToImageFilter

        camera: Any = self.renderer.GetActiveCamera()
        camera.SetPosition(*view.eye)
        camera.SetFocalPoint(*(view.eye + view.turn[2]))
        camera.SetViewUp(*-view.turn[1])
        camera.SetViewAngle(np.degrees(2 * np.arctan(self.size / 2 / view.focal)))
        x, y = (2 * (c - self.size / 2) / self.size for c in view.center)
        camera.SetWindowCenter(-x, y)
        self.renderer.ResetCameraClippingRange()
        took = 0.0
        for _ in range(2):
            start = time.process_time()
            self.window.Render()
            took = time.process_time() - start
        shot = vtkWindowToImageFilter()
        shot.SetInput(self.window)
        shot.ReadFrontBufferOff()
        shot.Update()
        rows = vtk_to_numpy(shot.GetOutput().GetPointData().GetScalars())
        return rows.reshape(self.size, self.size, -1)[::-1, :, 0] / 255, took
