"""Arrays made alike before kernels see them, which are compiled anew for each kind."""

from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

Number = TypeVar("Number", bound=np.generic)


def alike(given: ArrayLike, kind: type[Number]) -> NDArray[Number]:
    """Array of a type, in C order, which may be written to; a copy if it was anything else.

    It is of no subclass. What is masked is not a number.

    Examples
    --------
    >>> import numpy as np
    >>> from resample.memory.alike import alike
    >>> frozen = np.broadcast_to(np.float32(1), (2, 3))
    >>> alike(frozen, np.float32).flags.writeable
    True
    """
    if np.ma.is_masked(given):
        given = np.ma.filled(np.ma.asarray(given, np.float64), np.nan)
    return np.require(given, kind, ["C", "A", "W", "E"])
