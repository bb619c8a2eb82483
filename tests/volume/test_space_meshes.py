"""Meshes in volumes: against plain loops along rays, formulas, and each other."""

import numpy as np
import pytest
import trimesh

from resample.cameras.models import Orthographic
from resample.cameras.viewpoints import Orbit
from resample.colors import from_srgb
from resample.painting.choices import Projection
from resample.profiles.orders import Rays
from resample.resampler import Resampler
from resample_volume.appearance import Appearance, Classification
from resample_volume.calls import render
from resample_volume.classification.transfer import from_points
from resample_volume.inputs import as_volume
from resample_volume.meshes import read_mesh, scene_mesh
from resample_volume.rendering import Subject
from resample_volume.voxels.shading import Light
from tests import naive, ray_truth
from tests.commands import refused
from tests.volume.test_ray_truth import BLOBS, LOOK, SIZE

RED = (0.8, 0.1, 0.05)
EVEN = as_volume(np.full((32, 32, 32), 100.0, np.float32))
SHADE = (0.2, 0.5, 0.9)
FOG = tuple(from_srgb(np.array(SHADE)).tolist())  # linear


def fog(thick):
    """Look of an even medium of so much optical depth per voxel."""
    return from_points(
        [(0.0, SHADE, float(-np.expm1(-thick))), (200.0, SHADE, float(-np.expm1(-thick)))]
    )


def ahead(per_voxel=2.0, size=64, depth=40.0, middle=15.5):
    """Parallel camera that looks along z."""
    pose = np.eye(4)
    pose[:3, 3] = (-middle, -middle, depth - middle)
    return Orthographic(per_voxel, per_voxel, size / 2, size / 2, pose)


def sphere(radius=8.0, center=(15.5, 15.5, 15.5), color=RED, opacity=1.0):
    ball = trimesh.creation.icosphere(4, radius)
    return scene_mesh(ball.vertices + center, np.asarray(ball.faces), color, opacity)


def wall(depth, color=RED, opacity=1.0, half=40.0):
    """Square across z."""
    corner = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * [half, half, 1.0]
    corner += [15.5, 15.5, depth]
    return scene_mesh(corner, np.array([[0, 1, 2], [0, 2, 3]]), color, opacity)


def seen(meshes, volume=EVEN, look=None, camera=None, size=64, light=None, **choices):
    appearance = Appearance(
        fog(0.05) if look is None else look,
        light,
        classification=Classification.POST,
        meshes=tuple(meshes),
    )
    made = Resampler(order=Rays(), **choices)
    eye = ahead() if camera is None else camera
    return render(volume, appearance, eye, size=(size, size), resampler=made)


@pytest.mark.sweep
def test_a_sphere_in_fog_is_dimmed_by_the_way_to_it(record):
    frame = seen([sphere()])
    x, y = np.meshgrid(*[(np.arange(64) + 0.5 - 32) / 2] * 2)
    inside = np.hypot(x, y) < 7.5
    front = 16.0 - np.sqrt(np.maximum(64 - x**2 - y**2, 0))  # from the field's face
    left = np.exp(-0.05 * front)[..., None]
    truth = left * RED + (1 - left) * np.array(FOG)
    found = frame.rgba[..., :3]
    record.error("largest", np.abs(found[inside] / truth[inside] - 1).max())
    np.testing.assert_allclose(frame.rgba[inside, 3], 1, atol=1e-3)
    outside = (np.hypot(x, y) > 8.6) & (np.maximum(abs(x), abs(y)) < 15)
    through = 1 - np.exp(-0.05 * 32)
    np.testing.assert_allclose(
        found[outside], through * np.tile(FOG, (outside.sum(), 1)), rtol=5e-3
    )


@pytest.mark.some(1)
@pytest.mark.parametrize("depth", [-9.0, 3.3, 15.5, 28.9, 60.0])
def test_a_wall_in_front_within_or_behind_is_dimmed_by_what_is_before_it(depth):
    frame = seen([wall(depth)])
    left = np.exp(-0.05 * np.clip(depth + 0.5, 0, 32))
    truth = left * np.array(RED) + (1 - left) * np.array(FOG)
    middle = frame.rgba[8:-8, 8:-8]
    np.testing.assert_allclose(
        middle[..., :3], np.broadcast_to(truth, middle[..., :3].shape), atol=2e-3
    )
    np.testing.assert_allclose(middle[..., 3], 1, atol=1e-5)
    if depth < 0:
        np.testing.assert_allclose(frame.depth[8:-8, 8:-8], 40 + depth - 15.5, atol=1e-3)


