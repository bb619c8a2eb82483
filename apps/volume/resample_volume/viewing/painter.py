"""Pictures of a volume for a page: paint, save and film, pick, slice and measure."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from resample import registry
from resample.command.settings import PictureFormat, Resampling, chosen
from resample.console import Color
from resample.files.animations import write_film
from resample.files.conversion import levels_of
from resample.files.saving import screen_levels, write_frame
from resample.measuring.color_bars import with_color_bar
from resample.outofcore.passes import Memo, memoizing
from resample.progress import Cancel, Progress, progress_here
from resample.resampler import Resampler
from resample.scene import Quality
from resample.types import Floats, Frame
from resample.view.files import path_file
from resample.view.views import (
    KEYFRAMES,
    PagePicture,
    Point,
    Settings,
    Size,
    keyframes_as_toml,
    projection_of,
)
from resample_volume.annotations import annotated, bar_of, measure
from resample_volume.appearance import Appearance, VolumeLayer, named_transfer, transfer_of
from resample_volume.classification.scales import value_at
from resample_volume.classification.transfer import Transfer
from resample_volume.classification.value_statistics import survey
from resample_volume.command.animation import (
    FrameOptions,
    FrameOverlay,
    cameras_of,
    flight_of,
    shots,
)
from resample_volume.command.choices import AppearanceChoices, BesideFilm
from resample_volume.editing import points_of, spelled
from resample_volume.picking import Picked
from resample_volume.rendering import Subject
from resample_volume.scenes import Scene
from resample_volume.slicing import profile, slice_levels, slice_planes
from resample_volume.types import Volume
from resample_volume.voxels.framing import centered
from resample_volume.voxels.visible import unit_of

if TYPE_CHECKING:
    from resample.cameras.models import AnyCamera


SHOWN = (AppearanceChoices, Resampling, BesideFilm, PictureFormat)  # options that a page changes
STILL = AppearanceChoices()
STEERED = ("camera", "fov", "up", "fit")  # options that only move the camera
MOST_COMPARED = 2  # looks that are kept
VTK = "VTK"  # another renderer of the same
RATE, FILMED = 24.0, ".mp4"  # as the command writes, frames per second


class VolumeRequest(NamedTuple):
    """A request, parsed from options."""

    choices: AppearanceChoices
    layers: list[VolumeLayer]  # of the volume and those beside it
    resampler: Resampler
    beside: BesideFilm
    picture: PictureFormat


def entry_of(volume: Volume, look: Appearance) -> dict[str, Any]:
    """Return the name of a volume and the colors that it has, as a page's legend takes them."""
    points = points_of(transfer_of(volume, look), survey(volume).span)
    shown = dict.fromkeys(color for _, color, opacity in points if opacity > 0)
    return {"name": volume.name, "colors": list(shown) or ["#808080"]}


def own_look(
    look: AppearanceChoices, volume: Volume, transfer: Transfer | str | None, resampler: Resampler
) -> Appearance:
    """Return the look of one of several volumes, with its own transfer function.

    One that is a text is spread over the window of the look; the window of others is their own.
    """
    if transfer is None or isinstance(transfer, str):
        named = {} if transfer is None else {"transfer": transfer}
        return look.model_copy(update=named).appearance(volume, resampler)
    look = look.model_copy(update={"window": None})
    if look.opacity_unit is not None:
        transfer = replace(transfer, opacity_unit=look.opacity_unit)
    found = look.model_copy(update={"transfer": "auto"}).appearance(volume, resampler)
    return replace(found, transfer=transfer)


