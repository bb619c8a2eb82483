"""Grids of cells of VTK's, resampled onto a lattice."""

import numpy as np
import pytest

from resample.reading.limits import SETTING
from resample_cells import lattice
from resample_cells.readers import Vtm, Vts, Vtu, legacy_grid
from resample_volume import as_volume
from resample_volume.data.recordings import volume_at
from resample_volume.files.sections import Sections
from resample_volume.files.source import describe, open_volume
from resample_volume.files.vtk import Vtk, check_blocks

pytest.importorskip("vtkmodules", reason="VTK, the extra vtk, is not installed")

from vtkmodules import vtkIOLegacy, vtkIOXML
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkImageData, vtkMultiBlockDataSet, vtkStructuredGrid
from vtkmodules.vtkFiltersGeneral import vtkDataSetTriangleFilter

STEPS = (0.25, 0.5, 1.0)
COUNT = (9, 7, 5)  # points along x, y, z


def put_array(held, name, values):
    array = numpy_to_vtk(np.ascontiguousarray(values), deep=True)
    array.SetName(name)
    held.AddArray(array)


def curved(bend=0.0):
    """Structured grid, whose planes of z are moved along x; density is linear in place."""
    axes = [step * np.arange(count) for step, count in zip(STEPS, COUNT, strict=True)]
    z, y, x = np.meshgrid(*axes[::-1], indexing="ij")
    x = x + bend * np.sin(z)
    place = np.stack([x, y, z], -1).reshape(-1, 3)
    points = vtkPoints()
    points.SetData(numpy_to_vtk(place, deep=True))
    grid = vtkStructuredGrid()
    grid.SetDimensions(*COUNT)
    grid.SetPoints(points)
    put_array(grid.GetPointData(), "density", linear(*place.T))
    put_array(grid.GetPointData(), "wind", place.astype(np.float32))
    put_array(grid.GetCellData(), "number", np.arange(8 * 6 * 4, dtype=np.int16))
    return grid


def linear(x, y, z):
    return 10 + x + 2 * y - 3 * z


def tetrahedra(grid):
    cut = vtkDataSetTriangleFilter()
    cut.SetInputData(grid)
    cut.Update()
    return cut.GetOutput()


def written(grid, path, writer, home=vtkIOXML, **choices):
    made = getattr(home, writer)()
    made.SetInputData(grid)
    made.SetFileName(str(path))
    for name, value in choices.items():
        getattr(made, name)(value)
    made.Write()
    return path


def block(count, step, origin, *, of_cells=True, name="density"):
    """Image data with linear values."""
    image = vtkImageData()
    image.SetDimensions(*np.add(count, of_cells).tolist())
    image.SetSpacing(step, step, step)
    image.SetOrigin(*origin)
    axes = [
        start + step * (np.arange(n) + of_cells / 2) for n, start in zip(count, origin, strict=True)
    ]
    z, y, x = np.meshgrid(*axes[::-1], indexing="ij")
    held = image.GetCellData() if of_cells else image.GetPointData()
    put_array(held, name, linear(x, y, z).ravel())
    return image


def places(volume):
    """Coordinates x, y, z (Z, Y, X) of voxels on an upright lattice."""
    axes = [
        start + step * np.arange(count)
        for start, step, count in zip(
            volume.origin, volume.spacing, volume.values.shape[::-1], strict=True
        )
    ]
    return np.meshgrid(*axes[::-1], indexing="ij")[::-1]


def refused(reader, path, match):
    with pytest.raises((ValueError, OSError), match=match) as caught:
        reader(path)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400


def test_an_upright_structured_grid_is_read_without_error(tmp_path):
    path = written(curved(), tmp_path / "a.vts", "vtkXMLStructuredGridWriter")
    volume = Vts("density")(path)
    assert volume.spacing.tolist() == list(STEPS)
    assert volume.origin.tolist() == [0, 0, 0]
    np.testing.assert_allclose(volume.values, linear(*places(volume)))
    assert volume.note == (
        "192 cells were resampled onto a lattice of 9 x 7 x 5 voxels, 0.25 x 0.5 x 1 apart; "
        "interpolated back at the grid's own points they differ by 0 % of the range (rms), 0 % at "
        "most"
    )


def test_cells_of_an_upright_grid_become_voxels_at_their_centers(tmp_path):
    path = written(curved(), tmp_path / "a.vts", "vtkXMLStructuredGridWriter")
    volume = Vts("number")(path)
    assert np.array_equal(volume.values.ravel(), np.arange(192))
    assert volume.origin.tolist() == [0.125, 0.25, 0.5]


