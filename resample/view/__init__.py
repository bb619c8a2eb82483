"""Browser page that previews what a command would paint while its options change."""

import sys
from types import ModuleType
from typing import Any


class _Callable(ModuleType):
    """The package itself, which may also be called: `resample.view(scene)`."""

    def __call__(self, scene: Any, /, **settings: Any) -> Any:
        return sys.modules["resample"]._view(scene, **settings)


sys.modules[__name__].__class__ = _Callable
