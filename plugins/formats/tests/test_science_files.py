"""FITS, HDF5, Imaris, NetCDF, MGH, MINC, Analyze, and files of microscopes."""

import sys
from contextlib import suppress
from types import ModuleType

import numpy as np
import pytest
from PIL import Image

from resample_formats.hdf5 import Hdf5, NetCdf
from resample_volume.cli import app
from resample_volume.files.source import open_recording, open_volume
from tests.commands import ended

with suppress(ImportError):  # before a test opens a shell of IPython, which its log asks for
    import astropy.io.fits  # noqa: F401

VALUES = np.random.default_rng(7).integers(0, 200, (4, 5, 6), np.uint8)  # (Z, Y, X)
MORE = np.random.default_rng(8).integers(0, 200, (2, 3, 4, 5, 6), np.uint16)  # times, channels


def fits_file(path, values, **words):
    fits = pytest.importorskip("astropy.io.fits")
    image = fits.PrimaryHDU(values)
    image.header.update({key.replace("_", "-"): word for key, word in words.items()})
    image.writeto(path)
    return path


def test_a_cube_of_a_radio_telescope_keeps_the_proportion_of_its_pixels(tmp_path):
    cube = VALUES[None].astype(">f4")
    cube[0, 1, 2, 3] = np.nan
    path = fits_file(
        tmp_path / "cube.fits", cube, CTYPE1="RA---SIN", CTYPE2="DEC--SIN", CTYPE3="VRAD",
        CTYPE4="STOKES", CDELT1=-0.001, CDELT2=0.002, CDELT3=420.0, CDELT4=1.0, CUNIT3="m/s",
        BUNIT="Jy/beam",
    )  # fmt: skip
    volume = open_volume(path)
    np.testing.assert_array_equal(volume.values, cube[0].astype(np.float32))
    assert volume.spacing.tolist() == [1.0, 2.0, 1.0]
    assert volume.note.startswith("values are in Jy/beam; axes are RA---SIN by 0.001 deg, DEC--SIN")
    assert "VRAD by 420 m/s" in volume.note


def test_a_simulation_s_cube_has_lengths_and_blanks_are_missing(tmp_path):
    words = {
        f"{key}{n}": word for n in (1, 2, 3) for key, word in (("CDELT", 0.5), ("CUNIT", "kpc"))
    }
    path = fits_file(
        tmp_path / "a.fits", VALUES.astype(np.int16), BLANK=int(VALUES[0, 0, 0]), **words
    )
    volume = open_volume(path)
    assert volume.spacing.tolist() == [0.5, 0.5, 0.5]
    blank = VALUES[0, 0, 0] == VALUES
    np.testing.assert_array_equal(np.isnan(volume.values), blank)
    np.testing.assert_array_equal(volume.values[~blank], VALUES[~blank])


def test_an_image_of_a_fits_file_is_chosen_by_name_and_scaled(tmp_path):
    fits = pytest.importorskip("astropy.io.fits")
    scaled = fits.ImageHDU(VALUES.astype(np.int16), name="SCI")
    scaled.header["BSCALE"], scaled.header["BZERO"] = 0.5, 3.0
    held = [fits.PrimaryHDU(np.zeros((3, 3))), fits.ImageHDU(VALUES, name="MASK"), scaled]
    fits.HDUList(held).writeto(tmp_path / "a.fits")
    volume = open_volume(tmp_path / "a.fits")
    np.testing.assert_array_equal(volume.values, VALUES)
    from resample_formats.fits import Fits

    raw = Fits("SCI")(tmp_path / "a.fits").values
    np.testing.assert_allclose(raw, fits.getdata(tmp_path / "a.fits", "SCI"))
    with pytest.raises(ValueError, match=r"called OTHER: 0 PRIMARY .*1 MASK"):
        Fits("OTHER")(tmp_path / "a.fits")


