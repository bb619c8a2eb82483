"""Colors of clouds by columns of their files: read from every format, mapped and explained."""

import matplotlib
import numpy as np
import pytest

from resample.colors import from_srgb
from resample_points.data.cloud import Cloud
from resample_points.data.columns import UNKNOWN, Scale, colored, columns_of
from resample_points.files.readers import read_cloud

POSITION = np.random.default_rng(3).normal(size=(30, 3)).astype(np.float32)
INTENSITY = np.linspace(10, 20, 30, dtype=np.float32)
KIND = np.arange(30, dtype=np.uint8) % 4
NOTHING = np.zeros((0, 3), np.float32)
CLOUD = Cloud(
    POSITION, NOTHING, NOTHING, np.zeros(0, np.float32), {"intensity": INTENSITY, "class": KIND}
)


def _ply(path, encoding):
    kind = [*((name, "<f4") for name in "xyz"), ("intensity", "<f4"), ("class", "u1")]
    points = np.zeros(30, kind)
    for n, name in enumerate("xyz"):
        points[name] = POSITION[:, n]
    points["intensity"], points["class"] = INTENSITY, KIND
    header = f"ply\nformat {encoding} 1.0\nelement vertex 30\n"
    header += "".join(f"property float {name}\n" for name in ("x", "y", "z", "intensity"))
    header += "property uchar class\nend_header\n"
    rows = "".join(" ".join(map(repr, row)) + "\n" for row in points.tolist())
    body = rows.encode() if encoding == "ascii" else points.tobytes()
    path.write_bytes(header.encode() + body)


def _pcd(path, encoding):
    header = "FIELDS x y z intensity class _\nSIZE 4 4 4 4 4 4\nTYPE F F F F F F\n"
    header += f"COUNT 1 1 1 1 1 1\nPOINTS 30\nDATA {encoding}\n"
    table = np.column_stack([POSITION, INTENSITY, KIND, KIND]).astype(np.float32)
    rows = "".join(" ".join(f"{number:.9g}" for number in row) + "\n" for row in table)
    path.write_bytes(header.encode() + (rows.encode() if encoding == "ascii" else table.tobytes()))


def _text(path, first):
    table = np.column_stack([POSITION, INTENSITY, KIND])
    rows = "".join(", ".join(f"{number:.9g}" for number in row) + "\n" for row in table)
    path.write_text(first + rows)


WRITTEN = {
    "ascii.ply": lambda path: _ply(path, "ascii"),
    "binary.ply": lambda path: _ply(path, "binary_little_endian"),
    "ascii.pcd": lambda path: _pcd(path, "ascii"),
    "binary.pcd": lambda path: _pcd(path, "binary"),
    "named.csv": lambda path: _text(path, "x,y,z,intensity,class\n"),
    "named.txt": lambda path: _text(path, "\n//X Y Z intensity class\n"),
    "named.xyz": lambda path: _text(path, "# x y z intensity class\n"),
    "arrays.npz": lambda path: np.savez(
        path, position=POSITION, intensity=INTENSITY, **{"class": KIND}, about="a scan"
    ),
}


@pytest.mark.parametrize("name", WRITTEN)
def test_columns_are_read_from_every_format(tmp_path, name):
    WRITTEN[name](tmp_path / name)
    cloud = read_cloud(tmp_path / name)
    np.testing.assert_allclose(cloud.position, POSITION, rtol=1e-6)
    assert columns_of(cloud) == ["x", "y", "z", "intensity", "class"]
    np.testing.assert_allclose(cloud.columns["intensity"], INTENSITY, rtol=1e-6)
    np.testing.assert_array_equal(cloud.columns["class"], KIND)
    assert not len(cloud.color)


def test_names_in_text_may_say_colors_and_normals_too(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("X;Y;Z;Red;Green;Blue;nx;ny;nz;time\n1;2;3;255;0;51;0;0;1;7\n")
    cloud = read_cloud(path)
    np.testing.assert_allclose(cloud.color[0], from_srgb(np.array([1, 0, 0.2])), rtol=1e-6)
    np.testing.assert_array_equal(cloud.normal, [[0, 0, 1]])
    assert columns_of(cloud) == ["x", "y", "z", "time"]


def test_four_columns_of_text_are_a_place_and_a_value(tmp_path):
    path = tmp_path / "a.xyz"
    path.write_text("# made by hand\n1 2 3 40\n2 3 4 50\n")
    np.testing.assert_array_equal(read_cloud(path).columns["value"], [40, 50])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("x y z\n1 2 3 4\n", "names 3 columns and has 4"),
        ("1 2 3 4 5\n", "has 5 columns; known are x y z, .* or columns named by the first line"),
        ("one two\n1 2 three\n", "not a table of numbers"),
    ],
)
def test_text_without_sense_is_refused(tmp_path, content, message):
    path = tmp_path / "a.csv"
    path.write_text(content)
    with pytest.raises(ValueError, match=message):
        read_cloud(path)


