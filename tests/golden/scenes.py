"""Pictures on record, with which those of every painter are compared.

`python -m tests.golden.scenes NAME ...` puts these on record anew, all of them without a name: to
be done when a change of pictures is wanted, and with that reason.
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np

from tools.kernels.pictures import SCENES

RECORD = Path(__file__).with_name("pictures.npz")
LEVELS = 65535  # of a number on record


def recorded() -> dict[str, Any]:
    """Pictures on record."""
    return unpacked(RECORD)


def packed(file: Path, pictures: dict[str, Any]) -> None:
    """Store pictures to within a 65535th of their span, and what is NaN."""
    numbers = {}
    for name, picture in sorted(pictures.items()):
        known = np.isfinite(picture)
        low, span = picture[known].min(), max(float(np.ptp(picture[known])), 1e-9)
        levels = np.rint((np.where(known, picture, low) - low) / span * LEVELS)
        numbers[name] = levels.astype(np.uint16)
        numbers[f"{name} from"] = np.array([low, span], np.float32)
        if not known.all():
            numbers[f"{name} known"] = known
    np.savez_compressed(file, **numbers)


def unpacked(file: Path) -> dict[str, Any]:
    """Pictures that are stored."""
    found = {}
    with np.load(file) as stored:
        for name in stored:
            if not name.endswith((" from", " known")):
                low, span = stored[f"{name} from"]
                picture = (low + stored[name] * (span / LEVELS)).astype(np.float32)
                is_whole = f"{name} known" not in stored
                found[name] = (
                    picture if is_whole else np.where(stored[f"{name} known"], picture, np.nan)
                )
    return found


def main(names: list[str]) -> None:
    """Put pictures on record, and tell how near they are to the truth."""
    from tests.golden.truths import NONE, decibels, stored, truth_of

    known, truths = recorded(), stored()
    for name in names or SCENES:
        picture, before = np.asarray(SCENES[name](), np.float32), known.get(name)
        truth = truths.get(truth_of(name) or "")
        if truth is None:
            told = f"none: {NONE[name]}"
        else:
            told = f"{decibels(picture, truth):.2f} dB to the truth"
            if before is not None and before.shape == picture.shape:
                told += f", before {decibels(before, truth):.2f} dB"
        sys.stdout.write(f"{name}: {told}\n")
        known[name] = picture
    packed(RECORD, {name: known[name] for name in SCENES})


if __name__ == "__main__":
    main(sys.argv[1:])
