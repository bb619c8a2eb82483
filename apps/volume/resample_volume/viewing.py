"""Interactive page of a volume: `resample-volume view`, and `picture` without a page."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from resample.command.settings import PictureFormat, Resampling
from resample.files.animations import write_film
from resample.files.exchange import levels_of
from resample.files.saving import screen_levels, write_frame
from resample.files.stores.opening import is_address
from resample.outofcore.caching import Memo, memoizing
from resample.painting.choices import Projection
from resample.registry import names
from resample.resampler import Resampler
from resample.scene.scenes import LITTLE, Quality
from resample.types import Frame
from resample.view.exports import KEYFRAMES, ORBITING, keyframes_as_toml
from resample.view.files import FileView, path_file
from resample.view.views import (
    PagePicture,
    Point,
    Settings,
    Size,
    chosen,
    is_free,
    projection_of,
    settings_of,
)
from resample.watching import Cancel, Progress
from resample_volume.classification import PRESETS, TISSUES
from resample_volume.classification.scales import scale_named, value_at
from resample_volume.classification.surveys import survey
from resample_volume.command.animation import FrameOptions, cameras_of, drawing, flight_of, shots
from resample_volume.command.choices import AppearanceChoices, Beside, ReadOptions
from resample_volume.command.inputs import prepared
from resample_volume.editing import points_of, spelled
from resample_volume.files.generated import GENERATED
from resample_volume.files.source import find_reader
from resample_volume.inputs import as_volume
from resample_volume.media.appearance import Appearance, named_transfer, transfer_of
from resample_volume.picking import Picked
from resample_volume.rendering import Subject
from resample_volume.scenes import Scene
from resample_volume.slicing import profile, slice_levels, slice_planes
from resample_volume.space.annotations import annotated
from resample_volume.space.lines import measure, unit_of_space
from resample_volume.types import Volume
from resample_volume.voxels.framing import centered
from resample_volume.voxels.visible import lattice_of, unit_of

if TYPE_CHECKING:
    from resample.cameras.models import AnyCamera
    from resample.view.widgets import Viewer
    from resample_volume.figures.compare import VtkBeside

VTK = "VTK"  # other renderers of the same
COMMAND, FILM = "resample-volume render", "resample-volume animate"
FILMED, RATE = ".mp4", 24.0  # as the command writes, frames per second
NAMED = {"order": "orders", "filter": "filters", "kernel": "reconstructions"}  # plugins of options
SHOWN = (
    AppearanceChoices,
    Resampling,
    Beside,
    PictureFormat,
)  # models of options that a page changes
LEFT_OUT = (
    *("reader", "shape", "dtype", "endian", "spacing", "level", "units", "time"),
    *("channel", "channels", "scale", "size", "bits", "color-bar", "deep", "zoom-in"),
)
STILL, STEERED = (
    AppearanceChoices(),
    ("camera", "fov", "up", "fit"),
)  # options that only move the camera
BINS = 256
KINDS: Sequence[Settings] = (  # with kernels of their own
    {"classify": "pre"},  # also of previews
    {"projection": "maximum"},
    {"projection": "average"},
    {"projection": "first-hit", "iso": LITTLE / 2},
)
MOST_COMPARED = 2  # that are compared


class _VolumeRequest(NamedTuple):
    """A request, parsed from options."""

    choices: AppearanceChoices
    appearance: Appearance
    resampler: Resampler
    beside: Beside
    picture: PictureFormat


@dataclass
class VolumePainter:
    """Pictures of a volume for one page.

    Parameters
    ----------
    volume
        Without padding.
    """

    volume: Volume
    _scene: Scene = field(init=False)
    _resamplers: dict[Resampler, Resampler] = field(default_factory=dict)  # which keep tables

    _found: Memo = field(default_factory=dict)
    _appearances: dict[Any, Appearance] = field(default_factory=dict)  # the last request
    _picks: tuple[Picked, ...] = ()  # the last picks, from which the next is measured
    _vtk: "VtkBeside | None" = None

    def __post_init__(self) -> None:
        self._scene = Scene(self.volume)

    def __copy__(self) -> "VolumePainter":
        """Painter of another page, with the same volume and a scene of its own."""
        return VolumePainter(self.volume)

    def paint(self, settings: Settings, size: Size, *, quick: bool, cancel: Cancel) -> PagePicture:
        """Render with these options, see `resample.view.views.Painter`."""
        request = self._request(settings)
        quality: Quality = "preview" if quick else "final"
        frame = self._frame(request, size, ".png", quality, cancel)
        levels = levels_of(frame, "color", background=request.picture.behind(".png"))
        return PagePicture(levels, quick, {"view": self._view(request, size, quality)})

    def _view(self, request: _VolumeRequest, size: Size, quality: Quality) -> dict[str, Any]:
        """Return the projection from points around the volume's center, scene units, to pixels."""
        camera, volume = self._placed_view(request, size, quality)
        return projection_of(camera.view(), size, centered(volume)[1])

    def check(self, settings: Settings) -> None:
        """Reject options that are not allowed; errors as of `frame`."""
        self._request(settings).choices.viewpoint()

    def save(self, settings: Settings, size: Size, path: Path) -> None:
        """Write the picture as the command does."""
        request = self._request(settings)
        frame = self._frame(request, size, path.suffix)
        write_frame(path, frame, 8, request.picture.behind(path.suffix))

    def frame(self, settings: Settings, size: Size) -> Frame:
        """Render as the command does for a PNG, but without background.

        Raises ValueError, LookupError, OSError: an option is not allowed, or a file of one cannot
        be read.
        """
        return self._frame(self._request(settings), size, ".png")

    def _frame(
        self,
        request: _VolumeRequest,
        size: Size,
        suffix: str,
        quality: Quality = "final",
        cancel: Cancel | None = None,
    ) -> Frame:
        """Render the picture for a file of this suffix."""
        view = request.choices.viewpoint()
        choices: dict[str, Any] = {"resampler": request.resampler, "fit": request.choices.fit}
        frame = self._scene.render(
            request.appearance, view, size=size, quality=quality, cancel=cancel, **choices
        )
        marks = request.beside.annotations(request.picture.behind(suffix))
        if not marks.is_any:
            return frame
        camera, volume = self._placed_view(request, size)
        return annotated(frame, camera, volume, marks)

    def beside(self, rival: str, settings: Settings, size: Size) -> PagePicture:
        """Render with VTK, see `resample.view.views.Comparing`."""
        from resample_volume.figures.compare import VtkBeside

        if rival != VTK:
            raise ValueError(f"{rival!r:.40} is not known; a page can compare with {VTK}")
        request = self._request(settings)
        camera, volume = self._placed_view(request, size)
        self._vtk = self._vtk or VtkBeside()
        light = self._vtk.picture(volume, request.appearance, request.resampler, camera, size)
        return PagePicture(screen_levels(light, background=request.picture.behind(".png")), False)

    def keyframes(self, cameras: Sequence[str], settings: Settings) -> str:
        """Return a file of cameras around the volume, see `resample.view.views.Filming`."""
        return keyframes_as_toml(cameras, settings)

    def film(
        self, settings: Settings, size: Size, keyframes: str, path: Path, progress: Progress
    ) -> None:
        """Write a film through keyframes as `animate` does, see `resample.view.views.Filming`."""
        request, (width, height) = self._request(settings), size
        with path_file(KEYFRAMES, keyframes) as file:
            flight = flight_of(str(file), None, RATE, request.choices.viewpoint())
        medium = self.volume, request.appearance
        subject = Subject.of_several([medium], request.resampler, request.choices.fit)
        behind = request.picture.behind(FILMED) or (0.0, 0.0, 0.0)
        drawn = drawing(self.volume, subject, request.beside.annotations(behind))
        paint = FrameOptions(request.resampler, (height, width), behind, None, drawn)
        cameras = cameras_of(subject, flight, paint.size)
        write_film(path, shots(subject, cameras, paint), RATE, progress=progress)

    def _placed_view(
        self, request: _VolumeRequest, size: Size, quality: Quality = "final"
    ) -> "tuple[AnyCamera, Volume]":
        """Return the camera and the volume placed before it."""
        return self._scene.placed_view(
            *(request.appearance, request.choices.viewpoint()),
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
        request = self._request(settings)
        found = self._scene.pick(
            *(x, y, request.appearance, request.choices.viewpoint()),
            size=size,
            resampler=request.resampler,
            fit=request.choices.fit,
        )
        if found is None:
            self._picks = ()
            return {}
        self._picks = picks = (*self._picks[-2:], found)
        return {
            "voxel": "{2}, {1}, {0}".format(*found.voxel),  # along x, y and z
            "value": f"{found.value:.6g}",
            "position": ", ".join(f"{part:.6g}" for part in found.position),
            **_measured(picks, self.volume),
        }

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
        request = self._request(settings)
        transfer = transfer_of(self.volume, request.appearance, request.resampler.projection)
        points = [
            (float(value_at(place, self.volume.scale)), color, opacity)
            for place, color, opacity in points_of(transfer, survey(self.volume).span)
        ]
        name, projection = request.choices.transfer, request.resampler.projection
        return {
            "points": points,
            "transfer": spelled(points),
            "unit": transfer.opacity_unit,
            "usual": unit_of(named_transfer(name, self.volume, projection), self.volume),
            "windowed": self._takes_window(name, projection),
        }

    def _takes_window(self, name: str, projection: Projection) -> bool:
        """Return whether a window spreads a look; others are in data units already."""
        try:
            named_transfer(name, self.volume, projection, survey(self.volume).span)
        except ValueError:
            return False
        return True

    def _request(self, settings: Settings) -> _VolumeRequest:
        look, resampling, beside, picture = chosen(settings, SHOWN)
        resampler = look.renderer(resampling, self.volume.scale)
        resampler = self._resamplers.setdefault(resampler, resampler)
        appearance = self._appearance(look, resampler, beside)
        return _VolumeRequest(look, appearance, resampler, beside, picture)

    def _appearance(
        self, look: AppearanceChoices, resampler: Resampler, beside: Beside
    ) -> Appearance:
        """Return the look of the voxels, cached while only the camera moves."""
        still = {name: getattr(STILL, name) for name in STEERED}
        key = look.model_copy(update=still), resampler, beside.mesh, beside.plane, beside.surface
        appearance = self._appearances.get(key)
        if appearance is None:
            with memoizing(self._found):
                appearance = look.appearance(self.volume, resampler)
            appearance = beside.scene_objects(look, resampler).beside(appearance)
            before = list(self._appearances.items())[
                1 - MOST_COMPARED :
            ]  # replaced whole: picks ask meanwhile
            self._appearances = {**dict(before), key: appearance}
        return appearance


def volume_view(
    name: str, source: ReadOptions | None = None, begin: Sequence[Any] = ()
) -> FileView:
    """Return what pages show of a volume, which they share.

    `name`: of the volume, as the command takes it. `source`: how it is read. `begin`: options to
    begin with.
    """
    source = source or ReadOptions()
    first = VolumePainter(prepared(source, name))
    volume = first.volume

    def described() -> dict[str, Any]:
        settings = {"fit": "volume", "camera": "30,20,1", **settings_of(begin)}
        first.check(settings)
        known = survey(volume)
        size = volume.values.shape[::-1]
        return {
            "title": volume.name,
            "subtitle": f"{' × '.join(map(str, size))}, {volume.values.dtype}",
            "command": COMMAND,
            "film": {"command": FILM, **ORBITING},
            "package": "resample_volume",
            "inputs": [name],
            "fixed": settings_of([source]),
            "settings": settings,
            "fills": is_free(begin),
            "rivals": {VTK: _absence()},
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
            "histogram": _histogram(volume, known.span),
        }

    def little() -> VolumePainter:
        values = np.resize(np.arange(LITTLE), (LITTLE,) * 3).astype(volume.values.dtype)
        return VolumePainter(volume._replace(values=values))

    return FileView(first, described, first.check, KINDS, LEFT_OUT, little)


def view(volume: Any, /, **settings: Any) -> "Viewer":
    """Show a volume in a notebook: rotate it, change its look, copy the view as Python.

    Parameters
    ----------
    volume
        What `as_volume` takes. Anything but a file or a name is written to a temporary file, which
        lives as long as the widget.
    settings
        Options of `resample-volume render` to begin with: `transfer="bone"`, `opacity_unit=2`.

    Returns
    -------
    Widget with `settings`, `frame` and `to_python()`; needs the extra `notebook`.

    Raises
    ------
    ValueError, LookupError, OSError, TypeError
        An option is not allowed, or the volume cannot be read.

    Examples
    --------
    >>> from resample_volume import view
    >>> shown = view("checker-box:size=16", camera="top")
    >>> shown.settings["camera"]
    'top'
    """
    from resample.view import widgets

    file, folder = widgets.kept("volume.nrrd", volume, _write)
    named = widgets.named(settings)
    of_source = {key: named.pop(key) for key in list(named) if key in ReadOptions.model_fields}
    (source,) = chosen(of_source, (ReadOptions,))
    return widgets.Viewer(volume_view(file, source), named, folder)


def _write(path: Path, volume: Any) -> None:
    """Write what `as_volume` takes."""
    from resample_volume.files.source import write_volume

    write_volume(path, as_volume(volume, "volume"))


def _measured(picks: Sequence[Picked], volume: Volume) -> dict[str, str]:
    """Return the length and angle between the last two or three picked voxels."""
    if len(picks) < 2:
        return {}
    length = measure(*picks[-2:], volume=volume)
    told = {"distance": f"{length.distance:.6g} {length.unit}".rstrip()}
    if len(picks) == 3 and length.distance and measure(*picks[:2]).distance:
        told["angle"] = f"{measure(*picks).angle:.4g}°"
    return told


def _absence() -> str:
    """Return why VTK is not available for comparison; empty if it is."""
    if find_spec("vtkmodules") is not None:
        return ""
    return "VTK is not installed: pip install 'hybrid-resample[peers]'"


def suits(names: Sequence[str]) -> bool:
    """Return whether these name one volume: a file, a folder or a generated one."""
    if len(names) != 1:
        return False
    (name,) = names
    if is_address(name):
        return True
    if not Path(name).exists():
        return name.partition(":")[0] in GENERATED
    try:
        find_reader(Path(name))
    except (ValueError, OSError):
        return False
    return True


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
        As of the command.

    Examples
    --------
    >>> picture("checker-box:size=16", {"camera": "top", "size": "32x24"})
    Frame(32 × 24 px, 25.5 % covered, depth from 54.87)
    """
    source_keys = ReadOptions.model_fields
    of_source = {key: value for key, value in settings.items() if key in source_keys}
    rest = {key: value for key, value in settings.items() if key not in source_keys}
    (source,) = chosen(of_source, (ReadOptions,))
    height, width = chosen(rest, SHOWN)[-1].height_and_width()
    return VolumePainter(prepared(source, volume)).frame(rest, (width, height))


def _histogram(volume: Volume, span: tuple[float, float]) -> dict[str, Any]:
    """Return the histogram of values in the robust range."""
    low, high = span
    values = np.asarray(volume.values)
    count, _ = np.histogram(values[np.isfinite(values)], BINS, (low, max(high, low + 1e-30)))
    by = scale_named(volume.scale)
    scale = {} if by is None else {"scale": "log" if by.linear is None else "symlog"}
    linear = {} if by is None or by.linear is None else {"linear": by.linear}
    return {"low": low, "high": high, "counts": count.tolist(), **scale, **linear}
