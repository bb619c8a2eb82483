"""Intrinsics as words or files."""

from typing import TYPE_CHECKING

from resample.words import numbers_in

if TYPE_CHECKING:
    from resample.cameras.calibrations.lens_files import Calibration

Shape = tuple[int, int]  # height and width, px
FILES = "a file of Open3D (.json), ROS (.yaml) or OpenCV (.yml, .xml)"


def intrinsic_numbers(name: str, text: str) -> list[float]:
    """The numbers fx, fy, cx, cy and skew of a text.

    Raises
    ------
    ValueError
        There are others than four or five.
    """
    numbers = numbers_in(name, text)
    if len(numbers) not in (4, 5):
        raise ValueError(f"{name} {text!r}; give fx,fy,cx,cy or fx,fy,cx,cy,skew")
    return [*numbers, 0.0][:5]


def check_intrinsics(name: str, text: str) -> None:
    """Refuse what is neither numbers as `intrinsic_numbers` takes them nor a file of a camera."""
    with_intrinsics(name, text, "corner")


def with_intrinsics(name: str, text: str, convention: str) -> "Calibration":
    """Camera of intrinsics, of numbers or of a file, which counts as its program does.

    Raises
    ------
    ValueError, OSError
        It is neither, or the file cannot be read.
    """
    from resample.cameras.calibrations.lens_files import Calibration, is_file, read_intrinsics
    from resample.cameras.models import Camera

    if is_file(text):
        return read_intrinsics(text)
    fx, fy, cx, cy, skew = intrinsic_numbers(name, text)
    return Calibration(
        Camera.from_intrinsics(fx, fy, cx, cy, skew=skew, convention=convention),
    )
