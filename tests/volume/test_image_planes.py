"""Planes that show values: against SciPy's interpolation, formulas, and each other."""

from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates

from resample.cameras.models import Camera, Orthographic
from resample.colors import from_srgb, to_srgb
from resample.painting.choices import Projection
from resample.profiles.orders import Rays
from resample.resampler import Resampler
from resample_volume import meshes as image_planes
from resample_volume.appearance import Appearance
from resample_volume.calls import render
from resample_volume.classification.transfer import from_points
from resample_volume.inputs import as_volume
from resample_volume.meshes import ImagePlane, outline, settled
from resample_volume.rendering import Subject
from resample_volume.scenes import Scene
from resample_volume.voxels.shading import DepthCue, Light
from resample_volume.voxels.visible import lattice_of
from tests.commands import ended, refused
from tests.volume.test_space_meshes import EVEN, FOG, ahead, fog, wall

COARSE = pytest.mark.usefixtures("coarse")
LEVEL = 1 / 255
AWAY = 60.0  # scene units from a camera to a plane
NOTHING = "2000..3000"  # shows none of VALUES
VALUES = gaussian_filter(np.random.default_rng(1).normal(size=(10, 12, 14)), 2.0)
VALUES = (1000 * (VALUES - VALUES.min()) / np.ptp(VALUES)).astype(np.float32)
EVEN_VOLUME = as_volume(VALUES)
TURN = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
TURN[:, 0] *= np.linalg.det(TURN)
TURNED = EVEN_VOLUME._replace(
    spacing=np.array([0.5, 0.8, 2.0]), origin=np.array([40.0, -9.0, 7.0]), direction=TURN
)
HALF_KNOWN = EVEN_VOLUME._replace(values=np.where(np.indices(VALUES.shape)[2] < 7, VALUES, np.nan))


@pytest.fixture
def coarse(monkeypatch):
    """Few corners, where values hardly change from voxel to voxel."""
    monkeypatch.setattr(image_planes, "FINEST", 1)


def straight(volume, where, per_unit=8.0, size=48, perspective=False):
    """Camera straight before a plane, and voxels (H, W, 3) of it that pixels show."""
    plane = settled(ImagePlane(where), volume)
    middle = volume.origin + lattice_of(volume) @ outline(volume, plane.where).mean(axis=0)
    # Rotation (3, 3) of a camera that looks along a direction
    normal = np.array(plane.where[:3])
    right = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    right /= np.linalg.norm(right)
    rotation, pose = np.stack([right, np.cross(normal, right), normal]), np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, -rotation @ middle + [0, 0, AWAY]
    half, focal = size / 2, per_unit * AWAY
    camera = Orthographic(per_unit, per_unit, half, half, pose)
    if perspective:
        camera = Camera(np.array([[focal, 0, half], [0, focal, half], [0, 0, 1]]), pose)
    x, y = np.meshgrid(*[(np.arange(size) + 0.5 - half) / per_unit] * 2)
    place = np.stack([x, y, np.zeros_like(x)], -1) @ rotation + middle
    return camera, (place - volume.origin) @ np.linalg.inv(lattice_of(volume)).T


def seen_straight(volume, where, window=(100.0, 900.0), colors="gray", **choices):
    """Picture straight before a plane, and voxels (H, W, 3) that it shows."""
    planes, perspective = (ImagePlane(where, window, colors),), choices.pop("perspective", False)
    look = Appearance(choices.pop("transfer", NOTHING), planes=planes, **choices)
    camera, voxel = straight(volume, where, perspective=perspective)
    return render(volume, look, camera, size=voxel.shape[1::-1]), voxel


def within(volume, voxel, margin=0.0):
    """Whether places are in a volume, by a margin in voxels."""
    last = np.array(volume.values.shape[::-1]) - 0.5 - margin
    return ((voxel > margin - 0.5) & (voxel < last)).all(axis=-1)


