"""Check compressed frames of DICOM files before they are decoded."""

from typing import Any

from resample.reading.codestreams import size_of
from resample.reading.limits import LimitError


def check_frames(dataset: Any, name: str) -> None:
    """Reject compressed frames whose own size differs from the header's."""
    from pydicom.encaps import generate_frames

    wanted = (int(dataset.Rows), int(dataset.Columns))
    count = int(dataset.get("NumberOfFrames", 1) or 1)
    for frame in generate_frames(dataset.PixelData, number_of_frames=count):
        size = size_of(frame)
        if size is not None and size != wanted:
            raise LimitError(
                f"{name} holds a picture of {size[1]} x {size[0]} pixels and says that it has "
                f"{wanted[1]} x {wanted[0]}; get it again"
            )
