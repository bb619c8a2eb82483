"""Normalize arrays for kernels, which are compiled for each array type and layout."""

from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

Number = TypeVar("Number", bound=np.generic)


def contiguous(given: ArrayLike, kind: type[Number]) -> NDArray[Number]:
    """Writable C-ordered array of a type; a copy unless it already is one.

    The result is a plain ndarray. Masked elements become NaN.

    Examples
    --------
    >>> import numpy as np
    >>> from resample.memory.contiguous import contiguous
    >>> frozen = np.broadcast_to(np.float32(1), (2, 3))
    >>> contiguous(frozen, np.float32).flags.writeable
    True
    """
    if np.ma.is_masked(given):
        given = np.ma.filled(np.ma.asarray(given, np.float64), np.nan)
    return np.require(given, kind, ["C", "A", "W", "E"])
