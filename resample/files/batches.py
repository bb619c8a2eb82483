"""Many files at once: folders and patterns of names, whose results keep their names in a folder."""

import glob
from collections.abc import Iterator, Sequence
from pathlib import Path

from resample.files.pictures import SUFFIXES
from resample.files.sequences import FILMS, WRITTEN, frames_of
from resample.files.stores.opening import is_store
from resample.files.stores.pictures import SUFFIX as STORE

READ = (*SUFFIXES, *WRITTEN, *FILMS, ".bmp", ".hdr", ".jp2", ".jxl", ".pgm", ".ppm", ".pfm", ".tga")


def is_batch(images: Sequence[Path], output: Path) -> bool:
    """Whether results go to a folder: of several files, a folder, a pattern, or into one."""
    is_folder = output.is_dir() and output.suffix.lower() not in (*SUFFIXES, STORE)
    is_of_files = images[0].is_dir() and not is_store(images[0])
    return len(images) > 1 or is_folder or is_of_files or _is_pattern(images[0])


def batch_of(images: Sequence[Path], output: Path) -> list[tuple[Path, Path]]:
    """Files that are meant, and what each becomes.

    Parameters
    ----------
    images
        Files, folders and patterns such as `photos/*.jpg`; of folders what has a picture's or a
        film's suffix, but no folders within.
    output
        Folder, which need not exist yet.

    Raises
    ------
    ValueError
        There is no file, two results would have one name, or one would replace its source.
    OSError
        The folder cannot be one, or a file is damaged.
    """
    sources = list(dict.fromkeys(file for image in images for file in _files(image)))
    if not sources:
        raise ValueError(f"{', '.join(map(str, images))}: there is no picture")
    if output.exists() and not output.is_dir():
        raise OSError(f"{output} is not a folder; several pictures are written to one")
    if not output.exists() and output.suffix:
        raise ValueError(f"{output}: several pictures are written to a folder; give its name")
    pairs = [(source, output / _name(source)) for source in sources]
    taken: dict[Path, Path] = {}
    for source, target in pairs:
        if target in taken:
            raise ValueError(f"{taken[target]} and {source} would both become {target}")
        if target.resolve() in {source.resolve() for source in sources}:
            raise ValueError(f"{target} would be replaced; give another folder")
        taken[target] = source
    return pairs


def _is_pattern(path: Path) -> bool:
    return not path.exists() and glob.has_magic(str(path))


def _files(path: Path) -> Iterator[Path]:
    if path.is_dir():
        found = (file for file in sorted(path.iterdir()) if file.suffix.lower() in READ)
        yield from (file for file in found if file.is_file() and not file.name.startswith("."))
    elif _is_pattern(path):
        matches = sorted(map(Path, glob.glob(str(path), recursive=True)))
        yield from (file for file in matches if file.is_file())
    else:
        yield path


def _name(source: Path) -> str:
    """Name of what a file becomes: its own, where that form can be written."""
    suffix = source.suffix.lower()
    if suffix in SUFFIXES:
        return source.name
    if suffix in FILMS:
        return source.with_suffix(".mp4").name if suffix != ".mp4" else source.name
    is_animated = suffix in WRITTEN and frames_of(source) is not None
    return source.name if is_animated else source.with_suffix(".png").name
