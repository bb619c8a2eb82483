"""Films on command lines: paths that files hold, and frames that workers share."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from resample.console import progress_bar, say
from resample.files.animations import (
    MOST_FRAMES,
    Frames,
    Shots,
    check_count,
    made_by,
    write_film,
)
from resample.progress import WorkerPool

if TYPE_CHECKING:
    from resample.cameras.keyframes import Keyframes
    from resample.cameras.viewpoints import Viewpoint


class Tour(NamedTuple):
    """A path through keyframes."""

    keyframes: "Keyframes"
    frames: int

    def viewpoints(self, _spacing: float = 0.0) -> "list[Viewpoint]":
        """Viewpoint of each frame; independent of the object's spacing."""
        return self.keyframes.between(self.frames)


def is_file_of_path(path: str, known: Sequence[str], holds: str = "keyframes or poses") -> bool:
    """Whether a camera path is a file, and not one of the known names."""
    if path in known:
        return False
    if not Path(path).exists() and not Path(path).suffix:
        raise ValueError(f"unknown path {path!r}; known: {', '.join(known)}, or a file of {holds}")
    return True


def tour_of(path: Path, frames: int | None, fps: float, fov: float) -> Tour:
    """Path through the keyframes that can be rendered; reports those left out.

    `frames`: number of frames; None: as the keyframes' times (s) require. `fps`: frames per second.
    """
    from resample.cameras.files import left_out
    from resample.cameras.keyframes import keyframes_of

    keyframes = keyframes_of(path, fov)
    if path.suffix.lower() != ".toml" and (complaint := left_out(path)) is not None:
        say(complaint)
    if frames is None:
        frames = 1 + round(min(keyframes.duration * fps, MOST_FRAMES))
    try:
        check_count(frames)
        keyframes.between(frames)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    return Tour(keyframes, frames)


def write_shared(
    output: Path,
    shots: Shots,
    again: Callable[[int], Frames] | None = None,
    crew: WorkerPool | None = None,
    *,
    fps: float,
    resume: bool = False,
    bar: str = "rendering",
) -> None:
    """Write a film with a progress bar; workers share its frames, if there are any.

    `again`: function from a number of threads to the frames, for workers; None: no workers.
    `bar`: text of the progress bar.
    """
    with progress_bar(bar) as progress:
        made, executor = made_by(crew, shots, again)
        write_film(output, made, fps, resume=resume, progress=progress, executor=executor)
