"""Read calibrated lenses from files or text, in OpenCV's parameters."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from resample.cameras.models import Camera, LensModel
from resample.cameras.poses import turned_by
from resample.cameras.trajectories import columns_of
from resample.messages import naming, numbers_in
from resample.reading.limits import check_file, check_size
from resample.reading.texts import check_xml_text, json_of, text_of, toml_of, yaml_of
from resample.types import Doubles

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

SUFFIXES = (".yml", ".yaml", ".xml", ".json", ".toml")
MATRIX_NAMES = ("camera_matrix", "cameraMatrix", "matrix", "mtx", "K")
COEFFICIENT_NAMES = (
    *("distortion_coefficients", "dist_coeffs", "distCoeffs", "coefficients", "dist"),
    *("distortion", "D"),
)

MODEL_NAMES = ("lens_model", "distortion_model", "model")
ROTATION_NAMES = ("rectification_matrix", "rectification", "R_rect")
PINHOLE_NAMES = ("new_camera_matrix", "newCameraMatrix", "new_matrix", "projection_matrix")
MODELS = {  # names in OpenCV, ROS and COLMAP
    **dict.fromkeys(("pinhole", "plumb_bob", "rational_polynomial", "opencv"), LensModel.PINHOLE),
    **dict.fromkeys(("fisheye", "equidistant", "opencv_fisheye"), LensModel.FISHEYE),
}
SIZE_NAMES = (("image_height", "image_width"), ("height", "width"))
ROS_NAMES = {  # keys of the message camera_info of ROS 1 and 2
    **dict.fromkeys("Kk", ("camera_matrix", (3, 3))),
    **dict.fromkeys("Dd", ("distortion_coefficients", (-1,))),
    **dict.fromkeys("Rr", ("rectification_matrix", (3, 3))),
    **dict.fromkeys("Pp", ("projection_matrix", (3, 4))),
}


class Calibration(NamedTuple):
    """A camera with a lens, and the pinhole camera to rectify its pictures for."""

    camera: Camera  # its pose is the identity
    pinhole: Camera | None = None  # only its matrix is used; None: the camera's own
    rotation: Doubles | None = None  # (3, 3) from the camera's axes to the pinhole's
    shape: tuple[int, int] | None = None  # height and width of its pictures, px; None: unknown

    def sized(self, height: int, width: int) -> Camera:
        """Camera of the same view for a picture of another size in px."""
        if self.shape in (None, (height, width)):
            return self.camera
        old_height, old_width = self.shape or (height, width)
        if abs(old_height * width - old_width * height) > max(old_height, old_width):
            raise ValueError(
                f"intrinsics for {old_width} x {old_height} pixels do not fit a picture of"
                f" {width} x {height}, which has other proportions; give its own as fx,fy,cx,cy"
            )
        return self.camera.resized((old_height, old_width), (height, width))


def is_file(text: str) -> bool:
    """Whether a text names a file of intrinsics rather than giving numbers."""
    return Path(text).suffix.lower() in SUFFIXES


def read_lens(text: str) -> Camera:
    """Read a camera with a lens from a file or numbers; its pose is the identity.

    Parameters and errors as in `read_calibration`.
    """
    return read_calibration(text).camera


def read_intrinsics(path: str) -> Calibration:
    """Read a camera from a file for `read_calibration`; a lens is optional."""
    return _of_file(Path(path), None, needs_lens=False)


def read_calibration(text: str, model: LensModel | None = None) -> Calibration:
    """Read a camera with a lens, from a file or numbers, and its rectification.

    `text`: fx, fy, cx, cy, k1, k2, p1, p2[, k3...], for a fisheye fx, fy, cx, cy, k1, k2, k3, k4;
    or the path of a .yml, .yaml, .xml or .json file of `cv2.FileStorage`, or of a .json, .toml or
    plain .yaml file with a camera_matrix and distortion_coefficients, and optionally a lens_model
    (pinhole or fisheye), a rectification_matrix (3, 3), and a new_camera_matrix (3, 3) or (3, 4);
    of a camera_info .yaml of ROS, from its calibrator or a printed message; or of Open3D's .json of
    a pinhole.
    """
    if is_file(text):
        return _of_file(Path(text), model, needs_lens=True)
    numbers = numbers_in("lens", text)
    if len(numbers) < 8:
        wanted = "k1,k2,k3,k4" if model == LensModel.FISHEYE else "k1,k2,p1,p2 or more"
        raise ValueError(
            f"lens {text!r}; give fx,fy,cx,cy,{wanted}, or a .yml, .json or .toml file"
        )
    camera = Camera.from_opencv(numbers[:4], numbers[4:], model=model or LensModel.PINHOLE)
    return Calibration(camera)


def pinhole_of(matrix: ArrayLike) -> Camera:
    """Pinhole camera of OpenCV's new camera matrix, (3, 3), or (3, 4) without its last column."""
    given = np.asarray(matrix, np.float64)
    return Camera.from_opencv(given[:, :3] if given.shape == (3, 4) else given)


