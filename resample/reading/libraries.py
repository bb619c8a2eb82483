"""Errors of libraries that read files: missing ones, and the many kinds that damage raises."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from resample.words import one_line


def lacking(name: str, reader: str, error: ImportError, extra: str) -> ValueError:
    """Return the error for a file whose reader is not installed."""
    return ValueError(
        f"{name} is read by {reader}, and {error.name} is not installed: "
        f"pip install 'hybrid-resample[{extra}]'"
    )


@contextmanager
def damage(path: Path) -> Iterator[None]:
    """Turn the many errors that damaged files raise into one kind."""
    try:
        yield
    except MemoryError:
        raise
    except Exception as error:
        message = one_line(error).partition(" ****")[0]  # libE57 appends its sources' lines
        raise OSError(f"{path} is damaged: {message:.200}") from None
    except BaseException as error:
        if type(error).__name__ != "PanicException":  # of Rust
            raise
        raise OSError(f"{path} is damaged: it cannot be unpacked") from None
