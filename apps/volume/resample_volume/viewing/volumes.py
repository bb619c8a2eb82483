"""Pages of a volume: paint, save and film, pick, slice and measure; and pictures without a page."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from resample import registry
from resample.cameras.models import AnyCamera
from resample.command.settings import PictureFormat, Resampling, chosen, height_and_width, option_of
from resample.console import Color
from resample.files.animations import write_film
from resample.files.conversion import levels_of
from resample.files.saving import screen_levels, write_frame
from resample.measuring.color_bars import with_color_bar
from resample.outofcore.passes import Memo, memoizing
from resample.profiles.orders import Rays
from resample.progress import Cancel, Progress, progress_here
from resample.registry import missing, names
from resample.resampler import Resampler
from resample.scene import LITTLE, Quality
from resample.types import Floats, Frame
from resample.view import views
from resample.view.files import FileView, path_file
from resample_volume.annotations import annotated, bar_of, measure
from resample_volume.appearance import Appearance, VolumeLayer, named_transfer, transfer_of
from resample_volume.calls import render
from resample_volume.classification import PRESETS, TISSUES
from resample_volume.classification.scales import scale_named, value_at
from resample_volume.classification.transfer import Transfer, points_of, spelled
from resample_volume.classification.value_statistics import survey
from resample_volume.command.animation import (
    FrameOptions,
    cameras_of,
    flight_of,
    overlaid,
    shots,
)
from resample_volume.command.choices import Added, AppearanceChoices, FilmExtras, ReadOptions
from resample_volume.command.inputs import channel_transfers, media, of_first_channel, prepared
from resample_volume.data.recordings import SeveralChannelsError, unit_of_space
from resample_volume.data.values import as_array
from resample_volume.rendering import Subject
from resample_volume.scenes import Scene
from resample_volume.slicing import profile, slice_levels, slice_planes
from resample_volume.types import Picked, Volume
from resample_volume.voxels.framing import centered
from resample_volume.voxels.visible import lattice_of, unit_of

SHOWN = (AppearanceChoices, Resampling, FilmExtras, PictureFormat)  # options that a page changes
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
    extras: FilmExtras
    picture: PictureFormat

    @property
    def view(self) -> dict[str, Any]:
        """Arguments of the scene's methods."""
        view, paint, fit = self.choices.viewpoint(), self.resampler, self.choices.fit
        return {"look": self.layers, "camera": view, "resampler": paint, "fit": fit}


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
    """Pictures of a volume without padding, or of several, for one page."""

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

    def parsed(self, settings: views.Settings) -> VolumeRequest:
        """Return the request that options make; errors as in the command."""
        look, resampling, extras, picture = chosen(settings, SHOWN)
        resampler = look.renderer(resampling, self.volume.scale)
        resampler = self._resamplers.setdefault(resampler, resampler)
        # The look of the voxels is kept while only the camera moves.
        still = {name: getattr(STILL, name) for name in STEERED}
        key = look.model_copy(update=still), resampler, extras.mesh, extras.plane, extras.surface
        layers = self._layers.get(key)
        if layers is None:
            bare = look.model_copy(update={"labels": None, "label": ()})
            with memoizing(self._found):
                first = own_look(look, self.volume, self.first, resampler)
                others = [(one, own_look(bare, one, own, resampler)) for one, own in self.others]
            first = replace(first, **extras.scene_objects(look, resampler))
            layers = [(self.volume, first), *others]
            before = list(self._layers.items())[1 - MOST_COMPARED :]
            self._layers = {**dict(before), key: layers}  # replaced whole: picks ask meanwhile
        return VolumeRequest(look, layers, resampler, extras, picture)

    def paint(
        self, settings: views.Settings, size: views.Size, *, quick: bool, cancel: Cancel
    ) -> views.PagePicture:
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
        view = views.projection_of(camera.view(), size, centered(volume)[1])
        told: dict[str, Any] = {"view": view}
        if not quick:  # a legend of volumes and the colors that they have
            told["legend"] = entries = []
            for one, look in request.layers:
                points = points_of(transfer_of(one, look), survey(one).span)
                shown = dict.fromkeys(color for _, color, opacity in points if opacity > 0)
                entries.append({"name": one.name, "colors": list(shown) or ["#808080"]})
        if isinstance(self.first, str):  # the window that channels share, for pages that drag it
            points = points_of(transfer_of(*request.layers[0]), survey(self.volume).span)
            told["range"] = {"ends": [points[0][0], points[-1][0]], "option": "window"}
        return views.PagePicture(levels, quick, told)

    def check(self, settings: views.Settings) -> None:
        """Reject options that are not allowed; errors as in `frame`."""
        self.parsed(settings).choices.viewpoint()

    def save(self, settings: views.Settings, size: views.Size, path: Path) -> None:
        """Write the picture as the command does."""
        behind = self.parsed(settings).picture.behind(path.suffix)
        write_frame(path, self.frame(settings, size, path.suffix), 8, behind)

    def frame(self, settings: views.Settings, size: views.Size, suffix: str = ".png") -> Frame:
        """Render as the command does for a file of this suffix, without background."""
        request = self.parsed(settings)
        frame, behind = self._frame(request, size, suffix), request.picture.behind(suffix)
        for bar in self._bars(request, frame, behind):
            frame = frame._replace(rgba=with_color_bar(frame.rgba, bar, behind))
        return frame

    def _bars(self, request: VolumeRequest, frame: Frame, behind: Color | None) -> list[Floats]:
        """Return the color bars (H, B, 4) of a picture, one per volume, if they are wanted."""
        if not request.extras.color_bar:
            return []
        tone = self._scene.tone(request.layers, request.resampler, request.choices.fit)
        words = (request.resampler, len(frame.rgba), behind, tone, frame)
        return [bar_of(layer, *words) for layer in request.layers]

    def _frame(
        self, request: VolumeRequest, size: views.Size, suffix: str, quality: Quality = "final",
        cancel: Cancel | None = None,
    ) -> Frame:  # fmt: skip
        """Render the picture for a file of this suffix."""
        watched: dict[str, Any] = {"cancel": cancel, "progress": progress_here()}
        frame = self._scene.render(size=size, quality=quality, **watched, **request.view)
        marks = request.extras.annotations(request.picture.behind(suffix))
        if not marks.is_any:
            return frame
        camera, volume = self._placed_view(request, size)
        return annotated(frame, camera, volume, marks)

    def beside(self, rival: str, settings: views.Settings, size: views.Size) -> views.PagePicture:
        """Render with VTK, see `resample.view.views.Comparing`."""
        if rival != VTK:
            raise ValueError(f"{rival!r:.40} is not known; a page can compare with {VTK}")
        request = self.parsed(settings)
        camera, volume = self._placed_view(request, size)
        self._vtk = self._vtk or registry.load("peers", VTK)()
        light = self._vtk.picture(volume, request.layers[0][1], request.resampler, camera, size)
        levels = screen_levels(light, background=request.picture.behind(".png"))
        return views.PagePicture(levels, False)

    def keyframes(self, cameras: Sequence[str], settings: views.Settings) -> str:
        """Return a file of cameras around the volume, see `resample.view.views.Filming`."""
        return views.keyframes_as_toml(cameras, settings)

    def film(
        self, settings: views.Settings, size: views.Size, keyframes: str, path: Path,
        progress: Progress,
    ) -> None:  # fmt: skip
        """Write a film through keyframes as `animate` does, see `resample.view.views.Filming`."""
        request, (width, height) = self.parsed(settings), size
        with path_file(views.KEYFRAMES, keyframes) as file:
            flight = flight_of(str(file), None, RATE, request.choices.viewpoint())
        subject = Subject.of_several(request.layers, request.resampler, request.choices.fit)
        behind = request.picture.behind(FILMED) or (0.0, 0.0, 0.0)
        paint = FrameOptions(request.resampler, (height, width), behind)
        paint = overlaid(paint, request.extras, request.layers, subject)
        cameras = cameras_of(subject, flight, paint.size)
        write_film(path, shots(subject, cameras, paint), RATE, progress=progress)

    def _placed_view(
        self, request: VolumeRequest, size: views.Size, quality: Quality = "final"
    ) -> tuple[AnyCamera, Volume]:
        """Return the camera and the volume placed before it."""
        return self._scene.placed_view(size=size, quality=quality, **request.view)

    def pick(
        self, settings: views.Settings, size: views.Size, x: float, y: float
    ) -> dict[str, Any]:
        """Return the voxel at a point, its distance and angle to the last picks."""
        found = self._scene.pick(x, y, size=size, **self.parsed(settings).view)
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
        self, size: views.Size, plane: str, voxel: tuple[int, int, int],
        window: tuple[float, float] | None,
    ) -> views.PagePicture:  # fmt: skip
        """Return a slice, see `resample.view.views.Slicing`."""
        found = {one.name: one for one in slice_planes(self.volume)}.get(plane)
        if found is None:
            raise ValueError(f"slice {plane!r:.40}; give axial, coronal or sagittal")
        count = self.volume.values.shape[::-1]
        if not all(0 <= n < most for n, most in zip(voxel, count, strict=True)):
            raise ValueError(f"voxel {voxel} of {count}; give indices from 0")
        levels = slice_levels(self.volume, found, voxel[found.across], size, window)
        value = float(value_at(self.volume.values[voxel[::-1]], self.volume.scale))
        return views.PagePicture(levels, False, {"value": f"{value:.6g}"})

    def measure(self, start: views.Point, end: views.Point) -> dict[str, Any]:
        """Return values along a line, see `resample.view.views.Slicing`."""
        distance, along = profile(self.volume, start, end)
        values = [value if np.isfinite(value) else None for value in along.tolist()]
        return {"distance": distance, "unit": unit_of_space(self.volume), "values": values}

    def tell(self, settings: views.Settings, what: str) -> dict[str, Any]:
        """`points` of the look, see `resample.view.views.Knowing`."""
        if what != "points":
            raise ValueError(f"{what!r:.40} is not known; a page can ask for points")
        request, volume = self.parsed(settings), self.volume
        name, projection = request.choices.transfer, request.resampler.projection
        transfer, span = transfer_of(volume, request.layers[0][1], projection), survey(volume).span
        placed, by = points_of(transfer, span), volume.scale
        points = [(float(value_at(at, by)), color, opacity) for at, color, opacity in placed]
        told = {"points": points, "transfer": spelled(points), "unit": transfer.opacity_unit}
        told["usual"] = unit_of(named_transfer(name, volume, projection), volume)
        told["windowed"] = False
        with suppress(ValueError):  # a window spreads the look, unless it is in data units already
            named_transfer(name, volume, projection, span)
            told["windowed"] = True
        return told


