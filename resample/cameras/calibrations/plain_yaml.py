"""Parser of the YAML subset of calibration files: names, numbers, texts and lists."""

import re
from collections.abc import Sequence
from typing import Any, NamedTuple

NAME = re.compile(r"""("[^"]*"|'[^']*'|[^\s"'\[\]{},:#-][^"'\[\]{}:#]*?)\s*:(?:\s+|$)(.*)$""")
TAG = re.compile(r"^!!?[\w-]*\s*")  # such as !!opencv-matrix
TOKEN = re.compile(r"""[\[\],]|"[^"]*"|'[^']*'|[^\[\],"']+""")
DEEPEST = 16  # nesting levels


class _Line(NamedTuple):
    number: int  # from 1
    indent: int
    words: str


Found = tuple[Any, int]  # a value, and the index of the next line or word


def plain_yaml(text: str) -> dict[str, Any]:
    """Parse the first document of a text to names and values.

    Values are numbers, texts, None, lists and dictionaries; other features of YAML, such as anchors
    and multi-line texts, are rejected.
    """
    lines = _lines(text)
    if not lines:
        raise ValueError("it is empty")
    found, end = _block(lines, 0, 0)
    if end < len(lines) or not isinstance(found, dict):
        raise ValueError(
            f"line {lines[min(end, len(lines) - 1)].number}: it is not a name with a value"
        )
    return found


def _lines(text: str) -> list[_Line]:
    """Lines of the first document, without comments."""
    lines: list[_Line] = []
    for number, given in enumerate(text.splitlines(), 1):
        line = _without_comment(given).rstrip()
        if line.startswith(("---", "...")):
            if lines:
                break
            continue
        if line.strip() and not line.startswith("%"):
            words = line.lstrip(" ")
            lines.append(_Line(number, len(line) - len(words), words))
    return lines


def _without_comment(line: str) -> str:
    quote = ""
    for n, letter in enumerate(line):
        before = line[n - 1] if n else " "
        if quote:
            quote = "" if letter == quote else quote
        elif letter in "\"'" and before in " \t[,:":
            quote = letter
        elif letter == "#" and before in " \t":
            return line[:n]
    return line


def _block(lines: Sequence[_Line], n: int, depth: int) -> Found:
    """Parse the list or mapping that begins in line `n`."""
    if depth > DEEPEST:
        raise ValueError(f"line {lines[n].number}: nested deeper than {DEEPEST} levels")
    is_list = _is_item(lines[n])
    return _items(lines, n) if is_list else _names(lines, n, depth)


def _is_item(line: _Line) -> bool:
    return line.words == "-" or line.words.startswith("- ")


def _names(lines: Sequence[_Line], n: int, depth: int) -> Found:
    """Parse a mapping whose names have equal indentation."""
    facts: dict[str, Any] = {}
    indent = lines[n].indent
    while n < len(lines) and lines[n].indent == indent and not _is_item(lines[n]):
        line = lines[n]
        found = NAME.match(line.words)
        if found is None:
            raise ValueError(f"line {line.number}: {line.words!r:.60} is not a name with a value")
        value = TAG.sub("", found[2])
        if value:
            facts[_text(found[1])], n = _value(lines, n, value)
        elif n + 1 < len(lines) and _is_within(lines[n + 1], indent):
            facts[_text(found[1])], n = _block(lines, n + 1, depth + 1)
        else:
            facts[_text(found[1])], n = None, n + 1
    if n < len(lines) and lines[n].indent > indent:
        raise ValueError(f"line {lines[n].number}: it is too far to the right")
    return facts, n


def _is_within(line: _Line, indent: int) -> bool:
    """Whether a line belongs to the name above it."""
    return line.indent > indent or (line.indent == indent and _is_item(line))


def _items(lines: Sequence[_Line], n: int) -> Found:
    """Parse a list with one item per line."""
    items, indent = [], lines[n].indent
    while n < len(lines) and lines[n].indent == indent and _is_item(lines[n]):
        item, n = _value(lines, n, lines[n].words[1:].strip())
        items.append(item)
    return items, n


def _value(lines: Sequence[_Line], n: int, words: str) -> Found:
    """Parse a value that begins in line `n`; a list in brackets may span lines."""
    start = lines[n].number
    if not words.startswith("["):
        return _scalar(words, start), n + 1
    parts = [words]
    while sum(part.count("[") - part.count("]") for part in parts) > 0:
        n += 1
        if n == len(lines):
            raise ValueError(f"line {start}: its list is not closed")
        parts.append(lines[n].words)
    words_of = [word.strip() for word in TOKEN.findall(" ".join(parts)) if word.strip()]
    found, end = _bracket(words_of, 1, start, 0)
    if end != len(words_of):
        raise ValueError(f"line {start}: something comes after its list")
    return found, n + 1


def _bracket(words: Sequence[str], n: int, number: int, depth: int) -> Found:
    """Parse a list from the words after its bracket."""
    if depth > DEEPEST:
        raise ValueError(f"line {number}: nested deeper than {DEEPEST} levels")
    items: list[Any] = []
    while n < len(words) and words[n] != "]":
        if words[n] == "[":
            item, n = _bracket(words, n + 1, number, depth + 1)
        else:
            item, n = _scalar(words[n], number), n + 1
        items.append(item)
        if n < len(words) and words[n] == ",":
            n += 1
        elif n < len(words) and words[n] != "]":
            raise ValueError(f"line {number}: a comma is missing before {words[n]!r:.30}")
    if n >= len(words):
        raise ValueError(f"line {number}: its list is not closed")
    return items, n + 1


def _scalar(words: str, number: int) -> float | str | None:
    """Parse a number or text."""
    if words in ("", "~", "null"):
        return None
    if words[0] in "&*|>{}[]%@`,":
        raise ValueError(f"line {number}: {words!r:.60} is neither a number nor a text")
    plain = words.lower().replace(".inf", "inf").replace(".nan", "nan")
    try:
        return float(plain)
    except ValueError:
        return _text(words)


def _text(words: str) -> str:
    """Text without quotes."""
    is_quoted = len(words) > 1 and words[0] in "\"'" and words[-1] == words[0]
    return words[1:-1] if is_quoted else words