def test_a_cut_off_fits_file_is_said_in_a_line(tmp_path):
    path = fits_file(tmp_path / "a.fits", np.zeros((40, 50, 60)))
    path.write_bytes(path.read_bytes()[:9000])
    with pytest.raises((ValueError, OSError), match=r"is cut off|is damaged"):
        open_volume(path)
    path.write_bytes(b"SIMPLE  = nothing")
    with pytest.raises((ValueError, OSError), match="damaged"):
        open_volume(path)


@pytest.mark.parametrize(
    ("card", "changed", "told"),
    [
        (b"NAXIS   =                    3", b"NAXIS   =           9999999993", "9999999993 axes"),
        (b"BITPIX  =                    8", b"BITPIX  =                    9", "values of 9 bits"),
        (b"NAXIS1  =                    6", b"NAXIS1  =                   -6", "is damaged"),
    ],
)
def test_damaged_headers_of_fits_files_are_refused(tmp_path, card, changed, told):
    path = fits_file(tmp_path / "a.fits", VALUES)
    whole = path.read_bytes()
    assert card in whole
    path.write_bytes(whole.replace(card, changed))
    with pytest.raises((ValueError, OSError), match=told):
        open_volume(path)


def hdf5_file(path, arrays, **sizes):
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        for name, values in arrays.items():
            file[name] = values
            for key, size in sizes.items():
                file[name].attrs[key] = size
    return path


def test_the_only_array_of_an_hdf5_file_is_read_with_its_sizes(tmp_path):
    arrays = {"data/raw": VALUES, "table": np.zeros((3, 4))}
    path = hdf5_file(tmp_path / "a.h5", arrays, element_size_um=[2.0, 0.5, 0.25])
    volume = open_volume(path)
    np.testing.assert_array_equal(volume.values, VALUES)
    assert (volume.spacing.tolist(), volume.length) == ([0.25, 0.5, 2.0], "µm")


def test_one_of_several_arrays_is_chosen_by_its_path(tmp_path):
    path = hdf5_file(tmp_path / "a.h5", {"t0/one": VALUES, "t0/two": MORE})
    with pytest.raises(ValueError, match=r"holds several arrays: t0/one, t0/two; choose one by"):
        open_volume(path)
    np.testing.assert_array_equal(Hdf5("t0/one")(path).values, VALUES)
    np.testing.assert_array_equal(Hdf5("/t0/two").recorded(path).values, MORE)
    with pytest.raises(ValueError, match=r"holds no array 'three' of three axes or more; it holds"):
        Hdf5("three")(path)


def test_links_of_hdf5_to_other_files_are_not_followed(tmp_path):
    h5py = pytest.importorskip("h5py")
    hdf5_file(tmp_path / "secret.h5", {"data": VALUES})
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["data"] = h5py.ExternalLink("secret.h5", "/data")
    (tmp_path / "secret.h5").rename(tmp_path / "gone.h5")  # nor opened
    for reader in (Hdf5(), Hdf5("data"), NetCdf()):
        with pytest.raises(ValueError, match=r"a link, which is not followed|no array|no variable"):
            reader(tmp_path / "a.h5")


def letters(text):
    return np.frombuffer(text.encode(), "S1")


