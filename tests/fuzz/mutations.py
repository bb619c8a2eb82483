"""Files changed: bytes, numbers, lengths, words, and packed data that is packed again."""

import gzip
import io
import random
import re
import struct
import zipfile
from collections.abc import Callable, Mapping

from tests.fuzz.stores import SIGNATURE, chunks_of, png_of

NUMBERS = (
    *("0", "-0", "-1", "1e38", "-1e38", "1e-38", "1e-45", "5e-324", "1e308", "1e400", "nan", "inf"),
    *(
        "-inf",
        "2147483648",
        "4294967296",
        "9223372036854775808",
        "1" + "0" * 40,
        "99999999",
        "1e-30",
    ),
    *("0x7f", "1_000", "--1", "1e", "65536", "256", "-2147483649", "3.5", "null", "true", ""),
)
WORDS = (
    *("\x1b[2J", "\r", "\x07", "\0", "\x9b31m", "\u202e", "a" * 5000, "é", "%s%n", "../../../a"),
    *(
        "/etc/passwd",
        "https://example.org/a",
        "file:///etc/passwd",
        "~/a",
        "C:\\a",
        "a%09d.raw 1 99999999 1",
    ),
    *(
        "[" * 200,
        "{" * 200,
        '"',
        "'",
        "{}",
        "[]",
        "[[]]",
        "()",
        "=",
        ":",
        ",",
        "#",
        "\n",
        "\\",
        "LIST",
        "NaN",
    ),
)
WHOLE = (0, 1, -1, 2, 0x7F, 0x80, 0xFF, 0x7FFF, 0x8000, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF)
WIDER = (0x7FFFFFFFFFFFFFFF, 0x8000000000000000, 0xFFFFFFFFFFFFFFFF, 1 << 40)
FLOATS = (1e38, -1e38, 1e-38, 1e-45, 0.0, -0.0, float("nan"), float("inf"), 1e-30, 1e20, -1.0)
IS_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")
IS_WORD = re.compile(rb"[A-Za-z_][\w.-]*")

Change = Callable[[random.Random, bytearray], bytes | bytearray]


def mutated(rng: random.Random, files: Mapping[str, bytes]) -> dict[str, bytes]:
    """Files of which one or more are changed, at one to four places each."""
    names = list(files)
    chosen = {names[0]} if rng.random() < 0.7 else {rng.choice(names)}
    if rng.random() < 0.1:
        chosen = set(names)
    made = dict(files)
    for name in chosen:
        made[name] = _changed(rng, files[name])
    if len(names) > 1 and rng.random() < 0.02:
        del made[names[-1]]
    return made


def _changed(rng: random.Random, content: bytes) -> bytes:
    """One file, changed; packed ones sometimes within."""
    if content[:2] == b"\x1f\x8b" and rng.random() < 0.6:
        return gzip.compress(_changed(rng, gzip.decompress(content)), 1)
    if content[:2] == b"PK" and rng.random() < 0.6:
        return _changed_zip(rng, content)
    if content.startswith(SIGNATURE) and rng.random() < 0.4:
        return _changed_png(rng, content)
    made = bytearray(content)
    is_text = all(byte in b"\t\n\r" or 32 <= byte < 127 for byte in content[:64])
    for _ in range(rng.choice((1, 1, 1, 2, 3, 4))):
        changes = OF_TEXTS if is_text and rng.random() < 0.8 else OF_BYTES
        made = bytearray(rng.choice(changes)(rng, made))
    return bytes(made[: 1 << 20])


def _changed_png(rng: random.Random, content: bytes) -> bytes:
    """A chunk changed, with a checksum that is right; texts as such, behind their key."""
    chunks = chunks_of(content)
    texts = [n for n, chunk in enumerate(chunks) if chunk.startswith(b"tEXt")]
    n = rng.choice(texts or range(len(chunks)))
    kept = chunks[n].index(b"\0") + 1 if texts else 4
    chunks[n] = chunks[n][:kept] + _changed(rng, chunks[n][kept:])
    return png_of(chunks)


def _changed_zip(rng: random.Random, content: bytes) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(content)) as old, zipfile.ZipFile(file, "w") as new:
        names = sorted(set(old.namelist()))
        chosen = rng.choice(names)
        for name in names:
            data = old.read(name)
            new.writestr(name, _changed(rng, data) if name == chosen else data)
    return file.getvalue()


def _place(rng: random.Random, made: bytearray) -> int:
    """Somewhere, more often near the beginning, where headers are."""
    size = len(made)
    near = min(size, rng.choice((16, 64, 400, size or 1)))
    return rng.randrange(near) if near else 0


