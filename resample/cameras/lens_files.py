"""Calibrated lenses as files and words say them, in OpenCV's numbers."""

import errno
import json
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from resample.cameras.models import Camera
from resample.words import naming, numbers_in

MATRIX_NAMES = ("camera_matrix", "cameraMatrix", "matrix", "mtx", "K")
COEFFICIENT_NAMES = (
    *("distortion_coefficients", "dist_coeffs", "distCoeffs", "coefficients", "dist"),
    *("distortion", "D"),
)


def read_lens(text: str) -> Camera:
    """Camera with a lens, of a file or of numbers; its pose is the identity.

    Parameters
    ----------
    text
        fx, fy, cx, cy, k1, k2, p1, p2[, k3...]; or the path of a .yml, .yaml, .xml or .json file
        of `cv2.FileStorage`, or of a .json or .toml file, with a camera_matrix and
        distortion_coefficients.

    Raises
    ------
    ValueError
        It is neither, or they are not a lens.
    OSError
        The file cannot be read.
    """
    path = Path(text)
    if path.suffix.lower() in (".yml", ".yaml", ".xml", ".json", ".toml"):
        facts = _lens_facts(path)
        with naming(str(path)):
            return Camera.from_opencv(_named(facts, MATRIX_NAMES), _named(facts, COEFFICIENT_NAMES))
    numbers = numbers_in("lens", text)
    if len(numbers) < 8:
        raise ValueError(
            f"lens {text!r}; give fx,fy,cx,cy,k1,k2,p1,p2 or more, or a .yml, .json or .toml file"
        )
    fx, fy, cx, cy, *coefficients = numbers
    return Camera.from_intrinsics(fx, fy, cx, cy, distortion=coefficients, convention="opencv")


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
        storage.release()
    except (cv2.error, SystemError, UnicodeDecodeError):
        raise ValueError(
            f"{path} is no file of cv2.FileStorage; such a .yml begins with %YAML:1.0"
        ) from None
    return facts


def _named(facts: Mapping[str, Any], names: tuple[str, ...]) -> Any:
    """Array under the first of some names."""
    for name in names:
        if name in facts:
            value = facts[name]
            if isinstance(value, Mapping):  # as cv2.FileStorage writes a matrix to JSON, and ROS
                value = np.reshape(value["data"], (value["rows"], value["cols"]))
            return np.asarray(value, np.float64)
    raise ValueError(f"it has none of {', '.join(names)}")
