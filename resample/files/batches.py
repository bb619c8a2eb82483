"""Batches of files: folders and glob patterns; results go to a folder under the same names."""

import glob
from collections.abc import Iterator, Sequence
from pathlib import Path

from resample.files.chunked import is_in_store
from resample.files.formats import SUFFIXES
from resample.files.sequences import FILMS, WRITTEN, frames_of
from resample.files.stores.addresses import STORE, Address, Place

READ = (*SUFFIXES, *WRITTEN, *FILMS, ".bmp", ".hdr", ".jp2", ".jxl", ".pgm", ".ppm", ".pfm", ".tga")


def is_batch(images: Sequence[Place], output: Path) -> bool:
    """Whether results go to a folder: for several files, a folder or a pattern, or if it is one."""
    is_folder = output.is_dir() and output.suffix.lower() not in (*SUFFIXES, STORE)
    return len(images) > 1 or is_folder or _is_of_files(images[0])


def batch_of(images: Sequence[Place], output: Path) -> list[tuple[Place, Path]]:
    """Expand arguments to pairs of source and target."""
    sources = list(dict.fromkeys(file for image in images for file in _files(image)))
    if not sources:
        raise ValueError(f"{', '.join(map(str, images))}: no pictures found")
    if output.exists() and not output.is_dir():
        raise OSError(f"{output} is not a folder; several pictures are written to one")
    if not output.exists() and output.suffix:
        raise ValueError(f"{output}: several pictures are written to a folder; give its name")
    pairs = [(source, output / _name(source)) for source in sources]
    taken: dict[Path, Place] = {}
    for source, target in pairs:
        if target in taken:
            raise ValueError(f"{taken[target]} and {source} would both become {target}")
        if target.resolve() in {source.resolve() for source in sources}:
            raise ValueError(f"{target} would be replaced; give another folder")
        taken[target] = source
    return pairs


def _is_of_files(place: Place) -> bool:
    if isinstance(place, Address) or is_in_store(place):
        return False
    return place.is_dir() or _is_pattern(place)


def _is_pattern(path: Path) -> bool:
    return not path.exists() and glob.has_magic(str(path))


def _files(path: Place) -> Iterator[Place]:
    if isinstance(path, Address) or is_in_store(path):
        yield path
    elif path.is_dir():
        found = (file for file in sorted(path.iterdir()) if file.suffix.lower() in READ)
        yield from (file for file in found if file.is_file() and not file.name.startswith("."))
    elif _is_pattern(path):
        matches = sorted(map(Path, glob.glob(str(path), recursive=True)))
        yield from (file for file in matches if file.is_file())
    else:
        yield path


def _name(source: Place) -> str:
    """Name of a result: that of its source if its format can be written."""
    suffix = source.suffix.lower()
    if suffix in SUFFIXES:
        return source.name
    if suffix in FILMS:
        return Path(source.name).with_suffix(".mp4").name if suffix != ".mp4" else source.name
    is_animated = suffix in WRITTEN and frames_of(source) is not None
    return source.name if is_animated else Path(source.name).with_suffix(".png").name
