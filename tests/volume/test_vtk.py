"""Files of VTK: legacy ones, written byte by byte and read as VTK does, and values of cells."""

import numpy as np
import pytest

from resample.reading.limits import SETTING
from resample_volume.data.recordings import volume_at
from resample_volume.data.rectilinear import rectilinear
from resample_volume.files.source import open_volume
from resample_volume.files.vtk import Vti, Vtk, Vtr

NAMES = {
    "unsigned_char": "u1",
    "char": "i1",
    "unsigned_short": "u2",
    "short": "i2",
    "int": "i4",
    "float": "f4",
    "double": "f8",
}
X, Y, Z = np.array([0.0, 1, 2]), np.array([0.0, 1, 3, 3.5]), np.array([5.0, 6, 7])


@pytest.fixture
def values(rng) -> np.ndarray:
    return rng.integers(0, 100, (3, 4, 5))


def data(values, kind, form):
    if form == "ASCII":
        rows = np.reshape(values, (-1, np.shape(values)[-1]))
        return "\n".join(" ".join(map(str, row)) for row in rows.tolist()).encode() + b"\n"
    return np.asarray(values).astype(">" + NAMES[kind]).tobytes() + b"\n"


def start(form="BINARY", points=(5, 4, 3), kind="STRUCTURED_POINTS", place=None):
    place = "SPACING 0.5 1 2\nORIGIN -1 2 3" if place is None else place
    listed = " ".join(map(str, points))
    return (
        f"# vtk DataFile Version 3.0\nmade here\n{form}\nDATASET {kind}\nDIMENSIONS {listed}\n"
        f"{place}\n"
    ).encode()


def scalars(values, kind="float", form="BINARY", name="density", parts=""):
    head = f"SCALARS {name} {kind}{parts}\nLOOKUP_TABLE default\n".encode()
    return head + data(values, kind, form)


def field(form="BINARY", **arrays):
    """Write a field of arrays (N, C) of floats."""
    content = f"FIELD FieldData {len(arrays)}\n".encode()
    for name, held in arrays.items():
        rows, parts = held.shape
        content += f"{name} {parts} {rows} float\n".encode() + data(held, "float", form)
    return content


def put(path, *content):
    path.write_bytes(b"".join(content))
    return path


def refused(reader, path, match):
    with pytest.raises(ValueError, match=match) as caught:
        reader(path)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400


def of_vtk(path, reader="vtkStructuredPointsReader"):
    """Grid as VTK reads it."""
    made = getattr(pytest.importorskip("vtkmodules.vtkIOLegacy"), reader)()
    made.SetFileName(str(path))
    made.ReadAllScalarsOn()
    made.ReadAllVectorsOn()
    made.ReadAllFieldsOn()
    made.Update()
    return made.GetOutput()


def numbers_of(array):
    from vtkmodules.util.numpy_support import vtk_to_numpy

    return vtk_to_numpy(array)


@pytest.mark.parametrize("form", ["ASCII", "BINARY"])
@pytest.mark.parametrize("kind", NAMES)
def test_points_of_every_type_are_read_as_vtk_reads_them(kind, form, values, tmp_path):
    path = put(tmp_path / "a.vtk", start(form), b"POINT_DATA 60\n", scalars(values, kind, form))
    volume = open_volume(path)
    assert np.array_equal(volume.values, values)
    assert volume.values.dtype == NAMES[kind]
    assert volume.spacing.tolist() == [0.5, 1, 2]
    assert volume.origin.tolist() == [-1, 2, 3]
    image = of_vtk(path)
    assert np.array_equal(volume.values.ravel(), numbers_of(image.GetPointData().GetScalars()))
    assert (image.GetSpacing(), image.GetOrigin()) == ((0.5, 1, 2), (-1, 2, 3))


@pytest.mark.parametrize("form", ["ASCII", "BINARY"])
def test_cells_of_a_legacy_file_have_their_values_at_their_centers(form, values, tmp_path):
    path = put(
        tmp_path / "a.vtk",
        start(form, (6, 5, 4)),
        b"CELL_DATA 60\n",
        scalars(values, "short", form),
    )
    volume = Vtk()(path)
    assert np.array_equal(volume.values, values)
    assert volume.origin.tolist() == [-0.75, 2.5, 4]
    image = of_vtk(path)
    bounds = np.reshape(image.GetCell(0).GetBounds(), (3, 2))
    assert np.array_equal(volume.origin, bounds.mean(axis=1))
    assert np.array_equal(volume.values.ravel(), numbers_of(image.GetCellData().GetScalars()))


