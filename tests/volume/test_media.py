"""Several volumes in one scene, against integrals along rays and against sums by hand."""

from dataclasses import replace

import numpy as np
import pytest

from resample.cameras.viewpoints import Orbit
from resample.painting.choices import Projection
from resample.profiles.orders import ImageSheets, Rays
from resample.resampler import Resampler
from resample_volume.classification.labels import Labels
from resample_volume.classification.transfer import TransferFunction, from_points
from resample_volume.data import memory
from resample_volume.files.generated import vessel_tree
from resample_volume.media.appearance import Appearance, Classification
from resample_volume.media.lattices import common_lattice, onto
from resample_volume.media.mixing import mixed
from resample_volume.rendering import Subject, render
from resample_volume.types import Volume
from resample_volume.voxels.shading import DepthCue, Light
from resample_volume.voxels.visible import classify, lattice_of
from tests.volume.of_voxels import of_voxels

RED, BLUE = (0.9, 0.2, 0.1), (0.1, 0.3, 0.95)
C, S = np.cos(0.4), np.sin(0.4)
TURNED = np.array([[C, -S, 0], [S, C, 0], [0, 0, 1.0]])
SIZE = (32, 32)
BALLS = (((-2.0, 0.5, 0.0), 3.0, 0.25, RED), ((2.5, -1.0, 1.5), 4.0, 0.15, BLUE))
UNLIT, PRE = {"light": None}, {"classification": Classification.PRE}
TREE = vessel_tree(16)


def density(ball, position):
    """Soft ball's optical depth per scene unit at scene positions (..., 3)."""
    middle, width, strength, _ = ball
    away = ((position - np.array(middle)) ** 2).sum(-1)
    return strength * np.exp(-away / (2 * (width / 2) ** 2))


def look_of(ball, **more):
    """What makes a voxel of a density as opaque as that density is."""
    value = np.linspace(0, ball[2], 400)
    color = np.tile(ball[3], (value.size, 1))
    return Appearance(TransferFunction(value, color, 1 - np.exp(-value), 1.0), **(UNLIT | more))


def positions_of(volume):
    index = np.stack(np.meshgrid(*map(np.arange, volume.values.shape), indexing="ij"))[::-1]
    return np.moveaxis(index, 0, -1) @ lattice_of(volume).T + volume.origin


def lattice(size, spacing, middle=(0.0, 0.0, 0.0), direction=None):
    """Volume of zeros around a place."""
    turned, steps = np.eye(3) if direction is None else direction, np.full(3, spacing)
    half = turned @ (steps * (np.array(size[::-1]) - 1)) / 2
    return Volume(np.zeros(size, np.float32), steps, np.array(middle) - half, turned, "zeros")


def filled(ball, empty):
    return empty._replace(values=density(ball, positions_of(empty)).astype(np.float32), name="ball")


def truth(subject, viewpoint, balls=BALLS, steps=400):
    """Linear light along the rays through the middles of pixels, in short steps."""
    from resample.colors import from_srgb

    view = subject.camera(viewpoint, *SIZE).view()
    row, column = np.mgrid[: SIZE[0], : SIZE[1]] + 0.5
    x = (column - view.principal[0]) / view.focal[0]
    y = (row - view.principal[1]) / view.focal[1]
    depth = np.linspace(subject_depth(view) - 20, subject_depth(view) + 20, steps)
    length, light, passed = depth[1] - depth[0], np.zeros((*SIZE, 3)), np.ones(SIZE)
    for d in depth:
        eye = np.stack([x, y, np.full(SIZE, d)], -1)
        place = (eye - view.translation) @ view.rotation  # of a parallel camera
        sigma = [density(ball, place) for ball in balls]
        total = sum(sigma)
        colors = [np.asarray(from_srgb(np.array(ball[3]))) for ball in balls]
        sent = sum(s[..., None] * c for s, c in zip(sigma, colors, strict=True))
        share = (1 - np.exp(-total * length)) / np.maximum(total, 1e-30)
        light += (passed * share)[..., None] * sent
        passed *= np.exp(-total * length)
    return np.concatenate([light, 1 - passed[..., None]], -1)


