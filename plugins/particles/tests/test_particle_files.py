"""Particles from HDF5 of SWIFT, GADGET, AREPO and Phantom, and from columns; maps by commands."""

import sys
from functools import partial

import numpy as np
import pytest
from PIL import Image

from resample.files.images import read_channels
from resample_particles import column_density, read_particles
from resample_particles.files import KNOWN_LENGTHS, SUN, length_unit, mass_unit
from resample_particles.smoothing import KERNELS
from resample_points import cli
from tests import commands, snapshots
from tests.snapshots import COUNT, HEAT, PLACE

h5py = pytest.importorskip("h5py", reason="h5py reads HDF5 (the extra hdf5)")
ended, refused = partial(commands.ended, cli.app), partial(commands.refused, cli.app)
GAMMA = KERNELS["cubic"].gamma


def test_swift_is_physical_and_says_its_units(tmp_path):
    gas = read_particles(snapshots.swift(tmp_path / "a.hdf5"))
    np.testing.assert_allclose(gas.position, 0.5 * PLACE)
    np.testing.assert_allclose(gas.mass, 2.0)
    np.testing.assert_allclose(gas.smoothing, 0.2)
    np.testing.assert_allclose(gas.box, 5.0)
    assert gas.units["length"] == "Mpc"
    assert gas.units["mass"] == "10^10 Msun"
    assert gas.units["Temperatures"] == "K"
    assert {"ParticleIDs", "Velocities.x", "Velocities.z"} < set(gas.quantities)
    dark = read_particles(tmp_path / "a.hdf5", "dark")
    assert dark.smoothing is None
    assert len(dark) == COUNT


def test_gadget_has_factors_of_a_and_h_and_masses_in_its_header(tmp_path):
    path = snapshots.gadget(tmp_path / "a.hdf5")
    gas, dark = read_particles(path), read_particles(path, "dark")
    np.testing.assert_allclose(gas.position, PLACE, rtol=1e-6)  # a = h = 1/2
    np.testing.assert_allclose(gas.mass, 4.0)
    np.testing.assert_allclose(dark.mass, 6.0)
    np.testing.assert_allclose(gas.smoothing, 0.6 / GAMMA)
    np.testing.assert_allclose(gas.box, 10.0)
    assert gas.units["length"] == "kpc"


def test_particles_beside_their_box_are_not_periodic(tmp_path):
    def around_the_origin(_, gas):
        gas["Coordinates"][...] = PLACE - 5.0

    changed(tmp_path / "a.hdf5", around_the_origin)
    assert read_particles(tmp_path / "a.hdf5").box is None


def test_cells_reach_two_and_a_half_radii(tmp_path):
    gas = read_particles(snapshots.arepo(tmp_path / "a.hdf5"))
    radius = (0.75 / np.pi * 2.0 / 4.0) ** (1 / 3)
    np.testing.assert_allclose(gas.smoothing * GAMMA, 2.5 * radius)


def test_phantom_reaches_two_smoothing_lengths_and_leaves_out_accreted_ones(tmp_path):
    gas = read_particles(snapshots.phantom(tmp_path / "a.h5"), quantities=["u"])
    assert len(gas) == COUNT // 2 - 1
    np.testing.assert_allclose(gas.smoothing * GAMMA, 0.6, rtol=1e-6)
    np.testing.assert_allclose(gas.mass, 1.0)
    np.testing.assert_array_equal(gas.quantities["u"], HEAT[2::2])


def test_any_of_several_files_stands_for_all(tmp_path):
    for n, rows in enumerate((slice(0, 25), slice(25, 25), slice(25, None))):
        snapshots.gadget(tmp_path / f"snap.{n}.hdf5", rows, 3)
    snapshots.gadget(tmp_path / "whole.hdf5")
    whole = read_particles(tmp_path / "whole.hdf5")
    for n in (0, 2):
        joined = read_particles(tmp_path / f"snap.{n}.hdf5", quantities=["internal_energy"])
        np.testing.assert_array_equal(joined.position, whole.position)
        np.testing.assert_array_equal(joined.quantities["InternalEnergy"], HEAT)
    (tmp_path / "snap.1.hdf5").unlink()
    with pytest.raises(OSError, match=r"snap\.1\.hdf5"):
        read_particles(tmp_path / "snap.0.hdf5")


