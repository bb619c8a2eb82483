"""Read text files and parse JSON and TOML, within limits."""

import json
import re
import tomllib
from pathlib import Path
from typing import Any

from resample.reading.limits import check_size, limits, refused
from resample.words import TOO_LARGE, TOO_MANY_DIGITS

WIDEST = 1 << 63  # integers from here on do not fit into arrays
# Dotted keys; each word is matched once.
PARTS = re.compile(r"""(?<![\w-])(?:(?:[\w-]++|"[^"\n]*"|'[^'\n]*')[ \t]*+\.[ \t]*+){16,}""")


def text_of(path: Path) -> str:
    """Read a text file."""
    check_size(str(path), path.stat().st_size)
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError(f"{path} is not a text") from None


def json_of(text: str) -> Any:
    """Parse JSON.

    Examples
    --------
    >>> from resample.reading.texts import json_of
    >>> json_of('{"fov": 30}')
    {'fov': 30}
    """
    check_size("its JSON", len(text), "tree")
    try:
        return _checked(json.loads(text))
    except RecursionError:
        raise _too_deep() from None
    except ValueError as error:
        raise _own_error(error) from None


def toml_of(text: str) -> dict[str, Any]:
    """Parse TOML; errors as in `json_of`.

    Examples
    --------
    >>> from resample.reading.texts import toml_of
    >>> toml_of("fov = 30")
    {'fov': 30}
    """
    check_size("its TOML", len(text), "tree")
    # Parsing keys with very many parts takes quadratic time.
    longest = max((found[0].count(".") for found in PARTS.finditer(text)), default=0)
    if longest > limits().depth:
        raise _too_deep()
    try:
        found: dict[str, Any] = _checked(tomllib.loads(text))
    except RecursionError:
        raise _too_deep() from None
    except ValueError as error:
        raise _own_error(error) from None
    return found


def _too_deep() -> ValueError:
    return refused("too deep", "nested levels", "depth")


def _own_error(error: ValueError) -> ValueError:
    """Convert a parser's error; for numbers of thousands of digits it mentions Python internals."""
    is_own = type(error) is ValueError and TOO_MANY_DIGITS.match(str(error))
    return ValueError(TOO_LARGE) if is_own else error


def _checked(tree: Any) -> Any:
    """Return a tree unless it is nested too deep or has numbers with too many digits."""
    left, most, count = [(tree, 0)], limits().depth, 0
    while left:
        item, depth = left.pop()
        if isinstance(item, dict | list):
            if depth >= most:
                raise _too_deep()
            inner = item.values() if isinstance(item, dict) else item
            left.extend((one, depth + 1) for one in inner if isinstance(one, dict | list | int))
        elif isinstance(item, int) and not -WIDEST <= item < WIDEST:
            count += 1
    if count:
        raise ValueError(f"{count} whole numbers are beyond 64 bits; write them as 1e30")
    return tree
