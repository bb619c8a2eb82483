"""One scene of 3D Gaussians in all formats agrees within what each format rounds."""

import gzip
import sys
from importlib.metadata import EntryPoint, EntryPoints
from typing import NamedTuple

import numpy as np
import pytest

from conftest import real
from resample import registry
from resample_points import cli
from resample_points.data.gaussians import Gaussians, with_up
from resample_points.files.gaussians import sog
from resample_points.files.gaussians.formats import is_gaussians, read_gaussians, write_gaussians
from resample_points.files.readers import read_cloud
from tests import commands
from tests import splats as made
from tests.fuzz.files import put

WIDTHS = (0, 3, 8, 15)
SCENE = made.scene()


class Errors(NamedTuple):
    """The most that a format rounds."""

    position: float
    size: float  # of the logarithms of scales
    turn: float  # of a quaternion's components
    opacity: float
    color: float
    rest: float


EXACT = Errors(2e-7, 1e-6, 2e-7, 1e-6, 1e-7, 0.4 / 65534 + 1e-7)
BYTE = 1 / 510
# Components of a rounded quaternion: half a step each, and the largest one follows from the others.
FILES = {
    "ascii": (lambda s: made.trained_of(s, "ascii"), EXACT),
    "little": (made.trained_of, EXACT),
    "big": (lambda s: made.trained_of(s, "binary_big_endian"), EXACT),
    "compressed": (
        made.compressed_of,
        Errors(6 / 2046 + 1e-6, 4 / 2046 + 1e-5, 2e-3, BYTE + 1e-6, BYTE * 2 + 1e-5, 1 / 64 + 1e-6),
    ),
    "without ranges": (
        lambda s: made.compressed_of(s, colors=False),
        Errors(3e-3, 2e-3, 2e-3, BYTE + 1e-6, BYTE / made.CONSTANT + 1e-5, 1 / 64 + 1e-6),
    ),
    "splat": (
        made.splat_of,
        Errors(2e-7, 1e-6, 1e-2, BYTE + 1e-6, BYTE / made.CONSTANT + 1e-5, np.inf),
    ),
    **{
        f"ksplat {precision}": (
            lambda s, precision=precision: made.ksplat_of(s, precision),
            Errors(
                (2e-7, 2e-4, 2e-4)[precision],
                (1e-6, 1e-3, 1e-3)[precision],
                (2e-7, 1e-3, 1e-3)[precision],
                BYTE + 1e-6,
                BYTE / made.CONSTANT + 1e-5,
                (2e-5, 3e-4, 3 / 510 + 1e-4)[precision],
            ),
        )
        for precision in (0, 1, 2)
    },
    **{
        f"spz {version}": (
            lambda s, version=version: made.spz_of(s, version),
            Errors(
                2e-3 if version == 1 else 2**-13 + 1e-7,
                1 / 32 + 1e-5,
                3e-3 if version >= 3 else 0.1,  # w follows from three that may be nearly 1
                BYTE + 1e-6,
                BYTE / 0.15 + 1e-5,
                1 / 256 + 1e-6,
            ),
        )
        for version in (1, 2, 3, 4)
    },
}
OF_SOG = {
    2: Errors(1e-4, 4 / 510 + 1e-5, 7e-3, BYTE + 1e-6, 2 * BYTE + 1e-5, 0.8 * BYTE + 1e-4),
    1: Errors(1e-4, 4 / 510 + 1e-5, 7e-3, 6 * BYTE / 4 + 1e-5, 2 * BYTE + 1e-5, 0.8 * BYTE + 1e-4),
}


def written(path, content):
    path.write_bytes(content)
    return path


def are_alike(found, scene, errors):
    assert found.position.dtype == found.scale.dtype == found.rotation.dtype == np.float32
    signed = found.rotation * np.sign((found.rotation * scene.rotation).sum(1))[:, None]
    differences = Errors(
        np.abs(found.position - scene.position).max(),
        np.abs(np.log(found.scale) - np.log(scene.scale)).max(),
        np.abs(signed - scene.rotation).max(),
        np.abs(found.opacity - scene.opacity).max(),
        np.abs(found.color - scene.color).max(),
        0.0,
    )
    if errors.rest < np.inf:
        rest = found.harmonics * found.harmonic_step
        differences = differences._replace(rest=np.abs(rest - scene.rest).max(initial=0.0))
    assert np.allclose(np.linalg.norm(found.rotation, axis=1), 1, atol=1e-6)
    pairs = zip(differences, errors, strict=True)
    assert all(value <= most for value, most in pairs), differences


