"""A sheet of a golden picture that has changed: before, after, their difference, and captions."""

import math
import re
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

FOLDER = Path(tempfile.gettempdir()) / "golden-failures"
PANEL = 240  # px, width of a panel at least
CAPTION = 20  # px, height of what is written over it
GAP = 8  # px between panels
ROW = 128  # numbers of pictures without rows that are put side by side


def captions(before: Any, after: Any, decibels: tuple[float, float] | None) -> list[str]:
    """What stands over the panels: which they are, dB to the truth, how much is amplified."""
    told = [f", {found:.2f} dB to the truth" for found in decibels or ()] or ["", ""]
    return [
        f"before{told[0]}",
        f"after{told[1]}",
        f"after minus before, {amplified(before, after)} times, on gray",
    ]


def amplified(before: Any, after: Any) -> int:
    """Factor, a power of two, that brings the largest difference to half of the range."""
    largest = float(np.abs(shown(after, before) - shown(before, before)).max())
    return 1 if largest == 0 else 2 ** max(0, math.floor(math.log2(0.5 / largest)))


def shown(picture: Any, like: Any) -> Any:
    """RGB (H, W, 3) from 0 to 1: light as it is, values by the range of another picture."""
    low, high = (
        (0.0, 1.0) if like.ndim == 3 or like.shape[-1] in (3, 4) else (like.min(), like.max())
    )
    scaled = np.clip((np.asarray(picture, float) - low) / max(high - low, 1e-9), 0, 1)
    if scaled.ndim == 2 and like.shape[-1] in (3, 4):  # many pictures in one, pixel after pixel
        rest = -len(scaled) % ROW
        scaled = np.pad(scaled, ((0, rest), (0, 0))).reshape(-1, ROW, scaled.shape[1])
    scaled = scaled.reshape(*scaled.shape[:2], -1)
    return scaled[..., :3] if scaled.shape[2] >= 3 else np.repeat(scaled[..., :1], 3, axis=2)


def panels(before: Any, after: Any) -> list[Any]:
    """Before, after and their difference around gray, levels (H, W, 3), each pixel enlarged."""
    old, new = shown(before, before), shown(after, before)
    difference = 0.5 + 0.5 * np.clip(amplified(before, after) * (new - old), -1, 1)
    made = [old ** (1 / 2.2), new ** (1 / 2.2), difference]
    enlarged = max(1, PANEL // old.shape[1])
    return [
        np.rint(255 * panel).astype(np.uint8).repeat(enlarged, 0).repeat(enlarged, 1)
        for panel in made
    ]


def captioned(panel: Any, text: str) -> Any:
    """A panel under its caption, as wide as the wider of both."""
    font = ImageFont.load_default(12)
    wide = max(panel.shape[1], math.ceil(font.getlength(text)) + 4)
    page = Image.new("RGB", (wide, CAPTION + panel.shape[0]), "white")
    ImageDraw.Draw(page).text((2, 2), text, "black", font)
    page.paste(Image.fromarray(panel), (0, CAPTION))
    return np.asarray(page)


def write_sheet(
    name: str,
    before: Any,
    after: Any,
    decibels: tuple[float, float] | None = None,
    folder: Path = FOLDER,
) -> Path:
    """Write a sheet of two pictures of one shape, and tell where it is."""
    texts = captions(before, after, decibels)
    parts = [captioned(*each) for each in zip(panels(before, after), texts, strict=True)]
    high = max(len(part) for part in parts)
    padded = [
        np.pad(part, ((0, high - len(part)), (0, GAP), (0, 0)), constant_values=255)
        for part in parts
    ]
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{re.sub(r'[^a-z0-9]+', '-', name)}.png"
    Image.fromarray(np.concatenate(padded, axis=1)).save(path)
    return path
