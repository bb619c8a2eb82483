"""Export a picture of the page as command, settings file, Python or notebook."""

import json
import math
import shlex
from collections.abc import Sequence
from typing import Any

from resample.cameras.viewpoints import Orbit, viewpoint_of
from resample.command.settings_files import appearance_settings, as_toml
from resample.view.views import Settings, Size, marks_in

KEYFRAMES = "keyframes.toml"
ORBITING = {"file": KEYFRAMES, "steered": ["camera", "fov", "up"]}  # films that orbit
STEP = 2.0  # seconds from one keyframe to the next


def exports_of(
    about: dict[str, Any],
    settings: Settings,
    size: Size,
    cameras: Sequence[str] = (),
    keyframes: str = "",
) -> dict[str, str]:
    """Texts that reproduce the picture, and a film through keyframes.

    `size`: width and height, px.
    """
    command, inputs = about["command"], about["inputs"]
    whole = {**about.get("fixed", {}), **settings, "size": f"{size[0]}x{size[1]}"}
    words = [*command.split(), *inputs, *option_words(whole)]
    made_by = about.get("function", "picture")
    named = ", ".join(map(repr, inputs))
    lines = "".join(f"    {key!r}: {value!r},\n" for key, value in whole.items())
    python = (
        f"from {about['package']}.viewing import {made_by}\n\n"
        f"shown = {made_by}({named}, {{\n{lines}}})\n"
    )
    film = {}
    if len(cameras) > 1 and "film" in about:
        film = {"keyframes": keyframes, "film": _film(about, whole, len(cameras))}
    return {
        "command": shlex.join([*words, "-o", "picture.png"]),
        "settings": as_toml(command, appearance_settings(whole, marks_in(command))),
        "python": python + 'shown.save("picture.png")\n',
        "notebook": python + "shown\n",
        **film,
    }


def keyframes_as_toml(cameras: Sequence[str], settings: Settings) -> str:
    """Write keyframes as TOML, `STEP` apart, each along the shorter rotation from the previous."""
    tables, last = [], 0.0
    for n, text in enumerate(cameras):
        orbit = viewpoint_of(text)
        if not isinstance(orbit, Orbit):
            raise ValueError(
                f"keyframe {text!r:.60} is not azimuth,elevation,zoom; films need such cameras"
            )
        azimuth = orbit.azimuth if n == 0 else last + math.remainder(orbit.azimuth - last, 360.0)
        last = azimuth
        tables.append(
            f"[[camera]]\ntime = {n * STEP:g}\nazimuth = {azimuth!r}\n"
            f"elevation = {orbit.elevation!r}\nzoom = {orbit.zoom!r}\npan = {list(orbit.pan)!r}\n"
            f"fov = {float(settings.get('fov', orbit.fov))!r}\n"
            f"up = {json.dumps(settings.get('up', orbit.up))}\n"
        )
    return "\n".join(tables)


def _film(about: dict[str, Any], settings: Settings, count: int) -> str:
    """Command that makes a film through `count` keyframes."""
    film = about["film"]
    known = film.get("options", settings)
    still = {
        key: value for key, value in settings.items() if key in known and key not in film["steered"]
    }
    words = [*film["command"].split(), *about["inputs"], *option_words(still)]
    words.append(f"--path={film['file']}")
    if "each" in film:
        words.append(f"--frames={film['each'] * (count - 1) + 1}")
    return shlex.join([*words, "-o", "film.mp4"])


def option_words(settings: Settings) -> list[str]:
    """Arguments of a command line that set all options."""
    words: list[str] = []
    for key, value in settings.items():
        if isinstance(value, bool):
            words.append(f"--{key}" if value else f"--no-{key}")
        else:
            words += [f"--{key}={one}" for one in (value if isinstance(value, list) else [value])]
    return words