@pytest.mark.parametrize("kind", ["vts", "vtu"])
def test_linear_values_of_a_curved_grid_are_right_wherever_cells_are(kind, tmp_path):
    grid, writer, reader = curved(0.4), "vtkXMLStructuredGridWriter", Vts("density")
    if kind == "vtu":
        grid, writer = tetrahedra(grid), "vtkXMLUnstructuredGridWriter"
        reader = Vtu("density", spacing="0.1x0.2x0.4")
    volume = reader(written(grid, tmp_path / f"a.{kind}", writer))
    x, y, z = places(volume)
    known = np.isfinite(volume.values)
    bend = 0.4 * ((1 - z % 1) * np.sin(z // 1) + z % 1 * np.sin(z // 1 + 1))
    inside = (x - bend > 1e-3) & (x - bend < 2 - 1e-3)
    assert known[inside].all()
    assert not known[(x - bend < -1e-3) | (x - bend > 2 + 1e-3)].any()
    np.testing.assert_allclose(volume.values[inside], linear(x, y, z)[inside], atol=1e-6)
    assert "% of its points" in volume.note
    assert describe(volume)["nan"] == (~known).sum()


def test_the_error_that_is_said_is_that_of_the_lattice(tmp_path):
    grid = curved()
    held = vtk_to_numpy(grid.GetPointData().GetArray("density"))
    held[:] = 0
    held[np.ravel_multi_index((2, 3, 4), COUNT[::-1])] = 8
    path = written(grid, tmp_path / "a.vts", "vtkXMLStructuredGridWriter")
    volume = Vts("density", spacing="0.5x1x2")(path)  # every other point, but not that one
    assert volume.values.shape == (3, 4, 5)
    assert "differ by 5.6 % of the range (rms), 1e+02 % at most" in volume.note  # sqrt(1 / 315)
    assert volume.values.max() == 0


def test_steps_may_be_one_number(tmp_path):
    path = written(curved(), tmp_path / "a.vts", "vtkXMLStructuredGridWriter")
    volume = Vts("density", spacing="0.5")(path)
    assert volume.spacing.tolist() == [0.5, 0.5, 0.5]
    assert volume.values.shape == (9, 7, 5)
    with pytest.raises(ValueError, match="spacing is three positive numbers"):
        Vts(spacing="0")
    with pytest.raises(ValueError, match="part is magnitude"):
        Vtu(part="wind")


def test_vectors_are_channels_and_lengths(tmp_path):
    path = written(curved(), tmp_path / "a.vts", "vtkXMLStructuredGridWriter")
    held = Vts("wind").recorded(path)
    assert held.values.shape == (1, 3, 5, 7, 9)
    y = volume_at(held, None, 1)
    np.testing.assert_allclose(y.values, places(y)[1], atol=1e-6)
    length = Vts("wind", "magnitude")(path)
    np.testing.assert_allclose(length.values[4, 6, 8], np.sqrt(4 + 9 + 16), rtol=1e-6)
    refused(Vts("rain"), path, r"vts:array=NAME \(rain given\): density, wind, number \(cells\)")


@pytest.mark.some(2)
@pytest.mark.parametrize("version", [42, 51])
@pytest.mark.parametrize("form", [1, 2], ids=["ASCII", "BINARY"])
@pytest.mark.parametrize("kind", ["StructuredGrid", "UnstructuredGrid"])
def test_legacy_grids_are_those_that_vtk_reads(kind, form, version, tmp_path):
    grid = curved(0.4)
    grid = tetrahedra(grid) if kind == "UnstructuredGrid" else grid
    choices = {"SetFileVersion": version, "SetFileType": form}
    path = written(grid, tmp_path / "a.vtk", f"vtk{kind}Writer", vtkIOLegacy, **choices)
    reader = getattr(vtkIOLegacy, f"vtk{kind}Reader")()
    reader.SetFileName(str(path))
    reader.ReadAllFieldsOn()
    reader.Update()
    truth = reader.GetOutput()
    with path.open("rb") as file:
        read = legacy_grid(Sections(file, path.name))
    assert np.array_equal(
        vtk_to_numpy(read.GetPoints().GetData()), vtk_to_numpy(truth.GetPoints().GetData())
    )
    if kind == "UnstructuredGrid":
        for part in ("GetOffsetsArray", "GetConnectivityArray"):
            ours, theirs = (getattr(each.GetCells(), part)() for each in (read, truth))
            assert np.array_equal(vtk_to_numpy(ours), vtk_to_numpy(theirs))
        assert {read.GetCellType(n) for n in range(read.GetNumberOfCells())} == {10}
    volume = Vtk("density")(path)
    x, y, z = (part[np.isfinite(volume.values)] for part in places(volume))
    np.testing.assert_allclose(
        volume.values[np.isfinite(volume.values)], linear(x, y, z), atol=1e-5
    )
    assert Vtk("number", spacing="0.25x0.5x1")(path).spacing.tolist() == list(STEPS)


HEAD = "# vtk DataFile Version 3.0\na\nASCII\nDATASET "
CUBE = "0 0 0 1 0 0 0 1 0 1 1 0 0 0 1 1 0 1 0 1 1 1 1 1\n"
WHOLE = (
    f"{HEAD}UNSTRUCTURED_GRID\nPOINTS 8 float\n{CUBE}CELLS 1 9\n8 0 1 2 3 4 5 6 7\n"
    "CELL_TYPES 1\n11\nPOINT_DATA 8\nSCALARS v float\nLOOKUP_TABLE default\n0 1 2 3 4 5 6 7\n"
)


def test_a_cube_of_one_voxel_has_its_corners(tmp_path):
    (tmp_path / "a.vtk").write_text(WHOLE)
    assert open_volume(tmp_path / "a.vtk").values.ravel().tolist() == list(range(8))


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ("6 7\nCELL", "6 8\nCELL", "corners that are not among its points"),
        ("6 7\nCELL", "6 -7\nCELL", "corners that are not among its points"),
        ("8 0 1 2", "9 0 1 2", "do not fill the numbers"),
        ("8 0 1 2", "-8 0 1 2", "do not fill the numbers"),
        ("CELL_TYPES 1\n11", "CELL_TYPES 1\n10", "other numbers of corners than their kinds"),
        ("CELL_TYPES 1\n11", "CELL_TYPES 1\n99", "kind 99, which is not known"),
        ("CELL_TYPES 1\n11", "CELL_TYPES 1\n300", "kinds that are not read"),
        ("CELL_TYPES 1\n11", "CELL_TYPES 1\n42", "kinds that are not read"),
        ("CELL_TYPES 1\n11\n", "", "points, cells or their kinds are missing"),
        ("POINTS 8", "POINTS 7", "a line holds more than"),
        ("POINTS 8", "POINTS 99999999999999", "is cut off"),
        ("CELLS 1 9", "CELLS 1 99999999999999", "is cut off"),
        ("0 0 0 1", "nan 0 0 1", "points are not numbers"),
        ("1 1 1\nCELLS", "1 1 1e30\nCELLS", "no volume"),
        (" 0 0 1 1 0 1 0 1 1 1 1 1", " 0 0 0 1 0 0 0 1 0 1 1 0", "fills 1 x 1 x 0, no volume"),
        ("CELLS 1 9", "FISHES 1 9", "'FISHES'"),
        ("POINT_DATA 8", "POINT_DATA 9", "values of 8 points"),
        ("6 7\n", "", "is damaged: invalid literal"),
    ],
)
def test_nonsense_in_a_legacy_grid_is_refused_in_words(old, new, match, tmp_path):
    assert old in WHOLE
    (tmp_path / "a.vtk").write_text(WHOLE.replace(old, new))
    refused(open_volume, tmp_path / "a.vtk", match)


