import numpy as np
import pytest

from resample.cameras.models import Camera, Orthographic
from resample.cameras.poses import look_at
from resample.painting.choices import Primitive
from resample.profiles.reconstruction import BSplineKernel, GaussianKernel
from resample.resampler import Resampler
from resample.types import Samples
from resample_comparisons.volume.raycasting import Casting, cast_rays

# A rival, whose kernel is compiled for it alone.
pytestmark = pytest.mark.sweep

SKEW = np.array([[1.1, 0.2, 0.0], [0.0, 0.9, 0.1], [0.3, 0.0, -1.3]])  # left-handed too
ONE = {"height": 1, "width": 1}
ONE_RAY = Casting(rays=1, step=0.02)


def down(axis, x=0.5, y=0.5, near=-np.inf):
    """Parallel camera of one pixel that looks along an axis, through 0 at its center."""
    pose = np.eye(4)
    pose[:3, :3] = np.roll(np.eye(3), axis + 1, axis=1)
    return Orthographic(1, 1, x, y, pose, near if np.isfinite(near) else -1e3)


def nodes(*size):
    grid = np.stack(np.meshgrid(*map(np.arange, size), indexing="ij"), axis=-1)
    return grid.reshape(-1, 3).astype(np.float32)


def some_samples(rng, size=6, share=0.6):
    node = nodes(size, size, size)
    node = node[rng.random(len(node)) < share]
    position = (node @ SKEW.T + [1, 2, 3]).astype(np.float32)
    color = rng.random((len(node), 3)).astype(np.float32)
    return Samples(position, color, 0.5 * rng.random(len(node)).astype(np.float32), SKEW)


def a_camera(height=20, width=30, near=0.0):
    pose = look_at([4, -8, 5], [4.0, 4.5, 1.0])
    return Camera.from_fov(45, height=height, width=width, world_to_camera=pose, near=near)


def block(count, extinction, color=(0.2, 0.4, 0.8)):
    """Cube of equal samples around 0."""
    position = nodes(count, count, count) - (count - 1) / 2
    number = len(position)
    colors = np.tile(np.float32(color), (number, 1))
    return Samples(position, colors, np.full(number, extinction, np.float32), np.eye(3))


def unit_kernel(reconstruction):
    """Density with integral 1, normalised by SciPy."""
    from scipy.integrate import quad

    def shell(r):
        return 4 * np.pi * r**2 * float(reconstruction(np.array(r)))

    mass = quad(shell, 0, reconstruction.radius)[0]
    return lambda distance: reconstruction(distance) / mass


def naive_ray(samples, origin, way, length, count, reconstruction):
    """Midpoint rule over `count` steps of all samples' kernels, front to back."""
    density = unit_kernel(reconstruction)
    to_nodes = np.linalg.inv(samples.lattice)
    rgb, passed = np.zeros(3), 1.0
    for step in range(count):
        point = origin + (step + 0.5) / count * length * way
        weight = density(np.linalg.norm((samples.position - point) @ to_nodes.T, axis=1))
        depth = weight * samples.extinction
        if depth.sum() > 0:
            alpha = 1 - np.exp(-depth.sum() * length / count)
            rgb += passed * alpha * (depth @ samples.color) / depth.sum()
            passed *= 1 - alpha
    return np.append(rgb, 1 - passed)


# Samples that were classified before


@pytest.mark.parametrize("reconstruction", [GaussianKernel(), BSplineKernel(1.7)], ids=str)
@pytest.mark.parametrize("offset", [0.0, 0.4, 1.3, 1.9])
def test_a_ray_past_one_sample_integrates_its_kernel(reconstruction, offset):
    from scipy.integrate import quad

    density = unit_kernel(reconstruction)
    integral = quad(lambda t: float(density(np.hypot(t, offset))), -2, 2, points=[0], limit=200)[0]
    one = Samples(np.zeros((1, 3)), np.ones((1, 3)), np.full(1, 3.0), np.eye(3))
    look = Casting(rays=1, step=0.01, reconstruction=reconstruction)
    seen = cast_rays(one, down(2, x=0.5 + offset), **ONE, look=look)
    expected = 1 - np.exp(-3 * integral)
    assert seen.rgba[0, 0] == pytest.approx(expected, abs=1e-5)  # step 0.01


