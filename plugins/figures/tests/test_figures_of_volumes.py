"""The paper's figures: what is drawn is what the renderer does, and files say what they show."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

from resample.files.images import read_image
from resample.painting.choices import Footprint, Primitive
from resample.profiles.orders import EverySample
from resample.resampler import Resampler
from resample_comparisons.volume.painting import AxisSheets
from resample_figures import footprints, gallery, popping, schematic, timing
from resample_figures import volumes as paper
from resample_figures.footprints import KernelBall
from resample_figures.volumes import VolumeFolder, write_numbers
from resample_volume.files.source import generate, write_volume

SMALL = "vessel-tree:size=24"


@pytest.fixture
def nothing_fetched(tmp_path, monkeypatch):
    """Folder of downloads, which is empty; stand-ins are small."""
    cache = tmp_path / "cache"
    monkeypatch.setenv("HYBRID_RESAMPLE_DATA", str(cache))
    monkeypatch.setattr(paper, "STAND_INS", {"skull": "vis_male", "aneurism": SMALL})
    return cache


@pytest.fixture
def shelf(nothing_fetched):
    """A folder that holds an Engine, and a vis_male for the Skull."""
    folder = nothing_fetched.with_name("volumes")
    folder.mkdir()
    for name in ("engine", "vis_male"):
        write_volume(folder / f"{name}.nrrd", generate(SMALL))
    return VolumeFolder(folder)


def numbers(folder, name):
    """Rows of the CSV file and content of the JSON file."""
    with (folder / f"{name}.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return rows, json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))


# Which figures there are.


def test_no_numbers_mean_all_figures():
    assert paper.chosen_figures(None) == ["1-2", "3-4", "7", "8", "9"]


def test_halves_of_a_figure_stand_for_the_whole():
    assert paper.chosen_figures(["8", "2", "1"]) == ["1-2", "8"]


@pytest.mark.parametrize("number", ["5", "10", "", "8a"])
def test_an_unknown_figure_lists_the_known_ones(number, tmp_path):
    with pytest.raises(ValueError, match="there are 1-2, 3-4, 7, 8, 9"):
        paper.make(tmp_path / "new", [number])
    assert not (tmp_path / "new").exists()


def test_a_missing_folder_of_volumes_is_refused(tmp_path):
    with pytest.raises(NotADirectoryError, match="no such folder of volumes"):
        paper.make(tmp_path, ["8"], tmp_path / "absent")


# Where volumes come from.


@pytest.mark.sweep
def test_a_volume_of_the_folder_is_shown_as_itself(shelf):
    subject = shelf.subject("engine")
    assert (subject.name, subject.title, subject.note) == ("engine", "Engine", "")


@pytest.mark.sweep
def test_a_downloaded_volume_needs_no_folder(shelf, monkeypatch):
    monkeypatch.setenv("HYBRID_RESAMPLE_DATA", str(shelf.folder))
    assert VolumeFolder().subject("engine").name == "engine"


def test_a_stand_in_says_what_it_stands_in_for(shelf):
    subject = shelf.subject("skull")
    assert subject.title == "vis_male (for Skull)"
    assert "resample-volume fetch skull" in subject.note


@pytest.mark.sweep
def test_a_generated_stand_in_says_that_it_is_generated(shelf):
    assert f"the generated {SMALL} stands in" in shelf.subject("aneurism").note


@pytest.mark.sweep
def test_the_skull_itself_is_shown_where_it_is(shelf):
    write_volume(shelf.folder / "skull.nrrd", generate(SMALL))
    assert shelf.subject("skull").title == "Skull"


@pytest.mark.usefixtures("nothing_fetched")
def test_a_volume_without_stand_in_is_missing():
    assert VolumeFolder().subject("lobster") is None


# Files.


def test_numbers_of_both_files_are_the_same(tmp_path):
    write_numbers(tmp_path, "f", [{"a": 0.1}, {"a": 1 / 3, "b": None}], {"note": "x"})
    rows, content = numbers(tmp_path, "f")
    assert rows == [{"a": "0.1", "b": ""}, {"a": str(1 / 3), "b": ""}]
    assert content == {"note": "x", "rows": [{"a": 0.1}, {"a": 1 / 3, "b": None}]}


# Figures 1 and 2.


@pytest.fixture(scope="module")
def layer():
    return schematic.cut(generate("checker-box:size=8,block=2"), "checker", "box")


@pytest.mark.sweep
def test_drawn_splats_are_those_that_the_renderer_paints(layer):
    frame = schematic.resampler()(
        layer.samples, layer.camera, height=layer.width, width=layer.width
    )
    assert frame.statistics.splats == layer.is_splat.sum() > 0
    assert frame.statistics.points == (~layer.is_splat).sum() > 0


def test_the_dotted_line_divides_points_from_splats(layer):
    aside, ahead, spacing = schematic.boundary(layer)
    column = np.abs(aside - layer.place[:, :1]).argmin(axis=1)
    row = np.abs(ahead - layer.place[:, 1:]).argmin(axis=1)
    # A step of the grid changes the spacing by a hundredth.
    clear = np.abs(layer.spacing - schematic.THRESHOLD) > 0.02
    drawn = spacing[row, column] > schematic.THRESHOLD
    assert (drawn == layer.is_splat)[clear].all()


def test_turns_go_from_near_to_far(layer):
    depth = layer.footprints["depth"][np.argsort(layer.rank)]
    assert (np.diff(depth) >= 0).all()


@pytest.mark.sweep
def test_figures_1_and_2_count_what_they_draw(shelf, tmp_path):
    schematic.make(tmp_path, shelf, quick=True)
    rows, content = numbers(tmp_path, "figure-1-2")
    splats = [row for row in rows if row["figure"] == "2" and row["primitive"] == "splat"]
    assert len(splats) == content["2"]["splats"]
    assert read_image(tmp_path / "figure-1-2.png").shape[1] > 1000


@pytest.mark.sweep
@pytest.mark.usefixtures("nothing_fetched")
def test_figure_2_says_that_it_shows_another_volume(tmp_path):
    said = schematic.make(tmp_path, VolumeFolder(), quick=True)
    assert "Engine is not there" in said


# Figures 3 and 4.

SPHERE = KernelBall(35.0, 12.0, 40.0)


def touching_rays(sphere, count=24):
    """Rays (count, 2) that touch a sphere, found by halving along lines on the image plane."""
    inside = sphere.center[:2] / sphere.center[2]
    found = []
    for around in np.linspace(0, 2 * np.pi, count, endpoint=False):
        way = np.array([np.cos(around), np.sin(around)])
        low, high = 0.0, 10.0
        for _ in range(60):
            middle = (low + high) / 2
            ray = np.append(inside + middle * way, 1.0)
            along = sphere.center @ ray / (ray @ ray)
            gap = np.linalg.norm(sphere.center - along * ray)
            low, high = (middle, high) if gap < sphere.radius else (low, middle)
        found.append(inside + low * way)
    return np.array(found)


def test_the_ellipse_that_is_drawn_goes_through_the_rays_that_touch():
    center, axes = footprints.ellipse_of(footprints.record_of(SPHERE, Footprint.CORRECTED))
    offset = np.linalg.solve(axes, (touching_rays(SPHERE) - center).T)
    np.testing.assert_allclose(np.linalg.norm(offset, axis=0), 1.0, atol=1e-6)  # float32 records


def test_tangent_rays_touch():
    ellipse = footprints.distance_of(SPHERE, footprints.tangent_rays(SPHERE))
    np.testing.assert_allclose(ellipse, 1.0, atol=1e-12)


def test_the_midpoint_is_not_the_projected_center():
    center, _ = footprints.ellipse_of(footprints.record_of(SPHERE, Footprint.CORRECTED))
    ends = np.tan(np.radians([SPHERE.angle - SPHERE.cone, SPHERE.angle + SPHERE.cone]))
    assert np.linalg.norm(center) == pytest.approx(ends.mean(), rel=1e-6)
    projected = np.linalg.norm(SPHERE.center[:2]) / SPHERE.center[2]
    assert np.linalg.norm(center) > projected + 0.03


@pytest.fixture(scope="module")
def errors():
    choices = footprints.ErrorGrid((1, 15, 30), (30, 45), (5,), 60)
    rows = footprints.error_rows(choices)
    return {(row["angle_deg"], row["cone_deg"], row["model"]): row for row in rows}


@pytest.mark.parametrize(("angle", "cone"), [(0, 1), (0, 30), (30, 5), (45, 5)])
@pytest.mark.parametrize("kind", ["index_error", "footprint_error", "picture_error"])
def test_the_exact_footprint_has_no_error(errors, angle, cone, kind):
    assert errors[angle, cone, "exact"][kind] < 1e-5  # table of 1024 steps, float32


@pytest.mark.parametrize(("cone", "error"), [(1, 6.0e-5), (15, 1.3e-2), (30, 5.5e-2)])
def test_on_the_axis_the_index_errs_by_what_a_search_over_the_formula_finds(errors, cone, error):
    index = np.linspace(0, 1, 2001)
    alpha = np.radians(cone)
    by_hand = np.abs(np.sin(np.arctan(index * np.tan(alpha))) / np.sin(alpha) - index).max()
    found = errors[0, cone, "ellipse, index i"]["index_error"]
    assert found == pytest.approx(by_hand, rel=0.01)  # 60 distances
    assert found == pytest.approx(error, rel=0.05)  # as published with the design, two digits


@pytest.mark.parametrize("cone", [1, 15, 30])
def test_the_printed_form_is_worse_than_no_correction(errors, cone):
    printed = errors[0, cone, "corrected as printed"]
    assert printed["index_error"] > 2 * errors[0, cone, "ellipse, index i"]["index_error"]
    assert printed["footprint_error"] > 1000 * errors[0, cone, "corrected"]["footprint_error"]


def test_off_the_axis_the_correction_does_not_help(errors):
    corrected = errors[45, 5, "corrected"]["footprint_error"]
    assert corrected == pytest.approx(
        errors[45, 5, "ellipse, index i"]["footprint_error"], rel=0.02
    )


def test_the_disc_errs_alike_at_all_angles(errors):
    on, off = (errors[angle, 5, "disc"]["footprint_error"] for angle in (30, 45))
    assert on == pytest.approx(off, rel=1e-6)


@pytest.mark.parametrize("model", ["affine", "corrected", "projected", "exact"])
def test_pictures_err_as_the_rays_say(errors, model):
    row = errors[30, 5, model]
    # Pixels need not hit the worst ray.
    assert row["picture_error"] == pytest.approx(row["footprint_error"], rel=0.1, abs=1e-5)


@pytest.mark.sweep
def test_figures_3_and_4_write_the_errors(tmp_path):
    footprints.make(tmp_path, VolumeFolder(), quick=True)
    rows, content = numbers(tmp_path, "figure-3-4")
    assert {row["model"] for row in rows} == set(footprints.COLORS)
    assert content["ellipse"]["largest_error_at_tangent_rays"] < 1e-6  # float32 records
    assert (tmp_path / "figure-3-4.png").is_file()


# Figure 7.


@pytest.fixture(scope="module")
def scene():
    return popping.scene_of(replace(popping.QUICK, first=44.0, last=46.0))


def test_jumps_are_second_differences_of_what_a_screen_shows(scene):
    resample = Resampler(order=EverySample())
    curve = popping.popping(scene, resample)
    angle = curve.azimuth[1]
    before, here, after = (
        np.clip(scene.picture(resample, angle + turn, scene.choices.side)[..., :3], 0, 1)
        for turn in (-0.5, 0.0, 0.5)
    )
    encoded = [
        np.where(c <= 0.0031308, 12.92 * c, 1.055 * np.maximum(c, 1e-9) ** (1 / 2.4) - 0.055)
        for c in (before, here, after)
    ]
    jump = 255 * (encoded[0] - 2 * encoded[1] + encoded[2])
    assert curve.rms[1] == pytest.approx(np.sqrt((jump**2).mean()), rel=1e-3)  # float32
    assert curve.largest[1] == pytest.approx(np.abs(jump).max(), rel=1e-3)


def test_axis_sheets_pop_at_45_degrees(scene):
    curve = popping.popping(scene, Resampler(order=AxisSheets()))
    assert curve.azimuth[np.argmax(curve.rms)] == pytest.approx(45.0, abs=0.6)  # a step


@pytest.mark.sweep
def test_figure_7_writes_views_of_every_order(tmp_path, monkeypatch):
    short = replace(popping.QUICK, first=44.0, last=46.0)
    monkeypatch.setattr(popping, "QUICK", short)
    said = popping.make(tmp_path, VolumeFolder(), quick=True)
    rows, content = numbers(tmp_path, "figure-7")
    assert {row["order"] for row in rows} == set(popping.ORDERS) == set(content["orders"])
    names = {
        f"figure-7{view}-{order.replace(' ', '-')}.png" for view in "ab" for order in popping.ORDERS
    }
    names |= {"figure-7.png", "figure-7-popping.png", "figure-7.csv", "figure-7.json"}
    assert {path.name for path in tmp_path.iterdir()} == names
    assert "axis-sheets" in said


# Figure 8.


@pytest.mark.sweep
def test_figure_8_shows_what_is_there_and_says_what_is_not(shelf, tmp_path):
    said = gallery.make(tmp_path, shelf, quick=True)
    rows, content = numbers(tmp_path, "figure-8")
    assert [row["picture"][8] for row in rows] == list("abcde")
    assert [row["volume"] for row in rows] == [SMALL] * 3 + ["engine", "vis_male"]
    assert "vis_male stands in" in said
    assert any("figure-8f is left out" in note for note in content["notes"])
    assert not (tmp_path / "figure-8f.png").exists()


def test_pictures_of_figure_8_are_opaque_squares(shelf, tmp_path):
    gallery.make(tmp_path, shelf, quick=True)
    picture = read_image(tmp_path / "figure-8d.png")
    assert picture.shape == (gallery.QUICK_SIDE, gallery.QUICK_SIDE, 3)
    assert picture.max() > 0.1


@pytest.mark.sweep
@pytest.mark.slow
def test_figure_8a_marks_splats_in_red_and_has_points_too(volumes, tmp_path):
    gallery.make(tmp_path, VolumeFolder(volumes))
    rows, _ = numbers(tmp_path, "figure-8")
    marked = rows[0]
    assert min(int(marked["points"]), int(marked["splats"])) > 0.2 * int(marked["samples"])


# Figure 9.


@pytest.fixture(scope="module")
def box():
    return timing.case_of("checker-box", VolumeFolder(), timing.QUICK)


def share_of_splats(case, zoom, side):
    """By painting."""
    resample = Resampler(primitive=Primitive.PAPER, threshold=1.0)
    frame = resample(case.samples, case.camera(zoom, side), height=side, width=side)
    counted = frame.statistics.points + frame.statistics.splats
    assert counted == frame.statistics.samples  # hidden ones too
    return frame.statistics.splat_fraction


@pytest.mark.sweep
def test_views_of_figure_9_have_the_papers_shares_of_splats(box):
    zoom = timing.zooms(box, 24)
    assert share_of_splats(box, zoom["all splats"], 24) == 1.0
    # Samples change sides one after another: 512 of them.
    assert share_of_splats(box, zoom["mixed"], 24) == pytest.approx(0.466, abs=0.02)
    assert share_of_splats(box, zoom["all points"], 24) == 0.0


def test_spacing_is_known_of_what_is_out_of_sight(box):
    spacing = box.spacing(timing.NEAREST, 24)
    assert (spacing > 0).all()


def test_the_least_value_comes_as_near_to_the_count_as_can_be():
    volume = generate(SMALL)
    least = timing.least_value(volume, 500)
    counts = np.array([(volume.values >= value).sum() for value in range(256)])
    assert abs((volume.values >= least).sum() - 500) == np.abs(counts - 500).min()


@pytest.mark.sweep
def test_figure_9_has_three_views_of_each_volume_that_is_there(shelf, tmp_path, monkeypatch):
    some = {name: timing.PAPER[name] for name in ("lobster", "skull", "checker-box")}
    monkeypatch.setattr(timing, "PAPER", some)
    said = timing.make(tmp_path, shelf, quick=True)
    rows, content = numbers(tmp_path, "figure-9")
    assert [row["view"] for row in rows] == ["all splats", "mixed", "all points"] * 2
    assert "Lobster is not there" in said
    assert any("Lobster" in note for note in content["notes"])
    assert rows[0]["volume"] == "vis_male (for Skull)"
    assert all(float(row["hybrid_ms"]) > 0 for row in rows)
    rivals = [float(row[f"{name}_ms"]) for row in rows[1::3] for name in timing.BASELINES]
    assert min(rivals) > 0


@pytest.mark.sweep
def test_figure_9_says_why_there_is_no_time_of_vtk(tmp_path, monkeypatch):
    def refuse(*_, **__):
        raise ValueError("VTK is not installed")

    monkeypatch.setattr(timing, "VtkRenderer", refuse)
    monkeypatch.setattr(timing, "PAPER", {"checker-box": timing.PAPER["checker-box"]})
    said = timing.make(tmp_path, VolumeFolder(), quick=True)
    rows, _ = numbers(tmp_path, "figure-9")
    assert "no times of VTK: VTK is not installed" in said
    assert [row["vtk_ms"] for row in rows] == ["", "", ""]


@pytest.mark.sweep
@pytest.mark.slow
@pytest.mark.parametrize("name", ["engine", "lobster", "aneurism"])
def test_figure_9_paints_as_many_voxels_as_the_paper(name, volumes):
    case = timing.case_of(name, VolumeFolder(volumes), timing.QUICK)
    assert len(case.samples.position) == timing.PAPER[name].voxels


@pytest.mark.sweep
def test_all_figures_together(shelf, tmp_path):
    said = paper.make(tmp_path / "out", ["1", "8"], shelf.folder, quick=True)
    assert said.startswith("figures 1 and 2")
    assert "figure 8" in said
    assert (tmp_path / "out" / "figure-8.png").is_file()