@pytest.mark.parametrize("kind", FILES)
@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.each_value
def test_the_scene_is_the_same_in_every_format(tmp_path, kind, width):
    encode, errors = FILES[kind]
    scene = made.scene(width=width)
    ending = f".{kind.split()[0]}" if "splat" in kind else ".bin"
    path = written(tmp_path / f"scene{ending}", encode(scene))
    are_alike(read_gaussians(path), scene, errors)
    assert is_gaussians(path)


@pytest.mark.parametrize("version", OF_SOG)
@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.each_value
def test_folders_of_pictures_are_read(tmp_path, version, width):
    scene = made.scene(width=width)
    put(tmp_path, made.sog_of(scene, version))
    found = read_gaussians(tmp_path)
    are_alike(found, scene, OF_SOG[version])
    again = read_gaussians(tmp_path / "meta.json")
    assert all(np.array_equal(*pair) for pair in zip(found[:6], again[:6], strict=True))
    assert is_gaussians(tmp_path)
    assert is_gaussians(tmp_path / "meta.json")


@pytest.mark.parametrize("method", [0, 8])
def test_archives_of_pictures_are_read(tmp_path, method):
    path = written(tmp_path / "scene.sog", made.zipped(made.sog_of(SCENE), method))
    are_alike(read_gaussians(path), SCENE, OF_SOG[2])
    assert is_gaussians(path)


def test_more_than_one_chunk_has_ranges_of_its_own(tmp_path):
    scene = made.scene(count=600, width=3)
    scene.position[256:512] += 1000
    path = written(tmp_path / "a.ply", made.compressed_of(scene))
    errors = FILES["compressed"][1]
    are_alike(read_gaussians(path), scene, errors._replace(position=errors.position + 1e-4))


def test_properties_are_found_by_name_in_any_order_and_others_are_left_out(tmp_path):
    columns = made.trained_columns(SCENE) | {"beta": np.zeros(20), "f_dcx": np.ones(20)}
    names = sorted(columns)
    path = written(tmp_path / "a.ply", made.ply_of({name: columns[name] for name in names}))
    are_alike(read_gaussians(path), SCENE, EXACT)


def test_flat_gaussians_have_a_thin_third_axis(tmp_path):
    columns = made.trained_columns(SCENE)
    del columns["scale_2"]
    found = read_gaussians(written(tmp_path / "a.ply", made.ply_of(columns)))
    assert np.allclose(found.scale[:, :2], SCENE.scale[:, :2])
    assert np.allclose(found.scale[:, 2], SCENE.scale[:, :2].min(1) / 1000)


@pytest.mark.parametrize("encode", [made.trained_of, made.spz_of])
def test_degree_4_is_left_out(tmp_path, encode):
    path = written(tmp_path / "a.ply", encode(made.scene(width=24)))
    found = read_gaussians(path)
    expected = made.scene(width=24).rest[:, :15]
    assert np.abs(found.harmonics * found.harmonic_step - expected).max() <= 1 / 256 + 1e-6


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (made.trained_of(SCENE), False),
        (made.trained_of(SCENE, comments=["SplatRenderMode: mip"]), True),
        (made.trained_of(SCENE, comments=["antialiased 1", "SplatRenderMode: default"]), False),
        (made.compressed_of(SCENE, comments=["Antialiased 1"]), True),
        (made.spz_of(SCENE, flags=1), True),
        (made.spz_of(SCENE, version=4, flags=1), True),
        (made.spz_of(SCENE), False),
        (made.zipped(made.sog_of(SCENE, antialias=True)), True),
        (made.zipped(made.sog_of(SCENE, model="antialiased")), True),
        (made.zipped(made.sog_of(SCENE, model="2dgs", antialias=False)), False),
    ],
)
def test_files_say_whether_they_were_trained_antialiased(tmp_path, content, expected):
    assert read_gaussians(written(tmp_path / "a", content)).is_antialiased is expected


def axes(number):
    return (
        (2).to_bytes(4, "little")
        + (0).to_bytes(4, "little")
        + np.array([0xADBE0003, 4, number], "<u4").tobytes()
    )


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (made.trained_of(SCENE), None),
        (made.trained_of(SCENE, comments=["Vertical Axis: z"]), "z"),
        (made.zipped(made.sog_of(SCENE)), None),
        (made.spz_of(SCENE), "y"),
        (made.spz_of(SCENE, flags=2, extensions=axes(6)), "-y"),  # right, down, front
        (made.spz_of(SCENE, version=4, flags=2, extensions=axes(12)), "z"),  # right, front, up
        (made.spz_of(SCENE, version=4, flags=2, extensions=axes(99)), None),
    ],
)
def test_the_vertical_axis_is_the_one_that_the_format_names(tmp_path, content, expected):
    assert read_gaussians(written(tmp_path / "a", content)).up == expected


