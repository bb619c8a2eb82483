"""Autograd's own check of both functions. Needs PyTorch, which is an extra: `[torch]`."""

import numpy as np
import pytest

from resample_gradients import LinearWarp, MatrixPlaces

torch = pytest.importorskip("torch")

from resample_gradients.torch import warp, warp_by_map  # noqa: E402 - there is no other way

EDGES = ("transparent", "clamp", "wrap", "mirror", "reflect-101")
MATRICES = np.array([
    [[1.3, 0.2, -0.5], [-0.2, 1.1, 0.6], [0.01, 0.02, 1.0]],
    [[0.613, 0.107, 0.43], [0.191, 0.709, 0.31], [0.0, 0.01, 1.0]],
])  # fmt: skip
FRAME = (4, 5)


def tensor(array, dtype=None, *, grad=True):
    made = torch.from_dlpack(np.ascontiguousarray(array, np.float64)).clone()
    return made.to(dtype or torch.float64).requires_grad_(grad)


def picture():
    return tensor(np.random.default_rng(7).standard_normal((2, 2, 6, 5)))


def places():
    row, column = np.mgrid[: FRAME[0], : FRAME[1]] + 0.5
    jitter = np.random.default_rng(3).uniform(-0.2, 0.2, (2, *FRAME, 2))
    return np.stack([1.1 * column + 0.1 * row - 0.3, 1.3 * row - 0.2], axis=2) + jitter


@pytest.mark.parametrize("is_shared", [True, False])
@pytest.mark.parametrize("edge", EDGES)
def test_gradients_by_pictures_and_matrices_pass_autograd_s_check(edge, is_shared):
    matrix = tensor(MATRICES[0] if is_shared else MATRICES)
    call = (lambda image, matrix: warp(image, matrix, FRAME, edge=edge), (picture(), matrix))
    assert torch.autograd.gradcheck(*call)


@pytest.mark.parametrize("is_shared", [True, False])
@pytest.mark.parametrize("edge", EDGES)
def test_gradients_by_pictures_and_maps_pass_autograd_s_check(edge, is_shared):
    grid = tensor(places()[0] if is_shared else places())
    call = (lambda image, grid: warp_by_map(image, grid, edge=edge), (picture(), grid))
    assert torch.autograd.gradcheck(*call)


@pytest.mark.parametrize("said", [{"inverse": True}, {"convention": "opencv"}])
def test_matrices_may_be_said_in_other_ways(said):
    def call(matrix):
        return warp(picture().detach(), matrix[:2], FRAME, interpolation="spline", **said)

    assert torch.autograd.gradcheck(call, (tensor(MATRICES[1]),))


def test_pictures_are_those_of_numpy():
    image, chosen = picture(), LinearWarp(edge="wrap")
    shared = warp(image, tensor(MATRICES[0]), FRAME, edge="wrap")
    each = warp(image, tensor(MATRICES), FRAME, edge="wrap")
    for n in (0, 1):
        texels = np.moveaxis(np.from_dlpack(image[n].detach()), 0, 2)
        for tensors, matrix in ((shared, MATRICES[0]), (each, MATRICES[n])):
            expected = chosen(texels, MatrixPlaces(matrix, FRAME, (6, 5)))
            ours = np.moveaxis(np.from_dlpack(tensors[n].detach()), 0, 2)
            np.testing.assert_allclose(ours, expected, atol=1e-14)


def test_types_are_kept():
    image = tensor(np.ones((1, 3, 6, 5)), torch.float32)
    matrix = tensor(MATRICES[0])
    warped = warp(image, matrix, FRAME)
    warped.square().sum().backward()
    assert warped.shape == (1, 3, *FRAME)
    assert (warped.dtype, image.grad.dtype) == (torch.float32, torch.float32)
    assert matrix.grad.dtype == torch.float64


def test_tensors_that_cannot_be_are_refused():
    image = picture()
    with pytest.raises(ValueError, match=r"\(N, C, H, W\)"):
        warp(image[0], tensor(MATRICES[0]), FRAME)
    with pytest.raises(ValueError, match=r"float32 or float64"):
        warp(image.half(), tensor(MATRICES[0]), FRAME)
    with pytest.raises(ValueError, match=r"of \(1, 3, 3\) for 2 pictures"):
        warp(image, tensor(MATRICES[:1]), FRAME)
    with pytest.raises(ValueError, match="x and y of each pixel, not 3"):
        warp_by_map(image, tensor(np.ones((2, 4, 5, 3))))
