"""The commands of docs/howto/jobs.md run as they are printed there, on files made by formulas."""

import re
import shlex
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
import SimpleITK
import tifffile
from numpy.typing import NDArray
from PIL import Image
from scipy.ndimage import gaussian_filter

from resample_volume import cli
from tests.commands import ended

with suppress(ImportError):  # before a test opens a shell of IPython, which its log asks for
    import astropy.io.fits  # noqa: F401

PAGE = Path(__file__).parents[2] / "docs/howto/jobs.md"
SECTION = re.compile(r"^## (.+?)$(.*?)(?=^## |\Z)", re.MULTILINE | re.DOTALL)
JOBS = dict(SECTION.findall(PAGE.read_text(encoding="utf-8")))


def places(side: int) -> tuple[NDArray[np.float64], ...]:
    """Coordinates z, y and x from -1 to 1."""
    grid = np.linspace(-1, 1, side)
    return tuple(np.meshgrid(grid, grid, grid, indexing="ij"))


def ball(side: int, place: tuple[float, float, float], radius: float) -> NDArray[np.bool_]:
    """Voxels around a place (z, y, x)."""
    return np.sqrt(sum((a - b) ** 2 for a, b in zip(places(side), place, strict=True))) < radius


def write_files(folder: Path, side: int) -> None:
    """Write what the page speaks of, of `side` voxels along each axis."""
    rng = np.random.default_rng(7)
    _write_patient(folder, side, rng)
    # Cells: nuclei, their bodies, and grains.
    cells = [
        sum(200.0 * ball(side, place, radius) for place in rng.uniform(-0.7, 0.7, (many, 3)))
        for many, radius in ((9, 0.12), (9, 0.22), (40, 0.04))
    ]
    stack = np.stack([gaussian_filter(np.minimum(one, 200), side / 90) for one in cells])
    tifffile.imwrite(
        folder / "cells.ome.tif", stack.astype(np.uint8).swapaxes(0, 1), metadata={
            "axes": "ZCYX", "PhysicalSizeX": 0.2, "PhysicalSizeY": 0.2, "PhysicalSizeZ": 0.2,
        },
    )  # fmt: skip
    # Two vortices that turn against each other, and a weaker one.
    z, y, x = places(side)
    turns = sum(
        sign * np.exp(-(((x - at) ** 2 + (y - 0.2 * np.sin(4 * z + at)) ** 2) / 0.02))
        for at, sign in ((-0.5, 1), (0.0, -1), (0.5, 0.6))
    )
    np.save(folder / "vorticity.npy", (40 * turns).astype(np.float32))
    _write_cube(folder / "cube.fits", side, rng)


def _write_patient(folder: Path, side: int, rng: np.random.Generator) -> None:
    """Write CT with a table, PET and labels of one patient."""
    _, y, x = places(side)
    body = (x / 0.7) ** 2 + (y / 0.45) ** 2 < 1
    lungs = ball(side, (0, 0, -0.3), 0.25) | ball(side, (0, 0, 0.3), 0.25)
    spine = np.hypot(x, y - 0.3) < 0.1
    lesions = ball(side, (0.1, 0, 0.25), 0.06) | ball(side, (-0.5, 0.1, -0.4), 0.05)
    ct = np.select([spine, lungs, body, np.abs(y - 0.7) < 0.03], [800, -800, 40, 200], -1000)
    uptake = np.select([lesions, ball(side, (-0.75, 0, 0), 0.15), lungs, body], [9, 15, 0.3, 0.8])
    for name, values in (
        ("ct", gaussian_filter(ct.astype(float), 0.7) + rng.normal(0, 15, ct.shape)),
        ("pet", gaussian_filter(uptake, 1.0) * rng.normal(1, 0.05, ct.shape)),
        ("labels", np.select([spine, lungs], [1, 2])),
    ):
        kind = np.float32 if name == "pet" else np.int16
        image = SimpleITK.GetImageFromArray(values.astype(kind))
        image.SetSpacing((400 / side,) * 3)
        SimpleITK.WriteImage(image, str(folder / f"{name}.nii.gz"))


def _write_cube(path: Path, side: int, rng: np.random.Generator) -> None:
    """Write a disc of gas that turns: right ascension, declination, velocity."""
    fits = pytest.importorskip("astropy.io.fits")
    v, y, x = places(side)
    radius = np.hypot(x, 2 * y)
    speed = 0.7 * x / np.maximum(radius, 0.1)
    gas = np.exp(-((radius - 0.5) ** 2) / 0.06) * np.exp(-((v - speed) ** 2) / 0.01)
    header = fits.Header()
    header.update(BUNIT="Jy/beam", CTYPE1="RA---TAN", CTYPE2="DEC--TAN", CTYPE3="VRAD")
    header.update(CUNIT1="deg", CUNIT2="deg", CUNIT3="km/s", CDELT1=-0.01, CDELT2=0.01, CDELT3=5.0)
    noise = rng.normal(0, 0.01, gas.shape)
    fits.writeto(path, (gas + noise).astype(np.float32), header)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Folder with the files of all jobs."""
    folder = tmp_path_factory.mktemp("jobs")
    write_files(folder, 40)
    return folder


@pytest.mark.parametrize("job", JOBS)
def test_a_job_is_done_by_the_commands_that_are_printed(job, files, monkeypatch):
    monkeypatch.chdir(files)
    lines = re.findall(r"^\$ (resample-volume .+)$", JOBS[job], re.MULTILINE)
    assert lines
    for line in lines:
        words = shlex.split(line)[1:]
        assert ended(cli.app, *words) == 0
        if "-o" in words:
            with Image.open(words[words.index("-o") + 1]) as picture:
                levels = np.asarray(picture.convert("RGB"))
            assert np.ptp(levels[: levels.shape[0] // 2]) > 100


@pytest.mark.parametrize("job", JOBS)
def test_a_job_has_a_picture(job):
    (picture,) = re.findall(r"!\[.+\]\((.+)\)", JOBS[job])
    assert (PAGE.parent / picture).is_file()