BINS = 256  # of a histogram
COMMAND, FILM = "resample-volume render", "resample-volume animate"
NAMED = {"order": "orders", "filter": "filters", "kernel": "reconstructions"}  # plugins of options
LEFT_OUT = (
    *("reader", "shape", "dtype", "endian", "spacing", "level", "units", "time"),
    *("channel", "channels", "scale", "size", "bits", "deep", "zoom-in"),
)
KINDS: Sequence[views.Settings] = (  # with kernels of their own
    {"classify": "pre"},  # also of previews
    {"projection": "maximum"},
    {"projection": "average"},
    {"projection": "first-hit", "iso": LITTLE / 2},
)


def volume_view(
    name: str, source: ReadOptions | None = None, begin: Sequence[Any] = (),
    added: Added | None = None,
) -> FileView:  # fmt: skip
    """Return a volume's pages: reading options, additional inputs, initial options."""
    first, source = painter_of(name, source or ReadOptions(), begin, added or Added())
    volume, is_own = first.volume, first.first is None

    def described() -> dict[str, Any]:
        settings = {"fit": "volume", "camera": "30,20,1", **views.settings_of(begin)}
        first.check(settings)
        known, absence = survey(volume), missing("peers", VTK)
        if not absence and find_spec("vtkmodules") is None:
            absence = "VTK is not installed: pip install 'hybrid-resample[peers]'"
        if first.others:
            absence = "VTK gets a single volume; open the page without the others"
        size = volume.values.shape[::-1]
        return {
            "title": volume.name,
            "subtitle": f"{' × '.join(map(str, size))}, {volume.values.dtype}",
            "command": COMMAND,
            "film": {"command": FILM, **views.ORBITING},
            "package": "resample_volume",
            "inputs": [name],
            "fixed": views.settings_of([source, *([] if added is None else [added])]),
            "settings": settings,
            "fills": views.is_free(begin),
            "rivals": {VTK: absence},
            "names": {
                "transfer": [*PRESETS, *(TISSUES if known.units.added is not None else ())],
                **{option: names(group) for option, group in NAMED.items()},
            },
            "box": {
                "voxels": size,
                "lattice": lattice_of(volume).tolist(),
                "middle": centered(volume)[1].tolist(),
            },
            "slices": [asdict(plane) for plane in slice_planes(volume)],
            "spacing": np.asarray(volume.spacing).tolist(),
            "unit": unit_of_space(volume),
            "measures": True,
            **({"histogram": histogram(volume, known.span)} if is_own else {}),
        }

    def little() -> VolumePainter:
        values = np.resize(np.arange(LITTLE), (LITTLE,) * 3).astype(volume.values.dtype)
        return VolumePainter(volume._replace(values=values))

    left_out = LEFT_OUT if is_own else (*LEFT_OUT, "transfer")
    left_out = left_out if is_own or isinstance(first.first, str) else (*left_out, "window")
    return FileView(first, described, first.check, KINDS, left_out, little)


