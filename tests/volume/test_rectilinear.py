"""Grids of uneven planes, against fields that are known everywhere."""

import numpy as np
import pytest

import resample_volume
from resample import memory
from resample_volume.data import rectilinear as module
from resample_volume.data.rectilinear import rectilinear
from resample_volume.files.readers import Npz
from resample_volume.files.source import describe, open_volume
from resample_volume.files.vtk import Vtr

X = np.array([0.0, 1.0, 2.0, 3.0, 4.0])
Y = np.array([-3.0, -2.5, -1.0, 0.0, 2.0, 3.0])
Z = np.cumsum([5.0, 0.2, 0.3, 0.4, 0.5, 0.6, 0.6])


def field(x, y, z):
    return np.cos(z)[:, None, None] + 0.5 * np.sin(y)[:, None] + 0.25 * np.asarray(x)


def places(volume):
    return [
        volume.origin[n] + volume.spacing[n] * np.arange(volume.values.shape[2 - n])
        for n in range(3)
    ]


def test_values_are_interpolated_at_the_least_distance_of_planes():
    volume = rectilinear(field(X, Y, Z), X, Y, Z)
    np.testing.assert_allclose(volume.spacing, [1.0, 0.5, 0.2], atol=1e-12)
    assert volume.origin.tolist() == [0, -3, 5]
    assert volume.values.shape == (14, 13, 5)
    wanted = field(*places(volume))
    assert np.abs(volume.values - wanted).max() < 0.14  # between planes that are 2 apart
    assert "y 0.5 to 2, z 0.2 to 0.6" in volume.note
    assert "5 x 13 x 14 voxels, 1 x 0.5 x 0.2 apart" in volume.note


def test_interpolation_comes_nearer_than_lines_do(rng):
    y = np.cumsum(rng.uniform(0.1, 0.4, 20))
    volume = rectilinear(field(X, y, X), X, y, X)
    even = places(volume)[1]
    wanted, lines = 0.5 * np.sin(even), 0.5 * np.interp(even, y, np.sin(y))
    found = volume.values[0, :, 0] - 1
    assert np.abs(found - wanted).mean() < 0.4 * np.abs(lines - wanted).mean()


def test_given_planes_keep_their_values_and_edges_do_not_ring(rng):
    y = np.array([0.0, 1.0, 2.0, 4.0, 5.0, 8.0])
    values = rng.normal(size=(4, 6, 3)).astype(np.float32)
    volume = rectilinear(values, X[:3], y, X[:4])
    assert volume.values.shape == (4, 9, 3)
    np.testing.assert_allclose(volume.values[:, y.astype(int)], values, atol=1e-6)
    steps = np.where(y[:, None] > 2, np.float32(900), np.float32(-1000)) + 0 * values
    edge = rectilinear(steps, X[:3], y, X[:4]).values
    assert (edge[:, :3] == -1000).all()
    assert (edge[:, 4:] == 900).all()


def test_what_is_even_stays_as_it_is():
    values = np.arange(60, dtype=np.int16).reshape(3, 4, 5)
    volume = rectilinear(values, 2 * X, X[:4], X[:3] - 9)
    assert volume.values.dtype == np.int16
    assert np.array_equal(volume.values, values)
    assert volume.spacing.tolist() == [2, 1, 1]
    assert volume.origin.tolist() == [0, 0, -9]
    assert not volume.note


def test_descending_coordinates_turn_the_values_round():
    values = field(X, Y, Z)
    up, down = rectilinear(values, X, Y, Z), rectilinear(values[::-1, :, ::-1], X[::-1], Y, Z[::-1])
    assert np.array_equal(up.values, down.values)
    assert np.array_equal(up.origin, down.origin)


def test_missing_values_stay_missing_and_the_others_known():
    values = field(X, Y, Z)
    values[:, :2] = np.nan
    volume = rectilinear(values, X, Y, Z)
    y = places(volume)[1]
    assert np.isnan(volume.values[:, y < -1]).all()
    assert np.isfinite(volume.values[:, y >= -1]).all()
    linear = np.interp(1.0, [0.0, 2.0], [0.0, 0.5 * np.sin(2.0)])
    found = volume.values[0, np.flatnonzero(y == 1.0)[0], 0]
    assert found == pytest.approx(np.cos(5.0) + linear, abs=1e-5)


