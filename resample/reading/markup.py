"""Validate XML before other libraries parse it: deep nesting crashes some of them."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import IO, Any

from resample.reading.limits import check_items, limits, refused

BLOCK = 1 << 16  # bytes parsed together
LONGEST = 1 << 20  # bytes of a tag or comment; parsers restart each with every block


class _EndError(Exception):
    """The XML ends here."""


def check_xml(
    what: str, blocks: Iterable[bytes], last: str = "", encoding: str | None = None
) -> int:
    """Reject XML that is nested too deep or has a DOCTYPE.

    Malformed XML is left to the actual reader, which reports the error.

    Parameters
    ----------
    blocks
        Its bytes, in pieces.
    encoding
        Encoding of the bytes; None: as declared.

    Returns
    -------
    Number of elements.

    Examples
    --------
    >>> from resample.reading.markup import check_xml
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
