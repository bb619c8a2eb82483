"""How a picture on the page is made without the page: command, settings file, Python, notebook."""

import shlex
from collections.abc import Sequence
from typing import Any

from resample.files.facts.settings import as_toml
from resample.view.views import Settings, Size


def exports_of(about: dict[str, Any], settings: Settings, size: Size) -> dict[str, str]:
    """Texts that make the picture again.

    Parameters
    ----------
    about
        Of the view; its command and inputs are used.
    settings
        Options by name.
    size
        Width and height, px.
    """
    command, inputs = about["command"], about["inputs"]
    whole = {**settings, "size": f"{size[0]}x{size[1]}"}
    words = [*command.split(), *inputs]
    for key, value in whole.items():
        words += _words(key, value)
    named = ", ".join(map(repr, inputs))
    python = (
        f"from {about['package']}.viewing import picture\n\n"
        f"shown = picture({named}, {_indented(whole)})\n"
    )
    return {
        "command": shlex.join([*words, "-o", "picture.png"]),
        "settings": as_toml(command, whole),
        "python": python + 'shown.save("picture.png")\n',
        "notebook": python + "shown\n",
    }


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