def test_cells_without_volume_are_refused_though_they_lie_in_space(tmp_path):
    """Two triangles' worth of a cube's diagonal plane."""
    flat = WHOLE.replace("CELLS 1 9\n8 0 1 2 3 4 5 6 7", "CELLS 1 5\n4 0 1 7 6")
    (tmp_path / "a.vtk").write_text(flat.replace("CELL_TYPES 1\n11", "CELL_TYPES 1\n9"))
    refused(open_volume, tmp_path / "a.vtk", "its cells have no volume")


def test_nonsense_in_a_legacy_structured_grid_is_refused_in_words(tmp_path):
    text = f"{HEAD}STRUCTURED_GRID\nDIMENSIONS 2 2 2\nPOINTS 8 float\n{CUBE}POINT_DATA 8\n"
    for old, new, match in (
        ("2 2 2", "2 2 3", "not as many as its DIMENSIONS"),
        ("2 2 2", "2 4 1", "a single slice"),
        ("2 2 2", "2 2", "too few words"),
        ("DIMENSIONS", "SIZES", "not part of a structured grid"),
        ("a", "a", "there is none"),
    ):
        (tmp_path / "a.vtk").write_text(text.replace(old, new))
        refused(open_volume, tmp_path / "a.vtk", match)


def test_a_lattice_has_no_steps_to_choose(tmp_path):
    text = f"{HEAD}STRUCTURED_POINTS\nDIMENSIONS 2 2 2\nPOINT_DATA 8\nSCALARS v float\n"
    (tmp_path / "a.vtk").write_text(f"{text}LOOKUP_TABLE default\n0 1 2 3 4 5 6 7\n")
    refused(Vtk(spacing="1"), tmp_path / "a.vtk", "not a grid of cells.*leave it out, or give --s")


