"""Maps of clouds from above: truth is a formula's surface; files are read back by Pillow."""

from functools import partial

import numpy as np
import pytest
from PIL import Image

from resample.memory import allowing
from resample_points import Cloud, cli
from resample_points.painting import rasters
from resample_points.painting.rasters import raster_of, rasterized
from tests import commands
from tests.laser import las_of

ended, refused = partial(commands.ended, cli.app), partial(commands.refused, cli.app)
CORNER = np.array([435_000.0, 5_120_000.0, 250.0])
SIDE = 40.0  # scene units
WALLS = (10.3, 22.1, 12.4, 30.6)  # left, right, bottom, top of a roof
SCALE, TIE, KEYS, NODATA = 33550, 33922, 34735, 42113
PLANE, LAND = (
    'PROJCS["UTM 33N",{},AUTHORITY["EPSG","32633"]]',
    'GEOGCS["WGS 84",AUTHORITY["EPSG","4326"]]',
)
HEIGHTS = 'VERT_CS["NAVD88",AUTHORITY["EPSG","5703"]]'
COMPOUND = f'COMPD_CS["both",{PLANE.format(LAND)},{HEIGHTS}]'


def height(x, y):
    """Hills with a roof 14 units above."""
    left, right, bottom, top = WALLS
    is_roof = (x > left) & (x < right) & (y > bottom) & (y < top)
    return np.where(is_roof, 20 + 0.2 * x, 2 * np.sin(x / 5) + np.cos(y / 3))


def scan(count, seed=1):
    x, y = np.random.default_rng(seed).uniform(0, SIDE, (2, count))
    return np.stack([x, y, height(x, y)], axis=1)


def cloud_of(place, **columns):
    color = columns.pop("color", np.empty((0, 3), np.float32))
    return Cloud(place, np.empty((0, 3)), color, np.empty(0), columns)


def mapped(cloud, resolution, what="z", **options):
    bands = rasterized(cloud, raster_of(cloud, resolution), what, **options)
    return np.concatenate([values for _, values in bands])


def truth(resolution, parts=8):
    """Means (H, W) of the formula over cells, and which of them meet no wall within a unit."""
    side = round(SIDE / resolution)
    fine = (np.arange(side * parts) + 0.5) * resolution / parts
    whole = height(*np.meshgrid(fine, fine[::-1])).reshape(side, parts, side, parts)
    x = (np.arange(side) + 0.5) * resolution
    left, right, bottom, top = WALLS
    away_x = np.minimum(abs(x - left), abs(x - right))[None, :] > 1 + resolution
    away_y = np.minimum(abs(x - bottom), abs(x - top))[::-1, None] > 1 + resolution
    return whole.mean(axis=(1, 3)), away_x & away_y


@pytest.mark.parametrize(
    ("resolution", "error"), [(0.25, 0.04), (0.5, 0.03), (1.0, 0.02), (2.0, 0.02)]
)
def test_heights_are_those_of_the_surface(resolution, error):
    place, (expected, is_flat) = scan(8000) + CORNER, truth(resolution)
    found = mapped(cloud_of(place), resolution)[..., 0] - CORNER[2]
    assert found.shape == expected.shape
    assert np.isfinite(found).all()
    own = np.sqrt(np.mean((found - expected)[is_flat] ** 2))
    cell = (place - CORNER)[:, :2] // resolution
    number = ((SIDE / resolution - 1 - cell[:, 1]) * expected.shape[1] + cell[:, 0]).astype(int)
    counts = np.bincount(number, minlength=expected.size)
    means = np.bincount(number, place[:, 2] - CORNER[2], expected.size) / np.maximum(counts, 1)
    has = is_flat & (counts.reshape(expected.shape) > 0)
    of_means = np.sqrt(np.mean((means.reshape(expected.shape) - expected)[has] ** 2))
    assert own < error
    assert own < of_means  # the means of the points in each cell, as other software has them


def test_no_height_lies_between_a_roof_and_the_ground():
    found = mapped(cloud_of(scan(20_000)), 0.2)[..., 0]
    assert not ((found > 4) & (found < 20)).any()


def test_small_gaps_are_closed_and_large_ones_are_not():
    place = scan(8000)
    for x, y, radius in ((30.0, 10.0, 0.8), (30.0, 30.0, 5.0)):
        place = place[np.hypot(place[:, 0] - x, place[:, 1] - y) > radius]
    is_known = np.isfinite(mapped(cloud_of(place), 0.5)[..., 0])
    assert is_known[:40].mean() < 1  # north is up
    assert is_known[40:].all()
    assert not is_known[20, 60]
    assert is_known[20, 47]


