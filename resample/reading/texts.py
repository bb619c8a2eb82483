"""Texts of files, and the trees of JSON and TOML, within limits."""

import json
import re
import tomllib
from pathlib import Path
from typing import Any

from resample.reading.limits import check_items, check_size, limits, refused
from resample.words import TOO_LARGE, TOO_MANY_DIGITS

WIDEST = 1 << 63  # whole numbers from here on are none that arrays hold
# Of dotted keys; each word is looked at once.
PARTS = re.compile(r"""(?<![\w-])(?:(?:[\w-]++|"[^"\n]*"|'[^'\n]*')[ \t]*+\.[ \t]*+){16,}""")


def text_of(path: Path) -> str:
    """Text of a file.

    Raises
    ------
    OSError
        It cannot be read.
    ValueError
        It is no text, or too long.
    """
    check_size(str(path), path.stat().st_size)
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError(f"{path} is not a text") from None


def json_of(text: str) -> Any:
    """What a JSON text holds.

    Raises
    ------
    ValueError
        It is no JSON, too large or too deep, or has a number that no array can hold.

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
        raise _said(error) from None


def toml_of(text: str) -> dict[str, Any]:
    """What a TOML text holds; errors are those of `json_of`.

    Examples
    --------
    >>> from resample.reading.texts import toml_of
    >>> toml_of("fov = 30")
    {'fov': 30}
    """
    check_size("its TOML", len(text), "tree")
    # Of names of very many parts the time grows with the square.
    longest = max((found[0].count(".") for found in PARTS.finditer(text)), default=0)
    if longest > limits().depth:
        raise _too_deep()
    try:
        found: dict[str, Any] = _checked(tomllib.loads(text))
    except RecursionError:
        raise _too_deep() from None
    except ValueError as error:
        raise _said(error) from None
    return found


def _too_deep() -> ValueError:
    return refused("too deep", "things within each other", "depth")


def _said(error: ValueError) -> ValueError:
    """Give the error of a parser, which for numbers of thousands of digits speaks of Python."""
    is_own = type(error) is ValueError and TOO_MANY_DIGITS.match(str(error))
    return ValueError(TOO_LARGE) if is_own else error


def _checked(tree: Any) -> Any:
    """Pass on what is neither too deep nor has numbers of too many digits."""
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


def check_names(what: str, names: list[str]) -> None:
    """Refuse a file that names too many others."""
    check_items(what, len(names), "files are named")
