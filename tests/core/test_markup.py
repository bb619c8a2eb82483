"""XML of files: refused where it is deep, or defines things, before a library meets it."""

import zipfile

import pytest

from resample.cameras.calibrations import read_lens
from resample.reading.meshes import check_mesh
from resample.reading.texts import LONGEST, check_xml, check_xml_file
from resample_volume.files.vtk import Vti, Vtr

DEEP = "<a>" * 131_250
BOMB = '<!DOCTYPE a [<!ENTITY b "lol"><!ENTITY c "&b;&b;&b;">]><a>&c;</a>'
GRID = (
    '<VTKFile type="ImageData"><ImageData WholeExtent="0 1 0 1 0 1">{}<Piece Extent="0 1 0 1 0 1">'
    '<PointData Scalars="a"><DataArray type="UInt8" Name="a" format="ascii">1 2 3 4 5 6 7 8'
    "</DataArray></PointData></Piece></ImageData></VTKFile>"
)


@pytest.mark.parametrize("read", [Vti(), Vtr(), lambda path: read_lens(str(path)), check_mesh])
@pytest.mark.parametrize(("text", "match"), [(DEEP, "over the limit of 64"), (BOMB, "DOCTYPE")])
def test_deep_xml_and_what_defines_entities_are_refused(read, text, match, tmp_path):
    suffix = getattr(read, "suffixes", [".dae" if read is check_mesh else ".xml"])[0]
    if suffix.startswith(".vt"):
        pytest.importorskip("vtkmodules")
    path = tmp_path / f"a{suffix}"
    path.write_text(GRID.format(text) if suffix.startswith(".vt") and text is DEEP else text)
    with path.open("a") as file:
        file.write("</VTKFile>")
    with pytest.raises(ValueError, match=match):
        read(path)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "latin-1"])
def test_depth_is_that_of_the_text_in_whatever_letters(encoding):
    mark = f'<?xml version="1.0" encoding="{encoding}"?>'
    assert check_xml("a", [(mark + "<a>" * 64 + "</a>" * 64).encode(encoding)]) == 64
    with pytest.raises(ValueError, match="over the limit of 64"):
        check_xml("a", [(mark + "<a>" * 65).encode(encoding)])


def test_slashes_and_brackets_in_attributes_comments_and_data_close_nothing():
    text = "<a b='/>'>" * 60 + "<!-- </a> -->" + "<![CDATA[</a>]]>" + "<a>" * 5
    with pytest.raises(ValueError, match="over the limit of 64"):
        check_xml("a", [text.encode()])


def test_data_behind_an_element_are_not_looked_at():
    assert check_xml("a", [b"<r><d>_\xff\x00</r><" + b"<x>" * 100], last="d") == 2


def test_tags_that_go_on_and_on_are_refused():
    blocks = [b"<a b='", *[bytes([99]) * (1 << 16)] * (2 * LONGEST >> 16)]
    with pytest.raises(ValueError, match="tag or comment"):
        check_xml("a", blocks)


def test_very_many_elements_of_a_file_are_refused(tmp_path, monkeypatch):
    monkeypatch.setenv("RESAMPLE_LIMIT", "items=10")
    (tmp_path / "a.xml").write_text("<a>" + "<b/>" * 10 + "</a>")
    with pytest.raises(ValueError, match="11 elements"):
        check_xml_file(tmp_path / "a.xml")


def test_deep_xml_in_an_archive_is_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.3mf", "w", zipfile.ZIP_DEFLATED) as packed:
        packed.writestr("3D/a.model", DEEP)
    with pytest.raises(ValueError, match=r"a\.3mf: 3D/a\.model is too deep"):
        check_mesh(tmp_path / "a.3mf")


def test_what_is_no_xml_is_left_to_its_reader():
    for content in (b"", b"\xff\xff", b"<a", b'<?xml version="1.0" encoding="none"?><a>'):
        assert check_xml("a", [content]) == 0
