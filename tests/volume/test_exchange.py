"""Objects of other libraries as volumes; where one is not installed, by what it documents.

pyvista, nibabel and yt are none of the packages that tests need: their own tests are skipped where
they are missing, and stand-ins with their documented attributes take their place.
"""

import subprocess
import sys
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from resample_volume import Appearance, as_volume, open_volume, render
from resample_volume.classification.transfer import from_points

VALUES = np.arange(120, dtype=np.float32).reshape(4, 5, 6)  # (Z, Y, X)
AFFINE = np.array([[0, -2, 0, 5], [1.5, 0, 0, 6], [0, 0, 3, 7], [0, 0, 0, 1.0]])


class Image:
    """Image as nibabel's documentation has it: `dataobj` (X, Y, Z), `affine` to RAS."""

    __module__ = "nibabel.nifti1"

    def __init__(self, values: Any, affine: Any = AFFINE, intent: str = "") -> None:
        self.dataobj, self.affine, self.intent = values, affine, intent
        self.header = SimpleNamespace(get_intent=lambda: ("none", (), intent))

    def get_data_dtype(self) -> Any:
        return self.dataobj.dtype


class Grid(dict[Any, Any]):
    """Grid as yt's documentation has covering and arbitrary grids: fields (X, Y, Z) by name."""

    def __init__(self, **fields: Any) -> None:
        super().__init__(fields)
        self.left_edge, self.right_edge = np.array([0, 1, 0.0]), np.array([6, 3.5, 8])
        self.ActiveDimensions = np.array([6, 5, 4])


def vtk_image(*, of_cells: bool = False, **arrays: Any) -> Any:
    data = pytest.importorskip("vtkmodules.vtkCommonDataModel", reason="the extra vtk is missing")
    image = data.vtkImageData()
    image.SetExtent(2, 7 + of_cells, 3, 7 + of_cells, 4, 7 + of_cells)
    image.SetSpacing(0.5, 1, 2)
    image.SetOrigin(1, 2, 3)
    held = image.GetCellData() if of_cells else image.GetPointData()
    return with_arrays(image, held, arrays)


def with_arrays(data: Any, held: Any, arrays: dict[str, Any]) -> Any:
    from vtkmodules.util.numpy_support import numpy_to_vtk

    for name, values in arrays.items():
        array = numpy_to_vtk(values.reshape(120, -1).squeeze(), deep=True)
        array.SetName(name)
        held.AddArray(array)
    return data


def place_of(volume: Any, x: int, y: int, z: int) -> Any:
    return volume.origin + volume.direction @ (volume.spacing * [x, y, z])


def test_image_data_of_vtk_are_where_vtk_says() -> None:
    image = vtk_image(density=VALUES, heat=VALUES + 1)
    image.SetDirectionMatrix(0, -1, 0, 1, 0, 0, 0, 0, 1)
    volume = as_volume(image, part="density")
    assert np.array_equal(volume.values, VALUES)
    for x, y, z in ((0, 0, 0), (5, 0, 0), (0, 4, 0), (3, 2, 1)):
        number = image.FindPoint(place_of(volume, x, y, z))
        assert image.GetPointData().GetArray("density").GetValue(number) == VALUES[z, y, x]
    assert np.array_equal(as_volume((image, "heat")).values, VALUES + 1)


def test_values_of_vtk_are_not_copied() -> None:
    from vtkmodules.util.numpy_support import vtk_to_numpy

    image = vtk_image(density=VALUES)
    stored = vtk_to_numpy(image.GetPointData().GetArray("density"))
    assert np.shares_memory(as_volume(image).values, stored)


def test_cells_of_image_data_are_voxels_at_their_centers() -> None:
    image = vtk_image(of_cells=True, number=VALUES.astype(np.int64))
    volume = as_volume(image)
    assert volume.values.dtype == np.int32
    assert np.array_equal(volume.values, VALUES)
    bounds = np.reshape(image.GetCell(0).GetBounds(), (3, 2))
    assert np.array_equal(volume.origin, bounds.mean(axis=1))


def test_colors_of_vtk_are_colors() -> None:
    colors = np.stack([VALUES, VALUES, VALUES + 1], -1).astype(np.uint8)
    volume = as_volume(vtk_image(look=colors))
    assert volume.colors is not None
    assert np.array_equal(volume.colors, colors)