@pytest.mark.sweep
def test_a_wall_that_lets_light_through_is_one_layer_of_it():
    frame = seen([wall(15.5, opacity=0.4), wall(25.5)])
    half, back = np.exp(-0.05 * 16), np.exp(-0.05 * 26)
    fog_front, fog_middle = 1 - half, half - back
    truth = (fog_front + 0.6 * fog_middle) * np.array(FOG) + (0.4 * half + 0.6 * back) * np.array(
        RED
    )
    np.testing.assert_allclose(frame.rgba[32, 32, :3], truth, atol=2e-3)


@pytest.mark.sweep
def test_a_wall_that_is_wholly_clear_changes_nothing():
    with_wall, without = seen([wall(15.5, opacity=0.0)]), seen([])
    np.testing.assert_allclose(with_wall.rgba[8:-8, 8:-8], without.rgba[8:-8, 8:-8], atol=1e-4)


@pytest.mark.sweep
def test_the_camera_may_be_inside_of_field_and_mesh():
    shell = sphere(radius=10.0)
    eye = Orbit(40, 10, 3000, 60)
    look = Appearance(fog(0.05), None, classification=Classification.POST, meshes=(shell,))
    subject = Subject.of(EVEN, look)
    camera = subject.camera(eye, 16, 16)
    assert np.linalg.norm(camera.view().translation) < 0.1  # beside the middle
    made = Resampler(order=Rays())
    frame = made(subject.samples_for(camera), camera, height=16, width=16)
    left = np.exp(-0.5)
    truth = left * np.array(RED) + (1 - left) * np.array(FOG)
    np.testing.assert_allclose(frame.rgba[..., :3], np.broadcast_to(truth, (16, 16, 3)), atol=0.01)


def hits(mesh, camera, size):
    """Depth (H, W), triangle and normal of the nearest hits, by a loop over all triangles."""
    view = camera.view()
    eye, way = naive.rays(camera, *size)
    eye = np.broadcast_to(eye, (*size, 3))
    start = (eye - view.translation) @ view.rotation
    way = way @ view.rotation
    depth, normal = np.full(size, np.inf), np.zeros((*size, 3))
    for face in mesh.face:
        a, b, c = mesh.corner[face]
        across = np.cross(b - a, c - a)
        along = way @ across
        with np.errstate(divide="ignore", invalid="ignore"):
            t = ((a - start) @ across) / along
        place = start + t[..., None] * way
        signs = [np.cross(q - p, place - p) @ across >= 0 for p, q in ((a, b), (b, c), (c, a))]
        hit = np.logical_and.reduce(signs) & (t >= view.near) & (t < depth)
        depth[hit], normal[hit] = t[hit], across / np.linalg.norm(across)
    return depth, normal, start, way


@pytest.mark.sweep
@pytest.mark.parametrize("light", [None, Light(), Light((1, -1, 2))])
@pytest.mark.parametrize("fov", [30.0, 0.0])
def test_what_is_before_a_box_is_that_of_short_steps(light, fov, record):
    box = trimesh.creation.box((6.0, 5.0, 4.0))
    middle = np.array([5.0, 5.5, 4.5])
    mesh = scene_mesh(box.vertices + middle, np.asarray(box.faces), RED)
    look = Appearance(LOOK, light, classification=Classification.POST, meshes=(mesh,))
    made = Resampler(order=Rays(0.1), subpixels=1)
    subject = Subject.of(BLOBS, look, made)
    camera = subject.camera(Orbit(30, 20, 1.5, fov), *SIZE)
    field = subject.samples_for(camera)
    found = made(field, camera, height=SIZE[0], width=SIZE[1]).rgba
    depth, normal, start, way = hits(subject.mesh, camera, SIZE)
    met = ray_truth.along_rays(BLOBS.values, field, camera, SIZE, np.zeros((0, 4)))
    met.inside &= met.depth < depth[..., None]
    truth = ray_truth.composite(met, field, np.zeros((0, 4)))
    is_hit = np.isfinite(depth)
    place = np.where(is_hit[..., None], start + np.where(is_hit, depth, 0)[..., None] * way, 0.0)
    own, high = ray_truth.shine(
        field.classifier, 1e9 * normal[..., None, :], place[..., None, :], depth[..., None]
    )
    sent = np.where(is_hit[..., None], own * np.array(RED) + high, 0.0)
    left = 1 - truth[..., 3:]
    truth = np.concatenate(
        [truth[..., :3] + left * sent, truth[..., 3:] + left * is_hit[..., None]], -1
    )
    assert 40 < is_hit.sum() < is_hit.size
    record.quality("picture", -10 * np.log10(np.mean((found - truth) ** 2)))


