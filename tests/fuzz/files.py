"""A seed as files that are changed, and read."""

import random
from pathlib import Path

from tests.fuzz.pool import Try


def make() -> Try:
    """Reading of the files that a seed stands for."""
    from tests.fuzz.corpus import corpus
    from tests.fuzz.mutations import mutated
    from tests.fuzz.readers import READERS

    cases = corpus()

    def attempt(seed: int, folder: Path) -> None:
        rng = random.Random(seed)
        case = cases[seed % len(cases)]
        for name, content in mutated(rng, case.files).items():
            Path(folder, name).write_bytes(content)
        READERS[case.reader](folder / next(iter(case.files)))

    return attempt