def subject_depth(view):
    return float(view.translation[2])


def decibel(found, wanted):
    return -10 * np.log10(np.mean((found - wanted) ** 2))


def seen(subject, viewpoint, resampler=None):
    paint = resampler or Resampler()
    camera = subject.camera(viewpoint, *SIZE)
    return paint(
        subject.samples_for(camera), camera, height=SIZE[0], width=SIZE[1], clip=subject.clip
    ).rgba


# What overlaps


LATTICES = {
    "same": (lattice((40, 40, 40), 0.6), lattice((40, 40, 40), 0.6)),
    "coarser": (lattice((40, 40, 40), 0.6), lattice((20, 20, 20), 1.1, (0.2, 0.1, 0.3))),
    "turned": (lattice((40, 40, 40), 0.6), lattice((34, 34, 34), 0.7, (0.5, 0, 0), TURNED)),
    "apart": (
        lattice((26, 26, 26), 0.6, (-2, 0, 0)),
        lattice((26, 26, 26), 0.8, (3, -1, 1), TURNED),
    ),
}


@pytest.mark.sweep
@pytest.mark.parametrize(
    "name",
    [
        "same",
        "turned",
        "apart",
        pytest.param(
            "coarser",
            marks=pytest.mark.sweep,
        ),
    ],
)
def test_overlapping_balls_are_the_integral_of_both_along_rays(name, record):
    media = [
        (filled(ball, empty), look_of(ball))
        for ball, empty in zip(BALLS, LATTICES[name], strict=True)
    ]
    viewpoint = Orbit(30, 20, 1.0, 0)
    paint = Resampler(order=ImageSheets(0.25))
    subject = Subject.of_several(media, paint)
    moved = [(tuple(np.array(b[0]) - subject.middle), *b[1:]) for b in BALLS]
    wanted = truth(subject, viewpoint, moved)
    found = seen(subject, viewpoint, paint)
    assert wanted[..., 3].max() > 0.5
    record.quality("picture", decibel(found, wanted))


def test_media_on_one_lattice_are_their_sum_by_hand():
    other = TREE._replace(values=TREE.values[::-1].copy(), name="other")
    looks = [from_points([(10, RED, 0.0), (200, RED, 0.9)]), from_points([(5, BLUE, 0.4)])]
    one, two = (classify(v, t) for v, t in zip((TREE, other), looks, strict=True))
    color, depth = {}, {}
    for voxels in (one, two):
        for n, place in enumerate(map(tuple, voxels.position.tolist())):
            depth[place] = depth.get(place, 0.0) + voxels.extinction[n]
            color[place] = color.get(place, 0.0) + voxels.extinction[n] * voxels.color[n]
    media = [(v, of_voxels(t, **UNLIT)) for v, t in zip((TREE, other), looks, strict=True)]
    subject = Subject.of_several(media)
    samples = subject.samples_for(subject.camera(Orbit(), *SIZE))
    places = [tuple(place) for place in (samples.position + subject.middle).tolist()]
    assert sorted(places) == sorted(depth)
    wanted = np.array([depth[place] for place in places])
    np.testing.assert_allclose(samples.extinction, wanted, rtol=1e-6)
    wanted = np.array([color[place] / depth[place] for place in places])
    np.testing.assert_allclose(samples.color, wanted, rtol=1e-5)


LIGHTS = [None, Light(), Light((1, -1, 2), shadows=True, occlusion=True)]


@pytest.mark.sweep
@pytest.mark.parametrize(
    "light",
    [
        LIGHTS[1],
        *(pytest.param(light, marks=pytest.mark.sweep) for light in LIGHTS[::2]),
    ],
)
def test_the_order_of_volumes_does_not_matter(light):
    media = [
        (filled(ball, empty), look_of(ball, light=light, cue=DepthCue(), clip=("1/0/-1",), **PRE))
        for ball, empty in zip(BALLS, LATTICES["turned"], strict=True)
    ]
    third = (LATTICES["same"][0]._replace(values=media[0][0].values[::-1].copy()), media[0][1])
    pictures = [
        seen(Subject.of_several(some), Orbit())
        for some in ([*media, third], [third, *media], [third, *media[::-1]])
    ]
    assert pictures[0][..., 3].max() > 0.3
    for picture in pictures[1:]:
        np.testing.assert_allclose(picture, pictures[0], atol=1e-6)


