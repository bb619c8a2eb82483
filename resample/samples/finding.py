"""Find built-in samples by name: in memory, or as files that are written once."""

import atexit
import contextlib
import hashlib
import json
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from resample import registry
from resample.reading.limits import NotOwnError, neighbour, own_bytes, tell_unused
from resample.reading.texts import json_of
from resample.samples import DefaultOptions

PREFIX = "sample:"
VIEW = "--view"  # option for pictures with depth and pose
FOLDER_VARIABLE = "HYBRID_RESAMPLE_DATA"  # also used for downloaded volumes
CONTENTS = "contents.json"  # list of files in the folder of a sample
OWN_FOLDER = "FOLDER/"  # stands for the folder of a sample in the options that it adds
PICTURES = ("--texture", "--truth", "--reference", "-R")  # options that take one file


class CachedSample(NamedTuple):
    """Files of a sample."""

    folder: Path
    files: list[Path]
    options: list[DefaultOptions]


def sample(spec: str) -> Any:
    """Create built-in data by name; `resample plugins samples` lists the names.

    Parameters
    ----------
    spec
        A name, with optional parameters: `bricks`, `room:size=120`.

    Returns
    -------
    A picture is an array (H, W, 3) of bytes; `room` has `color`, `depth` and `fov`; a volume is a
    `resample_volume.Volume`; meshes and clouds are named arrays.

    Raises
    ------
    LookupError
        There is no such sample; the message lists all.
    ValueError
        A parameter is unknown or invalid.

    Examples
    --------
    >>> import resample
    >>> resample.sample("bricks:size=64").shape
    (64, 64, 3)
    >>> room = resample.sample("room:size=24")
    >>> room.color.shape, room.depth.shape, room.fov
    ((24, 32, 3), (24, 32), 60.0)
    """
    return registry.build("samples", spec.removeprefix(PREFIX))


def sample_path(spec: str) -> Path:
    """Path of built-in data as a file, written on first use.

    Parameters
    ----------
    spec
        As in `sample`.

    Returns
    -------
    The first file if there are several, which for a depth image is the picture. It is in the folder
    named by HYBRID_RESAMPLE_DATA or in the user's cache.

    Raises
    ------
    LookupError, ValueError
        As in `sample`.

    Examples
    --------
    >>> import resample
    >>> resample.sample_path("bricks:size=64").name
    'bricks.png'
    """
    return kept(spec).files[0]


def kept(spec: str) -> CachedSample:
    """Files of a sample, written if missing; errors as in `sample`.

    They are in the first folder where they are, or can be written, and are the user's own.
    """
    spec = spec.removeprefix(PREFIX)
    name = spec.partition(":")[0]
    plugin = registry.load("samples", name)
    digest = _digest(spec, str(sys.modules[plugin.__module__].__file__))
    for base in map(Path, _bases()):
        target = base / digest
        try:
            if not (target / CONTENTS).is_file():
                _make(target, spec, name)
            return _read(target)
        except OSError as error:
            failed = error
            if isinstance(error, NotOwnError):
                tell_unused(error, FOLDER_VARIABLE)
    raise failed


def _make(target: Path, spec: str, name: str) -> None:
    """Write a sample and its list of files to a folder, which appears complete."""
    from resample.samples.writing import store

    target.parent.mkdir(parents=True, exist_ok=True)
    made = Path(tempfile.mkdtemp(prefix=".sample-", dir=target.parent))
    try:
        contents = made / CONTENTS
        contents.write_text(json.dumps(store(sample(spec), made, name)), "utf-8")
        contents.chmod(0o600)
        with contextlib.suppress(OSError):  # another process was faster
            made.rename(target)
    finally:
        shutil.rmtree(made, ignore_errors=True)


def _read(target: Path) -> CachedSample:
    """Read the list of a sample's files, and what it adds to commands."""
    path = target / CONTENTS
    text = own_bytes(path, "tree").decode()
    try:
        files, options = json_of(text)
        return CachedSample(
            target,
            [neighbour(path, file) for file in files],
            [DefaultOptions(*each) for each in options],
        )
    except (ValueError, TypeError) as error:
        raise ValueError(f"{error}; remove {target}, which is written again") from None


def expanded(
    words: Sequence[str], check: Callable[[str, str], object] = lambda *_: None
) -> list[str]:
    """Replace samples in a command's arguments by their files and options.

    `check` is called with the name and value of each option that a sample adds, to reject it.
    """
    made: list[str] = []
    added: list[tuple[Path, DefaultOptions]] = []
    before = ""
    for word in words:
        option, equals, value = word.partition("=")
        if before == VIEW and word.startswith(PREFIX):
            made.append(_view(word))
        elif option == VIEW and value.startswith(PREFIX):
            made.append(f"{option}={_view(value)}")
        elif word.startswith(PREFIX):
            found = kept(word)
            alone = before in PICTURES
            made += [str(file) for file in (found.files[:1] if alone else found.files)]
            added += () if alone else [(found.folder, each) for each in found.options]
        elif option in PICTURES and equals and value.startswith(PREFIX):
            made.append(f"{option}={sample_path(value)}")
        else:
            made.append(word)
        before = word
    for folder, each in added:
        given = any(word.startswith(tuple(each.unless)) for word in words)
        if not given and set(words) & set(each.commands):
            for option, value in zip(each.words[::2], each.words[1::2], strict=True):
                check(option, value)
                file = value.removeprefix(OWN_FOLDER)
                own = value if file == value else str(neighbour(folder / CONTENTS, file))
                made += expanded([f"{option}={own}"])
    return made


def _view(text: str) -> str:
    """Convert sample:NAME,POSE, a picture with depth, to COLOR,DEPTH,POSE."""
    spec, _, pose = text.rpartition(",")
    files = kept(spec).files if spec and "=" not in pose else []
    if len(files) < 2:
        raise ValueError(
            f"view {text!r}; give sample:NAME,POSE, a depth image (sample:room) and a file"
        )
    return ",".join(map(str, [*files[:2], pose]))


def _bases() -> Iterator[str]:
    """Folders of samples, the best first: that of the data, the user's cache, a temporary one."""
    from platformdirs import user_cache_dir

    places = (os.environ.get(FOLDER_VARIABLE), user_cache_dir("hybrid-resample"))
    yield from (os.path.join(place, "samples") for place in places if place)
    yield _passing()


@cache
def _passing() -> str:
    """Folder that is removed with this process."""
    folder = tempfile.mkdtemp(prefix="hybrid-resample-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


def _digest(spec: str, source: str) -> str:
    """Digest of a sample's name and the code that makes it, so that outdated files are not used."""
    files = [*sorted(Path(__file__).parent.glob("*.py")), Path(source)]
    parts = [spec.encode(), *(file.read_bytes() for file in files)]
    return hashlib.sha256(b"\0".join(parts)).hexdigest()[:16]