def truth(volume, voxel, window=(100.0, 900.0)):
    """Shares of a window by SciPy's spline."""
    at = np.moveaxis(voxel[..., ::-1], -1, 0)
    value = map_coordinates(volume.values.astype(np.float64), at, order=3, mode="grid-mirror")
    return np.clip((value - window[0]) / (window[1] - window[0]), 0, 1)


WHERES = ["z=4.3", "x=50%", "y=0", "1/0/-1", "1/2/3/2.5"]


@pytest.mark.sweep
@pytest.mark.parametrize("where", WHERES)
@pytest.mark.parametrize("volume", [EVEN_VOLUME, TURNED], ids=["even", "turned"])
def test_a_plane_shows_the_spline_of_scipy_through_its_window(volume, where, record):
    frame, voxel = seen_straight(volume, where)
    inside = within(volume, voxel, 0.3)
    assert inside.sum() > 500
    found = to_srgb(frame.rgba[inside, :3])
    record.error("largest", np.abs(found - truth(volume, voxel)[inside][:, None]).max())
    np.testing.assert_allclose(frame.rgba[inside, 3], 1, atol=1e-6)
    assert not frame.rgba[~within(volume, voxel, -1.0)].any()


@pytest.mark.sweep
def test_a_perspective_camera_shows_the_same(record):
    frame, voxel = seen_straight(TURNED, "1/2/3", perspective=True)
    inside = within(TURNED, voxel, 0.3)
    found = to_srgb(frame.rgba[inside, :3])
    record.error("largest", np.abs(found - truth(TURNED, voxel)[inside][:, None]).max())


@pytest.mark.sweep
def test_colors_are_those_of_matplotlib(record):
    import matplotlib

    frame, voxel = seen_straight(EVEN_VOLUME, "z=5", colors="viridis")
    inside = within(EVEN_VOLUME, voxel, 0.3)
    wanted = np.asarray(matplotlib.colormaps["viridis"](truth(EVEN_VOLUME, voxel)[inside]))[:, :3]
    found = to_srgb(frame.rgba[inside, :3])
    record.error("largest", np.abs(found - wanted).max())  # of which it holds 256


@pytest.mark.sweep
@pytest.mark.parametrize(
    "light", [Light((1, -1, 2), shadows=True), Light(ambient=0.1, diffuse=0.2), None]
)
def test_no_light_and_no_depth_changes_what_a_plane_shows(light, record):
    frame, voxel = seen_straight(
        EVEN_VOLUME,
        "x=50%",
        light=light,
        cue=DepthCue(0.9),
        transfer=from_points([(0, (1, 1, 1), 1e-7)]),
    )
    inside = within(EVEN_VOLUME, voxel, 0.3)
    found = to_srgb(frame.rgba[inside, :3])
    record.error("largest", np.abs(found - truth(EVEN_VOLUME, voxel)[inside][:, None]).max())


@pytest.mark.sweep
def test_a_window_that_is_not_given_is_the_range_without_padding(record):
    values = np.tile(np.repeat(np.linspace(50, 250, 24), 24).astype(np.int16), 24)
    values = values.reshape(24, 24, 24)
    values[:4] = -2000
    plane = settled(ImagePlane("x=50%"), as_volume(values))
    assert plane.window == (50, 250)
    frame, voxel = seen_straight(as_volume(values), "x=50%", window=None)
    middle = within(as_volume(values), voxel) & (abs(voxel[..., 2] - 16) < 4)
    share = np.clip(voxel[middle, 1] / 23, 0, 1)[:, None]
    record.error("largest", np.abs(to_srgb(frame.rgba[middle, :3]) - share).max())