@dataclass
class VolumePainter:
    """Pictures of a volume for one page.

    `volume`: without padding. `first`: transfer function of a channel; None: the volume has that of
    the options. `others`: volumes that are shown together with it, each with its transfer function.
    """

    volume: Volume
    first: Transfer | str | None = None
    others: Sequence[tuple[Volume, Transfer | str]] = ()
    _scene: Scene = field(init=False)
    _resamplers: dict[Resampler, Resampler] = field(default_factory=dict)  # which keep tables
    _found: Memo = field(default_factory=dict)
    _layers: dict[Any, list[VolumeLayer]] = field(default_factory=dict)  # of the last requests
    _picks: tuple[Picked, ...] = ()  # the last picks, from which the next is measured
    _vtk: Any = None  # VTK's renderer, once it was asked for

    def __post_init__(self) -> None:
        self._scene = Scene(self.volume)

    def __copy__(self) -> "VolumePainter":
        """Painter of another page, with the same volume and a scene of its own."""
        return VolumePainter(self.volume, self.first, self.others)

    def parsed(self, settings: Settings) -> VolumeRequest:
        """Return the request that options make.

        Raises ValueError, LookupError, OSError: an option is not allowed, or a file of one cannot
        be read.
        """
        look, resampling, beside, picture = chosen(settings, SHOWN)
        resampler = look.renderer(resampling, self.volume.scale)
        resampler = self._resamplers.setdefault(resampler, resampler)
        # The look of the voxels is kept while only the camera moves.
        still = {name: getattr(STILL, name) for name in STEERED}
        key = look.model_copy(update=still), resampler, beside.mesh, beside.plane, beside.surface
        layers = self._layers.get(key)
        if layers is None:
            bare = look.model_copy(update={"labels": None, "label": ()})
            with memoizing(self._found):
                first = own_look(look, self.volume, self.first, resampler)
                others = [(one, own_look(bare, one, own, resampler)) for one, own in self.others]
            first = beside.scene_objects(look, resampler).beside(first)
            layers = [(self.volume, first), *others]
            before = list(self._layers.items())[1 - MOST_COMPARED :]
            self._layers = {**dict(before), key: layers}  # replaced whole: picks ask meanwhile
        return VolumeRequest(look, layers, resampler, beside, picture)

    def paint(self, settings: Settings, size: Size, *, quick: bool, cancel: Cancel) -> PagePicture:
        """Render with these options, see `resample.view.views.Painter`."""
        request = self.parsed(settings)
        quality: Quality = "preview" if quick else "final"
        frame = self._frame(request, size, ".png", quality, cancel)
        behind = request.picture.behind(".png")
        levels = levels_of(frame, "color", background=behind)
        # Over the right of the picture, so that pixels stay in place
        right = levels.shape[1]
        for light in reversed(self._bars(request, frame, behind)):
            bar = screen_levels(light, background=behind)[..., : levels.shape[2]]
            if right >= bar.shape[1]:
                levels[:, right - bar.shape[1] : right] = bar
                right -= bar.shape[1]
        # The projection from points around the volume's center, scene units, to pixels.
        camera, volume = self._placed_view(request, size, quality)
        view = projection_of(camera.view(), size, centered(volume)[1])
        legend = {} if quick else {"legend": [entry_of(*layer) for layer in request.layers]}
        return PagePicture(levels, quick, {"view": view, **legend, **self._range(request)})

    def _range(self, request: VolumeRequest) -> dict[str, Any]:
        """Return the ends of the window that channels share, for pages that drag it."""
        if not isinstance(self.first, str):
            return {}
        points = points_of(transfer_of(*request.layers[0]), survey(self.volume).span)
        return {"range": {"ends": [points[0][0], points[-1][0]], "option": "window"}}

    def check(self, settings: Settings) -> None:
        """Reject options that are not allowed; errors as of `frame`."""
        self.parsed(settings).choices.viewpoint()

    def save(self, settings: Settings, size: Size, path: Path) -> None:
        """Write the picture as the command does."""
        behind = self.parsed(settings).picture.behind(path.suffix)
        write_frame(path, self.frame(settings, size, path.suffix), 8, behind)

    def frame(self, settings: Settings, size: Size, suffix: str = ".png") -> Frame:
        """Render as the command does for a file of this suffix, but without background.

        Raises ValueError, LookupError, OSError: an option is not allowed, or a file of one cannot
        be read.
        """
        request = self.parsed(settings)
        frame, behind = self._frame(request, size, suffix), request.picture.behind(suffix)
        for bar in self._bars(request, frame, behind):
            frame = frame._replace(rgba=with_color_bar(frame.rgba, bar, behind))
        return frame

    def _bars(self, request: VolumeRequest, frame: Frame, behind: Color | None) -> list[Floats]:
        """Return the color bars (H, B, 4) of a picture, one per volume, if they are wanted."""
        if not request.beside.color_bar:
            return []
        tone = self._scene.tone(request.layers, request.resampler, request.choices.fit)
        return [
            bar_of(layer, request.resampler, len(frame.rgba), behind, tone, frame)
            for layer in request.layers
        ]

    def _frame(
        self,
        request: VolumeRequest,
        size: Size,
        suffix: str,
        quality: Quality = "final",
        cancel: Cancel | None = None,
    ) -> Frame:
        """Render the picture for a file of this suffix."""
        view = request.choices.viewpoint()
        choices: dict[str, Any] = {"resampler": request.resampler, "fit": request.choices.fit}
        choices["progress"] = progress_here()
        frame = self._scene.render(
            request.layers, view, size=size, quality=quality, cancel=cancel, **choices
        )
        marks = request.beside.annotations(request.picture.behind(suffix))
        if not marks.is_any:
            return frame
        camera, volume = self._placed_view(request, size)
        return annotated(frame, camera, volume, marks)

    def beside(self, rival: str, settings: Settings, size: Size) -> PagePicture:
        """Render with VTK, see `resample.view.views.Comparing`."""
        if rival != VTK:
            raise ValueError(f"{rival!r:.40} is not known; a page can compare with {VTK}")
        request = self.parsed(settings)
        camera, volume = self._placed_view(request, size)
        self._vtk = self._vtk or registry.load("peers", VTK)()
        light = self._vtk.picture(volume, request.layers[0][1], request.resampler, camera, size)
        return PagePicture(screen_levels(light, background=request.picture.behind(".png")), False)

    def keyframes(self, cameras: Sequence[str], settings: Settings) -> str:
        """Return a file of cameras around the volume, see `resample.view.views.Filming`."""
        return keyframes_as_toml(cameras, settings)

    def film(
        self, settings: Settings, size: Size, keyframes: str, path: Path, progress: Progress
    ) -> None:
        """Write a film through keyframes as `animate` does, see `resample.view.views.Filming`."""
        request, (width, height) = self.parsed(settings), size
        with path_file(KEYFRAMES, keyframes) as file:
            flight = flight_of(str(file), None, RATE, request.choices.viewpoint())
        subject = Subject.of_several(request.layers, request.resampler, request.choices.fit)
        behind = request.picture.behind(FILMED) or (0.0, 0.0, 0.0)
        given = request.beside.annotations(behind)
        layers = request.layers if request.beside.color_bar else []
        bars = [bar_of(one, request.resampler, height, behind, subject.tone) for one in layers]
        is_any = given.is_any or bars
        drawn = FrameOverlay(subject.placed(self.volume), given, bars) if is_any else None
        paint = FrameOptions(request.resampler, (height, width), behind, None, drawn)
        cameras = cameras_of(subject, flight, paint.size)
        write_film(path, shots(subject, cameras, paint), RATE, progress=progress)

    def _placed_view(
        self, request: VolumeRequest, size: Size, quality: Quality = "final"
    ) -> "tuple[AnyCamera, Volume]":
        """Return the camera and the volume placed before it."""
        return self._scene.placed_view(
            *(request.layers, request.choices.viewpoint()),
            size=size,
            resampler=request.resampler,
            quality=quality,
            fit=request.choices.fit,
        )

    def pick(self, settings: Settings, size: Size, x: float, y: float) -> dict[str, Any]:
        """Return the voxel visible at a point, see `resample.view.views.Painter`.

        Also tells the distance from the last pick and the angle at that to the one before; a pick
        beside the volume resets this.
        """
        request = self.parsed(settings)
        found = self._scene.pick(
            *(x, y, request.layers, request.choices.viewpoint()),
            size=size,
            resampler=request.resampler,
            fit=request.choices.fit,
        )
        if found is None:
            self._picks = ()
            return {}
        self._picks = picks = (*self._picks[-2:], found)
        told = {
            "voxel": "{2}, {1}, {0}".format(*found.voxel),  # along x, y and z
            "value": f"{found.value:.6g}",
            "position": ", ".join(f"{part:.6g}" for part in found.position),
        }
        if len(picks) > 1:
            length = measure(*picks[-2:], volume=self.volume)
            told["distance"] = f"{length.distance:.6g} {length.unit}".rstrip()
            if len(picks) == 3 and length.distance and measure(*picks[:2]).distance:
                told["angle"] = f"{measure(*picks).angle:.4g}°"
        return told

    def slice(
        self,
        size: Size,
        plane: str,
        voxel: tuple[int, int, int],
        window: tuple[float, float] | None,
    ) -> PagePicture:
        """Return a slice, see `resample.view.views.Slicing`."""
        found = {one.name: one for one in slice_planes(self.volume)}.get(plane)
        if found is None:
            raise ValueError(f"slice {plane!r:.40}; give axial, coronal or sagittal")
        count = self.volume.values.shape[::-1]
        if not all(0 <= n < most for n, most in zip(voxel, count, strict=True)):
            raise ValueError(f"voxel {voxel} of {count}; give indices from 0")
        levels = slice_levels(self.volume, found, voxel[found.across], size, window)
        value = float(value_at(self.volume.values[voxel[::-1]], self.volume.scale))
        return PagePicture(levels, False, {"value": f"{value:.6g}"})

    def measure(self, start: Point, end: Point) -> dict[str, Any]:
        """Return values along a line, see `resample.view.views.Slicing`."""
        found = profile(self.volume, start, end)
        values = [value if np.isfinite(value) else None for value in found.values.tolist()]
        return {"distance": found.distance, "unit": found.unit, "values": values}

    def tell(self, settings: Settings, what: str) -> dict[str, Any]:
        """`points` of the look, see `resample.view.views.Knowing`."""
        if what != "points":
            raise ValueError(f"{what!r:.40} is not known; a page can ask for points")
        request, volume = self.parsed(settings), self.volume
        name, projection = request.choices.transfer, request.resampler.projection
        transfer, span = transfer_of(volume, request.layers[0][1], projection), survey(volume).span
        points = [
            (float(value_at(place, volume.scale)), color, opacity)
            for place, color, opacity in points_of(transfer, span)
        ]
        try:  # whether a window spreads the look; others are in data units already
            named_transfer(name, volume, projection, span)
            is_windowed = True
        except ValueError:
            is_windowed = False
        return {
            "points": points,
            "transfer": spelled(points),
            "unit": transfer.opacity_unit,
            "usual": unit_of(named_transfer(name, volume, projection), volume),
            "windowed": is_windowed,
        }
