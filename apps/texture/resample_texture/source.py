"""Pictures, lenses and geometry as files and words say them."""

import errno
import json
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from resample.console import require_memory
from resample.images import read_image
from resample.types import Floats

if TYPE_CHECKING:
    from resample_texture.lenses import Lens

BYTES_PER_VALUE = 20  # of a source and the copies that are made while it is read and warped
MATRIX_NAMES = ("camera_matrix", "cameraMatrix", "matrix", "mtx", "K")
COEFFICIENT_NAMES = (
    *("distortion_coefficients", "dist_coeffs", "distCoeffs", "coefficients", "dist"),
    *("distortion", "D"),
)


class Kind(NamedTuple):
    """What a picture's file says about its values."""

    channels: tuple[str, ...]  # of those that `read_picture` gives; alpha is called A and is last
    bits: int  # per channel: 8, 16, or 32 for floats
    is_encoded: bool  # by the sRGB curve

    @property
    def has_alpha(self) -> bool:
        return "A" in self.channels


class Picture(NamedTuple):
    """A picture in linear light, premultiplied."""

    data: Floats  # (H, W, C)
    kind: Kind


def read_picture(path: str | Path) -> Picture:
    """Read a picture in linear light, premultiplied, and what its file says.

    Parameters
    ----------
    path
        Any format that OpenImageIO reads.

    Raises
    ------
    OSError
        The file is missing or damaged.
    ValueError
        It does not fit into this machine's memory.
    """
    height, width, stored, kind = _header(Path(path))
    require_memory(
        BYTES_PER_VALUE * height * width * stored,
        f"{path} of {width} x {height} pixels",
        "take a smaller picture",
    )
    data = read_image(path)
    if kind.has_alpha:
        n = kind.channels.index("A")
        order = [c for c in range(len(kind.channels)) if c != n] + [n]
        data = data[..., order]
        kind = kind._replace(channels=tuple(kind.channels[c] for c in order))
    return Picture(np.ascontiguousarray(data), kind)


def read_lens(text: str) -> "Lens":
    """Lens of a file, or of numbers.

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
    from resample_texture.lenses import Lens

    path = Path(text)
    if path.suffix.lower() in (".yml", ".yaml", ".xml", ".json", ".toml"):
        facts = _lens_facts(path)
        try:
            return Lens(_named(facts, MATRIX_NAMES), _named(facts, COEFFICIENT_NAMES))
        except (ValueError, TypeError) as error:
            raise ValueError(f"{path}: {error}") from None
    numbers = numbers_in("lens", text)
    if len(numbers) < 8:
        raise ValueError(
            f"lens {text!r}; give fx,fy,cx,cy,k1,k2,p1,p2 or more, or a .yml, .json or .toml file"
        )
    return Lens(np.array(numbers[:4]), np.array(numbers[4:]))


def numbers_in(name: str, text: str, count: int | None = None) -> list[float]:
    """Finite numbers of a text, separated by commas or blanks.

    Raises
    ------
    ValueError
        There is something else, or another count.
    """
    try:
        numbers = [float(part) for part in re.split(r"[\s,;]+", text.strip())]
    except ValueError:
        numbers = []
    if not numbers or not np.isfinite(numbers).all() or len(numbers) != (count or len(numbers)):
        wanted = "numbers" if count is None else f"{count} numbers"
        raise ValueError(f"{name} {text!r}; give {wanted} separated by commas")
    return numbers


def _header(path: Path) -> tuple[int, int, int, Kind]:
    """Height, width, number of stored channels, and what is said about the values."""
    import OpenImageIO

    if not path.is_file():
        raise FileNotFoundError(errno.ENOENT, "there is no such file", str(path))
    source = OpenImageIO.ImageInput.open(str(path))
    if source is None:
        reason = OpenImageIO.geterror().strip().partition("\n")[0] or "no reason is given"
        raise OSError(f"{path} is not a picture that can be read: {reason}")
    spec = source.spec()
    source.close()
    names = list(spec.channelnames)
    bits = {"uint8": 8, "uint16": 16}.get(str(spec.format), 32)
    space = spec.get_string_attribute("oiio:ColorSpace").lower()
    is_encoded = "srgb" in space or (bits < 32 and "lin" not in space)
    shown = tuple(name for name in "RGBA" if name in names) if "R" in names else tuple(names)
    return spec.height, spec.width, spec.nchannels, Kind(shown, bits, is_encoded)


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
