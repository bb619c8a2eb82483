"""A seed as a call of the library with odd arrays and numbers."""

import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tests.fuzz.pool import Try

TYPES = (
    *("uint8", "int8", "uint16", "int16", "uint32", "int32", "uint64", "int64", "float16"),
    *(
        "float32",
        "float64",
        "longdouble",
        "complex64",
        "bool",
        "object",
        ">i2",
        ">f4",
        ">f8",
        ">u2",
    ),
    *("S3", "U3", "M8[s]"),
)
SPECIAL = (
    *(0.0, -0.0, 1.0, -1.0, 1e38, -1e38, 1e-38, 1e-45, 5e-324, 1e-30, 1e30, 1e300, 1e-300, 3e38),
    *(float("nan"), float("inf"), float("-inf")),
)


class Odd:
    """Odd values, in the order that a seed gives them."""

    def __init__(self, seed: int, folder: Path, oddness: float) -> None:
        self.rng, self.folder, self.oddness = random.Random(seed), folder, oddness
        self.values = np.random.default_rng(seed)

    def is_odd(self) -> bool:
        return self.rng.random() < self.oddness

    def number(self, usual: float) -> Any:
        """A number, mostly as it usually is."""
        if not self.is_odd():
            return usual
        if self.rng.random() < 0.4:
            return self.rng.choice(SPECIAL)
        if self.rng.random() < 0.1:
            return self.rng.choice((None, "1", True, 7, np.float32(2), [1.0], 1j))
        return self.rng.choice((1, 1, -1)) * usual * 10.0 ** self.rng.uniform(-38, 38)

    def numbers(self, usual: Any) -> Any:
        """Array of numbers, of which some are odd; rarely of another kind."""
        made = np.array(usual, np.float64)
        if self.is_odd():
            flat = made.reshape(-1)
            for n in self.rng.sample(range(flat.size), self.rng.choice((1, 1, flat.size))):
                found = self.number(float(flat[n]))
                flat[n] = found if isinstance(found, float) else flat[n]
        if self.is_odd():
            made = made * 10.0 ** self.rng.uniform(-38, 38)
        return self.laid(made) if self.rng.random() < 0.2 * self.oddness else made

    def array(self, shape: tuple[int, ...], dtype: str = "float32") -> Any:
        """Array of noise of an odd type, layout, shape or content."""
        made: Any = self.values.random(shape) * (255 if dtype == "uint8" else 1)
        if not made.size:
            return made.astype(dtype)
        if self.is_odd():
            made.reshape(-1)[self.rng.randrange(made.size)] = self.rng.choice(SPECIAL)
        if self.is_odd():
            made = made * 10.0 ** self.rng.uniform(-38, 38)
        with np.errstate(all="ignore"):
            made = made.astype(self.rng.choice(TYPES) if self.is_odd() else dtype)
        if self.is_odd():
            made = self.shaped(made)
        return self.laid(made) if self.is_odd() and np.ndim(made) else made

    def shaped(self, made: Any) -> Any:
        """Another shape, with none, fewer or more axes."""
        return self.rng.choice(
            (made[:0], made[..., :0], made[:1], made[None], made[..., None], made[0], made.ravel())
        )

    def laid(self, made: Any) -> Any:
        """The same values elsewhere: another layout, a file, a list; or none at all."""
        forms: tuple[Callable[[], Any], ...] = (
            lambda: np.asfortranarray(made),
            lambda: np.repeat(made, 2, axis=0)[::2],
            lambda: made[::-1],
            lambda: self.mapped(made),
            made.tolist,
            lambda: np.ma.masked_invalid(made) if made.dtype.kind == "f" else made,
            lambda: np.broadcast_to(made[:1], made.shape) if made.ndim else made,
            lambda: made.astype(made.dtype.newbyteorder()),
            lambda: made.view(np.recarray),
            lambda: self.rng.choice((None, True, 3, "none", 1.5, {}, b"", object(), [[1], [1, 2]])),
        )
        return self.rng.choice(forms)()

    def mapped(self, made: Any) -> Any:
        if made.dtype.hasobject:
            return made
        path = self.folder / f"{len(list(self.folder.iterdir()))}.npy"  # others are still mapped
        np.save(path, made)
        return np.load(path, mmap_mode="r")

    def at_ends(self) -> tuple[tuple[int, ...], Any, tuple[int, int]]:
        """Shape, spacing and size of a picture at the ends of what is allowed."""
        shape = tuple(self.rng.choice((1, 2, 7)) for _ in range(3))
        size = self.rng.choice(((1, 1), (1, 9), (24, 20)))
        base = 10.0 ** self.rng.choice((-12, 11, self.rng.uniform(-12, 11)))
        if self.rng.random() < 0.5:
            return shape, np.full(3, base), size
        return shape, np.clip(base * 10.0 ** self.values.uniform(-3, 3, 3), 1e-12, 1e12), size

    def size(self) -> tuple[Any, Any]:
        """Width and height of a picture."""
        if not self.is_odd():
            return 24, 20
        return self.rng.choice(
            ((0, 5), (1, 1), (-1, 4), (2.5, 3), (1 << 40, 2), (3, None), ("a", 1))
        )