@pytest.mark.parametrize("width", WIDTHS)
def test_what_is_written_is_read_with_the_same_numbers(tmp_path, width):
    path = written(
        tmp_path / "a.ply", made.trained_of(made.scene(width=width), comments=["antialiased 1"])
    )
    found = read_gaussians(path)
    write_gaussians(tmp_path / "b.ply", found)
    again = read_gaussians(tmp_path / "b.ply")
    assert np.array_equal(again.position, found.position)
    assert np.array_equal(again.color, found.color)
    assert np.array_equal(again.harmonics, found.harmonics)
    assert np.allclose(again.scale, found.scale, rtol=1e-6)
    assert np.allclose(again.opacity, found.opacity, atol=1e-7)
    assert np.allclose(again.rotation, found.rotation, atol=1e-7)
    assert again.is_antialiased


def test_opacities_of_0_and_1_are_written_as_finite_logits(tmp_path):
    ends = Gaussians(
        *(np.ones((2, n), np.float32) for n in (3, 3, 4)), np.array([0.0, 1.0]), np.zeros((2, 3))
    )
    write_gaussians(tmp_path / "a.ply", ends)
    assert np.allclose(read_gaussians(tmp_path / "a.ply").opacity, [0, 1], atol=2e-7)


WRITTEN = {
    ".ply": EXACT,
    ".compressed.ply": FILES["compressed"][1],
    ".spz": FILES["spz 3"][1]._replace(position=1e-6),
    ".sog": OF_SOG[2]._replace(size=0.05, color=0.02, rest=0.02),
    ".splat": FILES["splat"][1],
}


@pytest.mark.parametrize("suffix", WRITTEN)
@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.each_value
def test_formats_are_written_as_they_are_read(tmp_path, suffix, width):
    scene = made.scene(count=700, width=width)
    start = read_gaussians(written(tmp_path / "a", made.trained_of(scene)))
    write_gaussians(tmp_path / f"b{suffix}", start)
    found = read_gaussians(tmp_path / f"b{suffix}")
    found = with_up(found, "-y")
    away = np.linalg.norm(found.position[:, None] - scene.position[None], axis=2)
    same = away.argmin(axis=1)
    assert len(set(same)) == 700
    ordered = made.Splats(*(part[same] for part in scene))
    errors = WRITTEN[suffix]  # and what the scene's own harmonics were rounded
    are_alike(found, ordered, errors._replace(rest=errors.rest + EXACT.rest))
    assert (found.up or "-y") == "-y"


def test_the_axis_up_is_that_of_the_format(tmp_path):
    y_up = read_gaussians(written(tmp_path / "a.spz", made.spz_of(SCENE, 3)))
    assert y_up.up == "y"
    write_gaussians(tmp_path / "b.splat", y_up)
    down = read_gaussians(tmp_path / "b.splat")
    assert np.allclose(np.sort(down.position[:, 1]), np.sort(-y_up.position[:, 1]))
    write_gaussians(tmp_path / "c.spz", down._replace(up="z"))
    turned = read_gaussians(tmp_path / "c.spz")
    assert np.allclose(np.sort(turned.position[:, 1]), np.sort(down.position[:, 2]), atol=1e-6)


def test_more_harmonics_than_a_palette_holds_are_its_nearest(tmp_path, monkeypatch):
    monkeypatch.setattr(sog, "LEVELS", 5)
    scene = made.scene(count=2000, width=3)
    base = np.random.default_rng(2).uniform(-1, 1, (20, 3, 3))[np.arange(2000) % 20]
    scene = scene._replace(rest=base + 0.01 * scene.rest)
    start = read_gaussians(written(tmp_path / "a", made.trained_of(scene)))
    write_gaussians(tmp_path / "b.sog", start)
    found = read_gaussians(tmp_path / "b.sog")
    same = np.linalg.norm(found.position[:, None] - scene.position[None], axis=2).argmin(axis=1)
    errors = found.harmonics * found.harmonic_step - scene.rest[same]
    assert np.abs(errors).max() < 0.03


def test_other_suffixes_and_numbers_are_refused(tmp_path):
    one = Gaussians(*(np.ones((1, n)) for n in (3, 3, 4)), np.ones(1), np.zeros((1, 3)))
    with pytest.raises(ValueError, match=r"a\.ksplat: Gaussians are written as \.ply, \.comp"):
        write_gaussians(tmp_path / "a.ksplat", one)
    with pytest.raises(ValueError, match="coordinate of 1e\\+07; SPZ holds"):
        write_gaussians(tmp_path / "a.spz", one._replace(position=np.full((1, 3), 1e7)))
    assert not list(tmp_path.iterdir())


