"""Create the screenshots and animations of the documentation: `make media`.

Pages are served by the commands and operated in a headless Chromium. With a folder of volumes
(`--data`) the Engine is shown, else a generated vessel tree.
"""

import argparse
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

IMAGES = Path(__file__).parents[1] / "docs" / "images"
BROWSERS = ("chromium", "chromium-browser", "chrome")
WINDOW = {"width": 1100, "height": 680}  # px
WIDE = {"width": 1200, "height": 800}  # px, with slices
SMALL = {"width": 1100, "height": 520}  # px, of animations
TIME = 120_000  # ms; kernels may have to be compiled
STEP = 60  # ms between frames of a drag
STILL = """() => document.querySelector('.canvas img').dataset.preview === 'false'
    && document.querySelector('.canvas').getAttribute('aria-busy') === 'false'
    && !document.querySelector('.notice')"""

NUMBER = "document.querySelector('.canvas img').dataset.number"

BLOCKS = "checker-box:size=96,block=4"
FLICKER = 96  # px, side of the picture
LARGER = 3  # enlargement factor
TURNS, TURN = 12, 0.25  # frames, degrees between them
PANS, PAN = 24, 1 / 8  # frames, px between them
WALLS = (12, 27, 42)  # columns of walls of one voxel


@contextmanager
def served(*words: str) -> Iterator[str]:
    """Serve a page by a command of this environment; yields its address."""
    command = [str(Path(sys.executable).parent / words[0]), *words[1:], "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            yield next(line.split()[-1] for line in process.stdout if "http://" in line)
        finally:
            process.terminate()


@contextmanager
def browser() -> Iterator[Any]:
    """Start a headless browser."""
    from playwright.sync_api import sync_playwright

    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if found is None:
        raise FileNotFoundError(f"no {' or '.join(BROWSERS)} is installed")
    with sync_playwright() as play:
        opened = play.chromium.launch(executable_path=found, args=["--no-sandbox"])
        yield opened
        opened.close()


@contextmanager
def page(opened: Any, address: str, size: dict[str, int]) -> Iterator[Any]:
    """Open a page and wait for its full picture."""
    tab = opened.new_page(viewport=size, color_scheme="dark")
    tab.set_default_timeout(TIME)
    for _ in range(2):  # the second time everything is compiled
        tab.goto(address)
        tab.wait_for_function(STILL)
    yield tab
    tab.close()


def shot(tab: Any) -> Image.Image:
    """Screenshot of a page."""
    return Image.open(BytesIO(tab.screenshot())).convert("RGB")


def middle(tab: Any) -> tuple[float, float]:
    """Center of the picture on the page, px."""
    box = tab.locator(".canvas").bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def settled(tab: Any) -> None:
    """Wait for the full picture."""
    tab.wait_for_timeout(5 * STEP)
    tab.wait_for_function(STILL)


def stills(opened: Any, folder: Path, volume: str) -> None:
    """One screenshot of each kind of page."""
    with (
        served("resample-volume", "view", volume, "--box", "--scale-bar") as address,
        page(opened, address, WINDOW) as tab,
    ):
        tab.mouse.click(*middle(tab))
        settled(tab)
        shot(tab).quantize(256).save(IMAGES / "viewer.png", optimize=True)
    with (
        served("resample-volume", "view", volume, "--clip=0.6/0.8/0", "--crop=40:,:,:") as address,
        page(opened, address, WINDOW) as tab,
    ):
        tab.click("#clip")
        tab.click("#crop")
        settled(tab)
        shot(tab).save(IMAGES / "viewer-cuts.webp", quality=80)
    with served("resample-volume", "view", volume) as address, page(opened, address, WIDE) as tab:
        tab.click("#slices")
        tab.check("#slice-axial-show")
        tab.check("#slice-axial-cut")
        tab.click("#measure")
        settled(tab)
        for place in ((0.45, 0.4), (0.62, 0.6)):
            box = tab.locator("#slice-sagittal").bounding_box()
            x, y = box["x"] + place[0] * box["width"], box["y"] + place[1] * box["height"]
            tab.mouse.click(x, y)
        settled(tab)
        shot(tab).save(IMAGES / "viewer-slices.webp", quality=80)
    with (
        served("resample-texture", "view", picture(folder)) as address,
        page(opened, address, WINDOW) as tab,
    ):
        x, y = middle(tab)
        tab.click("#magnify")
        tab.mouse.move(x + 40, y - 60)
        settled(tab)
        shot(tab).save(IMAGES / "viewer-picture.webp", quality=80)
    words = ("view", *depth_image(folder), "--fov", "60", "--move", "0.4,-0.1,0.2")
    with served("resample-warp3d", *words) as address, page(opened, address, WINDOW) as tab:
        tab.select_option("#option-show", "holes")
        settled(tab)
        shot(tab).save(IMAGES / "viewer-depths.webp", quality=80)


def together(opened: Any, folder: Path, volume: str) -> None:
    """Screenshots of two methods under a divider, of three channels, and of the sheet of keys."""
    words = ("view", volume, "--method", "splats", "--camera", "30,20,3")
    with served("resample-volume", *words) as address, page(opened, address, WINDOW) as tab:
        tab.select_option("#rivals", "method=points")
        settled(tab)
        tab.click("#slides")
        settled(tab)
        shot(tab).save(IMAGES / "viewer-compare.webp", quality=80)
    z, y, x = np.mgrid[-1:1:64j, -1:1:64j, -1:1:64j]
    blobs = [200 * np.exp(-9 * ((x - at) ** 2 + y**2 + z**2)) for at in (-0.4, 0.0, 0.4)]
    np.save(folder / "cells.npy", np.array(blobs).astype(np.uint8))
    words = ("view", str(folder / "cells.npy"), "--channels", "#3366ff,lime,red")
    with (
        served("resample-volume", *words, "--spacing", "0.25,0.25,0.25um") as address,
        page(opened, address, WINDOW) as tab,
    ):
        tab.click("#scales")
        settled(tab)
        shot(tab).save(IMAGES / "viewer-channels.webp", quality=80)
        tab.keyboard.press("?")
        settled(tab)
        shot(tab).save(IMAGES / "viewer-keys.webp", quality=80)


def picture(folder: Path) -> str:
    """Write a picture of a brick wall."""
    from resample_figures.figure_5 import generated

    levels = np.rint(255 * np.clip(generated("bricks").picture, 0, 1)).astype(np.uint8)
    Image.fromarray(np.squeeze(levels)[:480, :640]).save(folder / "bricks.png")
    return str(folder / "bricks.png")


def depth_image(folder: Path) -> tuple[str, str]:
    """Write a generated depth image."""
    from resample.colors import to_srgb
    from resample_comparisons.warp3d.scenes import generated

    image = generated(480).depth_image(4)
    levels = np.rint(255 * to_srgb(image.color)).astype(np.uint8)
    Image.fromarray(levels).save(folder / "room.png")
    np.save(folder / "room.npy", 1 / image.nearness)
    return str(folder / "room.png"), str(folder / "room.npy")


def moving(opened: Any, volume: str) -> None:
    """Animation of a volume that is dragged, then viewed from the top."""
    shots = []
    with (
        served("resample-volume", "view", volume, "--box") as address,
        page(opened, address, SMALL) as tab,
    ):
        x, y = middle(tab)
        shots.append(shot(tab))
        tab.mouse.move(x - 90, y)
        tab.mouse.down()
        for n in range(1, 19):
            before = tab.evaluate(NUMBER)
            tab.mouse.move(x - 90 + 12 * n, y + 3 * n)
            tab.wait_for_function(f"before => {NUMBER} !== before", arg=before)
            shots.append(shot(tab))
        tab.mouse.up()
        settled(tab)
        shots += [shot(tab)] * 8
        tab.select_option("#views", "top")
        settled(tab)
        shots += [shot(tab)] * 12
    film(IMAGES / "viewer.webp", shots, 80)


def flicker() -> None:
    """Animation of a distant rotating checker box: one ray per pixel, and ours, enlarged."""
    from resample_comparisons.volume.peers import VtkRenderer
    from resample_volume import Appearance, Scene
    from resample_volume.appearance import transfer_of

    scene, size = Scene(BLOCKS), (FLICKER, FLICKER)
    look = Appearance("checker", light=None)
    peer, shots = None, []
    for n in range(TURNS):
        viewpoint = (30 + TURN * n, 20, 0.95)
        camera, placed = scene.placed_view(look, viewpoint, size=size)
        ours = scene.render(look, viewpoint, size=size)
        if peer is None:
            transfer = transfer_of(scene.volume, look)
            peer = VtkRenderer(placed, transfer, height=FLICKER, width=FLICKER)
        shots.append(beside(levels_of(peer.render(camera)), ours.to_uint8(background=(0, 0, 0))))
    film(IMAGES / "flicker.webp", shots + shots[::-1], 90)


def panning() -> None:
    """Animation of walls of one voxel at a quarter of a pixel: one ray per pixel, and ours."""
    from resample import Orthographic
    from resample_comparisons.volume.peers import VtkRenderer
    from resample_volume import Appearance, as_volume, render
    from resample_volume.classification.transfer import from_points

    values, size = np.zeros((54, 54, 54), np.uint8), 24  # px
    values[6:48, 6:48, WALLS] = 100
    transfer = from_points([(50, (1, 1, 1), 0.0), (51, (1, 1, 1), 1.0)])
    look, volume = Appearance(transfer, light=None), as_volume(values)
    peer, shots = VtkRenderer(volume, transfer, height=size, width=size), []
    for n in range(PANS):
        pose = np.eye(4)
        pose[:3, 3] = (-26.5, -26.5, 60)
        camera = Orthographic(0.25, 0.25, size / 2 - 1.5 + PAN * n, size / 2, pose)
        ours = render(volume, look, camera, size=(size, size)).to_uint8(background=(0, 0, 0))
        both = [levels_of(peer.render(camera)), ours[..., :3]]
        shots.append(beside(*(one.repeat(4, 0).repeat(4, 1) for one in both)))
    film(IMAGES / "panning.webp", shots + shots[::-1], 90)


def maps() -> None:
    """A scanned town from above: its colors, and the heights above its ground over them."""
    from resample.colors import mapped
    from resample_points import Cloud, raster_of, rasterized

    rng = np.random.default_rng(4)
    x, y = rng.uniform(0, 100, (2, 120_000))
    ground = 4 * np.sin(x / 30) + 3 * np.cos(y / 23)
    z, color = ground.copy(), np.stack([0.10 + 0.05 * np.sin(x / 2), 0.2 + 0 * x, 0.06 + 0 * x], 1)
    is_road = np.abs(y - 50 - 8 * np.sin(x / 25)) < 3
    color[is_road] = 0.25
    for left, low, hue in zip(range(6, 90, 14), (14, 68, 22, 72, 16, 66), range(6), strict=False):
        is_roof = (x > left) & (x < left + 9) & (y > low) & (y < low + 14)
        z[is_roof] = 14 - 0.8 * np.abs(x[is_roof] - left - 4.5)
        color[is_roof] = ((0.45, 0.12, 0.08), (0.3, 0.3, 0.33), (0.5, 0.35, 0.2))[hue % 3]
    for cx, cy, radius in rng.uniform((0, 0, 1.5), (100, 100, 3.5), (60, 3)):
        away = np.hypot(x - cx, y - cy) / radius
        is_tree = (away < 1) & (z == ground) & ~is_road & (rng.random(len(x)) < 0.85)
        z[is_tree] += 3 + 5 * np.sqrt(1 - away[is_tree] ** 2) * rng.uniform(0.8, 1, is_tree.sum())
        color[is_tree] = (0.03, 0.1, 0.03)
    none = np.empty((0, 3))
    town = Cloud(np.stack([x, y, z], 1), none, color.astype(np.float32), np.empty(0))
    raster = raster_of(town, 0.25)
    base = np.concatenate([band for _, band in rasterized(town, raster, "color")])
    height = np.concatenate([band for _, band in rasterized(town, raster)])[..., 0]
    at = (np.arange(raster.width) + 0.5) * raster.resolution
    soil = 4 * np.sin(at / 30) + 3 * np.cos((raster.top - at[:, None]) / 23)
    share = np.clip((height - soil) / 14, 0, 1)
    over = mapped("turbo", share.ravel()).reshape(base.shape) * 0.75 + 0.25 * base
    both = [base, np.where(share[..., None] > 0.1, over, base.mean(axis=2, keepdims=True))]
    picture = levels_of(np.nan_to_num(np.concatenate(both, axis=1)))
    Image.fromarray(picture).save(IMAGES / "map.webp", quality=85, method=6)


def levels_of(light: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Levels of premultiplied linear light over black."""
    from resample.colors import to_srgb

    return np.asarray(np.rint(255 * to_srgb(np.clip(light[..., :3], 0, 1))), np.uint8)


def beside(left: NDArray[np.uint8], right: NDArray[np.uint8]) -> Image.Image:
    """Two pictures side by side, enlarged."""
    both = np.concatenate(
        [left[..., :3], np.full((FLICKER, 2, 3), 90, np.uint8), right[..., :3]], 1
    )
    return Image.fromarray(both.repeat(LARGER, 0).repeat(LARGER, 1))


def film(path: Path, shots: list[Image.Image], milliseconds: int) -> None:
    """Write pictures as a looping animation."""
    first, *more = shots
    first.save(
        path, save_all=True, append_images=more, duration=milliseconds, loop=0, quality=70, method=6
    )


def main() -> int:
    """Create all files."""
    parser = argparse.ArgumentParser(prog="python tools/media.py", description=__doc__)
    parser.add_argument("--data", type=Path, help="folder of volumes, with engine.nhdr")
    data = parser.parse_args().data
    volume = "vessel-tree:size=128" if data is None else str(data / "engine.nhdr")
    flicker()
    panning()
    maps()
    with tempfile.TemporaryDirectory(prefix="media-") as name, browser() as opened:
        stills(opened, Path(name), volume)
        together(opened, Path(name), volume)
        moving(opened, volume)
    return 0


if __name__ == "__main__":
    sys.exit(main())
