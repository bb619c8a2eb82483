"""Roles: functions whose body is chosen by the class of their first argument, when compiled."""

from collections.abc import Callable
from typing import Any

import numba
from numba.extending import overload

_OPTIONS = {"nogil": True, "error_model": "numpy", "no_cpython_wrapper": True}
_IN_LANES = {"fastmath": {"contract", "nsz"}, "forceinline": True}


def role(bodies: dict[type, Callable[..., Any]], *, in_lanes: bool = False) -> Callable[..., Any]:
    """Function of a bundle that does what `bodies` say of its class.

    Parameters
    ----------
    bodies
        What to do for each class of NamedTuples; kernels may be called, and all bodies take the
        same number of arguments.
    in_lanes
        Whether it is a part of loops of lanes, as a `lane_step` is.
    """

    def call(bundle: Any, *rest: Any) -> Any:
        return bodies[type(bundle)](bundle, *rest)

    if not numba.config.DISABLE_JIT:
        options = {**_OPTIONS, **(_IN_LANES if in_lanes else {})}

        @overload(call, jit_options=options, strict=False)
        def _choose(bundle, *_):  # type: ignore[no-untyped-def]
            return bodies.get(getattr(bundle, "instance_class", type(None)))

    return call
