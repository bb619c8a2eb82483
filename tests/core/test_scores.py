"""Scores: their record, the tables made of it, what judged commands may be told, and truths."""

import ast
import math
from argparse import Namespace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageSequence

from benchmarks.scores import clouds, gaussian_truth, images, pages, record, volume_truth
from benchmarks.scores.__main__ import judged, parsed
from benchmarks.scores.depth_scene import matrix_of, pose_of, projected, shapes
from benchmarks.scores.gaussian_truth import WIDENING, Gaussians, rasterized
from benchmarks.scores.judging import Call, Judge, Row, db
from benchmarks.scores.kernels import fine_rays, triangles, warps
from benchmarks.scores.kernels import gaussians as gaussian_kernels
from benchmarks.scores.kernels import scene as scene_kernels
from benchmarks.scores.options import SAYS_HOW, SAYS_WHAT, label, options
from benchmarks.scores.pictures import View, read_png, to_levels, to_light, write_png
from benchmarks.scores.volume_files import write_ome

RECORD = record.read()
ROWS = [row for taken in RECORD.values() for row in taken.rows]
COMMANDS = sorted({command for row in ROWS for command in row.commands})
SOURCES = sorted(Path(pages.__file__).parent.rglob("*.py"))
PRODUCT = ("resample", "tests")


def plain(compiled):
    """The Python of a compiled loop, so that nothing is compiled."""
    return getattr(compiled, "py_func", compiled)


# The record and its tables


@pytest.mark.parametrize("page", pages.PAGES, ids=lambda page: page.stem)
def test_tables_of_a_page_are_those_of_the_record(page):
    text = page.read_text(encoding="utf-8")
    assert pages.BLOCK.search(text)
    assert pages.rendered(text, RECORD) == text


def test_all_groups_are_on_record_with_rows():
    assert list(RECORD) == list(record.GROUPS)
    assert all(taken.rows for taken in RECORD.values())


@pytest.mark.parametrize("group", record.GROUPS)
def test_every_row_is_in_one_table(group):
    shown = [
        row.case
        for table in pages.QUALITY
        for _, row in pages.matches(table, RECORD)
        if table.group == group
    ]
    timed = [row.case for row in RECORD[group].rows if row.unit in pages.TIMES]
    assert sorted(shown + timed) == sorted(row.case for row in RECORD[group].rows)


def test_the_front_page_shows_rows_that_exist():
    listed = {group: {row.case for row in taken.rows} for group, taken in RECORD.items()}
    assert all(set(cases) <= listed[group] for group, cases in pages.SUMMARY.items())


def test_rows_that_are_behind_are_listed_as_such():
    text = pages.behind(RECORD)
    behind = [row for row in ROWS if row.is_behind() and row.unit not in pages.TIMES]
    assert text.count("\n") == len(behind) + 2
    assert all(f"| {row.case} |" in text for row in behind)


def test_a_group_replaces_its_own_rows_alone(tmp_path):
    file, other = tmp_path / "scores.json", Row("case", 1.0, 2.0, "peer", "dB")
    record.write(RECORD, file)
    taken = RECORD["depth"]._replace(rows=[other])
    record.write({**record.read(file), "depth": taken}, file)
    assert record.read(file) == {**RECORD, "depth": taken}


@pytest.mark.parametrize(
    ("ours", "peer", "sign", "gap", "is_behind"),
    [
        (40.0, 38.0, 1, 2.0, False),
        (38.0, 40.0, 1, -2.0, True),
        (3.0, 5.0, -1, 2.0, False),
        (40.0, 40.004, 1, 0.0, False),
        (4.0, 4.0, 0, 0.0, False),
        (5.0, 4.0, 0, -1.0, True),
        (40.0, None, 1, None, False),
        (None, 40.0, 1, None, True),
    ],
)
def test_a_row_says_how_far_it_is_ahead(ours, peer, sign, gap, is_behind):
    row = Row("case", ours, peer, "peer", "dB", sign)
    assert (row.gap(), row.is_behind()) == (gap, is_behind)


def test_the_better_figure_is_bold():
    assert pages.both(Row("", 31.0, 30.0, "peer", "dB")) == "**31.00** / 30.00"
    assert pages.both(Row("", 31.0, 30.0, "peer", "%", -1)) == "31.0 / **30.0**"
    assert pages.both(Row("", 4.0, 4.0, "asked", "files", 0)) == "4 / 4"


# What commands are told


def test_judged_commands_have_only_options_that_are_allowed():
    assert len(COMMANDS) > 30
    assert {name for command in COMMANDS for name in options(command)} <= {*SAYS_WHAT, *SAYS_HOW}