def painter_of(
    name: str, source: ReadOptions, begin: Sequence[Any], added: Added
) -> tuple[VolumePainter, ReadOptions]:
    """Return the painter of a volume, or of several; and how the first is read."""
    look = next((one for one in begin if isinstance(one, AppearanceChoices)), AppearanceChoices())
    try:
        if not (added.also or added.channels):
            return VolumePainter(prepared(source, name)), source
    except SeveralChannelsError:  # the file may name their looks
        pass
    try:
        shown = media(source, name, look, added, Resampler(order=Rays()))
    except SeveralChannelsError:
        if added.also:
            raise
        volume, source = of_first_channel(source, lambda chosen: prepared(chosen, name))
        return VolumePainter(volume), source
    (volume, transfer), *others = [(as_array(one), transfer_of(one, own)) for one, own in shown]
    in_channels = added.channels or len(others) > len(added.also)
    if added.channels and not added.also:
        own, *rest = channel_transfers(added.channels)
        beside = [(one, text) for (one, _), text in zip(others, rest, strict=True)]
        return VolumePainter(volume, own, beside), source
    return VolumePainter(volume, transfer if in_channels else None, others), source


def histogram(volume: Volume, span: tuple[float, float]) -> dict[str, Any]:
    """Return the histogram of values in the robust range."""
    low, high = span
    values = np.asarray(volume.values)
    count, _ = np.histogram(values[np.isfinite(values)], BINS, (low, max(high, low + 1e-30)))
    by = scale_named(volume.scale)
    scale = {} if by is None else {"scale": "log" if by.linear is None else "symlog"}
    linear = {} if by is None or by.linear is None else {"linear": by.linear}
    return {"low": low, "high": high, "counts": count.tolist(), **scale, **linear}


