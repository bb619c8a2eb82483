import struct

import numpy as np
import pytest
from PIL import Image, TiffImagePlugin

from resample.files.metadata.tags import (
    ASCII,
    DOUBLE,
    Tag,
    add_tags,
    block_of,
    block_tags,
    read_tags,
    text,
)

PLACE, WORDS, EXIF = 33922, 34737, 34665
NUMBERS = Tag(DOUBLE, np.array([0.1, -2.5, 3e300]))
NAME = Tag(ASCII, np.frombuffer(b"WGS 84|\0", np.uint8))
SPEED = Tag(5, np.array([1, 250], np.uint32))


def empty(path, form: str, pages: int = 1) -> None:
    """TIFF of directories with a single tag (width 7); `form` is bytes' order and a version."""
    order, version = form[0], int(form[1:])
    head = b"II" if order == "<" else b"MM"
    if version == 42:
        start, size = head + struct.pack(order + "HI", 42, 8), 2 + 12 + 4
        entry, count, word = struct.pack(order + "HHIHH", 256, 3, 1, 7, 0), "H", "I"
    else:
        start, size = head + struct.pack(order + "HHHQ", 43, 8, 0, 16), 8 + 20 + 8
        entry, count, word = struct.pack(order + "HHQHHI", 256, 3, 1, 7, 0, 0), "Q", "Q"
    data = start
    for n in range(pages):
        after = len(start) + (n + 1) * size if n < pages - 1 else 0
        data += struct.pack(order + count, 1) + entry + struct.pack(order + word, after)
    path.write_bytes(data)


@pytest.mark.parametrize("form", ["<42", ">42", "<43", ">43"])
def test_tags_of_every_page_come_back(form, tmp_path):
    path = tmp_path / "a.tif"
    empty(path, form, 3)
    add_tags(path, [{PLACE: NUMBERS}, {}, {WORDS: NAME, EXIF: {0x829A: SPEED, 1: NAME}}])
    first, second, third = read_tags(path, (256, PLACE, WORDS), {EXIF: None})
    assert [page[256].values.tolist() for page in (first, second, third)] == [[7]] * 3
    assert np.array_equal(first[PLACE].values, NUMBERS.values)
    assert set(second) == {256}
    assert text(third[WORDS]) == "WGS 84|"
    assert third[EXIF][0x829A].values.tolist() == [1, 250]


def test_a_tag_replaces_its_namesake(tmp_path):
    path = tmp_path / "a.tif"
    empty(path, "<42")
    for _ in range(2):
        add_tags(path, [{256: Tag(3, np.array([9], np.uint16))}])
    assert [page[256].values.tolist() for page in read_tags(path, (256,), {})] == [[9]]


def test_pillow_reads_what_is_added(tmp_path):
    path = tmp_path / "a.tif"
    Image.new("L", (5, 4), 77).save(path)
    add_tags(path, [{PLACE: NUMBERS, WORDS: NAME, EXIF: {0x829A: SPEED}}])
    with Image.open(path) as image:
        assert image.getpixel((3, 2)) == 77
        assert image.tag_v2[PLACE] == tuple(NUMBERS.values)
        assert image.tag_v2[WORDS] == "WGS 84|"
        assert image.getexif().get_ifd(EXIF)[0x829A] == pytest.approx(1 / 250)


@pytest.mark.parametrize("order", [b"II", b"MM"])
def test_what_pillow_wrote_is_read(order, tmp_path):
    path, tags = (
        tmp_path / "a.tif",
        TiffImagePlugin.ImageFileDirectory_v2(
            order + (b"*\0" if order == b"II" else b"\0*") + bytes(4)
        ),
    )
    tags.tagtype[PLACE] = DOUBLE
    tags[PLACE] = tuple(NUMBERS.values)
    Image.new("L", (5, 4)).save(path, tiffinfo=tags)
    assert np.array_equal(read_tags(path, (PLACE,), {})[0][PLACE].values, NUMBERS.values)


def test_a_block_is_what_pillow_calls_exif():
    block = block_of({271: NAME, EXIF: {0x829A: SPEED}})
    seen = Image.Exif()
    seen.load(b"Exif\0\0" + block)
    assert seen[271] == "WGS 84|"
    assert seen.get_ifd(EXIF)[0x829A] == pytest.approx(1 / 250)
    assert text(block_tags(block, (271,), {EXIF: None})[271]) == "WGS 84|"


def test_what_is_no_tiff_has_no_tags(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("MM or II, but no more")
    assert read_tags(path, (256,), {}) == []
    assert block_tags(b"II*", (256,), {}) == {}


def test_damage_is_an_error_for_files_and_nothing_for_blocks(tmp_path):
    path = tmp_path / "a.tif"
    empty(path, "<42")
    path.write_bytes(path.read_bytes()[:14])
    with pytest.raises(OSError, match="its tags are damaged"):
        read_tags(path, (256,), {})
    assert block_tags(path.read_bytes(), (256,), {}) == {}


@pytest.mark.sweep
def test_directories_in_a_circle_end(tmp_path):
    path = tmp_path / "a.tif"
    empty(path, "<42")
    data = bytearray(path.read_bytes())
    data[-4:] = (8).to_bytes(4, "little")
    path.write_bytes(data)
    with pytest.raises(OSError, match="its tags are damaged: directories overlap or form a loop"):
        read_tags(path, (256,), {})