def _camera(odd: Odd) -> Any:
    from resample import Camera, Orthographic, look_at

    kind = odd.rng.randrange(5)
    if kind == 0:
        return Camera.from_fov(odd.number(50.0), 20, 24)
    if kind == 1:
        pose = look_at(odd.numbers([4.0, 3, 5]), odd.numbers([0.0, 0, 0]))
        return Camera.from_fov(odd.number(50.0), 20, 24).moved(pose)
    if kind == 2:
        matrix = [[20.0, 0, 12], [0, 20, 10], [0, 0, 1]]
        return Camera.from_opencv(odd.numbers(matrix), odd.numbers([0.01, 0, 0, 0]))
    if kind == 3:
        pose = odd.numbers([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 9], [0, 0, 0, 1]])
        return Camera.from_fov(50.0, 20, 24).moved(pose)
    return Orthographic(odd.number(3.0), odd.number(3.0), odd.number(12.0), odd.number(10.0))


def _render(odd: Odd) -> None:
    from resample_volume import Volume, render

    volume = Volume(
        odd.array((6, 7, 8), "uint8"),
        odd.numbers([1.0, 1, 1]),
        odd.numbers([0.0, 0, 0]),
        odd.numbers(np.eye(3)),
        "odd",
    )
    look = odd.rng.choice(("auto", "auto", "100..200"))
    eye = odd.rng.choice((None, (30, 20), (odd.number(30.0), odd.number(20.0), odd.number(1.0))))
    render(volume, look, eye if odd.rng.random() < 0.7 else _camera(odd), size=odd.size())


def _ends(odd: Odd) -> None:
    from resample_volume import Volume, render

    shape, spacing, size = odd.at_ends()
    values = odd.values.integers(0, 255, shape, np.uint8)
    volume = Volume(values, spacing, np.zeros(3), np.eye(3), "ends")
    zoom = odd.rng.choice((1.0, 0.05, 5.0, 50.0))
    picture = render(volume, odd.rng.choice(("auto", "100..200")), (30, 20, zoom), size=size).rgba
    if not np.isfinite(picture).all():
        raise RuntimeError("a picture of what is not finite")


def _taken(odd: Odd) -> None:
    from resample_volume import as_volume, render

    render(as_volume(odd.array((6, 7, 8), odd.rng.choice(("uint8", "float32")))), size=(24, 20))


def _warp(odd: Odd) -> None:
    from resample_texture import warp

    image = odd.array(odd.rng.choice(((12, 14), (12, 14, 3), (12, 14, 4))), "uint8")
    matrix = odd.numbers([[0.9, -0.2, 3], [0.2, 0.9, 0], [0, 0.002, 1]])
    edge = odd.rng.choice(("transparent", "clamp", "wrap", "mirror"))
    warp(image, matrix, odd.size()[::-1], edge=edge)


