"""Volumes as callers have them, and cameras as they say them."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from resample.cameras.viewpoints import Orbit
from resample_volume import as_volume, render
from resample_volume.classification.transfer import from_points

PLAIN = (100 * np.random.default_rng(0).random((6, 7, 8))).astype(np.float32)
LOOK = from_points([(20.0, (1.0, 0.5, 0.1), 0.0), (100.0, (0.2, 0.5, 1.0), 0.8)])


def mapped(tmp_path: Path) -> NDArray[np.float32]:
    np.save(tmp_path / "values.npy", PLAIN)
    return np.asanyarray(np.load(tmp_path / "values.npy", mmap_mode="r"))


def read_only() -> NDArray[np.float32]:
    values = PLAIN.copy()
    values.setflags(write=False)
    return values


class Delayed:
    """What dask's arrays and others have in common."""

    def __array__(self, dtype: Any = None, copy: Any = None) -> NDArray[np.float32]:
        return PLAIN


@pytest.mark.some(3)
@pytest.mark.parametrize(
    "given",
    [
        PLAIN.astype(">f4"),
        pytest.param(np.asfortranarray(PLAIN), marks=pytest.mark.sweep),
        np.repeat(PLAIN, 2, axis=2)[:, :, ::2],
        PLAIN[::-1][::-1],
        read_only(),
        PLAIN.tolist(),
        Delayed(),
        np.ma.masked_array(PLAIN, np.zeros(PLAIN.shape, bool)),
    ],
    ids=["swapped", "fortran", "strided", "views", "read-only", "lists", "delayed", "masked"],
)
def test_the_same_values_are_the_same_picture(given: Any) -> None:
    truth = render(PLAIN, _look(), size=(24, 24)).rgba
    assert truth.any()
    np.testing.assert_array_equal(render(given, _look(), size=(24, 24)).rgba, truth)


def _look() -> Any:
    from resample_volume import Appearance

    return Appearance(LOOK)


def test_files_and_maps_of_files_are_volumes(tmp_path: Path) -> None:
    np.testing.assert_array_equal(as_volume(mapped(tmp_path)).values, PLAIN)
    np.testing.assert_array_equal(as_volume(tmp_path / "values.npy").values, PLAIN)
    assert as_volume("checker-box:size=8").values.shape == (8, 8, 8)


@pytest.mark.parametrize(
    ("dtype", "becomes"),
    [
        ("bool", "uint8"),
        ("float16", "float32"),
        ("longdouble", "float64"),
        ("int64", "int32"),
        ("uint64", "int32"),
        ("uint32", "int32"),
        (">i2", "int16"),
        ("int8", "int8"),
    ],
)
def test_types_become_the_nearest_that_volumes_have(dtype: str, becomes: str) -> None:
    given = (np.arange(24).reshape(2, 3, 4) % 2).astype(dtype)
    volume = as_volume(given)
    assert volume.values.dtype == np.dtype(becomes)
    assert volume.values.dtype.isnative
    np.testing.assert_array_equal(volume.values, given)


def test_whole_numbers_beyond_32_bits_become_floats() -> None:
    values = as_volume(np.array([[[0, 1 << 40]]])).values
    assert values.dtype == np.float64
    assert values.max() == 1 << 40


def test_what_is_masked_is_missing() -> None:
    given = np.ma.masked_greater(np.arange(24, dtype=np.uint8).reshape(2, 3, 4), 20)
    values = as_volume(given).values
    assert np.isnan(values).sum() == 3
    assert np.nanmax(values) == 20


def labeled(dims: tuple[str, ...], coords: dict[str, Any], values: NDArray[Any] = PLAIN) -> Any:
    """An array with the parts of xarray's that are read."""

    def transpose(*order: str) -> Any:
        axes = [dims.index(dim) for dim in order]
        return labeled(tuple(order), coords, values.transpose(axes))

    held = {dim: SimpleNamespace(values=np.asarray(place)) for dim, place in coords.items()}
    return SimpleNamespace(dims=dims, coords=held, values=values, name="t", transpose=transpose)


def test_coordinates_give_spacing_and_origin() -> None:
    coords = {"z": 5 + 2.0 * np.arange(6), "y": np.arange(7) / 2, "x": 3 - np.arange(8)}
    volume = as_volume(labeled(("z", "y", "x"), coords))
    np.testing.assert_allclose(volume.spacing, [1, 0.5, 2])
    np.testing.assert_allclose(volume.origin, [-4, 0, 5])
    np.testing.assert_array_equal(volume.values, PLAIN[:, :, ::-1])
    assert volume.name == "t"


def test_dimensions_are_known_by_their_names() -> None:
    given = labeled(("X", "Z", "Y"), {}, PLAIN.transpose(2, 0, 1))
    volume = as_volume(given)
    np.testing.assert_array_equal(volume.values, PLAIN)
    np.testing.assert_allclose(volume.spacing, 1)


