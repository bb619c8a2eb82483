"""Read text files and parse JSON, TOML and YAML, within limits."""

import json
import re
import tomllib
from collections.abc import Iterable, Iterator
from itertools import takewhile
from pathlib import Path
from typing import IO, Any

from resample.messages import TOO_LARGE, TOO_MANY_DIGITS
from resample.reading.limits import check_items, check_size, limits, refused

OPENCV = re.compile(r"\A%YAML[^\n]*")  # a directive; OpenCV's has a colon, which is not YAML
WIDEST = 1 << 63  # integers from here on do not fit into arrays
# Dotted keys; each word is matched once.
PARTS = re.compile(r"""(?<![\w-])(?:(?:[\w-]++|"[^"\n]*"|'[^'\n]*')[ \t]*+\.[ \t]*+){16,}""")
BLOCK = 1 << 16  # bytes parsed together
LONGEST = 1 << 20  # bytes of a tag or comment; parsers restart each with every block


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


def yaml_of(text: str) -> dict[str, Any]:
    """Parse the first document of YAML, as ROS and OpenCV write it, to names and values.

    Values are numbers, texts, None, lists and dictionaries. Tags are ignored; anchors, which can
    multiply what a file holds, are rejected.

    Raises ValueError: it is not YAML, has no names, is too large or nested too deep; the message
    names the line.

    Examples
    --------
    >>> yaml_of("fov: 30")
    {'fov': 30.0}
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
        raise _too_deep() from None
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
        return _number_or_text(event.value) if not event.style else event.value
    if depth > limits().depth:
        raise _too_deep()
    inner = takewhile(lambda part: not isinstance(part, yaml.CollectionEndEvent), events)
    if isinstance(event, yaml.SequenceStartEvent):
        return [_value(events, part, depth + 1) for part in inner]
    return {_name(part): _value(events, next(events), depth + 1) for part in inner}


def _name(event: Any) -> str:
    """Name of a value."""
    if not hasattr(event, "value") or event.anchor is not None:
        raise ValueError(f"{_line(event)}: a name is a text")
    return str(event.value)


def _number_or_text(words: str) -> float | str | None:
    """Value of words without quotes."""
    if words in ("", "~", "null"):
        return None
    try:
        return float(words.lower().replace(".inf", "inf").replace(".nan", "nan"))
    except ValueError:
        return words


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


class _EndError(Exception):
    """The XML ends here."""


def check_xml(
    what: str, blocks: Iterable[bytes], last: str = "", encoding: str | None = None
) -> int:
    """Reject XML that is nested too deep or has a DOCTYPE.

    Malformed XML is left to the actual reader, which reports the error.

    `blocks`: its bytes, in pieces. `encoding`: encoding of the bytes; None: as declared. Result:
    number of elements.

    Examples
    --------
    >>> check_xml("a.xml", [b"<a><b/></a>"])
    2
    """
    from xml.parsers import expat

    parser, seen, read = expat.ParserCreate(encoding), _ParserState(what, last), 0
    parser.StartElementHandler, parser.EndElementHandler = seen.begun, seen.ended
    parser.StartDoctypeDeclHandler = parser.EntityDeclHandler = seen.defined
    try:
        for block in blocks:
            parser.Parse(block, False)
            read += len(block)
            if read - parser.CurrentByteIndex > LONGEST:
                raise ValueError(f"{what} has a tag or comment of more than {LONGEST} bytes")
    except (expat.ExpatError, LookupError, _EndError):  # LookupError: unknown encoding
        pass
    return seen.count


class _ParserState:
    """State of the parser."""

    def __init__(self, what: str, last: str) -> None:
        self.what, self.last, self.most = what, last, limits().depth
        self.depth = self.count = 0

    def begun(self, name: str, _: Any) -> None:
        """Enter an element."""
        self.depth += 1
        self.count += 1
        if self.depth > self.most:
            raise refused(f"{self.what} is too deep", "nested elements", "depth")
        if name == self.last:
            raise _EndError

    def ended(self, _: str) -> None:
        """Leave an element."""
        self.depth -= 1

    def defined(self, *_: Any) -> None:
        """Reject a DOCTYPE."""
        raise ValueError(f"{self.what} has a DOCTYPE, which is not supported")


def check_xml_file(path: Path, last: str = "") -> None:
    """As `check_xml` for a file; also rejects too many elements."""
    with path.open("rb") as file:
        check_items(path.name, check_xml(path.name, _blocks(file), last), "elements")


def check_xml_member(what: str, file: IO[bytes]) -> None:
    """As `check_xml` for an open member of an archive."""
    check_xml(what, _blocks(file))


def check_xml_text(what: str, text: str) -> None:
    """As `check_xml` for a text."""
    pieces = (text[start : start + BLOCK] for start in range(0, len(text), BLOCK))
    check_xml(what, (piece.encode() for piece in pieces), encoding="utf-8")


def _blocks(file: IO[bytes]) -> Iterator[bytes]:
    while block := file.read(BLOCK):
        yield block
