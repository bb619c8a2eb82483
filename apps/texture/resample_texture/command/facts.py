"""What picture files say of themselves, for `resample-texture info`."""

from typing import Any

from resample.files.pictures import picture_at
from resample.files.sequences import frames_of
from resample.files.stores.opening import Place


def facts_in(path: Place) -> dict[str, Any]:
    """Return what a file of one or more pictures says, as JSON values.

    Raises ValueError, OSError: it cannot be read.
    """
    frames = frames_of(path)
    facts: dict[str, Any] = {"kind": "picture"}
    if frames is not None:
        duration = round(sum(frames.seconds), 3)
        facts = {"kind": "pictures", "count": len(frames.seconds), "seconds": duration}
        facts["plays"] = frames.plays or "without end"
        if frames.pages is None:
            first = next(iter(frames.read())).data
            return {**facts, "size": [first.shape[1], first.shape[0]]}
    header = picture_at(path).header
    kind, about = header.kind, header.about
    return {
        **facts,
        "size": [header.size[1], header.size[0]],
        "channels": list(kind.channels),
        "values": about.number or f"{kind.bits} bits",
        "meaning": _meaning(about.number, is_encoded=kind.is_encoded),
        "assumed": about.assumed or None,
        "colors": about.colors or None,
        "orientation": header.orientation,
        "georeference": about.geo is not None and about.geo.has_place,
    }


def _meaning(number: str, *, is_encoded: bool) -> str:
    if number:
        return "numbers"
    return "levels of displays" if is_encoded else "linear light"
