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
    """Pictures on record, to within a 65535th of their span."""
    with np.load(RECORD) as packed:
        return {name: _unpacked(packed, name) for name in packed if not name.endswith(" from")}


def _unpacked(packed: Any, name: str) -> Any:
    low, span = packed[f"{name} from"]
    return (low + packed[name] * (span / LEVELS)).astype(np.float32)


def main(names: list[str]) -> None:
    """Put pictures on record."""
    known = recorded() if names else {}
    known |= {name: np.asarray(SCENES[name](), np.float32) for name in names or SCENES}
    packed = {}
    for name, picture in sorted(known.items()):
        low, span = picture.min(), max(float(np.ptp(picture)), 1e-9)
        packed[name] = np.rint((picture - low) / span * LEVELS).astype(np.uint16)
        packed[f"{name} from"] = np.array([low, span], np.float32)
    np.savez_compressed(RECORD, **packed)


if __name__ == "__main__":
    main(sys.argv[1:])