def test_places_alone_are_particles_of_mass_1(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["Coordinates"] = PLACE.astype(np.float32)
    halo = read_particles(tmp_path / "a.h5", "dark")
    assert halo.mass.sum() == COUNT
    assert halo.units["mass"] == "particles"


@pytest.mark.parametrize("suffix", [".csv", ".npz"])
def test_columns_have_masses_lengths_and_quantities(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    parts = {"mass": np.full(COUNT, 2.0), "h": np.full(COUNT, 0.4), "temperature": HEAT}
    if suffix == ".npz":
        np.savez(path, position=PLACE, **parts)
    else:
        rows = np.column_stack([PLACE, *parts.values()])
        np.savetxt(path, rows, delimiter=",", header=f"x,y,z,{','.join(parts)}", comments="")
    gas = read_particles(path)
    np.testing.assert_allclose(gas.position, PLACE)
    assert gas.mass.sum() == 2 * COUNT
    np.testing.assert_allclose(gas.smoothing, 0.4)
    np.testing.assert_allclose(gas.quantities["temperature"], HEAT)


def changed(path, change):
    snapshots.swift(path)
    with h5py.File(path, "r+") as file:
        change(file, file["PartType0"])


def put(name, values):
    def change(_, gas):
        del gas[name]
        gas[name] = values

    return change


def linked(link):
    def change(_, gas):
        del gas["Masses"]
        gas["Masses"] = link

    return change


def huge(_, gas):
    del gas["Masses"], gas["Coordinates"]
    gas.create_dataset("Coordinates", (1 << 36, 3), "f8", chunks=(1024, 3))


def external(_, gas):
    del gas["Masses"]
    gas.create_dataset("Masses", (COUNT,), "f8", external=[("/etc/hostname", 0, 8 * COUNT)])


def virtual(_, gas):
    del gas["Masses"]
    layout = h5py.VirtualLayout((COUNT,), "f8")
    layout[:] = h5py.VirtualSource("other.h5", "m", (COUNT,))
    gas.create_virtual_dataset("Masses", layout)


def scaled(file, _):
    file["Header"].attrs["Scale-factor"] = -1.0


def steep(_, gas):
    gas["Coordinates"].attrs["a-scale exponent"] = -1e6


def vast(file, gas):
    put("Masses", np.full(COUNT, 1e300))(file, gas)
    gas["Masses"].attrs["a-scale exponent"] = -100.0


HOSTILE = {
    "shape": (put("Masses", np.ones(3)), r"'Masses' of the shape \(3,\); it must be \(60,\)"),
    "flat": (put("Coordinates", PLACE[:, :2]), r"it must be \(60, 3\)"),
    "text": (put("Masses", np.array([b"a"] * COUNT)), "numbers can be read"),
    "nan": (put("Masses", np.full(COUNT, np.nan)), "not finite"),
    "far": (put("Coordinates", np.full((COUNT, 3), 1e30)), "is the limit"),
    "negative": (put("SmoothingLengths", np.full(COUNT, -1.0)), "below 0"),
    "soft": (linked(h5py.SoftLink("/PartType1/Masses")), "a link, which is not followed"),
    "outside": (linked(h5py.ExternalLink("b.h5", "/m")), "a link, which is not followed"),
    "external": (external, "in other files"),
    "virtual": (virtual, "in other files"),
    "huge": (huge, "over the limit|memory"),
    "steep": (steep, "the powers"),
    "vast": (vast, "not finite"),
    "factor": (scaled, "a scale factor of -1"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_snapshots_are_refused_in_one_line(tmp_path, name):
    change, message = HOSTILE[name]
    changed(tmp_path / "a.hdf5", change)
    with pytest.raises((ValueError, OSError), match=message) as caught:
        read_particles(tmp_path / "a.hdf5")
    assert "\n" not in str(caught.value)
    assert "a.hdf5" in str(caught.value)


@pytest.mark.parametrize("share", [0.01, 0.3, 0.7, 0.99])
def test_snapshots_that_are_cut_off_are_refused(tmp_path, share):
    content = snapshots.swift(tmp_path / "a.hdf5").read_bytes()
    (tmp_path / "a.hdf5").write_bytes(content[: int(share * len(content))])
    with pytest.raises((ValueError, OSError)):
        read_particles(tmp_path / "a.hdf5")


@pytest.mark.parametrize(
    ("kind", "message"),
    [("stars", "no particles of type stars"), ("cheese", "give gas, dark, stars or 0 to 6")],
)
def test_types_that_are_not_there_are_refused(tmp_path, kind, message):
    path = snapshots.swift(tmp_path / "a.hdf5")
    with pytest.raises(ValueError, match=message):
        read_particles(path, kind)


def test_a_missing_h5py_is_named_with_its_extra(tmp_path, monkeypatch):
    path = snapshots.swift(tmp_path / "a.hdf5")
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(ValueError, match=r"pip install 'hybrid-resample\[hdf5\]'"):
        read_particles(path)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    snapshots.swift("a.hdf5")
    return tmp_path


def test_the_command_writes_numbers_that_python_gives(folder, capsys):
    assert not ended("density", "a.hdf5", "--size", "40", "-o", "a.npy")
    assert "10^10 Msun/Mpc²" in capsys.readouterr().err
    truth = column_density(read_particles("a.hdf5"), "z", size=(40, 40)).value
    np.testing.assert_array_equal(np.load("a.npy", allow_pickle=False), truth)
    assert not ended("density", "a.hdf5", "--size", "40", "-o", "a.exr")
    pixels = read_channels(folder / "a.exr")
    np.testing.assert_array_equal(pixels["Y"], truth.astype(np.float32))


def test_the_command_writes_slices_of_quantities_before_cameras_and_along_axes(folder):
    gas = read_particles("a.hdf5")
    more = ("--quantity", "temperature", "--size", "30", "--smoothing-kernel", "wendland")
    assert not ended("density", "a.hdf5", "--axis", "x", "--slice", "50%", *more, "-o", "a.npy")
    found = column_density(
        gas, "x", size=(30, 30), kernel="wendland", quantity="temperature", slice_at=2.5
    )
    np.testing.assert_array_equal(np.load(folder / "a.npy", allow_pickle=False), found.value)
    assert found.units == "K"
    assert not ended(
        "density",
        "a.hdf5",
        "--camera",
        "30/20/1",
        "--crop",
        "0:4,:,:",
        "--size",
        "30",
        "-o",
        "b.npy",
    )
    assert np.isfinite(np.load(folder / "b.npy", allow_pickle=False)).all()


@pytest.mark.sweep
def test_a_picture_has_a_logarithmic_scale_and_a_bar(folder):
    assert not ended("density", "a.hdf5", "--size", "80", "-o", "plain.png")
    assert not ended("density", "a.hdf5", "--size", "80", "--color-bar", "-o", "bar.png")
    plain, bar = (np.asarray(Image.open(folder / name)) for name in ("plain.png", "bar.png"))
    assert plain.shape[:2] == (80, 80)
    assert bar.shape[1] > 100
    np.testing.assert_array_equal(bar[:, :80, :3], plain[..., :3])
    span = ("--range", "1,100", "--colormap", "gray")
    assert not ended("density", "a.hdf5", "--size", "80", *span, "-o", "gray.png")
    value = column_density(read_particles("a.hdf5"), "z", size=(80, 80)).value
    gray = np.asarray(Image.open(folder / "gray.png"))[..., 0] / 255
    truth = np.clip(np.log10(np.maximum(value, 1.0)) / 2, 0, 1)
    assert abs(gray - truth).max() < 2.1 / 255


@pytest.mark.some(5)
@pytest.mark.parametrize(
    ("more", "message"),
    [
        (("-o", "a.jpg"), "maps are written as .png"),
        (("-o", "a.npy", "--color-bar"), "numbers have no color bar"),
        (("-o", "a.png", "--axis", "x", "--camera", "30/20/1"), "give one of them"),
        (("-o", "a.png", "--type", "7"), "0 to 6"),
        (
            ("-o", "a.png", "--quantity", "pressure"),
            "no quantity 'pressure'; known: Coordinates, Masses",
        ),
        (("-o", "a.png", "--range", "0,5"), "begins above 0"),
        (("-o", "a.png", "--slice", "half"), "a slice at"),
    ],
)
@pytest.mark.usefixtures("folder")
def test_options_that_do_not_fit_are_refused(more, message, capsys):
    assert message in refused(capsys, "density", "a.hdf5", "--size", "64", *more)


@pytest.mark.parametrize(
    ("size", "name"),
    [
        (None, ""), (1.0, "g"), (SUN, "Msun"), (1.0001 * SUN, "Msun"), (0.9999 * SUN, "Msun"),
        (SUN * 1e10, "10^10 Msun"), (SUN * 1e10 * 0.9999, "10^10 Msun"), (SUN / 1e3, "10^-3 Msun"),
        (SUN * 1.0001e-3, "10^-3 Msun"), (SUN * 1.1, "(2.1873e+33 g)"), (0.0, "(0 g)"),
        (-1.0, "(-1 g)"),
    ],
)  # fmt: skip
def test_a_unit_of_mass_is_named_by_the_nearest_power_of_ten_of_suns(size, name):
    assert mass_unit(size) == name


@pytest.mark.parametrize(
    ("size", "name"),
    [(None, ""), (1.0, "cm"), *((0.9999 * of, name) for name, of in KNOWN_LENGTHS.items()),
     (KNOWN_LENGTHS["kpc"] * 1.002, "(3.0918e+21 cm)"), (2.0, "(2 cm)")],
)  # fmt: skip
def test_a_unit_of_length_is_named_if_it_is_known(size, name):
    assert length_unit(size) == name


@pytest.mark.parametrize("files", [1e300, np.inf, 2e9])
def test_a_snapshot_of_more_files_than_there_can_be_is_refused(tmp_path, files):
    snapshots.gadget(tmp_path / "snap.0.hdf5", files=files)
    with pytest.raises(ValueError, match=r"snap\.0\.hdf5.*files"):
        read_particles(tmp_path / "snap.0.hdf5")


@pytest.mark.parametrize("files", [0, 1, np.nan])
def test_a_snapshot_of_one_file_may_have_any_name(tmp_path, files):
    snapshots.gadget(tmp_path / "any.hdf5", files=files)
    assert len(read_particles(tmp_path / "any.hdf5")) == COUNT


def test_a_part_of_a_snapshot_tells_by_its_name_which_one_it_is(tmp_path):
    snapshots.gadget(tmp_path / "any.hdf5", files=2)
    with pytest.raises(ValueError, match=r"is one of 2 files; give one that is called so"):
        read_particles(tmp_path / "any.hdf5")