def test_clouds_and_other_files_are_no_gaussians(tmp_path):
    cloud = {name: np.ones(3) for name in "xyz"}
    path = written(tmp_path / "a.ply", made.ply_of(cloud))
    assert not is_gaussians(path)
    assert not is_gaussians(tmp_path)
    assert not is_gaussians(tmp_path / "missing.spz")
    assert not is_gaussians(written(tmp_path / "a.json", b'{"means": 3}'))
    assert not is_gaussians(written(tmp_path / "a.nii.gz", gzip.compress(b"n+1")))
    assert not is_gaussians(written(tmp_path / "a.zip", made.zipped({"a": b""})))
    assert not is_gaussians(written(tmp_path / "b.zip", b"PK\3\4"))
    assert len(read_cloud(path).position) == 3


def test_a_missing_zstandard_names_its_extra(tmp_path, monkeypatch):
    path = written(tmp_path / "a.spz", made.spz_of(SCENE, version=4))
    monkeypatch.setitem(sys.modules, "numcodecs", None)
    with pytest.raises(ValueError, match=r"a\.spz: is SPZ of version 4.*hybrid-resample\[zstd\]"):
        read_gaussians(path)


def test_a_gaussian_of_degree_3_takes_146_bytes(tmp_path):
    found = read_gaussians(written(tmp_path / "a.ply", made.trained_of(SCENE)))
    assert sum(part.nbytes for part in found if isinstance(part, np.ndarray)) == 146 * 20


def test_activations_that_were_applied_before_writing_are_said(tmp_path, caplog):
    columns = made.trained_columns(SCENE)
    read_gaussians(written(tmp_path / "logits.ply", made.ply_of(columns)))
    assert not caplog.messages
    columns["opacity"] = SCENE.opacity
    columns.update({f"scale_{n}": SCENE.scale[:, n] for n in range(3)})
    read_gaussians(written(tmp_path / "twice.ply", made.ply_of(columns)))
    assert "as if activations had been applied" in caplog.messages[0]


def test_what_a_file_may_mean_is_said_once(tmp_path, capsys):
    columns = made.trained_columns(SCENE) | {"opacity": SCENE.opacity}
    columns |= {f"scale_{n}": SCENE.scale[:, n] for n in range(3)}
    path = written(tmp_path / "twice.ply", made.ply_of(columns))
    words = "render", path, "--size", "24x18", "-o", tmp_path / "out.png"
    assert commands.ended(cli.app, *words) == 0
    assert capsys.readouterr().err.count("as if activations had been applied") == 1


# Real files


@pytest.mark.parametrize(
    ("name", "count", "width"), [("biker.compressed.ply", 152_746, 0), ("playbot/3_0", 31_000, 8)]
)
def test_captured_scenes_are_read_whole(name, count, width):
    found = read_gaussians(real(f"splats/{name}"))
    assert found.harmonics.shape == (count, width, 3)
    assert 0.1 < np.median(found.opacity) < 1
    assert np.quantile(np.abs(found.position), 0.99) < 20


@pytest.mark.parametrize("name", ["minimal-raw", "minimal-v2", "minimal-v3", "minimal-v4"])
def test_other_writers_files_of_four_gaussians_are_read(name):
    found = read_gaussians(real(f"splats/formats/{name}.spz"))
    assert np.array_equal(np.abs(found.position), [[1, 0, 1], [0, 0, 1], [1, 0, 0], [0, 0, 0]])
    assert np.allclose(found.scale, 0.1, rtol=1 / 32)
    assert np.allclose(found.opacity, 0.9, atol=1 / 255)
    assert np.allclose(np.abs(found.rotation), [[1, 0, 0, 0]] * 4, atol=0.004)
    assert found.color[0, 0] < 0 < found.color[1, 0]


@pytest.mark.parametrize("suffix", ["splat", "ksplat"])
def test_another_writers_splat_file_of_four_gaussians_is_read(suffix):
    found = read_gaussians(real(f"splats/formats/minimal.{suffix}"))
    assert np.array_equal(found.position, [[-1, 0, -1], [0, 0, -1], [-1, 0, 0], [0, 0, 0]])
    assert np.array_equal(found.scale, np.full((4, 3), np.float32(0.1)))
    assert np.allclose(found.opacity, 0.9, atol=1 / 255)


def test_a_package_can_read_a_further_format(tmp_path, monkeypatch):
    fake = EntryPoint("two", "package:read_two", "resample.gaussians")
    monkeypatch.setattr(registry, "entry_points", EntryPoints([fake]).select)
    parts = (np.ones((1, n), np.float32) for n in (3, 3, 4))
    one = Gaussians(*parts, np.ones(1, np.float32), np.zeros((1, 3), np.float32))
    monkeypatch.setattr(EntryPoint, "load", lambda _: lambda path: path.stat() and one)
    path = tmp_path / "a.two"
    path.write_text("Gaussians")
    assert is_gaussians(path)
    np.testing.assert_array_equal(read_gaussians(path).position, one.position)
    assert not is_gaussians(path.rename(tmp_path / "a.splat"))