def test_steps_that_memory_does_not_hold_are_refused(tmp_path):
    (tmp_path / "a.vtk").write_text(WHOLE)
    refused(Vtk(spacing="1e-5"), tmp_path / "a.vtk", "memory.*take larger steps")
    refused(Vtk(spacing="1e-300"), tmp_path / "a.vtk", "over 1048576 voxels along a side of 1")


def test_tiny_cells_in_a_wide_grid_do_not_make_a_lattice_beyond_sense(tmp_path):
    far = CUBE.replace("1", "1e-3").split()
    places = " ".join([*far, "9 9 9"])
    text = WHOLE.replace(CUBE, places + "\n").replace("POINTS 8", "POINTS 9")
    text = text.replace("POINT_DATA 8", "POINT_DATA 9").replace("6 7\n", "6 7\n", 1)
    (tmp_path / "a.vtk").write_text(text.rstrip() + " 8\n")
    volume = open_volume(tmp_path / "a.vtk")
    assert volume.values.size < 1 << 22
    assert "coarser than its cells" in volume.note


def blocks_file(folder, *, hidden=""):
    """File of two levels, the finer of which lies within the other, and their values (Z, Y, X)."""
    (folder / "parts").mkdir()
    pieces = (((4, 4, 4), 1.0, (0, 0, 0)), ((4, 4, 2), 0.5, (1, 1, 1)))
    text = ""
    for level, (count, step, origin) in enumerate(pieces):
        piece = folder / "parts" / f"{level}.vti"
        written(block(count, step, origin), piece, "vtkXMLImageDataWriter")
        text += (
            f'<Block level="{level}" spacing="{step} {step} {step}">'
            f'<DataSet index="0" amr_box="0 3 0 3 0 {count[2] - 1}" file="parts/{level}.vti"/>'
            "</Block>"
        )
    path = folder / "a.vthb"
    path.write_text(
        '<VTKFile type="vtkOverlappingAMR" version="1.1"><vtkOverlappingAMR origin="0 0 0" '
        f'grid_description="XYZ">{text}{hidden}</vtkOverlappingAMR></VTKFile>'
    )
    middle = np.arange(8) // 2 + 0.5
    z, y, x = np.meshgrid(middle, middle, middle, indexing="ij")
    truth = linear(x, y, z)
    fine = (slice(2, 4), slice(2, 6), slice(2, 6))
    z, y, x = np.meshgrid(*[0.25 + 0.5 * np.arange(8)] * 3, indexing="ij")
    truth[fine] = linear(x, y, z)[fine]
    return path, truth


def test_the_finer_level_of_a_refined_grid_is_shown(tmp_path):
    path, truth = blocks_file(tmp_path)
    volume = open_volume(path)
    assert volume.spacing.tolist() == [0.5, 0.5, 0.5]
    assert volume.origin.tolist() == [0.25, 0.25, 0.25]
    np.testing.assert_allclose(volume.values, truth)
    assert volume.note.startswith("96 cells in 2 pieces were resampled")


def test_blocks_beside_each_other_are_one_volume(tmp_path):
    blocks = vtkMultiBlockDataSet()
    blocks.SetBlock(0, block((3, 4, 5), 0.5, (0, 0, 0), of_cells=False))
    blocks.SetBlock(1, block((3, 4, 5), 0.5, (1, 0, 0), of_cells=False))
    blocks.SetBlock(2, block((3, 4, 5), 0.5, (9, 0, 0), of_cells=False, name="other"))
    path = written(blocks, tmp_path / "a.vtm", "vtkXMLMultiBlockDataWriter")
    volume = Vtm("density")(path)
    assert volume.values.shape == (5, 4, 5)
    np.testing.assert_allclose(volume.values, linear(*places(volume)))
    assert volume.note.endswith("at most; 1 of 3 pieces lack this array, or cells")
    np.testing.assert_array_equal(as_volume(blocks, part="density").values, volume.values)


