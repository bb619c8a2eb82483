"""Python in README and the documents runs as it is written there, given what it speaks of."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import resample_volume
from tests import printed, snapshots

ROOT = Path(__file__).parents[2]
PAGES = ("README.md", "apps/texture/README.md", "apps/warp3d/README.md", "docs/library.md")
PAGES += ("apps/points/README.md", "docs/plugins.md", "docs/viewer.md", "docs/index.md")
PAGES += ("docs/scale.md",)
HOWTOS = (
    "application",
    "clouds",
    "coordinates",
    "gaussians",
    "network_depth",
    "opencv",
    "text",
    "xrays",
)
SLOW = ("particles", "planes", "projections")

EXTRA = "which is not installed: pip install 'hybrid-resample["

HEADER = """NRRD0004
type: uint8
dimension: 3
sizes: {}
encoding: raw
data file: engine_256x256x128_uint8.raw
"""


def blocks_of(page: str) -> list[str]:
    """A page's blocks of Python."""
    text = (ROOT / page).read_text(encoding="utf-8")
    return re.findall(r"```python\n(.*?)```", text, re.DOTALL)


def blocks() -> Iterator[Any]:
    """Each page's blocks of Python."""
    for page in PAGES:
        for number, found in enumerate(blocks_of(page), 1):
            yield pytest.param(found, id=f"{page}-{number}")


def pictures(rng: np.random.Generator) -> dict[str, Any]:
    """What the examples of textures and depth images are given."""
    image = rng.integers(0, 255, (120, 160, 3), np.uint8)
    y, x = np.indices(image.shape[:2], np.float32)
    return {
        "image": image,
        "color": image,
        "film": [image, image],
        "labels": image[..., 0] // 64,
        "matrix": np.array([[0.9, 0.1, 3.0], [-0.1, 1.0, 5.0], [0.0, 1e-4, 1.0]]),
        "frames": image[np.newaxis].repeat(2, axis=0),
        "matrices": np.stack([np.eye(3), np.diag([0.5, 0.5, 1.0])]),
        "camera_matrix": np.array([[150.0, 0, 79.5], [0, 150, 59.5], [0, 0, 1]]),
        "distortion": np.array([-0.1, 0.01, 0.0, 0.0]),
        "corners": np.array([[0.0, 0.0], [160.0, 120.0]]),
        "map_x": x + np.sin(y / 9),
        "map_y": y + 0.5,
        "flow": np.stack([np.sin(y / 20), np.cos(x / 20)], axis=-1),
        "depth": 2.0 + 0.01 * x,
        "pose": np.eye(4),
        "world_to_camera": np.eye(4),
        "gradient": np.ones((120, 160, 3), np.float32),
    }


def particles(rng: np.random.Generator) -> dict[str, Any]:
    """What the example of particles is given."""
    return {
        "position": rng.uniform([-1, -1, 5], [1, 1, 7], (20, 3)),
        "color": rng.uniform(size=(20, 3)),
        "opacity": 0.5,
        "radius": 0.1,
    }


def given(block: str, volume: NDArray[np.uint8]) -> dict[str, Any]:
    """Names that a block uses and does not make."""
    rng = np.random.default_rng(7)
    if "Scatter" in block:
        return {
            "position": rng.uniform(5, 100, (50, 2)),
            "reading": rng.normal(size=50),
            "jacobian": np.tile(np.eye(2), (50, 1, 1)),
        }
    if "particles" in block:
        return particles(rng)
    return pictures(rng) | {
        "resample_volume": resample_volume,
        "scene": resample_volume.Scene(volume),
    }


@pytest.mark.some(3)
@pytest.mark.parametrize("block", list(blocks()))
def test_examples_of_documents_run(
    block: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shape = (128, 256, 256) if "reshape(128" in block else (16, 24, 32)
    volume = np.zeros(shape, np.uint8)
    volume[4:12, 6:18, 8:24] = 200
    volume.tofile("engine_256x256x128_uint8.raw")
    Path("engine.nhdr").write_text(HEADER.format(" ".join(map(str, shape[::-1]))))
    if "slide.zarr" in block:
        pytest.importorskip("zarr", reason="pip install 'hybrid-resample[zarr]'")
        printed.make("slide.zarr")
        block = block.replace("30_000", "300")
    run(block, given(block, volume))


def run(block: str, names: dict[str, Any]) -> None:
    """Run an example, unless it wants an extra that is not there."""
    try:
        exec(compile(block, "example", "exec"), names)
    except ImportError as error:
        if EXTRA not in str(error):
            raise
        pytest.skip(str(error))


def snapshot() -> dict[str, Any]:
    """What the how-to of particles is given, beside a file."""
    pytest.importorskip("h5py", reason="pip install 'hybrid-resample[hdf5]'")
    snapshots.swift(Path("snapshot.hdf5"))
    count = len(snapshots.PLACE)
    return {
        "position": snapshots.PLACE,
        "mass": np.ones(count),
        "smoothing": np.full(count, 0.5),
        "metallicity": np.zeros(count),
    }


@pytest.mark.some(2)
@pytest.mark.parametrize(
    "name", [*HOWTOS, *(pytest.param(one, marks=pytest.mark.sweep) for one in SLOW)]
)
def test_examples_of_a_how_to_run_in_their_order(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    names = snapshot() if name == "particles" else {}
    for block in blocks_of(f"docs/howto/{name}.md"):
        run(block, names)


def test_every_how_to_with_examples_is_run() -> None:
    pages = {path.stem for path in (ROOT / "docs" / "howto").glob("*.md")}
    assert {one for one in pages if blocks_of(f"docs/howto/{one}.md")} == {*HOWTOS, *SLOW}
