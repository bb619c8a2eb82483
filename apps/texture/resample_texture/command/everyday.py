"""Commands for what is done every day: resize, scale, rotate, undistort."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from resample.command import flags
from resample.command.settings import Written
from resample.files.stores.addresses import Address, Place
from resample_texture.command.aims import Factor, NewSize, Turn, Undistortion
from resample_texture.command.choices import Besides, Filling, Picture, Warping

Files = Annotated[
    list[Picture],
    Parameter(
        help="Pictures, pages, films, folders or patterns, as warp takes them, and last what is "
        "written, unless --output says it."
    ),
]
Output = Annotated[
    flags.OptionalOutput, Parameter(help="Written to: as warp does. The last of the files.")
]

WRITTEN, BESIDES = Written.usual(), Besides.usual()
SIZE, WARPING, FILLING = NewSize.usual(), Warping.usual(), Filling.usual()


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
    """Give pictures another size; the area of each fills its target's exactly.

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
    """Scale pictures by exactly a factor; their sizes are the nearest whole ones.

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
    turn: Annotated[Turn, flags.Flat],
    warping: Annotated[Warping, flags.Flat] = WARPING,
    written: Annotated[Written, flags.Flat] = WRITTEN,
    besides: Annotated[Besides, flags.Flat] = BESIDES,
) -> None:
    """Rotate pictures about their middle; by multiples of 90 degrees pixel for pixel.

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
    warping: Annotated[Warping, flags.Flat] = WARPING,
    written: Annotated[Written, flags.Flat] = WRITTEN,
    besides: Annotated[Besides, flags.Flat] = BESIDES,
) -> None:
    """Take a lens's distortion out of pictures, and rectify them; or put it in.

    Example: resample-texture undistort "shots/*.jpg" straight/ --lens gopro.yml --fisheye
    """
    from resample_texture.command.jobs import warp_all

    images, target = separated(files, output)
    aim = out_of.aim()
    warp_all(images, target, aim, warping=warping, written=written, besides=besides)


def separated(files: list[Place], output: Path | None) -> tuple[list[Place], Path]:
    """Pictures, and what is written of them.

    Raises
    ------
    ValueError
        There is nothing to write to, or it is an address.
    """
    if output is not None:
        return files, output
    if len(files) < 2:
        raise ValueError(f"give what is written after {files[0]}, or by --output")
    *images, target = files
    if isinstance(target, Address):
        raise ValueError(f"{target} lies elsewhere; pictures are written to files and folders")
    return images, target