def test_each_of_several_is_lit_by_its_own_surfaces():
    media = [(TREE, of_voxels("vessels")), (TREE, of_voxels(from_points([(0, BLUE, 0.0)])))]
    alone = Subject.of(TREE, of_voxels("vessels"))
    camera = alone.camera(Orbit(), *SIZE)
    both = Subject.of_several(media).samples_for(camera)
    for found, wanted in zip(both[:3], alone.samples_for(camera)[:3], strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-5)


def test_one_of_several_takes_light_from_the_others():
    look = of_voxels(from_points([(0.5, RED, 0.0), (0.5, RED, 1.0)]), Light((0, 0, 1)))
    values = np.zeros((24, 24, 24), np.float32)
    low, high = values.copy(), values.copy()
    low[4:8, 6:18, 6:18], high[16:20, 6:18, 6:18] = 1, 1
    space = lattice(values.shape, 1.0)
    media = [(space._replace(values=part), look) for part in (low, high)]
    dark = [(v, replace(look, light=Light((0, 0, 1), shadows=True))) for v, _ in media]
    bright, shaded = (
        s.samples_for(s.camera(Orbit(), *SIZE)) for s in map(Subject.of_several, (media, dark))
    )
    z = bright.position[:, 2]
    below = z < 0
    assert shaded.color[below].mean() < 0.6 * bright.color[below].mean()
    assert shaded.color[z == z.max()].mean() == pytest.approx(bright.color[z == z.max()].mean())


# Where they are


@pytest.mark.sweep
def test_a_turned_volume_is_where_its_world_coordinates_say():
    far = (filled(BALLS[1], lattice((20, 22, 24), 0.9, (2.0, -1, 1), TURNED)), look_of(BALLS[1]))
    near = (filled(BALLS[0], lattice((20, 20, 20), 0.5, (-2, 0, 0))), look_of(BALLS[0]))
    whole = common_lattice([near[0], far[0]])
    np.testing.assert_allclose(whole.steps, np.eye(3) * 0.5)
    found = onto(far[0], whole)
    inside = np.isfinite(found.values)
    wanted = density(BALLS[1], positions_of(found))
    assert inside.sum() * 0.5**3 == pytest.approx(20 * 22 * 24 * 0.9**3, rel=0.02)
    np.testing.assert_allclose(found.values[inside], wanted[inside], atol=0.004)  # rim included


def test_the_finest_lattice_is_extended_to_all_and_the_finest_volume_kept_as_it_is():
    fine, coarse = lattice((8, 8, 8), 0.5), lattice((9, 9, 9), 2.0)
    for volumes in ((fine, coarse), (coarse, fine)):
        whole = common_lattice(volumes)
        assert whole.size.tolist() == [36, 36, 36]
        np.testing.assert_allclose(whole.origin, [-8.75] * 3)
        np.testing.assert_allclose(whole.middle, [0, 0, 0], atol=1e-12)
    assert onto(fine, whole) is fine


def test_what_is_finer_along_an_axis_is_smoothed_before_it_is_resampled(rng):
    noise = lattice((40, 12, 12), 1.0)._replace(
        spacing=np.array([1.0, 1, 0.25]), values=rng.normal(size=(40, 12, 12)).astype(np.float32)
    )
    whole = common_lattice(
        [lattice((12, 40, 40), 0.25)._replace(spacing=np.array([0.25, 0.25, 1]))]
    )
    found = onto(noise, whole._replace(origin=noise.origin))
    even = noise._replace(values=np.full(noise.values.shape, 3.5, np.float32))
    assert found.values.std() < 0.75 * noise.values.std()
    np.testing.assert_allclose(onto(even, whole).values, 3.5, rtol=1e-6)


