"""Several volumes on the same rays: their sizes, their sums, and what does not matter."""

import shutil
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from resample import Resampler
from resample.cameras.viewpoints import Orbit
from resample.files.images import read_image
from resample.profiles.orders import Rays
from resample_volume import Appearance, Light, cli, render
from resample_volume.classification.labels import Labels, Rule
from resample_volume.classification.transfer import from_points
from resample_volume.files.source import write_volume
from resample_volume.rendering import Subject
from resample_volume.types import Volume
from tests import commands
from tests.volume.test_glances import hired
from tests.volume.test_media import decibel

ended = partial(commands.ended, cli.app)

USUAL = Resampler(order=Rays(quality="usual"))
RED, BLUE = (0.9, 0.2, 0.1), (0.1, 0.3, 0.95)
UNLIT = partial(Appearance, light=None)
C, S = np.cos(0.4), np.sin(0.4)
STRAIGHT = np.eye(3)
TURNED = np.array([[C, -S, 0], [S, C, 0], [0, 0, 1.0]])


def ball(radius, shape=(24, 48, 48), spacing=(1.0, 1.0, 2.0), direction=STRAIGHT, middle=(0, 0, 0)):
    """Volume around the origin: distances from the surface of a ball, positive within it."""
    steps, size = np.array(spacing), np.array(shape[::-1])
    origin = -direction @ (steps * (size - 1)) / 2
    z, y, x = np.indices(shape)
    place = (np.stack([x, y, z], axis=-1) * steps) @ direction.T + origin
    away = np.linalg.norm(place - np.array(middle), axis=-1)
    return Volume((radius - away).astype(np.float32), steps, origin, direction, "ball")


def hard(color, at=0.0):
    """Look of an opaque surface at a value."""
    return UNLIT(from_points([(at - 0.01, color, 0.0), (at + 0.01, color, 1.0)]))


def half(color, share, **more):
    """Look of an even, translucent ball."""
    return UNLIT(from_points([(-0.5, color, 0.0), (0.5, color, share)]), **more)


def painted(media, side=64, viewpoint=None, paint=USUAL, **more):
    """Picture of volumes, and its camera."""
    subject = Subject.of_several(media, paint, **more)
    camera = subject.camera(viewpoint or Orbit(30, 20), side, side)
    seen = subject.samples_for(camera)
    return paint(seen, camera, height=side, width=side, clip=subject.cuts(camera)), camera


def diameters(alpha, per):
    """Width and height of what is opaque, scene units."""
    return alpha.sum(axis=1).max() / per, alpha.sum(axis=0).max() / per


# Sizes


@pytest.mark.parametrize("order", [1, -1])
def test_a_ball_of_36_mm_has_its_size_beside_another_volume(order):
    other = ball(-900)
    other.values[0, 0, 0] = 5
    media = [(ball(18), hard(RED)), (other, hard(BLUE))][::order]
    frame, camera = painted(media, 240, Orbit(0, 0, fov=0), fit="volume")
    red = frame.rgba[..., 0] / frame.rgba[120, 120, 0]
    assert diameters(red, camera.view().focal[0]) == pytest.approx((36, 36), abs=0.4)


