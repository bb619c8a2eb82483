"""What comparing commands have in common: names of methods, and rows as JSON."""

import json
import math
from collections.abc import Mapping, Sequence
from typing import Annotated

from cyclopts import Parameter

from resample.command.flags import OptionTopic

Json = Annotated[
    bool,
    OptionTopic.APPEARANCE,
    Parameter(
        name="--json",
        negative="",
        help="Print JSON instead of a table; the PSNR of equal pictures is null.",
    ),
]


def method_names(text: str, least: int = 1) -> list[str]:
    """Split a list of methods at commas.

    A part with = but no name is another parameter of the preceding method, as in
    `oiio:filter=cubic,opencv-supersample:n=4,kernel=linear`.
    """
    names: list[str] = []
    for part in filter(None, (word.strip() for word in text.split(","))):
        if names and "=" in part and ":" not in part.partition("=")[0]:
            names[-1] += f",{part}"
        else:
            names.append(part)
    if len(names) < least:
        raise ValueError("give methods to compare, such as bilinear,hybrid")
    return list(dict.fromkeys(names))


def rows_as_json(rows: Sequence[Mapping[str, object]]) -> str:
    """Format rows as JSON, where infinity becomes null."""
    finite = [
        {key: None if value == math.inf else value for key, value in row.items()} for row in rows
    ]
    return json.dumps(finite, indent=2) + "\n"
