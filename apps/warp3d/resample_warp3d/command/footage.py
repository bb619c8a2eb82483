"""Films with depth, read on demand and mostly forward, and networks in ONNX that estimate depth."""

import glob
import hashlib
import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from resample.colors import to_srgb
from resample.files.animations import check_rate
from resample.files.formats import levels
from resample.files.pictures import Picture, read_picture
from resample.files.sequences import FILMS, READ, USUAL, Frames, frames_of
from resample.files.writing import replacing
from resample.messages import numbers_in
from resample.types import Floats
from resample_warp3d.command.choices import MEAN, SHORTER, SPREAD, Estimating
from resample_warp3d.command.inputs import read_names
from resample_warp3d.depth.encodings import Raw
from resample_warp3d.depth.files import read_depth, read_depths

SQUEEZED = 0.01  # difference of proportions below which a map is of its picture
MULTIPLE = 14  # px of a network's patches, whose multiples sides are
T = TypeVar("T")
T_co = TypeVar("T_co", covariant=True)
STILLS = {*READ} - {*FILMS}  # suffixes of pictures
NUMBER = re.compile(r"(\d+)")
WHOLE = 0.0, math.inf  # s
SURVEYED = 9  # pictures of a film by which the eyes and black bars are chosen, at most
BLACK = 6.0 / 255.0 / 12.92  # light of black bars, at most
THINNEST = 0.02  # share of a side that a bar at each end has, at least


@dataclass(frozen=True, eq=False)
class DepthModel:
    """A network that estimates the depth of single pictures."""

    choice: Estimating
    session: Any  # of onnxruntime

    def __post_init__(self) -> None:
        form = self.session.get_inputs()[0].shape
        if len(form) != 4 or (isinstance(form[1], int) and form[1] != 3):
            raise ValueError(
                f"{self.path} takes arrays {form}; a network of depth takes pictures (N, 3, H, W)"
            )

        mean, spread = self._levels
        if mean.shape != (3,) or spread.shape != (3,) or not (spread > 0).all():
            raise ValueError("--model-mean and --model-std are three numbers, the latter above 0")

    @cached_property
    def _levels(self) -> tuple[Floats, Floats]:
        """Levels that the network takes for 0, and by which they are then divided."""
        about = self.session.get_modelmeta().custom_metadata_map
        return (
            np.array(numbers_in("mean", self.choice.model_mean or about.get("mean", MEAN)), "f4"),
            np.array(numbers_in("std", self.choice.model_std or about.get("std", SPREAD)), "f4"),
        )

    @property
    def path(self) -> Path:
        """File of the network."""
        assert self.choice.depth_model is not None
        return self.choice.depth_model

    @cached_property
    def fingerprint(self) -> str:
        """Hash of the file and the options."""
        digest = hashlib.sha256(
            self.choice.model_dump_json(exclude={"depth_model", "model_batch"}).encode()
        )
        with self.path.open("rb") as file:
            digest.update(hashlib.file_digest(file, "sha256").digest())
        return digest.hexdigest()

    @property
    def batch(self) -> int:
        """Pictures at a time."""
        given = self.session.get_inputs()[0].shape[0]
        return given if isinstance(given, int) else self.choice.model_batch

    def estimate(self, pictures: Sequence[Picture]) -> list[Raw]:
        """Return the depth of pictures of one size, in the network's numbers and at its size."""
        import cv2

        (mean, spread), form, count = self._levels, self.session.get_inputs()[0], len(pictures)
        about = self.session.get_modelmeta().custom_metadata_map
        shorter = self.choice.model_size or int(about.get("size", SHORTER))
        small = []  # at the network's size
        for picture in pictures:
            channels = slice(3) if picture.data.shape[2] > 2 else [0, 0, 0]
            color = np.ascontiguousarray(picture.data[..., channels], np.float32)
            height, width = color.shape[:2]
            scale = shorter / min(height, width)
            rows, columns = (
                given
                if isinstance(given, int)
                else max(1, round(side * scale / MULTIPLE)) * MULTIPLE
                for given, side in zip(form.shape[2:], (height, width), strict=True)
            )
            way = cv2.INTER_AREA if rows * columns < height * width else cv2.INTER_CUBIC
            light = cv2.resize(color, (columns, rows), interpolation=way)
            shown = np.asarray(to_srgb(np.clip(light, 0.0, 1.0)), np.float32)
            small.append((shown - mean) / spread)
        array = np.stack(small).transpose(0, 3, 1, 2)
        if isinstance(form.shape[0], int) and form.shape[0] > count:
            array = np.concatenate([array, np.repeat(array[-1:], form.shape[0] - count, axis=0)])
        kind = np.float16 if form.type == "tensor(float16)" else np.float32
        (made, *_) = self.session.run(None, {form.name: np.ascontiguousarray(array, kind)})
        made = np.asarray(made, np.float32)
        height, width = made.shape[-2:]
        if made.size != len(array) * height * width:
            raise ValueError(f"{self.path} gives arrays {made.shape}, not one map per picture")
        maps = made.reshape(-1, height, width)[:count]
        rows, columns = pictures[0].data.shape[:2]
        size = round(height * columns / rows), height  # networks of one size squeeze pictures
        if abs(size[0] / width - 1.0) < SQUEEZED:
            return list(maps)
        return [cv2.resize(each, size, interpolation=cv2.INTER_LINEAR) for each in maps]