def _flip(rng: random.Random, made: bytearray) -> bytearray:
    if made:
        made[_place(rng, made)] ^= 1 << rng.randrange(8)
    return made


def _byte(rng: random.Random, made: bytearray) -> bytearray:
    if made:
        made[_place(rng, made)] = rng.choice((0, 1, 127, 128, 255, rng.randrange(256)))
    return made


def _whole(rng: random.Random, made: bytearray) -> bytearray:
    """A whole number of 2, 4 or 8 bytes in its place."""
    width = rng.choice((2, 4, 4, 8))
    number = rng.choice(WHOLE + (WIDER if width == 8 else ())) & ((1 << 8 * width) - 1)
    return _over(rng, made, number.to_bytes(width, rng.choice(("little", "big"))))


def _float(rng: random.Random, made: bytearray) -> bytearray:
    number, form = rng.choice(FLOATS), rng.choice(("<f", ">f", "<d", ">d"))
    return _over(rng, made, struct.pack(form, number))


def _over(rng: random.Random, made: bytearray, piece: bytes) -> bytearray:
    place = _place(rng, made)
    if rng.random() < 0.7:
        place -= place % len(piece)
    made[place : place + len(piece)] = piece
    return made


def _cut(rng: random.Random, made: bytearray) -> bytearray:
    return made[: rng.randrange(len(made) + 1)]


def _drop(rng: random.Random, made: bytearray) -> bytearray:
    place = _place(rng, made)
    del made[place : place + rng.choice((1, 2, 4, 16, 100))]
    return made


def _insert(rng: random.Random, made: bytearray) -> bytearray:
    place = _place(rng, made)
    made[place:place] = rng.randbytes(rng.choice((1, 2, 4, 16, 100)))
    return made


def _repeat(rng: random.Random, made: bytearray) -> bytearray:
    first, size = _place(rng, made), rng.choice((1, 4, 16, 64))
    made[first:first] = made[first : first + size] * rng.choice((1, 2, 50))
    return made


def _number(rng: random.Random, made: bytearray) -> bytes:
    """Another number of a text."""
    return _replaced(rng, made, IS_NUMBER, rng.choice(NUMBERS))


def _word(rng: random.Random, made: bytearray) -> bytes:
    """Another word of a text, of its own or none."""
    found = IS_WORD.findall(bytes(made[:4096]))
    own = rng.choice(found).decode() if found else ""
    pattern = rng.choice((IS_WORD, IS_WORD, IS_NUMBER))
    return _replaced(rng, made, pattern, rng.choice((own, rng.choice(WORDS))))


def _replaced(rng: random.Random, made: bytearray, pattern: re.Pattern[bytes], text: str) -> bytes:
    found = list(pattern.finditer(bytes(made[:4096])))
    if not found:
        return bytes(made)
    one = rng.choice(found)
    return bytes(made[: one.start()]) + text.encode() + bytes(made[one.end() :])


def _line(rng: random.Random, made: bytearray) -> bytes:
    """A line gone, twice, many times, elsewhere, or empty."""
    lines = bytes(made).split(b"\n")
    n = rng.randrange(len(lines))
    line = lines.pop(n)
    again = rng.choice(([], [line] * 2, [line] * 300, [b"", line], [line[: len(line) // 2]]))
    at = rng.choice((n, rng.randrange(len(lines) + 1)))
    return b"\n".join([*lines[:at], *again, *lines[at:]])


def _nested(rng: random.Random, made: bytearray) -> bytes:
    """A value within very many others, or a name of very many parts."""
    found = list((IS_NUMBER if rng.random() < 0.6 else IS_WORD).finditer(bytes(made[:4096])))
    if not found:
        return bytes(made)
    one, depth = rng.choice(found), rng.choice((3, 20, 70, 3000))
    before, after = rng.choice((("[", "]"), ('{"a":', "}"), ("a.", ""), ("{a=", "}"), ("(", ")")))
    inner = before.encode() * depth + one[0] + after.encode() * depth
    return bytes(made[: one.start()]) + inner + bytes(made[one.end() :])


OF_BYTES: tuple[Change, ...] = (_flip, _byte, _whole, _whole, _float, _cut, _drop, _insert, _repeat)
OF_TEXTS: tuple[Change, ...] = (
    _number,
    _number,
    _number,
    _word,
    _word,
    _line,
    _nested,
    *OF_BYTES[:2],
)