def test_uneven_grids_of_vtk_are_made_even() -> None:
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonDataModel import vtkRectilinearGrid

    grid = vtkRectilinearGrid()
    grid.SetDimensions(6, 5, 4)
    axes = {"X": np.arange(6.0), "Y": np.array([0, 1, 3, 4, 5.0]), "Z": np.arange(4.0)}
    for axis, planes in axes.items():
        getattr(grid, f"Set{axis}Coordinates")(numpy_to_vtk(planes, deep=True))
    volume = as_volume(with_arrays(grid, grid.GetPointData(), {"density": VALUES}))
    assert volume.values.shape == (4, 6, 6)
    assert volume.note.startswith("uneven distances (y 1 to 2)")


def test_grids_of_cells_in_memory_are_resampled_and_nothing_warns() -> None:
    from vtkmodules.vtkCommonDataModel import vtkStructuredGrid
    from vtkmodules.vtkFiltersGeneral import vtkImageDataToPointSet

    made = vtkImageDataToPointSet()
    made.SetInputData(vtk_image(density=VALUES))
    made.Update()
    grid = made.GetOutput()
    assert isinstance(grid, vtkStructuredGrid)
    for n in range(
        0, grid.GetNumberOfPoints(), 6
    ):  # a slanting side, and without another appearance
        x, y, z = grid.GetPoint(n)
        grid.GetPoints().SetPoint(n, x - 0.3 * (z - 11), y, z)
    volume = as_volume(grid, "slanting")
    assert volume.name == "slanting"
    assert np.isnan(volume.values).any()
    assert "were resampled onto a lattice" in volume.note
    look = from_points([(0.0, (1.0, 0.5, 0.1), 0.0), (120.0, (0.2, 0.5, 1.0), 0.8)])
    assert render(grid, Appearance(look), size=(24, 24)).rgba.any()


@pytest.mark.parametrize(
    ("kind", "error", "match"),
    [
        ("vtkPolyData", ValueError, "no cells in space; surfaces are shown by --mesh"),
        ("vtkTable", TypeError, "a volume of vtkTable; give a data set of VTK's"),
        ("vtkImageData", ValueError, "part=NAME .none given.: there is none"),
    ],
)
def test_what_of_vtk_is_no_volume_is_said(kind: str, error: type[Exception], match: str) -> None:
    data = pytest.importorskip("vtkmodules.vtkCommonDataModel", reason="the extra vtk is missing")
    with pytest.raises(error, match=match):
        as_volume(getattr(data, kind)())


def test_an_array_is_chosen_where_there_are_several() -> None:
    image = vtk_image(density=VALUES, heat=VALUES)
    for part in ("", "rain"):
        with pytest.raises(ValueError, match=r"part=NAME \(\w+ given\): density, heat"):
            as_volume(image, part=part)


def test_images_of_pyvista_are_where_pyvista_says() -> None:
    pyvista = pytest.importorskip("pyvista", reason="pyvista is not installed")
    image = pyvista.ImageData(dimensions=(6, 5, 4), spacing=(0.5, 1, 2), origin=(1, 2, 3))
    image["density"], image["heat"] = VALUES.ravel(), VALUES.ravel() + 1
    volume = as_volume(image, part="density")
    number = image.find_closest_point(place_of(volume, 3, 2, 1))
    assert image["density"][number] == volume.values[1, 2, 3]
    cells = image.cast_to_unstructured_grid()
    np.testing.assert_allclose(as_volume(cells, part="heat").values, VALUES + 1)
    both = pyvista.MultiBlock([cells, pyvista.Sphere()])
    np.testing.assert_allclose(as_volume(both, part="heat").values, VALUES + 1)


def test_images_of_nibabel_are_in_the_patients_space() -> None:
    volume = as_volume(Image(VALUES.transpose(2, 1, 0)))
    assert np.array_equal(volume.values, VALUES)
    assert volume.space == "lps"
    assert volume.spacing.tolist() == [1.5, 2, 3]
    place = AFFINE @ [3, 2, 1, 1]
    np.testing.assert_allclose(place_of(volume, 3, 2, 1), place[:3] * [-1, -1, 1])
    assert as_volume(Image(VALUES, intent="Hounsfield units")).units == "hu"


