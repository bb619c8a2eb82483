"""Options that judged commands may have: those that say what is wanted, and two more.

A score is that of the *default* if all options of its command say what the input and the output
are, how large the picture is, what is seen in it, in which units, and how a volume looks.
"""

import shlex
from collections.abc import Iterable

SAYS_WHAT = {
    "-o": "output",
    "--size": "size",
    "--matrix": "view",
    "--degrees": "view",
    "--camera": "view",
    "--fov": "view",
    "--pose": "view",
    "--intrinsics": "view",
    "--also": "input",
    "--channel": "input",
    "--labels": "input",
    "--eyes": "output",
    "--depth-scale": "units",
    "--disparity-scale": "units",
    "--units": "units",
    "--transfer": "look",
    "--no-shading": "look",
    "--label": "look",
    "--projection": "kind of picture",
}
SAYS_HOW = {
    "--order": "the order that is judged",
    "--subpixels": "single rays, as the truth of that order has them",
    "--threads": "one thread, as the peer has",
}


def options(command: str) -> dict[str, str]:
    """Options of a command, with their values as it has them."""
    found, words = dict[str, str](), shlex.split(command)
    for n, word in enumerate(words):
        name, equals, value = word.partition("=")
        if word.startswith("--") or word == "-o":
            following = words[n + 1] if n + 1 < len(words) else "-o"
            has_none = following == "-o" or following.startswith("--")
            found[name] = value if equals else "" if has_none else following
    return found


def label(commands: Iterable[str]) -> str:
    """What a cell of these commands is called: `default`, or by its options that say how."""
    found = {
        f"{name} {value}"
        for command in commands
        for name, value in options(command).items()
        if name not in SAYS_WHAT
    }
    return f"`{' '.join(sorted(found))}`" if found else "default"
