"""Read text files and parse JSON, TOML and YAML, within limits."""

import json
import re
import tomllib
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from itertools import takewhile
from pathlib import Path
from typing import Any

from resample.messages import TOO_LARGE, TOO_MANY_DIGITS
from resample.reading.limits import check_items, check_size, limits, refused

OPENCV = re.compile(r"\A%YAML[^\n]*")  # a directive; OpenCV's has a colon, which is not YAML
WIDEST = 1 << 63  # integers from here on do not fit into arrays
# Dotted keys; each word is matched once.
PARTS = re.compile(r"""(?<![\w-])(?:(?:[\w-]++|"[^"\n]*"|'[^'\n]*')[ \t]*+\.[ \t]*+){16,}""")
BLOCK = 1 << 16  # bytes parsed together
TOO_DEEP = "too deep", "nested levels", "depth"
LONGEST = 1 << 20  # bytes of a tag or comment; parsers restart each with every block


def text_of(path: Path) -> str:
    """Read a text file."""
    check_size(str(path), path.stat().st_size)
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError(f"{path} is not a text") from None


def json_of(text: str) -> Any:
    """Parse JSON."""
    check_size("its JSON", len(text), "tree")
    return _parsed(json.loads, text)


def toml_of(text: str) -> dict[str, Any]:
    """Parse TOML; errors as in `json_of`."""
    check_size("its TOML", len(text), "tree")
    # Parsing keys with very many parts takes quadratic time.
    longest = max((found[0].count(".") for found in PARTS.finditer(text)), default=0)
    if longest > limits().depth:
        raise refused(*TOO_DEEP)
    found: dict[str, Any] = _parsed(tomllib.loads, text)
    return found


def yaml_of(text: str) -> dict[str, Any]:
    """Parse the first document of YAML, as ROS and OpenCV write it, to names and values.

    Values are numbers, texts, None, lists and dictionaries. Tags are ignored; anchors, which can
    multiply what a file holds, are rejected. The message of a ValueError names the line.
    """
    import yaml

    check_size("its YAML", len(text), "tree")
    text = OPENCV.sub("#", text)
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # the former is 10 times as fast
    try:
        events = yaml.parse(text, loader)  # values are built while it reads: nothing piles up
        next(events)
        if isinstance(next(events), yaml.StreamEndEvent):
            raise ValueError("it is empty")
        first = next(events)
        if not isinstance(first, yaml.MappingStartEvent):
            raise ValueError(f"{_line(first)}: it is not a name with a value")
        facts: dict[str, Any] = _value(events, first, 1)
        return facts
    except RecursionError:
        raise refused(*TOO_DEEP) from None
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        raise ValueError(f"line {mark.line + 1 if mark else 1}: {error.problem}") from None
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        raise ValueError(f"line {line}: {error.reason}") from None


def _line(event: Any) -> str:
    return f"line {event.start_mark.line + 1}"


def _value(events: Iterator[Any], event: Any, depth: int) -> Any:
    """Build the value that begins with an event of a YAML parser."""
    import yaml

    if event.anchor is not None:
        raise ValueError(f"{_line(event)}: anchors are not allowed; write the value out")
    if isinstance(event, yaml.ScalarEvent):
        words = event.value
        if event.style:
            return words
        if words in ("", "~", "null"):
            return None
        try:
            return float(words.lower().replace(".inf", "inf").replace(".nan", "nan"))
        except ValueError:
            return words
    if depth > limits().depth:
        raise refused(*TOO_DEEP)
    inner = takewhile(lambda part: not isinstance(part, yaml.CollectionEndEvent), events)
    if isinstance(event, yaml.SequenceStartEvent):
        return [_value(events, part, depth + 1) for part in inner]
    found = {}
    for name in inner:
        if not hasattr(name, "value") or name.anchor is not None:
            raise ValueError(f"{_line(name)}: a name is a text")
        found[str(name.value)] = _value(events, next(events), depth + 1)
    return found


def _parsed(parse: Callable[[str], Any], text: str) -> Any:
    """Parse a tree; reject one that is nested too deep or has numbers with too many digits."""
    try:
        tree = parse(text)
    except RecursionError:
        raise refused(*TOO_DEEP) from None
    except ValueError as error:  # of numbers of thousands of digits Python says how to allow them
        is_long = type(error) is ValueError and TOO_MANY_DIGITS.match(str(error))
        raise (ValueError(TOO_LARGE) if is_long else error) from None
    left, most, count = [(tree, 0)], limits().depth, 0
    while left:
        item, depth = left.pop()
        if isinstance(item, dict | list):
            if depth >= most:
                raise refused(*TOO_DEEP)
            inner = item.values() if isinstance(item, dict) else item
            left.extend((one, depth + 1) for one in inner if isinstance(one, dict | list | int))
        elif isinstance(item, int) and not -WIDEST <= item < WIDEST:
            count += 1
    if count:
        raise ValueError(f"{count} whole numbers are beyond 64 bits; write them as 1e30")
    return tree


def check_xml(
    what: str, blocks: Iterable[bytes], last: str = "", encoding: str | None = None
) -> int:
    """Reject XML that is nested too deep or has a DOCTYPE; return the number of elements.

    Malformed XML is left to the actual reader, which reports the error. `encoding`: of the bytes;
    None: as declared.
    """
    from xml.parsers import expat

    depth = count = read = 0
    most = limits().depth

    def begin(name: str, _: Any) -> None:
        nonlocal depth, count
        depth, count = depth + 1, count + 1
        if depth > most:
            raise refused(f"{what} is too deep", "nested elements", "depth")
        if name == last:
            raise StopIteration  # nothing behind it is read

    def end(_: str) -> None:
        nonlocal depth
        depth -= 1

    def define(*_: Any) -> None:
        raise ValueError(f"{what} has a DOCTYPE, which is not supported")

    parser = expat.ParserCreate(encoding)
    parser.StartElementHandler, parser.EndElementHandler = begin, end
    parser.StartDoctypeDeclHandler = parser.EntityDeclHandler = define
    try:
        for block in blocks:
            parser.Parse(block, False)
            read += len(block)
            if read - parser.CurrentByteIndex > LONGEST:
                raise ValueError(f"{what} has a tag or comment of more than {LONGEST} bytes")
    except (expat.ExpatError, LookupError, StopIteration):  # LookupError: unknown encoding
        pass
    return count


def check_xml_file(path: Path, last: str = "") -> None:
    """As `check_xml` for a file; also rejects too many elements."""
    with path.open("rb") as file:
        blocks = iter(partial(file.read, BLOCK), b"")
        check_items(path.name, check_xml(path.name, blocks, last), "elements")


def check_xml_text(what: str, text: str) -> None:
    """As `check_xml` for a text."""
    pieces = (text[start : start + BLOCK] for start in range(0, len(text), BLOCK))
    check_xml(what, (piece.encode() for piece in pieces), encoding="utf-8")