def opened(choice: Estimating, threads: int | None) -> DepthModel | None:
    """Open a network, if there is one."""
    if choice.depth_model is None:
        given = ("model_size", "model_mean", "model_std")
        for name in given:
            if getattr(choice, name) is not None:
                raise ValueError(f"--{name.replace('_', '-')} belongs to --depth-model")
        return None
    if not choice.depth_model.is_file():
        raise FileNotFoundError(2, "No such file", str(choice.depth_model))
    try:
        import onnxruntime
    except ImportError:
        raise ValueError(
            "--depth-model needs onnxruntime, which is not installed: "
            "pip install 'hybrid-resample[depth]'"
        ) from None
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads or 0
    options.log_severity_level = 3
    try:
        session = onnxruntime.InferenceSession(str(choice.depth_model), options)
    except Exception as error:
        text = str(error).partition("\n")[0]
        raise ValueError(f"{choice.depth_model} is not a network that runs: {text}") from None
    return DepthModel(choice, session)


class FrameSeries(Protocol[T_co]):
    """Role of pictures or maps by number."""

    def __len__(self) -> int: ...

    def __getitem__(self, n: int, /) -> T_co: ...


@dataclass(frozen=True)
class FileSeries(Generic[T]):
    """Pictures or maps of one file each."""

    files: Sequence[Path]
    read: Callable[[str], T]

    def __len__(self) -> int:
        return len(self.files)

    def __getitem__(self, n: int) -> T:
        return self.read(str(self.files[n]))


@dataclass
class DecodedSeries(Generic[T]):
    """Pictures or maps of one file, which is decoded from its beginning."""

    frames: Frames
    convert: Callable[[Picture], T]
    _next: int = field(default=0, init=False)
    _rest: Iterator[Picture] | None = field(default=None, init=False)

    def __len__(self) -> int:
        return len(self.frames.seconds)

    def __getitem__(self, n: int) -> T:
        if self._rest is None or n < self._next:
            self._rest, self._next = self.frames.read(), 0
        for picture in self._rest:
            self._next += 1
            if self._next > n:
                return self.convert(picture)
        raise OSError(f"{self.frames.path} ends after {self._next} of {len(self)} pictures")


@dataclass(frozen=True, eq=False)
class StackSeries:
    """Maps of an array (N, H, W)."""

    stack: Raw

    def __len__(self) -> int:
        return len(self.stack)

    def __getitem__(self, n: int) -> Raw:
        return np.ascontiguousarray(self.stack[n], self.stack.dtype.newbyteorder("="))