@pytest.mark.parametrize(
    ("name", "match"),
    [
        ("../b.vti", "a path that leads outside"),
        ("/etc/passwd", "an absolute path"),
        ("http://a/b.vti", "an address"),
        ("b.vti", "wants 'b.vti', which is not beside it"),
        ("b.txt", "pieces are .vti, .vtr, .vts, .vtu and .vtp"),
        ("a.vtm", "pieces are .vti"),
    ],
)
def test_pieces_lie_beside_their_file_or_below(name, match, tmp_path):
    (tmp_path / "in").mkdir()
    written(block((3, 3, 3), 1, (0, 0, 0)), tmp_path / "b.vti", "vtkXMLImageDataWriter")
    path = tmp_path / "in" / "a.vtm"
    text = '<VTKFile type="vtkMultiBlockDataSet"><vtkMultiBlockDataSet><DataSet index="0" file='
    path.write_text(f'{text}"{name}"/></vtkMultiBlockDataSet></VTKFile>')
    refused(Vtm(), path, match)


def test_a_link_that_leads_outside_is_no_piece(tmp_path):
    folder = tmp_path / "in"
    folder.mkdir()
    path, _ = blocks_file(folder)
    piece = folder / "parts" / "1.vti"
    piece.rename(tmp_path / "1.vti")
    piece.symlink_to(tmp_path / "1.vti")
    refused(Vtm(), path, "a link that leads outside")


