"""Warp depth images for the command line."""

from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from functools import partial
from operator import is_
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from resample.cameras.models import Camera, Orthographic
from resample.colors import Background
from resample.command.flags import Shape
from resample.command.session import Session, bytes_per_value, require_picture
from resample.console import say
from resample.files.animations import fingerprint
from resample.lazy import installed_version
from resample.types import Floats
from resample_warp3d.command.choices import DepthWarping, Joint
from resample_warp3d.command.inputs import DepthInput, Inputs, bytes_of_source
from resample_warp3d.depth.preparation import sourced
from resample_warp3d.depth.refining.conditioning import Refined, RefinementChoice
from resample_warp3d.projection_models import CameraModel, Way, mapping_between
from resample_warp3d.sheet.filling import fill
from resample_warp3d.sheet.sheets import background, behind
from resample_warp3d.types import Hole, Method, Source, Warped

if TYPE_CHECKING:
    from resample_warp3d.views.multi_source import Agreed, Joining

REFINEMENTS = {
    "snap": "edges moved to those of the picture, gaps filled",
    "sharpen": "soft edges hardened where the picture has edges, gaps filled",
    "shift": "moved to where the picture has its edges, gaps filled",
    "densify": "sparse samples interpolated along surfaces of one color",
    "complete": "small gaps filled from their surroundings",
}
FEW = 1e-4  # share of the pixels below which holes are not reported
HOLES = {
    Hole.DISOCCLUDED: "hidden in the source",
    Hole.OUTSIDE: "outside the source",
    Hole.NO_DEPTH: "without depth",
}


_last: "list[tuple[list[object], Joining, Agreed]]" = []  # matched sources, how, and the match


class Prepared(NamedTuple):
    """A prepared source and its camera."""

    source: Source
    camera: Camera | Orthographic
    refined: Refined  # how its depth was conditioned
    layer: Source | None  # background behind its silhouettes, if requested and not empty


class JoinedPicture(NamedTuple):
    """Several sources combined into one picture."""

    warped: Warped
    found: list[dict[str, Any]] | None  # each source's corrections; None: one source


# How to render a film's frames, what a screen shows of them (H, W, 3), and what they depend on.
CameraFilm = tuple[Callable[[CameraModel], Warped], Callable[[Warped], Floats], dict[str, object]]


def prepared(
    session: Session,
    views: Sequence[DepthInput],
    choice: DepthWarping,
    chosen: Sequence[RefinementChoice] | None = None,
) -> list[Prepared]:
    """Prepare sources, as options say, or as was chosen for a shot's first picture."""
    # Differences of labels have no meaning.
    is_auto, made = choice.refine == "auto", []
    name = "none" if is_auto and choice.unmixed else choice.refine
    with session.stage("prepare", bar="preparing"):
        for n, view in enumerate(views):
            like = None if chosen is None else chosen[n]
            refined = view.refined(name, choice.noise, like)
            if is_auto and like is None:
                found, words = refined.findings, (("left of", "right of"), ("above", "below"))
                sides = zip(found.offset, found.shift, words, strict=True)
                beside = [f"{abs(by):.1f} px {side[by < 0]}" for by, whole, side in sides if whole]
                told = [f"it lies {' and '.join(beside)} its colors"] if beside else []
                told += filter(None, [REFINEMENTS.get(refined.chosen)])
                if told:
                    say(f"depth: {'; '.join(told)}; --refine none keeps it unchanged")
            source = sourced(refined, noise=choice.noise)
            layer = background(source) if choice.has_layer else None
            made.append(Prepared(source, view.camera, refined, layer))
    return made


def joined(
    session: Session,
    sources: Sequence[Prepared],
    target: CameraModel,
    shape: Shape,
    choice: DepthWarping,
    joining: "Joining | None",
) -> JoinedPicture:
    """Render sources together for a camera in a frame (height, width); None: there is but one."""
    if joining is None:
        way = mapping_between(sources[0].camera, target, shape)
        return JoinedPicture(rendered(session, sources[0], way, shape, choice), None)
    from resample_warp3d.views.multi_source import PosedSource, agreed, layers_of, render_together

    look = partial(
        render_together, target=target, shape=shape, method=choice.built(), joining=joining,
        filter=choice.filter, threads=choice.threads,
    )  # fmt: skip
    with session.stage("match"):
        # The last match is kept, for the frames of a film and a viewer's pictures.
        parts: list[object] = [part for each in sources for part in (each.source, each.camera)]
        known = (
            match for kept, how, match in _last
            if how == joining and len(kept) == len(parts) and all(map(is_, kept, parts))
        )  # fmt: skip
        ready = next(known, None)
        if ready is None:
            posed = ((each.source, each.camera) for each in sources)
            views = [PosedSource(s, c) for s, c in posed if isinstance(c, Camera)]
            ready = agreed(views, joining)
            _last[:] = [(parts, joining, ready)]
    with session.stage("warp"):
        viewed = look(ready)
        layers = layers_of(ready, [each.layer for each in sources])
        alone = replace(joining, votes="none")
        layer = look(layers, joining=alone, match=viewed.match).warped if layers.order else None
    found = [
        {
            "moved": round(float(moved), 6),
            "depth_factor": round(1.0 / float(scale), 6),
            "gain": [round(float(each), 6) for each in gain],
            "bias": [round(float(each), 6) for each in bias],
        }
        for moved, scale, gain, bias in zip(ready.moved, ready.scale, *viewed.match, strict=True)
    ]
    return JoinedPicture(filled(session, viewed.warped, layer, choice), found)


