"""Read depth images from the command line's files and options."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from math import prod
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple, cast

import numpy as np

from resample.cameras.files import file_and_frame
from resample.cameras.models import Camera, Orthographic
from resample.cameras.pixels import Equirectangular, check_panorama
from resample.cameras.record3d import unpacked
from resample.command.flags import Shape
from resample.command.session import libraries
from resample.console import say
from resample.files.images import read_channels
from resample.files.pictures import Picture, form_of, header_of, read_picture
from resample.memory import require, require_memory
from resample.messages import naming
from resample.types import Floats
from resample_warp3d.command.choices import Depth
from resample_warp3d.command.source import SourceCamera
from resample_warp3d.depth.encodings import (
    BareDisparity,
    DepthEncoding,
    Raw,
    RelativeDepth,
    check_scale,
)
from resample_warp3d.depth.equation import lens_places, pose_warning
from resample_warp3d.depth.files import confident, read_depth
from resample_warp3d.depth.refining.conditioning import (
    Refine,
    Refined,
    RefinementChoice,
    refine,
)
from resample_warp3d.depth.refining.inspecting import is_sharpened
from resample_warp3d.depth.refining.resizing import fitted
from resample_warp3d.projection_models import CameraModel, taken_by
from resample_warp3d.types import DepthImage

NUMBERS = (".npy", ".npz", ".pfm", ".bin")  # suffixes of arrays
BYTES_PER_PIXEL = 144  # for refining and preparing a source, without its colors
BYTES_PER_VALUE = 23  # per channel of a source, for refining, preparing and warping


class DepthInput(NamedTuple):
    """One input: a picture, its depth and its camera."""

    picture: Picture
    image: DepthImage
    camera: Camera | Orthographic
    step: float | None  # smallest step of nearness in the file, if known
    is_fitted: bool = False  # the file's depth had another size
    is_registered: bool = False  # the depth is another camera's, which does not see all of it

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width, px."""
        return self.picture.data.shape[0], self.picture.data.shape[1]

    @property
    def pinhole(self) -> Camera:
        """The view's camera, if it is a pinhole or lens."""
        if not isinstance(self.camera, Camera):
            raise ValueError("only pictures of a pinhole or lens are supported here")
        return self.camera

    def refined(
        self, name: str, noise: float | None = None, like: RefinementChoice | None = None
    ) -> Refined:
        """Refine the depth by the option `name`, or `like` an earlier picture of the shot."""
        how = partial(
            refine, self.image, noise=noise, step=self.step, is_measured=self.is_registered,
            like=like,
        )  # fmt: skip
        found = how(cast(Refine, name))
        return (
            how("snap") if name == "auto" and self.is_fitted and found.chosen == "none" else found
        )


class Inputs(NamedTuple):
    """All inputs, from one picture or several."""

    views: list[DepthInput]  # a panorama's are its faces
    picture: Picture  # the first picture, whole
    camera: CameraModel  # camera of that picture
    shape: Shape  # its height and width, px

    @property
    def is_panorama(self) -> bool:
        """Whether all views are faces of one panorama."""
        return isinstance(self.camera, Equirectangular)


def view_names(text: str) -> list[str]:
    """Split a text COLOR,DEPTH,POSE into file names."""
    words = [word.strip() for word in text.split(",")]
    if len(words) != 3 or not all(words):
        raise ValueError(f"view {text!r}; give COLOR,DEPTH,POSE, three files separated by commas")
    return words


class DepthReader(NamedTuple):
    """Settings for reading depth images."""

    eye: SourceCamera
    meaning: Depth
    labels: bool = False  # colors are labels, kept as stored
    ends: tuple[float, float] | None = None  # range of relative depth, for films
    is_soft: Callable[[Floats], bool] = is_sharpened  # whether a small map's edges are soft

    @classmethod
    def checked(cls, eye: SourceCamera, meaning: Depth, *, labels: bool = False) -> "DepthReader":
        """Return a checked reader of the command line's options; report assumptions."""
        meaning.check()
        if meaning.is_relative:
            near, far = meaning.range()
            what = f"assumed a depth of {near:g} to {far:g} units (--near, --far)"
            given, eye = eye, eye.guessed()
            view = "" if eye is given else f" and a field of view of {eye.fov:g} degrees (--fov)"
            say(what + view)
        eye.check()
        if meaning.depth_intrinsics is not None and eye.lens is not None:
            raise ValueError(
                "--depth-intrinsics reprojects depth to a picture without a lens; undistort the "
                "picture first, with resample-texture undistort"
            )
        return cls(eye, meaning, labels)