@pytest.mark.parametrize("form", ["ASCII", "BINARY"])
def test_arrays_of_all_sections_are_found(form, values, tmp_path):
    wind = np.stack([values, values + 1, values + 2], -1).reshape(60, 3)
    table = data(np.ones((2, 4)), "float", form) if form == "ASCII" else bytes(8) + b"\n"
    path = put(
        tmp_path / "a.vtk",
        start(form),
        field(form, told=np.ones((2, 3))),
        b"POINT_DATA 60\nVECTORS wind float\n",
        data(wind, "float", form),
        b"METADATA\nINFORMATION 1\nNAME a LOCATION b\nDATA 1\n\n",
        scalars(values, "unsigned_char", form),
        b"LOOKUP_TABLE colors 2\n" + table,
        field(form, heat=wind[:, :1] + 7, **{"a%20b": wind[:, :2], "short": np.ones((3, 1))}),
        b"CELL_DATA 24\n",
        scalars(np.arange(24).reshape(2, 12), "short", form, "count"),
    )
    assert np.array_equal(Vtk()(path).values, values)
    assert np.array_equal(Vtk("heat")(path).values, values + 7)
    held = Vtk("a b").recorded(path)
    assert np.array_equal(volume_at(held, None, 1).values, values + 1)
    assert Vtk("count")(path).values.shape == (2, 3, 4)
    lengths = np.linalg.norm(wind, axis=1).astype(np.float32)
    assert np.array_equal(Vtk("wind", "magnitude")(path).values.ravel(), lengths)
    refused(Vtk("heat", "magnitude"), path, "heat has one number at each place; leave out")
    refused(Vtk("rain"), path, r"vtk:array=NAME \(rain given\): wind, density, heat.*count \(cell")
    image = of_vtk(path)
    assert np.array_equal(numbers_of(image.GetPointData().GetArray("heat")), values.ravel() + 7)


def test_colors_of_a_legacy_file(values, tmp_path):
    shades = np.stack([values, values + 50, values + 99], -1).reshape(60, 3)
    text = data(shades / 255, "float", "ASCII")
    for form, content in {"ASCII": text, "BINARY": shades.astype("u1").tobytes()}.items():
        path = put(tmp_path / "a.vtk", start(form), b"POINT_DATA 60\nCOLOR_SCALARS c 3\n", content)
        assert np.array_equal(Vtk()(path).colors.reshape(-1, 3), shades)


def test_bytes_are_mapped_and_an_extent_is_taken_for_dimensions(values, tmp_path):
    head = start().replace(b"DIMENSIONS 5 4 3", b"EXTENT 2 6 0 3 1 3")
    path = put(tmp_path / "a.vtk", head, b"POINT_DATA 60\n", scalars(values, "unsigned_char"))
    volume = Vtk()(path)
    assert isinstance(volume.values, np.memmap)
    assert volume.origin.tolist() == [0, 2, 5]


@pytest.mark.parametrize("form", ["ASCII", "BINARY"])
@pytest.mark.parametrize("kind", ["POINT_DATA 36", "CELL_DATA 12"])
def test_rectilinear_grids_of_legacy_files(kind, form, tmp_path, rng):
    shape = (3, 4, 3) if kind.startswith("POINT") else (2, 3, 2)
    values = rng.integers(0, 99, shape)
    place = b"".join(
        f"{axis}_COORDINATES {each.size} float\n".encode() + data([each], "float", form)
        for axis, each in zip("XYZ", (X, Y, Z), strict=True)
    )
    head = start(form, (3, 4, 3), "RECTILINEAR_GRID", "")
    path = put(
        tmp_path / "a.vtk", head, place, kind.encode(), b"\n", scalars(values, "float", form)
    )
    volume = Vtk()(path)
    axes = (X, Y, Z) if shape[1] == 4 else [(each[1:] + each[:-1]) / 2 for each in (X, Y, Z)]
    wanted = rectilinear(values.astype(np.float32), *axes)
    assert np.array_equal(volume.values, wanted.values)
    assert np.array_equal(volume.origin, wanted.origin)
    assert "even lattice" in volume.note
    grid = of_vtk(path, "vtkRectilinearGridReader")
    assert np.array_equal(numbers_of(grid.GetYCoordinates()), Y)


@pytest.mark.parametrize(
    ("kind", "match"),
    [
        ("POLYDATA", "a surface; write it as PLY or STL"),
        ("FIELD", "arrays without a place"),
        ("FISH", "'FISH', unknown; known are STRUCTURED_POINTS"),
    ],
)
def test_other_kinds_of_legacy_files_are_called_what_they_are(kind, match, tmp_path):
    refused(Vtk(), put(tmp_path / "a.vtk", start(kind=kind)), match)


WHOLE = start() + b"POINT_DATA 60\n" + scalars(np.zeros((12, 5)), "float")
TEXT = start("ASCII") + b"POINT_DATA 60\n" + scalars(np.zeros((12, 5)), "float", "ASCII")