def rendered(
    session: Session, source: Prepared, equation: Way, shape: Shape, choice: DepthWarping,
    method: Method | None = None, *, with_depth: bool = True,
) -> Warped:  # fmt: skip
    """Render a source, and fill it if requested; method None: that of the options."""
    from resample_warp3d.warping import render

    method = method or choice.built()
    with session.stage("warp"):
        viewed, *layers = (
            render(each, equation, shape, method, choice.threads, filter=choice.filter)
            for each in (source.source, source.layer)
            if each is not None
        )
    layer = layers[0] if layers else None
    return filled(session, viewed, layer, choice, with_depth=with_depth)


def filled(
    session: Session,
    viewed: Warped,
    layer: Warped | None,
    choice: DepthWarping,
    *,
    with_depth: bool = True,
) -> Warped:
    """Fill a picture's holes if requested, first from a layer if there is one."""
    if not choice.fill:
        return viewed
    with session.stage("fill"):
        viewed = viewed if layer is None else behind(viewed, layer)
        return fill(viewed, with_depth=with_depth)


def report(
    session: Session, sources: Sequence[Prepared], viewed: JoinedPicture, choice: DepthWarping
) -> dict[str, Any]:
    """Return sizes, depth refinement, corrections of views, shares and times for `--stats`."""
    warped = viewed.warped
    covered = warped.magnification > 0
    refine = [
        {
            "chosen": refined.chosen,
            "soft edges": round(refined.findings.soft, 4),
            "blur, px": round(refined.findings.sigma, 3),
            "aligned": round(refined.findings.aligned, 3),
            "overshoot": round(refined.findings.overshoot, 3),
            "offset, px": [round(each, 2) for each in refined.findings.offset],
            "enlargement": round(refined.findings.enlargement, 4),
            "unknown": round(refined.findings.unknown, 6),
            "confidence": round(float(refined.confidence.mean()), 6),
        }
        for refined in (source.refined for source in sources)
    ]
    about = {} if viewed.found is None else {"views": viewed.found}
    return {
        "sources": [list(prepared.source.nearness.shape[::-1]) for prepared in sources],
        "refine": refine,
        "size": list(warped.coverage.shape[::-1]),
        "method": choice.method,
        "covered": round(float(warped.coverage.mean()), 6),
        "holes": {
            hole.name.lower(): round(float((warped.holes == hole).mean()), 6) for hole in Hole
        },
        "magnification": (
            round(float(np.median(warped.magnification[covered])), 6) if covered.any() else None
        ),
        **about,
        "seconds": session.times(),
    }


def film_of(
    session: Session, taken: Inputs, shape: Shape, choice: DepthWarping, background: Background
) -> CameraFilm:
    """Return the renderer of a film's frames."""
    sources = prepared(session, taken.views, choice)
    joining = joining_of(taken, Joint.usual())

    def viewed(camera: CameraModel) -> Warped:
        return joined(session, sources, camera, shape, choice, joining).warped

    screen = partial(on_screen, has_alpha=taken.picture.kind.has_alpha, background=background)

    images = [view.image for view in taken.views]
    cameras = [[getattr(v.camera, each.name) for each in fields(v.camera)] for v in taken.views]
    words = [[p.tolist() if isinstance(p, np.ndarray) else p for p in one] for one in cameras]
    job: dict[str, object] = {
        "source": fingerprint(
            *(part for each in images for part in (each.color, each.nearness, each.place))
        ),
        "camera": words,
        "size": list(shape),
        "choices": choice.model_dump(exclude={"threads"}),
        "background": list(background),
        "version": installed_version(),
    }
    return viewed, screen, job


def on_screen(warped: Warped, *, has_alpha: bool, background: Background) -> Floats:
    """Return a warped picture (H, W, 3) as a screen shows it, 0..1."""
    channels = warped.image.shape[2] - has_alpha
    if channels not in (1, 3):
        raise ValueError(f"a picture of {channels} channels; gray and RGB ones can be shown")
    from resample.measuring.compare import shown

    image = warped.image
    if not has_alpha:
        coverage = np.clip(warped.coverage, 0.0, 1.0)[..., None]
        image = np.concatenate([image, coverage], axis=2, dtype=np.float32)
    return shown(image, background)


def joining_of(taken: Inputs, joint: Joint, *, unmixed: bool = False) -> "Joining | None":
    """Return how views are combined, if there are several; a panorama's faces are feathered."""
    if len(taken.views) == 1:
        return None
    from resample_warp3d.views.panoramas import SEAMLESS

    chosen = joint.joining(unmixed=unmixed)
    if not taken.is_panorama:
        return chosen
    return replace(SEAMLESS, blend="best") if chosen.blend == "best" else SEAMLESS


def check_memory(views: Sequence[DepthInput], shape: Shape, output: Path, others: int = 0) -> None:
    """Refuse a warp to (height, width) that does not fit into memory; log what it needs (DEBUG)."""
    channels = max(view.picture.data.shape[2] for view in views)
    sources = sum(bytes_of_source(view.picture.data.shape) for view in views)
    pixel = (channels + 1) * bytes_per_value(output)
    require_picture(shape, pixel, {"the sources": sources}, others)


def mention_holes(warped: Warped) -> None:
    """Report which share of a picture no source shows."""
    if not warped.coverage.any():
        say("no part of the source is in view; check the poses and the depth's scale")
        return
    shares = [(hole, float((warped.holes == hole).mean())) for hole in HOLES]
    told = [f"{share:.2%} {HOLES[hole]}" for hole, share in shares if share > FEW]
    if told:
        say(f"holes: {', '.join(told)}; --holes shows them, --fill fills them")
