"""Everyday commands: resize, scale, rotate, undistort."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from resample.command import flags
from resample.command.settings import Written
from resample.files.stores.opening import Address, Place
from resample_texture.command.aims import Factor, NewSize, Rotation, Undistortion
from resample_texture.command.choices import Besides, Filling, Picture, PictureWarping

Files = Annotated[
    list[Picture],
    Parameter(
        help="Pictures, pages, films, folders or patterns, as in warp, followed by the output "
        "unless --output names it."
    ),
]
Output = Annotated[
    flags.OptionalOutput, Parameter(help="As in warp. Default: the last of the files.")
]

WRITTEN, BESIDES = Written.usual(), Besides.usual()
SIZE, WARPING, FILLING = NewSize.usual(), PictureWarping.usual(), Filling.usual()


def resize(
    files: Files,
    /,
    *,
    output: Output = None,
    new: Annotated[NewSize, flags.Flat] = SIZE,
    warping: Annotated[Filling, flags.Flat] = FILLING,
    written: Annotated[Written, flags.Flat] = WRITTEN,
    besides: Annotated[Besides, flags.Flat] = BESIDES,
) -> None:
    """Resize pictures; each fills its target exactly.

    Example: resample-texture resize photo.jpg small.jpg --size 50%
    """
    from resample_texture.command.jobs import warp_all

    new.check()
    images, target = separated(files, output)
    warp_all(images, target, new.target, warping=warping, written=written, besides=besides)


def scale(
    files: Files,
    /,
    *,
    output: Output = None,
    by: Annotated[Factor, flags.Flat],
    warping: Annotated[Filling, flags.Flat] = FILLING,
    written: Annotated[Written, flags.Flat] = WRITTEN,
    besides: Annotated[Besides, flags.Flat] = BESIDES,
) -> None:
    """Scale pictures by an exact factor; their sizes are rounded to whole px.

    Example: resample-texture scale map.tif half.tif --factor 0.5
    """
    from resample_texture.command.jobs import warp_all

    by.check()
    images, target = separated(files, output)
    warp_all(images, target, by.target, warping=warping, written=written, besides=besides)


def rotate(
    files: Files,
    /,
    *,
    output: Output = None,
    turn: Annotated[Rotation, flags.Flat],
    warping: Annotated[PictureWarping, flags.Flat] = WARPING,
    written: Annotated[Written, flags.Flat] = WRITTEN,
    besides: Annotated[Besides, flags.Flat] = BESIDES,
) -> None:
    """Rotate pictures about their center; multiples of 90 degrees copy pixels.

    Example: resample-texture rotate photo.png straight.png --degrees -1.5 --keep-size
    """
    from resample_texture.command.jobs import warp_all

    images, target = separated(files, output)
    warp_all(images, target, turn.target, warping=warping, written=written, besides=besides)


def undistort(
    files: Files,
    /,
    *,
    output: Output = None,
    out_of: Annotated[Undistortion, flags.Flat],
    warping: Annotated[PictureWarping, flags.Flat] = WARPING,
    written: Annotated[Written, flags.Flat] = WRITTEN,
    besides: Annotated[Besides, flags.Flat] = BESIDES,
) -> None:
    """Remove a lens's distortion from pictures and rectify them, or add it.

    Example: resample-texture undistort "shots/*.jpg" straight/ --lens gopro.yml --fisheye
    """
    from resample_texture.command.jobs import warp_all

    images, target = separated(files, output)
    aim = out_of.aim()
    warp_all(images, target, aim, warping=warping, written=written, besides=besides)


def separated(files: list[Place], output: Path | None) -> tuple[list[Place], Path]:
    """Separate the pictures from the output.

    Raises
    ------
    ValueError
        There is no output, or it is an address.
    """
    if output is not None:
        return files, output
    if len(files) < 2:
        raise ValueError(f"give the output after {files[0]}, or by --output")
    *images, target = files
    if isinstance(target, Address):
        raise ValueError(f"{target} lies elsewhere; pictures are written to files and folders")
    return images, target
