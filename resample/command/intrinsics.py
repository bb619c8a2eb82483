"""Read intrinsics from numbers or files."""

from typing import TYPE_CHECKING

from resample.words import numbers_in

if TYPE_CHECKING:
    from resample.cameras.calibrations.lens_files import Calibration
    from resample.cameras.models import AnyConvention

Shape = tuple[int, int]  # height and width, px
FILES = "a file of Open3D (.json), ROS (.yaml) or OpenCV (.yml, .xml)"


def intrinsic_numbers(name: str, text: str) -> list[float]:
    """Read the numbers fx, fy, cx, cy and skew from a text."""
    numbers = numbers_in(name, text)
    if len(numbers) not in (4, 5):
        raise ValueError(f"{name} {text!r}; give fx,fy,cx,cy or fx,fy,cx,cy,skew")
    return [*numbers, 0.0][:5]


def check_intrinsics(name: str, text: str) -> None:
    """Refuse anything but numbers for `intrinsic_numbers` or a camera file."""
    with_intrinsics(name, text, "corner")


def with_intrinsics(name: str, text: str, convention: "AnyConvention") -> "Calibration":
    """Read intrinsics from numbers, or from a file in its own program's convention."""
    from resample.cameras.calibrations.lens_files import Calibration, is_file, read_intrinsics
    from resample.cameras.models import Camera

    if is_file(text):
        return read_intrinsics(text)
    fx, fy, cx, cy, skew = intrinsic_numbers(name, text)
    return Calibration(
        Camera.from_intrinsics(fx, fy, cx, cy, skew=skew, convention=convention),
    )
