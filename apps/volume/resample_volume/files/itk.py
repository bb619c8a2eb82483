"""SimpleITK, with its habits tamed: one line per error, nothing printed, nothing tolerated.

What ITK 5.4 tolerates is found in `integrity` before it is asked to read.
"""

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from resample_volume.files.headers import Header, header, recording
from resample_volume.files.memory import require_memory
from resample_volume.files.suppression import suppressed_output
from resample_volume.media.recordings import is_color
from resample_volume.types import Recording

# Pixel types whose name in lower case is NumPy's.
INTEGERS = ("UInt8", "Int8", "UInt16", "Int16", "UInt32", "Int32", "UInt64", "Int64")
PLAIN = (*INTEGERS, "Float32", "Float64")

# `[nrrd] function:`, `ITK ERROR: Class(0x55d2):` and the like
ORIGIN = re.compile(r"^(\[\w+\]\s*\w+:|(\w+::)?.*?ERROR:)\s*(\w+\(0x\w+\):)?\s*")

HOUNSFIELD = ("hu", "hounsfield", "hounsfield unit", "hounsfield units")

Result = TypeVar("Result")


def read_header(path: Path, image_io: str, name: str) -> tuple[Any, Header]:
    """Reader of a file, ready to be executed, and what its header says.

    Parameters
    ----------
    path
        A file that exists.
    image_io
        ITK's class for the format; without it ITK asks every format it knows, HDF5 loudly.
    name
        For messages.
    """
    import SimpleITK

    with suppressed_output():
        reader = SimpleITK.ImageFileReader()
        reader.SetFileName(str(path))
        reader.SetImageIO(image_io)
        attempt(name, reader.ReadImageInformation)
    return reader, described(reader, name)._replace(units=units_told(reader))


def units_told(reader: Any) -> str:
    """What a reader's file says that its values are: hu, or nothing that is known.

    Values of a DICOM file of computed tomography are, where it does not say that its rescaling
    makes anything else of them (US is "unspecified").
    """
    if told(reader, "0008|0060") == "CT":
        return "hu" if told(reader, "0028|1054") in ("", "HU", "US") else ""
    words = [told(reader, key) for key in ("units", "intent_name")]
    return "hu" if any(is_hounsfield(word) for word in words) else ""


def told(reader: Any, key: str) -> str:
    """Word of a file's header; nothing where there is none."""
    return str(reader.GetMetaData(key)).strip() if reader.HasMetaDataKey(key) else ""


def is_hounsfield(word: str) -> bool:
    """Whether a word is a name of Hounsfield units."""
    return word.strip("\"'= ").lower() in HOUNSFIELD


def read_values(reader: Any, known: Header) -> Recording:
    """Execute a reader whose header has been checked."""
    import SimpleITK

    require_memory(2 * known.size, known.name)  # ITK's image and NumPy's copy
    with suppressed_output():
        image = attempt(known.name, reader.Execute)
        return recording(SimpleITK.GetArrayFromImage(image), known)


def described(source: Any, name: str) -> Header:
    """Header of an ITK reader or image.

    A reader still has the file's own numbers; an image's negative spacing has become a mirrored
    direction. They are refused before that happens.
    """
    import SimpleITK

    of_image = isinstance(source, SimpleITK.Image)
    parts = source.GetNumberOfComponentsPerPixel() if of_image else source.GetNumberOfComponents()
    pixel = source.GetPixelID()
    text = SimpleITK.GetPixelIDValueAsString(pixel)
    types = {getattr(SimpleITK, f"sitk{kind}"): kind.lower() for kind in PLAIN}
    types |= {getattr(SimpleITK, f"sitkVector{kind}"): kind.lower() for kind in PLAIN}
    if pixel not in types:
        raise ValueError(
            f"{name} has voxels of type {text!r}, {parts} numbers each; "
            "a volume has one real number per voxel: extract a component"
        )
    count, size = source.GetDimension(), source.GetSize()
    if count not in (3, 4):  # ITK's direction has that many rows
        return header(size, types[pixel], name)
    known = header(
        size[:3],
        types[pixel],
        name,
        spacing=source.GetSpacing()[:3],
        origin=source.GetOrigin()[:3],
        direction=np.reshape(source.GetDirection(), (count, count))[:3, :3],
    )
    return known._replace(
        times=math.prod(size[3:]),
        parts=parts,
        is_color=is_color((parts,), known.dtype),
        pixel=text,
    )


def attempt(name: str, call: Callable[[], Result]) -> Result:
    """Run a call of SimpleITK; its pages of C++ become one line."""
    try:
        return call()
    except RuntimeError as error:
        raise ValueError(f"{name} cannot be read: {reason(error)}") from None


def reason(error: Exception) -> str:
    """Last line of a C++ exception, which is where the cause is, without where it was thrown."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return ORIGIN.sub("", lines[-1]).rstrip(".!") if lines else type(error).__name__