def test_a_cell_that_is_called_default_passes_no_option():
    defaults = [row for row in ROWS if label(row.commands) == "default"]
    assert len(defaults) > 100
    for row in defaults:
        assert row.commands
        assert all(set(options(command)) <= set(SAYS_WHAT) for command in row.commands)


@pytest.mark.parametrize("table", pages.QUALITY, ids=lambda table: table.cases)
def test_tables_call_nothing_else_default(table):
    found = [label(row.commands) for _, row in pages.matches(table, RECORD)]
    lines = pages.rendered_table(table, RECORD).splitlines()
    if "options" in lines[0]:
        assert [line.split(" | ")[-1].rstrip(" |") for line in lines[2:]] == found
    else:
        assert set(found) == {"default"}


def test_options_of_a_command_are_found():
    command = "resample-points render a.ply --camera=3,4 --order rays --edl -o out.png"
    assert options(command) == {"--camera": "3,4", "--order": "rays", "--edl": "", "-o": "out.png"}
    assert label([command]) == "`--edl  --order rays`"
    assert label(["resample-points render a.ply --size 3x4 -o out.png"]) == "default"


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.stem)
def test_truths_import_nothing_of_the_product(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    names = [node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    names += [a.name for node in ast.walk(tree) if isinstance(node, ast.Import) for a in node.names]
    ours = [name for name in names if name.startswith(PRODUCT)]
    assert ours == (["resample_texture"] if path.stem == "timed_warp" else [])
    assert all(
        name.startswith("benchmarks.scores") for name in names if name.startswith("benchmarks")
    )


# Runs


def test_a_command_is_run_and_its_picture_judged(tmp_path):
    picture = np.random.default_rng(7).integers(0, 256, (8, 12, 3), np.uint8)
    write_png(tmp_path / "source.png", picture)
    judge = Judge(tmp_path)
    call = judge.call("texture", "rotate", tmp_path / "source.png", "out.png", "--degrees", 90)
    made = np.rint(255 * read_png(tmp_path / "out.png")[0]).astype(np.uint8)
    judge.add("turned", np.array_equal(made, np.rot90(picture)), {"asked": 1}, calls=[call], sign=0)
    assert judge.rows[0].gap() == 0
    assert judge.rows[0].commands == ("resample-texture rotate source.png out.png --degrees 90",)
    assert 0 < call.cpu < 100


def test_of_peers_the_best_counts(tmp_path):
    judge, call = Judge(tmp_path), Call("resample-texture warp a.png", 1.0)
    judge.add("more is better", 1, {"a": 3.0, "b": 2.0}, calls=[call])
    judge.add("less is better", 1, {"a": 3.0, "b": 2.0}, calls=[call], sign=-1)
    judge.add("a command that failed", math.nan, {}, calls=[call, call])
    assert [(row.peer, row.name) for row in judge.rows] == [(3.0, "a"), (2.0, "b"), (None, "-")]
    assert judge.rows[2].ours is None
    assert judge.rows[2].commands == (call.command,)


def test_rows_without_data_are_skipped_and_named(tmp_path, capsys):
    taken = judged("images", Namespace(data=tmp_path, quick=True))
    assert taken.rows == []
    assert "textures/kodim19.png is not in" in taken.skipped[0]
    assert "left out: textures/kodim19.png" in capsys.readouterr().out


def test_an_unknown_group_is_refused_with_the_known_ones(capsys):
    with pytest.raises(SystemExit):
        parsed(["image"])
    assert "there is no group image; there are images, gaussians" in capsys.readouterr().err


# Truths in closed form


def test_means_of_waves_have_a_closed_form():
    assert images.wave().holds


def test_samples_lie_on_the_surface_and_the_street_is_where_it_should():
    assert all(finding.holds for finding in clouds.closed_forms())


def test_light_and_levels_are_inverse():
    levels = np.arange(256) / 255
    np.testing.assert_allclose(to_levels(to_light(levels)), levels, atol=1e-9)
    assert to_light(np.array([1.0])) == 1
    assert db(np.zeros(5), np.full(5, 0.1)) == pytest.approx(20)


def test_a_round_gaussian_is_widened_by_training(monkeypatch):
    monkeypatch.setattr(gaussian_truth, "composite", plain(gaussian_kernels.composite))
    color, upright = np.array([[1.0, 0.5, 0.25]]), np.array([[1.0, 0, 0, 0]])
    place, width = np.array([[0, 0, 10.0]]), np.full((1, 3), 0.2)
    one = Gaussians(place, width, upright, np.array([0.8]), color)
    found = rasterized(one, View(np.eye(3), np.zeros(3), 100.0, (16.0, 16.0)), (32, 32))
    y, x = np.mgrid[:32, :32] + 0.5 - 16
    alpha = 0.8 * np.exp(-0.5 * (x * x + y * y) / (2**2 + WIDENING))
    alpha[alpha < 1 / 255] = 0
    np.testing.assert_allclose(found, alpha[..., None] * color, atol=1e-12)


def test_rays_meet_gaussians_in_the_order_of_their_depths():
    out, eye = np.zeros((1, 3)), np.stack([np.eye(3) / 0.1] * 2)
    position = np.einsum("nij,nj->ni", eye, np.array([[0, 0, 10.0], [0, 0, 5.0]]))
    color = np.array([[1.0, 0, 0], [0, 1.0, 0]])
    given = (position, eye, np.array([0.8, 0.5]), color, out)
    plain(gaussian_kernels.composite_rays)(np.zeros((1, 2)), *given)
    np.testing.assert_allclose(out, [[0.4, 0.5, 0]], atol=1e-12)


def test_a_triangle_has_the_depth_of_its_plane():
    depth = np.full((8, 8), np.inf)
    corners = np.array([[[-9, -9, 4.0], [9, -9, 4.0], [0, 9, 4.0]]])
    plain(triangles.nearest_depths)(corners, 2.0, 4.0, 4.0, depth)
    assert depth[4, 4] == pytest.approx(4)
    assert np.isinf(depth[7, 0])


def test_a_linear_field_is_met_exactly():
    field = np.arange(5.0) + 10 * np.arange(4.0)[:, None] + 100 * np.arange(3.0)[:, None, None]
    value = plain(fine_rays.trilinear)
    assert value(field, 1.25, 2.5, 0.75) == pytest.approx(1.25 + 25 + 75)
    assert value(field, -0.1, 1, 1) == value(field, 1, 3.5, 1) == fine_rays.OUTSIDE


def test_extinction_is_that_of_opacities_between_points():
    at, opacity = np.array([0.0, 100.0, 200.0]), np.array([0.0, 0.2, 0.6])
    found = [plain(fine_rays.extinction)(value, at, opacity) for value in (-5, 50, 150, 300)]
    np.testing.assert_allclose(found, -np.log(1 - np.array([0, 0.1, 0.4, 0.6])))


def test_a_ball_is_zero_at_its_surface():
    field = volume_truth.ball((25, 25, 25), (1, 1, 1), 8.0)
    assert field[12, 12, 20] == 0
    assert field[12, 12, 12] == 400


def test_peers_without_motion_give_the_picture_back():
    color, depth = np.random.default_rng(7).random((6, 7, 3)), np.full((6, 7), 4.0)
    matrix = matrix_of(7, 6)
    u, v, z = projected(depth, matrix, np.eye(4))
    picture, best = np.zeros((6, 7, 3)), np.zeros((6, 7))
    plain(warps.draw_triangles)(color, u, v, z, 1, True, picture, best)
    np.testing.assert_allclose(picture, color, atol=1e-9)
    total, weight = np.zeros((6, 7, 3)), np.zeros((6, 7))
    plain(warps.add_softly)(color, u, v, z, 5.0, 4.0, total, weight)
    np.testing.assert_allclose(total / weight[..., None], color, atol=1e-9)


def test_a_camera_that_moves_to_the_right_moves_what_it_sees_to_the_left():
    matrix, depth = matrix_of(20, 10), np.full((10, 20), 2.0)
    u, v, z = projected(depth, matrix, pose_of((0.5, 0, 0)))
    np.testing.assert_allclose(u - (np.arange(20) + 0.5), -0.5 * matrix[0, 0] / 2)
    np.testing.assert_allclose(v, np.broadcast_to(np.arange(10)[:, None] + 0.5, (10, 20)))
    np.testing.assert_allclose(z, 2)


def test_rays_meet_the_nearest_shape():
    found = plain(scene_kernels.hit)(shapes(), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    assert found == (9.0, 0)  # the back wall
    length, which = plain(scene_kernels.hit)(shapes(), (-1.6, 0.9, 0.0), (0.0, 0.0, 1.0))
    assert (length, which) == (pytest.approx(5.0 - 1.1), 3)


def test_an_ome_tiff_has_its_values_and_sizes(tmp_path):
    values = np.random.default_rng(7).integers(0, 4000, (2, 3, 5, 4)).astype(np.uint16)
    write_ome(tmp_path / "a.ome.tif", values, (0.2, 0.2, 0.5))
    with Image.open(tmp_path / "a.ome.tif") as file:
        assert 'SizeC="2" SizeZ="3" SizeY="5" SizeX="4"' in file.tag_v2[270]
        assert 'PhysicalSizeZ="0.5"' in file.tag_v2[270]
        pages_of_file = [np.asarray(page) for page in ImageSequence.Iterator(file)]
    np.testing.assert_array_equal(pages_of_file, values.reshape(6, 5, 4))
