"""Picture files warped one after the other, and all pictures of a file alike."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from resample.command.session import Session
from resample.files.pictures import (
    Look,
    Picture,
    check_output,
    check_source,
    coverage_picture,
    holds_gaps,
    read_picture,
    write_picture,
)
from resample.types import Floats
from resample_texture.command.choices import Place, Warping
from resample_texture.command.inputs import Target, target_of
from resample_texture.command.rendering import report, sees_all, warped


@dataclass(frozen=True)
class Job:
    """What is done with every picture."""

    place: Place
    warping: Warping
    look: Look
    roi: tuple[int, int, int, int] | None = None

    def target(self, picture: Picture) -> Target:
        """Where a picture goes."""
        return target_of(self.place, (picture.data.shape[0], picture.data.shape[1]))

    def warped(
        self, session: Session, picture: Picture, target: Target, output: Path
    ) -> tuple[Picture, Floats]:
        """Picture as a file is to hold it, and the coverage of its pixels.

        Raises
        ------
        ValueError
            The file cannot hold it.
        """
        check_source(output, picture, self.look)
        choice = self.warping
        opens = choice.edge == "transparent" and not choice.total
        gaps = holds_gaps(output, picture, self.look)
        shape = picture.data.shape[0], picture.data.shape[1]
        is_open = opens and not gaps and not sees_all(target, shape, self.roi)
        check_output(output, self.look, transparent=picture.kind.has_alpha or is_open)
        return warped(session, picture, target, choice, self.roi, keeps_gaps=gaps)


def warp_file(
    session: Session, source: Path, output: Path, job: Job, coverage: Path | None = None
) -> dict[str, Any]:
    """Warp the picture of a file; returns what `--stats` says."""
    with session.stage("read"):
        picture = read_picture(source)
        target = job.target(picture)
    result, share = job.warped(session, picture, target, output)
    with session.stage("write"):
        write_picture(output, result, job.look)
        if coverage is not None:
            write_picture(coverage, coverage_picture(share), Look(is_light=False))
    return report(session, picture, result, job.warping)