def test_points_that_are_no_numbers_are_left_out_of_columns_too(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("x y z t\n0 0 0 1\nnan 0 0 2\n1 0 0 3\n")
    np.testing.assert_array_equal(read_cloud(path).columns["t"], [1, 3])


@pytest.mark.parametrize("colormap", ["viridis", "turbo", "gray"])
def test_colors_are_those_of_the_colormap(colormap):
    cloud, scale = colored(CLOUD, "intensity", colormap=colormap)
    assert scale == Scale("intensity", colormap, (10.0, 20.0))
    share = (INTENSITY.astype(np.float64) - 10) / 10
    expected = from_srgb(matplotlib.colormaps[colormap](share)[:, :3])
    np.testing.assert_allclose(cloud.color, expected, atol=1e-6)
    assert cloud.color.dtype == np.float32


def test_classes_have_colors_of_their_own():
    cloud, _ = colored(CLOUD, "class", colormap="tab10", span=(0, 9))
    expected = from_srgb(np.array(matplotlib.colormaps["tab10"].colors))[KIND]
    np.testing.assert_allclose(cloud.color, expected, atol=1e-6)


def test_height_is_a_column():
    cloud, scale = colored(CLOUD, "z", colormap="gray")
    assert scale.span == (POSITION[:, 2].min(), POSITION[:, 2].max())
    assert (np.diff(cloud.color[np.argsort(POSITION[:, 2]), 0]) >= 0).all()


@pytest.mark.parametrize("span", ["12,18", (12, 18), " 12 , 18 "])
def test_values_beyond_the_range_have_the_color_of_its_end(span):
    cloud, _ = colored(CLOUD, "intensity", colormap="gray", span=span)
    assert (cloud.color[INTENSITY < 12] == 0).all()
    assert (cloud.color[INTENSITY > 18] == 1).all()


def test_a_range_may_be_said_in_shares_of_the_points():
    _, scale = colored(CLOUD, "intensity", span="10%,90%")
    np.testing.assert_allclose(scale.span, np.quantile(INTENSITY, [0.1, 0.9]))


def test_points_without_a_value_are_gray():
    holes = np.where(np.arange(30) == 4, np.nan, INTENSITY)
    cloud, scale = colored(CLOUD._replace(columns={"t": holes}), "t")
    assert scale.span == (10.0, 20.0)
    np.testing.assert_allclose(cloud.color[4], UNKNOWN)


def test_equal_values_have_the_color_in_the_middle():
    cloud, _ = colored(CLOUD._replace(columns={"t": np.full(30, 7)}), "t", colormap="gray")
    np.testing.assert_allclose(cloud.color, from_srgb(np.array(0.5)), atol=5e-3)


@pytest.mark.parametrize(
    ("column", "choice", "message"),
    [
        ("time", {}, "no column 'time'; known: x, y, z, intensity, class"),
        ("z", {"colormap": "virids"}, "unknown colormap 'virids'.* viridis"),
        ("z", {"span": "1"}, "a range of '1'; give low,high"),
        ("z", {"span": "1,2,3"}, "give low,high"),
        ("z", {"span": "1,inf"}, "give low,high"),
        ("z", {"span": "-1%,50%"}, "give low,high"),
        ("class", {"span": "0%,5%"}, "a range of '0%,5%', which is from 0 to 0; give a wider"),
        ("z", {"span": (2, 1)}, "give the smaller first"),
    ],
)
def test_what_cannot_be_shown_is_refused(column, choice, message):
    with pytest.raises(ValueError, match=message) as caught:
        colored(CLOUD, column, **choice)
    assert "\n" not in str(caught.value)


def test_a_column_of_nothing_is_refused():
    with pytest.raises(ValueError, match="no finite value"):
        colored(CLOUD._replace(columns={"t": np.full(30, np.nan)}), "t")


def test_a_cloud_of_none_is_refused_in_words():
    with pytest.raises(ValueError, match="position of a cloud is None"):
        colored(CLOUD._replace(position=None), "z")


def test_columns_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match=r"column 't' has the shape \(3,\); it must be \(30,\)"):
        colored(CLOUD._replace(columns={"t": np.zeros(3)}), "t")