def test_a_ray_off_the_kernels_sees_nothing():
    one = Samples(np.zeros((1, 3)), np.ones((1, 3)), np.full(1, 3.0), np.eye(3))
    seen = cast_rays(one, down(2, x=2.6), **ONE, look=ONE_RAY)
    assert seen.rgba[0, 0].tolist() == [0, 0, 0, 0]
    assert np.isinf(seen.depth[0, 0])


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_an_even_block_absorbs_by_its_thickness(axis):
    seen = cast_rays(block(16, 0.1), down(axis), **ONE).rgba[0, 0]
    optical_depth = -np.log1p(-seen[3])
    assert optical_depth == pytest.approx(1.6, rel=8e-3)  # the kernel's ripple
    np.testing.assert_allclose(seen[:3] / seen[3], [0.2, 0.4, 0.8], rtol=1e-6)


def test_extinction_is_per_scene_unit():
    small = block(16, 0.1)
    large = small._replace(position=3 * small.position, lattice=3 * small.lattice)
    thin = large._replace(extinction=large.extinction / 3)
    once, again = (cast_rays(s, down(2), **ONE, look=ONE_RAY).rgba for s in (small, thin))
    np.testing.assert_allclose(once, again, rtol=1e-6)


@pytest.mark.parametrize("reconstruction", [GaussianKernel(), BSplineKernel(1.3)], ids=str)
def test_rays_are_the_sums_of_an_obvious_loop(rng, reconstruction):
    samples = some_samples(rng, share=0.1)  # sparse: most bricks are empty
    camera = a_camera(6, 8)
    look = Casting(rays=1, step=0.02, reconstruction=reconstruction)
    seen = cast_rays(samples, camera, height=6, width=8, look=look).rgba
    rotation, shift = camera.world_to_camera[:3, :3], camera.world_to_camera[:3, 3]
    for row, column in [(2, 3), (3, 4), (1, 5), (4, 2)]:
        way = np.array([column + 0.5 - camera.cx, row + 0.5 - camera.cy, camera.fx])
        way = rotation.T @ (way / np.linalg.norm(way))
        eye = -rotation.T @ shift
        expected = naive_ray(samples, eye, way, 25.0, 1250, reconstruction)
        np.testing.assert_allclose(seen[row, column], expected, atol=3e-5)  # other steps of 0.02
    assert seen[..., 3].max() > 0.05


def test_what_is_nearer_hides_what_is_farther():
    node = nodes(8, 8, 8) - 3.5
    color = np.where(node[:, 2:] < 0, np.float32([1, 0, 0]), np.float32([0, 0, 1]))
    two = Samples(node, color, np.full(len(node), 0.25, np.float32), np.eye(3))
    red, green, blue, alpha = cast_rays(two, down(2), **ONE).rgba[0, 0]
    assert (green, alpha) == (0, pytest.approx(1 - np.exp(-2), abs=3e-3))
    # Where the halves meet, kernels mix them over 2 voxels; ripple.
    assert red == pytest.approx(1 - np.exp(-1), abs=5e-3)
    assert blue == pytest.approx(np.exp(-1) - np.exp(-2), abs=5e-3)


def test_the_error_falls_with_the_square_of_the_step(rng):
    samples = some_samples(rng)

    def seen(step):
        look = Casting(rays=1, step=step)
        return cast_rays(samples, a_camera(), height=20, width=30, look=look).rgba

    truth = seen(0.01)
    coarse, fine = (np.sqrt(np.mean((seen(step) - truth) ** 2)) for step in (0.4, 0.1))
    assert 12 < coarse / fine < 22  # 16
    assert fine < 1e-4


def test_pixels_are_means_over_their_rays(rng):
    samples = some_samples(rng)
    fine = a_camera(40, 60)
    rays = cast_rays(samples, fine, height=40, width=60, look=Casting(rays=1)).rgba
    means = rays.reshape(20, 2, 30, 2, 4).mean(axis=(1, 3))
    seen = cast_rays(samples, a_camera(), height=20, width=30, look=Casting(rays=2)).rgba
    np.testing.assert_allclose(seen, means, atol=1e-6)