def test_images_of_nibabel_are_what_is_read_from_their_files(tmp_path: Any) -> None:
    nibabel = pytest.importorskip("nibabel", reason="nibabel is not installed")
    image = nibabel.Nifti1Image(VALUES.transpose(2, 1, 0), AFFINE)
    nibabel.save(image, tmp_path / "a.nii")
    given, read = as_volume(image), open_volume(tmp_path / "a.nii")
    assert np.array_equal(given.values, read.values)
    for ours, theirs in zip(given[1:4], read[1:4], strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-6)
    place = nibabel.affines.apply_affine(image.affine, (3, 2, 1))
    np.testing.assert_allclose(place_of(given, 3, 2, 1), place * [-1, -1, 1])


def test_one_volume_of_nibabel_may_have_further_axes_and_colors() -> None:
    assert as_volume(Image(VALUES[..., np.newaxis, np.newaxis])).values.shape == (6, 5, 4)
    colors = np.zeros((6, 5, 4, 1), [("R", "u1"), ("G", "u1"), ("B", "u1")])
    colors["G"] = 7
    given = as_volume(Image(colors))
    assert given.colors is not None
    assert given.colors[0, 0, 0].tolist() == [0, 7, 0]
    with pytest.raises(ValueError, match=r"4 x 5 x 6 x 2 holds several .* \.slicer"):
        as_volume(Image(np.zeros((4, 5, 6, 2), np.float32)))


@pytest.mark.parametrize("part", ["density", ("gas", "density")])
def test_grids_of_yt_have_their_values_at_centers_of_cells(part: Any) -> None:
    grid = Grid()
    grid[part] = VALUES.transpose(2, 1, 0)
    for volume in (as_volume(grid, part=part), as_volume((grid, part))):
        assert np.array_equal(volume.values, VALUES)
        assert volume.spacing.tolist() == [1, 0.5, 2]
        assert volume.origin.tolist() == [0.5, 1.25, 1]


def test_fields_of_yt_are_named() -> None:
    with pytest.raises(ValueError, match=r"name a field of the grid: part='density'"):
        as_volume(Grid())
    with pytest.raises(ValueError, match=r"no field 'rain': "):
        as_volume(Grid(), part="rain")
    with pytest.raises(ValueError, match=r"field 'a' is \(4, 5, 6\), the grid is \(6, 5, 4\)"):
        as_volume(Grid(a=VALUES), part="a")


def test_grids_of_yt_itself() -> None:
    yt = pytest.importorskip("yt", reason="yt is not installed")
    yt.set_log_level(50)
    box = np.array([[0, 6.0], [1, 3.5], [0, 8]])
    fields = {"density": (VALUES.transpose(2, 1, 0).astype(float), "g/cm**3")}
    data = yt.load_uniform_grid(fields, (6, 5, 4), length_unit="kpc", bbox=box)
    low, high = data.domain_left_edge, data.domain_right_edge
    for grid in (
        data.covering_grid(0, low, data.domain_dimensions),
        data.arbitrary_grid(low, high, dims=[6, 5, 4]),
    ):
        volume = as_volume(grid, part=("gas", "density"))
        np.testing.assert_allclose(volume.values, VALUES)
        there = [float(grid["index", axis][3, 2, 1]) for axis in "xyz"]
        np.testing.assert_allclose(place_of(volume, 3, 2, 1), there)


def test_a_variable_of_several_is_chosen() -> None:
    xarray = pytest.importorskip("xarray")
    axes = ("z", "y", "x")
    data = xarray.Dataset({"wet": (axes, VALUES), "dry": (axes, VALUES + 1)})
    assert np.array_equal(as_volume(data, part="dry").values, VALUES + 1)
    assert np.array_equal(as_volume(data[["wet"]]).values, VALUES)
    with pytest.raises(ValueError, match=r"part=NAME \(none given\): wet, dry"):
        as_volume(data)


def test_what_is_one_volume_has_no_parts(tmp_path: Any) -> None:
    np.save(tmp_path / "a.npy", VALUES)
    for given in (VALUES, tmp_path / "a.npy", as_volume(VALUES), Image(VALUES)):
        with pytest.raises(ValueError, match=r"without a part 'density'; leave part out"):
            as_volume(given, part="density")


@pytest.mark.sweep
def test_no_library_is_imported_for_an_array() -> None:
    code = (
        "import sys, numpy; from resample_volume import as_volume; as_volume(numpy.zeros((2,2,2)));"
        "assert not {'vtkmodules', 'SimpleITK', 'nibabel', 'yt', 'xarray'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