def imaris_file(path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        image = file.create_group("DataSetInfo/Image")
        facts = {"X": 6, "Y": 5, "Z": 4, "Unit": "um", "ExtMin0": 1, "ExtMin1": 0, "ExtMin2": 0}
        for key, fact in {**facts, "ExtMax0": 4, "ExtMax1": 2.5, "ExtMax2": 8}.items():
            image.attrs[key] = letters(str(fact))
        for c in range(3):
            channel = file.create_group(f"DataSetInfo/Channel {c}")
            channel.attrs["Color"] = letters("1.000 0.500 0.000")
            channel.attrs["ColorRange"] = letters("10.000 150.000")
            channel.attrs["Name"] = letters(f"dye {c}")
            for t in range(2):
                padded = np.pad(MORE[t, c], ((0, 4), (0, 3), (0, 2)))
                place = f"DataSet/ResolutionLevel 0/TimePoint {t}/Channel {c}/Data"
                file.create_dataset(place, data=padded, chunks=(8, 8, 8), compression="gzip")
    return path


def test_imaris_has_times_channels_sizes_and_looks(tmp_path):
    held = open_recording(imaris_file(tmp_path / "a.ims"))
    np.testing.assert_array_equal(held.values, MORE)
    assert (held.spacing.tolist(), held.length) == ([0.5, 0.5, 2.0], "µm")
    assert held.origin.tolist() == [1.25, 0.25, 1.0]
    assert held.looks[1] == ("dye 1", "#ff8000", (10.0, 150.0), True)


def netcdf_file(path, version, z=(0.0, 10.0, 20.0, 30.0)):
    """Temperatures (time, z, y, x) in m, packed, with a fill value."""
    places = {"z": np.array(z), "y": np.arange(5) * 2.0, "x": np.arange(6) * 4.0}
    packed = VALUES.astype(np.int16)[None]
    facts = {"scale_factor": 0.5, "add_offset": 100.0, "_FillValue": np.int16(VALUES[0, 0, 0])}
    if version == 3:
        from scipy import io

        with io.netcdf_file(path, "w") as file:
            for name, place in {"time": np.zeros(1), **places}.items():
                file.createDimension(name, len(place))
                one = file.createVariable(name, "d", (name,))
                one[:], one.units = place, "m"
            data = file.createVariable("temperature", "h", ("time", "z", "y", "x"))
            for key, fact in {**facts, "units": "K"}.items():
                setattr(data, key, fact)
            data[:] = packed
        return path
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        file["temperature"] = packed
        for n, (name, place) in enumerate({"time": np.zeros(1), **places}.items()):
            file[name] = place
            file[name].make_scale(name)
            file[name].attrs["units"] = "m"
            file["temperature"].dims[n].attach_scale(file[name])
        for key, fact in {**facts, "units": "K"}.items():
            file["temperature"].attrs[key] = fact
    return path


@pytest.mark.parametrize("version", [3, 4])
def test_a_variable_of_netcdf_is_unpacked_and_has_its_lattice(tmp_path, version):
    volume = open_volume(netcdf_file(tmp_path / "a.nc", version))
    blank = VALUES[0, 0, 0] == VALUES
    np.testing.assert_array_equal(np.isnan(volume.values), blank)
    np.testing.assert_allclose(volume.values[~blank], 0.5 * VALUES[~blank] + 100.0)
    assert (volume.spacing.tolist(), volume.length) == ([4000.0, 2000.0, 10000.0], "mm")
    assert volume.note == "values are in K"
    with pytest.raises(ValueError, match=r"holds temperature; choose one by --reader netcdf:array"):
        NetCdf("wind")(tmp_path / "a.nc")


@pytest.mark.parametrize("version", [3, 4])
def test_falling_coordinates_of_netcdf_lead_the_other_way(tmp_path, version):
    volume = open_volume(netcdf_file(tmp_path / "a.nc", version, z=(30.0, 20.0, 10.0, 0.0)))
    assert np.diag(volume.direction).tolist() == [1.0, 1.0, -1.0]
    last = volume.origin + volume.direction @ (volume.spacing * [5, 4, 3])
    np.testing.assert_allclose(volume.origin, [0.0, 0.0, 30000.0])
    np.testing.assert_allclose(last, [20000.0, 8000.0, 0.0])


@pytest.mark.parametrize("version", [3, 4])
def test_uneven_levels_of_netcdf_are_interpolated(tmp_path, version):
    volume = open_volume(netcdf_file(tmp_path / "a.nc", version, z=(0.0, 10.0, 20.0, 40.0)))
    assert volume.values.shape == (5, 5, 6)
    assert volume.spacing.tolist() == [4.0, 2.0, 10.0]


@pytest.mark.parametrize("name", ["a.mgz", "a.mgh", "a.img", "a.hdr", "a.mnc"])
def test_files_of_neuroscience_have_the_places_of_nifti(tmp_path, name):
    nibabel = pytest.importorskip("nibabel")
    matrix = np.array([[0, -2.0, 0, 10], [1.5, 0, 0, 20], [0, 0, 3.0, 30], [0, 0, 0, 1]])
    values = np.ascontiguousarray(VALUES.astype(np.int16).T)
    nibabel.save(nibabel.Nifti1Image(values, matrix), tmp_path / "same.nii")
    same = open_volume(tmp_path / "same.nii")
    if name == "a.mnc":
        minc_file(tmp_path / name)
        volume = open_volume(tmp_path / name)
        assert (volume.origin * (-1, -1, 1)).tolist() == [1.0, 2.0, 3.0]
        assert volume.spacing.tolist() == [0.25, 0.5, 2.0]
        np.testing.assert_allclose(volume.values, VALUES, atol=0.01)
        return
    kind = nibabel.MGHImage if ".mg" in name else nibabel.Nifti1Pair
    nibabel.save(kind(values, matrix), tmp_path / name)
    volume = open_volume(tmp_path / name)
    np.testing.assert_array_equal(volume.values, VALUES)
    assert (volume.space, volume.values.dtype) == ("lps", np.int16)
    for one, other in zip(volume[1:4], same[1:4], strict=True):
        np.testing.assert_allclose(one, other, atol=1e-5)


def minc_file(path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        root = file.create_group("minc-2.0")
        for name, step, start in (
            ("zspace", 2.0, 3.0),
            ("yspace", 0.5, 2.0),
            ("xspace", 0.25, 1.0),
        ):
            one = root.create_dataset(f"dimensions/{name}", data=np.int32(0))
            one.attrs.update({"step": step, "start": start, "length": np.int32(0)})
        image = root.create_dataset("image/0/image", data=VALUES)
        image.attrs["dimorder"] = np.bytes_(b"zspace,yspace,xspace")
        image.attrs["valid_range"] = np.array([0.0, 255.0])
        root.create_dataset("image/0/image-min", data=0.0)
        root.create_dataset("image/0/image-max", data=255.0)


def test_microscopes_files_are_read_by_bioio_where_it_is(tmp_path, monkeypatch):
    (tmp_path / "a.czi").write_bytes(b"ZISRAWFILE")
    monkeypatch.setitem(sys.modules, "bioio", None)
    with pytest.raises(
        ValueError, match=r"a.czi is read by bioio: pip install bioio bioio-czi, or"
    ):
        open_volume(tmp_path / "a.czi")

    class Opened:  # what bioio.BioImage has
        scenes, shape, dtype = ("one", "two"), MORE.shape, MORE.dtype
        channel_names = ("red", "green", "blue")
        physical_pixel_sizes = type("Sizes", (), {"X": 0.25, "Y": 0.5, "Z": 2.0})

        def __init__(self, path):
            assert path.endswith("a.czi")

        def set_scene(self, scene):
            assert scene == "one"

        def get_image_data(self, order):
            assert order == "TCZYX"
            return MORE

    library = ModuleType("bioio")
    library.BioImage = Opened
    monkeypatch.setitem(sys.modules, "bioio", library)
    held = open_recording(tmp_path / "a.czi")
    np.testing.assert_array_equal(held.values, MORE)
    assert (held.spacing.tolist(), held.length) == ([0.25, 0.5, 2.0], "µm")
    assert [look.label for look in held.looks] == ["red", "green", "blue"]


def test_commands_draw_them_and_say_what_they_hold(tmp_path, capsys):
    fits_file(tmp_path / "a.fits", VALUES.astype(np.float32), BUNIT="K")
    assert ended(app, "info", tmp_path / "a.fits") == 0
    assert "values are in K" in capsys.readouterr().out
    out = tmp_path / "a.png"
    assert ended(app, "render", tmp_path / "a.fits", "-o", out, "--size", "32x32") == 0
    with Image.open(out) as picture:
        assert picture.size == (32, 32)