def read_view(reader: DepthReader, color: str, depth: str, pose: str | None = None) -> DepthInput:
    """Read a depth image of a calibrated camera; report a doubtful scale."""
    with picture_file(color) as file:
        form, _ = form_of(Path(file))
        needed = {"libraries": libraries(), "the source": bytes_of_source(form)}
        require(f"{color} of {form[1]} x {form[0]} pixels", needed, "take a smaller picture")
        picture = read_names(file) if reader.labels else read_picture(file)
    view = view_of(reader, picture, read_depth(depth), (color, depth), pose)
    mention_doubt(reader, view, depth)
    return view


@contextmanager
def picture_file(color: str) -> Iterator[str]:
    """Yield a picture's file; that of a frame of Record3D is unpacked."""
    path, frame = file_and_frame(color)
    if Path(path).suffix.lower() != ".r3d":
        yield color
        return
    with TemporaryDirectory() as folder:
        file = Path(folder) / f"{Path(path).stem}-{frame or 0}.jpg"
        file.write_bytes(unpacked(Path(path), f"rgbd/{frame or 0}.jpg"))
        yield str(file)


def view_of(
    reader: DepthReader, picture: Picture, raw: Raw, names: tuple[str, str], pose: str | None = None
) -> DepthInput:
    """Make a depth image from a picture and the raw numbers of its depth."""
    shape = picture.data.shape[0], picture.data.shape[1]
    sight = reader.eye.camera_model(shape, pose)
    if isinstance(sight, Orthographic):
        encoding = _plain_encoding(reader, ("z", "inverse", "relative", "relative-z"))
        with naming(names[1]):
            nearness = encoding.nearness(raw)
        image, moved = taken_by(sight, _depth_image(picture, names, nearness, reader.is_soft))
        if not isinstance(moved, Orthographic):
            raise TypeError("an orthographic camera stays orthographic")
        return DepthInput(picture, image, moved, None, is_fitted=raw.shape[:2] != shape)
    if isinstance(sight, Equirectangular):
        raise ValueError("a panorama cannot be combined with further views")
    camera, meaning, depth = sight, reader.meaning, names[1]
    depth_camera = meaning.camera(camera, shape, (raw.shape[0], raw.shape[1]))
    encoding = meaning.encoding(depth_camera)
    if isinstance(encoding, RelativeDepth):
        encoding = replace(encoding, ends=reader.ends)
    with naming(depth):
        nearness = encoding.nearness(raw)
    if meaning.confidence is not None:
        nearness = confident(nearness, meaning.confidence, meaning.least_confidence)
    if meaning.depth_intrinsics is not None:
        from resample_warp3d.warping import registered

        _check_known(nearness, depth)
        nearness = registered(nearness, depth_camera, camera, shape)
    image = _depth_image(picture, names, nearness, reader.is_soft)
    image = image._replace(place=lens_places(camera, shape))
    is_fitted = nearness.shape != shape
    is_registered = meaning.depth_intrinsics is not None
    return DepthInput(
        picture, image, camera, encoding.quantum(raw), is_fitted, is_registered=is_registered
    )


def _plain_encoding(reader: DepthReader, kinds: tuple[str, ...]) -> DepthEncoding:
    """Return the encoding of depth whose camera is not a pinhole."""
    meaning = reader.meaning
    if meaning.depth_kind not in kinds or meaning.depth_intrinsics is not None:
        own = " with a separate camera" if meaning.depth_intrinsics is not None else ""
        raise ValueError(
            f"depth of the kind {meaning.depth_kind}{own} does not go with --source-projection"
            f" {reader.eye.source_projection}; known: {', '.join(kinds)}"
        )
    if meaning.depth_kind == "ray":  # ray length is the only kind there, stored like z
        meaning = meaning.model_copy(update={"depth_kind": "z"})
    encoding = meaning.encoding(Camera.from_fov(60.0, 1, 1))
    return replace(encoding, ends=reader.ends) if isinstance(encoding, RelativeDepth) else encoding


def inputs_of(reader: DepthReader, picture: Picture, raw: Raw, names: tuple[str, str]) -> Inputs:
    """Make the inputs of one picture and the raw numbers of its depth; panoramas are split."""
    if reader.eye.source_projection != "equirectangular":
        view = view_of(reader, picture, raw, names, None)
        return Inputs([view], picture, reader.eye.camera_model(view.shape), view.shape)
    from resample_warp3d.views.panoramas import faces

    shape = picture.data.shape[0], picture.data.shape[1]
    check_panorama(shape)
    encoding = _plain_encoding(reader, ("z", "ray", "inverse", "relative", "relative-z"))
    with naming(names[1]):
        nearness = encoding.nearness(raw)
    image = _depth_image(picture, names, nearness, reader.is_soft)
    near = image.nearness
    length = np.divide(1.0, near, out=np.zeros_like(near), where=near > 0)
    camera, is_fitted = reader.eye.camera_model(shape), raw.shape[:2] != shape
    views = [
        DepthInput(Picture(face.color, picture.kind), face, its_camera, None, is_fitted=is_fitted)
        for face, its_camera in faces(image.color, length, camera.world_to_camera)
    ]
    return Inputs(views, picture, camera, shape)