def test_commands_show_channels_and_other_files_at_their_size(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    cube = ball(18, (48, 48, 48), (1, 1, 1))
    empty = cube._replace(values=np.full_like(cube.values, -900))
    empty.values[0, 0, 0] = 5
    write_volume(Path("ball.nrrd"), cube)
    write_volume(Path("empty.nrrd"), empty)
    np.save("channels.npy", np.stack([empty.values, cube.values]))
    common = ("--no-shading", "--size", 200, "--camera", "front", "--fov", 0, "--fit", "volume")
    look = "-0.01,white,0 0.01,white,1"
    also = ("ball.nrrd", "--transfer", look, "--also", f"empty.nrrd:transfer={look}")
    channels = ("channels.npy", "--channels", "red,white", "--window", "-0.01,0.01")
    for name, words in {"also.exr": also, "channels.exr": channels}.items():
        assert ended("render", *words, *common, "-o", name) == 0
        alpha = read_image(name)[..., 3]
        per = 198 / (2 * 24 * np.sqrt(3))
        assert diameters(alpha, per) == pytest.approx((36, 36), abs=0.4)


def test_bricks_and_workers_give_the_bits_of_volumes_in_memory(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    hired(monkeypatch)
    monkeypatch.setenv("HYBRID_RESAMPLE_CACHE", str(tmp_path / "cache"))
    cube = ball(18, (80, 80, 80), (0.5, 0.5, 0.5))
    cube.values[:3] = -900
    for name, volume in {"ball": cube, "other": cube._replace(values=cube.values - 9)}.items():
        write_volume(Path(f"{name}.nrrd"), volume)
        assert ended("convert", f"{name}.nrrd", f"{name}.ome.zarr", "--chunk", 32) == 0
    look = "-0.01,white,0 0.01,white,1"
    common = ("--no-shading", "--size", 200, "--camera", "front", "--fov", 0, "--transfer", look)
    pictures = []
    for suffix, more in (
        ("nrrd", ()),
        ("ome.zarr", ("--memory", "6MB")),
        ("ome.zarr", ("--memory", "18MB", "--workers", 2)),
    ):
        words = (f"ball.{suffix}", "--also", f"other.{suffix}:transfer=0,red,0 1,red,0.4")
        for fit in ("volume", "visible"):
            assert ended("render", *words, *common, *more, "--fit", fit, "-o", "a.exr") == 0
            pictures.append(read_image("a.exr"))
        assert ended("animate", *words, *common, *more, "--frames", 2, "-o", "film") == 0
        pictures.append(read_image("film/frame-0001.png"))
        shutil.rmtree("film")
    per = 198 / (2 * 20 * np.sqrt(3))
    assert diameters(pictures[0][..., 3], per) == pytest.approx((36, 36), abs=0.4)
    for found in (pictures[3:6], pictures[6:]):
        for one, wanted in zip(found, pictures[:3], strict=True):
            assert np.array_equal(one, wanted)


def test_films_and_color_bars_have_several_volumes(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("a", "b"):
        write_volume(Path(f"{name}.nrrd"), ball(5, (12, 12, 12), (1, 1, 1)))
    also = ("a.nrrd", "--also", "b.nrrd:transfer=gray", "--size", 96)
    assert ended("animate", *also, "--frames", 2, "-o", "film") == 0
    assert len(list(Path("film").glob("*.png"))) == 2
    widths = []
    for words in ((), ("--color-bar",)):
        assert ended("render", *also, *words, "-o", "x.png") == 0
        widths.append(read_image("x.png").shape[1])
    assert ended("render", "a.nrrd", "--size", 96, "--color-bar", "-o", "x.png") == 0
    alone = read_image("x.png").shape[1]
    assert widths[1] - widths[0] == 2 * (alone - widths[0])


# Sums


def density(places, middle, radius, share):
    """Extinction at places (..., 3) of a ball that `half` shows."""
    value = np.clip(radius - np.linalg.norm(places - np.array(middle), axis=-1), -0.5, 0.5) + 0.5
    return -np.log1p(-share * value)


def test_overlapping_balls_are_their_integral_along_rays(record):
    balls = (((-2.0, 0.5, 0.0), 6.0, 0.1, RED), ((2.5, -1.0, 1.5), 7.0, 0.06, BLUE))
    lattices = ({"spacing": (0.5,) * 3}, {"spacing": (0.7,) * 3, "direction": TURNED})
    media = [
        (
            ball(radius, (44, 44, 44), middle=middle, **lattice),
            UNLIT(from_points(points(share, color, lattice["spacing"][0]))),
        )
        for (middle, radius, share, color), lattice in zip(balls, lattices, strict=True)
    ]
    frame, camera = painted(media, 48, Orbit(30, 20, fov=0), fit="volume")
    record.quality("picture", decibel(frame.rgba, integral(balls, camera.view(), 48)))


def points(share, color, spacing):
    """Points of a look whose extinction per scene unit is that of `density`."""
    value = np.linspace(-0.5, 0.5, 201)
    opacity = 1 - (1 - share * (value + 0.5)) ** spacing
    return [(float(v), color, float(o)) for v, o in zip(value, opacity, strict=True)]


def integral(balls, view, side, steps=600, fine=4):
    """Light of pixels by sums over short steps, 4 x 4 parallel rays per pixel."""
    from resample.colors import from_srgb

    row, column = (np.mgrid[: side * fine, : side * fine] + 0.5) / fine
    x = (column - view.principal[0]) / view.focal[0]
    y = (row - view.principal[1]) / view.focal[1]
    middle = float(view.translation[2])
    light, passed, step = np.zeros((*x.shape, 3)), np.ones(x.shape), 40 / steps
    colors = [np.asarray(from_srgb(np.array(color))) for *_, color in balls]
    for depth in middle - 20 + step * (np.arange(steps) + 0.5):
        place = (np.stack([x, y, np.full(x.shape, depth)], -1) - view.translation) @ view.rotation
        each = [density(place, *given) for *given, _ in balls]
        kept = np.exp(-sum(each) * step)
        sent = sum(e[..., None] * c for e, c in zip(each, colors, strict=True))
        light += (passed * (1 - kept) / np.maximum(sum(each), 1e-30))[..., None] * sent
        passed *= kept
    whole = np.concatenate([light, 1 - passed[..., None]], axis=-1)
    return whole.reshape(side, fine, side, fine, 4).mean(axis=(1, 3))


def test_two_fields_of_half_the_extinction_are_one():
    """Opacities whose transmittances multiply to that of one."""
    whole, looks = ball(8, (20, 20, 20), (1, 1, 1)), []
    for share in (0.4, 1 - np.sqrt(0.6)):
        value = np.linspace(0, 8, 65)
        opacity = 1 - (1 - share) ** (value / 8)
        looks.append(UNLIT(from_points([(v, RED, o) for v, o in zip(value, opacity, strict=True)])))
    one, _ = painted([(whole, looks[0])], fit="volume")
    two, _ = painted([(whole, looks[1])] * 2, fit="volume")
    assert one.rgba[..., 3].max() > 0.8
    np.testing.assert_allclose(two.rgba, one.rgba, atol=0.002)  # pieces of steps differ


# What does not matter


@pytest.fixture(scope="module")
def media():
    """Three lit volumes on lattices of their own."""
    lit = {"light": Light((1, -1, 2))}
    return [
        (ball(6, (24, 24, 24), (0.8,) * 3, middle=(-2, 0, 0)), half(RED, 0.3, **lit)),
        (ball(5, (20, 24, 18), (0.7, 0.8, 1.1), TURNED), half(BLUE, 0.9, **lit)),
        (ball(4, (20, 20, 20), (1, 1, 1), middle=(3, 2, 1)), half((0, 1, 0), 0.1, **lit)),
    ]


def test_the_order_of_volumes_changes_rounding_alone(media):
    frames = [painted([media[n] for n in order])[0] for order in ((0, 1, 2), (2, 0, 1), (1, 2, 0))]
    assert frames[0].rgba[..., 3].max() > 0.8
    for frame in frames[1:]:
        np.testing.assert_allclose(frame.rgba, frames[0].rgba, atol=1e-6)
        np.testing.assert_allclose(frame.coverage, frames[0].coverage, atol=1e-6)


def test_volumes_have_the_same_bits_for_any_number_of_threads(media):
    subject = Subject.of_several(media)
    camera = subject.camera(Orbit(30, 20), 150, 150)
    one, many = (
        USUAL(subject.samples_for(camera), camera, height=150, width=150, threads=count)
        for count in (1, 2)
    )
    assert np.array_equal(one.rgba, many.rgba)
    assert np.array_equal(one.depth, many.depth)


@pytest.mark.parametrize("side", [24, 64, 200])
def test_an_invisible_volume_changes_no_bit(media, side):
    subject = Subject.of_several(media[:1], USUAL, "volume")
    camera = subject.camera(Orbit(30, 20), side, side)
    field = subject.samples_for(camera)
    nothing = Subject.of(media[1][0], hard(BLUE, 1000.0), USUAL).samples_for(camera)
    alone = USUAL(field, camera, height=side, width=side)
    for pair in ([field, nothing], [nothing, field]):
        both = USUAL(pair, camera, height=side, width=side)
        assert np.array_equal(both.rgba, alone.rgba)


def test_what_lies_apart_is_painted_as_if_it_were_alone(media):
    """Each ray that meets a single field adds it up as that field's own rays do."""
    far = media[0][0]._replace(origin=media[0][0].origin + np.array([60.0, 0, 0]))
    pair = [media[0], (far, media[1][1])]
    both, camera = painted(pair, 128, Orbit(0, 0), fit="volume")
    subject = Subject.of(*pair[0], USUAL, around=None)
    shift = subject.middle - Subject.of_several(pair, USUAL).middle
    field = subject.samples_for(camera)
    field = field._replace(origin=field.origin + shift)
    alone = USUAL(field, camera, height=128, width=128)
    left = alone.coverage > 0
    assert 20 < left.sum() < 128 * 64
    np.testing.assert_allclose(both.rgba[left], alone.rgba[left], atol=1e-6)


# Looks


def test_labels_beside_another_volume_keep_their_own_colors():
    values = np.zeros((40, 40, 40), np.uint8)
    values[8:32, 8:32, 8:32] = 100
    labels = np.zeros_like(values)
    labels[8:32, 8:32, 8:20], labels[8:32, 8:32, 20:32] = 1, 7
    rules = {1: Rule((1.0, 0.0, 0.0)), 7: Rule((0.0, 0.0, 1.0))}
    look = UNLIT(
        from_points([(50, (1, 1, 1), 0.0), (51, (1, 1, 1), 1.0)]), labels=Labels(labels, rules)
    )
    block = Volume(values, np.ones(3), -np.full(3, 19.5), np.eye(3), "block")
    other = (ball(3, (10, 10, 10), (1, 1, 1), middle=(0, 0, 0)), half((0, 1, 0), 0.2))
    apart = other[0]._replace(origin=np.array([0.0, 0.0, 30.0]))
    frame, _ = painted([(block, look), (apart, other[1])], 160, Orbit(0, 0, fov=0), fit="volume")
    one, other = frame.rgba[..., 0], frame.rgba[..., 2]
    red, blue = (one > 0.5) & (other < 0.2), (other > 0.5) & (one < 0.2)
    assert red.sum() == pytest.approx(blue.sum(), rel=0.03)
    assert red.sum() > 400
    assert np.flatnonzero(red.any(axis=0)).max() <= np.flatnonzero(blue.any(axis=0)).min()


def test_one_volume_takes_light_from_another():
    low, high = (
        (ball(4, (16, 16, 16), (1, 1, 1))._replace(origin=np.array([-7.5, -7.5, z])), hard(RED))
        for z in (-20.0, 5.0)
    )
    halves = []
    for shadows in (False, True):
        look = Appearance(low[1].transfer, Light((0, 0, 1), shadows=shadows))
        frame, _ = painted([(low[0], look), (high[0], look)], 96, Orbit(0, 0), fit="volume")
        light = frame.rgba[..., :3].sum(axis=(1, 2))
        halves.append((light[:48].sum(), light[48:].sum()))
    (above, below), (bright, dark) = halves
    assert below == pytest.approx(above, rel=0.05)
    assert dark < 0.7 * bright


def test_a_list_of_volumes_is_ray_cast(media):
    frame = render(media, size=(32, 32))
    assert frame.statistics.rays > 0
    assert frame.statistics.splats == 0
