"""What the elements of VTK's XML say, and where their data are, by a parser such as VTK has."""

from dataclasses import dataclass
from mmap import mmap
from typing import Any

BLOCK = 1 << 16  # bytes that are parsed at a time
APPENDED = "AppendedData"  # what follows its beginning is no XML


class _EndError(Exception):
    """What comes is no more XML."""


@dataclass
class Element:
    """An element, and where it is."""

    name: str
    told: dict[str, str]
    start: int  # byte of its tag
    data: int = -1  # byte of its first letter that is no space; -1: it has none
    end: int = -1  # byte of what ends it; -1: nothing does


def elements_of(content: mmap) -> list[Element]:
    """All elements in their order, as far as a file is XML; that of appended data is the last."""
    from xml.parsers import expat

    parser, seen = expat.ParserCreate(), _Tracker()
    seen.parser = parser
    parser.StartElementHandler, parser.EndElementHandler = seen.begun, seen.ended
    try:
        for start in range(0, len(content), BLOCK):
            parser.Parse(content[start : start + BLOCK], False)
    except (expat.ExpatError, LookupError, _EndError):  # look-ups are of encodings
        pass
    return seen.every


def data_start(content: mmap, appended: Element) -> int:
    """Byte behind the underscore that appended data begin with; -1: there is none."""
    place = content.find(b">", appended.start) + 1
    while place and content[place : place + 1].isspace():
        place += 1
    return place + 1 if place and content[place : place + 1] == b"_" else -1


class _Tracker:
    """Elements that were seen, and those around the present place."""

    def __init__(self) -> None:
        self.every: list[Element] = []
        self.around: list[Element] = []
        self.parser: Any = None

    def begun(self, name: str, told: dict[str, str]) -> None:
        """Go on to an element."""
        self.every.append(Element(name, told, self.parser.CurrentByteIndex))
        if name == APPENDED:
            raise _EndError
        self.around.append(self.every[-1])
        self.parser.CharacterDataHandler = self.text

    def ended(self, _: str) -> None:
        """Leave an element."""
        self.around.pop().end = self.parser.CurrentByteIndex
        is_open = bool(self.around) and self.around[-1].data < 0
        self.parser.CharacterDataHandler = self.text if is_open else None

    def text(self, text: str) -> None:
        """Note where an element's data begin, and look at no more of them."""
        if self.around and text.strip():
            before = len(text) - len(text.lstrip())
            self.around[-1].data = self.parser.CurrentByteIndex + before
            self.parser.CharacterDataHandler = None
