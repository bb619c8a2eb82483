"""Provenance: the command and options that made a picture, stored in its file."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any

from resample.reading.pictures import opened

KEY = "resample:settings"  # key of the text in PNG and EXR
SUFFIXES = (".png", ".exr")  # files that can store it

_settings: ContextVar[str] = ContextVar("settings", default="")


@contextmanager
def stating(settings: str) -> Iterator[None]:
    """Store these settings, as TOML, in pictures written in this block."""
    # Texts of PNG are ASCII.
    token = _settings.set("".join(c if ord(c) < 128 else f"\\U{ord(c):08x}" for c in settings))
    try:
        yield
    finally:
        _settings.reset(token)


def state(spec: Any, path: Path) -> None:
    """Add the settings, if any, to an OpenImageIO header if the format can store them."""
    text = _settings.get()
    if text and path.suffix.lower() in SUFFIXES:
        spec.attribute(KEY, text)


def stated() -> dict[str, str]:
    """Texts to store in a PNG file: the settings, if any."""
    text = _settings.get()
    return {KEY: text} if text else {}


def settings_in(path: Path) -> str:
    """Read the settings, as TOML, that a picture was made with."""
    source = opened(path)
    text = str(source.spec().get_string_attribute(KEY))
    source.close()
    if not text:
        raise ValueError(
            f"{path} holds no settings; give a PNG or EXR that these commands have written, or a "
            ".toml file"
        )
    return text