def picture(volume: str, settings: Mapping[str, Any]) -> Frame:
    """Render a volume with the options of `resample-volume render`.

    Parameters
    ----------
    volume
        As the command takes it.
    settings
        Options by name, as settings files have them: `{"transfer": "bone", "size": "640x480"}`.

    Raises
    ------
    ValueError, LookupError, OSError
        As in the command.

    Examples
    --------
    >>> picture("checker-box:size=16", {"camera": "top", "size": "32x24"})
    Frame(32 × 24 px, 25.5 % covered, depth from 54.9)
    """
    given = {option: value for option, value in settings.items() if option not in ("size", "bits")}
    height, width = height_and_width(str(settings.get("size", "400")))
    if not given.keys() & {"also", "channels"}:
        with suppress(SeveralChannelsError):  # the file may name their looks
            return render(volume, size=(width, height), **{"camera": None, **given})
    fields = ((model, key) for model in (ReadOptions, Added) for key in model.model_fields)
    of_inputs = {option_of(*each) for each in fields}
    inputs = {option: given.pop(option) for option in of_inputs & given.keys()}
    source, added = chosen(inputs, (ReadOptions, Added))
    begin = chosen(given, SHOWN)
    painter, _ = painter_of(volume, source, begin, added)
    return painter.frame(given, (width, height), ".exr").over(begin[-1].behind(".exr"))
