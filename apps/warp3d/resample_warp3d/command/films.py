"""Render films with depth: each picture has a depth map and gets the same new viewpoint."""

import glob
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from resample.colors import to_srgb
from resample.command.session import Session
from resample.files.formats import WriteOptions
from resample.files.pictures import Picture
from resample.files.sequences import Frames, check_frames, frames_of, write_frames
from resample.files.writing import check_targets
from resample.types import Floats
from resample_warp3d.command.choices import DepthWarping, Extras, Showing
from resample_warp3d.command.depths import appearing, depths_of
from resample_warp3d.command.inputs import DepthReader, mention_doubt, view_of
from resample_warp3d.command.rendering import check_memory, prepared, warped
from resample_warp3d.command.target import Aim
from resample_warp3d.command.writing import warped_picture
from resample_warp3d.depth.encodings import Raw, RelativeDepth
from resample_warp3d.depth.files import read_depth


@dataclass(frozen=True)
class DepthFilm:
    """Pictures of a film, and the depth of each.

    Parameters
    ----------
    frames
        The pictures.
    depth
        Film of gray levels, folder of depth files, or pattern of names.

    Raises
    ------
    ValueError, OSError
        The depth is none of these, or its number of pictures differs.
    """

    frames: Frames
    depth: str

    def __post_init__(self) -> None:
        count, given = len(self.frames.seconds), self._count
        if given == 0 and Path(self.depth).is_dir():
            raise ValueError(f"{self.depth} is a folder without files; it needs depth files")
        if given == 0:
            raise ValueError(
                f"{self.depth} is neither a film, a folder nor a pattern; {self.frames.path} is "
                "a film, which needs the depth of every picture"
            )
        if given != count:
            raise ValueError(
                f"{self.frames.path} has {count} pictures, {self.depth} has {given}; give one "
                "depth for each"
            )

    @property
    def _count(self) -> int:
        return len(self._files) if self._levels is None else len(self._levels.seconds)

    @cached_property
    def _levels(self) -> Frames | None:
        """The depth as a film of gray levels, if it is one."""
        return frames_of(Path(self.depth))

    @cached_property
    def _files(self) -> list[str]:
        """Depth files in the order of their names."""
        folder = Path(self.depth)
        if folder.is_dir():
            return [str(file) for file in sorted(folder.iterdir()) if file.is_file()]
        return sorted(glob.glob(self.depth)) if glob.has_magic(self.depth) else []

    def depths(self) -> Iterator[Raw]:
        """Yield the raw depth of each picture; 8-bit levels if it is a film."""
        if self._levels is None:
            return (read_depth(file) for file in self._files)
        return (_gray_levels(picture) for picture in self._levels.read())

    def name_of(self, n: int) -> str:
        """Return the name of the n-th picture's depth: its file, or the film."""
        return self.depth if self._levels is not None else self._files[n]

    def reader(self, reader: DepthReader) -> DepthReader:
        """Return a reader with one range of relative depth for all pictures, to avoid pumping."""
        if not reader.meaning.is_relative:
            return reader
        ends = [RelativeDepth.ends_of(raw) for raw in self.depths()]
        return reader._replace(ends=(min(low for low, _ in ends), max(high for _, high in ends)))


def film_with_depth(
    color: str, depth: str, extras: Extras, further: Sequence[object], showing: Showing
) -> DepthFilm | None:
    """Return the film with its depth; None if a single picture is given."""
    frames = frames_of(Path(color))
    if frames is None:
        return None
    for name in ("holes", "coverage", "export", "stats"):
        if getattr(extras, name) is not None:
            raise ValueError(f"--{name.replace('_', '-')} is for pictures, not for films")
    showing.check_still()
    if further:
        raise ValueError("--view is for pictures, not for films")
    return DepthFilm(frames, depth)


def render_film(
    film: DepthFilm, output: Path, reader: DepthReader, aim: Aim,
    warping: DepthWarping, look: WriteOptions,     depth_output: Path | None = None,
) -> None:  # fmt: skip
    """Write a film from another viewpoint, and its depth if requested."""
    depths = depths_of(depth_output, output, reader.meaning)
    check_targets(output)
    check_frames(output, film.frames, look)
    session = Session()
    with session.stage("film", bar="rendering") as progress, appearing(depths):
        count = len(film.frames.seconds)

        def told() -> Iterator[Picture]:
            made = _pictures(session, film, film.reader(reader), aim, warping, output)
            for n, (picture, depth) in enumerate(made):
                if depths is not None:
                    depths.write(n, depth)
                if progress is not None:
                    progress((n + 1) / count)
                yield picture

        write_frames(output, told(), film.frames.seconds, look)


def _pictures(
    session: Session,
    film: DepthFilm,
    reader: DepthReader,
    aim: Aim,
    warping: DepthWarping,
    output: Path,
) -> Iterator[tuple[Picture, Floats]]:
    """Yield the pictures of a film from the new viewpoint, and their depth (H, W).

    The refinement chosen for the first picture is used for all.
    """
    for n, (picture, raw) in enumerate(zip(film.frames.read(), film.depths(), strict=True)):
        view = view_of(reader, picture, raw, (str(film.frames.path), film.name_of(n)))
        if n == 0:
            mention_doubt(reader, view, film.depth)
        shape = aim.shape(view.shape)
        if n == 0:
            check_memory([view], shape, output)
        sources = prepared(session, [view], warping)
        warping = warping.model_copy(update={"refine": sources[0].refined.chosen})
        target = aim.camera_model(
            reader.eye.camera_model(view.shape), view.shape, reader.eye.convention
        )
        seen = warped(session, sources[0], target, shape, warping)
        yield warped_picture(seen, picture.kind, filled=warping.fill), seen.depth


def _gray_levels(picture: Picture) -> Raw:
    """Return the gray levels 0..255 (H, W) of a film's picture."""
    gray = to_srgb(np.clip(picture.data[..., 0], 0.0, 1.0))
    return np.rint(gray * 255.0).astype(np.uint8)
