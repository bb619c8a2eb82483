"""Write pictures row by row."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from resample.files.chunked import SUFFIX as STORE
from resample.files.chunked import writing_store
from resample.files.facts.metadata import FileMetadata, WrittenPage
from resample.files.pictures import Picture, WriteOptions, complaint_of, finish, opened, page_of
from resample.files.writing import refused, replacing

Put = Callable[[Picture], None]


@contextmanager
def writing_rows(path: Path, height: int, look: WriteOptions) -> Iterator[Put]:
    """Write a picture of `height` rows; the file appears when the block succeeds.

    Parameters
    ----------
    path, look
        As in `write_picture`.
    height
        Rows of the whole picture.

    Yields
    ------
    The function that takes the picture's rows from the top, any number at a time, always with
    the same channels.

    Raises
    ------
    ValueError
        The format cannot store them, or the number of rows differs.
    OSError
        The file cannot be written.
    """
    if path.suffix.lower() == STORE:
        with writing_store(path, height) as store:
            yield lambda picture: store.put(page_of(path, picture, look).data)
        return
    with replacing(path) as temporary:
        rows = _Rows(path, temporary, height, look)
        yield rows.put
        rows.close()


class _Rows:
    """A file being written."""

    def __init__(self, path: Path, temporary: Path, height: int, look: WriteOptions) -> None:
        self.path, self.temporary, self.height, self.options = path, temporary, height, look
        self.target: Any = None
        self.done = 0
        self.stored = WrittenPage(FileMetadata(), (), "")

    def put(self, picture: Picture) -> None:
        """Write the next rows."""
        page = page_of(self.path, picture, self.options, tells=self.target is None)
        shape = self.height, *page.data.shape[1:]
        if self.target is None:
            self.stored = WrittenPage(page.about, shape, page.data.dtype.name)
            self.target = opened(self.path, self.temporary, page, self.height)
        first, last = self.done, self.done + page.data.shape[0]
        if self.stored.shape != shape or last > self.height:
            raise ValueError(f"rows {first} to {last} of {page.data.shape} in {self.stored.shape}")
        self._check(is_done=self.target.write_scanlines(first, last, 0, page.pixels))
        self.done = last

    def close(self) -> None:
        """Write remaining rows."""
        if self.done != self.height:
            raise ValueError(f"{self.path}: only {self.done} of {self.height} rows were given")
        self._check(is_done=self.target.close())
        finish(self.path, self.temporary, [self.stored])

    def _check(self, *, is_done: bool) -> None:
        if not is_done or self.target.has_error:
            raise refused(self.path, self.temporary, complaint_of(self.target))