@pytest.mark.sweep
def test_threads_do_not_change_a_bit_of_meshes():
    look = Appearance(
        LOOK, classification=Classification.POST, meshes=(sphere(4.0, (5, 5, 5), RED, 0.5),)
    )
    made = Resampler(order=Rays())
    subject = Subject.of(BLOBS, look, made)
    camera = subject.camera(Orbit(), 40, 48)
    field = subject.samples_for(camera)
    one, two = (made(field, camera, height=40, width=48, threads=n) for n in (1, 2))
    np.testing.assert_array_equal(one.rgba, two.rgba)
    np.testing.assert_array_equal(one.depth, two.depth)


@pytest.mark.sweep
def test_order_of_triangles_does_not_matter():
    ball = sphere(4.0, (5, 5, 5))
    turned = scene_mesh(ball.corner, ball.face[::-1], ball.color, smooth=0.0)
    plain = scene_mesh(ball.corner, ball.face, ball.color, smooth=0.0)
    one, two = (
        seen([mesh], BLOBS, LOOK, Orbit(), 40, light=Light()).rgba for mesh in (plain, turned)
    )
    np.testing.assert_allclose(one, two, atol=1e-5)


@pytest.mark.sweep
def test_a_mesh_thinner_than_a_pixel_is_not_skipped():
    corner = np.array([[0.0, -20, 5], [0.3, -20, 5], [0.3, 50, 5], [0.0, 50, 5]])
    thin = scene_mesh(
        corner + np.array([15.67, 0, 0]), np.array([[0, 1, 2], [0, 2, 3]]), (1.0, 1.0, 1.0)
    )
    frame = seen([thin], look=fog(1e-6), subpixels=None, camera=ahead(2.3))
    whole = frame.rgba[20:44, :, 0].sum(axis=1)
    np.testing.assert_allclose(whole, 0.3 * 2.3, atol=0.26)  # a sub-pixel


def test_a_mesh_beside_the_volume_is_in_the_picture():
    values = np.zeros((9, 9, 9), np.uint8)
    values[3:6, 3:6, 3:6] = 200
    box = trimesh.creation.box((2, 2, 2), trimesh.transformations.translation_matrix((40, 4, 4)))
    mesh = scene_mesh(np.asarray(box.vertices), np.asarray(box.faces))
    look = Appearance("100..300", classification=Classification.POST, meshes=(mesh,))
    seen = Subject.of(as_volume(values), look)
    alone = Subject.of(
        as_volume(values), Appearance("100..300", classification=Classification.POST)
    )
    away = np.linalg.norm(mesh.corner - seen.middle - seen.sphere.center, axis=1)
    assert away.max() <= seen.sphere.radius * (1 + 1e-9)
    between = np.linalg.norm(alone.sphere.center - seen.sphere.center)
    assert between + alone.sphere.radius <= seen.sphere.radius * (1 + 1e-9)
    frame = render(values, look, (0, 0), size=(60, 40))
    assert frame.rgba[:, 45:, 3].max() > 0.9  # the box, at the right
    assert frame.rgba[:, :15, 3].max() > 0.5  # the voxels, at the left
    small = scene_mesh(np.asarray(box.vertices) - (36, 0, 0), np.asarray(box.faces))
    inside = Subject.of(
        as_volume(values),
        Appearance("100..300", classification=Classification.POST, meshes=(small,)),
    )
    assert inside.sphere.radius == alone.sphere.radius


@pytest.mark.sweep
def test_a_mesh_before_the_first_surface_hides_it():
    values = np.zeros((32, 32, 32), np.float32)
    values[16:] = 100.0
    camera, look = ahead(), from_points([(0.0, SHADE, 0.0), (100.0, SHADE, 1.0)])
    made = {"projection": Projection.FIRST_HIT, "iso": 50.0, "look": look, "camera": camera}
    volume = as_volume(values)
    before = seen([wall(10.0)], volume, **made).rgba[32, 32]
    behind = seen([wall(20.0)], volume, **made).rgba[32, 32]
    np.testing.assert_allclose(before, [*RED, 1], atol=1e-5)
    np.testing.assert_allclose(behind, [*FOG, 1], atol=1e-5)