def test_cells_begin_at_multiples_of_their_side():
    raster = raster_of(cloud_of(np.array([[0.29, -0.61, 0], [0.9, 0.6, 0]])), 0.3)
    np.testing.assert_allclose((raster.left, raster.top), (0.0, 0.9), atol=1e-15)
    assert (raster.height, raster.width) == (6, 4)  # 0.9 and 0.6 are the first places of cells


def test_bands_memory_and_order_change_nothing(monkeypatch):
    place = scan(6000)
    whole = mapped(cloud_of(place), 0.5)
    monkeypatch.setattr(rasters, "MOST_CELLS", 7 * whole.shape[1])
    assert mapped(cloud_of(place), 0.5).tobytes() == whole.tobytes()
    monkeypatch.setattr(rasters, "MOST_POINTS", 300)
    assert mapped(cloud_of(place), 0.5, threads=1).tobytes() == whole.tobytes()
    np.testing.assert_allclose(mapped(cloud_of(place[::-1]), 0.5), whole, rtol=1e-6)


def test_densities_count_every_point_once():
    place = scan(5000)
    found = mapped(cloud_of(place), 0.5, "density")
    assert found.sum() * 0.25 == 5000


def test_classes_are_those_of_points_and_colors_are_means_of_light():
    place = scan(20_000)
    number = np.where(place[:, 2] > 10, 6, 2).astype(np.uint8)
    color = np.where(place[:, 2:] > 10, np.float32([[1, 0, 0]]), np.float32([[0, 0, 1]]))
    color[::2, 1] = 1.0
    cloud = cloud_of(place, classification=number, color=color, gps_time=place[:, 0])
    assert set(np.unique(mapped(cloud, 0.7, "class"))) == {2, 6}
    light = mapped(cloud, 2.0, "color")
    assert abs(light[..., 1].mean() - 0.5) < 0.02
    assert np.isin(np.rint(light[..., [0, 2]]), (0, 1)).all()
    np.testing.assert_allclose(light[..., 0] + light[..., 2], 1, atol=1e-6)
    time = mapped(cloud, 2.0, "gps_time")[..., 0]  # x, which is even
    even, is_flat = np.broadcast_to(np.arange(1.0, SIDE, 2), (20, 20)), truth(2.0)[1]
    is_flat[:, [0, -1]] = False  # where points lie on one side
    np.testing.assert_allclose(time[is_flat], even[is_flat], atol=0.01)


def test_wrong_maps_are_refused():
    cloud = cloud_of(scan(10))
    for resolution in (0.0, -1.0, np.nan, 1e-18):
        with pytest.raises(ValueError, match=r"resolution|finer"):
            raster_of(cloud, resolution)
    with pytest.raises(ValueError, match="no colors"):
        mapped(cloud, 1.0, "color")
    with pytest.raises(ValueError, match="no column 'classification'"):
        mapped(cloud, 1.0, "class")
    with pytest.raises(ValueError, match="no points"):
        raster_of(cloud_of(np.empty((0, 3))), 1.0)


# ------------------------------------------------------------------------------------- the command


def tile(path, place, *, records=()):
    """Write a LAZ file with records of a coordinate system, as laspy writes it."""
    laspy = pytest.importorskip("laspy", reason="the extra las is not installed")
    pytest.importorskip("lazrs", reason="the extra las is not installed")
    number = np.where(place[:, 2] > 10, 6, 2)
    parts = dict(zip("xyz", (place + CORNER).T, strict=True)) | {"classification": number}
    parts |= {"red": number * 1000, "green": number * 900, "blue": number, "intensity": number}
    parts |= {"scan_angle": np.full(len(place), -1500)}
    path.write_bytes(las_of(parts, point_format=7, version="1.4"))
    with laspy.open(str(path)) as reader:
        points = reader.read()
    points.header.vlrs.extend(records)
    points.write(str(path), do_compress=True)


def words(text):
    laspy = pytest.importorskip("laspy", reason="the extra las is not installed")
    return laspy.VLR("LASF_Projection", 2112, "", text.encode() + b"\0")


@pytest.fixture
def tiles(tmp_path, monkeypatch):
    """The working folder, with two tiles and the whole of both."""
    monkeypatch.chdir(tmp_path)
    place = scan(6000)
    some = place[:, 0] < 17.3
    for name, part in (("a", place[some]), ("b", place[~some]), ("whole", place)):
        tile(tmp_path / f"{name}.laz", part, records=[words(COMPOUND)])
    return tmp_path