@pytest.mark.parametrize(
    ("content", "match"),
    [
        (b"", "is not a legacy file of VTK"),
        (b"neither fish nor flesh\n" * 50, "is not a legacy file of VTK"),
        (WHOLE[:40], "not ASCII or BINARY"),
        (WHOLE[:45], "not ASCII or BINARY|names no DATASET"),
        (WHOLE[:90], "there is none"),
        (WHOLE[:-100], "is cut off: it has 300 bytes, 399 are wanted|is cut off"),
        (WHOLE.replace(b"5 4 3", b"5 4"), "has 2 dimensions"),
        (WHOLE.replace(b"5 4 3", b"5 4 nan"), "has 2 dimensions"),
        (WHOLE.replace(b"5 4 3", b"5 4 -3"), "is empty"),
        (WHOLE.replace(b"5 4 3", b"99999 99999 99999"), "60 values of 999970000299999 points"),
        (WHOLE.replace(b"SPACING 0.5 1 2", b"SPACING 0 1 2"), "must be positive"),
        (
            WHOLE.replace(b"DIMENSIONS 5 4 3\nSPACING 0.5", b"EXTENT 0 4 0 3 0 2\nSPACING inf"),
            "finite",
        ),
        (WHOLE.replace(b"SPACING 0.5 1 2", b"SPACING 1 2"), "are three numbers each"),
        (WHOLE.replace(b"SPACING 0.5 1 2", b"SPACING a 1 2"), "are not numbers"),
        (WHOLE.replace(b"density float", b"density string"), "numbers of type 'string'; known"),
        (WHOLE.replace(b"density float", b"density"), "has too few words"),
        (WHOLE.replace(b"density float", b"density float -1"), "not a count of numbers"),
        (WHOLE.replace(b"SCALARS", b"FISHES"), "unknown keyword 'FISHES'"),
        (WHOLE.replace(b"density float", b"density float 99999999999999"), "is cut off"),
        (start() + b"POINT_DATA 60\nFIELD a 99999999\n", "over the limit"),
        (start() + b"POINT_DATA 60\nFIELD a 1\n", "has too few words"),
        (start() + b"POINT_DATA 60\n", "there is none"),
        (TEXT[:-30], "cut off"),
        (TEXT[:-2] + b"a\n", "is damaged: could not convert"),
        (TEXT[:-1] + b" 7 7 7\n", "is damaged: a line holds more"),
        (start(kind="RECTILINEAR_GRID", place=""), "it has no X_COORDINATES"),
    ],
)
def test_nonsense_in_a_legacy_file_is_refused_in_words(content, match, tmp_path):
    refused(Vtk(), put(tmp_path / "a.vtk", content), match)


def test_planes_of_another_number_and_vectors_on_uneven_grids_are_refused(tmp_path):
    place = "".join(f"{axis}_COORDINATES 2 float\n0 1\n" for axis in "XYZ")
    head = start("ASCII", (2, 2, 3), "RECTILINEAR_GRID", place)
    path = put(tmp_path / "a.vtk", head, b"POINT_DATA 12\nSCALARS a int\n" + b"1 " * 11 + b"1\n")
    refused(Vtk(), path, "3 planes along z, but coordinates")
    head = start("ASCII", (2, 2, 2), "RECTILINEAR_GRID", place)
    put(path, head, b"POINT_DATA 8\nVECTORS a int\n" + b"1 2 2\n" * 8)
    refused(Vtk(), path, "3 numbers at each place, a volume on an uneven grid has one.*magnitude")
    assert (Vtk(part="magnitude")(path).values == 3).all()


def test_texts_of_vtk_have_a_limit(tmp_path, monkeypatch):
    monkeypatch.setenv(SETTING, "text=100")
    refused(Vtk(), put(tmp_path / "a.vtk", TEXT), "over the limit of .*text=")


# XML


def xml(path, grid, **arrays):
    """Write a grid; arrays whose names begin with `cell` are of cells."""
    io = pytest.importorskip("vtkmodules.vtkIOXML")
    from vtkmodules.util.numpy_support import numpy_to_vtk

    for name, values in arrays.items():
        made = numpy_to_vtk(values, deep=1)
        made.SetName(name)
        held = grid.GetCellData() if name.startswith("cell") else grid.GetPointData()
        held.AddArray(made)
    kind = "ImageData" if path.suffix == ".vti" else "RectilinearGrid"
    writer = getattr(io, f"vtkXML{kind}Writer")()
    writer.SetInputData(grid)
    writer.SetFileName(str(path))
    writer.Write()
    return path


def image_of(points):
    model = pytest.importorskip("vtkmodules.vtkCommonDataModel")
    image = model.vtkImageData()
    image.SetExtent(2, points[0] + 1, 0, points[1] - 1, 0, points[2] - 1)
    image.SetSpacing(0.5, 1, 2)
    image.SetOrigin(-1, 2, 3)
    image.SetDirectionMatrix(0, -1, 0, 1, 0, 0, 0, 0, 1)
    return image


