"""How a picture on the page is made without the page: command, settings file, Python, notebook."""

import json
import math
import shlex
from collections.abc import Sequence
from typing import Any

from resample.cameras.viewpoints import Orbit, viewpoint_of
from resample.command.settings_files import as_toml, look_of
from resample.view.views import Settings, Size, marks_in

ORBITING = {"file": "keyframes.toml", "steered": ["camera", "fov", "up"]}  # films around things
STEP = 2.0  # seconds from one keyframe to the next


def exports_of(
    about: dict[str, Any],
    settings: Settings,
    size: Size,
    cameras: Sequence[str] = (),
    keyframes: str = "",
) -> dict[str, str]:
    """Texts that make the picture again, and a film through keyframes.

    Parameters
    ----------
    about
        Of the view; its command, inputs, `fixed` options and what makes pictures are used.
    settings
        Options by name.
    size
        Width and height, px.
    cameras, keyframes
        Of a film, and the file that holds them; of one camera there is none.
    """
    command, inputs = about["command"], about["inputs"]
    whole = {**about.get("fixed", {}), **settings, "size": f"{size[0]}x{size[1]}"}
    words = [*command.split(), *inputs, *_options(whole)]
    made_by = about.get("function", "picture")
    named = ", ".join(map(repr, inputs))
    python = (
        f"from {about['package']}.viewing import {made_by}\n\n"
        f"shown = {made_by}({named}, {_indented(whole)})\n"
    )
    film = {}
    if len(cameras) > 1 and "film" in about:
        film = {"keyframes": keyframes, "film": _film(about, whole, len(cameras))}
    return {
        "command": shlex.join([*words, "-o", "picture.png"]),
        "settings": as_toml(command, look_of(whole, marks_in(command))),
        "python": python + 'shown.save("picture.png")\n',
        "notebook": python + "shown\n",
        **film,
    }


def keyframes_as_toml(cameras: Sequence[str], settings: Settings) -> str:
    """File of keyframes, `STEP` apart, each the short way round from the one before.

    Raises
    ------
    ValueError
        One is no camera around what is looked at.
    """
    tables, last = [], 0.0
    for n, text in enumerate(cameras):
        orbit = viewpoint_of(text)
        if not isinstance(orbit, Orbit):
            raise ValueError(f"a keyframe {text!r:.60}; films go through cameras of angles")
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
    """Command of a film through so many keyframes."""
    film = about["film"]
    known = film.get("options", settings)
    still = {
        key: value for key, value in settings.items() if key in known and key not in film["steered"]
    }
    words = [*film["command"].split(), *about["inputs"], *_options(still)]
    words.append(f"--path={film['file']}")
    if "each" in film:
        words.append(f"--frames={film['each'] * (count - 1) + 1}")
    return shlex.join([*words, "-o", "film.mp4"])


def _options(settings: Settings) -> list[str]:
    """Words of a command line that choose all values."""
    return [word for key, value in settings.items() for word in _words(key, value)]


def _words(key: str, value: Any) -> Sequence[str]:
    """Words of a command line that choose a value."""
    if isinstance(value, bool):
        return [f"--{key}" if value else f"--no-{key}"]
    if isinstance(value, list):
        return [f"--{key}={one}" for one in value]
    return [f"--{key}={value}"]


def _indented(settings: dict[str, Any]) -> str:
    lines = [f"    {key!r}: {value!r}," for key, value in settings.items()]
    return "{\n" + "\n".join(lines) + "\n}"