def test_planes_that_are_far_too_close_do_not_make_a_huge_lattice(monkeypatch):
    z = np.array([0.0, 1e-6, 1, 2, 3])
    volume = rectilinear(field(X, Y, z), X, Y, z)
    assert volume.values.shape[0] == 8 * 4 + 1
    assert "not finer than memory and sense allow" in volume.note
    monkeypatch.setattr(module, "MOST", 500)
    small = rectilinear(field(X, Y, Z), X, Y, Z)
    assert small.values.size < 1.2 * 500
    assert "not finer" in small.note
    monkeypatch.setattr(memory, "physical_memory", lambda: 100)
    with pytest.raises(ValueError, match="grid on an even lattice of 5 x 10 x 11 voxels needs"):
        rectilinear(field(X, Y, Z), X, Y, Z)


@pytest.mark.parametrize(
    ("x", "complaint"),
    [
        (X[:4], r"grid has 5 planes along x, but coordinates of the shape \(4,\)"),
        (np.array([0.0, 1, 1, 2, 3]), "x must be two or more finite coordinates"),
        (np.array([0.0, 1, 3, 2, 3]), "that ascend or descend"),
        (np.array([0.0, 1, 2, 3, np.nan]), "finite"),
    ],
)
def test_coordinates_that_are_none_are_refused(x, complaint):
    with pytest.raises(ValueError, match=complaint):
        rectilinear(field(X, Y, Z), x, Y, Z)
    with pytest.raises(ValueError, match=r"a grid has values \(Z, Y, X\), not \(3, 3\)"):
        rectilinear(np.zeros((3, 3)), X, Y, Z)


# Files


def test_numpy_archives_are_grids(tmp_path):
    path = tmp_path / "a.npz"
    np.savez(path, x=X, y=Y, z=Z, density=field(X, Y, Z))
    volume = open_volume(path)
    wanted = rectilinear(field(X, Y, Z), X, Y, Z)
    assert np.array_equal(volume.values, wanted.values)
    assert volume.name == "a"
    assert wanted.note in describe(volume)["findings"]
    np.savez(path, x=X, y=Y, z=Z, density=field(X, Y, Z), heat=field(X, Y, Z) + 1)
    with pytest.raises(ValueError, match=r"x, y, z, density, heat; .*npz:array=density"):
        Npz()(path)
    assert Npz("heat")(path).values.min() > volume.values.min() + 0.9


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 and so on", b"nothing"])
def test_damaged_archives_are_refused(content, tmp_path):
    path = tmp_path / "a.npz"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"a\.npz holds no arrays, or is damaged") as caught:
        Npz()(path)
    assert "\n" not in str(caught.value)


def test_rectilinear_grids_of_vtk(tmp_path):
    io = pytest.importorskip("vtkmodules.vtkIOXML")
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonDataModel import vtkRectilinearGrid

    values = field(X, Y, Z).astype(np.float32)
    grid = vtkRectilinearGrid()
    grid.SetDimensions(values.shape[::-1])
    for axis, place in zip("XYZ", (X, Y, Z), strict=True):
        getattr(grid, f"Set{axis}Coordinates")(numpy_to_vtk(place, deep=True))
    array = numpy_to_vtk(values.ravel(), deep=True)
    array.SetName("heat")
    grid.GetPointData().AddArray(array)
    writer = io.vtkXMLRectilinearGridWriter()
    writer.SetFileName(str(tmp_path / "a.vtr"))
    writer.SetInputData(grid)
    writer.Write()
    volume = open_volume(tmp_path / "a.vtr")
    wanted = rectilinear(values, X, Y, Z)
    assert np.array_equal(volume.values, wanted.values)
    assert np.array_equal(volume.spacing, wanted.spacing)
    with pytest.raises(ValueError, match=r"rain given.*heat"):
        Vtr(array="rain")(tmp_path / "a.vtr")
    (tmp_path / "a.vtr").write_bytes((tmp_path / "a.vtr").read_bytes()[:200])
    with pytest.raises(ValueError, match="damaged"):
        Vtr()(tmp_path / "a.vtr")


def test_the_library_has_it():
    assert resample_volume.rectilinear is rectilinear