def test_windows_and_surfaces_on_a_scale_are_of_values(record):
    from resample_volume.classification.scales import scaled

    ramp = as_volume(10.0 ** np.linspace(0, 3, 16) * np.ones((12, 12, 1)))
    volume = scaled(ramp, "log")
    frame, voxel = seen_straight(volume, "z=50%", window=(10.0, 1000.0))
    inside = within(volume, voxel, 0.6)
    share = np.clip((3 * voxel[inside, 0] / 15 - 1) / 2, 0, 1)[:, None]
    record.error("largest", np.abs(to_srgb(frame.rgba[inside, :3]) - share).max())
    pytest.importorskip("vtkmodules.vtkFiltersCore")
    mesh = Subject.of(volume, Appearance(NOTHING, surfaces=("100",)))
    np.testing.assert_allclose(mesh.mesh.corner[:, 0] + mesh.middle[0], 10, atol=1e-3)


@pytest.mark.sweep
def test_missing_voxels_are_holes():
    frame, voxel = seen_straight(HALF_KNOWN, "z=5")
    inside = within(HALF_KNOWN, voxel)
    known = inside & (voxel[..., 0] < 6.2)
    np.testing.assert_allclose(frame.rgba[known & within(HALF_KNOWN, voxel, 0.3), 3], 1, atol=1e-6)
    assert not frame.rgba[voxel[..., 0] > 6.8].any()


@pytest.mark.sweep
@COARSE
@pytest.mark.parametrize("depth", [3.3, 15.5, 28.9])
def test_what_is_before_a_plane_dims_it_and_what_is_behind_is_hidden(depth):
    look = Appearance(fog(0.05), None, planes=(ImagePlane(f"z={depth}", (0, 200)),))
    rgba = render(EVEN, look, ahead(), size=(64, 64)).rgba
    left = np.exp(-0.05 * (depth + 0.5))
    wanted = left * from_srgb(np.full(3, 0.5)) + (1 - left) * np.array(FOG)
    middle = rgba[8:-8, 8:-8]
    np.testing.assert_allclose(middle[..., :3], np.broadcast_to(wanted, (48, 48, 3)), atol=2e-3)
    np.testing.assert_allclose(middle[..., 3], 1, atol=1e-3)


@pytest.mark.sweep
@COARSE
def test_planes_and_meshes_let_through_what_their_opacities_leave():
    planes = (ImagePlane("z=15.5", (0, 200), opacity=0.4), ImagePlane("z=25.5", (0, 100)))
    look = Appearance(fog(0.05), None, planes=planes, meshes=(wall(20.5, opacity=0.5),))
    found = render(EVEN, look, ahead(), size=(64, 64)).rgba[32, 32, :3]
    half, third, back = np.exp(-0.05 * 16), np.exp(-0.05 * 21), np.exp(-0.05 * 26)
    of_fog = (1 - half) + 0.6 * (half - third) + 0.3 * (third - back)
    gray, red = float(from_srgb(np.array(0.5))), np.array((0.8, 0.1, 0.05))
    wanted = of_fog * np.array(FOG) + 0.4 * half * gray + 0.3 * third * red + 0.3 * back
    np.testing.assert_allclose(found, wanted, atol=2e-3)


@pytest.mark.sweep
@COARSE
def test_crossing_planes_hide_each_other_where_they_are_behind():
    planes = (ImagePlane("1/0/1", (0, 100)), ImagePlane("1/0/-1", (100, 1e6)))  # white, black
    rgba = render(EVEN, Appearance("9000..", planes=planes), ahead(), size=(64, 64)).rgba
    np.testing.assert_allclose(rgba[20:44, 8:28, 0], 0, atol=1e-4)  # -1 at the left is nearer
    np.testing.assert_allclose(rgba[20:44, 36:56, 0], 1, atol=1e-4)


@pytest.mark.sweep
@COARSE
def test_cuts_leave_planes_whole():
    plane = ("z=15.5:window=0..200",)
    whole = Appearance("9000..", planes=plane)
    cut = Appearance("9000..", planes=plane, clip=("1/0/0",), crop="0:8,:,:", slab="0/1/0/1/0")
    one, two = (render(EVEN, look, ahead(), size=(48, 48)).rgba for look in (whole, cut))
    np.testing.assert_array_equal(one, two)


