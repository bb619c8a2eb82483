"""Depth images warped for the command line."""

from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version
from typing import Any, NamedTuple

import numpy as np

from resample.cameras.models import Camera
from resample.colors import Background
from resample.command.console import say
from resample.command.session import Session, announce_compilation, require_picture
from resample.files.animations import fingerprint
from resample.types import Floats
from resample_warp3d.command.animation import on_screen
from resample_warp3d.command.choices import Shape, Warping
from resample_warp3d.command.inputs import DepthView
from resample_warp3d.depth.equation import between
from resample_warp3d.depth.preparation import prepare
from resample_warp3d.sheet.filling import fill
from resample_warp3d.types import Equation, Hole, Source, Warped

BYTES_PER_PIXEL = 160  # of a target and the copies that are made when it is warped and written
FEW = 1e-4  # of the pixels; fewer are not spoken about
HOLES = {
    Hole.DISOCCLUDED: "hidden in the source",
    Hole.OUTSIDE: "outside of it",
    Hole.NO_DEPTH: "without depth",
}


class Prepared(NamedTuple):
    """A source and the camera that took it."""

    source: Source
    camera: Camera


class Film(NamedTuple):
    """Frames of a camera that moves."""

    frame: Callable[[Camera], Floats]
    job: Mapping[str, object]


def prepared(session: Session, views: Sequence[DepthView], choice: Warping) -> list[Prepared]:
    """Sources ready to be warped."""
    announce()
    with session.stage("prepare", bar="preparing"):
        return [
            Prepared(prepare(view.image, noise=choice.noise, step=view.step), view.camera)
            for view in views
        ]


def warped(
    session: Session, sources: Sequence[Prepared], target: Camera, shape: Shape, choice: Warping
) -> Warped:
    """Sources as a camera sees them together in a frame (height, width)."""
    equations = [between(prepared.camera, target) for prepared in sources]
    each = [prepared.source for prepared in sources]
    return _rendered(session, each, equations, shape, choice)


def shifted(
    session: Session, source: Source, equation: Equation, shape: Shape, choice: Warping
) -> Warped:
    """Picture of a rectified pair as the equation of the other eye, or another place, says."""
    return _rendered(session, [source], [equation], shape, choice)


def _rendered(
    session: Session,
    sources: Sequence[Source],
    equations: Sequence[Equation],
    shape: Shape,
    choice: Warping,
) -> Warped:
    from resample_warp3d.merging import merge
    from resample_warp3d.warping import render

    method = choice.built()
    with session.stage("warp"):
        each = [
            render(source, equation, shape, method, choice.threads, filter=choice.filter)
            for source, equation in zip(sources, equations, strict=True)
        ]
        together = each[0] if len(each) == 1 else merge(each)
    if not choice.fill:
        return together
    with session.stage("fill"):
        return fill(together)


def report(
    session: Session, views: Sequence[DepthView], warped: Warped, choice: Warping
) -> dict[str, Any]:
    """Sizes, shares and times, for `--stats`."""
    covered = warped.magnification > 0
    return {
        "sources": [list(view.image.nearness.shape[::-1]) for view in views],
        "size": list(warped.coverage.shape[::-1]),
        "method": choice.method,
        "covered": round(float(warped.coverage.mean()), 6),
        "holes": {
            hole.name.lower(): round(float((warped.holes == hole).mean()), 6) for hole in Hole
        },
        "magnification": (
            round(float(np.median(warped.magnification[covered])), 6) if covered.any() else None
        ),
        "seconds": session.times(),
    }


def film_of(
    session: Session, view: DepthView, shape: Shape, choice: Warping, background: Background
) -> Film:
    """Film of a view: what its frames (H, W, 3) look like, and what they depend on."""
    sources = prepared(session, [view], choice)

    def frame(camera: Camera) -> Floats:
        seen = warped(session, sources, camera, shape, choice)
        return on_screen(seen, has_alpha=view.picture.kind.has_alpha, background=background)

    job = {
        "source": fingerprint(view.image.color, view.image.nearness, view.image.place),
        "camera": [view.camera.matrix.tolist(), view.camera.world_to_camera.tolist()],
        "size": list(shape),
        "choices": choice.model_dump(exclude={"threads"}),
        "background": list(background),
        "version": version("hybrid-resample"),
    }
    return Film(frame, job)


def check_memory(shape: Shape, channels: int) -> None:
    """Refuse a target that this machine cannot hold, before any work is done."""
    require_picture(shape, BYTES_PER_PIXEL + 16 * channels)


def mention_holes(warped: Warped) -> None:
    """Say what of a picture no source shows."""
    if not warped.coverage.any():
        say("nothing of the source is in view; check the poses and the depth's scale")
        return
    shares = [(hole, float((warped.holes == hole).mean())) for hole in HOLES]
    told = [f"{share:.2%} {HOLES[hole]}" for hole, share in shares if share > FEW]
    if told:
        say(f"holes: {', '.join(told)}; --holes shows them, --fill makes them up")


def announce() -> None:
    """Say on stderr that the first run takes longer, if this is one."""
    from resample_warp3d.depth.kernels.linking import link_rows

    announce_compilation(link_rows)
