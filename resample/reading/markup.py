"""XML of files, looked at before other libraries read it: deep XML ends the process in some."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import IO, Any

from resample.reading.limits import check_items, limits, refused

BLOCK = 1 << 16  # bytes that are looked at together
LONGEST = 1 << 20  # bytes of a tag or comment; parsers begin each again with each block


class _EndError(Exception):
    """What comes is no more XML."""


def check_xml(
    what: str, blocks: Iterable[bytes], last: str = "", encoding: str | None = None
) -> int:
    """Refuse XML whose elements are nested too deep, or that defines things of its own.

    What is no XML is left to who reads it, and says what is wrong with it.

    Parameters
    ----------
    what
        Name for the message.
    blocks
        Its bytes, piece by piece.
    last
        Name of an element behind whose beginning come data; empty: all is XML.
    encoding
        Of the bytes; None: as they say.

    Returns
    -------
    Number of elements.

    Raises
    ------
    ValueError
        There is something to refuse.

    Examples
    --------
    >>> from resample.reading.markup import check_xml
    >>> check_xml("a.xml", [b"<a><b/></a>"])
    2
    """
    from xml.parsers import expat

    parser, seen, read = expat.ParserCreate(encoding), _Seen(what, last), 0
    parser.StartElementHandler, parser.EndElementHandler = seen.begun, seen.ended
    parser.StartDoctypeDeclHandler = parser.EntityDeclHandler = seen.defined
    try:
        for block in blocks:
            parser.Parse(block, False)
            read += len(block)
            if read - parser.CurrentByteIndex > LONGEST:
                raise ValueError(f"{what} has a tag or comment of more than {LONGEST} bytes")
    except (expat.ExpatError, LookupError, _EndError):  # lookups are of encodings
        pass
    return seen.count


class _Seen:
    """What of XML has been seen so far."""

    def __init__(self, what: str, last: str) -> None:
        self.what, self.last, self.most = what, last, limits().depth
        self.depth = self.count = 0

    def begun(self, name: str, _: Any) -> None:
        """Go on to an element within others."""
        self.depth += 1
        self.count += 1
        if self.depth > self.most:
            raise refused(f"{self.what} is too deep", "elements within each other", "depth")
        if name == self.last:
            raise _EndError

    def ended(self, _: str) -> None:
        """Leave an element."""
        self.depth -= 1

    def defined(self, *_: Any) -> None:
        """Refuse what defines things."""
        raise ValueError(f"{self.what} defines things of its own (DOCTYPE), which are not read")


def check_xml_file(path: Path, last: str = "") -> None:
    """As `check_xml` of a file, of which very many elements are refused, too."""
    with path.open("rb") as file:
        check_items(path.name, check_xml(path.name, _blocks(file), last), "elements")


def check_xml_member(what: str, file: IO[bytes]) -> None:
    """As `check_xml` of an open member of an archive."""
    check_xml(what, _blocks(file))


def check_xml_text(what: str, text: str) -> None:
    """As `check_xml` of a text."""
    pieces = (text[start : start + BLOCK] for start in range(0, len(text), BLOCK))
    check_xml(what, (piece.encode() for piece in pieces), encoding="utf-8")


def _blocks(file: IO[bytes]) -> Iterator[bytes]:
    while block := file.read(BLOCK):
        yield block