def mention_doubt(reader: DepthReader, view: DepthInput, depth: str) -> None:
    """Warn if the scale of a depth file looks wrong."""
    doubt = check_scale(view.image.nearness)
    if doubt is not None and not reader.meaning.is_relative:
        say(f"{depth}: {doubt}")


def read_views(
    reader: DepthReader, color: str, depth: str, further: Sequence[Sequence[str]] = ()
) -> Inputs:
    """Read a depth image and further ones of the same scene; warn of doubtful poses."""
    check_order(color, depth)
    if further:
        reader.eye.check_pinhole("--view")
    if reader.eye.source_projection == "equirectangular":
        picture = read_names(color) if reader.labels else read_picture(color)
        return inputs_of(reader, picture, read_depth(depth), (color, depth))
    views = [read_view(reader, color, depth)]
    alone = reader.meaning.model_copy(update={"confidence": None})
    views += [read_view(reader._replace(meaning=alone), *names) for names in further]
    first, *others = views
    for other in others:  # whose depths may agree better with the inverses of their poses
        if isinstance(first.camera, Orthographic) or isinstance(other.camera, Orthographic):
            break
        if doubt := pose_warning(first.image, other.image, first.camera, other.camera):
            say(doubt)
            break
    camera = reader.eye.camera_model(views[0].shape)
    return Inputs(views, views[0].picture, camera, views[0].shape)


def bytes_of_source(form: tuple[int, ...]) -> int:
    """Return the peak bytes of a source (height, width, channels) with its depth."""
    return BYTES_PER_VALUE * prod(form)


def check_order(color: str, depth: str) -> None:
    """Refuse a file of numbers as a picture, as of names that were swapped."""
    if Path(color).suffix.lower() in NUMBERS:
        raise ValueError(
            f"{color} holds numbers; give the picture first, then its depth: {depth} {color}"
        )


def rectified_of(picture: Picture, raw: Raw, names: tuple[str, str], scale: float | None) -> Inputs:
    """Make the inputs of one picture of a rectified pair, with disparity in px as nearness."""
    encoding = BareDisparity(scale)
    shape = picture.data.shape[0], picture.data.shape[1]
    if raw.shape != shape:
        raise ValueError(
            f"{names[0]} has {shape[1]} x {shape[0]} pixels, {names[1]} has {raw.shape[1]} x "
            f"{raw.shape[0]}; they must be the same"
        )
    with naming(names[1]):
        nearness = encoding.nearness(raw)
    image = _depth_image(picture, names, nearness)
    camera = Camera.from_fov(60.0, *shape)
    view = DepthInput(picture, image, camera, encoding.quantum(raw))
    return Inputs([view], picture, camera, shape)


def read_names(path: str) -> Picture:
    """Read a label image with its numbers as stored; 8 and 16 bits scaled to 0..1."""
    kind = header_of(Path(path), as_data=False).kind
    stored = read_channels(path)
    data = np.stack([stored[name] for name in kind.channels], axis=2)
    return Picture(np.ascontiguousarray(data), kind)


def _check_known(nearness: Floats, depth: str) -> None:
    """Refuse a map without depth."""
    if not nearness.any():
        raise ValueError(f"{depth} has no depth at all; check its kind and its file")


def _depth_image(
    picture: Picture, names: tuple[str, str], nearness: Floats,
    is_soft: Callable[[Floats], bool] = is_sharpened,
) -> DepthImage:  # fmt: skip
    """Combine picture and nearness at the picture's size; drop pixels with invalid colors."""
    color, depth = names
    height, width, channels = picture.data.shape
    require_memory(
        (BYTES_PER_PIXEL + 12 * channels) * height * width,
        f"{color} of {width} x {height} pixels",
        "take a smaller picture",
    )
    _check_known(nearness, depth)
    try:
        image = fitted(DepthImage(picture.data, nearness), is_soft)
    except ValueError:
        stored = f"{depth} has {nearness.shape[1]} x {nearness.shape[0]}"
        raise ValueError(
            f"{color} has {width} x {height} pixels, {stored}; they must show the same frame, with "
            "sides of one proportion"
        ) from None
    nearness = image.nearness
    is_bad = ~np.isfinite(picture.data).all(axis=2)
    if is_bad.any():
        say(
            f"{color}: {int(is_bad.sum())} pixels have colors that are not numbers; they are "
            "dropped"
        )
        nearness[is_bad] = 0
        picture.data[is_bad] = 0
        if not nearness.any():
            raise ValueError(f"{color} has no color where {depth} has depth")
    return image