def _everyday(odd: Odd) -> None:
    from resample_texture import resize, rotate, scale, undistort, warp_points

    image = odd.array((12, 14, 3), "uint8")
    kind = odd.rng.randrange(6)
    if kind == 0:
        rotate(image, odd.number(30.0))
    elif kind == 1:
        scale(image, odd.number(0.7))
    elif kind == 2:
        undistort(image, odd.numbers([9, 9, 6.5, 5.5]), odd.numbers([0.1, 0.01, 0, 0]))
    elif kind == 3:
        warp_points(odd.numbers([[3, 4], [5, 6]]), odd.numbers([[1, 0, 3], [0, 1, 4]]))
    elif kind == 4:
        resize(image, odd.number(0.7), fit=odd.rng.choice((None, "pad")))
    else:
        resize(image, odd.size(), box=(2, 2, 10, 10))


def _depth(odd: Odd) -> None:
    from resample import Camera
    from resample_warp3d import warp

    color = odd.array((20, 24, 3))
    depth: Any = 2 + odd.array((20, 24)) if odd.rng.random() < 0.3 else odd.array((20, 24))
    source = Camera.from_fov(50, 20, 24) if odd.rng.random() < 0.5 else _camera(odd)
    warp(color, depth, source, _camera(odd), size=odd.size())


def _disparity(odd: Odd) -> None:
    from resample_warp3d import warp_disparity

    warp_disparity(odd.array((20, 24, 3)), odd.array((20, 24)), odd.number(0.5))


def _cloud(odd: Odd) -> None:
    from resample_points import Cloud, framed, render_cloud

    position = odd.array((60, 3))
    some = odd.rng.choice((0, 60))
    cloud = Cloud(position, odd.array((some, 3)), odd.array((some, 3)), odd.array((some,)))
    camera = framed(cloud, size=(24, 20)) if odd.rng.random() < 0.7 else _camera(odd)
    render_cloud(cloud, camera, size=odd.size())


def _samples(odd: Odd) -> None:
    from resample import Resampler, Samples

    place = odd.array((30, 3))
    place = place + np.array([0, 0, 4]) if isinstance(place, np.ndarray) else place
    lattice = odd.numbers(0.2 * np.eye(3))
    samples = Samples(place, odd.array((30, 3)), odd.array((30,)), lattice)
    width, height = odd.size()
    Resampler()(samples, _camera(odd), height=height, width=width)


def particles_of(odd: Odd) -> None:
    """Particles at odd places, of odd radii."""
    from resample import Resampler, particles

    place = odd.array((30, 3)) + np.array([0, 0, 4], np.float32)
    made = particles(place, odd.array((30, 3)), odd.number(0.5), odd.number(0.1))
    Resampler()(made, _camera(odd), height=20, width=24)


def _scatter(odd: Odd) -> None:
    from resample import Scatter

    place = odd.array((30, 2)) * 20
    if odd.rng.random() < 0.5:
        Scatter()(place, odd.array((30,)), jacobian=odd.numbers(np.eye(2)), shape=(20, 24))
    else:
        Scatter()(place, odd.array((30, 2)), radius=odd.number(1.5), shape=odd.size())


def _transfer(odd: Odd) -> None:
    from resample_volume import TransferFunction, render

    value = odd.array((3,)) if odd.is_odd() else odd.numbers([0.0, 100, 200])
    look = TransferFunction(value, odd.array((3, 3)), odd.array((3,)), odd.number(1.0))
    from resample_volume import Appearance

    render(odd.values.integers(0, 255, (6, 7, 8), np.uint8), Appearance(look), size=(24, 20))


CALLS: tuple[Callable[[Odd], None], ...] = (
    *(_render, _render, _taken, _warp, _everyday, _depth, _disparity, _cloud, _samples),
    *(particles_of, _scatter, _transfer, _ends),
)


def call_of(seed: int) -> Callable[[Odd], None]:
    """What a seed calls."""
    return CALLS[seed % len(CALLS)]


def make() -> Try:
    """A call of the library that a seed stands for."""

    def attempt(seed: int, folder: Path) -> None:
        odd = Odd(seed, folder, (0.05, 0.15, 0.4)[seed // len(CALLS) % 3])
        with np.errstate(all="ignore"):
            call_of(seed)(odd)

    return attempt