def test_missing_values_stay_missing_and_spread_no_farther():
    ramp = lattice((10, 10, 10), 1.0)
    values = positions_of(ramp)[..., 0].astype(np.float32)
    values[:, :, :4] = np.nan
    found = onto(ramp._replace(values=values), common_lattice([lattice((20, 20, 20), 0.5)]))
    x = positions_of(found)[..., 0]
    known = np.isfinite(found.values)
    assert not known[x < -1.01].any()
    assert known[x > -0.99].all()
    inner = (x > -0.5) & (x < 4.5)
    np.testing.assert_allclose(found.values[inner], x[inner], atol=1e-5)


@pytest.mark.sweep
def test_a_look_does_not_depend_on_the_lattice_of_others(record):
    """Fractions stay those of a volume's own values, opacities those of its own voxels."""
    ball = filled(BALLS[1], lattice((20, 20, 20), 1.0))
    look = Appearance(from_points([(0.0, RED, 0.0), (1.0, RED, 0.3)], normalized=True), **UNLIT)
    nothing = (lattice((40, 40, 40), 0.5), Appearance(from_points([(1, RED, 0.0)]), **UNLIT))
    paint = Resampler(order=ImageSheets(0.25))
    alone, both = (Subject.of_several(m, paint) for m in ([(ball, look)], [(ball, look), nothing]))
    camera = alone.camera(Orbit(zoom=0.8), *SIZE)
    one, two = (
        paint(s.samples_for(camera), camera, height=SIZE[0], width=SIZE[1]).rgba
        for s in (alone, both)
    )
    assert one[..., 3].max() > 0.5
    record.quality("picture", decibel(one, two))
    assert two[..., 3].sum() == pytest.approx(one[..., 3].sum(), rel=0.02)


# As a library


def test_a_list_of_volumes_is_rendered_each_with_its_look():
    other = TREE._replace(origin=TREE.origin + np.array([4.0, 0, 0]))
    frame = render([(TREE, "vessels"), (other, Appearance("gray"))], size=(24, 24))
    assert frame.rgba[..., 3].max() > 0.5
    one = render([(TREE, "vessels")], size=(24, 24)).rgba
    assert np.array_equal(one, render(TREE, "vessels", size=(24, 24)).rgba)


def test_what_several_volumes_cannot_be_is_refused(monkeypatch):
    plain, pre, post = (Appearance(classification=kind) for kind in Classification)
    several, slabs = [(TREE, plain), (TREE, plain)], Resampler(order=ImageSheets(0.5))
    labels = Labels(np.zeros(TREE.values.shape, np.uint8))
    fine = (TREE._replace(spacing=TREE.spacing / 2), pre)
    striped = (TREE, replace(pre, labels=labels))
    for media, paint, complaint in (
        ([(TREE, pre), (TREE, post)], None, "give all of them the same"),
        ([(TREE, plain), (TREE, post)], slabs, "need the order rays"),
        (
            several,
            Resampler(order=Rays(), projection=Projection.MAXIMUM),
            "shows the values of one",
        ),
        ([fine, striped], None, "which is resampled onto a finer volume"),
        ([], None, "give at least one"),
    ):
        with pytest.raises(ValueError, match=complaint):
            Subject.of_several(media, paint)
    with pytest.raises(ValueError, match=r"a list of pairs \(volume, appearance\)"):
        render([TREE, TREE])
    with pytest.raises(ValueError, match="without another appearance"):
        render(several, "gray")
    monkeypatch.setattr(memory.memory, "physical_memory", lambda: 1 << 18)
    with pytest.raises(
        ValueError, match=r"vessel-tree on the finest lattice, 3. x 3. x 3. voxels, needs"
    ):
        Subject.of_several([fine, (TREE, pre)])


def test_places_without_any_voxel_are_an_empty_scene():
    look = of_voxels(from_points([(0, RED, 0.0)]))
    subject = Subject.of_several([(TREE, look), (TREE, look)])
    assert subject.is_empty
    assert not seen(subject, Orbit()).any()
    whole = common_lattice([TREE])
    assert len(mixed([classify(TREE, look.transfer)], whole).position) == 0
