"""Find built-in samples by name: in memory, or as files that are written once."""

import atexit
import contextlib
import hashlib
import json
import os
import shutil
import sys
import tempfile
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from resample import registry

if TYPE_CHECKING:
    from resample.samples.writing import DefaultOptions

PREFIX = "sample:"
VIEW = "--view"  # option for pictures with depth and pose
FOLDER_VARIABLE = "HYBRID_RESAMPLE_DATA"  # also used for downloaded volumes
CONTENTS = "contents.json"  # list of files in the folder of a sample
PICTURES = ("--texture", "--truth", "--reference", "-R")  # options that take one file


class CachedSample(NamedTuple):
    """Files of a sample."""

    folder: Path
    files: list[Path]
    options: "list[DefaultOptions]"


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
    """Files of a sample, written if missing; errors as in `sample`."""
    spec = spec.removeprefix(PREFIX)
    name = spec.partition(":")[0]
    plugin = registry.load("samples", name)
    base = _base()
    target = base / _digest(spec, str(sys.modules[plugin.__module__].__file__))
    if not (target / CONTENTS).is_file():
        made = Path(tempfile.mkdtemp(prefix=".sample-", dir=base))
        try:
            _fill(made, spec, name)
            with contextlib.suppress(OSError):  # another process was faster
                made.rename(target)
        finally:
            shutil.rmtree(made, ignore_errors=True)
    facts = json.loads((target / CONTENTS).read_text("utf-8"))
    return CachedSample(
        target, [target / file for file in facts["files"]], _with_folder(target, facts["said"])
    )


def expanded(words: Sequence[str]) -> list[str]:
    """Replace samples in a command's arguments by their files and options."""
    made: list[str] = []
    options: list[DefaultOptions] = []
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
            options += () if alone else found.options
        elif option in PICTURES and equals and value.startswith(PREFIX):
            made.append(f"{option}={sample_path(value)}")
        else:
            made.append(word)
        before = word
    for each in options:
        given = any(word.startswith(tuple(each.unless)) for word in words)
        if not given and set(words) & set(each.commands):
            made += expanded(each.words)
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


def _with_folder(folder: Path, stored: Sequence[Sequence[Any]]) -> "list[DefaultOptions]":
    """Insert the folder's name into options."""
    from resample.samples.writing import DefaultOptions

    return [
        DefaultOptions(
            commands, [word.replace("FOLDER/", f"{folder}{os.sep}") for word in words], unless
        )
        for commands, words, unless in stored
    ]


def _fill(folder: Path, spec: str, name: str) -> None:
    """Write a sample and its list of files."""
    from resample.samples.writing import store

    stored = store(sample(spec), folder, name)
    contents = {"files": list(stored.files), "said": [list(map(list, s)) for s in stored.options]}
    (folder / CONTENTS).write_text(json.dumps(contents), "utf-8")


@cache
def _base() -> Path:
    """Folder of all samples; a temporary one if none can be kept."""
    from platformdirs import user_cache_dir

    base = Path(os.environ.get(FOLDER_VARIABLE) or user_cache_dir("hybrid-resample")) / "samples"
    try:
        base.mkdir(parents=True, exist_ok=True)
        if os.access(base, os.W_OK | os.X_OK):
            return base
    except OSError:
        pass
    passing = tempfile.mkdtemp(prefix="hybrid-resample-")
    atexit.register(shutil.rmtree, passing, ignore_errors=True)
    return Path(passing)


def _digest(spec: str, source: str) -> str:
    """Digest of a sample's name and the code that makes it, so that outdated files are not used."""
    files = [*sorted(Path(__file__).parent.glob("*.py")), Path(source)]
    parts = [spec.encode(), *(file.read_bytes() for file in files)]
    return hashlib.sha256(b"\0".join(parts)).hexdigest()[:16]