@pytest.mark.parametrize("projection", [Projection.MAXIMUM, Projection.AVERAGE])
def test_projections_of_values_refuse_meshes(projection):
    with pytest.raises(ValueError, match="projection composite or first-hit"):
        seen([wall(1.0)], projection=projection)


def test_splats_refuse_meshes_and_say_what_to_take():
    with pytest.raises(ValueError, match="classification post"):
        render(EVEN, Appearance(fog(0.1), classification="pre", meshes=(wall(1.0),)))


@pytest.mark.sweep
@pytest.mark.parametrize("gradient", ["central", "sobel"])  # of which the latter is of voxels
def test_rays_that_are_the_default_meet_meshes(gradient):
    look = Appearance(fog(0.05), None, gradient, meshes=(wall(15.5),))
    found = render(EVEN, look, ahead(), size=(64, 64)).rgba[32, 32, :3]
    left = np.exp(-0.05 * 16)
    np.testing.assert_allclose(found, left * np.array(RED) + (1 - left) * np.array(FOG), atol=2e-3)


@pytest.mark.parametrize("suffix", ["ply", "obj", "stl", "glb"])
def test_files_of_meshes_are_read(suffix, tmp_path):
    path = tmp_path / f"ball.{suffix}"
    trimesh.creation.icosphere(2, 3.0).export(path)
    mesh = read_mesh(f"{path}:color=tomato,opacity=0.5")
    assert mesh.opacity == 0.5
    assert len(mesh.face) == 320
    np.testing.assert_allclose(np.linalg.norm(mesh.corner, axis=1), 3, atol=1e-5)
    unit = mesh.normal / np.linalg.norm(mesh.normal, axis=1, keepdims=True)
    assert (unit * mesh.corner / 3).sum(axis=1).min() > 0.99  # smooth
    np.testing.assert_allclose(mesh.color[0], [1.0, 0.1246, 0.0630], atol=1e-3)


def test_a_box_keeps_its_edges():
    box = trimesh.creation.box()
    mesh = scene_mesh(box.vertices, np.asarray(box.faces))
    unit = mesh.normal / np.linalg.norm(mesh.normal, axis=1, keepdims=True)
    np.testing.assert_allclose(np.abs(unit).max(axis=1), 1, atol=1e-9)


def test_colors_of_corners_are_kept(tmp_path):
    ball = trimesh.creation.icosphere(1)
    ball.visual.vertex_colors = np.tile([255, 0, 0, 255], (len(ball.vertices), 1))
    ball.export(tmp_path / "red.ply")
    np.testing.assert_allclose(read_mesh(str(tmp_path / "red.ply")).color[0], [1, 0, 0], atol=1e-6)


@pytest.mark.some(1)
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--mesh", "none.ply", "--classify", "post"], "none.ply: there is no such file"),
        (
            ["--mesh", "BALL:size=3", "--classify", "post"],
            "unknown size; known are color and opacity",
        ),
        (["--mesh", "BALL:opacity=2", "--classify", "post"], "opacity 2.0 of a mesh; give 0 to 1"),
        (["--mesh", "BALL", "--classify", "pre"], "classification post"),
        (["--mesh", "BALL", "--order", "every-sample"], "classification post"),
        (["--mesh", "BALL", "--projection", "maximum"], "projection composite or first-hit"),
    ],
)
def test_what_cannot_be_is_one_line(words, said, tmp_path, monkeypatch, capsys):
    from resample_volume.cli import app

    monkeypatch.chdir(tmp_path)
    trimesh.creation.icosphere(1).export("ball.ply")
    given = [word.replace("BALL", "ball.ply") for word in words]
    assert said in refused(app, capsys, "render", "checker-box", "-o", "out.png", *given)


@pytest.mark.parametrize(
    ("corner", "face", "match"),
    [
        ([[np.inf, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], "not finite"),
        ([[1e13, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], "choose another unit"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 3]], "name corners 0 to 3; it has 3"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, -1]], "name corners -1 to 1; it has 3"),
    ],
)
def test_meshes_of_nowhere_and_of_corners_that_are_not_there_are_refused(corner, face, match):
    with pytest.raises(ValueError, match=match):
        scene_mesh(np.array(corner, float), np.array(face))