def test_cells_of_vti_have_their_values_at_their_centers(values, tmp_path):
    image = image_of((6, 5, 4))
    volume = Vti()(xml(tmp_path / "a.vti", image, cells=values.ravel().astype(np.int16)))
    assert np.array_equal(volume.values, values)
    bounds = np.reshape(image.GetCell(0).GetBounds(), (3, 2))
    assert np.array_equal(volume.origin, bounds.mean(axis=1))
    assert volume.spacing.tolist() == [0.5, 1, 2]


def test_scalars_of_vti_are_found_beside_vectors_and_cells(values, tmp_path):
    wind = np.stack([values.ravel(), values.ravel() + 1], 1).astype(np.float32)
    cells = np.zeros(24, np.int16)
    path = xml(
        tmp_path / "a.vti",
        image_of((5, 4, 3)),
        wind=wind,
        heat=values.ravel().astype(np.int16),
        cells=cells,
    )
    assert np.array_equal(Vti()(path).values, values)
    assert Vti("cells")(path).values.shape == (2, 3, 4)
    lengths = np.linalg.norm(wind.astype(np.float64), axis=1).astype(np.float32)
    assert np.array_equal(Vti("wind", "magnitude")(path).values.ravel(), lengths)
    refused(Vti("rain"), path, r"vti:array=NAME \(rain given\): wind, heat, cells \(cells\)")
    with pytest.raises(ValueError, match="part is magnitude, or left out, not 'x'"):
        Vti(part="x")


def test_cells_of_vtr_lie_between_its_planes(tmp_path, rng):
    model = pytest.importorskip("vtkmodules.vtkCommonDataModel")
    from vtkmodules.util.numpy_support import numpy_to_vtk

    grid = model.vtkRectilinearGrid()
    grid.SetDimensions(3, 4, 3)
    for axis, place in zip("XYZ", (X, Y, Z), strict=True):
        getattr(grid, f"Set{axis}Coordinates")(numpy_to_vtk(place, deep=True))
    values = rng.random((2, 3, 2))
    wind = rng.random((12, 3))
    path = xml(tmp_path / "a.vtr", grid, cells=values.ravel(), cell_wind=wind)
    middle = [(each[1:] + each[:-1]) / 2 for each in (X, Y, Z)]
    wanted = rectilinear(values, *middle)
    volume = Vtr()(path)
    assert np.array_equal(volume.values, wanted.values)
    assert np.array_equal(volume.origin, wanted.origin)
    refused(Vtr("cell_wind"), path, "3 numbers at each place")
    length = np.linalg.norm(wind, axis=1).reshape(2, 3, 2)
    assert np.array_equal(
        Vtr("cell_wind", "magnitude")(path).values, rectilinear(length, *middle).values
    )


@pytest.mark.parametrize("form", ["ASCII", "Binary"])
def test_what_vtk_writes_is_read_as_it_was(form, values, tmp_path):
    io = pytest.importorskip("vtkmodules.vtkIOLegacy")
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonDataModel import vtkStructuredPoints

    image = vtkStructuredPoints()
    image.SetDimensions(5, 4, 3)
    image.SetSpacing(0.1, 1, 2)
    wind = np.stack([values.ravel() + n / 3 for n in range(3)], 1)
    arrays = {"wind ä": wind, "heat": values.ravel() / 7, "big": values.ravel() * 300}
    for name, held in arrays.items():
        made = numpy_to_vtk(held, deep=1)
        made.SetName(name)
        image.GetPointData().AddArray(made)
    made.SetComponentName(0, "part")
    image.GetPointData().SetActiveScalars("heat")
    image.GetPointData().SetActiveVectors("wind ä")
    count = numpy_to_vtk(np.arange(24), deep=1)
    count.SetName("count")
    image.GetCellData().AddArray(count)
    writer = io.vtkStructuredPointsWriter()
    writer.SetInputData(image)
    writer.SetFileName(str(tmp_path / "a.vtk"))
    getattr(writer, f"SetFileTypeTo{form}")()
    writer.Write()
    volume = Vtk()(tmp_path / "a.vtk")
    assert volume.values.dtype == np.float64
    assert np.allclose(volume.values.ravel(), arrays["heat"], rtol=1e-5)
    assert volume.spacing.tolist() == [0.1, 1, 2]
    refused(Vtk("big"), tmp_path / "a.vtk", "voxels of type .*; known are uint8")
    held = Vtk("wind ä").recorded(tmp_path / "a.vtk")
    found = held.values[0].reshape(3, -1).T
    assert np.allclose(found, wind, rtol=1e-5)