@pytest.mark.sweep
@COARSE
def test_a_plane_before_the_first_surface_hides_it():
    values = np.zeros((32, 32, 32), np.float32)
    values[16:] = 100.0
    made = Resampler(order=Rays(), projection=Projection.FIRST_HIT, iso=50.0)
    for where, level in (("z=10", 0.0), ("z=20", None)):
        look = Appearance("0/white/0,100/white/1", None, planes=(ImagePlane(where, (0, 100)),))
        found = render(as_volume(values), look, ahead(), size=(64, 64), resampler=made)
        assert (found.rgba[32, 32, 0] < 1e-6) == (level == 0.0)


def test_a_preview_shows_the_plane_where_it_is_in_its_window():
    scene, look = Scene(TURNED), Appearance(NOTHING, planes=("1/2/3",))
    camera, voxel = straight(TURNED, "1/2/3")
    quick = scene.render(look, camera, size=(48, 48), quality="preview").rgba
    inside = within(TURNED, voxel, 2.0)
    np.testing.assert_allclose(quick[inside, 3], 1, atol=1e-6)
    away = np.abs(to_srgb(quick[inside, :3]) - truth(TURNED, voxel, (0, 1000))[inside][:, None])
    assert away.mean() < 0.05  # voxels of twice the size
    assert not quick[~within(TURNED, voxel, -3.0)].any()


@pytest.mark.some(1)
@pytest.mark.parametrize("perspective", [True, False])
def test_a_pointer_is_on_the_voxel_that_a_plane_shows(perspective):
    volume = TURNED._replace(values=(TURNED.values / 4).astype(np.uint8))
    scene, look = Scene(volume), Appearance(NOTHING, planes=("1/2/3",))
    camera, voxel = straight(TURNED, "1/2/3", perspective=perspective)
    ids = scene.sample_ids(look, camera, size=(48, 48))
    inside = within(TURNED, voxel)
    np.testing.assert_array_equal(ids[inside], np.floor(voxel[inside] + 0.5)[:, ::-1])
    assert (ids[~inside] == -1).all()
    thin = Appearance(NOTHING, planes=("1/2/3:opacity=0.2",))
    assert (scene.sample_ids(thin, camera, size=(48, 48)) == -1).all()
    assert scene.pick(24, 24, thin, camera, size=(48, 48)) is None


@COARSE
def test_a_pointer_is_on_what_is_before_a_plane():
    volume = EVEN._replace(
        values=np.where(np.indices((32, 32, 32))[0] >= 16, np.uint8(100), np.uint8(0))
    )
    scene, camera = Scene(volume), ahead()
    for where, index in (("z=8", 8), ("z=24", 15)):
        look = Appearance("50..150", None, planes=(where,))
        found = scene.pick(32, 32, look, camera, size=(64, 64))
        assert abs(found.voxel[0] - index) <= 1


@COARSE
def test_a_camera_around_what_is_seen_has_all_of_a_plane():
    look = Appearance(NOTHING, planes=("z=50%",))
    subject = Subject.of(EVEN_VOLUME, look)
    away = np.linalg.norm(subject.mesh.corner - subject.sphere.center, axis=1)
    assert away.max() <= subject.sphere.radius * (1 + 1e-9)
    assert not subject.is_empty


@pytest.mark.parametrize(
    ("text", "plane"),
    [
        ("z=40", ImagePlane("z=40")),
        ("x=50%:window=40/400", ImagePlane("x=50%", (-160.0, 240.0))),
        ("1/0/-1/20:window=-100..300", ImagePlane("1/0/-1/20", (-100.0, 300.0))),
        ("-1/0/0:colors=hot,opacity=0.5", ImagePlane("-1/0/0", None, "hot", 0.5)),
    ],
)
def test_words_of_planes(text, plane):
    assert ImagePlane.of(text) == plane
    assert Appearance(planes=(text,)).planes == (plane,)


