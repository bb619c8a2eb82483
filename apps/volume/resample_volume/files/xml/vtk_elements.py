"""Elements of VTK's XML files and the location of their data, by the parser that VTK uses."""

from dataclasses import dataclass
from mmap import mmap
from typing import Any

BLOCK = 1 << 16  # bytes parsed at a time
APPENDED = "AppendedData"  # what follows its beginning is no XML


class _NotXmlError(Exception):
    """The XML part of the file has ended."""


@dataclass
class Element:
    """An element and its location."""

    name: str
    attributes: dict[str, str]
    start: int  # byte of its tag
    data: int = -1  # byte of its first non-blank character; -1: none
    end: int = -1  # byte of its end; -1: it has none


def elements_of(content: mmap) -> list[Element]:
    """Return all elements in order, as far as a file is XML; appended data is the last."""
    from xml.parsers import expat

    parser, seen = expat.ParserCreate(), _Tracker()
    seen.parser = parser
    parser.StartElementHandler, parser.EndElementHandler = seen.begun, seen.ended
    try:
        for start in range(0, len(content), BLOCK):
            parser.Parse(content[start : start + BLOCK], False)
    except (expat.ExpatError, LookupError, _NotXmlError):  # look-ups are of encodings
        pass
    return seen.every


def data_start(content: mmap, appended: Element) -> int:
    """Return the byte after the underscore of appended data; -1: there is none."""
    place = content.find(b">", appended.start) + 1
    while place and content[place : place + 1].isspace():
        place += 1
    return place + 1 if place and content[place : place + 1] == b"_" else -1


class _Tracker:
    """Parser state: finished elements, and the open ones."""

    def __init__(self) -> None:
        self.every: list[Element] = []
        self.around: list[Element] = []
        self.parser: Any = None

    def begun(self, name: str, attributes: dict[str, str]) -> None:
        """Enter an element."""
        self.every.append(Element(name, attributes, self.parser.CurrentByteIndex))
        if name == APPENDED:
            raise _NotXmlError
        self.around.append(self.every[-1])
        self.parser.CharacterDataHandler = self.text

    def ended(self, _: str) -> None:
        """Leave an element."""
        self.around.pop().end = self.parser.CurrentByteIndex
        is_open = bool(self.around) and self.around[-1].data < 0
        self.parser.CharacterDataHandler = self.text if is_open else None

    def text(self, text: str) -> None:
        """Record where an element's data begin."""
        if self.around and text.strip():
            before = len(text) - len(text.lstrip())
            self.around[-1].data = self.parser.CurrentByteIndex + before
            self.parser.CharacterDataHandler = None