@pytest.mark.parametrize("kind", ["perspective", "inside", "near plane", "parallel"])
def test_transmittance_is_that_of_exact_splats(rng, kind):
    samples = some_samples(rng)
    pose = look_at([4, -8, 5], [4.0, 4.5, 1.0])
    inside = look_at([4.0, 4.0, 1.0], [5.0, 9.0, 0.0])
    camera = {
        "perspective": a_camera(),
        "inside": Camera.from_fov(60, height=20, width=30, world_to_camera=inside),
        "near plane": a_camera(near=12.0),
        "parallel": Orthographic(2, 3, 15, 10, pose, 11.0),
    }[kind]
    size = {"height": 20, "width": 30}
    seen = cast_rays(samples, camera, **size, look=Casting(rays=2, step=0.1)).rgba[..., 3]
    splats = Resampler(primitive=Primitive.SPLATS, subpixels=2)
    alpha = splats(samples, camera, **size).rgba[..., 3]
    assert alpha.max() > 0.3
    # Steps of 0.1, tables of float32; where a plane cuts, the kernel ends abruptly.
    np.testing.assert_allclose(seen, alpha, atol=2e-4)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_plane_through_the_middle_leaves_half(axis):
    plane = np.append(np.eye(3)[axis], 0.0)
    halves = [
        cast_rays(block(10, 0.1), down(axis), **ONE, look=Casting(clip=side * plane))
        for side in (1, -1)
    ]
    whole = cast_rays(block(10, 0.1), down(axis), **ONE)
    depth = [-np.log1p(-cast.rgba[0, 0, 3]) for cast in (*halves, whole)]
    assert depth[0] == pytest.approx(depth[1], rel=1e-5)
    assert depth[0] + depth[1] == pytest.approx(depth[2], rel=1e-5)


def test_the_near_plane_is_a_plane_to_clip_with():
    samples = block(10, 0.1)
    near = cast_rays(samples, down(2, near=1.25), **ONE).rgba
    clipped = cast_rays(samples, down(2), **ONE, look=Casting(clip=[0, 0, 1, -1.25])).rgba
    np.testing.assert_allclose(near, clipped, rtol=1e-6)
    assert near[0, 0, 3] < 0.5


def test_planes_may_leave_nothing():
    planes = [[0, 0, 1, 0], [0, 0, -1, -1]]
    assert not cast_rays(block(4, 1), down(2), **ONE, look=Casting(clip=planes)).rgba.any()


def test_the_number_of_threads_changes_no_bit(rng):
    samples = some_samples(rng)
    size = {"height": 20, "width": 30, "look": Casting(rays=2)}
    one, two = (cast_rays(samples, a_camera(), **size, threads=n) for n in (1, 2))
    assert np.array_equal(one.rgba, two.rgba)
    assert np.array_equal(one.depth, two.depth)


def test_progress_ends_at_one(rng):
    told = []
    cast_rays(some_samples(rng), a_camera(), height=20, width=30, progress=told.append)
    assert told == sorted(told)
    assert told[-1] == 1


def test_no_samples_give_an_empty_picture():
    nothing = Samples(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.eye(3))
    seen = cast_rays(nothing, a_camera(), height=2, width=3)
    assert seen.rgba.shape == (2, 3, 4)
    assert not seen.rgba.any()
    assert np.isinf(seen.depth).all()


# Input that is refused


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"rays": 0}, "0 rays per side of a pixel; 1 to 64"),
        ({"step": 0.0}, r"a step of 0.0 voxels; it must be above 0"),
        ({"step": np.nan}, "it must be above 0"),
        ({"clip": [[1, 0, 0]]}, r"clipping planes have the shape \(M, 4\), not \(1, 3\)"),
        ({"clip": [1, 0, 0, np.nan]}, r"clipping planes must be finite"),
    ],
)
def test_choices_outside_their_range_are_refused(wrong, message):
    with pytest.raises(ValueError, match=message):
        Casting(**wrong)


def test_samples_off_their_lattice_are_refused():
    samples = block(3, 1.0)
    moved = samples.position.copy()
    moved[5] += 0.3
    with pytest.raises(ValueError, match="do not stand on their lattice"):
        cast_rays(samples._replace(position=moved), down(2), **ONE)


def test_two_samples_on_one_node_are_refused():
    samples = block(3, 1.0)
    twice = samples.position.copy()
    twice[5] = twice[6]
    with pytest.raises(ValueError, match="two samples stand on one node"):
        cast_rays(samples._replace(position=twice), down(2), **ONE)


def test_samples_far_apart_are_refused_before_memory_is_taken():
    ends = np.array([[0, 0, 0], [1e6, 1e6, 1e6]], np.float32)
    samples = Samples(ends, np.ones((2, 3)), np.ones(2), np.eye(3))
    with pytest.raises(ValueError, match="lattice around these samples"):
        cast_rays(samples, down(2), **ONE)


@pytest.mark.parametrize("size", [{"height": 0, "width": 3}, {"height": 3, "width": -1}])
def test_no_picture_is_no_size(size):
    with pytest.raises(ValueError, match="both must be at least 1"):
        cast_rays(block(3, 1.0), down(2), **size)
