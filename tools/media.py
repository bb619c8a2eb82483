"""Pictures of the documents that show pages or move: `make media` makes them anew.

Pages are those that the commands serve, in a headless Chromium; they are used as a user would. With
a folder of volumes (`--data`) the engine is shown, else a generated tree of vessels.
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
SMALL = {"width": 900, "height": 480}  # px, of what moves
TIME = 120_000  # ms; kernels may have to be compiled
STEP = 60  # ms between pictures of a drag
STILL = """() => document.querySelector('.canvas img').dataset.preview === 'false'
    && document.querySelector('.canvas').getAttribute('aria-busy') === 'false'
    && !document.querySelector('.notice')"""

BLOCKS = "checker-box:size=96,block=4"
FLICKER = 96  # px of a side
LARGER = 3  # px that stand for one
TURNS, TURN = 12, 0.25  # pictures, degrees between them


@contextmanager
def served(*words: str) -> Iterator[str]:
    """Address of the page that a command of this environment serves."""
    command = [str(Path(sys.executable).parent / words[0]), *words[1:], "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            yield next(line.split()[-1] for line in process.stdout if "http://" in line)
        finally:
            process.terminate()


@contextmanager
def browser() -> Iterator[Any]:
    """A browser without a window."""
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
    """A page whose whole picture is there."""
    tab = opened.new_page(viewport=size)
    tab.set_default_timeout(TIME)
    for _ in range(2):  # the second time nothing is compiled
        tab.goto(address)
        tab.wait_for_function(STILL)
    yield tab
    tab.close()


def shot(tab: Any) -> Image.Image:
    """What a page shows."""
    return Image.open(BytesIO(tab.screenshot())).convert("RGB")


def middle(tab: Any) -> tuple[float, float]:
    """Middle of the picture on the page, px."""
    box = tab.locator(".canvas").bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def settled(tab: Any) -> None:
    """Wait for the whole picture."""
    tab.wait_for_timeout(5 * STEP)
    tab.wait_for_function(STILL)


def stills(opened: Any, folder: Path, volume: str) -> None:
    """One picture of each kind of page."""
    with (
        served("resample-volume", "view", volume, "--box", "--scale-bar") as address,
        page(opened, address, WINDOW) as tab,
    ):
        tab.mouse.click(*middle(tab))
        settled(tab)
        shot(tab).save(IMAGES / "viewer.png", optimize=True)
    with (
        served("resample-volume", "view", volume, "--clip=0.6/0.8/0", "--crop=40:,:,:") as address,
        page(opened, address, WINDOW) as tab,
    ):
        tab.click("#clip")
        tab.click("#crop")
        settled(tab)
        shot(tab).save(IMAGES / "viewer-cuts.webp", quality=80)
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


def picture(folder: Path) -> str:
    """File of a wall of bricks."""
    from resample_texture.showing.figures import generated

    levels = np.rint(255 * np.clip(generated("bricks").picture, 0, 1)).astype(np.uint8)
    Image.fromarray(np.squeeze(levels)[:480, :640]).save(folder / "bricks.png")
    return str(folder / "bricks.png")


def depth_image(folder: Path) -> tuple[str, str]:
    """Files of a generated depth image."""
    from resample.colors import to_srgb
    from resample_warp3d.showing.scenes import generated

    image = generated(480).depth_image(4)
    levels = np.rint(255 * to_srgb(image.color)).astype(np.uint8)
    Image.fromarray(levels).save(folder / "room.png")
    np.save(folder / "room.npy", 1 / image.nearness)
    return str(folder / "room.png"), str(folder / "room.npy")


def moving(opened: Any, volume: str) -> None:
    """A volume that is turned by a drag, then looked at from the top."""
    shots = []
    with (
        served("resample-volume", "view", volume, "--box") as address,
        page(opened, address, SMALL) as tab,
    ):
        x, y = middle(tab)
        shots.append(shot(tab))
        tab.mouse.move(x - 90, y)
        tab.mouse.down()
        for n in range(24):
            tab.mouse.move(x - 90 + 9 * n, y + 2 * n)
            tab.wait_for_timeout(STEP)
            shots.append(shot(tab))
        tab.mouse.up()
        settled(tab)
        shots += [shot(tab)] * 8
        tab.select_option("#views", "top")
        settled(tab)
        shots += [shot(tab)] * 12
    film(IMAGES / "viewer.webp", shots, 80)


def flicker() -> None:
    """A checker box far away that turns: one ray a pixel, and ours, enlarged without smoothing."""
    from resample_volume import Appearance, Scene
    from resample_volume.media.appearance import transfer_of
    from resample_volume.rivals.peers import VtkRenderer

    scene, size = Scene(BLOCKS), (FLICKER, FLICKER)
    look = Appearance("checker", light=None)
    peer, shots = None, []
    for n in range(TURNS):
        viewpoint = (30 + TURN * n, 20, 0.95)
        camera, placed = scene.standing(look, viewpoint, size=size)
        ours = scene.render(look, viewpoint, size=size)
        if peer is None:
            transfer = transfer_of(scene.volume, look)
            peer = VtkRenderer(placed, transfer, height=FLICKER, width=FLICKER)
        shots.append(beside(levels_of(peer.render(camera)), ours.to_uint8(background=(0, 0, 0))))
    film(IMAGES / "flicker.webp", shots + shots[::-1], 90)


def levels_of(light: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Levels of premultiplied linear light before black."""
    from resample.colors import to_srgb

    return np.asarray(np.rint(255 * to_srgb(np.clip(light[..., :3], 0, 1))), np.uint8)


def beside(left: NDArray[np.uint8], right: NDArray[np.uint8]) -> Image.Image:
    """Two pictures beside each other, pixels enlarged."""
    both = np.concatenate(
        [left[..., :3], np.full((FLICKER, 2, 3), 90, np.uint8), right[..., :3]], 1
    )
    return Image.fromarray(both.repeat(LARGER, 0).repeat(LARGER, 1))


def film(path: Path, shots: list[Image.Image], milliseconds: int) -> None:
    """Write pictures that go round and round."""
    first, *more = shots
    first.save(
        path, save_all=True, append_images=more, duration=milliseconds, loop=0, quality=70, method=6
    )


def main() -> int:
    """Make all of them."""
    parser = argparse.ArgumentParser(prog="python tools/media.py", description=__doc__)
    parser.add_argument("--data", type=Path, help="folder of volumes, with engine.nhdr")
    data = parser.parse_args().data
    volume = "vessel-tree:size=128" if data is None else str(data / "engine.nhdr")
    flicker()
    with tempfile.TemporaryDirectory(prefix="media-") as name, browser() as opened:
        stills(opened, Path(name), volume)
        moving(opened, volume)
    return 0


if __name__ == "__main__":
    sys.exit(main())
