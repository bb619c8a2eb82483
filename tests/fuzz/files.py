"""A seed as files that are changed, and read."""

import random
from collections.abc import Mapping
from pathlib import Path

from tests.fuzz.pool import Try

ODD_NAMES = 0.1  # share of files that stand alone
STEMS = (
    "-o",
    "--help",
    "a\x1b[2Jb",
    "a\nb",
    "a\rb",
    "é\u202e",
    "a b",
    "a:b=c",
    "%s%n",
    "~",
    "a'\"b",
    "caf\udce9",  # bytes that are no UTF-8
)


def put(folder: Path, files: Mapping[str, bytes]) -> dict[str, Path]:
    """Write files by their names, in folders where these have any."""
    found = {}
    for name, content in files.items():
        path = found[name] = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    return found


def odd_name(rng: random.Random, name: str) -> str:
    """Another name with the same ending, as long as may be, or with odd letters."""
    ending = name[name.index(".") :]
    return rng.choice((*STEMS, "a" * (255 - len(ending)))) + ending


def make() -> Try:
    """Reading of the files that a seed stands for."""
    from tests.fuzz.corpus import corpus
    from tests.fuzz.mutations import mutated
    from tests.fuzz.readers import READERS

    cases = corpus()

    def attempt(seed: int, folder: Path) -> None:
        rng = random.Random(seed)
        case = cases[seed % len(cases)]
        files = put(folder, mutated(rng, case.files))
        first = files.get(next(iter(case.files)), folder / next(iter(case.files)))
        if len(case.files) == 1 and rng.random() < ODD_NAMES and first.is_file():
            first = first.rename(folder / odd_name(rng, first.name))
        READERS[case.reader](first)

    return attempt
