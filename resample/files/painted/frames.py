"""Write rendered scenes in any picture format."""

from pathlib import Path
from typing import Any

from resample.console.backgrounds import Color
from resample.files import images, pictures
from resample.types import Frame

PICTURES = (".jpg", ".jpeg", ".tif", ".tiff")
SUFFIXES = (*images.SUFFIXES, *PICTURES)


def check_frame(path: Path, bits: int, background: Color | None) -> None:
    """Reject a target that `write_frame` would reject, before any work is done.

    Raises
    ------
    ValueError
        The suffix is unknown, or the format lacks transparency or this bit depth.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise ValueError(f"{path}: pictures are written as {', '.join(SUFFIXES)}")
    if suffix in PICTURES:
        pictures.check_output(path, pictures.WriteOptions(bits, background), transparent=True)
    elif suffix == ".png" and bits not in (8, 16):
        raise ValueError(f"{path}: PNG has 8 or 16 bits per channel, not {bits}")


def write_frame(path: Path, frame: Frame[Any], bits: int, background: Color | None) -> None:
    """Write a rendered scene in the format of its suffix.

    Parameters
    ----------
    path
        Target with a suffix in `SUFFIXES`.
    frame
        EXR stores all of it, other formats only its `rgba`.
    bits
        Bits per channel; 32 are floats of linear light. EXR has 32.
    background
        Linear background color; None keeps transparency.

    Raises
    ------
    ValueError
        The format cannot store it.
    OSError
        The file cannot be written.
    """
    check_frame(path, bits, background)
    if path.suffix.lower() not in PICTURES:
        images.write_frame(path, frame, bits=bits, background=background)
        return
    kind = pictures.Kind(("R", "G", "B", "A"), bits, is_encoded=bits != 32)
    look = pictures.WriteOptions(bits, background)
    pictures.write_picture(path, pictures.Picture(frame.rgba, kind), look)