@pytest.mark.usefixtures("tiles")
def test_a_map_is_a_geotiff_in_its_place(capsys):
    assert ended("map", "whole.laz", "--resolution", "0.5", "-o", "z.tif") == 0
    assert "from 435000, 5120040 on, both" in capsys.readouterr().err
    with Image.open("z.tif") as image:
        tags, data = image.tag_v2, np.asarray(image)
        assert tags[SCALE] == (0.5, 0.5, 1.0)
        assert tags[TIE] == (0, 0, 0, 435_000, 5_120_040, 0)
        assert tags[NODATA] == "-9999"
        keys = dict(zip(tags[KEYS][4::4], tags[KEYS][7::4], strict=True))
        assert keys == {1024: 1, 1025: 1, 3072: 32633, 4096: 5703}
        assert data.dtype == np.float32
        expected, is_flat = truth(0.5)
        np.testing.assert_allclose(data[is_flat], expected[is_flat] + CORNER[2], atol=0.5)


@pytest.mark.usefixtures("tiles")
def test_neighbouring_tiles_have_no_seam():
    for what in ("z", "color", "class", "intensity", "density", "scan_angle"):
        options = ["--resolution", "0.7", "--what", what, "-o"]
        assert ended("map", "whole.laz", *options, "one.tif") == 0
        assert ended("map", "a.laz", "--also", "b.laz", *options, "two.tif") == 0
        one, two = (np.asarray(Image.open(name)) for name in ("one.tif", "two.tif"))
        np.testing.assert_allclose(one, two, rtol=1e-6)
        if what == "scan_angle":
            np.testing.assert_allclose(one, -9.0, rtol=1e-6)  # 0.006 degrees a step


@pytest.mark.usefixtures("tiles")
def test_a_map_of_the_ground_has_no_roof():
    assert ended("map", "whole.laz", "--only", "classification=2", "-o", "z.tif") == 0
    with Image.open("z.tif") as image:
        data = np.asarray(image)
        assert data[data > -9999].max() < CORNER[2] + 4
        assert image.tag_v2[SCALE][0] in (0.1, 0.2, 0.5)  # the points' distance is 0.52
        assert (data == -9999).any()


@pytest.mark.usefixtures("tiles")
def test_a_scan_larger_than_memory_has_the_same_map(monkeypatch):
    from resample_points.data import parts

    assert ended("map", "whole.laz", "--resolution", "0.5", "-o", "z.tif") == 0
    monkeypatch.setattr(parts, "memory_in_use", lambda: 0)
    monkeypatch.setattr(parts, "STEP", 700)
    with allowing("400kB"):
        assert ended("map", "whole.laz", "--resolution", "0.5", "-o", "files.tif") == 0
    one, two = (np.asarray(Image.open(name)) for name in ("z.tif", "files.tif"))
    assert one.tobytes() == two.tobytes()


def test_keys_of_a_scan_are_kept_and_two_systems_refused(tiles, capsys):
    laspy = pytest.importorskip("laspy", reason="the extra las is not installed")
    entries = np.array([(1, 1, 0, 2), (1024, 0, 1, 1), (3072, 0, 1, 25832)], "<u2")
    tile(
        tiles / "c.laz", scan(500),
        records=[laspy.VLR("LASF_Projection", 34735, "", entries.tobytes())],
    )  # fmt: skip
    assert ended("map", "c.laz", "-o", "c.tif") == 0
    with Image.open("c.tif") as image:
        assert image.tag_v2[KEYS][4:] == (1024, 0, 1, 1, 1025, 0, 1, 1, 3072, 0, 1, 25832)
    capsys.readouterr()
    told = refused(capsys, "map", "a.laz", "--also", "c.laz", "-o", "x.tif")
    assert "a.laz in both, c.laz in EPSG:25832" in told
    assert "maps are written as .tif" in refused(capsys, "map", "a.laz", "-o", "x.png")
    assert "no column 'gps'" in refused(capsys, "map", "a.laz", "--what", "gps", "-o", "x.tif")
    assert not list(tiles.glob("x.*"))


@pytest.mark.usefixtures("tiles")
def test_info_names_classes(capsys):
    assert ended("info", "whole.laz") == 0
    lines = capsys.readouterr().out
    assert '"2 ground": ' in lines
    assert '"6 building": ' in lines