@dataclass(frozen=True, eq=False)
class EstimatedSeries:
    """Maps that a network estimates, in batches; they are kept in a folder."""

    pictures: FrameSeries[Picture]  # read forward, and by nobody else
    model: DepthModel
    folder: Path = Path()

    def __len__(self) -> int:
        return len(self.pictures)

    def __getitem__(self, n: int) -> Raw:
        kept = self.folder / f"{n:07d}.npy"
        if not kept.is_file():
            self.folder.mkdir(exist_ok=True)
            numbers = range(n, min(n + self.model.batch, len(self)))
            maps = self.model.estimate([self.pictures[each] for each in numbers])
            for each, depth in zip(numbers, maps, strict=True):
                with replacing(self.folder / f"{each:07d}.npy") as temporary:
                    np.save(temporary, depth.astype(np.float16))
        return np.asarray(np.load(kept), np.float32)


@dataclass(frozen=True, eq=False)
class Footage:
    """Pictures of a film, the depth of each, and their display times."""

    color: str  # as named by the user
    depth: str
    pictures: FrameSeries[Picture]
    depths: FrameSeries[Raw]
    frames: Frames  # the film as a file of several pictures
    rows: tuple[float, float] = (0.0, 1.0)  # shares of the height between black bars
    columns: tuple[float, float] = (0.0, 1.0)  # and of the width

    def __len__(self) -> int:
        return len(self.frames.seconds)

    @property
    def files(self) -> list[Path]:
        """All files that the film is read from."""
        found: list[Path] = []
        for series, name in ((self.pictures, self.color), (self.depths, self.depth)):
            path = Path(name)
            path = path if path.is_file() else Path(name.rpartition(":")[0])
            found += series.files if isinstance(series, FileSeries) else [path]
        return found

    def surveyed(self) -> list[int]:
        """Return the numbers of some pictures, evenly spaced."""
        count = len(self)
        chosen = np.linspace(0, count - 1, min(count, SURVEYED)).round().astype(int)
        return [int(n) for n in np.unique(chosen)]

    def without_bars(self) -> "Footage":
        """Return the film with the black bars found that some of its pictures have in common."""
        few = [np.asarray(self.pictures[n].data[..., :3].max(axis=2)) for n in self.surveyed()]
        if len({each.shape for each in few}) > 1:
            return self
        light = np.maximum.reduce(few)
        ends = []
        for axis in (1, 0):
            is_light = light.max(axis=axis) > BLACK
            lit, size = np.flatnonzero(is_light), len(is_light)
            has_none = not lit.size or min(lit[0], size - 1 - lit[-1]) < THINNEST * size
            ends.append((0.0, 1.0) if has_none else (lit[0] / size, (lit[-1] + 1) / size))
        return replace(self, rows=ends[0], columns=ends[1])

    def inside(self, whole: NDArray[Any]) -> NDArray[Any]:
        """Return the part between the black bars of a picture or map of any size."""
        ends = zip((self.rows, self.columns), whole.shape[:2], strict=True)
        return whole[tuple(slice(round(a * size), round(b * size)) for (a, b), size in ends)]

    def estimated_beside(self, output: Path) -> "Footage":
        """Return a film whose estimated depth is kept beside a target, by what it depends on."""
        assert isinstance(self.depths, EstimatedSeries)
        what = f"{self.fingerprint} {self.depths.model.fingerprint} {self.frames.first}"
        name = f".{output.name}.{hashlib.sha256(what.encode()).hexdigest()[:16]}"
        return replace(self, depths=replace(self.depths, folder=output.parent / name))

    def check_apart(self, folder: Path) -> None:
        """Refuse to write numbered files to a folder that the film's files are in."""
        for series in (self.pictures, self.depths):
            files = series.files if isinstance(series, FileSeries) else ()
            if folder.resolve() in {file.parent.resolve() for file in files}:
                raise ValueError(
                    f"{folder}: the film is read from this folder; give another one to write to"
                )

    def names(self, n: int) -> tuple[str, str]:
        """Name of a picture and of its depth."""
        both = (self.pictures, self.color), (self.depths, self.depth)
        color, depth = (
            str(series.files[n]) if isinstance(series, FileSeries) else name
            for series, name in both
        )
        return color, depth

    @cached_property
    def fingerprint(self) -> str:
        """Hash of the contents of all files."""
        digest = hashlib.sha256()
        for path in self.files:
            with path.open("rb") as file:
                digest.update(hashlib.file_digest(file, "sha256").digest())
        return digest.hexdigest()