def _of_file(path: Path, model: LensModel | None, *, needs_lens: bool) -> Calibration:
    """Read a file and check that its model agrees."""
    check_file(path)
    facts = _facts(path)
    with naming(str(path)):
        if "intrinsic" in facts or "intrinsic_matrix" in facts:
            inner = facts.get("intrinsic", facts)  # Open3D's, with pixel centers at + 0
            matrix = columns_of(inner, "intrinsic_matrix", 3)
            return Calibration(Camera.from_opencv(matrix), shape=_shape(inner))
        # Calibration from names and values.
        if "distortion_model" in facts:  # convert keys of a ROS message to keys of ROS files
            own = {key: value for key, value in facts.items() if key in ROS_NAMES}
            for name, given in own.items():
                full, shape = ROS_NAMES[name]
                if given is not None and full not in facts:
                    facts = {**facts, full: np.asarray(given, np.float64).reshape(shape)}
        named = next((facts[key] for key in MODEL_NAMES if key in facts), None)
        said = MODELS.get(str(named).lower())
        if named is None:  # OpenCV's calibration program writes a number
            said = LensModel.FISHEYE if facts.get("fisheye_model") in (1, 1.0, "1") else None
        elif said is None:
            raise ValueError(f"unknown lens model {named!r}; known: {', '.join(MODELS)}")
        if model is not None and said not in (None, model):
            raise ValueError(f"its lens is a {said}, not a {model}; leave that out")
        intrinsics = _named(facts, MATRIX_NAMES)
        bends = (_named if needs_lens else _maybe)(facts, COEFFICIENT_NAMES)
        if bends is not None and not bends.size:  # ROS: an empty list if there is no distortion
            bends = None
        camera = Camera.from_opencv(intrinsics, bends, model=model or said or LensModel.PINHOLE)
        matrix, rotation = (_maybe(facts, names) for names in (PINHOLE_NAMES, ROTATION_NAMES))
        return Calibration(
            camera,
            None if matrix is None else pinhole_of(matrix),
            None if rotation is None else turned_by(rotation),
            _shape(facts),
        )


def _shape(facts: Mapping[str, Any]) -> tuple[int, int] | None:
    """Height and width in a file."""
    for names in SIZE_NAMES:
        if all(facts.get(name) is not None for name in names):
            height, width = (int(facts[name]) for name in names)
            if min(height, width) < 0:
                raise ValueError(f"it is for pictures of {width} x {height} pixels")
            return (height, width) if height and width else None
    return None


def _facts(path: Path) -> Mapping[str, Any]:
    """Names and values of a file."""
    suffix = path.suffix.lower()
    if suffix == ".xml":
        # Parse an XML file of `cv2.FileStorage`, which itself crashes on damaged ones.
        from xml.etree import ElementTree

        text = text_of(path)
        check_size("its XML", len(text), "tree")
        check_xml_text(str(path), text)
        try:
            root = ElementTree.fromstring(text)  # noqa: S314  no entities, limited length
        except (ElementTree.ParseError, ValueError, RecursionError) as error:
            raise ValueError(f"{path} is not a file of cv2.FileStorage: {error}") from None
        if root.tag != "opencv_storage":
            raise ValueError(
                f"{path} is not a file of cv2.FileStorage: it begins with {root.tag!r:.40}"
            )
        with naming(str(path)):
            return {child.tag: _of_element(child) for child in root}
    text = text_of(path)
    with naming(str(path)):
        if suffix == ".toml":
            return toml_of(text)
        if suffix != ".json":
            return yaml_of(text)
        loaded = json_of(text)
        if not isinstance(loaded, dict):
            raise ValueError("it holds no names")
        return loaded


def _of_element(element: "Element") -> Any:
    """Convert an element to a matrix, text, number or list of numbers."""
    if len(element):
        return {child.tag: _of_element(child) for child in element}
    text = (element.text or "").strip()
    words = [] if text.startswith('"') else text.split()
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        return text.strip('"')
    if element.tag == "data" or len(numbers) > 1:
        return numbers
    return numbers[0] if numbers else text.strip('"')


def _named(facts: Mapping[str, Any], names: tuple[str, ...]) -> Doubles:
    """Array of the first name that is present."""
    found = _maybe(facts, names)
    if found is None:
        raise ValueError(f"it has none of {', '.join(names)}")
    return found


def _maybe(facts: Mapping[str, Any], names: tuple[str, ...]) -> Doubles | None:
    """Array of the first name that is present, if any."""
    for name in names:
        if name in facts:
            value = facts[name]
            if isinstance(value, Mapping):  # a matrix of cv2.FileStorage in JSON, or of ROS
                given = value["sizes"] if "sizes" in value else (value["rows"], value["cols"])
                value = np.reshape(value["data"], tuple(int(size) for size in np.ravel(given)[:2]))
            return np.asarray(value, np.float64)
    return None