def test_files_of_blocks_that_are_none_are_refused(tmp_path):
    path = tmp_path / "a.vtm"
    for text, match in (
        ("<VTKFile><a", "is damaged"),
        ("<VTKFile/>", "names no grid that fills space"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><a/>', "has a DOCTYPE"),
        ('<a><DataSet file="b.vtp"/></a>', "names no grid"),
        ("<a>" * 100, "too deep"),
    ):
        path.write_text(text)
        refused(Vtm(), path, match)


@pytest.mark.parametrize("mode", [0, 1, 2], ids=["ascii", "binary", "appended"])
@pytest.mark.parametrize("kind", ["vts", "vtu"])
def test_grids_that_are_cut_off_are_refused(kind, mode, tmp_path):
    grid = curved() if kind == "vts" else tetrahedra(curved())
    writer = "vtkXMLStructuredGridWriter" if kind == "vts" else "vtkXMLUnstructuredGridWriter"
    path = written(grid, tmp_path / f"a.{kind}", writer, SetDataMode=mode)
    content = path.read_bytes()
    for share in (0.2, 0.6, 0.97):
        path.write_bytes(content[: int(share * len(content))])
        refused(open_volume, path, "is damaged")


def test_counts_that_a_file_cannot_fill_are_refused(tmp_path, monkeypatch):
    path = written(
        tetrahedra(curved()), tmp_path / "a.vtu", "vtkXMLUnstructuredGridWriter", SetDataMode=0
    )
    text = path.read_text()
    for old in ('NumberOfPoints="315"', 'NumberOfCells="960"', 'NumberOfComponents="3"'):
        assert old in text
        name = old.split("=")[0]
        path.write_text(text.replace(old, f'{name}="99999999999"'))
        refused(Vtu("density"), path, "that unpack to .* over the limit")
        path.write_text(text.replace(old, f"{name} = '99999999999999999999'"))
        refused(Vtu("density"), path, "that unpack to .* over the limit")
    monkeypatch.setenv(SETTING, "unpacked=1KiB,ratio=1")
    path.write_text(text.replace('NumberOfComponents="3"', 'NumberOfComponents="300"'))
    refused(Vtu("density"), path, "that unpack to .* over the limit")


def test_components_of_a_grid_of_rows_are_counted_by_its_extent(tmp_path):
    path = written(curved(), tmp_path / "a.vts", "vtkXMLStructuredGridWriter", SetDataMode=0)
    text = path.read_text().replace('NumberOfComponents="3"', 'NumberOfComponents="9999999"')
    path.write_text(text)
    refused(Vts("density"), path, "that unpack to .* over the limit")


@pytest.mark.parametrize("kind", ["vts", "vti"])
def test_pieces_that_do_not_fill_the_whole_are_refused(kind, tmp_path):
    grid, writer = curved(), "vtkXMLStructuredGridWriter"
    if kind == "vti":
        grid, writer = block((8, 6, 4), 1.0, (0, 0, 0)), "vtkXMLImageDataWriter"
    path = written(grid, tmp_path / f"a.{kind}", writer, SetDataMode=0)
    whole = 'WholeExtent="0 8 0 6 0 4'
    assert whole in path.read_text()
    path.write_text(path.read_text().replace(whole, 'WholeExtent="0 8 0 6 0 99999'))
    refused(open_volume, path, "is damaged: its pieces hold 315 of 6300000 points")


def test_packed_blocks_without_a_size_are_refused(tmp_path):
    head = '<VTKFile header_type="UInt32" compressor="vtkZLibDataCompressor">'
    path = tmp_path / "a.vtu"
    path.write_bytes(
        f'{head}<DataArray offset="0"/><AppendedData encoding="raw">_'.encode()
        + np.array([1, 0, 0, 9], "<u4").tobytes()
        + b"</AppendedData></VTKFile>"
    )
    refused(check_blocks, path, "blocks of data have no size")


def test_connectivity_that_makes_no_sense_is_refused(tmp_path):
    path = written(
        tetrahedra(curved()), tmp_path / "a.vtu", "vtkXMLUnstructuredGridWriter", SetDataMode=0
    )
    lines = path.read_text().split("\n")
    at = next(n for n, line in enumerate(lines) if 'Name="connectivity"' in line) + 1
    words = lines[at].split()
    words[0] = "315"
    lines[at] = " ".join(words)
    path.write_text("\n".join(lines))
    refused(Vtu("density"), path, "corners that are not among its points")


def test_corners_that_a_file_cannot_hold_are_refused(tmp_path):
    path, grid = tmp_path / "a.vtu", tetrahedra(curved())
    written(grid, path, "vtkXMLUnstructuredGridWriter", SetDataMode=0)
    text = path.read_text()
    ends = str(4 * grid.GetNumberOfCells())
    assert f" {ends}\n" in text
    path.write_text(text.replace(f" {ends}\n", " 1000000000000\n"))
    refused(Vtu("density"), path, "that unpack to .* over the limit")
    hidden = text.replace(f" {ends}\n", " 1000000000000\n").replace('"offsets"', "'off&#115;ets'")
    path.write_text(hidden)
    refused(Vtu("density"), path, "that unpack to .* over the limit")
    path.write_text(text.replace(f" {ends}\n", " -7\n"))
    refused(Vtu("density"), path, "cells end before they begin")


def test_cells_that_are_not_counted_are_none(tmp_path):
    path = tmp_path / "a.vtu"
    written(tetrahedra(curved()), path, "vtkXMLUnstructuredGridWriter", SetDataMode=0)
    path.write_text(path.read_text().replace("NumberOfCells", "NumberOfFishes"))
    refused(Vtu("density"), path, "no cells in space|is damaged")


@pytest.mark.parametrize("encoding", [0, 1], ids=["raw", "base64"])
@pytest.mark.parametrize("mode", [1, 2], ids=["binary", "appended"])
@pytest.mark.parametrize("packed", [True, False], ids=["packed", "bare"])
def test_ends_of_cells_are_found_in_all_forms(packed, mode, encoding, tmp_path):
    path, grid = tmp_path / "a.vtu", tetrahedra(curved())
    choices = {"SetDataMode": mode, "SetEncodeAppendedData": encoding}
    if not packed:
        choices["SetCompressorType"] = 0
    written(grid, path, "vtkXMLUnstructuredGridWriter", **choices)
    assert Vtu("density")(path).note.startswith("960 cells were resampled")
    if not packed and mode == 2 and not encoding:
        last = np.int64(4 * 960).tobytes()
        content = path.read_bytes()
        at = content.rindex(np.int64(4 * 959).tobytes() + last) + 8
        path.write_bytes(content[:at] + np.int64(1 << 40).tobytes() + content[at + 8 :])
        refused(Vtu("density"), path, "that unpack to .* over the limit")


@pytest.mark.parametrize("count", [(2.6, 3), (2.4, 2), (3.4, 3), (3.6, 4)])
def test_a_lattice_has_the_nearest_whole_number_of_cells(monkeypatch, tmp_path, count):
    """Its steps then fill the grid exactly."""
    wanted, cells = count
    (tmp_path / "a.vtk").write_text(WHOLE)
    monkeypatch.setattr(lattice, "mean_cell", lambda *_: np.full(3, 1.0 / wanted))
    volume = open_volume(tmp_path / "a.vtk")
    assert volume.values.shape == (cells + 1,) * 3
    np.testing.assert_allclose(volume.spacing, 1.0 / cells)