def footage_of(
    color: str,
    depth: str | None,
    fps: float | None = None,
    *,
    labels: bool = False,
    times: tuple[float, float] = WHOLE,
    model: DepthModel | None = None,
) -> Footage | None:
    """Open a film, a folder or a pattern of pictures with depth; None for a single picture."""
    frames = frames_of(Path(color))
    files = (
        None if frames is not None else files_in(color, lambda path: path.suffix.lower() in STILLS)
    )
    if frames is None and files is None:
        return None
    if frames is None:
        if not files:
            raise ValueError(f"{color} has no pictures; give a film, a folder or a pattern")
        frames = Frames(Path(color), (USUAL,) * len(files))
    if fps is not None:
        check_rate(fps)
        frames = frames._replace(seconds=(1.0 / fps,) * len(frames.seconds))
    count, taken = len(frames.seconds), frames if times == WHOLE else frames.part(*times)

    def opened() -> FrameSeries[Picture]:
        if files is None:
            if not labels:
                return DecodedSeries(taken, lambda picture: picture)
            by = np.float32(255.0)
            return DecodedSeries(
                taken, lambda p: p._replace(data=np.asarray(_levels_of(p) / by, np.float32))
            )
        chosen = files[taken.first : taken.first + len(taken.seconds)]
        return FileSeries(chosen, read_names if labels else read_picture)

    if model is not None:
        estimated = EstimatedSeries(opened(), model)
        return Footage(color, str(model.path), opened(), estimated, taken)
    assert depth is not None
    depths = _depths_of(color, depth)
    if len(depths) not in (count, len(taken.seconds)):
        raise ValueError(
            f"{color} has {count} pictures, {depth} has {len(depths)}; give one depth for each"
        )
    first, last = taken.first, taken.first + len(taken.seconds)
    if len(depths) > len(taken.seconds) and isinstance(depths, DecodedSeries):
        seconds = depths.frames.seconds
        begin = sum(seconds[:first])
        part = depths.frames._replace(seconds=seconds[first:last], first=first, begin=begin)
        depths = DecodedSeries(part, depths.convert)
    elif len(depths) > len(taken.seconds) and isinstance(depths, FileSeries):
        depths = replace(depths, files=depths.files[first:last])
    elif len(depths) > len(taken.seconds) and isinstance(depths, StackSeries):
        depths = StackSeries(depths.stack[first:last])
    return Footage(color, depth, opened(), depths, taken)


def _depths_of(color: str, depth: str) -> FrameSeries[Raw]:
    grays = frames_of(Path(depth))
    if grays is not None:
        return DecodedSeries(grays, lambda picture: _levels_of(picture, 1)[..., 0])
    files = files_in(depth, lambda _: True)
    if files:
        return FileSeries(files, read_depth)
    if Path(depth).is_dir():
        raise ValueError(f"{depth} is a folder without files; it needs depth files")
    stack = read_depths(depth)
    if stack is not None:
        return StackSeries(stack)
    what = "is a folder of pictures" if Path(color).is_dir() else "is a film"
    raise ValueError(
        f"{color}: {what}, which needs the depth of every picture; {depth} is neither a film, a "
        "folder nor a pattern of depth files, nor a stack (N, H, W) in .npy or .npz"
    )


def files_in(name: str, is_wanted: Callable[[Path], bool]) -> list[Path] | None:
    """Return the files, but hidden ones, of a folder or pattern by the numbers in their names."""
    path = Path(name)
    if path.is_dir():
        found: Iterator[Path] = path.iterdir()
    elif not path.exists() and glob.has_magic(name):
        found = map(Path, glob.glob(name, recursive=True))
    else:
        return None
    files = [file for file in found if file.is_file() and not file.name.startswith(".")]
    parts = {file: NUMBER.split(str(file)) for file in filter(is_wanted, files)}
    # frame-9 comes before frame-10
    return sorted(
        parts, key=lambda file: [(int(p) if p.isdecimal() else -1, p) for p in parts[file]]
    )


def _levels_of(picture: Picture, channels: int | None = None) -> Raw:
    """Return the levels 0..255 of a film's picture as they are stored."""
    return levels(picture.data[..., :channels], "uint8", has_alpha=False, is_light=True)