@pytest.mark.some(8)
@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("w=40", "give a voxel's index"),
        ("z=", "give a voxel's index"),
        ("", "give a voxel's index"),
        ("1/0", "plane '1/0'; give a normal"),
        ("0/0/0", "must not be 0,0,0"),
        ("z=4:size=3", "unknown size"),
        ("z=4:window=3", "give a center and a width"),
        ("z=4:window=3/-1", "does not ascend"),
        ("z=4:window=3..nan", "does not ascend"),
        ("z=4:opacity=2", "give 0 to 1"),
        ("z=4:opacity=nan", "give 0 to 1"),
        ("z=4:colors=nocolor", "matplotlib colormap"),
        ("z=100", "which has 100 voxels along z; give 0 to 99"),
        ("x=101%", "0% to 100%"),
        ("1/0/0/900", "misses checker-box"),
    ],
)
def test_what_is_no_plane_is_one_line(text, said, tmp_path, monkeypatch, capsys):
    from resample_volume.cli import app

    monkeypatch.chdir(tmp_path)
    output = "out.png"
    words = ("checker-box", "-o", output, "--size", "16x16", f"--plane={text}")
    assert said in refused(app, capsys, "render", *words)


@pytest.mark.sweep
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--projection", "maximum"), "composite or first-hit"),
        (("--classify", "pre"), "a plane ends rays"),
        (("--order", "every-sample"), "a plane ends rays"),
    ],
)
def test_what_shows_no_planes_is_one_line(words, said, tmp_path, monkeypatch, capsys):
    from resample_volume.cli import app

    monkeypatch.chdir(tmp_path)
    output = "out.png"
    given = ("render", "checker-box", "-o", output, "--plane", "z=4", *words)
    assert said in refused(app, capsys, *given)


@pytest.mark.sweep
@COARSE
def test_a_film_of_times_has_one_window(tmp_path, monkeypatch):
    from PIL import Image

    from resample_volume.cli import app

    monkeypatch.chdir(tmp_path)
    step = np.repeat([0.0, 30.0], 6).astype(np.float32) * np.ones((12, 12, 1), np.float32)
    np.save("times.npy", np.stack([step, 3 * step]))
    words = ("--path", "still", "--frames", "2", "--size", "32", "--transfer", NOTHING)
    where = ("--plane", "z=50%", "--camera", "top", "--fov", "0")
    assert ended(app, "animate", "times.npy", *words, *where, "-o", "film") == 0
    frames = sorted(Path("film").glob("*.png"))
    levels = [np.asarray(Image.open(path))[..., 0] for path in frames]
    assert [int(np.percentile(frame, 95)) for frame in levels] == pytest.approx([85, 255], abs=8)


@pytest.mark.sweep
@pytest.mark.parametrize("transfer", [NOTHING, "100..300"])
@pytest.mark.parametrize("fov", ["0", "30"])
def test_a_plane_fills_the_picture_that_zooms_in(transfer, fov, tmp_path, monkeypatch):
    from PIL import Image

    from resample_volume.cli import app

    monkeypatch.chdir(tmp_path)
    values = np.zeros((12, 12, 12), np.uint8)
    values[5:7, 5:7, 5:7] = 200
    np.save("small.npy", values)
    words = ("--camera", "30/20/1", "--fov", fov, "--size", "60", "--background", "none")
    look = ("--transfer", transfer, "--plane", "z=50%", "--zoom-in", "-o", "out.png")
    assert ended(app, "render", "small.npy", *words, *look) == 0
    seen = np.asarray(Image.open("out.png"))[..., 3] > 0
    across = np.flatnonzero(seen.any(axis=0))
    assert 0 < across[0] < 10  # kernels of voxels reach as far
    assert 49 < across[-1] < 59
