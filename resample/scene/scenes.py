"""Base of scenes: prepared once, rendered often, in full or as previews that come first."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from typing import Any, Literal, get_args

from resample.progress import Cancel, cancellable, watched_cancel
from resample.scene.picking import pixel_at

Quality = Literal["final", "preview"]
LITTLE = 16  # px per side of pictures that only prepare


def is_quick(quality: str) -> bool:
    """Return whether a quality is that of previews; reject unknown ones."""
    if quality not in get_args(Quality):
        raise ValueError(f"quality {quality!r}; it can be {' or '.join(get_args(Quality))}")
    return quality == "preview"


class AnyScene:
    """Base of scenes: `resample_volume.Scene`, `resample_points.CloudScene` and so on.

    A scene defines `render` with its own view and choices, and `sample_ids` or `pick`; the view is
    what `render` takes without a name: a look and a camera, a matrix, a target.
    """

    def render(self, *view: Any, **choices: Any) -> Any:
        """Render a picture; `size` is in px, `quality` may be `preview`, `cancel` stops it."""
        raise NotImplementedError

    def sample_ids(self, *view: Any, **choices: Any) -> Any:
        """Return the indices (H, W, N) of the samples that pixels show; -1 where there is none."""
        raise NotImplementedError

    def prepare(self, *view: Any, **choices: Any) -> None:
        """Do what the first picture of a view needs; parameters as of `render`, but for `size`."""
        self.render(*view, size=(LITTLE, LITTLE), **choices)

    def preview(self, *view: Any, **choices: Any) -> Any:
        """Render quickly, from fewer samples and pixels; parameters as of `render`."""
        return self.render(*view, quality="preview", **choices)

    def finer(self, *view: Any, **choices: Any) -> Iterator[Any]:
        """Yield a preview, then the picture; parameters as of `render`."""
        yield self.preview(*view, **choices)
        yield self.render(*view, **choices)

    def pick(self, x: float, y: float, *view: Any, **choices: Any) -> Any:
        """Return the index of the sample shown at a point of the picture; None if there is none.

        `x`, `y`: right and down, px; centers of pixels are at halves. `view`, `choices`: as of
        `sample_ids`.
        """
        ids = self.sample_ids(*view, **choices)
        index = tuple(ids[pixel_at(ids.shape[1::-1], x, y)].tolist())
        return None if min(index) < 0 else index

    def cancel(self) -> None:
        """Stop all pictures of this scene that other threads render: they raise CancelledError."""
        for one in tuple(self._running):
            one.cancel()

    @cached_property
    def _running(self) -> set[Cancel]:
        """What stops the pictures that are being rendered."""
        return set()

    @contextmanager
    def _rendering(self, quality: str, cancel: Cancel | None) -> Iterator[bool]:
        """Let `cancel` stop the picture of a block; yield whether it is a preview."""
        is_preview = is_quick(quality)
        own = Cancel(cancel or watched_cancel())
        self._running.add(own)
        try:
            with cancellable(own):
                yield is_preview
        finally:
            self._running.discard(own)
