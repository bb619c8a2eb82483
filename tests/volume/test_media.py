"""Several volumes in one scene, against integrals along rays and against sums by hand."""

from dataclasses import replace

import numpy as np
import pytest

from resample.cameras.viewpoints import Orbit
from resample.painting.choices import Projection
from resample.profiles.orders import Rays
from resample.resampler import Resampler
from resample_comparisons.volume.painting import ImageSheets
from resample_volume.appearance import BY_DEFAULT, Appearance, Classification
from resample_volume.calls import render
from resample_volume.classification.labels import Labels, Rule
from resample_volume.classification.transfer import TransferFunction, from_points
from resample_volume.files.generated import vessel_tree
from resample_volume.rendering import Subject
from resample_volume.series import common_lattice
from resample_volume.types import Volume
from resample_volume.voxels.shading import DepthCue, Light
from resample_volume.voxels.visible import lattice_of

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
    paint = resampler or BY_DEFAULT
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
    "name", ["same", "turned", "apart", pytest.param("coarser", marks=pytest.mark.sweep)]
)
def test_overlapping_balls_are_the_integral_of_both_along_rays(name, record):
    media = [
        (filled(ball, empty), look_of(ball))
        for ball, empty in zip(BALLS, LATTICES[name], strict=True)
    ]
    viewpoint = Orbit(30, 20, 1.0, 0)
    paint = Resampler(order=Rays())
    subject = Subject.of_several(media, paint)
    moved = [(tuple(np.array(b[0]) - subject.middle), *b[1:]) for b in BALLS]
    wanted = truth(subject, viewpoint, moved)
    found = seen(subject, viewpoint, paint)
    assert wanted[..., 3].max() > 0.5
    record.quality("picture", decibel(found, wanted))


LIGHTS = [None, Light(), Light((1, -1, 2), shadows=True, occlusion=True)]


@pytest.mark.sweep
@pytest.mark.parametrize(
    "light", [LIGHTS[1], *(pytest.param(light, marks=pytest.mark.sweep) for light in LIGHTS[::2])]
)
def test_the_order_of_volumes_does_not_matter(light):
    media = [
        (filled(ball, empty), look_of(ball, light=light, cue=DepthCue(), clip=("1/0/-1",)))
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


# Where they are


def test_the_finest_lattice_is_extended_to_all_and_the_finest_volume_kept_as_it_is():
    fine, coarse = lattice((8, 8, 8), 0.5), lattice((9, 9, 9), 2.0)
    for volumes in ((fine, coarse), (coarse, fine)):
        whole, middle = common_lattice(volumes)
        assert whole.values.shape == (36, 36, 36)
        np.testing.assert_allclose(whole.origin, [-8.75] * 3)
        np.testing.assert_allclose(middle, [0, 0, 0], atol=1e-12)


@pytest.mark.sweep
def test_a_look_does_not_depend_on_the_lattice_of_others():
    """Fractions stay those of a volume's own values, opacities those of its own voxels."""
    ball = filled(BALLS[1], lattice((20, 20, 20), 1.0))
    look = Appearance(from_points([(0.0, RED, 0.0), (1.0, RED, 0.3)], normalized=True), **UNLIT)
    nothing = (lattice((40, 40, 40), 0.5), Appearance(from_points([(1, RED, 0.0)]), **UNLIT))
    paint = Resampler(order=Rays())
    alone, both = (Subject.of_several(m, paint) for m in ([(ball, look)], [(ball, look), nothing]))
    camera = alone.camera(Orbit(zoom=0.8), *SIZE)
    one, two = (
        paint(s.samples_for(camera), camera, height=SIZE[0], width=SIZE[1]).rgba
        for s in (alone, both)
    )
    assert one[..., 3].max() > 0.5
    assert np.array_equal(one, two)


# As a library


def test_a_list_of_volumes_is_rendered_each_with_its_look():
    other = TREE._replace(origin=TREE.origin + np.array([4.0, 0, 0]))
    frame = render([(TREE, "vessels"), (other, Appearance("gray"))], size=(24, 24))
    assert frame.rgba[..., 3].max() > 0.5
    one = render([(TREE, "vessels")], size=(24, 24)).rgba
    assert np.array_equal(one, render(TREE, "vessels", size=(24, 24)).rgba)


def test_what_several_volumes_cannot_be_is_refused():
    plain, pre, post = (Appearance(classification=kind) for kind in Classification)
    several, slabs = [(TREE, plain), (TREE, plain)], Resampler(order=ImageSheets(0.5))
    labels = Labels(np.zeros(TREE.values.shape, np.uint8), dict.fromkeys(range(300), Rule()))
    for media, paint, complaint in (
        ([(TREE, pre), (TREE, post)], BY_DEFAULT, "leave the classification pre out"),
        ([(TREE, pre), (TREE, pre)], Resampler(), "several volumes need the order rays"),
        ([(TREE, plain), (TREE, replace(plain, gradient="sobel"))], None, "gradient sobel is of"),
        ([(TREE, plain), (TREE, replace(plain, labels=labels))], None, "300 labels of vessel-tree"),
        ([(TREE, plain), (TREE, post)], slabs, "need the order rays"),
        (
            several,
            Resampler(order=Rays(), projection=Projection.MAXIMUM),
            "shows the values of one",
        ),
        ([], None, "give at least one"),
    ):
        with pytest.raises(ValueError, match=complaint):
            Subject.of_several(media, paint)
    with pytest.raises(ValueError, match=r"a list of pairs \(volume, appearance\)"):
        render([TREE, TREE])
    with pytest.raises(ValueError, match="without another appearance"):
        render(several, "gray")


def test_places_without_any_voxel_are_an_empty_scene():
    look = Appearance(from_points([(0, RED, 0.0)]))
    subject = Subject.of_several([(TREE, look), (TREE, look)])
    assert subject.is_empty
    assert not seen(subject, Orbit()).any()