def test_uneven_coordinates_are_made_even() -> None:
    coords = {"z": [0, 1, 2, 4, 6, 8.0], "y": np.arange(7), "x": np.arange(8)}
    volume = as_volume(labeled(("z", "y", "x"), coords))
    assert volume.values.shape == (9, 7, 8)
    assert volume.note


def test_xarray_itself() -> None:
    xarray = pytest.importorskip("xarray")
    given = xarray.DataArray(PLAIN, dims=("z", "y", "x"), coords={"z": 2.0 * np.arange(6)})
    np.testing.assert_allclose(as_volume(given).spacing, [1, 1, 2])
    turned = given.transpose("x", "z", "y")
    np.testing.assert_array_equal(as_volume(turned).values, PLAIN)


@pytest.mark.sweep
def test_dask_itself() -> None:
    array = pytest.importorskip("dask.array")
    delayed = array.from_array(PLAIN, chunks=(2, 4, 3)) * 2
    np.testing.assert_array_equal(as_volume(delayed).values, 2 * PLAIN)


def test_images_of_simple_itk_keep_their_place() -> None:
    itk = pytest.importorskip("SimpleITK")
    image = itk.GetImageFromArray(PLAIN)
    image.SetSpacing((1.0, 2.0, 3.0))
    image.SetOrigin((4.0, 5.0, 6.0))
    image.SetDirection((0, 1, 0, 1, 0, 0, 0, 0, 1))
    volume = as_volume(image)
    np.testing.assert_array_equal(volume.values, PLAIN)
    assert (volume.spacing == [1, 2, 3]).all()
    assert (volume.origin == [4, 5, 6]).all()
    assert volume.direction[0, 1] == 1
    with pytest.raises(ValueError, match="an image of 2 dimensions; a volume has 3"):
        as_volume(itk.GetImageFromArray(PLAIN[0]))


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        (None, TypeError, "a volume of NoneType; give an array"),
        (3.5, TypeError, "a volume of float; give an array"),
        ({"a": 1}, TypeError, "a volume of dict; give an array"),
        (PLAIN.astype(complex), TypeError, "a volume of complex128; its values must be real"),
        (np.full((2, 2, 2), "a"), TypeError, "its values must be real numbers"),
        (PLAIN[0], ValueError, r"an array \(Z, Y, X\) with voxels in it, not \(7, 8\)"),
        (np.zeros((2, 0, 3)), ValueError, r"not \(2, 0, 3\)"),
        ([[1, 2], [3]], ValueError, "lists of different lengths are not a volume"),
        (labeled(("t", "y", "x"), {}), ValueError, "has the dimensions z, y and x"),
        (labeled(("z", "y", "x"), {"x": list("abcdefgh")}), ValueError, "must be finite numbers"),
        ("no-such.nrrd", OSError, "there is no such file"),
    ],
)
def test_what_is_no_volume_is_said_in_a_line(
    given: Any, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message) as caught:
        render(given)
    assert "\n" not in str(caught.value)


@pytest.mark.some(1)
@pytest.mark.parametrize(
    ("given", "orbit"),
    [
        ((40, 10), Orbit(40, 10)),
        ([40, 10, 2], Orbit(40, 10, 2)),
        (np.array([40.0, 10.0]), Orbit(40, 10)),
        ("40/10/2", Orbit(40, 10, 2)),
        ("40/10/2/0.1/-0.2", Orbit(40, 10, 2, pan=(0.1, -0.2))),
        ("top", Orbit(0, 90)),
        ("front", Orbit(0, 0)),
    ],
)
def test_cameras_are_numbers_names_or_texts(given: Any, orbit: Orbit) -> None:
    seen = render(PLAIN, _look(), given, size=(16, 16)).rgba
    np.testing.assert_array_equal(seen, render(PLAIN, _look(), orbit, size=(16, 16)).rgba)


@pytest.mark.parametrize(
    ("given", "error"),
    [("above", ValueError), ((1, 2, 3, 4), ValueError), ((1, "a"), ValueError), (5, TypeError)],
)
def test_cameras_that_are_none_are_refused(given: Any, error: type[Exception]) -> None:
    with pytest.raises(error, match=r"give a camera; azimuth and elevation.*front, back"):
        render(PLAIN, _look(), given)


@pytest.mark.parametrize("name", ["spacing", "origin", "direction"])
def test_a_place_may_be_a_masked_array_of_which_nothing_is_masked(name: str) -> None:
    given = as_volume(np.arange(60, dtype=np.uint8).reshape(3, 4, 5))
    part = getattr(given, name)
    whole = given._replace(**{name: np.ma.MaskedArray(part, np.zeros(part.shape, bool))})
    assert all(type(each) is np.ndarray for each in as_volume(whole)[1:4])
    assert render(whole, size=(8, 8)).rgba.tobytes() == render(given, size=(8, 8)).rgba.tobytes()
    masked = given._replace(**{name: np.ma.MaskedArray(part, np.ones(part.shape, bool))})
    with pytest.raises(ValueError, match=name if name != "direction" else "lattice"):
        as_volume(masked)
