"""Calibrated lenses as files and words say them, in OpenCV's numbers."""

import errno
import json
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from resample.cameras.models import Camera, LensModel
from resample.cameras.poses import turned_by
from resample.types import Doubles
from resample.words import naming, numbers_in

MATRIX_NAMES = ("camera_matrix", "cameraMatrix", "matrix", "mtx", "K")
COEFFICIENT_NAMES = (
    *("distortion_coefficients", "dist_coeffs", "distCoeffs", "coefficients", "dist"),
    *("distortion", "D"),
)

MODEL_NAMES = ("lens_model", "distortion_model", "model")
ROTATION_NAMES = ("rectification_matrix", "rectification", "R_rect")
PINHOLE_NAMES = ("new_camera_matrix", "newCameraMatrix", "new_matrix", "projection_matrix")
MODELS = {  # as OpenCV, ROS and COLMAP call them
    **dict.fromkeys(("pinhole", "plumb_bob", "rational_polynomial", "opencv"), LensModel.PINHOLE),
    **dict.fromkeys(("fisheye", "equidistant", "opencv_fisheye"), LensModel.FISHEYE),
}


class Calibration(NamedTuple):
    """A camera with a lens, and the pinhole that its pictures are to be rectified for."""

    camera: Camera  # its pose is the identity
    pinhole: Camera | None = None  # of which the matrix matters; None: the camera's own
    rotation: Doubles | None = None  # (3, 3) from the camera's axes to the pinhole's


def read_lens(text: str) -> Camera:
    """Camera with a lens, of a file or of numbers; its pose is the identity.

    Parameters and errors are those of `read_calibration`.
    """
    return read_calibration(text).camera


def read_calibration(text: str, model: LensModel | None = None) -> Calibration:
    """Camera with a lens, of a file or of numbers, and what its pictures are rectified to.

    Parameters
    ----------
    text
        fx, fy, cx, cy, k1, k2, p1, p2[, k3...], of a fisheye fx, fy, cx, cy, k1, k2, k3, k4; or the
        path of a .yml, .yaml, .xml or .json file of `cv2.FileStorage`, or of a .json or .toml file,
        with a camera_matrix and distortion_coefficients, and maybe a lens_model (pinhole or
        fisheye), a rectification_matrix (3, 3), and a new_camera_matrix (3, 3) or (3, 4).
    model
        What the coefficients mean; by default what the file says, or a pinhole's.

    Raises
    ------
    ValueError
        It is neither, they are not a lens, or the file speaks of another model.
    OSError
        The file cannot be read.
    """
    path = Path(text)
    if path.suffix.lower() in (".yml", ".yaml", ".xml", ".json", ".toml"):
        facts = _lens_facts(path)
        with naming(str(path)):
            return _calibration(facts, model)
    numbers = numbers_in("lens", text)
    if len(numbers) < 8:
        wanted = "k1,k2,k3,k4" if model == LensModel.FISHEYE else "k1,k2,p1,p2 or more"
        raise ValueError(
            f"lens {text!r}; give fx,fy,cx,cy,{wanted}, or a .yml, .json or .toml file"
        )
    camera = Camera.from_opencv(numbers[:4], numbers[4:], model=model or LensModel.PINHOLE)
    return Calibration(camera)


def pinhole_of(matrix: ArrayLike) -> Camera:
    """Pinhole of OpenCV's new camera matrix, (3, 3), or (3, 4), of which it takes no more either.

    Raises
    ------
    ValueError
        It is none.
    """
    given = np.asarray(matrix, np.float64)
    return Camera.from_opencv(given[:, :3] if given.shape == (3, 4) else given)


def _calibration(facts: Mapping[str, Any], model: LensModel | None) -> Calibration:
    """What a file says, with a model that it does not contradict."""
    said = _model(facts)
    if model is not None and said not in (None, model):
        raise ValueError(f"its lens is a {said}, not a {model}; leave that out")
    intrinsics, bends = (_named(facts, names) for names in (MATRIX_NAMES, COEFFICIENT_NAMES))
    camera = Camera.from_opencv(intrinsics, bends, model=model or said or LensModel.PINHOLE)
    matrix, rotation = (_maybe(facts, names) for names in (PINHOLE_NAMES, ROTATION_NAMES))
    return Calibration(
        camera,
        None if matrix is None else pinhole_of(matrix),
        None if rotation is None else turned_by(rotation),
    )


def _model(facts: Mapping[str, Any]) -> LensModel | None:
    """Model that a file names."""
    said = next((facts[name] for name in MODEL_NAMES if name in facts), None)
    if said is None:
        return None
    if str(said).lower() not in MODELS:
        raise ValueError(f"unknown lens model {said!r}; known: {', '.join(MODELS)}")
    return MODELS[str(said).lower()]


def _lens_facts(path: Path) -> Mapping[str, Any]:
    if not path.is_file():
        raise FileNotFoundError(errno.ENOENT, "there is no such file", str(path))
    try:
        if path.suffix.lower() == ".toml":
            return tomllib.loads(path.read_text(encoding="utf-8"))
        if path.suffix.lower() == ".json":
            loaded = json.loads(path.read_text(encoding="utf-8"))
            if not isinstance(loaded, dict):
                raise ValueError("it holds no names")
            return loaded
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    return _opencv_facts(path)


def _opencv_facts(path: Path) -> Mapping[str, Any]:
    """Matrices of a file that `cv2.FileStorage` wrote."""
    import cv2

    try:
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
        nodes = [(name, storage.getNode(name)) for name in storage.root().keys()]  # noqa: SIM118
        facts = {name: node.mat() for name, node in nodes if node.isMap()}
        facts |= {name: node.string() for name, node in nodes if node.isString()}
        storage.release()
    except (cv2.error, SystemError, UnicodeDecodeError):
        raise ValueError(
            f"{path} is no file of cv2.FileStorage; such a .yml begins with %YAML:1.0"
        ) from None
    return facts


def _named(facts: Mapping[str, Any], names: tuple[str, ...]) -> Doubles:
    """Array under the first of some names."""
    found = _maybe(facts, names)
    if found is None:
        raise ValueError(f"it has none of {', '.join(names)}")
    return found


def _maybe(facts: Mapping[str, Any], names: tuple[str, ...]) -> Doubles | None:
    """Array under the first of some names, if there is one."""
    for name in names:
        if name in facts:
            value = facts[name]
            if isinstance(value, Mapping):  # as cv2.FileStorage writes a matrix to JSON, and ROS
                value = np.reshape(value["data"], (value["rows"], value["cols"]))
            return np.asarray(value, np.float64)
    return None
